//! SVG → PNG with the embedded font: no fonts of the system are asked for, so every machine draws the same.

use crate::error::{Error, Result};
use crate::io::png::srgb;
use crate::scene::Picture;
use resvg::{tiny_skia, usvg};
use std::sync::Arc;

/// DejaVu Sans, cut to Latin, figures and some signs (its licence lies beside it).
const FONT: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// An SVG of this module as PNG, `scale` pixels per unit.
///
/// # Errors
/// [`Error::Invalid`] for a picture that is no SVG or too large.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>> {
    let bad =
        |what: String| Error::Invalid { item: "chart", what, right: "an SVG of up to some thousand pixels a side can be drawn".into() };
    let mut options = usvg::Options { font_family: "DejaVu Sans".into(), ..usvg::Options::default() };
    Arc::make_mut(&mut options.fontdb).load_font_data(FONT.to_vec());
    let tree = usvg::Tree::from_str(svg, &options).map_err(|e| bad(e.to_string()))?;
    let size = tree.size();
    let (width, height) = ((size.width() * scale).ceil() as u32, (size.height() * scale).ceil() as u32);
    let mut pixels = tiny_skia::Pixmap::new(width, height).ok_or_else(|| bad(format!("{width}x{height} pixels")))?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut pixels.as_mut());
    // The ground is opaque: premultiplied or not is the same.
    encode(width, height, pixels.data())
}

/// What shines through a picture: linear radiance after exposure.
const BACKDROP: [f32; 3] = [0.045, 0.05, 0.06];

/// A picture for the eye, over a dark backdrop.
pub fn picture_png(picture: &Picture, exposure: f64) -> Result<Vec<u8>> {
    let gain = exposure.exp2() as f32;
    let pixel = |p: &[f32; 4]| {
        let through = 1.0 - p[3].clamp(0.0, 1.0);
        let channel = |c: usize| byte(srgb((p[c] * gain + through * BACKDROP[c]).max(0.0)));
        [channel(0), channel(1), channel(2), 255]
    };
    let bytes: Vec<u8> = picture.rgba.iter().flat_map(pixel).collect();
    encode(size(picture.width)?, size(picture.height)?, &bytes)
}

/// Differences as colours: black for 0 to light yellow for ½ and more.
pub fn heat_png(width: usize, height: usize, values: &[f32]) -> Result<Vec<u8>> {
    // Inferno, at sixths.
    const COLORS: [[f32; 3]; 7] = [
        [0.0, 0.0, 0.01],
        [0.16, 0.04, 0.33],
        [0.42, 0.09, 0.43],
        [0.66, 0.18, 0.37],
        [0.88, 0.35, 0.20],
        [0.98, 0.63, 0.08],
        [0.99, 1.0, 0.64],
    ];
    let pixel = |v: &f32| {
        // A NaN becomes 0 in the cast.
        let t = (v * 2.0).clamp(0.0, 1.0) * 6.0;
        let (i, f) = ((t as usize).min(5), t - (t as usize).min(5) as f32);
        let channel = |c: usize| byte(COLORS[i][c] + f * (COLORS[i + 1][c] - COLORS[i][c]));
        [channel(0), channel(1), channel(2), 255]
    };
    let bytes: Vec<u8> = values.iter().flat_map(pixel).collect();
    encode(size(width)?, size(height)?, &bytes)
}

fn byte(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}

fn bad(what: String) -> Error {
    Error::Invalid { item: "chart", what, right: "a picture of up to some thousand pixels a side can be drawn".into() }
}

fn size(n: usize) -> Result<u32> {
    u32::try_from(n).map_err(|_| bad(format!("{n} pixels a side")))
}

fn encode(width: u32, height: u32, rgba: &[u8]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    let failed = |e: png::EncodingError| bad(e.to_string());
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(rgba).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn decoded(png: &[u8]) -> Vec<u8> {
        let mut reader = ::png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn text_is_drawn_with_the_embedded_font() {
        let draw = |text: &str| {
            let mut svg = crate::chart::svg::Svg::new(200.0, 40.0);
            svg.text([5.0, 30.0], 24.0, crate::chart::svg::Anchor::Start, crate::chart::svg::INK, text);
            let bytes = decoded(&png(&svg.finish("t"), 1.0).unwrap());
            assert_eq!(bytes.len(), 200 * 40 * 4);
            bytes.chunks_exact(4).filter(|p| p[0] < 128).count()
        };
        // Ink where there is text, more where there is more, none where there is none.
        assert_eq!(draw(" "), 0);
        let (short, long) = (draw("1:4"), draw("1:4, σ ≤ ¼ √2"));
        assert!(short > 50 && long > 2 * short, "{short} {long}");
        assert!(png("<svg", 1.0).is_err());
    }

    #[test]
    fn pictures_and_differences_are_seen() {
        let picture = Picture { width: 2, height: 1, rgba: vec![[1.0, 1.0, 1.0, 1.0], [0.0; 4]] };
        let bytes = decoded(&picture_png(&picture, 0.0).unwrap());
        assert_eq!(bytes[..4], [255; 4]);
        assert!(bytes[4] > 40 && bytes[4] < 80 && bytes[6] > bytes[4]);
        let heat = decoded(&heat_png(3, 1, &[0.0, f32::NAN, 9.0]).unwrap());
        assert!(heat[0] == 0 && heat[4] == 0 && heat[8] > 250);
    }
}
