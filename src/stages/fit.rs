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
use super::{MediumView, cell_size, dims_f32, dims_u32, twin};
use crate::error::Result;
use crate::kernels::{fit_points, fit_rows, fit_see, fit_start, fit_step};
use crate::scene::transfer::Table;
use crate::scene::{Grid, Volume};
use crate::vk::{Buffer, Image, Recorder};

/// How much the values at the centres count beside what points say.
pub const LAMBDA: f32 = 0.02;

/// The bounds between which the iteration damps evenly; what lies below, the points hardly tell.
const SPECTRUM: [f64; 2] = [0.08, 1.0];

/// Iterations.
pub const STEPS: usize = 8;

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

/// Points of a work group of [`record_see`].
pub const GROUP: u32 = 64;

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
        &fit_see::Spec { bands: sweep.bands, near: sweep.near, axis: slice.axis as u32, clips: medium.clips, lanes: sweep.lanes[1] },
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

/// What is solved: the equations of the cells that points read.
pub struct Equations<'a> {
    /// Cells of the field.
    pub dims: [usize; 3],
    /// Linear indices of those that points read.
    pub cells: &'a Buffer,
    /// How many.
    pub count: u32,
    /// Per cell of the field its box + 1, or 0.
    pub boxes: &'a Buffer,
    /// Per cell of the field its equation + 1, or 0.
    pub places: &'a Buffer,
    /// 27 × equations, f32.
    pub rows: &'a Buffer,
    /// bands² × equations, f32.
    pub side: &'a Buffer,
    /// vec4 per equation, read and written in turns.
    pub solutions: [&'a Buffer; 2],
    /// vec4 per equation.
    pub moves: &'a Buffer,
    /// SH bands.
    pub bands: u32,
    /// Directions that the sums hold.
    pub directions: u32,
}

/// Coefficients 4·index .. of the swept cells: their slots, their own sums, and where what is found goes.
pub struct Group<'a> {
    /// Which four.
    pub index: u32,
    /// Slots of the cells.
    pub cell_map: &'a Image,
    /// rgba32f, slot by slot.
    pub sums: &'a Image,
    /// The same.
    pub fitted: &'a Image,
}

/// Records the equations of `count` cells from `first` on.
///
/// # Errors
/// What the recorder refuses.
pub fn record_rows(rec: &mut Recorder, grid: &Grid, seen: &Seen, equations: &Equations, (first, count): (u32, u32)) -> Result<()> {
    rec.dispatch(
        &fit_rows::Bindings {
            cells: equations.cells,
            boxes: equations.boxes,
            points: seen.points,
            seen: seen.sums,
            rows: equations.rows,
            side: equations.side,
        },
        &fit_rows::Spec { bands: equations.bands },
        &fit_rows::Params {
            cell_size: cell_size(grid, equations.dims),
            first_cell: first,
            field_dims: dims_u32(equations.dims),
            count,
            cell_count: equations.count,
            point_count: seen.per_box,
            capacity: seen.boxes * seen.per_box,
            mean: 1.0 / (equations.directions as f32 * Y00),
        },
        [count, 1, 1],
    )
}

/// Records what the iteration of a group begins with, for `count` slots from `first` on of the cells `wanted`.
///
/// # Errors
/// What the recorder refuses.
pub fn record_start(rec: &mut Recorder, equations: &Equations, group: &Group, wanted: &Buffer, (first, count): (u32, u32)) -> Result<()> {
    rec.dispatch(
        &fit_start::Bindings {
            wanted,
            places: equations.places,
            sums: group.sums.sampled(),
            solution: equations.solutions[0],
            fitted: group.fitted.storage(0),
        },
        &(),
        &fit_start::Params { first_slot: first, count },
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
pub fn record_step(rec: &mut Recorder, equations: &Equations, group: &Group, step: usize, (first, count): (u32, u32)) -> Result<()> {
    let (keep, add) = weights()[step];
    rec.dispatch(
        &fit_step::Bindings {
            cells: equations.cells,
            places: equations.places,
            rows: equations.rows,
            side: equations.side,
            cell_map: group.cell_map.sampled().as_nearest(),
            sums: group.sums.sampled(),
            before: equations.solutions[step % 2],
            after: equations.solutions[1 - step % 2],
            moves: equations.moves,
            fitted: group.fitted.storage(0),
        },
        &fit_step::Spec { last: step + 1 == STEPS },
        &fit_step::Params {
            field_dims: dims_u32(equations.dims),
            first_cell: first,
            count,
            cell_count: equations.count,
            coefficient: 4 * group.index,
            kept: equations.bands * equations.bands,
            keep,
            add,
            lambda: LAMBDA,
            unit: equations.directions as f32 / (4.0 * std::f32::consts::PI),
        },
        [count, 1, 1],
    )
}

/// The twin of [`record_see`], beside the twin of the sweep: sums of V·Y, 16 for each of the places `points` in voxels.
pub fn reference_seen(
    volume: &Volume,
    table: &Table,
    dims: [usize; 3],
    rays: &[sweep::Ray],
    settings: sweep::Settings,
    points: &[[f32; 3]],
    clip: &[[f32; 4]],
) -> Vec<[f32; 16]> {
    let size = cell_size(volume.grid(), dims);
    let mut out = vec![[0f32; 16]; points.len()];
    sweep::each_slice(volume, table, dims, rays, settings, clip, &mut |ray, group, swept| {
        let (a, [b, c]) = (group.axis, sweep::plane(group.axis));
        let order = swept.len() - 1;
        let index = group.slice(order, dims[a]);
        let d = [ray.voxel[0], ray.voxel[1], ray.voxel[2]];
        let reach = (settings.near as f32 + 0.5) * size[a] / d[a].abs();
        for (&x, sums) in points.iter().zip(&mut out).filter(|(x, _)| ((x[a] / size[a]) as usize).min(dims[a] - 1) == index) {
            let further = if group.rising { settings.near as f32 } else { -(settings.near as f32) };
            let t = ((index as f32 + further + 0.5) * size[a] - x[a]) / d[a];
            let end = twin::exit_distance(x, d, volume.grid().dims());
            let mut v = (-sweep::depth(volume, table, clip, (x, d), t.min(end), reach, settings.step_length)).exp();
            if t < end {
                let at = [b, c].map(|k| (x[k] + d[k] * t) / size[k] - 0.5);
                v *= sweep::read(&swept[order - settings.near as usize], [dims[b], dims[c]], at);
            }
            for (s, y) in sums.iter_mut().zip(ray.basis()) {
                *s += v * y;
            }
        }
    });
    out
}

/// What the fit makes least, of one coefficient: Σ w (Σ φ_c x_c − v)² + λ Σ D_c (x_c − x⁰_c)². `points`: places in cells from the
/// first cell's centre, w and v.
pub fn objective(dims: [usize; 3], points: &[([f32; 3], f64, f64)], own: &[f64], x: &[f64]) -> f64 {
    let mut weight = vec![0f64; own.len()];
    let mut sum = 0.0;
    for (q, w, v) in points {
        let corners = weights_at(dims, *q);
        let read: f64 = corners.iter().map(|&(c, phi)| phi * x[c]).sum();
        sum += w * (read - v) * (read - v);
        corners.iter().for_each(|&(c, phi)| weight[c] += w * phi);
    }
    sum + (0..own.len()).map(|c| f64::from(LAMBDA) * weight[c] * (x[c] - own[c]).powi(2)).sum::<f64>()
}

/// The twin of the solver: what makes [`objective`] least, by Gauss-Seidel to convergence. Cells that no point reads stay.
pub fn reference_solution(dims: [usize; 3], points: &[([f32; 3], f64, f64)], own: &[f64]) -> Vec<f64> {
    let corners: Vec<_> = points.iter().map(|(q, ..)| weights_at(dims, *q)).collect();
    let mut readers = vec![Vec::new(); own.len()];
    for (i, of) in corners.iter().enumerate() {
        of.iter().for_each(|&(c, phi)| readers[c].push((i, phi)));
    }
    let mut x = own.to_vec();
    let mut rest: Vec<f64> =
        points.iter().zip(&corners).map(|((_, _, v), of)| v - of.iter().map(|&(c, phi)| phi * x[c]).sum::<f64>()).collect();
    for _ in 0..2000 {
        for c in 0..x.len() {
            let (mut up, mut down, mut weight) = (0.0, 0.0, 0.0);
            for &(i, phi) in &readers[c] {
                let w = points[i].1;
                up += w * phi * rest[i];
                down += w * phi * phi;
                weight += w * phi;
            }
            let lambda = f64::from(LAMBDA) * weight;
            if down > 0.0 {
                let step = (up + lambda * (own[c] - x[c])) / (down + lambda);
                x[c] += step;
                readers[c].iter().for_each(|&(i, phi)| rest[i] -= phi * step);
            }
        }
    }
    x
}

/// [`twin::corners`] in double precision.
fn weights_at(dims: [usize; 3], q: [f32; 3]) -> Vec<(usize, f64)> {
    twin::corners(dims, q).into_iter().map(|(cell, weight)| (cell, f64::from(weight))).collect()
}
