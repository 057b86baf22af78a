//! Where a field's cells stand on the device: in bricks of [`BRICK`]³ cells, of which only those are held in which somebody
//! reads a cell, and a directory with one word for each brick of the field. Nobody filters the packed images (`relight`
//! reads a cell at a time, `isosurface` weighs eight cells itself), so bricks need no border.
//!
//! Counted for 16 coefficients of 8 bits: 16 bytes a cell of the held bricks and 4 for each 64 cells of the whole field.
//! Wanted cells alone, one after another, would take less, but a word for each cell of the field besides: of a 256³ field
//! of which 22 % is wanted, bricks of 4³ take 27 % of the dense images, slots 47 %, bricks of 8³ 31 %.

use super::cells::CellMap;
use super::dims_u32;
use crate::kernels::constants::BRICK;

/// The bit of a directory's word that says that its brick is held; see `glsl/field_bricks.glsl`.
const HELD: u32 = 1 << 31;

// The kernels shift by 2.
const _: () = assert!(BRICK == 4);

/// Most bricks of the images along x and y: 8 bits of a word.
const ROW: u64 = 64;

/// Most bricks along z, unless there are more than fit so: 2048 texels.
const LONGEST: u64 = 512;

/// Bytes that rows of texels are a multiple of on some devices.
const LINE: u64 = 64;

/// The bricks of a field.
pub struct Bricks {
    dims: [usize; 3],
    count: u64,
    places: [u32; 3],
    directory: Vec<u32>,
    window: [[usize; 3]; 2],
}

/// Bricks along the edges of a field of `dims` cells.
pub fn directory_dims(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.div_ceil(BRICK))
}

/// Cells along a brick's edges: where a field is thinner than a brick, its bricks are too.
fn edge(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.min(BRICK))
}

/// Bricks along x, y, z of images that hold `count` of them with as little to spare as can be; a texel has `texel` bytes.
fn places(count: u64, texel: u64) -> [u32; 3] {
    // Whole lines of memory.
    let step = (LINE / (BRICK as u64 * texel).max(1)).clamp(1, ROW);
    let mut best = ([step, 1, 1], (u64::MAX, 0));
    for x in (step..=ROW).step_by(step as usize) {
        for y in 1..=ROW {
            let z = count.div_ceil(x * y).max(1);
            if z > LONGEST && x * y < ROW * ROW {
                continue;
            }
            // As near to a cube as possible, for edges have limits.
            let spare = (x * y * z, x.max(y).max(z));
            if spare < best.1 {
                best = ([x, y, z], spare);
            }
        }
    }
    best.0.map(|n| n as u32)
}

/// Texels along the edges of images that hold `count` bricks of a field of `dims` cells.
pub fn image_dims(dims: [usize; 3], count: u64, texel: u64) -> [u32; 3] {
    let (edge, places) = (edge(dims), places(count, texel));
    std::array::from_fn(|a| edge[a] as u32 * places[a])
}

impl Bricks {
    /// The bricks that hold the wanted cells of `map`, a field of `dims` cells, in images of `texel` bytes a texel.
    pub fn new(dims: [usize; 3], map: &CellMap, texel: u64) -> Self {
        let n = directory_dims(dims);
        let mut directory = vec![0u32; n.iter().product()];
        for (row, texels) in map.texels.chunks_exact(dims[0]).enumerate() {
            let first = n[0] * (row % dims[1] / BRICK + n[1] * (row / dims[1] / BRICK));
            for (word, cells) in directory[first..].iter_mut().zip(texels.chunks(BRICK)) {
                *word |= u32::from(cells.iter().any(|t| t >> 4 > 0)) * HELD;
            }
        }
        let count = directory.iter().filter(|w| **w > 0).count() as u64;
        let places = places(count, texel);
        let held = directory.iter_mut().enumerate().filter(|(_, w)| **w > 0);
        let (mut lo, mut hi) = ([usize::MAX; 3], [0; 3]);
        for (slot, (i, word)) in held.enumerate() {
            let slot = slot as u32;
            let place = [slot % places[0], slot / places[0] % places[1], slot / places[0] / places[1]];
            *word = HELD | place[2] << 16 | place[1] << 8 | place[0];
            let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
            for a in 0..3 {
                lo[a] = lo[a].min(at[a] * BRICK);
                hi[a] = hi[a].max((at[a] * BRICK + BRICK).min(dims[a]));
            }
        }
        let window = if count > 0 { [lo, hi] } else { [[0; 3], [1; 3]] };
        Self { dims, count, places, directory, window }
    }

    /// Bricks that are held.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// A word for each brick of the field, x fastest: what the kernels look up.
    pub fn directory(&self) -> &[u32] {
        &self.directory
    }

    /// Words along x, y, z.
    pub fn directory_dims(&self) -> [u32; 3] {
        dims_u32(directory_dims(self.dims))
    }

    /// Texels of the field's images along x, y, z.
    pub fn image_dims(&self) -> [u32; 3] {
        let edge = edge(self.dims);
        std::array::from_fn(|a| edge[a] as u32 * self.places[a])
    }

    /// The box of cells around all bricks that are held, first and one past the last; one cell where there is none.
    pub fn window(&self) -> [[usize; 3]; 2] {
        self.window
    }

    /// Index of a cell's texel in the field's images, x fastest; `None` where its brick is not held. `cell` is a linear
    /// index.
    pub fn texel(&self, cell: usize) -> Option<usize> {
        let (n, edge) = (directory_dims(self.dims), edge(self.dims));
        let at = [cell % self.dims[0], cell / self.dims[0] % self.dims[1], cell / self.dims[0] / self.dims[1]];
        let word = *self.directory.get(at[0] / BRICK + n[0] * (at[1] / BRICK + n[1] * (at[2] / BRICK)))?;
        let place = [word & 255, word >> 8 & 255, word >> 16 & 32767];
        let p: [usize; 3] = std::array::from_fn(|a| place[a] as usize * edge[a] + at[a] % BRICK);
        let size = self.image_dims();
        (word & HELD > 0).then(|| p[0] + size[0] as usize * (p[1] + size[1] as usize * p[2]))
    }

    /// The cells of held bricks, in runs along x, ascending: linear index of a run's first cell, index of its texel, cells.
    pub fn runs(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        let [nx, ny, nz] = self.dims;
        let n = directory_dims(self.dims);
        let rows = (0..ny * nz).map(move |row| (nx * row, n[0] * (row % ny / BRICK + n[1] * (row / ny / BRICK))));
        rows.flat_map(move |(first, word)| {
            let held = self.directory[word..word + n[0]].iter().enumerate().filter(|(_, w)| **w & HELD > 0);
            held.filter_map(move |(i, _)| {
                let cell = first + BRICK * i;
                self.texel(cell).map(|texel| (cell, texel, BRICK.min(nx - BRICK * i)))
            })
        })
    }

    /// Linear indices of the cells of held bricks that `map` does not want, ascending.
    pub fn spare(&self, map: &CellMap) -> Vec<u32> {
        self.runs().flat_map(|(cell, _, count)| cell..cell + count).filter(|&cell| map.texels[cell] >> 4 == 0).map(|c| c as u32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(dims: [usize; 3], wants: impl Fn(usize) -> bool) -> CellMap {
        let mut wanted = 0;
        let texels = (0..dims.iter().product())
            .map(|i| {
                wanted += usize::from(wants(i));
                if wants(i) { (wanted as u32) << 4 } else { 15 }
            })
            .collect();
        CellMap { texels, wanted, matter: wanted }
    }

    #[test]
    fn every_wanted_cell_has_a_texel_of_its_own_inside_the_images() {
        for dims in [[9, 6, 5], [1, 13, 1], [64, 3, 2], [4, 4, 4], [2, 2, 2]] {
            for every in [1, 3, 17, 1000] {
                let map = map(dims, |i| i % every == 0);
                let bricks = Bricks::new(dims, &map, 4);
                let texels: usize = bricks.image_dims().iter().map(|&n| n as usize).product();
                let mut taken = vec![false; texels];
                let spare = bricks.spare(&map);
                let runs: Vec<_> = bricks.runs().flat_map(|(cell, texel, count)| (0..count).map(move |k| (cell + k, texel + k))).collect();
                let all: Vec<_> = (0..map.texels.len()).filter_map(|cell| bricks.texel(cell).map(|texel| (cell, texel))).collect();
                assert_eq!(runs, all);
                for (i, t) in map.texels.iter().enumerate() {
                    let Some(place) = bricks.texel(i) else {
                        assert!(*t >> 4 == 0, "cell {i} of {dims:?} is wanted");
                        continue;
                    };
                    assert!(!std::mem::replace(&mut taken[place], true), "two cells at {place}");
                    assert_eq!(spare.contains(&(i as u32)), *t >> 4 == 0);
                    let at = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
                    let [lo, hi] = bricks.window();
                    assert!((0..3).all(|a| (lo[a]..hi[a]).contains(&at[a])));
                }
            }
        }
    }

    #[test]
    fn images_have_little_to_spare() {
        for count in [1, 2, 5, 63, 64, 65, 100, 1103, 4097, 70_001, 1 << 22] {
            for texel in [1, 4, 16] {
                let [x, y, z] = places(count, texel).map(u64::from);
                assert!(x * y * z >= count && x <= ROW && y <= ROW && z <= 1024, "{count}: {x} {y} {z}");
                assert!(z <= LONGEST || count > ROW * ROW * LONGEST, "{count}: {x} {y} {z}");
                // A line's worth of bricks.
                assert!(x * y * z < count + 16 + count / 50, "{count}: {x} {y} {z}");
                assert_eq!(x * BRICK as u64 * texel % LINE, 0);
            }
        }
    }

    #[test]
    fn a_vacuum_holds_nothing() {
        let dims = [8, 8, 8];
        let map = map(dims, |_| false);
        let bricks = Bricks::new(dims, &map, 4);
        assert_eq!((bricks.count(), bricks.window()), (0, [[0; 3], [1; 3]]));
        assert!(bricks.spare(&map).is_empty());
    }
}
