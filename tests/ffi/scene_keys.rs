//! What the command says in a scene, C says in structs: every key has its place, and the pictures are the same.
#![cfg(feature = "cli")]

use crate::same::by_command;
use crate::scenes::*;
use crate::{Engine, init};
use exr::prelude::{ReadChannels, ReadLayers, read};
use halflight::ffi::*;
use halflight::scene::keys::KEYS;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::CString;
use std::path::Path;
use std::ptr::{null, null_mut};

/// Where C says it, or why it does not.
const PLACES: [(&str, &str); 61] = [
    ("volume.file", "hl_volume_load, or hl_volume_info.data"),
    ("volume.component", "hl_load_info.component, or hl_volume_info.component"),
    ("volume.series", "hl_load_info.series"),
    ("volume.dims", "hl_volume_info.dims: a headerless file is the host's to read"),
    ("volume.type", "hl_volume_info.type"),
    ("volume.spacing", "hl_load_info.spacing, or hl_volume_info.spacing"),
    ("volume.endian", "the host's: its memory has its own byte order"),
    ("volume.offset", "hl_volume_info.data"),
    ("volume.nan_as", "hl_load_info.nan_as, or hl_volume_info.nan_as"),
    ("volume.number", "the host's: it makes a volume per time step"),
    ("volume.numbers", "the host's"),
    ("transfer.points", "hl_transfer_info.points"),
    ("transfer.kind", "hl_transfer_info.kind"),
    ("transfer.reference", "hl_transfer_info.reference, or hl_transfer_file_info.reference"),
    ("transfer.file", "hl_transfer_load"),
    ("transfer.name", "hl_transfer_file_info.name"),
    ("transfer.range", "hl_transfer_file_info.range"),
    ("surface.iso", "hl_surface.iso"),
    ("surface.shading", "hl_surface.shading"),
    ("surface.albedo", "hl_surface.albedo"),
    ("clip.box", "hl_clip.low, hl_clip.high"),
    ("clip.planes", "hl_clip.planes"),
    ("clip.space", "hl_clip.space"),
    ("light.probe", "hl_light_info.probe"),
    ("light.constant", "hl_light_info.radiance"),
    ("light.rotate", "hl_light_info.axis, hl_light_info.degrees, hl_light_rotate"),
    ("light.scale", "hl_light_info.scale"),
    ("light.bands", "hl_light_info.bands"),
    ("light.window", "hl_light_info.window"),
    ("visibility.tolerance", "hl_precompute_info.tolerance"),
    ("visibility.quality", "hl_precompute_info.quality"),
    ("visibility.method", "hl_precompute_info.method"),
    ("visibility.ratio", "hl_precompute_info.ratio"),
    ("visibility.directions", "hl_precompute_info.directions"),
    ("visibility.bands", "hl_precompute_info.bands"),
    ("visibility.bits", "hl_precompute_info.bits"),
    ("visibility.filter", "hl_precompute_info.filter"),
    ("visibility.sampling", "hl_precompute_info.jittered"),
    ("visibility.growth", "hl_precompute_info.growth"),
    ("visibility.step", "hl_precompute_info.step"),
    ("visibility.near", "hl_precompute_info.near_slices"),
    ("visibility.cells", "hl_precompute_info.all_cells"),
    ("visibility.fit", "hl_precompute_info.fit"),
    ("camera.position", "hl_camera.position"),
    ("camera.target", "hl_camera.target"),
    ("camera.up", "hl_camera.up"),
    ("camera.fov", "hl_camera.fov"),
    ("camera.space", "hl_camera.space"),
    ("camera.orbit", "hl_camera.orbit"),
    ("camera.centre", "hl_camera.centre"),
    ("camera.distance", "hl_camera.distance"),
    ("image.width", "hl_render_info.width"),
    ("image.height", "hl_render_info.height"),
    ("image.step", "hl_render_info.step"),
    ("image.background", "hl_render_info.background"),
    ("image.exposure", "hl_save_info.exposure, hl_image_read"),
    ("image.skip", "hl_render_info.every_block"),
    ("animation.frames", "the host's: it moves camera, light and transfer function itself"),
    ("animation.first", "the host's"),
    ("animation.rate", "the host's"),
    ("animation.ease", "the host's"),
];

#[test]
fn every_key_of_a_scene_has_its_place() {
    let named: BTreeSet<&str> = PLACES.iter().map(|p| p.0).chain(["animation.keyframe"]).collect();
    assert_eq!(named, KEYS.iter().map(|k| k.name).collect());
    // And every place is in the header.
    let header = include_str!("../../include/halflight.h");
    for word in PLACES.iter().flat_map(|p| p.1.split([' ', ',', ':'])).filter(|w| w.starts_with("hl_")) {
        let (whole, member) = word.split_once('.').unwrap_or((word, ""));
        let found = match member {
            "" => header.contains(&format!("{whole}(")),
            // Between the struct's beginning and its end.
            _ => {
                let body = header.split(&format!("}} {whole};")).next().unwrap().rsplit("typedef struct").next().unwrap();
                body.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|w| w == member)
            }
        };
        assert!(found, "{word}");
    }
}

/// Numbers of three components a voxel, the ball in the second.
fn interleaved(n: usize) -> Vec<u8> {
    ball(n).iter().enumerate().flat_map(|(i, &v)| [(i * 7 % 251) as u8, v, 255 - v]).collect()
}

fn c_path(folder: &Path, name: &str) -> CString {
    CString::new(folder.join(name).to_str().unwrap()).unwrap()
}

const PRESET: &str = r#"[{"ColorSpace":"RGB","Name":"p","Points":[0,0,0.5,0,0.3,0.1,0.5,0,1,0.8,0.5,0],"RGBPoints":[0,0.2,0.5,0.9,0.5,0.9,0.4,0.1,1,1,1,0.8]},
    {"ColorSpace":"RGB","Name":"q","Points":[0,0,0.5,0,1,1,0.5,0],"RGBPoints":[0,1,0,0,1,0,1,0]}]"#;

#[test]
fn cuts_orbits_presets_and_components_are_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, n) = (folder.path(), 20);
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 3 {n} {n} {n}\nkinds: vector domain domain domain\nencoding: raw\n\
         space dimension: 3\nspace directions: none (0.5,0,0) (0,0.6,0) (0,0,0.7)\nspace origin: (0.25,0.3,0.35)\n\n"
    );
    let data = interleaved(n);
    std::fs::write(folder.join("v.nrrd"), [header.as_bytes(), &data].concat()).unwrap();
    std::fs::write(folder.join("p.json"), PRESET).unwrap();
    let scene = |more: &str| {
        format!(
            "[volume]\nfile = \"v.nrrd\"\ncomponent = 1\n[transfer]\nfile = \"p.json\"\nname = \"p\"\nrange = [20, 230]\nreference = \"world\"\n\
             [clip]\nbox = [0, 0.13, 0, 0.8, 1, 1]\nplanes = [[0.3, -0.5, 0.8, -0.071]]\n[visibility]\nmethod = \"sweep\"\ndirections = 32\n\
             [camera]\nposition = [1.2, -1.4, 0.9]\ntarget = [0.05, 0, 0]\norbit = [0.1, 0.2, 1, 50]\ncentre = [0.1, 0, 0]\ndistance = 1.9\n\
             [image]\nwidth = 40\nheight = 30\nskip = false\n{more}"
        )
    };
    let engine = Engine::new();
    let (mut loaded, mut made, mut transfer) = (null_mut(), null_mut(), null_mut());
    let info = hl_load_info { component: c"1".as_ptr(), ..init() };
    ok!(hl_volume_load(engine.0, c_path(folder, "v.nrrd").as_ptr(), &info, &mut loaded));
    refused!(HL_ERROR_FORMAT, "component", hl_volume_load(engine.0, c_path(folder, "v.nrrd").as_ptr(), null(), &mut made));
    // The same from memory, where the loaded one says that it lies.
    let mut place: hl_volume_info = init();
    ok!(hl_volume_get_info(loaded, &mut place));
    assert_eq!((place.dims, place.r#type, place.slope), ([n as u32; 3], HL_UINT8, 1.0));
    assert!((0..3).all(|a| (place.spacing[a] - [0.5, 0.6, 0.7][a]).abs() < 1e-12 && place.origin[a].abs() < 1e-12));
    let info = hl_volume_info { data: data.as_ptr().cast(), components: 3, component: 1, ..place };
    ok!(hl_volume_create(engine.0, &info, &mut made));
    let info = hl_transfer_file_info { name: c"p".as_ptr(), range: [20.0, 230.0], reference: HL_PER_WORLD, ..init() };
    ok!(hl_transfer_load(engine.0, c_path(folder, "p.json").as_ptr(), &info, &mut transfer));

    let planes = [0.3, -0.5, 0.8, -0.071];
    let clip = hl_clip { low: [0.0, 0.13, 0.0], high: [0.8, 1.0, 1.0], planes: planes.as_ptr(), plane_count: 1, ..init() };
    let camera = hl_camera {
        position: [1.2, -1.4, 0.9],
        target: [0.05, 0.0, 0.0],
        orbit: [0.1, 0.2, 1.0, 50.0],
        centre: [0.1, 0.0, 0.0],
        own_centre: 1,
        distance: 1.9,
        space: HL_CAMERA_SIDE,
        ..init()
    };
    let theirs = by_command(folder, &scene(""));
    assert!(theirs.iter().any(|&v| v > 0.1));
    let same = |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
    for volume in [loaded, made] {
        let info = hl_precompute_info { transfer, clip: &clip, ..quick(volume) };
        let view = hl_render_info { camera: &camera, every_block: 1, ..small(field(engine.0, &info)) };
        assert!(same(&pixels(image(engine.0, &view)), &theirs));
        // Leaping shows the same.
        assert!(same(&pixels(image(engine.0, &hl_render_info { every_block: 0, ..view })), &theirs));
        // Sabotage: a little less of an orbit, another component, no cut.
        let camera = hl_camera { orbit: [0.1, 0.2, 1.0, 50.1], ..camera };
        assert!(!same(&pixels(image(engine.0, &hl_render_info { camera: &camera, ..view })), &theirs));
        let whole = field(engine.0, &hl_precompute_info { clip: null(), ..info });
        assert!(!same(&pixels(image(engine.0, &hl_render_info { field: whole, ..view })), &theirs));
    }
    let mut other = null_mut();
    ok!(hl_volume_create(engine.0, &hl_volume_info { data: data.as_ptr().cast(), components: 3, component: 2, ..place }, &mut other));
    let other = field(engine.0, &hl_precompute_info { transfer, clip: &clip, ..quick(other) });
    assert!(!same(&pixels(image(engine.0, &hl_render_info { camera: &camera, ..small(other) })), &theirs));
    let path = c_path(folder, "p.json");
    let info = hl_transfer_file_info { name: c"r".as_ptr(), ..init() };
    refused!(HL_ERROR_FORMAT, "no preset is named 'r'", hl_transfer_load(engine.0, path.as_ptr(), &info, &mut transfer));
    let info = hl_transfer_file_info { name: c"p".as_ptr(), range: [2.0, 1.0], ..init() };
    refused!(HL_ERROR_INVALID, "it must ascend", hl_transfer_load(engine.0, path.as_ptr(), &info, &mut transfer));
    refused!(HL_ERROR_FORMAT, "2 presets", hl_transfer_load(engine.0, path.as_ptr(), null(), &mut transfer));
}

#[test]
fn a_cut_of_the_view_leaves_the_light_as_it_is() {
    let engine = Engine::new();
    let volume = volume(engine.0, 24);
    let whole = field(engine.0, &quick(volume));
    let clip = hl_clip { high: [0.5, 1.0, 1.0], ..init() };
    let cut = field(engine.0, &hl_precompute_info { clip: &clip, ..quick(volume) });
    let seen = pixels(image(engine.0, &hl_render_info { clip: &clip, ..small(whole) }));
    let [all, both] = [whole, cut].map(|f| pixels(image(engine.0, &small(f))));
    // What covers is the same; what shines is less than where the shadows were cut too.
    let sum = |p: &[f32], c: usize| p.iter().skip(c).step_by(4).map(|&v| f64::from(v)).sum::<f64>();
    assert!((sum(&seen, 3) - sum(&both, 3)).abs() < 1e-4 * sum(&both, 3) && sum(&seen, 3) < 0.9 * sum(&all, 3));
    assert!(sum(&seen, 0) < 0.95 * sum(&both, 0), "{} {}", sum(&seen, 0), sum(&both, 0));
    // Twice the same cut is one; cuts add up, until there are too many.
    let again = pixels(image(engine.0, &hl_render_info { clip: &clip, ..small(cut) }));
    let worst = again.iter().zip(&both).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst == 0.0, "{worst}");
    let planes = [0.0, 0.0, 1.0, -5.0].repeat(10);
    let many = hl_clip { low: [0.1; 3], high: [0.9; 3], planes: planes.as_ptr(), plane_count: 10, ..init() };
    let full = field(engine.0, &hl_precompute_info { clip: &many, ..quick(volume) });
    let mut none = null_mut();
    refused!(HL_ERROR_INVALID, "17 planes and faces", hl_render(engine.0, &hl_render_info { clip: &clip, ..small(full) }, &mut none));
    // A previous field of another cut is not taken.
    let plain = field(engine.0, &hl_precompute_info { clip: &clip, previous: whole, ..quick(volume) });
    assert_eq!(pixels(image(engine.0, &small(plain))), both);
}

/// All channels of an OpenEXR file.
fn channels(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes().from_file(path).unwrap();
    let list = &image.layer_data[0].channel_data.list;
    list.iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

#[test]
fn layers_are_those_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, n) = (folder.path(), 20);
    std::fs::write(folder.join("v.raw"), ball(n)).unwrap();
    let engine = Engine::new();
    let volume = volume(engine.0, n);
    let surface = hl_surface { iso: 100.0, own_albedo: 1, albedo: [0.8, 0.4, 0.2], ..init() };
    let all = HL_LAYER_DEPTH | HL_LAYER_NORMAL | HL_LAYER_ALBEDO | HL_LAYER_IRRADIANCE | HL_LAYER_VISIBILITY | HL_LAYER_OPACITY;
    let mut lengths = Vec::new();
    for (solid, half) in [(false, false), (true, false), (false, true)] {
        let more = if solid { "[surface]\niso = 100\nalbedo = [0.8, 0.4, 0.2]\n" } else { "" };
        let scene = format!(
            "[volume]\nfile = \"v.raw\"\ndims = [{n}, {n}, {n}]\ntype = \"uint8\"\n{more}[visibility]\nmethod = \"sweep\"\ndirections = 32\n\
             [image]\nwidth = 40\nheight = 30\nbackground = [0.1, 0.2, 0.3]\n[animation]\nframes = 1\n"
        );
        std::fs::write(folder.join("s.toml"), scene).unwrap();
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
            .current_dir(folder)
            .args(["frames", "s.toml", "-o", "f.####.exr", "--aov", "depth,normal,albedo,irradiance,visibility,opacity"])
            .args(["--exr-type", if half { "half" } else { "float" }, "--compression", "piz"])
            .output()
            .unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let theirs = channels(&folder.join("f.0001.exr"));
        let surface = if solid { &raw const surface } else { null() };
        let field = field(engine.0, &hl_precompute_info { surface, ..quick(volume) });
        let view = hl_render_info { layers: all, background: HL_BACKGROUND_COLOR, background_color: [0.1, 0.2, 0.3], ..small(field) };
        let image = self::image(engine.0, &view);
        let save = hl_save_info { layers: all, half: i32::from(half), compression: HL_COMPRESSION_PIZ, ..init() };
        ok!(hl_image_save(image, c_path(folder, "c.exr").as_ptr(), &save));
        let ours = channels(&folder.join("c.exr"));
        assert_eq!(ours.keys().collect::<Vec<_>>(), theirs.keys().collect::<Vec<_>>());
        assert_eq!(ours.len(), 17);
        for (name, values) in &theirs {
            let differ = values.iter().zip(&ours[name]).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            assert_eq!((differ, values.len()), (0, 1200), "{name}");
        }
        lengths.push(std::fs::metadata(folder.join("c.exr")).unwrap().len());
        // In memory too, and mapped.
        for (layer, names) in [
            (HL_LAYER_DEPTH, &["depth.Z", "depth.first"][..]),
            (HL_LAYER_NORMAL, &["normal.X", "normal.Y", "normal.Z"]),
            (HL_LAYER_ALBEDO, &["albedo.R", "albedo.G", "albedo.B"]),
            (HL_LAYER_IRRADIANCE, &["irradiance.R", "irradiance.G", "irradiance.B"]),
            (HL_LAYER_VISIBILITY, &["visibility.Y"]),
            (HL_LAYER_OPACITY, &["opacity.Y"]),
        ] {
            let mut numbers = vec![0f32; 1200 * names.len()];
            ok!(hl_image_read_layer(image, layer, numbers.as_mut_ptr(), numbers.len() as u64));
            let (mut map, mut count) = (null(), 0);
            ok!(hl_image_map_layer(image, layer, &mut map, &mut count));
            // SAFETY: mapped, of this length.
            let mapped = unsafe { std::slice::from_raw_parts(map, count as usize) };
            assert!(mapped.iter().zip(&numbers).all(|(a, b)| a.to_bits() == b.to_bits()) && mapped.len() == numbers.len());
            for (c, name) in names.iter().enumerate().filter(|_| !half) {
                let one = numbers.iter().skip(c).step_by(names.len());
                assert!(one.zip(&theirs[*name]).all(|(a, b)| a.to_bits() == b.to_bits()), "{name}");
            }
            ok!(hl_image_unmap(image));
        }
        // Colours are those of a picture without layers; sabotage: another pixel is another picture.
        let plain = self::image(engine.0, &hl_render_info { layers: 0, ..view });
        assert_eq!(pixels(image), pixels(plain));
        assert!(ours["visibility.Y"] != theirs["opacity.Y"] && (solid || ours["depth.Z"] != ours["depth.first"]));
    }
    assert!(lengths[2] < lengths[0], "{lengths:?}");
    let field = field(engine.0, &quick(volume));
    let image = self::image(engine.0, &hl_render_info { layers: HL_LAYER_OPACITY, ..small(field) });
    let (mut numbers, path) = ([0f32; 3600], c_path(folder, "c.exr"));
    refused!(HL_ERROR_INVALID, "no layer normal", hl_image_read_layer(image, HL_LAYER_NORMAL, numbers.as_mut_ptr(), 3600));
    refused!(HL_ERROR_INVALID, "one of HL_LAYER", hl_image_read_layer(image, 33, numbers.as_mut_ptr(), 3600));
    refused!(HL_ERROR_INVALID, "room for 1200", hl_image_read_layer(image, HL_LAYER_OPACITY, numbers.as_mut_ptr(), 3600));
    refused!(HL_ERROR_INVALID, "no layer depth", hl_image_save(image, path.as_ptr(), &hl_save_info { layers: 33, ..init() }));
    refused!(HL_ERROR_INVALID, "sum of HL_LAYER", hl_image_save(image, path.as_ptr(), &hl_save_info { layers: 128, ..init() }));
    refused!(
        HL_ERROR_INVALID,
        "no layer noise; reference pictures",
        hl_image_save(image, path.as_ptr(), &hl_save_info { layers: HL_LAYER_NOISE, ..init() })
    );
    refused!(HL_ERROR_INVALID, "half: is 2", hl_image_save(image, path.as_ptr(), &hl_save_info { half: 2, ..init() }));
    refused!(HL_ERROR_INVALID, "compression", hl_image_save(image, path.as_ptr(), &hl_save_info { compression: 5, ..init() }));
    let png = c_path(folder, "c.png");
    refused!(HL_ERROR_INVALID, "only an .exr", hl_image_save(image, png.as_ptr(), &hl_save_info { layers: HL_LAYER_OPACITY, ..init() }));
    refused!(HL_ERROR_INVALID, "exposure", hl_image_save(image, png.as_ptr(), &hl_save_info { exposure: f64::NAN, ..init() }));
}

#[test]
fn differences_are_drawn_as_the_command_draws_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let engine = Engine::new();
    let volume = volume(engine.0, 16);
    let (few, many) = (field(engine.0, &quick(volume)), field(engine.0, &hl_precompute_info { directions: 200, ..quick(volume) }));
    let (a, b) = (image(engine.0, &small(few)), image(engine.0, &small(many)));
    let radiant = image(engine.0, &hl_render_info { background: HL_BACKGROUND_COLOR, background_color: [3.0; 3], ..small(many) });
    for (a, b, kind, file) in [(a, b, HL_DIFFERENCE_SIGNED, "d.exr"), (a, radiant, HL_DIFFERENCE_FLIP, "d.png")] {
        ok!(hl_image_save(a, c_path(folder, "a.exr").as_ptr(), null()));
        ok!(hl_image_save(b, c_path(folder, "b.exr").as_ptr(), null()));
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
            .current_dir(folder)
            .args(["compare", "a.exr", "b.exr", "-o", file])
            .output()
            .unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let (mut ours, mut theirs) = (null_mut(), null_mut());
        ok!(hl_image_difference(a, b, kind, &mut ours));
        ok!(hl_image_load(engine.0, c_path(folder, file).as_ptr(), &mut theirs));
        let bytes = |image| {
            let mut bytes = vec![0u8; 4800];
            ok!(hl_image_read(image, HL_RGBA8, 0.0, bytes.as_mut_ptr().cast(), 0, 4800));
            bytes
        };
        assert!(bytes(ours) == bytes(theirs) && bytes(ours) != bytes(a), "{file}");
        if kind == HL_DIFFERENCE_SIGNED {
            assert!(pixels(ours) == pixels(theirs) && pixels(ours).iter().any(|&v| v < 0.0));
        }
    }
    let mut none = null_mut();
    refused!(HL_ERROR_INVALID, "kind: is 2", hl_image_difference(a, b, 2, &mut none));
    let tiny = image(engine.0, &hl_render_info { width: 8, ..small(few) });
    refused!(HL_ERROR_INVALID, "8x30", hl_image_difference(a, tiny, HL_DIFFERENCE_SIGNED, &mut none));
}

#[test]
fn volumes_are_described_and_guessed_at() {
    let engine = Engine::new();
    let volume = volume(engine.0, 16);
    let (mut bins, mut mean) = ([0u64; 64], 0.0);
    ok!(hl_volume_get_histogram(volume, bins.as_mut_ptr(), &mut mean));
    let data = ball(16);
    let truth = data.iter().map(|&v| f64::from(v)).sum::<f64>() / data.len() as f64;
    assert!((mean - truth).abs() < 1e-9 && bins.iter().sum::<u64>() == 4096 && bins[0] > bins[40]);
    let mut guess = null_mut();
    ok!(hl_transfer_guess(volume, &mut guess));
    let seen = pixels(image(engine.0, &small(field(engine.0, &hl_precompute_info { transfer: guess, ..quick(volume) }))));
    assert!(seen.iter().skip(3).step_by(4).any(|&a| a > 0.3));
    // The devices, with the one that the engine is on.
    let (mut own, mut listed): (hl_device_info, hl_device_info) = (init(), init());
    ok!(hl_engine_get_device(engine.0, &mut own));
    let mut names = Vec::new();
    for i in 0.. {
        // SAFETY: a struct of ours.
        match unsafe { hl_device_get(i, &mut listed) } {
            HL_OK => names.push((text(&listed.name), text(&listed.uuid), listed.memory_budget > 0)),
            HL_END => break,
            other => panic!("{other}"),
        }
    }
    assert!(names.contains(&(text(&own.name), text(&own.uuid), true)), "{names:?}");
}
