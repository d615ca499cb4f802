//! libFuzzer's entry to [`bonemill_fuzz::trajectory_csv`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::trajectory_csv(data));
