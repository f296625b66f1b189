//! See `foxhound_fuzz::lidar`.
#![no_main]

libfuzzer_sys::fuzz_target!(|case: &[u8]| {
    foxhound_fuzz::lidar(case);
});
