//! What every reader keeps to: claimed sizes are checked before they are believed, memory grows with the data that are
//! really there, and the text of a file enters an error message only clamped and escaped.

use crate::error::{Error, Result, bytes, escaped, shown};
use crate::room::more;
use crate::scene::Grid;
use flate2::bufread::{GzDecoder, ZlibDecoder};
use glam::DAffine3;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Most characters of a file's own text that an error quotes.
const QUOTED: usize = 200;

/// No deflate stream grows to more than this many times its own length (258 bytes from 2 bits, and some headers).
const DEFLATE_RATIO: u64 = 1032;

/// A file's text as an error quotes it: control characters escaped, at most 200 characters.
pub(crate) fn quote(text: &str) -> String {
    let mut out = String::new();
    for (i, c) in escaped(text).enumerate() {
        if i >= QUOTED {
            out.push('…');
            break;
        }
        out.push(c);
    }
    out
}

/// An [`Error::Format`].
pub(crate) fn bad(path: &Path, what: impl Into<String>, right: impl Into<String>) -> Error {
    Error::Format { path: path.to_owned(), what: what.into(), right: right.into() }
}

/// An [`Error::Io`].
pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Error {
    Error::Io { path: path.to_owned(), action, source }
}

/// The next byte of a file, none at its end; `at` counts them.
pub(crate) fn next_byte(path: &Path, file: &mut impl BufRead, at: &mut u64) -> Result<Option<u8>> {
    let byte = file.fill_buf().map_err(|e| io(path, "read", e))?.first().copied();
    if byte.is_some() {
        file.consume(1);
        *at += 1;
    }
    Ok(byte)
}

/// "256x256x128".
pub(crate) fn shape(dims: [usize; 3]) -> String {
    format!("{}x{}x{}", dims[0], dims[1], dims[2])
}

/// A grid whose numbers come from a file: what is wrong with them is said of the file.
pub(crate) fn grid(path: &Path, dims: [usize; 3], voxel_to_world: DAffine3) -> Result<Grid> {
    Grid::new(dims, voxel_to_world).map_err(|e| match e {
        Error::Invalid { item, what, right } => bad(path, format!("{item}: {what}"), right),
        other => other,
    })
}

/// Opens a regular file and says how long it is. Anything else (a folder, a pipe, a device) could block or never end.
pub(crate) fn open(path: &Path) -> Result<(BufReader<File>, u64)> {
    let before = std::fs::metadata(path).map_err(|e| io(path, "open", e))?;
    if !before.is_file() {
        return Err(match before.is_dir() {
            true => bad(path, "it is a folder", "name a file"),
            false => bad(path, "it is a pipe or a device", "a regular file is needed: save its data to one first"),
        });
    }
    let file = File::open(path).map_err(|e| io(path, "open", e))?;
    let length = file.metadata().map_err(|e| io(path, "open", e))?.len();
    Ok((BufReader::with_capacity(1 << 16, file), length))
}

/// The sample bytes of a file: plain, of known length, gzip, or as another decoder yields them.
pub(crate) enum Source {
    /// Bytes as they stand; so many are left.
    Plain(BufReader<File>, u64),
    /// Gzip, from so many compressed bytes.
    Gzip(Gunzip, u64),
    /// What a decoder of that name ("zlib", "base64", …) yields: at most so many bytes.
    Coded(Box<dyn Read>, &'static str, u64),
}

impl Source {
    /// From byte `at` of an opened file of `length` bytes.
    pub fn new(path: &Path, mut file: BufReader<File>, length: u64, at: u64, gzip: bool) -> Result<Self> {
        file.seek(SeekFrom::Start(at)).map_err(|e| io(path, "read", e))?;
        let left = length.saturating_sub(at);
        Ok(if gzip { Source::Gzip(Gunzip::new(file), left) } else { Source::Plain(file, left) })
    }

    /// A zlib stream of at most `length` bytes at the reader's place.
    pub fn zlib(file: BufReader<File>, length: u64) -> Self {
        Source::Coded(Box::new(ZlibDecoder::new(file.take(length))), "zlib", length.saturating_mul(DEFLATE_RATIO))
    }

    /// How the bytes are coded, where they are.
    pub fn coding(&self) -> Option<&'static str> {
        match self {
            Source::Plain(..) => None,
            Source::Gzip(..) => Some("gzip"),
            Source::Coded(_, name, _) => Some(name),
        }
    }

    /// Refuses a claim of `needs` bytes that the file cannot hold, before anything is allocated. `what` names the
    /// claim: "4x4x4 uint8 samples".
    pub fn check_claim(&self, path: &Path, what: &str, needs: u64) -> Result<()> {
        match self {
            Source::Plain(_, left) if needs > *left => Err(bad(
                path,
                format!("{what} need {needs} bytes, the file holds {left} there"),
                "the file is cut short or its header is wrong",
            )),
            Source::Gzip(_, left) if needs / DEFLATE_RATIO > *left => Err(bad(
                path,
                format!("{what} need {needs} bytes, more than {left} bytes of gzip data can hold"),
                "the file is cut short or its header is wrong",
            )),
            Source::Coded(_, name, most) if needs > *most => Err(bad(
                path,
                format!("{what} need {needs} bytes, more than the {name} data can hold ({most})"),
                "the file is cut short or its header is wrong",
            )),
            _ => Ok(()),
        }
    }

    /// Skips `count` bytes.
    pub fn skip(&mut self, path: &Path, count: u64) -> Result<()> {
        match self {
            Source::Plain(file, left) => {
                if count > *left {
                    return Err(bad(
                        path,
                        format!("{count} bytes are to be skipped where {left} are left"),
                        "the skip must lie inside the file",
                    ));
                }
                *left -= count;
                file.seek_relative(count as i64).map_err(|e| io(path, "read", e))
            }
            _ => match std::io::copy(&mut (&mut *self).take(count), &mut std::io::sink()) {
                Ok(n) if n == count => Ok(()),
                Ok(n) => Err(bad(path, format!("{count} bytes are to be skipped where {n} are left"), "the skip must lie inside the data")),
                Err(e) => Err(damaged(path, self, e, format!("in the {count} bytes to be skipped"))),
            },
        }
    }

    /// Call after the last sample: checks the gzip checksum, and warns of bytes that nothing asked for.
    pub fn finish(mut self, path: &Path) -> Result<()> {
        let mut byte = [0];
        match self.read(&mut byte) {
            Ok(n) => {
                if n > 0 || matches!(&mut self, Source::Gzip(g, _) if g.junk) {
                    log::warn!("{}: bytes follow the samples; they are not read", shown(path));
                }
                Ok(())
            }
            Err(e) => Err(damaged(path, &self, e, "after the last sample".into())),
        }
    }
}

impl Read for Source {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Source::Plain(file, left) => {
                // Not beyond what is its: other data may follow.
                let n = file.take(*left).read(buf)?;
                *left = left.saturating_sub(n as u64);
                Ok(n)
            }
            Source::Gzip(g, _) => g.read(buf),
            Source::Coded(r, ..) => r.read(buf),
        }
    }
}

/// What a failed read means.
pub(crate) fn damaged(path: &Path, source: &Source, error: std::io::Error, place: String) -> Error {
    use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    // A decoder that knows more says it in an error of ours.
    let error = match error.downcast::<Error>() {
        Ok(ours) => return ours,
        Err(error) => error,
    };
    match (error.kind(), source.coding()) {
        (UnexpectedEof, Some(coding)) => {
            bad(path, format!("the {coding} data break off {place}"), "the file is cut short; a whole one is needed")
        }
        (InvalidData | InvalidInput, Some(coding)) => {
            bad(path, format!("the {coding} data are damaged {place}: {}", quote(&error.to_string())), "an undamaged file is needed")
        }
        _ => io(path, "read", error),
    }
}

/// Gzip of one or more members, as `gzip` and `pigz` write it; bytes after the last member that are no gzip are left.
pub(crate) struct Gunzip {
    inner: Option<GzDecoder<BufReader<File>>>,
    /// Bytes that are no gzip follow the last member.
    junk: bool,
}

impl Gunzip {
    /// Starts at the reader's place.
    pub fn new(file: BufReader<File>) -> Self {
        Self { inner: Some(GzDecoder::new(file)), junk: false }
    }
}

impl Read for Gunzip {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        while let Some(decoder) = &mut self.inner {
            let n = decoder.read(buf)?;
            if n > 0 {
                return Ok(n);
            }
            // The member is over, its checksum was right.
            let next = decoder.get_mut().fill_buf()?;
            let (over, gzip) = (next.is_empty(), next.first() == Some(&0x1f));
            self.inner = match self.inner.take() {
                Some(decoder) if gzip => Some(GzDecoder::new(decoder.into_inner())),
                _ => {
                    self.junk = !over;
                    None
                }
            };
        }
        Ok(0)
    }
}

/// Refuses `count` samples of `each` bytes in memory beyond `cap`; returns the count as a length.
pub(crate) fn check_cap(path: &Path, what: &str, count: u64, each: u64, cap: u64) -> Result<usize> {
    let refuse = |size: String| {
        Err(bad(
            path,
            format!("{what} need {size} of memory"),
            format!("the limit is {}: make the volume smaller, by cropping or resampling it", bytes(cap)),
        ))
    };
    match count.checked_mul(each) {
        None => refuse("more than 16 EiB".into()),
        Some(size) if size > cap || size > isize::MAX as u64 => refuse(bytes(size)),
        Some(_) => Ok(count as usize),
    }
}

/// Makes room for `add` more of `total` elements: at least doubling, never beyond `total`.
pub(crate) fn grow<T>(path: &Path, vec: &mut Vec<T>, add: usize, total: usize) -> Result<()> {
    if vec.capacity() - vec.len() >= add {
        return Ok(());
    }
    let wanted = (vec.capacity() * 2).min(total).max(vec.len() + add);
    let add = wanted - vec.len();
    more(|| format!("{}: what it holds", shown(path)), vec, add)
}

/// Reads until `buf` is full or the data end; what was read before an error counts.
pub(crate) fn fill(source: &mut dyn Read, buf: &mut [u8]) -> (usize, Option<std::io::Error>) {
    let mut n = 0;
    while n < buf.len() {
        match source.read(&mut buf[n..]) {
            Ok(0) => break,
            Ok(k) => n += k,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return (n, Some(e)),
        }
    }
    (n, None)
}
