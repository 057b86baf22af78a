//! How things begin and end: versions, threads, growth, defects.

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;
use std::time::Instant;

#[test]
fn the_version_is_the_crates() {
    let (mut a, mut b, mut c, mut abi) = (9, 9, 9, 9);
    ok!(hl_version(&mut a, &mut b, &mut c, &mut abi));
    assert_eq!((format!("{a}.{b}.{c}").as_str(), abi), (env!("CARGO_PKG_VERSION"), HL_ABI));
    ok!(hl_version(std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null_mut()));
    for status in -13..=3 {
        let mut name = std::ptr::null();
        ok!(hl_status_name(status, &mut name));
        // SAFETY: a static name.
        let name = unsafe { CStr::from_ptr(name) }.to_str().unwrap();
        assert!(name.starts_with("HL_") && name.starts_with("HL_ERROR") == (status < 0), "{name}");
    }
}

#[test]
fn engines_are_independent_and_threads_share_one() {
    let engines = [Engine::new(), Engine::new()];
    let work = |engine: &Engine| {
        let field = field(engine.0, &quick(volume(engine.0, 16)));
        let all: Vec<_> = (0..4).map(|_| pixels(image(engine.0, &small(field)))).collect();
        assert!(all.windows(2).all(|w| w[0] == w[1]));
        all[0].clone()
    };
    let pictures: Vec<Vec<f32>> = std::thread::scope(|scope| {
        let threads: Vec<_> = [0, 0, 0, 1, 1].map(|e| (e, &engines)).map(|(e, all)| scope.spawn(move || work(&all[e]))).into();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    assert!(pictures.windows(2).all(|w| w[0] == w[1]) && pictures[0].iter().any(|&v| v > 0.1));
    // What one engine made is refused by the other.
    let far = volume(engines[1].0, 8);
    let mut field = std::ptr::null_mut();
    refused!(HL_ERROR_HANDLE, "another engine", hl_precompute(engines[0].0, &quick(far), &mut field));
}

#[test]
fn the_last_error_is_the_threads_own() {
    let engine = Engine::new();
    let mut volume = std::ptr::null_mut();
    refused!(HL_ERROR_INVALID, "is NULL", hl_volume_create(engine.0, std::ptr::null(), &mut volume));
    assert_eq!(crate::last(engine.0).0, HL_ERROR_INVALID);
    std::thread::scope(|scope| {
        let engine = &engine;
        scope.spawn(move || {
            let engine: &Engine = engine;
            assert_eq!(crate::last(engine.0), (HL_OK, String::new()));
        });
    });
    // Cut where the room ends, and ended.
    let mut text = [1 as c_char; 12];
    // SAFETY: room for eight.
    assert_eq!(unsafe { hl_last_error(engine.0, text.as_mut_ptr(), 8) }, HL_ERROR_INVALID);
    assert_eq!((super::scenes::text(&text).as_str(), text[8]), ("hl_volu", 1));
}

static HEARD: Mutex<Vec<(i32, String)>> = Mutex::new(Vec::new());

unsafe extern "C-unwind" fn hear(user: *mut c_void, severity: i32, text: *const c_char) {
    assert_eq!(user.addr(), 7);
    // SAFETY: the library hands over C strings.
    HEARD.lock().unwrap().push((severity, unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()));
}

#[test]
fn the_host_hears_what_is_said() {
    let log_user = std::ptr::without_provenance_mut(7);
    let info = hl_engine_info { log: Some(hear), log_user, log_level: HL_LOG_INFO, ..init() };
    let mut engine = std::ptr::null_mut();
    ok!(hl_engine_create(&info, &mut engine));
    let engine = Engine(engine);
    // A plan gives its reasons.
    field(engine.0, &hl_precompute_info { volume: volume(engine.0, 16), tolerance: 0.2, ..init() });
    let heard = HEARD.lock().unwrap();
    assert!(heard.iter().any(|(s, t)| *s == HL_LOG_INFO && t.starts_with("plan: ")), "{heard:?}");
    assert!(heard.iter().all(|(s, _)| *s <= HL_LOG_INFO));
}

static DEFECTS: Mutex<Vec<(i32, String)>> = Mutex::new(Vec::new());

unsafe extern "C-unwind" fn hear_defects(_: *mut c_void, severity: i32, text: *const c_char) {
    // SAFETY: the library hands over C strings.
    DEFECTS.lock().unwrap().push((severity, unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()));
}

/// In a process of its own, whose standard error is looked at.
#[test]
#[ignore = "run by `a_defect_is_told_to_the_host_and_not_to_its_standard_error`"]
fn defects() {
    let info = hl_engine_info { log: Some(hear_defects), ..init() };
    for blocking in [true, false] {
        let mut engine = std::ptr::null_mut();
        ok!(hl_engine_create(&info, &mut engine));
        let info = hl_precompute_info { progress: Some(explode), ..quick(volume(engine, 8)) };
        let (mut field, mut job) = (std::ptr::null_mut(), std::ptr::null_mut());
        if blocking {
            refused!(HL_ERROR_INTERNAL, "the host's own defect", hl_precompute(engine, &info, &mut field));
        } else {
            ok!(hl_precompute_start(engine, &info, &mut job));
            // SAFETY: a job of ours.
            assert!(unsafe { hl_job_wait(job, -1.0) } < 0);
        }
        // The cause is named for as long as the engine is there, with its place.
        refused!(HL_ERROR_POISONED, "the host's own defect (tests/ffi/life.rs:", hl_precompute(engine, &info, &mut field));
        let heard = std::mem::take(&mut *DEFECTS.lock().unwrap());
        assert!(heard.len() == 1 && heard[0].0 == HL_LOG_ERROR && heard[0].1.contains("the host's own defect"), "{heard:?}");
        ok!(hl_engine_destroy(engine));
    }
    // Sabotage: what panics outside is heard where it always was.
    assert!(std::thread::spawn(|| panic!("a panic elsewhere")).join().is_err());
}

#[test]
fn a_defect_is_told_to_the_host_and_not_to_its_standard_error() {
    let wrong = alone("life::defects").1;
    assert!(wrong.contains("a panic elsewhere") && !wrong.contains("own defect"), "{wrong}");
}

/// Runs a test in a process of its own: what it said, and what it said to be wrong.
fn alone(test: &str) -> (String, String) {
    let out = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--ignored", "--nocapture", "--test-threads=1"])
        .output()
        .unwrap();
    let [said, wrong] = [&out.stdout, &out.stderr].map(|t| String::from_utf8_lossy(t).into_owned());
    assert!(out.status.success(), "{said}\n{wrong}");
    (said, wrong)
}

unsafe extern "C-unwind" fn explode(_: *mut c_void, _: *const c_char, _: f32) -> i32 {
    panic!("the host's own defect")
}

#[test]
fn a_defect_poisons_the_engine_and_nothing_else() {
    let (engine, other) = (Engine::new(), Engine::new());
    let volume = volume(engine.0, 16);
    for blocking in [true, false] {
        let engine = if blocking { engine.0 } else { other.0 };
        let volume = if blocking { volume } else { self::volume(other.0, 16) };
        let info = hl_precompute_info { progress: Some(explode), ..quick(volume) };
        let (mut field, mut job) = (std::ptr::null_mut(), std::ptr::null_mut());
        if blocking {
            refused!(HL_ERROR_INTERNAL, "the host's own defect", hl_precompute(engine, &info, &mut field));
        } else {
            ok!(hl_precompute_start(engine, &info, &mut job));
            // The job's own fault, or that the engine is poisoned, whichever thread is faster.
            // SAFETY: a job of ours.
            let status = unsafe { hl_job_wait(job, -1.0) };
            assert!([HL_ERROR_INTERNAL, HL_ERROR_POISONED].contains(&status), "{status}");
        }
        refused!(HL_ERROR_POISONED, "the host's own defect", hl_precompute(engine, &quick(volume), &mut field));
        ok!(hl_engine_destroy(engine));
        refused!(HL_ERROR_HANDLE, "not known", hl_precompute(engine, &quick(volume), &mut field));
    }
    let third = Engine::new();
    self::volume(third.0, 8);
}

/// Bytes of memory that this process has in use.
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * text.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
}

/// In a process of its own: other tests would be counted too.
#[test]
#[ignore = "run by `a_thousand_cycles_do_not_grow`"]
fn cycles() {
    let made = std::cell::Cell::new(std::ptr::null_mut());
    let data = ball(8);
    let round = |whole: bool| {
        if whole {
            ok!(hl_engine_create(std::ptr::null(), made.as_ptr()));
        }
        let engine = made.get();
        let (mut volume, mut light, mut transfer) = (std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null_mut());
        ok!(hl_volume_create(engine, &volume_info(&data, 8), &mut volume));
        ok!(hl_transfer_create(engine, &transfer_info(&points(true, 0.5)), &mut transfer));
        ok!(hl_light_create(engine, std::ptr::null(), &mut light));
        let field = field(engine, &hl_precompute_info { transfer, ..quick(volume) });
        let image = image(engine, &hl_render_info { light, width: 4, height: 4, ..small(field) });
        let mut job = std::ptr::null_mut();
        ok!(hl_render_start(engine, &small(field), &mut job));
        if !whole {
            ok!(hl_job_destroy(job));
            ok!(hl_image_destroy(image));
            ok!(hl_field_destroy(field));
            ok!(hl_light_destroy(light));
            ok!(hl_transfer_destroy(transfer));
            ok!(hl_volume_destroy(volume));
        } else {
            // With a job under way, and everything still there.
            ok!(hl_engine_destroy(engine));
        }
    };
    let grown = |name: &str, round: &dyn Fn()| {
        (0..50).for_each(|_| round());
        let (start, before) = (Instant::now(), resident());
        (0..1000).for_each(|_| round());
        let grown = resident().saturating_sub(before);
        println!("1000 cycles {name} in {:.1} s: {} KiB more", start.elapsed().as_secs_f64(), grown >> 10);
        grown
    };
    let engines = grown("with their engine", &|| round(true));
    ok!(hl_engine_create(std::ptr::null(), made.as_ptr()));
    let things = grown("on one engine", &|| round(false));
    // A card's driver keeps megabytes that what is forgotten finds room in.
    let side = if crate::estimates::device(made.get()).kind == 3 { 16u32 } else { 64 };
    let pixels = vec![[0f32; 4]; (side * side) as usize];
    let forgotten = grown("that forget an image", &|| {
        let mut image = std::ptr::null_mut();
        let info = hl_image_info { data: pixels.as_ptr().cast(), width: side, height: side, ..init() };
        ok!(hl_image_create(made.get(), &info, &mut image));
    });
    println!("RESULT {engines} {things} {forgotten}");
}

#[test]
fn a_thousand_cycles_do_not_grow() {
    let (text, _) = alone("life::cycles");
    print!("{text}");
    let line = text.lines().find_map(|l| l.strip_prefix("RESULT ")).expect("a result");
    let grown: Vec<u64> = line.split(' ').map(|n| n.parse().unwrap()).collect();
    // 2 KiB a cycle, of things as of engines with all that is on them: the drift of allocator and driver is less.
    let kept_down = |grown: u64| grown < 2 << 20;
    assert!(kept_down(grown[0]) && kept_down(grown[1]), "{grown:?}");
    // Sabotage: what is forgotten is seen, though much of it finds room in what the engines left.
    assert!(!kept_down(grown[2]), "{grown:?}");
}
