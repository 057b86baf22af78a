//! The elements of a DICOM file that a volume needs, up to its pixel data. Format: DICOM PS3.5 and PS3.10,
//! <https://dicom.nema.org/medical/dicom/current/output/html/part05.html>. By hand, because the crates for it ask for as
//! much memory as a damaged length claims, up to 4 GiB.

pub(super) use super::dicom_tags::*;
use super::limits::{bad, io, open, quote};
use crate::error::{Result, shown};
use crate::room::more;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Longest value that is kept (but a list of offsets), deepest nesting, most frames and fragments.
const MAX_VALUE: u64 = 4096;
const MAX_DEPTH: usize = 32;
pub(super) const MAX_FRAMES: usize = 1 << 16;

/// Texts by element.
pub(super) type Fields = BTreeMap<Tag, String>;

/// Where the samples lie.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Pixels {
    /// In one piece, of bytes or of 16-bit words.
    Native { at: u64, length: u64, words: bool },
    /// Coded: (at, length) of each fragment.
    Coded(Vec<(u64, u64)>),
}

/// What a file says.
pub(super) struct Elements {
    pub fields: Fields,
    /// Of all frames, and of each.
    pub shared: Fields,
    pub frames: Vec<Fields>,
    /// Of the first detector.
    detector: Fields,
    /// Bits of a float sample, else 0; and the samples. None where the file has none.
    pub pixels: Option<(u32, Pixels)>,
    pub big_endian: bool,
}

/// A sequence or an item that the walk is in.
struct Level {
    tag: Tag,
    end: Option<u64>,
    /// Elements have no VR.
    implicit: bool,
}

struct Walk<'a> {
    path: &'a Path,
    file: BufReader<File>,
    length: u64,
    at: u64,
    big: bool,
    implicit: bool,
}

/// Whether bytes begin a DICOM file: 128 of any kind and a mark, or, of old files, the first element.
pub(super) fn is_start(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM")
}

/// Reads a file's elements.
pub(super) fn read(path: &Path) -> Result<Elements> {
    let (mut file, length) = open(path)?;
    let mut head = [0; 132];
    let (n, error) = super::limits::fill(&mut file, &mut head);
    if let Some(e) = error {
        return Err(io(path, "read", e));
    }
    let marked = is_start(&head[..n]);
    if !(marked || n >= 8 && matches!(head[..4], [2 | 8, 0, _, 0])) {
        return Err(bad(path, "it has no DICOM mark", "DICM at byte 128 begins a DICOM file"));
    }
    let mut walk = Walk { path, file, length, at: 0, big: false, implicit: false };
    walk.go(if marked { 132 } else { 0 })?;
    let mut fields = Fields::new();
    while walk.group()? == Some(2) {
        let (tag, length, _) = walk.header(false)?;
        let length = length.ok_or_else(|| walk.damaged("an element of the file's head has no length"))?;
        walk.take(tag, length, tag == SYNTAX, false, &mut fields)?;
    }
    let syntax = fields.get(&SYNTAX).map(String::as_str);
    walk.implicit = match syntax {
        Some("1.2.840.10008.1.2") => true,
        // An old file without head: a VR shows as two letters.
        None => !(head[4].is_ascii_uppercase() && head[5].is_ascii_uppercase()),
        Some(_) => false,
    };
    walk.big = syntax == Some("1.2.840.10008.1.2.2");
    if syntax == Some("1.2.840.10008.1.2.1.99") {
        return Err(bad(path, "it is a deflated DICOM file", "uncompressed files and RLE are read: gdcmconv --raw rewrites it"));
    }
    let (shared, detector) = (Fields::new(), Fields::new());
    let mut elements = Elements { fields, shared, frames: Vec::new(), detector, pixels: None, big_endian: walk.big };
    walk.data_set(&mut elements)?;
    for (tag, text) in std::mem::take(&mut elements.detector) {
        elements.fields.entry(tag).or_insert(text);
    }
    Ok(elements)
}

impl Walk<'_> {
    fn damaged(&self, what: &str) -> crate::Error {
        bad(self.path, format!("{what}, at byte {}", self.at), "the file is damaged or cut short")
    }

    fn go(&mut self, to: u64) -> Result<()> {
        self.file.seek(SeekFrom::Start(to)).map_err(|e| io(self.path, "read", e))?;
        self.at = to;
        Ok(())
    }

    fn skip(&mut self, count: u64) -> Result<()> {
        if count > self.length.saturating_sub(self.at) {
            return Err(self.damaged(&format!("an element claims {count} bytes, {} are left", self.length.saturating_sub(self.at))));
        }
        self.file.seek_relative(count as i64).map_err(|e| io(self.path, "read", e))?;
        self.at += count;
        Ok(())
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut raw = [0; N];
        match super::limits::fill(&mut self.file, &mut raw) {
            (n, None) if n == N => {
                self.at += N as u64;
                Ok(raw)
            }
            (_, Some(e)) => Err(io(self.path, "read", e)),
            _ => Err(self.damaged("it ends within an element")),
        }
    }

    fn u16(&mut self) -> Result<u16> {
        let raw = self.bytes()?;
        Ok(if self.big { u16::from_be_bytes(raw) } else { u16::from_le_bytes(raw) })
    }

    fn u32(&mut self) -> Result<u32> {
        let raw = self.bytes()?;
        Ok(if self.big { u32::from_be_bytes(raw) } else { u32::from_le_bytes(raw) })
    }

    /// The group of the next element; none where the file is over.
    fn group(&mut self) -> Result<Option<u16>> {
        if self.at >= self.length {
            return Ok(None);
        }
        let group = self.u16()?;
        self.file.seek_relative(-2).map_err(|e| io(self.path, "read", e))?;
        self.at -= 2;
        Ok(Some(group))
    }

    /// Tag, length (none: until a mark ends it), and value representation, where the file says one.
    fn header(&mut self, implicit: bool) -> Result<(Tag, Option<u64>, [u8; 2])> {
        let tag = u32::from(self.u16()?) << 16 | u32::from(self.u16()?);
        if implicit || tag >> 16 == 0xfffe {
            let length = self.u32()?;
            return Ok((tag, (length != u32::MAX).then_some(u64::from(length)), [0; 2]));
        }
        let vr: [u8; 2] = self.bytes()?;
        if !vr.iter().all(u8::is_ascii_uppercase) {
            return Err(self.damaged(&format!("element ({:04x},{:04x}) has no value representation", tag >> 16, tag & 0xffff)));
        }
        let long = [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"].contains(&&vr);
        if !long {
            return Ok((tag, Some(u64::from(self.u16()?)), vr));
        }
        self.u16()?;
        let length = self.u32()?;
        Ok((tag, (length != u32::MAX).then_some(u64::from(length)), vr))
    }

    /// Keeps an element's value, or goes beyond it.
    fn take(&mut self, tag: Tag, length: u64, wanted: bool, number: bool, fields: &mut Fields) -> Result<()> {
        // Of two bytes at least, as long as there are frames.
        let most = if tag == FRAME_OFFSETS { 20 * MAX_FRAMES as u64 } else { MAX_VALUE };
        if !wanted || length > most || fields.contains_key(&tag) {
            return self.skip(length);
        }
        let mut raw = vec![0; length as usize];
        match super::limits::fill(&mut self.file, &mut raw) {
            (n, None) if n == raw.len() => self.at += length,
            (_, Some(e)) => return Err(io(self.path, "read", e)),
            _ => return Err(self.damaged("it ends within an element")),
        }
        let text = match raw[..] {
            [a, b, ..] if number => if self.big { u16::from_be_bytes([a, b]) } else { u16::from_le_bytes([a, b]) }.to_string(),
            _ => String::from_utf8_lossy(&raw).trim_matches([' ', '\0']).to_owned(),
        };
        if !text.is_empty() {
            fields.insert(tag, text);
        }
        Ok(())
    }

    fn data_set(&mut self, out: &mut Elements) -> Result<()> {
        let mut levels: Vec<Level> = Vec::new();
        loop {
            while levels.last().is_some_and(|l| l.end.is_some_and(|end| self.at >= end)) {
                levels.pop();
            }
            if self.at >= self.length {
                return if levels.is_empty() { Ok(()) } else { Err(self.damaged("it ends within a sequence")) };
            }
            let implicit = self.implicit || levels.iter().any(|l| l.implicit);
            let (tag, length, vr) = self.header(implicit)?;
            let sequence = &vr == b"SQ";
            let end = match length {
                Some(n) if n > self.length.saturating_sub(self.at) && levels.is_empty() && tag == PIXELS => Some(self.length),
                Some(n) if n > self.length.saturating_sub(self.at) => {
                    return Err(self.damaged(&format!("an element claims {n} bytes, {} are left", self.length - self.at)));
                }
                Some(n) => Some(self.at + n),
                None => None,
            };
            if tag == MODALITY_LUT && levels.is_empty() {
                out.fields.insert(tag, "a sequence".into());
            }
            match tag {
                ITEM => {
                    if matches!(levels.as_slice(), [Level { tag: PER_FRAME, .. }]) {
                        if out.frames.len() == MAX_FRAMES {
                            return Err(self.damaged(&format!("it has more than {MAX_FRAMES} frames")));
                        }
                        out.frames.push(Fields::new());
                    }
                    levels.push(Level { tag, end, implicit: false });
                }
                ITEM_END => drop(levels.pop()),
                SEQUENCE_END => {
                    // An item without its own end mark ends with its sequence.
                    while levels.pop().is_some_and(|l| l.tag == ITEM) {}
                }
                PIXELS | FLOAT_PIXELS | DOUBLE_PIXELS if levels.is_empty() => {
                    let bits = match tag {
                        FLOAT_PIXELS => 32,
                        DOUBLE_PIXELS => 64,
                        _ => 0,
                    };
                    let pixels = match length {
                        Some(_) => Pixels::Native { at: self.at, length: end.unwrap_or(self.at) - self.at, words: &vr == b"OW" },
                        None => Pixels::Coded(self.fragments()?),
                    };
                    out.pixels = Some((bits, pixels));
                    return Ok(());
                }
                // The fragments of a picture within (an icon) are no data sets.
                PIXELS if length.is_none() => drop(self.fragments()?),
                // Of known length, only what is wanted is entered; without VR it shows by its tag.
                _ if length.is_none()
                    || (sequence || implicit) && (matches!(tag, SHARED | PER_FRAME | DETECTOR) || FRAME_PARTS.contains(&tag)) =>
                {
                    if levels.len() >= MAX_DEPTH {
                        return Err(self.damaged(&format!("its sequences are nested more than {MAX_DEPTH} deep")));
                    }
                    // Of unknown length and kind: implicit inside, by PS3.5, 6.2.2.
                    levels.push(Level { tag, end, implicit: !sequence && !implicit });
                }
                _ => self.value(tag, length.unwrap_or(0), &levels, out)?,
            }
        }
    }

    /// An element that is no sequence, at the place that `levels` are.
    fn value(&mut self, tag: Tag, length: u64, levels: &[Level], out: &mut Elements) -> Result<()> {
        let wanted = WANTED.iter().find(|w| w.0 == tag);
        let mut ignored = Fields::new();
        // Elsewhere the same elements speak of other images.
        let fields = match levels {
            [] => &mut out.fields,
            [Level { tag: SHARED, .. }, _, part, _] if FRAME_PARTS.contains(&part.tag) => &mut out.shared,
            [Level { tag: PER_FRAME, .. }, _, part, _] if FRAME_PARTS.contains(&part.tag) => out.frames.last_mut().unwrap_or(&mut ignored),
            [Level { tag: DETECTOR, .. }, _] if matches!(tag, POSITION | ORIENTATION) => &mut out.detector,
            _ => &mut ignored,
        };
        self.take(tag, length, wanted.is_some(), wanted.is_some_and(|w| w.1), fields)
    }

    /// The fragments of coded pixel data, without the table of offsets that comes first.
    fn fragments(&mut self) -> Result<Vec<(u64, u64)>> {
        let mut fragments = Vec::new();
        loop {
            let (tag, length, _) = self.header(true)?;
            match (tag, length) {
                (ITEM, Some(n)) => {
                    if fragments.len() > 4 * MAX_FRAMES {
                        return Err(self.damaged("it has too many fragments"));
                    }
                    fragments.push((self.at, n));
                    self.skip(n)?;
                }
                (SEQUENCE_END, _) => break,
                _ => return Err(self.damaged(&format!("a fragment of its pixel data is due, not {}", quote(&format!("{tag:08x}"))))),
            }
        }
        if !fragments.is_empty() {
            fragments.remove(0);
        }
        Ok(fragments)
    }
}

/// The bytes of a part of a file.
pub(super) fn part(path: &Path, at: u64, length: u64, out: &mut Vec<u8>) -> Result<()> {
    let (mut file, there) = open(path)?;
    if at.checked_add(length).is_none_or(|end| end > there) {
        return Err(bad(
            path,
            format!("its pixel data end at byte {there}, {} are needed", at.saturating_add(length)),
            "the file is cut short",
        ));
    }
    file.seek(SeekFrom::Start(at)).map_err(|e| io(path, "read", e))?;
    more(|| format!("{}: a slice", shown(path)), out, length as usize)?;
    let before = out.len();
    file.take(length).read_to_end(out).map_err(|e| io(path, "read", e))?;
    match (out.len() - before) as u64 == length {
        true => Ok(()),
        false => {
            Err(bad(path, format!("its pixel data end {} bytes early", length - (out.len() - before) as u64), "the file is cut short"))
        }
    }
}
