//! Table 1 of Ritschel 2007 ("Fast GPU-based Visibility Computation for Natural Illumination of Volume Data Sets"), measured
//! here: memory and setup time of the visibility field at 1:8 to 1:1, time per frame, for direct volume rendering and for
//! an isosurface, printed beside the paper's own figures.
//!
//! `cargo bench --bench paper -- VOLUME [--iso VALUE] [--ratios 8,4,2,1] [--limit SECONDS] [--json FILE]` or
//! `... VOLUME --frames N` for the frame rate of a turning camera, or `... VOLUME --edits N` for the time from a changed transfer
//! function to the picture under its own field. Without VOLUME: something short on the demo volume.

use halflight::engine::{DeviceInfo, DeviceVolume, Engine, Field, Lit, Medium, Options};
use halflight::io::{ReadOptions, read_volume};
use halflight::record::Record;
use halflight::scene::grid::glam::{DMat3, DVec3};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Method, Sampling};
use halflight::scene::{Camera, Grid, ImageSettings, Light, Matter, Picture, Probe, Shading, Surface, Transfer, Visibility, Volume};
use halflight::stages::raymarch::View;
use halflight::stages::twin;
use halflight::{Error, demo};
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

const USAGE: &str = "usage: paper [VOLUME] [--iso VALUE] [--ratios 8,4,2,1] [--limit SECONDS] [--json FILE] [--frames N | --edits N]";

/// The paper's Engine on a GeForce 8800 GTX: ratio, MB, setup seconds (DVR, ISO), frame milliseconds (DVR, ISO).
const PAPER: [(u32, u32, [f64; 2], [f64; 2]); 4] = [
    (8, 4, [2.3, 1.5], [36.1, 9.5]),
    (4, 16, [4.0, 2.6], [40.2, 12.6]),
    (2, 64, [12.3, 7.6], [45.6, 15.7]),
    (1, 256, [70.4, 40.8], [71.2, 17.2]),
];

/// Directions per cell.
const DIRECTIONS: u32 = 400;

type Failure = Box<dyn std::error::Error>;

struct Arguments {
    volume: Option<PathBuf>,
    iso: Option<f64>,
    ratios: Vec<u32>,
    limit: f64,
    json: Option<PathBuf>,
    frames: Option<u32>,
    edits: Option<u32>,
    /// Only whether it runs.
    test: bool,
}

/// `None`: the words are meant for another bench.
fn arguments() -> Result<Option<Arguments>, Failure> {
    let mut a = Arguments { volume: None, iso: None, ratios: Vec::new(), limit: 600.0, json: None, frames: None, edits: None, test: true };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} lacks its value\n{USAGE}"));
        match word.as_str() {
            // What cargo says: bench is measured, anything else is a test.
            "--bench" => a.test = false,
            "--test" => return Ok(Some(Arguments { test: true, ..a })),
            "--iso" => a.iso = Some(value()?.parse().map_err(|e| format!("--iso: {e}"))?),
            "--ratios" => {
                a.ratios =
                    value()?.split(',').map(str::parse).collect::<Result<_, _>>().map_err(|e| format!("--ratios: {e}; e.g. 8,4,2,1"))?
            }
            "--limit" => a.limit = value()?.parse().map_err(|e| format!("--limit: {e}"))?,
            "--json" => a.json = Some(value()?.into()),
            "--frames" => a.frames = Some(value()?.parse().map_err(|e| format!("--frames: {e}"))?),
            "--edits" => a.edits = Some(value()?.parse().map_err(|e| format!("--edits: {e}"))?),
            _ if word.starts_with('-') => return Err(format!("unknown option {word}\n{USAGE}").into()),
            _ if Path::new(&word).exists() || word.contains(['/', '.']) => a.volume = Some(word.into()),
            _ => {
                println!("paper: `{word}` is no file, taken as the filter of another bench");
                return Ok(None);
            }
        }
    }
    if a.frames.is_some() && a.edits.is_some() {
        return Err(format!("--frames and --edits are two benches\n{USAGE}").into());
    }
    if a.ratios.is_empty() {
        a.ratios = if a.volume.is_some() { vec![8, 4, 2, 1] } else { vec![8, 4] };
    }
    Ok(Some(a))
}

/// What is rendered, the same for every row.
struct Scene<'a> {
    engine: &'a Engine,
    grid: Grid,
    volume: DeviceVolume,
    iso: f64,
    light: Light,
    image: ImageSettings,
    repeats: usize,
}

fn settings(ratio: u32) -> Visibility {
    Visibility { method: Method::Hierarchical, sampling: Sampling::Jittered, directions: DIRECTIONS, ratio, ..Visibility::default() }
}

impl<'a> Scene<'a> {
    fn new(engine: &'a Engine, volume: &Volume, iso: Option<f64>, size: (usize, usize), repeats: usize) -> Result<Self, Failure> {
        let [lo, hi] = volume.range().map(f64::from);
        Ok(Self {
            engine,
            grid: *volume.grid(),
            volume: engine.upload(volume)?,
            iso: iso.unwrap_or(lo + 0.8 * (hi - lo)),
            light: Light::from_probe(&Probe::two_colored()),
            image: ImageSettings { width: size.0, height: size.1, ..ImageSettings::default() },
            repeats,
        })
    }

    /// Opacity per voxel over the data's range as bytes: 0 up to 70, 0.15 at 120, 0.6 from 200 on.
    fn dvr(&self) -> Result<Medium, Error> {
        self.dvr_of(1.0)
    }

    /// The same with all opacities times `strength`.
    fn dvr_of(&self, strength: f64) -> Result<Medium, Error> {
        let [lo, hi] = self.volume.range().map(f64::from);
        let point = |byte: f64, alpha: f64| [lo + (hi - lo) * byte / 255.0, 0.8, 0.7, 0.5, strength * alpha];
        let points = [point(70.0, 0.0), point(120.0, 0.15), point(200.0, 0.6)];
        let transfer = Transfer::from_points(&points, Kind::Opacity, Reference::Voxel)?;
        self.engine.classify(&self.volume, &Matter { transfer, surface: None })
    }

    /// The isosurface, shaded as in the paper: the dot product of visibility and light.
    fn surface(&self) -> Result<Medium, Error> {
        let transfer = Transfer::from_points(&[[self.iso, 0.8, 0.7, 0.5, 0.0]], Kind::Opacity, Reference::Voxel)?;
        let surface = Surface { iso: self.iso, shading: Shading::Isotropic, albedo: None };
        self.engine.classify(&self.volume, &Matter { transfer, surface: Some(surface) })
    }

    /// Turned about z through the volume's centre.
    fn camera(&self, degrees: f64) -> Camera {
        let centre = self.grid.centre_world();
        let offset = DMat3::from_rotation_z(degrees.to_radians()) * DVec3::new(1.6, -1.9, 1.1);
        Camera { position: centre + offset * self.grid.longest_side(), target: centre, up: DVec3::Z, fov_degrees: 30.0 }
    }

    fn frame(&self, medium: &Medium, lit: &Lit, degrees: f64) -> Result<Time, Failure> {
        self.shot(medium, lit, degrees, &self.image).map(|(_, time)| time)
    }

    fn shot(&self, medium: &Medium, lit: &Lit, degrees: f64, image: &ImageSettings) -> Result<(Picture, Time), Failure> {
        self.engine.take_timings();
        let start = Instant::now();
        let picture = self.engine.render(medium, lit, &self.camera(degrees), image, &mut |_, _| ControlFlow::Continue(()))?;
        let wall = start.elapsed().as_secs_f64();
        if picture.rgba.iter().all(|p| p[3] == 0.0) {
            return Err("the picture shows nothing: choose another --iso".into());
        }
        Ok((picture, Time { device: device_seconds(self.engine), wall }))
    }

    /// Each kernel once, for some drivers compile at a kernel's first dispatch.
    fn warm_up(&self) -> Result<(), Failure> {
        for medium in [self.dvr()?, self.surface()?] {
            let field = self.engine.precompute(&medium, &settings(8), &mut |_, _| ControlFlow::Continue(()))?;
            self.frame(&medium, &self.engine.relight(&field, &self.light)?, 0.0)?;
        }
        Ok(())
    }
}

/// Seconds.
#[derive(Clone, Copy)]
struct Time {
    /// Between timestamps; `None` where the device has none.
    device: Option<f64>,
    wall: f64,
}

fn device_seconds(engine: &Engine) -> Option<f64> {
    engine.take_timings().iter().map(|s| s.timed.then_some(s.seconds)).sum()
}

fn median(mut times: Vec<Time>) -> Time {
    let mut middle = |key: fn(&Time) -> f64| {
        times.sort_by(|a, b| key(a).total_cmp(&key(b)));
        let n = times.len();
        0.5 * (key(&times[(n - 1) / 2]) + key(&times[n / 2]))
    };
    let device = middle(|t| t.device.unwrap_or(f64::NAN));
    Time { device: (!device.is_nan()).then_some(device), wall: middle(|t| t.wall) }
}

/// The field, or after `limit` seconds how long it would have taken.
fn set_up(scene: &Scene, medium: &Medium, ratio: u32, limit: f64) -> Result<Result<(Field, Time), f64>, Failure> {
    scene.engine.take_timings();
    let start = Instant::now();
    let mut done = 0f32;
    let field = scene.engine.precompute(medium, &settings(ratio), &mut |_, fraction| {
        done = fraction;
        if start.elapsed().as_secs_f64() > limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let wall = start.elapsed().as_secs_f64();
    match field {
        Ok(field) => Ok(Ok((field, Time { device: device_seconds(scene.engine), wall }))),
        Err(Error::Cancelled) => Ok(Err(wall / f64::from(done.max(1e-6)))),
        Err(e) => Err(e.into()),
    }
}

/// A number in at least three digits.
fn digits(x: f64) -> String {
    match x {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        x if x >= 1.0 => format!("{x:.2}"),
        x => format!("{x:.3}"),
    }
}

fn or_dash(x: Option<f64>) -> String {
    x.map_or_else(|| String::from("–"), digits)
}

/// Prints the table, row by row, and returns its rows.
fn table(scene: &Scene, a: &Arguments) -> Result<Vec<Value>, Failure> {
    // What is wrong with the options is said before anything long is begun.
    let media = [("DVR", scene.dvr()?), ("isosurface", scene.surface()?)];
    a.ratios.iter().try_for_each(|&ratio| settings(ratio).check())?;
    println!(
        "| matter | ratio | field MiB | setup s, device | setup s, wall | frame ms, device | frame ms, wall | relight ms, wall | paper: MB | paper: setup s | paper: frame ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let mut rows = Vec::new();
    for (kind, (name, medium)) in media.iter().enumerate() {
        // Ratio and wall seconds of the row before, measured or predicted.
        let mut before: Option<(u32, f64)> = None;
        for &ratio in &a.ratios {
            let cells: usize = scene.grid.field_dims(ratio as usize).iter().product();
            let mebibytes = cells as f64 * 16.0 / f64::from(1 << 20);
            let paper = PAPER.iter().find(|p| p.0 == ratio);
            let paper = paper.map_or_else(|| String::from("| | "), |p| format!("{} | {} | {}", p.1, p.2[kind], p.3[kind]));
            let predicted = before.map(|(r, seconds)| seconds * (f64::from(r) / f64::from(ratio)).powi(3));
            let outcome = match predicted {
                Some(seconds) if seconds > a.limit => Err(seconds),
                _ => set_up(scene, medium, ratio, a.limit)?,
            };
            match outcome {
                Err(seconds) => {
                    println!("| {name} | 1:{ratio} | {} | | skipped: about {} s | | | | {paper} |", digits(mebibytes), digits(seconds));
                    rows.push(json!({ "matter": name, "ratio": ratio, "field_bytes": cells * 16, "skipped_predicted_s": seconds }));
                    before = Some((ratio, seconds));
                }
                Ok((field, setup)) => {
                    let start = Instant::now();
                    let lit = scene.engine.relight(&field, &scene.light)?;
                    let relight = 1e3 * start.elapsed().as_secs_f64();
                    scene.frame(medium, &lit, 0.0)?;
                    let frames: Result<Vec<Time>, Failure> = (0..scene.repeats).map(|_| scene.frame(medium, &lit, 0.0)).collect();
                    let frame = median(frames?);
                    println!(
                        "| {name} | 1:{ratio} | {} | {} | {} | {} | {} | {} | {paper} |",
                        digits(field.bytes() as f64 / f64::from(1 << 20)),
                        or_dash(setup.device),
                        digits(setup.wall),
                        or_dash(frame.device.map(|s| 1e3 * s)),
                        digits(1e3 * frame.wall),
                        digits(relight),
                    );
                    rows.push(json!({
                        "matter": name, "ratio": ratio, "field_bytes": field.bytes(),
                        "setup_device_s": setup.device, "setup_wall_s": setup.wall,
                        "frame_device_s": frame.device, "frame_wall_s": frame.wall, "relight_wall_ms": relight,
                    }));
                    before = Some((ratio, setup.wall));
                }
            }
        }
    }
    println!();
    println!("Wall times hold everything that the call does: for a setup the pyramid, for a frame its copy to the host.");
    println!("Paper: Ritschel 2007, Table 1, Engine, GeForce 8800 GTX; its 256 MB are 256³ cells of 16 bytes.");
    Ok(rows)
}

/// Steps of a frame's rays through the box, and those of them in blocks that hold matter: of every fourth pixel, per pixel
/// of the picture, had no ray ended in the dark.
fn steps(scene: &Scene, medium: &Medium, degrees: f64) -> Result<[f64; 2], Failure> {
    let (distances, blocks, n) = (scene.engine.read_occupancy(medium)?, medium.occupancy().dims(), scene.grid.dims());
    let view = View::new(&scene.grid, &scene.camera(degrees).rays(&scene.grid, scene.image.width, scene.image.height)?);
    let step = scene.grid.voxel_length() as f32;
    let (mut all, mut filled, mut pixels) = (0u64, 0u64, 0u64);
    for j in (0..scene.image.height).step_by(4) {
        for i in (0..scene.image.width).step_by(4) {
            let d = view.direction(i, j);
            let (enter, leave) = twin::box_span(view.origin, d, n);
            pixels += 1;
            let count = ((leave - enter.max(0.0)) / step).ceil().max(0.0) as u64;
            all += count;
            filled += (0..count)
                .filter(|&k| {
                    let p = twin::along(view.origin, d, enter.max(0.0) + (k as f32 + 0.5) * step);
                    let b: [usize; 3] = std::array::from_fn(|a| ((p[a] / 4.0) as usize).min(blocks[a] - 1));
                    distances[b[0] + blocks[0] * (b[1] + blocks[1] * b[2])] == 0
                })
                .count() as u64;
        }
    }
    Ok([all, filled].map(|count| count as f64 / pixels as f64))
}

/// Frames of a camera that turns once about z, with and without leaps over empty blocks, in turns.
fn turn(scene: &Scene, count: u32) -> Result<Value, Failure> {
    let medium = scene.dvr()?;
    // A frame takes the same time whichever way its field was found.
    let sweep = Visibility { method: Method::Sweep, directions: 64, step: 2.0, ..Visibility::default() };
    let field = scene.engine.precompute(&medium, &sweep, &mut |_, _| ControlFlow::Continue(()))?;
    let lit = scene.engine.relight(&field, &scene.light)?;
    let plain = ImageSettings { skip: false, ..scene.image };
    for image in [scene.image, plain] {
        scene.shot(&medium, &lit, 0.0, &image)?;
    }
    let (mut leaping, mut all, mut difference) = (Vec::new(), Vec::new(), 0f32);
    for i in 1..=count.max(1) {
        let degrees = 360.0 * f64::from(i) / f64::from(count.max(1));
        let (a, time) = scene.shot(&medium, &lit, degrees, &scene.image)?;
        leaping.push(time);
        let (b, time) = scene.shot(&medium, &lit, degrees, &plain)?;
        all.push(time);
        difference = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened()).map(|(a, b)| (a - b).abs()).fold(difference, f32::max);
    }
    let (leaping, all) = (median(leaping), median(all));
    let [in_box, in_matter] = steps(scene, &medium, 0.0)?;
    let o = medium.occupancy();
    println!(
        "{} of {} blocks hold matter; {in_box:.1} steps a pixel in the box, {in_matter:.1} of them in such blocks",
        o.occupied(),
        o.dims().iter().product::<usize>()
    );
    for (name, time) in [("leaping over empty blocks", leaping), ("every step", all)] {
        println!(
            "halflight, DVR at 1:4, one voxel per step, {name}: median {} ms/frame wall, {} ms device",
            digits(1e3 * time.wall),
            or_dash(time.device.map(|s| 1e3 * s))
        );
    }
    println!("largest difference of the two pictures: {difference:e}");
    Ok(json!({
        "frames": count, "frame_wall_s": leaping.wall, "frame_device_s": leaping.device,
        "every_step_frame_wall_s": all.wall, "every_step_frame_device_s": all.device, "largest_difference": difference,
        "blocks": o.dims(), "occupied_blocks": o.occupied(), "steps_per_pixel": in_box, "steps_in_matter_per_pixel": in_matter,
    }))
}

/// From a changed transfer function to the picture: classification, field, light and frame, each time with other opacities.
fn edits(scene: &Scene, count: u32) -> Result<Vec<Value>, Failure> {
    println!(
        "| field | field MiB | classified and computed ms, wall | lit and rendered ms, wall | together ms, wall | together ms, device |"
    );
    println!("|---|---|---|---|---|---|");
    let sweep = |ratio, directions, near, step, fit| Visibility {
        method: Method::Sweep,
        ratio,
        directions,
        near,
        step,
        fit,
        ..Visibility::default()
    };
    let fields = [
        ("sweep N = 64, near 1, step 2", sweep(4, 64, 1, 2.0, 0)),
        ("sweep N = 128, near 2, step 1", sweep(4, 128, 2, 1.0, 0)),
        ("sweep N = 128, near 1, step 1, fit = 8", sweep(4, 128, 1, 1.0, 8)),
        ("sweep N = 128, near 1, step 1, fit = 8", sweep(2, 128, 1, 1.0, 8)),
        ("sweep N = 64, near 1, step 1", sweep(1, 64, 1, 1.0, 0)),
    ];
    let mut rows = Vec::new();
    for (name, settings) in fields {
        let (mut all, mut computed, mut bytes) = (Vec::new(), Vec::new(), 0);
        // The first of each warms up.
        for i in 0..=count.max(1) {
            scene.engine.take_timings();
            let start = Instant::now();
            let medium = scene.dvr_of(0.9 + 0.05 * f64::from(i % 5))?;
            let field = scene.engine.precompute(&medium, &settings, &mut |_, _| ControlFlow::Continue(()))?;
            let wall = start.elapsed().as_secs_f64();
            let lit = scene.engine.relight(&field, &scene.light)?;
            let progress = &mut |_: &'static str, _: f32| ControlFlow::Continue(());
            let picture = scene.engine.render(&medium, &lit, &scene.camera(0.0), &scene.image, progress)?;
            let together = Time { device: device_seconds(scene.engine), wall: start.elapsed().as_secs_f64() };
            if picture.rgba.iter().all(|p| p[3] == 0.0) {
                return Err("the picture shows nothing".into());
            }
            bytes = field.bytes();
            if i > 0 {
                computed.push(Time { device: None, wall });
                all.push(together);
            }
        }
        let (computed, all) = (median(computed), median(all));
        println!(
            "| {name}, 1:{} | {} | {} | {} | {} | {} |",
            settings.ratio,
            digits(bytes as f64 / f64::from(1 << 20)),
            digits(1e3 * computed.wall),
            digits(1e3 * (all.wall - computed.wall)),
            digits(1e3 * all.wall),
            or_dash(all.device.map(|s| 1e3 * s)),
        );
        rows.push(json!({
            "matter": format!("DVR edited, {name}"), "ratio": settings.ratio, "field_bytes": bytes,
            "computed_wall_s": computed.wall, "edit_wall_s": all.wall, "edit_device_s": all.device,
        }));
    }
    Ok(rows)
}

/// Every time of the result, by row and key.
fn record(device: &DeviceInfo, volume: &str, result: &Value) -> Record {
    let mut record = Record::new("paper", device);
    let rows = result.as_array().cloned().unwrap_or_else(|| vec![result.clone()]);
    for row in rows.iter().filter_map(Value::as_object) {
        let matter = row.get("matter").and_then(Value::as_str).unwrap_or("DVR");
        let ratio = row.get("ratio").and_then(Value::as_u64).unwrap_or(4);
        for (key, value) in row {
            let unit = if key.ends_with("_ms") { "ms" } else { "s" };
            if let (Some(value), true) = (value.as_f64(), key.ends_with("_s") || key.ends_with("_ms")) {
                record.add(format!("{volume}, {matter}, 1:{ratio}, {key}"), unit, vec![value]);
            }
        }
    }
    record
}

fn run() -> Result<(), Failure> {
    let Some(mut a) = arguments()? else { return Ok(()) };
    let (name, volume, size, repeats) = match &a.volume {
        Some(path) => {
            let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
            (name, read_volume(path, &ReadOptions::default())?, (1024, 768), 5)
        }
        None if a.test => (String::from("the demo volume"), demo::volume(32)?, (64, 48), 1),
        None => (String::from("the demo volume"), demo::volume(64)?, (512, 384), 5),
    };
    if a.test && a.volume.is_none() {
        a.ratios = vec![8];
    }
    let engine = Engine::new(&Options::default())?;
    Scene::new(&engine, &demo::volume(16)?, None, (16, 16), 1)?.warm_up()?;
    let scene = Scene::new(&engine, &volume, a.iso, size, repeats)?;
    let (info, d) = (engine.device(), scene.grid.dims());
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    println!("halflight {}; {}; {}; {cores} processor cores", env!("CARGO_PKG_VERSION"), info.name, info.driver);
    let how = match a.frames.or(a.edits) {
        Some(count) => format!("pictures of {}x{}, median of {count}", size.0, size.1),
        None => format!(
            "{DIRECTIONS} directions, hierarchical, jittered; pictures of {}x{}, median of {repeats}; iso {}",
            size.0, size.1, scene.iso
        ),
    };
    println!("{name}, {}x{}x{} voxels; {how}", d[0], d[1], d[2]);
    println!();
    let result = match (a.frames, a.edits) {
        (Some(count), _) => turn(&scene, count)?,
        (None, Some(count)) => Value::Array(edits(&scene, count)?),
        (None, None) => Value::Array(table(&scene, &a)?),
    };
    if !a.test {
        let path = record(info, &name, &result).write(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/benches/records")))?;
        println!("wrote {}", path.display());
    }
    if let Some(path) = &a.json {
        let text = json!({
            "halflight": env!("CARGO_PKG_VERSION"), "device": info.name, "driver": info.driver, "cores": cores,
            "volume": name, "dims": d, "directions": DIRECTIONS, "width": size.0, "height": size.1, "iso": scene.iso,
            if a.frames.is_some() { "turn" } else { "rows" }: result,
        });
        std::fs::write(path, format!("{text:#}\n")).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}
