//! A field under a light.

use super::{Engine, Field, Progress, in_parts, quiet, telling};
use crate::error::Result;
use crate::room::zeroed;
use crate::scene::Light;
use crate::stages::relight;
use crate::vk::{Access, Buffer, Image, ImageDesc};

/// A field under a light: what a picture needs.
pub struct Lit {
    field: Field,
    light: Light,
    /// Over the box around all bricks of the field.
    image: Image,
    /// Where that box stands; see [`relight::window`].
    window: Buffer,
    /// Radiance that 1 in `image` stands for: keeps any light within half floats.
    scale: f32,
}

impl Lit {
    /// The field.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The light.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// Bytes of the irradiance on the device.
    pub fn bytes(&self) -> u64 {
        self.image.bytes()
    }

    /// What the kernel takes.
    pub(super) fn irradiance(&self) -> (&Image, &Buffer, f32) {
        (&self.image, &self.window, self.scale)
    }
}

impl Engine {
    /// Puts a field under a light; no visibility is computed.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`], and what the device refuses.
    pub fn relight(&self, field: &Field, light: &Light) -> Result<Lit> {
        self.relight_watched(field, light, &mut quiet)
    }

    /// The same, told of its progress.
    ///
    /// # Errors
    /// As [`Engine::relight`], and [`crate::Error::Cancelled`].
    pub fn relight_watched(&self, field: &Field, light: &Light, progress: &mut Progress) -> Result<Lit> {
        let mut tell = telling("relight", progress);
        tell(0.0)?;
        let bricks = field.bricks();
        let dims = relight::dims(bricks);
        let format = relight::format(light.coefficients.iter().all(|l| l[0] == l[1] && l[1] == l[2]));
        let bytes = self.padding().image(dims, format.bytes().into());
        self.ask("the irradiance volume", bytes, |_| "compute a coarser field, or allow more memory".into())?;
        let desc = ImageDesc { name: "irradiance", dims, levels: 1, format, views: &[], storage: true };
        let image = self.device.image3(&desc)?;
        let window = self.device.buffer_from("window", &relight::window(field.dims(), bricks))?;
        // |S/ϖ| ≤ |v||L|/4π with |v| ≤ 2√π, 0.28 of the light's norm: this scale puts every cell within ±1200, where half
        // floats have room on both sides.
        let norm = (0..3).map(|c| light.coefficients.iter().map(|l| l[c] * l[c]).sum::<f64>().sqrt()).fold(0.0, f64::max);
        let scale = if norm > 0.0 && norm.is_finite() { norm / 4096.0 } else { 1.0 };
        let coefficients: Vec<[f32; 4]> = light.scaled(1.0 / scale).to_f32().iter().map(|l| [l[0], l[1], l[2], 0.0]).collect();
        let light_buffer = self.device.buffer_from("light", &coefficients)?;
        let mut rec = self.device.record()?;
        // A fresh image takes the layout for stores.
        rec.barrier(&[image.mip(0).from(Access::None).to(Access::ComputeWrite)]);
        let (dims, bands) = (field.dims(), field.settings().bands);
        relight::record(&mut rec, &field.packed(), (dims, bricks), &light_buffer, &image, bands, &mut in_parts(&mut tell))?;
        // The renderers only read it.
        rec.barrier(&[image.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
        rec.submit()?;
        Ok(Lit { field: field.clone(), light: *light, image, window, scale: scale as f32 })
    }

    /// (S/ϖ per channel, mean visibility) of every cell, x fastest, zero where the field holds nothing: for tests and
    /// charts.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_irradiance(&self, lit: &Lit) -> Result<Vec<[f32; 4]>> {
        let bytes = self.device.read_image(&lit.image, 0)?;
        let value = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32();
        let unit = [lit.scale, lit.scale, lit.scale, 1.0];
        // Which number of a texel stands for each channel and for the mean visibility.
        let (place, size) = if lit.image.format() == relight::format(true) { ([0, 0, 0, 1], 4) } else { ([0, 1, 2, 3], 8) };
        let ([lo, hi], n) = (lit.field.bricks().window(), lit.field.dims());
        let mut out: Vec<[f32; 4]> = zeroed("an irradiance volume", n.iter().product())?;
        let row = size * (hi[0] - lo[0]);
        for (index, texels) in bytes.chunks_exact(row).enumerate() {
            let (y, z) = (lo[1] + index % (hi[1] - lo[1]), lo[2] + index / (hi[1] - lo[1]));
            let first = lo[0] + n[0] * (y + n[1] * z);
            for (cell, t) in out[first..].iter_mut().zip(texels.chunks_exact(size)) {
                *cell = std::array::from_fn(|c| unit[c] * value(&t[2 * place[c]..2 * place[c] + 2]));
            }
        }
        Ok(out)
    }
}
