//! Keys, defaults and overrides.

use super::*;

#[test]
fn every_key_is_read() {
    let s = parse(FULL).unwrap();
    assert_eq!(s.volume.file, PathBuf::from("/scenes/ct.raw"));
    assert_eq!((s.volume.component.as_deref(), s.volume.series.as_deref()), (Some("0"), Some("1.2.3")));
    assert_eq!(s.volume.nan_as, Some(-3.5));
    let raw = s.volume.raw.clone().unwrap();
    assert_eq!((raw.dims, raw.sample_type.as_str(), raw.spacing), ([4, 5, 6], "int16", [1.0, 1.5, 2.0]));
    assert_eq!((raw.big_endian, raw.offset), (true, 128));
    let TransferSource::Points(t) = &s.transfer else { panic!("{:?}", s.transfer) };
    assert_eq!((t.kind(), t.reference()), (Kind::Extinction, Reference::Side));
    assert_eq!(t.colors(), &[(0.0, [0.1, 0.2, 0.3]), (100.5, [1.0, 1.0, 1.0])]);
    assert_eq!(t.opacities(), &[(0.0, 0.0), (100.5, 8.0)]);
    assert_eq!(s.surface, Some(Surface { iso: 42.0, shading: Shading::Isotropic, albedo: Some([0.5, 0.25, 1.0]) }));
    let light = LightSettings {
        source: LightSource::Probe("/scenes/sky.hdr".into()),
        rotate: Some((DVec3::Z, 90.0)),
        scale: 2.5,
        bands: 3,
        window: Windowing::Hanning,
    };
    assert_eq!(s.light, light);
    let visibility = Visibility {
        method: Method::March,
        ratio: 2,
        directions: 128,
        bands: 2,
        bits: 16,
        filter: Filter::Product,
        sampling: Sampling::Jittered,
        growth: 0.5,
        step: 0.25,
        near: 3,
        fit: 0,
        cells: Cells::All,
    };
    assert_eq!(s.visibility, visibility);
    let camera = CameraSettings {
        position: Some(DVec3::new(1.0, 2.0, 3.0)),
        target: Some(DVec3::new(0.5, 0.0, 0.0)),
        up: DVec3::Y,
        fov_degrees: 45.0,
        space: Space::World,
        orbit: Some((DVec3::Z, 30.0)),
        centre: Some(DVec3::ONE),
        distance: Some(4.0),
        fit: None,
    };
    assert_eq!(s.camera, camera);
    let image =
        ImageSettings { width: 320, height: 200, step: 0.5, background: Background::Color([0.0, 0.5, 1.0]), exposure: -1.5, skip: false };
    assert_eq!(s.image, image);
    let clip = Clip { bounds: Some([[0.0, 0.25, 0.0], [1.0, 1.0, 0.5]]), planes: vec![[0.0, 0.0, 1.0, 2.0]], space: Space::World };
    assert_eq!(s.clip, clip);
    let keys = vec![Keyframe { frame: 4.0, values: vec![45.0], ease: Ease::Hold }];
    let animation = Animation { first: 3, frames: 9, rate: 30.0, tracks: vec![Track { channel: "camera.fov", keys }] };
    assert_eq!(s.animation, Some(animation));
    // The table of keys and this file agree: no key of the table is forgotten here, but for the exclusive ones.
    for key in keys::KEYS {
        let exclusive = [
            "transfer.file",
            "transfer.name",
            "transfer.range",
            "light.constant",
            "visibility.tolerance",
            "visibility.quality",
            "volume.number",
            "volume.numbers",
        ]
        .contains(&key.name);
        assert_ne!(s.origins.keys.contains_key(key.name), exclusive, "{}", key.name);
    }
    let other =
        parse("volume.file = 'a'\nlight.constant = [1, 2, 3]\n[transfer]\nfile = 'p.json'\nname = 'Cool'\nrange = [-1, 4]").unwrap();
    assert_eq!(other.light.source, LightSource::Constant([1.0, 2.0, 3.0]));
    let TransferSource::File { path, name, range, reference } = other.transfer else { panic!() };
    assert_eq!((path, name.as_deref()), (PathBuf::from("/scenes/p.json"), Some("Cool")));
    assert_eq!((range, reference), (Some([-1.0, 4.0]), Reference::Voxel));
}

#[test]
fn defaults_hold_where_a_key_is_absent() {
    let s = parse("[volume]\nfile = '/data/a.nrrd'\n[light]\n[visibility]\n[camera]\n[image]\n[transfer]").unwrap();
    let mut bare = Scene::of_volume("/data/a.nrrd".into());
    bare.origins = s.origins.clone();
    assert_eq!(s, bare);
    // What the table of keys promises.
    let d = |k| keys::find(k).unwrap().default.to_string();
    assert_eq!(d("image.width"), s.image.width.to_string());
    assert_eq!(d("image.height"), s.image.height.to_string());
    assert_eq!(d("image.step"), s.image.step.to_string());
    assert_eq!(d("image.exposure"), s.image.exposure.to_string());
    assert_eq!(d("image.skip"), s.image.skip.to_string());
    assert_eq!((d("image.background").as_str(), s.image.background), ("transparent", Background::Transparent));
    assert_eq!(d("camera.fov"), s.camera.fov_degrees.to_string());
    assert_eq!((d("camera.up").as_str(), s.camera.up), ("[0, 0, 1]", DVec3::Z));
    assert_eq!((d("camera.space").as_str(), s.camera.space), ("side", Space::Side));
    assert_eq!(d("visibility.ratio"), s.visibility.ratio.to_string());
    assert_eq!(d("visibility.directions"), s.visibility.directions.to_string());
    assert_eq!(d("visibility.bands"), s.visibility.bands.to_string());
    assert_eq!(d("visibility.bits"), s.visibility.bits.to_string());
    assert_eq!(d("visibility.growth"), s.visibility.growth.to_string());
    assert_eq!(d("visibility.step"), s.visibility.step.to_string());
    assert_eq!(d("visibility.near"), s.visibility.near.to_string());
    assert_eq!((d("visibility.method").as_str(), s.visibility.method), ("sweep", Method::Sweep));
    assert_eq!((d("visibility.filter").as_str(), s.visibility.filter), ("axis", Filter::Axis));
    assert_eq!((d("visibility.sampling").as_str(), s.visibility.sampling), ("stratified", Sampling::Stratified));
    assert_eq!(d("light.scale"), s.light.scale.to_string());
    assert_eq!(d("light.bands"), s.light.bands.to_string());
    assert_eq!((d("light.window").as_str(), s.light.window), ("none", Windowing::None));
    assert_eq!((d("light.constant").as_str(), s.light.source), ("[1, 1, 1]", LightSource::Constant([1.0; 3])));
    assert_eq!(s.transfer, TransferSource::Ramp { reference: Reference::Voxel });
    assert_eq!(d("transfer.reference"), "voxel");
    let shading = parse("volume.file = 'a'\nsurface.iso = 1").unwrap().surface.unwrap();
    assert_eq!((d("surface.shading").as_str(), shading.shading, shading.albedo), ("lambert", Shading::Lambert, None));
}

#[test]
fn overrides_replace_keys_and_pass_the_same_checks() {
    let s = with(FULL, &[("visibility.ratio", "8"), ("image.background", "light"), ("volume.file", "b.raw")]).unwrap();
    assert_eq!((s.visibility.ratio, s.image.background), (8, Background::Light));
    // A path from the command line is not the scene's.
    assert_eq!(s.volume.file, PathBuf::from("b.raw"));
    assert_eq!(s.origins.of("visibility.ratio"), "command line");
    assert_eq!(s.origins.of("visibility.bits"), "s.toml line 35");
    // The last one holds; quotes are allowed; a number may be a name.
    let s = with("volume.file='a'", &[("light.scale", "3"), ("light.scale", "4"), ("light.probe", "\"x y.hdr\""), ("transfer.file", "1")]);
    let s = s.unwrap();
    assert_eq!((s.light.scale, s.light.source), (4.0, LightSource::Probe("x y.hdr".into())));
    // The command line's choice displaces the file's other one.
    let s = with(FULL, &[("light.constant", "[1, 0, 0]"), ("transfer.file", "p.json")]).unwrap();
    assert_eq!(s.light.source, LightSource::Constant([1.0, 0.0, 0.0]));
    assert!(matches!(s.transfer, TransferSource::File { .. }));
    for (key, value, part) in [
        ("visibility.ratio", "3", "command line: `visibility.ratio` is 1:3; it must be 1, 2, 4 or 8"),
        ("visibility.ratio", "two", "command line: `visibility.ratio` is two; it must be 1, 2, 4 or 8"),
        ("visibility.ratios", "2", "command line: `visibility.ratios` is unknown; did you mean `visibility.ratio`?"),
        ("image.width", "1\nheight = 3", "`image.width` is"),
        ("transfer.name", "x", "command line: `transfer.name` cannot stand beside `transfer.points`"),
    ] {
        let sentence = with(FULL, &[(key, value)]).unwrap_err();
        assert!(sentence.contains(part), "{sentence}");
    }
}

#[test]
fn a_plan_and_the_settings_that_it_finds_displace_each_other() {
    use halflight::scene::visibility::{Quality, Wanted};
    let found = [
        ("method", "\"march\""),
        ("directions", "9"),
        ("near", "2"),
        ("fit", "8"),
        ("step", "2"),
        ("sampling", "\"jittered\""),
        ("filter", "\"box\""),
        ("growth", "1"),
    ];
    let all: String = found.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    let of = |keys: &str| format!("volume.file = 'a'\n[visibility]\nratio = 2\nbits = 16\n{keys}");
    // The command line's takes the place of all the scene's; what may stand beside it stays.
    for (key, value, wanted) in [("tolerance", "0.05", Wanted::Tolerance(0.05)), ("quality", "fine", Wanted::Quality(Quality::Fine))] {
        let s = with(&of(&all), &[(&format!("visibility.{key}"), value)]).unwrap();
        let plain = Visibility { ratio: 2, bits: 16, ..Visibility::default() };
        assert_eq!((s.wanted, s.visibility), (Some(wanted), plain));
        for (other, value) in &found {
            // Both from one place are refused.
            let both = with(&of(&format!("{key} = {}\n{other} = {value}", if key == "quality" { "'fine'" } else { "0.05" })), &[]);
            assert!(
                both.unwrap_err().contains(&format!("`visibility.{other}` cannot stand beside `visibility.{key}`; give one of the two"))
            );
        }
        let both = [(format!("visibility.{key}"), value), ("visibility.near".into(), "2")];
        let both = both.each_ref().map(|(k, v)| (k.as_str(), *v));
        assert!(with(&of(""), &both).unwrap_err().ends_with("give one of the two"));
    }
    // A method, too; of what belongs to it alone, the refusal says how.
    let planned = of("tolerance = 0.05");
    let s = with(&planned, &[("visibility.method", "sweep"), ("visibility.directions", "64")]).unwrap();
    assert_eq!((s.wanted, s.visibility.method, s.visibility.directions), (None, Method::Sweep, 64));
    let alone = with(&planned, &[("visibility.directions", "64")]).unwrap_err();
    let right = "give one of the two; `visibility.method` on the command line, too, takes the place of the scene's `visibility.tolerance`";
    assert!(alone.ends_with(right), "{alone}");
}

#[test]
fn overrides_are_written_as_people_write_numbers() {
    for albedo in ["[.9, .5, 1.]", "[0.9,+.5,1.0]", ".9,.5,1", "[9.e-1, 50e-2, 1]"] {
        let s = with("volume.file='a'\nsurface.iso=1", &[("surface.albedo", albedo)]).unwrap();
        assert_eq!(s.surface.unwrap().albedo, Some([0.9, 0.5, 1.0]), "{albedo}");
    }
    let s = with(
        "volume.file='a'",
        &[("image.exposure", "-.5"), ("camera.up", "0, -.5, 2."), ("transfer.points", "[0,0,0,0,0],[9,.5,1,1,1.]")],
    );
    let s = s.unwrap();
    assert_eq!((s.image.exposure, s.camera.up), (-0.5, DVec3::new(0.0, -0.5, 2.0)));
    let TransferSource::Points(t) = s.transfer else { panic!() };
    assert_eq!((t.colors()[1], t.opacities()[1]), ((9.0, [0.5, 1.0, 1.0]), (9.0, 1.0)));
    // What is wrong is shown as it was written; names keep their points.
    for (key, value, part) in [
        ("surface.albedo", "[.9 .9 .9]", "`surface.albedo` is [.9 .9 .9]; it must be three numbers"),
        ("surface.albedo", ".9,.9", "`surface.albedo` is .9,.9; it must be three numbers"),
        ("image.exposure", "1..5", "`image.exposure` is 1..5; it must"),
        ("volume.file", "", "`volume.file` is empty; it must be a text"),
    ] {
        let sentence = with("volume.file='a'\nsurface.iso=1", &[(key, value)]).unwrap_err();
        assert!(sentence.contains(part), "{sentence}");
    }
    for name in [".5", "1.", "1e3", "[a]", "2024-01-01", "007", "true"] {
        let s = with("volume.file='a'", &[("volume.file", name)]).unwrap();
        assert_eq!(s.volume.file, PathBuf::from(name));
    }
}

#[test]
fn a_volume_alone_is_a_scene() {
    let s = scene_of_volume(Path::new("x/engine.nii.gz"), &[("surface.iso", "80"), ("light.probe", "p.hdr")]).unwrap();
    assert_eq!(s.volume.file, PathBuf::from("x/engine.nii.gz"));
    assert_eq!(s.surface.unwrap().iso, 80.0);
    let e = scene_of_volume(Path::new("a"), &[("volume.file", "b")]).unwrap_err().to_string();
    assert!(e.starts_with("command line: `volume.file` is given twice"), "{e}");
}

#[test]
fn components_series_and_spacing_of_a_volume() {
    let text = "[volume]\nfile = 'a'\ncomponent = 2\nseries = '1.2.840.5'\nspacing = [0.5, 1, 2]\n";
    let scene = parse_scene(text, "s.toml", Path::new(""), &[]).unwrap();
    let v = &scene.volume;
    assert_eq!((v.component.as_deref(), v.series.as_deref(), v.spacing), (Some("2"), Some("1.2.840.5"), Some([0.5, 1.0, 2.0])));
    assert_eq!(parse_scene(&scene_text(&scene), "t", Path::new(""), &[]).unwrap().volume, scene.volume);
    // On the command line names need no quotes, and a UID is no number.
    let over = [("volume.component", "velocity:1"), ("volume.series", "1.2"), ("volume.spacing", "1,1,3")];
    let v = parse_scene(text, "s.toml", Path::new(""), &over).unwrap().volume;
    assert_eq!((v.component.as_deref(), v.series.as_deref(), v.spacing), (Some("velocity:1"), Some("1.2"), Some([1.0, 1.0, 3.0])));
    // A headerless file's spacing belongs to its layout.
    let raw = parse_scene("volume = {file = 'a', dims = [1, 2, 3], type = 'int8', spacing = [1, 2, 3]}", "s", Path::new(""), &[]).unwrap();
    assert_eq!((raw.volume.spacing, raw.volume.raw.map(|r| r.spacing)), (None, Some([1.0, 2.0, 3.0])));
}
