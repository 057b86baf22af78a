//! Values on the command line.

/// "0,255": two finite numbers that ascend.
pub fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.trim().trim_start_matches('[').trim_end_matches(']').split_once(',');
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    match numbers.and_then(|(a, b)| Some([number(a)?, number(b)?])) {
        Some([lo, hi]) if lo < hi => Ok([lo, hi]),
        _ => Err("it must be two ascending numbers, such as -1000,3000".into()),
    }
}

/// Seconds above 0.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s.is_finite() && s > 0.0 => Ok(s),
        _ => Err("it must be a number of seconds above 0".into()),
    }
}

/// A finite number above 0.
pub fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("it must be a number above 0, such as 0.01".into()),
    }
}

/// "512M", "1.5GiB", "1000000": bytes; K, M, G, T count in 1024s.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let power = match unit.trim().to_ascii_lowercase().trim_end_matches('b').trim_end_matches('i') {
        "" => 0,
        "k" => 1,
        "m" => 2,
        "g" => 3,
        "t" => 4,
        _ => return Err(format!("the unit '{unit}' is unknown; use K, M, G or T")),
    };
    match number.parse::<f64>() {
        Ok(n) if n > 0.0 && n * 1024f64.powi(power) <= 1e18 => Ok((n * 1024f64.powi(power)) as u64),
        _ => Err("it must be a size above 0, such as 512M or 1.5G".into()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_units() {
        for (text, bytes) in [("1", 1), ("2K", 2048), ("1.5G", 3 << 29), ("512 MiB", 512 << 20), ("3gb", 3 << 30)] {
            assert_eq!(parse_bytes(text), Ok(bytes), "{text}");
        }
        for text in ["", "0", "-1", "G", "1X", "1.2.3G", "1e3", "99999999T"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }
}
