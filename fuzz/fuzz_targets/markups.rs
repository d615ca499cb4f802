//! libFuzzer's entry to [`bonemill_fuzz::formats::markups`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::formats::markups(data));
