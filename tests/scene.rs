//! Scene files: every key, every default, every refusal.

use glam::DVec3;
use halflight::io::{parse_scene, read_scene, scene_of_volume, scene_text};
use halflight::scene::animation::{Ease, Keyframe, Track};
use halflight::scene::camera::{CameraSettings, Space};
use halflight::scene::keys;
use halflight::scene::scene::{
    Background, ImageSettings, LightSettings, LightSource, Matter, Scene, Shading, Surface, TransferSource, Windowing, fill_background,
    ramp,
};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Cells, Filter, Method, Sampling};
use halflight::scene::{Animation, Camera, Clip, Grid, Light, Picture, Probe, Visibility};
use std::path::{Path, PathBuf};

fn parse(text: &str) -> Result<Scene, String> {
    parse_scene(text, "s.toml", Path::new("/scenes"), &[]).map_err(|e| e.to_string())
}

fn with(text: &str, overrides: &[(&str, &str)]) -> Result<Scene, String> {
    parse_scene(text, "s.toml", Path::new("/scenes"), overrides).map_err(|e| e.to_string())
}

const FULL: &str = r#"
[volume]
file = "ct.raw"
component = "0"
series = "1.2.3"
dims = [4, 5, 6]
type = "int16"
spacing = [1, 1.5, 2]
endian = "big"
offset = 128
nan_as = -3.5

[transfer]
reference = "side"
points = [[0, 0.1, 0.2, 0.3, 0.0], [100.5, 1, 1, 1, 8.0]]
kind = "extinction"

[surface]
iso = 42
shading = "isotropic"
albedo = [0.5, 0.25, 1]

[light]
probe = "sky.hdr"
rotate = [0, 0, 2, 90]
scale = 2.5
bands = 3
window = "hanning"

[visibility]
method = "march"
ratio = 2
directions = 128
bands = 2
bits = 16
filter = "product"
sampling = "jittered"
growth = 0.5
step = 0.25
near = 3
cells = "all"

[camera]
position = [1, 2, 3]
target = [0.5, 0, 0]
up = [0, 1, 0]
fov = 45
space = "world"
orbit = [0, 0, 2, 30]
centre = [1, 1, 1]
distance = 4

[image]
width = 320
height = 200
step = 0.5
background = [0, 0.5, 1]
exposure = -1.5
skip = false

[clip]
box = [0, 0.25, 0, 1, 1, 0.5]
planes = [[0, 0, 1, 2]]
space = "world"

[animation]
frames = 9
first = 3
rate = 30
ease = "hold"
keyframe = [{ frame = 4, camera.fov = 45 }]
"#;

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
    assert_eq!((d("visibility.method").as_str(), s.visibility.method), ("hierarchical", Method::Hierarchical));
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
fn each_refusal_says_what_where_and_what_would_be_right() {
    let cases = [
        ("[camera]\nfov = 30", "s.toml: `volume.file` is missing; name the volume to show"),
        ("[volume]\nfile = 3", "s.toml line 2: `volume.file` is 3; it must be a text in quotes"),
        ("[volume]\nfile = ''", "`volume.file` is \"\"; it must be a text in quotes"),
        ("volume = 'a.nrrd'", "s.toml line 1: `volume` is not a table; write [volume] and its keys below"),
        ("[[volume]]\nfile = 'a'", "`volume` is not a table"),
        ("[lights]\n", "s.toml line 1: `lights` is unknown; did you mean `[light]`? (the tables are [volume], [transfer]"),
        (
            "\n\n[light]\nprob = 'x'",
            "s.toml line 4: `light.prob` is unknown; did you mean `light.probe`? ([light] has probe, constant, rotate",
        ),
        ("[image]\nqqqqqqqqq = 1", "`image.qqqqqqqqq` is unknown; [image] has width, height, step, background, exposure, skip"),
        // A table is no key: [prob] is not light.probe, but a key without its table is found.
        ("[iso]\n", "s.toml line 1: `iso` is unknown; the tables are [volume], [transfer]"),
        ("iso = 3\n", "s.toml line 1: `iso` is unknown; did you mean `surface.iso`? (the tables are"),
        ("[volume]\nfile = 'a'\nfile = 'b'", "s.toml: line 3: `file` is given a second time; give each key, and each table, once"),
        ("[image]\n[light]\n[image]", "s.toml: line 3: `image` is given a second time"),
        ("[image]\nwidth = ", "s.toml: line 2: "),
        ("[image]\nwidth = 1\nwidth = 2", "s.toml: line 3: `width` is given a second time"),
        ("volume.file = 'a'\nvolume.dims = [1, 2]", "`volume.dims` is [1, 2]; it must be three integers"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 2.5]", "`volume.dims` is [1.0, 2.0, 2.5]; it must be three integers"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 0]", "`volume.dims` is [1, 2, 0]"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 3]", "`volume.type` is missing; a headerless file needs"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 3]\nvolume.type = 'half'", "it must be \"uint8\" or \"int8\" or"),
        ("volume.file = 'a'\nvolume.type = 'uint8'", "s.toml line 2: `volume.type` stands without `volume.dims`"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 3]\nvolume.type = 'int8'\nvolume.offset = -1", "`volume.offset` is -1"),
        ("volume.file = 'a'\nvolume.spacing = [0, 1, 1]", "`volume.spacing` is [0, 1, 1]; it must be three numbers above 0"),
        ("volume.file = 'a'\nvolume.component = 1.5", "`volume.component` is 1.5"),
        ("volume.file = 'a'\nvolume.series = ''", "`volume.series`"),
        ("volume.file = 'a'\nvolume.dims = [1, 2, 3]\nvolume.type = 'int8'\nvolume.spacing = [0, 1, 1]", "`volume.spacing` is [0, 1, 1]"),
        ("volume.file = 'a'\nvolume.nan_as = nan", "`volume.nan_as` is nan; it must be a finite number"),
        ("volume.file = 'a'\ntransfer.points = [[0, 1, 1, 1]]", "`transfer.points` has [0, 1, 1, 1] as its point 0"),
        ("volume.file = 'a'\ntransfer.points = []", "`transfer.points` is unusable: it has no points; at least one"),
        (
            "volume.file = 'a'\ntransfer.points = [[0,0,0,0,2]]",
            "`transfer.points` is unusable: the opacity 2 at scalar 0; opacity must lie in 0..1",
        ),
        ("volume.file = 'a'\ntransfer.points = 'x'", "`transfer.points` is \"x\"; it must be a list of points"),
        ("volume.file = 'a'\ntransfer.kind = 'opacity'", "`transfer.kind` stands without `transfer.points`"),
        ("volume.file = 'a'\ntransfer.name = 'x'", "`transfer.name` stands without `transfer.file`"),
        ("volume.file = 'a'\ntransfer.file = 'x'\ntransfer.range = [2, 1]", "`transfer.range` is [2, 1]; the first must be below"),
        ("volume.file = 'a'\ntransfer.file = 'x'\ntransfer.points = []", "line 3: `transfer.points` cannot stand beside `transfer.file`"),
        ("volume.file = 'a'\n[surface]", "`surface.iso` is missing; say at which value"),
        ("volume.file = 'a'\nsurface.iso = inf", "`surface.iso` is inf; it must be a finite number"),
        (
            "volume.file = 'a'\nsurface.iso = 1\nsurface.albedo = [1, 2, 1]",
            "`surface.albedo` is [1, 2, 1]; it must be three numbers in 0..1",
        ),
        ("volume.file = 'a'\nsurface.iso = 1\nsurface.shading = 'phong'", "is \"phong\"; it must be \"lambert\" or \"isotropic\""),
        ("volume.file = 'a'\nlight.probe = 'x'\nlight.constant = [1,1,1]", "`light.constant` cannot stand beside `light.probe`"),
        ("volume.file = 'a'\nlight.rotate = [0, 0, 0, 90]", "`light.rotate` has an axis of length 0"),
        ("volume.file = 'a'\nlight.rotate = [0, 0, 90]", "`light.rotate` is [0, 0, 90]; it must be an axis and degrees"),
        ("volume.file = 'a'\nlight.scale = -1", "`light.scale` is -1; it must lie in 0..1e6"),
        ("volume.file = 'a'\nlight.bands = 5", "`light.bands` is 5; it must be 1 to 4"),
        ("volume.file = 'a'\nlight.constant = [1, -1, 1]", "`light.constant` is [1, -1, 1]"),
        ("volume.file = 'a'\nvisibility.ratio = 3", "s.toml line 2: `visibility.ratio` is 1:3; it must be 1, 2, 4 or 8"),
        ("volume.file = 'a'\nvisibility.ratio = 2.0", "`visibility.ratio` is 2.0; it must be 1, 2, 4 or 8"),
        ("volume.file = 'a'\nvisibility.directions = 0", "`visibility.directions` is 0; it must be 1 to 1048576"),
        ("volume.file = 'a'\nvisibility.bits = 12", "`visibility.bits` is 12; it must be 8, 16 or 32"),
        ("volume.file = 'a'\nvisibility.bands = 9", "`visibility.bands` is 9; it must be 1 to 4"),
        ("volume.file = 'a'\nvisibility.growth = 0", "`visibility.growth` is 0; it must lie in"),
        ("volume.file = 'a'\nvisibility.step = 99", "`visibility.step` is 99 voxels; it must lie in"),
        ("volume.file = 'a'\nvisibility.method = 'magic'", "it must be \"march\" or \"hierarchical\""),
        ("volume.file = 'a'\ncamera.position = [1, 2, 'z']", "`camera.position` is [1, 2, \"z\"]; it must be three numbers"),
        ("volume.file = 'a'\ncamera.up = [0, 0, 0]", "`camera.up` is [0, 0, 0]; it must be a direction"),
        ("volume.file = 'a'\ncamera.fov = 180", "`camera.fov` is 180; it must lie in 1..170 degrees"),
        ("volume.file = 'a'\nimage.width = 0", "`image.width` is 0; it must be 1 to 16384 pixels"),
        ("volume.file = 'a'\nimage.height = 100000000000", "`image.height` is 100000000000; it must be 1 to 16384"),
        ("volume.file = 'a'\nimage.step = 0", "`image.step` is 0; it must lie in 0.05..16 voxels"),
        ("volume.file = 'a'\nimage.background = 'sky'", "`image.background` is \"sky\"; it must be [red, green, blue]"),
        ("volume.file = 'a'\nimage.exposure = nan", "`image.exposure` is nan; it must lie in -40..40 stops"),
        ("volume.file = 'a'\nimage.skip = 1", "`image.skip` is 1; it must be true or false"),
    ];
    for (text, part) in cases {
        let sentence = parse(text).expect_err(text);
        assert!(sentence.contains(part), "{text:?}\n  said   {sentence}\n  wanted {part}");
        assert!(!sentence.contains('\n'), "{sentence}");
    }
}

#[test]
fn every_key_refuses_a_date_and_names_itself() {
    for key in keys::KEYS {
        let (table, name) = key.name.split_once('.').unwrap();
        let text = match table {
            "volume" if ["type", "spacing", "endian", "offset"].contains(&name) => {
                format!("[volume]\nfile='a'\ndims=[1,1,1]\n{}{name} = 2026-11-22", if name == "type" { "" } else { "type='int8'\n" })
            }
            "volume" if name == "file" => "[volume]\nfile = 2026-11-22".into(),
            "surface" if name != "iso" => format!("[volume]\nfile='a'\n[surface]\niso=1\n{name} = 2026-11-22"),
            "volume" => format!("[volume]\nfile='a#'\n{name} = 2026-11-22"),
            "animation" if name != "frames" => format!("[volume]\nfile='a'\n[animation]\nframes=1\n{name} = 2026-11-22"),
            _ => format!("[volume]\nfile='a'\n[{table}]\n{name} = 2026-11-22"),
        };
        let sentence = parse(&text).expect_err(key.name);
        assert!(sentence.contains(&format!("`{}` is 2026-11-22", key.name)), "{sentence}");
    }
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
fn files_that_are_no_scenes_are_refused() {
    let folder = std::env::temp_dir();
    let path = folder.join(format!("halflight-no-scene-{}.toml", std::process::id()));
    let missing = read_scene(&path, &[]).unwrap_err().to_string();
    assert!(missing.contains("cannot open"), "{missing}");
    std::fs::write(&path, b"[volume]\nfile = \"\xff\"").unwrap();
    let binary = read_scene(&path, &[]).unwrap_err().to_string();
    assert!(binary.contains("byte 17 is not UTF-8; a scene is a TOML text"), "{binary}");
    std::fs::write(&path, "[volume]\nfile = 'v.nrrd'").unwrap();
    assert_eq!(read_scene(&path, &[]).unwrap().volume.file, folder.join("v.nrrd"));
    std::fs::remove_file(&path).unwrap();
    let folder = read_scene(&folder, &[]).unwrap_err().to_string();
    assert!(folder.contains("it is a folder; name a file"), "{folder}");
}

#[test]
fn damaged_scenes_never_panic() {
    // A linear congruential generator: the same mutations every time.
    let mut state = 7u64;
    let mut next = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    for _ in 0..3000 {
        let mut bytes = FULL.as_bytes().to_vec();
        for _ in 0..1 + next(4) {
            let at = next(bytes.len().max(1));
            if bytes.is_empty() {
                break;
            }
            match next(3) {
                0 => bytes[at] = b" \n[]=.\"'0a-{}#\x01\xff"[next(16)],
                1 => drop(bytes.drain(at..(at + 1 + next(20)).min(bytes.len()))),
                _ => bytes.truncate(at + 1),
            }
        }
        let _ = parse_scene(&String::from_utf8_lossy(&bytes), "s.toml", Path::new("."), &[]);
    }
}

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
