//! The laws that errors and seconds are predicted by. Their constants were fitted to ten scenes (CT, MR, simulation,
//! transparent and opaque, an isosurface), 192 cells each, 16 to 128 directions; a scene's own figures are measured. The
//! scenes are the first ten of the table of plans in docs/measurements.md: engine as a medium and as an isosurface, bonsai, aneurism,
//! ct_avm, mni152, heptane, hydrogen atom, head_ct, walnut.

use crate::scene::visibility::MAX_SWEPT;

/// Fewer directions do not tell 16 harmonics apart.
pub(super) const LEAST: u32 = 32;

/// The exponent of quadrature before anything is known.
const USUAL: f64 = 0.8;

/// Quadrature error of N well-spread directions: q(N) = a·N^−p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Law {
    pub a: f64,
    pub p: f64,
}

impl Law {
    /// Through two measured (N, error). The exponent is kept to what step functions (½) to smooth ones (1¼) show.
    pub fn through(few: (u32, f64), many: (u32, f64)) -> Self {
        if !(few.1 > 0.0 && many.1 > 0.0) {
            return Self { a: 0.0, p: 1.0 };
        }
        let p = ((few.1 / many.1).ln() / (f64::from(many.0) / f64::from(few.0)).ln()).clamp(0.5, 1.25);
        Self { a: many.1 * f64::from(many.0).powf(p), p }
    }

    /// From the differences of two pairs of estimates (N, N, difference), if their errors are independent: the exponent of
    /// ½ to 1¼ that fits both, halfway to a usual one.
    pub fn between(few: (u32, u32, f64), many: (u32, u32, f64)) -> Self {
        let share = |(a, b, _): (u32, u32, f64), p: f64| f64::from(a).powf(-2.0 * p) + f64::from(b).powf(-2.0 * p);
        if !(few.2 > 0.0 && many.2 > 0.0) {
            return Self { a: 0.0, p: 1.0 };
        }
        let wanted = (many.2 / few.2).powi(2);
        // Falls with p.
        let off = |p: f64| (share(many, p) / share(few, p) - wanted).abs();
        let fits = (50..=125).map(|p| f64::from(p) / 100.0).min_by(|a, b| f64::total_cmp(&off(*a), &off(*b))).unwrap_or(USUAL);
        let p = 0.5 * (fits + USUAL);
        Self { a: many.2 / share(many, p).sqrt(), p }
    }

    pub fn error(&self, n: u32) -> f64 {
        self.a * f64::from(n).powf(-self.p)
    }
}

/// A sweep's shape: slices marched densely, and the longest step in voxels.
pub(super) type Shape = (u32, f32);

/// Slices that are worth a look.
const NEAR: [u32; 5] = [1, 2, 3, 4, 6];

/// Of a sweep's quadrature: how much faster it falls with N than a march's, for handing transmittance from slice to slice
/// smooths it; what share of a march's it is at 40 directions; how it grows with the slices marched densely.
const STEEPER: f64 = 0.35;
const SHARE: f64 = 0.5;
const SHARES: [f64; 2] = [0.3, 0.8];
const SHARPENED: f64 = 0.4;

/// How the error of that smoothing falls with the slices marched densely, and what it is before it is known.
const DIFFUSED: f64 = 0.7;
const DIFFUSION: f64 = 0.055;

/// A sweep's steps are even and seldom as long as they may be: their error against that of a march.
pub(super) const STEPPED: f64 = 0.7;

/// What a cell and direction costs beside its taps, in taps.
const CARRIED: f64 = 2.4;

/// What predictions are off by, relative, see [`Sweeps::doubt`].
pub(super) const DOUBTS: [f64; 3] = [0.03, 0.05, 0.08];

/// Sweeps of any shape: error² = quadrature² + diffusion² + (the steps' own)².
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sweeps {
    /// Quadrature of a march, which no sweep's exceeds.
    march: Law,
    /// Steps in voxels, and what a march in such steps is off by.
    steps: Vec<(f32, f64)>,
    /// Voxels per cell.
    ratio: u32,
    /// The shape that was measured, and the longest step that is taken.
    base: Shape,
    longest: f32,
    /// Of one slice: quadrature, diffusion.
    quadrature: Law,
    diffusion: f64,
    /// Seconds of the base shape: once, and per direction.
    seconds: [f64; 2],
    /// What was measured last against what these laws say.
    scale: f64,
    /// The (shape, N) that were run.
    seen: Vec<(Shape, u32)>,
}

impl Sweeps {
    /// Before a sweep's error was measured, but for the seconds of a direction of `base`; with the longest step to take.
    pub fn new(march: Law, steps: Vec<(f32, f64)>, ratio: u32, (base, longest): (Shape, f32), seconds: f64) -> Self {
        let p = march.p + STEEPER;
        let quadrature = Law { a: SHARE * march.error(40) * 40f64.powf(p), p };
        Self { march, steps, ratio, base, longest, quadrature, diffusion: DIFFUSION, seconds: [0.0, seconds], scale: 1.0, seen: Vec::new() }
    }

    /// Takes runs of the base shape into account: (N, error, seconds), ascending. With two of them quadrature is measured
    /// too, within the shares that were seen.
    pub fn measured(&mut self, runs: &[(u32, f64, f64)]) {
        let Some(&(n, error, seconds)) = runs.last() else { return };
        self.seconds = [0.0, seconds / f64::from(n)];
        if let [(few, more, before), .., (n, error, seconds)] = *runs {
            let share = |n: u32| f64::from(n).powf(-2.0 * self.quadrature.p);
            let a = ((more * more - error * error).max(0.0) / (share(few) - share(n))).sqrt();
            let one = self.quadrature.a / SHARE;
            self.quadrature.a = a.clamp(SHARES[0] * one, SHARES[1] * one);
            let each = ((seconds - before) / f64::from(n - few)).clamp(0.5 * self.seconds[1], self.seconds[1]);
            self.seconds = [(seconds - each * f64::from(n)).max(0.0), each];
        }
        let rest = error * error - self.swept(1, n).powi(2) - self.stepped(self.base.1).powi(2);
        // Something is always lost, and what is measured is never all quadrature.
        self.diffusion = rest.max(0.04 * error * error).sqrt();
        self.seen.extend(runs.iter().map(|r| (self.base, r.0)));
        // Now the law goes through what was seen.
        self.scale = 1.0;
        self.scale = error / self.error(self.base, n).max(1e-12);
    }

    /// Takes another shape's or a field's error into account: what was missed there is missed everywhere.
    pub fn learn(&mut self, shape: Shape, n: u32, error: f64) {
        self.scale *= (error / self.error(shape, n).max(1e-12)).clamp(0.5, 2.0);
        self.seen.push((shape, n));
    }

    /// The shapes that there are.
    pub fn shapes(&self) -> impl Iterator<Item = Shape> {
        NEAR.into_iter().flat_map(|near| self.steps.iter().filter(|s| s.0 <= self.longest).map(move |s| (near, s.0)))
    }

    /// The predicted error with `n` directions.
    pub fn error(&self, shape: Shape, n: u32) -> f64 {
        let (q, b) = (self.swept(shape.0, n), self.own(shape));
        self.scale * q.hypot(b)
    }

    /// The part of it that more directions do not change.
    pub fn own(&self, (near, step): Shape) -> f64 {
        (self.diffusion * f64::from(near).powf(-DIFFUSED)).hypot(self.stepped(step))
    }

    fn swept(&self, near: u32, n: u32) -> f64 {
        (self.quadrature.error(n) * f64::from(near).powf(SHARPENED)).min(self.march.error(n))
    }

    fn stepped(&self, step: f32) -> f64 {
        STEPPED * self.steps.iter().find(|s| s.0 == step).map_or(0.0, |s| s.1)
    }

    /// Predicted device seconds.
    pub fn seconds(&self, shape: Shape, n: u32) -> f64 {
        self.seconds[0] + self.each(shape) * f64::from(n)
    }

    /// Of one direction.
    pub fn each(&self, shape: Shape) -> f64 {
        let taps = |(near, step): Shape| CARRIED + f64::from(near * self.ratio) / f64::from(step);
        self.seconds[1] * taps(shape) / taps(self.base)
    }

    /// The fewest directions, in eights, whose error squared is at most `budget`.
    pub fn directions(&self, shape: Shape, budget: f64) -> Option<u32> {
        let within = |eights: &u32| self.error(shape, 8 * eights).powi(2) <= budget;
        let (mut least, mut most) = (LEAST / 8, MAX_SWEPT / 8);
        if !within(&most) {
            return None;
        }
        while least < most {
            let middle = (least + most) / 2;
            if within(&middle) { most = middle } else { least = middle + 1 }
        }
        Some(8 * least)
    }

    /// What a prediction may be off by, relative: least where the shape was run with about as many directions, more with
    /// fewer, most where it is guessed by another.
    pub fn doubt(&self, shape: Shape, n: u32) -> f64 {
        let runs = || self.seen.iter().filter(|s| s.0 == shape);
        match (runs().any(|s| 3 * s.1 >= 2 * n), runs().next()) {
            (true, _) => DOUBTS[0],
            (false, Some(_)) => DOUBTS[1],
            (false, None) => DOUBTS[2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_goes_through_what_it_was_given_and_inverts() {
        let law = Law::through((32, 1.4 * 32f64.powf(-0.75)), (256, 1.4 * 256f64.powf(-0.75)));
        assert!((law.a - 1.4).abs() < 1e-9 && (law.p - 0.75).abs() < 1e-9, "{law:?}");
        // Nothing there: nothing wrong.
        assert_eq!(Law::through((32, 0.0), (256, 0.0)).error(1), 0.0);
        let apart = |a: u32, b: u32| (a, b, law.error(a).hypot(law.error(b)));
        let between = Law::between(apart(28, 37), apart(37, 104));
        assert!((between.error(104) / law.error(104) - 1.0).abs() < 0.05 && (between.p - 0.775).abs() < 0.01, "{between:?}");
    }

    /// (march's q at 32 and 128; sweep near 1, step 2, at 32 and 64; near 2, step 1, at 96), measured.
    const SEEN: [([f64; 2], [f64; 2], f64); 6] = [
        ([0.1622, 0.0438], [0.1112, 0.0602], 0.0379), // engine
        ([0.2369, 0.1010], [0.1184, 0.0706], 0.0606), // aneurism, opaque
        ([0.2166, 0.0840], [0.1100, 0.0682], 0.0553), // head, bone
        ([0.1424, 0.0388], [0.0947, 0.0566], 0.0351), // walnut
        ([0.1649, 0.0534], [0.1300, 0.1010], 0.0662), // head, skin
        ([0.1562, 0.0446], [0.1094, 0.0532], 0.0382), // heptane
    ];

    #[test]
    fn shapes_that_were_not_run_are_guessed_within_the_doubt_on_measured_volumes() {
        for (march, swept, other) in SEEN {
            let march = Law::through((32, march[0]), (128, march[1]));
            let mut sweeps = Sweeps::new(march, vec![(1.0, 0.005), (2.0, 0.02)], 4, ((1, 2.0), 2.0), 0.01);
            sweeps.measured(&[(32, swept[0], 0.4), (64, swept[1], 0.7)]);
            assert!((sweeps.error((1, 2.0), 64) - swept[1]).abs() < 1e-9);
            let guess = sweeps.error((2, 1.0), 96);
            println!("{guess:.4} for {other}");
            assert!((guess / other - 1.0).abs() < 0.2, "{guess} for {other}");
            // The fewest directions for an error: one that is reached on every volume.
            let n = sweeps.directions((2, 1.0), guess * guess).expect("within reach");
            assert!(n <= 96 && sweeps.error((2, 1.0), n) <= guess && (n == LEAST || sweeps.error((2, 1.0), n - 8) > guess));
            assert_eq!([((1, 2.0), 96), ((1, 2.0), 104), ((2, 1.0), 96)].map(|(s, n)| sweeps.doubt(s, n)), DOUBTS);
            // A field that was a tenth off makes every shape's error a tenth larger.
            sweeps.learn((2, 1.0), 96, 1.1 * guess);
            assert!((sweeps.error((2, 1.0), 96) - 1.1 * guess).abs() < 1e-9);
            assert!((sweeps.each((2, 1.0)) / sweeps.each((1, 2.0)) - 10.4 / 4.4).abs() < 1e-6);
            assert_eq!(sweeps.directions((1, 2.0), 1e-8), None);
        }
    }
}
