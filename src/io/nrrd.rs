//! NRRD volumes, attached and detached. Format: <https://teem.sourceforge.net/nrrd/format.html>.
//!
//! World coordinates are those of the file's `space` (LPS, RAS, …), unchanged; of a left-handed one (LAS) x is negated.
//! `space origin` is the centre of the first sample, whatever the axes' centering. Without an origin the volume's box begins at the world origin.

use super::ReadOptions;
use super::limits::{Source, bad, grid, io, open, quote};
use super::nrrd_header::{self as header, Encoding, Header};
use super::samples::{self, Layout};
use crate::error::{Error, Result};
use crate::scene::{Grid, Volume};
use glam::{DAffine3, DMat3, DVec3};
use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

/// Reads the volume in an opened NRRD file of `length` bytes.
pub(super) fn read(path: &Path, mut file: BufReader<File>, length: u64, options: &ReadOptions) -> Result<Volume> {
    let header = header::read(path, &mut file)?;
    let (axes, apart) = spatial_axes(path, &header, options)?;
    let dims = dims(path, &header, axes)?;
    let grid = place(path, &header, axes, dims)?;
    let mut layout = Layout {
        big_endian: header.big_endian,
        text: header.encoding == Encoding::Text,
        replace: options.nan_as,
        ..Layout::scalar(dims, header.kind)
    };
    // Components that change fastest lie beside each other; those that change slowest are volumes one after the other.
    let mut before = 0;
    match apart {
        None => {}
        Some((0, count, pick)) => (layout.components, layout.pick) = (count, Some(pick)),
        Some((_, count, pick)) => {
            if layout.text || header.byte_skip < 0 {
                let what = format!("its {count} volumes are text, or end the file (byte skip: -1)");
                return Err(bad(path, what, "one of several is read from encoding: raw or gzip; `unu slice` cuts one out"));
            }
            before = layout.stored_bytes().and_then(|n| n.checked_mul(pick as u64)).unwrap_or(u64::MAX);
            layout.more = pick + 1 < count;
        }
    }
    let (path, mut source) = data(path, file, length, &header, &layout, options)?;
    source.skip(&path, before)?;
    Volume::new(grid, samples::read(&path, source, &layout, options)?, 1.0, 0.0)
}

/// Whether the samples along an axis lie in space; a reason where they do not.
fn not_spatial(header: &Header, axis: usize) -> Option<String> {
    let kind = &header.kinds[axis];
    if !matches!(kind.as_str(), "" | "domain" | "space" | "time" | "none" | "???" | "unknown") {
        return Some(format!("of kind '{}'", quote(kind)));
    }
    let directions = header.directions.as_ref()?;
    if let Some([0.0, 0.0, 0.0, _]) = directions[axis].as_deref() {
        return Some("along the fourth dimension of its space".into());
    }
    (directions[axis].is_none() && directions.iter().any(Option::is_some)).then(|| "without a direction in space".into())
}

/// Axes x, y, z, and beside them (axis, its size, the component wanted).
type Axes = ([Option<usize>; 3], Option<(usize, usize, usize)>);

/// The axes x, y and z; the third is missing for a 2-D image. Axes of size 1 that are too many fall away, those that are
/// not spatial first. One more, of components, may be the fastest or the slowest.
fn spatial_axes(path: &Path, header: &Header, options: &ReadOptions) -> Result<Axes> {
    let mut axes: Vec<usize> = (0..header.sizes.len()).collect();
    let drop = |axes: &mut Vec<usize>, which: &dyn Fn(usize) -> bool| {
        axes.iter().rposition(|&a| header.sizes[a] == 1 && which(a)).map(|i| axes.remove(i)).is_some()
    };
    while axes.len() > 2 && drop(&mut axes, &|a| not_spatial(header, a).is_some()) {}
    let in_space = |axes: &[usize]| axes.iter().filter(|&&a| not_spatial(header, a).is_none()).count();
    while in_space(&axes) > 3 && drop(&mut axes, &|_| true) {}
    let scalar = "a scalar volume has three axes in space, and beside them only axes of size 1";
    // Components in the midst become the slowest where only axes of size 1 follow.
    let within = axes.iter().position(|&a| not_spatial(header, a).is_some()).filter(|&i| i > 0);
    while axes.len() > 3 && within.is_some_and(|i| i + 1 < axes.len()) && axes.last().is_some_and(|&a| header.sizes[a] == 1) {
        axes.pop();
    }
    let odd = axes.iter().find_map(|&a| Some((a, not_spatial(header, a)?)));
    let asked = options.component.is_some();
    let mut apart = None;
    // Without a word about it, a fourth axis holds components only where one is asked for.
    if let Some(a) = odd.as_ref().map(|o| o.0).or_else(|| axes.last().copied().filter(|_| asked && axes.len() == 4)) {
        let what = match &odd {
            Some((_, why)) => format!("axis {a} has {} samples and is {why}", header.sizes[a]),
            None => format!("axis {a} has {} samples", header.sizes[a]),
        };
        let (first, last) = (axes.first() == Some(&a), axes.last() == Some(&a));
        let Some(count) = usize::try_from(header.sizes[a]).ok().filter(|_| axes.len() <= 4 && (first || last)) else {
            return Err(bad(path, what, scalar));
        };
        let pick = super::choose::component(path, &what, count, &[], None, options).map_err(|e| match e {
            Error::Format { path, what, right } => Error::Format { path, what, right: format!("{scalar}: {right}") },
            other => other,
        })?;
        apart = Some((if first { 0 } else { a }, count, pick));
        axes.retain(|&b| b != a);
    } else if axes.len() <= 3 {
        super::choose::component(path, "it is a scalar volume", 1, &[], None, options)?;
    }
    let axes = match axes[..] {
        [x, y] => Ok([Some(x), Some(y), None]),
        [x, y, z] => Ok([Some(x), Some(y), Some(z)]),
        [_] => Err(bad(path, "it has one axis only", "2 or 3 axes in space are needed")),
        _ => {
            let sizes: Vec<String> = header.sizes.iter().map(u64::to_string).collect();
            let last = axes.last().copied().unwrap_or(0);
            let what = format!("it has {} axes ({}); axis {last} alone has {}", sizes.len(), sizes.join("x"), header.sizes[last]);
            Err(bad(path, what, scalar))
        }
    };
    Ok((axes?, apart))
}

/// Voxels along the chosen axes.
pub(super) fn dims(path: &Path, header: &Header, axes: [Option<usize>; 3]) -> Result<[usize; 3]> {
    let mut dims = [1; 3];
    for (n, a) in dims.iter_mut().zip(axes) {
        let size = a.map_or(1, |a| header.sizes[a]);
        *n = usize::try_from(size).map_err(|_| bad(path, format!("an axis of {size} samples"), "at most 1048576 are read"))?;
    }
    Ok(dims)
}

/// The grid. A 2-D image becomes one slice, as thick as the shorter of its spacings.
pub(super) fn place(path: &Path, header: &Header, axes: [Option<usize>; 3], dims: [usize; 3]) -> Result<Grid> {
    let directions = header.directions.as_ref();
    let space = directions.and_then(|d| d.iter().flatten().next()).or(header.origin.as_ref()).map_or(3, Vec::len);
    // A fourth, of time, may be there as long as the volume does not lean into it.
    let leans = axes.iter().flatten().any(|&a| directions.and_then(|d| d[a].as_ref()).is_some_and(|v| v.len() == 4 && v[3] != 0.0));
    if !(2..=4).contains(&space) || leans || header.origin.as_ref().is_some_and(|o| o.len() != space) {
        return Err(bad(
            path,
            format!("its space has {space} dimensions, or its origin not as many"),
            "2 or 3 are read, and a fourth of time",
        ));
    }
    // The world is right-handed.
    let mirror = if header.left_handed && directions.is_some() { -1.0 } else { 1.0 };
    if mirror < 0.0 {
        log::warn!("{}: its space is left-handed; x is negated, so that what it shows is not mirrored", crate::error::shown(path));
    }
    let vector = |v: &[f64]| DVec3::new(mirror * v[0], v[1], v.get(2).copied().unwrap_or(0.0));
    let column = |i: usize| {
        let a = axes[i]?;
        if let Some(v) = directions.and_then(|d| d[a].as_ref()) {
            return Some(vector(v));
        }
        // Unknown spacings count as 1.
        let s = header.spacings[a];
        Some(DVec3::AXES[i] * if s.is_nan() { 1.0 } else { s })
    };
    let x = column(0).unwrap_or(DVec3::X);
    let y = column(1).unwrap_or(DVec3::Y);
    let z = column(2).unwrap_or_else(|| x.cross(y).normalize_or_zero() * x.length().min(y.length()));
    let matrix = DMat3::from_cols(x, y, z);
    let origin = header.origin.as_deref().map(vector).filter(|o| !o.is_nan());
    // Voxel coordinates have the centre of the first sample at ½.
    let corner = origin.map_or(DVec3::ZERO, |centre| centre - matrix * DVec3::splat(0.5));
    grid(path, dims, DAffine3 { matrix3: matrix, translation: corner })
}

/// The file that holds the samples, at the first of them.
pub(super) fn data(
    path: &Path,
    file: BufReader<File>,
    length: u64,
    header: &Header,
    layout: &Layout,
    options: &ReadOptions,
) -> Result<(PathBuf, Source)> {
    let (path, mut file, length, mut at) = match &header.data_file {
        None => (path.to_owned(), file, length, header.end),
        Some(name) => {
            let data = beside(path, name, options.allow_outside)?;
            let (file, length) = open(&data)?;
            (data, file, length, 0)
        }
    };
    let gzip = header.encoding == Encoding::Gzip;
    file.seek(SeekFrom::Start(at)).map_err(|e| io(&path, "read", e))?;
    for line in 0..header.line_skip {
        let n = file.skip_until(b'\n').map_err(|e| io(&path, "read", e))?;
        if n == 0 {
            return Err(bad(
                &path,
                format!("{} lines are to be skipped, it has {line}", header.line_skip),
                "line skip must lie inside the file",
            ));
        }
        at += n as u64;
    }
    if header.byte_skip < 0 {
        // The samples are the last bytes of the file.
        let needs = layout.count().and_then(|n| n.checked_mul(layout.kind.bytes()));
        let start = needs.and_then(|n| length.checked_sub(n)).filter(|s| *s >= at);
        at = start.ok_or_else(|| {
            let what =
                format!("{} need {} bytes, the file holds {} there", layout.what(), needs.unwrap_or(u64::MAX), length.saturating_sub(at));
            bad(&path, what, "the file is cut short or its header is wrong")
        })?;
    }
    let mut source = Source::new(&path, file, length, at, gzip)?;
    // Compressed samples are skipped after decompression.
    source.skip(&path, u64::try_from(header.byte_skip).unwrap_or(0))?;
    Ok((path, source))
}

/// The path of a data file that a header names, refused when it lies outside the header's folder.
pub(super) fn beside(path: &Path, name: &str, allow_outside: bool) -> Result<PathBuf> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let data = folder.join(name);
    let outside = || {
        let right = "it must lie in the header's folder: move it there, or the header to it";
        Err(bad(path, format!("its data file '{}' lies elsewhere", quote(name)), right))
    };
    if !allow_outside {
        if !Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
            return outside();
        }
        if std::fs::metadata(&data).is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound) {
            return Err(bad(
                path,
                format!("its data file '{}' is not there", quote(name)),
                "a detached header needs its data file beside it",
            ));
        }
        // A link may lead out, too.
        let real = |p: &Path| p.canonicalize().map_err(|e| io(p, "open", e));
        if !real(&data)?.starts_with(real(folder)?) {
            return outside();
        }
    }
    Ok(data)
}
