//! The fit: points, what they see, the equations' solution, and that pictures come closer to the truth by it.

mod common;
use common::*;
use halflight::engine::{FitPoints, Medium};
use halflight::measure::{Budget, Plan, Report, field_error};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Cells, Method};
use halflight::scene::{Grid, Matter, Surface, Transfer, Visibility, Volume};
use halflight::stages::{fit, pack, sweep, twin};
use halflight::vk::DeviceKind;

fn settings(fit: u32, ratio: u32) -> Visibility {
    Visibility { method: Method::Sweep, ratio, directions: 32, fit, bits: 32, step: 0.5, ..Visibility::default() }
}

/// A hollow ball: its wall is 3 voxels thick, opaque where `sigma` is large.
fn shell(n: usize, sigma: f64) -> (Volume, Matter) {
    let grid = Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid");
    let radius = |p: [f64; 3]| p.iter().map(|c| (c - n as f64 / 2.0).powi(2)).sum::<f64>().sqrt();
    let volume = Volume::from_fn(grid, |p| (1.0 - (radius(p) - 0.35 * n as f64).abs() / 2.5).clamp(0.0, 1.0) as f32).expect("volume");
    let points = [[0.2, 1.0, 1.0, 1.0, 0.0], [0.5, 1.0, 1.0, 1.0, sigma]];
    let transfer = Transfer::from_points(&points, Kind::Extinction, Reference::World).expect("transfer");
    (volume, Matter { transfer, surface: None })
}

fn points(engine: &Checked, medium: &Medium, settings: &Visibility) -> FitPoints {
    engine.fit_points(medium, settings, &mut quiet).expect("points")
}

#[test]
fn points_lie_in_matter_and_stand_for_all_of_it() {
    let engine = engine();
    let (volume, matter) = shell(40, 1.5);
    let (_, medium) = load(&engine, &volume, &matter);
    let table = matter.transfer.table(volume.range(), volume.grid());
    let alpha = |p: [f32; 3]| 1.0 - f64::from(-twin::extinction(&table, twin::sample(&volume, p))).exp();
    let found = points(&engine, &medium, &settings(8, 4));
    assert!(found.places.len() > 500 && found.places.len().is_multiple_of(8));
    assert!(found.places.iter().all(|&p| alpha(p) > 0.0), "each lies in matter");
    // Eight in a row share a box.
    for of in found.places.chunks_exact(8) {
        assert!(of.iter().all(|p| (0..3).all(|a| (p[a] / 4.0).floor() == (of[0][a] / 4.0).floor())));
    }
    // Importance sampling: the weights' sum estimates the opacity of all candidates, 64 to a box of 64 voxels here.
    let whole: f64 = (0..volume.grid().voxels() as usize).map(|i| alpha([i % 40, i / 40 % 40, i / 1600].map(|c| c as f32 + 0.5))).sum();
    let sum: f64 = found.weights.iter().map(|w| f64::from(*w)).sum();
    println!("opacity of {} points {sum:.0}, of all voxels {whole:.0}", found.weights.len());
    assert!((sum / whole - 1.0).abs() < 0.05, "{sum} {whole}");
    // What is exposed is drawn more often than what lies deep: points stand on average for less in front of the wall's middle.
    let deep = |p: &[f32; 3]| (p.iter().map(|c| (c - 20.0) * (c - 20.0)).sum::<f32>().sqrt() - 14.0).abs() < 0.5;
    let mean = |deep_ones: bool| {
        let of: Vec<f32> = found.places.iter().zip(&found.weights).filter(|(p, _)| deep(p) == deep_ones).map(|(_, w)| *w).collect();
        of.iter().sum::<f32>() / of.len() as f32
    };
    assert!(mean(true) > 1.2 * mean(false), "{} {}", mean(true), mean(false));
    // Everywhere alike, a point stands for its share of the candidates' opacity.
    let (_, fog) = load(&engine, &volume, &homogeneous(0.3));
    for w in points(&engine, &fog, &settings(4, 4)).weights {
        assert!((w / (16.0 * (1.0 - (-0.3f32).exp())) - 1.0).abs() < 1e-4, "{w}");
    }
    // Nothing of vacuum.
    let (_, vacuum) = load(&engine, &volume, &homogeneous(0.0));
    assert!(points(&engine, &vacuum, &settings(8, 4)).places.is_empty());
}

#[test]
fn what_points_see_equals_the_twin() {
    let [engine, card] = both_ways();
    for (g, grid) in awkward_grids([20, 16, 12]).into_iter().enumerate() {
        for (near, ratio) in [(1, 2), (2, 2), (1, 4), (2, 8), (1, 1)] {
            let volume = blobs(grid, 51 + g as u64);
            let matter = linear(0.8);
            let (_, medium) = load(&engine, &volume, &matter);
            let device = points(&engine, &medium, &Visibility { near, ..settings(3, ratio) });
            // On a card lanes share the directions: where they have several each, sums are added in another order.
            let (_, on_card) = load(&card, &volume, &matter);
            let v = Visibility { near, ..settings(3, ratio) };
            let apart = field_error(&points(&card, &on_card, &v).seen, &device.seen).relative_l2;
            assert!(apart < 1e-6, "grid {g}, near {near}, 1:{ratio}: {apart}");
            if g == 0 {
                // Sabotage: lanes are really used.
                let v = Visibility { directions: 150, ..v };
                let apart = field_error(&points(&card, &on_card, &v).seen, &points(&engine, &medium, &v).seen).relative_l2;
                assert!(apart < 1e-6 && (apart > 0.0 || card.device().kind != DeviceKind::Cpu), "1:{ratio}: {apart}");
            }
            let table = matter.transfer.table(volume.range(), &grid);
            let (dims, rays) = (grid.field_dims(ratio as usize), sweep::rays(32, &grid));
            let twin = |near| {
                let settings = sweep::Settings { near, step_length: 0.5 * grid.voxel_length() };
                let weight = 4.0 * std::f32::consts::PI / 32.0;
                let seen = fit::reference_seen(&volume, &table, dims, &rays, settings, &device.places, &[]);
                seen.iter().map(|v| v.map(|c| weight * c)).collect::<Vec<_>>()
            };
            let e = field_error(&device.seen, &twin(near)).relative_l2;
            // Single precision, the device's filter weights, and points on the face of a box.
            assert!(e < 1e-3, "grid {g}, near {near}, 1:{ratio}: {e}");
            if g == 0 && ratio < 4 {
                // Sabotage: another near field is told apart.
                assert!(field_error(&device.seen, &twin(near + 1)).relative_l2 > 1e-3);
            }
        }
    }
}

#[test]
fn the_solution_comes_close_to_the_least_of_its_objective() {
    let engine = engine();
    let (volume, matter) = shell(36, 1.0);
    let (_, medium) = load(&engine, &volume, &matter);
    for ratio in [2, 4] {
        let asked = settings(8, ratio);
        let dims = volume.grid().field_dims(ratio as usize);
        let cells: Vec<u32> = (0..dims.iter().product::<usize>() as u32).collect();
        let estimate = |s: &Visibility| engine.estimate(&medium, s, &cells, &mut quiet).expect("estimate");
        let (own, fitted) = (estimate(&Visibility { fit: 0, ..asked.clone() }), estimate(&asked));
        let found = points(&engine, &medium, &asked);
        for c in [0, 1, 2, 6, 12] {
            let column = |v: &[[f32; 16]]| v.iter().map(|v| f64::from(v[c])).collect::<Vec<_>>();
            let of = |i: usize| {
                let q = found.places[i].map(|p| p / ratio as f32 - 0.5);
                let share = f64::from(found.seen[i][0]) / (2.0 * std::f64::consts::PI.sqrt());
                (q, f64::from(found.weights[i]) * share.clamp(0.0, 1.0), f64::from(found.seen[i][c]))
            };
            let system: Vec<_> = (0..found.places.len()).map(of).collect();
            let (own, fitted) = (column(&own), column(&fitted));
            let least = fit::reference_solution(dims, &system, &own);
            let value = |x: &[f64]| fit::objective(dims, &system, &own, x);
            let [first, got, best] = [value(&own), value(&fitted), value(&least)];
            println!("1:{ratio}, coefficient {c}: {first:.3} before, {got:.3} fitted, {best:.3} at least");
            assert!(best < 0.5 * first, "there is something to gain");
            // Eight iterations leave what the points hardly tell.
            assert!(got >= best * (1.0 - 1e-6) && got - best < 0.06 * (first - best), "1:{ratio}, coefficient {c}");
            // Sabotage: what a neighbour in memory should be is no solution.
            let mut moved = fitted.clone();
            moved.rotate_right(1);
            assert!(value(&moved) - best > 0.06 * (first - best));
        }
    }
}

#[test]
fn pictures_read_a_fitted_field_closer_to_the_truth() {
    let engine = engine();
    let (volume, matter) = shell(48, 2.0);
    let (_, medium) = load(&engine, &volume, &matter);
    for bits in [8, 32] {
        let read = |fit: u32| {
            let settings = Visibility { bits, directions: 128, ..settings(fit, 4) };
            let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
            let kept = engine.read_field(&field).expect("read");
            let plan = Plan::new(&engine, &volume, &medium, &settings, &Budget { seconds: 3.0, field_seconds: Some(0.1) }).expect("plan");
            let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
            assert_eq!((report.fitted, report.before.is_some()), (fit > 0, fit == 0 || bits == 32));
            (report.read.expect("matter"), report)
        };
        let ((plain, before), (fitted, after)) = (read(0), read(8));
        println!("{bits} bits: as pictures read {:.3} plain, {:.3} fitted", plain.relative_l2, fitted.relative_l2);
        // The wall is thinner than a cell: four bands between two cells cannot follow all of it.
        assert!(fitted.relative_l2 < 0.65 * plain.relative_l2 && fitted.interval[1] < plain.interval[0]);
        // What is seen at cells' centres says nothing of it.
        assert!(before.after.all.relative_l2 < 0.6 * plain.relative_l2);
        assert_eq!(after.after.all, fitted);
        let again = Report::from_meta(&after.meta()).expect("in the header");
        assert_eq!((again.fitted, again.probes), (true, after.probes));
    }
}

#[test]
fn what_is_smooth_stays_as_it_is_and_runs_repeat() {
    let engine = engine();
    let volume = blobs(Grid::axis_aligned([24, 20, 16], [1.0, 0.5, 2.0]).expect("grid"), 7);
    let (_, thin) = load(&engine, &volume, &homogeneous(1e-4));
    let cells: Vec<u32> = (0..volume.grid().field_dims(4).iter().product::<usize>() as u32).collect();
    let estimate = |medium: &Medium, s: &Visibility| engine.estimate(medium, s, &cells, &mut quiet).expect("estimate");
    let e = field_error(&estimate(&thin, &settings(8, 4)), &estimate(&thin, &settings(0, 4))).relative_l2;
    assert!(e < 1e-3, "the whole sky is seen from everywhere: {e}");
    let (_, medium) = load(&engine, &volume, &linear(2.0));
    let (one, two) = (estimate(&medium, &settings(8, 4)), estimate(&medium, &settings(8, 4)));
    assert_eq!(one, two);
    assert!(field_error(&one, &estimate(&medium, &settings(0, 4))).relative_l2 > 1e-2, "here it makes a difference");
    assert!(one.iter().flatten().all(|v| v.is_finite()));
    // Fewer bands are the first of all but for rounding: their kernels are other programs.
    for bands in 1..4u32 {
        let some = estimate(&medium, &Visibility { bands, ..settings(8, 4) });
        let kept = (bands * bands) as usize;
        let off = some.iter().zip(&one).flat_map(|(a, b)| a[..kept].iter().zip(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5 && some.iter().all(|v| v[kept..].iter().all(|v| *v == 0.0)), "{bands} bands: {off}");
    }
    // Little memory makes smaller batches, whose sums round otherwise.
    let all = Visibility { cells: Cells::All, ..settings(8, 4) };
    assert!(field_error(&estimate(&medium, &all), &one).relative_l2 < 0.05);
}

#[test]
fn passes_are_valid_and_the_last_is_the_field() {
    let engine = engine();
    let (volume, matter) = shell(40, 2.0);
    let (_, medium) = load(&engine, &volume, &matter);
    let settings = Visibility { directions: 128, bits: 16, ..settings(8, 4) };
    let mut passes = Vec::new();
    let last = engine
        .refine(&medium, &settings, &mut quiet, &mut |pass| {
            passes.push((pass.directions, engine.read_field(pass.field).expect("read")));
            std::ops::ControlFlow::Continue(())
        })
        .expect("field");
    let last = engine.read_field(&last).expect("read");
    let whole = engine.precompute(&medium, &settings, &mut quiet).expect("field");
    let as_sums = |v: &[f32]| v.chunks_exact(16).map(|c| std::array::from_fn(|i| c[i])).collect::<Vec<[f32; 16]>>();
    let error = |v: &[f32]| field_error(&as_sums(v), &as_sums(&last)).relative_l2;
    assert_eq!(passes.iter().map(|p| p.0).collect::<Vec<_>>(), [32, 64, 128]);
    assert_eq!(passes[2].1, last);
    assert!(error(&engine.read_field(&whole).expect("read")) < 1e-3);
    println!("32 and 64 of 128 directions: {:.3}, {:.3}", error(&passes[0].1), error(&passes[1].1));
    assert!(error(&passes[0].1) < 0.25 && error(&passes[1].1) < error(&passes[0].1));
}

#[test]
fn wide_ranges_hold_twice_as_much_and_zero_exactly() {
    let v: [f32; 16] = std::array::from_fn(|i| if i == 0 { -1.7 } else { 1.9 * (i as f32 * 0.8).sin() });
    for bits in [8, 16, 32] {
        let back = pack::decode(&pack::reference(&v, 4, bits, true), bits, true);
        let worst = v.iter().zip(back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // Half of the largest step: 2√π/127, and ranges up to 1.54 in steps of 2·1.54/127.
        assert!(worst <= [0.014, 6e-5, 0.0][(bits / 16) as usize], "{bits} bits: {worst}");
        assert_eq!(pack::decode(&pack::reference(&[0.0; 16], 4, bits, true), bits, true), [0.0; 16]);
        // Sabotage: the narrow code cuts it off.
        let narrow = pack::decode(&pack::reference(&v, 4, bits, false), bits, false);
        assert!(bits == 32 || narrow[0] == 0.0);
    }
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    let engine = engine();
    let (volume, matter) = shell(16, 1.0);
    let (_, medium) = load(&engine, &volume, &matter);
    let refused =
        |medium: &Medium, s: &Visibility| engine.precompute(medium, s, &mut quiet).err().map(|e| e.to_string()).unwrap_or_default();
    for method in [Method::March, Method::Hierarchical] {
        let sentence = refused(&medium, &Visibility { method, ..settings(8, 4) });
        assert!(sentence.contains("visibility.fit") && sentence.contains("sweep"), "{sentence}");
    }
    assert!(refused(&medium, &settings(65, 4)).contains("0 to 64"));
    let (_, solid) = load(&engine, &volume, &surface(Surface { iso: 0.5, shading: Default::default(), albedo: None }));
    assert!(refused(&solid, &settings(8, 4)).contains("isosurface"));
}

/// lavapipe binds 128 MiB as one buffer; the equations take 108 bytes a cell that is read.
#[test]
fn a_fit_that_no_buffer_holds_is_refused_before_the_sweep() {
    let engine = engine();
    let range = engine.device().max_storage_range;
    if range > 1 << 28 {
        println!("{} binds {range} bytes as one buffer: nothing to refuse", engine.device().name);
        return;
    }
    let n = 112;
    let grid = Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid");
    let volume = Volume::from_fn(grid, |p| p[0].rem_euclid(2.0) as f32).expect("volume");
    let (_, medium) = load(&engine, &volume, &linear(0.05));
    let settings = Visibility { bands: 1, bits: 8, directions: 6, fit: 1, ..settings(1, 1) };
    let mut stages = Vec::new();
    let refused = engine.precompute(&medium, &settings, &mut |stage, fraction| {
        stages.push((stage, fraction));
        std::ops::ControlFlow::Continue(())
    });
    let said = refused.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("visibility.fit") && said.contains("equations take") && said.contains("coarser ratio"), "{said}");
    assert!(stages.iter().all(|(_, fraction)| *fraction == 0.0), "it was swept before: {stages:?}");
    // Sabotage: without the fit it is computed.
    engine.precompute(&medium, &Visibility { fit: 0, ..settings }, &mut quiet).expect("without a fit");
}
