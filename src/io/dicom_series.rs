//! DICOM slices to one volume: which series, in which order, at which distance.

use super::ReadOptions;
use super::choose;
use super::dicom::Slice;
use super::limits::{bad, grid, quote};
use super::nifti::{as_stored, rescaled};
use super::parts::parts;
use super::samples::{self, Layout, SampleType};
use crate::error::{Error, Result, shown};
use crate::scene::{Samples, Volume};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads the volume that some slices make up; `path` is the folder or file that they come from.
/// Of some series a file cannot be read: `unread` says why.
pub(super) fn read(path: &Path, slices: Vec<Slice>, unread: BTreeMap<String, Error>, options: &ReadOptions) -> Result<Volume> {
    let mut slices = series(path, slices, unread, options)?;
    let Some(first) = slices.first().cloned() else { return Err(bad(path, "it holds no image", "an image series is needed")) };
    for slice in &slices {
        let same_axes = match (slice.axes, first.axes) {
            (Some(a), Some(b)) => (0..2).all(|i| (a[i] - b[i]).length() < 1e-3),
            (a, b) => a.is_some() == b.is_some(),
        };
        let same_spacing = match (slice.spacing, first.spacing) {
            (Some(a), Some(b)) => (0..2).all(|i| (a[i] - b[i]).abs() < 1e-3 * b[i]),
            (a, b) => a.is_some() == b.is_some(),
        };
        if !slice.form.fits(&first.form) || !same_axes || !same_spacing {
            let what = format!(
                "it is {}, {}, and {} is {}, {}",
                slice.form.says(),
                frame(slice),
                shown(&first.path),
                first.form.says(),
                frame(&first)
            );
            return Err(bad(
                &slice.path,
                what,
                "slices of one volume share size, type, orientation and spacing: keep one kind in the folder",
            ));
        }
    }
    let axes = arrange(path, &mut slices)?;
    let form = first.form;
    if form.photometric == "MONOCHROME1" {
        log::warn!("{}: in its pictures small values are bright (MONOCHROME1); values are read as they are stored", shown(path));
    }
    if form.photometric == "PALETTE COLOR" {
        log::warn!("{}: its samples are indices of a palette (PALETTE COLOR); values are these indices", shown(path));
    }
    if slices.iter().any(|s| s.no_slope) {
        log::warn!("{}: its RescaleSlope is 0; 1 is taken", shown(path));
    }
    if slices.iter().any(|s| s.table) {
        log::warn!("{}: its Modality LUT is not applied; values are read as they are stored", shown(path));
    }
    let dims = [form.columns, form.rows, slices.len()];
    let origin = slices[0].position.unwrap_or(DVec3::ZERO);
    let grid = grid(path, dims, DAffine3 { matrix3: axes, translation: origin - axes * DVec3::splat(0.5) })?;
    let labels: Vec<String> = match (form.channels, form.photometric.as_str()) {
        (1, _) => Vec::new(),
        (3, p) if p.starts_with("YBR") => ["Y", "Cb", "Cr"].map(String::from).into(),
        _ => ["R", "G", "B", "A"][..form.channels].iter().map(|s| (*s).to_owned()).collect(),
    };
    let what = format!("its pixels have {} samples ({})", form.channels, quote(&form.photometric));
    let pick = choose::component(path, &what, form.channels, &labels, None, options)?;
    // One slope for all is the volume's own; else each slice is brought to the data's unit.
    let (slope, intercept) = slices[0].rescale;
    let uniform = slices.iter().all(|s| s.rescale == slices[0].rescale);
    let replace = if uniform { as_stored(path, options.nan_as, slope, intercept)? } else { options.nan_as };
    let kind = if uniform { form.kind() } else { SampleType::F32 };
    let layout = Layout { components: form.channels, pick: Some(pick), replace, ..Layout::scalar(dims, kind) };
    let each = layout.stored_bytes().unwrap_or(u64::MAX) / slices.len() as u64;
    let stored = form.kind();
    let padding: Vec<_> = slices.iter().map(|s| s.form.padding).collect();
    let source = parts(slices.len(), each, move |i, bytes| {
        if uniform {
            return slices[i].load(bytes);
        }
        let mut raw = Vec::new();
        slices[i].load(&mut raw)?;
        let (slope, intercept) = slices[i].rescale;
        let width = stored.bytes() as usize;
        bytes.extend(raw.chunks_exact(width).flat_map(|c| (slope * value(c, stored) + intercept).to_le_bytes()));
        Ok(())
    });
    let mut samples = samples::read(path, source, &layout, options)?;
    if uniform {
        unpad(path, &mut samples, &padding);
    }
    if uniform { rescaled(path, grid, samples, slope, intercept) } else { Volume::new(grid, samples, 1.0, 0.0) }
}

/// Padding around the image (the corners of a round field of view) counts as the image's smallest sample. Where it lies between the
/// image's samples it stays: some write a value that is none of their padding.
fn unpad(path: &Path, samples: &mut Samples, padding: &[Option<[i64; 2]>]) {
    fn of<T: Copy + Into<i64>>(samples: &mut [T], padding: &[Option<[i64; 2]>]) -> Option<(u64, [i64; 2], i64)> {
        let each = samples.len() / padding.len().max(1);
        let odd = |i: usize, v: i64| padding[i / each].is_some_and(|[lo, hi]| (lo..=hi).contains(&v));
        let image = samples.iter().enumerate().filter(|(i, v)| !odd(*i, (**v).into()));
        let [least, most] = [image.clone().min_by_key(|(_, v)| (**v).into()), image.max_by_key(|(_, v)| (**v).into())];
        let (least, most) = (*least?.1, (*most?.1).into());
        let (low, mut count, mut first) = (least.into(), 0, None);
        for (i, v) in samples.iter_mut().enumerate() {
            let value = (*v).into();
            if odd(i, value) && !(low..=most).contains(&value) {
                (*v, count) = (least, count + 1);
                first = first.or(padding[i / each]);
            }
        }
        Some((count, first?, low))
    }
    if padding.iter().all(Option::is_none) {
        return;
    }
    let done = match samples {
        Samples::U8(s) => of(s, padding),
        Samples::U16(s) => of(s, padding),
        Samples::I16(s) => of(s, padding),
        Samples::F32(_) => None,
    };
    if let Some((count, [lo, hi], least)) = done {
        let value = if lo == hi { lo.to_string() } else { format!("{lo} to {hi}") };
        log::warn!(
            "{}: {count} samples are padding (PixelPaddingValue, {value} as stored), no image; its smallest sample, {least}, stands for them",
            shown(path)
        );
    }
}

/// A little-endian sample as a number.
fn value(bytes: &[u8], kind: SampleType) -> f32 {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let low = u32::from_le_bytes([wide[0], wide[1], wide[2], wide[3]]);
    match kind {
        SampleType::I8 => f32::from(low as i8),
        SampleType::I16 => f32::from(low as i16),
        SampleType::I32 => low as i32 as f32,
        SampleType::F32 => f32::from_bits(low),
        SampleType::F64 => f64::from_le_bytes(wide) as f32,
        _ => low as f32,
    }
}

/// "0.5x0.75 mm, rows along [1, 0, 0]".
fn frame(slice: &Slice) -> String {
    let spacing = slice.spacing.map_or_else(|| "of unknown spacing".into(), |[x, y]| format!("{x}x{y} mm"));
    match slice.axes {
        Some([x, y]) => format!("{spacing}, rows along {x:.3}, columns along {y:.3}"),
        None => format!("{spacing}, of unknown orientation"),
    }
}

/// The slices of the wanted series.
fn series(path: &Path, slices: Vec<Slice>, mut unread: BTreeMap<String, Error>, options: &ReadOptions) -> Result<Vec<Slice>> {
    let mut all: BTreeMap<String, Vec<Slice>> = unread.keys().map(|uid| (uid.clone(), Vec::new())).collect();
    for slice in slices {
        all.entry(slice.series.clone()).or_default().push(slice);
    }
    let list = || {
        let some = all.iter().take(8).map(|(uid, s)| {
            let description = s.first().map_or("", |s| s.description.as_str());
            let description = if description.is_empty() { "no description" } else { description };
            let odd = if unread.contains_key(uid) { ", not readable" } else { "" };
            format!("{} ({}, {} slices{odd})", quote(uid), quote(description), s.len())
        });
        let more = if all.len() > 8 { ", …" } else { "" };
        some.collect::<Vec<_>>().join(", ") + more
    };
    let chosen = match &options.series {
        Some(wanted) => {
            if !all.contains_key(wanted) {
                let what = format!("is '{}', and {} holds {}", quote(wanted), shown(path), list());
                return Err(Error::Invalid { item: "volume.series", what, right: "it must be one of these SeriesInstanceUIDs".into() });
            }
            wanted.clone()
        }
        None if all.len() > 1 => {
            return Err(bad(path, format!("it holds {} series: {}", all.len(), list()), "choose one with volume.series"));
        }
        None => all.keys().next().cloned().unwrap_or_default(),
    };
    unread.remove(&chosen).map_or(Ok(()), Err)?;
    Ok(all.remove(&chosen).unwrap_or_default())
}

/// Sorts slices along their normal; returns the voxel axes.
fn arrange(path: &Path, slices: &mut [Slice]) -> Result<DMat3> {
    let first = slices[0].clone();
    let spacing = first.spacing.unwrap_or_else(|| {
        log::warn!("{}: it has no PixelSpacing; 1 is taken", shown(path));
        [1.0; 2]
    });
    let [x, y] = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let normal = x.cross(y).normalize_or_zero();
    let in_plane = |z: DVec3| DMat3::from_cols(x * spacing[0], y * spacing[1], z);
    let known = first.between.unwrap_or(spacing[0].min(spacing[1]));
    if slices.iter().any(|s| s.position.is_none()) || first.axes.is_none() {
        slices.sort_by(|a, b| (a.instance, &a.path).cmp(&(b.instance, &b.path)));
        slices.iter_mut().for_each(|s| s.position = None);
        if slices.len() > 1 {
            log::warn!("{}: its slices have no positions; they are sorted by InstanceNumber, {} apart", shown(path), known.abs());
            return Ok(in_plane(normal * known));
        }
        return Ok(in_plane(normal * known.abs()));
    }
    let place = |s: &Slice| s.position.unwrap_or_default().dot(normal);
    slices.sort_by(|a, b| place(a).total_cmp(&place(b)));
    let count = slices.len();
    if count == 1 {
        return Ok(in_plane(normal * known.abs()));
    }
    let gaps: Vec<f64> = slices.windows(2).map(|w| place(&w[1]) - place(&w[0])).collect();
    let mut sorted = gaps.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    if let Some(i) = gaps.iter().position(|g| *g < 1e-3 * median || *g <= 1e-6) {
        let (one, other) = (&slices[i].path, &slices[i + 1].path);
        return Err(match one == other {
            true => bad(
                path,
                format!("frames of {} lie at the same place", shown(one)),
                "several times, echoes or phases are no volume: dcm2niix parts them",
            ),
            false => bad(
                path,
                format!("{} and {} lie at the same place", shown(one), shown(other)),
                "a series of several times, echoes or phases is no volume: keep one of them in the folder",
            ),
        });
    }
    let span = slices[count - 1].position.unwrap_or_default() - slices[0].position.unwrap_or_default();
    let far = |g: &f64| (g - median).abs() > 0.02 * median;
    let Some(i) = gaps.iter().position(far) else { return Ok(in_plane(span / (count - 1) as f64)) };
    let missing: f64 = gaps.iter().map(|g| (g / median).round() - 1.0).filter(|n| *n >= 1.0).sum();
    // The mean, not the median: positions are often rounded.
    let parts = (count - 1) as f64 + missing;
    let step = (place(&slices[count - 1]) - place(&slices[0])) / parts;
    let between = format!("{} and {}", shown(&slices[i].path), shown(&slices[i + 1].path));
    if missing >= 1.0 {
        log::warn!("{}: {missing} slices seem to be missing, the first between {between}; the others are put {step} apart", shown(path));
    } else {
        log::warn!("{}: its slices are unevenly spaced, {} mm between {between}; all are put {step} apart", shown(path), gaps[i]);
    }
    Ok(in_plane(span / parts))
}
