//! The measured error of a field: formulas, the bootstrap's coverage, real fields of each estimator, and its way into the
//! file and back.

mod common;
use common::*;
use halflight::io::{read_nrrd_field, write_nrrd_field};
use halflight::measure::{self, Budget, Errors, Plan, Report, errors, field_error};
use halflight::scene::visibility::{Method, Sampling};
use halflight::scene::{Clip, Grid, Visibility, Volume};

/// Coefficients of a few cells, none like the other.
fn made_up(count: usize, seed: u64) -> Vec<[f32; 16]> {
    let mut random = Random(seed);
    (0..count).map(|_| std::array::from_fn(|i| (random.unit() - 0.3) / (1.0 + i as f32))).collect()
}

/// √Σ over the cells of the coefficients in `range`, squared.
fn norm(v: &[[f32; 16]], range: std::ops::Range<usize>) -> f64 {
    v.iter().flat_map(|v| &v[range.clone()]).map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt()
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

#[test]
fn injected_errors_are_found_where_they_are() {
    let truth = made_up(300, 1);
    // Band 1 ten per cent too large: its own error is 0.1, that of the whole 0.1·|v₁|/|v|.
    let mut v = truth.clone();
    v.iter_mut().for_each(|v| v[1..4].iter_mut().for_each(|c| *c *= 1.1));
    let e = errors(&v, &truth, 4);
    let expected = 0.1 * norm(&truth, 1..4) / norm(&truth, 0..16);
    assert!(near(e.bands[1].relative_l2, 0.1, 1e-6) && near(e.all.relative_l2, expected, 1e-6), "{e:?}");
    assert!([0, 2, 3].iter().all(|&l| e.bands[l].relative_l2 == 0.0 && e.bands[l].interval == [0.0; 2]));
    // The same error everywhere leaves no doubt of the band, but of its share.
    assert!(near(e.bands[1].interval[0], 0.1, 1e-6) && near(e.bands[1].interval[1], 0.1, 1e-6));
    assert!(e.all.interval[0] < expected && expected < e.all.interval[1]);
    assert_eq!(e.all, field_error(&v, &truth));
    // Of a field that keeps two bands: the rest is wrong altogether, and counts.
    v.iter_mut().for_each(|v| v[4..].fill(0.0));
    let e = errors(&v, &truth, 2);
    let kept = 0.1 * norm(&truth, 1..4) / norm(&truth, 0..4);
    let all = ((0.1 * norm(&truth, 1..4)).powi(2) + norm(&truth, 4..16).powi(2)).sqrt() / norm(&truth, 0..16);
    assert!(near(e.kept.relative_l2, kept, 1e-6) && near(e.all.relative_l2, all, 1e-6), "{e:?}");
    assert!([2, 3].iter().all(|&l| e.bands[l].relative_l2 == 1.0 && e.bands[l].interval == [1.0; 2]));
    // Sabotage: the same scaling one coefficient further is not what the formula says.
    let mut v = truth.clone();
    v.iter_mut().for_each(|v| v[2..5].iter_mut().for_each(|c| *c *= 1.1));
    let e = errors(&v, &truth, 4);
    assert!(!near(e.bands[1].relative_l2, 0.1, 1e-3) && e.bands[2].relative_l2 > 0.0);
    // Nothing to compare, nothing wrong; something against nothing is wrong without bound.
    assert_eq!(field_error(&[], &[]).relative_l2, 0.0);
    assert_eq!(field_error(&[[0.0; 16]], &[[0.0; 16]]).relative_l2, 0.0);
    assert_eq!(field_error(&[[1.0; 16]], &[[0.0; 16]]).relative_l2, f64::INFINITY);
}

#[test]
fn the_interval_covers_the_truth_nineteen_times_in_twenty() {
    // Reference (1, 0, …), error e in one coefficient with e² exponentially distributed of mean 0.01: the truth is 0.1.
    let mut random = Random(7);
    let (mut covered, mut narrowed) = (0, 0);
    let trials = 400;
    for _ in 0..trials {
        let truth = vec![std::array::from_fn(|i| if i == 0 { 1.0 } else { 0.0 }); 150];
        let mut v: Vec<[f32; 16]> = truth.clone();
        v.iter_mut().for_each(|v| v[5] = (-0.01 * (1.0 - random.unit()).max(1e-9).ln()).sqrt());
        let e = field_error(&v, &truth);
        let [lo, hi] = e.interval;
        covered += usize::from(lo <= 0.1 && 0.1 <= hi);
        let (middle, half) = (0.5 * (lo + hi), 0.25 * (hi - lo));
        narrowed += usize::from((0.1 - middle).abs() <= half);
    }
    let share = |n: usize| n as f64 / f64::from(trials);
    println!("95 % intervals cover {:.3}, of half their width {:.3}", share(covered), share(narrowed));
    // ±0.03 is three times the standard error of 400 trials; the percentile bootstrap itself falls a little short.
    assert!((0.91..=0.98).contains(&share(covered)), "{}", share(covered));
    // Sabotage: an interval of half the width covers two thirds.
    assert!(share(narrowed) < 0.80, "{}", share(narrowed));
}

fn scene() -> (Checked, Volume) {
    (engine(), blobs(Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid"), 3))
}

#[test]
fn probes_lie_within_two_cells_of_matter() {
    let engine = engine();
    // One voxel of matter.
    let grid = Grid::axis_aligned([40, 24, 32], [1.0; 3]).expect("grid");
    let volume = Volume::from_fn(grid, |p| if p.map(|c| c as usize) == [21, 3, 17] { 1.0 } else { 0.0 }).expect("volume");
    let (_, medium) = load(&engine, &volume, &linear(1.0));
    let near = measure::near_matter(&engine, &volume, &medium, 4).expect("cells");
    let dims = grid.field_dims(4);
    let expected: Vec<u32> = (0..dims.iter().product::<usize>())
        .filter(|i| {
            let at = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
            (0..3).all(|a| at[a].abs_diff([5usize, 0, 4][a]) <= 2)
        })
        .map(|i| i as u32)
        .collect();
    assert_eq!(near, expected);
    let some = measure::probes(&engine, &volume, &medium, 4, 20).expect("probes");
    assert!(some.len() == 20 && some.is_sorted() && some.iter().all(|c| near.contains(c)));
    assert_eq!(some, measure::probes(&engine, &volume, &medium, 4, 20).expect("probes"), "the same every time");
    // Sabotage: the next voxel lies in another cell.
    let moved = Volume::from_fn(grid, |p| if p.map(|c| c as usize) == [20, 4, 17] { 1.0 } else { 0.0 }).expect("volume");
    assert_ne!(measure::near_matter(&engine, &moved, &medium, 4).expect("cells"), expected);
}

/// What was cut away is no matter: its surroundings see the whole sky, are easy, and are looked at by nobody.
#[test]
fn probes_keep_away_from_matter_that_was_cut() {
    let engine = engine();
    let grid = Grid::axis_aligned([48, 16, 16], [1.0; 3]).expect("grid");
    // Two slabs, of which the clip box keeps the left one.
    let volume = Volume::from_fn(grid, |p| if p[0] < 8.0 || p[0] > 40.0 { 1.0 } else { 0.0 }).expect("volume");
    let uploaded = engine.upload(&volume).expect("upload");
    let near = |hi: f64| {
        let clip = Clip { bounds: Some([[0.0; 3], [hi, 1.0, 1.0]]), ..Clip::default() };
        let medium = engine.classify_clipped(&uploaded, &linear(1.0), &clip).expect("classify");
        let cells = measure::near_matter(&engine, &volume, &medium, 2).expect("cells");
        let settings = Visibility { ratio: 2, directions: 16, ..Visibility::default() };
        let plan = Plan::new(&engine, &volume, &medium, &settings, &Budget::default()).expect("plan");
        assert!(plan.cells.iter().all(|c| cells.contains(c)), "what measures a field looks there and nowhere else");
        cells
    };
    // Cells of two voxels: 4 of 24 columns hold matter, and two more lie near.
    let column = |c: &u32| (*c as usize) % 24;
    let expected = |columns: usize| (0..24 * 8 * 8).filter(|c| column(c) < columns).collect::<Vec<u32>>();
    assert_eq!(near(0.5), expected(6));
    // A plane at a voxel's face leaves nothing of the voxels behind it; one a quarter further in leaves some of the next column.
    assert_eq!(near(6.0 / 48.0), expected(5));
    assert_eq!(near(6.25 / 48.0), expected(6));
    // A slab too thin for any voxel's centre.
    assert_eq!(near(0.25 / 48.0), expected(3));
    // Sabotage: with nothing cut the right slab counts.
    assert!(near(1.0).iter().any(|c| column(c) > 20));
}

#[test]
fn real_fields_of_each_estimator_are_measured_as_they_are() {
    let (engine, volume) = scene();
    let (_, medium) = load(&engine, &volume, &linear(0.6));
    let plain = Visibility { ratio: 4, directions: 64, ..Visibility::default() };
    let cells = measure::probes(&engine, &volume, &medium, 4, 1024).expect("probes");
    let truth = measure::reference(&engine, &medium, 4, &cells, &mut quiet).expect("reference");
    let methods = [Method::March, Method::Hierarchical, Method::Sweep];
    for (i, method) in methods.into_iter().enumerate() {
        for (j, bits) in [8, 16, 32].into_iter().enumerate() {
            let settings = Visibility { method, bits, bands: [4, 3, 2][(i + j) % 3], ..plain.clone() };
            let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
            let kept = engine.read_field(&field).expect("read");
            let plan = Plan::new(&engine, &volume, &medium, &settings, &Budget::default()).expect("plan");
            assert_eq!(plan.cells, cells);
            let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
            // By hand, from the same parts.
            let estimate = engine.estimate(&medium, &settings, &cells, &mut quiet).expect("estimate");
            let before = report.before.expect("before packing");
            assert!(near(before.all.relative_l2, field_error(&estimate, &truth).relative_l2, 1e-6), "{method:?} {bits}: {report:?}");
            let again = measure::packed(&estimate, settings.bands, bits);
            let all = field_error(&again, &truth).relative_l2;
            // The field is what packing makes of the estimate, but for codes on an edge that rounded the other way.
            assert!(near(report.after.all.relative_l2, all, 1e-5), "{method:?} {bits}: {all} {report:?}");
            if bits == 32 {
                assert_eq!(before, report.after);
            }
            // What is not kept is wrong altogether, in both.
            for e in [&before, &report.after] {
                for l in settings.bands as usize..4 {
                    assert_eq!(e.bands[l].relative_l2, 1.0);
                }
                let (n, m) = (norm(&truth, 0..settings.coefficients()).powi(2), norm(&truth, settings.coefficients()..16).powi(2));
                let expected = ((e.kept.relative_l2.powi(2) * n + m) / (n + m)).sqrt();
                assert!(near(e.all.relative_l2, expected, 1e-9), "{method:?} {bits}");
                assert!(e.kept.relative_l2 > 1e-3 && e.kept.relative_l2 < 0.2, "{method:?} {bits}: {e:?}");
            }
            // 8 bits add about their quantum, 16 next to nothing.
            let cost = report.after.kept.relative_l2 - before.kept.relative_l2;
            assert!(cost.abs() < if bits == 8 { 0.01 } else { 1e-4 }, "{method:?} {bits}: {cost}");
            assert!(bits != 8 || cost.abs() > 1e-6, "8 bits do show: {cost}");
            // Sabotage: a field that is off by a twentieth in one coefficient does not measure the same.
            let mut off = kept.clone();
            off.iter_mut().step_by(settings.coefficients()).for_each(|v| *v *= 1.05);
            let worse = Report::measure(&engine, &medium, &field, &off, &plan, &mut quiet).expect("report").after;
            assert!(worse.bands[0].relative_l2 > report.after.bands[0].relative_l2 + 0.01, "{method:?} {bits}");
            assert_eq!(worse.bands[1..], report.after.bands[1..]);
            // Another field's numbers are refused.
            let wrong = Report::measure(&engine, &medium, &field, &kept[1..], &plan, &mut quiet).expect_err("too few");
            assert!(wrong.to_string().contains("coefficients of 120 cells are needed"), "{wrong}");
        }
    }
}

#[test]
fn the_reference_against_itself_is_right() {
    let (engine, volume) = scene();
    let (_, medium) = load(&engine, &volume, &linear(0.6));
    let settings = Visibility {
        method: Method::March,
        sampling: Sampling::Stratified,
        directions: measure::REFERENCE_DIRECTIONS,
        step: measure::REFERENCE_STEP,
        bits: 32,
        ratio: 8,
        ..Visibility::default()
    };
    let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
    let kept = engine.read_field(&field).expect("read");
    let plan = Plan::new(&engine, &volume, &medium, &settings, &Budget::default()).expect("plan");
    let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
    // How directions fall into dispatches changes the order of sums, no more.
    assert!(report.after.all.relative_l2 < 1e-5, "{report:?}");
    // That this is no proof of the reference is said, for people and programs.
    let said = "; the field is computed as its reference is, whose own error is not in it";
    assert!(report.as_reference && report.sentence().ends_with(said) && report.meta()[1].1.contains("\"as_reference\":true"), "{report:?}");
    // Sabotage: a tenth fewer directions are seen.
    let fewer = Visibility { directions: 3700, ..settings };
    let kept = engine.read_field(&engine.precompute(&medium, &fewer, &mut quiet).expect("field")).expect("read");
    let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
    assert!(report.after.all.relative_l2 > 1e-5, "{report:?}");
    // Its field was the reference's, the numbers are not; of another field nothing is said.
    let field = engine.precompute(&medium, &fewer, &mut quiet).expect("field");
    let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
    assert!(!report.as_reference && report.note().is_none() && !report.sentence().contains(said), "{}", report.sentence());
}

#[test]
fn the_budget_bounds_the_number_of_probes_and_nothing_else() {
    let (engine, volume) = scene();
    let (_, medium) = load(&engine, &volume, &linear(0.6));
    let settings = Visibility { ratio: 2, method: Method::Sweep, directions: 32, ..Visibility::default() };
    let plan = |seconds, field_seconds| Plan::new(&engine, &volume, &medium, &settings, &Budget { seconds, field_seconds }).expect("plan");
    let near = measure::near_matter(&engine, &volume, &medium, 2).expect("cells").len();
    let generous = plan(1e9, Some(2.0));
    assert_eq!(generous.cells.len(), near.min(1024));
    assert!(generous.before && generous.again == Some(2.0) && generous.seconds > 0.0);
    // Next to no time: the fewest, chosen as `probes` chooses them, and no second sweep.
    let hasty = plan(1e-6, Some(2.0));
    // A second sweep takes half of the budget at most, and the reference what that leaves.
    assert!(
        !plan(100.0, Some(50.5)).before && plan(100.0, Some(49.5)).before && plan(Budget::for_sweep(7.0), Some(7.0)).again == Some(7.0)
    );
    assert_eq!(hasty.cells, measure::probes(&engine, &volume, &medium, 2, 64).expect("probes"));
    assert!(!hasty.before && hasty.again.is_none() && hasty.seconds < generous.seconds);
    let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
    let kept = engine.read_field(&field).expect("read");
    let report = |plan: &Plan| Report::measure(&engine, &medium, &field, &kept, plan, &mut quiet).expect("report");
    let (a, b) = (report(&hasty), report(&hasty));
    assert_eq!((a.after, a.before, a.probes), (b.after, None, 64), "the same every time");
    assert!(a.table().iter().any(|l| l.contains("not measured")) && a.sentence().starts_with("not measured before packing"));
    // More probes, a narrower interval around the same.
    let all = report(&generous);
    let width = |e: &Errors| e.all.interval[1] - e.all.interval[0];
    assert!(width(&all.after) < width(&a.after));
    assert!(a.after.all.interval[0] < all.after.all.relative_l2 && all.after.all.relative_l2 < a.after.all.interval[1]);
}

#[test]
fn no_matter_no_measurement() {
    let (engine, volume) = scene();
    let (_, medium) = load(&engine, &volume, &homogeneous(0.0));
    let settings = Visibility { ratio: 8, directions: 8, ..Visibility::default() };
    let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
    let kept = engine.read_field(&field).expect("read");
    let plan = Plan::new(&engine, &volume, &medium, &settings, &Budget::default()).expect("plan");
    assert!(plan.cells.is_empty() && plan.seconds == 0.0);
    let report = Report::measure(&engine, &medium, &field, &kept, &plan, &mut quiet).expect("report");
    assert_eq!((report.probes, report.table().len()), (0, 0));
    assert!(report.sentence().contains("no cell lies near matter"));
}

#[test]
fn a_report_survives_the_header() {
    let truth = made_up(90, 4);
    let v = made_up(90, 5);
    let e = errors(&v, &truth, 3);
    let report = Report {
        probes: 90,
        fitted: false,
        as_reference: false,
        read: None,
        directions: 4096,
        step: 0.25,
        bands: 3,
        bits: 16,
        before: Some(e),
        after: e,
        seconds: 1.5,
    };
    let grid = Grid::axis_aligned([4, 4, 4], [1.0; 3]).expect("grid");
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("f.nrrd");
    write_nrrd_field(&path, [2, 2, 2], 9, &[0.5; 72], &grid, &report.meta()).expect("written");
    let mut meta = read_nrrd_field(&path, &Default::default()).expect("read").meta;
    // Numbers read from text may be off in their last bit.
    let figures = |r: &Report| {
        let list = |e: &Errors| {
            [e.all, e.kept, e.bands[0], e.bands[1], e.bands[2], e.bands[3]].map(|e| [e.relative_l2, e.interval[0], e.interval[1]])
        };
        [list(&r.before.expect("before packing")), list(&r.after)].concat().concat()
    };
    let back = Report::from_meta(&meta).expect("a report");
    assert!(figures(&back).iter().zip(figures(&report)).all(|(a, b)| near(*a, b, 1e-14)), "{back:?}");
    assert_eq!((back.probes, back.directions, back.step, back.bands, back.bits, back.seconds), (90, 4096, 0.25, 3, 16, 1.5));
    let line = &meta.iter().find(|(k, _)| k == "error").expect("a line for people").1;
    assert!(line.starts_with(&format!("{:.4} [", e.all.relative_l2)) && line.contains("90 probes"), "{line}");
    // Sabotage: one digit changed is another report; what is no report is none.
    let json = meta.iter_mut().find(|(k, _)| k == "error_json").expect("an object for programs");
    json.1 = json.1.replace("\"probes\":90", "\"probes\":91");
    assert_ne!(Report::from_meta(&meta), Some(back));
    for odd in ["", "{}", "[1", "{\"probes\":-1}", "null"] {
        assert_eq!(Report::from_meta(&[("error_json".into(), odd.into())]), None);
    }
    assert_eq!(Report::from_meta(&[]), None);
}

#[cfg(feature = "cli")]
mod cli {
    use super::common::run;
    use serde_json::Value;

    #[test]
    fn precompute_measures_says_and_stores_it() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 12 8\nencoding: raw\n\n".to_vec();
        bytes.extend((0..16 * 12 * 8).map(|i: i32| if (i % 16 - 8).abs() < 3 && (i / 192 - 4).abs() < 2 { 200u8 } else { 0 }));
        std::fs::write(f.join("v.nrrd"), bytes).unwrap();
        let scene = "volume.file = 'v.nrrd'\nvisibility.ratio = 2\nvisibility.directions = 32\nvisibility.bands = 3\n\
                     transfer.points = [[50, 1, 1, 1, 0], [150, 1, 1, 1, 0.5]]";
        std::fs::write(f.join("s.toml"), scene).unwrap();
        let (code, out, err) = run(f, &["precompute", "s.toml", "-o", "f.nrrd", "--measure"]);
        assert_eq!((code, err.as_str()), (0, ""), "{out}");
        for part in
            ["measuring  ", " probes × 4,096 directions, about ", "band 0 ", "band 3 (not kept)", "9 coefficients", "after (8 bits)"]
        {
            assert!(out.contains(part), "{part}: {out}");
        }
        let (_, info, _) = run(f, &["info", "f.nrrd"]);
        let row = out.lines().find(|l| l.contains("16 coefficients ")).unwrap();
        assert!(info.contains(row) && !info.contains("error_json"), "{info}");
        // The same cells, the same figures, as JSON, in the file, and from the library.
        let (code, out, _) = run(f, &["precompute", "s.toml", "-o", "g.nrrd", "--measure=30", "--json"]);
        assert_eq!(code, 0);
        let said: Value = serde_json::from_str(&out).unwrap();
        let meta = |name: &str| halflight::io::read_nrrd_field(&f.join(name), &Default::default()).unwrap().meta;
        let [a, b] = ["f.nrrd", "g.nrrd"].map(|name| halflight::measure::Report::from_meta(&meta(name)).unwrap());
        assert_eq!((a.after, a.before, a.probes), (b.after, b.before, b.probes));
        assert_eq!(said["field_error"]["after"], serde_json::to_value(b.after).unwrap());
        let info: Value = serde_json::from_str(&run(f, &["info", "g.nrrd", "--json"]).1).unwrap();
        let all = |v: &Value| v["field_error"]["after"]["all"]["relative_l2"].as_f64().unwrap();
        assert!((all(&info) - all(&said)).abs() < 1e-14 && info["field_error"]["probes"] == said["field_error"]["probes"]);
        // Sabotage: another estimate is another error.
        run(f, &["precompute", "s.toml", "-o", "h.nrrd", "--measure", "--visibility.directions", "16"]);
        assert_ne!(halflight::measure::Report::from_meta(&meta("h.nrrd")).unwrap().after, b.after);
        // Not asked for, not there; nonsense is refused.
        run(f, &["precompute", "s.toml", "-o", "n.nrrd"]);
        assert!(meta("n.nrrd").iter().all(|(k, _)| !k.starts_with("error")));
        for odd in ["--measure=0", "--measure=-3", "--measure=nan", "--measure=x"] {
            let (code, _, err) = run(f, &["precompute", "s.toml", "-o", "x.nrrd", odd]);
            assert!(code == 2 && err.contains("a number of seconds above 0"), "{odd}: {err}");
        }
        let (code, out, _) = run(f, &["precompute", "s.toml", "-o", "e.nrrd", "--measure", "--transfer.points", "[[0, 1, 1, 1, 0]]"]);
        assert!(code == 0 && out.contains("not measured: no cell lies near matter"), "{out}");
    }
}
