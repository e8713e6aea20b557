//! The foreign files of a wall: warp maps, screen meshes and masks in, decoded maps out.
//!
//! The kind of a file is seen by its first bytes or, if those say nothing, by its name:
//!
//! | file | is | what its numbers are |
//! |---|---|---|
//! | PFM | warp | points in metres, or u and v of the canvas: [`pfm`] |
//! | OBJ, glTF | warp or screen | metres at places of a picture: [`obj`], [`gltf_mesh`] |
//! | PNG | warp | u and v of the canvas in red and green: [`uv_image`] |
//! | text of five columns | warp | Paul Bourke's mesh: [`bourke`] |
//! | PNG | mask | light: [`mask`] |
//! | MPCDI | archive of all these | [`mpcdi`]; `polyptych wall import` makes a wall of it |

mod bourke;
mod foldover;
mod gltf_mesh;
mod mask;
pub mod mpcdi;
mod obj;
mod pfm;
mod png_image;
#[cfg(test)]
mod tests;
mod text;
mod uv_image;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use obj::Roles;
use polyptych_files::blob::BlobHash;
use polyptych_text::counted;
use polyptych_wall::surface_sample::SurfaceSample;
use polyptych_wall::warp::{CalibrationMap, MapCoordinates, WarpGeometry, WarpMap};
use serde::{Deserialize, Serialize};

use super::error::BakeError;
use super::{BakeCache, hex, source_file};

/// Largest file of a wall: a warp map of 8,192² points takes 768 MiB.
const MAP_FILE_BYTES_MAX: u64 = 1 << 30;

/// The use of a file of a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MapUse {
    /// The places of a channel's pixels.
    Warp {
        /// The channel's width by its height, which Bourke meshes are measured in; `None` where
        /// channels of several shapes use the file.
        aspect: Option<f64>,
        /// `true` if pixels of a PFM at (0, 0, 0) are unlit.
        dark_zeros: bool,
        /// `true` for an OBJ whose positions are places of the picture and whose UV are places of
        /// the canvas.
        sgct_roles: bool,
    },
    /// The shape of a screen: points in display space, with places on its canvas as UV.
    ScreenMesh,
    /// Factors of the pixels of a channel, or the light that they have anyway.
    Mask,
}

/// A file of a wall, as it was baked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakedMap {
    /// Its blob; 64 hexadecimal digits in JSON.
    #[serde(with = "hex")]
    pub blob: BlobHash,
    /// A description for people: "warp grid of 64 × 36 points in display space".
    pub what: String,
    /// `true` if its points lie on a canvas, and so are right for one eye only.
    pub is_for_one_eye: bool,
    /// Some places of its surface, if it has any.
    pub front: Vec<SurfaceSample>,
    /// A warning that something in it may not be meant, and what to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
}

/// Reads a file of a wall and writes its blob into the store.
///
/// # Errors
/// [`BakeError`], which names the file, the place in it, what is wrong and what would be right.
pub fn bake_map(
    path: &Path,
    used_as: MapUse,
    store: &BakeCache,
    cancel: &AtomicBool,
) -> Result<BakedMap, BakeError> {
    let map = read(path, used_as, store, cancel).map_err(|error| error.about(path))?;
    let blob = store.blobs().write(&map.encode())?;
    let is_for_one_eye =
        matches!(&map, CalibrationMap::Warp(warp) if warp.space == MapCoordinates::Canvas);
    let front = match &map {
        CalibrationMap::Warp(warp) => warp.surface_samples(),
        CalibrationMap::Mask(_) => Vec::new(),
    };
    let warning = zero_warning(&map);
    Ok(BakedMap { blob, what: describe(&map), is_for_one_eye, front, warning })
}

fn read(
    path: &Path,
    used_as: MapUse,
    store: &BakeCache,
    cancel: &AtomicBool,
) -> Result<CalibrationMap, BakeError> {
    let bytes = source_file::read(path, MAP_FILE_BYTES_MAX, "file", cancel)?;
    let gltf = || gltf_mesh::read(path, store.blobs(), cancel);
    let map = match used_as {
        MapUse::Mask => CalibrationMap::Mask(mask::read(&bytes, None)?),
        MapUse::Warp { sgct_roles: true, .. } => {
            if !has_ending(path, "obj") {
                let what = "SGCT's roles of positions and UV are those of an OBJ, which it is not";
                return Err(BakeError::at("file", what, "leave out warp_obj, or name an OBJ"));
            }
            CalibrationMap::Warp(obj::read(&bytes, Roles::Sgct)?)
        }
        _ if is_gltf(&bytes) => CalibrationMap::Warp(gltf()?),
        MapUse::ScreenMesh if has_ending(path, "obj") => {
            CalibrationMap::Warp(obj::read(&bytes, Roles::Room)?)
        }
        MapUse::ScreenMesh => {
            let what = "it is neither OBJ nor glTF";
            let right = "a mesh with positions in metres and UV on the screen would be right";
            return Err(BakeError::at("file", what, right));
        }
        MapUse::Warp { aspect, dark_zeros, .. } => {
            CalibrationMap::Warp(read_warp(path, &bytes, aspect, dark_zeros)?)
        }
    };
    // A reader's last word: what it made is as sound as what a server will decode.
    match map.fault() {
        None => Ok(map),
        Some(fault) => Err(BakeError::at("file", fault, "less would be right")),
    }
}

/// A grid with several points at the very origin, which no surface has.
fn zero_warning(map: &CalibrationMap) -> Option<String> {
    let CalibrationMap::Warp(WarpMap {
        space: MapCoordinates::Display,
        shape: WarpGeometry::Grid(grid),
    }) = map
    else {
        return None;
    };
    let zeros = grid.values.iter().filter(|value| **value == Vec3::ZERO).count();
    (zeros > 1).then(|| {
        format!(
            "{} at (0, 0, 0); if that means unlit, write warp_zero = \"dark\"",
            counted(zeros, "pixel")
        )
    })
}

fn read_warp(
    path: &Path,
    bytes: &[u8],
    aspect: Option<f64>,
    dark_zeros: bool,
) -> Result<WarpMap, BakeError> {
    match bytes {
        [b'P', b'F' | b'f', ..] | [b'p', b'f', ..] => {
            let map = pfm::read(bytes)?;
            if dark_zeros { map.with_dark_zeros() } else { map }.into_warp()
        }
        [0x89, b'P', b'N', b'G', ..] => uv_image::read(bytes),
        [b'P', b'K', 3, 4, ..] => {
            let what = "it is an archive, perhaps MPCDI";
            let right = "`polyptych wall import` makes a wall of it";
            Err(BakeError::at("file", what, right))
        }
        _ if has_ending(path, "obj") => obj::read(bytes, Roles::Room),
        _ if bytes.trim_ascii_start().first().is_some_and(u8::is_ascii_digit) => {
            bourke::read(bytes, aspect)
        }
        _ => {
            let what = "it is no kind of warp map that is known";
            let right = "PFM, OBJ, glTF, a PNG of UV or a Bourke mesh would be right";
            Err(BakeError::at("file", what, right))
        }
    }
}

fn is_gltf(bytes: &[u8]) -> bool {
    bytes.starts_with(b"glTF") || bytes.trim_ascii_start().first() == Some(&b'{')
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

fn describe(map: &CalibrationMap) -> String {
    match map {
        CalibrationMap::Warp(WarpMap { space, shape }) => {
            let space = match space {
                MapCoordinates::Canvas => "on the canvas",
                MapCoordinates::Display => "in display space",
            };
            match shape {
                WarpGeometry::Grid(grid) => {
                    format!("warp grid of {} × {} points {space}", grid.size.x, grid.size.y)
                }
                WarpGeometry::Mesh(mesh) => {
                    format!("warp mesh of {} {space}", counted(mesh.triangles.len(), "triangle"))
                }
            }
        }
        CalibrationMap::Mask(mask) => {
            let colours = if mask.components == 3 { "three colours" } else { "one colour" };
            format!("mask of {} × {} pixels in {colours}", mask.size.x, mask.size.y)
        }
    }
}
