//! fit: coefficients of cells that make what pictures read right, instead of what is seen at the cells' centres.
//!
//! Pictures read the field trilinearly, and only where matter is seen: in front of an opaque wall, within a fraction of a
//! cell, where visibility falls from half the sky to nothing. Centres lie anywhere, before the wall or deep in it, and what
//! is read between them is off by tens of percent. The fit draws points of visible matter in each cell ([`record_points`]),
//! sums what they see beside the sweep ([`record_see`]), and finds the cells whose trilinear interpolation φ comes closest to
//! it: x = argmin Σ w |Σ φ_c x_c − v|² + λ Σ D_c |x_c − x⁰_c|², w the opacity that a point stands for times the share of the
//! sky that it sees (what sees light is seen), D_c = Σ w φ_c, x⁰ the values at the centres. It is the L² projection of the
//! finite-element method in place of nodal interpolation; D⁻¹A has its eigenvalues in (0, 1], so that a few steps of
//! Chebyshev's semi-iteration, which need no sums over the whole field, solve it.

use super::sweep;
use super::{MediumView, cell_size, dims_f32, dims_u32};
use crate::error::Result;
use crate::kernels::{fit_points, fit_rows, fit_see, fit_step};
use crate::scene::Grid;
use crate::vk::{Buffer, Image, Recorder};

/// How much the values at the centres count beside what points say.
pub const LAMBDA: f32 = 0.02;

/// The bounds between which the iteration damps evenly; what lies below, the points hardly tell.
const SPECTRUM: [f64; 2] = [0.06, 1.0];

/// Iterations.
pub const STEPS: usize = 12;

/// Mean of Y_00·V over directions to the share of the sky.
const Y00: f32 = 0.282_094_8;

/// Records the drawing of `points` in each of `count` cells; `cells` holds their linear indices, `out` takes a vec4 each: place
/// in voxels, weight. A cell in which no matter is found has points of weight 0.
///
/// # Errors
/// What the recorder refuses.
pub fn record_points(
    rec: &mut Recorder,
    medium: &MediumView,
    dims: [usize; 3],
    (cells, count): (&Buffer, u32),
    points: u32,
    out: &Buffer,
) -> Result<()> {
    rec.dispatch(
        &fit_points::Bindings { volume: medium.volume.sampled(), sigma: medium.sigma, cells, points: out },
        &fit_points::Spec { clips: medium.clips },
        &fit_points::Params {
            cell_size: cell_size(medium.grid, dims),
            voxel: medium.grid.voxel_length() as f32,
            field_dims: dims_u32(dims),
            cell_count: count,
            point_count: points,
            map_scale: medium.map.0,
            map_bias: medium.map.1,
        },
        [count, 1, 1],
    )
}

/// Boxes with points, and what the points have seen. A box is a cell's.
pub struct Seen<'a> {
    /// vec4 per point, box after box.
    pub points: &'a Buffer,
    /// Points of a box.
    pub per_box: u32,
    /// Boxes.
    pub boxes: u32,
    /// Boxes by slice, along x, then y, then z.
    pub order: &'a Buffer,
    /// bands² × points, f32: sums of V·Y.
    pub sums: &'a Buffer,
}

/// Records what points see of a batch's directions from a slice that was just swept: `run` is (first of the order, boxes). The
/// caller puts barriers on the sums and on the transmittance.
///
/// # Errors
/// What the recorder refuses.
pub fn record_see(
    rec: &mut Recorder,
    medium: &MediumView,
    sweep: &sweep::Sweep,
    slice: sweep::Slice,
    rising: bool,
    step_length: f64,
    (seen, [first, boxes]): (&Seen, [u32; 2]),
) -> Result<()> {
    let size = cell_size(medium.grid, sweep.field_dims);
    let plane = i64::from(slice.index) + if rising { i64::from(sweep.near) } else { -i64::from(sweep.near) };
    rec.dispatch(
        &fit_see::Bindings {
            directions: sweep.directions,
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
            transmittance: sweep.transmittance,
            points: seen.points,
            order: seen.order,
            seen: seen.sums,
        },
        &fit_see::Spec { bands: sweep.bands, near: sweep.near, axis: slice.axis as u32, clips: medium.clips },
        &fit_see::Params {
            cell_size: size,
            step_length: step_length as f32,
            volume_dims: dims_f32(medium.grid.dims()),
            map_scale: medium.map.0,
            field_dims: dims_u32(sweep.field_dims),
            map_bias: medium.map.1,
            plane: (plane as f32 + 0.5) * size[slice.axis],
            // The slice `near` before this one, of a ring of near + 1.
            ring_slot: (slice.order + 1) % (sweep.near + 1),
            first_direction: slice.first_direction,
            direction_count: slice.direction_count,
            begin: u32::from(slice.begin),
            first_box: first,
            count: boxes * seen.per_box,
            point_count: seen.per_box,
            capacity: seen.boxes * seen.per_box,
        },
        [boxes * seen.per_box, 1, 1],
    )
}

/// What is solved: the wanted cells' equations for four coefficients.
pub struct Equations<'a> {
    /// Cells of the field.
    pub dims: [usize; 3],
    /// Linear indices of the wanted cells, ascending, as their slots are.
    pub cells: &'a Buffer,
    /// How many.
    pub count: u32,
    /// Per cell of the field its box + 1, or 0.
    pub boxes: &'a Buffer,
    /// 27 × cells.
    pub rows: &'a Buffer,
    /// vec4 per cell.
    pub side: &'a Buffer,
    /// vec4 per cell, read and written in turns.
    pub solutions: [&'a Buffer; 2],
    /// vec4 per cell.
    pub moves: &'a Buffer,
    /// SH bands.
    pub bands: u32,
    /// Directions that the sums hold.
    pub directions: u32,
}

/// Records the equations of `count` cells from `first` on, for coefficients 4·group on; the rows with the first group.
///
/// # Errors
/// What the recorder refuses.
pub fn record_rows(
    rec: &mut Recorder,
    grid: &Grid,
    seen: &Seen,
    equations: &Equations,
    (group, sums): (u32, &Image),
    (first, count): (u32, u32),
) -> Result<()> {
    rec.dispatch(
        &fit_rows::Bindings {
            cells: equations.cells,
            boxes: equations.boxes,
            points: seen.points,
            seen: seen.sums,
            sums: sums.sampled(),
            rows: equations.rows,
            side: equations.side,
            solution: equations.solutions[0],
        },
        &fit_rows::Spec { rows: group == 0 },
        &fit_rows::Params {
            cell_size: cell_size(grid, equations.dims),
            first_cell: first,
            field_dims: dims_u32(equations.dims),
            count,
            cell_count: equations.count,
            point_count: seen.per_box,
            capacity: seen.boxes * seen.per_box,
            coefficient: 4 * group,
            kept: equations.bands * equations.bands,
            mean: 1.0 / (equations.directions as f32 * Y00),
        },
        [count, 1, 1],
    )
}

/// (keep, add) of each iteration: move = keep·move + add·residual.
fn weights() -> [(f32, f32); STEPS] {
    let [lo, hi] = SPECTRUM.map(|s| s + f64::from(LAMBDA));
    let (centre, half) = ((hi + lo) / 2.0, (hi - lo) / 2.0);
    let sigma = centre / half;
    let mut rho = 1.0 / sigma;
    std::array::from_fn(|i| {
        if i == 0 {
            return (0.0, (1.0 / centre) as f32);
        }
        let next = 1.0 / (2.0 * sigma - rho);
        let pair = ((next * rho) as f32, (2.0 * next / half) as f32);
        rho = next;
        pair
    })
}

/// Records iteration `step` of `count` cells from `first` on; the last stores into `fitted`.
///
/// # Errors
/// What the recorder refuses.
pub fn record_step(
    rec: &mut Recorder,
    cell_map: &Image,
    equations: &Equations,
    (group, sums, fitted): (u32, &Image, &Image),
    step: usize,
    (first, count): (u32, u32),
) -> Result<()> {
    let (keep, add) = weights()[step];
    rec.dispatch(
        &fit_step::Bindings {
            cells: equations.cells,
            cell_map: cell_map.sampled().as_nearest(),
            rows: equations.rows,
            side: equations.side,
            sums: sums.sampled(),
            before: equations.solutions[step % 2],
            after: equations.solutions[1 - step % 2],
            moves: equations.moves,
            fitted: fitted.storage(0),
        },
        &fit_step::Spec { last: step + 1 == STEPS },
        &fit_step::Params {
            field_dims: dims_u32(equations.dims),
            first_cell: first,
            count,
            cell_count: equations.count,
            coefficient: 4 * group,
            keep,
            add,
            lambda: LAMBDA,
            unit: equations.directions as f32 / (4.0 * std::f32::consts::PI),
        },
        [count, 1, 1],
    )
}
