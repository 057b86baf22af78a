//! In what steps does the device interpolate? Texture units of cards round weights (NVIDIA's to 1/256); lavapipe's are exact, though
//! both say `subTexelPrecisionBits` = 8.

use super::{Device, Format, ImageDesc, lock};
use crate::error::Result;
use crate::kernels::filter;

/// Places that are looked at between two texels; as many different weights there are on a device that does not round.
const PLACES: u32 = 4096;

/// Weights of interpolation that are rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filtering {
    /// Steps between two texels.
    pub steps: u32,
    /// Part of a step from which on it counts as a whole one: 0.5 where weights are rounded, 1 where they are cut off.
    pub up_from: f32,
}

impl Filtering {
    /// A weight as the device takes it.
    pub fn round(self, weight: f32) -> f32 {
        let steps = self.steps as f32;
        (weight * steps + (1.0 - self.up_from)).floor() / steps
    }

    /// The weights of the eight texels around a place between them, x least, as an NVIDIA H200 takes them: whole steps that are
    /// split along z, then along x, then along y, halves going outwards in x. Twins that take them stay within the tolerances there
    /// that they have where weights are exact (`tests/aov.rs`, `tests/reference/`).
    pub fn weights(self, place: [f32; 3]) -> [f32; 8] {
        let steps = i64::from(self.steps);
        let [x, y, z] = place.map(|f| (self.round(f) * self.steps as f32) as i64);
        let mut weights = [0.0; 8];
        for (k, of_z) in [steps - z, z].into_iter().enumerate() {
            let upper = (2 * of_z * x + steps) / (2 * steps);
            for (i, of_x) in [of_z - upper, upper].into_iter().enumerate() {
                let upper = (2 * of_x * y + steps - 1 + i as i64) / (2 * steps);
                weights[i + 4 * k] = (of_x - upper) as f32 / self.steps as f32;
                weights[i + 2 + 4 * k] = upper as f32 / self.steps as f32;
            }
        }
        weights
    }

    /// The rounding behind weights found at evenly spaced places; nothing where it is finer than these can tell.
    fn of_ramp(weights: &[f32]) -> Option<Self> {
        let mut different = weights.to_vec();
        different.sort_by(f32::total_cmp);
        different.dedup();
        let (&first, &last) = (different.first()?, different.last()?);
        if different.len() < 2 || 2 * different.len() > weights.len() {
            return None;
        }
        let steps = (different.len() - 1) as f32 / (last - first);
        // The first place at the second weight; places are the middles of intervals.
        let at = weights.iter().position(|&w| w > 0.5 / steps)? as f32 / weights.len() as f32;
        Some(Self { steps: steps.round() as u32, up_from: if at * steps < 0.75 { 0.5 } else { 1.0 } })
    }
}

/// Asks the device; with `snap` as if it rounded to so many steps.
pub(super) fn measure(device: &Device, snap: u32) -> Result<Option<Filtering>> {
    let desc = ImageDesc { name: "ramp", dims: [2, 1, 1], levels: 1, format: Format::R16Unorm, views: &[], storage: false };
    let ramp = device.image3(&desc)?;
    device.write_image(&ramp, 0, &mut |_, bytes| bytes.copy_from_slice(&[0, 0, 255, 255]))?;
    let weights = device.buffer::<f32>("weights", PLACES as usize)?;
    let mut rec = device.record()?;
    let params = filter::Params { places: PLACES, snap: snap as f32 };
    rec.dispatch(&filter::Bindings { ramp: ramp.sampled(), weights: &weights }, &(), &params, [PLACES, 1, 1])?;
    rec.submit()?;
    let weights = device.read::<f32>(&weights, PLACES as usize)?;
    // The user asked for the time of his own kernels.
    lock(&device.0.timings).retain(|span| span.kernel != "filter");
    Ok(Filtering::of_ramp(&weights))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_that_rounds_is_found_out() {
        let device = Device::new(&crate::vk::Options { validation: true, ..Default::default() }).unwrap();
        for steps in [16, 64, 256] {
            // Sabotage: places rounded on purpose.
            assert_eq!(measure(&device, steps).unwrap(), Some(Filtering { steps, up_from: 0.5 }));
        }
        let own = device.filtering().unwrap();
        println!("{own:?}");
        assert!(own.is_none_or(|f| f.steps >= 64));
        assert_eq!(device.filtering().unwrap(), own);
        assert!(device.take_timings().is_empty() && device.validation_errors().is_empty());
    }

    #[test]
    fn weights_are_whole_steps_of_one() {
        let filtering = Filtering { steps: 256, up_from: 0.5 };
        // Read off the device: z alone is exact; halves go up beside the upper x, down beside the lower.
        assert_eq!(filtering.weights([0.0, 0.0, 0.3]), [179.0, 0.0, 0.0, 0.0, 77.0, 0.0, 0.0, 0.0].map(|w| w / 256.0));
        let halves = filtering.weights([0.5, 0.5, 6.0 / 256.0]);
        assert_eq!([halves[4], halves[5], halves[6], halves[7]], [2.0, 1.0, 1.0, 2.0].map(|w| w / 256.0));
        for i in 0..500 {
            let f: [f32; 3] = std::array::from_fn(|a| (i as f32 * [0.381, 0.617, 0.129][a]).fract());
            let w = filtering.weights(f);
            assert_eq!(w.iter().sum::<f32>(), 1.0);
            for (j, w) in w.into_iter().enumerate() {
                let product: f32 = (0..3).map(|a| if j >> a & 1 == 1 { f[a] } else { 1.0 - f[a] }).product();
                assert!(w >= 0.0 && (w - product).abs() < 1.8 / 256.0, "{f:?} {j}: {w} for {product}");
            }
        }
    }

    #[test]
    fn ramps_tell_how_they_were_rounded() {
        let ramp = |f: &dyn Fn(f32) -> f32| (0..PLACES).map(|i| f((i as f32 + 0.5) / PLACES as f32)).collect::<Vec<f32>>();
        assert_eq!(Filtering::of_ramp(&ramp(&|f| f)), None);
        for (steps, up_from) in [(256, 0.5), (256, 1.0), (16, 0.5), (512, 1.0)] {
            let filtering = Filtering { steps, up_from };
            assert_eq!(Filtering::of_ramp(&ramp(&|f| filtering.round(f))), Some(filtering));
        }
        // A format of little precision counts as what it is.
        assert_eq!(Filtering::of_ramp(&ramp(&|f| (f * 255.0).round() / 255.0)), Some(Filtering { steps: 255, up_from: 0.5 }));
        // No ramp at all.
        assert_eq!(Filtering::of_ramp(&ramp(&|_| 0.3)), None);
        assert_eq!(Filtering::of_ramp(&[]), None);
    }
}
