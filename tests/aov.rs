//! What lies behind a picture's pixels: the kernel against its twin, formulas, sabotage.

mod common;
use common::*;
use halflight::scene::grid::glam::DVec3;
use halflight::scene::visibility::Method;
use halflight::scene::{Clip, Grid, ImageSettings, Light, Shading, Surface, Visibility, Volume};
use halflight::stages::aov::{self, Behind};
use halflight::stages::raymarch::View;
use halflight::stages::twin;

fn numbers(b: &Behind) -> Vec<f32> {
    [&[b.first, b.depth, b.visibility, b.opacity], &b.normal[..], &b.albedo, &b.irradiance].concat()
}

#[test]
fn layers_equal_their_twin() {
    let engine = engine();
    let clip = Clip { planes: vec![[0.3, -0.5, 0.8, -0.071]], ..Clip::default() };
    for (g, grid) in [Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid"), oblique([9, 14, 7])].into_iter().enumerate() {
        let (volume, matter) = (blobs(grid, 31 + g as u64), linear(0.8));
        let uploaded = engine.upload(&volume).expect("upload");
        let medium = engine.classify_clipped(&uploaded, &matter, &clip).expect("classify");
        let s = Visibility { method: Method::March, ratio: 2, directions: 64, bits: 32, step: 0.5, ..Visibility::default() };
        let field = engine.precompute(&medium, &s, &mut quiet).expect("field");
        let light = Light::constant([0.3, 0.4, 0.5]).plus(&Light::cone(DVec3::new(0.3, -0.5, 0.8), 40.0, [6.0, 1.0, 0.5]));
        let lit = engine.relight(&field, &light).expect("light");
        let cells = engine.read_irradiance(&lit).expect("read");
        let table = matter.transfer.table(volume.range(), &grid);
        let (dims, n) = (field.dims(), grid.dims());
        let light_at = |p: [f32; 3]| -> [f32; 4] {
            let q = std::array::from_fn(|a| p[a] / n[a] as f32 * dims[a] as f32);
            std::array::from_fn(|c| twin::texture(dims, q, |i| cells[i[0] + dims[0] * (i[1] + dims[1] * i[2])][c]))
        };
        let camera = camera(&grid, [1.6, -1.9, 1.1], 40.0);
        let image = ImageSettings { width: 24, height: 18, step: 0.7, ..ImageSettings::default() };
        let device = engine.aovs(&medium, &lit, &camera, &image, &[], &mut quiet).expect("layers");
        let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
        let view = View::new(&grid, &camera.rays(&grid, 24, 18).expect("rays"));
        let step = 0.7 * grid.voxel_length();
        let filtering = engine.filtering().expect("filtering");
        let worst = |planes: &[[f32; 4]]| {
            let mut worst = 0f32;
            for (i, d) in device.iter().enumerate() {
                let pixel = [i % 24, i / 24];
                let t = twin::filtered(filtering, || aov::reference(&volume, &table, &view, pixel, step, light_at, planes));
                // Means of next to nothing are next to nothing's rounding.
                if t.opacity < 0.01 && d.opacity < 0.01 {
                    continue;
                }
                for (k, (a, b)) in numbers(d).iter().zip(numbers(&t)).enumerate() {
                    // The first hit jumps where opacity comes close to the threshold and turns away.
                    if (t.opacity - aov::FIRST).abs() > 1e-3 {
                        let off = (a - b).abs() / (1.0 + b.abs().min(1e6));
                        if off > 0.9 * worst.max(5e-3) {
                            println!("pixel {i}, number {k}: {a} for {b}, of {d:?}");
                        }
                        worst = worst.max(off);
                    }
                }
            }
            worst
        };
        let planes = clip.half_spaces(&grid);
        // Quotients of sums that each differ by rounding, down to an opacity of 0.01; rays end at a transmittance of 1e-3.
        assert!(worst(&planes) < 5e-3, "grid {g}: {}", worst(&planes));
        assert!(worst(&[]) > 5e-2, "sabotage");
        for (d, p) in device.iter().zip(&picture.rgba) {
            assert!((d.opacity - p[3]).abs() < 2e-3, "opacity is the picture's: {} {}", d.opacity, p[3]);
        }
    }
}

#[test]
fn a_homogeneous_box_has_the_depths_of_the_formula() {
    let engine = engine();
    let (grid, sigma) = (Grid::axis_aligned([16; 3], [1.0; 3]).expect("grid"), 0.2);
    let (_, medium) = load(&engine, &blobs(grid, 2), &homogeneous(sigma));
    let s = Visibility { method: Method::March, ratio: 4, directions: 32, ..Visibility::default() };
    let lit = engine.relight(&engine.precompute(&medium, &s, &mut quiet).expect("field"), &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [-2.0, 0.0, 0.0], 20.0);
    let image = ImageSettings { width: 3, height: 3, step: 0.25, ..ImageSettings::default() };
    let b = engine.aovs(&medium, &lit, &camera, &image, &[], &mut quiet).expect("layers")[4];
    let (near, length) = (24.0, 16.0);
    assert!((f64::from(b.first) - near + (1.0 - f64::from(aov::FIRST)).ln() / sigma).abs() < 1e-3, "{}", b.first);
    // Mean of t under exp(-sigma t) over the box.
    let full = (-sigma * length).exp();
    let mean = 1.0 / sigma - length * full / (1.0 - full);
    assert!((f64::from(b.depth) - near - mean).abs() < 0.01, "{} for {}", b.depth, near + mean);
    assert!((f64::from(b.opacity) - (1.0 - full)).abs() < 2e-3 && b.albedo == [1.0; 3] && b.normal == [0.0; 3]);
}

#[test]
fn a_ball_has_its_normals_and_sees_half_the_sky() {
    let engine = engine();
    let grid = Grid::axis_aligned([40, 40, 20], [1.0, 1.0, 2.0]).expect("grid");
    let radius = |p: [f64; 3]| ((p[0] - 20.0).powi(2) + (p[1] - 20.0).powi(2) + (2.0 * p[2] - 20.0).powi(2)).sqrt();
    let volume = Volume::from_fn(grid, |p| (14.0 - radius(p)) as f32).expect("volume");
    let (_, medium) = load(&engine, &volume, &surface(Surface { iso: 0.0, shading: Shading::Lambert, albedo: Some([0.5; 3]) }));
    let s = Visibility { method: Method::March, ratio: 1, directions: 256, step: 0.5, ..Visibility::default() };
    let lit = engine.relight(&engine.precompute(&medium, &s, &mut quiet).expect("field"), &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let image = ImageSettings { width: 32, height: 24, ..ImageSettings::default() };
    let (_, hits) = engine.render_with_distance(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
    let rays = camera.rays(&grid, 32, 24).expect("rays");
    let behind = engine.aovs(&medium, &lit, &camera, &image, &hits, &mut quiet).expect("layers");
    let mut seen = 0;
    for (i, b) in behind.iter().enumerate() {
        if hits[i] < 0.0 {
            assert!(b.opacity == 0.0 && b.first.is_infinite() && b.normal == [0.0; 3]);
            continue;
        }
        seen += 1;
        let w = rays.direction_world((i % 32) as f64, (i / 32) as f64);
        let outward = (camera.position + w * f64::from(hits[i]) - grid.centre_world()).normalize();
        let got = DVec3::new(b.normal[0].into(), b.normal[1].into(), b.normal[2].into());
        assert!(got.dot(outward) > 0.99, "pixel {i}: {got} for {outward}");
        // A convex body shades nothing but itself: h outside it, 1/2 + 1/2 sqrt(1 - (r/(r+h))^2) of the sky is seen, and
        // vacuum cells stand up to a cell's edge of 2 outside.
        assert!((0.48..0.76).contains(&b.visibility), "pixel {i}: {}", b.visibility);
    }
    assert!(seen > 100);
    let none = engine.aovs(&medium, &lit, &camera, &image, &[], &mut quiet).expect_err("needs hits").to_string();
    assert!(none.contains("0 distances for 768 pixels"), "{none}");
}

#[test]
fn visibility_keeps_within_0_and_1_though_a_fitted_field_does_not() {
    let sums = |visibility: f32| [[0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, visibility], [0.0, 0.5, 0.0, 0.0]];
    for (sum, expected) in [(-0.0097, 0.0), (0.25, 0.5), (0.51, 1.0)] {
        assert_eq!(Behind::of(&sums(sum)).visibility, expected);
    }
    // Hard matter in coarse cells: where all around is dark, what is fitted to matter elsewhere swings below 0.
    let engine = engine();
    let grid = Grid::axis_aligned([32; 3], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 3), &linear(6.0));
    let s = Visibility { method: Method::Sweep, ratio: 4, directions: 64, fit: 8, ..Visibility::default() };
    let lit = engine.relight(&engine.precompute(&medium, &s, &mut quiet).expect("field"), &Light::constant([1.0; 3])).expect("light");
    let cells = engine.read_irradiance(&lit).expect("read");
    let below = cells.iter().filter(|c| c[3] < 0.0).count();
    let image = ImageSettings { width: 32, height: 24, ..ImageSettings::default() };
    let behind = engine.aovs(&medium, &lit, &camera(&grid, [1.6, -1.9, 1.1], 30.0), &image, &[], &mut quiet).expect("layers");
    println!("{below} cells below 0");
    assert!(below > 0 && behind.iter().all(|b| (0.0..=1.0).contains(&b.visibility)));
}
