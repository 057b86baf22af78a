#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let path = halflight_fuzz::file("a.hdr", data);
    let _ = halflight::io::is_probe(&path);
    let _ = halflight::io::read_probe(&path);
});
