//! The samples of a `.vti` file: base64, counted or in zlib blocks, decoded as they are asked for.

use super::limits::{Source, bad, io};
use super::samples::Layout;
use crate::error::Result;
use flate2::read::ZlibDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

/// How numbers stand in the file.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coding {
    pub big_endian: bool,
    /// Sizes have 8 bytes, not 4.
    pub wide: bool,
    pub zlib: bool,
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
    if !coding.zlib {
        if first != needs {
            return Err(bad(
                path,
                format!("{} need {needs} bytes, the file says that there are {first}", layout.what()),
                "its header is wrong",
            ));
        }
        return Ok(Source::Coded(Box::new(bytes.take(needs)), if base64 { "base64" } else { "raw" }, most));
    }
    // Blocks: how many, of which size, of which size the last (0: whole), and each one's compressed size.
    let (block, last) = (size(&mut bytes, coding).map_err(failed)?, size(&mut bytes, coding).map_err(failed)?);
    let whole = if last == 0 { first } else { first.saturating_sub(1) };
    if whole.checked_mul(block).and_then(|n| n.checked_add(last)) != Some(needs) {
        let what = format!("{} need {needs} bytes, the file has {first} blocks of {block}, the last of {last}", layout.what());
        return Err(bad(path, what, "its header is wrong"));
    }
    let mut sizes = Vec::new();
    for _ in 0..first {
        if sizes.len() as u64 * 4 > left {
            return Err(bad(path, format!("it says that an array has {first} blocks"), "the file is cut short or its header is wrong"));
        }
        sizes.push(size(&mut bytes, coding).map_err(failed)?);
    }
    let blocks = Blocks { inner: Some(Inner::Between(bytes)), sizes: sizes.into_iter(), block, last, left: first, missing: 0 };
    Ok(Source::Coded(Box::new(blocks), "zlib", most.saturating_mul(1032)))
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

/// Zlib streams one after the other.
struct Blocks<I> {
    inner: Option<Inner>,
    sizes: I,
    block: u64,
    /// Bytes of the last block; 0: as many as the others.
    last: u64,
    /// Blocks that are not begun.
    left: u64,
    /// Bytes that the present block still owes.
    missing: u64,
}

enum Inner {
    Between(Box<dyn Read>),
    Within(ZlibDecoder<std::io::Take<Box<dyn Read>>>),
}

impl<I: Iterator<Item = u64>> Read for Blocks<I> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        loop {
            match self.inner.take() {
                None => return Ok(0),
                Some(Inner::Between(bytes)) => {
                    let Some(size) = self.sizes.next() else { return Ok(0) };
                    self.left -= 1;
                    self.missing = if self.left == 0 && self.last > 0 { self.last } else { self.block };
                    self.inner = Some(Inner::Within(ZlibDecoder::new(bytes.take(size))));
                }
                Some(Inner::Within(mut decoder)) => {
                    let most = buf.len().min(usize::try_from(self.missing).unwrap_or(usize::MAX));
                    // Once more where it owes nothing: the checksum stands behind the last byte.
                    let n = if most == 0 { decoder.read(&mut [0])? } else { decoder.read(&mut buf[..most])? };
                    if (most == 0) != (n == 0) {
                        let what = if n == 0 { "a block ends before its size" } else { "a block is longer than its size" };
                        return Err(Error::new(ErrorKind::InvalidData, what));
                    }
                    if n > 0 {
                        self.missing -= n as u64;
                        self.inner = Some(Inner::Within(decoder));
                        return Ok(n);
                    }
                    let mut rest = decoder.into_inner();
                    std::io::copy(&mut rest, &mut std::io::sink())?;
                    self.inner = Some(Inner::Between(rest.into_inner()));
                }
            }
        }
    }
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
