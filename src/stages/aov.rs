//! aov: what lies behind a pixel besides its colour. With w = T·α of raymarch's steps: opacity Σw, and the w-weighted means
//! of distance, normal (against the gradient of σ_t), albedo, irradiance and visibility; the distance at which opacity
//! reaches [`FIRST`]. Of a surface: those of its one hit.

use super::isosurface::Shade;
use super::occupancy::Leap;
use super::raymarch::{Part, View};
use super::{MediumView, relight, twin};
use crate::error::Result;
use crate::kernels::aov as kernel;
use crate::scene::transfer::Table;
use crate::scene::{Grid, Volume};
use crate::vk::{Buffer, Image, Recorder};
use bytemuck::{Pod, Zeroable};

/// Opacity at which a ray has hit something.
pub const FIRST: f32 = 0.05;

/// Vec4s of a pixel's state.
pub const STATE: usize = 4;

/// Bytes of a pixel while it is gathered: its state and a surface's hit.
pub const BYTES: u64 = 16 * STATE as u64 + 4;

/// Pixels that are gathered together at most.
pub const MOST: u64 = 1 << 18;

/// The layers of a picture beside its colours, each with its channels as programs that read OpenEXR name them.
pub const LAYERS: [(&str, &[&str]); 6] = [
    ("depth", &["depth.Z", "depth.first"]),
    ("normal", &["normal.X", "normal.Y", "normal.Z"]),
    ("albedo", &["albedo.R", "albedo.G", "albedo.B"]),
    ("irradiance", &["irradiance.R", "irradiance.G", "irradiance.B"]),
    ("visibility", &["visibility.Y"]),
    ("opacity", &["opacity.Y"]),
];

/// The `Frame` buffer of the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Frame {
    voxel_to_world_normal: [[f32; 4]; 4],
    iso: f32,
    side: f32,
    light_scale: f32,
    unused: f32,
}

impl Frame {
    /// `surface`: iso as the volume's image returns it, and whether larger samples mean larger values.
    pub fn new(grid: &Grid, surface: Option<(f32, bool)>, light_scale: f32) -> Self {
        Self {
            voxel_to_world_normal: Shade::normal_matrix(grid),
            iso: surface.map_or(0.0, |s| s.0),
            side: if surface.is_none_or(|s| s.1) { 1.0 } else { -1.0 },
            light_scale,
            unused: 0.0,
        }
    }
}

/// What the kernel reads besides the medium.
pub struct Inputs<'a> {
    /// The irradiance volume.
    pub irradiance: &'a Image,
    /// Where it stands ([`relight::window`]).
    pub window: &'a Buffer,
    /// A [`Frame`].
    pub frame: &'a Buffer,
    /// Distances of a surface's hits, rows × width; any buffer for a medium.
    pub hits: &'a Buffer,
    /// Whether there is a surface.
    pub surface: bool,
    /// What rays leap by.
    pub leap: Leap<'a>,
}

/// Records one part. `state` ([`STATE`] vec4 a pixel) is read and written; the caller puts barriers on it.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, medium: &MediumView, inputs: &Inputs, view: &View, part: Part, state: &Buffer) -> Result<()> {
    let [bounds_x, bounds_y, bounds_z] = inputs.leap.packed();
    rec.dispatch(
        &kernel::Bindings {
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
            albedo: medium.albedo,
            irradiance: inputs.irradiance.sampled(),
            state,
            window: inputs.window,
            hits: inputs.hits,
            frame: inputs.frame,
            occupancy: inputs.leap.distances.sampled(),
        },
        &kernel::Spec {
            clips: medium.clips,
            surface: inputs.surface.into(),
            skip: inputs.leap.skip.into(),
            grey: (inputs.irradiance.format() == relight::format(true)).into(),
        },
        &kernel::Params {
            origin: view.origin,
            step_length: part.step_length as f32,
            corner: view.corner,
            map_scale: medium.map.0,
            du: view.du,
            map_bias: medium.map.1,
            dv: view.dv,
            width: part.width,
            metric_diagonal: view.metric_diagonal,
            first_row: part.first_row,
            metric_cross: view.metric_cross,
            rows: part.rows,
            first_step: part.first_step,
            step_count: part.step_count,
            bounds_x,
            bounds_y,
            bounds_z,
            per_unit: view.per_unit,
        },
        [part.width, part.rows, 1],
    )
}

/// What lies behind a pixel; means are weighted by what each place adds to the pixel's opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behind {
    /// Distance from the eye at which opacity reaches [`FIRST`], or of the surface, world units; infinite where there is none.
    pub first: f32,
    /// Mean distance, world units; infinite where there is nothing.
    pub depth: f32,
    /// Mean normal brought to length 1, world; zero where there is none.
    pub normal: [f32; 3],
    /// Mean linear albedo.
    pub albedo: [f32; 3],
    /// Mean radiance scattered at albedo 1.
    pub irradiance: [f32; 3],
    /// Mean visibility, 0..1.
    pub visibility: f32,
    /// Opacity, 0..1.
    pub opacity: f32,
}

impl Behind {
    /// The number of a channel of a layer, by their places in [`LAYERS`].
    pub fn channel(&self, layer: usize, channel: usize) -> f32 {
        let of = |v: &[f32; 3]| v.get(channel).copied().unwrap_or(0.0);
        match (layer, channel) {
            (0, 0) => self.depth,
            (0, _) => self.first,
            (1, _) => of(&self.normal),
            (2, _) => of(&self.albedo),
            (3, _) => of(&self.irradiance),
            (4, _) => self.visibility,
            _ => self.opacity,
        }
    }

    /// From the kernel's sums.
    pub fn of(state: &[[f32; 4]; STATE]) -> Self {
        let [a, b, c, e] = state;
        let w = e[1];
        let mean = |x: f32| if w > 0.0 { x / w } else { 0.0 };
        let length = a[..3].iter().map(|x| x * x).sum::<f32>().sqrt();
        let some = |x: f32, there: bool| if there { x } else { f32::INFINITY };
        Self {
            first: some(b[3], b[3] >= 0.0),
            depth: some(mean(a[3]), w > 0.0),
            normal: [0, 1, 2].map(|i| if length > 0.0 { a[i] / length } else { 0.0 }),
            albedo: [0, 1, 2].map(|i| mean(b[i])),
            irradiance: [0, 1, 2].map(|i| mean(c[i])),
            // A fitted field swings beyond either end.
            visibility: mean(c[3]).clamp(0.0, 1.0),
            opacity: w.clamp(0.0, 1.0),
        }
    }
}

/// The twin for a medium. `irradiance(p)` is (S/ϖ, mean visibility) at voxel coordinates p.
pub fn reference(
    volume: &Volume,
    table: &Table,
    view: &View,
    pixel: [usize; 2],
    step_length: f64,
    irradiance: impl Fn([f32; 3]) -> [f32; 4],
    clip: &[[f32; 4]],
) -> Behind {
    let dims = volume.grid().dims();
    let normals = volume.grid().voxel_to_world().matrix3.inverse().transpose();
    let step = step_length as f32;
    let d = view.direction(pixel[0], pixel[1]);
    let (enter, leave) = twin::clip_span(clip, view.origin, d, twin::box_span(view.origin, d, dims));
    let begin = enter.max(0.0);
    let total = (leave - begin).max(0.0);
    let mut sums = [[0f32; 4]; STATE];
    sums[1][3] = -1.0;
    let mut depth = 0f32;
    for i in 0..(total / step).ceil() as u32 {
        let transmittance = (-depth).exp();
        if transmittance <= 1e-3 {
            break;
        }
        let t = i as f32 * step;
        let ds = step.min(total - t);
        let p = twin::along(view.origin, d, begin + t + 0.5 * ds);
        let value = twin::sample(volume, p);
        let sigma = twin::extinction(table, value);
        if sigma <= 0.0 {
            continue;
        }
        let w = transmittance * -(-sigma * ds).exp_m1();
        let sigma_at = |a: usize, by: f32| {
            let mut q = p;
            q[a] += by;
            f64::from(twin::extinction(table, twin::sample(volume, q)))
        };
        let (after, before) = ([0, 1, 2].map(|a| sigma_at(a, 1.0)), [0, 1, 2].map(|a| sigma_at(a, -1.0)));
        let gradient = glam::DVec3::from_array([0, 1, 2].map(|a| after[a] - before[a]));
        let flat = gradient.abs().element_sum() <= 1e-5 * (after.iter().sum::<f64>() + before.iter().sum::<f64>());
        let normal = if flat { glam::DVec3::ZERO } else { -(normals * gradient).normalize_or_zero() };
        let (albedo, light) = (twin::albedo(table, value), irradiance(p));
        for c in 0..3 {
            sums[0][c] += w * normal[c] as f32;
            sums[1][c] += w * albedo[c];
            sums[2][c] += w * light[c].max(0.0);
        }
        sums[0][3] += w * (begin + t + 0.5 * ds);
        sums[2][3] += w * light[3];
        sums[3][1] += w;
        let needed = -(1.0 - FIRST).ln();
        if sums[1][3] < 0.0 && depth + sigma * ds >= needed {
            sums[1][3] = begin + t + (needed - depth) / sigma;
        }
        depth += sigma * ds;
    }
    Behind::of(&sums)
}
