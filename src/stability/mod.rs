//! Where methods are strained: small scenes given by formulas, each with what it should give, run with every estimator.
//! Each measurement is a [`Row`]: a value, the bound it keeps and why, or a failure that is known and stated as such, in a
//! band that both improvement and regress leave. `tests/stability` asserts every row; [`table`] prints them.

mod beam;
mod devices;
mod extremes;
mod fit;
mod grids;
mod lab;
mod light;
mod limits;
mod matter;
mod rate;
mod views;

use crate::engine::{Engine, Progress};
use crate::error::Result;
use lab::Lab;
use std::fmt;

/// What a measured value must satisfy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// 0 or more, and at most this.
    AtMost(f64),
    /// Between the two.
    Within(f64, f64),
    /// The method fails here, about this much: a documented weakness, not an aim.
    Fails(f64, f64),
}

impl Bound {
    /// Whether `value` keeps the bound; no NaN does.
    pub fn holds(self, value: f64) -> bool {
        match self {
            Self::AtMost(most) => (0.0..=most).contains(&value),
            Self::Within(lo, hi) | Self::Fails(lo, hi) => (lo..=hi).contains(&value),
        }
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let text = match self {
            Self::AtMost(most) => format!("<= {}", short(*most)),
            Self::Within(lo, hi) => format!("{} .. {}", short(*lo), short(*hi)),
            Self::Fails(lo, hi) => format!("fails: {} .. {}", short(*lo), short(*hi)),
        };
        f.pad(&text)
    }
}

/// One measurement.
#[derive(Clone, Debug)]
pub struct Row {
    /// The scene, [`Case::name`].
    pub case: &'static str,
    /// Estimator and its settings, or the part of the engine.
    pub method: String,
    /// What was measured, with its unit.
    pub what: String,
    /// The value.
    pub value: f64,
    /// What it must satisfy.
    pub bound: Bound,
    /// Why the bound is what it is.
    pub why: &'static str,
}

impl Row {
    /// Whether the value keeps its bound.
    pub fn holds(&self) -> bool {
        self.bound.holds(self.value)
    }

    /// The head of the columns of a row's text.
    pub fn head() -> String {
        format!("{:<22} {:<26} {:<46} {:>9}  {:<22} {}", "case", "method", "measured", "value", "bound", "why")
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mark = if self.holds() { ' ' } else { '!' };
        let (case, method, what) = (self.case, &self.method, &self.what);
        write!(f, "{case:<22} {method:<26} {what:<46} {:>9} {mark}{:<22} {}", short(self.value), self.bound, self.why)
    }
}

/// A few digits, of any magnitude.
fn short(x: f64) -> String {
    match x.abs() {
        a if a != 0.0 && !(1e-3..1e5).contains(&a) => format!("{x:.1e}"),
        a if a < 10.0 => format!("{x:.3}"),
        _ => format!("{x:.1}"),
    }
}

/// A scene and what is measured in it.
#[derive(Clone, Copy)]
pub struct Case {
    /// Short, unique.
    pub name: &'static str,
    /// The volume and its matter, and what the truth is.
    pub about: &'static str,
    run: fn(&mut Lab) -> Result<()>,
}

impl Case {
    /// Measures it.
    ///
    /// # Errors
    /// What the engine refuses; [`crate::Error::Cancelled`].
    pub fn run(&self, engine: &Engine, progress: &mut Progress) -> Result<Vec<Row>> {
        self.tampered(engine, progress, 1.0)
    }

    /// As [`Case::run`] with every estimated coefficient multiplied by `factor`: what the bounds must notice.
    ///
    /// # Errors
    /// As [`Case::run`].
    #[doc(hidden)]
    pub fn tampered(&self, engine: &Engine, progress: &mut Progress, factor: f32) -> Result<Vec<Row>> {
        let mut lab = Lab::new(self.name, engine, progress, factor);
        (self.run)(&mut lab)?;
        Ok(lab.into_rows())
    }
}

const fn case(name: &'static str, about: &'static str, run: fn(&mut Lab) -> Result<()>) -> Case {
    Case { name, about, run }
}

/// Every case.
pub const CASES: &[Case] = &[
    case("sheet", "an opaque sheet of one voxel at growing distance; truth: the rectangle that it covers", matter::sheet),
    case("checkerboard", "alternating voxels, thin: their mean; alternating opaque blocks: the dense reference", matter::checkerboard),
    case("far voxel", "one opaque voxel, 7 to 11 voxels off; truth: a dense march of other directions at each cell", matter::far_voxel),
    case("tube", "a bore of 6 voxels in opaque matter, seen from its bottom; truth: its opening's solid angle", matter::tube),
    case("half-space", "above an opaque plane; truth: the zonal coefficients of a step", matter::half_space),
    case("walls", "hollow balls under cells of four voxels, read at their matter; truth: a dense march there", fit::walls),
    case("pinhole", "one direction through a hole of 3x3 voxels in a wall; truth: the hole's own width", beam::pinhole),
    case("axis switch", "one direction turning through 45 degrees, where a sweep changes its major axis", beam::axis_switch),
    case("extinction", "1e-6 to 1e6 per voxel: finite, and more matter is never brighter", extremes::extinction),
    case("iso value", "a surface at the data's minimum, on a plateau and at its maximum", extremes::iso_value),
    case("sun", "a sun of 100,000 skies' radiance beside a ball; truth: the geometry of the ball", light::sun),
    case("turned light", "light turned against volume turned; harmonics there and back", light::turned),
    case("spacing", "the same two clouds on isotropic, 1:1:5 and oblique grids; truth: their integrals in closed form", grids::spacing),
    case("dims", "dims of 1 and primes, homogeneous; truth: exp(-sigma chord)", grids::dims),
    case("odd size", "197x233x189 at 1:8 through every stage", grids::odd_size),
    case("directions", "N from 1 to 4096 beside hard shadows: order of convergence", rate::directions),
    case("step", "steps that shrink, smooth matter: order of convergence", rate::step),
    case("coarse field", "fields of 1:8 against 1:1: brightness of the picture", rate::coarse_field),
    case("camera", "a camera inside the volume and rays along its faces; truth: chords", views::camera),
    case("long rays", "more steps than one invocation may loop on every device; truth: the unsplit formula", limits::long_rays),
    case("repeat", "the same run again: the same bits", limits::repeat),
    case("elsewhere", "the same scene by the kernels' twins on this processor, and on every other device here", devices::elsewhere),
];

/// Runs every case.
///
/// # Errors
/// As [`Case::run`].
pub fn run(engine: &Engine, progress: &mut Progress) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for case in CASES {
        rows.extend(case.run(engine, progress)?);
    }
    Ok(rows)
}

/// The rows in aligned columns, with a head; a row that breaks its bound is marked with `!`.
pub fn table(rows: &[Row]) -> String {
    let mut out = Row::head();
    for row in rows {
        out.push('\n');
        out += &row.to_string();
    }
    out
}
