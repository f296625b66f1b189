//! See `foxhound_fuzz::link`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::link(case);
});
