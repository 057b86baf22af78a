//! What the command line of `frames` asks for.

use super::store::Store;
use crate::cli::args_keys::{OF_FRAMES, PLANNED, check_used, overrides};
use crate::cli::fail::Failure;
use crate::cli::layers::Written;
use crate::cli::output::{Folder, Inputs, Output, PICTURES};
use crate::cli::{field_file, load, path_of};
use clap::ArgMatches;
use halflight::error::shown;
use halflight::io;
use halflight::scene::frames::{Pattern, parse_frames};
use halflight::scene::scene::{LightSource, TransferSource};
use halflight::scene::visibility::{Method, Visibility};
use halflight::scene::{Scene, scene_at};
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Longest side of a preview, pixels.
const QUICK_SIDE: usize = 320;

/// What the command line asks for.
pub struct Asked {
    pub scene: Scene,
    /// The scene's file.
    file: PathBuf,
    pub frames: Vec<i64>,
    out: PathBuf,
    pattern: Option<Pattern>,
    pub written: Written,
    pub field: Option<PathBuf>,
    fields: Option<PathBuf>,
    pub skip: bool,
    pub fresh: bool,
    quick: bool,
    pub estimate: bool,
    pub said: Vec<String>,
}

impl Asked {
    pub fn of(m: &ArgMatches) -> Result<Self, Failure> {
        let path = path_of(m, "scene")?;
        let overrides = overrides(m).map_err(Failure::usage)?;
        check_used(&overrides, OF_FRAMES, "frames").map_err(Failure::usage)?;
        let mut scene = load::scene(path, &overrides)?;
        let Some(animation) = &scene.animation else {
            let right = "write [animation] with frames = N and [[animation.keyframe]] tables, or use halflight render";
            return Err(Failure::usage(format!("{}: it has no [animation]; {right}", shown(path))));
        };
        let frames: Vec<i64> = match m.get_one::<String>("frames") {
            Some(text) => parse_frames(text).map_err(|e| Failure::usage(e.to_string()))?,
            None => animation.range().collect(),
        };
        frames.iter().try_for_each(|&frame| load::check_frame(animation, frame, "--frames"))?;
        let field = field_file::given(m, &scene)?;
        // A preview has settings of its own; what the command line asks for beside it would change nothing.
        let chosen = m.get_flag("quick") && !overrides.iter().any(|(key, _)| PLANNED.contains(&key.as_str()));
        if scene.wanted.is_some() && field.is_none() && !chosen {
            return Err(Failure::usage(
                "a tolerance or quality picks settings by measuring time, and frames would differ from run to run; \
                 write the settings that halflight precompute says it chose, or give its file as --field",
            ));
        }
        // Frames are of the field that there is, whatever was wished for: their headers and hashes say so.
        if scene.wanted.is_some()
            && let Some(made) = field.as_deref().map(field_file::settings).transpose()?.flatten()
        {
            (scene.visibility, scene.wanted) = (made, None);
        }
        let out = path_of(m, "out")?.to_owned();
        Output::kind(&out, PICTURES)?;
        let pattern = Pattern::find(&out);
        if pattern.is_none() && frames.len() > 1 {
            let right = match out.file_name().and_then(|n| n.to_str()) {
                Some(_) => "give the number a place, such as f.####.exr or f.%04d.exr",
                None => "the number's place is only looked for in a name that is UTF-8",
            };
            return Err(Failure::usage(format!("{}: {} frames would all be written here; {right}", shown(&out), frames.len())));
        }
        let mut asked = Self {
            file: path.to_owned(),
            written: Written::of(m, &out)?,
            scene,
            frames,
            out,
            pattern,
            field,
            fields: m.get_one::<PathBuf>("fields").cloned(),
            skip: m.get_flag("skip-existing"),
            fresh: m.get_flag("no-reuse"),
            quick: m.get_flag("quick"),
            estimate: m.get_flag("estimate"),
            said: Vec::new(),
        };
        if asked.quick {
            asked.quicken()?;
        }
        Ok(asked)
    }

    /// A preview: a smaller picture, a coarser field of fewer directions. Says so.
    fn quicken(&mut self) -> Result<(), Failure> {
        if self.field.is_some() {
            return Err(Failure::usage("--quick computes its own field; drop --field"));
        }
        let image = &mut self.scene.image;
        let long = image.width.max(image.height);
        if long > QUICK_SIDE {
            let side = |n: usize| (n * QUICK_SIDE / long).max(1);
            (image.width, image.height) = (side(image.width), side(image.height));
        }
        let v = &self.scene.visibility;
        self.scene.wanted = None;
        self.scene.visibility = Visibility {
            method: Method::Sweep,
            ratio: 8,
            directions: 32,
            near: 1,
            fit: 0,
            step: 2.0,
            sampling: Default::default(),
            ..v.clone()
        };
        self.said.push(format!(
            "preview: {}x{} pixels, a field at 1:8 swept in 32 directions; without --quick it is as the scene says",
            image.width, image.height
        ));
        Ok(())
    }

    /// The folder of the pictures, made where it is missing. Refuses it where a frame's place is taken by what is no file, or by
    /// one that `scenes` are made of; what lies there is asked once, not of each frame.
    pub fn folder(&self, scenes: &[Scene]) -> Result<Folder, Failure> {
        let made = Folder::around(&self.path(self.frames[0]))?;
        let there: HashSet<OsString> = made.entries()?.flatten().map(|e| e.file_name()).collect();
        let paths = self.frames.iter().map(|&frame| self.path(frame));
        let mut taken = paths.filter(|p| p.file_name().is_some_and(|name| there.contains(name))).peekable();
        if taken.peek().is_some() {
            let mut inputs = vec![self.file.clone()];
            for (i, scene) in scenes.iter().enumerate() {
                if i == 0 || scene.volume.file != scenes[i - 1].volume.file {
                    inputs.extend(load::inputs(scene));
                }
            }
            inputs.extend(self.field.clone());
            let inputs = Inputs::of(inputs);
            for path in taken {
                if !path.is_file() {
                    self.output(&path)?;
                }
                inputs.spare(&path)?;
            }
        }
        Ok(made)
    }

    /// A frame's place. One that is taken by something else is no wrong usage: the pattern is right.
    pub fn output(&self, path: &Path) -> Result<Output, Failure> {
        Output::check(path, PICTURES).map_err(|f| Failure::new(3, f.sentence))
    }

    /// The folder of fields, made where it is missing.
    pub fn store(&self) -> Result<Option<Store>, Failure> {
        self.fields.as_deref().map(Store::open).transpose()
    }

    pub fn path(&self, frame: i64) -> PathBuf {
        self.pattern.as_ref().map_or_else(|| self.out.clone(), |p| p.path(frame))
    }

    pub fn scene(&self, frame: i64) -> Scene {
        scene_at(&self.scene, frame)
    }

    /// The scene as a header holds it: files in the scene's folder by their names in it.
    pub fn header_text(&self, scene: &Scene) -> String {
        let home = self.file.parent().unwrap_or(Path::new(""));
        let near = |path: &mut PathBuf| {
            if let Ok(rest) = path.strip_prefix(home) {
                *path = rest.to_owned();
            }
        };
        let mut scene = scene.clone();
        near(&mut scene.volume.file);
        if let LightSource::Probe(path) = &mut scene.light.source {
            near(path);
        }
        if let TransferSource::File { path, .. } = &mut scene.transfer {
            near(path);
        }
        io::scene_text(&scene)
    }
}
