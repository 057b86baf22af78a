//! Visibility fields as 4-D NRRD files: `coefficients x y z`, 32-bit floats, so that other programs can read them.

use super::field_keys::little_endian;
use super::limits::{bad, open};
use super::nrrd::{data as samples_of, dims as dims_of, place};
use super::nrrd_header::{self as header, Encoding};
use super::samples::{self, Layout};
use super::{ReadOptions, write_aside};
use crate::error::{Error, Result};
use crate::scene::{Grid, Samples};
use glam::{DMat3, DVec3};
use std::io::Write;
use std::path::Path;

/// A field read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct NrrdField {
    /// SH coefficients per cell.
    pub coefficients: usize,
    /// Cells along x, y, z and their place: the box is that of the volume.
    pub grid: Grid,
    /// Coefficient fastest, then x, y, z.
    pub data: Vec<f32>,
    /// The `key:=value` lines.
    pub meta: Vec<(String, String)>,
}

/// Writes a field of `dims` cells with `coefficients` numbers each (coefficient fastest, then x, y, z), which covers the
/// box of the volume's `grid` evenly (see [`Grid::field_dims`]). `meta` becomes `key:=value` lines. The file appears whole
/// or not at all.
///
/// # Errors
/// [`Error::Invalid`] for a length of `data` that does not fit, for numbers that are not finite, and for a key or value
/// that NRRD cannot hold; [`Error::Io`] from the system.
pub fn write_nrrd_field(
    path: &Path,
    dims: [usize; 3],
    coefficients: usize,
    data: &[f32],
    grid: &Grid,
    meta: &[(String, String)],
) -> Result<()> {
    let invalid = |item, what: String, right: &str| Err(Error::Invalid { item, what, right: right.into() });
    let needs = dims.iter().chain([&coefficients]).try_fold(1usize, |p, &n| p.checked_mul(n));
    if needs != Some(data.len()) || data.is_empty() {
        let what = format!("{} numbers for {coefficients} coefficients of {}x{}x{} cells", data.len(), dims[0], dims[1], dims[2]);
        return invalid("field", what, "their product is needed, and must not be 0");
    }
    // Parts without a way out are gone through many numbers at once.
    let odd = |part: &[f32]| part.iter().fold(false, |odd, v| odd | !v.is_finite());
    if data.chunks(1 << 12).any(odd)
        && let Some(i) = data.iter().position(|v| !v.is_finite())
    {
        return invalid("field", format!("number {i} is {}", data[i]), "all must be finite");
    }
    let mut lines = String::new();
    for (key, value) in meta {
        // What a reader would take for a comment or a field, or could not tell from the separator.
        let odd = |c: char| c.is_control() && c != '\n';
        if key.trim() != key || key.is_empty() || key.starts_with('#') || key.contains(':') || key.contains(odd) {
            return invalid(
                "field meta",
                format!("the key {key:?}"),
                "keys have no colon, no control characters, no outer blanks, and do not begin with #",
            );
        }
        if value.contains(odd) {
            return invalid("field meta", format!("the value {value:?} of '{key}'"), "values have no control characters beside line feeds");
        }
        lines += &format!("{}:={}\n", escape(key), escape(value));
    }
    let cells = cell_grid(grid, dims)?;
    let map = cells.voxel_to_world();
    let first = map.transform_point3(DVec3::splat(0.5));
    let vector = |v: DVec3| format!("({:?},{:?},{:?})", v.x, v.y, v.z);
    let head = format!(
        "NRRD0004\n# SH visibility field: coefficient l(l+1)+m fastest, then x, y, z\ntype: float\ndimension: 4\nspace dimension: 3\n\
         sizes: {coefficients} {} {} {}\nspace directions: none {} {} {}\nkinds: vector domain domain domain\nendian: little\n\
         encoding: raw\nspace origin: {}\n{lines}\n",
        dims[0],
        dims[1],
        dims[2],
        vector(map.matrix3.x_axis),
        vector(map.matrix3.y_axis),
        vector(map.matrix3.z_axis),
        vector(first),
    );
    write_aside(path, |out| {
        let fail = |source| Error::Io { path: path.to_owned(), action: "write", source };
        out.write_all(head.as_bytes()).map_err(fail)?;
        little_endian(data).try_for_each(|bytes| out.write_all(&bytes)).map_err(fail)
    })
}

/// Whether a file is a field as [`write_nrrd_field`] writes it, by its header.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Format`] when it is no regular file.
pub fn is_nrrd_field(path: &Path) -> Result<bool> {
    let (mut file, _) = open(path)?;
    // What has no readable header is for the readers of volumes to refuse.
    let Ok(header) = header::read(path, &mut file) else { return Ok(false) };
    let apart = header.kinds.first().is_some_and(|k| k == "vector") && header.directions.as_ref().is_some_and(|d| d[0].is_none());
    Ok(apart && header.sizes.len() == 4 && header.kind == samples::SampleType::F32 && matches!(header.sizes[0], 1 | 4 | 9 | 16))
}

/// The grid of `dims` cells over the box of `grid`.
fn cell_grid(grid: &Grid, dims: [usize; 3]) -> Result<Grid> {
    let n = grid.dims();
    let scale = DVec3::from_array(std::array::from_fn(|a| n[a] as f64 / dims[a] as f64));
    let mut map = grid.voxel_to_world();
    map.matrix3 *= DMat3::from_diagonal(scale);
    Grid::new(dims, map)
}

/// Reads a field that [`write_nrrd_field`] wrote, or any 4-D float NRRD with the coefficients on its first axis.
/// Of `options`, `max_bytes`, `allow_outside` and `progress` matter.
///
/// # Errors
/// As [`super::read_volume`].
pub fn read_nrrd_field(path: &Path, options: &ReadOptions) -> Result<NrrdField> {
    let (mut file, length) = open(path)?;
    let header = header::read(path, &mut file)?;
    let axes = [Some(1), Some(2), Some(3)];
    let what = format!("it has {} axes of type {}", header.sizes.len(), header.kind.name());
    if header.sizes.len() != 4 || header.kind != samples::SampleType::F32 {
        return Err(bad(path, what, "a field has 4 (coefficients, x, y, z), of type float"));
    }
    let coefficients = usize::try_from(header.sizes[0]).ok().filter(|n| matches!(n, 1 | 4 | 9 | 16));
    let coefficients = coefficients
        .ok_or_else(|| bad(path, format!("its first axis has {}", header.sizes[0]), "1, 4, 9 or 16 SH coefficients are needed"))?;
    let dims = dims_of(path, &header, axes)?;
    let grid = place(path, &header, axes, dims)?;
    let layout = Layout {
        components: coefficients,
        big_endian: header.big_endian,
        text: header.encoding == Encoding::Text,
        ..Layout::scalar(dims, header.kind)
    };
    let (data_path, source) = samples_of(path, file, length, &header, &layout, options)?;
    match samples::read(&data_path, source, &layout, options)? {
        Samples::F32(data) => Ok(NrrdField { coefficients, grid, data, meta: header.meta }),
        _ => Err(bad(path, what, "a field is of type float")),
    }
}

/// NRRD's escapes of keys and values.
fn escape(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n")
}
