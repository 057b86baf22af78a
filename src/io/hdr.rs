//! Radiance pictures (.hdr, .pic): run-length coded RGBE, as Ward, "Real Pixels", Graphics Gems II, and the Radiance
//! reference manual, "File Formats", describe them. Decoded here under our own bounds.

use std::io::{self, BufRead, Read};

/// Width, height and linear RGB pixels, top row first, or what is wrong.
type Decoded = Result<(usize, usize, Vec<[f32; 3]>), Trouble>;

/// What stopped the decoder.
pub(super) enum Trouble {
    /// The system.
    Io(io::Error),
    /// The file: what is wrong and where, and what would be right.
    Format(String, String),
}

impl From<io::Error> for Trouble {
    fn from(e: io::Error) -> Self {
        if e.kind() == io::ErrorKind::UnexpectedEof {
            Trouble::Format("the file ends before its last pixel".into(), "it was cut off: copy or download it again".into())
        } else {
            Trouble::Io(e)
        }
    }
}

fn wrong<T>(what: impl Into<String>, right: impl Into<String>) -> Result<T, Trouble> {
    Err(Trouble::Format(what.into(), right.into()))
}

/// Longest header that is read, bytes.
const MAX_HEADER: u64 = 1 << 16;

/// Reads a picture. `bad_shape` says what would be right, where a size is refused; it is asked before anything is
/// allocated. Values are divided by the header's EXPOSURE, which is what a program multiplied them with.
pub(super) fn decode(mut file: impl BufRead, bad_shape: impl Fn(usize, usize) -> Option<String>) -> Decoded {
    let (width, height, exposure) = header(&mut file.by_ref().take(MAX_HEADER))?;
    if let Some(right) = bad_shape(width, height) {
        return wrong(format!("{width}x{height} pixels"), right);
    }
    let mut pixels: Vec<[f32; 3]> = Vec::new();
    let mut line = vec![[0u8; 4]; width];
    for row in 0..height {
        match scanline(&mut file, &mut line) {
            Err(Trouble::Format(what, right)) => return wrong(format!("scanline {row} of {height}: {what}"), right),
            other => other?,
        }
        // Memory grows with what the file delivers, not with what its header claims.
        if pixels.try_reserve(width).is_err() {
            return wrong(format!("{width}x{height} pixels do not fit into memory"), "a smaller probe is enough for four bands");
        }
        pixels.extend(line.iter().map(|&[r, g, b, e]| {
            // mantissa·2^(e − 128 − 8); e = 0 means black.
            let scale = if e == 0 { 0.0 } else { f64::from(i32::from(e) - 136).exp2() / exposure };
            [r, g, b].map(|m| (f64::from(m) * scale) as f32)
        }));
    }
    Ok((width, height, pixels))
}

/// Width, height, and the product of the EXPOSURE lines.
fn header(file: &mut impl BufRead) -> Result<(usize, usize, f64), Trouble> {
    let mut exposure = 1.0;
    let mut first = true;
    loop {
        let text = line(file)?;
        if first && !text.starts_with("#?") {
            return wrong("the first line is not a Radiance signature", "it must begin with #?RADIANCE or #?RGBE");
        }
        first = false;
        if text.is_empty() {
            break;
        }
        if let Some(format) = text.strip_prefix("FORMAT=")
            && format.trim() != "32-bit_rle_rgbe"
        {
            return wrong(format!("FORMAT is {}", clamped(format)), "32-bit_rle_rgbe is read");
        }
        if let Some(value) = text.strip_prefix("EXPOSURE=") {
            match value.trim().parse::<f64>() {
                Ok(e) if e.is_finite() && e > 0.0 => exposure *= e,
                _ => return wrong(format!("EXPOSURE is {}", clamped(value)), "it must be a number above 0"),
            }
        }
    }
    if !(1e-30..=1e30).contains(&exposure) {
        return wrong(format!("the EXPOSURE lines multiply to {exposure:e}"), "their product must lie in 1e-30..1e30");
    }
    let size = line(file)?;
    let words: Vec<&str> = size.split_whitespace().collect();
    match words[..] {
        ["-Y", height, "+X", width] => match (width.parse(), height.parse()) {
            (Ok(w), Ok(h)) => Ok((w, h, exposure)),
            _ => wrong(format!("the size line is \"{}\"", clamped(&size)), "it must be -Y HEIGHT +X WIDTH with whole numbers"),
        },
        _ => wrong(format!("the size line is \"{}\"", clamped(&size)), "pictures from the top left are read: -Y HEIGHT +X WIDTH"),
    }
}

/// One header line without its end.
fn line(file: &mut impl BufRead) -> Result<String, Trouble> {
    let mut bytes = Vec::new();
    file.read_until(b'\n', &mut bytes)?;
    if bytes.pop() != Some(b'\n') {
        return wrong("the header has no end", "an empty line and the size line end it");
    }
    Ok(String::from_utf8_lossy(&bytes).trim_end_matches('\r').to_owned())
}

fn clamped(text: &str) -> String {
    text.trim().chars().take(40).filter(|c| !c.is_control()).collect()
}

fn scanline(file: &mut impl Read, out: &mut [[u8; 4]]) -> Result<(), Trouble> {
    let mut four = [0; 4];
    file.read_exact(&mut four)?;
    let width = out.len();
    let coded_width = usize::from(four[2]) << 8 | usize::from(four[3]);
    // The four components apart, each run-length coded; 2 2 cannot begin a normalised pixel.
    if four[..2] == [2, 2] && four[2] < 128 && (8..=32_767).contains(&width) {
        if coded_width != width {
            return wrong(format!("it says {coded_width} pixels"), format!("it must have {width}"));
        }
        return (0..4).try_for_each(|component| run_lengths(file, out, component));
    }
    // Flat pixels, in which 1 1 1 n repeats the pixel before n times (n counts 256-fold more in each marker that follows).
    let (mut at, mut shift) = (0, 0);
    loop {
        if four[..3] == [1, 1, 1] {
            let run = if shift < 24 { usize::from(four[3]) << shift } else { usize::MAX };
            if at == 0 || run > width - at {
                return wrong(format!("a run of {run} begins at pixel {at}"), format!("runs follow a pixel and end by pixel {width}"));
            }
            let last = out[at - 1];
            out[at..at + run].fill(last);
            at += run;
            shift += 8;
        } else {
            out[at] = four;
            at += 1;
            shift = 0;
        }
        if at == width {
            return Ok(());
        }
        file.read_exact(&mut four)?;
    }
}

fn run_lengths(file: &mut impl Read, out: &mut [[u8; 4]], component: usize) -> Result<(), Trouble> {
    let width = out.len();
    let mut at = 0;
    let mut buffer = [0; 128];
    while at < width {
        file.read_exact(&mut buffer[..1])?;
        let code = usize::from(buffer[0]);
        let count = if code > 128 { code - 128 } else { code };
        if count == 0 || count > width - at {
            return wrong(format!("a run of {count} begins at pixel {at}"), format!("runs are not empty and end by pixel {width}"));
        }
        if code > 128 {
            file.read_exact(&mut buffer[..1])?;
            let value = buffer[0];
            buffer[..count].fill(value);
        } else {
            file.read_exact(&mut buffer[..count])?;
        }
        for (pixel, value) in out[at..at + count].iter_mut().zip(&buffer) {
            pixel[component] = *value;
        }
        at += count;
    }
    Ok(())
}
