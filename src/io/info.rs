//! What a volume is, as plain data.

use super::{ReadOptions, read_volume};
use crate::error::Result;
use crate::scene::Volume;
use serde::Serialize;
use std::cell::Cell;
use std::path::Path;

/// Bins of [`VolumeInfo::histogram`].
pub const BINS: usize = 64;

/// A description of a volume.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VolumeInfo {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Type of the samples in memory: "uint8", "uint16", "int16" or "float32".
    pub sample_type: &'static str,
    /// Bytes of the samples in memory.
    pub bytes: u64,
    /// Edges of a voxel, world units.
    pub spacing: [f64; 3],
    /// Unit vectors of the voxel axes in world coordinates: `directions[0]` is that of x.
    pub directions: [[f64; 3]; 3],
    /// World coordinates of the corner where the box begins (voxel coordinates 0, 0, 0).
    pub corner: [f64; 3],
    /// World coordinates of the centre of voxel (0, 0, 0): what NRRD and NIfTI call the origin.
    pub first_centre: [f64; 3],
    /// Value = slope·sample + intercept.
    pub slope: f32,
    /// See `slope`.
    pub intercept: f32,
    /// NaN and infinite samples; what follows is of the others. Only [`describe_file`] accepts any.
    pub not_finite: u64,
    /// Smallest and largest value, in the data's unit; zeros where no sample is finite.
    pub range: [f32; 2],
    /// Mean value.
    pub mean: f64,
    /// Voxels per 64th of the range, the last closed on both sides; a constant volume has all in the first.
    pub histogram: Vec<u64>,
}

/// Describes the volume in a file, also one with NaN and infinite samples where `options` give nothing to put in their
/// place.
///
/// # Errors
/// As [`read_volume`].
pub fn describe_file(path: &Path, options: &ReadOptions) -> Result<VolumeInfo> {
    let count = Cell::new(0);
    let volume = read_volume(path, &ReadOptions { count_not_finite: Some(&count), ..options.clone() })?;
    let mut info = describe(&volume);
    let (odd, finite) = (count.get(), volume.grid().voxels() - count.get());
    if odd == 0 {
        return Ok(info);
    }
    info.not_finite = odd;
    if finite == 0 {
        (info.range, info.mean, info.histogram) = ([0.0; 2], 0.0, vec![0; BINS]);
        return Ok(info);
    }
    // The smallest sample stands for them: at the upper end where the slope is negative.
    let low = info.slope > 0.0;
    let bin = if low || info.range[0] == info.range[1] { 0 } else { BINS - 1 };
    info.histogram[bin] = info.histogram[bin].saturating_sub(odd);
    let sum = info.mean * volume.grid().voxels() as f64 - odd as f64 * f64::from(info.range[usize::from(!low)]);
    info.mean = sum / finite as f64;
    Ok(info)
}

/// Describes a volume; reads all of its samples once.
pub fn describe(volume: &Volume) -> VolumeInfo {
    let grid = volume.grid();
    let map = grid.voxel_to_world();
    let range = volume.range();
    let (lo, width) = (f64::from(range[0]), f64::from(range[1]) - f64::from(range[0]));
    let mut histogram = vec![0; BINS];
    let mut sum = 0.0;
    for i in 0..volume.samples().len() {
        let value = f64::from(volume.value(i));
        sum += value;
        let bin = if width > 0.0 { ((value - lo) / width * BINS as f64) as usize } else { 0 };
        histogram[bin.min(BINS - 1)] += 1;
    }
    let sample_type = volume.samples().type_name();
    let each = match sample_type {
        "uint8" => 1,
        "float32" => 4,
        _ => 2,
    };
    let (slope, intercept) = volume.rescale();
    VolumeInfo {
        dims: grid.dims(),
        sample_type,
        bytes: grid.voxels() * each,
        spacing: grid.spacing(),
        directions: [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis].map(|v| v.normalize_or_zero().to_array()),
        corner: map.translation.to_array(),
        first_centre: map.transform_point3(glam::DVec3::splat(0.5)).to_array(),
        slope,
        intercept,
        not_finite: 0,
        range,
        mean: sum / grid.voxels() as f64,
        histogram,
    }
}
