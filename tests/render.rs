//! Relighting, direct volume rendering and isosurfaces: formulas, twins, sabotage.

mod common;
use common::*;
use halflight::scene::grid::glam::DVec3;
use halflight::scene::visibility::{Cells, Method};
use halflight::scene::{Camera, Grid, ImageSettings, Light, Picture, Shading, Surface, Visibility, Volume};
use halflight::stages::raymarch::{self, View};
use halflight::stages::{isosurface, relight, twin};

fn camera(grid: &Grid, offset: [f64; 3], fov: f64) -> Camera {
    let centre = grid.centre_world();
    Camera { position: centre + DVec3::from(offset) * grid.longest_side(), target: centre, up: DVec3::Z, fov_degrees: fov }
}

fn image(width: usize, height: usize, step: f64) -> ImageSettings {
    ImageSettings { width, height, step, ..ImageSettings::default() }
}

fn march(ratio: u32) -> Visibility {
    Visibility { method: Method::March, ratio, directions: 128, bits: 32, step: 0.5, ..Visibility::default() }
}

/// A light with energy in every coefficient and channel.
fn coloured() -> Light {
    Light::constant([0.3, 0.4, 0.5]).plus(&Light::cone(DVec3::new(0.3, -0.5, 0.8), 40.0, [6.0, 1.0, 0.5])).plus(&Light::cone(
        DVec3::new(-0.8, 0.4, -0.1),
        25.0,
        [0.2, 2.0, 9.0],
    ))
}

#[test]
fn a_constant_light_without_occlusion_gives_back_the_albedo() {
    // Furnace: albedo 1, light 1, next to no extinction on the way in: S = 1, so radiance = coverage.
    let engine = engine();
    let grid = Grid::axis_aligned([24, 24, 24], [1.0; 3]).expect("grid");
    let volume = blobs(grid, 1);
    let (_, vacuum) = load(&engine, &volume, &homogeneous(0.0));
    for bits in [8, 16, 32] {
        let field = engine.precompute(&vacuum, &Visibility { bits, cells: Cells::All, ..march(2) }, &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0, 2.0, 0.5])).expect("light");
        for s in engine.read_irradiance(&lit).expect("read") {
            // Half floats: 11 bits.
            for (got, expected) in s.iter().zip([1.0, 2.0, 0.5, 1.0]) {
                assert!((got - expected).abs() < 1e-3 * expected, "{bits} bits: {s:?}");
            }
        }
        // The field is of a vacuum, the picture of a fog: only the fog's coverage dims it.
        let (_, fog) = load(&engine, &volume, &homogeneous(0.05));
        let picture = engine.render(&fog, &lit, &camera(&grid, [1.6, -1.9, 1.1], 30.0), &image(32, 24, 0.5), &mut quiet).expect("picture");
        assert!(picture.rgba.iter().any(|p| p[3] > 0.5));
        for p in &picture.rgba {
            assert!((p[0] - p[3]).abs() < 2e-3 && (p[1] - 2.0 * p[3]).abs() < 4e-3, "{p:?}");
        }
    }
}

#[test]
fn relight_equals_its_twin() {
    let engine = engine();
    let grid = Grid::axis_aligned([17, 13, 11], [1.0, 1.0, 5.0]).expect("grid");
    let volume = blobs(grid, 4);
    let (_, medium) = load(&engine, &volume, &linear(0.6));
    for (bands, bits) in [(4, 8), (4, 16), (4, 32), (3, 8), (2, 16), (1, 8), (1, 16), (1, 32)] {
        let field = engine.precompute(&medium, &Visibility { bands, bits, ..march(2) }, &mut quiet).expect("field");
        let coefficients = engine.read_field(&field).expect("read");
        let light = coloured();
        let lit = engine.relight(&field, &light).expect("light");
        let kept = (bands * bands) as usize;
        for (cell, s) in engine.read_irradiance(&lit).expect("read").iter().enumerate() {
            let mut v = [0.0; 16];
            v[..kept].copy_from_slice(&coefficients[cell * kept..(cell + 1) * kept]);
            let expected = relight::reference(&v, &light.to_f32());
            for c in 0..4 {
                assert!((s[c] - expected[c]).abs() < 1e-3 * (1.0 + expected[c].abs()), "{bands} {bits} {cell} {c}: {s:?} {expected:?}");
            }
            // Sabotage: a light turned by 10 degrees is told apart somewhere.
            if cell == 0 && bands == 4 {
                let turned = relight::reference(&v, &light.rotated(DVec3::Z, 10.0).to_f32());
                assert!((0..3).any(|c| (s[c] - turned[c]).abs() > 1e-3 * (1.0 + turned[c].abs())));
            }
        }
    }
}

#[test]
fn a_homogeneous_box_covers_by_its_chord_for_any_step() {
    let engine = engine();
    let (n, spacing, sigma) = ([20usize, 30, 10], [1.0, 0.5, 2.0], 0.07);
    let grid = Grid::axis_aligned(n, spacing).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 2), &homogeneous(sigma));
    let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
    let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    for step in [0.1, 0.5, 1.0, 3.0, 50.0] {
        let settings = image(40, 30, step);
        let picture = engine.render(&medium, &lit, &camera, &settings, &mut quiet).expect("picture");
        let rays = camera.rays(&grid, 40, 30).expect("rays");
        for j in 0..30 {
            for i in 0..40 {
                // The chord in world space, by slabs.
                let w = rays.direction_world(i as f64, j as f64);
                let (mut enter, mut leave) = (0f64, f64::INFINITY);
                for a in 0..3 {
                    let side = n[a] as f64 * spacing[a];
                    let (t0, t1) = ((0.0 - camera.position[a]) / w[a], (side - camera.position[a]) / w[a]);
                    enter = enter.max(t0.min(t1));
                    leave = leave.min(t0.max(t1));
                }
                let expected = 1.0 - (-sigma * (leave - enter).max(0.0)).exp();
                let got = f64::from(picture.rgba[j * 40 + i][3]);
                assert!((got - expected).abs() < 1e-4, "step {step}, pixel {i},{j}: {got} for {expected}");
            }
        }
    }
}

#[test]
fn raymarch_equals_its_twin() {
    let engine = engine();
    for (g, grid) in [
        Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid"),
        Grid::axis_aligned([19, 1, 6], [0.7, 2.0, 1.0]).expect("grid"),
        oblique([9, 14, 7]),
    ]
    .into_iter()
    .enumerate()
    {
        let volume = blobs(grid, 31 + g as u64);
        let matter = linear(0.8);
        let (_, medium) = load(&engine, &volume, &matter);
        let field = engine.precompute(&medium, &march(2), &mut quiet).expect("field");
        let lit = engine.relight(&field, &coloured()).expect("light");
        let cells = engine.read_irradiance(&lit).expect("read");
        let table = matter.transfer.table(volume.range(), &grid);
        let (dims, n) = (field.dims(), grid.dims());
        let light_at = |p: [f32; 3]| -> [f32; 3] {
            let q = std::array::from_fn(|a| p[a] / n[a] as f32 * dims[a] as f32);
            std::array::from_fn(|c| twin::trilinear(dims, q, |i| cells[i[0] + dims[0] * (i[1] + dims[1] * i[2])][c]))
        };
        // From outside, and from inside the box.
        for (offset, step) in [([1.6, -1.9, 1.1], 0.7), ([0.1, 0.02, 0.05], 1.0)] {
            let camera = camera(&grid, offset, 45.0);
            let picture = engine.render(&medium, &lit, &camera, &image(24, 18, step), &mut quiet).expect("picture");
            let view = View::new(&grid, &camera.rays(&grid, 24, 18).expect("rays"));
            let check = |table: &halflight::scene::transfer::Table| -> f32 {
                let mut worst = 0f32;
                for j in 0..18 {
                    for i in 0..24 {
                        let t = raymarch::reference(&volume, table, &view, [i, j], step * grid.voxel_length(), light_at);
                        let p = picture.rgba[j * 24 + i];
                        for c in 0..3 {
                            worst = worst.max((p[c] - t[c]).abs());
                        }
                        worst = worst.max((p[3] + (-t[3]).exp_m1()).abs());
                    }
                }
                worst
            };
            // Single precision along some 40 steps; a ray may end one step earlier (1e-3 of what is left).
            assert!(check(&table) < 2e-3, "grid {g}: {}", check(&table));
            // Sabotage: a tenth more extinction.
            assert!(check(&linear(0.88).transfer.table(volume.range(), &grid)) > 2e-3);
        }
    }
}

/// A ball of radius r about the centre: D falls linearly with distance, so that iso 0 is the sphere.
fn ball(n: usize, r: f64) -> Volume {
    let c = n as f64 / 2.0;
    Volume::from_fn(Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid"), |p| {
        (r - ((p[0] - c).powi(2) + (p[1] - c).powi(2) + (p[2] - c).powi(2)).sqrt()) as f32
    })
    .expect("volume")
}

fn sphere_surface(shading: Shading) -> halflight::scene::Matter {
    surface(Surface { iso: 0.0, shading, albedo: Some([0.8, 0.6, 0.4]) })
}

#[test]
fn the_isosurface_of_a_ball_is_hit_where_the_formula_says() {
    let engine = engine();
    let volume = ball(48, 15.0);
    let grid = *volume.grid();
    let (_, medium) = load(&engine, &volume, &sphere_surface(Shading::Lambert));
    let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
    let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [1.6, -1.9, 1.1], 25.0);
    let (picture, distance) = engine.render_with_distance(&medium, &lit, &camera, &image(64, 48, 1.0), &mut quiet).expect("picture");
    let rays = camera.rays(&grid, 64, 48).expect("rays");
    let view = View::new(&grid, &rays);
    let (mut hits, mut worst, mut worst_twin) = (0, 0f64, 0f32);
    for j in 0..48 {
        for i in 0..64 {
            let w = rays.direction_world(i as f64, j as f64);
            let o = camera.position - grid.centre_world();
            let (b, c) = (o.dot(w), o.dot(o) - 15.0 * 15.0);
            let got = distance[j * 64 + i];
            let covered = picture.rgba[j * 64 + i][3];
            assert_eq!(got >= 0.0, covered == 1.0);
            let root = b * b - c;
            // Rays that graze the rim are as uncertain as the interpolated ball is not round.
            if root > 9.0 {
                hits += 1;
                worst = worst.max((f64::from(got) - (-b - root.sqrt())).abs());
            } else if root < -9.0 {
                assert!(got < 0.0, "pixel {i},{j} hits beside the ball");
            }
            match isosurface::reference_hit(&volume, 0.0, &view, [i, j], 1.0) {
                Some(hit) if got >= 0.0 => worst_twin = worst_twin.max((hit.distance - got).abs()),
                Some(_) | None => assert!(root.abs() < 9.0 || got < 0.0),
            }
        }
    }
    println!("{hits} hits, worst distance error {worst:.4} voxels, against the twin {worst_twin:.5}");
    // A linear cone interpolated trilinearly errs by curvature/8: about 3/(8·15) voxel, times the obliqueness.
    assert!(hits > 400 && worst < 0.1, "{worst}");
    // Bisection of one voxel by 12 halvings, and single precision at a distance of some 100 voxels.
    assert!(worst_twin < 2e-3, "{worst_twin}");
    // Sabotage: a ball half a voxel larger is found out.
    let view_error = isosurface::reference_hit(&volume, -0.5, &view, [32, 24], 1.0).expect("hit").distance - distance[24 * 64 + 32];
    assert!(view_error.abs() > 0.1);
}

#[test]
fn a_convex_lambert_surface_under_constant_light_shows_its_albedo() {
    let engine = engine();
    let volume = ball(40, 14.0);
    let grid = *volume.grid();
    let (_, medium) = load(&engine, &volume, &sphere_surface(Shading::Lambert));
    let camera = camera(&grid, [1.6, -1.9, 1.1], 25.0);
    for ratio in [1, 2, 4] {
        let field = engine.precompute(&medium, &march(ratio), &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
        let picture = engine.render(&medium, &lit, &camera, &image(48, 36, 1.0), &mut quiet).expect("picture");
        let covered: Vec<_> = picture.rgba.iter().filter(|p| p[3] > 0.0).collect();
        let mean = covered.iter().map(|p| f64::from(p[0])).sum::<f64>() / covered.len() as f64 / 0.8;
        let spread = (covered.iter().map(|p| (f64::from(p[0]) / 0.8 - mean).powi(2)).sum::<f64>() / covered.len() as f64).sqrt();
        println!("1:{ratio}: {mean:.3} of the albedo, spread {spread:.3}");
        // Nothing shadows a ball: truth is 1. Four bands of a half sky's visibility keep the cosine lobe to a few percent.
        assert!((mean - 1.0).abs() < 0.06, "1:{ratio}: {mean}");
        assert!(spread < 0.06, "1:{ratio}: {spread}");
    }
}

#[test]
fn surface_shading_equals_brute_force_quadrature() {
    let engine = engine();
    let volume = ball(32, 9.0);
    let grid = *volume.grid();
    let light = coloured();
    let camera = camera(&grid, [1.6, -1.9, 1.1], 25.0);
    for shading in [Shading::Lambert, Shading::Isotropic] {
        let (_, medium) = load(&engine, &volume, &sphere_surface(shading));
        // A field of one cell per axis pair would be constant; 1:1 makes interpolation local instead.
        let field = engine.precompute(&medium, &march(1), &mut quiet).expect("field");
        let v = engine.read_field(&field).expect("read");
        let lit = engine.relight(&field, &light).expect("light");
        let picture = engine.render(&medium, &lit, &camera, &image(16, 12, 0.5), &mut quiet).expect("picture");
        let view = View::new(&grid, &camera.rays(&grid, 16, 12).expect("rays"));
        let mut hits = 0;
        for j in 0..12 {
            for i in 0..16 {
                let Some(hit) = isosurface::reference_hit(&volume, 0.0, &view, [i, j], 0.5) else { continue };
                let Some(normal) = hit.normal else { continue };
                // Trilinear among the cells in vacuum.
                let mut c = [0f32; 16];
                let mut weights = 0.0;
                let vacuum = |q: [usize; 3]| f32::from(volume.value(q[0] + 32 * (q[1] + 32 * q[2])) < 0.0);
                weights += twin::trilinear([32; 3], hit.position, vacuum);
                for (k, c) in c.iter_mut().enumerate() {
                    *c = twin::trilinear([32; 3], hit.position, |q| vacuum(q) * v[(q[0] + 32 * (q[1] + 32 * q[2])) * 16 + k]);
                }
                if weights < 0.05 {
                    continue;
                }
                let c = c.map(|c| c / weights);
                let expected = isosurface::reference_radiance(&c, &light, [0.8, 0.6, 0.4], normal, shading);
                let got = picture.rgba[j * 16 + i];
                hits += 1;
                for k in 0..3 {
                    assert!((got[k] - expected[k]).abs() < 0.02 * (expected[k] + 0.2), "{shading:?} {i},{j}: {got:?} {expected:?}");
                }
                // Sabotage: a normal turned by 30 degrees is told apart (Lambert only; the other form has none).
                if shading == Shading::Lambert && hits == 5 {
                    let n = DVec3::from(normal);
                    let turned = (n + 0.58 * n.any_orthonormal_vector()).normalize();
                    let wrong = isosurface::reference_radiance(&c, &light, [0.8, 0.6, 0.4], turned.to_array(), shading);
                    assert!((0..3).any(|k| (got[k] - wrong[k]).abs() > 0.02 * (wrong[k] + 0.2)));
                }
            }
        }
        assert!(hits > 20, "{hits}");
    }
}

#[test]
fn a_picture_larger_than_one_strip_is_the_same_picture() {
    let engine = engine();
    let grid = Grid::axis_aligned([16, 16, 16], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 8), &linear(0.8));
    let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
    let lit = engine.relight(&field, &coloured()).expect("light");
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let run = || -> Picture { engine.render(&medium, &lit, &camera, &image(96, 1200, 1.0), &mut quiet).expect("picture") };
    let (a, b) = (run(), run());
    assert!(a == b, "repeated runs pace their dispatches differently and must agree bit by bit");
}

#[test]
fn unusable_pictures_and_surfaces_are_refused_with_a_sentence() {
    let engine = engine();
    let volume = ball(16, 5.0);
    let grid = *volume.grid();
    let uploaded = engine.upload(&volume).expect("upload");
    let outside =
        engine.classify(&uploaded, &surface(Surface { iso: 99.0, shading: Shading::Lambert, albedo: None })).err().expect("outside");
    assert!(outside.to_string().contains("range"), "{outside}");
    let (_, medium) = load(&engine, &volume, &homogeneous(0.1));
    let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
    let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
    for bad in [
        image(0, 5, 1.0),
        image(5, 0, 1.0),
        image(5, 5, 0.0),
        image(5, 5, f64::NAN),
        image(5, 5, 1e-9),
        image(5, 5, 1e-19),
        image(5, 5, 1e-320),
    ] {
        let error = engine.render(&medium, &lit, &camera(&grid, [1.0, 1.0, 1.0], 30.0), &bad, &mut quiet).expect_err("refused");
        assert!(matches!(error, halflight::Error::Invalid { .. }), "{error}");
        let error = engine.aovs(&medium, &lit, &camera(&grid, [1.0, 1.0, 1.0], 30.0), &bad, &[], &mut quiet).expect_err("refused");
        assert!(matches!(error, halflight::Error::Invalid { .. }), "{error}");
    }
}

#[test]
fn a_surface_that_the_box_cuts_open_sees_what_an_open_plane_sees() {
    let engine = engine();
    // Solid matter but for one voxel; and a block whose faces lie `margin` voxels inside the box.
    // `off`: how far before the face the nearest cell centre in vacuum lies; 0 where there is none inside the box.
    for (margin, ratio, off) in [(0, 1, 0.0), (0, 4, 0.0), (1, 1, 0.5), (1, 4, 0.0), (2, 4, 0.0), (6, 4, 4.0)] {
        let n = 32usize;
        let volume = Volume::from_fn(Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid"), |p| {
            let inside = (0..3).all(|a| p[a] > margin as f64 && p[a] < (n - margin) as f64);
            let hole = p.iter().all(|&x| x > 15.0 && x < 16.0);
            f32::from(u8::from(inside && !hole))
        })
        .expect("volume");
        for shading in [Shading::Lambert, Shading::Isotropic] {
            let matter = surface(Surface { iso: 0.5, shading, albedo: Some([1.0; 3]) });
            let (_, medium) = load(&engine, &volume, &matter);
            let field = engine.precompute(&medium, &march(ratio), &mut quiet).expect("field");
            let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
            let camera = camera(volume.grid(), [0.0, -3.0, 0.0], 20.0);
            let picture = engine.render(&medium, &lit, &camera, &image(16, 16, 0.5), &mut quiet).expect("picture");
            // The middle of the face: a plane under constant light shows 1 (Lambert), or half the sky (isotropic).
            // The isotropic form sees more from a cell before the face: all but the solid angle of the square face.
            let half = (16 - margin) as f64;
            let blocked = (half * half / (half * half + off * off)).asin() / std::f64::consts::PI;
            let expected = if shading == Shading::Lambert { 1.0 } else { 1.0 - blocked as f32 };
            let got = picture.rgba[8 * 16 + 8];
            assert_eq!(got[3], 1.0);
            // Four bands of a step ring by a few percent.
            assert!((got[0] - expected).abs() < 0.08 * expected, "margin {margin}, 1:{ratio}, {shading:?}: {} for {expected}", got[0]);
        }
    }
}

#[test]
fn light_of_any_brightness_gives_the_same_picture_but_for_the_factor() {
    let engine = engine();
    let grid = Grid::axis_aligned([20, 20, 20], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 5), &linear(0.4));
    let field = engine.precompute(&medium, &march(2), &mut quiet).expect("field");
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let run = |factor: f64| {
        let lit = engine.relight(&field, &coloured().scaled(factor)).expect("light");
        engine.render(&medium, &lit, &camera, &image(24, 18, 1.0), &mut quiet).expect("picture")
    };
    let unit = run(1.0);
    for factor in [1e-12, 1e-3, 1e3, 1e6, 1e12] {
        for (p, u) in run(factor).rgba.iter().zip(&unit.rgba) {
            for c in 0..3 {
                let got = f64::from(p[c]) / factor;
                assert!((got - f64::from(u[c])).abs() < 2e-3 * (f64::from(u[c]) + 1e-3), "{factor}: {got} for {}", u[c]);
            }
            assert_eq!(p[3], u[3]);
        }
    }
}

#[test]
fn thin_media_cover_by_their_depth_at_any_step() {
    let engine = engine();
    let grid = Grid::axis_aligned([32; 3], [1.0; 3]).expect("grid");
    let volume = blobs(grid, 5);
    for sigma in [1e-6, 1e-5, 1e-4, 1e-2] {
        let (_, medium) = load(&engine, &volume, &homogeneous(sigma));
        let field = engine.precompute(&medium, &Visibility { directions: 4, ..march(8) }, &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
        for step in [1.0, 0.05] {
            let picture =
                engine.render(&medium, &lit, &camera(&grid, [0.0, -3.0, 0.0], 2.0), &image(3, 3, step), &mut quiet).expect("picture");
            let expected = -(-32.0 * sigma).exp_m1();
            let got = f64::from(picture.rgba[4][3]);
            // Up to 640 additions in single precision.
            assert!((got / expected - 1.0).abs() < 1e-4, "sigma {sigma}, step {step}: {got} for {expected}");
        }
    }
}

#[test]
fn one_stray_voxel_does_not_change_the_others() {
    let engine = engine();
    let grid = Grid::axis_aligned([32; 3], [1.0; 3]).expect("grid");
    let value = |p: [f64; 3], stray: f32| {
        if p[0] < 1.0 && p[1] < 1.0 && p[2] < 1.0 {
            return stray;
        }
        let r2: f64 = p.iter().map(|x| (x - 16.0).powi(2)).sum();
        f32::from(u8::from(r2 < 64.0))
    };
    let points = [[0.3, 1.0, 1.0, 1.0, 0.0], [0.7, 1.0, 1.0, 1.0, 0.2]];
    let transfer = halflight::scene::Transfer::from_points(
        &points,
        halflight::scene::transfer::Kind::Opacity,
        halflight::scene::transfer::Reference::Voxel,
    )
    .expect("transfer");
    let run = |stray: f32, surface: Option<Surface>| {
        let volume = Volume::from_fn(grid, |p| value(p, stray)).expect("volume");
        let (_, medium) = load(&engine, &volume, &halflight::scene::Matter { transfer: transfer.clone(), surface });
        let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
        engine.render(&medium, &lit, &camera(&grid, [1.6, -1.9, 1.1], 25.0), &image(24, 18, 0.5), &mut quiet).expect("picture")
    };
    for surface in [None, Some(Surface { iso: 0.5, shading: Shading::Lambert, albedo: None })] {
        let clean = run(0.0, surface);
        for stray in [-1e4, -32768.0, -1e6, -1e9, -3e38] {
            let picture = run(stray, surface);
            // The stray voxel itself is below every point: vacuum, as before.
            let worst =
                clean.rgba.iter().zip(&picture.rgba).flat_map(|(a, b)| (0..4).map(move |c| (a[c] - b[c]).abs())).fold(0.0, f32::max);
            assert!(worst < 2e-3, "{stray}, {surface:?}: {worst}");
        }
    }
}

#[test]
fn leaps_over_empty_blocks_change_no_bit() {
    let engine = engine();
    let extinctions = |points: &[[f64; 2]]| {
        let points: Vec<[f64; 5]> = points.iter().map(|&[s, e]| [s, s.clamp(0.0, 1.0), 0.7, 0.5, e]).collect();
        let transfer = halflight::scene::Transfer::from_points(
            &points,
            halflight::scene::transfer::Kind::Extinction,
            halflight::scene::transfer::Reference::World,
        );
        halflight::scene::Matter { transfer: transfer.expect("transfer"), surface: None }
    };
    let thin = extinctions(&[[0.6, 0.0], [1.0, 0.3]]);
    // Matter, a hole, matter.
    let shell = extinctions(&[[0.0, 0.0], [0.15, 0.0], [0.2, 0.4], [0.3, 0.0], [0.8, 0.0], [0.9, 2.0]]);
    let nothing = extinctions(&[[0.0, 0.0]]);
    let cut = |iso| surface(Surface { iso, shading: Shading::Lambert, albedo: Some([0.8, 0.6, 0.4]) });
    for dims in [[41, 30, 53], [64, 9, 1], [5, 3, 2]] {
        let grid = oblique(dims);
        let volume = blobs(grid, 7 + dims[0] as u64);
        let [lo, top] = volume.range().map(f64::from);
        let part = |x: f64| lo + x * (top - lo);
        // Rounding of filtered samples must not lose what lies exactly at the largest value either.
        for matter in [&thin, &shell, &nothing, &cut(part(0.5)), &cut(part(0.97)), &cut(top)] {
            let (_, medium) = load(&engine, &volume, matter);
            let field = engine.precompute(&medium, &Visibility { directions: 16, ..march(4) }, &mut quiet).expect("field");
            let lit = engine.relight(&field, &coloured()).expect("light");
            // From afar, from within, along a face.
            for position in [[1.6, -1.9, 1.1], [0.05, 0.02, 0.1], [0.5, -2.0, 0.0]] {
                for step in [1.0, 0.23, 3.7] {
                    let camera = camera(&grid, position, 30.0);
                    let [on, off] = [true, false].map(|skip| {
                        let image = ImageSettings { skip, ..image(40, 30, step) };
                        engine.render_with_distance(&medium, &lit, &camera, &image, &mut quiet).expect("picture")
                    });
                    assert!(on == off, "{dims:?}, {position:?}, step {step}: {} of {top}", medium.occupancy().occupied());
                }
            }
        }
    }
}

#[test]
fn a_speck_in_the_void_is_seen_by_leaping_rays() {
    let engine = engine();
    let grid = Grid::axis_aligned([64; 3], [1.0; 3]).expect("grid");
    // One voxel, in the corner of its block: only the apron tells the neighbours of it. Without it: nothing.
    for (at, expected) in [(Some([32, 32, 32]), true), (Some([35, 28, 63]), true), (None, false)] {
        let volume = Volume::from_fn(grid, |p| f32::from(u8::from(at == Some(p.map(|x| x as usize)) || p.iter().all(|&x| x < 1.0))))
            .expect("volume");
        let (_, medium) = load(&engine, &volume, &linear(2.0));
        let field = engine.precompute(&medium, &Visibility { directions: 4, ..march(8) }, &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
        let [on, off] = [true, false].map(|skip| {
            let image = ImageSettings { skip, ..image(96, 96, 0.25) };
            let camera =
                Camera { target: DVec3::from(at.unwrap_or([32; 3]).map(|x| x as f64 + 0.5)), ..camera(&grid, [0.3, -2.0, 0.2], 6.0) };
            engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture")
        });
        assert!(on == off);
        assert_eq!(on.rgba.iter().any(|p| p[3] > 0.5), expected, "{at:?}");
    }
}

#[test]
fn a_grey_light_in_one_channel_shows_what_it_shows_in_three() {
    let engine = engine();
    let grid = oblique([30, 24, 26]);
    let volume = blobs(grid, 4);
    let grey = Light::constant([0.4; 3]).plus(&Light::cone(DVec3::new(0.3, -0.5, 0.8), 40.0, [3.0; 3]));
    let mut coloured = grey;
    // Dimmer in blue alone: red and green are stored as before, in three channels.
    coloured.coefficients.iter_mut().for_each(|l| l[2] *= 0.5);
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    // An albedo that varies, and one that does not.
    for matter in [linear(0.8), homogeneous(0.1)] {
        let (_, medium) = load(&engine, &volume, &matter);
        let field = engine.precompute(&medium, &march(2), &mut quiet).expect("field");
        let [one, three] = [grey, coloured].map(|light| engine.relight(&field, &light).expect("light"));
        for (a, b) in engine.read_irradiance(&one).expect("read").iter().zip(engine.read_irradiance(&three).expect("read")) {
            assert_eq!((a[0], a[1], a[3]), (b[0], b[1], b[3]));
            assert!(a[2] == a[0] && (b[2] - 0.5 * b[0]).abs() <= 1e-3 * b[0].abs());
        }
        let [one, three] = [one, three].map(|lit| engine.render(&medium, &lit, &camera, &image(64, 48, 1.0), &mut quiet).expect("picture"));
        assert!(one.rgba.iter().any(|p| p[0] > 0.1));
        for (a, b) in one.rgba.iter().zip(&three.rgba) {
            assert!((0..2).chain(3..4).all(|c| (a[c] - b[c]).abs() < 1e-6), "{a:?} {b:?}");
        }
        // Sabotage: blue is told apart.
        assert!(one.rgba.iter().zip(&three.rgba).any(|(a, b)| (a[2] - b[2]).abs() > 0.01));
    }
}
