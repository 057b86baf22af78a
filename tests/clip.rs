//! Clip planes: what lies beyond is vacuum, for viewing rays and for shadows. Formulas, twins, sabotage.

mod common;
use common::*;
use halflight::engine::{Engine, Medium, ReferenceSettings};
use halflight::measure::field_error;
use halflight::scene::camera::Space;
use halflight::scene::grid::glam::DVec3;
use halflight::scene::visibility::{Cells, Method};
use halflight::scene::{Clip, Grid, ImageSettings, Light, Matter, Probe, Shading, Sky, Surface, Visibility, Volume};
use halflight::stages::directions::Directions;
use halflight::stages::raymarch::{self, View};
use halflight::stages::{classify, march, sweep};

fn clipped(engine: &Engine, volume: &Volume, matter: &Matter, clip: &Clip) -> Medium {
    let uploaded = engine.upload(volume).expect("upload");
    engine.classify_clipped(&uploaded, matter, clip).expect("classify")
}

/// An oblique cut and a box; no sample stands on either.
fn oblique_cut() -> Clip {
    Clip { bounds: Some([[0.0, 0.13, 0.0], [0.83, 1.0, 1.0]]), planes: vec![[0.3, -0.5, 0.8, -0.071]], space: Space::Side }
}

fn grids() -> [Grid; 3] {
    [
        Grid::axis_aligned([20, 16, 12], [1.0; 3]).expect("grid"),
        Grid::axis_aligned([17, 13, 11], [1.0, 1.0, 5.0]).expect("grid"),
        oblique([9, 14, 7]),
    ]
}

#[test]
fn every_estimator_equals_its_twin_under_clip_planes() {
    let engine = engine();
    for (g, grid) in grids().into_iter().enumerate() {
        let (volume, matter, clip) = (blobs(grid, 41 + g as u64), linear(0.8), oblique_cut());
        let planes = clip.half_spaces(&grid);
        assert_eq!(planes.len(), 3);
        let medium = clipped(&engine, &volume, &matter, &clip);
        let table = matter.transfer.table(volume.range(), &grid);
        let dims = grid.field_dims(2);
        let cells: Vec<u32> = (0..dims.iter().product::<usize>() as u32).collect();
        let s = Visibility { ratio: 2, directions: 29, bits: 32, step: 0.5, near: 2, cells: Cells::All, ..Visibility::default() };
        let step_length = 0.5 * grid.voxel_length();

        let device = engine.estimate(&medium, &Visibility { method: Method::March, ..s.clone() }, &cells, &mut quiet).expect("march");
        let set = Directions::new(29, s.sampling, &grid);
        let twin = |planes| march::reference_clipped(&volume, &table, dims, &cells, &set, step_length, planes);
        let e = field_error(&device, &twin(&planes)).relative_l2;
        // Single precision: where a plane cuts a ray is rounded, and exp by a few ulp; some 1e-4 of the coefficients.
        assert!(e < 1e-3, "march, grid {g}: {e}");
        // Sabotage: without the oblique plane it is another field.
        let e = field_error(&device, &twin(&planes[..2])).relative_l2;
        assert!(e > 1e-2, "march, grid {g}: {e}");

        let device = engine.estimate(&medium, &Visibility { method: Method::Sweep, ..s.clone() }, &cells, &mut quiet).expect("sweep");
        let settings = sweep::Settings { near: 2, step_length };
        let rays = sweep::rays(29, &grid);
        let twin = |planes| sweep::reference_clipped(&volume, &table, dims, &rays, settings, planes);
        let e = field_error(&device, &twin(&planes)).relative_l2;
        assert!(e < 1e-3, "sweep, grid {g}: {e}");
        assert!(field_error(&device, &twin(&planes[..2])).relative_l2 > 1e-2);

        let o0 = &engine.read_pyramid(&medium, &s).expect("pyramid")[0];
        let twin = |planes| worst(o0, &classify::reference_clipped(&volume, &table, planes)).0;
        // Half floats, and where a sample stands within rounding of a plane.
        assert!(twin(&planes) < 1e-3, "classify, grid {g}: {}", twin(&planes));
        assert!(twin(&planes[..2]) > 1e-2);
    }
}

#[test]
fn a_clipped_medium_covers_by_the_chord_that_is_left() {
    let engine = engine();
    let (n, sigma) = ([20usize, 30, 10], 0.07);
    let grid = Grid::axis_aligned(n, [1.0, 0.5, 2.0]).expect("grid");
    // Kept: y below 9 world units, and x + z above 12.
    let clip = Clip { planes: vec![[0.0, -1.0, 0.0, -9.0], [1.0, 0.0, 1.0, 12.0 / 2f64.sqrt()]], space: Space::World, ..Clip::default() };
    let volume = blobs(grid, 2);
    let medium = clipped(&engine, &volume, &homogeneous(sigma), &clip);
    let s = Visibility { method: Method::March, ratio: 4, directions: 32, ..Visibility::default() };
    let field = engine.precompute(&medium, &s, &mut quiet).expect("field");
    let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [-1.6, 1.9, -1.1], 30.0);
    let rays = camera.rays(&grid, 40, 30).expect("rays");
    for step in [0.5, 3.0] {
        let image = ImageSettings { width: 40, height: 30, step, ..ImageSettings::default() };
        let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
        let mut cut = 0;
        for (i, pixel) in picture.rgba.iter().enumerate() {
            let (o, w) = (camera.position, rays.direction_world((i % 40) as f64, (i / 40) as f64));
            let (mut enter, mut leave) = (0f64, f64::INFINITY);
            // All faces as half spaces n.p >= d.
            let sides = [20.0, 15.0, 20.0];
            let mut faces = vec![(-DVec3::Y, -9.0), (DVec3::new(1.0, 0.0, 1.0), 12.0)];
            for (axis, side) in DVec3::AXES.into_iter().zip(sides) {
                faces.push((axis, 0.0));
                faces.push((-axis, -side));
            }
            for (k, (n, d)) in faces.into_iter().enumerate() {
                let t = (d - n.dot(o)) / n.dot(w);
                if n.dot(w) > 0.0 {
                    cut += usize::from(k < 2 && t > enter);
                    enter = enter.max(t);
                } else {
                    leave = leave.min(t);
                }
            }
            let expected = 1.0 - (-sigma * (leave - enter).max(0.0)).exp();
            // A cut step is integrated whole, so that only rounding is left.
            assert!((f64::from(pixel[3]) - expected).abs() < 1e-4, "step {step}, pixel {i}: {} for {expected}", pixel[3]);
        }
        assert!(cut > 100);
    }
    // The reference renderer, which tracks, finds the same opacity within its noise.
    let image = ImageSettings { width: 20, height: 15, ..ImageSettings::default() };
    let sky = Sky::from_probe(&Probe::two_colored());
    let settings = ReferenceSettings { error: 0.0, samples: 256, ..ReferenceSettings::default() };
    let traced = engine.render_reference(&medium, &sky, &camera, &image, &settings, &mut quiet).expect("reference");
    let plain = engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
    let unclipped = clipped(&engine, &volume, &homogeneous(sigma), &Clip::default());
    let whole = engine.render(&unclipped, &lit, &camera, &image, &mut quiet).expect("picture");
    let off = |p: &halflight::scene::Picture| {
        let sum: f32 = p.rgba.iter().zip(&traced.picture.rgba).map(|(a, b)| (a[3] - b[3]).powi(2)).sum();
        (sum / p.rgba.len() as f32).sqrt()
    };
    // 256 samples of an opacity: at most a half over sqrt(256), 0.03, where it is a half, and most pixels are clear or dense.
    assert!(off(&plain) < 0.02, "{}", off(&plain));
    assert!(off(&whole) > 0.1, "sabotage: {}", off(&whole));
}

#[test]
fn a_clipped_frame_equals_its_twin() {
    let engine = engine();
    for (g, grid) in grids().into_iter().enumerate() {
        let (volume, matter, clip) = (blobs(grid, 31 + g as u64), linear(0.8), oblique_cut());
        let planes = clip.half_spaces(&grid);
        let medium = clipped(&engine, &volume, &matter, &clip);
        let s = Visibility { method: Method::March, ratio: 1, directions: 1, ..Visibility::default() };
        let lit = engine.relight(&engine.precompute(&medium, &s, &mut quiet).expect("field"), &Light::DARK).expect("light");
        let table = matter.transfer.table(volume.range(), &grid);
        // From outside, and from inside.
        for offset in [[1.6, -1.9, 1.1], [0.1, 0.02, 0.05]] {
            let camera = camera(&grid, offset, 45.0);
            let image = ImageSettings { width: 24, height: 18, step: 0.7, ..ImageSettings::default() };
            let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
            let view = View::new(&grid, &camera.rays(&grid, 24, 18).expect("rays"));
            let off = |planes: &[[f32; 4]]| {
                let at = |i: usize| {
                    let step = 0.7 * grid.voxel_length();
                    let t = raymarch::reference_clipped(&volume, &table, &view, [i % 24, i / 24], step, |_| [0.0; 3], planes);
                    (picture.rgba[i][3] + (-t[3]).exp_m1()).abs()
                };
                (0..24 * 18).map(at).fold(0f32, f32::max)
            };
            // Rays end at a transmittance of 1e-3, in another step where it is rounded otherwise.
            assert!(off(&planes) < 2e-3, "grid {g}: {}", off(&planes));
            assert!(off(&planes[..2]) > 1e-2, "sabotage, grid {g}");
        }
    }
}

#[test]
fn shadows_obey_the_planes() {
    // A slab above a block: clipped away, the block's cells see what they see where there never was a slab.
    let engine = engine();
    let grid = Grid::axis_aligned([16, 16, 24], [1.0; 3]).expect("grid");
    let filled = |slab: bool| Volume::from_fn(grid, |p| if p[2] < 8.0 || (slab && p[2] > 16.0) { 1.0 } else { 0.0 }).expect("volume");
    let clip = Clip { bounds: Some([[0.0; 3], [1.0, 1.0, 0.5]]), ..Clip::default() };
    let matter = linear(0.6);
    let dims = grid.field_dims(2);
    let cells: Vec<u32> = (0..(dims[0] * dims[1] * 6) as u32).collect();
    for method in [Method::March, Method::Sweep, Method::Hierarchical] {
        let s = Visibility { method, ratio: 2, directions: 64, bits: 32, cells: Cells::All, ..Visibility::default() };
        let of =
            |slab, clip: &Clip| engine.estimate(&clipped(&engine, &filled(slab), &matter, clip), &s, &cells, &mut quiet).expect("field");
        let (free, cut, shadowed) = (of(false, &Clip::default()), of(true, &clip), of(true, &Clip::default()));
        let e = field_error(&cut, &free).relative_l2;
        // The hierarchy's coarse levels have no other matter either; rounding is what is left.
        assert!(e < 1e-3, "{method:?}: {e}");
        assert!(field_error(&shadowed, &free).relative_l2 > 0.2, "sabotage, {method:?}");
    }
}

#[test]
fn a_cut_surface_shows_its_inside_with_the_planes_normal() {
    let engine = engine();
    let n = 40.0;
    let grid = Grid::axis_aligned([40; 3], [1.0; 3]).expect("grid");
    let ball =
        Volume::from_fn(grid, |p| (14.0 - ((p[0] - n / 2.0).powi(2) + (p[1] - n / 2.0).powi(2) + (p[2] - n / 2.0).powi(2)).sqrt()) as f32)
            .expect("volume");
    // The half towards the camera is cut away, 4 units before the centre.
    let clip = Clip { planes: vec![[1.0, 0.0, 0.0, -0.1]], ..Clip::default() };
    let matter = surface(Surface { iso: 0.0, shading: Shading::Lambert, albedo: Some([0.8, 0.6, 0.4]) });
    let medium = clipped(&engine, &ball, &matter, &clip);
    let s = Visibility { method: Method::March, ratio: 2, directions: 256, step: 0.5, ..Visibility::default() };
    let field = engine.precompute(&medium, &s, &mut quiet).expect("field");
    let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
    let camera = camera(&grid, [-2.0, 0.0, 0.0], 30.0);
    let image = ImageSettings { width: 33, height: 33, ..ImageSettings::default() };
    let (picture, hits) = engine.render_with_distance(&medium, &lit, &camera, &image, &mut quiet).expect("picture");
    let middle = 16 * 33 + 16;
    // 80 to the centre less 4, by bisection in single precision.
    assert!((hits[middle] - 76.0).abs() < 1e-3, "{}", hits[middle]);
    // A plane that nothing shades shows its albedo, as far as four bands of half a sky do.
    for c in 0..3 {
        assert!((picture.rgba[middle][c] - [0.8, 0.6, 0.4][c]).abs() < 0.03, "{:?}", picture.rgba[middle]);
    }
    let behind = engine.aovs(&medium, &lit, &camera, &image, &hits, &mut quiet).expect("layers");
    let b = &behind[middle];
    assert!((b.normal[0] + 1.0).abs() < 1e-6 && b.normal[1] == 0.0 && (b.first, b.depth, b.opacity) == (hits[middle], hits[middle], 1.0));
    // h before a disc of radius 13.4, 1/2 + 1/2 h/sqrt(h^2 + 13.4^2); vacuum cells stand at most 2 before it.
    assert!((0.49..0.58).contains(&b.visibility), "a plane sees half the sky: {}", b.visibility);
    // And the reference renderer finds the same place and brightness.
    let sky = Sky::constant([1.0; 3]).expect("sky");
    let settings = ReferenceSettings { error: 0.0, samples: 256, ..ReferenceSettings::default() };
    let traced = engine.render_reference(&medium, &sky, &camera, &image, &settings, &mut quiet).expect("reference");
    let places = (-3..=3i32).flat_map(|j| (-3..=3i32).map(move |i| (middle as i32 + 33 * j + i) as usize));
    let mean = places.map(|p| traced.picture.rgba[p][0]).sum::<f32>() / 49.0;
    // 49 pixels of 256 samples of a cosine.
    assert!((mean - 0.8).abs() < 0.02, "{mean}");
}
