//! Slicer's volume properties: `presets.xml` (many, each an element `VolumeProperty`) and `.vp` (one, nine lines). Their
//! scalars are the data's own. Format of `.vp`: Slicer's developer guide, "Volume rendering".

use super::super::limits::{bad, quote};
use super::preset::{Key, POINTS};
use super::xml::{Element, escape};
use super::{Named, Preset};
use crate::error::Result;
use std::path::Path;

/// The presets of a document.
pub(super) fn read_xml(path: &Path, root: &Element) -> Vec<Named> {
    let mut found = Vec::new();
    properties(root, &mut found);
    let named = |e: &Element| {
        let name = e.get("name").unwrap_or("").to_owned();
        let text = |key: &str| e.get(key).unwrap_or("");
        let shading = ["shade", "ambient", "diffuse", "specular", "specularPower"].map(text);
        let property = Property {
            scalar: text("scalarOpacity"),
            gradient: text("gradientOpacity"),
            color: text("colorTransfer"),
            shading,
            interpolation: text("interpolation"),
        };
        Named { preset: property.preset(path, &format!("line {}: ", e.line), &name), name }
    };
    found.into_iter().map(named).collect()
}

fn properties<'a>(element: &'a Element, found: &mut Vec<&'a Element>) {
    if element.name == "VolumeProperty" {
        found.push(element);
    }
    element.children.iter().for_each(|c| properties(c, found));
}

/// The one preset of a `.vp` file.
pub(super) fn read_vp(path: &Path, text: &str, stem: &str) -> Result<Preset> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    if lines.len() < 9 {
        let right = "nine are needed: interpolation, shade, diffuse, ambient, specular, specular power, opacity, gradient opacity, colour";
        return Err(bad(path, format!("it has {} lines", lines.len()), right));
    }
    let property = Property {
        interpolation: lines[0],
        shading: [lines[1], lines[3], lines[2], lines[4], lines[5]],
        scalar: lines[6],
        gradient: lines[7],
        color: lines[8],
    };
    property.preset(path, "", stem)
}

/// A volume property's texts.
struct Property<'a> {
    scalar: &'a str,
    gradient: &'a str,
    color: &'a str,
    /// Shade, ambient, diffuse, specular, specular power.
    shading: [&'a str; 5],
    interpolation: &'a str,
}

impl Property<'_> {
    fn preset(&self, path: &Path, place: &str, name: &str) -> Result<Preset> {
        let opacities = points::<2>(path, place, "scalarOpacity", self.scalar)?;
        let colors = points::<4>(path, place, "colorTransfer", self.color)?;
        let mut preset = Preset::new(
            name,
            colors.into_iter().map(|[x, r, g, b]| (x, [r, g, b])).collect(),
            opacities.into_iter().map(|[x, a]| [x, a, 0.5, 0.0]).collect(),
        );
        let gradient = points::<2>(path, place, "gradientOpacity", self.gradient);
        if gradient.is_ok_and(|g| g.iter().any(|p| p[1] != 1.0)) {
            preset.lost.push(format!("gradient opacity ({}): opacity depends on the value alone", quote(self.gradient)));
        }
        if self.interpolation.starts_with('0') {
            preset.lost.push("interpolation by the nearest sample; the data are interpolated linearly".into());
        }
        let [shade, ambient, diffuse, specular, power] = self.shading.map(quote);
        if shade.starts_with('1') {
            let text =
                format!("shading (ambient {ambient}, diffuse {diffuse}, specular {specular} to the power {power}): light takes its place");
            preset.shading.push(text);
        }
        preset.checked(path)
    }
}

/// "8 -3024 0 -16 0 …": how many numbers, then groups of `N`.
fn points<const N: usize>(path: &Path, place: &str, key: &str, text: &str) -> Result<Vec<[f64; N]>> {
    let wrong = |what: String| {
        bad(path, format!("{place}its {key} {what}"), format!("it must be the number of numbers and then {N} per point, parted by blanks"))
    };
    let mut numbers = Vec::new();
    for word in text.split_ascii_whitespace() {
        let number = word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("has '{}'", quote(word))))?;
        numbers.push(number);
    }
    let Some((count, rest)) = numbers.split_first() else { return Err(wrong("is missing or empty".into())) };
    if *count != rest.len() as f64 || rest.len() % N != 0 || rest.len() / N > POINTS {
        return Err(wrong(format!("claims {count} numbers and has {}", rest.len())));
    }
    Ok(rest.as_chunks::<N>().0.to_vec())
}

/// Scalars and opacities, scalars and colours.
fn texts(preset: &Preset) -> [String; 2] {
    let keys = preset.keys();
    let (mut opacities, mut colors) = (Vec::new(), Vec::new());
    let mut push = |x: f64, [r, g, b, a]: [f64; 4], color: bool, opacity: bool| {
        if opacity {
            opacities.push(format!("{x} {a}"));
        }
        if color {
            colors.push(format!("{x} {r} {g} {b}"));
        }
    };
    let rgb = |v: [f64; 4]| [v[0], v[1], v[2]];
    // Keys of colours and of opacities alone stay where they are needed only.
    let on = |line: &dyn Fn(&Key) -> Vec<f64>, keys: &[Key], i: usize| -> bool {
        if i == 0 || i + 1 == keys.len() {
            return true;
        }
        let (a, k, b) = (&keys[i - 1], &keys[i], &keys[i + 1]);
        let s = (k.x - a.x) / (b.x - a.x);
        let (l, m, r) = (line(&Key { left: a.right, ..*a }), line(k), line(&Key { left: b.left, ..*b }));
        (0..m.len()).any(|c| (l[c] + (r[c] - l[c]) * s - m[c]).abs() > 1e-12)
    };
    for (i, key) in keys.iter().enumerate() {
        let color = rgb(key.left) != rgb(key.right);
        let opacity = key.left[3] != key.right[3];
        push(key.x, key.left, color || on(&|k| rgb(k.left).to_vec(), &keys, i), opacity || on(&|k| vec![k.left[3]], &keys, i));
        if color || opacity {
            push(key.x, key.right, color, opacity);
        }
    }
    let list = |points: Vec<String>, each: usize| format!("{} {}", points.len() * each, points.join(" "));
    [list(opacities, 2), list(colors, 4)]
}

/// The presets as Slicer's `presets.xml`.
pub(super) fn write_xml(presets: &[Preset]) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<MRML>\n");
    for (i, preset) in presets.iter().enumerate() {
        let [opacity, color] = texts(preset);
        out += &format!(
            "  <VolumeProperty selected=\"false\" hideFromEditors=\"false\" name=\"{}\" gradientOpacity=\"4 0 1 255 1\" userTags=\"\" \
             specularPower=\"10\" scalarOpacity=\"{opacity}\" id=\"vtkMRMLVolumePropertyNode{}\" specular=\"0.2\" shade=\"1\" ambient=\"0.1\" \
             colorTransfer=\"{color}\" selectable=\"true\" diffuse=\"0.9\" interpolation=\"1\"/>\n",
            escape(&preset.name),
            i + 1
        );
    }
    out + "</MRML>\n"
}

/// A preset as Slicer's `.vp`.
pub(super) fn write_vp(preset: &Preset) -> String {
    let [opacity, color] = texts(preset);
    format!("1\n1\n0.9\n0.1\n0.2\n10\n{opacity}\n4 0 1 255 1\n{color}\n")
}
