//! What a scene means: its matter, background and light; and its text, which is the same scene again.

use super::*;

#[test]
fn the_ramp_rises_over_the_data_range_and_matter_knows_vacuum() {
    let grid = Grid::axis_aligned([2, 2, 2], [1.0; 3]).unwrap();
    let t = ramp([-10.0, 30.0], Reference::Voxel).unwrap();
    assert_eq!((t.sigma(-10.0, &grid), t.albedo(5.0)), (0.0, [0.9; 3]));
    // A quarter of the way: opacity ¼ per voxel.
    assert!((t.sigma(0.0, &grid) + 0.75f64.ln()).abs() < 1e-12);
    let flat = ramp([3.0, 3.0], Reference::Voxel).unwrap();
    assert!(flat.sigma(3.0, &grid) > 0.0);
    let surface = Surface { iso: 5.0, shading: Shading::Lambert, albedo: None };
    let matter = Matter { transfer: t.clone(), surface: Some(surface) };
    assert_eq!(matter.surface_albedo(), Some([0.9; 3]));
    assert!(!matter.is_vacuum([0.0, 5.0]) && matter.is_vacuum([0.0, 4.9]));
    let matter = Matter { transfer: t, surface: None };
    assert!(!matter.is_vacuum([-20.0, 0.0]) && matter.is_vacuum([-20.0, -10.0]));
}

#[test]
fn the_background_shows_through_what_is_not_covered() {
    let grid = Grid::axis_aligned([4, 4, 4], [1.0; 3]).unwrap();
    let rays = Camera::framing(&grid).rays(&grid, 3, 2).unwrap();
    let mut picture = Picture::new(3, 2);
    picture.rgba[4] = [0.25, 0.25, 0.25, 0.75];
    picture.rgba[5] = [0.5, 0.5, 0.5, 1.0];
    fill_background(&mut picture, &rays, |d| d.abs().as_vec3().to_array());
    let d = rays.direction_world(1.0, 1.0).abs().as_vec3();
    assert_eq!(picture.rgba[4], [0.25 + 0.25 * d.x, 0.25 + 0.25 * d.y, 0.25 + 0.25 * d.z, 1.0]);
    assert_eq!(picture.rgba[5], [0.5, 0.5, 0.5, 1.0]);
    let d = rays.direction_world(2.0, 0.0).abs().as_vec3();
    assert_eq!(picture.rgba[2], [d.x, d.y, d.z, 1.0]);
}

#[test]
fn background_and_light_turn_and_scale_alike() {
    let mut light = LightSettings { scale: 3.0, rotate: Some((DVec3::new(1.0, 2.0, 2.0) / 3.0, 77.0)), ..LightSettings::default() };
    // A probe of bands 0 and 1 alone is reproduced by its projection.
    let probe = Probe::from_fn(256, 128, |d| [(2.0 + d.x) as f32, (2.0 + d.y) as f32, (2.0 - d.z) as f32]).unwrap();
    let prepared = light.prepare(&Light::from_probe(&probe));
    let error = |light: &LightSettings| {
        let d = DVec3::new(0.3, -0.8, 0.52).normalize();
        let (a, b) = (prepared.radiance(d), light.background(Some(&probe), d));
        (0..3).map(|c| (a[c] - f64::from(b[c])).abs()).fold(0.0, f64::max)
    };
    assert!(error(&light) < 5e-3, "{}", error(&light));
    light.rotate = Some((DVec3::new(1.0, 2.0, 2.0) / 3.0, -77.0));
    assert!(error(&light) > 0.1);
    // Cut to one band it is the mean; the window leaves the mean alone and damps the rest.
    let full = Light::from_probe(&probe);
    let mean = LightSettings { bands: 1, ..LightSettings::default() }.prepare(&full);
    assert!((mean.radiance(DVec3::X)[0] - 2.0).abs() < 1e-3);
    let quarter = std::f64::consts::PI / 4.0;
    for (window, factor) in [
        (Windowing::None, 1.0),
        (Windowing::Hanning, 0.5 * (1.0 + quarter.cos())),
        (Windowing::Lanczos, quarter.sin() / quarter),
        (Windowing::Gauss, (-0.125 * quarter * quarter).exp()),
    ] {
        let soft = LightSettings { window, ..LightSettings::default() }.prepare(&full);
        let damped = (soft.radiance(DVec3::X)[0] - 2.0) / (full.radiance(DVec3::X)[0] - 2.0);
        assert!((damped - factor).abs() < 1e-3, "{window:?}: {damped}");
    }
    let constant = LightSettings { source: LightSource::Constant([1.0, 2.0, 3.0]), scale: 2.0, ..LightSettings::default() };
    assert_eq!(constant.background(None, DVec3::X), [2.0, 4.0, 6.0]);
}

#[test]
fn a_scenes_text_is_the_same_scene_again() {
    let texts = [
        "[volume]\nfile = \"a.nrrd\"",
        "[volume]\nfile = \"a.nrrd\"\n[visibility]\ntolerance = 0.07\nratio = 2",
        "[volume]\nfile = \"a.nrrd\"\n[visibility]\nquality = \"fine\"\nbits = 16",
        "[volume]\nfile = \"/x/a.raw\"\ndims = [3, 4, 5]\ntype = \"int16\"\nspacing = [0.1, 0.2, 3.0]\nendian = \"big\"\noffset = 12\nnan_as = 0.1\n\
         [transfer]\nkind = \"extinction\"\nreference = \"side\"\npoints = [[1, 0.8, 0.7, 0.5, 0], [2.5, 0.1, 0.2, 0.3, 40]]\n\
         [surface]\niso = 1.7\nshading = \"isotropic\"\nalbedo = [0.1, 0.2, 0.3]\n\
         [light]\nprobe = \"p.hdr\"\nrotate = [0, 0.6, 0.8, 33]\nscale = 2.5\nbands = 3\nwindow = \"gauss\"\n\
         [visibility]\nmethod = \"march\"\nratio = 2\ndirections = 77\nbands = 3\nbits = 16\nfilter = \"product\"\nsampling = \"jittered\"\ngrowth = 0.3\nstep = 0.7\n\
         [camera]\nposition = [1, 2, 3]\ntarget = [0.1, 0.2, 0.3]\nup = [0, 1, 0]\nfov = 44\nspace = \"world\"\n\
         [image]\nwidth = 10\nheight = 20\nstep = 0.3\nbackground = \"light\"\nexposure = -1.5\nskip = false",
        "[volume]\nfile = \"a.nrrd\"\n[transfer]\nfile = \"t.json\"\nname = \"bone\"\nrange = [1, 9]\n[light]\nconstant = [0.1, 0.2, 0.7]\n[image]\nbackground = [0.1, 0.2, 0.3]",
    ];
    for text in texts {
        let read = |text: &str| {
            let mut scene = halflight::io::parse_scene(text, "s.toml", std::path::Path::new(""), &[]).expect(text);
            scene.origins = Default::default();
            scene
        };
        let scene = read(text);
        let again = halflight::io::scene_text(&scene);
        assert_eq!(scene, read(&again), "{again}");
        // Sabotage: a text that lost a line is another scene (or none).
        let dropped: String = again.lines().filter(|l| !l.starts_with("ratio")).map(|l| format!("{l}\n")).collect();
        assert!(text.len() < 100 || read(&dropped) != scene || !again.contains("ratio = 2"));
    }
}

#[test]
fn axes_read_again_are_the_same() {
    // Scaled to length 1 a second time, many of them would move by a bit.
    for i in 0..200 {
        let text = format!("[volume]\nfile = 'a'\n[light]\nrotate = [{}, {}, 2, 90]\n", i % 20 - 7, i / 20);
        let scene = parse_scene(&text, "s.toml", Path::new(""), &[]).unwrap();
        let again = parse_scene(&scene_text(&scene), "s.toml", Path::new(""), &[]).unwrap();
        assert_eq!(scene.light, again.light, "{text}");
        let (axis, _) = scene.light.rotate.unwrap();
        assert!((axis.length() - 1.0).abs() < 1e-15);
    }
}
