//! libFuzzer's entry to [`bonemill_fuzz::nifti`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::nifti(data));
