//! Where pictures read a field, and what they read there: at points of matter, trilinearly between cells.

use crate::engine::Medium;
use crate::scene::Volume;
use crate::stages::directions::SplitMix;
use crate::stages::twin;

/// Voxels that are looked at for points, at most: vessels fill a hundredth of their volume.
const TRIES: usize = 1 << 22;

/// The seed of the points.
const SEED: u64 = 0x62_6574_7765_656e;

/// Up to `count` voxels of matter, drawn at random, ascending: with σ_t > 0, or, of an opaque surface, just outside it.
pub(crate) fn points(volume: &Volume, medium: &Medium, count: usize) -> Vec<u32> {
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
    voxels
}

/// How much a picture reads of each of `voxels`, which see `seen`: the opacity of a voxel times what light reaches it, for
/// cameras see what light sees; of a surface 1.
pub(crate) fn weights(volume: &Volume, medium: &Medium, voxels: &[u32], seen: &[[f32; 16]]) -> Vec<f32> {
    let lit = |(opacity, v): (f32, &[f32; 16])| if medium.has_surface() { 1.0 } else { opacity * v[0].max(0.0) };
    opacities(volume, medium, voxels).into_iter().zip(seen).map(lit).collect()
}

/// The opacities of voxels, 0..1.
pub(crate) fn opacities(volume: &Volume, medium: &Medium, voxels: &[u32]) -> Vec<f32> {
    let length = volume.grid().voxel_length() as f32;
    let of = |&voxel: &u32| 1.0 - (-twin::extinction(medium.table(), volume.value(voxel as usize)) * length).exp();
    voxels.iter().map(of).collect()
}

/// What is read at a voxel's centre from a field of `dims` cells, over a volume of `n` voxels: `cell` gives a cell's coefficients.
pub(crate) fn read(voxel: u32, n: [usize; 3], dims: [usize; 3], cell: impl Fn(u32) -> [f32; 16]) -> [f32; 16] {
    let mut v = [0f32; 16];
    for (c, weight) in around(voxel as usize, n, dims, &[]) {
        v.iter_mut().zip(cell(c)).for_each(|(v, c)| *v += weight * c);
    }
    v
}

/// The cells around a voxel's centre and their trilinear weights, of which those inside an opaque surface have none.
pub(crate) fn around(voxel: usize, n: [usize; 3], dims: [usize; 3], buried: &[bool]) -> Vec<(u32, f32)> {
    let at = [voxel % n[0], voxel / n[0] % n[1], voxel / n[0] / n[1]];
    let q = std::array::from_fn(|a| (at[a] as f32 + 0.5) * dims[a] as f32 / n[a] as f32 - 0.5);
    let sees = |cell: usize| !buried.get(cell).is_some_and(|b| *b);
    let mut corners: Vec<(u32, f32)> =
        twin::corners(dims, q).into_iter().filter(|c| sees(c.0)).map(|(cell, weight)| (cell as u32, weight)).collect();
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
