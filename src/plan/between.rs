//! What a field misses between its cells: pictures read it at points of matter, trilinearly, and beside opaque walls light
//! changes within a fraction of a cell.

use super::bench::{Run, systematic};
use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::measure::reading::{self, around};
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Visibility, Volume};

/// Directions of the two sets; they share none, so what few directions miss is told from what cells miss.
const DIRECTIONS: [u32; 2] = [41, 53];

/// Points at which pictures read a medium's field, and what is seen from there.
pub(super) struct Points {
    /// Linear voxel indices.
    voxels: Vec<u32>,
    /// How much a picture reads of each.
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
        let voxels = reading::points(volume, medium, count);
        let [a, b] = DIRECTIONS.map(|n| engine.estimate(medium, &marched(1, bands, n), &voxels, progress));
        let seen = [a?, b?];
        let weights = reading::weights(volume, medium, &voxels, &seen[1]);
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
