//! How the command ends when it does not succeed: one sentence and an exit code.

use halflight::Error;
use halflight::io::COMMAND_LINE;
use serde_json::{Value, json};

/// The sentence and the code.
#[derive(Debug)]
pub struct Failure {
    pub code: u8,
    pub sentence: String,
    /// Whether a JSON object on stdout says it already.
    pub told: bool,
}

impl Failure {
    pub fn new(code: u8, sentence: impl Into<String>) -> Self {
        Self { code, sentence: sentence.into(), told: false }
    }

    /// Wrong usage: code 2.
    pub fn usage(sentence: impl Into<String>) -> Self {
        Self::new(2, sentence)
    }

    /// As an object of its own.
    pub fn json(&self) -> Value {
        json!({ "error": self.sentence, "code": self.code })
    }
}

/// 0 done, 1 internal, 2 usage, 3 bad input or output file, 4 no device, 5 out of memory, 6 device lost.
fn code(error: &Error) -> u8 {
    match error {
        Error::Scene { origin, .. } if origin == COMMAND_LINE => 2,
        Error::Io { .. } | Error::Format { .. } | Error::Scene { .. } | Error::Invalid { .. } => 3,
        Error::NoDevice { .. } | Error::DeviceLacks { .. } => 4,
        Error::OutOfMemory { .. } | Error::NoMemory { .. } => 5,
        Error::DeviceLost { .. } => 6,
        _ => 1,
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::new(code(&error), error.to_string())
    }
}

impl From<clap::Error> for Failure {
    fn from(error: clap::Error) -> Self {
        let text = error.render().to_string();
        // Clap's paragraphs become one sentence; its usage block is a --help away.
        let end = ["\n\nUsage:", "\n\nFor more"].iter().filter_map(|m| text.find(m)).min().unwrap_or(text.len());
        let words = |paragraph: &str| paragraph.split_whitespace().collect::<Vec<_>>().join(" ");
        let parts: Vec<String> = text[..end].trim_start_matches("error: ").split("\n\n").map(words).collect();
        Self::usage(format!("{}; see halflight --help", parts.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_trouble_has_its_code() {
        let s = || "x".to_string();
        let scene = |origin: &str| Error::Scene { origin: origin.into(), key: s(), what: s(), right: s() };
        let cases = [
            (Error::Io { path: "x".into(), action: "open", source: std::io::Error::other("x") }, 3),
            (Error::Format { path: "x".into(), what: s(), right: s() }, 3),
            (Error::Invalid { item: "x", what: s(), right: s() }, 3),
            (scene("s.toml line 3"), 3),
            (scene(COMMAND_LINE), 2),
            (Error::NoDevice { what: s(), right: s() }, 4),
            (Error::DeviceLacks { device: s(), lacks: s() }, 4),
            (Error::OutOfMemory { what: s(), needs: 2, free: 1, budget: 1, right: s() }, 5),
            (Error::NoMemory { what: s(), needs: 2, right: s() }, 5),
            (Error::DeviceLost { during: s() }, 6),
            (Error::Hazard { kernel: "k", binding: "b", had: s(), needs: s() }, 1),
            (Error::Vulkan { call: "c", result: s() }, 1),
            (Error::Cancelled, 1),
        ];
        for (error, expected) in cases {
            assert_eq!(code(&error), expected, "{error}");
        }
    }
}
