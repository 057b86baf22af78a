//! The transfer function: scalar → extinction and albedo.

use super::grid::Grid;
use crate::error::{Error, Result};

/// Largest opacity that is taken at its word; α = 1 would mean an infinite extinction. 1 − 2⁻²⁴, so that an "opaque"
/// point means σ_t·d = 16.6 over its reference length d.
pub const MAX_OPACITY: f64 = 1.0 - 1.0 / 16_777_216.0;

/// Entries of the tables that the kernels look up: σ_t and albedo sampled evenly over the scalars between which it changes, linear in
/// between.
pub const TABLE_SIZE: usize = 4096;

/// What the last number of an opacity point means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Opacity α in 0..1 over the reference length d: σ_t = −ln(1 − α)/d.
    #[default]
    Opacity,
    /// Extinction σ_t per reference length.
    Extinction,
}

/// The length that opacity or extinction is meant over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reference {
    /// One voxel ([`Grid::voxel_length`]).
    #[default]
    Voxel,
    /// One world unit.
    World,
    /// The volume's longest side.
    Side,
}

impl Reference {
    /// The length in world units.
    pub fn length(self, grid: &Grid) -> f64 {
        match self {
            Reference::Voxel => grid.voxel_length(),
            Reference::World => 1.0,
            Reference::Side => grid.longest_side(),
        }
    }
}

/// Piecewise-linear transfer function. Outside its points the first and last values hold (VTK's clamping). Opacity is
/// interpolated as opacity and converted to extinction afterwards, as VTK does.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// (scalar in the data's unit, linear RGB albedo 0..1), ascending.
    colors: Vec<(f64, [f32; 3])>,
    /// (scalar in the data's unit, opacity or extinction), ascending.
    opacities: Vec<(f64, f64)>,
    kind: Kind,
    reference: Reference,
}

/// σ_t and albedo sampled at [`TABLE_SIZE`] scalars, evenly from `lo` to `hi`, linear in between; what kernels and twins
/// look up.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Scalar of the first entry, which holds below it too.
    pub lo: f32,
    /// Scalar of the last entry, which holds above it too.
    pub hi: f32,
    /// σ_t, 1/world unit.
    pub sigma: Vec<f32>,
    /// Linear RGB albedo; the fourth number is unused.
    pub albedo: Vec<[f32; 4]>,
}

impl Transfer {
    /// A transfer function from colour points and opacity (or extinction) points; scalars must not descend. Two points
    /// at one scalar make a step.
    ///
    /// # Errors
    /// [`Error::Invalid`] for no points, descending scalars, numbers that are not finite, an albedo or opacity outside
    /// 0..1, or a negative extinction.
    pub fn new(colors: Vec<(f64, [f32; 3])>, opacities: Vec<(f64, f64)>, kind: Kind, reference: Reference) -> Result<Self> {
        let bad = |what: String, right: &str| Err(Error::Invalid { item: "transfer function", what, right: right.into() });
        if colors.is_empty() || opacities.is_empty() {
            return bad("it has no points".into(), "at least one point with colour and opacity is needed");
        }
        let scalars = |s: &mut dyn Iterator<Item = f64>| -> Option<(usize, f64)> {
            let mut last = f64::NEG_INFINITY;
            for (i, v) in s.enumerate() {
                if !v.is_finite() || v < last {
                    return Some((i, v));
                }
                last = v;
            }
            None
        };
        let unsorted = scalars(&mut colors.iter().map(|c| c.0)).or_else(|| scalars(&mut opacities.iter().map(|o| o.0)));
        if let Some((i, v)) = unsorted {
            return bad(
                format!("point {i} stands at scalar {v}, below its predecessor or not finite"),
                "points must be sorted by scalar, ascending",
            );
        }
        if let Some((v, c)) = colors.iter().find(|(_, c)| c.iter().any(|x| !(0.0..=1.0).contains(x))) {
            return bad(format!("the albedo {c:?} at scalar {v}"), "albedo must lie in 0..1 (linear RGB)");
        }
        match kind {
            Kind::Opacity => {
                if let Some((v, a)) = opacities.iter().find(|(_, a)| !(0.0..=1.0).contains(a)) {
                    return bad(
                        format!("the opacity {a} at scalar {v}"),
                        "opacity must lie in 0..1 (for extinctions set kind = \"extinction\")",
                    );
                }
            }
            Kind::Extinction => {
                if let Some((v, a)) = opacities.iter().find(|(_, a)| !(a.is_finite() && *a >= 0.0)) {
                    return bad(format!("the extinction {a} at scalar {v}"), "extinction must be finite and not negative");
                }
            }
        }
        Ok(Self { colors, opacities, kind, reference })
    }

    /// From combined points [scalar, r, g, b, opacity or extinction], as a scene writes them.
    ///
    /// # Errors
    /// As [`Transfer::new`].
    pub fn from_points(points: &[[f64; 5]], kind: Kind, reference: Reference) -> Result<Self> {
        Self::new(
            points.iter().map(|p| (p[0], [p[1] as f32, p[2] as f32, p[3] as f32])).collect(),
            points.iter().map(|p| (p[0], p[4])).collect(),
            kind,
            reference,
        )
    }

    /// The function as combined points, of which [`Transfer::from_points`] makes it again: those it was made of where colours and
    /// opacities stand at the same scalars, else one where either has a point, two at steps.
    pub fn points(&self) -> Vec<[f64; 5]> {
        let row = |s: f64, c: [f32; 3], o: f64| [s, c[0].into(), c[1].into(), c[2].into(), o];
        if self.colors.iter().map(|c| c.0).eq(self.opacities.iter().map(|o| o.0)) {
            return self.colors.iter().zip(&self.opacities).map(|(c, o)| row(c.0, c.1, o.1)).collect();
        }
        let at = |s, above| (limit(&self.colors, s, above), limit(&self.opacities, s, above));
        stepped(&[self], at).into_iter().map(|(s, (c, o))| row(s, c, o)).collect()
    }

    /// What the opacity points mean.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The length that they are meant over.
    pub fn reference(&self) -> Reference {
        self.reference
    }

    /// The colour points.
    pub fn colors(&self) -> &[(f64, [f32; 3])] {
        &self.colors
    }

    /// The opacity or extinction points.
    pub fn opacities(&self) -> &[(f64, f64)] {
        &self.opacities
    }

    /// Linear RGB albedo at a scalar.
    pub fn albedo(&self, scalar: f64) -> [f32; 3] {
        let (a, b, t) = segment(&self.colors, scalar);
        std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t as f32)
    }

    /// σ_t at a scalar, 1/world unit.
    pub fn sigma(&self, scalar: f64, grid: &Grid) -> f64 {
        let (a, b, t) = segment(&self.opacities, scalar);
        let value = a + (b - a) * t;
        let per_reference = match self.kind {
            Kind::Opacity => -(1.0 - value.min(MAX_OPACITY)).ln(),
            Kind::Extinction => value,
        };
        per_reference / self.reference.length(grid)
    }

    /// The tables for data of `range`: over that part of the range in which the function changes, since its ends hold
    /// outside. A stray value far off the others does not cost resolution.
    pub fn table(&self, range: [f32; 2], grid: &Grid) -> Table {
        let [lo, hi] = table_interval(self.varying(), range);
        let at = |i: usize| lo + (hi - lo) * i as f64 / (TABLE_SIZE - 1) as f64;
        Table {
            lo: lo as f32,
            hi: hi as f32,
            sigma: (0..TABLE_SIZE).map(|i| self.sigma(at(i), grid) as f32).collect(),
            albedo: (0..TABLE_SIZE)
                .map(|i| {
                    let [r, g, b] = self.albedo(at(i));
                    [r, g, b, 0.0]
                })
                .collect(),
        }
    }
}

impl Transfer {
    /// Whether σ_t is 0 for all values of data within `range`.
    pub fn is_vacuum(&self, range: [f32; 2]) -> bool {
        let [lo, hi] = range.map(f64::from);
        let clear = |scalar: f64| {
            let (a, b, t) = segment(&self.opacities, scalar);
            a + (b - a) * t == 0.0
        };
        // Linear in between: the ends and the points inside decide.
        clear(lo) && clear(hi) && self.opacities.iter().all(|&(s, o)| s < lo || s > hi || o == 0.0)
    }

    /// The scalars between which colour or opacity change; first and last point where nothing does.
    fn varying(&self) -> [f64; 2] {
        fn hull<T: PartialEq>(points: &[(f64, T)]) -> Option<[f64; 2]> {
            let first = points.windows(2).find(|w| w[0].1 != w[1].1)?[0].0;
            let last = points.windows(2).rev().find(|w| w[0].1 != w[1].1)?[1].0;
            Some([first, last])
        }
        match (hull(&self.colors), hull(&self.opacities)) {
            (Some(a), Some(b)) => [a[0].min(b[0]), a[1].max(b[1])],
            (Some(a), None) | (None, Some(a)) => a,
            (None, None) => [self.opacities[0].0; 2],
        }
    }
}

/// The interval that a table covers: `varying` within the data, one entry wider on both sides so that a step at an end
/// stands inside the table.
fn table_interval(varying: [f64; 2], range: [f32; 2]) -> [f64; 2] {
    let (data_lo, data_hi) = (f64::from(range[0]), f64::from(range[1]));
    let lo = varying[0].clamp(data_lo, data_hi);
    let hi = varying[1].clamp(data_lo, data_hi).max(lo);
    // A bare step has no width of its own: single precision's resolution there.
    let least = 1e-5 * lo.abs().max(hi.abs()).max(1e-15);
    let margin = ((hi - lo) / (TABLE_SIZE - 3) as f64).max(least);
    [lo - margin, hi + margin]
}

impl Table {
    /// The tables of an opaque surface: `sigma` (1/world unit) where the data is at least `iso`, vacuum below. The step
    /// takes a hundred-thousandth of `iso`, whatever the data's range.
    pub fn surface(iso: f64, sigma: f64, albedo: [f32; 3]) -> Self {
        let [lo, hi] = table_interval([iso; 2], [iso as f32; 2]);
        let [r, g, b] = albedo;
        Self {
            lo: lo as f32,
            hi: hi as f32,
            // The kernels' table coordinate is off by tens of entries in single precision: the step stands that far below
            // iso, so that data at iso itself is always inside.
            sigma: (0..TABLE_SIZE).map(|i| if i < TABLE_SIZE / 2 - 128 { 0.0 } else { sigma as f32 }).collect(),
            albedo: vec![[r, g, b, 0.0]; TABLE_SIZE],
        }
    }
}

/// Colour (or albedo) and opacity (or extinction).
pub(super) type Both = ([f32; 3], f64);

/// `at(scalar, from above)` wherever one of `functions` has a point: two points where it steps.
pub(super) fn stepped(functions: &[&Transfer], at: impl Fn(f64, bool) -> Both) -> Vec<(f64, Both)> {
    let of = |t: &&Transfer| t.colors.iter().map(|c| c.0).chain(t.opacities.iter().map(|o| o.0)).collect::<Vec<_>>();
    let mut scalars: Vec<f64> = functions.iter().flat_map(of).collect();
    scalars.sort_by(f64::total_cmp);
    scalars.dedup();
    let mut out = Vec::with_capacity(2 * scalars.len());
    for s in scalars {
        let [below, above] = [false, true].map(|above| at(s, above));
        out.push((s, below));
        if above != below {
            out.push((s, above));
        }
    }
    out
}

/// The value of a piecewise-linear function at `s`, coming from below or from above.
pub(super) fn limit<T: Copy + Between>(points: &[(f64, T)], s: f64, above: bool) -> T {
    let after = if above { points.partition_point(|p| p.0 <= s) } else { points.partition_point(|p| p.0 < s) };
    match (points.get(after.wrapping_sub(1)), points.get(after)) {
        (Some(a), None) => a.1,
        (None, Some(b)) => b.1,
        (Some(a), Some(_)) if above && a.0 == s => a.1,
        (Some(_), Some(b)) if !above && b.0 == s => b.1,
        (Some(a), Some(b)) => a.1.between(b.1, (s - a.0) / (b.0 - a.0)),
        (None, None) => points[0].1,
    }
}

pub(super) trait Between {
    fn between(self, other: Self, t: f64) -> Self;
}

impl Between for f64 {
    fn between(self, other: Self, t: f64) -> Self {
        self + (other - self) * t
    }
}

impl Between for [f32; 3] {
    fn between(self, other: Self, t: f64) -> Self {
        std::array::from_fn(|c| self[c] + (other[c] - self[c]) * t as f32)
    }
}

/// The two values around `scalar` and the weight of the second; at a step the later point holds.
fn segment<T: Copy>(points: &[(f64, T)], scalar: f64) -> (T, T, f64) {
    let after = points.partition_point(|p| p.0 <= scalar);
    if after == 0 {
        return (points[0].1, points[0].1, 0.0);
    }
    if after == points.len() {
        return (points[after - 1].1, points[after - 1].1, 0.0);
    }
    let (a, b) = (points[after - 1], points[after]);
    (a.1, b.1, (scalar - a.0) / (b.0 - a.0))
}
