//! The values of a node: which are stored at all, how they are compressed, what type they have.

use super::super::limits::{bad, quote};
use super::stream::Stream;
use crate::error::Result;
use flate2::bufread::ZlibDecoder;
use half::f16;
use std::io::Read;
use std::path::Path;

/// Bit of a grid's compression: zlib.
const ZIP: u32 = 1;
/// Bit: only values of active voxels are stored, the others follow from the background.
const ACTIVE_MASK: u32 = 2;
/// Bit: Blosc.
const BLOSC: u32 = 4;

/// What stands before a node's values: how its inactive values follow. 0: all are the background.
const MINUS_BACKGROUND: u8 = 1;
const ONE_INACTIVE: u8 = 2;
const MASK_OF_BACKGROUNDS: u8 = 3;
const MASK_AND_ONE: u8 = 4;
const MASK_AND_TWO: u8 = 5;
/// All values are stored.
const ALL: u8 = 6;

/// A number as it stands in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    F16,
    F32,
    F64,
    I32,
    I64,
}

impl Scalar {
    pub fn bytes(self) -> usize {
        match self {
            Scalar::F16 => 2,
            Scalar::F32 | Scalar::I32 => 4,
            Scalar::F64 | Scalar::I64 => 8,
        }
    }

    /// The number at the head of `b`, as `f32`: beyond its range infinite.
    fn decode(self, b: &[u8]) -> f32 {
        fn head<const N: usize>(b: &[u8]) -> [u8; N] {
            b.first_chunk().copied().unwrap_or([0; N])
        }
        match self {
            Scalar::F16 => f16::from_le_bytes(head(b)).to_f32(),
            Scalar::F32 => f32::from_le_bytes(head(b)),
            Scalar::F64 => f64::from_le_bytes(head(b)) as f32,
            Scalar::I32 => i32::from_le_bytes(head(b)) as f32,
            Scalar::I64 => i64::from_le_bytes(head(b)) as f32,
        }
    }
}

/// The value type of a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    pub scalar: Scalar,
    /// Numbers per voxel: 1, or 3 for a vector.
    pub lanes: usize,
    /// Type of the numbers in a node's values; single ones (background, tiles of the root) keep `scalar`.
    pub stored: Scalar,
}

impl Kind {
    /// The kind of a tree's type name, such as "Tree_float_5_4_3_HalfFloat"; `None` for one that is not read.
    pub fn of_tree(name: &str) -> Option<Self> {
        let half = name.strip_suffix("_HalfFloat");
        let value = half.unwrap_or(name).strip_prefix("Tree_")?.strip_suffix("_5_4_3")?;
        let (scalar, lanes) = match value {
            "half" => (Scalar::F16, 1),
            "float" => (Scalar::F32, 1),
            "double" => (Scalar::F64, 1),
            "int32" => (Scalar::I32, 1),
            "int64" => (Scalar::I64, 1),
            "vec3s" => (Scalar::F32, 3),
            "vec3d" => (Scalar::F64, 3),
            "vec3i" => (Scalar::I32, 3),
            _ => return None,
        };
        let stored = if half.is_some() { Scalar::F16 } else { scalar };
        Some(Self { scalar, lanes, stored })
    }

    fn value_bytes(self) -> usize {
        self.scalar.bytes() * self.lanes
    }
}

/// How the values of one grid are coded, and which of them are wanted.
pub(super) struct Coding {
    pub kind: Kind,
    /// The number of each voxel that is kept.
    pub lane: usize,
    /// Factor on every value: −1 for level sets.
    pub sign: f32,
    /// Value of what the tree does not hold, `sign` applied.
    pub background: f32,
    zip: bool,
    blosc: bool,
    masked: bool,
    packed: Vec<u8>,
    plain: Vec<u8>,
}

impl Coding {
    /// From a grid's compression flags.
    pub fn new(path: &Path, flags: u32, kind: Kind, lane: usize, sign: f32) -> Result<Self> {
        if flags & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
            return Err(bad(path, format!("its compression is {flags:#x}"), "none, zip, blosc and active values are read"));
        }
        let (zip, blosc, masked) = (flags & ZIP != 0, flags & BLOSC != 0, flags & ACTIVE_MASK != 0);
        Ok(Self { kind, lane, sign, background: 0.0, zip, blosc, masked, packed: Vec::new(), plain: Vec::new() })
    }

    /// One value that stands alone.
    pub fn single(&self, stream: &mut Stream, what: &'static str) -> Result<f32> {
        let mut bytes = [0; 24];
        let bytes = &mut bytes[..self.kind.value_bytes()];
        stream.read(bytes, what)?;
        Ok(self.sign * self.kind.scalar.decode(&bytes[self.lane * self.kind.scalar.bytes()..]))
    }

    /// The values of a node whose active ones are those of `mask`, into `out`.
    pub fn node(&mut self, stream: &mut Stream, mask: &[u64], out: &mut [f32], what: &'static str) -> Result<()> {
        let (code, inactive) = self.inactive(stream, what)?;
        let mut selection = [0; 512];
        let selection = &mut selection[..mask.len()];
        if matches!(code, MASK_OF_BACKGROUNDS | MASK_AND_ONE | MASK_AND_TWO) {
            stream.mask(selection, what)?;
        }
        let count = self.count(code, mask, out.len());
        self.unpack(stream, count, what)?;
        let (lane, each) = (self.lane * self.kind.stored.bytes(), self.kind.lanes * self.kind.stored.bytes());
        let mut stored = self.plain.chunks_exact(each).map(|v| self.sign * self.kind.stored.decode(&v[lane..]));
        let bit = |mask: &[u64], i: usize| mask[i / 64] >> (i % 64) & 1 != 0;
        for (i, value) in out.iter_mut().enumerate() {
            let there = if count == mask.len() * 64 || bit(mask, i) { stored.next() } else { None };
            *value = there.unwrap_or(inactive[usize::from(bit(selection, i))]);
        }
        Ok(())
    }

    /// Passes over the values of a node.
    pub fn skip(&mut self, stream: &mut Stream, mask: &[u64], what: &'static str) -> Result<()> {
        let (code, _) = self.inactive(stream, what)?;
        if matches!(code, MASK_OF_BACKGROUNDS | MASK_AND_ONE | MASK_AND_TWO) {
            stream.skip(mask.len() as u64 * 8, what)?;
        }
        let count = self.count(code, mask, mask.len() * 64);
        let bytes = match self.size(stream, count, what)? {
            Size::Packed(n) | Size::Plain(n) => n,
        };
        stream.skip(bytes as u64, what)
    }

    /// The code of a node's inactive values, and the two that its selection mask chooses from.
    fn inactive(&self, stream: &mut Stream, what: &'static str) -> Result<(u8, [f32; 2])> {
        let at = stream.at();
        let code = stream.u8(what)?;
        if code > ALL {
            let text = format!("{what} at byte {at} begin with the code {code}");
            return Err(bad(stream.path, text, "codes of inactive values are 0 to 6: the file is damaged"));
        }
        let mut pair = [if code == MINUS_BACKGROUND || code == MASK_OF_BACKGROUNDS { -self.background } else { self.background }; 2];
        pair[1] = self.background;
        if matches!(code, ONE_INACTIVE | MASK_AND_ONE | MASK_AND_TWO) {
            pair[0] = self.single(stream, what)?;
        }
        if code == MASK_AND_TWO {
            pair[1] = self.single(stream, what)?;
        }
        Ok((code, pair))
    }

    /// How many values are stored of `all`.
    fn count(&self, code: u8, mask: &[u64], all: usize) -> usize {
        if self.masked && code != ALL { mask.iter().map(|w| w.count_ones() as usize).sum() } else { all }
    }

    /// The bytes that `count` values take in the file.
    fn size(&self, stream: &mut Stream, count: usize, what: &'static str) -> Result<Size> {
        let plain = count * self.kind.lanes * self.kind.stored.bytes();
        // Halves that are none have no size either.
        if !(self.zip || self.blosc) || (count == 0 && self.kind.stored != self.kind.scalar) {
            return Ok(Size::Plain(plain));
        }
        let at = stream.at();
        let size = stream.i64(what)?;
        let bytes = size.unsigned_abs();
        // What compression cannot make smaller is stored as it is, its size negative.
        if (size <= 0 && bytes != plain as u64) || (size > 0 && bytes > 2 * plain as u64 + 4096) {
            let text = format!("{what} at byte {at} claim {size} bytes for {plain}");
            return Err(bad(stream.path, text, "the file is damaged"));
        }
        Ok(if size > 0 { Size::Packed(bytes as usize) } else { Size::Plain(plain) })
    }

    /// Brings `count` values into `plain`.
    fn unpack(&mut self, stream: &mut Stream, count: usize, what: &'static str) -> Result<()> {
        let wanted = count * self.kind.lanes * self.kind.stored.bytes();
        let at = stream.at();
        self.plain.clear();
        match self.size(stream, count, what)? {
            Size::Plain(n) => {
                self.plain.resize(n, 0);
                stream.read(&mut self.plain, what)
            }
            Size::Packed(n) => {
                self.packed.clear();
                self.packed.resize(n, 0);
                stream.read(&mut self.packed, what)?;
                self.plain.resize(wanted, 0);
                let done = if self.blosc {
                    super::blosc::unpack(&self.packed, &mut self.plain)
                } else {
                    ZlibDecoder::new(self.packed.as_slice()).read_exact(&mut self.plain).map_err(|e| format!("zlib: {e}"))
                };
                done.map_err(|e| bad(stream.path, format!("{what} at byte {at}: {}", quote(&e)), "an undamaged file is needed"))
            }
        }
    }
}

/// Bytes of a node's values in the file.
enum Size {
    Packed(usize),
    Plain(usize),
}
