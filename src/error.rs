//! The one error type. Each variant is a kind of trouble that a caller can act on; its text says what is wrong, where,
//! and what would be right.

use std::path::PathBuf;

/// What a fallible call of this crate returns.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong, by cause.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write a file.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// "open", "read", "write", …
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },

    /// A file is damaged, or of a kind that is not read.
    #[error("{}: {what}; {right}", path.display())]
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
