//! Presets into files of other programs, and what they lose on the way.

use super::super::limits::quote;
use super::color::Space;
use super::{Preset, imagevis3d, inviwo, paraview, parse, slicer, voreen};
use crate::error::{Error, Result};
use std::path::Path;

/// A format that presets are written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// ParaView JSON, any number of presets.
    ParaView,
    /// Slicer's `presets.xml`, any number of presets.
    Slicer,
    /// Slicer's `.vp`.
    SlicerVp,
    /// Voreen's `.tfi`.
    Voreen,
    /// Inviwo's `.itf`.
    Inviwo,
    /// ImageVis3D's `.1dt`.
    ImageVis3d,
}

impl Format {
    /// Extension and format.
    pub const ALL: [(&'static str, Format); 6] = [
        ("json", Format::ParaView),
        ("xml", Format::Slicer),
        ("vp", Format::SlicerVp),
        ("tfi", Format::Voreen),
        ("itf", Format::Inviwo),
        ("1dt", Format::ImageVis3d),
    ];

    /// The format of a file's extension.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.iter().find(|(e, _)| *e == extension).map(|(_, f)| *f)
    }

    /// Whether a file holds any number of presets, with their names.
    pub fn holds_many(self) -> bool {
        matches!(self, Format::ParaView | Format::Slicer)
    }

    /// The program that reads it.
    pub fn name(self) -> &'static str {
        match self {
            Format::ParaView => "ParaView",
            Format::Slicer | Format::SlicerVp => "Slicer",
            Format::Voreen => "Voreen",
            Format::Inviwo => "Inviwo",
            Format::ImageVis3d => "ImageVis3D",
        }
    }
}

/// The text of a file of `format` that holds `presets`, laid on `range` if one is given, and what each of them loses.
///
/// # Errors
/// [`Error::Invalid`] for no preset, for several where the format holds one, and for a range that is not finite or descends.
pub fn convert(presets: &[Preset], format: Format, range: Option<[f64; 2]>) -> Result<(String, Vec<String>)> {
    if let Some(range) = range {
        super::check_range("range", range)?;
    }
    if presets.is_empty() || (presets.len() > 1 && !format.holds_many()) {
        let names = quote(&presets.iter().map(|p| format!("'{}'", p.name)).collect::<Vec<_>>().join(", "));
        let what = format!("there are {}, a file of {} holds one", presets.len(), format.name());
        return Err(Error::Invalid { item: "presets", what, right: format!("name one of {names}") });
    }
    let placed: Vec<Preset> = presets.iter().map(|p| range.map_or_else(|| p.clone(), |r| p.on(r))).collect();
    let text = match (format, &placed[0]) {
        (Format::ParaView, _) => paraview::write(&spanning(&placed)),
        (Format::Slicer, _) => slicer::write_xml(&spanning(&placed)),
        (Format::SlicerVp, one) => slicer::write_vp(&one.spanning()),
        (Format::Voreen, one) => voreen::write(one),
        (Format::Inviwo, one) => inviwo::write(one),
        (Format::ImageVis3d, one) => imagevis3d::write(one),
    };
    // Read back: what was written is what can be said about it.
    let extension = Format::ALL.iter().find(|(_, f)| *f == format).map_or("json", |(e, _)| e);
    let (_, back) = parse(Path::new(&format!("preset.{extension}")), &text)?;
    let mut lost = Vec::new();
    for (preset, back) in placed.iter().zip(back) {
        let before = if presets.len() > 1 { format!("'{}': ", quote(&preset.name)) } else { String::new() };
        lost.extend(preset.lost().chain(written(preset, &back.preset?, format).iter().map(String::as_str)).map(|l| format!("{before}{l}")));
    }
    // Slicer 5.6 and before read lines into 1024 bytes, and take the rest for the next line.
    if format == Format::SlicerVp && text.lines().any(|line| line.len() > 1023) {
        lost.push("what stands beyond 1023 bytes of a line, to Slicer up to 5.6; as .xml it has no limit".into());
    }
    Ok((text, lost))
}

fn spanning(presets: &[Preset]) -> Vec<Preset> {
    presets.iter().map(Preset::spanning).collect()
}

/// What `preset` lost in becoming `back`.
fn written(preset: &Preset, back: &Preset, format: Format) -> Vec<String> {
    let mut lost = Vec::new();
    if preset.name != back.name && !preset.name.is_empty() && format.holds_many() {
        lost.push(format!("its name: it became '{}'", quote(&back.name)));
    }
    let [lo, hi] = preset.domain();
    match (preset.relative, back.relative) {
        (true, false) => {
            lost.push(format!("that its scalars span the data: they became {lo} to {hi}; lay them on the data's with a range"))
        }
        (false, true) => lost.push(format!("its scalars {lo} to {hi}: {} spans the data with it, whatever their range", format.name())),
        _ => {}
    }
    if preset.space != back.space && preset.space != Space::Rgb {
        lost.push(format!("interpolation of colours in {:?}: straight lines of {} points follow it", preset.space, back.colors.len()));
    }
    let curved = |p: &Preset| p.opacities.iter().any(|o| o[2..] != [0.5, 0.0]);
    if curved(preset) && !curved(back) {
        lost.push(format!("midpoints and sharpness of opacities: straight lines of {} points follow them", back.opacities.len()));
    }
    if preset.parts != back.parts {
        let same = match (preset.parts, back.parts) {
            (Some(n), None) | (None, Some(n)) => format!(": the same where the side has {n} voxels"),
            _ => String::new(),
        };
        lost.push(format!("the length of its opacities: {} became {}{same}", preset.length(), back.length()));
    }
    let [color, opacity] = preset.difference(back);
    if color > 1e-4 || opacity > 1e-4 {
        lost.push(format!("precision: colours are off by at most {color:.4} and opacities by {opacity:.4} of 1"));
    }
    lost
}
