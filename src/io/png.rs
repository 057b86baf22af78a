//! PNG: pictures for the eye, 8 bit sRGB.

use super::exr::check;
use super::write_aside;
use crate::error::{Error, Result};
use crate::scene::Picture;
use std::path::Path;

/// Writes a picture for display: radiance times 2^`exposure_stops`, clamped to 0..1, through sRGB's transfer function
/// (IEC 61966-2-1), 8 bit, alpha not premultiplied (PNG's convention). Exposure leaves coverage as it is. `meta` becomes
/// text chunks (tEXt, or iTXt beyond ASCII).
///
/// # Errors
/// [`Error::Invalid`] for a picture whose pixels do not match its size, an exposure that is not finite, or a key that is
/// not 1 to 79 printable ASCII characters; [`Error::Io`] when the file cannot be written.
pub fn write_png(path: &Path, picture: &Picture, exposure_stops: f32, meta: &[(String, String)]) -> Result<()> {
    check(picture)?;
    if !exposure_stops.is_finite() {
        return Err(Error::Invalid { item: "exposure", what: format!("{exposure_stops} stops"), right: "it must be finite".into() });
    }
    for (key, value) in meta {
        let printable = key.chars().all(|c| (' '..='~').contains(&c)) && key.trim() == key;
        if !(1..=79).contains(&key.len()) || !printable || value.contains('\0') {
            return Err(Error::Invalid {
                item: "picture metadata",
                what: format!("the pair {:?}", key.chars().take(40).collect::<String>()),
                right: "keys have 1 to 79 printable ASCII characters and values no NUL".into(),
            });
        }
    }
    let size = |n: usize| {
        u32::try_from(n).ok().filter(|&n| n <= i32::MAX as u32).ok_or_else(|| Error::Invalid {
            item: "picture",
            what: format!("{n} pixels a side"),
            right: "PNG holds at most 2147483647".into(),
        })
    };
    let (width, height) = (size(picture.width)?, size(picture.height)?);
    let gain = exposure_stops.exp2();
    let bytes: Vec<u8> = picture.rgba.iter().flat_map(|&pixel| display(pixel, gain)).collect();
    let failed = |e: png::EncodingError| match e {
        png::EncodingError::IoError(source) => Error::Io { path: path.to_owned(), action: "write", source },
        other => Error::Format { path: path.to_owned(), what: format!("PNG: {other}"), right: "a smaller picture would fit".into() },
    };
    write_aside(path, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let software = ("Software".to_owned(), concat!("halflight ", env!("CARGO_PKG_VERSION")).to_owned());
        for (key, value) in std::iter::once(&software).chain(meta) {
            if value.is_ascii() {
                encoder.add_text_chunk(key.clone(), value.clone()).map_err(failed)?;
            } else {
                encoder.add_itxt_chunk(key.clone(), value.clone()).map_err(failed)?;
            }
        }
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&bytes).map_err(failed)?;
        writer.finish().map_err(failed)
    })
}

/// One pixel for display.
fn display([r, g, b, alpha]: [f32; 4], gain: f32) -> [u8; 4] {
    // A NaN goes through as NaN and ends as 0 in the cast.
    let alpha = alpha.clamp(0.0, 1.0);
    let color = |x: f32| if alpha > 0.0 { quantised(srgb(x.max(0.0) / alpha * gain)) } else { 0 };
    [color(r), color(g), color(b), quantised(alpha)]
}

/// sRGB's transfer function of linear 0..1.
pub fn srgb(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn quantised(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}
