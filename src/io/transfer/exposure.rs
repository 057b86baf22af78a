//! Exposure Render's appearance presets: nodes of intensity 0..1 over the data's range, opacity and a diffuse colour.

use super::super::limits::bad;
use super::xml::Element;
use super::{Named, Preset};
use crate::error::Result;
use std::path::Path;

/// The presets of a document.
pub(super) fn read(path: &Path, root: &Element) -> Result<Vec<Named>> {
    if !root.all("Preset").any(|p| p.child("Nodes").is_some()) {
        return Err(bad(path, "its presets have no Nodes: they are of cameras or lights", "appearance presets are read"));
    }
    let named = |e: &Element| {
        let name = e.get("Name").unwrap_or("").to_owned();
        Named { preset: preset(path, e, &name), name }
    };
    Ok(root.all("Preset").map(named).collect())
}

fn preset(path: &Path, e: &Element, name: &str) -> Result<Preset> {
    let mut points = Vec::new();
    let (mut shiny, mut glows) = (false, false);
    let lit = |c: Option<&Element>| c.is_some_and(|c| ["R", "G", "B"].iter().any(|k| c.get(k).is_some_and(|v| v != "0")));
    for node in e.needed(path, "Nodes")?.all("Node") {
        let value = |name: &str| node.needed(path, name)?.number(path, &["Value"]);
        let diffuse = node.needed(path, "Diffuse")?;
        let channel = |name: &str| Ok(diffuse.number(path, &[name])? / 255.0);
        points.push([value("NormalizedIntensity")?, channel("R")?, channel("G")?, channel("B")?, value("Opacity")?]);
        shiny |= lit(node.child("Specular"));
        glows |= lit(node.child("Emission"));
    }
    let mut preset = Preset::of_points(name, &points);
    (preset.domain, preset.relative) = ([0.0, 1.0], true);
    if let Some(scale) = e.number_of(path, "DensityScale", "Value")? {
        preset.lost.push(format!("DensityScale {scale}: opacities are taken as they stand"));
    }
    if glows {
        preset.lost.push("emission: nothing glows".into());
    }
    if e.number_of(path, "GradientFactor", "Value")?.is_some_and(|g| g != 0.0) {
        preset.lost.push("GradientFactor: opacity depends on the value alone".into());
    }
    if shiny {
        preset.shading.push("specular colours and roughness: light takes their place".into());
    }
    preset.checked(path)
}
