//! Code that the boards with an Arm Cortex-M share: crash record, stack, sleep of the thread.

#[expect(unsafe_code, reason = "memory that a reset leaves alone")]
pub(crate) mod crash_record;
#[expect(unsafe_code, reason = "the stack as memory")]
pub(crate) mod stack;

/// Sleeps until the next interrupt, unless `is_ready` is true. An interrupt in between still ends the sleep.
pub(crate) fn sleep_unless(is_ready: impl Fn() -> bool) {
    cortex_m::interrupt::free(|_| {
        if !is_ready() {
            cortex_m::asm::wfi();
        }
    });
}
