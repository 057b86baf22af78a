//! The plan: its promise against the full reference, what it obeys and refuses, and bands that no light asks for.

mod common;
use common::*;
use halflight::measure;
use halflight::plan::{self, Request};
use halflight::scene::visibility::{Cells, Method, Quality, Wanted};
use halflight::scene::{Grid, ImageSettings, Light, Matter, Probe, Shading, Surface, Visibility, Volume};

fn request(wanted: Wanted) -> Request {
    Request { wanted, ratio: None, bits: None, bands: 4, cells: Cells::Matter, pixels: None }
}

/// A machine on which a cell takes so many seconds a direction in steps of a voxel, and a sweep ten times what 512 cells do.
fn paced(second: f64) -> impl Fn(&Visibility, usize) -> f64 {
    move |s, cells| {
        let cells = if s.method == Method::Sweep { 5120 } else { cells };
        second * f64::from(s.directions) * cells as f64 / f64::from(s.step)
    }
}

/// The error over the kept coefficients of a planned field's data, at cells of `measure`'s, against the full reference.
fn verdict(engine: &Checked, volume: &Volume, medium: &halflight::engine::Medium, s: &Visibility, data: &[f32]) -> f64 {
    let cells = measure::probes(engine, volume, medium, s.ratio, 256).expect("probes");
    let truth = measure::reference(engine, medium, s.ratio, &cells, &mut quiet).expect("reference");
    let kept = s.coefficients();
    let at = |&c: &u32| std::array::from_fn(|i| if i < kept { data[c as usize * kept + i] } else { 0.0 });
    let v: Vec<[f32; 16]> = cells.iter().map(at).collect();
    measure::errors(&v, &truth, s.bands).kept.relative_l2
}

fn keeps_its_promise(volume: &Volume, matter: &Matter) {
    let engine = engine();
    let (_, medium) = load(&engine, volume, matter);
    let mut costs = Vec::new();
    for tolerance in [0.12, 0.05, 0.02] {
        let mut plan = plan::choose(&engine, volume, &medium, &request(Wanted::Tolerance(tolerance)), &mut quiet).expect("plan");
        let said = plan.clone();
        let made = plan.compute(&engine, &medium, &mut |_| (), &mut quiet).expect("field");
        let e = verdict(&engine, volume, &medium, &plan.settings, &made.data);
        println!("{tolerance}: {}; predicted {:?}, verified {:?}, measured {e:.4}", plan.chosen(), said.predicted, made.error);
        // Other cells and the full reference: the promise holds.
        assert!(e <= tolerance, "{tolerance}: {e}");
        assert!(made.error.relative_l2 <= tolerance && (made.error.interval[1] <= tolerance || made.missed.len() == 2));
        assert!(said.predicted.relative_l2 <= tolerance);
        // The bound that is said beforehand; how well a busy machine keeps it is no matter of a test.
        println!("planning took {:.2} s of at most about {:.2} s", said.planning_seconds, said.planning_limit);
        assert!(said.planning_limit >= plan::FLOOR_SECONDS);
        assert!(said.seconds >= 0.0 && said.need.peak() > made.field.bytes() && !said.reasons.is_empty() && said.probes() > 0);
        // Taps: slices of `ratio` voxels at so many cells.
        let s = &plan.settings;
        let cells = f64::from(s.ratio).powi(-3);
        costs.push(f64::from(s.directions) * f64::from(s.near * s.ratio) / f64::from(s.step) * cells);
        // Sabotage: with an eighth of the directions the same settings do not keep it.
        let few = Visibility { directions: (plan.settings.directions / 8).max(2), ..plan.settings.clone() };
        let field = engine.precompute(&medium, &few, &mut quiet).expect("field");
        let worse = verdict(&engine, volume, &medium, &few, &engine.read_field(&field).expect("read"));
        assert!(worse > tolerance, "{tolerance}: {worse} with {} directions", few.directions);
    }
    assert!(costs.is_sorted(), "no more work than the tolerance needs: {costs:?}");
}

#[test]
fn the_tolerance_is_met_on_blobs() {
    keeps_its_promise(&blobs(Grid::axis_aligned([40, 36, 32], [1.0; 3]).expect("grid"), 5), &linear(0.5));
}

#[test]
fn the_tolerance_is_met_on_the_demo() {
    keeps_its_promise(&halflight::demo::volume(32).expect("volume"), &halflight::demo::dvr().expect("matter"));
}

#[test]
fn what_is_settled_is_obeyed_and_what_is_out_of_reach_is_said() {
    let engine = engine();
    let volume = blobs(Grid::axis_aligned([40, 36, 32], [1.0; 3]).expect("grid"), 3);
    let (_, medium) = load(&engine, &volume, &linear(0.4));
    let pinned = Request { ratio: Some(4), bits: Some(16), bands: 2, ..request(Wanted::Quality(Quality::Draft)) };
    let mut plan = plan::choose(&engine, &volume, &medium, &pinned, &mut quiet).expect("plan");
    assert_eq!((plan.settings.ratio, plan.settings.bits, plan.settings.bands), (4, 16, 2));
    assert_eq!(plan.tolerance, 0.12);
    let made = plan.compute(&engine, &medium, &mut |_| (), &mut quiet).expect("field");
    assert_eq!(made.field.settings(), &plan.settings);
    // The same figures every time; only how many cells there are, and how dense the reference is, is a matter of time.
    let free = request(Wanted::Tolerance(0.05));
    let at = |second: f64| plan::choose_at(&engine, &volume, &medium, &free, Some(&paced(second)), &mut quiet).expect("plan");
    let [a, b, slow] = [1e-7, 1e-7, 2e-5].map(at);
    assert!(!a.tried.is_empty() && a.tried == b.tried && a.settings == b.settings && a.predicted == b.predicted);
    assert_eq!((a.probes(), a.reference(), &a.reasons), (b.probes(), b.reference(), &b.reasons));
    // Sabotage: a slow machine measures other cells.
    assert!(slow.probes() < a.probes() && slow.tried != a.tried, "{} {}", slow.probes(), a.probes());
    // A thin volume takes a finer field.
    assert!(a.settings.ratio == 2, "{}", a.chosen());
    let eight = Request { bits: Some(8), ..request(Wanted::Tolerance(0.002)) };
    let e = plan::choose(&engine, &volume, &medium, &request(Wanted::Tolerance(0.0005)), &mut quiet).map(|_| ()).expect_err("too small");
    assert!(e.to_string().contains("it must lie in 0.001..1"), "{e}");
    let e = plan::choose(&engine, &volume, &medium, &eight, &mut quiet).map(|_| ()).expect_err("out of reach").to_string();
    assert!(e.starts_with("visibility.tolerance: ") && e.contains("out of reach") && e.contains("or more"), "{e}");
    // Nothing there: nothing to measure.
    let (_, vacuum) = load(&engine, &volume, &linear(0.0));
    let mut plan = plan::choose(&engine, &volume, &vacuum, &free, &mut quiet).expect("plan");
    assert_eq!(plan.compute(&engine, &vacuum, &mut |_| (), &mut quiet).expect("field").error.relative_l2, 0.0);
}

/// Few directions meet thin, scattered matter, and a first reference turns out too coarse. The second is as dense as it must be, at
/// as many cells as there is time for.
#[test]
fn a_second_reference_looks_at_the_time_that_is_left() {
    let engine = engine();
    let grid = Grid::axis_aligned([64; 3], [1.0; 3]).expect("grid");
    let chance = |p: [f64; 3]| {
        let mut random = Random(p.iter().fold(11, |a, c| a * 64 + *c as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        random.unit();
        random.unit()
    };
    let specks = Volume::from_fn(grid, |p| if chance(p) < 1.0 / 300.0 { 1.0 } else { 0.0 }).expect("volume");
    let (_, medium) = load(&engine, &specks, &linear(1.0));
    let asked = Request { ratio: Some(4), ..request(Wanted::Tolerance(0.03)) };
    let [fast, short, slow] = [1e-8, 1e-6, 1e-5]
        .map(|second| plan::choose_at(&engine, &specks, &medium, &asked, Some(&paced(second)), &mut quiet).expect("plan"));
    let longer = |p: &plan::Plan| p.reasons.iter().any(|r| r.starts_with("planning took longer than it should: to judge 0.03 takes a"));
    for p in [&fast, &short, &slow] {
        println!("{} cells × {} directions: {:.1} of {:.1} s", p.probes(), p.reference().directions, p.planning_seconds, p.planning_limit);
        assert!(p.planning_seconds <= p.planning_limit || longer(p), "{:?}", p.reasons);
    }
    // Marches of few directions are judged once more where there was a second reference.
    let marches = |p: &plan::Plan| p.tried.iter().filter(|t| t.settings.method == Method::March).count();
    assert!(marches(&short) == 4 && fast.reference() == short.reference(), "{:?}", short.tried);
    assert!(fast.probes() == 512 && short.probes() < 512 && !longer(&short), "{}", short.probes());
    // Where even the fewest take longer, that is said.
    assert!(slow.probes() == 96 && longer(&slow), "{:?}", slow.reasons);
}

/// Cells as fine as the light's change between them asks for: coarse in a wide haze, fine beside thin walls and on surfaces.
#[test]
fn the_ratio_follows_what_a_field_misses_between_its_cells() {
    let engine = engine();
    let grid = Grid::axis_aligned([128; 3], [1.0; 3]).expect("grid");
    let apart = |p: [f64; 3]| p.iter().map(|c| (c - 64.0).powi(2)).sum::<f64>().sqrt();
    let haze = Volume::from_fn(grid, |p| (-(apart(p) / 40.0).powi(2)).exp() as f32).expect("volume");
    let shell = Volume::from_fn(grid, |p| (2.0 - (apart(p) - 40.0).abs()).clamp(0.0, 1.0) as f32).expect("volume");
    let ball = Surface { iso: 0.5, shading: Shading::Lambert, albedo: None };
    let cases = [(&haze, linear(0.01), 0.1), (&haze, linear(0.01), 0.02), (&shell, linear(2.0), 0.1), (&haze, surface(ball), 0.05)];
    let ratios = cases.map(|(volume, matter, tolerance)| {
        let (_, medium) = load(&engine, volume, &matter);
        let plan = plan::choose(&engine, volume, &medium, &request(Wanted::Tolerance(tolerance)), &mut quiet).expect("plan");
        println!("{tolerance}: {}", plan.reasons[0]);
        assert!(plan.reasons[0].contains("between its cells a field is off by "), "{:?}", plan.reasons);
        // What it says it misses is within the tolerance, or it is the finest.
        let missed = plan.between.expect("measured");
        assert_ne!(missed <= tolerance, plan.reasons[0].contains("to be asked for"), "{missed}");
        assert!(missed <= tolerance || plan.settings.ratio == 2);
        plan.settings.ratio
    });
    assert!(ratios[0] == 8 && ratios[1] <= ratios[0] && ratios[2] == 2 && ratios[3] < 8, "{ratios:?}");
}

#[test]
fn bands_that_the_light_does_not_ask_for_do_not_show() {
    let surface = |shading| Some(Surface { iso: 0.4, shading, albedo: None });
    let white = Light::constant([1.0; 3]);
    let lamps = Light::from_probe(&Probe::two_colored());
    assert_eq!(plan::needed_bands(&white, None), 1);
    assert_eq!(plan::needed_bands(&white, surface(Shading::Isotropic).as_ref()), 1);
    assert_eq!(plan::needed_bands(&white, surface(Shading::Lambert).as_ref()), 3);
    assert_eq!(plan::needed_bands(&lamps, None), 4);
    assert_eq!(plan::needed_bands(&lamps.bands(2), None), 2);
    assert_eq!(plan::needed_bands(&lamps.bands(2), surface(Shading::Lambert).as_ref()), 4);
    assert_eq!(plan::needed_bands(&Light::DARK, None), 1);

    let engine = engine();
    let volume = halflight::demo::volume(32).expect("volume");
    let camera = halflight::demo::camera(volume.grid());
    let image = ImageSettings { width: 96, height: 72, ..ImageSettings::default() };
    let opaque = |shading| Matter { transfer: halflight::demo::dvr().expect("matter").transfer, surface: surface(shading) };
    let matters = [halflight::demo::dvr().expect("matter"), opaque(Shading::Isotropic), opaque(Shading::Lambert)];
    for (matter, light) in matters.iter().zip([white; 3]).chain([(&matters[0], lamps.bands(2))]) {
        let (_, medium) = load(&engine, &volume, matter);
        let picture = |bands| {
            let settings = Visibility { method: Method::Sweep, directions: 64, bands, ..Visibility::default() };
            let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
            let lit = engine.relight(&field, &light).expect("lit");
            engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture")
        };
        let needed = plan::needed_bands(&light, matter.surface.as_ref());
        assert!(needed < 4);
        let (all, few) = (picture(4), picture(needed));
        let rmse = measure::relative_rmse(&few, &all).expect("comparable");
        println!("{needed} bands in place of 4: relative RMSE {rmse:.2e}");
        assert!(rmse <= 1e-3, "{needed} bands: {rmse}");
        // Sabotage: one fewer does show.
        if needed > 1 {
            assert!(measure::relative_rmse(&picture(needed - 1), &all).expect("comparable") > 2e-3);
        }
    }
}

#[test]
#[cfg(feature = "cli")]
fn the_command_says_the_plan_and_writes_what_it_chose() {
    let folder = std::env::temp_dir().join(format!("halflight-plan-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("folder");
    let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n".to_vec();
    let inside = |i: usize| [i % 24, i / 24 % 24, i / 576].iter().all(|&c| (6..18).contains(&c));
    bytes.extend((0..24 * 24 * 24).map(|i| if inside(i) { 200u8 } else { 0 }));
    std::fs::write(folder.join("v.nrrd"), bytes).expect("volume");
    std::fs::write(folder.join("s.toml"), "[volume]\nfile = 'v.nrrd'\n[visibility]\nmethod = 'march'\ndirections = 9").expect("scene");
    let run = |arguments: &[&str]| {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight")).current_dir(&folder).args(arguments).output().expect("run");
        (out.status.code(), String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr))
    };
    // The command line's tolerance displaces the file's method; the header holds what was chosen.
    let (code, text) = run(&["precompute", "s.toml", "-o", "f.nrrd", "--tolerance", "0.1", "--visibility.ratio", "2"]);
    assert_eq!(code, Some(0), "{text}");
    for part in
        ["if that is more; longer only where", "plan ", "predicted ", "because ", "planning ", "verified ", "1:2 as asked", "together"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
    let header = String::from_utf8_lossy(&std::fs::read(folder.join("f.nrrd")).expect("field")).into_owned();
    assert!(!header.contains("tolerance = ") && !header.contains("directions = 9\\n"), "the chosen settings stand there");
    let (code, text) =
        run(&["render", "v.nrrd", "-o", "p.png", "--quality", "draft", "--image.width", "32", "--image.height", "32", "--json"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("\"planning_seconds\"") && text.contains("\"bands_dropped\":3"), "{text}");
    for (arguments, part) in [
        (&["--tolerance", "0.1", "--quality", "fine"][..], "cannot be used with"),
        (&["--tolerance", "5"][..], "`visibility.tolerance` is 5; it must lie in 0.001..1"),
        (&["--tolerance", "-1"][..], "`visibility.tolerance` is -1"),
        (&["--quality", "best"][..], "`visibility.quality` is best; it must be \"draft\" or \"normal\" or \"fine\""),
        (&["--tolerance", "0.1", "--visibility.near", "2"][..], "cannot stand beside"),
    ] {
        let all: Vec<&str> = ["precompute", "v.nrrd", "-o", "x.nrrd"].into_iter().chain(arguments.iter().copied()).collect();
        let (code, text) = run(&all);
        assert!(code == Some(2) && text.contains(part), "{arguments:?}: {code:?} {text}");
    }
    let (_, help) = run(&["precompute", "--help"]);
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in ["at its cells' centres, such as 0.05", "device time at most, but at 64 cells", "not counted"] {
        assert!(help.contains(part), "{part}: {help}");
    }
    let _ = std::fs::remove_dir_all(&folder);
}
