#![no_main]
use halflight::io::{parse_scene, scene_text};
use halflight::scene::Scene;
use std::path::Path;
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let parse = |text: &str| parse_scene(text, "a.toml", Path::new("/scenes"), &[]);
    if let Ok(scene) = parse(text) {
        // What pictures carry in their headers is the same scene.
        let again = parse(&scene_text(&scene)).expect("a scene's own text");
        assert_eq!(Scene { origins: scene.origins.clone(), ..again }, scene);
    }
});
