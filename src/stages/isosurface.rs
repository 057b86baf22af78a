//! isosurface: direct isosurface rendering. The first t with D(t) ≥ iso by marching and then bisection; shaded once, in
//! the paper's isotropic form ϖ/(4π)·∫V L dω, or as Lambert ϖ/π·∫V L max(0, n·ω) dω with the gradient normal through the
//! SH product: Σ_k H_k(n) Σ_ij G_ijk v_i L_j with the clamped cosine's bands 0, 1, 2, 4, 6 (exact for V and L of four
//! bands). The field is interpolated among cells in vacuum only: one inside the surface sees nothing.

use super::occupancy::Leap;
use super::pack::{self, Packed};
use super::raymarch::{Part, View};
use super::twin;
use crate::error::Result;
use crate::kernels::isosurface as kernel;
use crate::scene::{Grid, Light, Shading, Volume, sh};
use crate::vk::{Buffer, Image, Recorder};
use bytemuck::{Pod, Zeroable};

/// Most clip planes that the kernel takes: those of a scene, and the faces of its box.
pub const MAX_CLIPS: usize = 16;

/// The `View` buffer of the kernel.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct Shade {
    /// Direction of a gradient in voxel space → world space, columns of four.
    pub voxel_to_world_normal: [[f32; 4]; 4],
    /// Linear RGB.
    pub albedo: [f32; 4],
    /// Cells of the field.
    pub field_dims: [f32; 4],
    /// Rows of 16 RGB(0); see the kernel.
    pub product: [[[f32; 4]; 16]; 31],
    /// Clip planes, voxel space.
    pub clip_planes: [[f32; 4]; MAX_CLIPS],
}

impl Shade {
    /// Folds light, albedo and shading.
    pub fn new(grid: &Grid, field_dims: [usize; 3], albedo: [f32; 3], light: &Light, shading: Shading) -> Self {
        let mut product = [[[0f32; 4]; 16]; 31];
        match shading {
            Shading::Isotropic => {
                for (p, l) in product[0].iter_mut().zip(&light.coefficients) {
                    *p = [l[0] as f32, l[1] as f32, l[2] as f32, 0.0];
                }
            }
            Shading::Lambert => {
                // H_k(n) = √(4π/(2l+1)) h_l Y_k(n); Y_k(n) is the kernel's part.
                let rows = sh::lambert_matrix(&light.coefficients);
                for (row, k) in product.iter_mut().zip(sh::lambert_rows()) {
                    let l = k.isqrt();
                    let h = sh::zonal_scale(l) * sh::zonal_clamped_cosine(l);
                    for (p, a) in row.iter_mut().zip(&rows[k]) {
                        *p = [(h * a[0]) as f32, (h * a[1]) as f32, (h * a[2]) as f32, 0.0];
                    }
                }
            }
        }
        Self {
            voxel_to_world_normal: Self::normal_matrix(grid),
            albedo: [albedo[0], albedo[1], albedo[2], 1.0],
            field_dims: [field_dims[0] as f32, field_dims[1] as f32, field_dims[2] as f32, 0.0],
            product,
            clip_planes: [[0.0; 4]; MAX_CLIPS],
        }
    }

    /// Direction of a gradient in voxel space → world space, columns of four; in [`Grid::unit`]s, so that no square of it leaves
    /// single precision.
    pub(super) fn normal_matrix(grid: &Grid) -> [[f32; 4]; 4] {
        let normal = grid.voxel_to_world().matrix3.inverse().transpose() * grid.unit();
        let column = |v: glam::DVec3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
        [column(normal.x_axis), column(normal.y_axis), column(normal.z_axis), [0.0, 0.0, 0.0, 1.0]]
    }

    /// Under clip planes, of which there are at most [`MAX_CLIPS`].
    pub fn clipped(mut self, planes: &[[f32; 4]]) -> Self {
        for (own, plane) in self.clip_planes.iter_mut().zip(planes) {
            *own = *plane;
        }
        self
    }
}

/// What the kernel reads besides the view.
pub struct Surface<'a> {
    /// Scalars.
    pub volume: &'a Image,
    /// The packed field.
    pub field: Packed<'a>,
    /// A [`Shade`].
    pub shade: &'a Buffer,
    /// Iso as the volume's image returns it.
    pub iso: f32,
    /// Whether larger image samples mean larger values.
    pub rising: bool,
    /// SH bands of the field.
    pub bands: u32,
    /// Shading that `shade` was folded for.
    pub shading: Shading,
    /// Clip planes in `shade`.
    pub clips: u32,
    /// What rays leap by.
    pub leap: Leap<'a>,
}

/// Records one part; `state` (vec4) and `depth` (float: world distance of the hit, −1 for none) hold rows × width pixels,
/// are read and written, and the caller puts barriers on them.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, surface: &Surface, view: &View, part: Part, state: &Buffer, depth: &Buffer) -> Result<()> {
    let view_format = pack::formats(surface.bands, surface.field.bits).1;
    let [field0, field1, field2, field3] = surface.field.images.map(|i| i.sampled_as(view_format));
    let [bounds_x, bounds_y, bounds_z] = surface.leap.packed();
    rec.dispatch(
        &kernel::Bindings {
            volume: surface.volume.sampled(),
            field0,
            field1,
            field2,
            field3,
            bricks: surface.field.directory.sampled().as_nearest(),
            view: surface.shade,
            state,
            hit_distance: depth,
            occupancy: surface.leap.distances.sampled(),
        },
        &kernel::Spec {
            bands: surface.bands,
            bits: surface.field.bits,
            wide: surface.field.wide,
            lambert: u32::from(surface.shading == Shading::Lambert),
            skip: surface.leap.skip.into(),
            clips: surface.clips,
            ..kernel::Spec::default()
        },
        &kernel::Params {
            origin: view.origin,
            step_length: part.step_length as f32,
            corner: view.corner,
            iso: surface.iso,
            du: view.du,
            side: if surface.rising { 1.0 } else { -1.0 },
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

/// A hit of the twin.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// World distance from the eye.
    pub distance: f32,
    /// Voxel coordinates.
    pub position: [f32; 3],
    /// World-space unit normal, outwards; `None` on flat data and where the volume's face cuts the surface open.
    pub normal: Option<[f64; 3]>,
}

/// The twin of the search: where the ray through a pixel first meets D ≥ iso.
pub fn reference_hit(volume: &Volume, iso: f32, view: &View, pixel: [usize; 2], step_length: f64) -> Option<Hit> {
    let dims = volume.grid().dims();
    let step = step_length as f32;
    let d = view.direction(pixel[0], pixel[1]);
    let (enter, leave) = twin::box_span(view.origin, d, dims);
    let begin = enter.max(0.0);
    let total = leave - begin;
    let inside = |t: f32| twin::sample(volume, twin::along(view.origin, d, begin + t)) >= iso;
    if total <= 0.0 {
        return None;
    }
    let at = |t: f32, normal| Hit { distance: begin + t, position: twin::along(view.origin, d, begin + t), normal };
    if inside(0.0) {
        return Some(at(0.0, None));
    }
    let mut lo = 0.0;
    for i in 1..=(total / step).ceil() as u32 {
        let mut hi = (i as f32 * step).min(total);
        if inside(hi) {
            for _ in 0..12 {
                let middle = 0.5 * (lo + hi);
                if inside(middle) {
                    hi = middle;
                } else {
                    lo = middle;
                }
            }
            let t = 0.5 * (lo + hi);
            let p = at(t, None).position;
            return Some(at(t, outward_normal(volume, p)));
        }
        lo = hi;
    }
    None
}

/// −∇D by central differences over one voxel, in world space.
fn outward_normal(volume: &Volume, p: [f32; 3]) -> Option<[f64; 3]> {
    let gradient: [f64; 3] = std::array::from_fn(|a| {
        let (mut before, mut after) = (p, p);
        before[a] -= 1.0;
        after[a] += 1.0;
        f64::from(twin::sample(volume, after) - twin::sample(volume, before))
    });
    let world = volume.grid().voxel_to_world().matrix3.inverse().transpose() * glam::DVec3::from(gradient);
    (world.length() > 0.0).then(|| (-world.normalize()).to_array())
}

/// The twin of the shading, by brute-force quadrature over the sphere instead of the SH product: ϖ/π·∫V L max(0, n·ω)dω
/// (or the isotropic form) for visibility coefficients `v`.
pub fn reference_radiance(v: &[f32; 16], light: &Light, albedo: [f32; 3], normal: [f64; 3], shading: Shading) -> [f32; 3] {
    let set = super::directions::fibonacci(20_000);
    let weight = 4.0 * std::f64::consts::PI / set.len() as f64;
    let mut sum = [0f64; 3];
    for w in set {
        let y = sh::basis(w);
        let visibility: f64 = y.iter().zip(v).map(|(y, &v)| y * f64::from(v)).sum();
        let lobe = match shading {
            Shading::Lambert => w.dot(glam::DVec3::from(normal)).max(0.0) / std::f64::consts::PI,
            Shading::Isotropic => 0.25 / std::f64::consts::PI,
        };
        for c in 0..3 {
            let radiance: f64 = y.iter().zip(&light.coefficients).map(|(y, l)| y * l[c]).sum();
            sum[c] += weight * visibility * radiance * lobe;
        }
    }
    std::array::from_fn(|c| (f64::from(albedo[c]) * sum[c].max(0.0)) as f32)
}
