//! DICOM images: the slices of a folder or of one file. What is read: uncompressed and RLE images of 8, 16 and 32 bits,
//! signed or not, and float ones; single frames and multi-frame objects.
//!
//! World coordinates are the patient's, LPS, in mm. A slice's position is the centre of its first pixel; the third axis
//! runs from the first slice's position to the last one's, so that a tilted gantry is honoured.

use super::ReadOptions;
use super::dicom_element::{self as element, Elements, Fields, Pixels, Tag, part};
use super::dicom_series;
use super::limits::{bad, fill, io, open, quote};
use super::samples::SampleType;
use crate::error::Result;
use crate::scene::Volume;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// How the samples of an image are stored: all slices of a volume share it.
#[derive(Clone, Debug, PartialEq)]
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
    rle: bool,
    pub photometric: String,
}

impl Form {
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

    /// Type of a sample as [`Slice::load`] yields it.
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

/// One frame, and where it lies.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    pub path: PathBuf,
    /// Byte and length of its samples.
    at: u64,
    length: u64,
    pub form: Form,
    pub series: String,
    pub description: String,
    pub instance: i64,
    /// Centre of the first pixel, mm.
    pub position: Option<DVec3>,
    /// Directions of rising column and of rising row.
    pub axes: Option<[DVec3; 2]>,
    /// Distance of columns and of rows, mm.
    pub spacing: Option<[f64; 2]>,
    /// Distance of slices, as the file says it without positions.
    pub between: Option<f64>,
    pub rescale: (f32, f32),
}

/// Those of `files` that begin as DICOM files do.
pub(super) fn files_among(files: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in files {
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        // The index of a medium holds no image.
        if name == "dicomdir" {
            continue;
        }
        let mut head = [0; 132];
        let (mut file, _) = open(path)?;
        let (n, error) = fill(&mut file, &mut head);
        if let Some(e) = error {
            return Err(io(path, "read", e));
        }
        if element::is_start(&head[..n]) || name.ends_with(".dcm") {
            found.push(path.clone());
        }
    }
    Ok(found)
}

/// Reads the series of a folder.
pub(super) fn read_files(folder: &Path, files: Vec<PathBuf>, options: &ReadOptions) -> Result<Volume> {
    let mut slices = Vec::new();
    for path in &files {
        let elements = element::read(path)?;
        match elements.pixels {
            None => log::warn!("{}: it holds no image; it is left out", crate::error::shown(path)),
            Some(_) => slices.extend(slices_of(path, elements)?),
        }
        if slices.len() > element::MAX_FRAMES {
            return Err(bad(folder, format!("it holds more than {} slices", element::MAX_FRAMES), "a folder with one series is needed"));
        }
    }
    if slices.is_empty() {
        return Err(bad(
            folder,
            format!("none of its {} DICOM files holds an image", files.len()),
            "the folder of an image series is needed",
        ));
    }
    dicom_series::read(folder, slices, options)
}

/// Reads one file: its only frame, or all of them.
pub(super) fn read_file(path: &Path, options: &ReadOptions) -> Result<Volume> {
    let elements = element::read(path)?;
    if elements.pixels.is_none() {
        return Err(bad(path, "it is a DICOM file without an image", "an object with pixel data is needed"));
    }
    let slices = slices_of(path, elements)?;
    if slices.len() == 1 {
        log::info!("{}: one slice; the folder of a series gives the whole volume", crate::error::shown(path));
    }
    dicom_series::read(path, slices, options)
}

/// Numbers of a text such as "1\2.5\3".
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let v: Option<Vec<f64>> = text.split('\\').take(N + 1).map(|w| w.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    v.and_then(|v| v.try_into().ok())
}

/// The frames of a file.
fn slices_of(path: &Path, elements: Elements) -> Result<Vec<Slice>> {
    let Elements { fields, shared, frames, pixels, big_endian } = elements;
    let Some((float_bits, pixels)) = pixels else { return Ok(Vec::new()) };
    let form = form(path, &fields, float_bits, big_endian, &pixels)?;
    let count = match fields.get(&element::FRAMES) {
        None => 1,
        Some(t) => t
            .trim()
            .parse::<usize>()
            .ok()
            .filter(|n| (1..=element::MAX_FRAMES).contains(n))
            .ok_or_else(|| bad(path, format!("it has '{}' frames", quote(t)), format!("1 to {} are read", element::MAX_FRAMES)))?,
    };
    let each = form.bytes();
    let places: Vec<(u64, u64)> = match pixels {
        Pixels::Native { at, length } => {
            let needs = each.checked_mul(count as u64);
            if needs.is_none_or(|n| n > length) {
                let what =
                    format!("{count} frames of {} need {} bytes, its pixel data have {length}", form.says(), needs.unwrap_or(u64::MAX));
                return Err(bad(path, what, "the file is cut short or damaged"));
            }
            (0..count as u64).map(|i| (at + i * each, each)).collect()
        }
        Pixels::Coded(fragments) if fragments.len() == count => fragments,
        Pixels::Coded(fragments) => {
            let what = format!("its {count} frames lie in {} fragments", fragments.len());
            return Err(bad(path, what, "a fragment per frame is read"));
        }
    };
    let none = Fields::new();
    let slice = |(i, (at, length)): (usize, (u64, u64))| {
        let frame = frames.get(i).unwrap_or(&none);
        let get = |tag: Tag| frame.get(&tag).or_else(|| shared.get(&tag)).or_else(|| fields.get(&tag)).map(String::as_str);
        let wrong =
            |name: &str, tag: Tag, right: &str| bad(path, format!("its {name} is '{}'", quote(get(tag).unwrap_or_default())), right);
        let number = |name: &str, tag: Tag| match get(tag) {
            None => Ok(None),
            Some(t) => numbers::<1>(t).map(|[v]| Some(v)).ok_or_else(|| wrong(name, tag, "a number is needed")),
        };
        let position = match get(element::POSITION) {
            None => None,
            Some(t) => {
                Some(DVec3::from(numbers(t).ok_or_else(|| wrong("ImagePositionPatient", element::POSITION, "three numbers are needed"))?))
            }
        };
        let axes = match get(element::ORIENTATION) {
            None => None,
            Some(t) => {
                let right = "two unit vectors at right angles, six numbers, are needed";
                let axes = numbers::<6>(t).map(|[a, b, c, d, e, f]| [DVec3::new(a, b, c), DVec3::new(d, e, f)]);
                let good =
                    axes.filter(|[x, y]| (x.length() - 1.0).abs() < 0.01 && (y.length() - 1.0).abs() < 0.01 && x.dot(*y).abs() < 0.01);
                Some(good.ok_or_else(|| wrong("ImageOrientationPatient", element::ORIENTATION, right))?)
            }
        };
        let spacing_tag = if get(element::SPACING).is_some() { element::SPACING } else { element::IMAGER_SPACING };
        // Rows first, in the file.
        let spacing = match get(spacing_tag) {
            None => None,
            Some(t) => Some(
                numbers::<2>(t)
                    .filter(|v| v.iter().all(|s| *s > 0.0))
                    .map(|[row, column]| [column, row])
                    .ok_or_else(|| wrong("PixelSpacing", spacing_tag, "two numbers above 0 are needed"))?,
            ),
        };
        let between = number("SpacingBetweenSlices", element::BETWEEN)?.map(f64::abs).filter(|s| *s > 0.0);
        let between = between.or(number("SliceThickness", element::THICKNESS)?.map(f64::abs).filter(|s| *s > 0.0));
        let slope = number("RescaleSlope", element::SLOPE)?.map_or(1.0, |v| v as f32);
        let intercept = number("RescaleIntercept", element::INTERCEPT)?.map_or(0.0, |v| v as f32);
        if slope == 0.0 || !slope.is_finite() || !intercept.is_finite() {
            return Err(wrong("RescaleSlope", element::SLOPE, "it must be a number other than 0"));
        }
        Ok(Slice {
            path: path.to_owned(),
            at,
            length,
            form: form.clone(),
            series: get(element::SERIES_UID).unwrap_or_default().to_owned(),
            description: get(element::SERIES_DESCRIPTION).unwrap_or_default().to_owned(),
            instance: get(element::INSTANCE).and_then(|t| t.trim().parse().ok()).unwrap_or(0),
            position,
            axes,
            spacing,
            between,
            rescale: (slope, intercept),
        })
    };
    places.into_iter().enumerate().map(slice).collect()
}

fn form(path: &Path, fields: &Fields, float_bits: u32, big_endian: bool, pixels: &Pixels) -> Result<Form> {
    let syntax = fields.get(&element::SYNTAX).map(String::as_str).unwrap_or_default();
    let rle = syntax == "1.2.840.10008.1.2.5";
    if matches!(pixels, Pixels::Coded(_)) && !rle {
        let right = "uncompressed images and RLE are read: `gdcmconv --raw IN OUT` or `dcmdjpeg IN OUT` rewrites it";
        return Err(bad(path, format!("its pixels are compressed as {} ({})", coding(syntax), quote(syntax)), right));
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
    Ok(Form { rows, columns, channels, planar, bits, stored, high, signed, float, big_endian, rle, photometric })
}

/// What a transfer syntax is called.
fn coding(uid: &str) -> &'static str {
    match uid.strip_prefix("1.2.840.10008.1.2.4.") {
        Some("50" | "51") => "JPEG",
        Some("57" | "70") => "lossless JPEG",
        Some("80" | "81") => "JPEG-LS",
        Some("90" | "91" | "92" | "93" | "201" | "202" | "203") => "JPEG 2000",
        Some("110" | "111" | "112") => "JPEG XL",
        Some("100" | "101" | "102" | "103" | "104" | "105" | "106" | "107" | "108") => "video",
        _ => "an unknown syntax",
    }
}

impl Slice {
    /// Appends the samples, little-endian, channels beside each other.
    pub fn load(&self, out: &mut Vec<u8>) -> Result<()> {
        let form = &self.form;
        let mut raw = Vec::new();
        part(&self.path, self.at, self.length, &mut raw)?;
        if form.rle {
            raw = unrle(&self.path, &raw, form)?;
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
        out.append(&mut raw);
        Ok(())
    }

    /// Leaves the bits in use, moved to the lowest, with their sign; others may hold overlays.
    fn mask(&self, sample: &mut [u8]) {
        let (stored, high) = (self.form.stored, self.form.high);
        let mut wide = [0; 4];
        wide[..sample.len()].copy_from_slice(sample);
        // Up to the top, and down again.
        let top = u32::from_le_bytes(wide) << (31 - high);
        let value = if self.form.signed { ((top as i32) >> (32 - stored)) as u32 } else { top >> (32 - stored) };
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
