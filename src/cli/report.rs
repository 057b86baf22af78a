//! What the command says: lines for people, or one JSON object. A reader that has gone away is no error.

use super::fail::Failure;
use super::progress::around;
use halflight::engine::{Engine, Span};
use halflight::error::{bytes, shown};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Collects what a command has to say; both forms side by side.
pub struct Report {
    json: bool,
    start: Instant,
    lines: Vec<String>,
    object: Map<String, Value>,
    written: Vec<String>,
}

impl Report {
    /// A report of a command that starts now.
    pub fn new(json: bool) -> Self {
        Self { json, start: Instant::now(), lines: Vec::new(), object: Map::new(), written: Vec::new() }
    }

    /// Seconds since the command started.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// A line for people: what, and its value.
    pub fn line(&mut self, what: &str, value: impl AsRef<str>) {
        self.lines.push(format!("{what:<10} {}", value.as_ref()));
    }

    /// A line as it stands.
    pub fn text(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }

    /// Notes that an output file stands, whatever comes after.
    pub fn wrote(&mut self, path: &Path) {
        self.line("wrote", format!("{} after {:.1} s", path.display(), self.seconds()));
        self.written.push(shown(path));
    }

    /// A member of the JSON object.
    pub fn set(&mut self, key: &str, value: Value) {
        self.object.insert(key.into(), value);
    }

    /// Says so far collected lines now, before long work; JSON waits for the end.
    pub fn flush(&mut self) -> Result<(), Failure> {
        if self.json {
            return Ok(());
        }
        let lines: Vec<String> = self.lines.drain(..).collect();
        lines.iter().try_for_each(|line| say(line)).map_err(|f| self.with_written(f))
    }

    /// The device, and what it may use.
    pub fn device(&mut self, engine: &Engine) {
        let device = engine.device();
        self.line("device", format!("{} ({})", device.name, device.driver));
        self.set("device", json!({ "name": device.name, "driver": device.driver }));
    }

    /// What the work will need of the device's memory, before it starts.
    pub fn needs(&mut self, engine: &Engine, needs: u64) {
        let memory = engine.memory();
        self.line("memory", format!("needs about {} of {}", bytes(needs), bytes(memory.budget)));
        self.set("memory_estimate", json!(needs));
    }

    /// Peak memory and the time of each kernel.
    pub fn work(&mut self, engine: &Engine, spans: &[Span]) {
        let memory = engine.memory();
        self.line("memory", format!("{} at most, of {}", bytes(memory.peak), bytes(memory.budget)));
        self.set("memory", json!({ "used": memory.used, "peak": memory.peak, "budget": memory.budget }));
        for line in table(spans) {
            self.text(line);
        }
        self.set("timings", spans.iter().map(|s| json!({ "kernel": s.kernel, "calls": s.calls, "seconds": s.seconds })).collect());
    }

    /// Ends the report with the command's whole time, and says it.
    pub fn finish(mut self) -> Result<(), Failure> {
        self.set("seconds", json!(self.seconds()));
        if self.json {
            let object = Value::Object(std::mem::take(&mut self.object));
            return say(&object.to_string()).map_err(|f| self.with_written(f));
        }
        self.flush()
    }

    /// A failure to say something is no failure of the files.
    fn with_written(&self, mut failure: Failure) -> Failure {
        if !self.written.is_empty() {
            failure.sentence += &format!("; {} was written all the same", self.written.join(" and "));
        }
        failure
    }
}

/// One line on stdout.
pub fn say(line: &str) -> Result<(), Failure> {
    match around(|| writeln!(std::io::stdout(), "{line}")) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::new(3, format!("standard output: cannot write: {e}"))),
        _ => Ok(()),
    }
}

/// Kernel, calls, device seconds, share.
fn table(spans: &[Span]) -> Vec<String> {
    let total: f64 = spans.iter().map(|s| s.seconds).sum();
    if total <= 0.0 {
        return vec!["the device keeps no time".into()];
    }
    let wide = spans.iter().map(|s| s.kernel.len()).fold(16, usize::max);
    let row =
        |name: &str, calls: &str, seconds: f64| format!("  {name:<wide$} {calls:>7} {seconds:>10.3} {:>6.1} %", 100.0 * seconds / total);
    let mut lines = vec![format!("  {:<wide$} {:>7} {:>10} {:>8}", "kernel", "calls", "device s", "share")];
    lines.extend(spans.iter().map(|s| row(s.kernel, &s.calls.to_string(), s.seconds)));
    lines.push(row("together", "", total));
    lines
}

/// "1 frame", "8 frames".
pub fn many(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_under_each_other_whatever_the_kernels_names() {
        let span = |kernel| Span { kernel, calls: 3, seconds: 0.25, timed: true };
        let lines = table(&[span("pack"), span("occupancy_distance"), span("raymarch")]);
        let ends: Vec<usize> = lines.iter().map(|l| l.chars().count()).collect();
        assert!(ends.iter().all(|&n| n == ends[0]), "{lines:#?}");
        assert!(lines[2].contains("occupancy_distance       3"), "{lines:#?}");
    }
}
