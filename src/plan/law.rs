//! The laws that candidates are predicted by, and the cheapest that they allow.

use crate::scene::visibility::MAX_SWEPT;

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

    pub fn error(&self, n: u32) -> f64 {
        self.a * f64::from(n).powf(-self.p)
    }

    /// The fewest directions whose error squared is `left`, in eights, but `least`.
    pub fn directions(&self, left: f64, least: u32) -> Option<u32> {
        if left <= 0.0 {
            return None;
        }
        let n = (self.a * self.a / left).powf(0.5 / self.p);
        (n < 1e6).then(|| (n.ceil() as u32).next_multiple_of(8).max(least))
    }
}

/// A sweep's shape as measured: error² = q(N)² + b². Its q is less than that of a march, because handing transmittance from
/// slice to slice spreads every direction a little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    pub near: u32,
    pub step: f32,
    /// q(N) = a·N^−¾.
    pub law: Law,
    /// b, its own error.
    pub error: f64,
    /// The (N, error) that the law goes through; `None` for a shape that was not run, but is guessed by another.
    pub seen: Option<(u32, f64)>,
    /// Seconds: once, and per direction.
    pub seconds: [f64; 2],
}

/// The exponent of quadrature in a sweep's law.
const SWEPT: f64 = 0.75;

/// a² from the errors of one shape with two numbers of directions.
pub(super) fn spread(few: (u32, f64), many: (u32, f64)) -> f64 {
    let share = |n: u32| f64::from(n).powf(-2.0 * SWEPT);
    ((few.1 * few.1 - many.1 * many.1) / (share(few.0) - share(many.0))).max(0.0)
}

impl Shape {
    /// From its error with `n` directions and what [`spread`] found.
    pub fn through((near, step): (u32, f32), (n, error): (u32, f64), a2: f64, seconds: [f64; 2]) -> Self {
        let share = f64::from(n).powf(-2.0 * SWEPT);
        // What is measured is at most all quadrature.
        let q2 = (a2 * share).min(error * error);
        let law = Law { a: (q2 / share).sqrt(), p: SWEPT };
        Self { near, step, law, error: (error * error - q2).sqrt(), seen: Some((n, error)), seconds }
    }

    /// Another shape, guessed by this one: what more dense slices brought two CTs (b as near^−0.4), and cost.
    /// What is computed by a guess is measured afterwards ([`super::Plan::compute`]).
    pub fn guess(&self, (near, step): (u32, f32)) -> Self {
        let taps = |near: u32, step: f32| 0.3 + f64::from(near) / f64::from(step);
        let more = taps(near, step) / taps(self.near, self.step);
        let error = self.error * (f64::from(self.near) / f64::from(near)).powf(0.4);
        Self { near, step, error, seen: None, seconds: [self.seconds[0], self.seconds[1] * more], ..*self }
    }

    /// Takes a field of `n` directions with the error `e` (without packing) into account.
    pub fn learn(&mut self, n: u32, e: f64) {
        let a2 = match self.seen {
            // Enough more directions than before to tell quadrature from the rest.
            Some((m, before)) if 3 * n >= 4 * m => spread((m, before), (n, e)),
            _ => self.law.a * self.law.a,
        };
        *self = Self::through((self.near, self.step), (n, e), a2, self.seconds);
    }

    /// Directions and seconds with which this shape's error squared stays below `budget`.
    pub fn within(&self, budget: f64, least: u32) -> Option<(u32, f64)> {
        let n = self.law.directions(budget - self.error * self.error, least).filter(|&n| n <= MAX_SWEPT)?;
        Some((n, self.seconds[0] + f64::from(n) * self.seconds[1]))
    }
}

/// Shapes worth a look at `ratio`, cheapest first: slices marched densely, and the longest step in voxels.
pub(super) fn shapes(ratio: u32) -> Vec<(u32, f32)> {
    let mut out: Vec<(u32, f32)> = Vec::new();
    for (near, step) in [(1, 2.0), (2, 2.0), (2, 1.0), (3, 1.0), (4, 1.0), (4, 0.5)] {
        let shape = (near, f32::min(step, ratio as f32));
        if !out.contains(&shape) {
            out.push(shape);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_goes_through_what_it_was_given_and_inverts() {
        let law = Law::through((32, 1.4 * 32f64.powf(-0.75)), (256, 1.4 * 256f64.powf(-0.75)));
        assert!((law.a - 1.4).abs() < 1e-9 && (law.p - 0.75).abs() < 1e-9, "{law:?}");
        let n = law.directions(0.05 * 0.05, 32).expect("some");
        assert!(law.error(n) <= 0.05 && law.error(n - 8) > 0.05, "{n}");
        assert_eq!(law.directions(0.0, 32), None);
        assert_eq!(law.directions(1.0, 32), Some(32));
        // Nothing there: nothing wrong.
        assert_eq!(Law::through((32, 0.0), (256, 0.0)).directions(1e-9, 32), Some(32));
    }

    #[test]
    fn a_shape_leaves_to_quadrature_what_it_does_not_take_itself() {
        let law = Law { a: 1.4, p: 0.75 };
        let total = |b: f64, n: u32| (law.error(n).powi(2) + b * b).sqrt();
        let shape = |b: f64| {
            let a2 = spread((32, total(b, 32)), (128, total(b, 128)));
            Shape::through((1, 2.0), (128, total(b, 128)), a2, [0.5, 0.01])
        };
        assert!((shape(0.03).error - 0.03).abs() < 1e-9 && (shape(0.03).law.a - 1.4).abs() < 1e-9);
        let (n, seconds) = shape(0.03).within(0.05 * 0.05, 32).expect("within reach");
        assert!((law.error(n).powi(2) + 0.03f64.powi(2)).sqrt() <= 0.05 && (seconds - 0.5 - 0.01 * f64::from(n)).abs() < 1e-12);
        assert!(n > shape(0.0).within(0.05 * 0.05, 32).expect("fewer").0);
        assert_eq!(shape(0.0501).within(0.05 * 0.05, 32), None);
    }
}
