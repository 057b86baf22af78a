//! relight: field × light → irradiance volume. S/ϖ = (1/4π) Σ_lm v_lm L_lm per colour channel: radiance scattered by an
//! isotropic medium of albedo 1. Both the dot product and interpolation are linear, so folding the light in first and
//! filtering afterwards is exact. Alpha holds the mean visibility v₀₀/(2√π).

use super::bricks::Bricks;
use super::pack::{self, Packed};
use super::{Parts, dims_u32, slab};
use crate::error::Result;
use crate::kernels::relight as kernel;
use crate::vk::{Access, Buffer, Format, Image, Recorder};

/// Cells per dispatch.
const CELLS: u64 = 1 << 20;

/// The irradiance's format: a light that is the same in all channels needs one, beside the mean visibility.
pub fn format(grey: bool) -> Format {
    if grey { Format::Rg16Sfloat } else { Format::Rgba16Sfloat }
}

/// Texels of the irradiance along x, y, z: the box around all bricks that are held. Bricks of its own would cost renderers
/// a look-up for every sample and a border a brick; 4³ cells and a border are 6³.
pub fn dims(bricks: &Bricks) -> [u32; 3] {
    let [lo, hi] = bricks.window();
    std::array::from_fn(|a| (hi[a] - lo[a]) as u32)
}

/// What brings normalised coordinates of the volume to those of the irradiance: scale and shift along x, y, z. Exactly 1
/// and 0 where the box is the whole field.
pub fn window(field_dims: [usize; 3], bricks: &Bricks) -> [[f32; 4]; 2] {
    let [lo, hi] = bricks.window();
    let mut window = [[0f32; 4]; 2];
    for a in 0..3 {
        let n = (hi[a] - lo[a]) as f64;
        window[0][a] = (field_dims[a] as f64 / n) as f32;
        window[1][a] = (-(lo[a] as f64) / n) as f32;
    }
    window
}

/// Records the irradiance ([`format`], [`dims`]) of a field of `field_dims` cells and `bands` bands; its images must be
/// readable, `light` holds 16 vec4. `irradiance` must be ready for stores and is left as just written.
///
/// # Errors
/// What the recorder refuses.
pub fn record(
    rec: &mut Recorder,
    packed: &Packed,
    (field_dims, bricks): ([usize; 3], &Bricks),
    light: &Buffer,
    irradiance: &Image,
    bands: u32,
    parts: &mut Parts,
) -> Result<()> {
    let (images, view) = (packed.images, pack::formats(bands, packed.bits).1);
    let [corner_x, corner_y, corner_z] = dims_u32(bricks.window()[0]);
    let dims = irradiance.dims();
    let slices = slab(dims, CELLS);
    for first_slice in (0..dims[2]).step_by(slices as usize) {
        if first_slice > 0 {
            // Slabs do not overlap; levels are tracked whole.
            rec.barrier(&[irradiance.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
        }
        rec.dispatch(
            &kernel::Bindings {
                field0: images[0].sampled_as(view),
                field1: images[1].sampled_as(view),
                field2: images[2].sampled_as(view),
                field3: images[3].sampled_as(view),
                light,
                irradiance: irradiance.storage(0),
                bricks: packed.directory.sampled().as_nearest(),
            },
            &kernel::Spec { bands, bits: packed.bits, wide: packed.wide, grey: (irradiance.format() == format(true)).into() },
            &kernel::Params { field_dims: dims_u32(field_dims), first_slice, corner_x, corner_y, corner_z },
            [dims[0], dims[1], slices.min(dims[2] - first_slice)],
        )?;
        parts(rec, f64::from((first_slice + slices).min(dims[2])) / f64::from(dims[2]))?;
    }
    Ok(())
}

/// The twin: (S/ϖ, mean visibility) of one cell from its coefficients and the light's.
pub fn reference(v: &[f32; 16], light: &[[f32; 3]; 16]) -> [f32; 4] {
    let mut sum = [0f32; 3];
    for (v, l) in v.iter().zip(light) {
        for c in 0..3 {
            sum[c] += v * l[c];
        }
    }
    let s = sum.map(|s| s / (4.0 * std::f32::consts::PI));
    [s[0], s[1], s[2], v[0] / (2.0 * std::f32::consts::PI.sqrt())]
}
