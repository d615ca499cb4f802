//! libFuzzer's way into [`bonemill_fuzz::mesh`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::mesh(data));
