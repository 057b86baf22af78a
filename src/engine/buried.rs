//! Cells that an opaque surface buries: found once per medium and ratio, and left out by every estimator.

use super::{Engine, Medium};
use crate::error::Result;
use crate::stages::buried;
use crate::vk::Access;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Which cells are buried, x fastest, by the field's dims.
pub(super) type Known = Mutex<BTreeMap<[usize; 3], Arc<Vec<bool>>>>;

impl Engine {
    /// Which cells of a field of `dims` are centred inside the medium's surface, x fastest; nothing where it has none.
    pub(crate) fn buried(&self, medium: &Medium, dims: [usize; 3]) -> Result<Arc<Vec<bool>>> {
        let Some(surface) = medium.matter.surface else { return Ok(Arc::default()) };
        if let Some(known) = medium.buried.lock().unwrap_or_else(PoisonError::into_inner).get(&dims) {
            return Ok(known.clone());
        }
        let cells: usize = dims.iter().product();
        let all = cells.div_ceil(32);
        let encoding = medium.volume.0.encoding;
        let iso = (encoding.sample_of(surface.iso as f32), encoding.scale > 0.0);
        let words = self.device.buffer::<u32>("buried cells", all.min(buried::WORDS))?;
        let mut found = Vec::with_capacity(32 * all);
        for first in (0..all).step_by(buried::WORDS) {
            let count = buried::WORDS.min(all - first);
            let mut rec = self.device.record()?;
            // The host has read what was there.
            rec.barrier(&[words.all().from(words.last_access()).to(Access::ComputeWrite)]);
            buried::record(&mut rec, &medium.view(), dims, iso, &words, (first, count))?;
            rec.submit()?;
            let read: Vec<u32> = self.device.read(&words, count)?;
            found.extend(read.into_iter().flat_map(|w| (0..32).map(move |b| w >> b & 1 == 1)));
        }
        found.truncate(cells);
        let found = Arc::new(found);
        medium.buried.lock().unwrap_or_else(PoisonError::into_inner).insert(dims, found.clone());
        Ok(found)
    }
}
