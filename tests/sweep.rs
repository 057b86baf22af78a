//! The sweep: formulas, twin, sabotage, and where it must be better than the hierarchy.

mod common;
use common::*;
use halflight::measure::field_error;
use halflight::scene::visibility::{Cells, Method, Sampling};
use halflight::scene::{Grid, Visibility, Volume, sh};
use halflight::stages::sweep;

fn settings(near: u32, directions: u32, ratio: u32) -> Visibility {
    Visibility { method: Method::Sweep, ratio, directions, near, bits: 32, step: 0.5, cells: Cells::All, ..Visibility::default() }
}

fn all(dims: [usize; 3]) -> Vec<u32> {
    (0..dims.iter().product::<usize>() as u32).collect()
}

#[test]
fn the_sweep_equals_its_twin() {
    let engine = engine();
    let grids = [
        Grid::axis_aligned([20, 16, 12], [1.0; 3]).expect("grid"),
        Grid::axis_aligned([17, 13, 11], [1.0, 1.0, 5.0]).expect("grid"),
        Grid::axis_aligned([19, 1, 6], [0.7, 2.0, 1.0]).expect("grid"),
        oblique([9, 14, 7]),
    ];
    for (g, grid) in grids.into_iter().enumerate() {
        for (near, ratio) in [(1, 1), (1, 2), (2, 2), (3, 4), (2, 8)] {
            let volume = blobs(grid, 41 + g as u64);
            let matter = linear(0.8);
            let (_, medium) = load(&engine, &volume, &matter);
            let dims = grid.field_dims(ratio as usize);
            let device = engine.estimate(&medium, &settings(near, 29, ratio), &all(dims), &mut quiet).expect("estimate");
            let rays = sweep::rays(29, &grid);
            let table = matter.transfer.table(volume.range(), &grid);
            let twin = |near| {
                let settings = sweep::Settings { near, step_length: 0.5 * grid.voxel_length() };
                sweep::reference(&volume, &table, dims, &rays, settings)
            };
            let e = field_error(&device, &twin(near)).relative_l2;
            // Single precision through at most 20 slices, and the device's filter weights.
            assert!(e < 1e-3, "grid {g}, near {near}, 1:{ratio}: {e}");
            // Sabotage: another near field is told apart wherever there is more than one slice to interpolate.
            if g == 0 && ratio < 4 {
                assert!(field_error(&device, &twin(near + 1)).relative_l2 > 1e-3);
            }
        }
    }
}

#[test]
fn a_homogeneous_medium_attenuates_by_its_chord() {
    let engine = engine();
    let (n, sigma) = ([24usize, 20, 16], 0.05);
    let volume = blobs(Grid::axis_aligned(n, [1.0, 0.5, 2.0]).expect("grid"), 2);
    let (_, medium) = load(&engine, &volume, &homogeneous(sigma));
    for ratio in [1, 2, 4] {
        let dims = volume.grid().field_dims(ratio as usize);
        let cells = all(dims);
        let swept = engine.estimate(&medium, &settings(1, 512, ratio), &cells, &mut quiet).expect("sweep");
        // Truth over the same directions: chords by slabs in world space.
        let rays = sweep::rays(512, volume.grid());
        let truth: Vec<[f32; 16]> = cells
            .iter()
            .map(|&cell| {
                let x = halflight::stages::twin::cell_centre(volume.grid(), dims, cell);
                let mut sum = [0f64; 16];
                for d in &rays {
                    let w: [f64; 3] = std::array::from_fn(|a| f64::from(d.voxel[a]) * [1.0, 0.5, 2.0][a]);
                    let chord = (0..3)
                        .map(|a| {
                            let wall = if w[a] > 0.0 { n[a] as f64 - f64::from(x[a]) } else { f64::from(x[a]) };
                            wall * [1.0, 0.5, 2.0][a] / w[a].abs()
                        })
                        .fold(f64::INFINITY, f64::min);
                    for (s, y) in sum.iter_mut().zip(sh::basis(w.into())) {
                        *s += (-sigma * chord).exp() * y * 4.0 * std::f64::consts::PI / 512.0;
                    }
                }
                sum.map(|s| s as f32)
            })
            .collect();
        let e = field_error(&swept, &truth).relative_l2;
        println!("homogeneous, 1:{ratio}: {e:.4}");
        // T is smooth but for a kink where a ray changes the wall it leaves by; interpolation rounds the kink off over a
        // cell, which is σ·cell/4 = 0.025 of T at 1:1 there, and less elsewhere.
        assert!(e < 0.02 * f64::from(ratio), "1:{ratio}: {e}");
        // Sabotage: a tenth more extinction.
        let (_, denser) = load(&engine, &volume, &homogeneous(1.1 * sigma));
        let wrong = engine.estimate(&denser, &settings(1, 512, ratio), &cells, &mut quiet).expect("sweep");
        assert!(ratio > 1 || field_error(&wrong, &truth).relative_l2 > 0.02);
    }
}

#[test]
fn an_empty_volume_sees_the_whole_sky_and_bands_and_batches_change_no_bit() {
    let engine = engine();
    let volume = blobs(Grid::axis_aligned([12, 9, 7], [1.0; 3]).expect("grid"), 1);
    let (_, vacuum) = load(&engine, &volume, &homogeneous(0.0));
    for v in engine.estimate(&vacuum, &settings(1, 400, 1), &[0, 17, 755], &mut quiet).expect("estimate") {
        assert!((f64::from(v[0]) - 2.0 * std::f64::consts::PI.sqrt()).abs() < 1e-5);
        assert!(v[1..].iter().all(|c| c.abs() < 0.02));
    }
    let (_, medium) = load(&engine, &volume, &linear(0.9));
    let cells = all(volume.grid().field_dims(2));
    let full = engine.estimate(&medium, &settings(2, 100, 2), &cells, &mut quiet).expect("estimate");
    for bands in 1..=4 {
        let s = Visibility { bands, ..settings(2, 100, 2) };
        let some = engine.estimate(&medium, &s, &cells, &mut quiet).expect("estimate");
        for (a, b) in some.iter().zip(&full) {
            assert_eq!(a[..s.coefficients()], b[..s.coefficients()]);
        }
        let field = engine.precompute(&medium, &s, &mut quiet).expect("precompute");
        let read = engine.read_field(&field).expect("read");
        assert_eq!(read, some.iter().flat_map(|v| v[..s.coefficients()].to_vec()).collect::<Vec<_>>());
    }
}

#[test]
fn a_sheet_far_off_keeps_its_shadow() {
    let engine = engine();
    // An opaque sheet of one voxel across z, and probes below it at growing distance: the half sky above is dark.
    let n = 48;
    let volume =
        Volume::from_fn(Grid::axis_aligned([n, n, n], [1.0; 3]).expect("grid"), |p| if p[2] > 40.0 && p[2] < 41.0 { 1.0 } else { 0.0 })
            .expect("volume");
    let (_, medium) = load(&engine, &volume, &linear(8.0));
    let s = settings(2, 256, 2);
    let dims = volume.grid().field_dims(2);
    let cells: Vec<u32> = (0..20).map(|z| (12 + dims[0] * (12 + dims[1] * z)) as u32).collect();
    let swept = engine.estimate(&medium, &s, &cells, &mut quiet).expect("sweep");
    let dense = Visibility { method: Method::March, directions: 1024, step: 0.25, ..s.clone() };
    let truth = engine.estimate(&medium, &dense, &cells, &mut quiet).expect("march");
    let hierarchy = engine.estimate(&medium, &Visibility { method: Method::Hierarchical, ..s }, &cells, &mut quiet).expect("hierarchical");
    let (e, h) = (field_error(&swept, &truth).relative_l2, field_error(&hierarchy, &truth).relative_l2);
    println!("sheet: sweep {e:.4}, hierarchical {h:.4}");
    assert!(e < 0.05 && e < h, "sweep {e}, hierarchical {h}");
}

#[test]
fn jittered_patterns_are_refused_and_cancelling_works() {
    let engine = engine();
    let volume = blobs(Grid::axis_aligned([16, 16, 16], [1.0; 3]).expect("grid"), 1);
    let (_, medium) = load(&engine, &volume, &linear(0.9));
    let s = Visibility { sampling: Sampling::Jittered, ..settings(1, 16, 2) };
    let text = engine.precompute(&medium, &s, &mut quiet).err().expect("refused").to_string();
    assert!(text.contains("stratified"), "{text}");
    let mut last = 0.0;
    let mut stop = |_: &'static str, f: f32| {
        assert!(f >= last && f <= 1.0);
        last = f;
        if f > 0.0 { std::ops::ControlFlow::Break(()) } else { std::ops::ControlFlow::Continue(()) }
    };
    assert!(matches!(engine.precompute(&medium, &settings(1, 16, 2), &mut stop), Err(halflight::Error::Cancelled)));
    assert!(engine.precompute(&medium, &settings(1, 16, 2), &mut quiet).is_ok());
}
