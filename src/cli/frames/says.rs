//! What `frames` says while it works: a bar for people, lines for logs, what Open Job Description listens to, or JSON.

use super::session::{Paid, STAGES};
use crate::cli::fail::Failure;
use crate::cli::report::say;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Map, json};
use std::io::IsTerminal;
use std::path::Path;

/// How progress is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    Tty,
    Lines,
    OpenJd,
    Json,
    None,
}

impl Mode {
    /// The mode of a word; `auto` is a bar where somebody sees it, and lines elsewhere. `--json` leaves room for nothing else.
    pub fn of(word: &str, json: bool) -> Result<Self, Failure> {
        if json && !["auto", "none"].contains(&word) {
            let right = "--progress json writes one object a frame, without --json";
            return Err(Failure::usage(format!(
                "--json prints one object at the end and nothing beside it; drop --progress {word} ({right})"
            )));
        }
        Ok(match word {
            "tty" => Self::Tty,
            "lines" => Self::Lines,
            "openjd" => Self::OpenJd,
            "json" => Self::Json,
            "none" => Self::None,
            _ if json => Self::None,
            _ if std::io::stderr().is_terminal() => Self::Tty,
            _ => Self::Lines,
        })
    }
}

/// What became of a frame.
pub enum Outcome<'a> {
    Written(&'a Paid),
    Skipped,
    Failed(&'a str),
}

/// Says what becomes of each frame.
pub struct Sayer {
    mode: Mode,
    count: usize,
    done: usize,
    bar: Option<ProgressBar>,
}

impl Sayer {
    pub fn new(mode: Mode, count: usize) -> Self {
        let bar = (mode == Mode::Tty).then(|| {
            let bar = ProgressBar::with_draw_target(Some(count as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{msg:<12} [{bar:32}] {pos}/{len}  {eta} left") {
                bar.set_style(style.progress_chars("=> "));
            }
            crate::cli::progress::show_bar(Some(&bar));
            bar
        });
        Self { mode, count, done: 0, bar }
    }

    /// A frame begins.
    pub fn begins(&self, frame: i64) -> Result<(), Failure> {
        if let Some(bar) = &self.bar {
            bar.set_message(format!("frame {frame}"));
        }
        match self.mode {
            Mode::OpenJd => say(&format!("openjd_status: frame {frame}, {} of {}", self.done + 1, self.count)),
            _ => Ok(()),
        }
    }

    /// A line that is of no frame.
    pub fn line(&self, text: &str) -> Result<(), Failure> {
        match self.mode {
            Mode::Tty | Mode::Lines | Mode::OpenJd => say(text),
            Mode::Json => say(&json!({ "note": text }).to_string()),
            Mode::None => Ok(()),
        }
    }

    /// A frame is done with.
    pub fn ends(&mut self, frame: i64, path: &Path, outcome: &Outcome) -> Result<(), Failure> {
        self.done += 1;
        if let Some(bar) = &self.bar {
            bar.set_position(self.done as u64);
        }
        let percent = 100.0 * self.done as f64 / self.count.max(1) as f64;
        if self.mode == Mode::Json {
            let mut object = Map::new();
            object.insert("frame".into(), json!(frame));
            object.insert("file".into(), json!(path.display().to_string()));
            object.insert("done".into(), json!(percent / 100.0));
            match outcome {
                Outcome::Written(paid) => {
                    object.insert("seconds".into(), json!(paid.seconds()));
                    object.insert("stages".into(), stages(paid));
                }
                Outcome::Skipped => drop(object.insert("skipped".into(), json!(true))),
                Outcome::Failed(why) => drop(object.insert("error".into(), json!(why))),
            }
            return say(&serde_json::Value::Object(object).to_string());
        }
        let text = match outcome {
            Outcome::Written(paid) => format!("{:.2} s: {}", paid.seconds(), paid.text()),
            Outcome::Skipped => format!("{} is whole and of this scene, kept", path.display()),
            Outcome::Failed(why) => format!("failed: {why}"),
        };
        self.line(&format!("frame {frame:>4} ({}/{}) {text}", self.done, self.count))?;
        if self.mode == Mode::OpenJd {
            say(&format!("openjd_progress: {percent:.1}"))?;
        }
        Ok(())
    }
}

impl Drop for Sayer {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            crate::cli::progress::show_bar(None);
            bar.finish_and_clear();
        }
    }
}

/// Seconds by stage.
pub fn stages(paid: &Paid) -> serde_json::Value {
    let pairs = STAGES.iter().zip(paid.0).filter_map(|(name, s)| Some(((*name).to_owned(), json!(s?))));
    serde_json::Value::Object(pairs.collect())
}
