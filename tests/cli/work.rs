//! Work on a device: pictures, fields, memory.

use super::*;

#[test]
fn render_makes_a_picture_and_says_what_it_took() {
    if !device() {
        return;
    }
    let f = Folder::new("render");
    sphere(&f);
    let run = |arguments: &[&str]| {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    let v: Value = serde_json::from_str(&run(&["render", "scene.toml", "-o", "a.exr", "--json"])).unwrap();
    assert_eq!(v["field"]["dims"], serde_json::json!([8, 6, 4]));
    assert_eq!(v["picture"], serde_json::json!({ "width": 40, "height": 30 }));
    let kernels: Vec<&str> = v["timings"].as_array().unwrap().iter().map(|t| t["kernel"].as_str().unwrap()).collect();
    assert!(["sweep", "gather", "relight", "raymarch"].iter().all(|k| kernels.contains(k)), "{kernels:?}");
    assert!(v["memory"]["peak"].as_u64().unwrap() > 0 && v["device"]["name"].is_string() && v["seconds"].is_f64());
    let a = halflight::io::read_picture_exr(&f.0.join("a.exr")).unwrap();
    assert_eq!((a.width, a.height), (40, 30));
    // The sphere is in the middle, the corner is empty; nearly unoccluded, it sends back its albedo's colour.
    let middle = a.rgba[15 * 40 + 20];
    assert!(middle[3] > 0.9 && middle[0] > 0.15 && middle[0] <= 1.01, "{middle:?}");
    assert!((middle[1] / middle[0] - 0.5).abs() < 1e-3 && a.rgba[0] == [0.0; 4], "{middle:?}");
    // An override shows: twice the light, twice the radiance; a background fills what was empty.
    run(&["render", "scene.toml", "-o", "b.exr", "--light.scale", "2", "--image.background", "light"]);
    let b = halflight::io::read_picture_exr(&f.0.join("b.exr")).unwrap();
    assert_eq!(b.rgba[0], [2.0, 2.0, 2.0, 1.0]);
    let expected = 2.0 * middle[0] + (1.0 - middle[3]) * 2.0;
    assert!((b.rgba[15 * 40 + 20][0] - expected).abs() < 0.02 * expected);
    let text = run(&["render", "scene.toml", "-o", "c.png", "--surface.iso", "100", "--surface.shading", "isotropic"]);
    assert!(["device", "16x12x8 uint8", "needs about", "isosurface", "c.png after"].iter().all(|p| text.contains(p)), "{text}");
    assert!(std::fs::metadata(f.0.join("c.png")).unwrap().len() > 100);
}

#[test]
fn precompute_writes_the_field() {
    if !device() {
        return;
    }
    let f = Folder::new("precompute");
    sphere(&f);
    let out = halflight(&f.0, &["precompute", "scene.toml", "-o", "field.nrrd", "--visibility.bands", "3", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    let info: Value = serde_json::from_slice(&halflight(&f.0, &["info", "field.nrrd", "--json"]).stdout).unwrap();
    assert_eq!((&info["kind"], &info["field"]["coefficients"]), (&"field".into(), &9.into()));
    assert!(info["meta"]["scene"].as_str().unwrap().contains("bands = 3"), "{info}");
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert_eq!((field.coefficients, field.grid.dims()), (9, [8, 6, 4]));
    // The corner sees nearly all of the sky: v₀₀ near 2√π. The middle of the sphere sees little of it.
    let most = 2.0 * std::f32::consts::PI.sqrt();
    let middle = field.data[9 * (4 + 8 * (3 + 6 * 2))];
    assert!(field.data[0] > 0.9 * most && field.data[0] <= 1.01 * most && middle < 0.5 * most, "{} {middle}", field.data[0]);
    // Sabotage of the same comparison: without matter the middle sees all.
    let vacuum = ["precompute", "scene.toml", "-o", "field.nrrd", "--transfer.points", "[[0, 1, 1, 1, 0]]", "--visibility.cells", "all"];
    let out = halflight(&f.0, &vacuum);
    assert_eq!(out.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&out.stderr).contains("the picture will be empty"));
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert!(field.data[16 * (4 + 8 * (3 + 6 * 2))] > 0.99 * most);
    // Cells that no renderer reads are zero unless all are asked for.
    assert_eq!(halflight(&f.0, &vacuum[..6]).status.code(), Some(0));
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert!(field.data.iter().all(|&v| v == 0.0));
}

#[test]
fn a_background_does_not_count_as_picture() {
    if !device() {
        return;
    }
    let f = Folder::new("background");
    sphere(&f);
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, &[arguments, &["--json"]].concat());
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let reference = ["--reference=0.05", "--image.background", "0.1,0.1,0.1"];
    for (file, more) in
        [("a.exr", &[][..]), ("t.exr", &reference[..1]), ("b.exr", &reference[1..]), ("u.exr", &reference), ("u.png", &reference)]
    {
        json(&[&["render", "scene.toml", "-o", file], more].concat());
    }
    json(&["render", "scene.toml", "-o", "b.png", "--image.background", "0.1,0.1,0.1"]);
    // The layer's channel is that of --aov opacity; a reference without a background has none.
    let channels = |file| json(&["info", file])["picture"]["channels"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(channels("u.exr"), ["A", "B", "G", "R", halflight::stages::aov::LAYERS[5].1[0], "stderr.B", "stderr.G", "stderr.R"]);
    assert_eq!(channels("t.exr"), ["A", "B", "G", "R", "stderr.B", "stderr.G", "stderr.R"]);
    let [plain, over] = [json(&["compare", "a.exr", "t.exr"]), json(&["compare", "b.exr", "u.exr"])];
    let rmse = |v: &Value| v["difference"]["relative_rmse"].as_f64().unwrap();
    assert_eq!((&plain["coverage"], &over["coverage"]), (&"alpha".into(), &"opacity".into()));
    assert!(plain["difference"]["covered"] == over["difference"]["covered"] && plain["difference"]["covered"].as_u64().unwrap() < 600);
    println!(
        "relative RMSE {} without a background, {} over one, {} with all of it",
        rmse(&plain),
        rmse(&over),
        over["difference"]["relative_rmse_all"]
    );
    // What shines through at the edge is picture, the sky beside it is none.
    assert!(rmse(&over) <= rmse(&plain) && rmse(&over) > 0.6 * rmse(&plain), "{} {}", rmse(&over), rmse(&plain));
    // Sabotage: of pictures that keep no coverage all of the sky counts, which is said.
    let out = halflight(&f.0, &["compare", "b.png", "u.png", "--json"]);
    let (v, said): (Value, _) = (serde_json::from_slice(&out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap());
    assert!(v["difference"]["covered"] == 1200 && rmse(&v) < 0.6 * rmse(&plain), "{v}");
    assert!(said.contains("u.png: its background counts as picture") && said.contains("--aov opacity"), "{said}");
    assert!(said.contains(v["warning"].as_str().unwrap()) && plain.get("warning").is_none() && over.get("warning").is_none());
    let text = String::from_utf8(halflight(&f.0, &["compare", "b.exr", "u.exr"]).stdout).unwrap();
    assert!(text.contains("(its layer opacity; "), "{text}");
}

#[test]
#[cfg(unix)]
fn a_signal_ends_render_and_precompute_with_nothing_written() {
    if !device() {
        return;
    }
    let f = Folder::new("signals");
    sphere(&f);
    let long = ["--visibility.directions", "1000000", "--visibility.ratio", "1", "--visibility.method", "march"];
    let cases: [(&[&str], &[&str]); 3] = [
        (&["render", "scene.toml", "-o", "new/x.exr"], &long),
        (&["render", "scene.toml", "-o", "new/x.exr", "--reference=0.00001", "--samples", "16777216"], &[]),
        (&["precompute", "scene.toml", "-o", "new/x.nrrd"], &long),
    ];
    for (i, (arguments, more)) in cases.into_iter().enumerate() {
        let (signal, name, code) = [("-INT", "SIGINT", 130), ("-TERM", "SIGTERM", 143)][i % 2];
        let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
        command.current_dir(&f.0).args(arguments).args(more).arg("--json").stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        while !f.0.join("new").exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it began");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        // Into the work on the device, most likely; wherever it is, it ends the same.
        std::thread::sleep(std::time::Duration::from_millis(600));
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let out = child.wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
        let object: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(object, serde_json::json!({ "error": format!("stopped by {name}"), "code": code }), "{arguments:?}");
        assert!(!f.0.join("new").exists(), "{arguments:?}: nothing is left");
    }
}

#[test]
fn too_little_memory_is_5_and_an_unknown_device_4() {
    if !device() {
        return;
    }
    let f = Folder::new("memory");
    sphere(&f);
    let out = halflight(&f.0, &["render", "scene.toml", "-o", "x.png", "--memory", "1K"]);
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(5), "{stderr}");
    assert!(
        stderr.contains("the volume of ")
            && stderr.contains("of device memory, 1.0 KiB of 1.0 KiB are free")
            && stderr.contains("resample")
            && !f.0.join("x.png").exists(),
        "{stderr}"
    );
    // What would fit is less than what did not.
    let out = halflight(&f.0, &["render", "scene.toml", "-o", "x.png", "--memory", "10K"]);
    let stderr = String::from_utf8(out.stderr).unwrap();
    let side: u32 = stderr.split("about ").nth(1).and_then(|t| t.split('x').next()).and_then(|n| n.parse().ok()).expect(&stderr);
    assert!((1..12).contains(&side) && side.pow(3) < 16 * 12 * 8, "{stderr}");
    fails(&f, &["render", "scene.toml", "-o", "x.png", "--device", "no such device"], 4, "no such device");
    // Before the command, too; what stands behind it holds.
    fails(&f, &["--device", "none such", "render", "scene.toml", "-o", "x.png"], 4, "none such");
    fails(&f, &["--device", "none such", "render", "scene.toml", "-o", "x.png", "--device", "no such device"], 4, "no such device");
    let out = halflight(&f.0, &["--threads", "2", "--memory", "1K", "render", "scene.toml", "-o", "x.png"]);
    assert_eq!(out.status.code(), Some(5), "{}", String::from_utf8_lossy(&out.stderr));
}

#[test]
fn a_tolerance_that_drops_a_fit_says_so() {
    let f = Folder::new("fit");
    sphere(&f);
    for (fit, said) in [(8, true), (0, false)] {
        let text = std::fs::read_to_string(f.0.join("scene.toml")).unwrap();
        f.file("fit.toml", format!("{text}\nvisibility.fit = {fit}\n"));
        let out = halflight(&f.0, &["precompute", "fit.toml", "-o", "f.nrrd", "--tolerance", "0.5"]);
        let err = String::from_utf8(out.stderr).unwrap();
        assert_eq!(out.status.code(), Some(0), "{err}");
        assert_eq!(err.contains("`visibility.fit` gives way to the tolerance") && err.contains("fit.toml line "), said, "{err}");
    }
}
