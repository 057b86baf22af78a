//! What each saving brings: the same work with and without it, and how far the picture moves.

use super::frame::Frames;
use super::{Clock, Saving, SubjectReport, median, seconds, timed};
use crate::engine::Field;
use crate::error::Result;
use crate::measure;
use crate::scene::visibility::{Cells, Method};
use crate::scene::{ImageSettings, Light, Picture, Visibility};

/// One row before it is measured.
struct Row {
    name: String,
    of: &'static str,
    before: Variant,
    after: Variant,
}

/// A field and the picture of it.
#[derive(Clone, PartialEq)]
struct Variant {
    field: Visibility,
    image: ImageSettings,
    light: Under,
}

/// What lights a variant.
#[derive(Clone, Copy, PartialEq)]
enum Under {
    /// The subject's own light.
    Own,
    /// The same radiance from all around.
    Constant([f64; 3]),
}

/// Grey, but for a millionth: what three channels cost where one would do.
const BARELY_TINTED: [f64; 3] = [1.0, 1.0, 1.000_001];

/// A variant with a field of so many bands.
fn bands(of: &Variant, bands: u32) -> Variant {
    Variant { field: Visibility { bands, ..of.field.clone() }, ..of.clone() }
}

/// The savings that are shown; a new one is a new row.
fn rows(ratio: u32, image: &ImageSettings) -> Vec<Row> {
    let base = Visibility { method: Method::Sweep, ratio, directions: 128, near: 2, step: 2.0, ..Visibility::default() };
    let full = Variant { field: base.clone(), image: *image, light: Under::Own };
    let bits = |bits| Variant { field: Visibility { bits, ..base.clone() }, ..full.clone() };
    let all = Variant { field: Visibility { cells: Cells::All, ..base.clone() }, ..full.clone() };
    let under = |kept, rgb| Variant { light: Under::Constant(rgb), ..bands(&full, kept) };
    let unskipped = Variant { image: ImageSettings { skip: false, ..*image }, ..full.clone() };
    let skipped = Variant { image: ImageSettings { skip: true, ..*image }, ..full.clone() };
    let row = |name: String, of, before: &Variant, after: Variant| Row { name, of, before: before.clone(), after };
    let mut rows = vec![
        row("leaping over empty blocks".into(), "frame", &unskipped, skipped),
        row("every cell → cells near matter".into(), "field", &all, full.clone()),
        row("constant light: 4 bands → 1".into(), "field", &under(4, [1.0; 3]), under(1, [1.0; 3])),
        row("constant light: 4 bands → 1".into(), "relight", &under(4, [1.0; 3]), under(1, [1.0; 3])),
        row("grey light: 3 channels → 1".into(), "relight", &under(4, BARELY_TINTED), under(4, [1.0; 3])),
        row("grey light: 3 channels → 1".into(), "frame", &under(4, BARELY_TINTED), under(4, [1.0; 3])),
        row("4 bands → 3".into(), "field", &full, bands(&full, 3)),
        row("4 bands → 2".into(), "field", &full, bands(&full, 2)),
        row("32 bits → 8".into(), "memory", &bits(32), full.clone()),
        row("every cell → bricks near matter".into(), "memory", &all, full.clone()),
        row("constant light: 4 bands → 1".into(), "memory", &under(4, [1.0; 3]), under(1, [1.0; 3])),
        row("32 bits → 8".into(), "relight", &bits(32), full.clone()),
        row(
            "one step of viewing rays a voxel → every second".into(),
            "frame",
            &full,
            Variant { image: ImageSettings { step: 2.0 * image.step, ..*image }, ..full.clone() },
        ),
    ];
    if ratio > 1 {
        let finer = Variant { field: Visibility { ratio: ratio / 2, ..base.clone() }, ..full.clone() };
        rows.push(row(format!("cells of 1:{} → 1:{ratio}", ratio / 2), "field", &finer, full.clone()));
    }
    rows
}

/// Share of a subject's time until when they may run.
const UNTIL: f64 = 0.68;

/// Runs of each side, in turns, where there is time for them.
const ROUNDS: usize = 3;

/// Fills `report` with the savings that its time still allows.
pub fn measure(frames: &Frames, cost: &dyn Fn(&Visibility) -> f64, clock: &mut Clock, report: &mut SubjectReport) -> Result<()> {
    for row in rows(frames.subject.ratio, &frames.image) {
        let once: f64 = [&row.before, &row.after].map(|v| cost(&v.field)).iter().sum();
        let rounds = if row.of != "field" || ROUNDS as f64 * once < 0.25 * clock.left(UNTIL) { ROUNDS } else { 1 };
        if once > clock.left(UNTIL) {
            report.left_out.push(format!("saving: {}", row.name));
            continue;
        }
        // Drivers compile at a kernel's first dispatch: once with few directions, untimed.
        for variant in [&row.before, &row.after] {
            frames.field(&Visibility { directions: 12, ..variant.field.clone() }, clock)?;
        }
        // Both sides in turns: what else the machine does falls on both.
        let mut runs = [Vec::new(), Vec::new()];
        let mut fields: [Option<Field>; 2] = [None, None];
        let mut pictures: [Option<Picture>; 2] = [None, None];
        for _ in 0..rounds {
            for (side, variant) in [&row.before, &row.after].into_iter().enumerate() {
                clock.check()?;
                let (field, field_seconds) = match fields[side].take().filter(|_| row.of != "field") {
                    Some(field) => (field, 0.0),
                    None => frames.field(&variant.field, clock)?,
                };
                let (lit, relight) = timed(frames.engine, || match variant.light {
                    Under::Own => frames.lit(&field, 4),
                    Under::Constant(rgb) => frames.engine.relight(&field, &Light::constant(rgb)),
                })?;
                let (picture, frame) = match pictures[side].take().filter(|_| row.of != "frame") {
                    Some(picture) => (picture, 0.0),
                    None => frames.picture(&lit, &variant.image, clock)?,
                };
                runs[side].push(match row.of {
                    "field" => field_seconds,
                    "relight" => seconds(&relight),
                    "memory" => field.bytes() as f64,
                    _ => frame,
                });
                (fields[side], pictures[side]) = (Some(field), Some(picture));
            }
        }
        let [before, after] = runs.map(|r| median(r).0);
        if let [Some(a), Some(b)] = &pictures {
            let rmse = measure::relative_rmse(b, a).unwrap_or(0.0);
            report.savings.push(Saving { name: row.name, of: row.of, before, after, rounds, rmse });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_changes_one_thing() {
        for ratio in [1, 2, 4, 8] {
            for row in rows(ratio, &ImageSettings::default()) {
                assert!(row.before != row.after && row.before.field.check().is_ok() && row.after.field.check().is_ok(), "{}", row.name);
                assert!(["field", "relight", "frame", "memory"].contains(&row.of));
            }
        }
    }
}
