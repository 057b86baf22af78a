#![no_main]
// Two files of a folder: the bytes, cut where the first two of them say.
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let (at, rest) = data.split_at(data.len().min(2));
    let cut = at.iter().fold(0usize, |n, &b| n << 8 | usize::from(b)).min(rest.len());
    let first = halflight_fuzz::file("series/a.dcm", &rest[..cut]);
    halflight_fuzz::file("series/b.dcm", &rest[cut..]);
    if let Some(folder) = first.parent() {
        halflight_fuzz::volume(folder, data.len());
    }
});
