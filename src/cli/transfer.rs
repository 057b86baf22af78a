//! `transfer`: presets of other programs, and from one program's file to another's.

use super::Context;
use super::fail::Failure;
use super::output::{Kind, Output};
use super::path_of;
use super::report::many;
use clap::ArgMatches;
use halflight::Error;
use halflight::error::{escaped, shown};
use halflight::io::transfer::{Format, Named, Preset, choose, convert, read_presets};
use halflight::io::write_aside;
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// `halflight transfer IN [--list] [--preset NAME] [--range LOW,HIGH] [-o OUT]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let path = path_of(m, "in")?;
    let name = m.get_one::<String>("preset").map(String::as_str);
    let range = m.get_one::<[f64; 2]>("range").copied();
    let output = m.get_one::<PathBuf>("out").map(|out| target(out)).transpose()?;
    if let Some((output, _)) = &output {
        output.is_none_of(&[path])?;
    }
    let (program, presets) = read_presets(path)?;
    let list = m.get_flag("list");
    if !list {
        report.line("file", format!("{}, {} of {program}", shown(path), many(presets.len(), "preset")));
    }
    report.set("file", json!(path.display().to_string()));
    report.set("program", json!(program));
    let Some((output, format)) = output else {
        let wanted: Vec<&Named> = match name {
            // Said by the choice, where there is none of that name.
            Some(name) => presets.iter().filter(|p| p.name.eq_ignore_ascii_case(name)).collect(),
            None => presets.iter().collect(),
        };
        if let (true, Some(_)) = (wanted.is_empty(), name) {
            choose(path, presets, name)?;
            return Ok(());
        }
        wanted.iter().for_each(|named| report.text(if list { plain(&named.name) } else { format!("  {}", line(named)) }));
        if let (false, [Named { preset: Ok(preset), .. }]) = (list, &wanted[..]) {
            preset.lost().for_each(|lost| report.line("not held", plain(lost)));
            preset.length_here().iter().for_each(|length| report.line("opacities", length));
        }
        report.set("presets", wanted.iter().map(|p| object(p)).collect());
        return report.finish();
    };
    let chosen: Vec<Preset> = match (name, format.holds_many()) {
        (None, true) => {
            let (mut good, mut bad) = (Vec::new(), Vec::new());
            for named in presets {
                match named.preset {
                    Ok(preset) => good.push(preset),
                    Err(e) => bad.push(e),
                }
            }
            // One that cannot be read is said, the others are written; nothing is written where none can.
            for error in &bad {
                report.line("left out", error.to_string());
            }
            match (good.is_empty(), bad.into_iter().next()) {
                (true, Some(first)) => return Err(first.into()),
                _ => good,
            }
        }
        _ => vec![choose(path, presets, name)?],
    };
    let (text, lost) = convert(&chosen, format, range)?;
    write_aside(output.place()?, |file| {
        file.write_all(text.as_bytes()).map_err(|source| Error::Io { path: output.path.clone(), action: "write", source })
    })?;
    report.line("presets", format!("{} for {}", many(chosen.len(), "preset"), format.name()));
    match lost.is_empty() {
        true => report.line("lost", "nothing"),
        false => lost.iter().for_each(|lost| report.line("lost", plain(lost))),
    }
    report.wrote(&output.path);
    report.set("presets", chosen.iter().map(|p| json!(p.name)).collect());
    report.set("lost", json!(lost));
    report.set("output", json!(output.path.display().to_string()));
    report.finish()
}

/// The output, and the format of its extension.
fn target(out: &std::path::Path) -> Result<(Output, Format), Failure> {
    let kinds: Vec<(&str, Kind)> = Format::ALL.iter().map(|(e, _)| (*e, Kind::Transfer)).collect();
    let output = Output::check(out, &kinds)?;
    let format = Format::of(out).ok_or_else(|| Failure::usage(format!("{}: its extension is of no transfer function", shown(out))))?;
    Ok((output, format))
}

fn plain(text: &str) -> String {
    escaped(text).collect()
}

/// "'CT-Bone': 4 colours, 4 opacities, scalars -3024 to 3071".
fn line(named: &Named) -> String {
    let what = match &named.preset {
        Err(e) => format!("cannot be used: {e}"),
        Ok(p) => {
            let ([colors, opacities], [lo, hi]) = (p.points(), p.domain());
            let span = if p.is_relative() { "over the data's range".into() } else { format!("scalars {lo} to {hi}") };
            format!(
                "{}, {}, {span}",
                many(colors, "colour"),
                if opacities == 1 { "1 opacity".into() } else { format!("{opacities} opacities") }
            )
        }
    };
    format!("'{}': {what}", plain(&named.name))
}

fn object(named: &Named) -> Value {
    match &named.preset {
        Err(e) => json!({ "name": named.name, "error": e.to_string() }),
        Ok(p) => json!({
            "name": named.name, "colors": p.points()[0], "opacities": p.points()[1], "domain": p.domain(), "relative": p.is_relative(),
            "opacity_length": p.length(), "not_held": p.lost().collect::<Vec<_>>(),
        }),
    }
}
