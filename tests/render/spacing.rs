//! Spacing from nanometres to light years: pictures, traces and layers are the same but for the unit of distances.

use super::*;
use halflight::engine::{Behind, ReferenceSettings};
use halflight::scene::{Clip, Matter, Probe, Sky};

/// All that can be seen of some matter, in a unit of length.
struct Seen {
    picture: Picture,
    traced: Picture,
    behind: Vec<Behind>,
}

/// `factor` of the extinction that is the same per voxel at every unit.
fn seen(unit: f64, solid: bool, factor: f64) -> Seen {
    let engine = engine();
    let grid = Grid::axis_aligned([16, 12, 10], [unit, 1.5 * unit, unit]).expect("grid");
    // Samples are as small as densities in CGS units: gradients must not vanish.
    let blobs = blobs(grid, 6);
    let samples = (0..16 * 12 * 10).map(|i| blobs.value(i) * 2f32.powi(-80)).collect();
    let volume = Volume::new(grid, halflight::scene::Samples::F32(samples), 1.0, 0.0).expect("volume");
    let top = 2f64.powi(-80);
    let matter = if solid {
        surface(Surface { iso: 0.35 * top, shading: Shading::Lambert, albedo: Some([0.8, 0.6, 0.4]) })
    } else {
        let points = [[0.0, 0.9, 0.2, 0.4, 0.0], [top, 0.3, 0.8, 0.6, 0.7 * factor / unit]];
        let kinds = (halflight::scene::transfer::Kind::Extinction, halflight::scene::transfer::Reference::World);
        Matter { transfer: halflight::scene::Transfer::from_points(&points, kinds.0, kinds.1).expect("transfer"), surface: None }
    };
    let clip = Clip { planes: vec![[0.3, -0.5, -0.8, -0.2]], ..Clip::default() };
    let medium = engine.classify_clipped(&engine.upload(&volume).expect("upload"), &matter, &clip).expect("classify");
    let field = engine.precompute(&medium, &Visibility { directions: 64, ..march(2) }, &mut quiet).expect("field");
    let lit = engine.relight(&field, &coloured()).expect("light");
    let camera = camera(&grid, [0.9, 0.8, 1.9], 40.0);
    let settings = image(24, 18, 0.5);
    let (picture, hits) = engine.render_with_distance(&medium, &lit, &camera, &settings, &mut quiet).expect("picture");
    let behind = engine.aovs(&medium, &lit, &camera, &settings, &hits, &mut quiet).expect("layers");
    let all = ReferenceSettings { samples: 32, error: 0.0, ..ReferenceSettings::default() };
    let sky = Sky::from_probe(&Probe::two_colored());
    let traced = engine.render_reference(&medium, &sky, &camera, &settings, &all, &mut quiet).expect("reference").picture;
    Seen { picture, traced, behind }
}

/// Every number, distances in units.
fn numbers(s: &Seen, unit: f64) -> Vec<f32> {
    let colours = s.picture.rgba.iter().chain(&s.traced.rgba).flatten().copied();
    let behind = s.behind.iter().flat_map(|b| {
        let far = |x: f32| (f64::from(x) / unit) as f32;
        [&[far(b.first), far(b.depth), b.visibility, b.opacity], &b.normal[..], &b.albedo, &b.irradiance].concat()
    });
    colours.chain(behind).collect()
}

#[test]
fn pictures_traces_and_layers_are_the_same_from_nanometres_to_light_years() {
    for solid in [false, true] {
        let plain = numbers(&seen(1.0, solid, 1.0), 1.0);
        let lit = plain.iter().filter(|x| **x > 0.0 && x.is_finite()).count();
        assert!(lit > 800, "{lit}");
        // Units that are powers of two, from about 1e-9 to 1e24, change no bit.
        for unit in [-30, 20, 50, 68, 80].map(|e| 2f64.powi(e)) {
            let got = numbers(&seen(unit, solid, 1.0), unit);
            assert!(got == plain, "{unit:e}, surface {solid}: {:?}", worst(&got, &plain));
        }
        // Others round otherwise, and a trace's draws fall on the other side of a rounded number here and there.
        for unit in [1e-9, 3.1e20, 1e24] {
            let got = numbers(&seen(unit, solid, 1.0), unit);
            let near = |a: f32, b: f32| a == b || (a - b).abs() < 2e-3 * (1.0 + b.abs());
            let equal = got.iter().zip(&plain).filter(|(a, b)| near(**a, **b)).count();
            assert!(equal * 100 > plain.len() * 99, "{unit:e}, surface {solid}: {equal} of {}", plain.len());
        }
    }
    // Sabotage: a twentieth more matter.
    assert!(numbers(&seen(1.0, false, 1.05), 1.0) != numbers(&seen(1.0, false, 1.0), 1.0));
}

#[test]
fn a_spacing_beyond_single_precision_is_refused() {
    let refused = Grid::axis_aligned([4; 3], [1.0, 1.0, 1.1e30]).expect_err("too far apart").to_string();
    assert!(refused.contains("1.1e30") && refused.contains("at most 1e30"), "{refused}");
    assert!(Grid::axis_aligned([4; 3], [1e30; 3]).is_ok());
}
