//! The measured error of a computed field: before packing and after it, whole and by band, within a budget of time. A field
//! holds what is seen from its cells' centres and is measured there; one that is fitted to what pictures read between cells
//! ([`crate::scene::Visibility::fit`]) is measured as they read it: at voxels of matter, trilinearly, each by the opacity that is seen.

use super::budget::Plan;
use super::{Errors, REFERENCE_DIRECTIONS, REFERENCE_STEP, errors, is_reference, reading, reference};
use crate::engine::{Engine, Field, Medium, Progress, Span};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// The measured error of a field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Cells that were measured; of a fitted field voxels of matter.
    pub probes: usize,
    /// Whether the field is fitted: `after` is its error as pictures read it, at voxels of matter.
    #[serde(default)]
    pub fitted: bool,
    /// Whether the field is computed as its reference is: the reference's own error is then not in the figures.
    #[serde(default)]
    pub as_reference: bool,
    /// The error as pictures read the field, over 16 coefficients: at voxels of matter, trilinearly, each by its opacity and
    /// the share of the sky that it sees. Of a medium.
    #[serde(default)]
    pub read: Option<super::FieldError>,
    /// Directions of the reference.
    pub directions: u32,
    /// Step of the reference, voxels.
    pub step: f32,
    /// Bands that the field keeps.
    pub bands: u32,
    /// Bits of its coefficients.
    pub bits: u32,
    /// The estimator's own error; `None` where it was not measured ([`Plan::before`]).
    pub before: Option<Errors>,
    /// The error of the field as the renderers see it.
    pub after: Errors,
    /// Seconds of device time that measuring took.
    pub seconds: f64,
}

impl Report {
    /// The keys of [`Report::meta`]: one line for people, one object for programs.
    pub const KEYS: [&str; 2] = ["error", "error_json"];

    /// Measures `field` at the plan's cells or voxels. `kept` is what [`Engine::read_field`] gave: the field as the renderers
    /// see it. Takes the engine's timings.
    ///
    /// # Errors
    /// [`Error::Invalid`] where `kept` is not of this field; otherwise as [`Engine::estimate`].
    pub fn measure(engine: &Engine, medium: &Medium, field: &Field, kept: &[f32], plan: &Plan, progress: &mut Progress) -> Result<Self> {
        let settings = field.settings();
        let (coefficients, count) = (settings.coefficients(), field.dims().iter().product::<usize>());
        let n = medium.grid().dims();
        let outside = |of: &[u32], most: usize| of.last().is_some_and(|&c| c as usize >= most);
        if kept.len() != coefficients * count || outside(&plan.cells, count) || outside(&plan.voxels, n.iter().product()) {
            return Err(Error::Invalid {
                item: "measured field",
                what: format!("{} numbers, and cells up to {}", kept.len(), plan.cells.last().copied().unwrap_or(0)),
                right: format!("{coefficients} coefficients of {count} cells are needed, and a plan for them"),
            });
        }
        let start = Instant::now();
        engine.take_timings();
        let of = |cell: u32| of_cell(kept, coefficients, cell);
        let mut truth = reference(engine, medium, 1, &plan.voxels, &mut |stage, f| progress(stage, 0.2 * f))?;
        let mut after: Vec<_> = plan.voxels.iter().map(|&voxel| reading::read(voxel, n, field.dims(), of)).collect();
        for ((opacity, truth), read) in plan.opacities.iter().zip(&mut truth).zip(&mut after) {
            let root = (opacity * truth[0].max(0.0)).sqrt();
            *truth = truth.map(|c| root * c);
            *read = read.map(|c| root * c);
        }
        let read = (!plan.voxels.is_empty()).then(|| errors(&after, &truth, settings.bands).all);
        let fitted = settings.fit > 0;
        if !fitted {
            truth = reference(engine, medium, settings.ratio, &plan.cells, &mut |stage, f| progress(stage, 0.2 + 0.7 * f))?;
            after = plan.cells.iter().map(|&cell| of(cell)).collect();
        }
        let before = match (settings.bits, plan.before) {
            (32, _) => Some(after.clone()),
            (_, true) => Some(engine.estimate(medium, settings, &plan.cells, &mut |stage, f| progress(stage, 0.9 + 0.1 * f))?),
            (_, false) => None,
        };
        Ok(Self {
            probes: truth.len(),
            fitted,
            as_reference: is_reference(settings),
            read,
            directions: REFERENCE_DIRECTIONS,
            step: REFERENCE_STEP,
            bands: settings.bands,
            bits: settings.bits,
            before: before.map(|v| errors(&v, &truth, settings.bands)),
            after: errors(&after, &truth, settings.bands),
            seconds: Span::seconds(&engine.take_timings(), start),
        })
    }

    /// The report as pairs for a file's header; see [`Report::KEYS`].
    pub fn meta(&self) -> Vec<(String, String)> {
        let json = serde_json::to_string(self).unwrap_or_default();
        vec![(Self::KEYS[0].into(), self.sentence()), (Self::KEYS[1].into(), json)]
    }

    /// The report in a file's header, if there is one.
    pub fn from_meta(meta: &[(String, String)]) -> Option<Self> {
        let (_, json) = meta.iter().find(|(key, _)| key == Self::KEYS[1])?;
        serde_json::from_str(json).ok()
    }

    /// One line: both errors over 16 coefficients with their intervals, and what they were measured with.
    pub fn sentence(&self) -> String {
        if self.probes == 0 {
            return "not measured: no cell lies near matter".into();
        }
        let figure = |e: &Errors| format!("{:.4} [{:.4}, {:.4}]", e.all.relative_l2, e.all.interval[0], e.all.interval[1]);
        let before = self.before.as_ref().map_or_else(|| "not measured".into(), figure);
        let between = match self.read.filter(|_| !self.fitted) {
            Some(e) => format!("; {:.4} as pictures read it, at voxels of matter between the cells", e.relative_l2),
            None => String::new(),
        };
        format!(
            "{before} before packing, {} after {} bits; relative L2 over 16 coefficients with its 95 % interval, {} {} against {} directions \
             in steps of {} voxel{between}{}",
            figure(&self.after),
            self.bits,
            self.probes,
            self.of(),
            self.directions,
            self.step,
            self.note().map_or_else(String::new, |note| format!("; {note}"))
        )
    }

    /// What the figures do not tell, if there is something.
    pub fn note(&self) -> Option<&'static str> {
        self.as_reference.then_some("the field is computed as its reference is, whose own error is not in it")
    }

    /// Where it was measured.
    pub fn of(&self) -> &'static str {
        if self.fitted { "voxels of matter, as pictures read them," } else { "probes near matter" }
    }

    /// A small table: a row per band, one over what is kept where that is less, one over all.
    pub fn table(&self) -> Vec<String> {
        if self.probes == 0 {
            return Vec::new();
        }
        let after = if self.bits == 32 { "after (32-bit float)".into() } else { format!("after ({} bits)", self.bits) };
        let mut lines = vec![format!("  {:<16} {:<25} {after}", "relative L2", "before packing")];
        let mut row = |name: String, of: &dyn Fn(&Errors) -> super::FieldError| {
            let cell = |e: Option<&Errors>| match e.map(of) {
                Some(e) => format!("{:.4} [{:.4}, {:.4}]", e.relative_l2, e.interval[0], e.interval[1]),
                None => "not measured".into(),
            };
            lines.push(format!("  {name:<16} {:<25} {}", cell(self.before.as_ref()), cell(Some(&self.after))));
        };
        for l in 0..4 {
            let kept = (l as u32) < self.bands;
            row(format!("band {l}{}", if kept { "" } else { " (not kept)" }), &|e| e.bands[l]);
        }
        if self.bands < 4 {
            row(format!("{} coefficients", self.bands * self.bands), &|e| e.kept);
        }
        row("16 coefficients".into(), &|e| e.all);
        if let Some(e) = self.read.filter(|_| !self.fitted) {
            let figure = format!("{:.4} [{:.4}, {:.4}]", e.relative_l2, e.interval[0], e.interval[1]);
            lines.push(format!("  {:<16} {:<25} {figure}", "as pictures read", "between cells:"));
        }
        lines
    }
}

/// The coefficients of a cell, 0 where the field keeps none.
fn of_cell(kept: &[f32], coefficients: usize, cell: u32) -> [f32; 16] {
    let first = cell as usize * coefficients;
    std::array::from_fn(|i| if i < coefficients { kept[first + i] } else { 0.0 })
}
