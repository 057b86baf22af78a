//! The text part of a MetaImage file.

use super::limits::{bad, io, quote};
use crate::error::Result;
use std::io::{BufRead, Read};
use std::path::Path;

/// Longest header that is read, bytes; a list of files belongs to it.
const HEADER_BYTES: u64 = 4 << 20;

/// The keys that are read; others may stand as often as they like.
const READ: [&str; 21] = [
    "ObjectType",
    "NDims",
    "DimSize",
    "ElementSpacing",
    "ElementSize",
    "Offset",
    "Origin",
    "Position",
    "TransformMatrix",
    "Orientation",
    "Rotation",
    "ElementType",
    "ElementNumberOfChannels",
    "ElementToIntensityFunctionSlope",
    "ElementToIntensityFunctionOffset",
    "BinaryData",
    "BinaryDataByteOrderMSB",
    "ElementByteOrderMSB",
    "CompressedData",
    "CompressedDataSize",
    "HeaderSize",
];

/// Key and value of a line; MetaIO takes both signs.
pub(super) fn split(line: &str) -> Option<(&str, &str)> {
    line.split_once(['=', ':']).map(|(key, value)| (key.trim(), value.trim()))
}

/// The header's lines, up to and with `ElementDataFile`.
pub(super) struct Header<'a> {
    pub path: &'a Path,
    /// Key, value, line number.
    entries: Vec<(String, String, usize)>,
    /// Byte that follows the header.
    pub end: u64,
}

impl<'a> Header<'a> {
    pub fn read(path: &'a Path, file: &mut impl BufRead) -> Result<Self> {
        let mut header = Header { path, entries: Vec::new(), end: 0 };
        let mut line = Vec::new();
        for number in 1.. {
            let text = header.line(file, &mut line)?;
            let Some(text) = text else {
                return Err(bad(
                    path,
                    "its header has no line ElementDataFile",
                    "it ends a MetaImage header, and says where the samples are",
                ));
            };
            if text.trim().is_empty() {
                continue;
            }
            let Some((key, value)) = split(&text) else {
                return Err(bad(path, format!("line {number} is '{}'", quote(&text)), "header lines are 'Key = Value'"));
            };
            let (key, value) = (key.to_owned(), value.to_owned());
            let last = key == "ElementDataFile";
            if READ.contains(&&*key) && header.get(&[&key]).is_some() {
                return Err(bad(path, format!("line {number} gives '{}' a second time", quote(&key)), "each key may stand once"));
            }
            header.entries.push((key, value, number));
            if last {
                break;
            }
        }
        Ok(header)
    }

    /// The next line without its end; none where the file is over.
    pub fn line(&mut self, file: &mut impl BufRead, line: &mut Vec<u8>) -> Result<Option<String>> {
        line.clear();
        let left = HEADER_BYTES - self.end;
        let n = file.by_ref().take(left).read_until(b'\n', line).map_err(|e| io(self.path, "read", e))?;
        self.end += n as u64;
        if n as u64 == left && left > 0 && line.last() != Some(&b'\n') || left == 0 {
            let what = format!("its header does not end within {} MiB", HEADER_BYTES >> 20);
            return Err(bad(self.path, what, "a line ElementDataFile ends a MetaImage header"));
        }
        Ok((n > 0).then(|| String::from_utf8_lossy(line).trim_end_matches(['\n', '\r']).to_owned()))
    }

    /// The first of the keys, spelled differently by different programs, that stands there.
    pub fn entry(&self, keys: &[&str]) -> Option<&(String, String, usize)> {
        keys.iter().find_map(|k| self.entries.iter().find(|(key, ..)| key == k))
    }

    pub fn get(&self, keys: &[&str]) -> Option<&str> {
        self.entry(keys).map(|(_, v, _)| v.as_str())
    }

    pub fn wrong(&self, keys: &[&str], right: impl Into<String>) -> crate::Error {
        match self.entry(keys) {
            Some((key, value, line)) => bad(self.path, format!("line {line}: '{} = {}'", quote(key), quote(value)), right),
            None => bad(self.path, format!("the key {} is missing", keys[0]), right),
        }
    }

    /// The numbers of a key; how many there must be is `count`.
    pub fn numbers(&self, keys: &[&str], count: usize) -> Result<Option<Vec<f64>>> {
        let Some(text) = self.get(keys) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = text.split_whitespace().take(count + 1).map(|w| w.parse::<f64>().ok()).collect();
        match numbers.filter(|v| v.len() == count) {
            Some(v) => Ok(Some(v)),
            None => Err(self.wrong(keys, format!("{count} numbers are needed"))),
        }
    }

    pub fn flag(&self, keys: &[&str]) -> Result<Option<bool>> {
        Ok(match self.get(keys).map(str::to_ascii_lowercase).as_deref() {
            None => None,
            Some("true" | "t" | "1" | "yes") => Some(true),
            Some("false" | "f" | "0" | "no") => Some(false),
            Some(_) => return Err(self.wrong(keys, "it must be True or False")),
        })
    }

    pub fn whole(&self, keys: &[&str]) -> Result<Option<i64>> {
        match self.get(keys) {
            None => Ok(None),
            Some(t) => t.parse().map(Some).map_err(|_| self.wrong(keys, "it must be a whole number")),
        }
    }
}
