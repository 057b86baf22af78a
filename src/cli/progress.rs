//! The progress bar: on stderr when that is a terminal, otherwise nothing.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::ops::ControlFlow;

/// A job's bar; it vanishes when dropped.
pub struct Progress(Option<ProgressBar>);

impl Progress {
    /// A bar, if anybody would see it.
    pub fn new() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(None);
        }
        let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{msg:<12} [{bar:32}] {percent:>3} %  {eta} left") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(Some(bar))
    }

    /// Shows `stage` and the fraction done of the whole job, 0..1.
    pub fn show(&self, stage: &'static str, fraction: f64) {
        if let Some(bar) = &self.0 {
            bar.set_message(stage);
            bar.set_position((fraction.clamp(0.0, 1.0) * 1000.0) as u64);
        }
    }

    /// For the engine's jobs; never asks them to stop.
    pub fn job(&self) -> impl FnMut(&'static str, f32) -> ControlFlow<()> + '_ {
        |stage, fraction| {
            self.show(stage, f64::from(fraction));
            ControlFlow::Continue(())
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
