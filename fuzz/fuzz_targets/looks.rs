//! See `foxhound_fuzz::looks`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::looks(case);
});
