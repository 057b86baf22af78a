//! The pixels of DICOM images: how they are stored, and what they become.

use super::dicom_element::{self as element, Fields, Pixels, Tag};
use super::limits::{bad, quote};
use super::samples::SampleType;
use crate::error::Result;
use std::path::Path;

/// How the samples of an image are stored.
#[derive(Clone, Debug)]
pub(super) struct Form {
    pub rows: usize,
    pub columns: usize,
    /// Samples per pixel.
    pub channels: usize,
    /// Those of a pixel do not stand beside each other.
    planar: bool,
    /// 8, 16, 32 or 64.
    bits: u32,
    stored: u32,
    high: u32,
    signed: bool,
    float: bool,
    big_endian: bool,
    /// Samples of a byte, two in a big-endian word: the second comes first.
    pub swapped: bool,
    rle: bool,
    pub photometric: String,
    /// Stored samples that are no image, the least and the greatest.
    pub padding: Option<[i64; 2]>,
}

impl Form {
    /// Whether images of both decode to samples of one kind: they may use other bits of them.
    pub fn fits(&self, other: &Self) -> bool {
        (self.rows, self.columns, self.channels, self.kind()) == (other.rows, other.columns, other.channels, other.kind())
            && self.photometric == other.photometric
    }

    /// "512x512, 16 bits signed, MONOCHROME2".
    pub fn says(&self) -> String {
        let sign = if self.float {
            " float"
        } else if self.signed {
            " signed"
        } else {
            ""
        };
        format!("{}x{}, {} bits{sign}, {}", self.columns, self.rows, self.bits, quote(&self.photometric))
    }

    /// Type of a sample as [`Form::decode`] yields it.
    pub fn kind(&self) -> SampleType {
        match (self.bits, self.signed, self.float) {
            (8, true, _) => SampleType::I8,
            (8, ..) => SampleType::U8,
            (16, true, _) => SampleType::I16,
            (16, ..) => SampleType::U16,
            (32, _, true) => SampleType::F32,
            (32, true, _) => SampleType::I32,
            (32, ..) => SampleType::U32,
            _ => SampleType::F64,
        }
    }

    /// Samples of a frame.
    fn count(&self) -> u64 {
        self.rows as u64 * self.columns as u64 * self.channels as u64
    }

    /// Bytes of a frame.
    pub fn bytes(&self) -> u64 {
        self.count() * u64::from(self.bits / 8)
    }
}

/// The form that the elements of an image describe.
pub(super) fn form(path: &Path, fields: &Fields, float_bits: u32, big_endian: bool, pixels: &Pixels) -> Result<Form> {
    let syntax = fields.get(&element::SYNTAX).map(String::as_str).unwrap_or_default();
    let rle = syntax == "1.2.840.10008.1.2.5";
    if matches!(pixels, Pixels::Coded(_)) && !rle {
        let (name, tool) = coding(syntax);
        let right = format!("uncompressed images and RLE are read: {tool}");
        return Err(bad(path, format!("its pixels are compressed as {name} ({})", quote(syntax)), right));
    }
    let optional = |tag: Tag, name: &str| match fields.get(&tag) {
        None => Ok(None),
        Some(t) => t.parse::<u32>().map(Some).map_err(|_| bad(path, format!("its {name} is '{}'", quote(t)), "a number is needed")),
    };
    let needed = |tag: Tag, name: &str| {
        optional(tag, name)?.filter(|n| *n > 0).ok_or_else(|| bad(path, format!("its {name} is missing or 0"), "an image has it"))
    };
    let (rows, columns) = (needed(element::ROWS, "Rows")? as usize, needed(element::COLUMNS, "Columns")? as usize);
    let bits = if float_bits > 0 { float_bits } else { needed(element::ALLOCATED, "BitsAllocated")? };
    let (float, known) = (float_bits > 0, matches!(bits, 8 | 16 | 32) || float_bits == 64);
    if !known || rle && float {
        return Err(bad(path, format!("its samples have {bits} bits"), "8, 16 and 32 are read"));
    }
    let stored = if float { bits } else { optional(element::STORED, "BitsStored")?.unwrap_or(bits) };
    let high = if float { bits - 1 } else { optional(element::HIGH_BIT, "HighBit")?.unwrap_or(stored.wrapping_sub(1)) };
    if stored == 0 || stored > bits || high >= bits || high + 1 < stored {
        return Err(bad(path, format!("{stored} of its {bits} bits are used, the highest is {high}"), "they must lie within a sample"));
    }
    let channels = optional(element::SAMPLES, "SamplesPerPixel")?.unwrap_or(1) as usize;
    let photometric = fields.get(&element::PHOTOMETRIC).cloned().unwrap_or_else(|| "MONOCHROME2".into());
    if !matches!(channels, 1 | 3 | 4) || channels > 1 && (photometric.ends_with("422") || photometric.ends_with("420")) {
        return Err(bad(
            path,
            format!("its pixels have {channels} samples, {}", quote(&photometric)),
            "1, or 3 or 4 at full resolution, are read",
        ));
    }
    let planar = channels > 1 && (rle || optional(element::PLANAR, "PlanarConfiguration")? == Some(1));
    let signed = optional(element::SIGNED, "PixelRepresentation")? == Some(1);
    let swapped = big_endian && bits == 8 && matches!(pixels, Pixels::Native { words: true, .. });
    // Of one sample a pixel, an integer with the sign of the others (PS3.3, C.7.5.1.1.2).
    let padding = |tag| {
        let stored: u16 = fields.get(&tag)?.parse().ok()?;
        Some(if signed { i64::from(stored as i16) } else { i64::from(stored) })
    };
    // The background of labels is a label.
    let image = channels == 1 && !float && !fields.contains_key(&element::SEGMENTATION);
    let padding = padding(element::PADDING).filter(|_| image).map(|value| {
        let limit = padding(element::PADDING_LIMIT).unwrap_or(value);
        [value.min(limit), value.max(limit)]
    });
    Ok(Form { rows, columns, channels, planar, bits, stored, high, signed, float, big_endian, swapped, rle, photometric, padding })
}

/// What a transfer syntax is called, and what rewrites it.
fn coding(uid: &str) -> (&'static str, &'static str) {
    match uid.strip_prefix("1.2.840.10008.1.2.4.") {
        Some("50" | "51") => ("JPEG", "`dcmdjpeg IN OUT` or `gdcmconv --raw IN OUT` rewrites it"),
        Some("57" | "70") => ("lossless JPEG", "`dcmdjpeg IN OUT` or `gdcmconv --raw IN OUT` rewrites it"),
        Some("80" | "81") => ("JPEG-LS", "`dcmdjpls IN OUT` or `gdcmconv --raw IN OUT` rewrites it"),
        Some("90" | "91" | "92" | "93") => ("JPEG 2000", "`gdcmconv --raw IN OUT` rewrites it"),
        Some("201" | "202" | "203") => ("high-throughput JPEG 2000", "export it uncompressed"),
        Some("110" | "111" | "112") => ("JPEG XL", "export it uncompressed"),
        Some("100" | "101" | "102" | "103" | "104" | "105" | "106" | "107" | "108") => ("video", "export it as uncompressed frames"),
        _ => ("an unknown syntax", "export it uncompressed"),
    }
}

impl Form {
    /// The samples of a frame as they stand in a file become little-endian, channels beside each other.
    pub fn decode(&self, path: &Path, mut raw: Vec<u8>) -> Result<Vec<u8>> {
        let form = self;
        if form.rle {
            raw = unrle(path, &raw, form)?;
        }
        let each = form.bits as usize / 8;
        if form.big_endian && !form.rle {
            raw.chunks_exact_mut(each).for_each(<[u8]>::reverse);
        }
        if form.planar {
            let plane = form.rows * form.columns * each;
            let planes = std::mem::take(&mut raw);
            raw.reserve_exact(planes.len());
            for pixel in (0..plane).step_by(each) {
                for c in 0..form.channels {
                    raw.extend_from_slice(planes.get(c * plane + pixel..c * plane + pixel + each).unwrap_or_default());
                }
            }
        }
        if !form.float && (form.stored < form.bits || form.high + 1 < form.bits) {
            raw.chunks_exact_mut(each).for_each(|sample| self.mask(sample));
        }
        Ok(raw)
    }

    /// Leaves the bits in use, moved to the lowest, with their sign; others may hold overlays.
    fn mask(&self, sample: &mut [u8]) {
        let (stored, high) = (self.stored, self.high);
        let mut wide = [0; 4];
        wide[..sample.len()].copy_from_slice(sample);
        // Up to the top, and down again.
        let top = u32::from_le_bytes(wide) << (31 - high);
        let value = if self.signed { ((top as i32) >> (32 - stored)) as u32 } else { top >> (32 - stored) };
        sample.copy_from_slice(&value.to_le_bytes()[..sample.len()]);
    }
}

/// RLE (PS3.5, annex G): for each byte of a sample, the highest first, a PackBits stream of that byte of all pixels.
/// Yields little-endian samples, channel after channel.
fn unrle(path: &Path, raw: &[u8], form: &Form) -> Result<Vec<u8>> {
    let broken = |what: &str| bad(path, format!("its RLE data are damaged: {what}"), "an undamaged file is needed");
    let word = |i: usize| raw.get(4 * i..4 * i + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let each = form.bits as usize / 8;
    let pixels = form.rows * form.columns;
    let segments = word(0).filter(|n| *n == each * form.channels).ok_or_else(|| broken("the number of segments is wrong"))?;
    // PackBits yields at most 64 bytes from one.
    if (pixels * segments) as u64 / 64 > raw.len() as u64 {
        return Err(broken("they are too short for the image"));
    }
    let mut out = Vec::new();
    out.try_reserve_exact(pixels * segments).map_err(|_| broken("they do not fit into memory"))?;
    out.resize(pixels * segments, 0u8);
    for s in 0..segments {
        let start = word(1 + s).filter(|n| (64..=raw.len()).contains(n)).ok_or_else(|| broken("a segment begins outside"))?;
        let end = if s + 1 < segments { word(2 + s).unwrap_or(0) } else { raw.len() };
        let mut bytes = raw.get(start..end.min(raw.len())).unwrap_or_default().iter().copied();
        let (channel, place) = (s / each, each - 1 - s % each);
        let mut at = 0;
        let mut put = |byte: u8| {
            if at < pixels {
                out[(channel * pixels + at) * each + place] = byte;
                at += 1;
            }
        };
        while let Some(head) = bytes.next() {
            match head as i8 {
                n @ 0.. => (0..=n).for_each(|_| bytes.next().into_iter().for_each(&mut put)),
                -128 => {}
                n => {
                    if let Some(byte) = bytes.next() {
                        (0..=-i32::from(n)).for_each(|_| put(byte));
                    }
                }
            }
        }
        if at < pixels {
            return Err(broken(&format!("segment {s} holds {at} of {pixels} pixels")));
        }
    }
    Ok(out)
}
