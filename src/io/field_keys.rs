//! What a field is of, as hashes (BLAKE3) in its file: of contents, never of names or dates, so that they hold on every machine.

use super::NrrdField;
use crate::scene::transfer::Table;
use crate::scene::{Grid, Matter, Samples, Volume};
use std::borrow::Cow;

/// What a field is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldKeys {
    /// Hash of the volume.
    pub volume: String,
    /// Hash of its matter.
    pub matter: String,
}

impl FieldKeys {
    /// Those of a volume that is filled by `matter` within the half spaces of `clip`
    /// ([`Clip::half_spaces`](crate::scene::Clip::half_spaces)).
    pub fn of(volume: &Volume, matter: &Matter, clip: &[[f32; 4]]) -> Self {
        Self { volume: of_volume(volume), matter: of_matter(matter, clip, volume.range(), volume.grid()) }
    }

    /// The lines of a field's header.
    pub fn meta(&self, coefficients: &[f32]) -> [(String, String); 3] {
        let data = of_coefficients(coefficients);
        [("volume_hash".into(), self.volume.clone()), ("matter_hash".into(), self.matter.clone()), ("data_hash".into(), data)]
    }

    /// Whether a file says what it is of.
    pub fn told(file: &NrrdField) -> bool {
        ["volume_hash", "matter_hash", "data_hash"].iter().all(|key| line(file, key).is_some())
    }

    /// Why a file is not of this, if it says something else.
    pub fn differ(&self, file: &NrrdField) -> Option<&'static str> {
        let other = |key: &str, hash: &str| line(file, key).is_some_and(|told| told != hash);
        if line(file, "data_hash").is_some_and(|told| told != of_coefficients(&file.data)) {
            return Some("its coefficients are not those that were written: it is damaged");
        }
        if other("volume_hash", &self.volume) {
            return Some("it was computed from another volume");
        }
        other("matter_hash", &self.matter).then_some("it was computed for another transfer function, surface or clipping")
    }
}

fn line<'a>(file: &'a NrrdField, key: &str) -> Option<&'a str> {
    file.meta.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str())
}

/// What a volume holds: dims, place, type, rescaling, samples.
pub fn of_volume(volume: &Volume) -> String {
    let mut hasher = blake3::Hasher::new();
    let map = volume.grid().voxel_to_world();
    for n in volume.grid().dims() {
        hasher.update(&(n as u64).to_le_bytes());
    }
    for x in map.to_cols_array() {
        hasher.update(&x.to_le_bytes());
    }
    let (slope, intercept) = volume.rescale();
    hasher.update(&slope.to_le_bytes()).update(&intercept.to_le_bytes()).update(volume.samples().type_name().as_bytes());
    match volume.samples() {
        Samples::U8(s) => drop(hasher.update(s)),
        Samples::U16(s) => numbers(&mut hasher, s),
        Samples::I16(s) => numbers(&mut hasher, s),
        Samples::F32(s) => numbers(&mut hasher, s),
    }
    hex(&hasher)
}

/// Where a medium absorbs, and how much: what visibility depends on beside the volume. Colours have no part in it.
pub fn of_matter(matter: &Matter, clip: &[[f32; 4]], range: [f32; 2], grid: &Grid) -> String {
    let mut hasher = blake3::Hasher::new();
    match matter.surface {
        Some(surface) => drop(hasher.update(b"surface").update(&surface.iso.to_le_bytes())),
        None => {
            let Table { lo, hi, sigma, .. } = matter.transfer.table(range, grid);
            hasher.update(b"medium").update(&lo.to_le_bytes()).update(&hi.to_le_bytes());
            numbers(&mut hasher, &sigma);
        }
    }
    numbers(&mut hasher, clip.as_flattened());
    hex(&hasher)
}

/// The numbers of a field.
pub fn of_coefficients(data: &[f32]) -> String {
    let mut hasher = blake3::Hasher::new();
    numbers(&mut hasher, data);
    hex(&hasher)
}

fn numbers<T: bytemuck::Pod>(hasher: &mut blake3::Hasher, values: &[T]) {
    for bytes in little_endian(values) {
        hasher.update(&bytes);
    }
}

/// Numbers as little-endian bytes, a part at a time.
pub(super) fn little_endian<T: bytemuck::Pod>(values: &[T]) -> impl Iterator<Item = Cow<'_, [u8]>> {
    values.chunks(1 << 16).map(|part| {
        let bytes: &[u8] = bytemuck::cast_slice(part);
        if cfg!(target_endian = "little") {
            return Cow::Borrowed(bytes);
        }
        let mut bytes = bytes.to_vec();
        bytes.chunks_exact_mut(size_of::<T>()).for_each(<[u8]>::reverse);
        Cow::Owned(bytes)
    })
}

/// 32 digits: 128 bits tell any two contents apart.
pub fn hex(hasher: &blake3::Hasher) -> String {
    hasher.finalize().to_hex()[..32].to_owned()
}
