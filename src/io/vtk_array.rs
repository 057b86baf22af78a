//! The arrays of a VTK image, legacy or XML, and its grid.

use super::ReadOptions;
use super::choose;
use super::limits::{bad, grid, quote};
use super::samples::SampleType;
use crate::error::Result;
use crate::scene::Grid;
use glam::{DAffine3, DMat3, DVec3};
use std::path::Path;

/// Some values per point or per cell of an image.
pub(super) struct Array {
    pub name: String,
    pub kind: SampleType,
    pub components: usize,
    /// Of cells, not of points.
    pub cells: bool,
}

impl Array {
    /// Labels of its components; those of cells say so.
    fn labels(&self) -> Vec<String> {
        let name = if self.cells { format!("cells/{}", self.name) } else { self.name.clone() };
        choose::labels(&name, self.components).collect()
    }
}

/// The array and component that is wanted among all; `default` is an array that stands out.
pub(super) fn choose_array(path: &Path, arrays: &[&Array], default: Option<usize>, options: &ReadOptions) -> Result<(usize, usize)> {
    let all: Vec<(usize, usize)> = arrays.iter().enumerate().flat_map(|(a, x)| (0..x.components).map(move |c| (a, c))).collect();
    if all.is_empty() {
        return Err(bad(path, "it has no array of numbers at points or cells", "POINT_DATA with scalars is needed"));
    }
    let labels: Vec<String> = arrays.iter().flat_map(|a| a.labels()).collect();
    let default = default.filter(|&d| arrays[d].components == 1).and_then(|d| all.iter().position(|&(a, _)| a == d));
    let what = match arrays {
        [only] => format!("its array '{}' has {} components", quote(&only.name), only.components),
        _ => format!("it holds {} arrays", arrays.len()),
    };
    Ok(all[choose::component(path, &what, all.len(), &labels, default, options)?])
}

/// The grid of an image's points or cells: `points` along each axis, `axes` their directions and spacings, `first` the
/// place of the first point.
pub(super) fn image_grid(path: &Path, points: [usize; 3], axes: DMat3, first: DVec3, cells: bool) -> Result<Grid> {
    let dims = if cells { points.map(|n| (n - n.min(1)).max(1)) } else { points };
    let corner = if cells { first } else { first - axes * DVec3::splat(0.5) };
    grid(path, dims, DAffine3 { matrix3: axes, translation: corner })
}
