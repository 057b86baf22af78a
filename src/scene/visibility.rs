//! How the visibility field is computed: plain settings.

use crate::error::{Error, Result};

/// The estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Dense ray march: the ground truth for small steps and many directions.
    March,
    /// Growing steps through the opacity pyramid (Ritschel 2007, section 3.1).
    Hierarchical,
    /// Short characteristics: transmittance swept from slice to slice, dense near the cell (see `stages::sweep`). The default:
    /// on CPU devices some thirty times as fast as the hierarchy, at less error.
    #[default]
    Sweep,
}

/// How the opacity pyramid averages two successive cells (see `stages::minify`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Mean opacity, as plain MIP mapping.
    Box,
    /// All 64 pairs of the eight cells: (mean T)².
    Product,
    /// Aligned pairs along each axis, averaged over the three axes.
    #[default]
    Axis,
    /// Mean extinction.
    Extinction,
}

/// How directions are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// One well-spread set for all voxels (spherical Fibonacci).
    #[default]
    Stratified,
    /// The paper's: M jittered patterns, each voxel picks one by a hash.
    Jittered,
}

/// Most directions of a sweep: their order takes N² work.
pub const MAX_SWEPT: u32 = 4096;

/// Most points of a cell that a field is fitted to.
pub const MOST_FITTED: u32 = 64;

/// Which cells of the field are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cells {
    /// Those that a renderer reads: within two cells of matter. The others are zero.
    #[default]
    Matter,
    /// All.
    All,
}

/// What a field is wanted for; a plan finds the settings (see [`crate::plan`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Relative L2 error over the kept coefficients that the field must not exceed.
    Tolerance(f64),
    /// A word for a tolerance and a ratio.
    Quality(Quality),
}

/// A tolerance and a ratio in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Error 0.12, field 1:8.
    Draft,
    /// Error 0.06, field 1:4.
    Normal,
    /// Error 0.03, field 1:2.
    Fine,
}

impl Wanted {
    /// The error that the field must not exceed.
    pub fn tolerance(self) -> f64 {
        match self {
            Self::Tolerance(t) => t,
            Self::Quality(Quality::Draft) => 0.12,
            Self::Quality(Quality::Normal) => 0.06,
            Self::Quality(Quality::Fine) => 0.03,
        }
    }
}

/// Settings of a visibility field.
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility {
    /// The estimator.
    pub method: Method,
    /// Voxels per field cell along each axis: 1, 2, 4 or 8.
    pub ratio: u32,
    /// Directions per cell, N.
    pub directions: u32,
    /// SH bands: 1, 2, 3 or 4, for 1, 4, 9 or 16 coefficients.
    pub bands: u32,
    /// Bits per packed coefficient: 8, 16, or 32 (float, unpacked).
    pub bits: u32,
    /// Minification filter of the pyramid (`hierarchical`).
    pub filter: Filter,
    /// Choice of directions.
    pub sampling: Sampling,
    /// Step growth per distance (`hierarchical`): step = max(1 voxel, growth·distance).
    pub growth: f32,
    /// Step length in voxels (`march`; `sweep`, at most).
    pub step: f32,
    /// Slices of field cells that a ray is marched densely before the swept transmittance is trusted (`sweep`).
    pub near: u32,
    /// Points of visible matter per cell that coefficients are fitted to (`sweep`, media), by least squares of what pictures
    /// read between cells; 0: they are what is seen from the cells' centres. See `stages::fit`.
    pub fit: u32,
    /// Which cells are computed.
    pub cells: Cells,
}

impl Default for Visibility {
    fn default() -> Self {
        Self {
            method: Method::Sweep,
            ratio: 4,
            directions: 128,
            bands: 4,
            bits: 8,
            filter: Filter::Axis,
            sampling: Sampling::Stratified,
            growth: 0.25,
            step: 1.0,
            near: 1,
            fit: 0,
            cells: Cells::Matter,
        }
    }
}

impl Visibility {
    /// Number of SH coefficients, bands².
    pub fn coefficients(&self) -> usize {
        (self.bands * self.bands) as usize
    }

    /// Checks each setting.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the first setting out of its range.
    pub fn check(&self) -> Result<()> {
        let bad = |item, what: String, right: &str| Err(Error::Invalid { item, what, right: right.into() });
        if ![1, 2, 4, 8].contains(&self.ratio) {
            return bad("visibility.ratio", format!("1:{}", self.ratio), "it must be 1, 2, 4 or 8");
        }
        if !(1..=1 << 20).contains(&self.directions) {
            return bad("visibility.directions", format!("{}", self.directions), "it must be 1 to 1048576");
        }
        if !(1..=4).contains(&self.bands) {
            return bad("visibility.bands", format!("{}", self.bands), "it must be 1 to 4");
        }
        if ![8, 16, 32].contains(&self.bits) {
            return bad("visibility.bits", format!("{}", self.bits), "it must be 8, 16 or 32");
        }
        if !(0.05..=4.0).contains(&self.growth) {
            return bad("visibility.growth", format!("{}", self.growth), "it must lie in 0.05..4");
        }
        if !(0.01..=16.0).contains(&self.step) {
            return bad("visibility.step", format!("{} voxels", self.step), "it must lie in 0.01..16");
        }
        if !(1..=8).contains(&self.near) {
            return bad("visibility.near", format!("{}", self.near), "it must be 1 to 8 slices");
        }
        if self.fit > MOST_FITTED {
            return bad("visibility.fit", format!("{} points", self.fit), &format!("it must be 0 to {MOST_FITTED} points per cell"));
        }
        if self.fit > 0 && self.method != Method::Sweep {
            return bad(
                "visibility.fit",
                format!("{} points", self.fit),
                "only visibility.method \"sweep\" sees from points; take that, or fit 0",
            );
        }
        if self.method == Method::Sweep && self.directions > MAX_SWEPT {
            let right = format!("a sweep takes at most {MAX_SWEPT}; more would not show beside its own error");
            return bad("visibility.directions", format!("{}", self.directions), &right);
        }
        if self.method == Method::Sweep && self.sampling == Sampling::Jittered {
            return bad(
                "visibility.sampling",
                "jittered".into(),
                "a sweep takes one set of directions for all cells: take stratified, or method march or hierarchical",
            );
        }
        Ok(())
    }
}
