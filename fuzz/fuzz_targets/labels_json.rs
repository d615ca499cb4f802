//! libFuzzer's entry to [`bonemill_fuzz::labels_json`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::labels_json(data));
