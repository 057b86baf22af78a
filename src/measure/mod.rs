//! How wrong a field or a picture is, measured against its reference (definitions below).
//!
//! - [`field_error`], [`errors`]: relative L2 over cells and coefficients, whole and by band, with bootstrap intervals.
//! - [`Plan`], [`Report`]: the same of a computed field against the dense reference, before and after packing, within a
//!   budget of device time.
//! - [`PictureError`]: of a picture against Monte Carlo without harmonics, at fewer of its pixels.
//! - [`relative_rmse`], [`compare`]: one picture against another.
//! - [`flip`]: the perceived difference of two pictures (Andersson et al. 2020, 2021).

mod budget;
mod field;
pub mod flip;
mod frame;
mod picture;
mod probes;
pub(crate) mod reading;
mod report;

pub use budget::{Budget, Plan};
pub use field::{Errors, FieldError, errors, field_error};
pub use frame::{PictureError, Pictured};
#[cfg(feature = "chart")]
pub(crate) use frame::{covered_mean, exposed, judged};
pub use picture::{Difference, compare, relative_rmse, signed};
pub(crate) use probes::{draw, near};
pub use probes::{near_matter, probes};
pub use report::Report;

use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::scene::Visibility;
use crate::scene::visibility::{Method, Sampling};
use crate::stages::pack;

/// Directions of the reference.
pub const REFERENCE_DIRECTIONS: u32 = 4096;

/// Step of the reference, voxels.
pub const REFERENCE_STEP: f32 = 0.25;

/// The reference at some cells: `march` with [`REFERENCE_DIRECTIONS`] stratified directions and steps of
/// [`REFERENCE_STEP`] voxels.
///
/// # Errors
/// As [`Engine::estimate`].
pub fn reference(engine: &Engine, medium: &Medium, ratio: u32, cells: &[u32], progress: &mut Progress) -> Result<Vec<[f32; 16]>> {
    engine.estimate(medium, &dense(ratio, REFERENCE_DIRECTIONS), cells, progress)
}

/// The reference's settings, with another number of directions.
fn dense(ratio: u32, directions: u32) -> Visibility {
    Visibility {
        method: Method::March,
        sampling: Sampling::Stratified,
        directions,
        step: REFERENCE_STEP,
        bands: 4,
        ratio,
        ..Visibility::default()
    }
}

/// Whether settings estimate as the reference does.
fn is_reference(s: &Visibility) -> bool {
    (s.method, s.sampling, s.directions, s.step) == (Method::March, Sampling::Stratified, REFERENCE_DIRECTIONS, REFERENCE_STEP)
}

/// What `bits` of packing make of coefficients.
pub fn packed(v: &[[f32; 16]], bands: u32, bits: u32) -> Vec<[f32; 16]> {
    v.iter()
        .map(|v| {
            let mut out = pack::decode(&pack::reference(v, bands, bits, false), bits, false);
            out[(bands * bands) as usize..].fill(0.0);
            out
        })
        .collect()
}
