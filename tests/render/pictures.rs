//! Pictures as a whole: strips, refusals, stray voxels, leaps over empty blocks, grey lights.

use super::*;

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
