//! libFuzzer's way into [`bonemill_fuzz::job_toml`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::job_toml(data));
