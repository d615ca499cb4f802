//! libFuzzer's entry to [`bonemill_fuzz::forces_csv`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::forces_csv(data));
