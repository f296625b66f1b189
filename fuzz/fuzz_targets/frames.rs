//! See `foxhound_fuzz::frames`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::frames(case);
});
