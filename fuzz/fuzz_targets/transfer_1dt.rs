#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| halflight_fuzz::transfer(&halflight_fuzz::file("a.1dt", data), data.len()));
