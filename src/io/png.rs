//! PNG: pictures for the eye, 8 bit sRGB.

use super::exr::{MAX_PIXELS, check};
use super::limits::{bad, open};
use super::picture::PictureInfo;
use super::write_aside;
use crate::error::{Error, Result};
use crate::scene::Picture;
use std::io::{BufRead, Seek};
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

/// The first eight bytes of a PNG file.
pub(super) const MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

/// Reads a picture as [`write_png`] writes it, or any other PNG (grey, palette, 1 to 16 bits; of an animation the still
/// picture), taking its samples for sRGB whatever else it says of them: linear, premultiplied; coverage 1 without alpha.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; [`Error::Format`] when it is damaged, no PNG, or too large.
pub fn read_picture_png(path: &Path) -> Result<Picture> {
    let failed = |e: png::DecodingError| match e {
        png::DecodingError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::Io { path: path.to_owned(), action: "read", source }
        }
        other => {
            let what = format!("PNG: {}", super::limits::quote(&other.to_string()));
            bad(path, what, "a whole, undamaged picture is needed")
        }
    };
    let (file, _) = open(path)?;
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(failed)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let size = reader.output_buffer_size().filter(|_| width.checked_mul(height).is_some_and(|n| n <= MAX_PIXELS));
    let room = |size: usize| {
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(size).ok()?;
        bytes.resize(size, 0u8);
        Some(bytes)
    };
    let too_large = || bad(path, format!("{width}x{height} pixels"), format!("at most {MAX_PIXELS} that fit into memory are read"));
    let mut bytes = size.and_then(room).ok_or_else(too_large)?;
    let frame = reader.next_frame(&mut bytes).map_err(failed)?;
    let channels = frame.color_type.samples();
    let wide = frame.bit_depth == png::BitDepth::Sixteen;
    let each = channels * if wide { 2 } else { 1 };
    // Linear values of all that a sample can be.
    let table: Vec<f32> = if wide {
        (0..=65535).map(|i| linear(i as f32 / 65535.0)).collect()
    } else {
        (0..=255).map(|i| linear(i as f32 / 255.0)).collect()
    };
    let top = (table.len() - 1) as f32;
    let mut picture = Picture { width, height, rgba: Vec::new() };
    picture.rgba.try_reserve_exact(width * height).map_err(|_| too_large())?;
    picture.rgba.extend(bytes[..frame.buffer_size()].chunks_exact(each).map(|pixel| {
        let sample = |c: usize| if wide { usize::from(pixel[2 * c]) << 8 | usize::from(pixel[2 * c + 1]) } else { usize::from(pixel[c]) };
        let (color, alpha) = match channels {
            1 | 2 => ([0; 3], 1),
            _ => ([0, 1, 2], 3),
        };
        let alpha = if alpha < channels { sample(alpha) as f32 / top } else { 1.0 };
        let [r, g, b] = color.map(|c| table[sample(c)] * alpha);
        [r, g, b, alpha]
    }));
    check(&picture).map_err(|_| bad(path, format!("{} of its {width}x{height} pixels", picture.rgba.len()), "all must be there"))?;
    Ok(picture)
}

/// A picture's texts, as [`write_png`] writes them.
pub(super) fn entries(info: &png::Info) -> Vec<(String, String)> {
    let ascii = info.uncompressed_latin1_text.iter().map(|t| (t.keyword.clone(), t.text.clone()));
    ascii.chain(info.utf8_text.iter().filter_map(|t| Some((t.keyword.clone(), t.get_text().ok()?)))).collect()
}

/// What a PNG's header says.
pub(super) fn describe(file: impl BufRead + Seek) -> Option<PictureInfo> {
    let reader = png::Decoder::new(file).read_info().ok()?;
    let info = reader.info();
    let (software, meta) = entries(info).into_iter().partition::<Vec<_>, _>(|(key, _)| key == "Software");
    let names: &[&str] = if info.color_type == png::ColorType::Rgba { &["R", "G", "B", "A"] } else { &[] };
    Some(PictureInfo {
        width: info.width as usize,
        height: info.height as usize,
        channels: names.iter().map(|name| ((*name).to_owned(), "8-bit")).collect(),
        software: software.into_iter().next().map_or_else(String::new, |(_, value)| value),
        meta,
    })
}

/// Whether a PNG's texts are `wanted` and its pixels are all there.
pub(super) fn whole(path: &Path, wanted: &super::MetaFilter) -> Result<bool> {
    let failed = |e: png::DecodingError| bad(path, format!("PNG: {}", super::limits::quote(&e.to_string())), "a whole picture is needed");
    let reader = png::Decoder::new(open(path)?.0).read_info().map_err(failed)?;
    if !wanted(&entries(reader.info())) {
        return Ok(false);
    }
    drop(reader);
    read_picture_png(path)?;
    // The end of the file, too: what was cut off behind the pixels is not whole.
    let bytes = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), action: "read", source })?;
    Ok(bytes.ends_with(b"IEND\xaeB`\x82"))
}

/// Linear value of sRGB's 0..1: the inverse of [`srgb`].
pub fn linear(srgb: f32) -> f32 {
    if srgb <= 0.04045 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// One pixel for display.
pub(crate) fn display([r, g, b, alpha]: [f32; 4], gain: f32) -> [u8; 4] {
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
