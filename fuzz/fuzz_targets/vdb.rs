#![no_main]
// The input has its runs of zeros coded.
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    halflight_fuzz::volume(&halflight_fuzz::file("a.vdb", &halflight_fuzz::unpack(data, 1 << 17)), data.len());
});
