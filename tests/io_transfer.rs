//! ParaView presets: their curves follow VTK's formulas, their scalars ParaView's rescaling.

mod io_common;
use halflight::Result;
use halflight::io::{TransferOptions, read_transfer};
use halflight::scene::Grid;
use halflight::scene::transfer::{Kind, Reference, Transfer};
use io_common::{Folder, says};

fn grid() -> Grid {
    Grid::axis_aligned([4; 3], [1.0; 3]).unwrap()
}

/// Opacity over the reference length, which is 1 here.
fn opacity(t: &Transfer, x: f64) -> f64 {
    1.0 - (-t.sigma(x, &grid())).exp()
}

fn preset(json: &str, options: &TransferOptions) -> Result<Transfer> {
    let dir = Folder::new();
    read_transfer(&dir.file("p.json", &[json.as_bytes()]), options)
}

fn linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

const GREY: &str = r#"{"ColorSpace":"RGB","Name":"g","NanColor":[1,0,0],"RGBPoints":[0,0,0,0,1,1,1,1]}"#;

#[test]
fn colours_are_mixed_as_displayed_and_albedo_is_linear() {
    let t = preset(GREY, &TransferOptions::new([100.0, 300.0])).unwrap();
    for i in 0..=200 {
        let s = f64::from(i) / 200.0;
        let expected = linear(s);
        let got = f64::from(t.albedo(100.0 + 200.0 * s)[1]);
        assert!((got - expected).abs() < 2e-4, "at {s}: {got}, display grey {s} is {expected}");
    }
    assert!((f64::from(t.albedo(200.0)[0]) - 0.5).abs() > 0.2, "a straight line in linear light would be seen");
}

#[test]
fn scalars_are_placed_as_paraview_does() {
    let end = |json: &str, options: &TransferOptions| {
        let t = preset(json, options).unwrap();
        (t.colors()[0].0, t.colors().last().unwrap().0, t.opacities()[0].0, t.opacities().last().unwrap().0)
    };
    let data = TransferOptions::new([-5.0, 7.0]);
    assert_eq!(end(GREY, &data), (-5.0, 7.0, -5.0, 7.0), "0..1 spans the data");
    let absolute = GREY.replace("1,1,1,1]", "1200,1,1,1]");
    assert_eq!(end(&absolute, &data), (0.0, 1200.0, 0.0, 1200.0), "other scalars are absolute");
    let signed = GREY.replace("[0,", "[-1,");
    assert!(signed != GREY && end(&signed, &data) == (-5.0, 7.0, -5.0, 7.0), "-1..1 is what most of ParaView's own span");
    let ranged = TransferOptions { range: Some([10.0, 20.0]), ..data.clone() };
    assert_eq!(end(GREY, &ranged), (10.0, 20.0, 10.0, 20.0));
    assert_eq!(end(&absolute, &ranged), (10.0, 20.0, 10.0, 20.0), "a range overrides");
    // Colours and opacities move together.
    let both = GREY.replace("\"RGBPoints\"", "\"Points\":[0.5,0,0.5,0,0.75,1,0.5,0],\"RGBPoints\"");
    assert_eq!(end(&both, &data), (-5.0, 7.0, 1.0, 4.0));
    let t = preset(&both, &TransferOptions { reference: Reference::Side, ..data.clone() }).unwrap();
    assert_eq!((t.kind(), t.reference()), (Kind::Opacity, Reference::Side));
    let nan = TransferOptions { range: Some([f64::NAN, 1.0]), ..data };
    says(preset(GREY, &nan), &["transfer range", "finite"]);
    says(preset(GREY, &TransferOptions::new([1.0, 0.0])), &["data range", "ascend"]);
}

#[test]
fn without_points_the_opacity_is_a_ramp() {
    let t = preset(GREY, &TransferOptions::new([0.0, 10.0])).unwrap();
    for x in [0.0, 2.5, 5.0, 9.0] {
        assert!((opacity(&t, x) - x / 10.0).abs() < 1e-9);
    }
}

/// A preset with one opacity interval 0..1 from `a` to `b` of that shape.
fn shape(a: f64, b: f64, midpoint: f64, sharpness: f64) -> Transfer {
    let points = format!("\"Points\":[0,{a},{midpoint},{sharpness},1,{b},0.5,0],\"RGBPoints\"");
    preset(&GREY.replace("\"RGBPoints\"", &points), &TransferOptions::new([0.0, 1.0])).unwrap()
}

#[test]
fn midpoint_and_sharpness_shape_the_opacity() {
    // Straight: the mean is reached at the midpoint.
    let t = shape(0.2, 0.8, 0.25, 0.0);
    for (x, y) in [(0.0, 0.2), (0.125, 0.35), (0.25, 0.5), (0.625, 0.65), (1.0, 0.8)] {
        assert!((opacity(&t, x) - y).abs() < 1e-9, "at {x}: {}", opacity(&t, x));
    }
    // Sharp: a step at the midpoint.
    let t = shape(0.2, 0.8, 0.25, 1.0);
    for (x, y) in [(0.0, 0.2), (0.249, 0.2), (0.25, 0.8), (0.9, 0.8)] {
        assert!((opacity(&t, x) - y).abs() < 1e-9, "at {x}: {}", opacity(&t, x));
    }
    // In between: VTK's curve, by hand for sharpness 0.5, s = 0.25 of a midpoint of 0.5: s' = ½·(½)^6 = 1/128.
    let t = shape(0.0, 0.9, 0.5, 0.5);
    let s: f64 = 1.0 / 128.0;
    let expected = 0.9 * (3.0 * s * s - 2.0 * s.powi(3)) + 0.45 * (2.0 * s.powi(3) - 3.0 * s * s + s);
    assert!((opacity(&t, 0.25) - expected).abs() < 1e-6, "{} {expected}", opacity(&t, 0.25));
    assert!((opacity(&t, 0.5) - 0.45).abs() < 1e-9, "the mean at the midpoint");
    assert!((opacity(&t, 0.75) + opacity(&t, 0.25) - 0.9).abs() < 1e-6, "point symmetric");
    assert!((opacity(&t, 0.25) - 0.225).abs() > 0.1, "a straight line would be seen");
}

#[test]
fn colour_spaces() {
    let two = |space: &str| {
        let json = format!(r#"[{{"ColorSpace":"{space}","RGBPoints":[0,0.230,0.299,0.754,1,0.706,0.016,0.150]}}]"#);
        preset(&json, &TransferOptions::new([0.0, 1.0])).unwrap()
    };
    let near = |t: &Transfer, x: f64, display: [f64; 3], tolerance: f64| {
        let got = t.albedo(x).map(f64::from);
        (0..3).all(|c| (got[c] - linear(display[c])).abs() < tolerance)
    };
    let ends = ([0.230, 0.299, 0.754], [0.706, 0.016, 0.150]);
    for space in ["RGB", "HSV", "Lab", "Diverging", "Step"] {
        let t = two(space);
        assert!(near(&t, 0.0, ends.0, 1e-6) && near(&t, 1.0, ends.1, 1e-6), "{space} keeps its points");
    }
    // Moreland's map passes a light grey; straight lines in sRGB and Lab do not.
    assert!(near(&two("Diverging"), 0.5, [0.865; 3], 0.02), "{:?}", two("Diverging").albedo(0.5));
    assert!(near(&two("RGB"), 0.5, [0.468, 0.1575, 0.452], 1e-3));
    assert!(!near(&two("Lab"), 0.5, [0.468, 0.1575, 0.452], 1e-3));
    assert!(near(&two("Step"), 0.01, ends.1, 1e-6) && near(&two("Step"), -1.0, ends.0, 1e-6), "the later colour holds");
}

#[test]
fn presets_are_chosen_by_name() {
    let named = |name: Option<&str>| TransferOptions { name: name.map(str::to_owned), ..TransferOptions::new([0.0, 1.0]) };
    let file = format!("[{GREY},{}]", GREY.replace("\"g\"", "\"Other\"").replace("1,1,1,1]", "1,1,0,0]"));
    assert_eq!(preset(&file, &named(Some("other"))).unwrap().albedo(1.0), [1.0, 0.0, 0.0]);
    assert_eq!(preset(&file, &named(Some("g"))).unwrap().albedo(1.0), [1.0; 3]);
    says(preset(&file, &named(None)), &["2 presets and none was named", "'g', 'Other'"]);
    says(preset(&file, &named(Some("x"))), &["no preset is named 'x'", "'Other'"]);
    assert!(preset(&format!("\u{feff}{GREY}"), &named(None)).is_ok(), "a byte order mark is skipped");
}

#[test]
fn bad_presets_say_what_is_wrong() {
    let open = |json: &str| preset(json, &TransferOptions::new([0.0, 1.0]));
    says(open("<xml>"), &["no JSON", "line 1"]);
    says(open("3"), &["no preset"]);
    says(open("[]"), &["no preset"]);
    says(open(r#"{"IndexedColors":[1,1,1]}"#), &["IndexedColors", "categories"]);
    says(open(r#"{"Name":"x"}"#), &["no RGBPoints"]);
    says(open(r#"{"RGBPoints":[]}"#), &["0 numbers", "4 per point"]);
    says(open(r#"{"RGBPoints":[0,0,0,0,1]}"#), &["5 numbers"]);
    says(open(r#"{"RGBPoints":[0,0,0,"a"]}"#), &["'\"a\"'", "finite numbers"]);
    says(open(r#"{"RGBPoints":[0,0,0,1e999]}"#), &["no JSON"]);
    says(open(r#"{"RGBPoints":[0,0,0,1.5]}"#), &["the colour [0.0, 0.0, 1.5] at 0", "0..1"]);
    says(open(r#"{"RGBPoints":[0,0,0,1],"Points":[0,2,0.5,0]}"#), &["opacity point", "0..1"]);
    says(open(r#"{"RGBPoints":[0,0,0,1],"ColorSpace":"CMYK"}"#), &["CMYK", "Diverging"]);
    assert!(open(r#"{"RGBPoints":[0.5,0,0,1]}"#).is_ok(), "one point is a constant");
    // Far apart: no infinity gets through.
    assert!(open(r#"{"RGBPoints":[-1e308,0,0,1,1e308,1,1,1]}"#).is_err());
}

#[test]
fn real_presets_open() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/transfer/");
    let (okubo, maps) = (format!("{data}paraview_json/OkuboWeiss.json"), format!("{data}vtkjs_json/ColorMaps.excerpt.json"));
    if !std::path::Path::new(&okubo).is_file() {
        println!("skipped: the real presets are not here");
        return;
    }
    let t = read_transfer(okubo.as_ref(), &TransferOptions::new([0.0, 9.0])).unwrap();
    assert!((opacity(&t, 0.5) - 0.5).abs() < 1e-9 && opacity(&t, 1.0) < 1e-9, "scalars 0..2 are absolute");
    let named = |name: &str| TransferOptions { name: Some(name.into()), ..TransferOptions::new([0.0, 255.0]) };
    for name in ["Cool to Warm", "Rainbow Desaturated", "Cold and Hot", "Black-Body Radiation", "X Ray", "Grayscale", "Linear YGB 1211g"] {
        let t = read_transfer(maps.as_ref(), &named(name)).unwrap();
        assert_eq!((t.colors()[0].0, t.colors().last().unwrap().0), (0.0, 255.0), "{name}");
    }
    says(read_transfer(maps.as_ref(), &named("KAAMS")), &["IndexedColors"]);
}
