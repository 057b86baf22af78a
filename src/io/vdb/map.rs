//! Where a grid lies: OpenVDB's linear maps from index to world coordinates.

use super::super::limits::{bad, quote};
use super::stream::Stream;
use crate::error::Result;
use glam::{DAffine3, DMat3, DVec3};

const WHAT: &str = "the grid's transform";

/// Reads the transform; integer index coordinates are voxel centres.
pub(super) fn read(stream: &mut Stream) -> Result<DAffine3> {
    let kind = stream.text(WHAT)?;
    let map = match kind.as_str() {
        // Behind the scale stand voxel size and three inverses, which follow from it.
        "UniformScaleMap" | "ScaleMap" => {
            let scale = vector(stream)?;
            stream.skip(4 * 24, WHAT)?;
            DAffine3::from_scale(scale)
        }
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            let (translation, scale) = (vector(stream)?, vector(stream)?);
            stream.skip(4 * 24, WHAT)?;
            DAffine3 { matrix3: DMat3::from_diagonal(scale), translation }
        }
        "TranslationMap" => DAffine3::from_translation(vector(stream)?),
        // Row vectors times matrix: rows are the images of the axes, the fourth is the origin's.
        "AffineMap" | "UnitaryMap" => {
            let mut rows = [[0.0; 4]; 4];
            for number in rows.iter_mut().flatten() {
                *number = stream.f64(WHAT)?;
            }
            if rows.map(|r| r[3]) != [0.0, 0.0, 0.0, 1.0] {
                return Err(bad(stream.path, "its transform is a perspective one", "linear transforms are read"));
            }
            let [x, y, z, translation] = rows.map(|r| DVec3::new(r[0], r[1], r[2]));
            DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation }
        }
        "NonlinearFrustumMap" => {
            let right = "linear transforms are read: resample the grid to one, with Houdini's VDB Resample or vdb_tool";
            return Err(bad(stream.path, "its grid lies in a camera's frustum", right));
        }
        other => {
            return Err(bad(stream.path, format!("its transform is a '{}'", quote(other)), "scale, translation and affine maps are read"));
        }
    };
    Ok(map)
}

fn vector(stream: &mut Stream) -> Result<DVec3> {
    Ok(DVec3::new(stream.f64(WHAT)?, stream.f64(WHAT)?, stream.f64(WHAT)?))
}
