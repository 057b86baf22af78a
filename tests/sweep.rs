//! The sweep: formulas, twin, sabotage, and where it must be better than the hierarchy.

mod common;
use common::*;
use halflight::measure::field_error;
use halflight::scene::Samples;
use halflight::scene::visibility::{Cells, Method, Sampling};
use halflight::scene::{Grid, ImageSettings, Light, Picture, Probe, Visibility, Volume, sh};
use halflight::stages::sweep;
use halflight::vk::DeviceKind;

fn settings(near: u32, directions: u32, ratio: u32) -> Visibility {
    Visibility { method: Method::Sweep, ratio, directions, near, bits: 32, step: 0.5, cells: Cells::All, ..Visibility::default() }
}

fn sky() -> Light {
    Light::from_probe(&Probe::two_colored())
}

fn all(dims: [usize; 3]) -> Vec<u32> {
    (0..dims.iter().product::<usize>() as u32).collect()
}

/// A slice of more tiles than a dispatch takes work groups (65,535 of 128 cells on lavapipe) is swept in parts.
#[test]
fn a_slice_may_have_more_tiles_than_a_dispatch_takes() {
    let engine = engine();
    let (side, at) = (2912, 2800);
    let of = |n: usize, from: usize| {
        let mut samples = vec![0f32; n * n];
        for y in 0..24 {
            samples[n * (from + y) + from..][..24].fill(1.0);
        }
        Volume::new(Grid::axis_aligned([n, n, 1], [1.0; 3]).expect("grid"), Samples::F32(samples), 1.0, 0.0).expect("volume")
    };
    let seen = |n: usize, from: usize| {
        let (_, medium) = load(&engine, &of(n, from), &linear(0.3));
        let cells: Vec<u32> = (0..24).flat_map(|y| (0..24).map(move |x| (n * (from + y) + from + x) as u32)).collect();
        let settings = Visibility { bands: 1, cells: Cells::Matter, ..settings(1, 6, 1) };
        engine.estimate(&medium, &settings, &cells, &mut quiet).expect("estimate")
    };
    let (large, small) = (seen(side, at), seen(64, 20));
    // The same matter in a small volume: beyond it nothing hinders light.
    let apart = field_error(&large, &small).relative_l2;
    assert!(apart < 1e-5, "{apart}");
    // Sabotage: cells of another place are told apart.
    let moved: Vec<_> = small.iter().cycle().skip(5).take(small.len()).copied().collect();
    assert!(field_error(&large, &moved).relative_l2 > 1e-2);
}

#[test]
fn the_sweep_equals_its_twin() {
    let [engine, card] = both_ways();
    let grids = awkward_grids([20, 16, 12]);
    for (g, grid) in grids.into_iter().enumerate() {
        for (near, ratio) in [(1, 1), (1, 2), (2, 2), (3, 4), (2, 8)] {
            let volume = blobs(grid, 41 + g as u64);
            let matter = linear(0.8);
            let (_, medium) = load(&engine, &volume, &matter);
            let dims = grid.field_dims(ratio as usize);
            let device = engine.estimate(&medium, &settings(near, 29, ratio), &all(dims), &mut quiet).expect("estimate");
            // On a card lanes share the directions: where they have several each, sums are added in another order.
            let (_, on_card) = load(&card, &volume, &matter);
            let shared = |v: &Visibility| card.estimate(&on_card, v, &all(dims), &mut quiet).expect("estimate");
            let apart = field_error(&shared(&settings(near, 29, ratio)), &device).relative_l2;
            assert!(apart < 1e-6, "grid {g}, near {near}, 1:{ratio}: {apart}");
            if g == 0 {
                // Sabotage: lanes are really used.
                let v = settings(near, 150, ratio);
                let apart = field_error(&shared(&v), &engine.estimate(&medium, &v, &all(dims), &mut quiet).expect("estimate")).relative_l2;
                assert!(apart < 1e-6 && (apart > 0.0 || card.device().kind != DeviceKind::Cpu), "1:{ratio}: {apart}");
            }
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

/// Lanes share directions, and runs of tiles are swept whole, on separate cards: with void to carry through, every number of
/// bands, fitted and not.
#[test]
fn a_card_sweeps_the_same_field() {
    let [engine, card] = both_ways();
    for grid in awkward_grids([44, 36, 28]) {
        let n = grid.dims().map(|n| n as f64);
        // A ball in a corner: tiles of both kinds, and some of both in a slice.
        let volume = Volume::from_fn(grid, |p| {
            let d2: f64 = (0..3).map(|a| ((p[a] / n[a] - 0.3) * n[0] / 6.0).powi(2)).sum();
            (1.5 - d2).clamp(0.0, 1.0) as f32
        });
        let volume = volume.expect("a volume");
        let media = [&engine, &card].map(|e| load(e, &volume, &linear(0.8)).1);
        for (near, ratio, bands, fit) in [(1, 1, 4, 0), (2, 2, 4, 3), (3, 1, 3, 0), (2, 1, 2, 3), (1, 2, 1, 0)] {
            let v = Visibility { cells: Cells::Matter, bands, fit, directions: 70, ..settings(near, 70, ratio) };
            let [cpu, wide] = [(&engine, &media[0]), (&card, &media[1])].map(|(e, medium)| {
                let field = e.precompute(medium, &v, &mut quiet).expect("field");
                e.read_field(&field).expect("read")
            });
            let (difference, at) = worst(&cpu, &wide);
            assert!(cpu.iter().any(|c| *c != 0.0) && difference < 1e-4, "{near} 1:{ratio} {bands} bands, fit {fit}: {difference} at {at}");
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

#[test]
fn every_pass_is_a_valid_field_and_the_last_is_the_whole() {
    let engine = engine();
    let volume = blobs(Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid"), 9);
    let (_, medium) = load(&engine, &volume, &linear(0.8));
    let s = settings(2, 256, 2);
    let cells = all(volume.grid().field_dims(2));
    let dense = Visibility { method: Method::March, directions: 4096, step: 0.25, ..s.clone() };
    let truth = engine.estimate(&medium, &dense, &cells, &mut quiet).expect("march");
    let read = |field: &halflight::engine::Field| -> Vec<[f32; 16]> {
        engine.read_field(field).expect("read").chunks_exact(16).map(|c| c.try_into().expect("16")).collect()
    };
    let mut passes = Vec::new();
    let last = engine
        .refine(&medium, &s, &mut quiet, &mut |pass| {
            passes.push((pass.directions, field_error(&read(pass.field), &truth).relative_l2));
            std::ops::ControlFlow::Continue(())
        })
        .expect("refine");
    println!("passes: {passes:?}");
    assert_eq!(passes.iter().map(|p| p.0).collect::<Vec<_>>(), [32, 64, 128, 256]);
    // Directions cost their usual N^-3/4, and the beginning of a set a fifth more than a set of its own.
    for (n, e) in &passes {
        let own = engine.estimate(&medium, &Visibility { directions: *n, ..s.clone() }, &cells, &mut quiet).expect("sweep");
        let own = field_error(&own, &truth).relative_l2;
        assert!(*e < 1.25 * own, "{n} directions: {e}, a set of their own {own}");
    }
    // Down to the sweep's own error, which no direction removes.
    assert!(passes.windows(2).all(|p| p[1].1 < p[0].1) && passes[1].1 < 0.6 * passes[0].1, "{passes:?}");
    // The sums of all passes are those of one, in another order.
    let whole = read(&engine.precompute(&medium, &s, &mut quiet).expect("precompute"));
    assert!(field_error(&read(&last), &whole).relative_l2 < 1e-6);
    // Stopped early, the last finished pass is what is returned.
    let mut seen = 0;
    let first = engine.refine(&medium, &s, &mut quiet, &mut |pass| {
        seen = pass.directions;
        std::ops::ControlFlow::Break(())
    });
    let error = field_error(&read(&first.expect("refine")), &truth).relative_l2;
    assert!(seen == 32 && (error - passes[0].1).abs() < 1e-9);
    // Sabotage: without the correction the beginning of a set is further off.
    let rays = sweep::rays(256, volume.grid());
    let table = linear(0.8).transfer.table(volume.range(), volume.grid());
    let plain = sweep::reference(&volume, &table, volume.grid().field_dims(2), &rays[..32], sweep::Settings { near: 2, step_length: 0.5 });
    assert!(field_error(&plain, &truth).relative_l2 > 1.15 * passes[0].1);
}

#[test]
fn cells_nobody_reads_are_left_out_and_change_no_other() {
    let engine = engine();
    // A ball in a corner of a large empty box.
    let volume = Volume::from_fn(Grid::axis_aligned([64, 48, 40], [1.0; 3]).expect("grid"), |p| {
        let d = (p[0] - 14.0).hypot(p[1] - 12.0).hypot(p[2] - 11.0);
        if d < 8.0 { 1.0 } else { 0.0 }
    })
    .expect("volume");
    let (_, medium) = load(&engine, &volume, &linear(0.9));
    let small = ImageSettings { width: 64, height: 48, step: 0.5, ..ImageSettings::default() };
    for method in [Method::Sweep, Method::March, Method::Hierarchical] {
        // One slice: what is carried only is then swept as everything else.
        let all = Visibility { method, ..settings(1, 64, 2) };
        let near = Visibility { cells: Cells::Matter, ..all.clone() };
        let fields = [&all, &near].map(|s| engine.read_field(&engine.precompute(&medium, s, &mut quiet).expect("field")).expect("read"));
        let cells = fields[1].chunks_exact(16).zip(fields[0].chunks_exact(16));
        let computed = cells.clone().filter(|(near, _)| near.iter().any(|v| *v != 0.0)).count();
        assert!(computed > 1000 && computed < 32 * 24 * 20 / 3, "{computed}");
        for (near, all) in cells {
            assert!(near == all || near.iter().all(|v| *v == 0.0));
        }
        // And no picture sees the difference: the irradiance of the left cells lies in a smaller image, whose coordinates
        // are rounded elsewhere, by some 1e-6 of a texel.
        let pictures = [&all, &near].map(|s| {
            let field = engine.precompute(&medium, s, &mut quiet).expect("field");
            let lit = engine.relight(&field, &sky()).expect("light");
            engine.render(&medium, &lit, &halflight::demo::camera(volume.grid()), &small, &mut quiet).expect("picture")
        });
        let apart = |a: &Picture, b: &Picture| {
            let pairs = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened());
            pairs.map(|(a, b)| (a - b).abs()).fold(0f32, f32::max)
        };
        assert!(apart(&pictures[0], &pictures[1]) < 2e-5, "{}", apart(&pictures[0], &pictures[1]));
        // Sabotage: the same under a field that holds a smaller ball's cells only.
        let (_, less) = load(&engine, &volume, &homogeneous(0.0));
        let lit = engine.relight(&engine.precompute(&less, &near, &mut quiet).expect("field"), &sky()).expect("light");
        let dark = engine.render(&medium, &lit, &halflight::demo::camera(volume.grid()), &small, &mut quiet);
        assert!(apart(&dark.expect("picture"), &pictures[0]) > 1e-2);
    }
}
