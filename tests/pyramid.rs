//! The opacity pyramid: classify and minify against formulas and twins.

mod common;
use common::*;
use halflight::scene::visibility::Filter;
use halflight::scene::{Grid, Visibility};
use halflight::stages::{classify, minify};

const FILTERS: [Filter; 4] = [Filter::Box, Filter::Product, Filter::Axis, Filter::Extinction];

fn pyramid(
    engine: &halflight::Engine,
    volume: &halflight::scene::Volume,
    matter: &halflight::scene::Matter,
    filter: Filter,
) -> Vec<Vec<f32>> {
    let (_, medium) = load(engine, volume, matter);
    engine.read_pyramid(&medium, &Visibility { filter, ..Visibility::default() }).expect("pyramid")
}

/// O is stored as the nearest half float: half a unit in the last place of values below 1, and the device's exp.
const HALF: f32 = 2.5e-4 + 1e-5;

#[test]
fn a_homogeneous_medium_has_the_opacity_of_its_length() {
    let engine = engine();
    let grid = Grid::axis_aligned([16, 16, 16], [0.5, 0.5, 0.5]).expect("grid");
    let volume = blobs(grid, 1);
    let sigma = 0.3;
    for filter in [Filter::Product, Filter::Axis, Filter::Extinction] {
        let levels = pyramid(&engine, &volume, &homogeneous(sigma), filter);
        assert_eq!(levels.len(), 5);
        for (k, level) in levels.iter().enumerate() {
            let expected = 1.0 - (-sigma * 0.5 * f64::from(1 << k)).exp() as f32;
            // Each level squares the error of the half floats below it at most twofold.
            let tolerance = HALF * (1 + k) as f32;
            assert!(level.iter().all(|o| (o - expected).abs() < tolerance), "{filter:?} level {k}: {} for {expected}", level[0]);
        }
    }
    // The plain filter keeps the mean opacity of one voxel at every level: wrong for a ray, and shown to be.
    let levels = pyramid(&engine, &volume, &homogeneous(sigma), Filter::Box);
    assert!((levels[4][0] - levels[0][0]).abs() < HALF);
}

#[test]
fn an_opaque_sheet_blocks_half_of_the_axes_pairs() {
    // One opaque layer of a 2x2x2 block, across x: pairs along x all meet it (1), pairs along y and z meet it or not (½).
    let volume =
        halflight::scene::Volume::from_fn(Grid::axis_aligned([2, 2, 2], [1.0; 3]).expect("grid"), |p| if p[0] < 1.0 { 1.0 } else { 0.0 })
            .expect("volume");
    let o0 = [1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0];
    let top = |filter| minify::reference(&o0, [2, 2, 2], filter).0[0];
    assert!((top(Filter::Axis) - 2.0 / 3.0).abs() < 1e-6);
    assert!((top(Filter::Product) - 0.75).abs() < 1e-6);
    assert!((top(Filter::Box) - 0.5).abs() < 1e-6);
    drop(volume);
}

#[test]
fn classify_and_minify_equal_their_twins() {
    let engine = engine();
    // Powers of two, odd, prime, a dimension of 1, anisotropic and oblique.
    let grids = awkward_grids([16, 8, 32]);
    for (g, grid) in grids.into_iter().enumerate() {
        let volume = blobs(grid, 7 + g as u64);
        let matter = linear(1.5);
        let table = matter.transfer.table(volume.range(), &grid);
        for filter in FILTERS {
            let levels = pyramid(&engine, &volume, &matter, filter);
            let (w, i) = worst(&levels[0], &classify::reference(&volume, &table));
            assert!(w < HALF, "classify, grid {g}: differs by {w} at {i}");
            // Each level from the device's own finer one: errors do not add up.
            let mut dims = grid.dims().map(|n| n as u32);
            for k in 1..levels.len() {
                let (twin, coarse) = minify::reference(&levels[k - 1], dims, filter);
                let (w, i) = worst(&levels[k], &twin);
                assert!(w < HALF, "{filter:?}, grid {g}, level {k}: differs by {w} at {i}");
                dims = coarse;
            }
        }
    }
}

#[test]
fn the_comparison_fails_when_something_is_wrong() {
    let engine = engine();
    let grid = Grid::axis_aligned([16, 8, 32], [1.0; 3]).expect("grid");
    let volume = blobs(grid, 7);
    let matter = linear(1.5);
    let table = matter.transfer.table(volume.range(), &grid);
    let levels = pyramid(&engine, &volume, &matter, Filter::Axis);
    // Another extinction, another axis order, another filter.
    let denser = linear(1.6).transfer.table(volume.range(), &grid);
    assert!(worst(&levels[0], &classify::reference(&volume, &denser)).0 > HALF);
    let mut shifted = levels[0].clone();
    shifted.rotate_right(1);
    assert!(worst(&shifted, &classify::reference(&volume, &table)).0 > HALF);
    for other in [Filter::Box, Filter::Product, Filter::Extinction] {
        assert!(worst(&levels[1], &minify::reference(&levels[0], [16, 8, 32], other).0).0 > HALF, "{other:?}");
    }
}

#[test]
fn the_axis_filter_is_nearest_to_the_true_block_transmittance_on_sheets_and_blobs() {
    // Truth for a block of 2^k voxels: mean over the three axes of the mean transmittance of its columns.
    let truth = |o0: &[f32], n: usize| -> f64 {
        let mut sum = 0.0;
        for axis in 0..3 {
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let stride = |axis: usize| n.pow(axis as u32);
            for i in 0..n {
                for j in 0..n {
                    sum += (0..n).map(|k| 1.0 - f64::from(o0[i * stride(a) + j * stride(b) + k * stride(axis)])).product::<f64>();
                }
            }
        }
        sum / (3 * n * n) as f64
    };
    let mut errors = [0.0; 4];
    let mut random = Random(3);
    for case in 0..40 {
        // Random voxels, sheets and rods in a block of 8.
        let n = 8;
        let fill = random.unit();
        let o0: Vec<f32> = (0..n * n * n)
            .map(|i| {
                let r = random.unit();
                match case % 3 {
                    0 => f32::from(u8::from(r < 0.3 * fill)) * 0.9,
                    1 => f32::from(u8::from(i % n == 3)) * fill,
                    _ => f32::from(u8::from(i % n < 2 && i / n % n < 3)) * fill,
                }
            })
            .collect();
        let t = truth(&o0, n);
        for (e, filter) in errors.iter_mut().zip(FILTERS) {
            let mut level = (o0.clone(), [n as u32; 3]);
            while level.1[0] > 1 {
                level = minify::reference(&level.0, level.1, filter);
            }
            *e += (1.0 - f64::from(level.0[0]) - t).abs() / 40.0;
        }
    }
    println!(
        "mean |T - truth| of an 8x8x8 block: box {:.3}, product {:.3}, axis {:.3}, extinction {:.3}",
        errors[0], errors[1], errors[2], errors[3]
    );
    assert!(errors[2] < errors[0] && errors[2] < errors[1] && errors[2] < errors[3], "{errors:?}");
}
