//! Stacks of pictures: a folder, a pattern `slice_####.tif`, a TIFF of several pages, or one picture as a single slice.
//! Slices follow each other in the natural order of their names (slice_9 before slice_10). Few say how far apart their voxels
//! are: `volume.spacing` gives all three distances. The box begins at the world origin, x along rows, y along columns from the
//! top.

use super::ReadOptions;
use super::choose;
use super::limits::{bad, grid, io, quote};
use super::nifti::{as_stored, rescaled};
use super::parts::parts;
use super::samples::{self, Layout};
use super::stack_axes::Said;
use super::stack_picture::{self as picture, Contents, Form};
use crate::error::{Result, shown};
use crate::scene::Volume;
use glam::{DAffine3, DVec3};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Most files of a folder that are looked at.
const MAX_FILES: usize = 1 << 18;

pub(super) use picture::is_picture;

/// Whether a path names several pictures by a run of `#`, which stand for digits.
pub(super) fn is_pattern(path: &Path) -> bool {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    name.contains('#') && is_stack_name(&name)
}

fn is_stack_name(name: &str) -> bool {
    extension(name).is_some()
}

/// "tif" or "png".
fn extension(name: &str) -> Option<&'static str> {
    let (_, extension) = name.rsplit_once('.')?;
    match extension.to_ascii_lowercase().as_str() {
        "tif" | "tiff" => Some("tif"),
        "png" => Some("png"),
        _ => None,
    }
}

/// The regular files of a folder in natural order, hidden ones left out.
pub(super) fn files_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = |e| io(folder, "read", e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if entry.file_name().to_string_lossy().starts_with('.') || !entry.path().is_file() {
            continue;
        }
        if files.len() == MAX_FILES {
            return Err(bad(folder, format!("it holds more than {MAX_FILES} files"), "a folder with the slices alone is needed"));
        }
        files.push(entry.path());
    }
    files.sort_by(|a, b| natural(&name_of(a), &name_of(b)));
    Ok(files)
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Names in the order that people mean: runs of digits are compared as numbers.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    let run = |s: &str| s.find(|c: char| !c.is_ascii_digit()).unwrap_or(s.len());
    loop {
        let (x, y) = (run(a), run(b));
        if x > 0 && y > 0 {
            let (m, n) = (a[..x].trim_start_matches('0'), b[..y].trim_start_matches('0'));
            // With as many digits, the order of text is that of numbers.
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n)).then_with(|| x.cmp(&y));
            if order.is_ne() {
                return order;
            }
            (a, b) = (&a[x..], &b[y..]);
            continue;
        }
        let (mut p, mut q) = (a.chars(), b.chars());
        match (p.next(), q.next()) {
            (Some(c), Some(d)) if c == d => (a, b) = (p.as_str(), q.as_str()),
            (c, d) => return c.cmp(&d),
        }
    }
}

/// The pictures of a folder, in order.
pub(super) fn read_folder(folder: &Path, files: Vec<PathBuf>, options: &ReadOptions) -> Result<Volume> {
    let of = |kind: &str| files.iter().filter(|f| extension(&name_of(f)) == Some(kind)).cloned().collect::<Vec<_>>();
    let (tiff, png) = (of("tif"), of("png"));
    match (tiff.is_empty(), png.is_empty()) {
        (true, true) => Err(bad(
            folder,
            format!("it is a folder with {} files, none of them DICOM, TIFF or PNG", files.len()),
            "name a file, or the folder of a series or stack",
        )),
        (false, false) => Err(bad(
            folder,
            format!("it holds {} TIFF and {} PNG files", tiff.len(), png.len()),
            "choose some with a pattern, such as 'folder/slice_####.tif'",
        )),
        (tiffs, _) => {
            let slices = if tiffs { png } else { tiff };
            if let Some(odd) = odd_names(&slices) {
                log::warn!("{}: {odd}", shown(folder));
            }
            read_slices(folder, slices, options)
        }
    }
}

/// What is odd about names, in order, that should differ in one number which counts the slices.
fn odd_names(files: &[PathBuf]) -> Option<String> {
    // Texts and numbers in turn, a text first.
    let parts = |path: &PathBuf| {
        let (name, mut parts, mut digits) = (name_of(path), vec![String::new()], false);
        for c in name.chars() {
            if c.is_ascii_digit() != digits {
                parts.push(String::new());
                digits = !digits;
            }
            parts.last_mut().into_iter().for_each(|part| part.push(c));
        }
        parts
    };
    let names: Vec<Vec<String>> = files.iter().map(parts).collect();
    let [first, .., last] = &names[..] else { return None };
    let pair = format!("{} and {}", shown(files.first()?), shown(files.last()?));
    let alike = |a: &[String]| a.len() == first.len() && a.iter().zip(first).step_by(2).all(|(a, b)| a == b);
    if !names.iter().all(|name| alike(name)) {
        return Some(format!(
            "the names of its pictures, such as {pair}, differ in more than a number; all are taken as slices of one volume"
        ));
    }
    let varies: Vec<usize> = (1..first.len()).step_by(2).filter(|&i| names.iter().any(|name| name[i] != first[i])).collect();
    let [at] = varies[..] else {
        let mut pattern = last.clone();
        if let Some(&at) = varies.first() {
            pattern[at] = "#".repeat(pattern[at].len());
        }
        return Some(format!(
            "the names of its pictures, such as {pair}, count in {} places; all are taken as slices of one volume, in this order: a pattern \
             such as '{}' takes some",
            varies.len(),
            pattern.concat()
        ));
    };
    let number = |i: usize| names[i][at].parse::<u64>().ok();
    let gap = (1..names.len()).find(|&i| number(i - 1).zip(number(i)).is_some_and(|(a, b)| b.checked_sub(a).is_some_and(|d| d > 1)))?;
    Some(gap_after(&names[gap - 1][at], &names[gap][at]))
}

/// What is said where numbers are missing.
fn gap_after(a: &str, b: &str) -> String {
    format!("no slice has a number between {a} and {b}; the others are taken as evenly spaced")
}

/// Whether a file of a folder is one of its pictures.
pub(super) fn is_slice(path: &Path) -> bool {
    is_stack_name(&name_of(path))
}

/// The pictures that a pattern names.
pub(super) fn read_pattern(path: &Path, options: &ReadOptions) -> Result<Volume> {
    let slices = slices(path)?;
    if let Some(w) = slices.windows(2).find(|w| w[1].0 != w[0].0 + 1) {
        log::warn!("{}: {}", shown(path), gap_after(&w[0].0.to_string(), &w[1].0.to_string()));
    }
    read_slices(path, slices.into_iter().map(|s| s.1).collect(), options)
}

/// The files that a pattern names with their numbers, in the order of these.
pub(super) fn slices(path: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let name = name_of(path);
    let first = name.find('#').unwrap_or(0);
    let last = name.rfind('#').map_or(first, |i| i + 1);
    let (head, run, tail) = (&name[..first], &name[first..last], &name[last..]);
    if run.contains(|c| c != '#') {
        return Err(bad(path, "its name has # in two places", "one run of # stands for the slice's number"));
    }
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let number = |file: &Path| -> Option<u64> {
        let name = name_of(file);
        let digits = name.strip_prefix(head)?.strip_suffix(tail)?;
        // More digits than # only where the number needs them.
        let fits = digits.len() == run.len() || digits.len() > run.len() && !digits.starts_with('0');
        if fits && digits.bytes().all(|b| b.is_ascii_digit()) { digits.parse().ok() } else { None }
    };
    let mut slices: Vec<(u64, PathBuf)> = files_of(folder)?.into_iter().filter_map(|f| Some((number(&f)?, f))).collect();
    slices.sort_by_key(|s| s.0);
    if slices.is_empty() {
        return Err(bad(
            path,
            "no file of this pattern is there",
            format!("each # stands for a digit: {head}{}{tail} would be one", "0".repeat(run.len())),
        ));
    }
    Ok(slices)
}

/// One picture, or the pages of one TIFF.
pub(super) fn read_file(path: &Path, options: &ReadOptions) -> Result<Volume> {
    let Contents { form, mut pages, axes, said } = picture::contents(path)?;
    let mut options = options.clone();
    if let Some(axes) = axes {
        pages = axes.choose(path, &form, &pages, &options)?;
        options.component = None;
    }
    let load = picture::pages(path.to_owned(), form.clone(), pages.clone())?;
    read(path, &form, pages.len(), &said, &options, load)
}

/// Files of one page each.
fn read_slices(path: &Path, files: Vec<PathBuf>, options: &ReadOptions) -> Result<Volume> {
    if let [only] = &files[..] {
        return read_file(only, options);
    }
    let Contents { form, pages, said, .. } = picture::contents(&files[0])?;
    if pages.len() > 1 {
        let what = format!("it has {} pages, and there are {} files", pages.len(), files.len());
        return Err(bad(&files[0], what, "a stack has one page per file, or one file: name that file"));
    }
    let first = files[0].clone();
    let (expected, calibration) = (form.clone(), said.calibration);
    let count = files.len();
    read(path, &form, count, &said, options, move |i, bytes| {
        let Contents { form: found, pages, said, .. } = picture::contents(&files[i])?;
        if found != expected || pages.len() != 1 {
            let what = format!("it is {}, and {} is {}", found.says(pages.len()), shown(&first), expected.says(1));
            return Err(bad(&files[i], what, "all slices must have the same size and type"));
        }
        if said.calibration != calibration {
            let what = format!("its values are calibrated otherwise (ImageJ) than those of {}", shown(&first));
            return Err(bad(&files[i], what, "all slices must have the same calibration: save them as one stack"));
        }
        picture::pages(files[i].clone(), found, pages)?(0, bytes)
    })
}

fn read(
    path: &Path,
    form: &Form,
    count: usize,
    said: &Said,
    options: &ReadOptions,
    load: impl FnMut(usize, &mut Vec<u8>) -> Result<()> + 'static,
) -> Result<Volume> {
    let dims = [form.width, form.height, count];
    let given = options.spacing.or(said.spacing(count));
    let spacing = given.unwrap_or([1.0; 3]);
    if given.is_none() && count > 1 {
        log::info!("{}: slices do not say how far apart they are; voxels are taken as cubes of edge 1 (volume.spacing)", shown(path));
    }
    if let Some(function) = said.curve {
        log::warn!("{}: its calibration (ImageJ's function {function}) is not applied; values are read as they are stored", shown(path));
    }
    if form.color == picture::WHITE_FIRST {
        log::warn!(
            "{}: in its pictures small values are bright (PhotometricInterpretation 0); values are read as they are stored",
            shown(path)
        );
    }
    let grid = grid(path, dims, DAffine3::from_scale(DVec3::from(spacing)))?;
    let labels = form.labels();
    let what = format!("its pixels have {} channels ({})", form.channels, quote(form.color));
    // Of grey and coverage, grey is meant.
    let default = (form.color == "grey and alpha").then_some(0);
    let pick = choose::component(path, &what, form.channels, &labels, default, options)?;
    let (slope, intercept) = said.calibration.filter(|_| form.channels == 1).unwrap_or((1.0, 0.0));
    let replace = as_stored(path, options.nan_as, slope, intercept)?;
    let layout = Layout {
        components: form.channels,
        pick: Some(pick),
        big_endian: cfg!(target_endian = "big"),
        replace,
        ..Layout::scalar(dims, form.kind)
    };
    let each = layout.stored_bytes().unwrap_or(u64::MAX) / count as u64;
    rescaled(path, grid, samples::read(path, parts(count, each, load), &layout, options)?, slope, intercept)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_as_people_mean() {
        let mut names =
            ["s10.tif", "s9.tif", "s009.tif", "t1.tif", "s1a2.tif", "s1a10.tif", "S2.tif", "s.tif", "s100000000000000000000000.tif"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(
            names,
            ["S2.tif", "s.tif", "s1a2.tif", "s1a10.tif", "s9.tif", "s009.tif", "s10.tif", "s100000000000000000000000.tif", "t1.tif"]
        );
    }

    #[test]
    fn patterns_are_known() {
        for (name, pattern) in [("a/s_###.tif", true), ("s#.PNG", true), ("s_1.tif", false), ("###.raw", false), ("a#/s.tif", false)] {
            assert_eq!(is_pattern(Path::new(name)), pattern, "{name}");
        }
    }
}
