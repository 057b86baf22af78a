//! Frames one after the other: what does not change between them is not computed again. A frame's bits depend on its scene
//! alone: whatever is kept is what would have been computed.

use super::fail::Failure;
use super::fingerprint;
use super::layers::{Layers, Written};
use super::load;
use super::progress::Progress;
use super::{Context, field_file};
use halflight::engine::{DeviceVolume, Engine, Field, Lit, Medium};
use halflight::scene::scene::{LightSource, TransferSource, VolumeSettings};
use halflight::scene::{Camera, Clip, Light, Matter, Probe, Scene, Visibility, Volume};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Instant;

/// The stages that a frame may pay for, in order.
pub const STAGES: [&str; 8] = ["read", "upload", "classify", "visibility", "relight", "render", "layers", "write"];

/// Wall seconds of each of [`STAGES`] that a frame paid for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Paid(pub [Option<f64>; STAGES.len()]);

impl Paid {
    /// Runs a stage and adds its time.
    pub fn time<T>(&mut self, stage: usize, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = work();
        *self.0[stage].get_or_insert(0.0) += start.elapsed().as_secs_f64();
        out
    }

    /// All stages together.
    pub fn seconds(&self) -> f64 {
        self.0.iter().flatten().sum()
    }

    /// "visibility 1.52 s, render 0.21 s".
    pub fn text(&self) -> String {
        let parts = STAGES.iter().zip(self.0).filter_map(|(name, s)| Some(format!("{name} {:.2} s", s?)));
        parts.collect::<Vec<_>>().join(", ")
    }
}

/// A volume in host memory, and what it is called by.
struct Read {
    settings: VolumeSettings,
    volume: Rc<Volume>,
    hash: String,
}

/// A medium and what it was classified from.
struct Classified {
    transfer: TransferSource,
    matter: Matter,
    clip: Clip,
    medium: Medium,
    /// What visibility depends on beside the volume.
    hash: String,
}

/// A field and what it was computed from.
struct Computed {
    volume: String,
    matter: String,
    settings: Visibility,
    field: Field,
}

/// What stays between frames.
pub struct Session<'a> {
    context: &'a Context,
    /// A field file in place of computing one.
    given: Option<PathBuf>,
    /// Keep nothing.
    fresh: bool,
    engine: Option<Engine>,
    probe: Option<(PathBuf, Probe, Light)>,
    read: Option<Read>,
    on_device: Option<DeviceVolume>,
    classified: Option<Classified>,
    computed: Option<Computed>,
    lit: Option<(Light, Lit)>,
    /// What was measured of a loaded field.
    pub field_meta: Vec<(String, String)>,
    /// The most that a scene was said to need, bytes.
    pub estimate: u64,
}

/// Called by jobs: whether to go on.
pub type Going<'a> = &'a dyn Fn() -> bool;

impl<'a> Session<'a> {
    pub fn new(context: &'a Context, given: Option<PathBuf>, fresh: bool) -> Self {
        Self {
            context,
            given,
            fresh,
            engine: None,
            probe: None,
            read: None,
            on_device: None,
            classified: None,
            computed: None,
            lit: None,
            field_meta: Vec::new(),
            estimate: 0,
        }
    }

    /// The engine, once a frame has been rendered.
    pub fn engine(&self) -> Option<&Engine> {
        self.engine.as_ref()
    }

    /// The scene's volume and its hash, read if it is another than the one before.
    pub fn volume(&mut self, scene: &Scene, paid: &mut Paid) -> Result<(Rc<Volume>, String), Failure> {
        if self.read.as_ref().is_none_or(|r| r.settings != scene.volume) {
            (self.lit, self.computed, self.classified, self.on_device, self.read) = (None, None, None, None, None);
            let volume = paid.time(0, || load::volume(scene, &Progress::silent()))?;
            let hash = paid.time(0, || fingerprint::volume(&volume));
            self.read = Some(Read { settings: scene.volume.clone(), volume: Rc::new(volume), hash });
        }
        let read = self.read.as_ref().ok_or_else(lost)?;
        Ok((read.volume.clone(), read.hash.clone()))
    }

    fn light(&mut self, scene: &Scene, paid: &mut Paid) -> Result<Light, Failure> {
        if let LightSource::Probe(path) = &scene.light.source {
            if self.probe.as_ref().is_none_or(|(known, ..)| known != path) {
                let (probe, light) = paid.time(0, || load::probe(path))?;
                self.probe = Some((path.clone(), probe, light));
            }
        } else {
            self.probe = None;
        }
        let raw = match (&self.probe, &scene.light.source) {
            (Some((.., light)), _) => *light,
            (None, LightSource::Constant(rgb)) => Light::constant(rgb.map(f64::from)),
            (None, LightSource::Probe(_)) => Light::DARK,
        };
        Ok(scene.light.prepare(&raw))
    }

    /// The picture of a scene, over its background, and what lies behind it where that is wanted.
    pub fn layers(&mut self, scene: &Scene, written: &Written, going: Going, paid: &mut Paid) -> Result<Layers, Failure> {
        if self.fresh {
            (self.lit, self.computed, self.classified, self.on_device, self.read, self.probe) = (None, None, None, None, None, None);
        }
        let light = self.light(scene, paid)?;
        let (volume, volume_hash) = self.volume(scene, paid)?;
        let blame = |e| Failure::from(scene.origins.blame(e));
        if self.engine.is_none() {
            self.engine = Some(paid.time(1, || self.context.engine())?);
        }
        let engine = self.engine.as_ref().ok_or_else(lost)?;
        if self.on_device.is_none() {
            self.on_device = Some(paid.time(1, || engine.upload(&volume))?);
        }
        let on_device = self.on_device.as_ref().ok_or_else(lost)?;
        let same = |c: &Classified| c.transfer == scene.transfer && c.matter.surface == scene.surface && c.clip == scene.clip;
        if !self.classified.as_ref().is_some_and(same) {
            let matter = paid.time(2, || load::matter(scene, &volume))?;
            let hash = fingerprint::matter(&matter, scene, &volume);
            // A field of the same hash is a field of this medium; what is lit by it is not drawn with the medium's colours.
            self.classified = None;
            let medium = paid.time(2, || engine.classify_clipped(on_device, &matter, &scene.clip)).map_err(blame)?;
            self.classified = Some(Classified { transfer: scene.transfer.clone(), matter, clip: scene.clip.clone(), medium, hash });
        }
        let classified = self.classified.as_ref().ok_or_else(lost)?;
        let mut settings = scene.visibility.clone();
        if self.given.is_none() && !scene.origins.keys.contains_key("visibility.bands") {
            settings.bands = halflight::plan::needed_bands(&light, scene.surface.as_ref()).min(settings.bands);
        }
        let kept =
            |c: &Computed| c.volume == volume_hash && c.matter == classified.hash && (c.settings == settings || self.given.is_some());
        if !self.computed.as_ref().is_some_and(kept) {
            (self.lit, self.computed) = (None, None);
            let field = match &self.given {
                Some(path) => {
                    let keys = field_file::Keys { volume: volume_hash.clone(), matter: classified.hash.clone() };
                    let loaded = paid.time(0, || field_file::read(engine, path, &volume, scene, &keys))?;
                    self.field_meta = loaded.meta;
                    loaded.field
                }
                None => {
                    let pixels = Some((scene.image.width, scene.image.height));
                    let need = engine.admit(&classified.medium, &settings, pixels).map_err(blame)?;
                    self.estimate = self.estimate.max(need.peak());
                    paid.time(3, || engine.precompute(&classified.medium, &settings, &mut job(going))).map_err(blame)?
                }
            };
            self.computed = Some(Computed { volume: volume_hash, matter: classified.hash.clone(), settings, field });
        }
        let computed = self.computed.as_ref().ok_or_else(lost)?;
        if !self.lit.as_ref().is_some_and(|(l, _)| *l == light) {
            self.lit = None;
            self.lit = Some((light, paid.time(4, || engine.relight(&computed.field, &light))?));
        }
        let (_, lit) = self.lit.as_ref().ok_or_else(lost)?;
        let aspect = scene.image.width as f64 / scene.image.height as f64;
        let camera = Camera::from_settings(&scene.camera, volume.grid(), aspect).map_err(blame)?;
        let medium = &classified.medium;
        let (mut picture, hits) =
            paid.time(5, || engine.render_with_distance(medium, lit, &camera, &scene.image, &mut job(going))).map_err(blame)?;
        let mut behind = Vec::new();
        if written.behind() {
            behind = paid.time(6, || engine.aovs(medium, lit, &camera, &scene.image, &hits, &mut job(going))).map_err(blame)?;
            if let Some(albedo) = classified.matter.surface_albedo() {
                // A surface's picture is the product of the two.
                for (b, p) in behind.iter_mut().zip(&picture.rgba).filter(|(b, _)| b.opacity > 0.0) {
                    b.albedo = albedo;
                    b.irradiance = [0, 1, 2].map(|c| if albedo[c] > 0.0 { p[c] / albedo[c] } else { 0.0 });
                }
            }
        }
        let probe = self.probe.as_ref().map(|p| &p.1);
        super::render::lay_background(scene, volume.grid(), &camera, probe, &mut picture)?;
        Ok(Layers { picture, behind })
    }
}

fn job(going: Going) -> impl FnMut(&'static str, f32) -> ControlFlow<()> {
    move |_, _| if going() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
}

fn lost() -> Failure {
    Failure { code: 1, sentence: "internal error: a stage left nothing".into() }
}
