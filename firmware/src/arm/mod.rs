//! What the boards with an Arm Cortex-M share: the record of a crash, and the stack.

#[expect(unsafe_code, reason = "memory that a reset leaves alone, the fault vector")]
pub(crate) mod crash_record;
#[expect(unsafe_code, reason = "the stack as memory")]
pub(crate) mod stack;
