//! Scenes from TOML. The keys are those of `scene::keys`; an unknown one is an error that names it and its place.

use super::limits::open;
use super::settings::{COMMAND_LINE, Settings};
use crate::error::{Error, Result, shown};
use crate::scene::animation::{Animation, Series};
use crate::scene::camera::{CameraSettings, Space};
use crate::scene::clip::Clip;
use crate::scene::frames::{Pattern, parse_frames};
use crate::scene::scene::{
    Background, ImageSettings, LightSettings, LightSource, MAX_SIDE, RawSettings, SAMPLE_TYPES, Scene, Shading, Surface, TransferSource,
    VolumeSettings, Windowing,
};
use crate::scene::transfer::{Kind, Reference, Transfer};
use crate::scene::visibility::{Cells, Filter, Method, Quality, Sampling, Visibility, Wanted};
use glam::DVec3;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// Overrides of a scene's keys, (dotted key, value as TOML); the last of a key holds.
pub type Overrides<'a> = [(&'a str, &'a str)];

/// Scene files larger than this are refused: bytes.
const MAX_SCENE: u64 = 16 << 20;

/// Reads a scene file. Its relative paths are relative to its folder, those of overrides to the current one.
///
/// # Errors
/// [`Error::Io`] and [`Error::Format`] for a file that cannot be read as TOML, [`Error::Scene`] for a key that is unknown,
/// missing, or has an unusable value.
pub fn read_scene(path: &Path, overrides: &Overrides) -> Result<Scene> {
    let format = |what: String, right: &str| Error::Format { path: path.to_owned(), what, right: right.into() };
    let (file, _) = open(path)?;
    let mut bytes = Vec::new();
    file.take(MAX_SCENE + 1).read_to_end(&mut bytes).map_err(|source| Error::Io { path: path.to_owned(), action: "read", source })?;
    if bytes.len() as u64 > MAX_SCENE {
        return Err(format("it is larger than 16 MiB".into(), "a scene is a short TOML text"));
    }
    let text = String::from_utf8(bytes)
        .map_err(|e| format(format!("byte {} is not UTF-8", e.utf8_error().valid_up_to()), "a scene is a TOML text"))?;
    parse_scene(&text, &shown(path), path.parent().unwrap_or(Path::new("")), overrides)
}

/// The scene of a volume file alone, with overrides.
///
/// # Errors
/// [`Error::Scene`] as [`read_scene`], origin "command line".
pub fn scene_of_volume(volume: &Path, overrides: &Overrides) -> Result<Scene> {
    let mut settings = Settings::new(COMMAND_LINE.into(), Path::new(""));
    for (key, value) in overrides {
        settings.set(key, value)?;
    }
    if settings.has("volume.file") {
        return Err(settings.origins.error("volume.file", "is given twice", "name the volume once, or give a scene file (.toml)"));
    }
    let mut scene = build(settings, Some(volume))?;
    scene.origins.scene = COMMAND_LINE.into();
    Ok(scene)
}

/// Reads a scene from its text. `origin` names it in errors; `folder` is what its relative paths are relative to.
///
/// # Errors
/// As [`read_scene`].
pub fn parse_scene(text: &str, origin: &str, folder: &Path, overrides: &Overrides) -> Result<Scene> {
    let mut settings = Settings::new(origin.into(), folder);
    settings.read(text)?;
    for (key, value) in overrides {
        settings.set(key, value)?;
    }
    build(settings, None)
}

/// Groups of keys of which a scene has one; the first of each is its main key.
pub(super) const RIVALS: [[&[&str]; 2]; 2] = [
    [&["light.probe"], &["light.constant"]],
    [&["transfer.file", "transfer.name", "transfer.range"], &["transfer.points", "transfer.kind"]],
];

fn build(mut s: Settings, volume: Option<&Path>) -> Result<Scene> {
    let animation = super::scene_animation::animation(&mut s, volume)?;
    for [a, b] in RIVALS {
        s.exclusive(a, b)?;
    }
    let wanted = wanted(&mut s)?;
    plain(s, volume, animation, wanted)
}

/// The scene of settings whose groups are settled.
pub(super) fn plain(mut s: Settings, volume: Option<&Path>, animation: Option<Animation>, wanted: Option<Wanted>) -> Result<Scene> {
    let volume = volume_settings(&s, volume, animation.as_ref())?;
    if volume.steps.is_some() && animation.as_ref().is_some_and(|a| a.track("volume.number").is_some() || !s.has("volume.number")) {
        Arc::make_mut(&mut s.origins.animated).insert("volume.file".into(), Vec::new());
    }
    Ok(Scene {
        volume,
        transfer: transfer(&s)?,
        surface: surface(&s)?,
        clip: clip(&s)?,
        light: light(&s)?,
        visibility: visibility(&s)?,
        wanted,
        camera: camera(&s)?,
        image: image(&s)?,
        animation,
        origins: s.origins,
    })
}

fn volume_settings(s: &Settings, file: Option<&Path>, animation: Option<&Animation>) -> Result<VolumeSettings> {
    let file = match (file, s.path("volume.file")?) {
        (Some(file), _) => file.to_owned(),
        (None, Some(file)) => file,
        (None, None) => return Err(s.origins.error("volume.file", "is missing", "name the volume to show")),
    };
    let dims = s.numbers::<3>("volume.dims", 1.0..=1048576.0, "it must be three integers, [x, y, z], each 1 to 1048576")?;
    let spacing = s.numbers("volume.spacing", 1e-30..=1e30, "it must be three numbers above 0")?;
    let raw = match dims {
        Some(dims) if dims.iter().all(|n| n.fract() == 0.0) => {
            let Some(sample_type) = s.choice("volume.type", &SAMPLE_TYPES.map(|t| (t, t)))? else {
                return Err(s.origins.error("volume.type", "is missing", "a headerless file needs volume.dims and volume.type"));
            };
            Some(RawSettings {
                dims: dims.map(|n| n as usize),
                sample_type: sample_type.into(),
                spacing: spacing.unwrap_or([1.0; 3]),
                big_endian: s.choice("volume.endian", &[("little", false), ("big", true)])?.unwrap_or(false),
                offset: s.integer("volume.offset", 0..=u64::MAX, "it must be a number of bytes")?.unwrap_or(0),
            })
        }
        Some(dims) => return Err(s.origins.error("volume.dims", format!("is {dims:?}"), "it must be three integers")),
        None => {
            let raw_keys = ["volume.type", "volume.endian", "volume.offset"];
            if let Some(key) = raw_keys.into_iter().find(|k| s.has(k)) {
                let right = "with volume.dims it describes a headerless file; other files say it themselves";
                return Err(s.origins.error(key, "stands without `volume.dims`", right));
            }
            None
        }
    };
    let nan_as = s.number("volume.nan_as", f64::from(f32::MIN)..=f64::from(f32::MAX), "it must be a finite number")?;
    let steps = series(s, &file, animation)?;
    let file = steps.as_ref().map_or(file, |series| series.still(animation.map_or(1, |a| a.first)));
    Ok(VolumeSettings {
        file,
        steps,
        component: s.word("volume.component")?,
        series: s.word("volume.series")?,
        // A headerless file's spacing stands in its layout.
        spacing: spacing.filter(|_| raw.is_none()),
        raw,
        nan_as: nan_as.map(|v| v as f32),
    })
}

/// A time series: a file with a place for a number, in an animation or with a number given.
fn series(s: &Settings, file: &Path, animation: Option<&Animation>) -> Result<Option<Series>> {
    let given = ["volume.number", "volume.numbers"].into_iter().find(|k| s.has(k));
    // Numbered pictures are the slices of one volume, unless their numbers are asked for.
    let slices = file.extension().is_some_and(|e| ["tif", "tiff", "png"].iter().any(|s| e.eq_ignore_ascii_case(s)));
    if given.is_none() && (animation.is_none() || slices) {
        return Ok(None);
    }
    if Pattern::find(file).is_none() {
        let right = "name the files of a series with #### or %04d in place of their number";
        return given.map_or(Ok(None), |key| Err(s.origins.error(key, "stands beside a volume.file without a number", right)));
    }
    let mut numbers = Vec::new();
    if let Some(text) = s.text("volume.numbers")? {
        numbers = parse_frames(&text).map_err(|e| match e {
            Error::Invalid { what, right, .. } => s.origins.error("volume.numbers", format!("is unusable: {what}"), right),
            other => other,
        })?;
        numbers.sort_unstable();
    }
    let number = s.number("volume.number", -1e15..=1e15, "it must be a whole number")?.map(|n| n.floor() as i64);
    Ok(Some(Series { file: file.to_owned(), numbers, number }))
}

fn transfer(s: &Settings) -> Result<TransferSource> {
    let references = [("voxel", Reference::Voxel), ("world", Reference::World), ("side", Reference::Side)];
    let reference = s.choice("transfer.reference", &references)?.unwrap_or_default();
    let kind = s.choice("transfer.kind", &[("opacity", Kind::Opacity), ("extinction", Kind::Extinction)])?;
    let points = "it must be a list of points, each [scalar, red, green, blue, opacity]";
    if let Some(points) = s.rows::<5>("transfer.points", points)? {
        return match Transfer::from_points(&points, kind.unwrap_or_default(), reference) {
            Ok(transfer) => Ok(TransferSource::Points(transfer)),
            Err(Error::Invalid { what, right, .. }) => Err(s.origins.error("transfer.points", format!("is unusable: {what}"), right)),
            Err(other) => Err(other),
        };
    }
    let range = s.numbers::<2>("transfer.range", f64::MIN..=f64::MAX, "it must be two numbers, [low, high]")?;
    if let Some([lo, hi]) = range.filter(|[lo, hi]| lo >= hi) {
        return Err(s.origins.error("transfer.range", format!("is [{lo}, {hi}]"), "the first must be below the second"));
    }
    let name = s.text("transfer.name")?;
    if let Some(path) = s.path("transfer.file")? {
        return Ok(TransferSource::File { path, name, range, reference });
    }
    for (key, needed) in [("transfer.kind", "transfer.points"), ("transfer.range", "transfer.file"), ("transfer.name", "transfer.file")] {
        if s.has(key) {
            return Err(s.origins.error(key, format!("stands without `{needed}`"), format!("give `{needed}` or drop it")));
        }
    }
    Ok(TransferSource::Ramp { reference })
}

fn surface(s: &Settings) -> Result<Option<Surface>> {
    if !s.has_table("surface") {
        return Ok(None);
    }
    let Some(iso) = s.number("surface.iso", f64::MIN..=f64::MAX, "it must be a finite number, in the data's unit")? else {
        return Err(s.origins.error("surface.iso", "is missing", "say at which value the surface lies, or drop [surface]"));
    };
    let shading = s.choice("surface.shading", &[("lambert", Shading::Lambert), ("isotropic", Shading::Isotropic)])?;
    let albedo = s.numbers::<3>("surface.albedo", 0.0..=1.0, "it must be three numbers in 0..1, linear red, green, blue")?;
    Ok(Some(Surface { iso, shading: shading.unwrap_or_default(), albedo: albedo.map(|a| a.map(|v| v as f32)) }))
}

fn clip(s: &Settings) -> Result<Clip> {
    let bounds = s.numbers::<6>("clip.box", 0.0..=1.0, "it must be six numbers in 0..1, [x0, y0, z0, x1, y1, z1]")?;
    let planes = s.rows::<4>("clip.planes", "it must be a list of planes, each [nx, ny, nz, d]")?;
    let clip = Clip {
        bounds: bounds.map(|[x0, y0, z0, x1, y1, z1]| [[x0, y0, z0], [x1, y1, z1]]),
        planes: planes.unwrap_or_default(),
        space: s.choice("clip.space", &[("side", Space::Side), ("world", Space::World)])?.unwrap_or_default(),
    };
    clip.check().map_err(|e| s.origins.blame(e))?;
    Ok(clip)
}

fn light(s: &Settings) -> Result<LightSettings> {
    let default = LightSettings::default();
    let radiance = "it must be three numbers in 0..1e6, linear red, green, blue";
    let constant = s.numbers::<3>("light.constant", 0.0..=1e6, radiance)?.map(|c| c.map(|v| v as f32));
    let windows =
        [("none", Windowing::None), ("hanning", Windowing::Hanning), ("lanczos", Windowing::Lanczos), ("gauss", Windowing::Gauss)];
    Ok(LightSettings {
        source: match (s.path("light.probe")?, constant) {
            (Some(path), _) => LightSource::Probe(path),
            (None, Some(rgb)) => LightSource::Constant(rgb),
            (None, None) => default.source,
        },
        rotate: turn(s, "light.rotate")?,
        scale: s.number("light.scale", 0.0..=1e6, "it must lie in 0..1e6")?.unwrap_or(default.scale),
        bands: s.integer("light.bands", 1..=4, "it must be 1 to 4")?.map_or(default.bands, |v| v as u32),
        window: s.choice("light.window", &windows)?.unwrap_or_default(),
    })
}

/// An axis of length 1 and degrees.
fn turn(s: &Settings, key: &str) -> Result<Option<(DVec3, f64)>> {
    let turn = s.numbers::<4>(key, -1e6..=1e6, "it must be an axis and degrees, [x, y, z, degrees]")?;
    if turn.is_some_and(|r| r[..3].iter().all(|v| v.abs() < 1e-12)) {
        return Err(s.origins.error(key, "has an axis of length 0", "such as [0, 0, 1, 90]: a quarter turn about z"));
    }
    // One that has length 1 but for rounding stays as it is: a scene's own text reads as the same scene.
    let unit = |axis: DVec3| if (axis.length_squared() - 1.0).abs() < 1e-14 { axis } else { axis.normalize_or_zero() };
    Ok(turn.map(|[x, y, z, degrees]| (unit(DVec3::new(x, y, z)), degrees)))
}

/// A tolerance or a quality, in place of the settings that a plan finds; bands, cells, ratio and bits may stand beside it.
fn wanted(s: &mut Settings) -> Result<Option<Wanted>> {
    const FOUND: [&str; 8] = [
        "visibility.method",
        "visibility.directions",
        "visibility.near",
        "visibility.fit",
        "visibility.step",
        "visibility.sampling",
        "visibility.filter",
        "visibility.growth",
    ];
    let tolerance = s.number("visibility.tolerance", 0.001..=1.0, "it must lie in 0.001..1, such as 0.05")?;
    let qualities = [("draft", Quality::Draft), ("normal", Quality::Normal), ("fine", Quality::Fine)];
    let quality = s.choice("visibility.quality", &qualities)?;
    let fit = (s.integer("visibility.fit", 0..=u64::MAX, "it must be 0 to 64 points per cell")? > Some(0))
        .then(|| s.origins.of("visibility.fit").to_owned());
    s.exclusive(&["visibility.tolerance"], &["visibility.quality"])?;
    s.exclusive(&["visibility.tolerance"], &FOUND)?;
    s.exclusive(&["visibility.quality"], &FOUND)?;
    if let Some(origin) = fit.filter(|_| !s.has("visibility.fit")) {
        log::warn!(
            "{origin}: `visibility.fit` gives way to the tolerance, and a planned field is not fitted: the picture may be further off"
        );
    }
    Ok(match (s.has("visibility.tolerance"), s.has("visibility.quality")) {
        (true, _) => tolerance.map(Wanted::Tolerance),
        (_, true) => quality.map(Wanted::Quality),
        _ => None,
    })
}

fn visibility(s: &Settings) -> Result<Visibility> {
    let default = Visibility::default();
    let integer = |key, right, or: u32| Ok::<_, Error>(s.integer(key, 0..=u64::from(u32::MAX), right)?.map_or(or, |v| v as u32));
    let number = |key, right, or: f32| Ok::<_, Error>(s.number(key, -1e30..=1e30, right)?.map_or(or, |v| v as f32));
    let filters = [("box", Filter::Box), ("product", Filter::Product), ("axis", Filter::Axis), ("extinction", Filter::Extinction)];
    let settings = Visibility {
        method: s
            .choice("visibility.method", &[("march", Method::March), ("hierarchical", Method::Hierarchical), ("sweep", Method::Sweep)])?
            .unwrap_or_default(),
        ratio: integer("visibility.ratio", "it must be 1, 2, 4 or 8", default.ratio)?,
        directions: integer("visibility.directions", "it must be 1 to 1048576", default.directions)?,
        bands: integer("visibility.bands", "it must be 1 to 4", default.bands)?,
        bits: integer("visibility.bits", "it must be 8, 16 or 32", default.bits)?,
        filter: s.choice("visibility.filter", &filters)?.unwrap_or_default(),
        sampling: s
            .choice("visibility.sampling", &[("stratified", Sampling::Stratified), ("jittered", Sampling::Jittered)])?
            .unwrap_or_default(),
        growth: number("visibility.growth", "it must lie in 0.05..4", default.growth)?,
        step: number("visibility.step", "it must lie in 0.01..16", default.step)?,
        near: integer("visibility.near", "it must be 1 to 8 slices", default.near)?,
        fit: integer("visibility.fit", "it must be 0 to 64 points per cell", default.fit)?,
        cells: s.choice("visibility.cells", &[("matter", Cells::Matter), ("all", Cells::All)])?.unwrap_or_default(),
    };
    settings.check().map_err(|e| match e {
        Error::Invalid { item, what, right } => s.origins.error(item, format!("is {what}"), right),
        other => other,
    })?;
    let idle = ["visibility.filter", "visibility.growth"].into_iter().find(|key| s.has(key) && !s.has("visibility.method"));
    if let Some(key) = idle {
        let right = "it is of visibility.method \"hierarchical\": set that, too, or drop it";
        return Err(s.origins.error(key, "changes nothing in a sweep, the default method", right));
    }
    Ok(settings)
}

fn camera(s: &Settings) -> Result<CameraSettings> {
    let vector = |key| Ok::<_, Error>(s.numbers::<3>(key, -1e30..=1e30, "it must be three numbers, [x, y, z]")?.map(DVec3::from));
    let default = CameraSettings::default();
    let up = vector("camera.up")?.unwrap_or(default.up);
    if up == DVec3::ZERO {
        return Err(s.origins.error("camera.up", "is [0, 0, 0]", "it must be a direction, such as [0, 0, 1]"));
    }
    Ok(CameraSettings {
        position: vector("camera.position")?,
        target: vector("camera.target")?,
        up,
        fov_degrees: s.number("camera.fov", 1.0..=170.0, "it must lie in 1..170 degrees")?.unwrap_or(default.fov_degrees),
        space: s.choice("camera.space", &[("side", Space::Side), ("world", Space::World)])?.unwrap_or_default(),
        orbit: turn(s, "camera.orbit")?,
        centre: vector("camera.centre")?,
        distance: s.number("camera.distance", 1e-30..=1e30, "it must be a length above 0")?,
        fit: None,
    })
}

fn image(s: &Settings) -> Result<ImageSettings> {
    let default = ImageSettings::default();
    let side = format!("it must be 1 to {MAX_SIDE} pixels");
    let size = |key, or| Ok::<_, Error>(s.integer(key, 1..=MAX_SIDE as u64, &side)?.map_or(or, |v| v as usize));
    let background = "it must be [red, green, blue], linear, in 0..1e6, or \"light\"";
    Ok(ImageSettings {
        width: size("image.width", default.width)?,
        height: size("image.height", default.height)?,
        step: s.number("image.step", 0.05..=16.0, "it must lie in 0.05..16 voxels")?.unwrap_or(default.step),
        background: match s.choice("image.background", &[("light", Background::Light)]) {
            Ok(found) => found.unwrap_or_default(),
            Err(_) => match s.numbers::<3>("image.background", 0.0..=1e6, background)? {
                Some(color) => Background::Color(color.map(|v| v as f32)),
                None => Background::Transparent,
            },
        },
        exposure: s.number("image.exposure", -40.0..=40.0, "it must lie in -40..40 stops")?.unwrap_or(default.exposure),
        skip: s.flag("image.skip")?.unwrap_or(default.skip),
    })
}
