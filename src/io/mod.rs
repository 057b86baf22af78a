//! Files in and out: one file per format. Readers are bounded and never panic; writers write aside and rename.

pub mod exr;
mod hdr;
pub mod info;
mod limits;
mod nifti;
mod nrrd;
pub mod nrrd_field;
mod nrrd_header;
pub mod paraview;
mod paraview_color;
pub mod png;
pub mod probe;
mod raw;
mod samples;
pub mod scene;
mod scene_text;
mod settings;
pub mod volume;

pub use exr::{read_picture_exr, write_exr};
pub use info::{VolumeInfo, describe};
pub use nrrd_field::{NrrdField, read_nrrd_field, write_nrrd_field};
pub use paraview::{TransferOptions, read_transfer};
pub use png::write_png;
pub use probe::read_probe;
pub use samples::SampleType;
pub use scene::{Overrides, parse_scene, read_scene, scene_of_volume};
pub use scene_text::scene_text;
pub use settings::COMMAND_LINE;
pub use volume::{RawLayout, ReadOptions, read_volume};

use crate::error::{Error, Result};
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes a file beside `path` and renames it over `path` when `write` has succeeded: there is never a partial output.
///
/// # Errors
/// [`Error::Io`] naming `path`, or what `write` returned.
pub fn write_aside(path: &Path, write: impl FnOnce(&mut BufWriter<&std::fs::File>) -> Result<()>) -> Result<()> {
    let fail = |action| move |source| Error::Io { path: path.to_owned(), action, source };
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let file = tempfile::Builder::new().prefix(".halflight-").tempfile_in(folder).map_err(fail("create"))?;
    let mut out = BufWriter::with_capacity(1 << 20, file.as_file());
    write(&mut out)?;
    out.flush().map_err(fail("write"))?;
    drop(out);
    // A temporary file is private; an output file is as the user's other files.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644)).map_err(fail("write"))?;
    }
    file.as_file().sync_data().map_err(fail("write"))?;
    file.persist(path).map_err(|e| Error::Io { path: path.to_owned(), action: "write", source: e.error })?;
    Ok(())
}
