//! SVG → PNG with the embedded font: no fonts of the system are asked for, so every machine draws the same.

use crate::error::{Error, Result};
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
    let mut out = Vec::new();
    let failed = |e: png::EncodingError| bad(e.to_string());
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(failed)?;
    // The ground is opaque: premultiplied or not is the same.
    writer.write_image_data(pixels.data()).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(out)
}
