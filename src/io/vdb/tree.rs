//! The tree of a grid: a root, two levels of inner nodes (32³ and 16³ children) and leaves of 8³ voxels. It is walked twice:
//! once for the box of its active voxels, once into a dense volume of that box.

use super::super::limits::bad;
use super::stream::Stream;
use super::values::Coding;
use crate::error::Result;
use std::collections::HashSet;

/// Voxels along an edge of what a child of the root covers.
const ROOT_CHILD: i64 = 4096;
/// Voxels along a leaf's edge.
const LEAF: i64 = 8;

/// Index coordinates.
pub(super) type Ijk = [i64; 3];

/// What a walk meets.
trait Visit {
    /// A cube of `size` voxels of one value; the value is only read where [`Visit::VALUES`] holds.
    fn tile(&mut self, origin: Ijk, size: i64, value: f32, active: bool);
    /// A leaf and its active voxels: word x, bit 8y + z.
    fn leaf(&mut self, origin: Ijk, active: &[u64; 8]) -> Result<()>;
    /// Whether tiles need their values.
    const VALUES: bool;
}

/// Walks the tree's topology from the background value on.
fn walk<V: Visit>(stream: &mut Stream, coding: &mut Coding, visit: &mut V) -> Result<()> {
    const WHAT: &str = "the root of the tree";
    coding.background = coding.single(stream, WHAT)?;
    let (tiles, children) = (stream.u32(WHAT)?, stream.u32(WHAT)?);
    let mut seen = HashSet::new();
    let mut origin = |stream: &mut Stream| {
        let at = stream.at();
        let origin: Ijk = [stream.i32(WHAT)?.into(), stream.i32(WHAT)?.into(), stream.i32(WHAT)?.into()];
        // Twice the same place would be twice the work, without end.
        if origin.iter().any(|v| v % ROOT_CHILD != 0) || !seen.insert(origin) {
            let what = format!("the root's child at byte {at} lies at {origin:?}, off the raster of {ROOT_CHILD} or a second time");
            return Err(bad(stream.path, what, "the file is damaged"));
        }
        Ok(origin)
    };
    for _ in 0..tiles {
        let origin = origin(stream)?;
        let value = coding.single(stream, WHAT)?;
        let active = stream.u8(WHAT)? != 0;
        visit.tile(origin, ROOT_CHILD, value, active);
    }
    for _ in 0..children {
        let origin = origin(stream)?;
        node(stream, coding, visit, origin, 5)?;
    }
    Ok(())
}

/// An inner node of (2^`log2`)³ children, and all below it.
fn node<V: Visit>(stream: &mut Stream, coding: &mut Coding, visit: &mut V, origin: Ijk, log2: u32) -> Result<()> {
    let what = if log2 == 5 { "an inner node of 32³" } else { "an inner node of 16³" };
    let count = 1usize << (3 * log2);
    let child = if log2 == 5 { ROOT_CHILD / 32 } else { LEAF };
    let mut masks = vec![0; count / 32];
    let (children, active) = masks.split_at_mut(count / 64);
    stream.mask(children, what)?;
    stream.mask(active, what)?;
    let place = |i: usize| -> Ijk {
        let low = (1 << log2) - 1;
        [i >> (2 * log2), i >> log2 & low, i & low].map(|v| v as i64 * child)
    };
    let at = |i: usize| -> Ijk { std::array::from_fn(|a| origin[a] + place(i)[a]) };
    if V::VALUES {
        let mut values = vec![0.0; count];
        coding.node(stream, active, &mut values, what)?;
        for (i, value) in values.into_iter().enumerate() {
            let bit = |mask: &[u64]| mask[i / 64] >> (i % 64) & 1 != 0;
            if !bit(children) && (value != coding.background || bit(active)) {
                visit.tile(at(i), child, value, bit(active));
            }
        }
    } else {
        coding.skip(stream, active, what)?;
        for i in bits(active) {
            if children[i / 64] >> (i % 64) & 1 == 0 {
                visit.tile(at(i), child, 0.0, true);
            }
        }
    }
    for i in bits(children) {
        if log2 == 5 {
            node(stream, coding, visit, at(i), 4)?;
        } else {
            let mut mask = [0; 8];
            stream.mask(&mut mask, "the mask of a leaf")?;
            visit.leaf(at(i), &mask)?;
        }
    }
    Ok(())
}

/// The set bits of a mask.
fn bits(mask: &[u64]) -> impl Iterator<Item = usize> + '_ {
    mask.iter().enumerate().flat_map(|(w, &word)| (0..64).filter(move |b| word >> b & 1 != 0).map(move |b| w * 64 + b))
}

/// The active part of a tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// First and last active voxel along each axis.
    pub lo: Ijk,
    pub hi: Ijk,
    /// Active voxels.
    pub active: u64,
    pub leaves: u64,
}

impl Extent {
    /// Voxels along each axis of the active box; `None` where nothing is active.
    pub fn dims(&self) -> Option<[usize; 3]> {
        (self.active > 0).then(|| std::array::from_fn(|a| (self.hi[a] - self.lo[a] + 1) as usize))
    }

    fn add(&mut self, lo: Ijk, hi: Ijk, active: u64) {
        self.lo = std::array::from_fn(|a| self.lo[a].min(lo[a]));
        self.hi = std::array::from_fn(|a| self.hi[a].max(hi[a]));
        self.active = self.active.saturating_add(active);
    }
}

impl Visit for Extent {
    const VALUES: bool = false;

    fn tile(&mut self, origin: Ijk, size: i64, _: f32, active: bool) {
        if active {
            self.add(origin, origin.map(|v| v + size - 1), (size * size * size).unsigned_abs());
        }
    }

    fn leaf(&mut self, origin: Ijk, active: &[u64; 8]) -> Result<()> {
        self.leaves += 1;
        let (lo, hi) = active.iter().enumerate().filter(|(_, word)| **word != 0).fold(([8; 3], [-1; 3]), |(lo, hi), (x, &word)| {
            let rows = |y: i64| word >> (8 * y) & 0xff;
            let column = (0..8).fold(0, |all, y| all | rows(y));
            let (y0, y1) = (i64::from(word.trailing_zeros() / 8), 7 - i64::from(word.leading_zeros() / 8));
            let (z0, z1) = (i64::from(column.trailing_zeros()), 63 - i64::from(column.leading_zeros()));
            let (a, b) = ([x as i64, y0, z0], [x as i64, y1, z1]);
            (std::array::from_fn(|i| a[i].min(lo[i])), std::array::from_fn(|i| b[i].max(hi[i])))
        });
        if hi[0] >= 0 {
            let count = active.iter().map(|w| u64::from(w.count_ones())).sum();
            self.add(std::array::from_fn(|a| origin[a] + lo[a]), std::array::from_fn(|a| origin[a] + hi[a]), count);
        }
        Ok(())
    }
}

/// The active part of the tree whose topology begins here.
pub(super) fn extent(stream: &mut Stream, coding: &mut Coding) -> Result<Extent> {
    let mut extent = Extent { lo: [i64::MAX; 3], hi: [i64::MIN; 3], active: 0, leaves: 0 };
    walk(stream, coding, &mut extent)?;
    Ok(extent)
}

/// A dense box of voxels, x fastest.
struct Dense<'a> {
    lo: Ijk,
    dims: [usize; 3],
    out: &'a mut [f32],
    leaves: Vec<(Ijk, [u64; 8])>,
    expected: u64,
}

impl Dense<'_> {
    /// Calls `set` for the rows along x that a cube and the box share: with the row, and index coordinates of its first.
    fn rows(&mut self, origin: Ijk, size: i64, mut set: impl FnMut(&mut [f32], Ijk)) {
        let lo: Ijk = std::array::from_fn(|a| origin[a].max(self.lo[a]));
        let hi: Ijk = std::array::from_fn(|a| (origin[a] + size).min(self.lo[a] + self.dims[a] as i64));
        if (0..3).any(|a| lo[a] >= hi[a]) {
            return;
        }
        let place = |v: i64, a: usize| (v - self.lo[a]) as usize;
        for z in lo[2]..hi[2] {
            for y in lo[1]..hi[1] {
                let row = self.dims[0] * (place(y, 1) + self.dims[1] * place(z, 2));
                set(&mut self.out[row + place(lo[0], 0)..row + place(hi[0], 0)], [lo[0], y, z]);
            }
        }
    }
}

impl Visit for Dense<'_> {
    const VALUES: bool = true;

    fn tile(&mut self, origin: Ijk, size: i64, value: f32, _: bool) {
        self.rows(origin, size, |row, _| row.fill(value));
    }

    fn leaf(&mut self, origin: Ijk, active: &[u64; 8]) -> Result<()> {
        // As many as the first walk met; the file may have changed in between.
        if (self.leaves.len() as u64) < self.expected {
            self.leaves.push((origin, *active));
        }
        Ok(())
    }
}

/// Fills the box of `extent` (x fastest) with the values of the tree whose topology begins here; `out` has the background.
pub(super) fn fill(
    stream: &mut Stream,
    coding: &mut Coding,
    extent: &Extent,
    out: &mut [f32],
    report: &dyn Fn(f64) -> Result<()>,
) -> Result<()> {
    let Some(dims) = extent.dims() else { return Ok(()) };
    let mut dense = Dense { lo: extent.lo, dims, out, leaves: Vec::new(), expected: extent.leaves };
    walk(stream, coding, &mut dense)?;
    let leaves = std::mem::take(&mut dense.leaves);
    let mut values = [0.0; 512];
    for (i, (origin, mask)) in leaves.iter().enumerate() {
        // The mask stands here a second time.
        stream.skip(64, "the values of a leaf")?;
        coding.node(stream, mask, &mut values, "the values of a leaf")?;
        dense.rows(*origin, LEAF, |row, [x, y, z]| {
            for (n, voxel) in row.iter_mut().enumerate() {
                let [x, y, z] = [x + n as i64 - origin[0], y - origin[1], z - origin[2]];
                *voxel = values[(x * 64 + y * 8 + z) as usize];
            }
        });
        if i % 1024 == 0 {
            report(i as f64 / leaves.len() as f64)?;
        }
    }
    report(1.0)
}
