//! The straight line's stages, one file per kernel: the equation, `record()` for the device and `reference()`, the CPU
//! twin in plain loops. `twin` and `directions` hold what they share.

pub mod aov;
pub mod block_ranges;
pub mod bricks;
pub mod buried;
pub mod cells;
pub mod classify;
pub mod directions;
pub mod estimate;
pub mod fit;
pub mod hierarchical;
pub mod isosurface;
pub mod majorant;
pub mod march;
pub mod minify;
pub mod occupancy;
pub mod pack;
pub mod raymarch;
pub mod relight;
pub mod resolve;
pub mod sweep;
pub mod trace;
pub mod twin;
pub mod widen;

use crate::error::Result;
use crate::scene::{Grid, Volume};
use crate::vk::{self, Recorder};

/// How the volume's image encodes values: image sample x → value = scale·x + bias, in the data's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoding {
    /// Data units per image unit.
    pub scale: f32,
    /// Value at image sample 0.
    pub bias: f32,
}

impl Encoding {
    /// The encoding that `upload` uses for these samples: integers become 16-bit unorm (what 8 bits hold is spread exactly,
    /// since some devices round the filtering of 8-bit images to 8 bits), floats stay floats.
    pub fn of(volume: &Volume) -> Self {
        widen::SampleType::stored_as(volume).encoding(volume.rescale())
    }

    /// The image sample that stands for a value.
    pub fn sample_of(&self, value: f32) -> f32 {
        (value - self.bias) / self.scale
    }

    /// (map_scale, map_bias): image sample → table coordinate for a table over `lo..hi`.
    pub fn table_map(&self, lo: f32, hi: f32) -> (f32, f32) {
        let last = (crate::scene::transfer::TABLE_SIZE - 1) as f32;
        if hi > lo { (self.scale / (hi - lo) * last, (self.bias - lo) / (hi - lo) * last) } else { (0.0, 0.0) }
    }
}

/// A classified volume on the device: what the stages after classification read.
pub struct MediumView<'a> {
    /// Dims and place.
    pub grid: &'a Grid,
    /// Scalars.
    pub volume: &'a vk::Image,
    /// σ_t table, 1/world unit; behind it four numbers per clip plane (`glsl/clip.glsl`), and [`Grid::unit`]s per world unit.
    pub sigma: &'a vk::Buffer,
    /// Clip planes.
    pub clips: u32,
    /// Albedo table.
    pub albedo: &'a vk::Buffer,
    /// Image sample → table coordinate.
    pub map: (f32, f32),
    /// Distance of each block to the nearest that holds matter; see `stages::occupancy`.
    pub occupancy: &'a vk::Image,
    /// The albedo of all table entries, where they have the same.
    pub flat_albedo: Option<[f32; 3]>,
}

/// Dims as the kernels take them.
pub(crate) fn dims_u32(dims: [usize; 3]) -> [u32; 3] {
    dims.map(|n| n as u32)
}

/// Dims as floats.
pub(crate) fn dims_f32(dims: [usize; 3]) -> [f32; 3] {
    dims.map(|n| n as f32)
}

/// Voxels per field cell along each axis.
pub(crate) fn cell_size(grid: &Grid, field_dims: [usize; 3]) -> [f32; 3] {
    let n = grid.dims();
    std::array::from_fn(|a| n[a] as f32 / field_dims[a] as f32)
}

/// Called after each dispatch of a stage that splits its work, with the fraction of the stage that is recorded: may submit it,
/// and stop.
pub type Parts<'a> = dyn FnMut(&mut Recorder, f64) -> Result<()> + 'a;

/// Slices per dispatch so that a dispatch touches at most `voxels` voxels.
pub(crate) fn slab(dims: [u32; 3], voxels: u64) -> u32 {
    (voxels / (u64::from(dims[0]) * u64::from(dims[1])).max(1)).clamp(1, u64::from(dims[2])) as u32
}
