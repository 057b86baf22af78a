//! Where a volume lies: dims, and the affine map from voxel to world coordinates.

use crate::error::{Error, Result};
pub use glam;
use glam::{DAffine3, DMat3, DVec3};

/// Longest edge of a voxel, world units: a million of them, and a camera some boxes away, are still distances in single precision.
const LONGEST_SPACING: f64 = 1e30;

/// The sampling grid of a volume. `voxel` coordinates run 0..n per axis, the centre of voxel i lies at i + ½; `world`
/// coordinates are the data's physical units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    voxel_to_world: DAffine3,
}

impl Grid {
    /// A grid of `dims` voxels. `voxel_to_world` maps voxel coordinates (corner of voxel 0 at the origin) to world;
    /// it may be oblique, not singular.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a dimension of 0 or beyond 2^20, and for a map that is not finite, has no volume, or spaces voxels by
    /// more than 10³⁰.
    pub fn new(dims: [usize; 3], voxel_to_world: DAffine3) -> Result<Self> {
        if dims.iter().any(|&n| n == 0 || n > 1 << 20) {
            return Err(Error::Invalid {
                item: "grid dims",
                what: format!("{}x{}x{} voxels", dims[0], dims[1], dims[2]),
                right: "each must be 1 to 1048576".into(),
            });
        }
        let m = voxel_to_world.matrix3;
        let scale = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
        if !voxel_to_world.is_finite() || m.determinant().abs() <= 1e-9 * scale || scale < 1e-60 {
            return Err(Error::Invalid {
                item: "grid spacing",
                what: format!("the voxel axes {}, {}, {} span no volume", m.x_axis, m.y_axis, m.z_axis),
                right: "they must be finite, not zero, and not lie in one plane".into(),
            });
        }
        let longest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        if longest > LONGEST_SPACING {
            return Err(Error::Invalid {
                item: "grid spacing",
                what: format!("a voxel's edge is {longest:e} world units"),
                right: format!("at most {LONGEST_SPACING:e}, for distances in single precision: take a larger unit of length"),
            });
        }
        Ok(Self { dims, voxel_to_world })
    }

    /// An axis-aligned grid whose box begins at the world origin.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn axis_aligned(dims: [usize; 3], spacing: [f64; 3]) -> Result<Self> {
        Self::new(dims, DAffine3::from_scale(DVec3::from(spacing)))
    }

    /// Voxels along x, y, z (x fastest in memory).
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of voxels.
    pub fn voxels(&self) -> u64 {
        self.dims.iter().map(|&n| n as u64).product()
    }

    /// The map from voxel to world coordinates.
    pub fn voxel_to_world(&self) -> DAffine3 {
        self.voxel_to_world
    }

    /// The map from world to voxel coordinates.
    pub fn world_to_voxel(&self) -> DAffine3 {
        self.voxel_to_world.inverse()
    }

    /// Lengths of the three voxel edges, world units.
    pub fn spacing(&self) -> [f64; 3] {
        let m = self.voxel_to_world.matrix3;
        [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()]
    }

    /// The length that "one voxel" means for steps and opacities: the smallest distance between neighbouring planes of
    /// voxels, world units (the smallest spacing when the axes are orthogonal; VTK's usual unit distance).
    pub fn voxel_length(&self) -> f64 {
        let inverse = self.voxel_to_world.matrix3.inverse().transpose();
        1.0 / inverse.x_axis.length().max(inverse.y_axis.length()).max(inverse.z_axis.length())
    }

    /// A power of two near [`Grid::voxel_length`], world units: what is brought to single precision in it keeps its bits, and its
    /// squares stay in range whatever unit the world has.
    pub fn unit(&self) -> f64 {
        self.voxel_length().log2().floor().exp2()
    }

    /// Longest edge of the volume's box, world units.
    pub fn longest_side(&self) -> f64 {
        let s = self.spacing();
        (0..3).map(|a| s[a] * self.dims[a] as f64).fold(0.0, f64::max)
    }

    /// Centre of the volume's box, world coordinates.
    pub fn centre_world(&self) -> DVec3 {
        self.voxel_to_world.transform_point3(self.dims_f64() * 0.5)
    }

    /// Length of the box's longest diagonal, world units: no straight way through the volume is longer.
    pub fn diagonal(&self) -> f64 {
        let n = self.dims_f64();
        let m = self.voxel_to_world.matrix3;
        [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]
            .iter()
            .map(|s| (m * DVec3::new(n.x, n.y * s[0], n.z * s[1])).length())
            .fold(0.0, f64::max)
    }

    /// MᵀM of the linear part M: the world length of a voxel-space vector d is √(dᵀ metric d).
    pub fn metric(&self) -> DMat3 {
        let m = self.voxel_to_world.matrix3;
        m.transpose() * m
    }

    /// Cells of a field at 1:`ratio`, rounded up. Cells divide the box evenly: cell j along an axis of n voxels and c
    /// cells has its centre at voxel coordinate (j + ½)·n/c, so field and volume share normalised coordinates.
    pub fn field_dims(&self, ratio: usize) -> [usize; 3] {
        self.dims.map(|n| n.div_ceil(ratio.max(1)))
    }

    fn dims_f64(&self) -> DVec3 {
        DVec3::new(self.dims[0] as f64, self.dims[1] as f64, self.dims[2] as f64)
    }
}
