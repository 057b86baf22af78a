//! How wrong a field or a picture is, measured against its reference (`physics.md`'s definitions, stated here too).

use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Grid, Picture, Visibility, Volume};
use crate::stages::directions::SplitMix;
use crate::stages::{pack, twin};

/// Directions of the reference.
pub const REFERENCE_DIRECTIONS: u32 = 4096;

/// Step of the reference, voxels.
pub const REFERENCE_STEP: f32 = 0.25;

/// Field cells within two cells of matter (σ_t > 0 at a voxel), up to `count` of them, drawn at random without
/// repetition from a fixed seed, ascending.
pub fn probes(volume: &Volume, medium: &Medium, ratio: u32, count: usize) -> Vec<u32> {
    let grid: &Grid = volume.grid();
    let n = grid.dims();
    let dims = grid.field_dims(ratio as usize);
    // Cells that hold a voxel of matter.
    let mut near = vec![false; dims.iter().product()];
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                let v = volume.value(x + n[0] * (y + n[1] * z));
                if twin::extinction(medium.table(), v) > 0.0 {
                    let c = |i: usize, a: usize| (i * dims[a] / n[a]).min(dims[a] - 1);
                    near[c(x, 0) + dims[0] * (c(y, 1) + dims[1] * c(z, 2))] = true;
                }
            }
        }
    }
    // Grown by two cells along each axis in turn.
    let strides = [1, dims[0], dims[0] * dims[1]];
    for a in 0..3 {
        let source = near.clone();
        for (i, out) in near.iter_mut().enumerate() {
            let at = i / strides[a] % dims[a];
            let (lo, hi) = (at.saturating_sub(2), (at + 2).min(dims[a] - 1));
            *out = (lo..=hi).any(|k| source[i + k * strides[a] - at * strides[a]]);
        }
    }
    let mut cells: Vec<u32> = near.iter().enumerate().filter(|(_, n)| **n).map(|(i, _)| i as u32).collect();
    // Fisher-Yates, as far as needed.
    let mut random = SplitMix(0x70_726f_6265);
    let count = count.min(cells.len());
    for i in 0..count {
        let j = i + (random.next() % (cells.len() - i) as u64) as usize;
        cells.swap(i, j);
    }
    cells.truncate(count);
    cells.sort_unstable();
    cells
}

/// The reference at some cells: `march` with [`REFERENCE_DIRECTIONS`] stratified directions and steps of
/// [`REFERENCE_STEP`] voxels.
///
/// # Errors
/// As [`Engine::estimate`].
pub fn reference(engine: &Engine, medium: &Medium, ratio: u32, cells: &[u32], progress: &mut Progress) -> Result<Vec<[f32; 16]>> {
    let settings = Visibility {
        method: Method::March,
        sampling: Sampling::Stratified,
        directions: REFERENCE_DIRECTIONS,
        step: REFERENCE_STEP,
        bands: 4,
        ratio,
        ..Visibility::default()
    };
    engine.estimate(medium, &settings, cells, progress)
}

/// Relative L2 error over cells and 16 coefficients, with a 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldError {
    /// √(Σ|v − v_ref|² / Σ|v_ref|²).
    pub relative_l2: f64,
    /// 95 % confidence interval: bootstrap over cells, 1,000 resamples, fixed seed.
    pub interval: [f64; 2],
}

/// The error of `v` against `reference`, cell by cell in the same order.
pub fn field_error(v: &[[f32; 16]], reference: &[[f32; 16]]) -> FieldError {
    let parts: Vec<(f64, f64)> = v
        .iter()
        .zip(reference)
        .map(|(v, r)| {
            v.iter().zip(r).fold((0.0, 0.0), |(d, n), (v, r)| {
                let (v, r) = (f64::from(*v), f64::from(*r));
                (d + (v - r) * (v - r), n + r * r)
            })
        })
        .collect();
    let ratio = |(d, n): (f64, f64)| if n > 0.0 { (d / n).sqrt() } else { 0.0 };
    let add = |a: (f64, f64), b: &(f64, f64)| (a.0 + b.0, a.1 + b.1);
    let relative_l2 = ratio(parts.iter().fold((0.0, 0.0), add));
    let mut random = SplitMix(0x626f_6f74);
    let mut resampled: Vec<f64> = (0..if parts.is_empty() { 0 } else { 1000 })
        .map(|_| ratio((0..parts.len()).fold((0.0, 0.0), |a, _| add(a, &parts[(random.next() % parts.len() as u64) as usize]))))
        .collect();
    resampled.sort_by(f64::total_cmp);
    let interval = if resampled.is_empty() { [0.0; 2] } else { [resampled[25], resampled[974]] };
    FieldError { relative_l2, interval }
}

/// What `bits` of packing make of coefficients.
pub fn packed(v: &[[f32; 16]], bands: u32, bits: u32) -> Vec<[f32; 16]> {
    v.iter()
        .map(|v| {
            let mut out = pack::decode(&pack::reference(v, bands, bits), bits);
            out[(bands * bands) as usize..].fill(0.0);
            out
        })
        .collect()
}

/// √mean((a − b)²)/mean(b) over R, G, B of the pixels that `b` covers (coverage above 0). `None` where sizes differ or
/// nothing is covered.
pub fn relative_rmse(a: &Picture, b: &Picture) -> Option<f64> {
    if (a.width, a.height) != (b.width, b.height) {
        return None;
    }
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for (a, b) in a.rgba.iter().zip(&b.rgba).filter(|(_, b)| b[3] > 0.0) {
        for c in 0..3 {
            squares += f64::from(a[c] - b[c]).powi(2);
            sum += f64::from(b[c]);
            count += 1.0;
        }
    }
    (count > 0.0 && sum > 0.0).then(|| (squares / count).sqrt() / (sum / count))
}
