//! What a sequence will cost: the stages that each frame will pay for, at what the frames measured so far paid for them.

use super::session::{Paid, STAGES};
use halflight::scene::scene::TransferSource;
use halflight::scene::{Scene, Transfer};

/// Whether each stage may be paid for again, from one frame's scene to the next; `layers` are asked for or not.
pub fn needs(before: Option<&Scene>, scene: &Scene, layers: bool) -> [bool; STAGES.len()] {
    let Some(before) = before else { return [true, true, true, false, true, true, true, layers, true] };
    let volume = before.volume != scene.volume;
    let probe = before.light.source != scene.light.source;
    let matter = volume || before.transfer != scene.transfer || before.surface != scene.surface || before.clip != scene.clip;
    let absorbs = volume || before.clip != scene.clip || !same_extinction(before, scene);
    let field = absorbs || before.visibility != scene.visibility;
    [volume || probe, volume, matter, false, field, field || before.light != scene.light, true, layers, true]
}

/// What tells the fields of a sequence's frames apart.
pub fn field_of(scene: &Scene) -> String {
    let matter = match (&scene.surface, &scene.transfer) {
        (Some(surface), _) => format!("{:?}", surface.iso),
        (None, TransferSource::Points(t)) => format!("{:?}", (t.kind(), t.reference(), t.opacities())),
        (None, other) => format!("{other:?}"),
    };
    format!("{:?}", (&scene.volume, matter, &scene.clip, &scene.visibility))
}

/// Whether two scenes of one volume absorb alike, whatever their colours.
fn same_extinction(a: &Scene, b: &Scene) -> bool {
    let shape = |t: &Transfer| (t.kind(), t.reference(), t.opacities().to_vec());
    match (a.surface, b.surface) {
        (Some(a), Some(b)) => a.iso == b.iso,
        (None, None) => match (&a.transfer, &b.transfer) {
            (TransferSource::Points(a), TransferSource::Points(b)) => shape(a) == shape(b),
            (a, b) => a == b,
        },
        _ => false,
    }
}

/// Frames that are remembered: estimates are made of fewer.
const MOST: usize = 16;

/// Costs seen so far.
#[derive(Clone, Debug, Default)]
pub struct Forecast {
    /// Each stage's seconds, ascending; the very first frame apart: it compiles kernels and opens the device.
    seen: [Vec<f64>; STAGES.len()],
    first: [Option<f64>; STAGES.len()],
    frames: usize,
}

impl Forecast {
    /// Takes in what a frame paid.
    pub fn measured(&mut self, paid: &Paid) {
        for (i, seconds) in paid.0.iter().enumerate() {
            let Some(seconds) = *seconds else { continue };
            if self.frames == 0 {
                self.first[i] = Some(seconds);
            } else if self.frames < MOST {
                let place = self.seen[i].partition_point(|s| *s < seconds);
                self.seen[i].insert(place, seconds);
            }
        }
        self.frames += 1;
    }

    /// Frames measured.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Seconds of frames that need these stages; `None` while a needed stage was never seen.
    pub fn seconds<'a>(&self, needs: impl IntoIterator<Item = &'a [bool; STAGES.len()]>) -> Option<f64> {
        let mut sum = 0.0;
        for frame in needs {
            for (i, _) in frame.iter().enumerate().filter(|(_, n)| **n) {
                // Opening the device is paid for once, with the first upload.
                // Of the others the median: one frame that compiles a kernel anew is not how the rest will be.
                let seen = &self.seen[i];
                sum += seen.get(seen.len().saturating_sub(1) / 2).copied().or(self.first[i])?;
            }
        }
        Some(sum)
    }

    /// Whether every stage that some frame needs has been seen beyond the first frame, where that is possible.
    pub fn knows(&self, needs: &[[bool; STAGES.len()]]) -> bool {
        let again = |i: usize| needs.iter().skip(1).any(|n| n[i]);
        self.frames > 0 && (0..STAGES.len()).all(|i| !again(i) || !self.seen[i].is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::super::session::{RENDER, VISIBILITY};
    use super::*;

    #[test]
    fn one_slow_frame_is_not_how_the_rest_will_be() {
        let paid = |stage: usize, seconds: f64| {
            let mut paid = Paid::default();
            paid.0[stage] = Some(seconds);
            paid
        };
        let needs = |stage: usize| std::array::from_fn(|i| i == stage);
        let mut forecast = Forecast::default();
        assert_eq!(forecast.seconds(&[needs(VISIBILITY)]), None);
        forecast.measured(&paid(VISIBILITY, 9.0));
        // Only the first was seen, with what it opens and compiles.
        assert_eq!(forecast.seconds(&[needs(VISIBILITY), needs(VISIBILITY)]), Some(18.0));
        for seconds in [7.0, 1.0, 1.25] {
            forecast.measured(&paid(VISIBILITY, seconds));
        }
        assert_eq!(forecast.seconds(&[needs(VISIBILITY); 10]), Some(12.5));
        assert_eq!(forecast.seconds(&[needs(VISIBILITY), needs(RENDER)]), None, "what was never seen cannot be said");
        assert!(forecast.knows(&[needs(RENDER), needs(VISIBILITY)]) && !forecast.knows(&[needs(VISIBILITY), needs(RENDER)]));
    }
}
