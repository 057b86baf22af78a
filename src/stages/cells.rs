//! Which cells of a field anybody reads, and how far each is from matter: what estimators may leave out.

use crate::kernels::constants::{BLOCK, SLOT_ROW, TILE_COLUMN, TILE_ROW};

/// Cells around matter that are wanted: renderers read the cells around a sample in matter, and one further along the
/// normal.
pub const MARGIN: u8 = 2;

/// More cells than a map can number.
pub const MOST: u64 = 1 << 28;

/// Farthest distance that a map tells, cells.
const FAR: u8 = 15;

/// Per cell: how many cells around it are clear of matter (4 bits), and its slot among the wanted cells + 1 (28 bits, 0 if
/// nobody reads it).
pub struct CellMap {
    /// One texel a cell, x fastest.
    pub texels: Vec<u32>,
    /// Wanted cells.
    pub wanted: usize,
    /// Cells that may hold matter.
    pub matter: usize,
}

/// Cells of a field of `dims` that share a voxel with a block that holds matter. `blocks` are those of the occupancy, over a
/// volume of `voxels`.
pub fn matter(filled: &[bool], blocks: [usize; 3], voxels: [usize; 3], dims: [usize; 3]) -> Vec<bool> {
    // Cells that a block overlaps along an axis.
    let span = |block: usize, a: usize| {
        let (first, last) = (block * BLOCK, (block * BLOCK + BLOCK).min(voxels[a]) - 1);
        // Cell i runs from voxel i·voxels/dims.
        first * dims[a] / voxels[a]..=(((last + 1) * dims[a]).div_ceil(voxels[a]) - 1).min(dims[a] - 1)
    };
    let mut out = vec![false; dims.iter().product()];
    for (i, _) in filled.iter().enumerate().filter(|(_, f)| **f) {
        let block = [i % blocks[0], i / blocks[0] % blocks[1], i / blocks[0] / blocks[1]];
        for z in span(block[2], 2) {
            for y in span(block[1], 1) {
                let row = dims[0] * (y + dims[1] * z);
                let x = span(block[0], 0);
                out[row + x.start()..=row + x.end()].fill(true);
            }
        }
    }
    out
}

/// Texels of an image that holds `wanted` slots.
pub fn slot_dims(wanted: u64) -> [u32; 3] {
    let row = SLOT_ROW as u32;
    let rows = wanted.div_ceil(u64::from(row)).max(1);
    [row, rows.min(u64::from(row)) as u32, rows.div_ceil(u64::from(row)) as u32]
}

impl CellMap {
    /// Cells within [`MARGIN`] of a cell that holds `matter` are wanted, or all, but not those that are `buried` (none are
    /// where it is empty); and those of `also`.
    pub fn new(dims: [usize; 3], matter: &[bool], buried: &[bool], also: &[u32], all: bool) -> Self {
        let distances = distances(dims, matter);
        let mut wants: Vec<bool> = distances.iter().map(|&d| all || d <= MARGIN).collect();
        for (wants, _) in wants.iter_mut().zip(buried).filter(|(_, buried)| **buried) {
            *wants = false;
        }
        for &cell in also {
            wants[cell as usize] = true;
        }
        let mut wanted = 0;
        let texel = |(distance, wants): (u8, bool)| {
            wanted += usize::from(wants);
            u32::from(distance.saturating_sub(1)) | if wants { (wanted as u32) << 4 } else { 0 }
        };
        let texels = distances.into_iter().zip(wants).map(texel).collect();
        Self { texels, wanted, matter: matter.iter().filter(|m| **m).count() }
    }

    /// The cells that `wants` says, x fastest; nothing is known of matter.
    pub fn listed(wants: impl Iterator<Item = bool>) -> Self {
        let mut wanted = 0;
        let texel = |wants: bool| {
            wanted += usize::from(wants);
            if wants { (wanted as u32) << 4 } else { 0 }
        };
        let texels = wants.map(texel).collect();
        Self { texels, wanted, matter: 0 }
    }

    /// Linear indices of the wanted cells, ascending.
    pub fn cells(&self) -> Vec<u32> {
        self.texels.iter().enumerate().filter(|(_, t)| **t >> 4 > 0).map(|(i, _)| i as u32).collect()
    }
}

/// Slices cut into tiles of [`TILE_ROW`] x [`TILE_COLUMN`] cells: first those of a slice in which some cell is wanted or near
/// matter, then those through which transmittance is only carried.
pub struct Tiles {
    /// Tile numbers, row of tiles after row, slice after slice, axis after axis.
    pub list: Vec<u32>,
    /// Per axis and slice: first tile of the list, how many are worked on, and how many only carried.
    runs: [Vec<[u32; 3]>; 3],
}

impl Tiles {
    /// Bytes of the list of a field of `dims` cells.
    pub fn bytes(dims: [usize; 3]) -> u64 {
        let tiles = |axis: usize| {
            let [row, column] = super::sweep::plane(axis);
            dims[axis] * dims[row].div_ceil(TILE_ROW) * dims[column].div_ceil(TILE_COLUMN)
        };
        4 * (0..3).map(tiles).sum::<usize>() as u64
    }

    /// The tiles of a field of `dims` cells.
    pub fn new(dims: [usize; 3], map: &CellMap) -> Self {
        let [nx, ny, nz] = dims;
        let worked = |texel: &u32| texel >> 4 > 0 || texel & 15 < u32::from(MARGIN);
        let across = |axis: usize| super::sweep::plane(axis).map(|a| dims[a]);
        let tiles = |axis: usize| across(axis)[0].div_ceil(TILE_ROW) * across(axis)[1].div_ceil(TILE_COLUMN);
        // Per axis, slice after slice of tiles; across x, per tile a row of slices, for cells are read a row of x at a time.
        let mut busy: [Vec<bool>; 3] = std::array::from_fn(|axis| vec![false; dims[axis] * tiles(axis)]);
        let [rows, columns] = [nx.div_ceil(TILE_ROW), ny.div_ceil(TILE_ROW)];
        for (index, row) in map.texels.chunks_exact(nx.max(1)).enumerate() {
            let (y, z) = (index % ny, index / ny);
            let across_x = &mut busy[0][nx * (y / TILE_ROW + columns * (z / TILE_COLUMN))..][..nx];
            for (busy, &texel) in across_x.iter_mut().zip(row) {
                *busy |= worked(&texel);
            }
            for (axis, first) in [(1, y * tiles(1) + rows * (z / TILE_COLUMN)), (2, z * tiles(2) + rows * (y / TILE_COLUMN))] {
                for (busy, cells) in busy[axis][first..].iter_mut().zip(row.chunks(TILE_ROW)) {
                    *busy |= cells.iter().any(worked);
                }
            }
        }
        let mut list = Vec::with_capacity(busy.iter().map(Vec::len).sum());
        let runs = std::array::from_fn(|axis| {
            let (busy, count) = (&busy[axis], tiles(axis));
            let at = |slice: usize, tile: usize| if axis == 0 { slice + nx * tile } else { tile + count * slice };
            let run = |slice: usize| {
                let first = list.len();
                list.extend((0..count).filter(|&t| busy[at(slice, t)]).map(|t| t as u32));
                let worked = list.len() - first;
                list.extend((0..count).filter(|&t| !busy[at(slice, t)]).map(|t| t as u32));
                [first as u32, worked as u32, (count - worked) as u32]
            };
            (0..[nx, ny, nz][axis]).map(run).collect()
        });
        Self { list, runs }
    }

    /// The tiles of a slice as (first, count) of the list, and whether they are worked on or only carried; `whole`: in one run,
    /// worked on if any is.
    pub fn of(&self, axis: usize, slice: usize, whole: bool) -> impl Iterator<Item = ([u32; 2], bool)> {
        let [first, mut worked, mut carried] = self.runs[axis][slice];
        if whole && worked > 0 {
            (worked, carried) = (worked + carried, 0);
        }
        [([first, worked], true), ([first + worked, carried], false)].into_iter().filter(|([_, count], _)| *count > 0)
    }
}

/// Chebyshev distance in cells to the nearest cell with matter, at most 15. Steps to any of the 26 neighbours count 1, so that two
/// passes find it (Rosenfeld & Pfaltz 1966): a shortest way takes first the steps to cells that stand later in the order, then
/// those to earlier ones. A row of cells is worked on at once.
pub fn distances(dims: [usize; 3], matter: &[bool]) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let mut d: Vec<u8> = matter.iter().map(|&m| if m { 0 } else { FAR }).collect();
    // The least of the rows beside a row that the pass has been through; one cell more at both ends.
    let (mut beside, mut shifted) = (vec![FAR; nx + 2], vec![FAR; nx]);
    for forward in [true, false] {
        for index in 0..ny * nz {
            let index = if forward { index } else { ny * nz - 1 - index };
            let (y, z) = (index % ny, index / ny);
            let (before_y, before_z) = if forward { (y.checked_sub(1), z.checked_sub(1)) } else { (Some(y + 1), Some(z + 1)) };
            let before_z = before_z.filter(|&z| z < nz);
            let rows = [(before_y, Some(z)), (y.checked_sub(1), before_z), (Some(y), before_z), (Some(y + 1), before_z)];
            beside.fill(FAR);
            for (y, z) in rows {
                if let (Some(y), Some(z)) = (y.filter(|&y| y < ny), z) {
                    least(&mut beside[1..=nx], &d[nx * (y + ny * z)..][..nx], 0);
                }
            }
            let row = &mut d[nx * index..][..nx];
            for reach in 0..3 {
                least(row, &beside[reach..][..nx], 1);
            }
            // Along the row: steps of 1, 2, 4 and 8 make up to 15.
            for step in [1, 2, 4, 8].into_iter().filter(|&step| step < nx) {
                shifted.copy_from_slice(row);
                let (to, from) =
                    if forward { (&mut row[step..], &shifted[..nx - step]) } else { (&mut row[..nx - step], &shifted[step..]) };
                least(to, from, step as u8);
            }
        }
    }
    d
}

/// Each the smaller of itself and `others` + `step`.
fn least(row: &mut [u8], others: &[u8], step: u8) {
    for (v, other) in row.iter_mut().zip(others) {
        *v = (*v).min(other + step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_chebyshev_and_capped() {
        let dims = [23, 7, 19];
        let at = |p: [usize; 3]| p[0] + dims[0] * (p[1] + dims[1] * p[2]);
        let (a, b) = ([3, 2, 4], [20, 6, 18]);
        let mut matter = vec![false; dims.iter().product()];
        matter[at(a)] = true;
        matter[at(b)] = true;
        let d = distances(dims, &matter);
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let to = |q: [usize; 3]| x.abs_diff(q[0]).max(y.abs_diff(q[1])).max(z.abs_diff(q[2]));
                    assert_eq!(usize::from(d[at([x, y, z])]), to(a).min(to(b)).min(15), "{x} {y} {z}");
                }
            }
        }
        let map = CellMap::new(dims, &matter, &[], &[], false);
        assert_eq!(map.texels[at(a)] & 15, 0);
        assert_eq!(map.wanted, d.iter().filter(|&&d| d <= MARGIN).count());
        assert_eq!(map.texels.iter().filter(|&&t| t >> 4 > 0).count(), map.wanted);
        assert_eq!(CellMap::new(dims, &matter, &[], &[0], false).wanted, map.wanted + usize::from(d[0] > MARGIN));
        assert_eq!(CellMap::new(dims, &matter, &matter, &[], false).wanted, map.wanted - 2, "what is buried is not wanted");
        assert_eq!(map.cells().len(), map.wanted);
        // Every tile of every slice stands once, and none that holds a wanted cell is only carried.
        let tiles = Tiles::new(dims, &map);
        for axis in 0..3 {
            let [row, column] = super::super::sweep::plane(axis);
            for slice in 0..dims[axis] {
                let mut seen = Vec::new();
                for ([first, count], worked) in tiles.of(axis, slice, false) {
                    for &t in &tiles.list[first as usize..(first + count) as usize] {
                        seen.push(t);
                        let width = dims[row].div_ceil(TILE_ROW);
                        let (i, j) = (t as usize % width * TILE_ROW, t as usize / width * TILE_COLUMN);
                        let any = (j..dims[column].min(j + TILE_COLUMN)).any(|j| {
                            (i..dims[row].min(i + TILE_ROW)).any(|i| {
                                let mut p = [0; 3];
                                (p[axis], p[row], p[column]) = (slice, i, j);
                                d[at(p)] <= MARGIN
                            })
                        });
                        assert_eq!(any, worked);
                    }
                }
                seen.sort_unstable();
                assert_eq!(seen, (0..(dims[row].div_ceil(TILE_ROW) * dims[column].div_ceil(TILE_COLUMN)) as u32).collect::<Vec<_>>());
            }
        }
        assert!(distances(dims, &vec![false; matter.len()]).iter().all(|&d| d == 15));
    }
}
