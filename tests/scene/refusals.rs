//! What is refused, and with which sentence.

use super::*;

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
        ("volume.file = 'a'\nvisibility.growth = 1", "`visibility.growth` changes nothing in a sweep, the default method; it is of"),
        ("volume.file = 'a'\nvisibility.filter = 'box'", "`visibility.filter` changes nothing in a sweep"),
        ("volume.file = 'a'\nvisibility.sampling = 'jittered'", "take stratified, or method march or hierarchical"),
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
