//! A scene's keys on the command line: their options and help, from the library's table of keys, and what each command uses.

use clap::{Arg, ArgAction, ArgMatches};
use halflight::scene::keys::{self, KEYS, Key};

/// What `light` uses of a scene.
pub const OF_LIGHT: &[&str] = &["light.rotate", "light.scale", "light.bands", "light.window", "image.exposure"];

/// What a visibility field depends on.
pub const OF_FIELD: &[&str] = &["volume", "transfer", "surface", "clip", "visibility"];

/// What a volume alone depends on.
pub const OF_VOLUME: &[&str] = &["volume"];

/// All of a scene.
pub const OF_SCENE: &[&str] = &["volume", "transfer", "surface", "clip", "light", "visibility", "camera", "image"];

/// All of a scene and its animation.
pub const OF_FRAMES: &[&str] = &["volume", "transfer", "surface", "clip", "light", "visibility", "camera", "image", "animation"];

/// What has a plan find settings: `frames` hides these options, for it refuses them.
pub const PLANNED: [&str; 2] = ["visibility.tolerance", "visibility.quality"];

/// What a chart uses: the estimators' own settings are what it varies.
pub const OF_CHART: &[&str] = &["volume", "transfer", "surface", "light", "visibility.ratio", "camera", "image"];

/// What a reference picture depends on.
pub const OF_REFERENCE: &[&str] =
    &["volume", "transfer", "surface", "clip", "light.probe", "light.constant", "light.rotate", "light.scale", "camera", "image"];

/// Whether `key` is one of `used`: tables, or single keys.
fn is_used(key: &str, used: &[&str]) -> bool {
    used.iter().any(|u| key == *u || key.split_once('.').is_some_and(|(table, _)| table == *u))
}

/// Refuses overrides that would change nothing in `work`.
pub fn check_used(overrides: &[(String, String)], used: &[&str], work: &str) -> Result<(), String> {
    match overrides.iter().find(|(key, _)| keys::find(key).is_some() && !is_used(key, used)) {
        None => Ok(()),
        Some((key, _)) => {
            let there = if used.is_empty() { "it uses no key of a scene".into() } else { format!("it uses {}", used.join(", ")) };
            Err(format!("command line: `{key}` changes nothing in {work}; {there}"))
        }
    }
}

/// The overrides of scene keys in the order given: (key, value as TOML).
pub fn overrides(matches: &ArgMatches) -> Result<Vec<(String, String)>, String> {
    let mut found: Vec<(usize, String, String)> = Vec::new();
    if let Ok(Some(sets)) = matches.try_get_many::<String>("set") {
        for (text, at) in sets.zip(matches.indices_of("set").into_iter().flatten()) {
            let Some((key, value)) = text.split_once('=') else {
                return Err(format!("--set {text} has no `=`; write it as --set key=value, such as --set visibility.ratio=2"));
            };
            found.push((at, key.trim().into(), value.trim().into()));
        }
    }
    for key in KEYS {
        if let Ok(Some(values)) = matches.try_get_many::<String>(key.name) {
            for (value, at) in values.zip(matches.indices_of(key.name).into_iter().flatten()) {
                found.push((at, key.name.into(), value.clone()));
            }
        }
    }
    found.sort_by_key(|f| f.0);
    let mut overrides: Vec<_> = found.into_iter().map(|(_, key, value)| (key, value)).collect();
    for (id, key) in [("tolerance", "visibility.tolerance"), ("quality", "visibility.quality")] {
        if let Ok(Some(value)) = matches.try_get_one::<String>(id) {
            overrides.push((key.into(), value.clone()));
        }
    }
    if let Ok(Some(value)) = matches.try_get_one::<String>("nan-as") {
        overrides.push(("volume.nan_as".into(), value.clone()));
    }
    Ok(overrides)
}

/// One option per key of `used` (tables or keys), and `--set`. Where they are many, the short help leaves them out.
pub fn scene_args(used: &[&str]) -> Vec<Arg> {
    let keys: Vec<&Key> = KEYS.iter().filter(|k| is_used(k.name, used)).collect();
    let many = keys.len() > 8;
    let option = |k: &&Key| {
        let table = k.name.split('.').next().unwrap_or_default();
        Arg::new(k.name)
            .long(k.name)
            .value_name(value_name(k))
            .help(key_help(k))
            .help_heading(heading(table))
            .hide_short_help(many)
            .hide(used == OF_FRAMES && PLANNED.contains(&k.name))
            .action(ArgAction::Append)
            .allow_hyphen_values(k.value.starts_with('['))
            .allow_negative_numbers(!k.value.starts_with('['))
    };
    let set = Arg::new("set").long("set").value_name("KEY=VALUE").action(ArgAction::Append).help(if many {
        "override a key, animated or not: --set visibility.ratio=2 (or --visibility.ratio 2); --help lists all keys"
    } else {
        "override a key: --set light.scale=2 (or --light.scale 2)"
    });
    keys.iter().map(option).chain([set]).collect()
}

/// What the help shows in angle brackets: lists without their own (clap wants it static).
fn value_name(key: &Key) -> &'static str {
    match key.value {
        "[X, Y, Z]" => "X,Y,Z",
        "[X, Y, Z, DEGREES]" => "X,Y,Z,DEGREES",
        "[R, G, B]" => "R,G,B",
        "[R, G, B]|light" => "R,G,B|light",
        "[LOW, HIGH]" => "LOW,HIGH",
        "[[S, R, G, B, A], …]" => "POINTS",
        "[X0, Y0, Z0, X1, Y1, Z1]" => "X0,Y0,Z0,X1,Y1,Z1",
        "[[NX, NY, NZ, D], …]" => "PLANES",
        "[{KEYFRAME}, …]" => "KEYFRAMES",
        other => other,
    }
}

/// The key's meaning and default.
fn key_help(key: &Key) -> String {
    let form = if key.value.starts_with("[[") { format!(": {}", key.value) } else { String::new() };
    let bare = key.default.strip_prefix('[').and_then(|d| d.strip_suffix(']')).map(|d| d.replace(' ', ""));
    match bare.as_deref().unwrap_or(key.default) {
        "" => format!("{}{form}", key.help),
        default => format!("{}{form} (default: {default})", key.help),
    }
}

/// The table's heading in the help; clap wants it static.
fn heading(table: &str) -> &'static str {
    match table {
        "volume" => "Scene: [volume]",
        "transfer" => "Scene: [transfer]",
        "surface" => "Scene: [surface]",
        "light" => "Scene: [light]",
        "visibility" => "Scene: [visibility]",
        "clip" => "Scene: [clip]",
        "camera" => "Scene: [camera]",
        "animation" => "Scene: [animation]",
        "image" => "Scene: [image]",
        _ => "Scene",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::cli::args::command;

    #[test]
    fn help_of_a_key_reads_well() {
        let shown = |name| {
            let k = keys::find(name).unwrap();
            format!("<{}> {}", value_name(k), key_help(k))
        };
        assert_eq!(shown("camera.up"), "<X,Y,Z> direction that is up in the picture (default: 0,0,1)");
        assert_eq!(shown("image.width"), "<PIXELS> pixels per row (default: 1024)");
        assert!(shown("volume.file").starts_with("<PATH> volume, relative to the scene file"));
        assert!(
            shown("transfer.points").contains("<POINTS>") && shown("transfer.points").contains("[[S, R, G, B, A], …] (default: a grey")
        );
        for k in KEYS {
            assert!(!value_name(k).contains(['[', ']', ' ']) && !key_help(k).contains("[default"), "{}", k.name);
        }
    }

    #[test]
    fn keys_that_change_nothing_are_refused() {
        let given = |key: &str| vec![(key.to_string(), "1".to_string())];
        assert!(check_used(&given("light.scale"), OF_LIGHT, "`light`").is_ok());
        assert!(check_used(&given("visibility.ratio"), OF_FIELD, "`precompute`").is_ok());
        let refused = check_used(&given("visibility.ratio"), OF_LIGHT, "`light`").unwrap_err();
        assert!(refused.starts_with("command line: `visibility.ratio` changes nothing in `light`; it uses light.rotate"), "{refused}");
        // Unknown keys are for the scene's reader to refuse.
        assert!(check_used(&given("light.scales"), OF_LIGHT, "`light`").is_ok());
        let tables: Vec<&str> = keys::tables();
        assert_eq!(tables, OF_FRAMES);
    }

    #[test]
    fn overrides_keep_their_order() {
        let m = command()
            .try_get_matches_from([
                "halflight",
                "render",
                "s.toml",
                "-o",
                "x.png",
                "--visibility.ratio",
                "2",
                "--set",
                "image.width=7",
                "--set",
                "visibility.ratio = 4",
                "--image.exposure",
                "-1.5",
                "--nan-as",
                "-3",
            ])
            .unwrap();
        let found = overrides(m.subcommand().unwrap().1).unwrap();
        let found: Vec<_> = found.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        let expected = [
            ("visibility.ratio", "2"),
            ("image.width", "7"),
            ("visibility.ratio", "4"),
            ("image.exposure", "-1.5"),
            ("volume.nan_as", "-3"),
        ];
        assert_eq!(found, expected);
    }
}
