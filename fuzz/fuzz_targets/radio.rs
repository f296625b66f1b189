//! See `foxhound_fuzz::radio`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::radio(case);
});
