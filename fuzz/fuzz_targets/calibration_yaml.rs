//! libFuzzer's entry to [`bonemill_fuzz::calibration_yaml`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::calibration_yaml(data));
