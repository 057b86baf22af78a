//! Direction sets of the estimators, tabulated with their Y_lm (Ritschel 2007, "Sampling Implementation Details").

use crate::scene::{Grid, sh, visibility::Sampling};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Jittered patterns M: enough that neighbours rarely share one.
pub const PATTERNS: u32 = 64;

/// One tabulated direction, as the kernels read it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Direction {
    /// xyz: direction in voxel space, of world length 1; no component is 0.
    pub voxel: [f32; 4],
    /// Y_lm of the world direction, index l(l+1)+m.
    pub basis: [f32; 16],
}

/// A table of patterns, one after the other, each of `pattern_size` directions.
pub struct Directions {
    /// `patterns`·`pattern_size` directions.
    pub table: Vec<Direction>,
    /// Directions in a pattern, N.
    pub pattern_size: u32,
    /// Number of patterns, M.
    pub patterns: u32,
}

impl Directions {
    /// The table for `n` directions per cell over `grid`.
    pub fn new(n: u32, sampling: Sampling, grid: &Grid) -> Self {
        let (set, patterns) = match sampling {
            Sampling::Stratified => (fibonacci(n), 1),
            Sampling::Jittered => (jittered(n, PATTERNS), PATTERNS),
        };
        let to_voxel = grid.world_to_voxel().matrix3;
        let table = set.iter().map(|&world| tabulate(world, to_voxel * world)).collect();
        Self { table, pattern_size: n, patterns }
    }
}

fn tabulate(world: DVec3, voxel: DVec3) -> Direction {
    Direction { voxel: safe_voxel(voxel), basis: sh::basis(world).map(|y| y as f32) }
}

/// A voxel-space direction as the kernels take it: a component of exactly 0 would make the slab test divide 0 by 0.
pub(crate) fn safe_voxel(voxel: DVec3) -> [f32; 4] {
    let least = 1e-7 * voxel.abs().max_element();
    let safe = |v: f64| if v.abs() < least { least } else { v } as f32;
    [safe(voxel.x), safe(voxel.y), safe(voxel.z), 0.0]
}

/// The same directions in an order whose every beginning is well spread: each next one stands where the potential
/// Σ 1/|d − dᵢ| of those before is least (greedy minimal energy). N² work.
pub fn spread(set: &[DVec3]) -> Vec<DVec3> {
    let mut potential = vec![0.0; set.len()];
    let mut out = Vec::with_capacity(set.len());
    for _ in 0..set.len() {
        let best = (0..set.len()).min_by(|&a, &b| f64::total_cmp(&potential[a], &potential[b])).unwrap_or(0);
        let chosen = set[best];
        for (p, d) in potential.iter_mut().zip(set) {
            *p += 1.0 / d.distance(chosen).max(1e-12);
        }
        potential[best] = f64::INFINITY;
        out.push(chosen);
    }
    out
}

/// Spherical Fibonacci set: equal areas, each point at the middle of its z-stratum, turned by the golden angle.
pub fn fibonacci(n: u32) -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            on_sphere(z, golden * f64::from(i))
        })
        .collect()
}

/// `patterns` sets of `n` directions, each jittered within one of n equal-area strata (rows of z, cut evenly in angle).
/// The seed is fixed: the same table everywhere.
pub fn jittered(n: u32, patterns: u32) -> Vec<DVec3> {
    let rows = (f64::from(n).sqrt().round() as u32).max(1);
    let mut random = SplitMix(0x6861_6c66_6c69_6768);
    let mut out = Vec::with_capacity((n * patterns) as usize);
    for _ in 0..patterns {
        for row in 0..rows {
            // Rows take their share of n, and a band of z in proportion, so that all strata have the same area.
            let first = (u64::from(n) * u64::from(row) / u64::from(rows)) as u32;
            let end = (u64::from(n) * u64::from(row + 1) / u64::from(rows)) as u32;
            for i in first..end {
                let z = 1.0 - 2.0 * (f64::from(first) + f64::from(end - first) * random.unit()) / f64::from(n);
                let phi = std::f64::consts::TAU * (f64::from(i - first) + random.unit()) / f64::from(end - first);
                out.push(on_sphere(z, phi));
            }
        }
    }
    out
}

fn on_sphere(z: f64, phi: f64) -> DVec3 {
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// SplitMix64 (Steele et al. 2014): small, seeded, the same everywhere.
pub(crate) struct SplitMix(pub(crate) u64);

impl SplitMix {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// PCG hash (Jarzynski & Olano 2020): picks a cell's pattern; the same as in `estimate.glsl`.
pub(crate) fn pcg_hash(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ Y_i Y_j over the set, times 4π/N, must be the identity: to rounding of the set's own spread.
    fn gram_error(set: &[DVec3]) -> f64 {
        let mut g = [[0.0; 16]; 16];
        for &d in set {
            let y = sh::basis(d);
            for i in 0..16 {
                for j in 0..16 {
                    g[i][j] += y[i] * y[j] * 4.0 * std::f64::consts::PI / set.len() as f64;
                }
            }
        }
        (0..256).map(|k| (g[k / 16][k % 16] - f64::from(u8::from(k / 16 == k % 16))).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn fibonacci_integrates_products_of_harmonics() {
        assert!(gram_error(&fibonacci(400)) < 0.01, "{}", gram_error(&fibonacci(400)));
        // Sabotage: a set with its last quarter missing is no longer spread.
        assert!(gram_error(&fibonacci(400)[..300]) > 0.1);
    }

    #[test]
    fn jittered_strata_have_equal_area_for_any_count() {
        for n in [1, 2, 7, 100, 397, 400] {
            let set = jittered(n, 3);
            assert_eq!(set.len(), 3 * n as usize);
            assert!(set.iter().all(|d| (d.length() - 1.0).abs() < 1e-12));
        }
        assert!(gram_error(&jittered(400, 1)) < 0.15);
        assert!(gram_error(&jittered(400, 64)) < 0.02);
    }
}
