//! Pixels as hosts lay them: formats and strides.

use super::abi::*;
use super::call::choice;
use super::fault::{Fault, Result};
use crate::io::png::{display, linear};
use crate::scene::Picture;

/// Largest side of an image.
const MAX_SIDE: u32 = 1 << 16;

/// A pixel's type.
#[derive(Clone, Copy, PartialEq)]
enum Format {
    Rgba32F,
    Rgb32F,
    Rgba8,
}

impl Format {
    fn of(item: &str, format: i32) -> Result<Self> {
        choice(item, format, &[(HL_RGBA32F, Self::Rgba32F), (HL_RGB32F, Self::Rgb32F), (HL_RGBA8, Self::Rgba8)])
    }

    fn bytes(self) -> usize {
        match self {
            Self::Rgba32F => 16,
            Self::Rgb32F => 12,
            Self::Rgba8 => 4,
        }
    }
}

/// How pixels lie in memory.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    pub width: usize,
    pub height: usize,
    format: Format,
    /// Bytes from a column, and from a row, to the next.
    strides: [i64; 2],
}

impl Layout {
    pub fn of(info: &hl_image_info) -> Result<Self> {
        let format = Format::of("hl_image_info.format", info.format)?;
        let sides = [info.width, info.height];
        if sides.iter().any(|n| !(1..=MAX_SIDE).contains(n)) {
            return Err(Fault::invalid(
                "hl_image_info.width and height",
                format_args!("are {}x{}", info.width, info.height),
                "each must be 1 to 65536",
            ));
        }
        let column = if info.column_stride == 0 { format.bytes() as i64 } else { info.column_stride };
        // Rows go down, wherever columns go.
        let packed = column.checked_abs().and_then(|column| i64::from(info.width).checked_mul(column));
        let row = if info.row_stride == 0 { packed } else { Some(info.row_stride) };
        let reach = |n: u32, stride: i64| (i64::from(n) - 1).checked_mul(stride.checked_abs()?);
        let all = row.and_then(|row| reach(info.width, column)?.checked_add(reach(info.height, row)?));
        match (row, all) {
            (Some(row), Some(all)) if all <= isize::MAX as i64 - 16 => {
                Ok(Self { width: info.width as usize, height: info.height as usize, format, strides: [column, row] })
            }
            _ => Err(Fault::invalid("hl_image_info.column_stride and row_stride", "reach beyond any memory", "count them in bytes")),
        }
    }

    /// The pixels at `data`, the top left one.
    pub fn picture(&self, data: *const u8) -> Result<Picture> {
        let mut rgba = Vec::new();
        rgba.try_reserve_exact(self.width * self.height).map_err(|_| Fault::memory("a copy of the image"))?;
        for y in 0..self.height as i64 {
            for x in 0..self.width as i64 {
                // No overflow: `of` checked the farthest pixel.
                let at = data.wrapping_offset((x * self.strides[0] + y * self.strides[1]) as isize);
                // SAFETY: the caller says that a pixel lies at every place that size and strides name; no alignment is
                // asked for.
                rgba.push(unsafe {
                    match self.format {
                        Format::Rgba32F => at.cast::<[f32; 4]>().read_unaligned(),
                        Format::Rgb32F => {
                            let [r, g, b] = at.cast::<[f32; 3]>().read_unaligned();
                            [r, g, b, 1.0]
                        }
                        Format::Rgba8 => {
                            let [r, g, b, a] = at.cast::<[u8; 4]>().read().map(|v| f32::from(v) / 255.0);
                            [linear(r) * a, linear(g) * a, linear(b) * a, a]
                        }
                    }
                });
            }
        }
        Ok(Picture { width: self.width, height: self.height, rgba })
    }
}

/// Copies a picture to `size` bytes, in which its top left pixel lies at `data`.
pub(super) fn write(picture: &Picture, format: i32, exposure: f64, data: *mut u8, row_stride: i64, size: u64) -> Result<()> {
    let format = Format::of("format", format)?;
    if data.is_null() {
        return Err(Fault::invalid("data", "is NULL", "room for the pixels is needed"));
    }
    if !exposure.is_finite() {
        return Err(Fault::invalid("exposure", format_args!("is {exposure}"), "it must be finite"));
    }
    let row = picture.width * format.bytes();
    let stride = if row_stride == 0 { row as i64 } else { row_stride };
    let needs = (picture.height as u64 - 1).checked_mul(stride.unsigned_abs()).and_then(|n| n.checked_add(row as u64));
    if stride.unsigned_abs() < row as u64 || needs.is_none_or(|n| n > size) {
        let what = format!("{size} bytes in rows of {stride}");
        return Err(Fault::invalid("size and row_stride", what, &format!("{} rows of {row} bytes are needed", picture.height)));
    }
    let gain = (exposure as f32).exp2();
    for (y, pixels) in picture.rgba.chunks_exact(picture.width).enumerate() {
        let bytes: Vec<u8> = match format {
            Format::Rgba32F => bytemuck::cast_slice(pixels).to_vec(),
            Format::Rgb32F => pixels.iter().flat_map(|&[r, g, b, _]| bytemuck::cast::<_, [u8; 12]>([r, g, b])).collect(),
            Format::Rgba8 => pixels.iter().flat_map(|&p| display(p, gain)).collect(),
        };
        // SAFETY: the caller says that `size` bytes are there, behind `data` or, where rows go upwards, with `data` as the last
        // of them; the check above keeps every row within them, and so the offset within what can be counted.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), data.offset(y as isize * stride as isize), row) };
    }
    Ok(())
}
