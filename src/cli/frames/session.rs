//! Frames one after the other: what does not change between them is not computed again. A frame's bits depend on its scene
//! alone: whatever is kept is what would have been computed.

use super::forecast::field_of;
use super::store::{self, Of, Store};
use crate::cli::fail::Failure;
use crate::cli::field_file::Keys;
use crate::cli::fingerprint;
use crate::cli::layers::{Layers, Written};
use crate::cli::load;
use crate::cli::{Context, field_file};
use halflight::engine::{DeviceVolume, Engine, Field, Lit, Medium};
use halflight::io;
use halflight::scene::scene::{LightSource, TransferSource, VolumeSettings};
use halflight::scene::visibility::{Method, Sampling};
use halflight::scene::{Camera, Clip, Grid, Light, Matter, Probe, Scene, Visibility, Volume};
use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Instant;

/// The stages that a frame may pay for, in order.
pub const STAGES: [&str; 9] = ["read", "upload", "classify", "fields", "visibility", "relight", "render", "layers", "write"];
const READ: usize = 0;
const UPLOAD: usize = 1;
const CLASSIFY: usize = 2;
/// Fields read from a folder, written to it, waited for.
pub const FIELDS: usize = 3;
pub const VISIBILITY: usize = 4;
const RELIGHT: usize = 5;
pub const RENDER: usize = 6;
const LAYERS: usize = 7;
pub const WRITE: usize = 8;

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
    /// A field file in place of computing one, and whether it turned out to be none of this.
    given: Option<PathBuf>,
    pub given_is_bad: bool,
    /// Where fields are kept beyond this run.
    store: Option<Store>,
    /// Keep nothing.
    fresh: bool,
    engine: Option<Engine>,
    probe: Option<(PathBuf, Probe, Light)>,
    read: Option<Read>,
    /// Hashes and grids of the volumes seen so far, by file: of a frame nothing else of its volume changes.
    hashes: HashMap<PathBuf, (String, Grid)>,
    on_device: Option<DeviceVolume>,
    classified: Option<Classified>,
    computed: Option<Computed>,
    lit: Option<(Light, Lit)>,
    /// What was measured of a loaded field.
    pub field_meta: Vec<(String, String)>,
    /// Where the last picture's camera stood.
    pub camera_meta: Vec<(String, String)>,
    /// Why the last picture shows nothing, or only the volume's box.
    pub unseen: Option<String>,
    /// The most that a scene was said to need, bytes.
    pub estimate: u64,
}

/// A place to stop at.
fn keep_on(going: Going) -> Result<(), Failure> {
    if going() { Ok(()) } else { Err(halflight::Error::Cancelled.into()) }
}

/// Called by jobs: whether to go on.
pub type Going<'a> = &'a dyn Fn() -> bool;

impl<'a> Session<'a> {
    pub fn new(context: &'a Context, given: Option<PathBuf>, store: Option<Store>, fresh: bool) -> Self {
        Self {
            context,
            given,
            given_is_bad: false,
            store,
            fresh,
            engine: None,
            probe: None,
            read: None,
            hashes: HashMap::new(),
            on_device: None,
            classified: None,
            computed: None,
            lit: None,
            field_meta: Vec::new(),
            camera_meta: Vec::new(),
            unseen: None,
            estimate: 0,
        }
    }

    /// The engine, once a frame has been rendered.
    pub fn engine(&self) -> Option<&Engine> {
        self.engine.as_ref()
    }

    /// The folder of fields.
    pub fn store(&self) -> Option<&Store> {
        self.store.as_ref()
    }

    /// What the scene's volume holds, and its place; it is read if this is not known.
    pub fn volume_hash(&mut self, scene: &Scene, going: Going, paid: &mut Paid) -> Result<(String, Grid), Failure> {
        match self.hashes.get(&scene.volume.file) {
            Some(known) => Ok(known.clone()),
            None => self.volume(scene, going, paid).map(|(volume, hash)| (hash, *volume.grid())),
        }
    }

    /// The scene's volume and its hash, read if it is another than the one before.
    fn volume(&mut self, scene: &Scene, going: Going, paid: &mut Paid) -> Result<(Rc<Volume>, String), Failure> {
        if self.read.as_ref().is_none_or(|r| r.settings != scene.volume) {
            (self.lit, self.computed, self.classified, self.on_device, self.read) = (None, None, None, None, None);
            let volume = paid.time(READ, || load::volume_while(scene, going))?;
            keep_on(going)?;
            let hash = paid.time(READ, || fingerprint::volume(&volume));
            self.hashes.insert(scene.volume.file.clone(), (hash.clone(), *volume.grid()));
            self.read = Some(Read { settings: scene.volume.clone(), volume: Rc::new(volume), hash });
        }
        let read = self.read.as_ref().ok_or_else(lost)?;
        Ok((read.volume.clone(), read.hash.clone()))
    }

    /// Refuses frames that need several fields where a file gives one. Volumes are read only for scenes that differ in what a field
    /// depends on.
    pub fn check_given(&mut self, frames: &[i64], scenes: &[Scene], going: Going) -> Result<(), Failure> {
        if self.given.is_none() {
            return Ok(());
        }
        let mut seen = HashSet::new();
        let distinct: Vec<_> = frames.iter().zip(scenes).filter(|(_, scene)| seen.insert(field_of(scene))).collect();
        let mut first: Option<(i64, Keys)> = None;
        for (frame, scene) in distinct.iter().filter(|_| distinct.len() > 1) {
            // What cannot be read is said of its frame.
            let Ok(keys) = self.keys(scene, going) else { continue };
            let (other, of) = first.get_or_insert((**frame, keys.clone()));
            if *of != keys {
                let what = if of.volume != keys.volume { "volume" } else { "transfer function, surface or clipping" };
                return Err(Failure::usage(format!(
                    "--field holds one field, and frame {frame} needs another than frame {other}, for its {what} differs; \
                     --fields DIR keeps one for each"
                )));
            }
        }
        Ok(())
    }

    fn keys(&mut self, scene: &Scene, going: Going) -> Result<Keys, Failure> {
        let (volume, hash) = self.volume(scene, going, &mut Paid::default())?;
        let matter = load::matter(scene, &volume)?;
        Ok(Keys { volume: hash, matter: fingerprint::matter(&matter, scene, &volume) })
    }

    /// Whether the folder holds the scene's field of another process; `None` where only reading its volume would tell.
    pub fn others_have(&self, scene: &Scene) -> Option<bool> {
        let (store, engine) = (self.store.as_ref()?, self.engine.as_ref()?);
        let read = self.read.as_ref().filter(|r| r.settings == scene.volume)?;
        let matter = load::matter(scene, &read.volume).ok()?;
        let keys = Keys { volume: read.hash.clone(), matter: fingerprint::matter(&matter, scene, &read.volume) };
        Some(store.others(&store::name(engine, &keys, &self.settings(scene, &self.known_light(scene)?))))
    }

    /// The scene's settings of visibility, with no more bands than its light needs.
    fn settings(&self, scene: &Scene, light: &Light) -> Visibility {
        let mut settings = scene.visibility.clone();
        if self.given.is_none() && !scene.origins.keys.contains_key("visibility.bands") {
            settings.bands = halflight::plan::needed_bands(light, scene.surface.as_ref()).min(settings.bands);
        }
        settings
    }

    fn light(&mut self, scene: &Scene, paid: &mut Paid) -> Result<Light, Failure> {
        match &scene.light.source {
            LightSource::Constant(_) => self.probe = None,
            LightSource::Probe(path) if self.probe.as_ref().is_some_and(|kept| kept.0 == *path) => {}
            LightSource::Probe(path) => {
                self.probe = None;
                let probe = paid.time(READ, || load::probe(scene, path))?;
                let light = Light::from_probe(&probe);
                self.probe = Some((path.clone(), probe, light));
            }
        }
        self.known_light(scene).ok_or_else(lost)
    }

    /// The scene's light, unless its probe has not been read.
    fn known_light(&self, scene: &Scene) -> Option<Light> {
        let raw = match &scene.light.source {
            LightSource::Constant(rgb) => Light::constant(rgb.map(f64::from)),
            LightSource::Probe(path) => self.probe.as_ref().filter(|kept| kept.0 == *path)?.2,
        };
        Some(scene.light.prepare(&raw))
    }

    /// The picture of a scene, over its background, and what lies behind it where that is wanted.
    pub fn layers(&mut self, scene: &Scene, written: &Written, going: Going, paid: &mut Paid) -> Result<Layers, Failure> {
        if self.fresh {
            (self.lit, self.computed, self.classified, self.on_device, self.read, self.probe) = (None, None, None, None, None, None);
        }
        let light = self.light(scene, paid)?;
        let (volume, volume_hash) = self.volume(scene, going, paid)?;
        let blame = |e| Failure::from(scene.origins.blame(e));
        if self.engine.is_none() {
            self.engine = Some(paid.time(UPLOAD, || self.context.engine())?);
        }
        let engine = self.engine.as_ref().ok_or_else(lost)?;
        keep_on(going)?;
        if self.on_device.is_none() {
            self.on_device = Some(paid.time(UPLOAD, || engine.upload(&volume))?);
        }
        let on_device = self.on_device.as_ref().ok_or_else(lost)?;
        let same = |c: &Classified| c.transfer == scene.transfer && c.matter.surface == scene.surface && c.clip == scene.clip;
        if !self.classified.as_ref().is_some_and(same) {
            let matter = paid.time(CLASSIFY, || load::matter(scene, &volume))?;
            let hash = fingerprint::matter(&matter, scene, &volume);
            // A field of the same hash is a field of this medium; what is lit by it is not drawn with the medium's colours.
            self.classified = None;
            let medium = paid.time(CLASSIFY, || engine.classify_frame(on_device, &matter, &scene.clip)).map_err(blame)?;
            self.classified = Some(Classified { transfer: scene.transfer.clone(), matter, clip: scene.clip.clone(), medium, hash });
        }
        let classified = self.classified.as_ref().ok_or_else(lost)?;
        self.unseen = load::unseen(scene, &classified.matter, &volume);
        let settings = self.settings(scene, &light);
        let kept =
            |c: &Computed| c.volume == volume_hash && c.matter == classified.hash && (c.settings == settings || self.given.is_some());
        if !self.computed.as_ref().is_some_and(kept) {
            (self.lit, self.computed) = (None, None);
            let pixels = (scene.image.width, scene.image.height);
            // Layers hold more a pixel while they are gathered.
            let layers = written.bytes(&scene.image);
            let keys = Keys { volume: volume_hash.clone(), matter: classified.hash.clone() };
            let mut need = None;
            let made = match (&self.given, &mut self.store) {
                (Some(path), _) => {
                    let loaded = paid.time(READ, || field_file::read(engine, path, &volume, scene, &keys, None));
                    self.given_is_bad = loaded.is_err();
                    let loaded = loaded?;
                    self.field_meta = loaded.meta;
                    Ok(loaded.field)
                }
                (None, None) => {
                    need = Some(engine.admit(&classified.medium, &settings, Some(pixels)).map_err(blame)?);
                    paid.time(VISIBILITY, || engine.precompute(&classified.medium, &settings, &mut job(going))).map_err(blame)
                }
                (None, Some(store)) => {
                    let of =
                        Of { engine, volume: &volume, scene: Scene { visibility: settings.clone(), wanted: None, ..scene.clone() }, keys };
                    store.field(&of, going, paid, || {
                        need = Some(engine.admit(&classified.medium, &settings, Some(pixels)).map_err(blame)?);
                        engine.precompute(&classified.medium, &settings, &mut job(going)).map_err(blame)
                    })
                }
            };
            if let (None, Ok(field)) = (need, &made) {
                need = Some(engine.need(&classified.medium, &loading(field.settings()), Some(pixels)).map_err(blame)?);
            }
            self.estimate = self.estimate.max(need.map_or(0, |n| n.peak() + layers));
            let field = made?;
            self.computed = Some(Computed { volume: volume_hash, matter: classified.hash.clone(), settings, field });
        }
        let computed = self.computed.as_ref().ok_or_else(lost)?;
        if !self.lit.as_ref().is_some_and(|(l, _)| *l == light) {
            self.lit = None;
            self.lit = Some((light, paid.time(RELIGHT, || engine.relight(&computed.field, &light))?));
        }
        let (_, lit) = self.lit.as_ref().ok_or_else(lost)?;
        let camera = Camera::from_settings(&scene.camera, volume.grid(), scene.image.aspect()).map_err(blame)?;
        self.camera_meta = io::camera_meta(&camera, scene.image.aspect()).map_err(blame)?;
        let medium = &classified.medium;
        let (mut picture, hits) =
            paid.time(RENDER, || engine.render_with_distance(medium, lit, &camera, &scene.image, &mut job(going))).map_err(blame)?;
        let mut behind = Vec::new();
        if written.behind() {
            let of = (medium, &classified.matter, lit);
            let gather = || written.gather(engine, of, (&camera, &scene.image), (&picture, &hits), &mut job(going));
            behind = paid.time(LAYERS, gather).map_err(blame)?;
        }
        let probe = self.probe.as_ref().map(|p| &p.1);
        crate::cli::render::lay_background(scene, volume.grid(), &camera, probe, &mut picture)?;
        Ok(Layers { picture, behind })
    }
}

fn job(going: Going) -> impl FnMut(&'static str, f32) -> ControlFlow<()> {
    move |_, _| if going() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
}

/// Settings whose field takes as much to make as this one does to bring back: a march of one direction.
fn loading(v: &Visibility) -> Visibility {
    Visibility { method: Method::March, sampling: Sampling::Stratified, directions: 1, ..v.clone() }
}

fn lost() -> Failure {
    Failure::new(1, "internal error: a stage left nothing")
}
