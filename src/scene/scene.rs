//! A scene: what to show, in which light, from where, how exactly. Plain data; `io::scene` reads it from TOML.

use super::animation::{Animation, Series};
use super::camera::{CameraSettings, Rays};
use super::clip::Clip;
use super::grid::Grid;
use super::light::{Light, Probe};
use super::picture::Picture;
use super::sh::Window;
use super::transfer::{Kind, Reference, Transfer};
use super::visibility::{Visibility, Wanted};
use crate::error::{Error, Result};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A whole scene. Paths are resolved: usable as they stand.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// `[volume]`
    pub volume: VolumeSettings,
    /// `[transfer]`
    pub transfer: TransferSource,
    /// `[surface]`
    pub surface: Option<Surface>,
    /// `[clip]`
    pub clip: Clip,
    /// `[light]`
    pub light: LightSettings,
    /// `[visibility]`
    pub visibility: Visibility,
    /// The tolerance or quality that `[visibility]` asks for: a plan replaces `visibility`'s settings, but for `bands` and
    /// `cells`, and for `ratio` and `bits` where they are given.
    pub wanted: Option<Wanted>,
    /// `[camera]`
    pub camera: CameraSettings,
    /// `[image]`
    pub image: ImageSettings,
    /// `[animation]`; see [`super::scene_at`].
    pub animation: Option<Animation>,
    /// Where each key that was given stands, for the errors that only show once the data is there.
    pub origins: Origins,
}

impl Scene {
    /// The scene with its camera where it stands for a volume on `grid`, as its text holds it.
    #[must_use]
    pub fn placed(&self, grid: &Grid) -> Self {
        Self { camera: self.camera.placed(grid, self.image.aspect()), ..self.clone() }
    }

    /// The scene of a volume alone: every other setting at its default.
    pub fn of_volume(file: PathBuf) -> Self {
        Self {
            volume: VolumeSettings { file, ..VolumeSettings::default() },
            transfer: TransferSource::Ramp { reference: Reference::Voxel },
            surface: None,
            clip: Clip::default(),
            light: LightSettings::default(),
            visibility: Visibility::default(),
            wanted: None,
            camera: CameraSettings::default(),
            image: ImageSettings::default(),
            animation: None,
            origins: Origins::default(),
        }
    }
}

/// Key → where it was set: "scene.toml line 7" or "command line".
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origins {
    /// The scene file; where a key that nobody set is missing.
    pub scene: String,
    /// By dotted key.
    pub keys: BTreeMap<String, String>,
    /// What an animation changes: by key, where each keyframe of its track stands. The file of a time series, `volume.file`,
    /// has no keyframes. Shared by the scenes of all frames.
    pub animated: Arc<BTreeMap<String, Vec<String>>>,
}

impl Origins {
    /// Where `key` was set.
    pub fn of(&self, key: &str) -> &str {
        self.keys.get(key).map_or(self.scene.as_str(), String::as_str)
    }

    /// The error of a key's value.
    pub fn error(&self, key: &str, what: impl Into<String>, right: impl Into<String>) -> Error {
        Error::Scene { origin: self.of(key).into(), key: key.into(), what: what.into(), right: right.into() }
    }

    /// Whether frames of an animation differ in what a surface meets: in its value, or in the data.
    pub fn surface_moves(&self) -> bool {
        self.animated.contains_key("volume.file") || self.animated.get("surface.iso").is_some_and(|keyframes| keyframes.len() > 1)
    }

    /// An [`Error::Invalid`] about a scene's key becomes the [`Error::Scene`] that says where the key stands.
    pub fn blame(&self, error: Error) -> Error {
        match error {
            Error::Invalid { item, what, right } if super::keys::find(item).is_some() => self.error(item, what, right),
            other => other,
        }
    }
}

/// `[volume]`: the file, and what a file without header does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VolumeSettings {
    /// The file, the folder of a series or stack, or the `####` pattern of a stack; of a time series the file that is shown
    /// outside an animation.
    pub file: PathBuf,
    /// The time series, if `file` is of one.
    pub steps: Option<Series>,
    /// Which component, channel or array is the scalar: its name, or its number from 0.
    pub component: Option<String>,
    /// Which DICOM series of a folder that holds several: its SeriesInstanceUID.
    pub series: Option<String>,
    /// Voxel edges of an image stack, world units; files of other kinds say their own.
    pub spacing: Option<[f64; 3]>,
    /// The layout of a headerless file.
    pub raw: Option<RawSettings>,
    /// What NaN and infinite samples are replaced by; without it they are an error.
    pub nan_as: Option<f32>,
}

/// Layout of a headerless volume file, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct RawSettings {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// One of [`SAMPLE_TYPES`].
    pub sample_type: String,
    /// Voxel edges, world units.
    pub spacing: [f64; 3],
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
    /// Bytes before the first sample.
    pub offset: u64,
}

/// Names of sample types in a scene.
pub const SAMPLE_TYPES: [&str; 10] = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64"];

/// `[transfer]`: where the transfer function comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum TransferSource {
    /// None given: [`ramp`] over the data's range.
    Ramp {
        /// The length that its opacity is meant over.
        reference: Reference,
    },
    /// Points in the scene.
    Points(Transfer),
    /// A preset file.
    File {
        /// The file.
        path: PathBuf,
        /// Which preset of a file that holds several.
        name: Option<String>,
        /// Scalars of the preset's ends; without it, as the preset says.
        range: Option<[f64; 2]>,
        /// The length that its opacities are meant over.
        reference: Reference,
    },
}

/// The transfer function of a scene without one: light grey (albedo 0.9), opacity rising linearly from 0 at the data's
/// smallest value to 1 at its largest, per `reference`, as ParaView does at first sight.
///
/// # Errors
/// As [`Transfer::new`], for a range that is not finite or upside down.
pub fn ramp(range: [f32; 2], reference: Reference) -> Result<Transfer> {
    let [lo, hi] = range.map(f64::from);
    Transfer::from_points(&[[lo, 0.9, 0.9, 0.9, 0.0], [hi, 0.9, 0.9, 0.9, 1.0]], Kind::Opacity, reference)
}

/// `[surface]`: an opaque isosurface in place of the translucent volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Where the data is at least this, it is opaque; elsewhere vacuum. In the data's unit.
    pub iso: f64,
    /// How the surface reflects.
    pub shading: Shading,
    /// Linear RGB albedo; without it the transfer function's at `iso`.
    pub albedo: Option<[f32; 3]>,
}

/// How an isosurface turns visibility and light into radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    /// Diffuse reflection about the surface's normal: ϖ/π · ∫ V L max(0, n·ω) dω.
    #[default]
    Lambert,
    /// As the volume's: ϖ/4π · ∫ V L dω, without a normal.
    Isotropic,
}

/// What fills the volume: its transfer function, or an opaque surface coloured by it.
#[derive(Clone, Debug, PartialEq)]
pub struct Matter {
    /// Scalar → extinction and albedo.
    pub transfer: Transfer,
    /// The surface, if one is asked for.
    pub surface: Option<Surface>,
}

impl Matter {
    /// Linear RGB albedo of the surface, if there is one.
    pub fn surface_albedo(&self) -> Option<[f32; 3]> {
        self.surface.map(|s| s.albedo.unwrap_or_else(|| self.transfer.albedo(s.iso)))
    }

    /// Whether the surface lies within data of this range: above there is none, below it is the volume's whole box.
    ///
    /// # Errors
    /// [`Error::Invalid`] where it does not.
    pub fn check_surface(&self, range: [f32; 2]) -> Result<()> {
        let [lo, hi] = range;
        match self.surface {
            Some(s) if !(f64::from(lo)..=f64::from(hi)).contains(&s.iso) => Err(Error::Invalid {
                item: "surface.iso",
                what: format!("is {}, outside the data's range {lo} to {hi}", s.iso),
                right: "choose a value within the range".into(),
            }),
            _ => Ok(()),
        }
    }

    /// Whether nothing would be seen of data within `range`: no extinction anywhere, or no value reaches the surface.
    pub fn is_vacuum(&self, range: [f32; 2]) -> bool {
        match self.surface {
            Some(surface) => surface.iso > f64::from(range[1]),
            None => self.transfer.is_vacuum(range),
        }
    }
}

/// `[light]`: where light comes from, and what is done to it before it meets visibility.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSettings {
    /// Probe or constant.
    pub source: LightSource,
    /// Axis (world) and angle in degrees by which the light is turned, counter-clockwise seen against the axis.
    pub rotate: Option<(DVec3, f64)>,
    /// Factor on all radiance.
    pub scale: f64,
    /// SH bands kept, 1 to 4.
    pub bands: u32,
    /// Window against ringing.
    pub window: Windowing,
}

impl LightSettings {
    /// The light as it meets visibility: bands cut, windowed (the window is as wide as the kept bands), turned, scaled.
    pub fn prepare(&self, light: &Light) -> Light {
        let width = f64::from(self.bands);
        let window = match self.window {
            Windowing::None => Window::None,
            Windowing::Hanning => Window::Hanning(width),
            Windowing::Lanczos => Window::Lanczos(width),
            Windowing::Gauss => Window::Gauss(width),
        };
        let light = light.bands(self.bands as usize).windowed(window).scaled(self.scale);
        match self.rotate {
            Some((axis, degrees)) => light.rotated(axis, degrees),
            None => light,
        }
    }

    /// What the turned, scaled light shows in a world direction, unprojected: the background of a picture.
    pub fn background(&self, probe: Option<&Probe>, dir: DVec3) -> [f32; 3] {
        let back = match self.rotate {
            Some((axis, degrees)) => DQuat::from_axis_angle(axis, -degrees.to_radians()) * dir,
            None => dir,
        };
        let radiance = match (probe, &self.source) {
            (Some(probe), _) => probe.radiance(back),
            (None, LightSource::Constant(rgb)) => *rgb,
            (None, LightSource::Probe(_)) => [0.0; 3],
        };
        radiance.map(|v| v * self.scale as f32)
    }
}

/// Where light comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSource {
    /// A lat-long probe.
    Probe(PathBuf),
    /// The same radiance from all around, linear RGB.
    Constant([f32; 3]),
}

/// Window applied to the light's bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Windowing {
    /// None: sharpest, may ring.
    #[default]
    None,
    /// Hanning (raised cosine).
    Hanning,
    /// Lanczos (sinc).
    Lanczos,
    /// Gauss: damps least.
    Gauss,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self { source: LightSource::Constant([1.0; 3]), rotate: None, scale: 1.0, bands: 4, window: Windowing::None }
    }
}

/// `[image]`: the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSettings {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Step of the viewing ray, in voxels ([`super::Grid::voxel_length`]).
    pub step: f64,
    /// What is seen beside and through the volume.
    pub background: Background,
    /// Exposure of 8-bit pictures, stops.
    pub exposure: f64,
    /// Whether rays leap over empty blocks; the picture is the same.
    pub skip: bool,
}

impl ImageSettings {
    /// Width over height.
    pub fn aspect(&self) -> f64 {
        self.width as f64 / self.height as f64
    }
}

/// Largest picture side that is taken seriously.
pub const MAX_SIDE: usize = 16384;

impl Default for ImageSettings {
    fn default() -> Self {
        Self { width: 1024, height: 768, step: 1.0, background: Background::Transparent, exposure: 0.0, skip: true }
    }
}

/// What is seen where the volume does not cover.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Background {
    /// Nothing: the picture keeps its coverage.
    #[default]
    Transparent,
    /// One linear RGB radiance.
    Color([f32; 3]),
    /// The light itself, as the probe shows it.
    Light,
}

/// Lays `picture` over what each pixel's direction (world, length 1) shows; it is opaque afterwards.
pub fn fill_background(picture: &mut Picture, rays: &Rays, radiance: impl Fn(DVec3) -> [f32; 3]) {
    let width = picture.width.max(1);
    for (p, pixel) in picture.rgba.iter_mut().enumerate() {
        let through = 1.0 - pixel[3].clamp(0.0, 1.0);
        let behind = if through > 0.0 { radiance(rays.direction_world((p % width) as f64, (p / width) as f64)) } else { [0.0; 3] };
        for c in 0..3 {
            pixel[c] += through * behind[c];
        }
        pixel[3] = 1.0;
    }
}
