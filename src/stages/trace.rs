//! trace: the reference renderer. L = ∫ T σ_t S dt with S = ϖ/(4π) ∫ V L_i dω, or a surface's ϖ/π ∫ V L_i max(0, n·ω) dω,
//! by Monte Carlo in the medium itself: no field, no harmonics, for a medium no step either (delta and ratio tracking,
//! Woodcock 1965, Novák et al. 2014, in cells of known majorant). `reference()` is its twin, number by number.

use super::majorant::{self, CELL};
use super::raymarch::View;
use super::{MediumView, isosurface, twin};
use crate::error::Result;
use crate::kernels::trace as kernel;
use crate::scene::sky::{Sky, Tables};
use crate::scene::transfer::Table;
use crate::scene::{Grid, Shading, Volume};
use crate::vk::{Buffer, Image, Recorder};
use bytemuck::{Pod, Zeroable};

/// Samples of a block, whose sky directions are stratified 4×4; standard errors are of block means.
pub const BLOCK: u32 = 16;

/// Vec4s of a pixel's state: the block so far, the mean of blocks, their sum of squared deviations (and, above 0 in its
/// fourth, the sign of an invocation cut short).
pub const STATE: usize = 3;

/// Step of a surface's shadow rays, voxels.
pub const SHADOW_STEP: f64 = 0.25;

/// The `Setting` buffer of the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Setting {
    sky_to_voxel: [[f32; 4]; 4],
    voxel_to_world_normal: [[f32; 4]; 4],
    world_to_sky: [[f32; 4]; 4],
    surface_albedo: [f32; 4],
    sky_size: [u32; 4],
    iso: f32,
    side: f32,
    shadow_step: f32,
    scale: f32,
    unused: [f32; 4],
}

/// A surface in place of the medium.
#[derive(Clone, Copy, Debug)]
pub struct Opaque {
    /// Iso as the volume's image returns it.
    pub iso: f32,
    /// Whether larger image samples mean larger values.
    pub rising: bool,
    /// Linear RGB.
    pub albedo: [f32; 3],
    /// How it reflects.
    pub shading: Shading,
}

impl Setting {
    /// Folds light and grid.
    pub fn new(grid: &Grid, sky: &Sky, surface: Option<&Opaque>) -> Self {
        let columns = |m: glam::DMat3| {
            let c = |v: glam::DVec3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
            [c(m.x_axis), c(m.y_axis), c(m.z_axis), [0.0, 0.0, 0.0, 1.0]]
        };
        let [r, g, b] = surface.map_or([0.0; 3], |s| s.albedo);
        let probe = &sky.tables().probe;
        Self {
            sky_to_voxel: columns(grid.world_to_voxel().matrix3 * sky.rotation()),
            voxel_to_world_normal: isosurface::Shade::normal_matrix(grid),
            world_to_sky: columns(sky.rotation().transpose()),
            surface_albedo: [r, g, b, 1.0],
            sky_size: [probe.width() as u32, probe.height() as u32, 0, 0],
            iso: surface.map_or(0.0, |s| s.iso),
            side: if surface.is_none_or(|s| s.rising) { 1.0 } else { -1.0 },
            shadow_step: (SHADOW_STEP * grid.voxel_length()) as f32,
            scale: sky.scale() as f32,
            unused: [0.0; 4],
        }
    }
}

/// What the kernel reads besides the medium.
pub struct Inputs<'a> {
    /// See [`majorant`].
    pub majorants: &'a Image,
    /// [`Tables::cumulative`].
    pub cumulative: &'a Buffer,
    /// [`Tables::weights`].
    pub weights: &'a Buffer,
    /// A [`Setting`].
    pub setting: &'a Buffer,
    /// How the surface reflects that `setting` describes; none for the medium.
    pub surface: Option<Shading>,
}

/// Which samples of which pixels a dispatch adds.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Pixels per row.
    pub width: u32,
    /// First row of the state.
    pub band_row: u32,
    /// First row.
    pub first_row: u32,
    /// Rows.
    pub rows: u32,
    /// First sample; 0 begins new sums.
    pub first_sample: u32,
    /// Samples.
    pub sample_count: u32,
    /// Iterations that an invocation may make.
    pub most_events: u32,
    /// Another is another picture: the draws' count starts elsewhere.
    pub seed: u32,
}

/// Records one part. `state` ([`STATE`] vec4 a pixel) is read and written; the caller puts barriers on it.
///
/// # Errors
/// What the recorder refuses.
pub fn record(
    rec: &mut Recorder,
    medium: &MediumView,
    inputs: &Inputs,
    view: &View,
    part: Part,
    step_length: f64,
    state: &Buffer,
) -> Result<()> {
    let matter = match inputs.surface {
        None => 0,
        Some(Shading::Isotropic) => 1,
        Some(Shading::Lambert) => 2,
    };
    rec.dispatch(
        &kernel::Bindings {
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
            albedo: medium.albedo,
            majorants: inputs.majorants.sampled().as_nearest(),
            cumulative: inputs.cumulative,
            sky: inputs.weights,
            setting: inputs.setting,
            state,
        },
        &kernel::Spec { cell: CELL, matter, clips: medium.clips },
        &kernel::Params {
            origin: view.origin,
            step_length: step_length as f32,
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
            band_row: part.band_row,
            first_sample: part.first_sample,
            sample_count: part.sample_count,
            most_events: part.most_events,
            seed: part.seed,
            per_unit: view.per_unit,
        },
        [part.width, part.rows, 1],
    )
}

/// What the twin renders.
pub struct Twin<'a> {
    /// Scalars.
    pub volume: &'a Volume,
    /// Matter.
    pub table: &'a Table,
    /// Twin majorants of that matter.
    pub majorants: &'a [f32],
    /// Light.
    pub sky: &'a Sky,
    /// Camera.
    pub view: &'a View,
    /// Pixels per row.
    pub width: usize,
    /// As the kernel's.
    pub seed: u32,
    /// Iso value (rising), albedo, shading and step [world units] of a surface.
    pub surface: Option<(f32, [f32; 3], Shading, f64)>,
}

/// The twin's draws.
struct Draws([u32; 3]);

impl Draws {
    fn draw(&mut self) -> [f32; 2] {
        let [mut x, mut y, mut z] = self.0.map(|v| v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        self.0[2] = self.0[2].wrapping_add(1);
        for round in 0..2 {
            x = x.wrapping_add(y.wrapping_mul(z));
            y = y.wrapping_add(z.wrapping_mul(x));
            z = z.wrapping_add(x.wrapping_mul(y));
            if round == 0 {
                (x, y, z) = (x ^ x >> 16, y ^ y >> 16, z ^ z >> 16);
            }
        }
        [x, y].map(|v| (v >> 8) as f32 / 16_777_216.0)
    }

    fn roulette(&mut self, t: f32) -> f32 {
        match t {
            t if t >= 0.1 => t,
            t if self.draw()[0] * 0.1 < t => 0.1,
            _ => 0.0,
        }
    }
}

/// The twin: RGB and opacity of one sample of one pixel.
pub fn reference(scene: &Twin, pixel: [usize; 2], sample: u32) -> [f32; 4] {
    let dims = scene.volume.grid().dims();
    let d = scene.view.direction(pixel[0], pixel[1]);
    let (enter, leave) = twin::box_span(scene.view.origin, d, dims);
    let enter = enter.max(0.0);
    let mut draws = Draws([(pixel[1] * scene.width + pixel[0]) as u32, sample, scene.seed.wrapping_mul(0x9E37_79B9)]);
    if leave <= enter {
        return [0.0; 4];
    }
    let jitter = draws.draw();
    let stratum = [sample % 4, sample % BLOCK / 4];
    let u = std::array::from_fn(|i| ((stratum[i] as f32 + jitter[i]) / 4.0).min(0.999_999_94));
    let (toward, weight) = sample_sky(scene.sky.tables(), u);
    let grid = scene.volume.grid();
    let world = scene.sky.rotation() * toward;
    let w = safe((grid.world_to_voxel().matrix3 * world).to_array().map(|v| v as f32));
    let scale = scene.sky.scale() as f32;
    let Some((iso, albedo, shading, step)) = scene.surface else {
        let (mut sum, mut place, mut through) = (0f32, 0f32, 1f32);
        track(scene, scene.view.origin, d, [enter, leave], &mut draws, 8.0 / (leave - enter), |draws, t, share, pick| {
            let part = through * share;
            sum += part;
            if pick * sum < part {
                place = t;
            }
            through = draws.roulette(through - part);
            through > 0.0
        });
        let p = twin::along(scene.view.origin, d, place);
        let mut seen = 1f32;
        if sum > 0.0 {
            let end = twin::box_span(p, w, dims).1;
            track(scene, p, w, [0.0, end], &mut draws, 0.0, |draws, _, share, _| {
                seen = draws.roulette(seen * (1.0 - share));
                seen > 0.0
            });
        }
        let a = twin::albedo(scene.table, twin::sample(scene.volume, p));
        let [r, g, b] = std::array::from_fn(|c| sum * seen * a[c] * weight[c] * scale);
        return [r, g, b, if through > 0.5 { sum } else { 1.0 - through }];
    };
    let Some(hit) = isosurface::reference_hit(scene.volume, iso, scene.view, pixel, step) else { return [0.0; 4] };
    // Flat data and cut faces are left to formula tests.
    let Some(normal) = hit.normal.map(glam::DVec3::from) else { return [f32::NAN; 4] };
    let lobe = if shading == Shading::Lambert { 4.0 * normal.dot(world).max(0.0) as f32 } else { 1.0 };
    // Between the last vacuum and the first matter, eight halvings closer.
    let half = (step / 8192.0) as f32;
    let (mut vacuum, mut matter) = (hit.distance - half, hit.distance + half);
    for _ in 0..8 {
        let middle = 0.5 * (vacuum + matter);
        let inside = twin::sample(scene.volume, twin::along(scene.view.origin, d, middle)) >= iso;
        *(if inside { &mut matter } else { &mut vacuum }) = middle;
    }
    let p = twin::along(scene.view.origin, d, vacuum);
    let shadow_step = (SHADOW_STEP * grid.voxel_length()) as f32;
    let (begin, end) = twin::box_span(p, w, dims);
    let mut lit = lobe;
    if lobe > 0.0 && end > begin.max(0.0) {
        let mut t = begin.max(0.0) + draws.draw()[0] * shadow_step;
        while t < end && lit > 0.0 {
            if twin::sample(scene.volume, twin::along(p, w, t)) >= iso {
                lit = 0.0;
            }
            t += shadow_step;
        }
    }
    let [r, g, b] = std::array::from_fn(|c| lit * albedo[c] * weight[c] * scale);
    [r, g, b, 1.0]
}

/// Tentative collisions along a ray: `met(draws, t, σ_t/majorant, pick)` until it says no; majorants above 0 are `least`
/// at least. Cell by cell, the cell found
/// anew each time from the ray's place.
fn track(
    scene: &Twin,
    p: [f32; 3],
    d: [f32; 3],
    span: [f32; 2],
    draws: &mut Draws,
    least: f32,
    mut met: impl FnMut(&mut Draws, f32, f32, f32) -> bool,
) {
    let cells = majorant::cells(scene.volume.grid().dims()).map(|c| c as usize);
    let edge = CELL as f32;
    let mut at: [i64; 3] = std::array::from_fn(|a| ((p[a] + d[a] * span[0]) / edge).floor().clamp(0.0, cells[a] as f32 - 1.0) as i64);
    let mut t = span[0];
    let mut depth = -(1.0 - draws.draw()[0]).ln();
    loop {
        let bound = scene.majorants[at[0] as usize + cells[0] * (at[1] as usize + cells[1] * at[2] as usize)];
        let bound = if bound > 0.0 { bound.max(least) } else { 0.0 };
        let wall: [f32; 3] = std::array::from_fn(|a| ((at[a] + i64::from(d[a] > 0.0)) as f32 * edge - p[a]) / d[a]);
        let boundary = wall.iter().fold(span[1], |m, &w| m.min(w));
        let ahead = bound * (boundary - t);
        if ahead > depth {
            t += depth / bound;
            let u = draws.draw();
            depth = -(1.0 - u[0]).ln();
            let share = (twin::extinction(scene.table, twin::sample(scene.volume, twin::along(p, d, t))) / bound).min(1.0);
            if !met(draws, t, share, u[1]) {
                return;
            }
            continue;
        }
        depth -= ahead.max(0.0);
        t = boundary;
        if boundary >= span[1] {
            return;
        }
        for a in 0..3 {
            if wall[a] <= boundary {
                at[a] += if d[a] > 0.0 { 1 } else { -1 };
            }
            if at[a] < 0 || at[a] >= cells[a] as i64 {
                return;
            }
        }
    }
}

/// A direction of the unturned sky, and its weight.
fn sample_sky(tables: &Tables, u: [f32; 2]) -> (glam::DVec3, [f32; 3]) {
    let (width, height) = (tables.probe.width(), tables.probe.height());
    let invert = |of: &[f32], u: f32| {
        let i = of.partition_point(|&c| c <= u).min(of.len() - 1);
        let below = if i > 0 { of[i - 1] } else { 0.0 };
        (i, f64::from(((u - below) / (of[i] - below)).clamp(0.0, 1.0)))
    };
    let (row, v) = invert(&tables.cumulative[..height], u[0]);
    let (column, h) = invert(&tables.cumulative[height + row * width..height + (row + 1) * width], u[1]);
    let edge = |j: usize| (std::f64::consts::PI * j as f64 / height as f64).cos();
    let z = edge(row) + (edge(row + 1) - edge(row)) * v;
    let (s, c) = (2.0 * std::f64::consts::PI * (column as f64 + h) / width as f64).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    let [x, y, w, _] = tables.weights[row * width + column];
    (glam::DVec3::new(r * s, r * c, z), [x, y, w])
}

/// No component 0 beside the largest, as `safe_direction`.
fn safe(d: [f32; 3]) -> [f32; 3] {
    let least = 1e-7 * d.iter().fold(0f32, |m, x| m.max(x.abs()));
    d.map(|x| if x.abs() < least { least } else { x })
}
