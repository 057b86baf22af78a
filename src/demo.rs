//! A scene that needs no files: a machined block with bored cylinders, and through it a hollow tube that looks at the
//! camera, lit from two sides in two colours. What the `demo` command, tests and benches show.

use crate::error::Result;
use crate::scene::scene::{Matter, Shading, Surface};
use crate::scene::transfer::{Kind, Reference, Transfer};
use crate::scene::{Camera, Grid, Samples, Visibility, Volume};
use glam::{DVec2, DVec3};

/// Value of the block and its flange.
pub const BLOCK: f32 = 110.0;

/// Value of the tube, the cylinders' liners and the bolts.
pub const METAL: f32 = 220.0;

/// Isovalue that separates all matter from vacuum.
pub const ISO: f64 = 60.0;

/// The model's box, in its own units; every length below is in them.
const SIZE: [f64; 3] = [128.0, 128.0, 64.0];

/// The block as a `uint8` volume of `side` x `side` x `side`/2 voxels; the box keeps its size of 128 x 128 x 64 world units.
///
/// # Errors
/// [`crate::Error::Invalid`] for a side beyond what a grid allows, or of 0.
pub fn volume(side: usize) -> Result<Volume> {
    let dims = [side, side, (side / 2).max(1)];
    let spacing: [f64; 3] = std::array::from_fn(|a| SIZE[a] / dims[a].max(1) as f64);
    let grid = Grid::axis_aligned(dims, spacing)?;
    let to_model = |i: usize, a: usize| (i as f64 + 0.5) * spacing[a];
    let mut samples = Vec::with_capacity(dims[0] * dims[1] * dims[2]);
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let p = DVec3::new(to_model(x, 0), to_model(y, 1), to_model(z, 2));
                samples.push(value(p, grid.voxel_length()).round() as u8);
            }
        }
    }
    Volume::new(grid, Samples::U8(samples), 1.0, 0.0)
}

/// Value at a point of the model; edges fade over 1.5 voxels, as a scanner's would.
fn value(p: DVec3, voxel: f64) -> f32 {
    let cover = |distance: f64| (0.5 - distance / (1.5 * voxel)).clamp(0.0, 1.0) as f32;
    (BLOCK * cover(block(p))).max(METAL * cover(metal(p)))
}

const TUBE_Z: f64 = 41.0;
const TUBE_INNER: f64 = 15.5;
const BORES: [f64; 2] = [32.0, 96.0];
const BORE_RADIUS: f64 = 12.0;

/// Signed distance from the block: negative inside.
fn block(p: DVec3) -> f64 {
    let body = rounded_box(p - DVec3::new(64.0, 82.0, 20.0), DVec3::new(48.0, 34.0, 15.0), 4.0);
    let flange = rounded_box(p - DVec3::new(64.0, 82.0, 6.5), DVec3::new(58.0, 42.0, 2.5), 2.0);
    let solid = body.min(flange);
    // Bored from above, and hollow where the tube passes.
    let bores =
        BORES.iter().map(|&x| capped(DVec2::new(p.x - x, p.y - 82.0).length() - BORE_RADIUS, 12.0 - p.z)).fold(f64::INFINITY, f64::min);
    let channel = tube_axis(p) - TUBE_INNER;
    solid.max(-bores).max(-channel)
}

/// Signed distance from tube, liners and bolts.
fn metal(p: DVec3) -> f64 {
    let wall = (tube_axis(p) - 17.75).abs() - 2.25;
    // A window on either side, where the tube stands free: each colour enters through its own.
    let window = rounded_box(p - DVec3::new(64.0, 24.0, TUBE_Z + 2.0), DVec3::new(40.0, 9.0, 7.0), 5.0);
    let tube = wall.max((p.y - 63.0).abs() - 57.0).max(-window);
    let bore = |x: f64| DVec2::new(p.x - x, p.y - 82.0).length();
    let liner = BORES.iter().map(|&x| capped((bore(x) - 13.5).abs() - 1.5, (p.z - 24.5).abs() - 14.5)).fold(f64::INFINITY, f64::min);
    let bolt = [(12.0, 46.0), (116.0, 46.0), (12.0, 118.0), (116.0, 118.0)]
        .iter()
        .map(|&(x, y)| capped(DVec2::new(p.x - x, p.y - y).length() - 3.0, (p.z - 9.0).abs() - 5.0))
        .fold(f64::INFINITY, f64::min);
    tube.min(liner).min(bolt)
}

/// Distance from the tube's axis, which runs along y.
fn tube_axis(p: DVec3) -> f64 {
    DVec2::new(p.x - 64.0, p.z - TUBE_Z).length()
}

fn capped(side: f64, end: f64) -> f64 {
    side.max(end)
}

fn rounded_box(p: DVec3, half: DVec3, radius: f64) -> f64 {
    let q = p.abs() - (half - DVec3::splat(radius));
    q.max(DVec3::ZERO).length() + q.max_element().min(0.0) - radius
}

/// What is seen beside the block, linear radiance.
pub const BACKGROUND: [f32; 3] = [0.045, 0.05, 0.06];

/// Exposure of the translucent and of the opaque picture, stops: an isotropic haze sends back far less than a pale surface.
pub const EXPOSURES: [f64; 2] = [1.0, -0.75];

/// The translucent view: the block as haze, the metal dense in it.
///
/// # Errors
/// None for these points.
pub fn dvr() -> Result<Matter> {
    let points = [
        [50.0, 0.55, 0.62, 0.72, 0.0],
        [90.0, 0.55, 0.62, 0.72, 0.05],
        [130.0, 0.55, 0.62, 0.72, 0.05],
        [170.0, 0.92, 0.90, 0.86, 0.30],
        [210.0, 0.92, 0.90, 0.86, 0.60],
    ];
    // Over a voxel of the 128-wide model, so that other sizes show the same matter.
    let points = points.map(|[s, r, g, b, a]: [f64; 5]| [s, r, g, b, -(1.0 - a).ln()]);
    Ok(Matter { transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World)?, surface: None })
}

/// The opaque view: everything as one pale surface.
///
/// # Errors
/// As [`dvr`].
pub fn iso() -> Result<Matter> {
    let surface = Surface { iso: ISO, shading: Shading::Lambert, albedo: Some([0.85, 0.85, 0.85]) };
    Ok(Matter { surface: Some(surface), ..dvr()? })
}

/// The camera: looks into the tube from in front, from the right and from above.
pub fn camera(grid: &Grid) -> Camera {
    let centre = grid.centre_world();
    let side = grid.longest_side();
    Camera {
        position: centre + DVec3::new(0.50, -1.42, 0.62) * side,
        target: centre + DVec3::new(0.01, -0.06, -0.01) * side,
        up: DVec3::Z,
        fov_degrees: 30.0,
    }
}

/// Field settings of the demo: `quick` for a look, otherwise for show.
pub fn visibility(quick: bool) -> Visibility {
    Visibility { ratio: if quick { 4 } else { 2 }, directions: if quick { 64 } else { 128 }, ..Visibility::default() }
}
