//! Clipping: what lies outside is vacuum, for viewing rays and for shadows. What is kept is convex: a ray meets it in one
//! interval, so that every march through the medium is cut exactly where the plane stands (trilinear inside, nothing
//! beyond), at no cost per sample.

use super::camera::Space;
use super::grid::Grid;
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

/// Most planes besides the box.
pub const MAX_PLANES: usize = 10;

/// `[clip]`: the part of the volume that is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// Lower and upper corner of the kept box, as fractions 0..1 of the volume's own sides, along its own axes.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Kept half spaces n·p ≥ d as [n.x, n.y, n.z, d]; world axes, n taken at length 1, so that `d` is a distance along it.
    pub planes: Vec<[f64; 4]>,
    /// What p and d count in: longest sides from the volume's centre, or world coordinates.
    pub space: Space,
}

impl Clip {
    /// Checks each number.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a box upside down or outside 0..1, a normal of length 0, numbers that are not finite, and
    /// more than [`MAX_PLANES`] planes.
    pub fn check(&self) -> Result<()> {
        let bad = |item, what: String, right: &str| Err(Error::Invalid { item, what, right: right.into() });
        if let Some([lo, hi]) = self.bounds
            && !(0..3).all(|a| 0.0 <= lo[a] && lo[a] < hi[a] && hi[a] <= 1.0)
        {
            let right = "it must be [x0, y0, z0, x1, y1, z1] with 0 <= x0 < x1 <= 1 and so on, fractions of the volume's sides";
            return bad("clip.box", format!("is {lo:?} to {hi:?}"), right);
        }
        if self.planes.len() > MAX_PLANES {
            return bad("clip.planes", format!("has {} planes", self.planes.len()), "at most 10 are cut by");
        }
        if let Some(p) = self.planes.iter().find(|p| !p.iter().all(|x| x.is_finite()) || p[..3].iter().all(|x| x.abs() < 1e-12)) {
            return bad(
                "clip.planes",
                format!("has {p:?}"),
                "each is [nx, ny, nz, d] with a normal that is not 0, taken at length 1: n·p >= d is kept",
            );
        }
        Ok(())
    }

    /// Whether nothing is left of a volume on `grid`: no corner of what the planes and the box's faces bound lies within all
    /// of them. What is bounded and not empty has one.
    pub fn keeps_nothing(&self, grid: &Grid) -> bool {
        // A hair further in: what is only touched has no volume.
        const HAIR: f64 = 1e-5;
        let dims = grid.dims().map(|n| n as f64);
        let mut planes: Vec<(DVec3, f64)> = Vec::new();
        for (n, size) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(dims) {
            planes.extend([(n, -HAIR), (-n, size - HAIR)]);
        }
        for [x, y, z, d] in self.half_spaces(grid) {
            let n = DVec3::new(x.into(), y.into(), z.into());
            planes.extend(n.try_normalize().map(|unit| (unit, f64::from(d) / n.length() - HAIR)));
        }
        let inside = |p: DVec3| planes.iter().all(|(n, d)| n.dot(p) + d > -0.01 * HAIR);
        (0..planes.len()).all(|i| {
            (0..i).all(|j| {
                (0..j).all(|k| {
                    let [a, b, c] = [i, j, k].map(|p| planes[p]);
                    let m = DMat3::from_cols(a.0, b.0, c.0).transpose();
                    m.determinant().abs() < 1e-9 || !inside(m.inverse() * -DVec3::new(a.1, b.1, c.1))
                })
            })
        })
    }

    /// The kept half spaces of a volume on `grid`, voxel space: n·p + d ≥ 0 as [n.x, n.y, n.z, d], |n| the change per voxel.
    pub fn half_spaces(&self, grid: &Grid) -> Vec<[f32; 4]> {
        let dims = grid.dims().map(|n| n as f64);
        let mut out = Vec::new();
        for a in 0..3 {
            let Some([lo, hi]) = self.bounds else { break };
            let mut face = |sign: f64, at: f64| {
                let mut plane = [0f32; 4];
                plane[a] = sign as f32;
                plane[3] = (-sign * at * dims[a]) as f32;
                out.push(plane);
            };
            // The volume's own faces cut without help.
            if lo[a] > 0.0 {
                face(1.0, lo[a]);
            }
            if hi[a] < 1.0 {
                face(-1.0, hi[a]);
            }
        }
        let map = grid.voxel_to_world();
        for &[x, y, z, d] in &self.planes {
            let n = DVec3::new(x, y, z).normalize_or_zero();
            let d = match self.space {
                Space::Side => n.dot(grid.centre_world()) + d * grid.longest_side(),
                Space::World => d,
            };
            // n·(M v + t) − d, as a function of voxel coordinates v.
            let m = map.matrix3.transpose() * n;
            out.push([m.x as f32, m.y as f32, m.z as f32, (n.dot(map.translation) - d) as f32]);
        }
        out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use glam::DAffine3;

    #[test]
    fn half_spaces_stand_where_the_words_say() {
        let map = DAffine3 {
            matrix3: DMat3::from_cols(DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.5, 1.0, 0.0), DVec3::Z),
            translation: DVec3::new(-1.0, 4.0, 2.0),
        };
        let grid = Grid::new([10, 8, 6], map).unwrap();
        let clip = Clip {
            bounds: Some([[0.5, 0.0, 0.0], [1.0, 0.25, 1.0]]),
            planes: vec![[0.0, 3.0, 0.0, 5.0], [1.0, 1.0, 0.0, 0.0]],
            space: Space::World,
        };
        clip.check().unwrap();
        let planes = clip.half_spaces(&grid);
        assert_eq!(planes.len(), 4, "faces at 0 and 1 cost nothing");
        let inside =
            |p: [f64; 3]| planes.iter().map(|n| (0..3).map(|a| f64::from(n[a]) * p[a]).sum::<f64>() + f64::from(n[3])).collect::<Vec<_>>();
        assert_eq!(inside([5.0, 2.0, 0.0])[..2], [0.0, 0.0]);
        // World y = 5 where the voxel's y is 1.
        assert!(inside([3.0, 1.0, 2.0])[2].abs() < 1e-6 && inside([3.0, 1.5, 2.0])[2] > 0.0);
        let world = map.transform_point3(DVec3::new(3.0, 2.0, 1.0));
        assert!((inside([3.0, 2.0, 1.0])[3] - (world.x + world.y) / 2f64.sqrt()).abs() < 1e-5);
        let side = Clip { planes: vec![[0.0, 0.0, 1.0, 0.25]], ..Clip::default() };
        let [x, y, z] = grid.dims().map(|n| n as f64 / 2.0);
        let p = side.half_spaces(&grid)[0];
        assert!(
            (f64::from(p[0]) * x + f64::from(p[1]) * y + f64::from(p[2]) * z + f64::from(p[3]) + 0.25 * grid.longest_side()).abs() < 1e-5
        );
    }

    #[test]
    fn what_keeps_nothing_is_known() {
        let grid = Grid::axis_aligned([10, 8, 6], [1.0, 0.5, 2.0]).unwrap();
        let planes = |planes: &[[f64; 4]]| Clip { planes: planes.to_vec(), ..Clip::default() }.keeps_nothing(&grid);
        // The longest side is 12: z spans -0.5 to 0.5 of it, x less.
        assert!(!planes(&[]) && !planes(&[[0.0, 0.0, 1.0, 0.49]]) && planes(&[[0.0, 0.0, 1.0, 0.51]]));
        assert!(!planes(&[[1.0, 0.0, 0.0, 0.41]]) && planes(&[[1.0, 0.0, 0.0, 0.42]]) && planes(&[[1.0, 0.0, 0.0, 5.0]]));
        // Two that leave a wedge, and two that face away from each other.
        assert!(!planes(&[[0.0, 0.0, 1.0, 0.1], [1.0, 0.0, -1.0, -0.15]]) && planes(&[[0.0, 0.0, 1.0, 0.1], [0.0, 0.0, -1.0, 0.1]]));
        // No plane alone, but these three together with the box.
        assert!(planes(&[[1.0, 0.0, 0.0, 0.3], [-1.0, 1.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]));
        // The box's fractions against a plane.
        let both = |d| Clip { bounds: Some([[0.0; 3], [1.0, 1.0, 0.25]]), planes: vec![[0.0, 0.0, 1.0, d]], space: Space::Side };
        assert!(!both(-0.26).keeps_nothing(&grid) && both(-0.24).keeps_nothing(&grid));
    }

    #[test]
    fn nonsense_is_refused() {
        let bounds = |lo, hi| Clip { bounds: Some([lo, hi]), ..Clip::default() };
        assert!(bounds([0.5; 3], [0.5; 3]).check().is_err());
        assert!(bounds([-0.1; 3], [0.5; 3]).check().is_err());
        assert!(bounds([f64::NAN; 3], [1.0; 3]).check().is_err());
        let planes = |p: [f64; 4], n| Clip { planes: vec![p; n], ..Clip::default() };
        assert!(planes([0.0, 0.0, 0.0, 1.0], 1).check().is_err());
        assert!(planes([0.0, 0.0, f64::INFINITY, 1.0], 1).check().is_err());
        assert!(planes([0.0, 0.0, 1.0, 1.0], 11).check().is_err());
        assert!(planes([0.0, 0.0, 1.0, 1.0], 10).check().is_ok() && Clip::default().check().is_ok());
    }
}
