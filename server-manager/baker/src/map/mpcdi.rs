//! MPCDI, VESA's format for the calibration of several projectors: profiles 2d and 3d.
//!
//! An archive has regions, one for each projector, each with a warp map and masks. As the
//! standard, its reference library and the programs that read it have it:
//!
//! - a region is a part of the buffer, `x y xsize ysize` from 0 to 1 and from its lower left;
//! - the warp of profile 2d says for every pixel of a projector the place in its region, u to the
//!   right and v up; the third number of a pixel is not used, and often NaN;
//! - a region may be in any of several buffers, each a picture of its own;
//! - profile 3d has a frustum for each region, and the warp is a place in the frustum's picture;
//!   where it has three numbers and a unit of length, they are points on the surface;
//! - profile sl has the poses of projectors, whose lenses must be plain;
//! - alpha (how much light) and beta (how much black) are PNG whose gamma the XML says; they and
//!   the warp may have sizes of their own (§3.7).
//!
//! Display space has its axes as MPCDI has them: +X right, +Y up, −Z ahead. Angles are in degrees;
//! yaw turns to the right, pitch up and roll clockwise.

mod archive;
mod document;
mod region;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use archive::Archive;
use document::Document;
use glam::{DVec3, UVec2};
use polyptych_files::output_file;
use polyptych_wall::warp::{MapCoordinates, WarpGeometry, WarpMap};

use super::super::check;
use super::super::error::BakeError;
use super::{pfm, png_image};

pub use region::RegionFrustum;

/// Ends of the names of a channel's files.
const WARP_ENDING: &str = ".pfm";
const ALPHA_ENDING: &str = "-alpha.png";
const BETA_ENDING: &str = "-beta.png";

/// The content of an archive, after its files were written.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The profile of the archive.
    pub profile: Profile,
    /// The pictures that the projectors show, in the order of the archive.
    pub buffers: Vec<ImportedBuffer>,
    /// The projectors, in the order of the archive.
    pub regions: Vec<ImportedRegion>,
    /// Assumptions that were made, for a person to check.
    pub notes: Vec<String>,
}

/// The profiles that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// Pictures of one plane.
    TwoD,
    /// A frustum for each projector.
    ThreeD,
    /// A pose for each projector.
    ShaderLamps,
}

/// A picture that projectors show parts of.
#[derive(Clone, Debug)]
pub struct ImportedBuffer {
    /// Its id, in the letters that names of screens have; unique.
    pub name: String,
    /// In pixels.
    pub size: UVec2,
}

/// A projector of an archive.
#[derive(Clone, Debug)]
pub struct ImportedRegion {
    /// Its id, in the letters that names of channels have; unique.
    pub name: String,
    /// The place of its buffer in the list.
    pub buffer: usize,
    /// Its own pixels.
    pub size: UVec2,
    /// Its part of the buffer in pixels, from the upper left: origin and size.
    pub part: (UVec2, UVec2),
    /// The frustum of profiles 3d and sl.
    pub pyramid: Option<RegionFrustum>,
    /// The position of the lens, of profile sl, in metres.
    pub position: DVec3,
    /// The space of the warp's coordinates.
    pub space: MapCoordinates,
    /// The warp map, a PFM, by its name in the folder; none of profile sl.
    pub warp: Option<String>,
    /// The mask of light, a PNG, by its name in the folder.
    pub alpha: Option<String>,
    /// The light that is there anyway, a PNG, by its name in the folder.
    pub beta: Option<String>,
}

/// Returns the names of the files that [`import`] would write for an archive, region by region.
///
/// # Errors
/// [`BakeError`], if the text of the archive can't be read.
pub fn file_names(path: &Path) -> Result<Vec<String>, BakeError> {
    let document = Archive::open(path).and_then(|mut archive| {
        let mut notes = Vec::new();
        let text = archive.xml(path, &mut notes)?;
        document::parse(&text, &mut notes)
    });
    let document = document.map_err(|error| error.about(path))?;
    let mut files = Vec::new();
    for (region, name) in document.regions.iter().zip(region_names(&document)) {
        let maps = [
            (WARP_ENDING, document.profile != Profile::ShaderLamps),
            (ALPHA_ENDING, region.files.alpha.is_some()),
            (BETA_ENDING, region.files.beta.is_some()),
        ];
        let written = maps.into_iter().filter(|(_, is_there)| *is_there);
        files.extend(written.map(|(ending, _)| format!("{name}{ending}")));
    }
    Ok(files)
}

/// Reads an archive and writes its maps into a folder, which must be there.
///
/// # Errors
/// [`BakeError`], which names the archive, the entry, what is wrong and what would be right. Files
/// that were written before stay.
pub fn import(path: &Path, folder: &Path, cancel: &AtomicBool) -> Result<Imported, BakeError> {
    import_file(path, folder, cancel).map_err(|error| error.about(path))
}

fn import_file(path: &Path, folder: &Path, cancel: &AtomicBool) -> Result<Imported, BakeError> {
    let mut archive = Archive::open(path)?;
    let mut notes = Vec::new();
    let text = archive.xml(path, &mut notes)?;
    let document = document::parse(&text, &mut notes)?;
    if document.profile == Profile::ShaderLamps {
        notes.push(
            "profile sl says nothing of the surface that is lit: put the screen where it stands, \
             or give it a mesh"
                .to_owned(),
        );
    }
    let mut regions: Vec<ImportedRegion> = Vec::new();
    for (region, name) in document.regions.iter().zip(region_names(&document)) {
        check(cancel)?;
        let maps = region::read(&mut archive, &document, region, &mut notes)?;
        let write = |ending: &str, bytes: &[u8]| {
            let file = format!("{name}{ending}");
            let at: PathBuf = folder.join(&file);
            output_file::write(&at, bytes).map_err(|error| BakeError::io(&at, error))?;
            Ok::<_, BakeError>(file)
        };
        let mask = |mask: &Option<polyptych_wall::warp::Mask>, ending: &str| {
            let Some(mask) = mask else { return Ok(None) };
            let png = png_image::encode_linear(mask.size, mask.components, &mask.texels)?;
            write(ending, &png).map(Some)
        };
        let pfm = match &maps.warp {
            Some(WarpMap { space, shape: WarpGeometry::Grid(grid) }) => {
                Some(pfm::write(*space, grid))
            }
            _ => None,
        };
        regions.push(ImportedRegion {
            buffer: region.buffer,
            size: region.size,
            part: document.part(region),
            pyramid: region.pyramid,
            position: maps.position,
            space: maps.warp.as_ref().map_or(MapCoordinates::Display, |warp| warp.space),
            warp: pfm.map(|bytes| write(WARP_ENDING, &bytes)).transpose()?,
            alpha: mask(&maps.alpha, ALPHA_ENDING)?,
            beta: mask(&maps.beta, BETA_ENDING)?,
            name,
        });
    }
    // Names of a file may hold anything.
    for note in &mut notes {
        *note = note.replace(char::is_control, " ");
    }
    notes.sort();
    notes.dedup();
    let mut buffers: Vec<ImportedBuffer> = Vec::new();
    for document::Buffer { id, size } in &document.buffers {
        let name = name_of(id, |name| buffers.iter().any(|known| known.name == name));
        buffers.push(ImportedBuffer { name, size: *size });
    }
    Ok(Imported { profile: document.profile, buffers, regions, notes })
}

/// The names of channels for the regions of an archive, in its order; each is unique.
fn region_names(document: &Document) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for region in &document.regions {
        let name = name_of(&region.id, |name| names.iter().any(|known| known == name));
        names.push(name);
    }
    names
}

/// A name of a channel that is like the region's id.
fn name_of(id: &str, is_taken: impl Fn(&str) -> bool) -> String {
    const BYTES_MAX: usize = 48;
    let letter = |c: char| match c.to_ascii_lowercase() {
        c if c.is_ascii_alphanumeric() || "-_".contains(c) => c,
        _ => '-',
    };
    let name: String = id.chars().take(BYTES_MAX).map(letter).collect();
    let name = name.trim_matches('-');
    let name = if name.is_empty() { "region" } else { name };
    let mut unique = name.to_owned();
    for number in 2.. {
        if !is_taken(&unique) {
            break;
        }
        unique = format!("{name}-{number}");
    }
    unique
}

/// The corners of the plane that a frustum of profile 3d looks through, `distance` metres from
/// `eye`: lower left, lower right and upper left.
pub fn corners(pyramid: &RegionFrustum, eye: DVec3, distance: f64) -> [DVec3; 3] {
    let turn = pyramid.display_from_view();
    let [left, right, down, up] = pyramid.tangents().map(|tangent| tangent * distance);
    [(left, down), (right, down), (left, up)].map(|(x, y)| eye + turn * DVec3::new(x, y, -distance))
}
