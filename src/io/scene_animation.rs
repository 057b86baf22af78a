//! `[animation]` of a scene, read and written.

use super::scene::{RIVALS, plain};
use super::settings::{Settings, clamp};
use crate::error::{Error, Result};
use crate::scene::animation::{Animation, CHANNELS, Ease, Keyframe, Shape, Track};
use crate::scene::keys::nearest;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use toml::{Table, Value};

const EASES: [(&str, Ease); 3] = [("linear", Ease::Linear), ("smooth", Ease::Smooth), ("hold", Ease::Hold)];

const KEY: &str = "animation.keyframe";

/// Seconds.
const HALF_MILLISECOND: f64 = 5.001e-4;

/// Most keyframes that are taken seriously: each is checked as a whole scene.
const MAX_KEYFRAMES: usize = 10_000;

/// The animation, if the scene has one. A key that is animated but not set takes the first keyframe's value.
pub(super) fn animation(s: &mut Settings, volume: Option<&Path>) -> Result<Option<Animation>> {
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
    // What the command line sets takes the place of the file's track, and of a rival's.
    let displaced = |key: &str| {
        let rival = |[a, b]: [&[&str]; 2]| (a.contains(&key) && s.overrides(b[0])) || (b.contains(&key) && s.overrides(a[0]));
        !s.overrides(KEY) && (s.overrides(key) || RIVALS.into_iter().any(rival))
    };
    // (channel, frame, ease, the value as written, which keyframe)
    let mut found: Vec<(usize, f64, Ease, Value, usize)> = Vec::new();
    for (i, table) in tables.iter().enumerate() {
        let bad = |what: String, right: &str| wrong(s, i, what, right);
        let own = match table.get("ease") {
            None => ease,
            Some(value) => match EASES.iter().find(|(name, _)| value.as_str() == Some(name)) {
                Some((_, ease)) => *ease,
                None => return Err(bad(format!("has ease = {value}"), "it must be \"linear\", \"smooth\" or \"hold\"")),
            },
        };
        let frame = match (table.get("frame"), table.get("time")) {
            (None, None) => return Err(bad("has no frame".into(), "give it frame = N, or time = SECONDS, one of the two")),
            (Some(_), Some(_)) => return Err(bad("has a frame and a time".into(), "give it one of the two")),
            (Some(frame), None) => number(frame).ok_or_else(|| bad(format!("has frame = {}", short(frame)), "it must be a number"))?,
            (None, Some(time)) => {
                let time = number(time).ok_or_else(|| bad(format!("has time = {}", short(time)), "it must be a number of seconds"))?;
                // A frame's time is hardly ever a round number: half a millisecond off, it is that frame's.
                let frame = first + rate * time;
                if (frame - frame.round()).abs() <= (HALF_MILLISECOND * rate).min(0.1) { frame.round() } else { frame }
            }
        };
        let mut keys = flat(table);
        keys.retain(|(key, _)| !["ease", "frame", "time"].contains(&key.as_str()));
        if keys.is_empty() {
            return Err(bad("sets nothing".into(), "give it keys of the scene, such as camera.orbit = [0, 0, 1, 90], or drop it"));
        }
        for (key, value) in keys {
            let Some(channel) = CHANNELS.iter().position(|(name, _)| *name == key) else {
                let names: Vec<&str> = CHANNELS.iter().map(|c| c.0).collect();
                let near = nearest(&key, names.iter().copied()).map_or(String::new(), |n| format!("did you mean `{n}`? "));
                return Err(bad(format!("has `{}`", clamp(&key)), &format!("{near}animated are {}", names.join(", "))));
            };
            if !displaced(&key) {
                found.push((channel, frame, own, value, i));
            }
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // What nothing else sets stands as in its first keyframe, so that the scene is whole without its animation.
    let origin = |s: &Settings, i: usize| format!("{}, keyframe {}", s.entry(KEY, i), i + 1);
    for (channel, _, _, value, i) in &found {
        let name = CHANNELS[*channel].0;
        if !s.has(name) {
            s.put(name, value.clone(), origin(s, *i));
        }
    }
    // Each keyframe is checked as a scene without the others.
    let mut still = s.clone();
    still.remove(KEY);
    for (channel, _, _, value, i) in &found {
        let mut with = still.clone();
        with.put(CHANNELS[*channel].0, value.clone(), origin(s, *i));
        plain(with, volume, None, None)?;
    }
    let mut animated: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (channel, frame, ease, value, i) in found {
        let (name, shape) = CHANNELS[channel];
        let bad = |what: &str, right: &str| Err(wrong(s, i, format!("{what} `{name}`"), right));
        // The scene's own check, above, has said what a value must look like.
        let Some(values) = numbers(&value, shape) else { return bad("has an unusable", "it must have the numbers that the key has") };
        let key = Keyframe { frame, values, ease };
        match animation.tracks.last_mut().filter(|t| t.channel == name) {
            None => animation.tracks.push(Track { channel: name, keys: vec![key] }),
            Some(track) if track.keys.last().is_some_and(|last| last.frame == key.frame) => {
                return bad("stands at the frame of another with", "give each key one value at a frame");
            }
            Some(track) if shape != Shape::Points && track.keys[0].values.len() != key.values.len() => {
                return bad("has another number of rows than the one before in", "give all keyframes as many");
            }
            Some(track)
                if ["light.rotate", "camera.orbit"].contains(&name) && track.keys.last().is_some_and(|last| opposite(last, &key)) =>
            {
                return bad("has an axis opposite to that of the keyframe before in", "keep the axis and turn by an angle below 0");
            }
            Some(track) => track.keys.push(key),
        }
        let place = origin(s, i);
        animated.entry(name.into()).or_default().push(place);
    }
    s.origins.animated = Arc::new(animated);
    Ok(Some(animation))
}

/// Whether the way from one turn to the next, where a frame lies on it, leads through an axis that is none.
fn opposite(from: &Keyframe, to: &Keyframe) -> bool {
    let axis = |k: &Keyframe| DVec3::new(k.values[0], k.values[1], k.values[2]);
    let (a, way) = (axis(from), axis(to) - axis(from));
    let nearest = a + way * (-a.dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    from.ease != Ease::Hold && from.frame.floor() + 1.0 < to.frame && nearest.length() < 1e-3 * a.length().min(axis(to).length())
}

/// What is wrong with a keyframe, at its own line.
fn wrong(s: &Settings, i: usize, what: String, right: &str) -> Error {
    Error::Scene { origin: s.entry(KEY, i).into(), key: KEY.into(), what: format!("number {} {what}", i + 1), right: right.into() }
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

/// A value as an error shows it.
fn short(value: &Value) -> String {
    clamp(&value.to_string())
}
