//! Savings as pairs of bars, before and after, each pair scaled to its longer bar.

use super::axis::number;
use super::canvas::{Canvas, Draw, Drawn, GRID, INK, MUTED, WIDTH};
use super::{Report, Saving};
use crate::error::bytes;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

/// Bars of each subject.
pub struct Bars<'a>(Vec<(&'a str, &'a [Saving])>);

impl<'a> Bars<'a> {
    /// All savings of a report.
    pub fn of(report: &'a Report) -> Self {
        Self(report.subjects.iter().filter(|s| !s.savings.is_empty()).map(|s| (s.name.as_str(), s.savings.as_slice())).collect())
    }
}

/// Without and with.
const COLORS: [RGBColor; 2] = [RGBColor(0xaa, 0xb2, 0xba), RGBColor(0x00, 0x9e, 0x73)];

const ROW: f64 = 46.0;

/// Units down to the first subject, and of a subject's name.
const HEAD: f64 = 60.0;
const NAME: f64 = 34.0;

/// Where bars begin, and where words about them do.
const LEFT: f64 = 400.0;
const RIGHT: f64 = WIDTH - 180.0;

impl Draw for Bars<'_> {
    fn height(&self) -> f64 {
        HEAD + self.0.iter().map(|(_, savings)| NAME + ROW * savings.len() as f64).sum::<f64>() + 12.0
    }

    fn draw<B: DrawingBackend>(&self, on: &Canvas<B>) -> Drawn<B> {
        on.text([18.0, 21.0], 17.0, HPos::Left, INK, "What each saving brings")?;
        let subtitle = "device time, or memory, without it (grey) and with it (green), each pair to its own scale; right: how far the picture moves, as relative RMSE";
        on.text([18.0, 43.0], 12.0, HPos::Left, MUTED, subtitle)?;
        let mut y = HEAD;
        for (name, savings) in &self.0 {
            on.text([18.0, y + 20.0], 13.0, HPos::Left, INK, name)?;
            y += NAME;
            for saving in *savings {
                row(on, y, saving)?;
                y += ROW;
            }
        }
        Ok(())
    }
}

fn row<B: DrawingBackend>(on: &Canvas<B>, y: f64, saving: &Saving) -> Drawn<B> {
    let rule = [(on.px(18.0), on.px(y)), (on.px(WIDTH - 18.0), on.px(y))];
    on.area.draw(&PathElement::new(rule, on.line(GRID, 1.0)))?;
    on.text([LEFT - 14.0, y + 23.0], 12.0, HPos::Right, INK, &format!("{}, {}", saving.of, saving.name))?;
    let longest = saving.before.max(saving.after).max(1e-12);
    for (value, color, top) in [(saving.before, COLORS[0], y + 6.0), (saving.after, COLORS[1], y + 24.0)] {
        let length = (0.85 * (RIGHT - LEFT) * value / longest).max(1.0);
        let corners = [(on.px(LEFT), on.px(top)), (on.px(LEFT + length), on.px(top + 15.0))];
        on.area.draw(&Rectangle::new(corners, color.filled()))?;
        on.text([LEFT + length + 6.0, top + 7.5], 11.0, HPos::Left, INK, &amount(saving, value))?;
    }
    let times = saving.before / saving.after.max(1e-12);
    on.text(
        [RIGHT + 10.0, y + 15.0],
        12.0,
        HPos::Left,
        INK,
        &format!("{times:.2} times as {}", if saving.of == MEMORY { "small" } else { "fast" }),
    )?;
    let moved = match saving.rmse {
        0.0 => "the same picture".to_owned(),
        rmse if rmse < 1e-4 => "RMSE below 0.0001".to_owned(),
        rmse if rmse > TRADE => format!("a trade: RMSE {}", number(rmse)),
        rmse => format!("RMSE {}", number(rmse)),
    };
    on.text([RIGHT + 10.0, y + 32.0], 11.0, HPos::Left, MUTED, &moved)
}

/// What a row saves in place of seconds.
const MEMORY: &str = "memory";

/// A picture that moves further than this is not the same for less, but another.
const TRADE: f64 = 0.01;

/// Seconds or bytes for people.
fn amount(saving: &Saving, value: f64) -> String {
    if saving.of == MEMORY { bytes(value as u64) } else { time(value) }
}

/// Seconds for people.
pub fn time(s: f64) -> String {
    match s {
        s if s >= 10.0 => format!("{s:.0} s"),
        s if s >= 1.0 => format!("{s:.2} s"),
        s if s >= 0.1 => format!("{:.0} ms", 1e3 * s),
        s if s >= 1e-3 => format!("{:.1} ms", 1e3 * s),
        s => format!("{:.0} µs", 1e6 * s),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::chart::canvas;

    #[test]
    fn times_read_well() {
        for (s, text) in [(12.3, "12 s"), (1.5, "1.50 s"), (0.25, "250 ms"), (0.0012, "1.2 ms"), (5e-5, "50 µs")] {
            assert_eq!(time(s), text);
        }
    }

    #[test]
    fn the_longer_bar_is_the_same_length_whatever_the_times() {
        let saving = |before, after| Saving { name: "n".into(), of: "field", before, after, rounds: 1, rmse: 0.0 };
        let of = |list: &[Saving]| canvas::svg(&Bars(vec![("a", list)])).unwrap();
        let widths = |svg: &str, color: &str| -> Vec<i32> {
            let bars = svg.lines().filter(|l| l.contains(color) && l.starts_with("<rect"));
            bars.map(|l| l.split("width=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap()).collect()
        };
        let svg = of(&[saving(2.0, 1.0), saving(0.001, 0.004)]);
        let (before, after) = (widths(&svg, "#AAB2BA"), widths(&svg, "#009E73"));
        assert!(
            before[0] == after[1] && (before[0] - 2 * after[0]).abs() <= 2 && (after[1] - 4 * before[1]).abs() <= 4,
            "{before:?} {after:?}"
        );
        let memory = Saving { of: "memory", rmse: 0.2, ..saving(4096.0, 1024.0) };
        let svg_memory = of(&[memory]);
        assert!(of(&[Saving { rmse: 1e-7, ..saving(2.0, 1.0) }]).contains("RMSE below 0.0001"));
        assert!(["4.00 times as small", "4.0 KiB", "a trade: RMSE 0.2"].iter().all(|t| svg_memory.contains(t)), "{svg_memory}");
        assert!(svg.contains("2.00 times as fast") && svg.contains("0.25 times as fast") && svg.contains("the same picture"));
        assert!(canvas::png(&Bars(Vec::new())).is_ok());
    }
}
