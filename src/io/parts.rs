//! Samples that lie in several files, or in pictures: one part after the other, each decoded when its turn comes.

use super::limits::Source;
use crate::error::Result;
use std::io::{Error, Read};

/// Bytes of `count` parts; `load` appends those of one.
struct Parts<F> {
    load: F,
    count: usize,
    next: usize,
    bytes: Vec<u8>,
    at: usize,
}

/// The bytes of `count` parts of `each` bytes. An error of `load` names the part's own file, and comes out as it is.
pub(crate) fn parts(count: usize, each: u64, load: impl FnMut(usize, &mut Vec<u8>) -> Result<()> + 'static) -> Source {
    let most = each.saturating_mul(count as u64);
    Source::Coded(Box::new(Parts { load, count, next: 0, bytes: Vec::new(), at: 0 }), "slices", most)
}

impl<F: FnMut(usize, &mut Vec<u8>) -> Result<()>> Read for Parts<F> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        while self.at == self.bytes.len() {
            if self.next == self.count {
                return Ok(0);
            }
            self.bytes.clear();
            self.at = 0;
            (self.load)(self.next, &mut self.bytes).map_err(Error::other)?;
            self.next += 1;
        }
        let n = buf.len().min(self.bytes.len() - self.at);
        buf[..n].copy_from_slice(&self.bytes[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}
