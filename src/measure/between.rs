//! What a field misses between its cells: pictures read it at points of matter, trilinearly, and beside opaque walls light
//! changes within a fraction of a cell.

use super::{FieldError, errors};
use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Visibility, Volume};
use crate::stages::directions::SplitMix;
use crate::stages::twin;

/// Directions at points and cells alike: the same ones, so that what few directions miss is missed on both sides.
const DIRECTIONS: u32 = 48;

/// Voxels that are looked at for a point, at most: vessels fill a hundredth of their volume.
const TRIES: usize = 1 << 22;

/// The seed of the points.
const SEED: u64 = 0x62_6574_7765_656e;

/// Points at which pictures read a medium's field, and what is seen from there.
pub(crate) struct Points {
    /// Linear voxel indices.
    voxels: Vec<u32>,
    seen: Vec<[f32; 16]>,
    bands: u32,
}

/// The march that points and cells are compared with.
fn marched(ratio: u32, bands: u32) -> Visibility {
    let sampling = Sampling::Stratified;
    Visibility { method: Method::March, sampling, directions: DIRECTIONS, step: 1.0, ratio, bands, bits: 32, ..Visibility::default() }
}

impl Points {
    /// Up to `count` voxels of matter, drawn at random: with σ_t > 0, or, of an opaque surface, just outside it.
    pub fn draw(engine: &Engine, volume: &Volume, medium: &Medium, bands: u32, count: usize, progress: &mut Progress) -> Result<Self> {
        let n = volume.grid().dims();
        let matter = |i: usize| twin::extinction(medium.table(), volume.value(i)) > 0.0;
        let strides = [1, n[0], n[0] * n[1]];
        let read = |i: usize| match medium.has_surface() {
            false => matter(i),
            true => {
                let beside = |a: usize| {
                    let at = i / strides[a] % n[a];
                    (at > 0 && matter(i - strides[a])) || (at + 1 < n[a] && matter(i + strides[a]))
                };
                !matter(i) && (0..3).any(beside)
            }
        };
        let mut random = SplitMix(SEED);
        let all = volume.grid().voxels();
        let place = |i: usize| [i % n[0], i / n[0] % n[1], i / n[0] / n[1]].map(|c| c as f32 + 0.5);
        let mut voxels: Vec<u32> = (0..TRIES)
            .map(|_| (random.next() % all) as usize)
            .filter(|&i| read(i) && medium.keeps(place(i)))
            .take(count)
            .map(|i| i as u32)
            .collect();
        voxels.sort_unstable();
        voxels.dedup();
        let seen = engine.estimate(medium, &marched(1, bands), &voxels, progress)?;
        Ok(Self { voxels, seen, bands })
    }

    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// How far a field at `ratio`, exact at its cells, is off at the points: relative L2 over the kept coefficients.
    pub fn error(&self, engine: &Engine, volume: &Volume, medium: &Medium, ratio: u32, progress: &mut Progress) -> Result<FieldError> {
        let (n, dims) = (volume.grid().dims(), volume.grid().field_dims(ratio as usize));
        let buried = engine.buried(medium, dims)?;
        let around: Vec<Vec<(u32, f32)>> = self.voxels.iter().map(|&v| around(v as usize, n, dims, &buried)).collect();
        let mut cells: Vec<u32> = around.iter().flatten().map(|(cell, _)| *cell).collect();
        cells.sort_unstable();
        cells.dedup();
        let at_cells = engine.estimate(medium, &marched(ratio, self.bands), &cells, progress)?;
        let mut read = Vec::with_capacity(around.len());
        for corners in &around {
            let mut v = [0f32; 16];
            for (cell, weight) in corners {
                let Ok(i) = cells.binary_search(cell) else { continue };
                v.iter_mut().zip(at_cells[i]).for_each(|(v, c)| *v += weight * c);
            }
            read.push(v);
        }
        Ok(errors(&read, &self.seen, self.bands).kept)
    }
}

/// The cells around a voxel's centre and their trilinear weights, of which those inside an opaque surface have none.
fn around(voxel: usize, n: [usize; 3], dims: [usize; 3], buried: &[bool]) -> Vec<(u32, f32)> {
    let at = [voxel % n[0], voxel / n[0] % n[1], voxel / n[0] / n[1]];
    let q: [f32; 3] = std::array::from_fn(|a| (at[a] as f32 + 0.5) * dims[a] as f32 / n[a] as f32 - 0.5);
    let mut corners = Vec::with_capacity(8);
    for i in 0..8usize {
        let (mut cell, mut weight, mut stride) = (0, 1.0, 1);
        for a in 0..3 {
            let upper = i >> a & 1;
            let f = q[a] - q[a].floor();
            weight *= if upper == 1 { f } else { 1.0 - f };
            cell += stride * (q[a].floor() as i64 + upper as i64).clamp(0, dims[a] as i64 - 1) as usize;
            stride *= dims[a];
        }
        if weight > 0.0 && !buried.get(cell).is_some_and(|b| *b) {
            corners.push((cell as u32, weight));
        }
    }
    let sum: f32 = corners.iter().map(|c| c.1).sum();
    corners.iter_mut().for_each(|c| c.1 /= sum);
    corners
}

#[cfg(test)]
mod tests {
    use super::around;

    #[test]
    fn weights_reproduce_what_is_linear_and_leave_out_what_is_buried() {
        let (n, dims) = ([24usize, 16, 12], [6usize, 4, 3]);
        let voxel = 9 + 24 * (6 + 16 * 5);
        let corners = around(voxel, n, dims, &[]);
        let sum = |f: &dyn Fn([f32; 3]) -> f32| -> f32 {
            corners.iter().map(|&(c, w)| w * f([c as usize % 6, c as usize / 6 % 4, c as usize / 24].map(|c| 4.0 * (c as f32 + 0.5)))).sum()
        };
        for (a, at) in [9.5f32, 6.5, 5.5].into_iter().enumerate() {
            assert!((sum(&|p| p[a]) - at).abs() < 1e-4);
        }
        // Sabotage: one corner buried, and the sum is no longer linear; the weights still make 1.
        let mut buried = vec![false; 72];
        buried[corners[0].0 as usize] = true;
        let fewer = around(voxel, n, dims, &buried);
        assert_eq!(fewer.len(), corners.len() - 1);
        assert!((fewer.iter().map(|c| c.1).sum::<f32>() - 1.0).abs() < 1e-6 && fewer[0].1 > corners[1].1);
        assert!(around(voxel, n, dims, &[true; 72]).is_empty());
    }
}
