//! A preset as its file says it, colours as displayed; what every format is read into and written from.

use super::super::limits::{bad, quote};
use super::color::{Rgb, Space};
use super::curve;
use crate::error::{Error, Result};
use crate::scene::Transfer;
use crate::scene::transfer::{Kind, Reference};
use std::path::Path;

/// Most points of one preset, colours or opacities.
pub(super) const POINTS: usize = 1 << 16;

/// An opacity point: x, opacity, and VTK's shape of the curve to the next point (midpoint and sharpness).
pub(super) type OpacityPoint = [f64; 4];

/// Widths of a preset that two points may be apart and still be one step.
pub(super) const STEP: f64 = 1e-6;

/// A transfer function as a file holds it: display colours and opacities over scalars, each with its own points.
#[derive(Clone, Debug, PartialEq)]
pub struct Preset {
    /// The name that the file gives it, or the file's own.
    pub name: String,
    /// The scalars that a range is laid on.
    pub(super) domain: [f64; 2],
    /// Whether the domain spans the data, whatever their range.
    pub(super) relative: bool,
    pub(super) space: Space,
    /// Ascending.
    pub(super) colors: Vec<(f64, Rgb)>,
    /// Ascending.
    pub(super) opacities: Vec<OpacityPoint>,
    /// What the file says and this cannot hold.
    pub(super) lost: Vec<String>,
    /// The same of shading, which natural light replaces.
    pub(super) shading: Vec<String>,
    /// Into how many parts the program divides the volume's side, to take opacities over one of them; none: over a voxel.
    pub(super) parts: Option<u32>,
}

/// Display colour and opacity on both sides of a scalar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Key {
    pub x: f64,
    pub left: [f64; 4],
    pub right: [f64; 4],
}

impl Preset {
    /// A preset whose colours are interpolated as displayed. Without a domain its points span it.
    pub(super) fn new(name: &str, colors: Vec<(f64, Rgb)>, opacities: Vec<OpacityPoint>) -> Self {
        let hull = hull(&colors, &opacities);
        let (lost, shading) = (Vec::new(), Vec::new());
        Self { name: name.into(), domain: hull, relative: false, space: Space::Rgb, colors, opacities, lost, shading, parts: None }
    }

    /// From points of colour and opacity in one: x, red, green, blue, opacity.
    pub(super) fn of_points(name: &str, points: &[[f64; 5]]) -> Self {
        let colors = points.iter().map(|p| (p[0], [p[1], p[2], p[3]])).collect();
        Self::new(name, colors, points.iter().map(|p| [p[0], p[4], 0.5, 0.0]).collect())
    }

    /// Sorts the points and refuses what is no transfer function.
    pub(super) fn checked(mut self, path: &Path) -> Result<Self> {
        let said = |what: String, right: &str| Err(bad(path, what, right));
        let name = quote(&self.name);
        if self.colors.is_empty() || self.opacities.is_empty() {
            return said(format!("the preset '{name}' has no points"), "at least one with colour and opacity is needed");
        }
        if self.colors.len() > POINTS || self.opacities.len() > POINTS {
            let n = self.colors.len().max(self.opacities.len());
            return said(format!("the preset '{name}' has {n} points"), "at most 65536 are read");
        }
        self.colors.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.opacities.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let finite = self.colors.iter().map(|c| c.0).chain(self.opacities.iter().map(|o| o[0])).chain(self.domain).all(f64::is_finite);
        if !finite || self.domain[0] > self.domain[1] {
            return said(format!("the scalars of the preset '{name}' are not finite or descend"), "they must be finite and ascend");
        }
        // Some programs write 1.000001.
        let tidy = |v: &mut f64| *v = if (-1e-5..=1.0 + 1e-5).contains(v) { v.clamp(0.0, 1.0) } else { *v };
        self.colors.iter_mut().flat_map(|c| &mut c.1).for_each(tidy);
        self.opacities.iter_mut().flat_map(|o| &mut o[1..]).for_each(tidy);
        if let Some(p) = self.colors.iter().find(|p| p.1.iter().any(|c| !(0.0..=1.0).contains(c))) {
            return said(format!("the colour {:?} at {}", p.1, p.0), "red, green and blue must lie in 0..1");
        }
        if let Some(p) = self.opacities.iter().find(|p| p[1..].iter().any(|c| !(0.0..=1.0).contains(c))) {
            return said(format!("the opacity point {p:?}"), "opacity, midpoint and sharpness must lie in 0..1");
        }
        Ok(self)
    }

    /// What the file says of this preset and a [`Transfer`] does not hold.
    pub fn lost(&self) -> impl Iterator<Item = &str> {
        self.lost.iter().chain(&self.shading).map(String::as_str)
    }

    /// The length that the program takes opacities over: "a voxel", "1/200 of the volume's side".
    pub fn length(&self) -> String {
        self.parts.map_or_else(|| "a voxel".into(), |n| format!("1/{n} of the volume's side"))
    }

    /// What that length means here, where it is none that [`Reference`](crate::scene::transfer::Reference) has.
    pub fn length_here(&self) -> Option<String> {
        self.parts.map(|n| {
            format!(
                "over {}; here over transfer.reference, a voxel where it is not set: the same where the side has {n} voxels",
                self.length()
            )
        })
    }

    /// The scalars that the preset is about; 0 to 1 where they span the data, whatever their range.
    pub fn domain(&self) -> [f64; 2] {
        self.domain
    }

    /// Whether the domain spans the data, whatever their range.
    pub fn is_relative(&self) -> bool {
        self.relative
    }

    /// Number of colour and of opacity points.
    pub fn points(&self) -> [usize; 2] {
        [self.colors.len(), self.opacities.len()]
    }

    /// The same with its domain laid on a range.
    pub(super) fn on(&self, range: [f64; 2]) -> Self {
        let [lo, hi] = self.domain;
        let place = |x: f64| if hi > lo { range[0] + (range[1] - range[0]) * ((x - lo) / (hi - lo)) } else { range[0] };
        let mut moved = self.clone();
        moved.colors.iter_mut().for_each(|c| c.0 = place(c.0));
        moved.opacities.iter_mut().for_each(|o| o[0] = place(o[0]));
        (moved.domain, moved.relative) = (range, false);
        moved
    }

    /// The same with points at both ends of its domain, for formats that know the domain by them.
    pub(super) fn spanning(&self) -> Self {
        let mut wider = self.clone();
        let ([lo, hi], [first, last]) = (hull(&self.colors, &self.opacities), self.domain);
        if let (true, Some(c), Some(o)) = (lo > first, self.colors.first(), self.opacities.first()) {
            wider.colors.insert(0, (first, c.1));
            wider.opacities.insert(0, [first, o[1], 0.5, 0.0]);
        }
        if let (true, Some(c), Some(o)) = (hi < last, self.colors.last(), self.opacities.last()) {
            wider.colors.push((last, c.1));
            wider.opacities.push([last, o[1], 0.5, 0.0]);
        }
        wider
    }

    /// The transfer function over data of `data_range`, or laid on `range`; `path` is what errors name.
    ///
    /// # Errors
    /// [`Error::Format`] where its points are no transfer function.
    pub fn transfer(&self, path: &Path, range: Option<[f64; 2]>, data_range: [f64; 2], reference: Reference) -> Result<Transfer> {
        let placed = match range.or(self.relative.then_some(data_range)) {
            Some(range) => &self.on(range),
            None => self,
        };
        let (colors, opacities) = (curve::scene_linear(placed.space, &placed.colors), curve::opacities(&placed.opacities));
        Transfer::new(colors, opacities, Kind::Opacity, reference).map_err(|e| match e {
            Error::Invalid { item, what, right } => bad(path, format!("{item}: {what}"), right),
            other => other,
        })
    }

    /// The preset as points between which colours and opacities are straight lines, for formats that know no others.
    pub(super) fn keys(&self) -> Vec<Key> {
        let (colors, opacities) = (curve::display(self.space, &self.colors), curve::opacities(&self.opacities));
        let mut xs: Vec<f64> = colors.iter().map(|c| c.0).chain(opacities.iter().map(|o| o.0)).collect();
        xs.sort_by(f64::total_cmp);
        let width = self.domain[1] - self.domain[0];
        let mut keys: Vec<Key> = Vec::new();
        for x in xs {
            match keys.last_mut() {
                // The right side of a step, a hair beside its left.
                Some(key) if x - key.x <= 1.5 * STEP * width => key.right = [x, 0.0, 0.0, 0.0],
                _ => keys.push(Key { x, left: [x, 0.0, 0.0, 0.0], right: [x, 0.0, 0.0, 0.0] }),
            }
        }
        // Both sides were places so far.
        let opacities: Vec<(f64, [f64; 1])> = opacities.iter().map(|o| (o.0, [o.1])).collect();
        for key in &mut keys {
            let side = |x: f64, right: bool| {
                let ([r, g, b], [a]) = (at(&colors, x, right), at(&opacities, x, right));
                [r, g, b, a]
            };
            (key.left, key.right) = (side(key.left[0], false), side(key.right[0], true));
        }
        keys
    }

    /// Largest difference of the colours, and of the opacities, to another preset, each over its own domain.
    pub(super) fn difference(&self, other: &Preset) -> [f64; 2] {
        const PLACES: usize = 4096;
        let lines = |p: &Preset| {
            let opacities: Vec<_> = curve::opacities(&p.opacities).into_iter().map(|o| (o.0, [o.1])).collect();
            (curve::display(p.space, &p.colors), opacities, p.domain)
        };
        let (a, b) = (lines(self), lines(other));
        let mut worst = [0.0f64; 2];
        for i in 0..PLACES {
            // Between the entries of every table of a power of two, so that a step is seen where it is and not a hair beside.
            let s = (i as f64 + 0.37) / PLACES as f64;
            let place = |domain: [f64; 2]| domain[0] + (domain[1] - domain[0]) * s;
            let (x, y) = (place(a.2), place(b.2));
            let (c, d) = (at(&a.0, x, true), at(&b.0, y, true));
            worst[0] = (0..3).map(|i| (c[i] - d[i]).abs()).fold(worst[0], f64::max);
            worst[1] = worst[1].max((at(&a.1, x, true)[0] - at(&b.1, y, true)[0]).abs());
        }
        worst
    }
}

/// The scalars that the points span.
fn hull(colors: &[(f64, Rgb)], opacities: &[OpacityPoint]) -> [f64; 2] {
    let all = || colors.iter().map(|c| c.0).chain(opacities.iter().map(|o| o[0]));
    let hull = [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)];
    if hull[0] <= hull[1] { hull } else { [0.0, 1.0] }
}

/// The value at `x` of a line through points; of a step's two, the one on the wanted side.
fn at<const N: usize>(points: &[(f64, [f64; N])], x: f64, right: bool) -> [f64; N] {
    let after = points.partition_point(|p| if right { p.0 <= x } else { p.0 < x });
    match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
        (Some(a), _) if a.0 == x => a.1,
        (_, Some(b)) if b.0 == x => b.1,
        (Some(a), Some(b)) => {
            let s = if b.0 > a.0 { (x - a.0) / (b.0 - a.0) } else { 0.0 };
            std::array::from_fn(|i| a.1[i] + (b.1[i] - a.1[i]) * s)
        }
        (Some(only), None) | (None, Some(only)) => only.1,
        (None, None) => [0.0; N],
    }
}
