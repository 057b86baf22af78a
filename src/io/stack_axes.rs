//! Pages of a TIFF that are of several channels or times: ImageJ's hyperstacks
//! (<https://imagej.net/ij/developer/source/ij/io/FileSaver.java.html>, its description of a stack) and OME-TIFF
//! (<https://docs.openmicroscopy.org/ome-model/6.3.1/ome-tiff/specification.html>), and arrays of tifffile. They say it in the first
//! page's description, the first two also how far voxels lie apart, ImageJ also what values mean.

use super::ReadOptions;
use super::choose;
use super::limits::bad;
use super::samples::SampleType;
use super::stack_picture::Form;
use super::xml::{Form as TagForm, Tags};
use crate::error::Result;
use std::collections::BTreeSet;
use std::path::Path;

/// Bytes of a description that are looked at: OME-XML may tell all of a microscope before its planes.
pub(super) const MOST: usize = 1 << 20;

/// How many slices, channels and times there are, and how many pages lie from one to the next.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axes {
    counts: [usize; 3],
    strides: [usize; 3],
    /// "ImageJ", "OME-TIFF" or "tifffile".
    by: &'static str,
}

/// What a description says of the voxels, and of the values, beside the axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Said {
    /// Voxel distances, in the file's own unit; the third may be missing where slices are files of their own.
    pub spacing: Option<([f64; 2], Option<f64>)>,
    /// Slope and intercept of the values.
    pub calibration: Option<(f32, f32)>,
    /// Number of another calibration (ImageJ's function), which is not applied.
    pub curve: Option<f64>,
}

impl Said {
    /// All three distances of a stack of `count` slices.
    pub fn spacing(&self, count: usize) -> Option<[f64; 3]> {
        let ([x, y], z) = self.spacing?;
        // A single slice is as thick as the shorter of its spacings.
        let z = if count == 1 { z.or(Some(x.min(y))) } else { z };
        Some([x, y, z?])
    }
}

/// Pixels per unit along x and y, and whether that is a centimetre.
pub(super) struct Resolution {
    pub rates: [Option<f64>; 2],
    pub centimetres: bool,
}

/// What the first page's description says; `pages` are those of the file.
pub(super) fn said(path: &Path, description: &[u8], form: &Form, resolution: &Resolution, pages: usize) -> Said {
    let text = String::from_utf8_lossy(description);
    if text.starts_with("ImageJ=") {
        return imagej_said(&text, form, resolution, pages);
    }
    Said { spacing: if text.contains("<OME") { ome_spacing(path, description) } else { None }, ..Said::default() }
}

/// As ImageJ's FileOpener has it: distances count where a unit is given, values lie on a straight line where the calibration's
/// function is 0.
fn imagej_said(text: &str, form: &Form, resolution: &Resolution, pages: usize) -> Said {
    let value = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('=')).map(str::trim);
    let number = |key: &str| value(key).and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite());
    let unit = value("unit").is_some_and(|u| !u.is_empty() && !u.starts_with("pixel"));
    // Axes in units of their own have no common measure.
    let one_unit = ["yunit", "zunit"].iter().all(|key| value(key).is_none_or(|u| Some(u) == value("unit")));
    let depth = number("spacing").map(f64::abs).filter(|d| *d > 0.0);
    let depth = depth.or((pages > 1 || number("slices").is_some()).then_some(1.0));
    // Micrometres beside pixels per centimetre, as Micro-Manager writes them.
    let micro = value("unit").is_some_and(|u| ["um", "µm", "\\u00B5m"].contains(&u));
    let part = if resolution.centimetres && micro { 1e4 } else { 1.0 };
    let spacing = match resolution.rates {
        [Some(x), Some(y)] if unit && one_unit => Some(([part / x, part / y], depth)),
        _ => None,
    };
    // Of floats, only the name of their unit counts.
    let function = number("cf").filter(|_| !matches!(form.kind, SampleType::F32 | SampleType::F64));
    let line = number("c0").zip(number("c1")).map(|(c0, c1)| (c1 as f32, c0 as f32));
    let calibration = line.filter(|(c1, c0)| function == Some(0.0) && *c1 != 0.0 && c1.is_finite() && c0.is_finite());
    // 21 is an optical density, without coefficients.
    let curve = function.filter(|f| *f != 0.0 && (line.is_some() || *f == 21.0));
    Said { spacing, calibration, curve }
}

/// PhysicalSizeX, Y and Z of the first image, in their unit, or in micrometres where they have several.
fn ome_spacing(path: &Path, description: &[u8]) -> Option<([f64; 2], Option<f64>)> {
    let mut tags = Tags::new(path, description);
    while let Ok(Some(tag)) = tags.next() {
        if tag.name.rsplit(':').next() != Some("Pixels") || tag.form == TagForm::Close {
            continue;
        }
        let of = |axis: &str| {
            let size: f64 = tag.get(&format!("PhysicalSize{axis}"))?.parse().ok()?;
            let unit = match tag.get(&format!("PhysicalSize{axis}Unit")).unwrap_or("µm") {
                "pm" => 1e-6,
                "Å" => 1e-4,
                "nm" => 1e-3,
                "µm" | "um" => 1.0,
                "mm" => 1e3,
                "cm" => 1e4,
                "m" => 1e6,
                _ => return None,
            };
            Some((size, unit)).filter(|(size, _)| size.is_finite() && *size > 0.0)
        };
        let (x, y, z) = (of("X")?, of("Y")?, of("Z"));
        let one = [y, z.unwrap_or(x)].iter().all(|s| s.1 == x.1);
        let length = |(size, unit): (f64, f64)| if one { size } else { size * unit };
        return Some(([length(x), length(y)], z.map(length)));
    }
    None
}

/// Where samples lie that pages do not speak of.
pub(super) struct Behind {
    /// Byte where the first page's begin, uncompressed.
    pub start: Option<u64>,
    /// Bytes of the file.
    pub length: u64,
    pub big_endian: bool,
}

impl Axes {
    /// Axes whose order in the file is `order`, such as "ZCT".
    fn new(counts: [usize; 3], order: &str, by: &'static str) -> Self {
        let mut strides = [1; 3];
        let mut stride = 1usize;
        for axis in order.chars().filter_map(|c| "ZCT".find(c)) {
            strides[axis] = stride;
            stride = stride.saturating_mul(counts[axis]);
        }
        Self { counts, strides, by }
    }

    fn total(&self) -> usize {
        self.counts.iter().fold(1, |n, &c| n.saturating_mul(c))
    }

    /// Whether pages follow one axis alone: whatever it is called, they are slices.
    fn are_one(&self) -> bool {
        self.counts.iter().filter(|n| **n > 1).count() < 2
    }

    /// "4 slices of 3 channels (ImageJ)".
    fn says(&self) -> String {
        let [z, c, t] = self.counts;
        let times = if t > 1 { format!(" at {t} times") } else { String::new() };
        let channels = if c > 1 { format!(" of {c} channels") } else { String::new() };
        format!("{z} slice{}{channels}{times} ({})", if z == 1 { "" } else { "s" }, self.by)
    }

    /// Those of `pages` that belong to the channel and time that are wanted.
    pub fn choose(&self, path: &Path, form: &Form, pages: &[usize], options: &ReadOptions) -> Result<Vec<usize>> {
        let [z, c, t] = self.counts;
        if form.channels > 1 {
            let what = format!("it holds {}, and its pixels have {} channels ({})", self.says(), form.channels, form.color);
            return Err(bad(path, what, "channels or times in pages of one channel are read: split it"));
        }
        let name = |i: usize| format!("c{}t{}", i % c, i / c);
        let labels: Vec<String> = if c > 1 && t > 1 { (0..c * t).map(name).collect() } else { Vec::new() };
        let pick = choose::component(path, &format!("it holds {}", self.says()), c * t, &labels, None, options)?;
        let [step, channel, time] = self.strides;
        let first = pick % c * channel + pick / c * time;
        Ok((0..z).filter_map(|i| pages.get(first + i * step).copied()).collect())
    }
}

/// The axes that a description gives the pages; none where they are slices alone.
pub(super) fn axes(path: &Path, description: &[u8], form: &Form, pages: &[usize], behind: &Behind) -> Result<Option<Axes>> {
    let text = String::from_utf8_lossy(description);
    if text.starts_with("ImageJ=") {
        return imagej(path, &text, form, pages, behind);
    }
    if text.starts_with("{\"shape\":") && text.contains("\"truncated\": true") {
        return Err(headerless(path, "its description (tifffile) counts more slices".into(), None, form, behind));
    }
    if let Some(axes) = shaped(&text, form, pages) {
        return Ok(Some(axes));
    }
    if text.contains("<OME") { ome(path, description, form, pages) } else { Ok(None) }
}

/// The axes of an array that tifffile wrote: {"shape": [2, 4, 5, 7], "axes": "CZYX"}. Without "axes" the last of those before rows and
/// columns is z.
fn shaped(text: &str, form: &Form, pages: &[usize]) -> Option<Axes> {
    let json: serde_json::Value = serde_json::Deserializer::from_str(text).into_iter().next()?.ok()?;
    let mut shape = json.get("shape")?.as_array()?.iter().map(|n| usize::try_from(n.as_u64()?).ok()).collect::<Option<Vec<_>>>()?;
    let own = [form.height, form.width, form.channels];
    shape.truncate(shape.strip_suffix(if form.channels > 1 { &own[..] } else { &own[..2] })?.len());
    let letters = json.get("axes").and_then(|a| a.as_str()).map(|a| a.chars().take(shape.len()).collect::<Vec<_>>());
    let axes: Vec<(usize, Option<char>)> =
        shape.iter().enumerate().map(|(i, &n)| (n, letters.as_ref().and_then(|l| l.get(i).copied()))).filter(|(n, _)| *n > 1).collect();
    let total = axes.iter().fold(1usize, |all, (n, _)| all.saturating_mul(*n));
    if !(2..=3).contains(&axes.len()) || total != pages.len() {
        return None;
    }
    let called = |letter: char| axes.iter().position(|a| a.1 == Some(letter));
    let z = called('Z').or(called('T')).unwrap_or(axes.len() - 1);
    // The others are channels and times as they are called, else channels the faster.
    let own = |i: usize| axes[i].1.filter(|c| matches!(c, 'C' | 'T'));
    let others: Vec<usize> = (0..axes.len()).rev().filter(|&i| i != z).collect();
    let mut free = "CT".chars().filter(|&c| !others.iter().any(|&i| own(i) == Some(c))).collect::<Vec<_>>().into_iter();
    let (mut counts, mut order) = ([1; 3], String::new());
    for (i, (n, _)) in axes.iter().enumerate().rev() {
        let axis = if i == z { 'Z' } else { own(i).or_else(|| free.next())? };
        counts["ZCT".find(axis)?] = *n;
        order.push(axis);
    }
    Some(Axes::new(counts, &order, "tifffile"))
}

fn imagej(path: &Path, text: &str, form: &Form, pages: &[usize], behind: &Behind) -> Result<Option<Axes>> {
    let number = |key: &str| {
        let value = text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('='));
        value.and_then(|v| v.trim().parse::<usize>().ok()).filter(|n| *n > 0).unwrap_or(1)
    };
    let (images, z, c, t) = (number("images"), number("slices"), number("channels"), number("frames"));
    // One directory for all that follow each other without a gap: its form for more than 4 GB. A single page that was
    // taken from a stack may have kept its description.
    let left = behind.start.map_or(0, |start| behind.length.saturating_sub(start));
    let all = (images as u64).saturating_mul(form.bytes() as u64);
    if pages.len() == 1 && images > 1 && all <= left {
        // A headerless file has nothing behind its samples.
        let count = (c == 1 && form.channels == 1 && all == left).then_some(images);
        return Err(headerless(path, format!("its description (ImageJ) counts {images} slices"), count, form, behind));
    }
    let axes = Axes::new([z, c, t], "CZT", "ImageJ");
    if pages.len() == 1 || axes.are_one() {
        return Ok(None);
    }
    checked(path, axes, pages)
}

/// Axes that fit the pages.
fn checked(path: &Path, mut axes: Axes, pages: &[usize]) -> Result<Option<Axes>> {
    if axes.counts[0] == 1 {
        // Flat pictures at several times: these are the third axis.
        axes.counts.swap(0, 2);
        axes.strides.swap(0, 2);
    }
    match axes.total() == pages.len() {
        true => Ok(Some(axes)),
        false => {
            let what = format!("its description counts {}, it has {} pages", axes.says(), pages.len());
            Err(bad(path, what, "all of its pages are needed in one file"))
        }
    }
}

/// Refuses slices that no page speaks of; says how they are read, where that is known.
fn headerless(path: &Path, what: String, count: Option<usize>, form: &Form, behind: &Behind) -> crate::Error {
    let right = match (count, behind.start) {
        (Some(count), Some(start)) if !form.half => {
            let endian = if behind.big_endian && form.kind.bytes() > 1 { " --volume.endian big" } else { "" };
            let (width, height, kind) = (form.width, form.height, form.kind.name());
            format!("headerless they are read: --volume.dims {width},{height},{count} --volume.type {kind} --volume.offset {start}{endian}")
        }
        _ => "a page per slice is needed: save it again so".into(),
    };
    bad(path, format!("{what}, and it has 1 page"), right)
}

fn ome(path: &Path, description: &[u8], form: &Form, pages: &[usize]) -> Result<Option<Axes>> {
    let mut tags = Tags::new(path, description);
    let (mut axes, mut images, mut planes) = (None, 0, 0usize);
    let (mut files, mut elsewhere) = (BTreeSet::new(), None);
    // What is no XML behind, or is cut off, says no more.
    while let Ok(Some(tag)) = tags.next() {
        let number = |key: &str| tag.get(key).and_then(|v| v.parse::<usize>().ok());
        match tag.name.rsplit(':').next() {
            Some("Pixels") if tag.form != TagForm::Close => {
                images += 1;
                let size = |key: &str| number(key).filter(|n| *n > 0).unwrap_or(1);
                // Samples of a pixel are channels, too.
                let channels = size("SizeC").div_ceil(form.channels);
                let order = tag.get("DimensionOrder").unwrap_or("XYZCT");
                let found = Axes::new([size("SizeZ"), channels, size("SizeT")], order, "OME-TIFF");
                planes = planes.saturating_add(found.total());
                axes.get_or_insert(found);
            }
            Some("TiffData") if tag.form != TagForm::Close && images == 1 => {
                let (Some(axes), Some(page)) = (&axes, number("IFD")) else { continue };
                let first = ["FirstZ", "FirstC", "FirstT"].map(|key| number(key).unwrap_or(0));
                let due = first.iter().zip(axes.strides).fold(0usize, |sum, (n, s)| sum.saturating_add(n.saturating_mul(s)));
                if axes.total() == pages.len() && pages.get(due) != Some(&page) {
                    elsewhere.get_or_insert((page, due));
                }
            }
            Some("UUID") => files.extend(tag.get("FileName").map(str::to_owned)),
            _ => {}
        }
    }
    let Some(axes) = axes else { return Ok(None) };
    // Of an image in several files, which all describe the whole, one may hold a slice, or the slices of a channel and time.
    let alone = axes.are_one() || pages.len() == 1 || pages.len() == axes.counts[0];
    if let Some((page, due)) = elsewhere.filter(|_| files.len() < 2) {
        let what = format!("its description (OME-TIFF) puts a plane at page {page} that is due at {due}");
        return Err(bad(path, what, "planes in the order of DimensionOrder are read: save it again so"));
    }
    if images > 1 && planes == pages.len() {
        return Err(bad(path, format!("it holds {images} images (OME-TIFF)"), "one is read: save it alone"));
    }
    if alone { Ok(None) } else { checked(path, axes, pages) }
}
