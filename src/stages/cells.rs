//! Which cells of a field anybody reads, and how far each is from matter: what estimators may leave out.

use crate::kernels::constants::SLOT_ROW;

/// Cells around matter that are wanted: renderers read the cells around a sample in matter, and one further along the
/// normal.
pub const MARGIN: u8 = 2;

/// Farthest distance that a map tells, cells.
const FAR: u8 = 15;

/// Per cell: how many cells around it are clear of matter (4 bits), and its slot among the wanted cells + 1 (28 bits, 0 if
/// nobody reads it).
pub struct CellMap {
    /// One texel a cell, x fastest.
    pub texels: Vec<u32>,
    /// Wanted cells.
    pub wanted: usize,
}

/// Texels of an image that holds `wanted` slots.
pub fn slot_dims(wanted: usize) -> [u32; 3] {
    let row = SLOT_ROW as u32;
    [row, row, wanted.div_ceil(SLOT_ROW * SLOT_ROW).max(1) as u32]
}

impl CellMap {
    /// All cells wanted, none known to be clear.
    pub fn everywhere(dims: [usize; 3]) -> Self {
        let wanted = dims.iter().product();
        Self { texels: (1..=wanted as u32).map(|slot| slot << 4).collect(), wanted }
    }

    /// Cells within [`MARGIN`] of a cell that holds `matter` are wanted, or all.
    pub fn new(dims: [usize; 3], matter: &[bool], all: bool) -> Self {
        let mut wanted = 0;
        let texels = distances(dims, matter)
            .into_iter()
            .map(|distance| {
                let clear = u32::from(distance.saturating_sub(1));
                if all || distance <= MARGIN {
                    wanted += 1;
                    clear | (wanted as u32) << 4
                } else {
                    clear
                }
            })
            .collect();
        Self { texels, wanted }
    }
}

/// Chebyshev distance in cells to the nearest cell with matter, at most 15: per axis, the least of a run's distances each
/// raised to its place in the run.
pub fn distances(dims: [usize; 3], matter: &[bool]) -> Vec<u8> {
    let mut d: Vec<u8> = matter.iter().map(|&m| if m { 0 } else { FAR }).collect();
    let strides = [1, dims[0], dims[0] * dims[1]];
    let mut line = Vec::new();
    for a in 0..3 {
        let n = dims[a];
        for first in (0..d.len()).filter(|i| i / strides[a] % n == 0) {
            line.clear();
            line.extend((0..n).map(|k| d[first + k * strides[a]]));
            for (k, out) in (0..n).map(|k| (k, first + k * strides[a])) {
                let mut best = line[k];
                let mut reach = 1;
                // Farther entries cannot do better than their place.
                while reach < usize::from(best) {
                    let side = |at: Option<&u8>| at.map_or(FAR, |v| (*v).max(reach as u8));
                    best = best.min(side(k.checked_sub(reach).and_then(|k| line.get(k)))).min(side(line.get(k + reach)));
                    reach += 1;
                }
                d[out] = best;
            }
        }
    }
    d
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
        let map = CellMap::new(dims, &matter, false);
        assert_eq!(map.texels[at(a)] & 15, 0);
        assert_eq!(map.wanted, d.iter().filter(|&&d| d <= MARGIN).count());
        assert_eq!(map.texels.iter().filter(|&&t| t >> 4 > 0).count(), map.wanted);
        assert!(distances(dims, &vec![false; matter.len()]).iter().all(|&d| d == 15));
    }
}
