//! widen: samples as a host stores them in a buffer or an image → as the volume's image stores them, exactly: integers v
//! become 16-bit unorm (uint8 as 257·v, int8 as 257·(v + 2⁷), int16 as v + 2¹⁵), floats single floats.

use super::Encoding;
use crate::error::Result;
use crate::kernels::widen as kernel;
use crate::scene::{Samples, Volume};
use crate::vk::{Buffer, Format, Recorder};

/// Types of a sample that a host may have, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 8-bit unsigned.
    U8,
    /// 8-bit signed.
    I8,
    /// 16-bit unsigned.
    U16,
    /// 16-bit signed.
    I16,
    /// 16-bit float.
    F16,
    /// 32-bit float.
    F32,
}

/// The image formats that hold such samples.
pub const FORMATS: [(Format, SampleType); 8] = [
    (Format::R8Unorm, SampleType::U8),
    (Format::R8Uint, SampleType::U8),
    (Format::R8Sint, SampleType::I8),
    (Format::R16Unorm, SampleType::U16),
    (Format::R16Uint, SampleType::U16),
    (Format::R16Sint, SampleType::I16),
    (Format::R16Sfloat, SampleType::F16),
    (Format::R32Sfloat, SampleType::F32),
];

impl SampleType {
    /// The samples of an image of the host.
    pub fn of(format: Format) -> Option<Self> {
        FORMATS.iter().find(|(f, _)| *f == format).map(|(_, s)| *s)
    }

    /// Bytes of a sample.
    pub fn bytes(self) -> u32 {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// The format of the volume's image.
    pub fn format(self) -> Format {
        if matches!(self, Self::F16 | Self::F32) { Format::R32Sfloat } else { Format::R16Unorm }
    }

    /// As what the volume's image stores these samples: 16-bit ones that 8 bits would hold as those, so that they use the image's
    /// range (some devices interpolate to 20 bits or so of it).
    pub fn stored_as(volume: &Volume) -> Self {
        let [lo, hi] = volume.stored_range();
        match volume.samples() {
            Samples::U16(_) if hi > 255.0 => Self::U16,
            Samples::I16(_) if lo < -128.0 || hi > 127.0 => Self::I16,
            Samples::I16(_) => Self::I8,
            Samples::U8(_) | Samples::U16(_) => Self::U8,
            Samples::F32(_) => Self::F32,
        }
    }

    /// The image's integer of a stored v is factor·(v + offset): (factor, offset). Floats are kept.
    pub fn spread(self) -> (i32, i32) {
        match self {
            Self::U8 => (257, 0),
            Self::I8 => (257, 128),
            Self::U16 => (1, 0),
            Self::I16 => (1, 32768),
            Self::F16 | Self::F32 => (1, 0),
        }
    }

    /// How many stored steps the image's unit is, and what is stored as 0; floats are kept.
    fn integers(self) -> Option<(f32, f32)> {
        let (factor, offset) = self.spread();
        (self.format() == Format::R16Unorm).then_some(((65535 / factor) as f32, -offset as f32))
    }

    /// As [`Encoding::of`] a volume of these samples.
    pub fn encoding(self, (slope, intercept): (f32, f32)) -> Encoding {
        let (scale, zero) = self.integers().unwrap_or((1.0, 0.0));
        Encoding { scale: slope * scale, bias: slope * zero + intercept }
    }

    /// The stored sample, exactly, of what the volume's image returns.
    pub fn stored(self, sample: f32) -> f32 {
        self.integers().map_or(sample, |(scale, zero)| (sample * scale).round() + zero)
    }

    /// The kernel's kind, for those that it has to change.
    fn kind(self) -> Option<u32> {
        match self {
            Self::U8 => Some(1),
            Self::I8 => Some(2),
            Self::I16 => Some(3),
            Self::F16 => Some(4),
            Self::U16 | Self::F32 => None,
        }
    }

    /// Whether [`record`] has anything to do; the others are copied as they are.
    pub fn widens(self) -> bool {
        self.kind().is_some()
    }

    /// Bytes of the buffer that [`record`] reads, and of the one that it writes, for so many samples.
    pub fn buffers(self, samples: u64) -> (u64, u64) {
        let words = |bytes: u64| bytes.next_multiple_of(4);
        (words(samples * u64::from(self.bytes())), words(samples * u64::from(self.format().bytes())))
    }
}

/// Records `samples` samples from `narrow` to `wide`, both packed tightly and of [`SampleType::buffers`] bytes at least.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, from: SampleType, narrow: &Buffer, wide: &Buffer, samples: u64) -> Result<()> {
    let Some(kind) = from.kind() else { return Ok(()) };
    let words = (from.buffers(samples).1 / 4).min(u64::from(u32::MAX)) as u32;
    rec.dispatch(&kernel::Bindings { narrow, wide }, &kernel::Spec { kind }, &kernel::Params { words }, [words, 1, 1])
}

/// The twin: each sample read as its type, and its image's sample written.
pub fn reference(from: SampleType, narrow: &[u8]) -> Vec<u8> {
    match from {
        SampleType::U8 => narrow.iter().flat_map(|&v| (u16::from(v) * 257).to_le_bytes()).collect(),
        SampleType::I8 => narrow.iter().flat_map(|&v| ((i32::from(v.cast_signed()) + 128) as u16 * 257).to_le_bytes()).collect(),
        SampleType::I16 => {
            let value = |b: &[u8]| i32::from(i16::from_le_bytes([b[0], b[1]]));
            narrow.chunks_exact(2).flat_map(|b| ((value(b) + 32768) as u16).to_le_bytes()).collect()
        }
        SampleType::F16 => narrow.chunks_exact(2).flat_map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32().to_le_bytes()).collect(),
        SampleType::U16 | SampleType::F32 => narrow.to_vec(),
    }
}
