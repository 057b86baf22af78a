//! occupancy: where there is anything at all. Per block of 4³ voxels the distance, in blocks, to the nearest block that
//! holds matter, so that rays leap over what is empty (distance maps after Deakin & Knoll 2019, *Accelerated Volume
//! Rendering with Chebyshev Distance Maps*).
//!
//! A block's range holds every sample that a trilinear tap inside the block can touch: its voxels and one more on every
//! side. A block holds matter when an entry with σ_t > 0 has part in the interpolation between its smallest and largest
//! sample, rounding added. The ranges are found once, at upload, on the host, which is reading every
//! sample then anyway; the distances anew on the device with every transfer function.

use super::widen::SampleType;
use super::{Encoding, Parts, slab};
use crate::error::Result;
use crate::kernels::constants::{BLOCK, MAX_LEAP};
use crate::kernels::{occupancy as kernel, occupancy_distance as distance_kernel};
use crate::scene::transfer::{TABLE_SIZE, Table};
use crate::scene::{Samples, Volume};
use crate::vk::{Access, Buffer, Format, Image, Recorder};

/// Blocks per dispatch: tens of milliseconds on a CPU device.
const BLOCKS: u64 = 1 << 19;

/// Blocks along x, y, z of a volume of `dims` voxels; the last along an axis may reach beyond the volume.
pub fn block_dims(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.div_ceil(BLOCK))
}

/// Bytes on the device: ranges and distances that stay, and the distances of one pass while they are computed. `image` says what
/// one takes, by its dims and the bytes of a texel.
pub fn bytes(volume: &Volume, image: impl Fn([u32; 3], u64) -> u64) -> (u64, u64) {
    let blocks = block_dims(volume.grid().dims()).map(|n| n as u32);
    let distances = image(blocks, 1);
    (image(blocks, format(volume.samples()).bytes().into()) + distances, distances + FILLED_BYTES)
}

const FILLED_BYTES: u64 = 4 * (TABLE_SIZE as u64 + 1);

/// The format of the ranges: two samples as the volume's image holds one.
pub fn format(samples: &Samples) -> Format {
    if matches!(samples, Samples::F32(_)) { Format::Rg32Sfloat } else { Format::Rg16Unorm }
}

/// Smallest and largest sample of each block of `BLOCK`³ voxels and of one voxel around it, x fastest, as texels of
/// [`format`].
pub fn ranges(volume: &Volume) -> Vec<u8> {
    fn texels<T: Copy, const N: usize>(ranges: Vec<[T; 2]>, encode: impl Fn(T) -> [u8; N]) -> Vec<u8> {
        ranges.into_iter().flatten().flat_map(encode).collect()
    }
    let dims = volume.grid().dims();
    let (factor, offset) = SampleType::stored_as(volume).spread();
    let word = |v: i32| (((v + offset) * factor) as u16).to_ne_bytes();
    match volume.samples() {
        Samples::U8(s) => texels(block_ranges(s, dims, |a, b| a.min(b), |a, b| a.max(b)), |v| word(v.into())),
        Samples::U16(s) => texels(block_ranges(s, dims, |a, b| a.min(b), |a, b| a.max(b)), |v| word(v.into())),
        Samples::I16(s) => texels(block_ranges(s, dims, |a, b| a.min(b), |a, b| a.max(b)), |v| word(v.into())),
        Samples::F32(s) => texels(block_ranges(s, dims, f32::min, f32::max), f32::to_ne_bytes),
    }
}

/// Slices are joined along z, then rows along y, whole rows at a time, then samples along x.
fn block_ranges<T: Copy>(samples: &[T], [nx, ny, nz]: [usize; 3], min: impl Fn(T, T) -> T, max: impl Fn(T, T) -> T) -> Vec<[T; 2]> {
    let [bx, by, bz] = block_dims([nx, ny, nz]);
    let around = |block: usize, n: usize| (block * BLOCK).saturating_sub(1)..(block * BLOCK + BLOCK + 1).min(n);
    let join = |lo: &mut [T], hi: &mut [T], other_lo: &[T], other_hi: &[T]| {
        for ((lo, hi), (a, b)) in lo.iter_mut().zip(hi).zip(other_lo.iter().zip(other_hi)) {
            (*lo, *hi) = (min(*lo, *a), max(*hi, *b));
        }
    };
    let mut out = Vec::with_capacity(bx * by * bz);
    for z in 0..bz {
        let mut slices = around(z, nz).map(|z| &samples[z * nx * ny..(z + 1) * nx * ny]);
        let Some(first) = slices.next() else { continue };
        let (mut lo, mut hi) = (first.to_vec(), first.to_vec());
        for slice in slices {
            join(&mut lo, &mut hi, slice, slice);
        }
        for y in 0..by {
            let mut rows = around(y, ny).map(|y| y * nx..(y + 1) * nx);
            let Some(first) = rows.next() else { continue };
            let (mut row_lo, mut row_hi) = (lo[first.clone()].to_vec(), hi[first].to_vec());
            for row in rows {
                join(&mut row_lo, &mut row_hi, &lo[row.clone()], &hi[row]);
            }
            for x in 0..bx {
                let x = around(x, nx);
                let (a, b) = (&row_lo[x.clone()], &row_hi[x]);
                out.push([a.iter().copied().fold(a[0], &min), b.iter().copied().fold(b[0], &max)]);
            }
        }
    }
    out
}

/// What rays leap by.
#[derive(Clone, Copy)]
pub struct Leap<'a> {
    /// Distances of the blocks.
    pub distances: &'a Image,
    /// Box of voxels around all matter, first and one past the last; beyond it nothing is sampled.
    pub bounds: [[usize; 3]; 2],
    /// Whether rays leap at all.
    pub skip: bool,
}

impl Leap<'_> {
    /// The box as the kernels take it: per axis the first voxel, and << 16 one past the last.
    pub(super) fn packed(&self) -> [u32; 3] {
        std::array::from_fn(|a| self.bounds[0][a] as u32 | (self.bounds[1][a] as u32) << 16)
    }
}

/// Entries with σ_t > 0 before entry i, for i = 0..=TABLE_SIZE.
pub fn filled(table: &Table) -> Vec<u32> {
    let mut count = 0;
    std::iter::once(0)
        .chain(table.sigma.iter().map(|&s| {
            count += u32::from(s > 0.0);
            count
        }))
        .collect()
}

/// Records the distances of all blocks into `distances` (r8, fresh, [`block_dims`]), which is left ready to be read;
/// `scratch` is a fresh image of the same kind, `filled` a buffer of [`filled`], `map` image sample → table coordinate,
/// `surface` whether the table is that of a surface.
///
/// # Errors
/// What the recorder refuses.
pub fn record(
    rec: &mut Recorder,
    ranges: &Image,
    (filled, map, surface): (&Buffer, (f32, f32), bool),
    (distances, scratch): (&Image, &Image),
    parts: &mut Parts,
) -> Result<()> {
    let dims = ranges.dims();
    let slices = slab(dims, BLOCKS);
    // Each of four passes.
    let part = |pass: u32, first_slice: u32| (f64::from(pass) + f64::from((first_slice + slices).min(dims[2])) / f64::from(dims[2])) / 4.0;
    // Fresh images take the layout for stores.
    rec.barrier(&[scratch, distances].map(|i| i.mip(0).from(Access::None).to(Access::ComputeWrite)));
    for first_slice in (0..dims[2]).step_by(slices as usize) {
        if first_slice > 0 {
            // Slabs do not overlap; levels are tracked whole.
            rec.barrier(&[scratch.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
        }
        rec.dispatch(
            &kernel::Bindings { bounds: ranges.sampled(), filled, distances: scratch.storage(0) },
            &kernel::Spec::default(),
            &kernel::Params { map_scale: map.0, map_bias: map.1, first_slice, surface: surface.into() },
            [dims[0], dims[1], slices.min(dims[2] - first_slice)],
        )?;
        parts(rec, part(0, first_slice))?;
    }
    let mut from = scratch;
    let mut to = distances;
    for axis in 0..3 {
        // Each axis reads what the one before wrote.
        rec.barrier(&[from.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
        if axis > 0 {
            // And writes over what the one before read.
            rec.barrier(&[to.mip(0).from(Access::ComputeRead).to(Access::ComputeWrite)]);
        }
        for first_slice in (0..dims[2]).step_by(slices as usize) {
            if first_slice > 0 {
                // Slabs do not overlap; levels are tracked whole.
                rec.barrier(&[to.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
            }
            rec.dispatch(
                &distance_kernel::Bindings { before: from.sampled(), after: to.storage(0) },
                &distance_kernel::Spec::default(),
                &distance_kernel::Params { axis, first_slice },
                [dims[0], dims[1], slices.min(dims[2] - first_slice)],
            )?;
            parts(rec, part(axis + 1, first_slice))?;
        }
        std::mem::swap(&mut from, &mut to);
    }
    // Rays only read it. Three swaps: what was written last is `from`, which is `distances`.
    rec.barrier(&[from.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
    Ok(())
}

/// The box of voxels, first and one past the last along each axis, around all blocks of distance 0; `None` where there is
/// no such block.
pub fn bounds(distances: &[u8], dims: [usize; 3]) -> Option<[[usize; 3]; 2]> {
    let [bx, by, _] = block_dims(dims);
    let mut found: Option<[[usize; 3]; 2]> = None;
    for (row, line) in distances.chunks_exact(bx).enumerate() {
        let Some(first) = line.iter().position(|&d| d == 0) else { continue };
        let last = line.iter().rposition(|&d| d == 0).unwrap_or(first);
        let (lo, hi) = ([first, row % by, row / by], [last + 1, row % by + 1, row / by + 1]);
        found = Some(found.map_or([lo, hi], |[a, b]| [std::array::from_fn(|i| a[i].min(lo[i])), std::array::from_fn(|i| b[i].max(hi[i]))]));
    }
    found.map(|[lo, hi]| [lo.map(|b| b * BLOCK), std::array::from_fn(|a| (hi[a] * BLOCK).min(dims[a]))])
}

/// The twin: distance of every block, x fastest, by the definitions: a block holds matter when one of the samples that
/// its taps can touch, or any value between two of them, has σ_t > 0; the distance is the smallest over all other blocks.
pub fn reference(volume: &Volume, table: &Table) -> Vec<u8> {
    let dims = volume.grid().dims();
    let n = block_dims(dims);
    let top = (TABLE_SIZE - 1) as f32;
    let encoding = Encoding::of(volume);
    let (scale, bias) = encoding.table_map(table.lo, table.hi);
    let holds = |block: [usize; 3]| {
        let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut error = 0f32;
        let around = |a: usize| (block[a] * BLOCK).saturating_sub(1)..(block[a] * BLOCK + BLOCK + 1).min(dims[a]);
        for z in around(2) {
            for y in around(1) {
                for x in around(0) {
                    let sample = encoding.sample_of(volume.value(x + dims[0] * (y + dims[1] * z)));
                    let u = sample * scale + bias;
                    error = error.max(4.8e-7 * ((sample * scale).abs() + bias.abs()));
                    (lo, hi) = (lo.min(u), hi.max(u));
                }
            }
        }
        if lo == hi {
            error = 0.0;
        }
        let first = (lo - error).floor().clamp(0.0, top) as usize;
        let last = (hi + error).ceil().clamp(0.0, top) as usize;
        table.sigma[first..=last].iter().any(|&s| s > 0.0)
    };
    let blocks = (0..n.iter().product()).map(|i: usize| [i % n[0], i / n[0] % n[1], i / n[0] / n[1]]);
    let occupied: Vec<[usize; 3]> = blocks.clone().filter(|&b| holds(b)).collect();
    let distance = |a: [usize; 3], b: [usize; 3]| (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0);
    blocks.map(|b| occupied.iter().map(|&o| distance(b, o)).min().unwrap_or(MAX_LEAP).min(MAX_LEAP) as u8).collect()
}
