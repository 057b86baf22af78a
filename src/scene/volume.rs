//! A scalar volume in host memory.

use super::grid::Grid;
use crate::error::{Error, Result};

/// Samples as stored, x fastest, then y, then z. Readers bring every file type to one of these: 8- and 16-bit integers
/// stay exact, everything else becomes `f32`.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 8-bit unsigned.
    U8(Vec<u8>),
    /// 16-bit unsigned.
    U16(Vec<u16>),
    /// 16-bit signed (8-bit signed is widened to it).
    I16(Vec<i16>),
    /// 32-bit float, finite.
    F32(Vec<f32>),
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Samples::U8(s) => s.len(),
            Samples::U16(s) => s.len(),
            Samples::I16(s) => s.len(),
            Samples::F32(s) => s.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample `i` as stored (before slope and intercept).
    pub fn get(&self, i: usize) -> f32 {
        match self {
            Samples::U8(s) => f32::from(s[i]),
            Samples::U16(s) => f32::from(s[i]),
            Samples::I16(s) => f32::from(s[i]),
            Samples::F32(s) => s[i],
        }
    }

    /// "uint8", "uint16", "int16" or "float32".
    pub fn type_name(&self) -> &'static str {
        match self {
            Samples::U8(_) => "uint8",
            Samples::U16(_) => "uint16",
            Samples::I16(_) => "int16",
            Samples::F32(_) => "float32",
        }
    }
}

/// A scalar volume: grid, samples, and the linear map from stored sample to the data's own unit
/// (value = `slope`·sample + `intercept`). Its invariants (sample count, finite values) hold from construction on.
#[derive(Clone, Debug)]
pub struct Volume {
    grid: Grid,
    samples: Samples,
    slope: f32,
    intercept: f32,
    range: [f32; 2],
    stored: [f32; 2],
}

impl Volume {
    /// A volume of `grid.voxels()` samples.
    ///
    /// # Errors
    /// [`Error::Invalid`] when the number of samples is not that of the grid, when a sample is NaN or infinite, or when
    /// slope or intercept are not finite or the slope is 0.
    pub fn new(grid: Grid, samples: Samples, slope: f32, intercept: f32) -> Result<Self> {
        if samples.len() as u64 != grid.voxels() {
            let d = grid.dims();
            return Err(Error::Invalid {
                item: "volume samples",
                what: format!("{} samples for {}x{}x{} voxels", samples.len(), d[0], d[1], d[2]),
                right: format!("{} are needed", grid.voxels()),
            });
        }
        if !slope.is_finite() || !intercept.is_finite() || slope == 0.0 {
            return Err(Error::Invalid {
                item: "volume slope and intercept",
                what: format!("slope {slope}, intercept {intercept}"),
                right: "both must be finite and the slope not 0".into(),
            });
        }
        if let Samples::F32(s) = &samples
            && let Some(i) = s.iter().position(|v| !v.is_finite())
        {
            let d = grid.dims();
            return Err(Error::Invalid {
                item: "volume samples",
                what: format!("sample ({}, {}, {}) is {}", i % d[0], i / d[0] % d[1], i / d[0] / d[1], s[i]),
                right: "all must be finite (the command accepts them with --nan-as VALUE)".into(),
            });
        }
        let (lo, hi) = match &samples {
            Samples::U8(s) => s.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(f32::from(v)), h.max(f32::from(v)))),
            Samples::U16(s) => s.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(f32::from(v)), h.max(f32::from(v)))),
            Samples::I16(s) => s.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(f32::from(v)), h.max(f32::from(v)))),
            Samples::F32(s) => s.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v))),
        };
        let (a, b) = (slope * lo + intercept, slope * hi + intercept);
        Ok(Self { grid, samples, slope, intercept, range: [a.min(b), a.max(b)], stored: [lo, hi] })
    }

    /// A volume whose values are given by a formula of the voxel centre (voxel coordinates).
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn from_fn(grid: Grid, f: impl Fn([f64; 3]) -> f32) -> Result<Self> {
        let [nx, ny, nz] = grid.dims();
        let mut samples = Vec::with_capacity(nx * ny * nz);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    samples.push(f([x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5]));
                }
            }
        }
        Self::new(grid, Samples::F32(samples), 1.0, 0.0)
    }

    /// Dims and place in the world.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The stored samples.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// (slope, intercept) of value = slope·sample + intercept.
    pub fn rescale(&self) -> (f32, f32) {
        (self.slope, self.intercept)
    }

    /// Smallest and largest value, in the data's unit.
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Smallest and largest sample as stored.
    pub fn stored_range(&self) -> [f32; 2] {
        self.stored
    }

    /// Value of the voxel with linear index `i` (x fastest), in the data's unit.
    pub fn value(&self, i: usize) -> f32 {
        self.slope * self.samples.get(i) + self.intercept
    }
}
