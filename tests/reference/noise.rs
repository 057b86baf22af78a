//! How sure a reference picture is: its standard error, its seeds, and when it stops.

use super::*;

#[test]
fn its_standard_error_is_the_scatter_between_seeds_and_falls_with_the_root_of_samples() {
    let (engine, medium, camera) = small_scene();
    let sky = Sky::from_probe(&Probe::two_colored());
    let run =
        |seed: u32, samples: u32| render(&engine, &medium, &sky, &camera, &image(24, 18), &ReferenceSettings { seed, ..all(samples) });
    let seeds: Vec<Reference> = (0..12).map(|seed| run(seed * 1000, 128)).collect();
    let (mut scatter, mut claimed) = (0.0, 0.0);
    for i in 0..24 * 18 {
        for c in 0..3 {
            let values: Vec<f64> = seeds.iter().map(|r| f64::from(r.picture.rgba[i][c])).collect();
            let mean = values.iter().sum::<f64>() / 12.0;
            scatter += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 11.0;
            claimed += seeds.iter().map(|r| f64::from(r.standard_error[i][c]).powi(2)).sum::<f64>() / 12.0;
        }
    }
    let ratio = (scatter / claimed).sqrt();
    println!("scatter between seeds / standard error: {ratio:.3}");
    // Some 400 lit numbers, 11 degrees of freedom each: a few percent.
    assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
    let fall = run(0, 128).relative_error / run(0, 2048).relative_error;
    println!("16 times the samples: {fall:.3} times less error");
    assert!((fall - 4.0).abs() < 0.3, "{fall}");
}

#[test]
fn neighbouring_seeds_are_independent_pictures() {
    // Haze under an even sky: noise comes from how many collisions a viewing ray meets, draw after draw.
    let engine = engine();
    let grid = Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 5), &linear(0.02));
    let camera = camera(&grid, [1.6, -1.9, 1.1], 30.0);
    let sky = Sky::constant([1.0; 3]).expect("sky");
    let run =
        |seed: u32, samples: u32| render(&engine, &medium, &sky, &camera, &image(24, 18), &ReferenceSettings { seed, ..all(samples) });
    let (truth, seeds) = (run(1 << 20, 8192), (0..12).map(|seed| run(seed, 128)).collect::<Vec<Reference>>());
    // How far the mean of some pictures lies from the truth, in what independent ones of their standard errors leave.
    let off = |pictures: &[&Reference]| {
        let (mut squares, mut expected) = (0.0, 0.0);
        let n = pictures.len() as f64;
        for i in 0..24 * 18 {
            for c in 0..3 {
                let of = |value: &dyn Fn(&Reference) -> f32| pictures.iter().map(|r| f64::from(value(r))).collect::<Vec<f64>>();
                let mean = of(&|r| r.picture.rgba[i][c]).iter().sum::<f64>() / n;
                squares += (mean - f64::from(truth.picture.rgba[i][c])).powi(2);
                expected += of(&|r| r.standard_error[i][c]).iter().map(|e| e * e).sum::<f64>() / (n * n);
                expected += f64::from(truth.standard_error[i][c]).powi(2);
            }
        }
        (squares / expected).sqrt()
    };
    let all_of_them = off(&seeds.iter().collect::<Vec<_>>());
    println!("the mean of seeds 0 to 11 is {all_of_them:.3} of what independent pictures leave from the truth");
    // Some 400 lit numbers.
    assert!((all_of_them - 1.0).abs() < 0.12, "{all_of_them}");
    // Sabotage: one picture twelve times is no better than once.
    assert!(off(&[&seeds[3]; 12]) > 2.0);
}

#[test]
fn a_picture_in_which_nothing_was_lit_yet_is_not_certain() {
    let engine = engine();
    // The only light stands behind ten mean free paths: one sample in two thousand sees it.
    let grid = Grid::axis_aligned([10; 3], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &blobs(grid, 2), &homogeneous(1.0));
    let camera = camera(&grid, [0.0, -3.0, 0.0], 10.0);
    let (sky, ..) = spot(DVec3::new(0.01, 0.9999, 0.005));
    let run = |sky: &Sky, samples: u32| {
        render(&engine, &medium, sky, &camera, &image(2, 2), &ReferenceSettings { error: 0.05, samples, ..ReferenceSettings::default() })
    };
    let first = run(&sky, 32);
    assert!(first.picture.rgba.iter().all(|p| p[0] == 0.0 && p[3] > 0.5), "{:?}", first.picture.rgba);
    assert!(first.relative_error.is_infinite() && first.samples == 32, "{}", first.relative_error);
    let longer = run(&sky, 8192);
    assert!(longer.picture.rgba.iter().any(|p| p[0] > 0.0) && longer.relative_error > 0.05 && longer.samples == 8192, "{longer:?}");
    // Where there is nothing to be lit, or no light, black is certain at once.
    let dark = run(&Sky::constant([0.0; 3]).expect("sky"), 8192);
    assert!(dark.relative_error == 0.0 && dark.samples == 32);
    let points = [[0.0, 0.0, 0.0, 0.0, 1.0]];
    let kinds = (halflight::scene::transfer::Kind::Extinction, halflight::scene::transfer::Reference::World);
    let black = Matter { transfer: halflight::scene::Transfer::from_points(&points, kinds.0, kinds.1).expect("transfer"), surface: None };
    let black = [black, surface(Surface { iso: 0.3, shading: Shading::Lambert, albedo: Some([0.0; 3]) })];
    for matter in black {
        let (_, medium) = load(&engine, &blobs(grid, 2), &matter);
        let settings = ReferenceSettings { error: 0.05, ..ReferenceSettings::default() };
        let r = render(&engine, &medium, &sky, &camera, &image(2, 2), &settings);
        assert!(r.relative_error == 0.0 && r.samples == 32 && r.picture.rgba.iter().any(|p| p[3] > 0.5));
    }
}

#[test]
fn it_stops_when_told_and_keeps_what_was_finished() {
    let (engine, medium, camera) = small_scene();
    let sky = Sky::constant([1.0; 3]).expect("sky");
    let wanted = ReferenceSettings { error: 0.04, ..ReferenceSettings::default() };
    let mut told = vec![];
    let mut watch = |_: &'static str, f: f32| {
        told.push(f);
        ControlFlow::Continue(())
    };
    let reference = engine.render_reference(&medium, &sky, &camera, &image(24, 18), &wanted, &mut watch).expect("picture");
    assert!(reference.relative_error <= 0.04 && reference.samples < 4096, "{} after {}", reference.relative_error, reference.samples);
    assert!(told.windows(2).all(|w| w[0] <= w[1]) && told.first() == Some(&0.0) && told.last() == Some(&1.0), "{told:?}");
    // Stopped in the second pass, the first is kept; before that there is none.
    let stop_after = |calls: usize| {
        let mut count = 0;
        let mut stop = move |_: &'static str, _: f32| {
            count += 1;
            if count > calls { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        engine.render_reference(&medium, &sky, &camera, &image(24, 18), &all(1 << 20), &mut stop)
    };
    let kept = stop_after(60).expect("finished passes");
    let same = render(&engine, &medium, &sky, &camera, &image(24, 18), &all(kept.samples));
    assert!(kept.cancelled && kept.picture == same.picture && !same.cancelled);
    assert!(matches!(stop_after(0), Err(Error::Cancelled)) && matches!(stop_after(1), Err(Error::Cancelled)));
    for bad in [
        ReferenceSettings { samples: 0, ..wanted },
        ReferenceSettings { error: -0.1, ..wanted },
        ReferenceSettings { error: f64::NAN, ..wanted },
        ReferenceSettings { seconds: Some(0.0), ..wanted },
    ] {
        let refused = engine.render_reference(&medium, &sky, &camera, &image(8, 6), &bad, &mut quiet);
        assert!(matches!(refused, Err(Error::Invalid { .. })), "{bad:?}");
    }
    let dark = render(&engine, &medium, &Sky::constant([0.0; 3]).expect("sky"), &camera, &image(8, 6), &wanted);
    assert!(dark.relative_error == 0.0 && dark.picture.rgba.iter().all(|p| p[0] == 0.0));
}
