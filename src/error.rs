//! The one error type. Each variant is a kind of trouble that a caller can act on; its text says what is wrong, where,
//! and what would be right.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What a fallible call of this crate returns.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong, by cause.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write a file.
    #[error("{}: cannot {action}: {}", shown(path), reason(action, source))]
    Io {
        /// The file.
        path: PathBuf,
        /// "open", "read", "write", …
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },

    /// A file is damaged, or of a kind that is not read.
    #[error("{}: {what}; {right}", shown(path))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where in the file.
        what: String,
        /// What would be right.
        right: String,
    },

    /// A key of a scene (or its command-line override) is unknown or has an unusable value.
    #[error("{origin}: `{key}` {what}; {right}")]
    Scene {
        /// The scene file, or "command line".
        origin: String,
        /// The key, dotted: `volume.file`.
        key: String,
        /// What is wrong with it.
        what: String,
        /// What would be right.
        right: String,
    },

    /// A value handed to the library is out of its range.
    #[error("{item}: {what}; {right}")]
    Invalid {
        /// Which value.
        item: &'static str,
        /// What is wrong with it.
        what: String,
        /// What would be right.
        right: String,
    },

    /// No Vulkan device answers, or none of the wanted name.
    #[error("no Vulkan device: {what}; {right}")]
    NoDevice {
        /// What was looked for, and what was found.
        what: String,
        /// What would help.
        right: String,
    },

    /// The chosen device cannot run the kernels.
    #[error("device '{device}' lacks {lacks}")]
    DeviceLacks {
        /// The device's name.
        device: String,
        /// The missing features, limits or formats, by their Vulkan names.
        lacks: String,
    },

    /// More memory is needed than the budget or the device allows. Asked before anything is allocated.
    #[error("{what} needs {} of device memory, {} of {} are free; {right}", bytes(*needs), bytes(*free), bytes(*budget))]
    OutOfMemory {
        /// What was to be allocated.
        what: String,
        /// Bytes that it needs.
        needs: u64,
        /// Bytes that the budget still holds.
        free: u64,
        /// The whole budget, bytes.
        budget: u64,
        /// What would fit.
        right: String,
    },

    /// The system, or the driver, gave no memory although the budget allows it.
    #[error("{what} {}; {right}", if *needs > 0 { format!("needs {} of main memory, which the system does not give", bytes(*needs)) } else { "got no memory".into() })]
    NoMemory {
        /// What was to be allocated, or the driver's call.
        what: String,
        /// Bytes that it needs; 0: the driver does not say.
        needs: u64,
        /// What would help.
        right: String,
    },

    /// The device stopped answering; the engine must be made anew.
    #[error("the device was lost during {during}")]
    DeviceLost {
        /// What ran.
        during: String,
    },

    /// A dispatch was recorded that needs a barrier which nobody wrote: a defect of this crate, caught before it runs.
    #[error("kernel '{kernel}', binding '{binding}': last access was {had}, this dispatch needs {needs}, and no barrier stands between")]
    Hazard {
        /// The kernel.
        kernel: &'static str,
        /// The binding's name in the kernel.
        binding: &'static str,
        /// The last access on record.
        had: String,
        /// The access that the dispatch makes.
        needs: String,
    },

    /// A Vulkan call failed for another reason.
    #[error("{call} failed: {result}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// Vulkan's result code.
        result: String,
    },

    /// The caller asked to stop; what was finished before is still valid.
    #[error("cancelled")]
    Cancelled,
}

/// A path as a sentence names it: one line, and of a very long one its end.
pub fn shown(path: &Path) -> String {
    const MOST: usize = 300;
    let text: Vec<char> = escaped(&path.display().to_string()).collect();
    match text.len().checked_sub(MOST) {
        None | Some(0) => text.into_iter().collect(),
        Some(over) => std::iter::once('…').chain(text.into_iter().skip(over + 1)).collect(),
    }
}

/// Text in which nothing disturbs a terminal: control characters, and those that hide or reorder text, are escaped.
pub fn escaped(text: &str) -> impl Iterator<Item = char> + '_ {
    let odd =
        |c: char| c.is_control() || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}');
    text.chars().flat_map(move |c| {
        let (plain, code) = if odd(c) { (None, Some(c.escape_default())) } else { (Some(c), None) };
        plain.into_iter().chain(code.into_iter().flatten())
    })
}

/// What the system's refusal means, and what would be right.
fn reason(action: &str, source: &std::io::Error) -> String {
    let opens = matches!(action, "open" | "read");
    let text = match source.kind() {
        ErrorKind::NotFound if opens => "no such file; check the path",
        ErrorKind::NotFound => "no such folder; make it first or name another",
        ErrorKind::AlreadyExists => "there is a file of that name; name another folder, or remove it",
        ErrorKind::NotADirectory => "a part of the path is a file, not a folder; check the path",
        ErrorKind::IsADirectory => "it is a folder; name a file",
        ErrorKind::PermissionDenied if opens => "permission denied; you need the right to read it, and to enter its folder",
        ErrorKind::PermissionDenied => "permission denied; name a place that you may write to",
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only; name a place that you may write to",
        ErrorKind::StorageFull => "the disk is full; make room or name another place",
        ErrorKind::QuotaExceeded => "your quota of the disk is used up; make room or name another place",
        ErrorKind::FileTooLarge => "it would be larger than files may become here; raise the limit (ulimit -f) or name another place",
        ErrorKind::InvalidFilename => "the name is too long or not allowed; choose another",
        _ => return source.to_string(),
    };
    text.into()
}

/// "12.0 MiB": bytes for people.
pub fn bytes(n: u64) -> String {
    const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = n as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit < UNITS.len() - 1 {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{n} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_paths_keep_their_end_and_stay_in_one_line() {
        assert_eq!(shown(Path::new("a/b.nrrd")), "a/b.nrrd");
        assert_eq!(shown(Path::new("a\n\u{1b}[31m\u{202e}b")), "a\\n\\u{1b}[31m\\u{202e}b");
        let exact = "x".repeat(300);
        assert_eq!(shown(Path::new(&exact)), exact);
        let long = format!("{}/end.nrrd", "d/".repeat(2000));
        let text = shown(Path::new(&long));
        assert!(text.chars().count() == 300 && text.starts_with('…') && text.ends_with("d//end.nrrd"), "{text}");
        let error = Error::Format { path: long.into(), what: "w".into(), right: "r".into() };
        assert!(error.to_string().len() < 320);
    }

    #[test]
    fn the_system_refusals_say_what_would_be_right() {
        let io = |action, kind: ErrorKind| Error::Io { path: "p".into(), action, source: kind.into() }.to_string();
        assert!(io("open", ErrorKind::NotFound).starts_with("p: cannot open: no such file; check the path"));
        assert!(io("create", ErrorKind::NotFound).contains("no such folder"));
        for action in ["open", "read", "write"] {
            assert!(io(action, ErrorKind::PermissionDenied).contains("permission denied; "));
        }
        let other = Error::Io { path: "p".into(), action: "read", source: std::io::Error::other("odd") };
        assert_eq!(other.to_string(), "p: cannot read: odd");
    }
}
