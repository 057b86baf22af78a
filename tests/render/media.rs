//! Direct volume rendering and relighting: formulas and twins.

use super::*;

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
fn what_lies_behind_opaque_matter_does_not_shine_through_however_bright() {
    let engine = engine();
    let grid = Grid::axis_aligned([24; 3], [1.0; 3]).expect("grid");
    let camera = camera(&grid, [0.0, -3.0, 0.0], 10.0);
    let stepped = |sigma: f64, background: Background, step: f64| {
        let (_, medium) = load(&engine, &blobs(grid, 2), &homogeneous(sigma));
        let field = engine.precompute(&medium, &march(4), &mut quiet).expect("field");
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("light");
        engine.render(&medium, &lit, &camera, &ImageSettings { background, ..image(8, 8, step) }, &mut quiet).expect("picture")
    };
    let at = |sigma: f64, background: Background| stepped(sigma, background, 0.5);
    let through = |p: &Picture| 1.0 - f64::from(p.rgba[4 * 8 + 4][3]);
    // A depth of 24: of a sun of 1e5 a millionth is left, not a hundred.
    for background in [Background::Color([1.0; 3]), Background::Light] {
        assert!(through(&at(1.0, background)) < 1e-7, "{background:?}: {:e}", through(&at(1.0, background)));
        // Thin matter lets pass what the formula says.
        assert!((through(&at(0.2, background)) / (-0.2f64 * 24.0).exp() - 1.0).abs() < 1e-2);
    }
    // Where nothing is laid behind, rays end as soon as a thousandth is left; light is the same to the last bit.
    let clear = at(1.0, Background::Transparent);
    assert!((1e-4..1e-3).contains(&through(&clear)), "{:e}", through(&clear));
    let laid = at(1.0, Background::Light);
    assert!(clear.rgba.iter().zip(&laid.rgba).all(|(a, b)| a[..3] == b[..3] && b[3] - a[3] < 1e-3));
    // The same where a ray takes several dispatches, dark early in one of them or late in the last.
    let fine = |sigma, background| stepped(sigma, background, 0.001);
    engine.take_timings();
    fine(0.31, Background::Light);
    assert!(engine.take_timings().iter().any(|s| s.kernel == "raymarch" && s.calls > 1), "one dispatch did");
    for sigma in [0.31, 1.0] {
        let [clear, laid] = [Background::Transparent, Background::Light].map(|b| fine(sigma, b));
        assert!(clear.rgba.iter().zip(&laid.rgba).all(|(a, b)| a[..3] == b[..3] && b[3] - a[3] < 1e-3));
        let formula = (-sigma * 24.0).exp();
        let off = through(&laid) - formula;
        assert!(off.abs() < 2e-2 * formula + 2e-7, "{sigma}: {:e} for {formula:e}", through(&laid));
    }
}
