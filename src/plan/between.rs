//! What a field misses between its cells: pictures read it at points of matter, trilinearly, and beside opaque walls light
//! changes within a fraction of a cell.

use super::bench::{Run, systematic};
use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Visibility, Volume};
use crate::stages::directions::SplitMix;
use crate::stages::twin;

/// Directions of the two sets; they share none, so what few directions miss is told from what cells miss.
const DIRECTIONS: [u32; 2] = [41, 53];

/// Voxels that are looked at for a point, at most: vessels fill a hundredth of their volume.
const TRIES: usize = 1 << 22;

/// The seed of the points.
const SEED: u64 = 0x62_6574_7765_656e;

/// Points at which pictures read a medium's field, and what is seen from there.
pub(super) struct Points {
    /// Linear voxel indices.
    voxels: Vec<u32>,
    /// How much a picture reads of each: the opacity of a voxel times what light reaches it, for cameras see what light sees;
    /// of a surface 1.
    weights: Vec<f32>,
    /// Coefficients there, from each set of directions.
    seen: [Vec<[f32; 16]>; 2],
    bands: u32,
}

/// The march that points and cells are compared with.
fn marched(ratio: u32, bands: u32, directions: u32) -> Visibility {
    let sampling = Sampling::Stratified;
    Visibility { method: Method::March, sampling, directions, step: 1.0, ratio, bands, bits: 32, ..Visibility::default() }
}

impl Points {
    /// Up to `count` voxels of matter, drawn at random: with σ_t > 0, or, of an opaque surface, just outside it.
    pub fn draw(engine: &Engine, volume: &Volume, medium: &Medium, bands: u32, count: usize, progress: &mut Progress) -> Result<Self> {
        let n = volume.grid().dims();
        let extinction = |i: usize| twin::extinction(medium.table(), volume.value(i));
        let strides = [1, n[0], n[0] * n[1]];
        let read = |i: usize| match medium.has_surface() {
            false => extinction(i) > 0.0,
            true => {
                let beside = |a: usize| {
                    let at = i / strides[a] % n[a];
                    (at > 0 && extinction(i - strides[a]) > 0.0) || (at + 1 < n[a] && extinction(i + strides[a]) > 0.0)
                };
                extinction(i) == 0.0 && (0..3).any(beside)
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
        let [a, b] = DIRECTIONS.map(|n| engine.estimate(medium, &marched(1, bands, n), &voxels, progress));
        let seen = [a?, b?];
        let length = volume.grid().voxel_length() as f32;
        let weight = |(&voxel, v): (&u32, &[f32; 16])| match medium.has_surface() {
            false => (1.0 - (-extinction(voxel as usize) * length).exp()) * v[0].max(0.0),
            true => 1.0,
        };
        let weights = voxels.iter().zip(&seen[1]).map(weight).collect();
        Ok(Self { voxels, weights, seen, bands })
    }

    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// How far a field at `ratio`, exact at its cells, is off at the points: relative L2 over the kept coefficients, points by
    /// their weights. Points that no cell outside the surface lies around are left out.
    pub fn error(&self, engine: &Engine, volume: &Volume, medium: &Medium, ratio: u32, progress: &mut Progress) -> Result<f64> {
        let (n, dims) = (volume.grid().dims(), volume.grid().field_dims(ratio as usize));
        let buried = engine.buried(medium, dims)?;
        let around: Vec<Vec<(u32, f32)>> = self.voxels.iter().map(|&v| around(v as usize, n, dims, &buried)).collect();
        let mut cells: Vec<u32> = around.iter().flatten().map(|(cell, _)| *cell).collect();
        cells.sort_unstable();
        cells.dedup();
        let mut pair = |set: usize| -> Result<[Run; 2]> {
            let at_cells = engine.estimate(medium, &marched(ratio, self.bands, DIRECTIONS[set]), &cells, progress)?;
            let (mut read, mut true_ones) = (Vec::new(), Vec::new());
            for (point, corners) in around.iter().enumerate().filter(|(_, corners)| !corners.is_empty()) {
                let mut v = [0f32; 16];
                for (cell, weight) in corners {
                    let Ok(i) = cells.binary_search(cell) else { continue };
                    v.iter_mut().zip(at_cells[i]).for_each(|(v, c)| *v += weight * c);
                }
                let root = self.weights[point].sqrt();
                read.push(v.map(|c| root * c));
                true_ones.push(self.seen[set][point].map(|c| root * c));
            }
            Ok([(read, 0.0), (true_ones, 0.0)])
        };
        let [a, b] = [pair(0)?, pair(1)?];
        Ok(systematic([[&a[0], &a[1]], [&b[0], &b[1]]], (self.bands * self.bands) as usize)[0])
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
        let bent: f32 = fewer.iter().map(|&(c, w)| w * 4.0 * ((c % 6) as f32 + 0.5)).sum();
        assert!((bent - 9.5).abs() > 1e-2, "{bent}");
        assert!(around(voxel, n, dims, &[true; 72]).is_empty());
    }
}
