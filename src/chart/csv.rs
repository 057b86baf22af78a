//! `points.csv`: one row a point, RFC 4180.

use super::Report;
use std::fmt::Write as _;

/// A cell of a row, quoted where it must be.
fn cell(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

/// Every measured field as a table; seconds are the device's, errors relative L2.
pub fn points_csv(report: &Report) -> String {
    let keys = crate::scene::keys::keys_of("visibility");
    let mut out = format!("scene,name,seconds,timing,error,error_low,error_high,error_16_bit,error_8_bit,front,{}\r\n", keys.join(","));
    for subject in &report.subjects {
        for p in &subject.fields {
            let _ = write!(
                out,
                "{},{},{:.6},{},{:.6},{:.6},{:.6},{:.6},{:.6},{}",
                cell(&subject.name),
                cell(&p.name),
                p.seconds,
                p.timing.word(),
                p.error,
                p.interval[0],
                p.interval[1],
                p.packed[0],
                p.packed[1],
                p.front
            );
            for key in &keys {
                let value = p.settings.get(*key).map_or_else(String::new, |v| v.as_str().map_or_else(|| v.to_string(), str::to_owned));
                let _ = write!(out, ",{}", cell(&value));
            }
            out.push_str("\r\n");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        assert_eq!([cell("a b"), cell("a,b"), cell("a\"b")], ["a b", "\"a,b\"", "\"a\"\"b\""]);
    }
}
