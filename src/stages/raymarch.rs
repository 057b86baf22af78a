//! raymarch: direct volume rendering. L = Σ T α S front to back, α = 1 − exp(−σ_t Δs) for any step Δs (midpoint rule,
//! classification after interpolation), S = ϖ · irradiance; a ray ends when T ≤ 10⁻³; its depth, if something is laid behind
//! the picture, where coverage rounds to 1.

use super::occupancy::Leap;
use super::{MediumView, relight, twin};
use crate::error::Result;
use crate::kernels::raymarch as kernel;
use crate::scene::transfer::Table;
use crate::scene::{Grid, Volume, camera::Rays};
use crate::vk::{Buffer, Image, Recorder};

/// The camera's rays in voxel space, single precision as the kernels take them. The ray through pixel (i, j), row 0 on
/// top, runs along corner + i·du + j·dv. Lengths are in [`Grid::unit`]s here, so that no square leaves single precision.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The eye, voxel coordinates.
    pub origin: [f32; 3],
    /// Direction through the centre of the upper left pixel.
    pub corner: [f32; 3],
    /// Change of direction per pixel to the right.
    pub du: [f32; 3],
    /// Change of direction per row down.
    pub dv: [f32; 3],
    /// xx, yy, zz of the grid's metric.
    pub metric_diagonal: [f32; 3],
    /// xy, xz, yz of the grid's metric.
    pub metric_cross: [f32; 3],
    /// Units per world unit.
    pub per_unit: f32,
}

impl View {
    /// The rays of a camera over `grid`.
    pub fn new(grid: &Grid, rays: &Rays) -> Self {
        let unit = grid.unit();
        let g = grid.metric() * (1.0 / (unit * unit));
        Self {
            origin: rays.origin_voxel.map(|v| v as f32),
            corner: rays.corner.map(|v| (v * unit) as f32),
            du: rays.du.map(|v| (v * unit) as f32),
            dv: rays.dv.map(|v| (v * unit) as f32),
            metric_diagonal: [g.x_axis.x as f32, g.y_axis.y as f32, g.z_axis.z as f32],
            metric_cross: [g.x_axis.y as f32, g.x_axis.z as f32, g.y_axis.z as f32],
            per_unit: (1.0 / unit) as f32,
        }
    }

    /// The twin of `pixel_direction` in `view.glsl`.
    pub fn direction(&self, i: usize, j: usize) -> [f32; 3] {
        let (u, v) = (i as f32, j as f32);
        let d: [f32; 3] = std::array::from_fn(|a| self.corner[a] + u * self.du[a] + v * self.dv[a]);
        let mut length2 =
            2.0 * (self.metric_cross[0] * d[0] * d[1] + self.metric_cross[1] * d[0] * d[2] + self.metric_cross[2] * d[1] * d[2]);
        for (g, d) in self.metric_diagonal.iter().zip(d) {
            length2 += g * d * d;
        }
        let d = d.map(|x| x / length2.sqrt() * self.per_unit);
        let least = 1e-7 * d.iter().fold(0f32, |m, x| m.max(x.abs()));
        d.map(|x| if x.abs() < least { least } else { x })
    }
}

/// Which part of a picture a dispatch renders: some rows, and of each ray some steps.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Pixels per row.
    pub width: u32,
    /// First row.
    pub first_row: u32,
    /// Rows.
    pub rows: u32,
    /// First step of each ray; 0 begins new pixels.
    pub first_step: u32,
    /// Steps at most.
    pub step_count: u32,
    /// World length of a step.
    pub step_length: f64,
    /// Whether something is laid behind a medium's picture: its coverage is followed further than its light.
    pub backed: bool,
}

/// Records one part. `irradiance` is the volume, where it stands ([`relight::window`]), and the radiance that its unit
/// stands for; `state` (rows × width vec4: radiance and optical depth) is read and written, the caller puts
/// barriers on it.
///
/// # Errors
/// What the recorder refuses.
pub fn record(
    rec: &mut Recorder,
    medium: &MediumView,
    irradiance: (&Image, &Buffer, f32),
    view: &View,
    part: Part,
    leap: Leap,
    state: &Buffer,
) -> Result<()> {
    let (irradiance, window, light_scale) = irradiance;
    let [bounds_x, bounds_y, bounds_z] = leap.packed();
    rec.dispatch(
        &kernel::Bindings {
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
            albedo: medium.albedo,
            irradiance: irradiance.sampled(),
            state,
            occupancy: leap.distances.sampled(),
            window,
        },
        &kernel::Spec {
            skip: leap.skip.into(),
            tinted: medium.flat_albedo.is_some().into(),
            grey: (irradiance.format() == relight::format(true)).into(),
            clips: medium.clips,
            backed: part.backed.into(),
            ..kernel::Spec::default()
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
            tint: medium.flat_albedo.unwrap_or([1.0; 3]).map(|a| a * light_scale),
            bounds_x,
            bounds_y,
            bounds_z,
            first_step: part.first_step,
            step_count: part.step_count,
        },
        [part.width, part.rows, 1],
    )
}

/// The twin: radiance and optical depth of one pixel of a picture that nothing is laid behind. `irradiance(p)` is S/ϖ at voxel coordinates p.
pub fn reference(
    volume: &Volume,
    table: &Table,
    view: &View,
    pixel: [usize; 2],
    step_length: f64,
    irradiance: impl Fn([f32; 3]) -> [f32; 3],
) -> [f32; 4] {
    reference_clipped(volume, table, view, pixel, step_length, irradiance, &[])
}

/// The twin under clip planes.
pub fn reference_clipped(
    volume: &Volume,
    table: &Table,
    view: &View,
    pixel: [usize; 2],
    step_length: f64,
    irradiance: impl Fn([f32; 3]) -> [f32; 3],
    clip: &[[f32; 4]],
) -> [f32; 4] {
    let dims = volume.grid().dims();
    let step = step_length as f32;
    let d = view.direction(pixel[0], pixel[1]);
    let (enter, leave) = twin::clip_span(clip, view.origin, d, twin::box_span(view.origin, d, dims));
    let begin = enter.max(0.0);
    let total = leave - begin;
    let mut out = [0.0; 4];
    let mut transmittance = 1f32;
    if total <= 0.0 {
        return out;
    }
    for i in 0..(total / step).ceil() as u32 {
        if transmittance <= 1e-3 {
            break;
        }
        let t = i as f32 * step;
        let ds = step.min(total - t);
        let p = twin::along(view.origin, d, begin + t + 0.5 * ds);
        let value = twin::sample(volume, p);
        let sigma = twin::extinction(table, value);
        if sigma > 0.0 {
            let alpha = -(-sigma * ds).exp_m1();
            let (albedo, light) = (twin::albedo(table, value), irradiance(p));
            for c in 0..3 {
                out[c] += transmittance * alpha * albedo[c] * light[c].max(0.0);
            }
            out[3] += sigma * ds;
            transmittance = (-out[3]).exp();
        }
    }
    out
}
