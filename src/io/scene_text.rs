//! A scene as TOML text with every effective setting: what pictures and fields carry in their headers. Read again by
//! `io::parse_scene`, it is the same scene.

use crate::error::Result;
use crate::scene::Camera;
use crate::scene::camera::Space;
use crate::scene::frames::frames_text;
use crate::scene::scene::{Background, LightSource, Scene, Shading, TransferSource, Windowing};
use crate::scene::transfer::{Kind, Reference};
use crate::scene::visibility::{Cells, Filter, Method, Quality, Sampling, Visibility, Wanted};
use toml::{Table, Value};

/// The scene's text. Paths are as the scene holds them.
pub fn scene_text(scene: &Scene) -> String {
    let mut root = Table::new();
    let tables = [
        ("volume", volume(scene)),
        ("transfer", transfer(scene)),
        ("surface", surface(scene)),
        ("clip", clip(scene)),
        ("light", light(scene)),
        ("visibility", visibility(scene)),
        ("camera", camera(scene)),
        ("image", image(scene)),
        ("animation", scene.animation.as_ref().map_or_else(Table::new, super::scene_animation::text)),
    ];
    let mut text = String::new();
    for (name, table) in tables {
        if !table.is_empty() {
            root.clear();
            root.insert(name.into(), Value::Table(table));
            text += &root.to_string();
        }
    }
    text
}

/// Where a picture's camera stands, for its header: `camera`, a [camera] table in world coordinates that any scene of the
/// volume can have, and [`WORLD_TO_CAMERA`](super::WORLD_TO_CAMERA), row by row, for rows times matrices as OpenEXR has them:
/// x to the right of the picture, y up, z away from the camera; [`SCREEN_WINDOW_WIDTH`](super::SCREEN_WINDOW_WIDTH) of a picture
/// of `aspect`, width over height.
///
/// # Errors
/// As [`Camera::check`].
pub fn camera_meta(camera: &Camera, aspect: f64) -> Result<Vec<(String, String)>> {
    let [right, up, forward] = camera.basis()?;
    let entries = [("position", camera.position), ("target", camera.target), ("up", camera.up)];
    let mut out = table(entries.map(|(key, v)| (key, floats(v.to_array()))).into());
    out.insert("space".into(), word("world"));
    out.insert("fov".into(), Value::Float(camera.fov_degrees));
    let axes = [right, up, forward];
    let mut rows: Vec<f64> = (0..3).flat_map(|i| axes.map(|a| a[i]).into_iter().chain([0.0])).collect();
    rows.extend(axes.map(|a| -a.dot(camera.position)).into_iter().chain([1.0]));
    let mut meta = vec![("camera".into(), Table::from_iter([("camera".to_owned(), Value::Table(out))]).to_string())];
    // No -0: it is one of two names of a number.
    let rows: Vec<f32> = rows.iter().map(|x| *x as f32 + 0.0).collect();
    if rows.iter().all(|x| x.is_finite()) {
        meta.push((super::WORLD_TO_CAMERA.into(), rows.iter().map(f32::to_string).collect::<Vec<_>>().join(" ")));
    }
    let width = (2.0 * (camera.fov_degrees / 2.0).to_radians().tan() * aspect) as f32;
    if width.is_finite() && width > 0.0 {
        meta.push((super::SCREEN_WINDOW_WIDTH.into(), width.to_string()));
    }
    Ok(meta)
}

/// The shortest decimal that reads as the same single-precision number.
fn short(x: f32) -> Value {
    Value::Float(x.to_string().parse().unwrap_or(f64::from(x)))
}

fn shorts(x: impl IntoIterator<Item = f32>) -> Value {
    Value::Array(x.into_iter().map(short).collect())
}

fn floats(x: impl IntoIterator<Item = f64>) -> Value {
    Value::Array(x.into_iter().map(Value::Float).collect())
}

fn integer(x: u64) -> Value {
    Value::Integer(i64::try_from(x).unwrap_or(i64::MAX))
}

fn word(x: &str) -> Value {
    Value::String(x.into())
}

fn table(entries: Vec<(&str, Value)>) -> Table {
    entries.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
}

fn volume(scene: &Scene) -> Table {
    let v = &scene.volume;
    let mut out = vec![("file", word(&v.steps.as_ref().map_or(&v.file, |s| &s.file).display().to_string()))];
    if let Some(series) = &v.steps {
        out.extend(series.number.map(|n| ("number", Value::Integer(n))));
        if !series.numbers.is_empty() {
            out.push(("numbers", word(&frames_text(&series.numbers))));
        }
    }
    out.extend(v.component.iter().map(|c| ("component", word(c))));
    out.extend(v.series.iter().map(|s| ("series", word(s))));
    out.extend(v.spacing.map(|s| ("spacing", floats(s))));
    if let Some(raw) = &v.raw {
        out.push(("dims", Value::Array(raw.dims.map(|n| integer(n as u64)).into())));
        out.push(("type", word(&raw.sample_type)));
        out.push(("spacing", floats(raw.spacing)));
        out.push(("endian", word(if raw.big_endian { "big" } else { "little" })));
        out.push(("offset", integer(raw.offset)));
    }
    if let Some(nan_as) = v.nan_as {
        out.push(("nan_as", short(nan_as)));
    }
    table(out)
}

fn transfer(scene: &Scene) -> Table {
    let length = |r: Reference| {
        word(match r {
            Reference::Voxel => "voxel",
            Reference::World => "world",
            Reference::Side => "side",
        })
    };
    match &scene.transfer {
        TransferSource::Ramp { reference } => table(vec![("reference", length(*reference))]),
        TransferSource::Points(t) => {
            let kind = match t.kind() {
                Kind::Opacity => "opacity",
                Kind::Extinction => "extinction",
            };
            let row = |[s, r, g, b, last]: [f64; 5]| {
                Value::Array(vec![Value::Float(s), short(r as f32), short(g as f32), short(b as f32), Value::Float(last)])
            };
            let points = t.points().into_iter().map(row).collect();
            table(vec![("reference", length(t.reference())), ("kind", word(kind)), ("points", Value::Array(points))])
        }
        TransferSource::File { path, name, range, reference } => {
            let mut out = vec![("file", word(&path.display().to_string())), ("reference", length(*reference))];
            out.extend(name.as_ref().map(|n| ("name", word(n))));
            out.extend(range.map(|r| ("range", floats(r))));
            table(out)
        }
    }
}

fn surface(scene: &Scene) -> Table {
    let Some(s) = &scene.surface else { return Table::new() };
    let shading = match s.shading {
        Shading::Lambert => "lambert",
        Shading::Isotropic => "isotropic",
    };
    let mut out = vec![("iso", Value::Float(s.iso)), ("shading", word(shading))];
    out.extend(s.albedo.map(|a| ("albedo", shorts(a))));
    table(out)
}

fn clip(scene: &Scene) -> Table {
    let c = &scene.clip;
    let mut out = Vec::new();
    out.extend(c.bounds.map(|b| ("box", floats(b.concat()))));
    if !c.planes.is_empty() {
        out.push(("planes", Value::Array(c.planes.iter().map(|p| floats(*p)).collect())));
    }
    if c.space == Space::World {
        out.push(("space", word("world")));
    }
    table(out)
}

fn light(scene: &Scene) -> Table {
    let l = &scene.light;
    let mut out = vec![match &l.source {
        LightSource::Probe(path) => ("probe", word(&path.display().to_string())),
        LightSource::Constant(c) => ("constant", shorts(*c)),
    }];
    out.extend(l.rotate.map(|(axis, degrees)| ("rotate", floats([axis.x, axis.y, axis.z, degrees]))));
    out.push(("scale", Value::Float(l.scale)));
    out.push(("bands", integer(l.bands.into())));
    let window = match l.window {
        Windowing::None => "none",
        Windowing::Hanning => "hanning",
        Windowing::Lanczos => "lanczos",
        Windowing::Gauss => "gauss",
    };
    out.push(("window", word(window)));
    table(out)
}

fn visibility(scene: &Scene) -> Table {
    let v = &scene.visibility;
    let method = match v.method {
        Method::March => "march",
        Method::Hierarchical => "hierarchical",
        Method::Sweep => "sweep",
    };
    let filter = match v.filter {
        Filter::Box => "box",
        Filter::Product => "product",
        Filter::Axis => "axis",
        Filter::Extinction => "extinction",
    };
    let sampling = match v.sampling {
        Sampling::Stratified => "stratified",
        Sampling::Jittered => "jittered",
    };
    if let Some(wanted) = scene.wanted {
        // Only what stands beside a tolerance, where it was given.
        let d = Visibility::default();
        let given = |key: &str, other: bool| other || scene.origins.keys.contains_key(key);
        let mut out = vec![match wanted {
            Wanted::Tolerance(t) => ("tolerance", Value::Float(t)),
            Wanted::Quality(Quality::Draft) => ("quality", word("draft")),
            Wanted::Quality(Quality::Normal) => ("quality", word("normal")),
            Wanted::Quality(Quality::Fine) => ("quality", word("fine")),
        }];
        let numbers = [("ratio", v.ratio, d.ratio), ("bands", v.bands, d.bands), ("bits", v.bits, d.bits)];
        for (key, value, default) in numbers {
            if given(&format!("visibility.{key}"), value != default) {
                out.push((key, integer(value.into())));
            }
        }
        if v.cells == Cells::All {
            out.push(("cells", word("all")));
        }
        return table(out);
    }
    table(vec![
        ("method", word(method)),
        ("ratio", integer(v.ratio.into())),
        ("directions", integer(v.directions.into())),
        ("bands", integer(v.bands.into())),
        ("bits", integer(v.bits.into())),
        ("filter", word(filter)),
        ("sampling", word(sampling)),
        ("growth", short(v.growth)),
        ("step", short(v.step)),
        ("near", integer(v.near.into())),
        ("fit", integer(v.fit.into())),
        ("cells", word(if v.cells == Cells::All { "all" } else { "matter" })),
    ])
}

fn camera(scene: &Scene) -> Table {
    let c = &scene.camera;
    let mut out = Vec::new();
    out.extend(c.position.map(|p| ("position", floats(p.to_array()))));
    out.extend(c.target.map(|p| ("target", floats(p.to_array()))));
    out.push(("up", floats(c.up.to_array())));
    out.push(("fov", Value::Float(c.fov_degrees)));
    out.push(("space", word(if c.space == Space::World { "world" } else { "side" })));
    out.extend(c.orbit.map(|(axis, degrees)| ("orbit", floats([axis.x, axis.y, axis.z, degrees]))));
    out.extend(c.centre.map(|p| ("centre", floats(p.to_array()))));
    out.extend(c.distance.map(|d| ("distance", Value::Float(d))));
    table(out)
}

fn image(scene: &Scene) -> Table {
    let i = &scene.image;
    let mut out = vec![
        ("width", integer(i.width as u64)),
        ("height", integer(i.height as u64)),
        ("step", Value::Float(i.step)),
        ("exposure", Value::Float(i.exposure)),
        ("skip", Value::Boolean(i.skip)),
    ];
    match i.background {
        Background::Transparent => {}
        Background::Color(c) => out.push(("background", shorts(c))),
        Background::Light => out.push(("background", word("light"))),
    }
    table(out)
}
