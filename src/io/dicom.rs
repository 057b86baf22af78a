//! DICOM images: the slices of a folder or of one file. What is read: uncompressed and RLE images of 8, 16 and 32 bits,
//! signed or not, and float ones; single frames and multi-frame objects.
//!
//! World coordinates are the patient's, LPS, in mm. A slice's position is the centre of its first pixel; the third axis
//! runs from the first slice's position to the last one's, so that a tilted gantry is honoured.

use super::ReadOptions;
use super::dicom_element::{self as element, Elements, Fields, Pixels, Tag, part};
use super::dicom_pixels::{Form, form};
use super::dicom_series;
use super::limits::{bad, fill, io, open, quote};
use crate::error::Result;
use crate::scene::Volume;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
    /// Distance of slices, as the file says it without positions; below 0 where they lie against their normal.
    pub between: Option<f64>,
    pub rescale: (f32, f32),
    /// Whether the file says that the slope is 0, for which 1 stands.
    pub no_slope: bool,
    /// Whether a table says what samples mean.
    pub table: bool,
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
    // Of another series than the one that is wanted, what cannot be read does not matter.
    let mut unread = BTreeMap::new();
    for path in &files {
        let elements = element::read(path)?;
        match elements.pixels {
            None => log::warn!("{}: it holds no image; it is left out", crate::error::shown(path)),
            Some(_) => {
                let series = elements.fields.get(&element::SERIES_UID).cloned().unwrap_or_default();
                match slices_of(path, elements) {
                    Ok(some) => slices.extend(some),
                    Err(e) => drop(unread.entry(series).or_insert(e)),
                }
            }
        }
        if slices.len() > element::MAX_FRAMES {
            return Err(bad(folder, format!("it holds more than {} slices", element::MAX_FRAMES), "a folder with one series is needed"));
        }
    }
    if slices.is_empty() && unread.is_empty() {
        return Err(bad(
            folder,
            format!("none of its {} DICOM files holds an image", files.len()),
            "the folder of an image series is needed",
        ));
    }
    dicom_series::read(folder, slices, unread, options)
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
    dicom_series::read(path, slices, BTreeMap::new(), options)
}

/// Numbers of a text such as "1\2.5\3".
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let v: Option<Vec<f64>> = text.split('\\').take(N + 1).map(|w| w.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    v.and_then(|v| v.try_into().ok())
}

/// Where the frames of a dose lie along their normal, from the first; none where the file does not say.
fn offsets(path: &Path, fields: &Fields, count: usize) -> Result<Option<Vec<f64>>> {
    let Some(text) = fields.get(&element::FRAME_OFFSETS).filter(|_| count > 1) else { return Ok(None) };
    let all: Option<Vec<f64>> = text.split('\\').map(|w| w.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match all.filter(|all| all.len() == count) {
        Some(all) => Ok(Some(all.iter().map(|z| z - all[0]).collect())),
        None => {
            Err(bad(path, format!("its GridFrameOffsetVector is '{}'", quote(text)), format!("{count} numbers are needed, one a frame")))
        }
    }
}

/// The frames of a file.
fn slices_of(path: &Path, elements: Elements) -> Result<Vec<Slice>> {
    let Elements { fields, shared, frames, pixels, big_endian, .. } = elements;
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
    if count == 1 && fields.get(&element::IMAGE_TYPE).is_some_and(|t| t.split('\\').any(|word| word.trim() == "MOSAIC")) {
        let what = "its one picture is a mosaic, the slices of a volume as tiles";
        return Err(bad(path, what, "dcm2niix makes a NIfTI volume of it"));
    }
    let each = form.bytes();
    let places: Vec<(u64, u64)> = match pixels {
        Pixels::Native { at, length, .. } => {
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
    let offsets = offsets(path, &fields, count)?;
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
        // Its sign is the direction of stacking (PS3.3, C.8.4.15).
        let between = number("SpacingBetweenSlices", element::BETWEEN)?.filter(|s| *s != 0.0);
        let between = between.or(number("SliceThickness", element::THICKNESS)?.map(f64::abs).filter(|s| *s > 0.0));
        // Frames of a file with one position lie along the normal from there; one that is said to be shared is each one's own.
        let position = match axes {
            _ if count == 1 || [frame, &shared].iter().any(|f| f.contains_key(&element::POSITION)) => position,
            None => None,
            Some([x, y]) => {
                let along = offsets.as_ref().map(|o| o[i]).or(between.map(|d| d * i as f64));
                position.zip(along).map(|(p, z)| p + x.cross(y).normalize_or_zero() * z)
            }
        };
        let named =
            if get(element::SLOPE).is_some() { ("RescaleSlope", element::SLOPE) } else { ("DoseGridScaling", element::DOSE_SCALING) };
        let told = number(named.0, named.1)?;
        let no_slope = told == Some(0.0);
        let slope = match told {
            // As GDCM has it.
            Some(0.0) => 1.0,
            slope => slope.map_or(1.0, |v| v as f32),
        };
        if slope == 0.0 || !slope.is_finite() {
            return Err(wrong(named.0, named.1, "it must lie within the range of float32"));
        }
        let intercept = number("RescaleIntercept", element::INTERCEPT)?.map_or(0.0, |v| v as f32);
        if !intercept.is_finite() {
            return Err(wrong("RescaleIntercept", element::INTERCEPT, "it must lie within the range of float32"));
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
            no_slope,
            table: fields.contains_key(&element::MODALITY_LUT),
        })
    };
    places.into_iter().enumerate().map(slice).collect()
}

impl Slice {
    /// Appends the samples, little-endian, channels beside each other.
    pub fn load(&self, out: &mut Vec<u8>) -> Result<()> {
        let mut raw = Vec::new();
        if self.form.swapped {
            // Whole words, of which a frame of odd length has a half; elements begin at even bytes.
            let (begin, end) = (self.at & !1, (self.at + self.length).next_multiple_of(2));
            part(&self.path, begin, end - begin, &mut raw)?;
            raw.chunks_exact_mut(2).for_each(<[u8]>::reverse);
            raw.drain(..(self.at - begin) as usize);
            raw.truncate(self.length as usize);
        } else {
            part(&self.path, self.at, self.length, &mut raw)?;
        }
        out.append(&mut self.form.decode(&self.path, raw)?);
        Ok(())
    }
}
