//! `hl_image_*_layer`: what lies behind the pixels of a picture.

use super::abi::*;
use super::call::{enter, put};
use super::fault::{Fault, Result};
use super::host::lock;
use super::image::ImageCell;
use crate::engine::{Behind, LAYERS, layer_channels};
use crate::io::ExrChannel;
use crate::room::reserved;
use std::sync::Arc;

/// How many there are: those of [`LAYERS`], and the noise of a reference picture.
pub(super) const COUNT: usize = LAYERS.len() + 1;

/// Bit of each.
pub(super) const BITS: [u32; COUNT] =
    [HL_LAYER_DEPTH, HL_LAYER_NORMAL, HL_LAYER_ALBEDO, HL_LAYER_IRRADIANCE, HL_LAYER_VISIBILITY, HL_LAYER_OPACITY, HL_LAYER_NOISE];

/// Name and channels of the last.
const NOISE: (&str, &[&str]) = ("noise", &["noise.R", "noise.G", "noise.B"]);

/// The layers of an image.
pub(super) enum Layers {
    /// What lies behind its pixels; the bits of what was asked for.
    Behind(u32, Vec<Behind>),
    /// The standard error of its R, G, B.
    Noise(Vec<[f32; 3]>),
}

impl Layers {
    fn bits(&self) -> u32 {
        match self {
            Self::Behind(bits, _) => *bits,
            Self::Noise(_) => HL_LAYER_NOISE,
        }
    }

    /// The layer at a place in [`BITS`], channel by channel.
    fn channels(&self, place: usize) -> Vec<(&'static str, Vec<f32>)> {
        match self {
            Self::Behind(_, behind) => layer_channels(place, behind).collect(),
            Self::Noise(noise) => NOISE.1.iter().enumerate().map(|(c, name)| (*name, noise.iter().map(|n| n[c]).collect())).collect(),
        }
    }

    /// The same, pixel by pixel.
    fn numbers(&self, place: usize) -> Result<Vec<f32>> {
        let room = |pixels: usize, channels: usize| Ok::<_, Fault>(reserved("a layer of an image", pixels * channels)?);
        match self {
            Self::Behind(_, behind) => {
                let count = LAYERS[place].1.len();
                let mut all = room(behind.len(), count)?;
                all.extend(behind.iter().flat_map(|b| (0..count).map(move |c| b.channel(place, c))));
                Ok(all)
            }
            Self::Noise(noise) => {
                let mut all = room(noise.len(), 3)?;
                all.extend_from_slice(noise.as_flattened());
                Ok(all)
            }
        }
    }
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
    let has = image.layers.as_ref().map_or(0, Layers::bits);
    match &image.layers {
        Some(layers) if bits & !has == 0 => Ok(layers),
        _ => {
            let names = LAYERS.iter().map(|l| l.0).chain([NOISE.0]);
            let missing: Vec<&str> = names.zip(BITS).filter(|(_, b)| bits & b & !has != 0).map(|(name, _)| name).collect();
            let right = match bits & !has & HL_LAYER_NOISE {
                0 => "ask for it with hl_render_info.layers",
                _ => "reference pictures have noise, and nothing else",
            };
            Err(Fault::invalid("image", format!("has no layer {}", missing.join(", ")), right))
        }
    }
}

/// The channels of some layers, as a file stores them.
pub(super) fn channels(layers: &Layers, bits: u32) -> Vec<ExrChannel> {
    let wanted = (0..COUNT).filter(|&i| bits & BITS[i] != 0);
    let named = wanted.flat_map(|i| layers.channels(i));
    named.map(|(name, values)| ExrChannel { name: name.into(), values, full: name.starts_with("depth") }).collect()
}

/// The place of the one layer that `layer` names.
fn place(layer: u32) -> Result<usize> {
    BITS.iter()
        .position(|&b| b == layer)
        .ok_or_else(|| Fault::invalid("layer", format_args!("is {layer}"), "it must be one of HL_LAYER_..."))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_read_layer(image: *const hl_image, layer: u32, data: *mut f32, count: u64) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        let place = place(layer)?;
        let numbers = of(&image, layer)?.numbers(place)?;
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
        let numbers = match &mapped.layers[place] {
            Some(numbers) => numbers.clone(),
            None => mapped.layers[place].insert(Arc::new(layers.numbers(place)?)).clone(),
        };
        put(data, numbers.as_ptr());
        put(count, numbers.len() as u64);
        mapped.count = mapped.count.saturating_add(1);
        Ok(HL_OK)
    })
}
