//! libFuzzer's entry to [`bonemill_fuzz::plan_toml`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::plan_toml(data));
