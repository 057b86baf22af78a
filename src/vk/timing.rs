//! Device time per kernel.

use std::time::Instant;

/// What one kernel took since the timings were last taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// The kernel.
    pub kernel: &'static str,
    /// Dispatches.
    pub calls: u32,
    /// Device seconds over all of them; 0 where the device has no timestamps.
    pub seconds: f64,
    /// Whether the device measures time.
    pub timed: bool,
}

impl Span {
    /// Device seconds of all of them; where the device keeps no time, those of the clock since `start`.
    pub(crate) fn seconds(spans: &[Self], start: Instant) -> f64 {
        match spans.iter().all(|s| s.timed) {
            true => spans.iter().map(|s| s.seconds).sum(),
            false => start.elapsed().as_secs_f64(),
        }
    }
}

/// Turns pairs of timestamps into seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// Nanoseconds per tick.
    pub period: f64,
    /// Valid bits of a timestamp; 0: no timestamps.
    pub bits: u32,
}

impl Clock {
    pub(super) fn timed(self) -> bool {
        self.bits > 0
    }

    /// Seconds between two timestamps, which wrap at the valid bits.
    pub(super) fn seconds(self, begin: u64, end: u64) -> f64 {
        let mask = if self.bits >= 64 { u64::MAX } else { (1 << self.bits) - 1 };
        (end.wrapping_sub(begin) & mask) as f64 * self.period * 1e-9
    }
}

/// Adds one dispatch.
pub(super) fn add(spans: &mut Vec<Span>, kernel: &'static str, seconds: Option<f64>) {
    let index = spans.iter().position(|s| s.kernel == kernel).unwrap_or_else(|| {
        spans.push(Span { kernel, calls: 0, seconds: 0.0, timed: seconds.is_some() });
        spans.len() - 1
    });
    spans[index].calls += 1;
    spans[index].seconds += seconds.unwrap_or(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_wrap_at_their_valid_bits() {
        let clock = Clock { period: 2.0, bits: 36 };
        assert_eq!(clock.seconds((1 << 36) - 5, 10), 15.0 * 2.0e-9);
        // Without the mask the same pair would be centuries.
        assert!(Clock { period: 2.0, bits: 64 }.seconds((1 << 36) - 5, 10) > 1.0e9);
        assert!(!Clock { period: 1.0, bits: 0 }.timed());
    }
}
