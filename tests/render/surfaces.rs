//! The isosurface: where it is hit, and how it is shaded.

use super::*;

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
    let filtering = engine.filtering().expect("filtering");
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
            match twin::filtered(filtering, || isosurface::reference_hit(&volume, 0.0, &view, [i, j], 1.0)) {
                Some(hit) if got >= 0.0 => worst_twin = worst_twin.max((hit.distance - got).abs()),
                Some(_) | None => assert!(root.abs() < 9.0 || got < 0.0),
            }
        }
    }
    println!("{hits} hits, worst distance error {worst:.4} voxels, against the twin {worst_twin:.5}");
    // A linear cone interpolated trilinearly errs by curvature/8: about 3/(8·15) voxel, times the obliqueness.
    assert!(hits > 400 && worst < 0.1, "{worst}");
    // Bisection of one voxel by 12 halvings, and single precision at a distance of some 100 voxels.
    // Where weights come in steps, a hit lies at the edge of one, on whichever side of it rounding puts a place.
    let step = filtering.map_or(0.0, |f| 1.0 / f.steps as f32);
    assert!(worst_twin < 2e-3 + step, "{worst_twin}");
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
            // The layer of visibility is what the isotropic form shows under such a light, at every pixel.
            if shading == Shading::Isotropic {
                assert_visibility_is_the_picture(&engine, &medium, &lit, &camera, &image(16, 16, 0.5));
            }
        }
    }
}

/// Under a constant light of 1 an isotropic surface of albedo 1 shows the mean visibility: the picture and the layer are one.
fn assert_visibility_is_the_picture(
    engine: &Checked,
    medium: &halflight::engine::Medium,
    lit: &halflight::engine::Lit,
    camera: &Camera,
    image: &ImageSettings,
) {
    let (picture, hits) = engine.render_with_distance(medium, lit, camera, image, &mut quiet).expect("picture");
    let behind = engine.aovs(medium, lit, camera, image, &hits, &mut quiet).expect("layers");
    let mut seen = 0;
    for (i, (p, b)) in picture.rgba.iter().zip(&behind).enumerate().filter(|(_, (p, _))| p[3] > 0.0) {
        // Half floats.
        assert!((b.visibility - p[0]).abs() < 2e-3, "pixel {i}: {} for {}", b.visibility, p[0]);
        seen += 1;
    }
    assert!(seen > 20, "{seen}");
}

#[test]
fn the_visibility_layer_of_a_surface_that_the_box_cuts_open_is_half_the_sky() {
    let engine = engine();
    // A block in a corner of the box: the field holds cells near it only.
    let grid = Grid::axis_aligned([64; 3], [1.0; 3]).expect("grid");
    let block = |p: [f64; 3]| p[0] < 32.0 && p[2] < 48.0;
    let samples = (0..1 << 18).map(|i| 200 * u8::from(block([f64::from(i % 64), 0.0, f64::from(i >> 12)])));
    let volume = Volume::new(grid, halflight::scene::Samples::U8(samples.collect()), 1.0, 0.0).expect("volume");
    let matter = surface(Surface { iso: 100.0, shading: Shading::Isotropic, albedo: Some([1.0; 3]) });
    let (_, medium) = load(&engine, &volume, &matter);
    let field = engine.precompute(&medium, &Visibility { directions: 64, ..march(4) }, &mut quiet).expect("field");
    for light in [Light::constant([1.0; 3]), Light::constant([1.0, 1.0, 1.001])] {
        let lit = engine.relight(&field, &light).expect("light");
        let camera = camera(&grid, [-2.5, 0.0, 0.0], 20.0);
        let settings = image(24, 24, 1.0);
        assert_visibility_is_the_picture(&engine, &medium, &lit, &camera, &settings);
        let (_, hits) = engine.render_with_distance(&medium, &lit, &camera, &settings, &mut quiet).expect("picture");
        let behind = engine.aovs(&medium, &lit, &camera, &settings, &hits, &mut quiet).expect("layers");
        let face: Vec<_> = behind.iter().filter(|b| b.opacity > 0.0 && b.normal[0] < -0.9).map(|b| f64::from(b.visibility)).collect();
        let mean = face.iter().sum::<f64>() / face.len() as f64;
        println!("mean visibility of the open face: {mean:.3}");
        assert!(face.len() > 100 && (mean - 0.5).abs() < 0.02, "{mean}");
        // Sabotage: distances a twentieth further off are another place, and so is the light there.
        let inside: Vec<f32> = hits.iter().map(|h| 1.05 * h).collect();
        let wrong = engine.aovs(&medium, &lit, &camera, &settings, &inside, &mut quiet).expect("layers");
        assert!(wrong.iter().zip(&behind).any(|(w, b)| (w.visibility - b.visibility).abs() > 0.02));
    }
}

#[test]
fn a_cut_face_keeps_its_normal_in_the_layers_though_distances_are_rounded() {
    let engine = engine();
    let volume = ball(32, 14.0);
    let clip = halflight::scene::Clip { planes: vec![[0.3, -0.5, -0.8, -0.071]], ..Default::default() };
    let uploaded = engine.upload(&volume).expect("upload");
    let medium = engine.classify_clipped(&uploaded, &sphere_surface(Shading::Lambert), &clip).expect("classify");
    let lit =
        engine.relight(&engine.precompute(&medium, &march(4), &mut quiet).expect("field"), &Light::constant([1.0; 3])).expect("light");
    let camera = camera(volume.grid(), [-0.6, 1.0, 1.6], 30.0);
    let settings = image(24, 18, 0.5);
    let (_, hits) = engine.render_with_distance(&medium, &lit, &camera, &settings, &mut quiet).expect("picture");
    let face = -DVec3::new(0.3, -0.5, -0.8).normalize();
    let on_face = |hits: &[f32]| {
        let behind = engine.aovs(&medium, &lit, &camera, &settings, hits, &mut quiet).expect("layers");
        behind.iter().map(|b| face.dot(b.normal.map(f64::from).into()) > 0.99999).collect::<Vec<_>>()
    };
    let exact = on_face(&hits);
    let count = exact.iter().filter(|f| **f).count();
    assert!(count > 40, "{count}");
    // Another compiler may round the distance of the plane another way in the kernel that left it.
    let rounded =
        |ulps: i32| hits.iter().map(|h| if *h > 0.0 { f32::from_bits((h.to_bits() as i32 + ulps) as u32) } else { *h }).collect::<Vec<_>>();
    for ulps in [-3, 3] {
        assert!(on_face(&rounded(ulps)) == exact, "{ulps} ulps");
    }
    // Sabotage: a hundredth of a voxel is another surface.
    let inside: Vec<f32> = hits.iter().map(|h| if *h > 0.0 { h + 0.01 } else { *h }).collect();
    assert_ne!(on_face(&inside), exact);
}
