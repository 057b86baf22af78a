//! Transfer functions from files of other programs: ParaView (also vtk.js), Slicer, Voreen, Inviwo, ImageVis3D, NiiVue and
//! Exposure Render; and back to the first five.
//!
//! All of them interpolate display colours and opacities over scalars. [`Transfer`] is scene-linear and piecewise linear,
//! so curves are resampled until it follows them. What a file says beyond that (gradient opacity, shading, …) is named by
//! [`Preset::lost`]. Opacities are taken over the length that [`TransferOptions::reference`] says, whatever the program
//! means by them ([`Preset::length`]): one voxel for VTK's, ¹⁄₂₀₀ of the volume for Voreen's, ¹⁄₁₅₀ for Inviwo's. These parts
//! are of the texture, whose sides are 1 along each axis: of a volume that is no cube no one length is theirs, and a file
//! knows no volume, so that they are said, not converted.

mod color;
mod convert;
mod curve;
mod exposure;
mod imagevis3d;
mod inviwo;
mod niivue;
mod paraview;
mod preset;
mod slicer;
mod voreen;
mod xml;

pub use convert::{Format, convert};
pub use preset::Preset;

use super::limits::{bad, io, open, quote};
use crate::error::{Error, Result, shown};
use crate::scene::Transfer;
use crate::scene::transfer::Reference;
use preset::OpacityPoint;
use std::io::Read;
use std::path::Path;

/// Largest preset file, bytes.
const FILE_BYTES: u64 = 64 << 20;

/// How to read a transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferOptions {
    /// Scalars that the preset's ends are laid on. Without it, a preset of relative scalars spans `data_range`
    /// (ParaView's "rescale to data range" of one within 0..1) and any other stays where it is.
    pub range: Option<[f64; 2]>,
    /// Smallest and largest value of the volume.
    pub data_range: [f64; 2],
    /// The length that the preset's opacities are meant over.
    pub reference: Reference,
    /// Which preset, in a file of several.
    pub name: Option<String>,
}

impl TransferOptions {
    /// For data of this range; opacities over one voxel.
    pub fn new(data_range: [f64; 2]) -> Self {
        Self { range: None, data_range, reference: Reference::default(), name: None }
    }
}

/// What a file holds under a name.
#[derive(Debug)]
pub struct Named {
    /// The preset's name; empty where the file gives it none.
    pub name: String,
    /// The preset, or why it cannot be used.
    pub preset: Result<Preset>,
}

/// The presets of a file, and the format that it is in.
///
/// # Errors
/// [`Error::Io`] from the system; [`Error::Format`] for a file that holds no presets.
pub fn read_presets(path: &Path) -> Result<(&'static str, Vec<Named>)> {
    let (mut file, length) = open(path)?;
    if length > FILE_BYTES {
        return Err(bad(path, format!("it has {length} bytes"), format!("a preset file has at most {} MiB", FILE_BYTES >> 20)));
    }
    let mut bytes = Vec::new();
    file.by_ref().take(FILE_BYTES).read_to_end(&mut bytes).map_err(|e| io(path, "read", e))?;
    let text = String::from_utf8_lossy(&bytes);
    // Some programs write a byte order mark.
    parse(path, text.strip_prefix('\u{feff}').unwrap_or(&text))
}

/// The presets of a text; `path` gives the errors a place, and what the text is where its beginning does not tell.
fn parse(path: &Path, text: &str) -> Result<(&'static str, Vec<Named>)> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let one = |preset: Result<Preset>| preset.map(|p| vec![Named { name: p.name.clone(), preset: Ok(p) }]);
    let start = text.trim_start().chars().next();
    if start == Some('<') && extension != "json" {
        let root = xml::parse(path, text)?;
        let kind = |names: &'static [&'static str]| root.find(&move |e: &xml::Element| names.contains(&e.name.as_str()));
        if let Some(scene) = kind(&["VolumeProperty"]).map(|_| &root) {
            return Ok(("Slicer", slicer::read_xml(path, scene)));
        }
        if root.name == "VoreenData" {
            return Ok(("Voreen", one(voreen::read(path, &root, &stem))?));
        }
        if kind(&["dataPoints", "Points"]).is_some() {
            return Ok(("Inviwo", one(inviwo::read(path, &root, &stem))?));
        }
        if root.name == "Presets" {
            return Ok(("Exposure Render", exposure::read(path, &root)?));
        }
        return Err(bad(
            path,
            format!("its root is '{}', of no transfer function known here", quote(&root.name)),
            "XML of Slicer (VolumeProperty), Voreen (VoreenData), Inviwo (InviwoTreeData, InviwoWorkspace) and Exposure Render (Presets) is read",
        ));
    }
    match extension.as_str() {
        "vp" => Ok(("Slicer", one(slicer::read_vp(path, text, &stem))?)),
        "1dt" => Ok(("ImageVis3D", one(imagevis3d::read(path, text, &stem))?)),
        "2dt" => Err(bad(
            path,
            "it is a function of two variables, value and gradient",
            "one of the value alone is needed: an ImageVis3D .1dt, or another program's",
        )),
        _ => paraview::read(path, text, &stem),
    }
}

/// Reads a transfer function in the format that the file is in.
///
/// # Errors
/// [`Error::Io`] from the system; [`Error::Format`] for a file that is no such preset, and where its name is missing or
/// unknown; [`Error::Invalid`] for a range that is not finite or descends.
pub fn read_transfer(path: &Path, options: &TransferOptions) -> Result<Transfer> {
    check_range("data range", options.data_range)?;
    check_range("transfer range", options.range.unwrap_or([0.0, 1.0]))?;
    read_preset(path, options.name.as_deref())?.transfer(path, options.range, options.data_range, options.reference)
}

/// The preset of that name in a file, or the only one; what of it is lost is logged.
///
/// # Errors
/// As [`read_transfer`].
pub fn read_preset(path: &Path, name: Option<&str>) -> Result<Preset> {
    let (format, presets) = read_presets(path)?;
    let preset = choose(path, presets, name)?;
    for lost in &preset.lost {
        log::warn!("{}: {format} preset '{}': {lost}", shown(path), quote(&preset.name));
    }
    for lost in preset.shading.iter().cloned().chain(preset.length_here().map(|l| format!("opacities {l}"))) {
        log::info!("{}: {format} preset '{}': {lost}", shown(path), quote(&preset.name));
    }
    Ok(preset)
}

/// Refuses a range that is not finite or descends.
pub(super) fn check_range(item: &'static str, range: [f64; 2]) -> Result<()> {
    if range[0].is_finite() && range[1].is_finite() && range[0] <= range[1] {
        return Ok(());
    }
    Err(Error::Invalid { item, what: format!("{} to {}", range[0], range[1]), right: "both ends must be finite and ascend".into() })
}

/// The preset of that name.
///
/// # Errors
/// [`Error::Format`] where the name is missing or unknown, and the preset's own.
pub fn choose(path: &Path, mut presets: Vec<Named>, name: Option<&str>) -> Result<Preset> {
    let names = || quote(&presets.iter().map(|p| format!("'{}'", p.name)).collect::<Vec<_>>().join(", "));
    let at = match (name, presets.len()) {
        (_, 0) => return Err(bad(path, "it holds no preset", "at least one is needed")),
        (None, 1) => 0,
        (None, n) => return Err(bad(path, format!("it holds {n} presets and none was named"), format!("name one of {}", names()))),
        (Some(name), _) => {
            let exact = presets.iter().position(|p| p.name == name);
            let found = exact.or_else(|| presets.iter().position(|p| p.name.eq_ignore_ascii_case(name)));
            found.ok_or_else(|| bad(path, format!("no preset is named '{}'", quote(name)), format!("it holds {}", names())))?
        }
    };
    presets.swap_remove(at).preset
}
