//! Every key of a scene, once: the scene file's reader, the command's options and its help all come from this table.

/// One key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// Table and key: `volume.file`.
    pub name: &'static str,
    /// What its value looks like.
    pub value: &'static str,
    /// What holds when it is absent; empty when it must be given.
    pub default: &'static str,
    /// What it means, with its unit.
    pub help: &'static str,
}

const fn key(name: &'static str, value: &'static str, default: &'static str, help: &'static str) -> Key {
    Key { name, value, default, help }
}

/// The keys, table by table.
pub const KEYS: &[Key] = &[
    key(
        "volume.file",
        "PATH",
        "",
        "volume, relative to the scene file: NRRD, NIfTI, MetaImage, VTK, OpenVDB, DICOM, TIFF or PNG stack, headerless",
    ),
    key(
        "volume.component",
        "NAME|NUMBER",
        "the only one",
        "which component, channel, array or grid is the scalar, where a file holds several",
    ),
    key("volume.series", "UID", "the only one", "which DICOM series of a folder that holds several (SeriesInstanceUID)"),
    key("volume.dims", "[X, Y, Z]", "from the header", "voxels of a headerless file, x fastest"),
    key("volume.type", "TYPE", "from the header", "sample type of a headerless file: uint8, int16, float32, …"),
    key("volume.spacing", "[X, Y, Z]", "[1, 1, 1]", "voxel edges of a headerless file or an image stack, world units"),
    key("volume.endian", "little|big", "little", "byte order of a headerless file"),
    key("volume.offset", "BYTES", "0", "bytes before the first sample of a headerless file"),
    key("volume.nan_as", "VALUE", "an error", "what NaN and infinite samples are replaced by"),
    key(
        "volume.number",
        "N",
        "the first; in an animation each frame's own",
        "which file of a time series: takes the place of #### (or %04d) in volume.file",
    ),
    key("volume.numbers", "RANGE", "every frame's own", "the files of a time series that there are: \"0-500x10\""),
    key("transfer.points", "[[S, R, G, B, A], …]", "a grey ramp", "scalar, linear RGB albedo and opacity of each point, ascending"),
    key("transfer.kind", "opacity|extinction", "opacity", "what the last number of a point means"),
    key(
        "transfer.reference",
        "voxel|world|side",
        "voxel",
        "the length that opacity or extinction is meant over: one voxel, one world unit, the longest side",
    ),
    key(
        "transfer.file",
        "PATH",
        "none",
        "preset of ParaView, Slicer, Voreen, Inviwo, ImageVis3D, NiiVue or Exposure Render in place of points",
    ),
    key("transfer.name", "NAME", "the only one", "which preset of a file that holds several"),
    key("transfer.range", "[LOW, HIGH]", "as the preset says", "scalars that a preset's ends are laid on"),
    key("surface.iso", "VALUE", "no surface", "show the opaque surface where the data has this value"),
    key("surface.shading", "lambert|isotropic", "lambert", "diffuse about the normal, or without a normal as in the volume"),
    key("surface.albedo", "[R, G, B]", "the transfer function's at iso", "linear albedo of the surface"),
    key("clip.box", "[X0, Y0, Z0, X1, Y1, Z1]", "none", "what is kept, as fractions 0..1 of the volume's own sides; vacuum outside"),
    key(
        "clip.planes",
        "[[NX, NY, NZ, D], …]",
        "none",
        "half spaces n.p >= d that are kept, n taken at length 1, world axes, at most 10; vacuum beyond",
    ),
    key("clip.space", "side|world", "side", "d in longest sides from the volume's centre, or in world coordinates"),
    key("light.probe", "PATH", "none", "lat-long light probe, Radiance .hdr or .exr"),
    key("light.constant", "[R, G, B]", "[1, 1, 1]", "linear radiance from all around, in place of a probe"),
    key("light.rotate", "[X, Y, Z, DEGREES]", "none", "turns the light about a world axis"),
    key("light.scale", "FACTOR", "1", "factor on the light's radiance"),
    key("light.bands", "1|2|3|4", "4", "spherical-harmonic bands of the light that are used"),
    key("light.window", "none|hanning|lanczos|gauss", "none", "window on the light's bands against ringing"),
    key(
        "visibility.tolerance",
        "ERROR",
        "none",
        "largest field error: method (march or sweep), ratio, directions, near, step and bits are found by measuring",
    ),
    key("visibility.quality", "draft|normal|fine", "none", "tolerance 0.12, 0.06 or 0.03, and a field at 1:8, 1:4 or 1:2"),
    key(
        "visibility.method",
        "march|hierarchical|sweep",
        "sweep",
        "dense march (the reference), the paper's opacity pyramid, or swept slices",
    ),
    key("visibility.ratio", "1|2|4|8", "4", "voxels per cell of the visibility field, along each axis"),
    key("visibility.directions", "N", "128", "directions per cell"),
    key("visibility.bands", "1|2|3|4", "4", "spherical-harmonic bands of the field: 1, 4, 9 or 16 coefficients"),
    key("visibility.bits", "8|16|32", "8", "bits per stored coefficient; 32 is unpacked float"),
    key("visibility.filter", "box|product|axis|extinction", "axis", "how the opacity pyramid joins two successive cells (hierarchical)"),
    key(
        "visibility.sampling",
        "stratified|jittered",
        "stratified",
        "one well-spread set of directions, or jittered patterns (march, hierarchical)",
    ),
    key("visibility.growth", "FACTOR", "0.25", "growth of the pyramid's steps with distance (hierarchical)"),
    key("visibility.step", "VOXELS", "1", "step of the dense march, and of a sweep near its cell"),
    key("visibility.near", "SLICES", "1", "cells that a sweep marches densely before it trusts the swept value"),
    key(
        "visibility.fit",
        "POINTS",
        "0",
        "points of matter per cell that a sweep's field is fitted to, so that it reads right between cells (8); 0: none",
    ),
    key("visibility.cells", "matter|all", "matter", "cells that are computed: those within two cells of matter, or all"),
    key(
        "camera.position",
        "[X, Y, Z]",
        "from [1.6, -1.9, 1.1], the whole box in view",
        "where the camera stands, in longest sides from the volume's centre, +z up",
    ),
    key("camera.target", "[X, Y, Z]", "[0, 0, 0]", "what the middle of the picture shows, counted as the position"),
    key("camera.up", "[X, Y, Z]", "[0, 0, 1]", "direction that is up in the picture"),
    key("camera.fov", "DEGREES", "30", "vertical field of view"),
    key("camera.space", "side|world", "side", "position and target in longest sides from the centre, or in world coordinates"),
    key("camera.orbit", "[X, Y, Z, DEGREES]", "none", "turns the camera about a world axis through camera.centre"),
    key("camera.centre", "[X, Y, Z]", "the target", "centre of the orbit, counted as the position"),
    key("camera.distance", "LENGTH", "as the position says", "from the target to the camera, counted as the position"),
    key("image.width", "PIXELS", "1024", "pixels per row"),
    key("image.height", "PIXELS", "768", "rows"),
    key("image.step", "VOXELS", "1", "step of the viewing ray"),
    key("image.background", "[R, G, B]|light", "transparent", "linear radiance behind the volume, or the light itself"),
    key("image.exposure", "STOPS", "0", "exposure of 8-bit pictures"),
    key("image.skip", "true|false", "true", "leap over empty blocks; off is slower and shows the same picture"),
    key("animation.frames", "N", "no animation", "how many frames there are"),
    key("animation.first", "N", "1", "number of the first frame"),
    key("animation.rate", "FRAMES", "24", "frames a second"),
    key("animation.ease", "linear|smooth|hold", "linear", "the way from a keyframe to the next, where it does not say itself"),
    key(
        "animation.keyframe",
        "[{KEYFRAME}, …]",
        "none",
        "{ frame = N (or time = SECONDS), ease = …, camera.orbit = …, light.rotate = …, … }: values of keys at a frame",
    ),
];

/// The key of that name.
pub fn find(name: &str) -> Option<&'static Key> {
    KEYS.iter().find(|k| k.name == name)
}

/// The tables in order: "volume", "transfer", …
pub fn tables() -> Vec<&'static str> {
    let mut tables: Vec<_> = KEYS.iter().filter_map(|k| k.name.split_once('.')).map(|(table, _)| table).collect();
    tables.dedup();
    tables
}

/// The keys of a table, without its name.
pub fn keys_of(table: &str) -> Vec<&'static str> {
    KEYS.iter().filter_map(|k| k.name.split_once('.')).filter(|(t, _)| *t == table).map(|(_, k)| k).collect()
}

/// The known word that `wrong` was probably meant to be: at most a third of its letters differ.
pub fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wrong: Vec<char> = wrong.chars().take(64).collect();
    known
        .into_iter()
        .map(|k| (distance(&wrong, &k.chars().collect::<Vec<_>>()), k))
        .filter(|(d, k)| *d <= 1 + k.len() / 4)
        .min_by_key(|(d, _)| *d)
        .map(|(_, k)| k)
}

/// Levenshtein distance: insertions, deletions and replacements between two words.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
