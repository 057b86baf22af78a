//! Animation: keyframes of a scene's own keys, and the scene at a frame. Pure: a frame depends on its number alone.

use super::camera::Framing;
use super::clip::Clip;
use super::frames::Pattern;
use super::scene::{LightSource, Scene, TransferSource};
use super::transfer::{Between, Transfer, limit, stepped};
use glam::DVec3;
use std::path::PathBuf;

/// `[animation]`: how many frames, and what changes over them.
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Number of the first frame.
    pub first: i64,
    /// Frames.
    pub frames: u32,
    /// Frames a second.
    pub rate: f64,
    /// What changes, in the order of [`CHANNELS`], at most one of each.
    pub tracks: Vec<Track>,
}

/// A key of the scene over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The key: a name in [`CHANNELS`].
    pub channel: &'static str,
    /// At least one, ascending by frame, no two at one.
    pub keys: Vec<Keyframe>,
}

/// A value at a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// Frame; fractions lie between frames.
    pub frame: f64,
    /// The key's numbers, row after row.
    pub values: Vec<f64>,
    /// The way to the next keyframe of the track.
    pub ease: Ease,
}

/// The way from a keyframe to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ease {
    /// Even.
    #[default]
    Linear,
    /// A monotone cubic through the keyframes (Steffen 1990): no jump of speed, no overshoot, at rest at the first keyframe,
    /// at the last, and where it turns back.
    Smooth,
    /// The value stays, and jumps at the next keyframe.
    Hold,
}

/// How many numbers a channel has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// So many.
    Numbers(usize),
    /// Rows of so many: the same number of rows in every keyframe.
    Rows(usize),
    /// Points of a transfer function, rows of five, in any number: functions fade into each other.
    Points,
}

/// The keys that can be animated.
pub const CHANNELS: &[(&str, Shape)] = &[
    ("volume.number", Shape::Numbers(1)),
    ("transfer.points", Shape::Points),
    ("surface.iso", Shape::Numbers(1)),
    ("surface.albedo", Shape::Numbers(3)),
    ("clip.box", Shape::Numbers(6)),
    ("clip.planes", Shape::Rows(4)),
    ("light.constant", Shape::Numbers(3)),
    ("light.rotate", Shape::Numbers(4)),
    ("light.scale", Shape::Numbers(1)),
    ("camera.position", Shape::Numbers(3)),
    ("camera.target", Shape::Numbers(3)),
    ("camera.up", Shape::Numbers(3)),
    ("camera.fov", Shape::Numbers(1)),
    ("camera.centre", Shape::Numbers(3)),
    ("camera.orbit", Shape::Numbers(4)),
    ("camera.distance", Shape::Numbers(1)),
    ("image.exposure", Shape::Numbers(1)),
];

/// Files of a time series in place of one volume: `step_####.vti`.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The pattern that `volume.file` holds.
    pub file: PathBuf,
    /// The numbers that there are, ascending; empty: every one.
    pub numbers: Vec<i64>,
    /// The number that is shown, in every frame unless it is animated; without one an animation shows one after the other,
    /// and a still the first.
    pub number: Option<i64>,
}

impl Series {
    /// The file of the last number that is not beyond `number`; the first where there is none.
    pub fn at(&self, number: i64) -> PathBuf {
        let before = self.numbers.partition_point(|&n| n <= number).saturating_sub(1);
        let number = self.numbers.get(before).copied().unwrap_or(number);
        Pattern::find(&self.file).map_or_else(|| self.file.clone(), |p| p.path(number))
    }

    /// The file outside an animation.
    pub fn still(&self, first: i64) -> PathBuf {
        self.at(self.number.or(self.numbers.first().copied()).unwrap_or(first))
    }
}

impl Animation {
    /// The frames' numbers.
    pub fn range(&self) -> std::ops::RangeInclusive<i64> {
        self.first..=self.first.saturating_add(i64::from(self.frames.max(1)) - 1)
    }

    /// The track of a key.
    pub fn track(&self, channel: &str) -> Option<&Track> {
        self.tracks.iter().find(|t| t.channel == channel)
    }
}

/// The scene at a frame, with nothing left to animate. Before the first keyframe of a track its value holds, and after the
/// last its own.
pub fn scene_at(scene: &Scene, frame: i64) -> Scene {
    let Some(animation) = &scene.animation else { return scene.clone() };
    // All but the animation itself, which may be as long as there are frames.
    let mut out = Scene {
        volume: scene.volume.clone(),
        transfer: scene.transfer.clone(),
        surface: scene.surface,
        clip: scene.clip.clone(),
        light: scene.light.clone(),
        visibility: scene.visibility.clone(),
        wanted: scene.wanted,
        camera: scene.camera,
        image: scene.image,
        animation: None,
        origins: scene.origins.clone(),
    };
    if let Some(series) = out.volume.steps.take() {
        let number = match animation.track("volume.number") {
            // Between two numbers the earlier one holds.
            Some(track) => (track.at(frame as f64)[0] + 1e-9).floor() as i64,
            None => series.number.unwrap_or_else(|| {
                let place = usize::try_from(frame.saturating_sub(animation.first)).unwrap_or(0);
                series.numbers.get(place).or(series.numbers.last()).copied().unwrap_or(frame)
            }),
        };
        out.volume.file = series.at(number);
    }
    // Fitted to the box once, so that a changing field of view zooms and a changing target pans.
    if ["camera.fov", "camera.target"].iter().any(|k| animation.track(k).is_some()) {
        out.camera.fit = Some(Framing { target: scene.camera.target, fov_degrees: scene.camera.fov_degrees });
    }
    for track in &animation.tracks {
        apply(&mut out, track, frame as f64);
        // What is wrong with a value between two keyframes is said of both.
        if let Some(places) = scene.origins.animated.get(track.channel) {
            let (a, b, t) = track.neighbours(frame as f64);
            let place = |i: usize| places.get(i).cloned().unwrap_or_default();
            let text = if t == 0.0 { place(a) } else { format!("between {} and {}", place(a), place(b)) };
            out.origins.keys.insert(track.channel.into(), text);
        }
    }
    out
}

fn apply(scene: &mut Scene, track: &Track, frame: f64) {
    if track.channel == "transfer.points" {
        let (a, b, t) = track.between(frame);
        if let TransferSource::Points(base) = &scene.transfer {
            let of = |k: &Keyframe| {
                let points: Vec<[f64; 5]> = k.values.chunks_exact(5).map(|p| std::array::from_fn(|i| p[i])).collect();
                Transfer::from_points(&points, base.kind(), base.reference())
            };
            // The reader has made sure that both are good.
            if let (Ok(a), Ok(b)) = (of(a), of(b)) {
                scene.transfer = TransferSource::Points(faded(&a, &b, t));
            }
        }
        return;
    }
    let v = track.at(frame);
    let three = |i: usize| DVec3::new(v[i], v[i + 1], v[i + 2]);
    let turn = || (three(0).normalize_or_zero(), v[3]);
    let color = || [v[0] as f32, v[1] as f32, v[2] as f32];
    match track.channel {
        "surface.iso" => scene.surface.iter_mut().for_each(|s| s.iso = v[0]),
        "surface.albedo" => scene.surface.iter_mut().for_each(|s| s.albedo = Some(color())),
        "clip.box" => scene.clip.bounds = Some([[v[0], v[1], v[2]], [v[3], v[4], v[5]]]),
        "clip.planes" => {
            let planes = v.chunks_exact(4).map(|p| std::array::from_fn(|i| p[i])).collect();
            scene.clip = Clip { planes, ..std::mem::take(&mut scene.clip) };
        }
        "light.constant" => scene.light.source = LightSource::Constant(color()),
        "light.rotate" => scene.light.rotate = Some(turn()),
        "light.scale" => scene.light.scale = v[0],
        "camera.position" => scene.camera.position = Some(three(0)),
        "camera.target" => scene.camera.target = Some(three(0)),
        "camera.up" => scene.camera.up = three(0),
        "camera.fov" => scene.camera.fov_degrees = v[0],
        "camera.centre" => scene.camera.centre = Some(three(0)),
        "camera.orbit" => scene.camera.orbit = Some(turn()),
        "camera.distance" => scene.camera.distance = Some(v[0]),
        "image.exposure" => scene.image.exposure = v[0],
        _ => {}
    }
}

impl Track {
    /// Places of the two keyframes around a frame, and the eased way 0..1 from the first to the second.
    fn neighbours(&self, frame: f64) -> (usize, usize, f64) {
        let after = self.keys.partition_point(|k| k.frame <= frame);
        let i = after.saturating_sub(1);
        if after == 0 || after >= self.keys.len() {
            return (i, i, 0.0);
        }
        let (a, b) = (&self.keys[i], &self.keys[after]);
        let t = (frame - a.frame) / (b.frame - a.frame);
        let eased = match a.ease {
            Ease::Linear => t,
            Ease::Smooth => t * t * (3.0 - 2.0 * t),
            Ease::Hold => 0.0,
        };
        (i, after, eased)
    }

    /// The keyframes themselves, and the way.
    fn between(&self, frame: f64) -> (&Keyframe, &Keyframe, f64) {
        let (a, b, t) = self.neighbours(frame);
        (&self.keys[a], &self.keys[b], t)
    }

    /// The channel's numbers at a frame; each is interpolated alone.
    pub fn at(&self, frame: f64) -> Vec<f64> {
        let (i, _, t) = self.neighbours(frame);
        let (a, b, _) = self.between(frame);
        if t == 0.0 && std::ptr::eq(a, b) {
            return a.values.clone();
        }
        let h = b.frame - a.frame;
        let u = (frame - a.frame) / h;
        (0..a.values.len().min(b.values.len()))
            .map(|c| {
                let (from, to) = (a.values[c], b.values[c]);
                if a.ease != Ease::Smooth {
                    return from + (to - from) * t;
                }
                let (m0, m1) = (self.slope(i, c), self.slope(i + 1, c));
                let (u2, u3) = (u * u, u * u * u);
                let value = from + (to - from) * (3.0 * u2 - 2.0 * u3) + h * (m0 * (u3 - 2.0 * u2 + u) + m1 * (u3 - u2));
                // Monotone but for rounding.
                value.clamp(from.min(to), from.max(to))
            })
            .collect()
    }

    /// Speed of component `c` at keyframe `i`: that of the parabola through it and its neighbours, limited so that nothing
    /// overshoots (Steffen 1990); 0 at the ends and at extremes.
    fn slope(&self, i: usize, c: usize) -> f64 {
        if i == 0 || i + 1 >= self.keys.len() {
            return 0.0;
        }
        let [a, b, d] = [&self.keys[i - 1], &self.keys[i], &self.keys[i + 1]];
        let (h0, h1) = (b.frame - a.frame, d.frame - b.frame);
        let (s0, s1) = ((b.values[c] - a.values[c]) / h0, (d.values[c] - b.values[c]) / h1);
        if s0 * s1 <= 0.0 || a.ease == Ease::Hold || b.ease == Ease::Hold {
            return 0.0;
        }
        let p = (s0 * h1 + s1 * h0) / (h0 + h1);
        s0.signum() * p.abs().min(2.0 * s0.abs()).min(2.0 * s1.abs())
    }
}

/// The function whose albedo and opacity (or extinction) at every scalar are those of `a` and `b` mixed: linear again between
/// the points of both; steps stay steps.
fn faded(a: &Transfer, b: &Transfer, t: f64) -> Transfer {
    if t == 0.0 {
        return a.clone();
    }
    let mixed = |s, above| {
        let [c, d] = [a, b].map(|f| limit(f.colors(), s, above));
        let [o, p] = [a, b].map(|f| limit(f.opacities(), s, above));
        (c.between(d, t).map(|x| x.clamp(0.0, 1.0)), o.between(p, t))
    };
    let (colors, opacities) = stepped(&[a, b], mixed).into_iter().map(|(s, (c, o))| ((s, c), (s, o))).unzip();
    Transfer::new(colors, opacities, a.kind(), a.reference()).unwrap_or_else(|_| a.clone())
}
