//! `hl_image_*_layer`: what lies behind the pixels of a picture.

use super::abi::*;
use super::call::{enter, put};
use super::fault::{Fault, Result};
use super::host::lock;
use super::image::ImageCell;
use crate::engine::{Behind, LAYERS, layer_channels};
use crate::io::ExrChannel;
use std::sync::Arc;

/// Bit and place in [`LAYERS`].
pub(super) const BITS: [u32; LAYERS.len()] =
    [HL_LAYER_DEPTH, HL_LAYER_NORMAL, HL_LAYER_ALBEDO, HL_LAYER_IRRADIANCE, HL_LAYER_VISIBILITY, HL_LAYER_OPACITY];

/// The layers of an image.
pub(super) struct Layers {
    /// Those that were asked for.
    pub bits: u32,
    pub behind: Vec<Behind>,
}

/// A sum of layers' bits.
pub(super) fn bits(item: &str, bits: u32) -> Result<u32> {
    match bits & !BITS.iter().sum::<u32>() {
        0 => Ok(bits),
        _ => Err(Fault::invalid(item, format_args!("is {bits}"), "it must be a sum of HL_LAYER_...")),
    }
}

/// The layers of an image that has all of `bits`.
pub(super) fn of(image: &ImageCell, bits: u32) -> Result<&Layers> {
    let has = image.layers.as_ref().map_or(0, |l| l.bits);
    match &image.layers {
        Some(layers) if bits & !has == 0 => Ok(layers),
        _ => {
            let missing: Vec<&str> = LAYERS.iter().zip(BITS).filter(|(_, b)| bits & b & !has != 0).map(|(l, _)| l.0).collect();
            let what = format!("has no layer {}", missing.join(", "));
            Err(Fault::invalid("image", what, "ask for it with hl_render_info.layers"))
        }
    }
}

/// The channels of some layers, as a file stores them.
pub(super) fn channels(layers: &Layers, bits: u32) -> Vec<ExrChannel> {
    let wanted = (0..LAYERS.len()).filter(|&i| bits & BITS[i] != 0);
    let named = wanted.flat_map(|i| layer_channels(i, &layers.behind));
    named.map(|(name, values)| ExrChannel { name: name.into(), values, full: name.starts_with("depth") }).collect()
}

/// The place of the one layer that `layer` names.
fn place(layer: u32) -> Result<usize> {
    BITS.iter()
        .position(|&b| b == layer)
        .ok_or_else(|| Fault::invalid("layer", format_args!("is {layer}"), "it must be one of HL_LAYER_..."))
}

/// All numbers of a layer, pixel by pixel.
fn numbers(layers: &Layers, place: usize) -> Vec<f32> {
    let count = LAYERS[place].1.len();
    layers.behind.iter().flat_map(|b| (0..count).map(move |c| b.channel(place, c))).collect()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_read_layer(image: *const hl_image, layer: u32, data: *mut f32, count: u64) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        let place = place(layer)?;
        let numbers = numbers(of(&image, layer)?, place);
        if data.is_null() || count != numbers.len() as u64 {
            let what = if data.is_null() { "data is NULL".into() } else { format!("count is {count}") };
            return Err(Fault::invalid("layer", what, &format!("room for {} numbers is needed", numbers.len())));
        }
        // SAFETY: the caller says that `count` numbers fit, and there are as many; bytes need no alignment.
        unsafe { std::ptr::copy_nonoverlapping(numbers.as_ptr().cast::<u8>(), data.cast::<u8>(), 4 * numbers.len()) };
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_map_layer(image: *mut hl_image, layer: u32, data: *mut *const f32, count: *mut u64) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        if data.is_null() {
            return Err(Fault::invalid("data", "is NULL", "a place for the pointer is needed"));
        }
        let place = place(layer)?;
        let layers = of(&image, layer)?;
        let mut mapped = lock(&image.mapped);
        let numbers = mapped.layers[place].get_or_insert_with(|| Arc::new(numbers(layers, place)));
        put(data, numbers.as_ptr());
        put(count, numbers.len() as u64);
        mapped.count = mapped.count.saturating_add(1);
        Ok(HL_OK)
    })
}
