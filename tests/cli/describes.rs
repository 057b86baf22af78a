//! `info` and `light`.

use super::*;

#[test]
fn info_describes_volumes_and_scenes() {
    let f = Folder::new("info");
    f.volume();
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let v = json(&["info", "v.nrrd", "--json"]);
    assert_eq!((&v["kind"], &v["volume"]["dims"]), (&"volume".into(), &serde_json::json!([4, 3, 2])));
    assert_eq!(v["volume"]["range"], serde_json::json!([0.0, 23.0]));
    f.file("r.bin", (0..24u8).collect::<Vec<_>>());
    let raw = json(&["--json", "info", "r.bin", "--volume.dims", "[2, 3, 2]", "--set", "volume.type=int16", "--volume.endian=big"]);
    // Big-endian pairs (0, 1), (2, 3), …, (22, 23).
    assert_eq!(raw["volume"]["range"], serde_json::json!([1.0, 22.0 * 256.0 + 23.0]));
    f.file("s.toml", "volume.file = 'v.nrrd'\nvisibility.ratio = 2\ncamera.fov = 50");
    let s = json(&["info", "s.toml", "--camera.fov", "40", "--json"]);
    assert_eq!((&s["kind"], &s["camera"]["fov"]), (&"scene".into(), &serde_json::json!(40.0)));
    assert_eq!((&s["field"]["dims"], &s["given"]["camera.fov"]), (&serde_json::json!([2, 2, 1]), &"command line".into()));
    assert!(s["field"]["bytes"].as_u64() > Some(0) && s["field"]["tolerance"].is_null());
    // Of a field that a plan will choose only what is asked for is known.
    let planned = ["info", "s.toml", "--visibility.tolerance", "0.05"];
    f.file("p.toml", "volume.file = 'v.nrrd'\nvisibility.tolerance = 0.1");
    let [given, free] = [&planned[..], &["info", "p.toml"]].map(|arguments| {
        let text = String::from_utf8(halflight(&f.0, arguments).stdout).unwrap();
        assert!(text.contains("planned when it is computed, for an error of 0.") && !text.contains("memory"), "{text}");
        (json(&[arguments, &["--json"]].concat())["field"].clone(), text)
    });
    assert_eq!(given.0, serde_json::json!({ "coefficients": 16, "tolerance": 0.05, "dims": [2, 2, 1] }));
    assert_eq!(free.0, serde_json::json!({ "coefficients": 16, "tolerance": 0.1 }));
    assert!(given.1.contains("field      2x2x1, planned") && free.1.contains("field      planned"));
    let text = String::from_utf8(halflight(&f.0, &["info", "v.nrrd"]).stdout).unwrap();
    assert!(text.contains("4x3x2 uint8, 24 B") && text.contains("0 to 23"), "{text}");
    let mut nan = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 2 1 1\nencoding: raw\nendian: little\n\n".to_vec();
    nan.extend([1f32, f32::NAN].iter().flat_map(|v| v.to_le_bytes()));
    f.file("nan.nrrd", nan);
    // Samples that are not finite are counted, and the rest described.
    let v = json(&["info", "nan.nrrd", "--json"]);
    assert_eq!((&v["volume"]["not_finite"], &v["volume"]["range"]), (&1.into(), &serde_json::json!([1.0, 1.0])));
    let text = String::from_utf8(halflight(&f.0, &["info", "nan.nrrd"]).stdout).unwrap();
    assert!(text.contains("1 of 2 samples are NaN or infinite; ") && text.contains("--nan-as VALUE"), "{text}");
    f.file("none.raw", [f32::NAN, f32::INFINITY].map(f32::to_le_bytes).concat());
    let text = halflight(&f.0, &["info", "none.raw", "--volume.dims", "2,1,1", "--volume.type", "float32"]).stdout;
    assert!(String::from_utf8(text).unwrap().contains("none: no sample is finite"));
    // It also says on stderr that samples were replaced.
    let out = halflight(&f.0, &["info", "nan.nrrd", "--nan-as", "-5", "--json"]);
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["volume"]["range"], serde_json::json!([-5.0, 1.0]));
}

#[test]
fn info_describes_fields_and_probes() {
    use halflight::scene::Grid;
    let f = Folder::new("fields");
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    // Half of the directions are seen from each of 3x2x1 cells: v₀₀ = √π.
    let v00 = std::f32::consts::PI.sqrt();
    for coefficients in [1, 4, 9, 16] {
        let data: Vec<f32> = (0..6 * coefficients).map(|i| if i % coefficients == 0 { v00 } else { 7.0 }).collect();
        let grid = Grid::axis_aligned([6, 4, 2], [0.5, 1.0, 2.0]).unwrap();
        let meta = [("scene".to_string(), "[volume]\nfile = \"v.nrrd\"".to_string()), ("device".into(), "d".into())];
        halflight::io::write_nrrd_field(&f.0.join("field.nrrd"), [3, 2, 1], coefficients, &data, &grid, &meta).unwrap();
        let v = json(&["info", "field.nrrd", "--json"]);
        assert_eq!((&v["kind"], &v["file"]), (&"field".into(), &"field.nrrd".into()));
        assert_eq!((&v["field"]["dims"], &v["field"]["coefficients"]), (&serde_json::json!([3, 2, 1]), &coefficients.into()));
        assert_eq!(v["field"]["spacing"], serde_json::json!([1.0, 2.0, 4.0]));
        assert!((v["field"]["visible"].as_f64().unwrap() - 0.5).abs() < 1e-6);
        assert_eq!(v["meta"]["scene"], meta[0].1.as_str());
        let text = String::from_utf8(halflight(&f.0, &["info", "field.nrrd"]).stdout).unwrap();
        assert!(text.contains(&format!("3x2x1 cells, {coefficients} coefficients")), "{text}");
        assert!(text.contains("50.00 %") && text.contains("\n  file = \"v.nrrd\"\n") && text.contains("device     d"), "{text}");
    }
    // Cells that are not computed are zero, and no part of the average.
    let grid = Grid::axis_aligned([6, 4, 2], [0.5, 1.0, 2.0]).unwrap();
    for (held, visible, says) in [
        (2, Some(0.5), "50.00 % of the directions, on average over the 2 of 6 cells that hold something"),
        (0, None, "visible    0 of 6 cells"),
    ] {
        let data: Vec<f32> = (0..6 * 4).map(|i| if i < held * 4 { v00 } else { 0.0 }).collect();
        halflight::io::write_nrrd_field(&f.0.join("field.nrrd"), [3, 2, 1], 4, &data, &grid, &[]).unwrap();
        let v = json(&["info", "field.nrrd", "--json"]);
        assert_eq!(v["field"]["cells_held"], held);
        assert!(v["field"]["visible"].as_f64().map(|v| (v * 1e4).round() / 1e4) == visible, "{v}");
        let text = String::from_utf8(halflight(&f.0, &["info", "field.nrrd"]).stdout).unwrap();
        assert!(text.contains(says), "{text}");
    }
    fails(&f, &["info", "field.nrrd", "--volume.nan_as", "3"], 2, "`volume.nan_as` changes nothing in the description of a field");
    let whole = std::fs::read(f.0.join("field.nrrd")).unwrap();
    f.file("field.nrrd", &whole[..whole.len() - 1]);
    fails(&f, &["info", "field.nrrd"], 3, "the file is cut short");
    grey(&f);
    let v = json(&["info", "grey.hdr", "--json"]);
    assert_eq!((&v["kind"], &v["file"], &v["width"]), (&"probe".into(), &"grey.hdr".into(), &8.into()));
    let text = String::from_utf8(halflight(&f.0, &["info", "grey.hdr"]).stdout).unwrap();
    assert!(text.contains("grey.hdr, 8x4 pixels"), "{text}");
}

#[test]
fn info_describes_pictures_of_its_own_and_leaves_probes_probes() {
    use halflight::io::{ExrChannel, ExrOptions, write_exr, write_exr_layers, write_png};
    use halflight::scene::Picture;
    let f = Folder::new("pictures");
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let text = |file: &str| String::from_utf8(halflight(&f.0, &["info", file]).stdout).unwrap();
    // As wide as a probe would be.
    let picture = Picture::new(8, 4);
    let meta = [("scene".to_string(), "[volume]\nfile = \"v.nrrd\"".to_string()), ("frame".into(), "7".into())];
    let depth = ExrChannel { name: "depth.Z".into(), values: vec![1.0; 32], full: true };
    write_exr_layers(&f.0.join("p.exr"), &picture, &[depth], ExrOptions { half: true, ..Default::default() }, &meta).unwrap();
    write_png(&f.0.join("p.png"), &picture, 0.0, &meta).unwrap();
    for (file, layers) in [("p.exr", "RGBA half, depth float"), ("p.png", "RGBA 8-bit")] {
        let said = text(file);
        assert!(said.contains(&format!("{file}, 8x4 pixels, written by halflight {}", env!("CARGO_PKG_VERSION"))), "{said}");
        assert!(said.contains(&format!("layers     {layers}\n")) && said.contains("\n  file = \"v.nrrd\"\n"), "{said}");
        let v = json(&["info", file, "--json"]);
        assert_eq!((&v["kind"], &v["picture"]["width"], &v["meta"]["frame"]), (&"picture".into(), &8.into(), &"7".into()));
        assert_eq!(v["meta"]["scene"], meta[0].1.as_str());
        fails(&f, &["info", file, "--volume.spacing", "1,1,1"], 2, "`volume.spacing` changes nothing in the description of a picture");
        fails(&f, &["info", file, "--plot", "h.png"], 2, "--plot draws the histogram of a volume, and this is a picture");
    }
    // One that says nothing of its making is what it was: a probe, a slice of a volume.
    write_exr(&f.0.join("q.exr"), &picture, &[]).unwrap();
    write_png(&f.0.join("q.png"), &picture, 0.0, &[]).unwrap();
    assert_eq!(json(&["info", "q.exr", "--json"])["kind"], "probe");
    assert_eq!(json(&["info", "q.png", "--volume.component", "0", "--json"])["kind"], "volume");
    // A header that ends early is for the readers to refuse.
    for file in ["p.exr", "p.png"] {
        let bytes = std::fs::read(f.0.join(file)).unwrap();
        f.file(file, &bytes[..60]);
        fails(&f, &["info", file], 3, file);
        // One that is whole over pixels that are not is no picture either.
        f.file(file, &bytes[..bytes.len() - 20]);
        fails(&f, &["info", file], 3, file);
    }
}

#[test]
fn info_of_a_scene_is_in_words_and_counts_a_series() {
    let f = Folder::new("words");
    let volume = std::fs::read(f.volume()).unwrap();
    grey(&f);
    for n in [1, 2, 4, 7] {
        f.file(&format!("t_{n:02}.nrrd"), &volume);
    }
    let text = |arguments: &[&str]| {
        let out = halflight(&f.0, &[&["info"], arguments].concat());
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    f.file("s.toml", "[volume]\nfile = 't_##.nrrd'\n[surface]\niso = 9\n[visibility]\nmethod = 'sweep'\n[animation]\nframes = 5");
    let said = text(&["s.toml", "--surface.shading", "isotropic"]);
    for line in [
        "surface    iso 9, isotropic",
        "light      constant [1, 1, 1]",
        "directions, sweep",
        "animation  frames 1 to 5, 24 a second",
        "series     5 files, t_01.nrrd to t_05.nrrd; 2 missing: t_03.nrrd, t_05.nrrd",
    ] {
        assert!(said.contains(&format!("{line}\n")), "{line}: {said}");
    }
    assert!(text(&["s.toml", "--light.probe", "grey.hdr"]).contains("light      probe grey.hdr\n"));
    // A track of numbers, and numbers that are listed.
    let moved = text(&["s.toml", "--set", "animation.keyframe=[{ frame = 1, volume.number = 1 }, { frame = 2, volume.number = 2 }]"]);
    assert!(moved.contains("24 a second; volume.number\n") && moved.contains("series     2 files, t_01.nrrd to t_02.nrrd\n"), "{moved}");
    assert!(text(&["s.toml", "--volume.numbers", "1,4,7"]).contains("series     3 files, t_01.nrrd to t_07.nrrd\n"));
    let v: Value = serde_json::from_slice(&halflight(&f.0, &["info", "s.toml", "--json"]).stdout).unwrap();
    assert_eq!(
        v["series"],
        serde_json::json!({ "files": 5, "first": "t_01.nrrd", "last": "t_05.nrrd", "missing": ["t_03.nrrd", "t_05.nrrd"] })
    );
    // Without a scene: one of them, and a sentence where none is named.
    assert!(text(&["t_##.nrrd", "--volume.number", "4"]).contains("volume     t_04.nrrd\n"));
    fails(
        &f,
        &["info", "t_##.nrrd"],
        3,
        "t_##.nrrd: no such file; as a pattern it stands for the files of a time series; name one of them",
    );
    fails(&f, &["render", "t_%02d.nrrd", "-o", "x.png"], 3, "or say which with --volume.number");
}

#[test]
fn transfer_lists_bare_names() {
    let f = Folder::new("names");
    f.file(
        "p.json",
        r#"[{"Name":"hot metal","ColorSpace":"RGB","RGBPoints":[0,0,0,0,1,1,1,1]},{"Name":"grey","ColorSpace":"RGB","RGBPoints":[0,0,0,0,1,1,1,1]}]"#,
    );
    let text = |more: &[&str]| String::from_utf8(halflight(&f.0, &[&["transfer", "p.json"], more].concat()).stdout).unwrap();
    assert_eq!(text(&["--list"]), "hot metal\ngrey\n");
    assert_eq!(text(&["--list", "--preset", "Grey"]), "grey\n");
    assert!(text(&[]).starts_with("file       p.json, 2 presets of ParaView") && text(&[]).contains("'grey': 2 colours"), "{}", text(&[]));
    let v: Value = serde_json::from_str(&text(&["--list", "--json"])).unwrap();
    assert_eq!((&v["presets"][0]["name"], &v["presets"][0]["colors"]), (&"hot metal".into(), &2.into()));
}

#[test]
fn light_projects_a_probe() {
    let f = Folder::new("light");
    // 8x4 Radiance pixels of (1, ½, ¼): mantissas 128, 64, 32 at exponent 129 (2^(129−136) = 1/128).
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    hdr.extend([128, 64, 32, 129].repeat(32));
    f.file("grey.hdr", hdr);
    let out = halflight(&f.0, &["light", "grey.hdr", "--json", "--light.scale", "2", "-o", "both.png"]);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    // A constant's only coefficient is 2·L·√(4π), and its radiance is 2·L everywhere.
    let l00 = v["coefficients"][0][0].as_f64().unwrap();
    assert!((l00 / (2.0 * (4.0 * std::f64::consts::PI).sqrt()) - 1.0).abs() < 0.02, "{l00}");
    assert!((v["coefficients"][0][1].as_f64().unwrap() / l00 - 0.5).abs() < 0.02);
    let up = &v["radiance"]["+z"];
    assert!((up["projected"][0].as_f64().unwrap() - up["probe"][0].as_f64().unwrap()).abs() < 0.02);
    assert!(std::fs::metadata(f.0.join("both.png")).unwrap().len() > 100);
    let text = String::from_utf8(halflight(&f.0, &["light", "grey.hdr"]).stdout).unwrap();
    assert!(text.contains("band 0") && text.contains("-z"), "{text}");
}
