//! Files in and out: one file per format. Readers are bounded and never panic; writers write aside and rename.

pub mod exr;
mod hdr;
pub mod info;
mod limits;
mod nifti;
mod nrrd;
pub mod nrrd_field;
mod nrrd_header;
pub mod picture;
pub mod png;
pub mod probe;
mod raw;
mod samples;
pub mod scene;
mod scene_text;
mod settings;
pub mod transfer;
mod vdb;
pub mod volume;

pub use crate::aside::{write_aside, write_target};
pub use exr::{read_picture_exr, write_exr, write_exr_with_error};
pub use info::{VolumeInfo, describe, describe_file};
pub use nrrd_field::{NrrdField, is_nrrd_field, read_nrrd_field, write_nrrd_field};
pub use picture::{PictureKind, read_picture};
pub use png::{read_picture_png, write_png};
pub use probe::{is_probe, read_probe};
pub use samples::SampleType;
pub use scene::{Overrides, parse_scene, read_scene, scene_of_volume};
pub use scene_text::scene_text;
pub use settings::COMMAND_LINE;
pub use transfer::{TransferOptions, read_transfer};
pub use volume::{RawLayout, ReadOptions, read_volume};
