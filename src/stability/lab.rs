//! What the cases share: scenes by formula, the estimators under test, truths by plain integration on the host.

use super::{Bound, Row};
use crate::engine::{Engine, Medium, Progress};
use crate::error::Result;
use crate::measure::field_error;
use crate::scene::grid::glam::DVec3;
use crate::scene::transfer::{Kind, Reference};
use crate::scene::visibility::{Filter, Method};
use crate::scene::{Grid, Matter, Shading, Surface, Transfer, Visibility, Volume, sh};
use crate::stages::directions::fibonacci;
use std::f64::consts::PI;

/// v₀₀ of an open sky, 2√π.
pub(super) const OPEN: f64 = 3.544_907_701_811_032;

/// Directions of a truth that is integrated on the host.
const TRUTH_DIRECTIONS: u32 = 100_000;

/// An engine at work on one case, and the rows so far.
pub struct Lab<'a> {
    pub(super) engine: &'a Engine,
    pub(super) progress: &'a mut Progress<'a>,
    case: &'static str,
    rows: Vec<Row>,
    /// Worst distance of a v₀₀ from [0, 2√π]; infinite for a coefficient that is not finite.
    outside: Option<f64>,
    /// What every estimated coefficient is multiplied by: 1, but when the bounds themselves are tested.
    tamper: f32,
}

impl<'a> Lab<'a> {
    pub(super) fn new(case: &'static str, engine: &'a Engine, progress: &'a mut Progress<'a>, tamper: f32) -> Self {
        Self { engine, progress, case, rows: Vec::new(), outside: None, tamper }
    }

    pub(super) fn medium(&self, volume: &Volume, matter: &Matter) -> Result<Medium> {
        self.engine.classify(&self.engine.upload(volume)?, matter)
    }

    /// Coefficients of some cells; whatever is estimated here must stay within an open sky.
    pub(super) fn estimate(&mut self, medium: &Medium, settings: &Visibility, cells: &[u32]) -> Result<Vec<[f32; 16]>> {
        let mut v = self.engine.estimate(medium, settings, cells, self.progress)?;
        v.iter_mut().flatten().for_each(|c| *c *= self.tamper);
        let mut outside = self.outside.unwrap_or(0.0);
        for v in &v {
            let v00 = f64::from(v[0]);
            outside = outside.max(-v00).max(v00 - OPEN);
            if v.iter().any(|c| !c.is_finite()) {
                outside = f64::INFINITY;
            }
        }
        self.outside = Some(outside);
        Ok(v)
    }

    pub(super) fn row(&mut self, method: impl Into<String>, what: impl Into<String>, value: f64, bound: Bound, why: &'static str) {
        self.rows.push(Row { case: self.case, method: method.into(), what: what.into(), value, bound, why });
    }

    /// A row whose bound depends on the method.
    pub(super) fn hold(&mut self, m: &Tested, what: impl Into<String>, value: f64, expected: &Expected) {
        let (bound, why) = expected.of(m);
        self.row(&m.name, what, value, bound, why);
    }

    /// What estimated coefficients are multiplied by.
    pub(super) fn tamper(&self) -> f32 {
        self.tamper
    }

    pub(super) fn into_rows(mut self) -> Vec<Row> {
        if let Some(outside) = self.outside {
            self.row(
                "all",
                "finite; v00 outside 0..2 sqrt(pi), at most",
                outside,
                Bound::AtMost(1e-5),
                "V lies in 0..1; sums of single precision",
            );
        }
        self.rows
    }
}

/// An estimator under test.
pub(super) struct Tested {
    pub(super) name: String,
    pub(super) settings: Visibility,
}

impl Tested {
    /// Whether it is this method.
    pub(super) fn is(&self, method: Method) -> bool {
        self.settings.method == method
    }

    /// Whether it is the hierarchy with this filter.
    pub(super) fn filters(&self, filter: Filter) -> bool {
        self.is(Method::Hierarchical) && self.settings.filter == filter
    }
}

/// Field settings without packing, 1:`ratio`.
pub(super) fn settings(method: Method, ratio: u32, directions: u32) -> Visibility {
    Visibility { method, ratio, directions, bits: 32, step: 0.5, ..Visibility::default() }
}

/// March, the hierarchy with each filter, and the sweep with 1, 2 and 4 slices marched.
pub(super) fn methods(ratio: u32, directions: u32) -> Vec<Tested> {
    let base = |method| settings(method, ratio, directions);
    let mut all = vec![Tested { name: "march".into(), settings: base(Method::March) }];
    for (filter, name) in [(Filter::Box, "box"), (Filter::Product, "product"), (Filter::Axis, "axis"), (Filter::Extinction, "extinction")] {
        all.push(Tested { name: format!("hierarchical {name}"), settings: Visibility { filter, ..base(Method::Hierarchical) } });
    }
    all.extend(sweeps(ratio, directions));
    all
}

/// The sweep with 1, 2 and 4 slices marched.
pub(super) fn sweeps(ratio: u32, directions: u32) -> Vec<Tested> {
    [1, 2, 4]
        .map(|near| Tested {
            name: format!("sweep near {near}"),
            settings: Visibility { near, ..settings(Method::Sweep, ratio, directions) },
        })
        .into()
}

/// One of each method: march, hierarchical as by default, sweep with one slice marched.
pub(super) fn three(ratio: u32, directions: u32) -> Vec<Tested> {
    methods(ratio, directions)
        .into_iter()
        .filter(|m| m.is(Method::March) || m.filters(Filter::Axis) || m.name.ends_with("near 1"))
        .collect()
}

/// Unit voxels.
pub(super) fn cubes(dims: [usize; 3]) -> Result<Grid> {
    Grid::axis_aligned(dims, [1.0; 3])
}

/// Opaque where D ≥ ½: faces of axis-aligned blocks of voxels of 1 lie exactly between the voxels.
pub(super) fn opaque() -> Result<Matter> {
    Ok(Matter { surface: Some(Surface { iso: 0.5, shading: Shading::Isotropic, albedo: Some([1.0; 3]) }), ..linear(0.0)? })
}

/// A volume of 1 where `inside` holds at the voxel's centre, else 0.
pub(super) fn solid(grid: Grid, inside: impl Fn([f64; 3]) -> bool) -> Result<Volume> {
    Volume::from_fn(grid, |p| f32::from(u8::from(inside(p))))
}

/// σ_t = `top`·D per world unit for D in 0..1, albedo 1.
pub(super) fn linear(top: f64) -> Result<Matter> {
    let points = [[0.0, 1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, 1.0, top]];
    Ok(Matter { transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World)?, surface: None })
}

/// The same σ_t per world unit everywhere, albedo 1.
pub(super) fn homogeneous(sigma: f64) -> Result<Matter> {
    Ok(Matter { transfer: Transfer::from_points(&[[0.0, 1.0, 1.0, 1.0, sigma]], Kind::Extinction, Reference::World)?, surface: None })
}

/// Linear index of a cell.
pub(super) fn cell(dims: [usize; 3], at: [usize; 3]) -> u32 {
    (at[0] + dims[0] * (at[1] + dims[1] * at[2])) as u32
}

/// All cells.
pub(super) fn every(dims: [usize; 3]) -> Vec<u32> {
    (0..dims.iter().product::<usize>() as u32).collect()
}

/// Centre of a cell, voxel coordinates.
pub(super) fn centre(grid: &Grid, dims: [usize; 3], cell: u32) -> DVec3 {
    DVec3::from(crate::stages::twin::cell_centre(grid, dims, cell).map(f64::from))
}

/// ∫ V Y_lm dω of a visibility given by formula, over [`TRUTH_DIRECTIONS`]: 2e-4 of a hard shadow.
pub(super) fn truth(visibility: impl Fn(DVec3) -> f64) -> [f32; 16] {
    project(&fibonacci(TRUTH_DIRECTIONS), visibility)
}

/// (4π/N) Σ V Y_lm.
pub(super) fn project(directions: &[DVec3], visibility: impl Fn(DVec3) -> f64) -> [f32; 16] {
    let mut sum = [0.0; 16];
    for &w in directions {
        let v = visibility(w);
        if v != 0.0 {
            for (s, y) in sum.iter_mut().zip(sh::basis(w)) {
                *s += v * y;
            }
        }
    }
    sum.map(|s| (s * 4.0 * PI / directions.len() as f64) as f32)
}

/// Relative L2 error over cells and coefficients; infinite where either holds a number that is not finite.
pub(super) fn error(v: &[[f32; 16]], truth: &[[f32; 16]]) -> f64 {
    let finite = v.iter().chain(truth).flatten().all(|c| c.is_finite());
    if finite { field_error(v, truth).relative_l2 } else { f64::INFINITY }
}

/// Fraction of the sky that is seen, from v₀₀.
pub(super) fn seen(v: &[f32; 16]) -> f64 {
    f64::from(v[0]) / OPEN
}

/// Distance along w (world = voxel coordinates here) to where a ray from x inside leaves the box 0..n.
pub(super) fn exit(x: DVec3, w: DVec3, n: DVec3) -> f64 {
    (0..3).filter(|&a| w[a] != 0.0).map(|a| if w[a] > 0.0 { (n[a] - x[a]) / w[a] } else { -x[a] / w[a] }).fold(f64::INFINITY, f64::min)
}

/// Slope of log(error) over log(n), by least squares: minus the order of convergence.
pub(super) fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|(a, b)| (a.ln(), b.ln())).unzip();
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum();
    covariance / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

/// What each method is held to in a case, and why.
#[derive(Clone, Copy)]
pub(super) struct Expected {
    /// Dense march.
    pub(super) march: (Bound, &'static str),
    /// The hierarchy with box, product, axis, extinction.
    pub(super) filters: [Bound; 4],
    /// Why these.
    pub(super) hierarchical: &'static str,
    /// The sweep: upper bounds.
    pub(super) sweep: (Bound, &'static str),
}

impl Expected {
    /// The bound of a method and its reason.
    pub(super) fn of(&self, m: &Tested) -> (Bound, &'static str) {
        let filter = |filter| self.filters[filter as usize];
        match m.settings.method {
            Method::March => self.march,
            Method::Hierarchical => (filter(m.settings.filter), self.hierarchical),
            Method::Sweep => self.sweep,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_helpers_give_what_theory_says() {
        // An open sky, and half of one.
        let open = truth(|_| 1.0);
        assert!((f64::from(open[0]) - OPEN).abs() < 1e-5 && open[1..].iter().all(|c| c.abs() < 1e-3));
        let half = truth(|w| f64::from(u8::from(w.z > 0.0)));
        for l in 0..4 {
            assert!((f64::from(half[sh::index(l, 0)]) - sh::zonal_half_space(l)).abs() < 1e-3);
        }
        assert_eq!(exit(DVec3::splat(1.0), DVec3::X, DVec3::splat(4.0)), 3.0);
        assert_eq!(exit(DVec3::splat(1.0), DVec3::NEG_Z, DVec3::splat(4.0)), 1.0);
        let points: Vec<(f64, f64)> = (4..12).map(|k| (f64::from(1 << k), 3.0 * f64::from(1 << k).powf(-0.75))).collect();
        assert!((slope(&points) + 0.75).abs() < 1e-12);
        // A number that is none is no small error.
        assert_eq!(error(&[[f32::NAN; 16]], &[open]), f64::INFINITY);
        assert_eq!(error(&[open], &[[f32::NAN; 16]]), f64::INFINITY);
    }
}
