//! TIFF files byte by byte: what encoders do not write.

/// The value of an entry.
#[derive(Clone)]
pub enum Value {
    Short(u16),
    Long(Vec<u32>),
    Text(String),
    Rational(u32, u32),
}

/// A directory: entries in ascending order of their tags.
pub type Directory = Vec<(u16, Value)>;

/// A little-endian TIFF of some directories; `data` begin at byte 8.
pub fn tiff(data: &[u8], directories: &[Directory]) -> Vec<u8> {
    let mut out = [&b"II*\0"[..], &[0; 4], data].concat();
    // Where the place of the next directory stands.
    let mut link = 4;
    for directory in directories {
        let mut entries = (directory.len() as u16).to_le_bytes().to_vec();
        for (tag, value) in directory {
            let (kind, count, bytes) = match value {
                Value::Short(v) => (3u16, 1, v.to_le_bytes().to_vec()),
                Value::Long(v) => (4, v.len(), v.iter().flat_map(|n| n.to_le_bytes()).collect()),
                Value::Rational(n, d) => (5, 1, [n.to_le_bytes(), d.to_le_bytes()].concat()),
                Value::Text(t) => (2, t.len() + 1, [t.as_bytes(), &[0]].concat()),
            };
            let mut place = bytes.clone();
            if bytes.len() > 4 {
                place = (out.len() as u32).to_le_bytes().to_vec();
                out.extend(bytes);
                out.resize(out.len().next_multiple_of(2), 0);
            }
            place.resize(4, 0);
            entries.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &(count as u32).to_le_bytes(), &place].concat());
        }
        out.resize(out.len().next_multiple_of(2), 0);
        let at = out.len() as u32;
        out[link..link + 4].copy_from_slice(&at.to_le_bytes());
        out.extend(entries);
        link = out.len();
        out.extend([0; 4]);
    }
    out
}

/// A page of one uncompressed strip that begins at byte `at`; `format` is 1 for unsigned integers, 2 for signed ones, 3 for floats.
pub fn page(size: [u32; 2], bits: u16, format: u16, photometric: u16, at: u32) -> Directory {
    let [width, height] = size.map(|n| Value::Long(vec![n]));
    let bytes = size[0] * size[1] * u32::from(bits) / 8;
    vec![
        (256, width),
        (257, height),
        (258, Value::Short(bits)),
        (259, Value::Short(1)),
        (262, Value::Short(photometric)),
        (273, Value::Long(vec![at])),
        (277, Value::Short(1)),
        (278, Value::Long(vec![size[1]])),
        (279, Value::Long(vec![bytes])),
        (339, Value::Short(format)),
    ]
}

/// Puts an entry where its tag belongs, or changes it.
pub fn set(directory: &mut Directory, tag: u16, value: Value) {
    directory.retain(|(t, _)| *t != tag);
    directory.push((tag, value));
    directory.sort_by_key(|(t, _)| *t);
}

/// LZW of codes that each stand for a byte, cleared before they need more than nine bits.
pub fn lzw(bytes: &[u8]) -> Vec<u8> {
    let codes = bytes.chunks(200).flat_map(|c| std::iter::once(256).chain(c.iter().map(|&b| u16::from(b)))).chain([257]);
    let bits: Vec<u8> = codes.flat_map(|code| (0..9).rev().map(move |i| (code >> i & 1) as u8)).collect();
    bits.chunks(8).map(|c| c.iter().enumerate().fold(0, |byte, (i, bit)| byte | bit << (7 - i))).collect()
}
