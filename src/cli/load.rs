//! From a scene's words to its data: volume, matter, light, camera.

use super::fail::Failure;
use super::progress::Progress;
use halflight::error::Error;
use halflight::io::{self, COMMAND_LINE, RawLayout, ReadOptions, SampleType, TransferOptions, VolumeInfo};
use halflight::scene::animation::Animation;
use halflight::scene::scene::{LightSource, RawSettings, SAMPLE_TYPES, TransferSource, ramp};
use halflight::scene::{Camera, Light, Matter, Probe, Scene, Transfer, Volume};
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::Path;

/// The stage in which the volume is read.
pub const READ: &str = "read volume";

/// All that a frame needs, in host memory.
pub struct Loaded {
    pub volume: Volume,
    pub matter: Matter,
    /// The light's probe, if it has one.
    pub probe: Option<Probe>,
    /// The light as it meets visibility.
    pub light: Light,
    pub camera: Camera,
}

/// A scene file, or any other file as the volume of a default scene.
pub fn scene(path: &Path, overrides: &[(String, String)]) -> Result<Scene, Failure> {
    let overrides: Vec<(&str, &str)> = overrides.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    Ok(match is_scene(path) {
        true => io::read_scene(path, &overrides)?,
        false => io::scene_of_volume(path, &overrides)?,
    })
}

/// Whether a file is a scene, by its extension.
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// The scene's volume.
pub fn volume(scene: &Scene, bar: &Progress) -> Result<Volume, Failure> {
    read(scene, bar, &|| bar.going(), |options| io::read_volume(&scene.volume.file, options))
}

/// The same without a bar, as long as `going`.
pub fn volume_while(scene: &Scene, going: &dyn Fn() -> bool) -> Result<Volume, Failure> {
    read(scene, &Progress::silent(), going, |options| io::read_volume(&scene.volume.file, options))
}

/// What the scene's volume is, also where its samples are not all finite.
pub fn volume_info(scene: &Scene) -> Result<VolumeInfo, Failure> {
    read(scene, &Progress::new(&[READ]), &|| true, |options| io::describe_file(&scene.volume.file, options))
}

fn read<T>(
    scene: &Scene,
    bar: &Progress,
    going: &dyn Fn() -> bool,
    with: impl FnOnce(&ReadOptions) -> Result<T, Error>,
) -> Result<T, Failure> {
    bar.enter(READ);
    let show = |fraction: f64| {
        bar.show(fraction);
        if going() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let raw = scene.volume.raw.as_ref().map(layout).transpose()?;
    let v = &scene.volume;
    let options = ReadOptions {
        raw,
        component: v.component.clone(),
        series: v.series.clone(),
        spacing: v.spacing,
        nan_as: v.nan_as,
        progress: Some(&show),
        ..ReadOptions::default()
    };
    with(&options).map_err(|e| of_file(scene, "volume.file", scene.origins.blame(e)))
}

/// What is wrong with a file that `key` names. Who misses one that the scene names may not know what its path is relative to.
pub fn of_file(scene: &Scene, key: &str, error: Error) -> Failure {
    let missing = matches!(&error, Error::Io { action: "open" | "read", source, .. } if source.kind() == ErrorKind::NotFound);
    let mut failure = Failure::from(error);
    if missing && scene.origins.of(key) != COMMAND_LINE {
        failure.sentence += " (paths in a scene are relative to the scene file)";
    }
    failure
}

/// Reads all that the scene names and checks it against the data. The small files come first: their errors should not
/// wait for the volume.
pub fn load(scene: &Scene, bar: &Progress) -> Result<Loaded, Failure> {
    let (probe, light) = light(scene)?;
    let volume = volume(scene, bar)?;
    let matter = matter(scene, &volume)?;
    let aspect = scene.image.width as f64 / scene.image.height as f64;
    let camera = Camera::from_settings(&scene.camera, volume.grid(), aspect).map_err(|e| scene.origins.blame(e))?;
    Ok(Loaded { volume, matter, probe, light, camera })
}

/// Refuses a frame that the animation does not have.
pub fn check_frame(animation: &Animation, frame: i64, option: &str) -> Result<(), Failure> {
    let range = animation.range();
    match range.contains(&frame) {
        true => Ok(()),
        false => Err(Failure::usage(format!(
            "frame {frame} lies outside the animation, which has {} to {}; change animation.frames or {option}",
            range.start(),
            range.end()
        ))),
    }
}

/// The scene's matter, checked against the data; says where nothing will be seen.
pub fn matter(scene: &Scene, volume: &Volume) -> Result<Matter, Failure> {
    let (matter, [lo, hi]) = (checked_matter(scene, volume)?, volume.range());
    if matter.is_vacuum([lo, hi]) {
        log::warn!("the transfer function is transparent over the data's range {lo} to {hi}: the picture will be empty");
    }
    Ok(matter)
}

/// The same without a word.
pub fn checked_matter(scene: &Scene, volume: &Volume) -> Result<Matter, Failure> {
    let transfer = transfer(scene, volume)?;
    let [lo, hi] = volume.range();
    if let Some(surface) = scene.surface
        && !(f64::from(lo)..=f64::from(hi)).contains(&surface.iso)
    {
        let what = format!("is {}, outside the data's range {lo} to {hi}", surface.iso);
        let error = scene.origins.error("surface.iso", what, "choose a value within the range");
        // Only the data shows it: bad input, wherever the value was written.
        return Err(Failure::new(3, error.to_string()));
    }
    Ok(Matter { transfer, surface: scene.surface })
}

/// The scene's probe.
pub fn probe(scene: &Scene, path: &Path) -> Result<Probe, Failure> {
    io::read_probe(path).map_err(|e| of_file(scene, "light.probe", e))
}

/// The scene's light, and its probe for the background.
pub fn light(scene: &Scene) -> Result<(Option<Probe>, Light), Failure> {
    let probe = match &scene.light.source {
        LightSource::Probe(path) => Some(probe(scene, path)?),
        LightSource::Constant(_) => None,
    };
    let light = match (&probe, &scene.light.source) {
        (Some(probe), _) => Light::from_probe(probe),
        (None, LightSource::Constant(rgb)) => Light::constant(rgb.map(f64::from)),
        (None, LightSource::Probe(_)) => Light::DARK,
    };
    Ok((probe, scene.light.prepare(&light)))
}

fn transfer(scene: &Scene, volume: &Volume) -> Result<Transfer, Failure> {
    Ok(match &scene.transfer {
        TransferSource::Ramp { reference } => ramp(volume.range(), *reference)?,
        TransferSource::Points(transfer) => transfer.clone(),
        TransferSource::File { path, name, range, reference } => {
            let data_range = volume.range().map(f64::from);
            let options = TransferOptions { range: *range, data_range, reference: *reference, name: name.clone() };
            io::read_transfer(path, &options).map_err(|e| of_file(scene, "transfer.file", e))?
        }
    })
}

fn layout(raw: &RawSettings) -> Result<RawLayout, Error> {
    use SampleType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let kinds = [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64];
    let Some(kind) = SAMPLE_TYPES.iter().position(|t| *t == raw.sample_type).map(|i| kinds[i]) else {
        let right = SAMPLE_TYPES.join(", ");
        return Err(Error::Invalid { item: "volume.type", what: format!("is {:?}", raw.sample_type), right });
    };
    Ok(RawLayout { dims: raw.dims, kind, big_endian: raw.big_endian, spacing: raw.spacing, offset: raw.offset })
}
