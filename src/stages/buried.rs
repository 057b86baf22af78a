//! buried: which cells of a field are centred inside an opaque surface, D(centre) ≥ iso, and not clipped away. Nothing is
//! seen from there: V = 0 in every direction. An opaque medium of finite extinction would let light a fraction of a voxel
//! deep, and say of such cells what no picture reads and what no two estimators agree on.

use super::{MediumView, twin};
use crate::error::Result;
use crate::kernels::buried as kernel;
use crate::scene::Volume;
use crate::vk::{Buffer, Recorder};

/// Words of 32 cells per dispatch: tens of milliseconds on a CPU device.
pub const WORDS: usize = 1 << 16;

/// Records a dispatch: `count` words from `first` on, into `words` from its beginning, which must be ready for writes. `iso`
/// as the volume's image returns it, and whether its samples rise with the values.
///
/// # Errors
/// What the recorder refuses.
pub fn record(
    rec: &mut Recorder,
    medium: &MediumView,
    field_dims: [usize; 3],
    (iso, rising): (f32, bool),
    words: &Buffer,
    (first, count): (usize, usize),
) -> Result<()> {
    rec.dispatch(
        &kernel::Bindings { volume: medium.volume.sampled(), sigma: medium.sigma, words },
        &kernel::Spec { clips: medium.clips },
        &kernel::Params {
            field_dims: field_dims.map(|n| n as f32),
            iso,
            side: if rising { 1.0 } else { -1.0 },
            map_scale: medium.map.0,
            map_bias: medium.map.1,
            first_word: first as u32,
            word_count: count as u32,
        },
        [count as u32, 1, 1],
    )
}

/// The twin, x fastest. `planes`: what is kept, n·p + d ≥ 0 in voxels.
pub fn reference(volume: &Volume, field_dims: [usize; 3], iso: f32, planes: &[[f32; 4]]) -> Vec<bool> {
    let cells = field_dims.iter().product::<usize>() as u32;
    let inside = |cell| {
        let p = twin::cell_centre(volume.grid(), field_dims, cell);
        let kept = planes.iter().all(|n| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + n[3] >= 0.0);
        kept && twin::sample(volume, p) >= iso
    };
    (0..cells).map(inside).collect()
}
