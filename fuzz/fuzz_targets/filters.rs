//! See `foxhound_fuzz::filters`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::filters(case);
});
