//! See `foxhound_fuzz::pad`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::pad(case);
});
