//! Logarithmic axes: their range, and where their numbers stand.

use plotters::coord::combinators::{BindKeyPoints, IntoLogRange, LogCoord, WithKeyPoints};

/// A number as an axis says it: at most two digits that count.
pub fn number(v: f64) -> String {
    let digits = (1 - v.abs().max(1e-12).log10().floor() as i32).max(0) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// An axis as plotters takes it.
pub type Coordinate = WithKeyPoints<LogCoord<f64>>;

/// A logarithmic axis.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Least value.
    pub lo: f64,
    /// Largest.
    pub hi: f64,
}

impl Axis {
    /// Around positive values, with some room on both sides.
    pub fn around(values: impl Iterator<Item = f64>) -> Self {
        let (lo, hi) = values.filter(|v| v.is_finite() && *v > 0.0).fold((f64::INFINITY, 0f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let (lo, hi) = if lo <= hi { (lo, hi) } else { (0.1, 1.0) };
        let room = (0.06 * (hi / lo).log10()).max(0.12);
        Self { lo: lo * 10f64.powf(-room), hi: hi * 10f64.powf(room) }
    }

    /// Where the grid's lines are, with and without a number: as many numbers as `length` holds, `apart` from each other.
    fn ticks(&self, length: f64, apart: f64) -> [Vec<f64>; 2] {
        let decade = length / (self.hi / self.lo).log10();
        let choices: [&[f64]; 4] = [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], &[1.0, 2.0, 3.0, 5.0], &[1.0, 2.0, 5.0], &[1.0]];
        let nearest = [10.0 / 9.0, 1.5, 2.0, 10.0f64];
        let fits = nearest.iter().position(|ratio| decade * ratio.log10() >= apart).unwrap_or(3);
        let places = |of: &[f64]| -> Vec<f64> {
            let decades = self.lo.log10().floor() as i32..=self.hi.log10().ceil() as i32;
            let all = decades.flat_map(|d| of.iter().map(move |m| m * 10f64.powi(d)));
            all.filter(|v| *v >= self.lo && *v <= self.hi).collect()
        };
        [places(choices[fits]), places(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])]
    }

    /// The nearest value that it holds.
    pub fn on(&self, v: f64) -> f64 {
        v.clamp(self.lo, self.hi)
    }

    /// The numbers that have room beside each other, `letter` units wide a letter: of two that have not the larger stays.
    fn uncrowded(&self, mut numbers: Vec<f64>, length: f64, letter: f64) -> Vec<f64> {
        let place = |v: f64| length * (v / self.lo).log10() / (self.hi / self.lo).log10();
        let half = |v: f64| 0.5 * letter * number(v).len() as f64;
        let mut free = f64::INFINITY;
        numbers.reverse();
        numbers.retain(|&v| {
            let stays = place(v) + half(v) <= free;
            if stays {
                free = place(v) - half(v) - 0.6 * letter;
            }
            stays
        });
        numbers.reverse();
        numbers
    }

    /// For plotters, `length` units long, its numbers `apart` at least, and as wide as `letter` a letter.
    pub fn coordinate(&self, length: f64, apart: f64, letter: f64) -> Coordinate {
        let [numbered, all] = self.ticks(length, apart);
        let numbered = self.uncrowded(numbered, length, letter);
        (self.lo..self.hi).log_scale().with_key_points(numbered).with_light_points(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_axes_are_short() {
        for (v, text) in [(0.01, "0.01"), (0.015, "0.015"), (1.0, "1"), (20.0, "20"), (100.0, "100"), (5000.0, "5000"), (0.2, "0.2")] {
            assert_eq!(number(v), text);
        }
    }

    #[test]
    fn an_axis_holds_its_values_and_its_numbers_stand_apart() {
        for (lo, hi) in [(0.01, 1.0), (0.3, 0.31), (1e-6, 1e6), (2.0, 2.0)] {
            let axis = Axis::around([lo, hi, f64::NAN, 0.0].into_iter());
            assert!(axis.lo < lo && axis.hi > hi);
            let [numbered, all] = axis.ticks(900.0, 44.0);
            let units = |a: f64, b: f64| 900.0 * (b / a).log10() / (axis.hi / axis.lo).log10();
            assert!(numbered.windows(2).all(|w| units(w[0], w[1]) >= 44.0) && numbered.len() <= all.len() + 1, "{numbered:?}");
        }
        // Long numbers give way, short ones stay; stacked ones have no width.
        let axis = Axis { lo: 3e-4, hi: 1.2 };
        let numbers = vec![5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 0.1, 1.0];
        assert_eq!(axis.uncrowded(numbers.clone(), 450.0, 6.5), numbers[1..]);
        assert_eq!(axis.uncrowded(numbers.clone(), 450.0, 0.0), numbers);
        // Nothing to show: still an axis.
        assert!(Axis::around([].into_iter()).ticks(900.0, 44.0)[0].len() > 1);
    }
}
