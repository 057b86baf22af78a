//! The reference renderer: formulas, twin, sabotage, and its own standard error.

#[path = "../common/mod.rs"]
mod common;
mod noise;

use common::*;
use halflight::Error;
use halflight::engine::{Medium, Reference, ReferenceSettings};
use halflight::scene::grid::glam::DVec3;
use halflight::scene::visibility::Method;
use halflight::scene::{Camera, Grid, ImageSettings, Light, Matter, Probe, Shading, Sky, Surface, Visibility, Volume};
use halflight::stages::directions::fibonacci;
use halflight::stages::raymarch::View;
use halflight::stages::{majorant, trace, twin};
use std::ops::ControlFlow;

fn image(width: usize, height: usize) -> ImageSettings {
    ImageSettings { width, height, ..ImageSettings::default() }
}

/// All of `samples`.
fn all(samples: u32) -> ReferenceSettings {
    ReferenceSettings { samples, error: 0.0, ..ReferenceSettings::default() }
}

fn render(engine: &Checked, medium: &Medium, sky: &Sky, camera: &Camera, image: &ImageSettings, s: &ReferenceSettings) -> Reference {
    engine.render_reference(medium, sky, camera, image, s, &mut quiet).expect("a reference picture")
}

/// A sky with one bright pixel toward `dir`, and the direction of its centre with the irradiance that it gives there.
fn spot(dir: DVec3) -> (Sky, DVec3, f64) {
    let (w, h) = (256usize, 128usize);
    let row = (dir.z.acos() / std::f64::consts::PI * h as f64) as usize;
    let column = ((dir.x.atan2(dir.y) / std::f64::consts::TAU).rem_euclid(1.0) * w as f64) as usize;
    let mut pixels = vec![[0.0; 3]; w * h];
    pixels[row * w + column] = [1000.0, 2000.0, 500.0];
    let edge = |j: usize| (std::f64::consts::PI * j as f64 / h as f64).cos();
    let solid = (edge(row) - edge(row + 1)) * std::f64::consts::TAU / w as f64;
    let (azimuth, z) = (std::f64::consts::TAU * (column as f64 + 0.5) / w as f64, 0.5 * (edge(row) + edge(row + 1)));
    let r = (1.0 - z * z).sqrt();
    (Sky::from_probe(&Probe::new(w, h, pixels).expect("probe")), DVec3::new(r * azimuth.sin(), r * azimuth.cos(), z), 1000.0 * solid)
}

/// The way from p along w (world) to the end of the box 0..side.
fn way_out(p: DVec3, w: DVec3, side: DVec3) -> f64 {
    (0..3).map(|a| ((if w[a] > 0.0 { side[a] } else { 0.0 }) - p[a]) / w[a]).fold(f64::INFINITY, f64::min)
}

/// ∫ T σ S dt through a homogeneous box by the midpoint rule in f64, S from `source`.
fn box_radiance(eye: DVec3, w: DVec3, side: DVec3, sigma: f64, source: impl Fn(DVec3) -> f64) -> f64 {
    let (mut enter, mut leave) = (0f64, f64::INFINITY);
    for a in 0..3 {
        let (t0, t1) = ((0.0 - eye[a]) / w[a], (side[a] - eye[a]) / w[a]);
        enter = enter.max(t0.min(t1));
        leave = leave.min(t0.max(t1));
    }
    let steps = 200;
    let ds = (leave - enter).max(0.0) / f64::from(steps);
    (0..steps)
        .map(|i| {
            let s = (f64::from(i) + 0.5) * ds;
            (-sigma * s).exp() * sigma * ds * source(eye + w * (enter + s))
        })
        .sum()
}

/// Fails where a pixel lies further than 5 standard errors (and `bias`, relative) from what is expected; the mean
/// deviation of all in standard errors must be that of noise.
fn agree(reference: &Reference, expected: &[(usize, [f64; 3])], bias: f64) -> Result<(), String> {
    let (mut chi2, mut count) = (0.0, 0.0);
    for (i, e) in expected {
        for (c, &e) in e.iter().enumerate() {
            let (got, error) = (f64::from(reference.picture.rgba[*i][c]), f64::from(reference.standard_error[*i][c]));
            let off = (got - e).abs() - bias * e.abs();
            if off > 5.0 * error + 1e-6 * e {
                return Err(format!("pixel {i}, channel {c}: {got} for {e}, standard error {error}"));
            }
            chi2 += (off.max(0.0) / error.max(1e-9 + 1e-6 * e)).powi(2);
            count += 1.0;
        }
    }
    let chi2 = chi2 / f64::max(count, 1.0);
    if chi2 > 1.6 || count < 30.0 { Err(format!("{chi2:.2} mean squared standard errors off over {count} numbers")) } else { Ok(()) }
}

#[test]
fn majorants_equal_their_twin_and_bound_every_interpolated_value() {
    let engine = engine();
    for (g, grid) in [Grid::axis_aligned([33, 8, 17], [1.0; 3]).expect("grid"), oblique([9, 14, 7])].into_iter().enumerate() {
        let volume = blobs(grid, 3 + g as u64);
        let matter = linear(0.8);
        let (_, medium) = load(&engine, &volume, &matter);
        let table = matter.transfer.table(volume.range(), &grid);
        let got = engine.read_majorants(&medium).expect("read");
        let twin = majorant::reference(&volume, &table);
        // One entry of the table more or less.
        assert!(worst(&got, &twin).0 < 0.8 / 1000.0, "{:?}", worst(&got, &twin));
        let cells = majorant::cells(grid.dims()).map(|c| c as usize);
        let mut random = Random(9);
        for _ in 0..20_000 {
            let p: [f32; 3] = std::array::from_fn(|a| random.unit() * grid.dims()[a] as f32);
            let at = p.map(|x| x as usize / majorant::CELL as usize);
            let sigma = halflight::stages::twin::extinction(&table, halflight::stages::twin::sample(&volume, p));
            assert!(sigma <= got[at[0] + cells[0] * (at[1] + cells[1] * at[2])]);
        }
    }
}

#[test]
fn a_homogeneous_box_shows_what_quadrature_says() {
    let engine = engine();
    let (n, spacing) = ([20usize, 30, 10], [1.0, 0.5, 2.0]);
    let grid = Grid::axis_aligned(n, spacing).expect("grid");
    let side = DVec3::new(20.0, 15.0, 20.0);
    let volume = blobs(grid, 2);
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let settings = image(16, 12);
    let rays = camera.rays(&grid, 16, 12).expect("rays");
    let radiance = [1.0, 2.0, 0.5];
    let constant = Sky::constant([1.0, 2.0, 0.5]).expect("sky");
    let (lamp, toward, irradiance) = spot(DVec3::new(0.3, -0.8, 0.52));
    let set = fibonacci(600);
    for sigma in [1e-5, 0.05, 0.6] {
        let (_, medium) = load(&engine, &volume, &homogeneous(sigma));
        let expected = |source: &dyn Fn(DVec3) -> f64, color: [f64; 3]| -> Vec<(usize, [f64; 3])> {
            (0..16 * 12)
                .step_by(5)
                .map(|i| {
                    let w = rays.direction_world((i % 16) as f64, (i / 16) as f64);
                    let l = box_radiance(camera.position, w, side, sigma, source);
                    (i, color.map(|c| c * l))
                })
                .filter(|(_, e)| e[0] > 0.0)
                .collect()
        };
        // From everywhere, and nearly from one direction: 1/(4π) V E. The quadratures are good to a thousandth or so.
        let all_around = |p: DVec3| set.iter().map(|&w| (-sigma * way_out(p, w, side)).exp()).sum::<f64>() / set.len() as f64;
        let one_way = |p: DVec3| (-sigma * way_out(p, toward, side)).exp() / (4.0 * std::f64::consts::PI);
        let furnace = render(&engine, &medium, &constant, &camera, &settings, &all(512));
        agree(&furnace, &expected(&all_around, radiance), 3e-3).expect("constant light");
        if sigma == 1e-5 {
            // Nothing shadows anything: the medium gives the light back where it covers.
            for p in &furnace.picture.rgba {
                assert!((p[0] - p[3]).abs() <= 8e-3 * p[3] && (p[1] - 2.0 * p[3]).abs() <= 16e-3 * p[3], "{p:?}");
            }
        }
        let lamp_lit = |sky: &Sky| render(&engine, &medium, sky, &camera, &settings, &all(512));
        let by_lamp = expected(&one_way, [irradiance, 2.0 * irradiance, 0.5 * irradiance]);
        agree(&lamp_lit(&lamp), &by_lamp, 3e-3).expect("one direction");
        // Turned there and back again.
        let turned = lamp.rotated(DVec3::new(1.0, 2.0, -0.5), 70.0).rotated(DVec3::new(-1.0, -2.0, 0.5), 70.0);
        agree(&lamp_lit(&turned), &by_lamp, 3e-3).expect("one direction, turned and turned back");
        if sigma == 0.6 {
            // Sabotage: a light turned the wrong way; one drawn without its density.
            assert!(agree(&lamp_lit(&lamp.rotated(DVec3::Z, 30.0)), &by_lamp, 3e-3).is_err());
            assert!(agree(&lamp_lit(&lamp.scaled(1.05)), &by_lamp, 3e-3).is_err());
        }
    }
}

#[test]
fn a_rotated_light_is_the_light_that_the_background_shows() {
    let sky = Sky::from_probe(&Probe::two_colored()).rotated(DVec3::new(0.2, 1.0, 0.4), 50.0).scaled(2.0);
    let light = Light::from_probe(&Probe::two_colored()).rotated(DVec3::new(0.2, 1.0, 0.4), 50.0).scaled(2.0);
    // ∫ L Y over the exact light is what the harmonics hold.
    let set = fibonacci(20_000);
    for i in 0..16 {
        for c in 0..3 {
            let sum: f64 = set.iter().map(|&w| f64::from(sky.radiance(w)[c]) * halflight::scene::sh::basis(w)[i]).sum();
            let got = sum * 4.0 * std::f64::consts::PI / set.len() as f64;
            assert!((got - light.coefficients[i][c]).abs() < 0.05, "{i} {c}: {got} {}", light.coefficients[i][c]);
        }
    }
    // The tables' probabilities and weights give the mean back: Σ P·w = mean radiance.
    let t = sky.tables();
    let (w, h) = (t.probe.width(), t.probe.height());
    let share =
        |first: usize, i: usize| f64::from(t.cumulative[first + i]) - if i > 0 { f64::from(t.cumulative[first + i - 1]) } else { 0.0 };
    for c in 0..3 {
        let sum: f64 = (0..w * h).map(|i| share(0, i / w) * share(h + i / w * w, i % w) * f64::from(t.weights[i][c])).sum();
        assert!((sum - t.probe.mean()[c]).abs() < 1e-6 * t.probe.mean()[c], "{sum} {:?}", t.probe.mean());
    }
}

#[test]
fn the_harmonic_renderer_tends_to_it_under_constant_light() {
    let engine = engine();
    let grid = Grid::axis_aligned([48, 40, 32], [0.5; 3]).expect("grid");
    // Soft matter that the box does not cut: a field of the voxels' own resolution follows its visibility.
    let volume = Volume::from_fn(grid, |p| {
        let p = p.map(|x| 0.5 * x);
        let bump = |x: f64, y: f64, z: f64, r: f64| (-((p[0] - x).powi(2) + (p[1] - y).powi(2) + (p[2] - z).powi(2)) / (r * r)).exp();
        (bump(9.0, 9.0, 8.0, 4.0) + bump(16.0, 12.0, 7.0, 3.0) - 0.1).max(0.0) as f32
    });
    let (_, medium) = load(&engine, &volume.expect("volume"), &linear(0.25));
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let settings = ImageSettings { step: 0.25, ..image(16, 12) };
    let reference = render(&engine, &medium, &Sky::constant([1.0, 2.0, 0.5]).expect("sky"), &camera, &settings, &all(16384));
    let field = Visibility { method: Method::March, ratio: 1, directions: 128, bits: 32, step: 0.5, ..Visibility::default() };
    let field = engine.precompute(&medium, &field, &mut quiet).expect("field");
    let picture = |light: &Light| {
        let lit = engine.relight(&field, light).expect("light");
        engine.render(&medium, &lit, &camera, &settings, &mut quiet).expect("picture")
    };
    let deviation = |p: &halflight::scene::Picture| -> (f64, f64, f64) {
        let (mut sum, mut off, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
        for (i, (p, r)) in p.rgba.iter().zip(&reference.picture.rgba).enumerate().filter(|(_, (_, r))| r[3] > 0.0) {
            for c in 0..3 {
                let error = f64::from(reference.standard_error[i][c]);
                sum += f64::from(r[c]);
                off += f64::from(p[c] - r[c]);
                squares += (f64::from(p[c] - r[c]).powi(2) - error * error).max(-1.0);
                count += 1.0;
            }
        }
        (off / sum, (squares / count).max(0.0).sqrt() / (sum / count), reference.relative_error)
    };
    let (mean, rms, error) = deviation(&picture(&Light::constant([1.0, 2.0, 0.5])));
    println!("mean {mean:+.5}, beyond noise {rms:.5}, standard error {error:.5}");
    // Noise of the mean is some √(pixels) smaller. A field of the voxels' centres, interpolated, and its directions.
    assert!(mean.abs() < 0.004 && rms < 0.013, "{mean} {rms}");
    // Sabotage: light a twentieth brighter.
    assert!(deviation(&picture(&Light::constant([1.05, 2.1, 0.525]))).0 > 0.04);
}

/// A ball whose iso 0 is the sphere of radius r.
fn ball(n: usize, r: f64) -> Volume {
    let c = n as f64 / 2.0;
    Volume::from_fn(Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid"), |p| {
        (r - ((p[0] - c).powi(2) + (p[1] - c).powi(2) + (p[2] - c).powi(2)).sqrt()) as f32
    })
    .expect("volume")
}

#[test]
fn a_convex_surface_shows_its_albedo_or_half_of_it() {
    let engine = engine();
    let volume = ball(40, 14.0);
    let camera = camera(volume.grid(), [1.6, -1.9, 1.1], 25.0);
    for (shading, share) in [(Shading::Lambert, 1.0), (Shading::Isotropic, 0.5)] {
        let matter = surface(Surface { iso: 0.0, shading, albedo: Some([0.8, 0.6, 0.4]) });
        let (_, medium) = load(&engine, &volume, &matter);
        let reference = render(&engine, &medium, &Sky::constant([1.0; 3]).expect("sky"), &camera, &image(24, 18), &all(512));
        let covered: Vec<usize> = (0..24 * 18).filter(|&i| reference.picture.rgba[i][3] > 0.0).collect();
        assert!(covered.len() > 80 && covered.iter().all(|&i| reference.picture.rgba[i][3] == 1.0));
        let mean = covered.iter().map(|&i| f64::from(reference.picture.rgba[i][0])).sum::<f64>() / covered.len() as f64 / 0.8;
        println!("{shading:?}: {mean:.4} of the albedo, standard error {:.4}", reference.relative_error);
        // A ball of voxels is not quite convex: grazing rays may meet a facet.
        assert!((mean - share).abs() < 0.01, "{shading:?}: {mean}");
    }
}

#[test]
fn a_surface_cut_open_by_the_box_is_lit_through_the_face() {
    let engine = engine();
    let volume =
        Volume::from_fn(Grid::axis_aligned([16; 3], [1.0; 3]).expect("grid"), |p| f32::from(u8::from(p[2] < 12.0))).expect("volume");
    let camera = camera(volume.grid(), [0.0, -3.0, 0.0], 15.0);
    for (shading, expected) in [(Shading::Lambert, 1.0), (Shading::Isotropic, 0.5)] {
        let (_, medium) = load(&engine, &volume, &surface(Surface { iso: 0.5, shading, albedo: Some([1.0; 3]) }));
        let reference = render(&engine, &medium, &Sky::constant([1.0; 3]).expect("sky"), &camera, &image(9, 9), &all(1024));
        let (got, error) = (reference.picture.rgba[4 * 9 + 4], reference.standard_error[4 * 9 + 4][0]);
        assert!(got[3] == 1.0 && (got[0] - expected).abs() < 4.0 * error + 1e-4, "{shading:?}: {got:?}, {error}");
    }
}

#[test]
fn tracing_equals_its_twin() {
    let engine = engine();
    let grid = oblique([19, 14, 11]);
    let volume = blobs(grid, 31);
    let camera = camera(&grid, [1.1, -1.3, 0.8], 40.0);
    let view = View::new(&grid, &camera.rays(&grid, 24, 18).expect("rays"));
    let sky = Sky::from_probe(&Probe::two_colored()).rotated(DVec3::new(0.2, 1.0, 0.4), 50.0);
    let (samples, filtering) = (64, engine.filtering().expect("filtering"));
    let opaque = |shading| Surface { iso: 0.35, shading, albedo: Some([0.8, 0.6, 0.4]) };
    for matter in [linear(0.8), surface(opaque(Shading::Lambert)), surface(opaque(Shading::Isotropic))] {
        let (_, medium) = load(&engine, &volume, &matter);
        let device = render(&engine, &medium, &sky, &camera, &image(24, 18), &ReferenceSettings { seed: 7, ..all(samples) });
        let twins = |sky: &Sky, seed: u32| -> (usize, usize, f64) {
            let table = medium.table();
            let majorants = majorant::reference(&volume, table);
            let scene = trace::Twin {
                volume: &volume,
                table,
                majorants: &majorants,
                sky,
                view: &view,
                width: 24,
                seed,
                surface: matter.surface.map(|s| (s.iso as f32, [0.8, 0.6, 0.4], s.shading, grid.voxel_length())),
            };
            let (mut near, mut lit, mut far) = (0, 0, 0f64);
            for i in (0..24 * 18).step_by(if matter.surface.is_some() { 1 } else { 3 }) {
                let mut mean = [0f64; 4];
                for s in 0..samples {
                    let l = twin::filtered(filtering, || trace::reference(&scene, [i % 24, i / 24], s));
                    (0..4).for_each(|c| mean[c] += f64::from(l[c]) / f64::from(samples));
                }
                let got = device.picture.rgba[i];
                if mean.iter().any(|m| m.is_nan()) || got[3] == 0.0 && mean[3] == 0.0 {
                    continue;
                }
                lit += 1;
                let off = (0..4).map(|c| (f64::from(got[c]) - mean[c]).abs() / (0.1 + mean[c])).fold(0.0, f64::max);
                near += usize::from(off < 2e-3);
                far = far.max(off);
            }
            (near, lit, far)
        };
        let (near, lit, far) = twins(&sky, 7);
        println!("{near} of {lit} pixels equal, the furthest {far:.4} off");
        // A draw that falls on the other side of a rounded number changes one sample of 64; few do.
        assert!(lit > 40 && near * 10 > lit * 9, "{near} of {lit}");
        // Sabotage: other numbers, another light.
        for (near, lit, _) in [twins(&sky, 8), twins(&sky.rotated(DVec3::X, 5.0), 7)] {
            assert!(near * 2 < lit, "{near} of {lit}");
        }
    }
}

/// Blobs, and a camera that sees all of them.
fn small_scene() -> (Checked, Medium, Camera) {
    let engine = engine();
    let grid = Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 5), &linear(0.8));
    (engine, medium, camera(&grid, [1.6, -1.9, 1.1], 30.0))
}

#[test]
fn splitting_the_work_changes_no_bit() {
    let (engine, medium, camera) = small_scene();
    let sky = Sky::from_probe(&Probe::two_colored());
    let run =
        |first: u32, samples: u32| render(&engine, &medium, &sky, &camera, &image(40, 30), &ReferenceSettings { first, ..all(samples) });
    let whole = run(208, 208);
    for first in [1, 48, 80] {
        let parts = run(first, 208);
        assert!(parts.samples == 208 && parts.picture == whole.picture && parts.standard_error == whole.standard_error, "{first}");
    }
    assert!(run(208, 192).picture != whole.picture);
}

#[test]
fn matter_too_dense_for_the_device_is_an_error_not_a_wrong_picture() {
    let engine = engine();
    // A grain of huge extinction in each cell: its majorant holds for the vacuum around it.
    let grid = Grid::axis_aligned([16; 3], [1.0; 3]).expect("grid");
    let volume = Volume::from_fn(grid, |p| f32::from(u8::from(p.iter().all(|x| (x % 8.0) < 1.0)))).expect("volume");
    let matter: Matter = linear(1e6);
    let (_, medium) = load(&engine, &volume, &matter);
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let sky = Sky::constant([1.0; 3]).expect("sky");
    let refused = engine.render_reference(&medium, &sky, &camera, &image(12, 9), &all(32), &mut quiet);
    assert!(
        matches!(&refused, Err(e @ Error::Invalid { .. }) if e.to_string().contains("dense")),
        "{:?}",
        refused.map(|r| r.relative_error)
    );
}

#[test]
fn a_written_picture_holds_its_standard_error_in_channels_of_their_own() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("r.exr");
    let picture = halflight::scene::Picture { width: 3, height: 2, rgba: (0..6).map(|i| [i as f32, 0.5, 0.25, 1.0]).collect() };
    let error: Vec<[f32; 3]> = (0..6).map(|i| [0.1 * i as f32, 0.2, 0.3]).collect();
    let write = |error: &[[f32; 3]], covered: Option<&[f32]>| halflight::io::write_exr_with_error(&path, &picture, error, covered, &[]);
    write(&error, None).expect("written");
    assert_eq!(halflight::io::read_picture_exr(&path).expect("read"), picture);
    let bytes = std::fs::read(&path).expect("bytes");
    assert!([&b"stderr.R\0"[..], b"stderr.G\0", b"stderr.B\0"].iter().all(|name| bytes.windows(9).any(|w| w == *name)));
    assert!(write(&error[1..], None).is_err() && halflight::io::read_coverage(&path).expect("read").is_none());
    // What it covers without its background, beside an alpha of 1.
    let covered = [0.0, 0.25, 1.0, 0.5, 0.0, 0.75];
    write(&error, Some(&covered)).expect("written");
    assert_eq!(halflight::io::read_picture_exr(&path).expect("read"), picture);
    assert_eq!(halflight::io::read_coverage(&path).expect("read").as_deref(), Some(&covered[..]));
    assert!(write(&error, Some(&covered[1..])).is_err());
}
