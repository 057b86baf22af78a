//! Probes and lights against theory, brute force, and Mitsuba's own lookup.

use glam::{DMat3, DVec3};
use halflight::Error;
use halflight::io::read_probe;
use halflight::scene::sh::{self, Window};
use halflight::scene::{Light, Probe};
use std::f64::consts::PI;
use std::path::PathBuf;

const AXES: [DVec3; 6] = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];

fn spread(n: usize) -> impl Iterator<Item = DVec3> {
    // Spherical Fibonacci points.
    (0..n).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let phi = 2.0 * PI * (i as f64 * 0.618_033_988_749_894_8).fract();
        DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z)
    })
}

fn distance(a: &Light, b: &Light) -> f64 {
    let difference = a.plus(&b.scaled(-1.0));
    let norm = |l: &Light| l.energy().iter().flatten().sum::<f64>().sqrt();
    norm(&difference) / norm(b)
}

/// A file of the test data, or a printed reason.
fn data(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/probes")).join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

#[test]
fn constant_light_is_constant() {
    let light = Light::constant([1.0, 2.0, 0.5]);
    for dir in spread(50) {
        let [r, g, b] = light.radiance(dir);
        assert!((r - 1.0).abs() < 1e-14 && (g - 2.0).abs() < 1e-14 && (b - 0.5).abs() < 1e-14);
    }
    // Furnace: fully visible everywhere, v00 = 2√π, S = L00·v00/4π = 1.
    assert!((light.coefficients[0][0] * 2.0 * PI.sqrt() / (4.0 * PI) - 1.0).abs() < 1e-14);
    let probe = Probe::new(8, 4, vec![[1.0, 2.0, 0.5]; 32]).unwrap();
    assert!(distance(&Light::from_probe(&probe), &light) < 1e-13, "even four rows project a constant exactly");
}

#[test]
fn a_very_bright_pixel_keeps_its_energy() {
    for bright in [(200, 3), (0, 0), (511, 128), (77, 255)] {
        let mut pixels = vec![[0.1f32, 0.2, 0.3]; 512 * 256];
        pixels[bright.1 * 512 + bright.0] = [1e6, 5e5, 1e6];
        let probe = Probe::new(512, 256, pixels).unwrap();
        let (mean, light) = (probe.mean(), Light::from_probe(&probe));
        // The pixel's solid angle, by its own formula.
        let solid = 2.0 * PI / 512.0 * ((PI * bright.1 as f64 / 256.0).cos() - (PI * (bright.1 + 1) as f64 / 256.0).cos());
        for c in 0..3 {
            let (low, high) = ([0.1f32, 0.2, 0.3][c], [1e6f32, 5e5, 1e6][c]);
            let integral = f64::from(low) * (4.0 * PI - solid) + f64::from(high) * solid;
            assert!((light.coefficients[0][c] / (integral * (0.25 / PI).sqrt()) - 1.0).abs() < 1e-9);
            assert!((light.coefficients[0][c] / (mean[c] * 4.0 * PI * (0.25 / PI).sqrt()) - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn projection_equals_brute_force() {
    // Every pixel cut into 16x16 patches, each weighted with its exact solid angle: another code path.
    let probe = Probe::from_fn(16, 8, |d| [(1.0 + d.x) as f32, (2.0 + d.y * d.z) as f32, (d.z > 0.3) as u8 as f32 * 7.0]).unwrap();
    let mut brute = Light::DARK;
    let cut = 16;
    for j in 0..8 * cut {
        let (top, bottom) = (PI * j as f64 / (8 * cut) as f64, PI * (j + 1) as f64 / (8 * cut) as f64);
        for i in 0..16 * cut {
            let turn = 2.0 * PI * (i as f64 + 0.5) / (16 * cut) as f64;
            let theta = 0.5 * (top + bottom);
            let dir = DVec3::new(theta.sin() * turn.sin(), theta.sin() * turn.cos(), theta.cos());
            let weight = 2.0 * PI / (16 * cut) as f64 * (top.cos() - bottom.cos());
            let pixel = probe.pixels()[j / cut * 16 + i / cut];
            for (rgb, y) in brute.coefficients.iter_mut().zip(sh::basis(dir)) {
                for c in 0..3 {
                    rgb[c] += weight * y * f64::from(pixel[c]);
                }
            }
        }
    }
    let light = Light::from_probe(&probe);
    assert!(distance(&light, &brute) < 3e-4, "{}", distance(&light, &brute));
    // Mirrored or a column further it is another light.
    for wrong in [light.transformed(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))), light.rotated(DVec3::Z, 22.5)] {
        assert!(distance(&wrong, &brute) > 0.01);
    }
}

#[test]
fn a_band_limited_sky_comes_back() {
    // A sum of the first 16 harmonics, sampled to a probe, projects to itself as far as 256 rows resolve it.
    let truth = Light {
        coefficients: std::array::from_fn(|i| {
            [
                if i == 0 { 20.0 } else { ((i * 7 + 3) % 11) as f64 / 11.0 - 0.5 },
                20.0 * f64::from(i == 0),
                if i < 4 { 20.0 / (1 + 3 * i) as f64 } else { 0.0 },
            ]
        }),
    };
    let probe = Probe::from_fn(512, 256, |d| truth.radiance(d).map(|x| x as f32)).unwrap();
    assert!(distance(&Light::from_probe(&probe), &truth) < 2e-5, "{}", distance(&Light::from_probe(&probe), &truth));
}

#[test]
fn directional_and_cone() {
    let toward = DVec3::new(1.0, -2.0, 2.0);
    let irradiance = [3.0, 2.0, 1.0];
    let sun = Light::directional(toward, irradiance);
    assert!((sun.coefficients[0][0] - 3.0 * (0.25 / PI).sqrt()).abs() < 1e-15, "its integral is the irradiance");
    // A narrow disc of the same irradiance tends to it; a disc of 180° is constant light.
    let solid = 2.0 * PI * (1.0 - 0.5f64.to_radians().cos());
    assert!(distance(&Light::cone(toward, 0.5, irradiance.map(|e| e / solid)), &sun) < 2e-4);
    assert!(distance(&Light::cone(toward, 180.0, irradiance), &Light::constant(irradiance)) < 1e-15);
    // And a probe with a disc painted on it.
    let n = toward.normalize();
    let painted = Probe::from_fn(1024, 512, |d| if d.dot(n) > 40f64.to_radians().cos() { [2.0, 1.0, 0.0] } else { [0.0; 3] }).unwrap();
    let cone = Light::cone(toward, 40.0, [2.0, 1.0, 0.0]);
    assert!(distance(&Light::from_probe(&painted), &cone) < 2e-3);
    assert!(distance(&Light::from_probe(&painted), &Light::cone(toward, 41.0, [2.0, 1.0, 0.0])) > 0.01);
}

#[test]
fn rotating_the_light_is_rotating_the_probe() {
    let probe = Probe::two_colored();
    let light = Light::from_probe(&probe);
    let (axis, degrees) = (DVec3::new(1.0, 0.4, -0.3), 73.0);
    let turn = DMat3::from_axis_angle(axis.normalize(), f64::to_radians(degrees));
    // Looked up turned back, painted anew, projected: the slow way round.
    let turned = Probe::from_fn(512, 256, |d| probe.radiance(turn.transpose() * d)).unwrap();
    assert!(distance(&light.rotated(axis, degrees), &Light::from_probe(&turned)) < 2e-3);
    assert!(distance(&light.rotated(axis, -degrees), &Light::from_probe(&turned)) > 0.3);
    assert!(distance(&light.rotated(axis, degrees).rotated(axis, -degrees), &light) < 1e-14);
    assert!(distance(&light.rotated(axis, 360.0), &light) < 1e-14);
    assert_eq!(light.rotated(DVec3::ZERO, 30.0), light);
    let (a, b) = (light.energy(), light.rotated(axis, degrees).energy());
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        assert!((a - b).abs() < 1e-9 * a.max(1.0));
    }
}

#[test]
fn a_quarter_turn_about_z_on_a_cone() {
    let (warm, turned) = (Light::cone(DVec3::X, 20.0, [1.0; 3]), Light::cone(DVec3::Y, 20.0, [1.0; 3]));
    assert!(distance(&warm.rotated(DVec3::Z, 90.0), &turned) < 1e-14);
}

#[test]
fn bands_windows_and_sums() {
    let light = Light::from_probe(&Probe::two_colored());
    for n in 0..=4 {
        let cut = light.bands(n);
        for l in 0..4 {
            assert_eq!(cut.energy()[l], if l < n { light.energy()[l] } else { [0.0; 3] });
        }
    }
    let damped = light.windowed(Window::Hanning(4.0));
    assert!((damped.coefficients[6][0] - 0.5 * light.coefficients[6][0]).abs() < 1e-14);
    assert_eq!(damped.coefficients[0], light.coefficients[0]);
    assert!(distance(&light.plus(&light), &light.scaled(2.0)) < 1e-15);
    assert_eq!(light.to_f32()[5][1], light.coefficients[5][1] as f32);
}

#[test]
fn probe_axes() {
    // One coloured pixel block per axis: top row +z, left edge +y, a quarter further +x.
    let mut pixels = vec![[0.0f32; 3]; 64 * 32];
    let mut paint = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>, id: f32| {
        for j in rows {
            for i in columns.clone() {
                pixels[j * 64 + i % 64] = [id; 3];
            }
        }
    };
    paint(0..64, 0..2, 3.0);
    paint(0..64, 30..32, 6.0);
    for (quarter, id) in [(0, 2.0), (1, 1.0), (2, 5.0), (3, 4.0)] {
        paint(62 + 16 * quarter..66 + 16 * quarter, 14..18, id);
    }
    let probe = Probe::new(64, 32, pixels).unwrap();
    for (axis, id) in AXES.iter().zip([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) {
        assert_eq!(probe.radiance(*axis), [id; 3], "{axis}");
        assert_eq!(probe.radiance(*axis * 17.0), [id; 3], "any length");
    }
    // The projection looks the same way.
    let light = Light::from_probe(&probe);
    assert!(light.coefficients[2][0] < 0.0 && light.coefficients[3][0] > 0.0 && light.coefficients[1][0] > 0.0, "{light:?}");
}

#[test]
fn lookup_is_bilinear_and_wraps() {
    // A ramp in azimuth and height is linear between pixel centres; over the seam it runs from the last to the first.
    let probe = Probe::new(8, 4, (0..32).map(|i| [(i % 8) as f32, (i / 8) as f32, 1.0]).collect()).unwrap();
    let look = |column: f64, row: f64| {
        let (turn, theta) = (2.0 * PI * column / 8.0, PI * row / 4.0);
        probe.radiance(DVec3::new(theta.sin() * turn.sin(), theta.sin() * turn.cos(), theta.cos()))
    };
    for (column, row) in [(0.5, 0.5), (3.5, 2.5), (4.0, 2.0), (6.9, 3.4), (1.25, 1.75)] {
        let [a, b, c] = look(column, row);
        assert!(
            (f64::from(a) - (column - 0.5)).abs() < 1e-5 && (f64::from(b) - (row - 0.5)).abs() < 1e-5 && c == 1.0,
            "{column} {row}: {a} {b}"
        );
    }
    assert!((look(8.0, 2.0)[0] - 3.5).abs() < 1e-5 && (look(0.0, 2.0)[0] - 3.5).abs() < 1e-5, "half way from 7 to 0");
    assert!(look(2.5, 0.1)[1] == 0.0 && look(2.5, 3.99)[1] == 3.0, "clamped at the poles");
    assert!(probe.radiance(DVec3::ZERO)[2] == 1.0 && probe.radiance(DVec3::NAN)[2] == 1.0, "no direction is no panic");
}

#[test]
fn mitsubas_envmap_sees_the_same() {
    let Some(path) = data("probulator_uffizi.hdr") else { return };
    let probe = read_probe(&path).unwrap();
    assert_eq!((probe.width(), probe.height()), (256, 128));
    // Mitsuba 3.9.1, envmap turned +90° about x, along ±x, ±y, ±z (its texture holds half floats).
    let oracle = [
        [0.16015625, 0.14013672, 0.12426758],
        [0.36914062, 0.34472656, 0.3449707],
        [11.5625, 11.5, 13.5625],
        [0.09228516, 0.07751465, 0.06835938],
        [0.4477539, 0.3881836, 0.37695312],
        [0.17089844, 0.15673828, 0.16455078],
    ];
    let error = |dir: DVec3, oracle: [f64; 3]| -> f64 {
        probe.radiance(dir).into_iter().zip(oracle).map(|(x, o)| (f64::from(x) - o).abs() / o).fold(0.0, f64::max)
    };
    let worst = |degrees: f64| -> f64 {
        let turn = DMat3::from_rotation_z(degrees.to_radians());
        let at = |(axis, oracle): (DVec3, [f64; 3])| match axis.z {
            0.0 => error(turn * axis, oracle),
            // A pole has no azimuth: any column of the outermost row will do.
            z => (0..1024)
                .map(|i| error(DMat3::from_rotation_z(f64::from(i) * PI / 512.0) * DVec3::new(1e-6, 0.0, z), oracle))
                .fold(1.0, f64::min),
        };
        AXES.into_iter().zip(oracle).map(at).fold(0.0, f64::max)
    };
    assert!(worst(0.0) < 1e-3, "{}", worst(0.0));
    assert!(worst(1.4) > 0.01 && worst(90.0) > 0.1, "a column further it is not the same");
}

/// The probe as Mitsuba 3's `envmap` understands it: rows at j/(height−1).
fn as_mitsuba(probe: &Probe, width: usize) -> Probe {
    let rows = probe.height() as f64;
    let look = |d: DVec3| {
        let theta = (d.z.acos() * (rows - 1.0) + 0.5 * PI) / rows;
        let flat = DVec3::new(d.x, d.y, 0.0).normalize() * theta.sin();
        probe.radiance(DVec3::new(flat.x, flat.y, theta.cos()))
    };
    Probe::from_fn(width, width / 2, look).unwrap()
}

#[test]
fn between_the_poles_mitsubas_rows_lie_elsewhere() {
    let Some(path) = data("probulator_uffizi.hdr") else { return };
    let probe = read_probe(&path).unwrap();
    // Mitsuba 3.9.1 again, off the axes.
    let oracle = [
        (DVec3::new(0.6, 0.64, 0.48), [0.12720256, 0.10929977, 0.12500988]),
        (DVec3::new(-0.6, 0.48, -0.64), [0.23125185, 0.20869438, 0.21650682]),
        (DVec3::new(0.36, -0.48, 0.8), [0.57063985, 0.51222116, 0.53076053]),
        (DVec3::new(-0.48, -0.36, -0.8), [0.21383053, 0.19414969, 0.20307153]),
        (DVec3::new(0.01, 0.6, 0.79994), [6.8446188, 6.8073153, 7.9178467]),
    ];
    let worst = |probe: &Probe| -> f64 {
        let error = |(d, o): &(DVec3, [f64; 3])| (0..3).map(|c| (f64::from(probe.radiance(*d)[c]) - o[c]).abs() / o[c]).fold(0.0, f64::max);
        oracle.iter().map(error).fold(0.0, f64::max)
    };
    let theirs = as_mitsuba(&probe, 4096);
    assert!(worst(&theirs) < 2e-3 && worst(&probe) > 0.02, "{} {}", worst(&theirs), worst(&probe));
    // What pictures that are compared with Mitsuba's must know: the two lights differ by 2.4 %.
    let apart = distance(&Light::from_probe(&theirs), &Light::from_probe(&probe));
    assert!((0.02..0.03).contains(&apart), "{apart}");
}

#[test]
fn real_probes_are_read_and_keep_their_energy() {
    for (name, size) in [
        ("probulator_uffizi.hdr", (256, 128)),
        ("probulator_pisa.hdr", (256, 128)),
        ("probulator_ennis.hdr", (256, 128)),
        ("probulator_grace.hdr", (256, 128)),
        ("polyhaven_studio_small_08_1k.hdr", (1024, 512)),
        ("pbrt2_grace_latlong.exr", (1024, 512)),
    ] {
        let Some(path) = data(name) else { return };
        let probe = read_probe(&path).unwrap();
        assert_eq!((probe.width(), probe.height()), size);
        let (light, mean) = (Light::from_probe(&probe), probe.mean());
        for (mean, l00) in mean.iter().zip(light.coefficients[0]) {
            assert!(*mean > 0.0 && (l00 / (mean * (4.0 * PI).sqrt()) - 1.0).abs() < 1e-6, "{name}");
        }
        println!("{name}: mean radiance {mean:.3?}");
    }
}

#[test]
fn the_demos_probe_is_two_coloured_and_hdr() {
    let probe = Probe::two_colored();
    assert_eq!((probe.width(), probe.height()), (256, 128));
    assert!(Probe::new(256, 128, probe.pixels().to_vec()).is_ok(), "it keeps the rules of any probe");
    let (warm, cool) = (probe.radiance(DVec3::new(0.80, 0.45, 0.45)), probe.radiance(DVec3::new(-0.75, -0.60, 0.25)));
    assert!(warm[0] > 3.0 * warm[2] && warm[0] > 10.0 && cool[2] > 3.0 * cool[0] && cool[2] > 10.0, "{warm:?} {cool:?}");
    // Both lamps light about as much: the irradiance that faces each is within a factor of two.
    let light = Light::from_probe(&probe);
    let toward = |d: DVec3| light.bands(2).radiance(d.normalize()).iter().sum::<f64>();
    let ratio = toward(DVec3::new(0.80, 0.45, 0.45)) / toward(DVec3::new(-0.75, -0.60, 0.25));
    assert!((0.5..2.0).contains(&ratio), "{ratio}");
    assert!(light.coefficients[0][2] / light.coefficients[0][0] > 0.5);
}

#[test]
fn wrong_probes_say_what_is_wrong() {
    let text = |r: halflight::Result<Probe>| match r.unwrap_err() {
        e @ Error::Invalid { .. } => e.to_string(),
        other => panic!("{other}"),
    };
    assert!(text(Probe::new(8, 8, vec![[0.0; 3]; 64])).contains("2:1"));
    assert!(text(Probe::new(0, 0, vec![])).contains("0x0"));
    assert!(text(Probe::new(32_768, 16_384, vec![])).contains("16384"));
    assert!(text(Probe::from_fn(2, usize::MAX, |_| [0.0; 3])).contains("2:1"));
    assert!(text(Probe::new(8, 4, vec![[0.0; 3]; 31])).contains("31"));
    let mut pixels = vec![[0.5f32; 3]; 32];
    pixels[11][1] = f32::NAN;
    pixels[12][2] = -1.0;
    let message = text(Probe::new(8, 4, pixels));
    assert!(message.contains("(3, 1)") && message.contains("1 more"), "{message}");
}
