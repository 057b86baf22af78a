//! The text of a legacy VTK file, and what lies between its words.

use super::limits::{bad, io, next_byte, quote};
use super::samples::SampleType;
use crate::error::Result;
use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::Path;

/// Longest word or line of the text parts, bytes.
const LONGEST: usize = 4096;

/// The text of a file, word by word and line by line, with the place in it.
pub(super) struct Text<'a> {
    pub path: &'a Path,
    pub file: BufReader<File>,
    pub length: u64,
    pub at: u64,
}

impl Text<'_> {
    fn byte(&mut self) -> Result<Option<u8>> {
        next_byte(self.path, &mut self.file, &mut self.at)
    }

    /// The next word; none where the file is over. Stops behind the blank that ends it; says whether that ended the line.
    pub fn word_and_end(&mut self) -> Result<Option<(String, bool)>> {
        let mut word = Vec::new();
        loop {
            match self.byte()? {
                Some(b) if !b.is_ascii_whitespace() => {
                    if word.len() == LONGEST {
                        let start = quote(&String::from_utf8_lossy(&word[..40]));
                        return Err(bad(self.path, format!("the word '{start}…' has more than {LONGEST} bytes"), "a keyword is due there"));
                    }
                    word.push(b);
                }
                end if !word.is_empty() => {
                    return Ok(Some((String::from_utf8_lossy(&word).into_owned(), end.is_none_or(|b| b == b'\n'))));
                }
                None => return Ok(None),
                Some(_) => {}
            }
        }
    }

    pub fn word(&mut self, what: &str) -> Result<String> {
        match self.word_and_end()? {
            Some((word, _)) => Ok(word),
            None => Err(bad(self.path, format!("it ends where {what} is due"), "the file is cut short")),
        }
    }

    /// The last word of a line; goes to the next line, where values may begin with any byte.
    pub fn last(&mut self, what: &str) -> Result<String> {
        match self.word_and_end()? {
            Some((word, ended)) => {
                if !ended {
                    self.line()?;
                }
                Ok(word)
            }
            None => Err(bad(self.path, format!("it ends where {what} is due"), "the file is cut short")),
        }
    }

    /// The rest of the line.
    pub fn line(&mut self) -> Result<String> {
        let mut line = Vec::new();
        while let Some(b) = self.byte()?.filter(|b| *b != b'\n') {
            if line.len() == LONGEST {
                return Err(bad(self.path, format!("a line of its text has more than {LONGEST} bytes"), "lines are short there"));
            }
            line.push(b);
        }
        Ok(String::from_utf8_lossy(&line).trim().to_owned())
    }

    pub fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        self.parse(&word, what)
    }

    pub fn parse<T: std::str::FromStr>(&self, word: &str, what: &str) -> Result<T> {
        word.parse().map_err(|_| bad(self.path, format!("'{}' stands where {what} is due", quote(word)), "a number is needed"))
    }

    /// Goes beyond `count` samples; false where the file ends before.
    pub fn skip(&mut self, count: u64, kind: SampleType, binary: bool) -> Result<bool> {
        if !binary {
            for _ in 0..count {
                if self.word_and_end()?.is_none() {
                    return Ok(false);
                }
            }
            return Ok(true);
        }
        let Some(to) = count.checked_mul(kind.bytes()).and_then(|n| self.at.checked_add(n)).filter(|to| *to <= self.length) else {
            return Ok(false);
        };
        self.file.seek(SeekFrom::Start(to)).map_err(|e| io(self.path, "read", e))?;
        self.at = to;
        Ok(true)
    }
}
