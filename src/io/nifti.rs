//! NIfTI-1 volumes: one file (`.nii`, gzipped or not) or a pair (`.hdr` and `.img`). Header layout: nifti1.h
//! (<https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h>), 348 bytes.
//!
//! World coordinates are the file's: RAS+, in its unit of length (nearly always mm). They come from the sform, else the
//! qform, else the spacings alone, where the centre of voxel 0 lies at the world origin.

use super::ReadOptions;
use super::limits::{Source, bad, damaged, fill, grid, open, quote};
use super::samples::{self, Layout, SampleType};
use crate::error::{Error, Result};
use crate::scene::{Grid, Samples, Volume};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

const HEADER: usize = 348;

/// A datatype: three bytes.
const RGB24: i16 = 128;

/// Whether these bytes begin a NIfTI-1 file, or one of its relatives that are refused by name.
pub(super) fn is_header(head: &[u8; HEADER]) -> bool {
    let h = Bytes { raw: head, big_endian: head[0] == 0 };
    matches!(&head[344..], b"n+1\0" | b"ni1\0") || matches!((h.i32(0), &head[4..8]), (540, b"n+2\0" | b"ni2\0")) || h.i32(0) == 348
}

/// The header as numbers.
struct Bytes<'a> {
    raw: &'a [u8; HEADER],
    big_endian: bool,
}

impl Bytes<'_> {
    fn take<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut out = [0; N];
        out.copy_from_slice(&self.raw[at..at + N]);
        if self.big_endian {
            out.reverse();
        }
        out
    }
    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.take(at))
    }
    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.take(at))
    }
    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.take(at)))
    }
    fn f32s<const N: usize>(&self, at: usize) -> [f64; N] {
        std::array::from_fn(|i| self.f32(at + 4 * i))
    }
}

/// Reads the volume in an opened NIfTI file of `length` bytes.
pub(super) fn read(path: &Path, file: BufReader<File>, length: u64, gzip: bool, options: &ReadOptions) -> Result<Volume> {
    let mut source = Source::new(path, file, length, 0, gzip)?;
    let mut raw = [0; HEADER];
    let (n, error) = fill(&mut source, &mut raw);
    if let Some(e) = error {
        return Err(damaged(path, &source, e, format!("after {n} of the header's {HEADER} bytes")));
    }
    if n < HEADER {
        return Err(bad(path, format!("it ends after {n} bytes, inside its header"), "a NIfTI-1 header has 348 bytes"));
    }
    let h = Bytes { raw: &raw, big_endian: i32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]]).swap_bytes() == 348 };
    let single = check_magic(path, &h)?;
    let (kind, colors) = kind(path, &h)?;
    let (dims, pick) = dims(path, &h, colors, options)?;
    let grid = place(path, &h, dims)?;
    // "the scaling is to be ignored if datatype is DT_RGB24", nifti1.h.
    let (slope, intercept) = if h.i16(70) == RGB24 { (1.0, 0.0) } else { rescale(path, &h)? };
    let stored = as_stored(path, options.nan_as, slope, intercept)?;
    let mut layout = Layout { big_endian: h.big_endian, replace: stored, ..Layout::scalar(dims, kind) };
    let mut before = 0;
    if colors > 1 {
        (layout.components, layout.pick) = (colors, Some(pick.0));
    } else {
        // Volumes stand one after the other.
        before = layout.stored_bytes().and_then(|n| n.checked_mul(pick.0 as u64)).unwrap_or(u64::MAX);
        layout.more = pick.0 + 1 < pick.1;
    }
    let offset = offset(path, &h, single)?;
    let (path, mut source) = if single {
        source.skip(path, offset - HEADER as u64)?;
        (path.to_owned(), source)
    } else {
        let (path, mut source) = image(path)?;
        source.skip(&path, offset)?;
        (path, source)
    };
    source.skip(&path, before)?;
    rescaled(&path, grid, samples::read(&path, source, &layout, options)?, slope, intercept)
}

/// What stands in for NaN, as a stored sample.
pub(super) fn as_stored(path: &Path, nan_as: Option<f32>, slope: f32, intercept: f32) -> Result<Option<f32>> {
    let stored = nan_as.map(|v| (v - intercept) / slope);
    match stored.filter(|v| !v.is_finite()) {
        None => Ok(stored),
        Some(v) => Err(bad(
            path,
            format!("volume.nan_as becomes {v} with slope {slope} and intercept {intercept}"),
            "it must be finite as a stored sample",
        )),
    }
}

/// A volume whose slope and intercept come from a file.
pub(super) fn rescaled(path: &Path, grid: Grid, samples: Samples, slope: f32, intercept: f32) -> Result<Volume> {
    let volume = Volume::new(grid, samples, slope, intercept)?;
    if volume.range().iter().any(|v| !v.is_finite()) {
        let what = format!("slope {slope} and intercept {intercept} take its samples beyond the range of float32");
        return Err(bad(path, what, "values must be finite"));
    }
    Ok(volume)
}

/// Whether header and samples are in one file.
fn check_magic(path: &Path, h: &Bytes) -> Result<bool> {
    let magic = &h.raw[344..348];
    if h.i32(0) == 540 {
        return Err(bad(path, "it is a NIfTI-2 file", "NIfTI-1 is read; nibabel or `fslchfiletype` converts"));
    }
    if h.i32(0) != 348 {
        return Err(bad(path, format!("its header says that it has {} bytes", h.i32(0)), "a NIfTI-1 header has 348 bytes"));
    }
    match magic {
        b"n+1\0" => Ok(true),
        b"ni1\0" => Ok(false),
        [0, 0, 0, 0] => Err(bad(path, "it has no NIfTI mark: an ANALYZE 7.5 file", "NIfTI-1 is read; nibabel converts")),
        _ => {
            Err(bad(path, format!("its mark is '{}'", quote(&String::from_utf8_lossy(magic))), "NIfTI-1 files have n+1 or ni1 at byte 344"))
        }
    }
}

/// Dims, and of how many volumes or colours which is wanted: (index, count).
fn dims(path: &Path, h: &Bytes, colors: usize, options: &ReadOptions) -> Result<([usize; 3], (usize, usize))> {
    let dim: [i16; 8] = std::array::from_fn(|i| h.i16(40 + 2 * i));
    let used = usize::try_from(dim[0]).ok().filter(|n| (1..=7).contains(n));
    let used = used.ok_or_else(|| bad(path, format!("dim[0] is {}", dim[0]), "it counts the axes, 1 to 7"))?;
    let mut dims = [1; 3];
    let (mut volumes, mut series) = (1usize, None);
    for (axis, &n) in dim.iter().enumerate().skip(1).take(used) {
        match n {
            1.. if axis <= 3 => dims[axis - 1] = n as usize,
            2.. => {
                let what = match axis {
                    4 => format!("it is a series of {n} volumes (dim[4])"),
                    _ => format!("each voxel has {n} values (dim[{axis}])"),
                };
                volumes = volumes.saturating_mul(n as usize);
                series.get_or_insert(what);
            }
            // Unused axes are often left at 0.
            0 | 1 if axis > 3 => {}
            _ => return Err(bad(path, format!("dim[{axis}] is {n}"), "an axis has at least 1 voxel")),
        }
    }
    if colors > 1 {
        if let Some(series) = series {
            return Err(bad(path, format!("{series}, of colours"), "one scalar volume is needed; `fslroi` or nibabel cut one out"));
        }
        let labels = ["R", "G", "B", "A"].map(String::from);
        let what = format!("its samples are {} colours (datatype {})", if colors == 3 { "RGB" } else { "RGBA" }, h.i16(70));
        return Ok((dims, (super::choose::component(path, &what, colors, &labels[..colors], None, options)?, colors)));
    }
    let what = series.unwrap_or_else(|| "it is one scalar volume".into());
    let pick = super::choose::component(path, &what, volumes, &[], None, options).map_err(|e| match e {
        Error::Format { path, what, right } => {
            Error::Format { path, what, right: format!("one scalar volume is needed: {right}; `fslroi` or nibabel cut one out") }
        }
        other => other,
    })?;
    Ok((dims, (pick, volumes)))
}

/// Type of a sample, and samples per voxel that stand beside each other.
fn kind(path: &Path, h: &Bytes) -> Result<(SampleType, usize)> {
    let right = "integers and floats of 8 to 64 bits are read";
    let refused = |what: &str| Err(bad(path, format!("its samples are {what} (datatype {})", h.i16(70)), right));
    let kind = match h.i16(70) {
        2 => SampleType::U8,
        4 => SampleType::I16,
        8 => SampleType::I32,
        16 => SampleType::F32,
        64 => SampleType::F64,
        256 => SampleType::I8,
        512 => SampleType::U16,
        768 => SampleType::U32,
        1024 => SampleType::I64,
        1280 => SampleType::U64,
        1 => return refused("single bits"),
        32 | 1792 | 2048 => return refused("complex numbers"),
        RGB24 => return Ok((SampleType::U8, 3)),
        2304 => return Ok((SampleType::U8, 4)),
        1536 => return refused("128-bit floats"),
        _ => return refused("of an unknown type"),
    };
    if i64::from(h.i16(72)) != kind.bytes() as i64 * 8 {
        log::warn!("{}: bitpix is {}, the datatype is {}; the datatype holds", crate::error::shown(path), h.i16(72), kind.name());
    }
    Ok((kind, 1))
}

/// scl_slope and scl_inter; a slope of 0 (or one that is not finite, as some programs leave it) means none.
fn rescale(path: &Path, h: &Bytes) -> Result<(f32, f32)> {
    let [slope, intercept]: [f64; 2] = h.f32s(112);
    if slope == 0.0 || !slope.is_finite() {
        return Ok((1.0, 0.0));
    }
    if !intercept.is_finite() {
        return Err(bad(path, format!("scl_inter is {intercept} beside a slope of {slope}"), "it must be finite"));
    }
    Ok((slope as f32, intercept as f32))
}

/// Byte of the first sample.
fn offset(path: &Path, h: &Bytes, single: bool) -> Result<u64> {
    let offset = h.f32(108);
    if single && (0.0..352.0).contains(&offset) {
        log::warn!("{}: vox_offset is {offset}; samples are taken from byte 352 on, the first that is possible", crate::error::shown(path));
        return Ok(352);
    }
    // Up to here every whole number is a float32 (below) or at least meant (above 2^24).
    if offset >= 0.0 && offset.fract() == 0.0 && offset < 1e12 {
        return Ok(offset as u64);
    }
    Err(bad(path, format!("vox_offset is {offset}"), "it is the byte of the first sample, a whole number of 352 or more (0 in a pair)"))
}

/// A name without its `.gz`.
fn without_gz(path: &Path) -> PathBuf {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz")) { path.with_extension("") } else { path.to_owned() }
}

/// The header of the pair that `path`, an `.img` or `.img.gz`, is the samples' half of.
pub(super) fn header_beside(path: &Path) -> Option<PathBuf> {
    let name = without_gz(path);
    name.extension().filter(|e| e.eq_ignore_ascii_case("img"))?;
    ["hdr", "hdr.gz"].into_iter().map(|e| name.with_extension(e)).find(|p| p.is_file())
}

/// The samples' half of a pair: `name.img` or `name.img.gz` beside `name.hdr` or `name.hdr.gz`.
fn image(path: &Path) -> Result<(PathBuf, Source)> {
    let name = without_gz(path);
    for extension in ["img", "img.gz", "IMG"] {
        let data = name.with_extension(extension);
        if data.is_file() {
            let (mut file, length) = open(&data)?;
            let mut head = [0; 2];
            fill(&mut file, &mut head);
            let source = Source::new(&data, file, length, 0, head == [0x1f, 0x8b])?;
            return Ok((data, source));
        }
    }
    Err(bad(path, "it is the header of a pair, and its .img is not beside it", "name.hdr needs name.img or name.img.gz in the same folder"))
}

fn place(path: &Path, h: &Bytes, dims: [usize; 3]) -> Result<Grid> {
    let (qform, sform) = (h.i16(252), h.i16(254));
    let mut choices: Vec<(&str, DMat3, DVec3)> = Vec::new();
    if sform > 0 {
        let [x, y, z]: [[f64; 4]; 3] = std::array::from_fn(|row| h.f32s(280 + 16 * row));
        let matrix = DMat3::from_cols_array_2d(&[[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]]);
        choices.push(("sform", matrix, DVec3::new(x[3], y[3], z[3])));
    }
    let pixdim: [f64; 4] = h.f32s(76);
    let spacing = DVec3::from_array(std::array::from_fn(|a| {
        let s = pixdim[a + 1].abs();
        if s > 0.0 && s.is_finite() { s } else { 1.0 }
    }));
    if qform > 0 {
        let [b, c, d, ox, oy, oz]: [f64; 6] = h.f32s(256);
        let rest = 1.0 - (b * b + c * c + d * d);
        // Rounding may leave the vector part a little too long: a turn by 180 degrees.
        let q = DQuat::from_xyzw(b, c, d, rest.max(0.0).sqrt()).normalize();
        let flip = if pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let matrix = DMat3::from_quat(q) * DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, flip));
        choices.push(("qform", matrix, DVec3::new(ox, oy, oz)));
    }
    choices.push(("pixdim", DMat3::from_diagonal(spacing), DVec3::ZERO));
    let mut last: Option<Error> = None;
    for (name, matrix, centre) in choices {
        // The file places the centre of voxel 0, which has voxel coordinates ½.
        match grid(path, dims, DAffine3 { matrix3: matrix, translation: centre - matrix * DVec3::splat(0.5) }) {
            Ok(grid) => {
                if let Some(e) = last {
                    log::warn!("{e}; the {name} is taken instead");
                }
                return Ok(grid);
            }
            Err(e) => last = Some(e),
        }
    }
    Err(last.unwrap_or_else(|| bad(path, "it has no place in the world", "sform, qform or pixdim are needed")))
}
