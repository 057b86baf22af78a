//! majorant: the largest extinction of each cell of [`CELL`] voxels a side, over every value that interpolation can take
//! there. What lies in a cell of majorant 0 is vacuum; elsewhere a ray meets tentative collisions at the majorant's rate.

use super::{MediumView, Parts, slab, twin};
use crate::error::Result;
use crate::kernels::majorant as kernel;
use crate::scene::Volume;
use crate::scene::transfer::{TABLE_SIZE, Table};
use crate::vk::{Access, Image, Recorder};

/// Voxels along a cell's edge: smaller ones bound tighter and are more to cross.
pub const CELL: u32 = 8;

/// Cells per dispatch, each a thousand texels.
const CELLS: u64 = 1 << 13;

/// Cells along x, y, z.
pub fn cells(dims: [usize; 3]) -> [u32; 3] {
    dims.map(|n| (n as u32).div_ceil(CELL))
}

/// Records the majorants (r32f, [`cells`]), slab by slab; the image must be ready for stores and is left as just written.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, medium: &MediumView, majorants: &Image, parts: &mut Parts) -> Result<()> {
    let dims = majorants.dims();
    let slices = slab(dims, CELLS);
    for first_slice in (0..dims[2]).step_by(slices as usize) {
        if first_slice > 0 {
            // Slabs do not overlap; levels are tracked whole.
            rec.barrier(&[majorants.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
        }
        rec.dispatch(
            &kernel::Bindings { volume: medium.volume.sampled(), sigma: medium.sigma, majorants: majorants.storage(0) },
            &kernel::Spec { cell: CELL },
            &kernel::Params { cells: dims, first_slice, map_scale: medium.map.0, map_bias: medium.map.1 },
            [dims[0], dims[1], slices.min(dims[2] - first_slice)],
        )?;
        parts(rec, f64::from((first_slice + slices).min(dims[2])) / f64::from(dims[2]))?;
    }
    Ok(())
}

/// The twin, x fastest.
pub fn reference(volume: &Volume, table: &Table) -> Vec<f32> {
    let n = volume.grid().dims();
    let [cx, cy, cz] = cells(n).map(|c| c as usize);
    let edge = CELL as usize;
    let mut out = Vec::with_capacity(cx * cy * cz);
    for c in 0..cx * cy * cz {
        let at = [c % cx, c / cx % cy, c / cx / cy];
        let from: [usize; 3] = std::array::from_fn(|a| (at[a] * edge).saturating_sub(1));
        let to: [usize; 3] = std::array::from_fn(|a| ((at[a] + 1) * edge).min(n[a] - 1));
        let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    let v = volume.value(x + n[0] * (y + n[1] * z));
                    (least, most) = (least.min(v), most.max(v));
                }
            }
        }
        let (first, _) = twin::table_position(table, least);
        let (last, _) = twin::table_position(table, most);
        let span = &table.sigma[first.saturating_sub(1)..(last + 3).min(TABLE_SIZE)];
        out.push(span.iter().fold(0.0, |m, &s| f32::max(m, s)));
    }
    out
}
