//! A chart's run as a record's figures.

use super::Report;
use crate::engine::DeviceInfo;
use crate::record::{Figure, Record};

/// Every point, its time and its error with the interval.
pub fn record(report: &Report, device: &DeviceInfo) -> Record {
    let mut record = Record::new("chart", device);
    let mut put = |name: String, unit, value, spread| record.figures.push(Figure { name, unit, value, spread });
    for s in &report.subjects {
        for p in &s.fields {
            let name = format!("{}, 1:{}, {}", s.name, p.ratio, p.name);
            put(format!("{name}: device time, {}", p.timing.word()), "s", p.seconds, p.spread);
            put(format!("{name}: field error, 95 %"), "1", p.error, Some(p.interval));
        }
        for p in &s.frames {
            let name = format!("{}, {}, viewing step {}", s.name, p.name, p.step);
            put(format!("{name}: frame"), "s", p.seconds, p.spread);
            put(format!("{name}: image relative RMSE, 95 %"), "1", p.rmse, Some(p.interval));
        }
        for l in &s.levels {
            let name = format!("{}, {}, {}: image relative RMSE, 95 %", s.name, s.floor, super::candidates::counted_bands(l.bands));
            put(name, "1", l.rmse, Some(l.interval));
        }
        for p in &s.savings {
            let name = format!("{}, {}, {}", s.name, p.of, p.name);
            let unit = if p.of == "memory" { "B" } else { "s" };
            put(format!("{name}: before"), unit, p.before, None);
            put(format!("{name}: after"), unit, p.after, None);
        }
    }
    record
}
