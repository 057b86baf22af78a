//! Records of measurements: one JSON file per run that says what was measured, on what, and when, so that runs can be laid
//! side by side later.

use crate::aside::write_aside;
use crate::engine::DeviceInfo;
use crate::error::{Error, Result};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

/// Version of the record's form; 2 brought `arguments`.
pub const SCHEMA: u32 = 2;

/// Where and when something was measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Version of this crate.
    pub halflight: &'static str,
    /// UTC, ISO 8601: 2026-01-31T12:00:00Z.
    pub date: String,
    /// The Vulkan device.
    pub device: String,
    /// Its driver.
    pub driver: String,
    /// Processor cores that the process may use.
    pub cores: usize,
    /// The source's git commit, "-dirty" behind it where files differ from it; "unknown" outside a checkout.
    pub commit: String,
}

impl Machine {
    /// This machine, now; the commit is that of the checkout that this crate was built in, if it is still there.
    pub fn of(device: &DeviceInfo) -> Self {
        Self {
            halflight: env!("CARGO_PKG_VERSION"),
            date: utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
            device: device.name.clone(),
            driver: device.driver.clone(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            commit: commit(Path::new(env!("CARGO_MANIFEST_DIR"))),
        }
    }
}

/// One measured figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// What.
    pub name: String,
    /// "s", "ns", "1" for a ratio.
    pub unit: &'static str,
    /// The figure: of several runs, their median.
    pub value: f64,
    /// From and to: the range of the runs, or the interval that the name tells; absent where there was one run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<[f64; 2]>,
}

/// All that one run measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
    /// [`SCHEMA`].
    pub schema: u32,
    /// "kernels", "paper", "estimators", "ffi", "chart".
    pub kind: String,
    /// On what, and when.
    #[serde(flatten)]
    pub machine: Machine,
    /// What ran: the words of the command line behind the program's name; of paths only the files' names.
    pub arguments: Vec<String>,
    /// The figures.
    pub figures: Vec<Figure>,
}

impl Record {
    /// An empty record of a run on `device` that ends now.
    pub fn new(kind: &str, device: &DeviceInfo) -> Self {
        let words = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
        Self { schema: SCHEMA, kind: kind.into(), machine: Machine::of(device), arguments: arguments(words), figures: Vec::new() }
    }

    /// Adds the median of several runs with their range; nothing where there were none.
    pub fn add(&mut self, name: impl Into<String>, unit: &'static str, mut runs: Vec<f64>) {
        runs.retain(|v| v.is_finite());
        runs.sort_by(f64::total_cmp);
        if let (Some(&lo), Some(&hi)) = (runs.first(), runs.last()) {
            let value = 0.5 * (runs[(runs.len() - 1) / 2] + runs[runs.len() / 2]);
            self.figures.push(Figure { name: name.into(), unit, value, spread: (runs.len() > 1).then_some([lo, hi]) });
        }
    }

    /// The record's file name: date, device, kind.
    pub fn file_name(&self) -> String {
        let date: String = self.machine.date.chars().filter(|c| *c != ':').collect();
        format!("{date}-{}-{}.json", slug(&self.machine.device), slug(&self.kind))
    }

    /// As JSON text.
    pub fn text(&self) -> String {
        // Plain data: there is nothing in it that JSON could not hold.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// Writes the record into `folder`, which is made where it is missing, and says where.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, folder: &Path) -> Result<PathBuf> {
        std::fs::create_dir_all(folder).map_err(|source| Error::Io { path: folder.to_owned(), action: "make this folder", source })?;
        let path = folder.join(self.file_name());
        write_aside(&path, |out| {
            out.write_all(self.text().as_bytes()).map_err(|source| Error::Io { path: path.clone(), action: "write", source })
        })?;
        Ok(path)
    }
}

/// `benches/records` of the checkout of this crate that `inside` lies in; it is never made.
pub fn folder(inside: &Path) -> Option<PathBuf> {
    let named = |text: String| toml::from_str::<toml::Table>(&text).ok()?.get("package")?.get("name")?.as_str().map(str::to_owned);
    let ours = |root: &&Path| std::fs::read_to_string(root.join("Cargo.toml")).ok().and_then(named).as_deref() == Some("halflight");
    let records = inside.ancestors().find(ours)?.join("benches/records");
    records.is_dir().then_some(records)
}

/// Words of a command line that name no place on this machine: of each path its last part. `--bench` is cargo's.
fn arguments(words: impl Iterator<Item = String>) -> Vec<String> {
    // A path may stand behind `--name=` or in a scene's key, in quotes.
    let short = |word: String| -> String {
        let pieces = word.split_inclusive(['=', '"', '\'']);
        pieces.map(|piece| piece.trim_end_matches(['/', '\\']).rsplit(['/', '\\']).next().unwrap_or_default()).collect()
    };
    words.filter(|word| word != "--bench").map(short).collect()
}

/// "llvmpipe (LLVM 15.0.6, 256 bits)" → "llvmpipe-llvm-15.0.6-256-bits".
fn slug(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_ascii_alphanumeric() || c == '.' { c.to_ascii_lowercase() } else { ' ' }).collect();
    let words: Vec<&str> = plain.split_whitespace().collect();
    let joined: String = words.join("-").chars().take(60).collect();
    if joined.is_empty() { "unknown".into() } else { joined }
}

/// Seconds since 1970 as a date (Howard Hinnant's `civil_from_days`).
fn utc(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    let z = days + 719_468;
    let (era, doe) = (z / 146_097, z % 146_097);
    let yoe = (doe - doe / 1460 + doe / 36_524 - doe / 146_096) / 365;
    let doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    let mp = (5 * doy + 2) / 153;
    let (day, month) = (doy - (153 * mp + 2) / 5 + 1, if mp < 10 { mp + 3 } else { mp - 9 });
    let year = yoe + 400 * era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

/// The commit that is checked out in `folder`, if that is a checkout's root.
fn commit(folder: &Path) -> String {
    let git = |arguments: &[&str]| {
        let out = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok().filter(|o| o.status.success())?;
        String::from_utf8(out.stdout).ok().map(|text| text.trim().to_owned())
    };
    let head = folder.join(".git").exists().then(|| git(&["rev-parse", "--short=12", "HEAD"])).flatten();
    match head {
        None => "unknown".into(),
        // Records are themselves new files: only changes of tracked ones count.
        Some(head) if git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|s| s.is_empty()) => head,
        Some(head) => head + "-dirty",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_civil() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }

    fn record() -> Record {
        let machine = Machine {
            halflight: "0.0.0",
            date: utc(0),
            device: "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
            driver: "d".into(),
            cores: 2,
            commit: "unknown".into(),
        };
        Record { schema: SCHEMA, kind: "chart".into(), machine, arguments: vec!["engine.nii.gz".into()], figures: Vec::new() }
    }

    #[test]
    fn arguments_say_what_ran_and_not_where() {
        let words = [
            "--bench",
            "/home/me/data/engine.nii.gz",
            "--opacity",
            "40:0,60:0.8",
            "--ratios=4,2",
            "--out=../x/",
            "volume.file='/d/v.nrrd'",
            r"C:\d\e.nrrd",
        ];
        let short = arguments(words.into_iter().map(str::to_owned));
        assert_eq!(short, ["engine.nii.gz", "--opacity", "40:0,60:0.8", "--ratios=4,2", "--out=x", "volume.file='v.nrrd'", "e.nrrd"]);
    }

    #[test]
    fn figures_are_medians_with_their_range() {
        let mut r = record();
        r.add("a", "s", vec![3.0, 1.0, 2.0, f64::NAN]);
        r.add("b", "s", vec![4.0]);
        r.add("c", "s", Vec::new());
        assert_eq!(r.figures.len(), 2);
        assert_eq!((r.figures[0].value, r.figures[0].spread), (2.0, Some([1.0, 3.0])));
        assert_eq!((r.figures[1].value, r.figures[1].spread), (4.0, None));
    }

    #[test]
    fn a_record_is_one_file_that_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut r = record();
        r.add("frame", "s", vec![0.5]);
        let path = r.write(&folder.path().join("new")).unwrap();
        assert_eq!(path.file_name().unwrap(), "1970-01-01T000000Z-llvmpipe-llvm-15.0.6-256-bits-chart.json");
        let v: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(
            (&v["schema"], &v["kind"], &v["cores"], &v["arguments"][0], &v["figures"][0]["value"]),
            (&2.into(), &"chart".into(), &2.into(), &"engine.nii.gz".into(), &0.5.into())
        );
        // A file where the folder should be is an error, not a panic.
        assert!(r.write(&path).is_err());
    }

    #[test]
    fn records_lie_in_the_checkout_and_nowhere_else() {
        let here = tempfile::tempdir().unwrap();
        let (root, below) = (here.path(), here.path().join("a/b"));
        std::fs::create_dir_all(&below).unwrap();
        assert_eq!(folder(&below), None);
        // Another project's folder of that name is not ours, and ours without one is left without.
        std::fs::create_dir_all(root.join("benches/records")).unwrap();
        for (text, ours) in [("[package]\nname = \"other\"", false), ("no toml", false), ("[package]\nname = \"halflight\"", true)] {
            std::fs::write(root.join("Cargo.toml"), text).unwrap();
            assert_eq!(folder(&below), ours.then(|| root.join("benches/records")), "{text}");
        }
        std::fs::remove_dir(root.join("benches/records")).unwrap();
        assert_eq!((folder(&below), root.join("benches/records").exists()), (None, false));
    }

    #[test]
    fn a_folder_that_is_no_checkout_has_no_commit() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(commit(folder.path()), "unknown");
        assert_eq!(slug("///"), "unknown");
    }
}
