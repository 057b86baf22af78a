//! What a picture's file holds beside its colours, and how its numbers are stored.

use super::fail::Failure;
use super::output::{Kind, Output};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches};
use halflight::Error;
use halflight::engine::{Behind, Engine, LAYERS, Lit, Medium, Progress, layer_channels, surface_layers};
use halflight::error::shown;
use halflight::io::{self, ExrChannel, ExrCompression, ExrOptions};
use halflight::scene::{Camera, ImageSettings, Matter, Picture, Scene};
use halflight::stages::aov;
use std::path::Path;

/// How pictures are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Places in [`LAYERS`].
    aovs: Vec<usize>,
    options: ExrOptions,
}

/// A picture over its background, and what lies behind its pixels if that was asked for.
pub struct Layers {
    pub picture: Picture,
    pub behind: Vec<Behind>,
}

/// The options that say it.
pub fn args() -> [Arg; 3] {
    [
        Arg::new("aov")
            .long("aov")
            .value_name("LAYERS")
            .value_delimiter(',')
            .action(ArgAction::Append)
            .value_parser(LAYERS.map(|a| a.0))
            .help("more layers in each .exr: depth,normal,albedo,irradiance,visibility,opacity"),
        Arg::new("exr-type")
            .long("exr-type")
            .value_name("TYPE")
            .value_parser(["half", "float"])
            .default_value("float")
            .help("numbers of an .exr; depth stays float"),
        Arg::new("compression")
            .long("compression")
            .value_name("HOW")
            .value_parser(["none", "rle", "zips", "zip", "piz"])
            .default_value("zip")
            .help("lossless compression of an .exr"),
    ]
}

impl Written {
    pub fn of(m: &ArgMatches, out: &Path) -> Result<Self, Failure> {
        let names: Vec<&String> = m.get_many("aov").map(Iterator::collect).unwrap_or_default();
        let aovs: Vec<usize> = (0..LAYERS.len()).filter(|&i| names.iter().any(|n| *n == LAYERS[i].0)).collect();
        let is_exr = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let given = |(id, _): &&(&str, &str)| m.value_source(id) == Some(ValueSource::CommandLine);
        let of_exr = [("aov", "holds the layers"), ("exr-type", "has the types"), ("compression", "has the compressions")];
        if let Some((id, does)) = of_exr.iter().find(given).filter(|_| !is_exr) {
            return Err(Failure::usage(format!("{}: only an .exr {does} of --{id}", shown(out))));
        }
        let word = |id: &str| m.get_one::<String>(id).map_or("", String::as_str);
        let options = ExrOptions {
            half: word("exr-type") == "half",
            compression: match word("compression") {
                "none" => ExrCompression::None,
                "rle" => ExrCompression::Rle,
                "zips" => ExrCompression::Zips,
                "piz" => ExrCompression::Piz,
                _ => ExrCompression::Zip,
            },
        };
        Ok(Self { aovs, options })
    }

    /// Whether something is wanted that lies behind the pixels.
    pub fn behind(&self) -> bool {
        !self.aovs.is_empty()
    }

    /// Device memory that gathering it takes, bytes.
    pub fn bytes(&self, image: &ImageSettings) -> u64 {
        if self.behind() { aov::BYTES * ((image.width * image.height) as u64).min(aov::MOST) } else { 0 }
    }

    /// What lies behind the pixels of a picture and its `hits`, if that is wanted.
    pub fn gather(
        &self,
        engine: &Engine,
        (medium, matter, lit): (&Medium, &Matter, &Lit),
        (camera, image): (&Camera, &ImageSettings),
        (picture, hits): (&Picture, &[f32]),
        progress: &mut Progress,
    ) -> Result<Vec<Behind>, Error> {
        if !self.behind() {
            return Ok(Vec::new());
        }
        let mut behind = engine.aovs(medium, lit, camera, image, hits, progress)?;
        if let Some(albedo) = matter.surface_albedo() {
            surface_layers(&mut behind, picture, albedo);
        }
        Ok(behind)
    }

    /// What tells one way of writing from another.
    pub fn text(&self) -> String {
        format!("{:?} {:?}", self.aovs.iter().map(|&i| LAYERS[i].0).collect::<Vec<_>>(), self.options)
    }

    /// Writes a picture.
    pub fn write(&self, output: &Output, layers: &Layers, scene: &Scene, meta: &[(String, String)]) -> Result<(), Failure> {
        if output.kind != Kind::Exr {
            let gain = scene.image.exposure;
            let mut meta = meta.to_vec();
            meta.push(("view".into(), format!("radiance times 2^{gain}, clamped to 0..1, sRGB (IEC 61966-2-1), no tone mapping")));
            io::write_png(output.place()?, &layers.picture, gain as f32, &meta)?;
            return Ok(());
        }
        let channels: Vec<ExrChannel> = self.aovs.iter().flat_map(|&i| layer_channels(i, &layers.behind)).map(channel).collect();
        io::write_exr_layers(output.place()?, &layers.picture, &channels, self.options, meta)?;
        Ok(())
    }
}

fn channel((name, values): (&str, Vec<f32>)) -> ExrChannel {
    ExrChannel { name: name.into(), values, full: name.starts_with("depth") }
}
