//! The projections of SGCT's viewports: which point of the room each place of a picture shows.
//!
//! Formulas are those of SGCT's `src/projection/*.cpp`, `viewport.cpp` and `baseviewport.cpp`,
//! brought from its cubes of planes into directions.

use anyhow::bail;
use glam::{DQuat, DVec2, DVec3};
use polyptych_wall::limits::CHANNEL_SIDE_MAX;

use super::super::super::optics::{Fisheye, equirectangular};
use super::super::mesh::Frustum;
use super::super::tree::{At, Value};
use super::{known, orientation};

/// Steepest angle of a planar picture's edge, in degrees; at 90 it would have no end.
const EDGE_DEGREES_MAX: f64 = 89.5;

/// How far the plane of a picture by angles stands unless it is said, in metres.
const DISTANCE_DEFAULT_M: f64 = 10.0;

/// Diameter of a dome where a fisheye does not say it, in metres.
const DIAMETER_DEFAULT_M: f64 = 14.8;

/// How large cylinders and spheres are that say nothing of it, in metres.
pub(super) const RADIUS_DEFAULT_M: f64 = 5.0;

/// Faces of a cube where a configuration says nothing of their size, in pixels.
const QUALITY_DEFAULT: u32 = 512;

#[derive(Clone, Debug)]
pub(super) enum Projection<'t> {
    /// Lower left, upper left and upper right corner.
    Plane([DVec3; 3]),
    /// Its middle lies at the offset from the eye.
    Fisheye {
        lens: Fisheye,
        radius: f64,
        offset: DVec3,
        crop: Crop,
        /// If false, its square is stretched over the picture.
        keeps_aspect: bool,
    },
    Equirectangular,
    /// Degrees by which it is turned, and its height in radii.
    Cylinder {
        rotation: f64,
        bottom: f64,
        radius: f64,
    },
    /// The faces that are shown, in turned cubes.
    Cube {
        faces: Vec<&'static str>,
        rotation: DQuat,
    },
    /// Four meshes of the faces of a cube.
    Mirror {
        geometry: At<'t>,
        tilt: f64,
    },
}

/// Shares of a fisheye's square that are cut off: left, right, bottom, top.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Crop(pub [f64; 4]);

/// A projection and the pixels of its own picture, if it has one beside the window's.
pub(super) struct Found<'t> {
    pub projection: Projection<'t>,
    pub pixels: Option<[u32; 2]>,
    /// Its mesh maps the display to the picture.
    pub is_texture: bool,
    /// It is a plane by angles.
    pub is_by_angles: bool,
}

impl<'t> Found<'t> {
    pub fn of(projection: Projection<'t>) -> Self {
        Self { projection, pixels: None, is_texture: false, is_by_angles: false }
    }
}

/// Returns the projection of a viewport; `None` if it has none.
pub(super) fn read<'t>(viewport: &At<'t>) -> anyhow::Result<Option<Found<'t>>> {
    let (at, kind) = if let Some(at) = viewport.get("projection") {
        let kind = at.need("type")?;
        let name = kind.text()?.to_lowercase();
        if !known::PROJECTIONS.contains(&name.as_str()) {
            let remedy = format!("these are: {}", known::PROJECTIONS.join(", "));
            return Err(kind.error(format!("there is no projection {name}"), remedy));
        }
        (at, name)
    } else {
        let named = known::PROJECTIONS.iter().find_map(|name| Some((viewport.get(name)?, *name)));
        let Some((at, name)) = named else { return Ok(None) };
        (at, name.to_owned())
    };
    at.check_keys(known::PROJECTION)?;
    at.leave_out(known::PROJECTION_LEFT_OUT);
    let by_angles = |projection| Found { is_by_angles: true, ..Found::of(projection) };
    Ok(Some(match kind.as_str() {
        "planarprojection" => by_angles(plane(&at)?),
        "texturemappedprojection" => Found { is_texture: true, ..by_angles(plane(&at)?) },
        "projectionplane" | "viewplane" => Found::of(Projection::Plane(corners(&at)?)),
        "fisheyeprojection" => Found::of(fisheye(&at)?),
        "equirectangularprojection" => Found::of(Projection::Equirectangular),
        "cylindricalprojection" => Found::of(cylinder(&at)?),
        "cubemapprojection" => cube(&at)?,
        "spoutoutputprojection" => spout(&at)?,
        "spoutflatprojection" => {
            let inner = at.need("planarprojection")?;
            inner.check_keys(known::PROJECTION)?;
            let side = |name: &str| at.get(name).map(|at| at.integer(1..=8192)).transpose();
            let pixels = side("width")?.zip(side("height")?);
            Found { pixels: pixels.map(|(w, h)| [w as u32, h as u32]), ..by_angles(plane(&inner)?) }
        }
        _ => {
            let tilt = at.number_or("tilt", 0.0)?;
            Found::of(Projection::Mirror { geometry: at.need("geometry")?, tilt })
        }
    }))
}

/// Lower left, upper left and upper right corner: by name, in XML in this order.
fn corners(at: &At<'_>) -> anyhow::Result<[DVec3; 3]> {
    if !at.tree.is_xml {
        let [a, b, c] =
            ["lowerleft", "upperleft", "upperright"].map(|name| at.need(name)?.vector());
        return Ok([a?, b?, c?]);
    }
    let found: Vec<DVec3> =
        at.list("", "pos")?.iter().map(At::vector).collect::<anyhow::Result<_>>()?;
    let Ok(corners) = <[DVec3; 3]>::try_from(found) else {
        let remedy = "write <Pos> for lower left, upper left and upper right";
        return Err(at.error("it does not have three corners", remedy));
    };
    Ok(corners)
}

/// A picture by its angles: the plane stands at a distance from the origin, not from the eye.
fn plane<'t>(at: &At<'t>) -> anyhow::Result<Projection<'t>> {
    let fov = at.need("fov")?;
    let names = ["left", "right", "down", "up", "hfov", "vfov", "distance"];
    fov.check_keys(&names)?;
    let edge = |name: &str, both: &str| -> anyhow::Result<f64> {
        let at = fov.get(name).or_else(|| fov.get(both));
        let at = at.map_or_else(|| fov.need(name), Ok)?;
        let half = if at.key.ends_with(both) { 0.5 } else { 1.0 };
        let degrees = at.number()? * half;
        if degrees.abs() > EDGE_DEGREES_MAX {
            let what = format!("an edge at {degrees} degrees, which no planar picture has");
            let remedy =
                format!("{EDGE_DEGREES_MAX} at most, or {} across", 2.0 * EDGE_DEGREES_MAX);
            return Err(at.error(what, remedy));
        }
        Ok(degrees)
    };
    let (left, right) = (edge("left", "hfov")?, edge("right", "hfov")?);
    let (down, up) = (edge("down", "vfov")?, edge("up", "vfov")?);
    if left + right <= 0.01 || down + up <= 0.01 {
        let what = format!("{} by {} degrees span no picture", left + right, down + up);
        return Err(fov.error(what, "left and right, and down and up, add up to more than 0"));
    }
    let distance = at.get("distance").or_else(|| fov.get("distance"));
    let metres = distance.as_ref().map_or(Ok(DISTANCE_DEFAULT_M), At::number)?;
    if !(0.001..=1e5).contains(&metres) {
        let at = distance.unwrap_or(fov);
        return Err(at.error(format!("found {metres}"), "0.001 to 100000 metres would be right"));
    }
    let frustum = Frustum {
        up,
        down: -down,
        left: -left,
        right,
        rotation: at.get("orientation").map_or(Ok(DQuat::IDENTITY), |at| orientation(&at))?,
        offset: at.vector_or_zero("offset")?,
        eye: None,
    };
    Ok(Projection::Plane(plane_of(&frustum, metres)))
}

/// The corners of a picture by its angles.
pub(super) fn plane_of(frustum: &Frustum, metres: f64) -> [DVec3; 3] {
    let Frustum { up, down, left, right, rotation, offset, .. } = *frustum;
    let [up, down, left, right] = [up, down, left, right].map(|angle| angle.to_radians().tan());
    let corner = |x: f64, y: f64| rotation * (DVec3::new(x, y, -1.0) * metres) + offset;
    [corner(left, down), corner(left, up), corner(right, up)]
}

/// The corners of the frustum that a mesh brings with it.
pub(super) fn plane_of_mesh(frustum: &Frustum) -> anyhow::Result<Projection<'static>> {
    let Frustum { up, down, left, right, .. } = *frustum;
    let angles = [up, down, left, right];
    let is_right = angles.iter().all(|angle| angle.abs() <= EDGE_DEGREES_MAX);
    if !is_right || right - left < 0.01 || up - down < 0.01 {
        bail!(
            "the mesh's frustum is {left} to {right} and {down} to {up} degrees; rising angles \
             within {EDGE_DEGREES_MAX} would be right"
        );
    }
    Ok(Projection::Plane(plane_of(frustum, DISTANCE_DEFAULT_M)))
}

fn fisheye<'t>(at: &At<'t>) -> anyhow::Result<Projection<'t>> {
    let lens =
        Fisheye { degrees: at.number_or("fov", 180.0)?, tilt_degrees: at.number_or("tilt", 0.0)? };
    lens.check().map_err(|error| {
        let text = error.to_string();
        let (what, remedy) = text.split_once("; ").unwrap_or((&text, "another would be right"));
        at.get("fov").unwrap_or_else(|| at.clone()).error(what, remedy)
    })?;
    let diameter = at.number_or("diameter", DIAMETER_DEFAULT_M)?;
    if !(0.01..=2000.0).contains(&diameter) {
        let at = at.need("diameter")?;
        return Err(at.error(format!("found {diameter}"), "0.01 to 2000 metres would be right"));
    }
    let mut crop = Crop::default();
    if let Some(at) = at.get("crop") {
        at.check_keys(&["left", "right", "bottom", "top"])?;
        for (share, name) in crop.0.iter_mut().zip(["left", "right", "bottom", "top"]) {
            *share = at.number_or(name, 0.0)?;
        }
        let [left, right, bottom, top] = crop.0;
        if crop.0.iter().any(|share| !(0.0..=1.0).contains(share))
            || left + right >= 1.0
            || bottom + top >= 1.0
        {
            let remedy = "shares of 0 to 1, opposite ones less than 1 together, would be right";
            return Err(at.error("the crop leaves nothing", remedy));
        }
    }
    // The shader subtracts the offset from directions with y down and z along the axis.
    let given = at.vector_or_zero("offset")?;
    let offset = lens.rotation() * DVec3::new(-given.x, given.y, given.z);
    let keeps_aspect = at.get("keepaspectratio").map_or(Ok(true), |at| at.flag())?;
    Ok(Projection::Fisheye { lens, radius: diameter / 2.0, offset, crop, keeps_aspect })
}

fn cylinder<'t>(at: &At<'t>) -> anyhow::Result<Projection<'t>> {
    let rotation = at.number_or("rotation", 0.0)?;
    let bottom = at.number_or("heightoffset", 0.0)?;
    let radius = at.number_or("radius", RADIUS_DEFAULT_M)?;
    let is_right = (0.01..=1000.0).contains(&radius) && bottom.abs() <= 1000.0;
    if !is_right || rotation.abs() > 3600.0 {
        let remedy = "a radius of 0.01 to 1000 metres and a height within 1000 would be right";
        return Err(at.error("the cylinder's numbers are wrong", remedy));
    }
    at.tree.note(
        "the cylinder's left edge looks ahead, as SGCT's documentation has it, and rotation is in \
         degrees; if the picture was turned in SGCT, change degrees of the cylinder",
    );
    Ok(Projection::Cylinder { rotation, bottom, radius })
}

fn cube<'t>(at: &At<'t>) -> anyhow::Result<Found<'t>> {
    let mut faces = vec!["right", "left", "bottom", "top", "front", "back"];
    if let Some(channels) = at.get("channels") {
        let names = ["right", "left", "bottom", "top", "zleft", "zright"];
        channels.check_keys(&names)?;
        let mut shown = Vec::new();
        for (name, face) in names.iter().zip(faces) {
            if channels.need(name)?.flag()? {
                shown.push(face);
            }
        }
        faces = shown;
        if faces.is_empty() {
            return Err(channels.error("no face of the cube is shown", "switch one on"));
        }
    }
    let turned = at.get_any(&["orientation", "rigorientation"]);
    let rotation = turned.map_or(Ok(DQuat::IDENTITY), |at| orientation(&at))?;
    let side = quality(at)?;
    let projection = Projection::Cube { faces, rotation };
    Ok(Found { pixels: Some([side; 2]), ..Found::of(projection) })
}

/// The pixels of a cube map's face.
fn quality(at: &At<'_>) -> anyhow::Result<u32> {
    let Some(at) = at.get("quality") else { return Ok(QUALITY_DEFAULT) };
    let words = match &at.node.value {
        Value::Number(number) => number.to_string(),
        _ => at.text()?.to_lowercase(),
    };
    let side = match words.as_str() {
        "low" => 256,
        "medium" => 512,
        "high" => 1024,
        "1.5k" => 1536,
        word => match word.strip_suffix('k').map(str::parse::<u32>) {
            Some(Ok(thousands)) => thousands.saturating_mul(1024),
            Some(Err(_)) => 0,
            None => word.parse().unwrap_or(0),
        },
    };
    if !(1..=CHANNEL_SIDE_MAX).contains(&side) {
        let remedy = format!("low, medium, high, 1k to 8k or 1 to {CHANNEL_SIDE_MAX} are right");
        return Err(at.error(format!("found {words}"), remedy));
    }
    Ok(side)
}

fn spout<'t>(at: &At<'t>) -> anyhow::Result<Found<'t>> {
    let found = cube(at)?;
    let mapping = at.get("mapping").map_or(Ok("cubemap"), |at| at.text())?;
    let projection = match mapping {
        "cubemap" => return Ok(found),
        "fisheye" => fisheye(at)?,
        "equirectangular" => Projection::Equirectangular,
        _ => {
            let remedy = "cubemap, fisheye and equirectangular are right";
            return Err(at.need("mapping")?.error(format!("found {mapping}"), remedy));
        }
    };
    Ok(Found { projection, ..found })
}

impl Projection<'_> {
    /// The point of the room that a place of the picture shows to this eye; `None` where it is
    /// dark. `aspect` is the picture's width by its height.
    pub fn point(&self, place: DVec2, aspect: f64, eye: DVec3) -> Option<DVec3> {
        match self {
            Self::Plane([lower_left, upper_left, upper_right]) => Some(
                *lower_left
                    + (upper_right - upper_left) * place.x
                    + (upper_left - lower_left) * place.y,
            ),
            Self::Fisheye { lens, radius, offset, crop, keeps_aspect } => {
                let aspect = keeps_aspect.then_some(aspect);
                let direction = lens.direction(crop.place(place, aspect)?)?;
                Some(eye + (direction + offset) * radius)
            }
            Self::Equirectangular => Some(eye + equirectangular(place) * RADIUS_DEFAULT_M),
            Self::Cylinder { rotation, bottom, radius } => {
                let (sin, cos) = (place.x * 360.0 - rotation).to_radians().sin_cos();
                Some(eye + DVec3::new(sin, place.y + bottom, -cos) * radius)
            }
            Self::Cube { .. } | Self::Mirror { .. } => None,
        }
    }
}

impl Crop {
    /// The place in a fisheye's square of a place of the picture, which shows the rest of the
    /// square as large as it fits; without an aspect the rest is stretched over the picture.
    fn place(self, place: DVec2, aspect: Option<f64>) -> Option<DVec2> {
        let [left, right, bottom, top] = self.0;
        let fits = match aspect.map(|aspect| aspect * (1.0 - bottom - top) / (1.0 - left - right)) {
            Some(aspect) if aspect >= 1.0 => DVec2::new(1.0 / aspect, 1.0),
            Some(aspect) => DVec2::new(1.0, aspect),
            None => DVec2::ONE,
        };
        let at = ((place * 2.0 - 1.0) / fits + 1.0) / 2.0;
        let is_inside = at.clamp(DVec2::ZERO, DVec2::ONE) == at;
        let low = DVec2::new(left, bottom);
        let high = DVec2::new(1.0 - right, 1.0 - top);
        is_inside.then(|| low + (high - low) * at)
    }
}
