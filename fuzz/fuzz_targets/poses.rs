//! libFuzzer's entry to [`bonemill_fuzz::poses`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::poses(data));
