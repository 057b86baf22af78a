//! pack: sums of V·Y_lm → the four packed images of the field.
//!
//! v₀₀ ∈ [0, 2√π] and |v_lm| ≤ ½∫|Y_lm|dω = R_lm: each coefficient is quantised over exactly its own range. For l > 0
//! code 2^(bits−1) is zero and codes 2^(bits−1) ± (2^(bits−1) − 1) are ±R_lm, so that an empty neighbourhood stays
//! exactly uncoloured. 32 bits keep the float. A fitted field ([`super::fit`]) goes beyond what can be seen from any point:
//! its ranges are twice as wide, [−√π, 3√π] for v₀₀ with zero at code 2^(bits−2).

use super::dims_u32;
use super::estimate::Run;
use crate::error::Result;
use crate::kernels::constants::PACK_RANGE;
use crate::kernels::pack as kernel;
use crate::vk::{Format, Image, Recorder};

/// Images of a field: coefficients 4g..4g+3 lie in image g.
pub const GROUPS: usize = 4;

/// Groups that `bands` fill: 1, 1, 3 or 4.
pub fn groups(bands: u32) -> usize {
    ((bands * bands) as usize).div_ceil(4)
}

/// (format that `pack` stores, format that reads as 0..1 or float) of a field image. A single coefficient has an image
/// of a single component.
pub fn formats(bands: u32, bits: u32) -> (Format, Format) {
    match (bits, bands) {
        (8, 1) => (Format::R8Uint, Format::R8Unorm),
        (8, _) => (Format::R32Uint, Format::Rgba8Unorm),
        (16, 1) => (Format::R16Uint, Format::R16Unorm),
        (16, _) => (Format::Rg32Uint, Format::Rgba16Unorm),
        (_, 1) => (Format::R32Uint, Format::R32Sfloat),
        _ => (Format::Rgba32Uint, Format::Rgba32Sfloat),
    }
}

/// Where coefficients are packed to.
pub struct Packed<'a> {
    /// Images of the groups, of [`Bricks`](super::bricks::Bricks).
    pub images: [&'a Image; GROUPS],
    /// The directory of the bricks.
    pub directory: &'a Image,
    /// Bits a coefficient.
    pub bits: u32,
    /// Whether ranges are twice as wide.
    pub wide: bool,
}

/// Records the packing of `run`'s cells, each sum times `weight` (4π/N for sums of V·Y over N directions); sums must be
/// readable, the images ready for stores. Cells of bricks that are not held are left out.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, run: &Run, weight: f32, packed: &Packed) -> Result<()> {
    let images = packed.images;
    rec.dispatch(
        &kernel::Bindings {
            cells: run.cells,
            sums: run.sums,
            field0: images[0].storage(0),
            field1: images[1].storage(0),
            field2: images[2].storage(0),
            field3: images[3].storage(0),
            bricks: packed.directory.sampled().as_nearest(),
        },
        &kernel::Spec { bands: run.bands, bits: packed.bits, wide: packed.wide },
        &kernel::Params { field_dims: dims_u32(run.field_dims), cell_count: run.cell_count, capacity: run.capacity, weight },
        [run.cell_count, 1, 1],
    )
}

/// The twin: codes of 16 coefficients (at 32 bits: their bit patterns). Coefficients beyond `bands`² count as 0. `wide`: of a
/// fitted field.
pub fn reference(v: &[f32; 16], bands: u32, bits: u32, wide: bool) -> [u32; 16] {
    std::array::from_fn(|i| {
        let x = if i < (bands * bands) as usize && !v[i].is_nan() { v[i] } else { 0.0 };
        if bits == 32 {
            return x.to_bits();
        }
        let top = ((1u64 << bits) - 1) as f32;
        let zero = (1u64 << (bits - 1)) as f32;
        let part = x / PACK_RANGE[i];
        let code = match (i, wide) {
            (0, false) => (part * top).round_ties_even().clamp(0.0, top),
            (0, true) => ((part * (zero - 1.0)).round_ties_even() + zero / 2.0).clamp(0.0, top),
            _ => (part * (zero - 1.0) * if wide { 0.5 } else { 1.0 }).round_ties_even().clamp(1.0 - zero, zero - 1.0) + zero,
        };
        code as u32
    })
}

/// The coefficients that 16 codes stand for; `wide`: in a fitted field.
pub fn decode(codes: &[u32; 16], bits: u32, wide: bool) -> [f32; 16] {
    std::array::from_fn(|i| coefficient(i, codes[i], bits, wide))
}

/// Coefficient i from its code.
#[inline(always)]
fn coefficient(i: usize, code: u32, bits: u32, wide: bool) -> f32 {
    if bits == 32 {
        return f32::from_bits(code);
    }
    let top = ((1u64 << bits) - 1) as f32;
    let zero = (1u64 << (bits - 1)) as f32;
    let code = code as f32;
    match (i, wide) {
        (0, false) => code / top * PACK_RANGE[0],
        (0, true) => (code - zero / 2.0) / (zero - 1.0) * PACK_RANGE[0],
        _ => (code - zero) / (zero - 1.0) * PACK_RANGE[i] * if wide { 2.0 } else { 1.0 },
    }
}

/// Coefficients 4g.. of some cells from their texels in field image g, as the kernel stored them. `out` has `bands`² for each
/// cell, of which the others stay.
pub fn unpack(texels: &[u8], g: usize, (bands, bits, wide): (u32, u32, bool), out: &mut [f32]) {
    let (codes, kept) = (if bands == 1 { 1 } else { 4 }, (bands * bands) as usize);
    // Compiled once for each size of a code.
    match bits {
        8 => unpack_as::<1>(texels, codes, g, wide, kept, out),
        16 => unpack_as::<2>(texels, codes, g, wide, kept, out),
        _ => unpack_as::<4>(texels, codes, g, wide, kept, out),
    }
}

fn unpack_as<const N: usize>(texels: &[u8], codes: usize, g: usize, wide: bool, kept: usize, out: &mut [f32]) {
    for (texel, out) in texels.chunks_exact(N * codes).zip(out.chunks_exact_mut(kept)) {
        for (i, (b, out)) in texel.as_chunks::<N>().0.iter().zip(&mut out[4 * g..]).enumerate() {
            let code = b.iter().rev().fold(0, |n, &byte| n << 8 | u32::from(byte));
            *out = coefficient(4 * g + i, code, 8 * N as u32, wide);
        }
    }
}
