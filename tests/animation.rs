//! The scene at a frame: keyframes read, interpolated, written again.

use halflight::io::{parse_scene, scene_text};
use halflight::scene::camera::CameraSettings;
use halflight::scene::grid::glam::DVec3;
use halflight::scene::scene::{LightSource, TransferSource};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::{Camera, Grid, Scene, Transfer, scene_at};
use std::path::Path;
use std::sync::Arc;

fn parse(text: &str) -> Scene {
    parse_scene(text, "s.toml", Path::new(""), &[]).expect("a good scene")
}

fn refused(text: &str) -> String {
    parse_scene(text, "s.toml", Path::new(""), &[]).expect_err("a bad scene").to_string()
}

const TURN: &str = r#"
[volume]
file = "v.nrrd"
[animation]
frames = 24
rate = 12
[[animation.keyframe]]
frame = 1
camera.orbit = [0, 0, 1, 0]
light = { rotate = [0, 0, 1, 10], scale = 1 }
[[animation.keyframe]]
frame = 25
camera.orbit = [0, 0, 1, 360]
[[animation.keyframe]]
time = 1
ease = "smooth"
light.scale = 3
[[animation.keyframe]]
frame = 19
light.scale = 5
light.rotate = [0, 0, 1, 100]
"#;

#[test]
fn keyframes_hold_at_their_frames_and_beyond() {
    let scene = parse(TURN);
    let animation = scene.animation.as_ref().expect("an animation");
    assert_eq!((animation.frames, animation.rate, animation.range()), (24, 12.0, 1..=24));
    let at = |frame| scene_at(&scene, frame);
    assert_eq!(at(1).camera.orbit, Some((DVec3::Z, 0.0)));
    assert_eq!(at(7).camera.orbit, Some((DVec3::Z, 90.0)), "even between keyframes");
    assert_eq!(at(24).camera.orbit, Some((DVec3::Z, 345.0)), "a whole turn ends one frame before its first picture comes again");
    assert_eq!(
        (at(-3).light.scale, at(1).light.scale, at(13).light.scale, at(19).light.scale, at(99).light.scale),
        (1.0, 1.0, 3.0, 5.0, 5.0)
    );
    assert_eq!(at(10).light.rotate, Some((DVec3::Z, 55.0)));
    // Nothing is left to animate, and every call says the same.
    assert!(at(5).animation.is_none() && at(5) == at(5));
    assert_eq!(scene_at(&at(5), 9), at(5));
    // What only keyframes set stands as in the first of them.
    assert_eq!((scene.light.scale, scene.camera.orbit), (1.0, Some((DVec3::Z, 0.0))));
}

#[test]
fn a_scene_with_an_animation_is_read_as_it_is_written() {
    let text = TURN.replace("[volume]\n", "[volume]\nnumbers = \"0-50x10\"\n").replace("v.nrrd", "v_####.nrrd")
        + "[[animation.keyframe]]\nframe = 2.5\nease = \"hold\"\nclip.box = [0, 0, 0, 1, 1, 0.5]\nclip.planes = [[0, 0, 1, 0.1], [1, 0, 0, -1]]\n\
           transfer.points = [[0, 1, 1, 1, 0], [1, 0.25, 0.5, 1, 0.125]]\nsurface.iso = 0.5\nvolume.number = 20\n";
    let scene = parse(&text);
    let again = parse(&scene_text(&scene));
    assert_eq!(Scene { origins: scene.origins.clone(), ..again }, scene);
    for frame in [1, 2, 3, 20] {
        let one = scene_at(&scene, frame);
        assert_eq!(Scene { origins: one.origins.clone(), ..parse(&scene_text(&one)) }, one);
    }
}

/// Values of a scalar track at hundredths of frames, through a channel whose frames are stretched.
fn track(ease: &str, keys: &[(f64, f64)]) -> Vec<f64> {
    let mut text = "[volume]\nfile = \"v\"\n[animation]\nframes = 1000\nfirst = 0\n".to_owned() + &format!("ease = \"{ease}\"\n");
    for (frame, value) in keys {
        text += &format!("[[animation.keyframe]]\nframe = {frame}\nlight.scale = {value}\n");
    }
    let scene = parse(&text);
    (0..=900).map(|f| scene_at(&scene, f).light.scale).collect()
}

const KEYS: [(f64, f64); 5] = [(100.0, 1.0), (200.0, 2.0), (500.0, 8.0), (600.0, 8.5), (800.0, 3.0)];

#[test]
fn smooth_goes_through_every_keyframe_without_a_jerk_or_an_overshoot() {
    let v = track("smooth", &KEYS);
    for (frame, value) in KEYS {
        assert!((v[frame as usize] - value).abs() < 1e-12, "frame {frame}");
    }
    let speed: Vec<f64> = v.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(speed[..600].iter().all(|s| *s >= 0.0) && speed[600..].iter().all(|s| *s <= 0.0), "monotone between keyframes");
    let jerk = speed.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    assert!(jerk < 2e-3, "speed changes by {jerk} from one frame to the next");
    assert!(speed[100].abs() < 1e-3 && speed[599].abs() < 1e-3 && speed[799].abs() < 2e-3, "at rest at the ends and where it turns");
    // The comparison can fail: an even way has corners.
    let speed: Vec<f64> = track("linear", &KEYS).windows(2).map(|w| w[1] - w[0]).collect();
    assert!(speed.windows(2).any(|w| (w[1] - w[0]).abs() > 9e-3));
    // Two keyframes: 3u² − 2u³.
    let two = track("smooth", &[(0.0, 0.0), (800.0, 1.0)]);
    assert!((two[200] - 0.15625).abs() < 1e-12);
}

#[test]
fn hold_jumps_at_the_keyframe() {
    let v = track("hold", &KEYS);
    assert_eq!((v[0], v[199], v[200], v[499], v[500], v[900]), (1.0, 1.0, 2.0, 2.0, 8.0, 3.0));
}

#[test]
fn a_time_within_half_a_millisecond_of_a_frame_is_that_frame() {
    // Written with three or six digits, or as a division leaves it, at each rate that films have: the jump comes at its frame.
    for rate in [24.0, 25.0, 29.97, 30.0, 50.0, 60.0] {
        for frame in 1..400 {
            let seconds = f64::from(frame) / rate;
            for time in [format!("{seconds}"), format!("{seconds:.6}"), format!("{seconds:.3}")] {
                let animation = parse(&format!(
                    "[volume]\nfile = \"v\"\n[animation]\nframes = 9\nfirst = 0\nrate = {rate}\n\
                     [[animation.keyframe]]\ntime = {time}\nlight.scale = 2.0\n"
                ));
                assert_eq!(animation.animation.expect("one").tracks[0].keys[0].frame, f64::from(frame), "{time} s at {rate}");
            }
        }
    }
    // What lies between frames stays there.
    let between =
        parse("[volume]\nfile = \"v\"\n[animation]\nframes = 9\nrate = 25\n[[animation.keyframe]]\ntime = 0.5\nlight.scale = 2.0\n");
    assert_eq!(between.animation.expect("one").tracks[0].keys[0].frame, 13.5);
}

#[test]
fn frames_share_what_an_animation_says_of_its_keyframes() {
    let keys =
        |n: usize| -> String { (1..=n).map(|i| format!("[[animation.keyframe]]\nframe = {i}\ncamera.fov = {}\n", 20 + i % 9)).collect() };
    let scene = parse(&format!("[volume]\nfile = \"v\"\n[animation]\nframes = 3000\n{}", keys(3000)));
    let (a, b) = (scene_at(&scene, 3), scene_at(&scene, 2999));
    assert!(Arc::ptr_eq(&a.origins.animated, &b.origins.animated) && a.animation.is_none());
    assert_eq!(a.origins.of("camera.fov"), "s.toml line 11, keyframe 3");
}

#[test]
fn transfer_functions_fade_into_each_other() {
    let scene = parse(
        "[volume]\nfile = \"v\"\n[animation]\nframes = 11\n\
         [[animation.keyframe]]\nframe = 1\ntransfer.points = [[0, 0, 0, 0, 0], [10, 1, 1, 1, 1]]\n\
         [[animation.keyframe]]\nframe = 11\ntransfer.points = [[4, 1, 0, 0, 0], [4, 1, 0, 0, 0.5], [8, 1, 0, 0, 0.5]]\n",
    );
    let grid = Grid::new([4; 3], Default::default()).expect("a grid");
    let of = |frame| match scene_at(&scene, frame).transfer {
        TransferSource::Points(t) => t,
        other => panic!("{other:?}"),
    };
    let opacity = |frame, s: f64| 1.0 - (-of(frame).sigma(s, &grid)).exp();
    let (a, b) = (|s: f64| s / 10.0, |s: f64| if s < 4.0 { 0.0 } else { 0.5 });
    for s in [0.0, 1.0, 3.9999, 4.0, 5.5, 8.0, 9.0] {
        for (frame, t) in [(1, 0.0), (4, 0.3), (9, 0.8), (11, 1.0)] {
            let expected = a(s) + (b(s) - a(s)) * t;
            assert!((opacity(frame, s) - expected).abs() < 1e-6, "{frame} {s}");
        }
    }
    assert_eq!(of(4).albedo(2.0).map(|c| (c * 1000.0).round() as i32), [440, 140, 140]);
    // What a header or a hash holds of a frame is the function of that frame, its steps included.
    for frame in 1..=11 {
        let again = parse(&scene_text(&scene_at(&scene, frame)));
        assert_eq!(again.transfer, TransferSource::Points(of(frame)), "{frame}");
    }
}

#[test]
fn colours_and_opacities_at_other_scalars_are_written_as_one_function() {
    let colors = vec![(0.0, [0.0, 0.5, 1.0]), (6.0, [0.0, 0.5, 1.0]), (6.0, [1.0, 0.5, 0.0])];
    let opacities = vec![(2.0, 0.25), (4.0, 0.25), (4.0, 0.0), (8.0, 0.75)];
    let made = Transfer::new(colors, opacities, Kind::Opacity, Reference::Voxel).expect("a function");
    let scene = Scene { transfer: TransferSource::Points(made.clone()), ..parse("[volume]\nfile = \"v\"\n") };
    let TransferSource::Points(again) = parse(&scene_text(&scene)).transfer else { panic!("points") };
    let grid = Grid::new([4; 3], Default::default()).expect("a grid");
    for s in [-1.0, 0.0, 1.0, 2.0, 3.0, 3.999, 4.0, 5.0, 5.999, 6.0, 7.0, 8.0, 9.0] {
        assert_eq!(again.albedo(s), made.albedo(s), "{s}");
        assert!((again.sigma(s, &grid) - made.sigma(s, &grid)).abs() < 1e-12, "{s}");
    }
}

#[test]
fn files_of_a_time_series_hold_until_the_next() {
    let file = |extra: &str, frame| {
        let scene = parse(&format!("[volume]\nfile = \"d/step_####.vti\"\n{extra}[animation]\nframes = 9\n"));
        scene_at(&scene, frame).volume.file.display().to_string()
    };
    assert_eq!(file("", 7), "d/step_0007.vti");
    assert_eq!(file("numbers = \"0-30x10\"\n", 1), "d/step_0000.vti");
    assert_eq!(file("numbers = \"0-30x10\"\n", 3), "d/step_0020.vti");
    assert_eq!(file("numbers = \"0-30x10\"\n", 9), "d/step_0030.vti", "the last one holds");
    let scene = parse(
        "[volume]\nfile = \"s%03d.nrrd\"\nnumbers = \"0-30x10\"\n[animation]\nframes = 7\n\
         [[animation.keyframe]]\nframe = 1\nvolume.number = 0\n[[animation.keyframe]]\nframe = 7\nvolume.number = 30\n",
    );
    let names: Vec<String> = (1..=7).map(|f| scene_at(&scene, f).volume.file.display().to_string()).collect();
    assert_eq!(names, ["s000.nrrd", "s000.nrrd", "s010.nrrd", "s010.nrrd", "s020.nrrd", "s020.nrrd", "s030.nrrd"]);
    assert_eq!(scene.volume.file.display().to_string(), "s000.nrrd");
}

#[test]
fn an_orbit_turns_the_camera_and_keeps_its_picture() {
    let grid = Grid::new([20, 10, 10], Default::default()).expect("a grid");
    let camera = |text: &str| {
        let scene = parse(&format!("[volume]\nfile = \"v\"\n[camera]\n{text}"));
        Camera::from_settings(&scene.camera, &grid, 1.5).expect("a camera")
    };
    let plain = camera("position = [2, 0, 0]\n");
    let turned = camera("position = [2, 0, 0]\norbit = [0, 0, 2, 90]\n");
    let centre = grid.centre_world();
    assert!((plain.position - centre - DVec3::new(40.0, 0.0, 0.0)).length() < 1e-9);
    assert!((turned.position - centre - DVec3::new(0.0, 40.0, 0.0)).length() < 1e-9 && turned.target == centre);
    let far = camera("position = [2, 0, 0]\ndistance = 3\norbit = [0, 0, 1, 90]\ncentre = [1, 0, 0]\n");
    assert!((far.position - centre - DVec3::new(20.0, 40.0, 0.0)).length() < 1e-9);
    assert!((far.target - centre - DVec3::new(20.0, -20.0, 0.0)).length() < 1e-9);
    let over = camera("position = [2, 0, 0]\norbit = [0, 1, 0, -90]\n");
    assert!((over.position - centre - DVec3::new(0.0, 0.0, 40.0)).length() < 1e-9 && (over.up + DVec3::X).length() < 1e-9);
}

#[test]
fn a_zoom_and_a_pan_keep_the_camera_where_the_still_scene_has_it() {
    let grid = Grid::new([20, 10, 14], Default::default()).expect("a grid");
    let build = |still: &str, keys: [&str; 2]| {
        let text = format!(
            "[volume]\nfile = \"v\"\n{still}[animation]\nframes = 9\n[[animation.keyframe]]\nframe = 1\n{}\n[[animation.keyframe]]\nframe = 9\n{}\n",
            keys[0], keys[1]
        );
        parse(&text)
    };
    let camera = |scene: &Scene| Camera::from_settings(&scene.camera, &grid, 1.5).expect("a camera");
    for still in ["", "[camera]\nfov = 35\n", "[camera]\nspace = \"world\"\n"] {
        let zoom = build(still, ["camera.fov = 40", "camera.fov = 10"]);
        let first = camera(&zoom);
        assert_eq!(first.fov_degrees, if still.contains("fov") { 35.0 } else { 40.0 });
        for frame in 1..=9 {
            let one = scene_at(&zoom, frame);
            let seen = camera(&one);
            assert!((seen.position - first.position).length() < 1e-12 * first.position.length(), "{still} {frame}");
            assert_eq!((seen.target, seen.fov_degrees), (first.target, 40.0 - 3.75 * (frame - 1) as f64));
            // The text of a frame whose volume is known has the same camera, to the bit.
            let placed = one.placed(&grid);
            assert!(placed.camera.position.is_some() && placed.camera.fit.is_none());
            let again = parse(&scene_text(&placed));
            let aspect = placed.image.aspect();
            let of = |s: &Scene| Camera::from_settings(&s.camera, &grid, aspect).expect("a camera");
            assert_eq!(of(&again), of(&one), "{still} {frame}");
        }
        let pan = build(still, ["camera.target = [0, 0, 0]", "camera.target = [0.5, 0, 0]"]);
        let (a, b) = (camera(&scene_at(&pan, 1)), camera(&scene_at(&pan, 9)));
        assert!((a.position - b.position).length() < 1e-12 && (a.target - b.target).length() > 0.4);
    }
    // A camera that was placed, or keeps a distance, is none that was fitted; nor does an orbit fit anew.
    for (still, keys) in [
        ("[camera]\nposition = [2, 0, 0]\n", ["camera.fov = 40", "camera.fov = 10"]),
        ("[camera]\ndistance = 3\n", ["camera.target = [0, 0, 0]", "camera.target = [0.5, 0, 0]"]),
        ("", ["camera.orbit = [0, 0, 1, 0]", "camera.orbit = [0, 0, 1, 80]"]),
    ] {
        let scene = build(still, keys);
        for frame in [1, 4, 9] {
            let one = scene_at(&scene, frame);
            let plain = Scene { camera: CameraSettings { fit: None, ..one.camera }, ..one.clone() };
            assert_eq!(camera(&one), camera(&plain), "{still} {frame}");
            assert_eq!(one.placed(&grid), plain);
        }
    }
}

#[test]
fn the_command_line_takes_the_place_of_a_track() {
    let text = "[volume]\nfile = \"v\"\n[animation]\nframes = 9\n[[animation.keyframe]]\nframe = 1\n\
                camera.fov = 20\nlight.constant = [1, 1, 1]\ntransfer.points = [[0, 1, 1, 1, 0], [9, 1, 1, 1, 1]]\nlight.scale = 1\n\
                [[animation.keyframe]]\nframe = 9\ncamera.fov = 40\nlight.scale = 2\n";
    let over = |given: &[(&str, &str)]| parse_scene(text, "s.toml", Path::new(""), given).expect("a good scene");
    let tracks = |scene: &Scene| scene.animation.iter().flat_map(|a| a.tracks.iter().map(|t| t.channel)).collect::<Vec<_>>();
    assert_eq!(tracks(&over(&[])), ["transfer.points", "light.constant", "light.scale", "camera.fov"]);
    let scene = over(&[("camera.fov", "60")]);
    assert_eq!(tracks(&scene), ["transfer.points", "light.constant", "light.scale"]);
    let one = scene_at(&scene, 9);
    assert_eq!((one.camera.fov_degrees, one.light.scale, one.camera.fit), (60.0, 2.0, None));
    assert!(scene_text(&scene).contains("fov = 60.0") && !scene_text(&scene).contains("fov = 20.0"));
    assert_eq!(one.origins.of("camera.fov"), "command line");
    // Rivals of a group: the other kind of light, of transfer function.
    let scene = over(&[("light.probe", "p.hdr"), ("transfer.file", "t.json")]);
    assert_eq!(tracks(&scene), ["light.scale", "camera.fov"]);
    let one = scene_at(&scene, 5);
    assert!(matches!((&one.light.source, &one.transfer), (LightSource::Probe(_), TransferSource::File { .. })));
    let scene = over(&[("transfer.points", "[[0, 1, 1, 1, 0], [5, 0, 0, 0, 1]]")]);
    assert_eq!(tracks(&scene), ["light.constant", "light.scale", "camera.fov"]);
    let TransferSource::Points(points) = scene_at(&scene, 3).transfer else { panic!("points") };
    assert_eq!(points.colors()[1].0, 5.0);
    // What is beside the group stays beside it.
    assert_eq!(tracks(&over(&[("transfer.kind", "extinction")])).len(), 4);
    // Keyframes from the command line take the place of the file's, and of the file's rival; and stand beside its own keys.
    let file = text.replace("[animation]", "[transfer]\nfile = \"t.json\"\n[animation]");
    let refused = parse_scene(&file, "s.toml", Path::new(""), &[]).expect_err("a pair").to_string();
    assert!(refused.contains("s.toml line 7, keyframe 1: `transfer.points` cannot stand beside `transfer.file`"), "{refused}");
    let keyframes = "[{ frame = 1, transfer.points = [[0, 1, 1, 1, 0], [9, 1, 1, 1, 1]], camera.fov = 30 }]";
    let given = [("animation.keyframe", keyframes), ("camera.fov", "50")];
    let scene = parse_scene(&file, "s.toml", Path::new(""), &given).expect("a good scene");
    assert_eq!(tracks(&scene), ["transfer.points", "camera.fov"]);
    assert!(matches!(scene.transfer, TransferSource::Points(_)) && scene.camera.fov_degrees == 50.0);
    // A file's number of a series.
    let series = "[volume]\nfile = \"d/#.vti\"\n[animation]\nframes = 9\n[[animation.keyframe]]\nframe = 1\nvolume.number = 0\n\
                  [[animation.keyframe]]\nframe = 9\nvolume.number = 8\n";
    let file = |given: &[(&str, &str)]| {
        scene_at(&parse_scene(series, "s.toml", Path::new(""), given).expect("a good scene"), 5).volume.file.display().to_string()
    };
    assert_eq!((file(&[]), file(&[("volume.number", "7")])), ("d/4.vti".into(), "d/7.vti".into()));
}

#[test]
fn a_value_between_two_keyframes_is_blamed_on_both() {
    let scene = parse(
        "[volume]\nfile = \"v\"\n[animation]\nframes = 9\n[[animation.keyframe]]\nframe = 1\nsurface.iso = 5\n\
         [[animation.keyframe]]\nframe = 5\nsurface.iso = 15\nlight.scale = 1\n[[animation.keyframe]]\nframe = 8\nsurface.iso = 0\nease = \"hold\"\n\
         [[animation.keyframe]]\nframe = 20\nsurface.iso = 9\n",
    );
    let of = |frame| scene_at(&scene, frame).origins.of("surface.iso").to_owned();
    assert_eq!(of(1), "s.toml line 5, keyframe 1");
    assert_eq!(of(3), "between s.toml line 5, keyframe 1 and s.toml line 8, keyframe 2");
    assert_eq!((of(5), of(-9)), ("s.toml line 8, keyframe 2".into(), of(1)));
    assert_eq!(of(9), "s.toml line 12, keyframe 3", "what holds is the value of one");
    assert_eq!(scene_at(&scene, 3).origins.of("light.scale"), "s.toml line 8, keyframe 2");
}

#[test]
fn what_is_wrong_is_said_with_its_keyframe() {
    let one = |keyframe: &str| refused(&format!("[volume]\nfile = \"v\"\n[animation]\nframes = 3\n[[animation.keyframe]]\n{keyframe}\n"));
    assert!(
        one("frame = 1\ncamera.orbt = [0,0,1,3]")
            .contains("line 5: `animation.keyframe` number 1 has `camera.orbt`; did you mean `camera.orbit`?")
    );
    assert!(one("camera.fov = 3").contains("number 1 has no frame"));
    assert!(
        one("frame = 1\ntime = 2\ncamera.fov = 9").contains("line 5: `animation.keyframe` number 1 has a frame and a time; give it one")
    );
    assert!(one("frame = \"1\"\ncamera.fov = 9").contains("number 1 has frame = \"1\"; it must be a number"));
    assert!(one("time = [2]\ncamera.fov = 9").contains("has time = [2]; it must be a number of seconds"));
    for nothing in ["frame = 1", "time = 1\nease = \"hold\""] {
        assert!(one(nothing).contains("number 1 sets nothing; give it keys of the scene"), "{nothing}");
    }
    // The key's own words, at the keyframe's own line.
    for (value, words) in [
        ("camera.position = [1, 2]", "`camera.position` is [1, 2]; it must be three numbers, [x, y, z]"),
        ("camera.fov = \"30\"", "`camera.fov` is \"30\"; it must lie in 1..170 degrees"),
        ("camera.fov = nan", "`camera.fov` is nan; it must lie in 1..170 degrees"),
        ("transfer.points = []", "`transfer.points` is unusable: "),
        ("transfer.points = [[0, 1]]", "`transfer.points` has [0, 1] as its point 0; it must be a list of points"),
        ("clip.planes = [1, 0, 0, 1]", "`clip.planes` has 1 as its point 0; it must be a list of planes"),
        ("surface.iso = [1]", "`surface.iso` is [1]; it must be a finite number"),
        ("light.constant = 1", "`light.constant` is 1; it must be three numbers"),
    ] {
        let said = one(&format!("frame = 1\nlight.scale = 1\n[[animation.keyframe]]\nframe = 2\n{value}"));
        assert!(said.contains(&format!("s.toml line 8, keyframe 2: {words}")), "{said}");
    }
    let listed = "[volume]\nfile = \"v\"\n[animation]\nframes = 3\nkeyframe = [\n  { frame = 1, camera.fov = 9 },\n  { frame = 2 },\n]\n";
    assert!(refused(listed).contains("s.toml line 7: `animation.keyframe` number 2 sets nothing"), "{}", refused(listed));
    let given = [("animation.keyframe", "[{ frame = 1, camera.fov = 999 }]")];
    let said = parse_scene(TURN, "s.toml", Path::new(""), &given).expect_err("a bad scene").to_string();
    assert!(said.starts_with("command line, keyframe 1: `camera.fov` is 999"), "{said}");
    assert!(one("frame = 1\nease = \"cubic\"").contains("\"linear\", \"smooth\" or \"hold\""));
    assert!(one("frame = 1\nlight.rotate = [0, 0, 1]").contains("`light.rotate` is [0, 0, 1]; it must be an axis and degrees"));
    let turned = |ease: &str, axis: &str, last: i32| {
        let keyframes = format!(
            "frame = 1\nease = \"{ease}\"\ncamera.orbit = [0, 0, 1, 0]\n[[animation.keyframe]]\nframe = {last}\ncamera.orbit = {axis}"
        );
        parse_scene(
            &format!("[volume]\nfile = \"v\"\n[animation]\nframes = 3\n[[animation.keyframe]]\n{keyframes}\n"),
            "s.toml",
            Path::new(""),
            &[],
        )
    };
    let said = turned("linear", "[0, 0, -2, 90]", 3).expect_err("no axis half way").to_string();
    assert!(
        said.contains("line 9: `animation.keyframe` number 2 has an axis opposite to that of the keyframe before in `camera.orbit`"),
        "{said}"
    );
    for (ease, axis, last) in
        [("hold", "[0, 0, -2, 90]", 3), ("smooth", "[0, 0.1, -2, 90]", 3), ("linear", "[1, 0, 0, 90]", 3), ("linear", "[0, 0, -2, 90]", 2)]
    {
        assert!(turned(ease, axis, last).is_ok(), "{ease} {axis}");
    }
    assert!(one("frame = 1\ncamera.fov = 999").contains("s.toml line 5, keyframe 1: `camera.fov` is 999; it must lie in 1..170"));
    assert!(one("frame = 1\nlight.rotate = [0, 0, 0, 5]").contains("axis of length 0"));
    assert!(one("frame = 1\ncamera.fov = 9\n[[animation.keyframe]]\nframe = 1\ncamera.fov = 8").contains("at the frame of another"));
    assert!(refused("[volume]\nfile = \"v\"\n[animation]\nrate = 3\n").contains("`animation.frames` is missing"));
    assert!(refused("[volume]\nfile = \"v\"\n[animation]\nframes = 0\n").contains("1 to 1048576"));
    assert!(refused("[volume]\nfile = \"v\"\nnumbers = \"1-3\"\n").contains("without a number"));
    assert!(refused("[volume]\nfile = \"v\"\n[clip]\nbox = [0, 0, 0, 0.5, 0, 1]\n").contains("`clip.box`"));
    let both = "[volume]\nfile = \"v\"\n[light]\nprobe = \"p.hdr\"\n[animation]\nframes = 3\n[[animation.keyframe]]\nframe = 1\nlight.constant = [1, 1, 1]\n";
    assert!(refused(both).contains("cannot stand beside"));
    assert!(matches!(parse(&both.replace("probe = \"p.hdr\"", "")).light.source, LightSource::Constant(_)));
}
