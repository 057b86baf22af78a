#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let path = halflight_fuzz::file("field.nrrd", data);
    if halflight::io::is_nrrd_field(&path).is_ok() {
        let _ = halflight::io::read_nrrd_field(&path, &halflight_fuzz::options());
    }
});
