//! The progress bar, one for a whole command: on stderr when that is a terminal, otherwise nothing.

use super::signals::Signals;
use halflight::Error;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::Instant;

/// The bar that is on the terminal now: other lines must not run into it.
static SHOWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// A command's bar; it vanishes when dropped.
pub struct Progress {
    bar: Option<ProgressBar>,
    start: Instant,
    clock: RefCell<Clock>,
    /// What ends the work.
    signals: Option<Signals>,
}

impl Progress {
    /// A bar over `stages` in order (a name may come again), if anybody would see it.
    pub fn new(stages: &[&'static str]) -> Self {
        let stages = stages.iter().map(|&name| Stage { name, work: 0.0 }).collect();
        let clock = RefCell::new(Clock { stages, at: 0, entered: 0.0, spent: 0.0, fraction: 0.0 });
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{msg:<12} [{bar:32}] {percent:>3} %  {prefix}") {
                bar.set_style(style.progress_chars("=> "));
            }
            bar
        });
        if let Ok(mut shown) = SHOWN.lock() {
            shown.clone_from(&bar);
        }
        Self { bar, start: Instant::now(), clock, signals: None }
    }

    /// No bar: for what is part of a larger whole.
    pub fn silent() -> Self {
        let clock = RefCell::new(Clock { stages: Vec::new(), at: 0, entered: 0.0, spent: 0.0, fraction: 0.0 });
        Self { bar: None, start: Instant::now(), clock, signals: None }
    }

    /// The same, of work that a signal ends.
    pub fn until(mut self, signals: &Signals) -> Self {
        self.signals = Some(signals.clone());
        self
    }

    /// Whether no signal has come.
    pub fn going(&self) -> bool {
        self.signals.as_ref().is_none_or(Signals::going)
    }

    /// A place to stop at: after what a signal may have cut short, and before something is written.
    pub fn check(&self) -> Result<(), Error> {
        if self.going() { Ok(()) } else { Err(Error::Cancelled) }
    }

    /// How much work the long stages are, in any one unit; said before the first of them begins.
    pub fn plan(&self, works: &[(&str, f64)]) {
        for stage in &mut self.clock.borrow_mut().stages {
            if let Some((_, work)) = works.iter().find(|(name, _)| *name == stage.name) {
                stage.work = work.max(0.0);
            }
        }
    }

    /// The next stage of that name begins.
    pub fn enter(&self, name: &str) {
        self.clock.borrow_mut().enter(name, self.start.elapsed().as_secs_f64());
        self.show(0.0);
    }

    /// Shows the fraction done of the present stage, 0..1.
    pub fn show(&self, fraction: f64) {
        let mut clock = self.clock.borrow_mut();
        clock.fraction = fraction.clamp(0.0, 1.0);
        if let Some(bar) = &self.bar {
            let left = clock.left(self.start.elapsed().as_secs_f64());
            bar.set_message(clock.stages.get(clock.at).map_or("", |s| s.name));
            bar.set_prefix(left.map_or_else(String::new, |s| format!("{} left", duration(s))));
            bar.set_position((clock.done() * 1000.0) as u64);
        }
    }

    /// For the engine's jobs, each a stage.
    pub fn job(&self) -> impl FnMut(&'static str, f32) -> ControlFlow<()> + '_ {
        |_, fraction| {
            self.show(f64::from(fraction));
            if self.going() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            show_bar(None);
            bar.finish_and_clear();
        }
    }
}

/// Says which bar is on the terminal now.
pub fn show_bar(bar: Option<&ProgressBar>) {
    if let Ok(mut shown) = SHOWN.lock() {
        *shown = bar.cloned();
    }
}

/// Writes something else to the terminal: the bar steps aside meanwhile.
pub fn around<T>(write: impl FnOnce() -> T) -> T {
    let bar = SHOWN.lock().ok().and_then(|shown| shown.clone());
    match bar {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// Stderr for the log.
pub struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        around(|| std::io::stderr().write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}

struct Stage {
    name: &'static str,
    /// 0: a short stage.
    work: f64,
}

/// What is done, and what is left. Times are seconds since the start.
struct Clock {
    stages: Vec<Stage>,
    at: usize,
    /// When the present stage began.
    entered: f64,
    /// Time that past stages with work took.
    spent: f64,
    /// Of the present stage.
    fraction: f64,
}

impl Clock {
    /// Share of the bar that a short stage has.
    const SHORT: f64 = 0.02;

    fn enter(&mut self, name: &str, now: f64) {
        let from = self.at + usize::from(self.entered > 0.0 || self.fraction > 0.0);
        let next = self.stages.iter().skip(from).position(|s| s.name == name).map_or(self.at, |i| from + i);
        if next > self.at && self.stages[self.at].work > 0.0 {
            self.spent += now - self.entered;
        }
        (self.at, self.entered, self.fraction) = (next, now, 0.0);
    }

    /// Work of all stages, and of those that are past.
    fn works(&self) -> (f64, f64) {
        let sum = |stages: &[Stage]| stages.iter().map(|s| s.work).sum::<f64>();
        (sum(&self.stages), sum(&self.stages[..self.at.min(self.stages.len())]))
    }

    /// Fraction of the whole, 0..1; never falls once the works are known.
    fn done(&self) -> f64 {
        let (all, _) = self.works();
        let short = self.stages.iter().filter(|s| s.work <= 0.0).count() as f64 * Self::SHORT;
        // Without long stages the short ones fill the bar; before they are planned there are no long ones to see.
        let share = |s: &Stage| if s.work > 0.0 { s.work / all * (1.0 - short).max(0.1) } else { Self::SHORT };
        let past: f64 = self.stages.iter().take(self.at).map(share).sum();
        let now = self.stages.get(self.at).map_or(0.0, |s| self.fraction * share(s));
        let whole = if self.stages.len() == 1 { Self::SHORT } else { 1.0 };
        ((past + now) / whole).clamp(0.0, 1.0)
    }

    /// Seconds left of the whole; `None` while too little has been seen.
    fn left(&self, now: f64) -> Option<f64> {
        let stage = self.stages.get(self.at)?;
        let (all, past) = self.works();
        let inside = now - self.entered;
        let seen = stage.work > 0.0 && self.fraction >= 0.02 && inside >= 0.5;
        let done = past + stage.work * self.fraction;
        let time = self.spent + if stage.work > 0.0 { inside } else { 0.0 };
        if done <= 0.02 * all || time < 0.5 || all <= 0.0 {
            return None;
        }
        // The present stage by its own pace where that is known, what follows by the pace so far.
        let pace = time / done;
        let present = if seen { inside * (1.0 - self.fraction) / self.fraction } else { pace * stage.work * (1.0 - self.fraction) };
        let left = present + pace * (all - past - stage.work).max(0.0);
        (left >= 1.0).then_some(left)
    }
}

/// "40 s", "3 min", "2 h 5 min".
pub fn duration(seconds: f64) -> String {
    match seconds.round() as u64 {
        s @ 0..=99 => format!("{s} s"),
        s @ 100..=5999 => format!("{} min", (s + 30) / 60),
        s => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn clock() -> Clock {
        let stage = |name, work| Stage { name, work };
        let stages = vec![stage("read", 0.0), stage("visibility", 90.0), stage("relight", 0.0), stage("render", 10.0)];
        Clock { stages, at: 0, entered: 0.0, spent: 0.0, fraction: 0.0 }
    }

    #[test]
    fn the_whole_never_falls_and_ends_at_one() {
        let mut c = clock();
        let mut last = 0.0;
        for (i, name) in ["read", "visibility", "relight", "render"].into_iter().enumerate() {
            c.enter(name, i as f64);
            for fraction in [0.0, 0.3, 1.0] {
                c.fraction = fraction;
                assert!(c.done() >= last, "{name} {fraction}");
                last = c.done();
            }
        }
        assert!((last - 1.0).abs() < 1e-9);
        c.enter("visibility", 9.0);
        assert_eq!(c.at, 3, "a stage that is past does not come again");
    }

    #[test]
    fn time_left_is_of_the_whole_and_waits_until_it_is_known() {
        let mut c = clock();
        c.enter("read", 0.0);
        c.fraction = 0.9;
        assert_eq!(c.left(30.0), None, "reading says nothing of the work");
        c.enter("visibility", 30.0);
        assert_eq!(c.left(30.0), None);
        c.fraction = 0.01;
        assert_eq!(c.left(31.0), None);
        // A third of 90 took 30 s: 60 s for the rest of it, 10 for the picture.
        c.fraction = 1.0 / 3.0;
        assert!((c.left(60.0).unwrap() - 70.0).abs() < 1e-9);
        c.enter("relight", 120.0);
        assert!((c.left(125.0).unwrap() - 10.0).abs() < 1e-9);
        c.enter("render", 125.0);
        assert!((c.left(125.0).unwrap() - 10.0).abs() < 1e-9);
        // The picture is slower than thought: its own pace counts.
        c.fraction = 0.1;
        assert!((c.left(128.0).unwrap() - 27.0).abs() < 1e-9);
        c.fraction = 0.999;
        assert_eq!(c.left(129.0), None, "no \"0 s left\"");
    }

    #[test]
    fn durations_read_well() {
        let cases = [(1.0, "1 s"), (99.4, "99 s"), (100.0, "2 min"), (3600.0, "60 min"), (7500.0, "2 h 5 min")];
        for (seconds, text) in cases {
            assert_eq!(duration(seconds), text);
        }
    }
}
