//! Pixels → PNG: charts, pictures, differences.

use crate::error::{Error, Result};
use crate::io::png::srgb;
use crate::scene::Picture;

/// A chart of twice the size, RGB, as a PNG of `width`·`height` pixels: each the mean of four.
pub fn halved_png(width: u32, height: u32, fine: &[u8]) -> Result<Vec<u8>> {
    let row = 6 * width as usize;
    let mut bytes = Vec::with_capacity(4 * width as usize * height as usize);
    for rows in fine.chunks_exact(2 * row) {
        let (upper, lower) = rows.split_at(row);
        for (a, b) in upper.chunks_exact(6).zip(lower.chunks_exact(6)) {
            let mean = |c: usize| ((u32::from(a[c]) + u32::from(a[c + 3]) + u32::from(b[c]) + u32::from(b[c + 3]) + 2) / 4) as u8;
            bytes.extend([mean(0), mean(1), mean(2), 255]);
        }
    }
    encode(width, height, &bytes)
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
    fn four_pixels_become_their_mean() {
        let fine = [0, 10, 255, 4, 10, 255, 8, 10, 255, 12, 10, 255];
        assert_eq!(decoded(&halved_png(1, 1, &fine).unwrap()), [6, 10, 255, 255]);
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
