//! `frames`: a scene's animation as numbered pictures, resumable, in any order and in any chunks with the same bits.

use super::args_keys::{OF_FRAMES, check_used, overrides};
use super::fail::Failure;
use super::fingerprint::{self, Files};
use super::forecast::{Forecast, needs};
use super::frames_says::{Mode, Outcome, Sayer, stages};
use super::layers::{Layers, Written};
use super::output::{Folder, Output, PICTURES};
use super::session::{Paid, STAGES, Session};
use super::{Context, load, path_of};
use clap::ArgMatches;
use halflight::error::{bytes, shown};
use halflight::io;
use halflight::scene::frames::{Pattern, frames_text, parse_frames};
use halflight::scene::scene::{LightSource, TransferSource};
use halflight::scene::visibility::{Method, Visibility};
use halflight::scene::{Scene, scene_at};
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// Frames after which the cost of the rest is said, at most.
const MEASURED: usize = 3;

/// Longest side of a preview, pixels.
const QUICK_SIDE: usize = 320;

/// `halflight frames SCENE -o 'out/f.####.exr' --frames 1-100x2`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mode = Mode::of(m.get_one::<String>("progress").map_or("auto", String::as_str), context.json);
    rendered(context, m, mode).inspect_err(|failure| {
        if mode == Mode::OpenJd {
            let _ = super::report::say(&format!("openjd_fail: {}", failure.sentence));
        }
    })
}

fn rendered(context: &Context, m: &ArgMatches, mode: Mode) -> Result<(), Failure> {
    let signal = listen()?;
    let asked = Asked::of(m)?;
    let mut sayer = Sayer::new(mode, asked.frames.len());
    for line in &asked.said {
        sayer.line(line)?;
    }
    // Made in vain, it goes again.
    let _folder = Folder::make(asked.path(asked.frames[0]).parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
    let mut run = Run {
        asked: &asked,
        session: Session::new(context, asked.field.clone(), asked.fresh),
        files: Files::default(),
        scenes: asked.frames.iter().map(|&f| asked.scene(f)).collect(),
        forecast: Forecast::default(),
        told: None,
        tally: Tally::default(),
        start: Instant::now(),
    };
    let going = || signal.load(Ordering::Relaxed) == 0;
    let ended = run.frames(&mut sayer, &going);
    drop(sayer);
    let caught = signal.load(Ordering::Relaxed);
    let failure = match ended {
        _ if caught != 0 => Some(Failure {
            code: 128 + caught as u8,
            sentence: format!(
                "stopped by {}; finished frames are kept, --skip-existing goes on",
                if caught == SIGINT as usize { "SIGINT" } else { "SIGTERM" }
            ),
        }),
        Err(failure) => Some(failure),
        Ok(()) => run.tally.failed.first().map(|(frame, f)| Failure {
            code: f.code,
            sentence: match run.tally.failed.len() {
                1 => format!("frame {frame} failed: {}", f.sentence),
                n => format!("{n} frames failed, the first of them {frame}: {}", f.sentence),
            },
        }),
    };
    run.summary(context, failure.as_ref())?;
    if let (Some(engine), None) = (run.session.engine(), &failure) {
        context.verdict(engine)?;
    }
    failure.map_or(Ok(()), Err)
}

/// The signal that came, 0 for none. A second one ends the process at once.
fn listen() -> Result<Arc<AtomicUsize>, Failure> {
    let (signal, again) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
    for number in [SIGINT, SIGTERM] {
        let register = || {
            signal_hook::flag::register_conditional_shutdown(number, 128 + number, again.clone())?;
            signal_hook::flag::register(number, again.clone())?;
            signal_hook::flag::register_usize(number, signal.clone(), number as usize)
        };
        register().map_err(|e| Failure { code: 1, sentence: format!("signals cannot be listened to: {e}") })?;
    }
    Ok(signal)
}

/// What the command line asks for.
struct Asked {
    scene: Scene,
    /// The scene's folder: files in it are named relative to it, wherever the command runs.
    folder: PathBuf,
    frames: Vec<i64>,
    out: PathBuf,
    pattern: Option<Pattern>,
    written: Written,
    field: Option<PathBuf>,
    skip: bool,
    fresh: bool,
    quick: bool,
    estimate: bool,
    said: Vec<String>,
}

impl Asked {
    fn of(m: &ArgMatches) -> Result<Self, Failure> {
        let path = path_of(m, "scene")?;
        let overrides = overrides(m).map_err(Failure::usage)?;
        check_used(&overrides, OF_FRAMES, "frames").map_err(Failure::usage)?;
        let scene = load::scene(path, &overrides)?;
        let Some(animation) = &scene.animation else {
            let right = "write [animation] with frames = N and [[animation.keyframe]] tables, or use halflight render";
            return Err(Failure::usage(format!("{}: it has no [animation]; {right}", shown(path))));
        };
        let range = animation.range();
        let frames = match m.get_one::<String>("frames") {
            Some(text) => parse_frames(text).map_err(|e| Failure::usage(e.to_string()))?,
            None => range.clone().collect(),
        };
        if let Some(frame) = frames.iter().find(|f| !range.contains(f)) {
            return Err(Failure::usage(format!(
                "frame {frame} lies outside the animation, which has {} to {}; change animation.frames or --frames",
                range.start(),
                range.end()
            )));
        }
        let field = m.get_one::<PathBuf>("field").cloned();
        if scene.wanted.is_some() && field.is_none() {
            return Err(Failure::usage(
                "a tolerance or quality picks settings by measuring time, and frames would differ from run to run; \
                 write the settings that halflight precompute says it chose, or give its file as --field",
            ));
        }
        let out = path_of(m, "out")?.to_owned();
        let pattern = Pattern::find(&out);
        if pattern.is_none() && frames.len() > 1 {
            let right = "give the number a place, such as f.####.exr or f.%04d.exr";
            return Err(Failure::usage(format!("{}: {} frames would all be written here; {right}", shown(&out), frames.len())));
        }
        let mut asked = Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            written: Written::of(m, &out)?,
            scene,
            frames,
            out,
            pattern,
            field,
            skip: m.get_flag("skip-existing"),
            fresh: m.get_flag("no-reuse"),
            quick: m.get_flag("quick"),
            estimate: m.get_flag("estimate"),
            said: Vec::new(),
        };
        if asked.quick {
            asked.quicken()?;
        }
        Ok(asked)
    }

    /// A preview: a smaller picture, a coarser field of fewer directions. Says so.
    fn quicken(&mut self) -> Result<(), Failure> {
        if self.field.is_some() {
            return Err(Failure::usage("--quick computes its own field; drop --field"));
        }
        let image = &mut self.scene.image;
        let long = image.width.max(image.height);
        if long > QUICK_SIDE {
            let side = |n: usize| (n * QUICK_SIDE / long).max(1);
            (image.width, image.height) = (side(image.width), side(image.height));
        }
        let v = &self.scene.visibility;
        self.scene.visibility =
            Visibility { method: Method::Sweep, ratio: 8, directions: 32, near: 1, step: 2.0, sampling: Default::default(), ..v.clone() };
        self.said.push(format!(
            "preview: {}x{} pixels, a field at 1:8 swept in 32 directions; without --quick it is as the scene says",
            image.width, image.height
        ));
        Ok(())
    }

    fn path(&self, frame: i64) -> PathBuf {
        self.pattern.as_ref().map_or_else(|| self.out.clone(), |p| p.path(frame))
    }

    fn scene(&self, frame: i64) -> Scene {
        scene_at(&self.scene, frame)
    }

    /// The scene as a header holds it: files in the scene's folder by their names in it.
    fn header_text(&self, scene: &Scene) -> String {
        let near = |path: &mut PathBuf| {
            if let Ok(rest) = path.strip_prefix(&self.folder) {
                *path = rest.to_owned();
            }
        };
        let mut scene = scene.clone();
        near(&mut scene.volume.file);
        if let LightSource::Probe(path) = &mut scene.light.source {
            near(path);
        }
        if let TransferSource::File { path, .. } = &mut scene.transfer {
            near(path);
        }
        io::scene_text(&scene)
    }
}

/// What came of the frames.
#[derive(Default)]
struct Tally {
    written: usize,
    skipped: usize,
    failed: Vec<(i64, Failure)>,
    paid: Paid,
    list: Vec<serde_json::Value>,
}

struct Run<'a> {
    asked: &'a Asked,
    session: Session<'a>,
    files: Files,
    scenes: Vec<Scene>,
    forecast: Forecast,
    /// What was said beforehand: seconds of all that was then left, and when.
    told: Option<(f64, Instant, usize)>,
    tally: Tally,
    start: Instant,
}

impl Run<'_> {
    /// Frame after frame. What is wrong with one frame's own files ends that frame; all else ends the run.
    fn frames(&mut self, sayer: &mut Sayer, going: &dyn Fn() -> bool) -> Result<(), Failure> {
        let order = if self.asked.estimate { sample(self.scenes.len()) } else { (0..self.scenes.len()).collect() };
        for place in order {
            if !going() {
                return Ok(());
            }
            let (frame, path) = (self.asked.frames[place], self.asked.path(self.asked.frames[place]));
            sayer.begins(frame)?;
            let mut paid = Paid::default();
            match self.frame(place, &path, going, &mut paid) {
                Ok(true) => {
                    self.tally.written += 1;
                    for (sum, s) in self.tally.paid.0.iter_mut().zip(paid.0) {
                        *sum = if sum.is_none() { s } else { sum.map(|a| a + s.unwrap_or(0.0)) };
                    }
                    self.tally.list.push(json!({ "frame": frame, "seconds": paid.seconds(), "stages": stages(&paid) }));
                    sayer.ends(frame, &path, &Outcome::Written(&paid))?;
                    self.forecast.measured(&paid);
                    self.tell(place, sayer)?;
                }
                Ok(false) => {
                    self.tally.skipped += 1;
                    sayer.ends(frame, &path, &Outcome::Skipped)?;
                }
                Err(_) if !going() => return Ok(()),
                Err((failure, own)) => {
                    sayer.ends(frame, &path, &Outcome::Failed(&failure.sentence))?;
                    let (code, sentence) = (failure.code, failure.sentence.clone());
                    self.tally.failed.push((frame, failure));
                    if !own {
                        return Err(Failure { code, sentence: format!("frame {frame}: {sentence}") });
                    }
                }
            }
        }
        Ok(())
    }

    /// Renders and writes a frame; `false` where its file is whole and of this scene already. An error says whether it is
    /// of this frame alone.
    fn frame(&mut self, place: usize, path: &Path, going: &dyn Fn() -> bool, paid: &mut Paid) -> Result<bool, (Failure, bool)> {
        let scene = &self.scenes[place];
        // Scenes fail by their own files; a device or a disk that fails one frame fails all.
        let own = |f: Failure| {
            let own = f.code == 3;
            (f, own)
        };
        let output = Output::check(path, PICTURES).map_err(|f| (f, false))?;
        let (_, volume) = self.session.volume(scene, paid).map_err(own)?;
        let hash = fingerprint::frame(scene, &volume, &mut self.files, &self.asked.written.text()).map_err(own)?;
        if self.asked.skip && is_whole(path, &hash) {
            return Ok(false);
        }
        let layers: Layers = self.session.layers(scene, &self.asked.written, going, paid).map_err(own)?;
        let animation = self.asked.scene.animation.as_ref();
        let mut meta = vec![
            ("scene".to_owned(), self.asked.header_text(scene)),
            ("frame".to_owned(), self.asked.frames[place].to_string()),
            ("rate".to_owned(), animation.map_or(24.0, |a| a.rate).to_string()),
            ("scene_hash".to_owned(), hash),
            ("volume_hash".to_owned(), volume),
        ];
        if let Some(engine) = self.session.engine() {
            meta.push(("device".into(), format!("{}; {}", engine.device().name, engine.device().driver)));
        }
        meta.extend(self.session.field_meta.iter().cloned());
        paid.time(7, || self.asked.written.write(&output, &layers, scene, &meta)).map_err(|f| (f, false))?;
        Ok(true)
    }

    /// What each frame may pay for.
    fn needs(&self) -> Vec<[bool; STAGES.len()]> {
        let before = |i: usize| i.checked_sub(1).map(|b| &self.scenes[b]);
        self.scenes.iter().enumerate().map(|(i, s)| needs(before(i), s, self.asked.written.behind())).collect()
    }

    /// Says what the rest will cost, once enough is known.
    fn tell(&mut self, place: usize, sayer: &Sayer) -> Result<(), Failure> {
        if self.told.is_some() || self.asked.fresh {
            return Ok(());
        }
        let needs = self.needs();
        let last = self.asked.estimate && self.forecast.frames() == sample(self.scenes.len()).len();
        if !last && (self.asked.estimate || (self.forecast.frames() < MEASURED && !self.forecast.knows(&needs)) || place + 1 == needs.len())
        {
            return Ok(());
        }
        let (all, rest) = (self.forecast.seconds(&needs), self.forecast.seconds(&needs[place + 1..]));
        let (Some(all), Some(rest)) = (all, rest) else { return Ok(()) };
        self.told = Some((rest, Instant::now(), self.tally.written + self.tally.skipped));
        let memory = bytes(self.session.estimate);
        sayer.line(&match self.asked.estimate {
            true => format!("estimate: {} for {} frames, {memory} of device memory", duration(all), needs.len()),
            false => format!("estimate: {} more for what is left, {memory} of device memory", duration(rest)),
        })
    }

    /// How many frames, how long, how far off the estimate was.
    fn summary(&self, context: &Context, failure: Option<&Failure>) -> Result<(), Failure> {
        let (tally, seconds) = (&self.tally, self.start.elapsed().as_secs_f64());
        let mut report = context.report();
        let each = if tally.written > 0 { tally.paid.seconds() / tally.written as f64 } else { 0.0 };
        let mut text = format!("{} written in {}, {each:.2} s each", tally.written, duration(seconds));
        if tally.skipped > 0 {
            text += &format!("; {} were whole already", tally.skipped);
        }
        let left = self.asked.frames.len() - tally.written - tally.skipped - tally.failed.len();
        if left > 0 && !self.asked.estimate {
            text += &format!("; {left} not begun or not finished");
        }
        report.line("frames", text);
        if !tally.failed.is_empty() {
            let frames: Vec<i64> = tally.failed.iter().map(|f| f.0).collect();
            report.line("failed", frames_text(&frames));
        }
        if tally.written > 0 {
            report.line("stages", tally.paid.text());
        }
        if let Some(engine) = self.session.engine() {
            let memory = engine.memory();
            report.line("memory", format!("{} at most, {} said beforehand", bytes(memory.peak), bytes(self.session.estimate)));
            report.set("memory", json!({ "peak": memory.peak, "estimate": self.session.estimate }));
        }
        if let Some((rest, when, before)) = self.told.filter(|_| failure.is_none() && !self.asked.estimate)
            && tally.written + tally.skipped > before
        {
            let took = when.elapsed().as_secs_f64();
            let off = 100.0 * (rest / took - 1.0);
            report.line("estimate", format!("was {} for what took {}: {:+.0} %", duration(rest), duration(took), off));
            report.set("estimate", json!({ "seconds": rest, "took": took }));
        }
        if let (true, Some((..))) = (self.asked.estimate, self.told) {
            let needs = self.needs();
            report.set("estimate", json!({ "seconds": self.forecast.seconds(&needs), "memory": self.session.estimate }));
        }
        report.set("written", json!(tally.written));
        report.set("skipped", json!(tally.skipped));
        report
            .set("failed", tally.failed.iter().map(|(frame, f)| json!({ "frame": frame, "error": f.sentence, "code": f.code })).collect());
        report.set("stages", stages(&tally.paid));
        report.set("frames", json!(tally.list));
        // A failure ends as one JSON object of its own.
        if failure.is_some() && context.json { Ok(()) } else { report.finish() }
    }
}

/// Places that an estimate measures: the first two, which differ by what is paid once, one in the middle and the last.
fn sample(count: usize) -> Vec<usize> {
    let mut places = vec![0, 1, count / 2, count.saturating_sub(1)];
    places.retain(|p| *p < count);
    places.sort_unstable();
    places.dedup();
    places
}

/// Whether a file is there, of this scene, and decodes to its end.
fn is_whole(path: &Path, hash: &str) -> bool {
    path.is_file() && io::whole_picture(path, &|meta| meta.iter().any(|(k, v)| k == "scene_hash" && v == hash)).unwrap_or(false)
}

/// "3.4 s", "12 min", "2 h 5 min".
fn duration(seconds: f64) -> String {
    if seconds < 99.5 { format!("{seconds:.1} s") } else { super::progress::duration(seconds) }
}
