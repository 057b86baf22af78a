//! Transfer functions of other programs: read as they mean them, and written so that reading gives the same function.

mod io_common;
use halflight::Result;
use halflight::io::transfer::{Format, Preset, choose, convert, read_presets};
use halflight::io::{TransferOptions, read_transfer};
use halflight::scene::Grid;
use halflight::scene::transfer::Transfer;
use io_common::{Folder, says};

/// Opacity over the reference length, which is 1 here.
fn opacity(t: &Transfer, x: f64) -> f64 {
    let grid = Grid::axis_aligned([4; 3], [1.0; 3]).unwrap();
    1.0 - (-t.sigma(x, &grid)).exp()
}

fn linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

fn open(file: &str, text: &str, options: &TransferOptions) -> Result<Transfer> {
    let dir = Folder::new();
    read_transfer(&dir.file(file, &[text.as_bytes()]), options)
}

fn presets(file: &str, text: &str) -> Vec<Preset> {
    let dir = Folder::new();
    read_presets(&dir.file(file, &[text.as_bytes()])).unwrap().1.into_iter().map(|p| p.preset.unwrap()).collect()
}

/// Checks opacity and display colour at scalars.
#[track_caller]
fn is(t: &Transfer, expected: &[(f64, f64, [f64; 3])]) {
    for (x, a, rgb) in expected {
        assert!((opacity(t, *x) - a).abs() < 1e-6, "at {x}: opacity {}, not {a}", opacity(t, *x));
        let albedo = t.albedo(*x).map(f64::from);
        assert!((0..3).all(|c| (albedo[c] - linear(rgb[c])).abs() < 1e-3), "at {x}: {albedo:?}, not {:?}", rgb.map(linear));
    }
}

const KEYS: &str = r#"<?xml version="1.0" ?>
<VoreenData version="1"><TransFuncIntensity type="TransFuncIntensity">
  <alphaMode value="1" /><gammaValue value="1" /><domain x="0" y="200" /><threshold x="0" y="1" />
  <Keys>
    <key type="TransFuncMappingKey"><intensity value="0.25" /><split value="false" /><colorL r="255" g="0" b="0" a="0" /></key>
    <key type="TransFuncMappingKey"><intensity value="0.5" /><split value="true" /><colorL r="0" g="255" b="0" a="51" /><colorR r="0" g="0" b="255" a="102" /></key>
    <key type="TransFuncMappingKey"><intensity value="1" /><split value="false" /><colorL r="255" g="255" b="255" a="204" /></key>
  </Keys>
</TransFuncIntensity></VoreenData>"#;

#[test]
fn voreen_keys() {
    let data = TransferOptions::new([-5.0, 7.0]);
    let t = open("a.tfi", KEYS, &data).unwrap();
    // The domain is the data's; a split key is still its left colour.
    let (red, green, blue) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    is(
        &t,
        &[
            (0.0, 0.0, red),
            (50.0, 0.0, red),
            (75.0, 0.1, [0.5, 0.5, 0.0]),
            (100.0, 0.2, green),
            (100.0003, 0.4, blue),
            (150.0, 0.6, [0.5, 0.5, 1.0]),
            (300.0, 0.8, [1.0; 3]),
        ],
    );
    // A domain of 0..1 is relative, a threshold is transparent beyond, an alpha mode replaces the keys'.
    let t = open("a.tfi", &KEYS.replace("y=\"200\"", "y=\"1\""), &data).unwrap();
    is(&t, &[(-2.0, 0.0, red), (1.0, 0.2, green), (7.0, 0.8, [1.0; 3])]);
    let t = open("a.tfi", &KEYS.replace("threshold x=\"0\" y=\"1\"", "threshold x=\"0.375\" y=\"0.75\""), &data).unwrap();
    is(
        &t,
        &[
            (74.9, 0.0, [0.502, 0.498, 0.0]),
            (75.0, 0.1, [0.5, 0.5, 0.0]),
            (125.0, 0.5, [0.25, 0.25, 1.0]),
            (150.1, 0.0, [0.501, 0.501, 1.0]),
        ],
    );
    assert!(open("a.tfi", &KEYS.replace("alphaMode value=\"1\"", "alphaMode value=\"2\""), &data).is_ok_and(|t| opacity(&t, 50.0) > 0.999));
    // Of functions that say their data type, what has no opacity keeps none.
    let typed = KEYS.replace("alphaMode value=\"1\"", "alphaMode value=\"2\"").replace("<Keys>", "<dataType value=\"5121\" /><Keys>");
    is(
        &open("a.tfi", &typed, &data).unwrap(),
        &[(50.0, 0.0, [1.0, 0.0, 0.0]), (50.1, 1.0, [0.998, 0.002, 0.0]), (75.0, 1.0, [0.5, 0.5, 0.0]), (200.0, 1.0, [1.0, 1.0, 1.0])],
    );
    is(&open("a.tfi", &typed, &data).unwrap(), &[(20.0, 0.0, [1.0, 0.0, 0.0])]);
    let gamma = presets("a.tfi", &KEYS.replace("gammaValue value=\"1\"", "gammaValue value=\"2\""));
    assert!(gamma[0].lost().any(|l| l.contains("gammaValue 2")));
    // Part of the normalised values, as older files have it: said, for the keys are placed in the whole.
    for (y, said) in [("0.8", true), ("1", false), ("200", false)] {
        let part = presets("a.tfi", &KEYS.replace("y=\"200\"", &format!("y=\"{y}\"")));
        assert_eq!(part[0].lost().any(|l| l == format!("domain 0 to {y}: the data's range takes its place")), said, "{y}");
    }
}

#[test]
fn voreen_curves() {
    let text = r#"<VoreenData version="1"><TransFuncGaussian><domain x="0" y="100"/><Curves>
      <curve><intensity value="0.5"/><width value="0.002"/><baseValue value="0"/><split value="false"/><active value="true"/><colorL r="255" g="0" b="0" a="102"/></curve>
      <curve><intensity value="0.9"/><width value="0.002"/><baseValue value="0"/><split value="false"/><active value="false"/><colorL r="0" g="255" b="0" a="255"/></curve>
    </Curves></TransFuncGaussian></VoreenData>"#;
    let t = open("a.tfg", text, &TransferOptions::new([0.0, 1.0])).unwrap();
    for x in [40.0, 50.0, 55.0, 90.0] {
        let expected = 0.4 * (-(x / 100.0f64 - 0.5).powi(2) / 0.004).exp();
        assert!((opacity(&t, x) - expected).abs() < 1e-4, "at {x}: {} {expected}", opacity(&t, x));
    }
    is(&t, &[(50.0, 0.4, [1.0, 0.0, 0.0])]);
    says(open("a.tfg", &text.replace("0.002", "0"), &TransferOptions::new([0.0, 1.0])), &["line 2: the width of a curve is 0"]);
}

#[test]
fn inviwo_points() {
    let text = r#"<?xml version="1.0" ?><InviwoTreeData version="1.0"><maskMin content="0" /><maskMax content="0.75" />
      <dataPoints><point><pos x="0.25" y="0.9"/><rgba x="1" y="0" z="0" w="0.2"/></point><point><pos x="0.75" y="0"/><rgba x="0" y="0" z="1" w="0.6"/></point></dataPoints>
      <interpolationType_ content="0" /></InviwoTreeData>"#;
    let data = TransferOptions::new([100.0, 300.0]);
    let t = open("a.itf", text, &data).unwrap();
    // Positions are of the data's range, not of the points' own.
    is(
        &t,
        &[
            (100.0, 0.2, [1.0, 0.0, 0.0]),
            (150.0, 0.2, [1.0, 0.0, 0.0]),
            (200.0, 0.4, [0.5, 0.0, 0.5]),
            (250.0, 0.6, [0.0, 0.0, 1.0]),
            (251.0, 0.0, [0.0, 0.0, 1.0]),
        ],
    );
    let later = text
        .replace("dataPoints", "Points")
        .replace("<point>", "<Point>")
        .replace("</point>", "</Point>")
        .replace("pos x=", "pos content=");
    assert_eq!(open("a.itf", &later, &data).unwrap(), t);
    let absolute = text.replace("x=\"0.75\"", "x=\"1500\"");
    is(&open("a.itf", &absolute, &data).unwrap(), &[(1500.0, 0.6, [0.0, 0.0, 1.0])]);
    // The file's own word comes before what the points look like.
    let typed = |kind: u8, text: &str| text.replace("<dataPoints>", &format!("<type content=\"{kind}\" /><dataPoints>"));
    assert_eq!(open("a.itf", &typed(0, text), &data).unwrap(), t);
    let scalars = typed(1, text);
    let small = TransferOptions::new([-1.0, 2.0]);
    // The data's scalars 0.25 and 0.75; the mask is of relative positions.
    is(
        &open("a.itf", &scalars, &small).unwrap(),
        &[(0.25, 0.2, [1.0, 0.0, 0.0]), (0.5, 0.4, [0.5, 0.0, 0.5]), (0.76, 0.6, [0.0, 0.0, 1.0])],
    );
    let preset = &presets("a.itf", &scalars)[0];
    assert!(!preset.is_relative() && preset.lost().any(|l| l.contains("the mask")), "{:?}", preset.lost().collect::<Vec<_>>());
    let unmasked = scalars.replace("<maskMax content=\"0.75\" />", "<maskMax content=\"1\" />");
    assert_eq!(presets("a.itf", &unmasked)[0].lost().count(), 0);
    // A mask that lets all points through, as Inviwo writes it of such functions.
    let wide = scalars.replace(
        "<maskMin content=\"0\" /><maskMax content=\"0.75\" />",
        "<maskMin content=\"-1.8e308\" /><maskMax content=\"1.7e308\" />",
    );
    let wide = wide.replace("-1.8e308", "-1.7976931348623157e308");
    assert_eq!(presets("a.itf", &wide)[0].lost().count(), 0);
    assert!(presets("a.itf", &text.replace("_ content=\"0\"", "_ content=\"1\""))[0].lost().any(|l| l.contains("cubic")));
}

#[test]
fn imagevis3d_tables() {
    let t = open("a.1dt", "3\n1 0 0 0 \n0 1 0 0.5 \n0 0 1 0.25 \n", &TransferOptions::new([0.0, 100.0])).unwrap();
    is(&t, &[(0.0, 0.0, [1.0, 0.0, 0.0]), (25.0, 0.25, [0.5, 0.5, 0.0]), (50.0, 0.5, [0.0, 1.0, 0.0]), (100.0, 0.25, [0.0, 0.0, 1.0])]);
    let bad = |text: &str, parts: &[&str]| says(open("a.1dt", text, &TransferOptions::new([0.0, 1.0])), parts);
    bad("", &["empty", "number of entries"]);
    bad("0", &["number of entries is '0'"]);
    bad("99999999999999999999", &["1 to 65536"]);
    bad("2 0 0 0 0 0 0 0", &["ends in entry 1 of 2"]);
    bad("1 0 0 0 x", &["entry 0 has 'x'"]);
    bad("1 0 0 0 1e999", &["entry 0 has '1e999'"]);
    bad("1 0 0 0 0 7", &["'7' stands behind"]);
    bad("1 0 0 0 2", &["opacity", "0..1"]);
    says(open("a.2dt", "1 1", &TransferOptions::new([0.0, 1.0])), &["two variables", ".1dt"]);
}

const SLICER: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<MRML>
  <VolumeProperty name="Bone" gradientOpacity="4 0 1 255 1" specularPower="10" scalarOpacity="8 -1000 0 -16.5 0 641 0.7 3071 0.7" specular="0.2" shade="1" ambient="0.1" colorTransfer="8 -1000 0 0 0 3071 1 0.5 1" diffuse="0.9" interpolation="1"/>
  <VolumeProperty name="Skin &amp; fat" gradientOpacity="4 0 0 255 1" scalarOpacity="4 0 0 1 1" shade="0" colorTransfer="8 0 1 0 0 1 0 1 0" interpolation="1"/>
  <VolumeProperty name="Odd" scalarOpacity="5 0 0 1 1" colorTransfer="0"/>
</MRML>"#;

#[test]
fn slicer_presets() {
    let named = |name: &str| TransferOptions { name: Some(name.into()), ..TransferOptions::new([-5.0, 7.0]) };
    let t = open("presets.xml", SLICER, &named("bone")).unwrap();
    is(&t, &[(-1000.0, 0.0, [0.0; 3]), (312.25, 0.35, [0.32235, 0.161175, 0.32235]), (3071.0, 0.7, [1.0, 0.5, 1.0])]);
    // Scalars within 0..1 are the data's own here.
    is(&open("presets.xml", SLICER, &named("Skin & fat")).unwrap(), &[(0.5, 0.5, [0.5, 0.5, 0.0]), (1.0, 1.0, [0.0, 1.0, 0.0])]);
    says(open("presets.xml", SLICER, &named("Odd")), &["line 5: its scalarOpacity claims 5 numbers and has 4", "2 per point"]);
    says(open("presets.xml", SLICER, &named("None")), &["no preset is named 'None'", "'Bone', 'Skin & fat', 'Odd'"]);
    let dir = Folder::new();
    let all = read_presets(&dir.file("presets.xml", &[SLICER.as_bytes()])).unwrap();
    assert_eq!((all.0, all.1.len()), ("Slicer", 3));
    let lost = |i: usize| all.1[i].preset.as_ref().unwrap().lost().map(str::to_owned).collect::<Vec<_>>();
    assert!(lost(0).len() == 1 && lost(0)[0].contains("shading (ambient 0.1, diffuse 0.9, specular 0.2 to the power 10)"), "{:?}", lost(0));
    assert!(lost(1).len() == 1 && lost(1)[0].contains("gradient opacity (4 0 0 255 1)"), "{:?}", lost(1));
    let vp = "1\n1\n0.9\n0.1\n0.2\n10\n4 -10 0 30 0.5\n4 0 1 255 1\n8 -10 1 0 0 30 0 0 1\n";
    is(&open("a.vp", vp, &TransferOptions::new([0.0, 1.0])).unwrap(), &[(10.0, 0.25, [0.5, 0.0, 0.5])]);
    says(open("a.vp", "1\n1", &TransferOptions::new([0.0, 1.0])), &["it has 2 lines", "nine"]);
}

#[test]
fn niivue_maps_and_exposure_render() {
    let map = r#"{"min":-100,"max":155,"R":[0,255],"G":[0,0],"B":[255,0],"A":[0,51],"I":[0,255]}"#;
    is(
        &open("a.json", map, &TransferOptions::new([0.0, 1.0])).unwrap(),
        &[(-100.0, 0.0, [0.0, 0.0, 1.0]), (27.5, 0.1, [0.5, 0.0, 0.5]), (155.0, 0.2, [1.0, 0.0, 0.0])],
    );
    let relative = map.replace("\"min\":-100,\"max\":155,", "");
    is(&open("a.json", &relative, &TransferOptions::new([0.0, 10.0])).unwrap(), &[(5.0, 0.1, [0.5, 0.0, 0.5])]);
    says(open("a.json", &map.replace("[0,51]", "[0]"), &TransferOptions::new([0.0, 1.0])), &["2, 2, 2, 1 and 2 numbers"]);
    says(open("a.json", &map.replace("[0,51]", "[0,256]"), &TransferOptions::new([0.0, 1.0])), &["its A is [0,256]"]);
    let nodes = r#"<!DOCTYPE Appearance>
<Presets><Preset Name="p"><Nodes>
  <Node><NormalizedIntensity Value="0"/><Opacity Value="0"/><Diffuse R="0" G="0" B="255"/><Specular R="9" G="0" B="0"/></Node>
  <Node><NormalizedIntensity Value="1"/><Opacity Value="0.5"/><Diffuse R="255" G="0" B="0"/></Node>
</Nodes><DensityScale Value="39"/></Preset></Presets>"#;
    is(&open("a.xml", nodes, &TransferOptions::new([0.0, 10.0])).unwrap(), &[(5.0, 0.25, [0.5, 0.0, 0.5])]);
    let lost: Vec<String> = presets("a.xml", nodes)[0].lost().map(str::to_owned).collect();
    assert!(lost.len() == 2 && lost[0].contains("DensityScale 39") && lost[1].contains("specular"), "{lost:?}");
    says(open("a.xml", "<Presets><Preset><Film/></Preset></Presets>", &TransferOptions::new([0.0, 1.0])), &["cameras or lights"]);
}

#[test]
fn xml_that_is_none_or_does_too_much_is_refused() {
    let bad = |text: &str, parts: &[&str]| says(open("a.xml", text, &TransferOptions::new([0.0, 1.0])), parts);
    bad("<!DOCTYPE a [<!ENTITY x \"y\">]>\n<MRML/>", &["line 1", "document type with declarations", "remove"]);
    bad("<!DOCTYPE a SYSTEM \"http://x/y.dtd\">\n<MRML/>", &["document type with declarations"]);
    bad("<MRML>\n<a></b></MRML>", &["line 2"]);
    bad("<MRML>\n<a>\n", &["does not end", "cut short"]);
    bad("<other/>", &["its root is 'other'", "Slicer", "Voreen"]);
    bad("<a b='&unknown;'/>", &["line 1"]);
    bad("< ", &["line 1"]);
    bad(&"<a>".repeat(100), &["64 inside each other"]);
    let many: String = (0..300).map(|i| format!("a{i}='' ")).collect();
    bad(&format!("<a {many}/>"), &["256 attributes"]);
}

/// Presets with all that formats differ in: curves, a colour space, a step, and scalars of their own.
fn samples() -> Vec<Preset> {
    let straight = r#"{"Name":"straight","ColorSpace":"RGB","RGBPoints":[-100,0,0,1,50,1,1,0,300,1,0,0],"Points":[-100,0,0.5,0,0,0.5,0.5,0,300,0.9,0.5,0]}"#;
    let curved =
        r#"{"Name":"curved","ColorSpace":"Diverging","RGBPoints":[0,0.23,0.3,0.75,1,0.7,0.02,0.15],"Points":[0,0,0.3,0.6,1,0.8,0.5,0]}"#;
    let list = presets("p.json", &format!("[{straight},{curved}]"));
    list.into_iter().chain(presets("stepped.tfi", KEYS)).chain(presets("points.itf", &inviwo())).collect()
}

/// Points that do not reach the ends of the data.
fn inviwo() -> String {
    r#"<InviwoTreeData version="1.0"><dataPoints><point><pos x="0.2" y="0"/><rgba x="1" y="0" z="0" w="0.2"/></point><point><pos x="0.6" y="0"/><rgba x="0" y="0" z="1" w="0.6"/></point></dataPoints></InviwoTreeData>"#.into()
}

/// Largest difference of opacity and albedo of two functions over their scalars.
fn worst(a: &Transfer, b: &Transfer, range: [f64; 2]) -> f64 {
    let at = |i: usize| range[0] + (range[1] - range[0]) * (i as f64 + 0.37) / 5000.0;
    let difference = |x: f64| {
        let colors = (0..3).map(|c| f64::from((a.albedo(x)[c] - b.albedo(x)[c]).abs())).fold(0.0, f64::max);
        colors.max((opacity(a, x) - opacity(b, x)).abs())
    };
    (0..5000).map(|i| difference(at(i))).fold(0.0, f64::max)
}

#[test]
fn what_is_written_reads_as_the_same_function() {
    let dir = Folder::new();
    for preset in samples() {
        let range = if preset.is_relative() { [0.0, 1.0] } else { preset.domain() };
        let options = TransferOptions { range: Some(range), ..TransferOptions::new([0.0, 1.0]) };
        // ParaView's own text is the measure.
        let (text, _) = convert(std::slice::from_ref(&preset), Format::ParaView, None).unwrap();
        let original = read_transfer(&dir.file("original.json", &[text.as_bytes()]), &options).unwrap();
        for (extension, format) in Format::ALL {
            let (text, lost) = convert(std::slice::from_ref(&preset), format, None).unwrap();
            let path = dir.file(&format!("p.{extension}"), &[text.as_bytes()]);
            let back = read_transfer(&path, &options).unwrap_or_else(|e| panic!("{} as {extension}: {e}", preset.name));
            let off = worst(&original, &back, range);
            println!("{} as {extension}: off by {off:.5}; lost: {lost:?}", preset.name);
            // Voreen has 8 bits; a table smears the step over an entry; curves, also those from display to linear colours, are
            // followed to a thousandth by as many pieces as there are points.
            let tolerance = match (format, preset.name.as_str()) {
                // Half a step of 8 bits is 2.3 times as much in linear light, at most.
                (Format::Voreen, _) => 1.2 / 255.0 + 1e-3,
                (Format::ImageVis3d, "stepped") => 1.0,
                (Format::ImageVis3d, "straight") => 2e-3,
                (_, "curved") => 2e-3,
                _ => 1e-3,
            };
            assert!(off <= tolerance, "{} as {extension}: off by {off}", preset.name);
            if format == Format::Inviwo {
                // What it has read since 2018, and nothing of before.
                assert!(text.contains("<Points>") && text.contains("<pos content=") && !text.contains("dataPoints"), "{text}");
            }
            let said = |part: &str| lost.iter().any(|l| l.contains(part));
            assert!(said("precision") || off < 2e-3, "{} as {extension}: {off} {lost:?}", preset.name);
            assert!(!said("precision") || off > 5e-5, "{} as {extension}: {off} {lost:?}", preset.name);
            let places = format == Format::ImageVis3d;
            assert_eq!(
                lost.iter().any(|l| l.starts_with("its scalars")),
                !preset.is_relative() && places,
                "{} as {extension}: {lost:?}",
                preset.name
            );
            let length = (preset.length(), presets(&format!("p.{extension}"), &text)[0].length());
            assert_eq!(said("length of its opacities"), length.0 != length.1, "{} as {extension}: {lost:?}", preset.name);
            let spans = matches!(format, Format::Slicer | Format::SlicerVp);
            assert_eq!(said("span the data"), preset.is_relative() && spans, "{} as {extension}: {lost:?}", preset.name);
            let long = format == Format::SlicerVp && text.lines().any(|l| l.len() > 1023);
            assert_eq!(said("1023 bytes of a line"), long && preset.name == "curved", "{lost:?}");
            assert_eq!(said("midpoints"), preset.name == "curved" && format != Format::ParaView);
            // The comparison sees one changed digit.
            let (digit, other) = match format {
                Format::Voreen => ("255", "155"),
                Format::SlicerVp => ("300 0.9", "300 0.4"),
                Format::ImageVis3d => ("1 0 0 0.9", "1 0 0.4 0.9"),
                Format::Inviwo => ("w=\"0.9\"", "w=\"0.4\""),
                _ => ("0.9", "0.4"),
            };
            if preset.name == "straight" {
                assert!(text.contains(digit), "{text}");
                let other = text.replacen(digit, other, 1);
                let changed = read_transfer(&dir.file(&format!("q.{extension}"), &[other.as_bytes()]), &options).unwrap();
                assert!(worst(&original, &changed, range) > 0.05, "{extension}: a changed number is seen");
            }
        }
    }
}

#[test]
fn several_presets_go_where_several_fit() {
    let all: Vec<Preset> = samples().into_iter().take(2).collect();
    for (extension, format) in [("json", Format::ParaView), ("xml", Format::Slicer)] {
        let (text, lost) = convert(&all, format, Some([0.0, 255.0])).unwrap();
        let back = presets(&format!("p.{extension}"), &text);
        assert_eq!(back.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["straight", "curved"]);
        assert!(back.iter().all(|p| p.domain() == [0.0, 255.0] && !p.is_relative()), "the range is the data's");
        assert!(lost.iter().all(|l| l.starts_with("'curved': ")), "{lost:?}");
    }
    says(convert(&all, Format::Voreen, None), &["there are 2, a file of Voreen holds one", "'straight', 'curved'"]);
    says(convert(&[], Format::ParaView, None), &["there are 0"]);
    says(convert(&all, Format::Slicer, Some([1.0, 0.0])), &["range", "ascend"]);
    // Names that XML would take for its own.
    let odd = presets("p.json", r#"{"Name":"a<b>\"&'c","RGBPoints":[0,0,0,0,9,1,1,1]}"#);
    let (text, _) = convert(&odd, Format::Slicer, None).unwrap();
    assert_eq!(presets("p.xml", &text)[0].name, odd[0].name);
}

#[test]
fn a_file_of_each_format_written_twice_is_the_same() {
    // What a format holds, it keeps: writing what was read back changes nothing.
    for preset in samples() {
        for (extension, format) in Format::ALL {
            let (text, _) = convert(std::slice::from_ref(&preset), format, None).unwrap();
            let back = presets(&format!("{}.{extension}", preset.name), &text);
            let (again, lost) = convert(&back, format, None).unwrap();
            assert_eq!(text, again, "{} as {extension}", preset.name);
            // What older readers cannot take is said each time.
            let lost: Vec<_> = lost.iter().filter(|l| !l.contains("shading") && !l.contains("1023 bytes")).collect();
            assert!(lost.is_empty(), "{} as {extension}: {lost:?}", preset.name);
        }
    }
}

#[test]
fn every_real_file_opens_or_says_why_not() {
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/transfer"));
    if !root.is_dir() {
        println!("skipped: the real presets are not here");
        return;
    }
    let mut files: Vec<_> = std::fs::read_dir(root)
        .unwrap()
        .flat_map(|d| std::fs::read_dir(d.unwrap().path()).unwrap().map(|f| f.unwrap().path()).collect::<Vec<_>>())
        .collect();
    files.sort();
    let mut opened = 0;
    for path in &files {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        match read_presets(path) {
            Ok((program, all)) => {
                opened += 1;
                let (good, bad): (Vec<_>, Vec<_>) = all.iter().partition(|p| p.preset.is_ok());
                let lost: std::collections::BTreeSet<&str> =
                    good.iter().flat_map(|p| p.preset.as_ref().unwrap().lost()).map(|l| l.split([':', '(']).next().unwrap()).collect();
                println!("{name} | {program} | {} of {} | {lost:?}", good.len(), all.len());
                for p in bad {
                    println!("    {}", p.preset.as_ref().unwrap_err());
                }
                for p in &all {
                    let Ok(preset) = &p.preset else { continue };
                    // Each becomes a function over data, and goes into every format.
                    let options = TransferOptions { name: Some(p.name.clone()), ..TransferOptions::new([0.0, 255.0]) };
                    read_transfer(path, &options).unwrap();
                    for (_, format) in Format::ALL {
                        convert(std::slice::from_ref(preset), format, None).unwrap_or_else(|e| panic!("{name} '{}': {e}", p.name));
                    }
                }
            }
            Err(e) => {
                println!("{name} | refused: {e}");
                assert!(["c60.2dt", "CameraPresets.xml", "LightingPresets.xml"].iter().any(|n| name.ends_with(n)), "{name}: {e}");
            }
        }
    }
    assert_eq!((files.len(), opened), (31, 28));
    let slicer = read_presets(&root.join("slicer/presets.xml")).unwrap().1;
    assert_eq!(slicer.len(), 25);
    let bone = choose(root, slicer, Some("CT-Bone")).unwrap();
    assert_eq!((bone.points(), bone.domain()), ([4, 4], [-3024.0, 3071.0]));
}

#[cfg(feature = "cli")]
#[test]
fn the_command_lists_and_converts() {
    let dir = Folder::new();
    dir.file("presets.xml", &[SLICER.as_bytes()]);
    let run = |arguments: &[&str]| {
        let folder = dir.path(".");
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
            .current_dir(folder)
            .arg("transfer")
            .args(arguments)
            .output()
            .unwrap();
        let text = |b: Vec<u8>| String::from_utf8(b).unwrap();
        (out.status.code().unwrap_or(-1), text(out.stdout), text(out.stderr))
    };
    let (code, out, _) = run(&["presets.xml", "--list"]);
    assert_eq!((code, out.as_str()), (0, "Bone\nSkin & fat\nOdd\n"));
    let (code, out, _) = run(&["presets.xml"]);
    assert!(
        code == 0 && out.contains("3 presets of Slicer") && out.contains("'Bone': 2 colours, 4 opacities, scalars -1000 to 3071"),
        "{out}"
    );
    assert!(out.contains("'Odd': cannot be used: "), "{out}");
    let (code, out, _) = run(&["presets.xml", "--preset", "bone"]);
    assert!(code == 0 && out.contains("'Bone'") && !out.contains("fat") && out.contains("shading (ambient 0.1"), "{out}");
    let (code, out, err) = run(&["presets.xml", "--preset", "Bone", "-o", "bone.tfi"]);
    assert!(code == 0 && out.contains("1 preset for Voreen") && out.contains("lost") && out.contains("wrote"), "{out}{err}");
    assert!(out.contains("a voxel became 1/200 of the volume's side: the same where the side has 200 voxels"), "{out}");
    let (code, out, _) = run(&["bone.tfi"]);
    assert!(code == 0 && out.contains("opacities  over 1/200 of the volume's side; here over transfer.reference"), "{out}");
    let (code, out, _) = run(&["bone.tfi", "--json", "-o", "bone.vp"]);
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(code == 0 && json["presets"][0] == "bone" && json["program"] == "Voreen", "{out}");
    let (code, out, _) = run(&["presets.xml", "-o", "all.json"]);
    assert!(code == 0 && out.contains("left out") && out.contains("claims 5 numbers") && out.contains("2 presets for ParaView"), "{out}");
    let (code, out, _) = run(&["all.json", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, json["presets"].as_array().unwrap().len()), (0, 2));
    for (arguments, expected, parts) in [
        (&["presets.xml", "-o", "x.tfi"][..], 3, &["3 presets and none was named", "'Bone'"][..]),
        (&["presets.xml", "--preset", "None", "-o", "x.tfi"], 3, &["no preset is named 'None'"]),
        (&["presets.xml", "--preset", "None"], 3, &["no preset is named 'None'"]),
        (&["presets.xml", "-o", "x.bmp"], 2, &["its extension must be", ".tfi"]),
        (&["presets.xml", "--preset", "Bone", "-o", "presets.xml"], 2, &["is an input of this command"]),
        (&["presets.xml", "--preset", "Bone", "-o", "x.vp", "--range", "5,1"], 2, &["two ascending numbers"]),
        (&["none.xml"], 3, &["none.xml: cannot open", "no such file"]),
    ] {
        let (code, out, err) = run(arguments);
        assert_eq!(code, expected, "{arguments:?}: {out}{err}");
        parts.iter().for_each(|p| assert!(err.contains(p), "{arguments:?}: '{err}' does not say '{p}'"));
    }
    assert!(!dir.path("x.tfi").exists() && !dir.path("x.vp").exists());
}
