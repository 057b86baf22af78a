//! From a scene's words to its data: volume, matter, light, camera.

use super::fail::Failure;
use super::progress::Progress;
use halflight::error::Error;
use halflight::io::{self, COMMAND_LINE, RawLayout, ReadOptions, SampleType, VolumeInfo};
use halflight::scene::animation::Animation;
use halflight::scene::scene::{LightSource, RawSettings, SAMPLE_TYPES, TransferSource, ramp};
use halflight::scene::{Camera, Light, Matter, Probe, Scene, Transfer, Volume};
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Once;

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
    if let Some(why) = unseen(scene, &matter, &volume) {
        log::warn!("{why}");
    }
    let camera = Camera::from_settings(&scene.camera, volume.grid(), scene.image.aspect()).map_err(|e| scene.origins.blame(e))?;
    Ok(Loaded { volume, matter, probe, light, camera })
}

/// The files that the scene names: its volume's, the probe, the preset.
pub fn inputs(scene: &Scene) -> Vec<PathBuf> {
    let mut files = io::volume_files(&scene.volume.file);
    if let LightSource::Probe(probe) = &scene.light.source {
        files.push(probe.clone());
    }
    if let TransferSource::File { path, .. } = &scene.transfer {
        files.push(path.clone());
    }
    files
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

/// The scene's matter, checked against the data.
pub fn matter(scene: &Scene, volume: &Volume) -> Result<Matter, Failure> {
    let matter = Matter { transfer: transfer(scene, volume)?, surface: scene.surface };
    // A front that has not come yet, or has passed, is no error of the frame.
    if !scene.origins.surface_moves() {
        // Only the data shows it: bad input, wherever the value was written.
        matter.check_surface(volume.range()).map_err(|e| Failure::new(3, scene.origins.blame(e).to_string()))?;
    }
    Ok(matter)
}

/// Why nothing will be seen of the volume, or only its box, if so.
pub fn unseen(scene: &Scene, matter: &Matter, volume: &Volume) -> Option<String> {
    let [lo, hi] = volume.range();
    match matter.surface {
        _ if scene.clip.keeps_nothing(volume.grid()) => Some("[clip] leaves nothing of the volume: the picture will be empty".into()),
        Some(s) if s.iso < f64::from(lo) => {
            Some(format!("`surface.iso` is {}, below the data's range {lo} to {hi}: the whole box is solid", s.iso))
        }
        Some(s) if s.iso > f64::from(hi) => {
            Some(format!("`surface.iso` is {}, above the data's range {lo} to {hi}: the picture will be empty", s.iso))
        }
        None if matter.is_vacuum([lo, hi]) => {
            Some(format!("the transfer function is transparent over the data's range {lo} to {hi}: the picture will be empty"))
        }
        _ => None,
    }
}

/// The scene's probe.
pub fn probe(scene: &Scene, path: &Path) -> Result<Probe, Failure> {
    io::read_probe(path).map_err(|e| of_file(scene, "light.probe", e))
}

/// The scene's light, and its probe for the background.
pub fn light(scene: &Scene) -> Result<(Option<Probe>, Light), Failure> {
    let (probe, light) = match &scene.light.source {
        LightSource::Probe(path) => {
            let probe = probe(scene, path)?;
            let light = Light::from_probe(&probe);
            (Some(probe), light)
        }
        LightSource::Constant(rgb) => (None, Light::constant(rgb.map(f64::from))),
    };
    Ok((probe, scene.light.prepare(&light)))
}

fn transfer(scene: &Scene, volume: &Volume) -> Result<Transfer, Failure> {
    Ok(match &scene.transfer {
        TransferSource::Ramp { reference } => {
            // The ramp is grey: a surface's albedo is the same everywhere on it.
            if scene.surface.is_none() {
                rescaled(scene, "give transfer.points in data values");
            }
            ramp(volume.range(), *reference)?
        }
        TransferSource::Points(transfer) => transfer.clone(),
        TransferSource::File { path, name, range, reference } => {
            let file = |e| of_file(scene, "transfer.file", e);
            let preset = io::transfer::read_preset(path, name.as_deref()).map_err(file)?;
            if preset.is_relative() && range.is_none() && scene.surface.is_none_or(|s| s.albedo.is_none()) {
                rescaled(scene, "give transfer.range = [low, high]");
            }
            preset.transfer(path, *range, volume.range().map(f64::from), *reference).map_err(file)?
        }
    })
}

/// Says once that the steps of a time series are each shown on a scale of their own.
fn rescaled(scene: &Scene, fix: &str) {
    static SAID: Once = Once::new();
    if scene.origins.animated.contains_key("volume.file") {
        SAID.call_once(|| {
            log::warn!(
                "the transfer function follows the data's own range, which may differ from file to file of this time series: one value \
                 then looks different in different frames; {fix}, to lay it on the same values in all"
            );
        });
    }
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
