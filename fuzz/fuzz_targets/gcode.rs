//! libFuzzer's way into [`bonemill_fuzz::gcode`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| bonemill_fuzz::gcode(data));
