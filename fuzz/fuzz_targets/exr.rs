#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let path = halflight_fuzz::file("a.exr", data);
    // As a probe, as a frame that is compared, as one that is asked whether it is whole.
    match data.len() % 3 {
        0 => drop(halflight::io::is_probe(&path).and_then(|_| halflight::io::read_probe(&path))),
        1 => drop(halflight::io::read_picture(&path)),
        _ => drop(halflight::io::whole_picture(&path, &|_| true)),
    }
});
