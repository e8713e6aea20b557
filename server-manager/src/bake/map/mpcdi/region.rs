//! One region's files: the warp in our spaces, the masks in linear light.

use glam::{DQuat, DVec3, Vec3};
use polyptych_protocol::wall::warp::{MapSpace, Mask, WarpMap};

use super::super::super::error::BakeError;
use super::super::super::uri::shorten;
use super::super::{mask, pfm, picture};
use super::Profile;
use super::archive::Archive;
use super::document::{Document, MaskFile, Region, WarpFile, place};

/// The viewing pyramid of a region of profile 3d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pyramid {
    /// Yaw (to the right), pitch (up) and roll (clockwise), in degrees.
    pub turn: [f64; 3],
    /// Left, right, down and up from the axis, in degrees; left and down are usually negative.
    pub angles: [f64; 4],
}

impl Pyramid {
    /// The rotation from the frustum's own axes, looking along −Z, to display space: yaw about +Y
    /// last, as it is said in the order in which a head turns.
    pub fn display_from_view(&self) -> DQuat {
        let [yaw, pitch, roll] = self.turn.map(f64::to_radians);
        DQuat::from_rotation_y(-yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(-roll)
    }
}

/// The decoded files of a region.
pub(super) struct Maps {
    pub warp: WarpMap,
    pub alpha: Option<Mask>,
    pub beta: Option<Mask>,
}

pub(super) fn read(
    archive: &mut Archive,
    document: &Document,
    region: &Region,
    notes: &mut Vec<String>,
) -> Result<Maps, BakeError> {
    let set = format!("mpcdi.xml fileset of {}", place(&region.id));
    let Some(file) = &region.files.warp else {
        let right = "one for each region would be right";
        return Err(BakeError::at(set, "it has no geometryWarpFile", right));
    };
    let bytes = archive.entry(&file.path, &format!("{set} geometryWarpFile"))?;
    let shown = format!("entry '{}'", shorten(&file.path));
    let warp = warp(&bytes, document, region, file, notes).map_err(|error| error.within(&shown))?;
    let mut mask_of = |file: &Option<MaskFile>, kind: &str| {
        let Some(file) = file else { return Ok(None) };
        let bytes = archive.entry(&file.path, &format!("{set} {kind}"))?;
        let shown = format!("entry '{}'", shorten(&file.path));
        read_mask(&bytes, region, file).map(Some).map_err(|error| error.within(&shown))
    };
    let (alpha, beta) =
        (mask_of(&region.files.alpha, "alphaMap")?, mask_of(&region.files.beta, "betaMap")?);
    Ok(Maps { warp, alpha, beta })
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
        let origin = origin_of(file, notes)?;
        let convert = |value: Vec3| (value.as_dvec3() * metres + origin).as_vec3();
        return map.map(MapSpace::Display, convert);
    }
    // Profile 2d: a place in the region's part of the buffer. Profile 3d: in its own picture.
    let (origin, extent) = match document.profile {
        Profile::TwoD => (region.origin.as_vec2(), region.extent.as_vec2()),
        Profile::ThreeD => (glam::Vec2::ZERO, glam::Vec2::ONE),
    };
    map.map(MapSpace::Canvas, |value| {
        let place = origin + value.truncate() * extent;
        Vec3::new(place.x, 1.0 - place.y, 0.0)
    })
}

/// How many metres the unit has.
fn metres_of(unit: &str, notes: &mut Vec<String>) -> Result<f64, BakeError> {
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

/// Where the origin of the points lies, seen from ours, which is the eye.
fn origin_of(file: &WarpFile, notes: &mut Vec<String>) -> Result<DVec3, BakeError> {
    let is = |name: &str| file.origin.eq_ignore_ascii_case(name);
    let where_it_is = match file.origin.as_str() {
        _ if is("idealEyePoint") => return Ok(DVec3::ZERO),
        _ if is("centerOfMass") => "in the middle of the surface",
        _ if is("floorCenter") => "on the floor",
        _ if is("") || is("unkown") || is("unknown") => "nobody knows where",
        other => {
            let what = format!("it is '{}'", shorten(other));
            let right = "idealEyePoint, centerOfMass or floorCenter would be right";
            return Err(BakeError::at("originOf3DData", what, right));
        }
    };
    notes.push(format!("the origin of the points is {where_it_is}: set the eye of the wall"));
    Ok(DVec3::ZERO)
}

fn read_mask(bytes: &[u8], region: &Region, file: &MaskFile) -> Result<Mask, BakeError> {
    let picture = picture::decode(bytes)?;
    if picture.size != region.size {
        let what = format!("it has {} × {} pixels", picture.size.x, picture.size.y);
        let right = format!("{} × {}, as its region, would be right", region.size.x, region.size.y);
        return Err(BakeError::at("PNG", what, right));
    }
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
