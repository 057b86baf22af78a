//! `[animation]` of a scene, read and written.

use super::scene::plain;
use super::settings::Settings;
use crate::error::Result;
use crate::scene::animation::{Animation, CHANNELS, Ease, Keyframe, Shape, Track};
use crate::scene::keys::nearest;
use std::path::Path;
use toml::{Table, Value};

const EASES: [(&str, Ease); 3] = [("linear", Ease::Linear), ("smooth", Ease::Smooth), ("hold", Ease::Hold)];

/// Most keyframes that are taken seriously: each is checked as a whole scene.
const MAX_KEYFRAMES: usize = 10_000;

/// The animation, if the scene has one. A key that is animated but not set takes the first keyframe's value.
pub(super) fn animation(s: &mut Settings, volume: Option<&Path>) -> Result<Option<Animation>> {
    const KEY: &str = "animation.keyframe";
    if !s.has_table("animation") {
        return Ok(None);
    }
    let Some(frames) = s.integer("animation.frames", 1..=1 << 20, "it must be 1 to 1048576")? else {
        return Err(s.origins.error("animation.frames", "is missing", "say how many frames there are, or drop [animation]"));
    };
    let first = s.number("animation.first", -1e9..=1e9, "it must be a whole number")?.unwrap_or(1.0);
    if first.fract() != 0.0 {
        return Err(s.origins.error("animation.first", format!("is {first}"), "it must be a whole number"));
    }
    let rate = s.number("animation.rate", 1e-3..=1e6, "it must be a number of frames a second above 0")?.unwrap_or(24.0);
    let ease = s.choice("animation.ease", &EASES)?.unwrap_or_default();
    let mut animation = Animation { first: first as i64, frames: frames as u32, rate, tracks: Vec::new() };
    let tables =
        s.tables(KEY, "it must be a list of tables: [[animation.keyframe]], then frame = N and the keys' values")?.unwrap_or_default();
    if tables.len() > MAX_KEYFRAMES {
        return Err(s.origins.error(KEY, format!("has {} entries", tables.len()), "at most 10000 are read"));
    }
    // (channel, keyframe, its value as written, its place)
    let mut found: Vec<(usize, Keyframe, Value, usize)> = Vec::new();
    for (i, table) in tables.iter().enumerate() {
        let bad = |what: String, right: &str| s.origins.error(KEY, format!("number {} {what}", i + 1), right);
        let own = match table.get("ease") {
            None => ease,
            Some(value) => match EASES.iter().find(|(name, _)| value.as_str() == Some(name)) {
                Some((_, ease)) => *ease,
                None => return Err(bad(format!("has ease = {value}"), "it must be \"linear\", \"smooth\" or \"hold\"")),
            },
        };
        let number = |key| table.get(key).map(number);
        let frame = match (number("frame"), number("time")) {
            (Some(Some(frame)), None) => frame,
            (None, Some(Some(seconds))) => first + seconds * rate,
            _ => return Err(bad("has no frame".into(), "give it frame = N, or time = SECONDS, one of the two")),
        };
        for (key, value) in flat(table) {
            if ["ease", "frame", "time"].contains(&key.as_str()) {
                continue;
            }
            let Some(channel) = CHANNELS.iter().position(|(name, _)| *name == key) else {
                let names: Vec<&str> = CHANNELS.iter().map(|c| c.0).collect();
                let near = nearest(&key, names.iter().copied()).map_or(String::new(), |n| format!("did you mean `{n}`? "));
                return Err(bad(format!("has `{}`", short(&key)), &format!("{near}animated are {}", names.join(", "))));
            };
            let Some(values) = numbers(&value, CHANNELS[channel].1) else {
                return Err(bad(format!("has {key} = {}", short(&value.to_string())), "it must have the numbers that the key has"));
            };
            found.push((channel, Keyframe { frame, values, ease: own }, value, i));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.frame.total_cmp(&b.1.frame)));
    // What nothing else sets stands as in its first keyframe, so that the scene is whole without its animation.
    let origin = |i: usize| format!("{}, keyframe {}", s.origins.of(KEY), i + 1);
    let mut firsts: Vec<(&str, Value, String)> = Vec::new();
    for (channel, _, value, i) in &found {
        let name = CHANNELS[*channel].0;
        if !s.has(name) && firsts.last().is_none_or(|f| f.0 != name) {
            firsts.push((name, value.clone(), origin(*i)));
        }
    }
    let checks: Vec<(&str, Value, String)> = found.iter().map(|(c, _, v, i)| (CHANNELS[*c].0, v.clone(), origin(*i))).collect();
    for (key, value, origin) in firsts {
        s.put(key, value, origin);
    }
    for (key, value, origin) in checks {
        let mut with = s.clone();
        with.put(key, value, origin);
        plain(with, volume, None, None)?;
    }
    for (channel, key, _, i) in found {
        let (name, shape) = CHANNELS[channel];
        let bad = |what: &str, right: &str| Err(s.origins.error(KEY, format!("number {} {what} `{name}`", i + 1), right));
        match animation.tracks.last_mut().filter(|t| t.channel == name) {
            None => animation.tracks.push(Track { channel: name, keys: vec![key] }),
            Some(track) if track.keys.last().is_some_and(|last| last.frame == key.frame) => {
                return bad("stands at the frame of another with", "give each key one value at a frame");
            }
            Some(track) if shape != Shape::Points && track.keys[0].values.len() != key.values.len() => {
                return bad("has another number of rows than the one before in", "give all keyframes as many");
            }
            Some(track) => track.keys.push(key),
        }
    }
    Ok(Some(animation))
}

/// The table that reads as the animation.
pub(super) fn text(animation: &Animation) -> Table {
    let mut keyframes = Vec::new();
    for track in &animation.tracks {
        let shape = CHANNELS.iter().find(|(name, _)| *name == track.channel).map(|c| c.1);
        for key in &track.keys {
            let floats = |v: &[f64]| Value::Array(v.iter().map(|x| Value::Float(*x)).collect());
            let value = match shape {
                Some(Shape::Numbers(1)) => Value::Float(key.values[0]),
                Some(Shape::Rows(n)) => Value::Array(key.values.chunks(n).map(floats).collect()),
                Some(Shape::Points) => Value::Array(key.values.chunks(5).map(floats).collect()),
                _ => floats(&key.values),
            };
            let ease = EASES.iter().find(|(_, e)| *e == key.ease).map_or("linear", |e| e.0);
            let (table, name) = track.channel.split_once('.').unwrap_or(("", track.channel));
            let mut entry = Table::new();
            entry.insert("frame".into(), Value::Float(key.frame));
            entry.insert("ease".into(), Value::String(ease.into()));
            entry.insert(table.into(), Value::Table(Table::from_iter([(name.to_owned(), value)])));
            keyframes.push(Value::Table(entry));
        }
    }
    let mut out = Table::new();
    out.insert("frames".into(), Value::Integer(animation.frames.into()));
    out.insert("first".into(), Value::Integer(animation.first));
    out.insert("rate".into(), Value::Float(animation.rate));
    if !keyframes.is_empty() {
        out.insert("keyframe".into(), Value::Array(keyframes));
    }
    out
}

/// A table's values by dotted key: `camera.orbit = …` and `camera = { orbit = … }` are the same.
fn flat(table: &Table) -> Vec<(String, Value)> {
    let mut out = Vec::new();
    for (key, value) in table {
        match value {
            Value::Table(inner) => out.extend(inner.iter().map(|(k, v)| (format!("{key}.{k}"), v.clone()))),
            other => out.push((key.clone(), other.clone())),
        }
    }
    out
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(v) => Some(*v as f64),
        Value::Float(v) if v.is_finite() => Some(*v),
        _ => None,
    }
}

/// The numbers of a channel, row after row.
fn numbers(value: &Value, shape: Shape) -> Option<Vec<f64>> {
    let row = |value: &Value, n: usize| -> Option<Vec<f64>> {
        let numbers: Vec<f64> = value.as_array()?.iter().map(number).collect::<Option<_>>()?;
        (numbers.len() == n).then_some(numbers)
    };
    let rows = |n| Some(value.as_array()?.iter().map(|r| row(r, n)).collect::<Option<Vec<_>>>()?.concat());
    match shape {
        Shape::Numbers(1) => Some(vec![number(value)?]),
        Shape::Numbers(n) => row(value, n),
        Shape::Rows(n) => rows(n),
        Shape::Points => rows(5).filter(|v| !v.is_empty()),
    }
}

/// A scene's own words in an error.
fn short(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(80).collect();
    if text.chars().count() > 80 { line + "…" } else { line }
}
