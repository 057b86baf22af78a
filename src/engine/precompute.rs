//! Visibility: from a medium to its packed field, in passes that refine.

use super::estimate::{Estimator, Work};
use super::sweep::Sweeper;
use super::{Engine, Field, Medium, Progress, telling};
use crate::error::{Error, Result};
use crate::scene::visibility::{Cells, Method};
use crate::scene::{Grid, Visibility};
use crate::stages::cells::{self, CellMap};
use crate::stages::sweep;
use std::ops::ControlFlow;

/// The part of a hierarchical field's progress that its pyramid is.
pub(super) const PYRAMID: f64 = 0.05;

/// A finished pass of [`Engine::refine`].
pub struct Pass<'a> {
    /// A valid estimate, which stays as it is while later passes are computed.
    pub field: &'a Field,
    /// Directions that it holds.
    pub directions: u32,
}

/// The method's stage.
pub(super) fn stage(settings: &Visibility) -> &'static str {
    match settings.method {
        Method::March => "march",
        Method::Hierarchical => "hierarchical",
        Method::Sweep => "sweep",
    }
}

impl Engine {
    /// Computes the visibility field.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range, [`Error::OutOfMemory`] before anything is allocated,
    /// [`Error::Cancelled`].
    pub fn precompute(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Field> {
        self.passes(medium, settings, &[settings.directions], progress, &mut |_| ControlFlow::Continue(()))
    }

    /// Computes the visibility field in passes, each of which adds as many directions as those before it: `finished` is
    /// given every pass's field and may stop there, which returns that field. Only a sweep refines; other methods make
    /// one pass.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn refine(
        &self,
        medium: &Medium,
        settings: &Visibility,
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Pass) -> ControlFlow<()>,
    ) -> Result<Field> {
        let n = settings.directions;
        // Fewer than 32 directions do not tell 16 harmonics apart.
        let mut ends: Vec<u32> = (1..=3).rev().map(|k| n >> k).filter(|&n| settings.method == Method::Sweep && n >= 32).collect();
        ends.push(n);
        self.passes(medium, settings, &ends, progress, finished)
    }

    /// The field after each of the numbers of directions `ends`, the last of them all.
    fn passes(
        &self,
        medium: &Medium,
        settings: &Visibility,
        ends: &[u32],
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Pass) -> ControlFlow<()>,
    ) -> Result<Field> {
        let map = self.cell_map(medium, settings, &[])?;
        let cost = self.cost(medium.grid(), settings, &map)?;
        // A pass's field may be kept while the next is made.
        let fields = ends.len().min(2) as u64;
        let share = self.admitted(&format!("the visibility field at 1:{}", settings.ratio), fields, &cost, |free| {
            let fits = [2, 4, 8].into_iter().filter(|&ratio| ratio > settings.ratio).find(|&ratio| {
                let coarser = Visibility { ratio, ..settings.clone() };
                let cost = self.cell_map(medium, &coarser, &[]).and_then(|map| self.cost(medium.grid(), &coarser, &map));
                cost.is_ok_and(|c| fields * c.kept + c.least() <= free)
            });
            match fits {
                Some(ratio) => format!("1:{ratio} would fit"),
                None => "no coarser ratio would fit; resample the volume or allow more memory".into(),
            }
        })?;
        let layout = self.layout(medium.grid().field_dims(settings.ratio as usize), settings, &map)?;
        let cells = map.cells();
        let work = |directions| Work { cells: &cells, directions, tile: share.tile };
        let held = (&map, &layout);
        let mut tell = telling(stage(settings), progress);
        tell(0.0)?;
        if settings.method != Method::Sweep {
            let estimator = match settings.method {
                Method::Hierarchical => Estimator::Hierarchical(self.pyramid(medium, settings, &mut |f| tell(PYRAMID * f))?),
                _ => Estimator::March,
            };
            let begun = if settings.method == Method::Hierarchical { PYRAMID } else { 0.0 };
            let mut tell = |f| tell(begun + (1.0 - begun) * f);
            let field = self.packed(medium, settings, held, &work(settings.directions), &estimator, &mut tell)?;
            let _ = finished(&Pass { field: &field, directions: settings.directions });
            return Ok(field);
        }
        let rays = sweep::rays(settings.directions, medium.grid());
        let mut sweeper = Sweeper::new(self, medium, settings, &map, share.ring)?;
        let mut from = 0;
        loop {
            let to = ends.iter().copied().find(|&n| n > from).unwrap_or(settings.directions);
            let part = |n: u32| f64::from(n) / f64::from(settings.directions);
            sweeper.pass(&rays[from as usize..to as usize], &mut |f| tell(part(from) + f * part(to - from)))?;
            let correction = match to < settings.directions {
                true => sweep::correction(&rays[..to as usize], settings.coefficients()),
                false => None,
            };
            let correction = correction.map(|c| self.device.buffer_from("correction", &c)).transpose()?;
            let estimator = Estimator::Sweep(&sweeper, correction);
            let field = self.packed(medium, settings, held, &work(to), &estimator, &mut |_| tell(part(to)))?;
            if finished(&Pass { field: &field, directions: to }).is_break() || to == settings.directions {
                return Ok(field);
            }
            from = to;
        }
    }

    /// Linear indices of the cells that a field of these settings holds, ascending; the others are zero
    /// ([`Cells`]).
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range.
    pub fn wanted_cells(&self, medium: &Medium, settings: &Visibility) -> Result<Vec<u32>> {
        Ok(self.cell_map(medium, settings, &[])?.cells())
    }

    /// Which cells a field of these settings holds; `also` are wanted besides.
    pub(super) fn cell_map(&self, medium: &Medium, settings: &Visibility, also: &[u32]) -> Result<CellMap> {
        let dims = self.field_dims(medium.grid(), settings)?;
        if settings.fit > 0 && medium.has_surface() {
            return Err(Error::Invalid {
                item: "visibility.fit",
                what: format!("asks for {} points of an isosurface", settings.fit),
                right: "fields are fitted to media; a surface takes its light from the vacuum before it: take fit 0".into(),
            });
        }
        let matter = cells::matter(medium.occupancy.filled(), medium.occupancy.dims(), medium.grid().dims(), dims);
        let buried = self.buried(medium, dims)?;
        Ok(CellMap::new(dims, &matter, &buried, also, settings.cells == Cells::All))
    }

    /// Cells of a field of these settings, which are checked.
    pub(super) fn field_dims(&self, grid: &Grid, settings: &Visibility) -> Result<[usize; 3]> {
        settings.check()?;
        let dims = grid.field_dims(settings.ratio as usize);
        let cells = dims.iter().map(|&n| n as u64).product::<u64>();
        if cells >= cells::MOST {
            return Err(Error::Invalid {
                item: "visibility.ratio",
                what: format!("1:{} makes {cells} cells", settings.ratio),
                right: format!("a field holds fewer than {}; take a coarser ratio", cells::MOST),
            });
        }
        Ok(dims)
    }
}
