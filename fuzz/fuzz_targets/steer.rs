//! See `foxhound_fuzz::steer`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::steer(case);
});
