#![no_main]
use halflight::io::{TransferOptions, read_transfer};
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let path = halflight_fuzz::file("a.json", data);
    for name in [None, Some("a".to_owned())] {
        let _ = read_transfer(&path, &TransferOptions { name, ..TransferOptions::new([-1.0, 9.0]) });
    }
});
