//! Numbers of frames and names of their files: the forms that render farms use.

use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Most frames that one list may name.
pub const MOST_FRAMES: usize = 1 << 20;

/// The frames that a text names, in its order, each once: `7`, `1-100`, `1-100x2` and `1-100:2` (every second), `1:100:5`,
/// `100-1` (backwards), and several of these separated by commas. A step's sign is that of the range, or is left out.
///
/// # Errors
/// [`Error::Invalid`] that names the part which is none of these.
pub fn parse_frames(text: &str) -> Result<Vec<i64>> {
    let bad = |part: &str, why: &str| Error::Invalid {
        item: "frames",
        what: format!("`{}` {why}", part.chars().take(40).collect::<String>()),
        right: "write 7, 1-100, 1-100x2, 1-100:2, 1:100:5, 100-1, or several with commas: 5,10,20-24".into(),
    };
    let mut frames = Vec::new();
    for part in text.split(',') {
        let part = part.trim();
        let (from, to, step) = range(part).ok_or_else(|| bad(part, "is no range of frames"))?;
        let backwards = to < from;
        if step == Some(0) {
            return Err(bad(part, "has a step of 0"));
        }
        if step.is_some_and(|s| s < 0 && !backwards && from != to) {
            return Err(bad(part, "steps away from its end"));
        }
        let stride = step.map_or(1, i64::unsigned_abs);
        let count = to.abs_diff(from) / stride + 1;
        if count > (MOST_FRAMES - frames.len()) as u64 {
            return Err(bad(part, "makes more than 1048576 frames"));
        }
        let at = |i: u64| if backwards { from.saturating_sub_unsigned(i * stride) } else { from.saturating_add_unsigned(i * stride) };
        frames.extend((0..count).map(at));
    }
    let mut seen = std::collections::HashSet::with_capacity(frames.len());
    frames.retain(|f| seen.insert(*f));
    Ok(frames)
}

/// (first, last, step) of one part of a list.
fn range(part: &str) -> Option<(i64, i64, Option<i64>)> {
    let (from, rest) = integer(part)?;
    if rest.is_empty() {
        return Some((from, from, None));
    }
    let rest = rest.strip_prefix(['-', ':'])?;
    let (to, rest) = integer(rest)?;
    if rest.is_empty() {
        return Some((from, to, None));
    }
    let (step, rest) = integer(rest.strip_prefix(['x', ':'])?)?;
    rest.is_empty().then_some((from, to, Some(step)))
}

/// The integer at the beginning of a text, and what follows; small enough that sums of two do not overflow.
fn integer(text: &str) -> Option<(i64, &str)> {
    let sign = usize::from(text.starts_with('-'));
    let digits = text.len() - sign - text[sign..].trim_start_matches(|c: char| c.is_ascii_digit()).len();
    if digits == 0 || digits > 15 {
        return None;
    }
    let (number, rest) = text.split_at(sign + digits);
    Some((number.parse().ok()?, rest))
}

/// The shortest list that names these frames: "1-9x2,20".
pub fn frames_text(frames: &[i64]) -> String {
    let mut parts = Vec::new();
    let mut i = 0;
    while i < frames.len() {
        let step = frames.get(i + 1).map_or(0, |next| next - frames[i]);
        let mut end = i + 1;
        while end < frames.len() && step != 0 && frames[end] - frames[end - 1] == step {
            end += 1;
        }
        let (from, to) = (frames[i], frames[end - 1]);
        parts.push(match (end - i, step.abs()) {
            (1, _) => from.to_string(),
            (2, _) => {
                end -= 1;
                from.to_string()
            }
            (_, 1) => format!("{from}-{to}"),
            (_, step) => format!("{from}-{to}x{step}"),
        });
        i = end;
    }
    parts.join(",")
}

/// A file name with a place for a number: `f.####.exr` (as many digits as there are #, or more) or `f.%04d.exr`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    folder: PathBuf,
    before: String,
    width: usize,
    after: String,
}

impl Pattern {
    /// The pattern in a path's file name; `None` where it has no place for a number. Of several runs of # the last counts.
    pub fn find(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let parts = |before: &str, width: usize, after: &str| {
            Some(Self { folder: folder.clone(), before: before.into(), width, after: after.into() })
        };
        if let Some(end) = name.rfind('#') {
            let before = name[..=end].trim_end_matches('#');
            return parts(before, end + 1 - before.len(), &name[end + 1..]);
        }
        let (at, _) = name.match_indices('%').find(|(i, _)| {
            let rest = name[i + 1..].trim_start_matches(|c: char| c.is_ascii_digit());
            rest.starts_with('d')
        })?;
        let digits = name[at + 1..].chars().take_while(char::is_ascii_digit).count();
        let width = name[at + 1..at + 1 + digits].parse::<usize>().unwrap_or(1).clamp(1, 32);
        parts(&name[..at], width, &name[at + digits + 2..])
    }

    /// The path of a number.
    pub fn path(&self, number: i64) -> PathBuf {
        self.folder.join(format!("{}{number:0width$}{}", self.before, self.after, width = self.width))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn frames_take_the_forms_of_farms() {
        let cases: [(&str, &[i64]); 14] = [
            ("7", &[7]),
            ("1-4", &[1, 2, 3, 4]),
            ("1-10x3", &[1, 4, 7, 10]),
            ("1-10:4", &[1, 5, 9]),
            ("1:10:5", &[1, 6]),
            ("1:3", &[1, 2, 3]),
            ("5,10,20-22", &[5, 10, 20, 21, 22]),
            ("3-1", &[3, 2, 1]),
            ("9-1x4", &[9, 5, 1]),
            ("9-1:-4", &[9, 5, 1]),
            ("-2-1", &[-2, -1, 0, 1]),
            ("-1--3", &[-1, -2, -3]),
            (" 1 , 2-3 ", &[1, 2, 3]),
            ("1-3,2-5", &[1, 2, 3, 4, 5]),
        ];
        for (text, frames) in cases {
            assert_eq!(parse_frames(text).unwrap(), frames, "{text}");
        }
    }

    #[test]
    fn what_is_no_list_of_frames_is_refused() {
        for text in ["", "a", "1-", "1-2x", "1-2x0", "1-5x-2", "1--", "1;2", "1,,2", "1-2-3", "1.5", "1-9999999", "99999999999999999"] {
            let error = parse_frames(text).unwrap_err().to_string();
            assert!(error.starts_with("frames: `") && error.contains("1-100x2"), "{text}: {error}");
        }
        assert!(parse_frames(&"1-1048576,".repeat(3)).is_err());
    }

    #[test]
    fn lists_are_written_as_they_are_read() {
        for (text, short) in [("1,2,3", "1-3"), ("1-9x2,20", "1-9x2,20"), ("3-1", "3-1"), ("1,5", "1,5"), ("5,4,9,10,11", "5,4,9-11")] {
            let frames = parse_frames(text).unwrap();
            assert_eq!(frames_text(&frames), short);
            assert_eq!(parse_frames(short).unwrap(), frames);
        }
    }

    #[test]
    fn numbers_take_their_place_in_names() {
        let name = |pattern: &str, n| Pattern::find(Path::new(pattern)).map(|p| p.path(n).display().to_string());
        assert_eq!(name("out/f.####.exr", 7).unwrap(), "out/f.0007.exr");
        assert_eq!(name("out/f.####.exr", 123_456).unwrap(), "out/f.123456.exr");
        assert_eq!(name("f.%04d.exr", 7).unwrap(), "f.0007.exr");
        assert_eq!(name("f%d.exr", 7).unwrap(), "f7.exr");
        assert_eq!(name("#a.##.png", 3).unwrap(), "#a.03.png");
        assert_eq!(name("50%.%03d.png", -1).unwrap(), "50%.-01.png");
        assert_eq!(name("d.##/f.exr", 1), None);
        assert_eq!(name("50%.png", 1), None);
    }
}
