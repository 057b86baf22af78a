//! The samples of a `.vti` file: base64, counted or in compressed blocks, decoded as they are asked for.

use super::limits::{Source, bad, io};
use super::samples::Layout;
use super::vti_blocks::{Blocks, HELD, Packing};
use crate::error::{Result, bytes as bytes_text};
use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

/// How numbers stand in the file.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coding {
    pub big_endian: bool,
    /// Sizes have 8 bytes, not 4.
    pub wide: bool,
    pub packing: Option<Packing>,
}

/// Where an array's values lie.
#[derive(Clone, Copy, Debug)]
pub(super) enum Place {
    /// Numbers in text, from byte to byte.
    Text((u64, u64)),
    /// Base64, from byte to byte.
    Inline((u64, u64)),
    /// So many bytes behind the underscore of the appended data.
    Appended(u64),
}

/// The bytes of an array's values.
pub(super) fn data(
    path: &Path,
    mut file: BufReader<File>,
    length: u64,
    place: &Place,
    appended: Option<(u64, bool)>,
    coding: &Coding,
    layout: &Layout,
) -> Result<Source> {
    let (at, end, base64) = match *place {
        Place::Text((at, end)) => return Source::new(path, file, end.min(length), at, false),
        Place::Inline((at, end)) => (at, end.min(length), true),
        Place::Appended(offset) => {
            let Some((after, base64)) = appended else {
                return Err(bad(path, "its array is appended, and there are no appended data", "the file is cut short"));
            };
            let at = underscore(path, &mut file, after)?.saturating_add(offset);
            if at > length {
                return Err(bad(path, format!("its array begins at byte {at}, the file ends at {length}"), "the file is cut short"));
            }
            (at, length, base64)
        }
    };
    file.seek(SeekFrom::Start(at)).map_err(|e| io(path, "read", e))?;
    let left = end.saturating_sub(at);
    let plain = file.take(left);
    let (mut bytes, most): (Box<dyn Read>, u64) =
        if base64 { (Box::new(Base64::new(plain)), left / 4 * 3) } else { (Box::new(plain), left) };
    let needs = layout.stored_bytes().unwrap_or(u64::MAX);
    let failed = |e: Error| bad(path, format!("the size of an array at byte {at} cannot be read: {e}"), "the file is cut short or damaged");
    let first = size(&mut bytes, coding).map_err(failed)?;
    let Some(packing) = coding.packing else {
        if first != needs {
            return Err(bad(
                path,
                format!("{} need {needs} bytes, the file says that there are {first}", layout.what()),
                "its header is wrong",
            ));
        }
        return Ok(Source::Coded(Box::new(bytes.take(needs)), if base64 { "base64" } else { "raw" }, most));
    };
    // Blocks: how many, of which size, of which size the last (0: whole), and each one's compressed size.
    let (block, last) = (size(&mut bytes, coding).map_err(failed)?, size(&mut bytes, coding).map_err(failed)?);
    let whole = if last == 0 { first } else { first.saturating_sub(1) };
    if whole.checked_mul(block).and_then(|n| n.checked_add(last)) != Some(needs) {
        let what = format!("{} need {needs} bytes, the file has {first} blocks of {block}, the last of {last}", layout.what());
        return Err(bad(path, what, "its header is wrong"));
    }
    if packing != Packing::Zlib && block.max(last) > HELD {
        let what = format!("its blocks have {}, and are decoded whole", bytes_text(block.max(last)));
        return Err(bad(path, what, format!("at most {} are read: VTK's own are of 32 KiB", bytes_text(HELD))));
    }
    let mut sizes = Vec::new();
    for _ in 0..first {
        if sizes.len() as u64 * 4 > left {
            return Err(bad(path, format!("it says that an array has {first} blocks"), "the file is cut short or its header is wrong"));
        }
        sizes.push(size(&mut bytes, coding).map_err(failed)?);
    }
    let blocks = Blocks::new(bytes, packing, sizes, block, last);
    Ok(Source::Coded(Box::new(blocks), packing.name(), most.saturating_mul(packing.ratio())))
}

/// The byte behind the `_` that begins appended data.
fn underscore(path: &Path, file: &mut BufReader<File>, after: u64) -> Result<u64> {
    file.seek(SeekFrom::Start(after)).map_err(|e| io(path, "read", e))?;
    for at in after..after + 4096 {
        let byte = file.fill_buf().map_err(|e| io(path, "read", e))?.first().copied();
        file.consume(1.min(usize::from(byte.is_some())));
        match byte {
            Some(b'_') => return Ok(at + 1),
            Some(b) if b.is_ascii_whitespace() => {}
            _ => break,
        }
    }
    Err(bad(path, "its appended data do not begin with an underscore", "the file is cut short or damaged"))
}

/// A size in the file's own width and order.
fn size(bytes: &mut dyn Read, coding: &Coding) -> std::io::Result<u64> {
    let mut raw = [0; 8];
    let width = if coding.wide { 8 } else { 4 };
    bytes.read_exact(&mut raw[..width])?;
    if coding.big_endian {
        raw[..width].reverse();
    }
    Ok(u64::from_le_bytes(raw))
}

/// Base64, in groups of four; padding may stand within it, where writers put one coded part behind another.
struct Base64<R> {
    text: BufReader<R>,
    ready: [u8; 3],
    at: usize,
    count: usize,
    /// Trouble that came after bytes which went out first.
    trouble: Option<Error>,
}

impl<R: Read> Base64<R> {
    fn new(text: R) -> Self {
        Self { text: BufReader::new(text), ready: [0; 3], at: 0, count: 0, trouble: None }
    }

    /// The next group; none at the end, or at a tag.
    fn group(&mut self) -> std::io::Result<bool> {
        let (mut value, mut have, mut pad) = (0u32, 0, 0);
        while have < 4 {
            let Some(byte) = self.text.fill_buf()?.first().copied().filter(|b| *b != b'<') else {
                return match have {
                    0 => Ok(false),
                    _ => Err(Error::new(ErrorKind::InvalidData, "it ends within a group of four")),
                };
            };
            self.text.consume(1);
            let digit = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                b'=' if have >= 2 => 0,
                b if b.is_ascii_whitespace() => continue,
                _ => return Err(Error::new(ErrorKind::InvalidData, format!("'{}' is no digit of base64", byte.escape_ascii()))),
            };
            if byte != b'=' && pad > 0 {
                return Err(Error::new(ErrorKind::InvalidData, "a digit stands behind padding"));
            }
            pad += usize::from(byte == b'=');
            value = value << 6 | u32::from(digit);
            have += 1;
        }
        let [_, a, b, c] = value.to_be_bytes();
        (self.ready, self.at, self.count) = ([a, b, c], 0, 3 - pad);
        Ok(true)
    }
}

impl<R: Read> Read for Base64<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        if let Some(e) = self.trouble.take() {
            return Err(e);
        }
        let mut n = 0;
        while n < buf.len() {
            if self.at == self.count {
                match self.group() {
                    Ok(true) => continue,
                    Ok(false) => break,
                    Err(e) if n == 0 => return Err(e),
                    Err(e) => {
                        self.trouble = Some(e);
                        break;
                    }
                }
            }
            let k = (self.count - self.at).min(buf.len() - n);
            buf[n..n + k].copy_from_slice(&self.ready[self.at..self.at + k]);
            self.at += k;
            n += k;
        }
        Ok(n)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn decoded(text: &str) -> std::io::Result<Vec<u8>> {
        let mut out = Vec::new();
        Base64::new(text.as_bytes()).read_to_end(&mut out).map(|_| out)
    }

    #[test]
    fn base64_reads_in_groups() {
        assert_eq!(decoded("TWFu").expect("read"), b"Man");
        assert_eq!(decoded("TW\n Fu TWE= TQ==TWFu<x").expect("read"), b"ManMaMMan");
        for wrong in ["TWF", "TW=u", "T===", "TW!u", "=WFu"] {
            assert!(decoded(wrong).is_err(), "{wrong}");
        }
    }
}
