#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| halflight_fuzz::volume(&halflight_fuzz::file("a.nrrd", data), data.len()));
