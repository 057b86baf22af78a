//! What a picture's file holds beside its colours, and how its numbers are stored.

use super::fail::Failure;
use super::output::{Kind, Output};
use clap::{Arg, ArgAction, ArgMatches};
use halflight::engine::{Behind, LAYERS, layer_channels};
use halflight::error::shown;
use halflight::io::{self, ExrChannel, ExrCompression, ExrOptions};
use halflight::scene::{Picture, Scene};
use std::path::Path;

/// How frames are written.
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

/// The options of `frames` that say it.
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
        if !aovs.is_empty() && !is_exr {
            return Err(Failure::usage(format!("{}: only an .exr holds the layers of --aov", shown(out))));
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

    /// What tells one way of writing from another.
    pub fn text(&self) -> String {
        format!("{:?} {:?}", self.aovs.iter().map(|&i| LAYERS[i].0).collect::<Vec<_>>(), self.options)
    }

    /// Writes a frame.
    pub fn write(&self, output: &Output, layers: &Layers, scene: &Scene, meta: &[(String, String)]) -> Result<(), Failure> {
        if output.kind != Kind::Exr {
            let gain = scene.image.exposure;
            let mut meta = meta.to_vec();
            meta.push(("view".into(), format!("radiance times 2^{gain}, clamped to 0..1, sRGB (IEC 61966-2-1), no tone mapping")));
            io::write_png(&output.path, &layers.picture, gain as f32, &meta)?;
            return Ok(());
        }
        let channels: Vec<ExrChannel> = self.aovs.iter().flat_map(|&i| layer_channels(i, &layers.behind)).map(channel).collect();
        io::write_exr_layers(&output.path, &layers.picture, &channels, self.options, meta)?;
        Ok(())
    }
}

fn channel((name, values): (&str, Vec<f32>)) -> ExrChannel {
    ExrChannel { name: name.into(), values, full: name.starts_with("depth") }
}
