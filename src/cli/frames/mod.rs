//! `frames`: a scene's animation as numbered pictures, resumable, in any order and in any chunks with the same bits.

mod asked;
mod forecast;
mod says;
mod session;
mod store;
mod summary;

use super::Context;
use super::fail::Failure;
use super::fingerprint::{self, Files};
use super::layers::Layers;
use super::report::{Report, many, say};
use super::signals::Signals;
use asked::Asked;
use clap::ArgMatches;
use forecast::{Forecast, needs};
use halflight::error::bytes;
use halflight::io;
use halflight::scene::Scene;
use says::{Mode, Outcome, Sayer, stages};
use serde_json::json;
use session::{Paid, STAGES, Session};
use std::collections::HashSet;
use std::path::Path;
use std::time::Instant;
use summary::{Tally, duration};

/// Frames after which the cost of the rest is said: the first opens the device, the second may compile kernels anew.
const MEASURED: usize = 4;

/// `halflight frames SCENE -o 'out/f.####.exr' --frames 1-100x2`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mode = Mode::of(m.get_one::<String>("progress").map_or("auto", String::as_str), context.json)?;
    rendered(context, m, mode).inspect_err(|failure| {
        let _ = match mode {
            Mode::OpenJd => say(&format!("openjd_fail: {}", failure.sentence)),
            // The last line sums up, also where there is nothing else to sum up.
            Mode::Json if !failure.told => say(&failure.json().to_string()),
            _ => Ok(()),
        };
    })
}

fn rendered(context: &Context, m: &ArgMatches, mode: Mode) -> Result<(), Failure> {
    // Whoever reads JSON, line by line too, reads nothing else.
    let told = context.json || mode == Mode::Json;
    let report = Report::new(told);
    let signals = Signals::listen()?;
    let going = || signals.going();
    let asked = Asked::of(m)?;
    let scenes: Vec<Scene> = asked.frames.iter().map(|&f| asked.scene(f)).collect();
    // Made in vain, it goes again.
    let _folder = asked.folder(&scenes)?;
    let mut run = Run {
        asked: &asked,
        session: Session::new(context, asked.field.clone(), asked.store()?, asked.fresh),
        files: Files::default(),
        scenes,
        forecast: Forecast::default(),
        told: None,
        stale: false,
        tally: Tally::default(),
    };
    run.session.check_given(&asked.frames, &run.scenes, &going)?;
    let mut sayer = Sayer::new(mode, if asked.estimate { sample(asked.frames.len()).len() } else { asked.frames.len() });
    for line in &asked.said {
        sayer.line(line)?;
    }
    let ended = run.frames(&mut sayer, &going);
    drop(sayer);
    let failure = match (signals.failure(), ended) {
        (Some(stopped), _) => Some(Failure::new(stopped.code, stopped.sentence + "; finished frames are kept, --skip-existing goes on")),
        // Where nothing came of any frame it is said as other commands say it.
        (None, Err(failure)) if run.tally.is_empty() => return Err(failure),
        (None, Err(failure)) => Some(failure),
        (None, Ok(())) => run.tally.failure(),
    };
    let failure = failure.or_else(|| run.session.engine().and_then(|engine| context.verdict(engine).err()));
    run.summary(report, failure.as_ref())?;
    failure.map_or(Ok(()), |failure| Err(Failure { told, ..failure }))
}

/// What a failure ends.
enum Ends {
    /// A frame whose own files are bad.
    Frame,
    /// All frames from this one on: a device or a disk that fails one fails the others.
    Rest,
    /// The run, whichever frame it met first.
    Run,
}

struct Run<'a> {
    asked: &'a Asked,
    session: Session<'a>,
    files: Files,
    scenes: Vec<Scene>,
    forecast: Forecast,
    /// What was said beforehand: seconds of all that was then left, when, and how many frames will then have been written.
    told: Option<(f64, Instant, usize)>,
    /// Whether a file that was there was not whole, or of another scene or build.
    stale: bool,
    tally: Tally,
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
                Err((failure, Ends::Run)) => return Err(failure),
                Err((failure, ends)) => {
                    sayer.ends(frame, &path, &Outcome::Failed(&failure.sentence))?;
                    let rest = Failure::new(failure.code, format!("frame {frame}: {}", failure.sentence));
                    self.tally.failed.push((frame, failure));
                    if let Ends::Rest = ends {
                        return Err(rest);
                    }
                }
            }
        }
        Ok(())
    }

    /// Renders and writes a frame; `false` where its file is whole and of this scene already. An error says what it ends.
    fn frame(&mut self, place: usize, path: &Path, going: &dyn Fn() -> bool, paid: &mut Paid) -> Result<bool, (Failure, Ends)> {
        let scene = &self.scenes[place];
        let (frame, first) = (self.asked.frames[place], self.tally.is_empty());
        let own = |f: Failure| {
            let ends = match f.code {
                3 => Ends::Frame,
                // A device that is not there; what the command line says, unless it suited the frames before.
                4 => Ends::Run,
                2 if first => Ends::Run,
                _ => Ends::Rest,
            };
            (f, ends)
        };
        let output = self.asked.output(path).map_err(|f| (f, Ends::Rest))?;
        let (volume, grid) = self.session.volume_hash(scene, going, paid).map_err(own)?;
        let scene = &scene.placed(&grid);
        // Probe and preset are those of all frames.
        let hash = fingerprint::frame(scene, &volume, &mut self.files, &self.asked.written.text()).map_err(|f| (f, Ends::Run))?;
        let rate = self.asked.scene.animation.as_ref().map_or(24.0, |a| a.rate).to_string();
        let mut meta = vec![("frame".to_owned(), frame.to_string()), ("rate".to_owned(), rate.clone()), ("scene_hash".to_owned(), hash)];
        if self.asked.skip && is_whole(path, &meta) {
            return Ok(false);
        }
        self.stale |= self.asked.skip && path.is_file();
        let layers: Layers = self.session.layers(scene, &self.asked.written, going, paid).map_err(|f| match own(f) {
            (f, Ends::Frame) if self.session.given_is_bad => (f, Ends::Run),
            (f, Ends::Frame) if self.session.store().is_some_and(|s| s.broken) => (f, Ends::Rest),
            other => other,
        })?;
        meta.extend([("scene".to_owned(), self.asked.header_text(scene)), ("volume_hash".to_owned(), volume)]);
        if let Some(engine) = self.session.engine() {
            meta.push(("device".into(), format!("{}; {}", engine.device().name, engine.device().driver)));
        }
        meta.push((io::FRAMES_PER_SECOND.into(), rate));
        meta.extend(self.session.camera_meta.iter().chain(&self.session.field_meta).cloned());
        if let Some(why) = &self.session.unseen {
            log::warn!("frame {frame}: {why}");
        }
        paid.time(session::WRITE, || self.asked.written.write(&output, &layers, scene, &meta)).map_err(|f| (f, Ends::Rest))?;
        Ok(true)
    }

    /// What each of these frames, in turn, may pay for.
    fn needs(&self, places: &[usize]) -> Vec<[bool; STAGES.len()]> {
        let scenes: Vec<_> = places.iter().map(|&p| &self.scenes[p]).collect();
        let before = |i: usize| i.checked_sub(1).map(|b| scenes[b]);
        let mut list: Vec<_> = scenes.iter().enumerate().map(|(i, s)| needs(before(i), s, self.asked.written.behind())).collect();
        let mut known = HashSet::new();
        for (n, scene) in list.iter_mut().zip(&scenes).filter(|(n, _)| n[session::VISIBILITY]) {
            if let Some(store) = self.session.store() {
                n[session::FIELDS] = true;
                // Of a volume that is not read yet: where all were found so far, others have computed them.
                let others = || self.session.others_have(scene).unwrap_or(store.found > 0 && store.computed == 0);
                n[session::VISIBILITY] = known.insert(forecast::field_of(scene)) && !others();
            } else if self.asked.field.is_some() {
                n[session::VISIBILITY] = false;
            }
        }
        list
    }

    /// Says what the rest will cost, once enough is known.
    fn tell(&mut self, place: usize, sayer: &Sayer) -> Result<(), Failure> {
        if self.told.is_some() || self.asked.fresh {
            return Ok(());
        }
        // Of what lies ahead, frames whose files are there will be skipped, as far as that can be told without reading them: not
        // where all that were met so far were made by another build, or of another scene.
        let kept = self.asked.skip && !(self.stale && self.tally.skipped == 0);
        let there = |p: usize| kept && self.asked.path(self.asked.frames[p]).is_file();
        let places: Vec<usize> = (0..self.scenes.len()).filter(|&p| p <= place || !there(p)).collect();
        let measured = self.forecast.frames();
        let last = self.asked.estimate && measured == sample(self.scenes.len()).len();
        // Of a few frames, nothing would be left to say it of; of many, what they need is not asked again after each.
        let enough = match places.len() {
            ..=8 => measured >= MEASURED || self.forecast.knows(&self.needs(&places)),
            _ => measured >= MEASURED && measured.is_power_of_two(),
        };
        if !last && (self.asked.estimate || !enough || place + 1 == places.len()) {
            return Ok(());
        }
        let needs = self.needs(&places);
        let (all, rest) = (self.forecast.seconds(&needs), self.forecast.seconds(&needs[place + 1..]));
        let fields = needs[if self.asked.estimate { 0 } else { place + 1 }..].iter().filter(|n| n[session::VISIBILITY]).count();
        let (Some(all), Some(rest)) = (all, rest) else {
            // Only fields can be missing in what each frame pays for.
            let said =
                format!("estimate: none, {} must be computed and those of the frames measured were all found", many(fields, "field"));
            return if last { sayer.line(&said) } else { Ok(()) };
        };
        let left = needs.len() - place - 1;
        self.told = Some((rest, Instant::now(), self.tally.written + left));
        let mut memory = format!("{} of device memory", bytes(self.session.estimate));
        if let Some(store) = self.session.store().filter(|_| fields > 0) {
            memory += &format!(", {} of {} in {}", many(fields, "field"), bytes(store.largest), store.folder.display());
        }
        sayer.line(&match self.asked.estimate {
            true => format!("estimate: {} for {}, {memory}", duration(all), many(needs.len(), "frame")),
            false => format!("estimate: {} more for {}, {memory}", duration(rest), many(left, "frame")),
        })
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

/// Whether a file is there, says all of `meta`, and decodes to its end.
fn is_whole(path: &Path, meta: &[(String, String)]) -> bool {
    path.is_file() && io::whole_picture(path, &|said| meta.iter().all(|m| said.contains(m))).unwrap_or(false)
}
