//! OpenVDB volumes (<https://www.openvdb.org>), file format 222 to 225: one scalar grid of a file, or one component of a
//! vector grid, as a dense volume over the box of its active voxels.
//!
//! Index coordinates are voxel centres in OpenVDB; world coordinates are the grid's own, through its transform. Fog
//! volumes keep their values, the background (usually 0) stands where the box holds no voxel. A level set's signed
//! distance changes its sign: **inside is positive**, so that the surface is at 0 and what is at or above an isovalue is
//! inside; its values end at plus and minus the half width of its band.

mod blosc;
mod map;
mod stream;
mod tree;
mod values;

use super::ReadOptions;
use super::choose::{component, labels};
use super::limits::{bad, check_cap, grid, quote, shape};
use crate::error::{Result, shown};
use crate::room::reserved;
use crate::scene::{Samples, Volume};
use glam::{DAffine3, DVec3};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use stream::Stream;
use values::{Coding, Kind};

/// The first bytes of every file.
const MAGIC: &[u8] = b" BDV\0\0\0\0";
/// Formats that are read: since values depend on node masks (OpenVDB 3.0, 2015).
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;
/// Most grids of a file.
const GRIDS: i32 = 1 << 16;

/// Whether a file that begins like this is OpenVDB's.
pub(super) fn is_vdb(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// Where a grid stands in the file.
struct Descriptor {
    name: String,
    tree: String,
    /// The grid that it shares its tree with, or nothing.
    parent: String,
    at: u64,
}

impl Descriptor {
    fn kind(&self) -> Option<Kind> {
        if self.parent.is_empty() { Kind::of_tree(&self.tree) } else { None }
    }

    /// "density (float)".
    fn shown(&self) -> String {
        let tree = self.tree.strip_prefix("Tree_").unwrap_or(&self.tree).replace("_5_4_3", "").replace("_HalfFloat", " as half");
        let instance = if self.parent.is_empty() { "" } else { ", an instance" };
        format!("'{}' ({tree}{instance})", self.name)
    }
}

/// Reads the grid that [`ReadOptions::component`] names, or the only scalar one. A vector's components are named with it:
/// "velocity:0".
pub(super) fn read(path: &Path, file: BufReader<File>, length: u64, options: &ReadOptions) -> Result<Volume> {
    let mut stream = Stream::new(path, file, length)?;
    let grids = descriptors(&mut stream)?;
    let (descriptor, kind, lane) = choose(path, &grids, options)?;
    stream.seek(descriptor.at, "the grid's data")?;
    let flags = stream.u32("the grid's compression")?;
    let level_set = metadata(&mut stream)?.is_some_and(|class| class == "level set");
    let map = map::read(&mut stream)?;
    let buffers = stream.i32("the tree")?;
    if buffers != 1 {
        return Err(bad(
            path,
            format!("the tree of grid {} has {buffers} buffers", descriptor.shown()),
            "it has 1, or the file is damaged",
        ));
    }
    let mut coding = Coding::new(path, flags, kind, lane, if level_set { -1.0 } else { 1.0 })?;
    let topology = stream.at();
    let extent = tree::extent(&mut stream, &mut coding)?;
    let Some(dims) = extent.dims() else {
        return Err(bad(path, format!("the grid {} has no active voxel", descriptor.shown()), "at least one is needed"));
    };
    let corner = DVec3::from(extent.lo.map(|v| v as f64)) - DVec3::splat(0.5);
    let grid = grid(path, dims, map * DAffine3::from_translation(corner))?;
    let what = format!("{} float32 samples (the box of {} active voxels)", shape(dims), extent.active);
    let count = check_cap(path, &what, grid.voxels(), 4, options.max_bytes)?;
    log::info!("{}: grid {}, {what}, {} leaves", shown(path), descriptor.shown(), extent.leaves);
    let mut samples = reserved(&format!("{}: its volume", shown(path)), count)?;
    samples.resize(count, coding.background);
    stream.seek(topology, "the tree")?;
    tree::fill(&mut stream, &mut coding, &extent, &mut samples, &|fraction| options.report(fraction))?;
    finite(path, &mut samples, dims, options)?;
    Volume::new(grid, Samples::F32(samples), 1.0, 0.0)
}

/// The header, the file's metadata, and where the grids are.
fn descriptors(stream: &mut Stream) -> Result<Vec<Descriptor>> {
    const WHAT: &str = "the header";
    let path = stream.path;
    let mut magic = [0; 8];
    stream.read(&mut magic, WHAT)?;
    if !is_vdb(&magic) {
        return Err(bad(path, "it does not begin as an OpenVDB file", "an OpenVDB file (.vdb) is needed"));
    }
    let version = stream.u32(WHAT)?;
    if !VERSIONS.contains(&version) {
        let right = format!("formats {} to {} are read (OpenVDB 3.0 and later)", VERSIONS.start(), VERSIONS.end());
        return Err(bad(path, format!("its file format is {version}"), right));
    }
    // The library's version.
    stream.skip(8, WHAT)?;
    let offsets = stream.u8(WHAT)? != 0;
    // Its uuid, as text.
    stream.skip(36, WHAT)?;
    metadata(stream)?;
    let count = stream.i32(WHAT)?;
    if !(1..=GRIDS).contains(&count) {
        return Err(bad(path, format!("it claims {count} grids"), format!("1 to {GRIDS} are read")));
    }
    if !offsets && count > 1 {
        let right = "save it as a file (openvdb::io::File), or with one grid";
        return Err(bad(path, format!("its {count} grids stand in a stream, without their places"), right));
    }
    let mut grids = Vec::new();
    for i in 0..count {
        const WHAT: &str = "the description of a grid";
        let name = stream.text(WHAT)?;
        // Behind a separator stands a number that tells grids of one name apart.
        let name = match name.split_once('\u{1e}') {
            Some(("", number)) => number.to_owned(),
            Some((name, "0")) => name.to_owned(),
            Some((name, number)) => format!("{name}[{number}]"),
            None => name,
        };
        let (tree, parent) = (stream.text(WHAT)?, stream.text(WHAT)?);
        let places = [stream.i64(WHAT)?, stream.i64(WHAT)?, stream.i64(WHAT)?];
        let here = stream.at();
        let [at, _, end] = if offsets { places.map(|p| u64::try_from(p).unwrap_or(u64::MAX)) } else { [here, here, here] };
        if at < here || end < at {
            let what = format!("grid {i} claims to stand at bytes {} to {}, before its own description", places[0], places[2]);
            return Err(bad(path, what, "the file is damaged"));
        }
        grids.push(Descriptor { name, tree, parent, at });
        if i + 1 < count {
            stream.seek(end, "the grids")?;
        }
    }
    Ok(grids)
}

/// Passes over a list of metadata; returns the text of the entry "class".
fn metadata(stream: &mut Stream) -> Result<Option<String>> {
    const WHAT: &str = "the metadata";
    let mut class = None;
    for _ in 0..stream.u32(WHAT)? {
        let (name, kind) = (stream.text(WHAT)?, stream.text(WHAT)?);
        if name == "class" && kind == "string" {
            class = Some(stream.text(WHAT)?);
        } else {
            let size = stream.u32(WHAT)?;
            stream.skip(size.into(), WHAT)?;
        }
    }
    Ok(class)
}

/// The wanted grid, its kind, and which number of each voxel; without a wish the only grid of single numbers.
fn choose<'a>(path: &Path, grids: &'a [Descriptor], options: &ReadOptions) -> Result<(&'a Descriptor, Kind, usize)> {
    let list = quote(&grids.iter().map(Descriptor::shown).collect::<Vec<_>>().join(", "));
    let of_name = |name: &str| grids.iter().find(|g| g.name == name);
    if let Some(g) = options.component.as_deref().and_then(of_name).filter(|g| g.kind().is_none()) {
        let (what, right) = match g.parent.is_empty() {
            true => (
                "is of a type that is not read".into(),
                "half, float, double, int32, int64 and vectors of three are read, in trees 5_4_3".into(),
            ),
            false => {
                let parent = quote(&g.parent);
                (format!("is an instance of '{parent}'"), format!("name '{parent}' itself: it has the same values in another place"))
            }
        };
        return Err(bad(path, format!("the grid {} {what}", quote(&g.shown())), right));
    }
    let readable: Vec<_> = grids.iter().filter_map(|g| Some((g, g.kind()?))).collect();
    let each: Vec<_> = readable.iter().flat_map(|&(g, kind)| (0..kind.lanes).map(move |lane| (g, kind, lane))).collect();
    let names: Vec<String> = readable.iter().flat_map(|(g, kind)| labels(&g.name, kind.lanes)).collect();
    if each.is_empty() {
        let right = "one of half, float, double, int32, int64, or of vectors of three of them is needed, in a tree 5_4_3";
        return Err(bad(path, format!("of its grids none is read: {list}"), right));
    }
    let mut scalar = each.iter().enumerate().filter(|(_, e)| e.1.lanes == 1).map(|(i, _)| i);
    let default = scalar.next().filter(|_| scalar.next().is_none());
    let chosen = component(path, &format!("it holds {list}"), each.len(), &names, default, options)?;
    Ok(each[chosen])
}

/// Values that are not finite, as the options say.
fn finite(path: &Path, samples: &mut [f32], dims: [usize; 3], options: &ReadOptions) -> Result<()> {
    let Some(first) = samples.iter().position(|v| !v.is_finite()) else {
        options.count_not_finite.inspect(|count| count.set(0));
        return Ok(());
    };
    let odd = samples.iter().filter(|v| !v.is_finite()).count() as u64;
    let (place, value) = ([first % dims[0], first / dims[0] % dims[1], first / dims[0] / dims[1]], samples[first]);
    let stand_in = match (options.nan_as, options.count_not_finite) {
        (Some(v), _) => {
            log::warn!("{}: {odd} samples are not finite, the first at voxel {place:?}; {v} stands for them", shown(path));
            v
        }
        (None, Some(count)) => {
            count.set(odd);
            samples.iter().copied().filter(|v| v.is_finite()).reduce(f32::min).unwrap_or(0.0)
        }
        (None, None) => {
            let what = format!("{odd} of the samples are not finite as float32, the first at voxel {place:?}: {value}");
            let right = "all must be finite; --nan-as VALUE (volume.nan_as in a scene) puts a value in their place";
            return Err(bad(path, what, right));
        }
    };
    samples.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = stand_in);
    Ok(())
}
