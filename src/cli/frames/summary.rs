//! What came of the frames, said at the end.

use super::Run;
use super::says::stages;
use super::session::Paid;
use crate::cli::fail::Failure;
use crate::cli::report::Report;
use halflight::error::bytes;
use halflight::scene::frames::frames_text;
use serde_json::json;

/// What came of the frames.
#[derive(Default)]
pub struct Tally {
    pub written: usize,
    pub skipped: usize,
    pub failed: Vec<(i64, Failure)>,
    pub paid: Paid,
    pub list: Vec<serde_json::Value>,
}

impl Tally {
    /// Whether nothing came of any frame.
    pub fn is_empty(&self) -> bool {
        self.written + self.skipped + self.failed.len() == 0
    }

    /// What a run ends with whose frames fail by their own files.
    pub fn failure(&self) -> Option<Failure> {
        let (frame, first) = self.failed.first()?;
        let sentence = match self.failed.len() {
            1 => format!("frame {frame} failed: {}", first.sentence),
            n => format!("{n} frames failed, the first of them {frame}: {}", first.sentence),
        };
        Some(Failure::new(first.code, sentence))
    }
}

impl Run<'_> {
    /// How many frames, how long, how far off the estimate was.
    pub fn summary(&self, mut report: Report, failure: Option<&Failure>) -> Result<(), Failure> {
        let (tally, seconds) = (&self.tally, report.seconds());
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
        if let Some(store) = self.session.store() {
            report.line("fields", store.text());
            report.set("fields", store.json());
        }
        // Where others wrote some meanwhile, or a file that was there was not whole, it was an estimate of something else.
        if let Some((rest, when, _)) =
            self.told.filter(|(.., written)| failure.is_none() && !self.asked.estimate && tally.written == *written)
        {
            let took = when.elapsed().as_secs_f64();
            let off = 100.0 * (rest / took - 1.0);
            report.line("estimate", format!("was {} for what took {}: {:+.0} %", duration(rest), duration(took), off));
            report.set("estimate", json!({ "seconds": rest, "took": took }));
        }
        if let (true, Some((..))) = (self.asked.estimate, self.told) {
            let needs = self.needs(&(0..self.scenes.len()).collect::<Vec<_>>());
            report.set("estimate", json!({ "seconds": self.forecast.seconds(&needs), "memory": self.session.estimate }));
        }
        report.set("written", json!(tally.written));
        report.set("skipped", json!(tally.skipped));
        report
            .set("failed", tally.failed.iter().map(|(frame, f)| json!({ "frame": frame, "error": f.sentence, "code": f.code })).collect());
        report.set("stages", stages(&tally.paid));
        report.set("frames", json!(tally.list));
        if let Some(failure) = failure {
            report.set("error", json!(failure.sentence));
            report.set("code", json!(failure.code));
        }
        report.finish()
    }
}

/// "3.4 s", "12 min", "2 h 5 min".
pub fn duration(seconds: f64) -> String {
    if seconds < 99.5 { format!("{seconds:.1} s") } else { crate::cli::progress::duration(seconds) }
}
