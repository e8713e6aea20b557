//! One region's files: the warp in our spaces, the masks in linear light.

use glam::{DMat2, DQuat, DVec2, DVec3, UVec2, Vec2, Vec3};
use polyptych_wall::warp::{MapCoordinates, Mask, WarpMap};

use super::super::super::error::BakeError;
use super::super::super::uri::shorten;
use super::super::pfm::Pfm;
use super::super::{mask, pfm, png_image};
use super::Profile;
use super::archive::Archive;
use super::document::{Document, MaskFile, Region, WarpFile, place};

/// Numbers of a map that are offsets move nothing further than this share of the region, or are
/// negative somewhere.
const OFFSET_MAX: f64 = 0.25;

/// Maximum share of the region that offsets, taken as places, cover.
const OFFSET_AREA_MAX: f64 = 0.03;

/// The viewing pyramid of a region of profile 3d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionFrustum {
    /// Yaw (to the right), pitch (up) and roll (clockwise), in degrees.
    pub turn: [f64; 3],
    /// Left, right, down and up from the axis, in degrees; left and down are usually negative.
    pub angles: [f64; 4],
}

impl RegionFrustum {
    /// Tangents of its edges from the axis: left, right, bottom, top.
    pub fn tangents(&self) -> [f64; 4] {
        self.angles.map(|angle| angle.to_radians().tan())
    }

    /// The rotation from the frustum's own axes, looking along −Z, to display space: yaw about +Y
    /// last, as it is said in the order in which a head turns.
    pub fn display_from_view(&self) -> DQuat {
        let [yaw, pitch, roll] = self.turn.map(f64::to_radians);
        DQuat::from_rotation_y(-yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(-roll)
    }
}

/// The decoded files of a region.
pub(super) struct RegionMaps {
    /// `None` of a projector that is given by its pose.
    pub warp: Option<WarpMap>,
    pub alpha: Option<Mask>,
    pub beta: Option<Mask>,
    /// The position of its lens, in metres of display space.
    pub position: DVec3,
}

pub(super) fn read(
    archive: &mut Archive,
    document: &Document,
    region: &Region,
    notes: &mut Vec<String>,
) -> Result<RegionMaps, BakeError> {
    let set = format!("mpcdi.xml fileset of {}", place(&region.id));
    let warp = match (&region.files.warp, document.profile) {
        (_, Profile::ShaderLamps) => None,
        (Some(file), _) => {
            let bytes = archive.entry(&file.path, &format!("{set} geometryWarpFile"))?;
            let shown = format!("entry '{}'", shorten(&file.path));
            let warp = warp(&bytes, document, region, file, notes);
            Some(warp.map_err(|error| error.within(&shown))?)
        }
        (None, _) => {
            notes.push(format!("{} has no geometryWarpFile: it is straight", place(&region.id)));
            Some(canvas_map(straight(), document, region)?)
        }
    };
    if let Some(path) = &region.files.distortion {
        let bytes = archive.entry(path, &format!("{set} distortionMap"))?;
        let shown = format!("entry '{}'", shorten(path));
        check_plain(&bytes).map_err(|error| error.within(&shown))?;
    }
    let mut mask_of = |file: &Option<MaskFile>, kind: &str| {
        let Some(file) = file else { return Ok(None) };
        let bytes = archive.entry(&file.path, &format!("{set} {kind}"))?;
        let shown = format!("entry '{}'", shorten(&file.path));
        read_mask(&bytes, file).map(Some).map_err(|error| error.within(&shown))
    };
    let (alpha, beta) =
        (mask_of(&region.files.alpha, "alphaMap")?, mask_of(&region.files.beta, "betaMap")?);
    Ok(RegionMaps { warp, alpha, beta, position: lens(region, document.profile, notes)? })
}

/// Returns the position of a projector's lens, in metres; the origin for profiles other than sl.
fn lens(region: &Region, profile: Profile, notes: &mut Vec<String>) -> Result<DVec3, BakeError> {
    if profile != Profile::ShaderLamps {
        return Ok(DVec3::ZERO);
    }
    let Some(position) = region.position else {
        notes
            .push(format!("{} has no coordinateFrame: it stands at the origin", place(&region.id)));
        return Ok(DVec3::ZERO);
    };
    let unit = region.files.warp.as_ref().map_or("", |file| file.unit.as_str());
    Ok(position * if unit.is_empty() { 1.0 } else { metres_of(unit, notes)? })
}

fn warp(
    bytes: &[u8],
    document: &Document,
    region: &Region,
    file: &WarpFile,
    notes: &mut Vec<String>,
) -> Result<WarpMap, BakeError> {
    let map = pfm::read(bytes)?;
    let is_coarse = map.size.cmplt(region.size).any();
    if is_coarse && !["", "linear", "unkown", "unknown"].contains(&file.interpolation.as_str()) {
        let what = format!("its interpolation is '{}'", shorten(&file.interpolation));
        let right = "linear, or a value for each pixel, would be right";
        return Err(BakeError::at("interpolation", what, right));
    }
    let has_unit = !["", "2d"].contains(&file.unit.as_str());
    if document.profile == Profile::ThreeD && has_unit && !map.is_uv() {
        let metres = metres_of(&file.unit, notes)?;
        note_origin(file, notes)?;
        let convert = |value: Vec3| (value.as_dvec3() * metres).as_vec3();
        return map.map(MapCoordinates::Display, convert);
    }
    if offsets(&map) {
        let what = "its numbers lie around 0 and do not follow the pixels: they seem to be offsets \
                    from where each pixel is";
        let right = "the place of each pixel in its region, u and v of 0 to 1, would be right";
        return Err(BakeError::at("pixels", what, right));
    }
    canvas_map(map, document, region)
}

/// Profile 2d: a place in the region's part of the buffer. Profile 3d: in its own picture.
fn canvas_map(map: Pfm, document: &Document, region: &Region) -> Result<WarpMap, BakeError> {
    let (origin, extent) = match document.profile {
        Profile::TwoD => (region.origin.as_vec2(), region.extent.as_vec2()),
        Profile::ThreeD | Profile::ShaderLamps => (Vec2::ZERO, Vec2::ONE),
    };
    map.map(MapCoordinates::Canvas, |value| {
        let place = origin + value.truncate() * extent;
        Vec3::new(place.x, 1.0 - place.y, 0.0)
    })
}

/// Each pixel at its own place; between and beside the four it goes on.
fn straight() -> Pfm {
    let values = [[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]];
    let values = values.map(|[u, v]| Vec3::new(u, v, 0.0)).to_vec();
    Pfm { size: UVec2::splat(2), components: 3, values }
}

/// Returns whether numbers are offsets and not places: as places, they would show little more than
/// one point of the region, at its lower left corner or beyond it. Decided by the plane through u
/// and v over the pixels, in least squares: of a picture that is shown whole its determinant is
/// about 1.
fn offsets(map: &Pfm) -> bool {
    let lit = map.values.iter().enumerate().filter(|(_, v)| v.x.is_finite() && v.y.is_finite());
    let at = |index: usize| {
        let pixel = UVec2::new(index as u32 % map.size.x, index as u32 / map.size.x);
        (pixel.as_dvec2() + 0.5) / map.size.as_dvec2() - 0.5
    };
    let value = |v: &Vec3| v.truncate().as_dvec2();
    let count = lit.clone().count().max(1) as f64;
    let middle = lit.clone().map(|(i, _)| at(i)).sum::<DVec2>() / count;
    let mean = lit.clone().map(|(_, v)| value(v)).sum::<DVec2>() / count;
    let (mut spread, mut along) = (DMat2::ZERO, DMat2::ZERO);
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for (index, v) in lit {
        let (place, value) = (at(index) - middle, value(v));
        spread += DMat2::from_cols(place * place.x, place * place.y);
        along += DMat2::from_cols((value - mean) * place.x, (value - mean) * place.y);
        (low, high) = (low.min(value), high.max(value));
    }
    // A line of pixels says nothing.
    if spread.determinant() <= f64::MIN_POSITIVE {
        return false;
    }
    let size = (along * spread.inverse()).determinant().abs();
    let is_small = low.abs().max(high.abs()).max_element() < OFFSET_MAX;
    size < OFFSET_AREA_MAX && (low.min_element() < 0.0 || is_small)
}

/// That a lens leaves the picture as it is: all zeros, which programs write that know no lens, or
/// each pixel's own place.
fn check_plain(bytes: &[u8]) -> Result<(), BakeError> {
    let map = pfm::read(bytes)?;
    let is_zero = map.values.iter().all(|v| v.x == 0.0 && v.y == 0.0);
    let is_own = map.values.iter().enumerate().all(|(index, v)| {
        let pixel = UVec2::new(index as u32 % map.size.x, index as u32 / map.size.x);
        let place = (pixel.as_vec2() + 0.5) / map.size.as_vec2();
        let off = (v.truncate() - Vec2::new(place.x, 1.0 - place.y)).abs() * map.size.as_vec2();
        off.max_element() <= 1.0
    });
    if is_zero || is_own {
        return Ok(());
    }
    let what = "its lens is not plain: the distortionMap moves pixels";
    let right =
        "a geometryWarpFile of profile 2d or 3d, or a lens without distortion, would be right";
    Err(BakeError::at("pixels", what, right))
}

/// Returns the number of metres in the unit.
pub(super) fn metres_of(unit: &str, notes: &mut Vec<String>) -> Result<f64, BakeError> {
    Ok(match unit {
        "mm" => 0.001,
        "cm" => 0.01,
        "dm" => 0.1,
        "m" => 1.0,
        "in" => 0.0254,
        "ft" => 0.3048,
        "yd" => 0.9144,
        // The standard's reference library has it without the first n.
        "unkown" | "unknown" => {
            notes.push("the unit of the points is not known: they were taken as metres".to_owned());
            1.0
        }
        other => {
            let what = format!("it is '{}'", shorten(other));
            let right = "mm, cm, dm, m, in, ft or yd would be right";
            return Err(BakeError::at("geometricUnit", what, right));
        }
    })
}

/// Adds a note if the points of a warp are measured from elsewhere than the eye, our origin.
///
/// # Errors
/// `originOf3DData` is none of the names that MPCDI has.
fn note_origin(file: &WarpFile, notes: &mut Vec<String>) -> Result<(), BakeError> {
    let is = |name: &str| file.origin.eq_ignore_ascii_case(name);
    let origin = match file.origin.as_str() {
        _ if is("idealEyePoint") => return Ok(()),
        _ if is("centerOfMass") => "in the middle of the surface",
        _ if is("floorCenter") => "on the floor",
        _ if is("") || is("unkown") || is("unknown") => "not known",
        other => {
            let what = format!("it is '{}'", shorten(other));
            let right = "idealEyePoint, centerOfMass or floorCenter would be right";
            return Err(BakeError::at("originOf3DData", what, right));
        }
    };
    notes.push(format!("the origin of the points is {origin}: set the eye of the wall"));
    Ok(())
}

/// A mask of any size: it is stretched over the region; *MPCDI 2.0*, §3.7.
fn read_mask(bytes: &[u8], file: &MaskFile) -> Result<Mask, BakeError> {
    let picture = png_image::decode(bytes)?;
    let said = [
        ("componentDepth", file.components, picture.components as f64),
        ("bitDepth", file.bits, f64::from(picture.bits)),
    ];
    for (name, said, found) in said {
        if let Some(said) = said.filter(|said| *said != found) {
            let what = format!("{name} is {found}, mpcdi.xml says {said}");
            return Err(BakeError::at("PNG", what, "equal numbers would be right"));
        }
    }
    mask::convert(&picture, file.gamma)
}
