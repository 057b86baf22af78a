//! The text part of an NRRD file. Format: <https://teem.sourceforge.net/nrrd/format.html>.

use super::limits::{bad, io, quote};
use super::samples::SampleType;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::path::Path;

/// Longest header that is read; segmentations carry some tens of KiB.
const HEADER_BYTES: u64 = 4 << 20;

/// Most axes that the format allows.
const AXES: usize = 16;

/// How the samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Raw,
    Gzip,
    Text,
}

/// The fields that matter here, each list as long as `sizes`.
#[derive(Clone, Debug)]
pub(crate) struct Header {
    pub kind: SampleType,
    /// Samples along each axis, fastest first; none is 0.
    pub sizes: Vec<u64>,
    /// Lower case; empty where not given.
    pub kinds: Vec<String>,
    /// NaN where not given.
    pub spacings: Vec<f64>,
    /// Axis vectors in space; `None` for an axis that is not spatial.
    pub directions: Option<Vec<Option<Vec<f64>>>>,
    /// Centre of the first sample, in space.
    pub origin: Option<Vec<f64>>,
    /// Of its space.
    pub left_handed: bool,
    pub encoding: Encoding,
    pub big_endian: bool,
    pub data_file: Option<String>,
    pub line_skip: u64,
    /// −1: the samples are the last bytes of the file.
    pub byte_skip: i64,
    /// `key:=value` lines, unescaped.
    pub meta: Vec<(String, String)>,
    /// Byte that follows the header.
    pub end: u64,
}

/// Lines of the header as they stand.
struct Lines<'a> {
    path: &'a Path,
    /// Field → (its line, its text).
    fields: BTreeMap<&'static str, (usize, String)>,
    meta: Vec<(String, String)>,
    end: u64,
}

/// Reads the header from the start of a file.
pub(crate) fn read(path: &Path, file: &mut impl BufRead) -> Result<Header> {
    split(path, file)?.interpret()
}

/// The field that a name means; NRRD has spellings with and without a blank.
fn field(name: &str) -> Option<&'static str> {
    const KNOWN: [&str; 31] = [
        "type",
        "dimension",
        "sizes",
        "spacings",
        "space directions",
        "space origin",
        "space",
        "space dimension",
        "space units",
        "kinds",
        "encoding",
        "endian",
        "data file",
        "line skip",
        "byte skip",
        "block size",
        "content",
        "units",
        "labels",
        "centers",
        "centerings",
        "thicknesses",
        "axis mins",
        "axis maxs",
        "min",
        "max",
        "old min",
        "old max",
        "sample units",
        "measurement frame",
        "number",
    ];
    let letters = |s: &'static str| s.bytes().filter(|b| *b != b' ');
    KNOWN.into_iter().find(|k| letters(k).eq(name.trim().bytes().filter(|b| *b != b' ').map(|b| b.to_ascii_lowercase())))
}

fn split<'a>(path: &'a Path, file: &mut impl BufRead) -> Result<Lines<'a>> {
    let mut lines = Lines { path, fields: BTreeMap::new(), meta: Vec::new(), end: 0 };
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let left = HEADER_BYTES - lines.end;
        let n = file.by_ref().take(left).read_until(b'\n', &mut line).map_err(|e| io(path, "read", e))?;
        lines.end += n as u64;
        if n as u64 == left {
            return Err(bad(
                path,
                format!("its header does not end within {} MiB", HEADER_BYTES >> 20),
                "an empty line ends an NRRD header",
            ));
        }
        let bytes = line.strip_suffix(b"\n").unwrap_or(&line);
        let text = String::from_utf8_lossy(bytes.strip_suffix(b"\r").unwrap_or(bytes));
        if number == 1 {
            if !matches!(&*text, "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005" | "NRRD00.01") {
                return Err(bad(path, format!("its first line is '{}'", quote(&text)), "NRRD0001 to NRRD0005 are read"));
            }
        } else if text.is_empty() {
            // The empty line, or the end of a detached header.
            break;
        } else if !text.starts_with('#') {
            lines.take(number, &text)?;
            if lines.text("data file").is_some_and(|t| t.split_whitespace().next() == Some("LIST")) {
                // Names of files follow, to the end.
                break;
            }
        }
    }
    Ok(lines)
}

impl Lines<'_> {
    fn take(&mut self, number: usize, text: &str) -> Result<()> {
        if let Some((name, value)) = text.split_once(':')
            && let Some(field) = field(name)
            && !value.starts_with('=')
        {
            if self.fields.insert(field, (number, value.trim().to_owned())).is_some() {
                return Err(bad(self.path, format!("line {number} gives the field '{field}' a second time"), "each field may stand once"));
            }
        } else if let Some((key, value)) = text.split_once(":=") {
            self.meta.push((unescape(key), unescape(value)));
        } else if let Some((name, _)) = text.split_once(": ") {
            log::debug!("{}: line {number}: field '{}' is not known, and ignored", crate::error::shown(self.path), quote(name));
        } else {
            let right = "header lines are 'field: value', 'key:=value' or '# comment', and an empty line ends them";
            return Err(bad(self.path, format!("line {number} is '{}'", quote(text)), right));
        }
        Ok(())
    }

    /// The text of a field.
    fn text(&self, field: &str) -> Option<&str> {
        self.fields.get(field).map(|(_, t)| t.as_str())
    }

    fn needed(&self, field: &'static str, right: &str) -> Result<&str> {
        self.text(field).ok_or_else(|| bad(self.path, format!("the field '{field}' is missing"), right))
    }

    /// What is wrong with the text of a field.
    fn wrong(&self, field: &str, right: impl Into<String>) -> Error {
        let (line, text) = self.fields.get(field).map(|(l, t)| (*l, quote(t))).unwrap_or_default();
        bad(self.path, format!("line {line}: '{field}: {text}'"), right)
    }

    /// A field of one word per axis.
    fn list<T>(&self, field: &'static str, axes: usize, right: &str, parse: impl Fn(&str) -> Option<T>) -> Result<Option<Vec<T>>> {
        let Some(text) = self.text(field) else { return Ok(None) };
        let words: Option<Vec<T>> = text.split_whitespace().take(AXES + 1).map(parse).collect();
        let words = words.ok_or_else(|| self.wrong(field, right))?;
        if words.len() != axes {
            return Err(self.wrong(field, format!("it must have {axes} entries, one per axis; {} stand there", words.len())));
        }
        Ok(Some(words))
    }

    fn interpret(self) -> Result<Header> {
        let kind = self.kind()?;
        let axes = self.needed("dimension", "dimension: 3 (or 2, or more with axes of size 1) is needed")?;
        let axes = axes.parse().ok().filter(|n| (1..=AXES).contains(n)).ok_or_else(|| self.wrong("dimension", "it must be 1 to 16"))?;
        self.needed("sizes", "it gives the number of samples along each axis")?;
        let positive = |s: &str| s.parse::<u64>().ok().filter(|n| *n > 0);
        let sizes = self.list("sizes", axes, "each must be a whole number above 0", positive)?.unwrap_or_default();
        let number = |s: &str| s.parse::<f64>().ok();
        let spacings = self.list("spacings", axes, "each must be a number or nan", number)?.unwrap_or_else(|| vec![f64::NAN; axes]);
        let kinds = self.list("kinds", axes, "each must be a word", |s| Some(s.to_ascii_lowercase()))?;
        let directions = match self.text("space directions") {
            None => None,
            Some(text) => {
                let right = "each axis has a vector (x,y,z) or none";
                let v = vectors(text).ok_or_else(|| self.wrong("space directions", right))?;
                if v.len() != axes {
                    return Err(
                        self.wrong("space directions", format!("it must have {axes} entries, one per axis; {} stand there", v.len()))
                    );
                }
                Some(v)
            }
        };
        let origin = match self.text("space origin") {
            None => None,
            Some(text) => match vectors(text).as_deref() {
                Some([origin]) => origin.clone(),
                _ => return Err(self.wrong("space origin", "it must be one vector (x,y,z)")),
            },
        };
        let space = self.text("space").unwrap_or_default().to_ascii_lowercase();
        // teem's nrrdSpace enumeration, with and without time.
        let left_handed = ["left-anterior-superior", "las", "3d-left-handed"]
            .iter()
            .any(|s| space.strip_prefix(s).is_some_and(|rest| matches!(rest, "" | "-time" | "t")));
        if let Some(space) = self.text("space") {
            log::debug!("{}: coordinates are in the file's space '{}'", crate::error::shown(self.path), quote(space));
        }
        if directions.is_none() && (self.text("axis mins").is_some() || self.text("axis maxs").is_some()) {
            log::warn!(
                "{}: axis mins and axis maxs are ignored; spacings or space directions place a volume",
                crate::error::shown(self.path)
            );
        }
        let encoding = self.encoding()?;
        let big_endian = match self.text("endian").map(str::to_ascii_lowercase).as_deref() {
            Some("little") => false,
            Some("big") => true,
            Some(_) => return Err(self.wrong("endian", "it must be little or big")),
            None if kind.bytes() == 1 || encoding == Encoding::Text => false,
            None => {
                let right = format!("endian: little or endian: big is needed for {}", kind.name());
                return Err(bad(self.path, "the field 'endian' is missing", right));
            }
        };
        let line_skip = match self.text("line skip") {
            None => 0,
            Some(t) => t.parse().map_err(|_| self.wrong("line skip", "it must be a whole number, 0 or more"))?,
        };
        let byte_skip = match self.text("byte skip") {
            None => 0,
            Some(t) => {
                t.parse().ok().filter(|n| *n >= -1).ok_or_else(|| self.wrong("byte skip", "it must be a whole number, 0 or more, or -1"))?
            }
        };
        if byte_skip < 0 && encoding != Encoding::Raw {
            return Err(self.wrong("byte skip", "-1 is possible with encoding: raw only"));
        }
        let data_file = self.data_file()?;
        Ok(Header {
            kind,
            kinds: kinds.unwrap_or_else(|| vec![String::new(); axes]),
            sizes,
            spacings,
            directions,
            origin,
            left_handed,
            encoding,
            big_endian,
            data_file,
            line_skip,
            byte_skip,
            meta: self.meta,
            end: self.end,
        })
    }

    fn kind(&self) -> Result<SampleType> {
        let text = self.needed("type", "type: uint8, int16, float, … is needed")?;
        SampleType::from_name(text).ok_or_else(|| match text {
            "block" => self.wrong("type", "blocks of bytes are no scalars; an integer or float type is needed"),
            _ => self.wrong("type", "it must be an NRRD type: int8, uint8, … int64, uint64, float or double"),
        })
    }

    fn encoding(&self) -> Result<Encoding> {
        let right = "raw, gzip and ascii are read; `unu save -e gzip` rewrites a file";
        Ok(match self.needed("encoding", right)?.to_ascii_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "txt" | "text" | "ascii" => Encoding::Text,
            _ => return Err(self.wrong("encoding", right)),
        })
    }

    fn data_file(&self) -> Result<Option<String>> {
        let Some(text) = self.text("data file") else { return Ok(None) };
        let several = "samples spread over several files are not read; `unu save` joins them in one";
        if text == "LIST" || text.starts_with("LIST ") {
            return Err(self.wrong("data file", several));
        }
        // "slice%03d.raw 1 40 1": a pattern and its range.
        if text.contains('%') && text.split_whitespace().skip(1).last().is_some_and(|w| w.parse::<i64>().is_ok()) {
            return Err(self.wrong("data file", several));
        }
        if text.is_empty() {
            return Err(self.wrong("data file", "the name of a file is needed"));
        }
        Ok(Some(text.to_owned()))
    }
}

/// "(1,0,0) (0, 1, 0) none": vectors of one length.
fn vectors(text: &str) -> Option<Vec<Option<Vec<f64>>>> {
    let mut rest = text.trim_start();
    let mut out: Vec<Option<Vec<f64>>> = Vec::new();
    while !rest.is_empty() && out.len() <= AXES {
        if let Some(after) = rest.strip_prefix("none") {
            out.push(None);
            rest = after.trim_start();
        } else {
            let (vector, after) = rest.strip_prefix('(')?.split_once(')')?;
            let numbers = vector.split(',').take(AXES + 1).map(|n| n.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
            if numbers.len() > AXES || out.iter().flatten().any(|v| v.len() != numbers.len()) {
                return None;
            }
            out.push(Some(numbers));
            rest = after.trim_start();
        }
    }
    Some(out)
}

/// A key or value with its escapes (`\\`, `\n`) resolved.
fn unescape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match (c, chars.peek()) {
            ('\\', Some('n')) => out.push('\n'),
            ('\\', Some('\\')) => out.push('\\'),
            _ => {
                out.push(c);
                continue;
            }
        }
        chars.next();
    }
    out
}
