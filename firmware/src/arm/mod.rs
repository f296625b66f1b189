//! What the boards with an Arm Cortex-M share: the record of a crash, the stack, and how the thread sleeps.

#[expect(unsafe_code, reason = "memory that a reset leaves alone")]
pub(crate) mod crash_record;
#[expect(unsafe_code, reason = "the stack as memory")]
pub(crate) mod stack;

/// Sleeps until the next interrupt, unless this is so already. One that comes in between still ends the sleep.
pub(crate) fn sleep_unless(is_ready: impl Fn() -> bool) {
    cortex_m::interrupt::free(|_| {
        if !is_ready() {
            cortex_m::asm::wfi();
        }
    });
}
