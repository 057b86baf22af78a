//! The bytes of an OpenVDB file: little-endian numbers, length-prefixed strings, and where in the file one stands.

use super::super::limits::{bad, io};
use crate::error::Result;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

/// Longest name, type or text that is read, bytes.
const TEXT: u32 = 1 << 16;

/// An opened file and the place in it.
pub(super) struct Stream<'a> {
    pub path: &'a Path,
    file: BufReader<File>,
    at: u64,
    length: u64,
}

macro_rules! numbers {
    ($($name:ident: $type:ty),*) => {
        $(pub fn $name(&mut self, what: &'static str) -> Result<$type> {
            let mut bytes = [0; size_of::<$type>()];
            self.read(&mut bytes, what)?;
            Ok(<$type>::from_le_bytes(bytes))
        })*
    };
}

impl<'a> Stream<'a> {
    /// A file of `length` bytes, from its first.
    pub fn new(path: &'a Path, file: BufReader<File>, length: u64) -> Result<Self> {
        let mut stream = Self { path, file, at: 0, length };
        stream.seek(0, "the header")?;
        Ok(stream)
    }

    numbers! { u8: u8, u32: u32, i32: i32, i64: i64, f64: f64 }

    /// The byte that is next.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// Bytes from here to the file's end.
    pub fn left(&self) -> u64 {
        self.length - self.at
    }

    /// Goes to byte `at`, where `what` begins.
    pub fn seek(&mut self, at: u64, what: &'static str) -> Result<()> {
        if at > self.length {
            return Err(bad(self.path, format!("{what} begin at byte {at} of {}", self.length), "the file is cut short or damaged"));
        }
        self.file.seek(SeekFrom::Start(at)).map_err(|e| io(self.path, "read", e))?;
        self.at = at;
        Ok(())
    }

    /// Fills `buf`.
    pub fn read(&mut self, buf: &mut [u8], what: &'static str) -> Result<()> {
        if buf.len() as u64 > self.left() {
            return Err(self.ends(what));
        }
        match self.file.read_exact(buf) {
            Ok(()) => {
                self.at += buf.len() as u64;
                Ok(())
            }
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Err(self.ends(what)),
            Err(e) => Err(io(self.path, "read", e)),
        }
    }

    /// Passes over `count` bytes.
    pub fn skip(&mut self, count: u64, what: &'static str) -> Result<()> {
        // Beyond the left bytes of a file, and so within i64 below them.
        if count > self.left() {
            return Err(self.ends(what));
        }
        self.file.seek_relative(count as i64).map_err(|e| io(self.path, "read", e))?;
        self.at += count;
        Ok(())
    }

    /// A bit mask, 64 bits a word.
    pub fn mask(&mut self, words: &mut [u64], what: &'static str) -> Result<()> {
        for word in words {
            let mut bytes = [0; 8];
            self.read(&mut bytes, what)?;
            *word = u64::from_le_bytes(bytes);
        }
        Ok(())
    }

    /// A text behind its length.
    pub fn text(&mut self, what: &'static str) -> Result<String> {
        let at = self.at;
        let length = self.u32(what)?;
        if length > TEXT {
            return Err(bad(self.path, format!("{what} at byte {at} claim a text of {length} bytes"), format!("at most {TEXT} are read")));
        }
        let mut bytes = vec![0; length as usize];
        self.read(&mut bytes, what)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The error of a file that ends within `what`.
    fn ends(&self, what: &str) -> crate::Error {
        bad(self.path, format!("it ends within {what}: byte {} of {}", self.at, self.length), "the file is cut short or damaged")
    }
}
