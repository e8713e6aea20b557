//! From a screen's section to a [`Screen`]: its place, its form and its projection. Its channels
//! come from [`tiles`](super::tiles) or [`by_hand`](super::explicit).

use glam::{DMat3, DVec2, DVec3, UVec2};
use polyptych_wall::limits::{CHANNEL_SIDE_MAX, SHARED_CANVAS_SIDE_MAX};
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, ChannelCalibration, ChannelKind, FrustumMode, Screen, Surface};

use super::check::{COORDINATE_MAX_M, check_name, check_numbers};
use super::document::{ProjectionChoice, ScreenSection};
use super::error::WallFileError;
use super::files::Files;
use super::source::SourceText;
use crate::tiling::Rect;

/// Shortest side of a screen: the smallest displays made are some millimetres wide.
pub(super) const SCREEN_SIDE_MIN_M: f64 = 1e-3;

/// Maximum deviation of corners from a right angle, as a cosine: a millimetre per metre, which
/// people who measure a room achieve.
const RIGHT_ANGLE_COSINE_MAX: f64 = 1e-3;

/// Maximum distance in metres by which an upper left corner stays aside of a right angle: corners
/// as far away as a file may place them are rounded by less, so that a file written from a wall
/// makes the same wall.
const LEAN_MAX_M: f64 = 1e-9;

/// A channel, with the keys that errors about it name.
pub(super) struct ChannelDraft {
    /// The channel as it will be.
    pub channel: Channel,
    /// The key of its name.
    pub name_key: String,
    /// The key of its rectangle.
    pub key: String,
}

impl ChannelDraft {
    /// Returns its rectangle on the canvas.
    pub fn rect(&self) -> Rect {
        Rect { origin: self.channel.origin, size: self.channel.size }
    }
}

/// A section, where it stands and what it is read from.
pub(super) struct PlacedSection<'a> {
    /// The file.
    pub source: &'a SourceText<'a>,
    /// The screen's place in the list of screens.
    pub index: u16,
    /// The section of the file.
    pub section: &'a ScreenSection,
}

/// The screen of this index and its channels.
pub(super) fn screen(
    source: &SourceText<'_>,
    index: u16,
    section: &ScreenSection,
    files: &mut Files,
) -> Result<(Screen, Vec<ChannelDraft>), WallFileError> {
    let place = PlacedSection { source, index, section };
    check_name(source, &place.key("name"), &section.name)?;
    let surface = if let Some(surface) = place.curved(files)? {
        surface
    } else {
        let [lower_left, lower_right, upper_left] = place.corners()?;
        let plane = Plane { lower_left, lower_right, upper_left };
        place.check_rectangle(&plane)?;
        Surface::Plane(squared(plane))
    };
    let mut screen =
        Screen { name: section.name.clone(), surface, canvas: UVec2::ZERO, bezel: None };
    let mut drafts = match (&section.tiles, section.channel.is_empty()) {
        (Some(tiles), true) => place.tiles(tiles, &mut screen)?,
        (None, false) => place.channels(&mut screen)?,
        (Some(_), false) => {
            let what = "the screen has both tiles and channels by hand";
            return Err(place.error("channel", what, "keep one of the two"));
        }
        (None, true) => {
            let what = format!("screen {:?} has no channel", section.name);
            return Err(place.error("tiles", what, "add [screen.tiles] with pixels = [w, h]"));
        }
    };
    let projection = place.projection(screen.canvas)?;
    for draft in &mut drafts {
        draft.channel.projection = match draft.channel.cover {
            ChannelKind::Tile => projection,
            // No canvas is shared with it.
            ChannelKind::Projector(_) | ChannelKind::Map => FrustumMode::Own,
        };
    }
    Ok((screen, drafts))
}

impl PlacedSection<'_> {
    /// The whole key of one of the section's keys.
    pub fn key(&self, name: &str) -> String {
        format!("screen[{}].{name}", self.index)
    }

    /// An error at one of the section's keys.
    pub fn error(&self, name: &str, what: impl Into<String>, remedy: &str) -> WallFileError {
        self.source.error(self.key(name), what, remedy)
    }

    /// Lower left, lower right and upper left, however they are given.
    fn corners(&self) -> Result<[DVec3; 3], WallFileError> {
        let s = self.section;
        let corners = [
            ("lower_left", s.lower_left),
            ("lower_right", s.lower_right),
            ("upper_left", s.upper_left),
        ];
        let pose = [
            ("size", s.size.is_some()),
            ("center", s.center.is_some()),
            ("rotation", s.rotation.is_some()),
        ];
        let by_corners = corners.iter().find(|(_, corner)| corner.is_some());
        if let (Some((corner, _)), Some((other, _))) = (by_corners, pose.iter().find(|p| p.1)) {
            let what = format!("the screen's place is given twice, by {corner} and by {other}");
            let remedy = "give three corners, or size, center and rotation";
            return Err(self.error(other, what, remedy));
        }
        if by_corners.is_none() {
            return self.corners_from_pose();
        }
        let mut points = [DVec3::ZERO; 3];
        for (point, (name, corner)) in points.iter_mut().zip(corners) {
            let Some(corner) = corner else {
                let what = format!("screen {:?} lacks this corner", s.name);
                return Err(self.error(name, what, "give all three corners, [x, y, z] in metres"));
            };
            let key = self.key(name);
            check_numbers(self.source, &key, &corner, COORDINATE_MAX_M, "metres")?;
            *point = DVec3::from_array(corner);
        }
        Ok(points)
    }

    fn corners_from_pose(&self) -> Result<[DVec3; 3], WallFileError> {
        let s = self.section;
        let (Some(size), Some(center)) = (s.size, s.center) else {
            let lacks = if s.size.is_none() { "size" } else { "center" };
            let what = format!("nobody knows where screen {:?} stands", s.name);
            let remedy = "give lower_left, lower_right and upper_left, or size and center";
            return Err(self.error(lacks, what, remedy));
        };
        let rotation = s.rotation.unwrap_or_default();
        check_numbers(self.source, &self.key("size"), &size, COORDINATE_MAX_M, "metres")?;
        check_numbers(self.source, &self.key("center"), &center, COORDINATE_MAX_M, "metres")?;
        check_numbers(self.source, &self.key("rotation"), &rotation, 360.0, "degrees")?;
        let turn = rotation_matrix(rotation);
        let half = DVec2::from_array(size) / 2.0;
        let corner = |x: f64, y: f64| {
            DVec3::from_array(center) + turn * DVec3::new(x * half.x, y * half.y, 0.0)
        };
        if let Some(index) = size.iter().position(|side| *side < SCREEN_SIDE_MIN_M) {
            let what = format!("a side of {} metres is too short", size[index]);
            let remedy = format!("write {SCREEN_SIDE_MIN_M} or more");
            return Err(self.error(&format!("size[{index}]"), what, &remedy));
        }
        Ok([corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)])
    }

    /// Three corners span a rectangle only with a right angle and some length.
    fn check_rectangle(&self, screen: &Plane) -> Result<(), WallFileError> {
        let right = screen.lower_right - screen.lower_left;
        let up = screen.upper_left - screen.lower_left;
        let diagonal = screen.upper_left - screen.lower_right;
        let sides = [
            (right, "lower_right", "lower_left and lower_right"),
            (up, "upper_left", "lower_left and upper_left"),
            (diagonal, "upper_left", "lower_right and upper_left"),
        ];
        if let Some((_, name, both)) =
            sides.iter().find(|s| s.0.length() < SCREEN_SIDE_MIN_M * 0.999)
        {
            let what = format!("corners {both} coincide");
            let remedy =
                format!("a screen's sides have {SCREEN_SIDE_MIN_M} metres or more; see its size");
            return Err(self.error(name, what, &remedy));
        }
        let cosine = right.normalize().dot(up.normalize());
        if cosine.abs() <= RIGHT_ANGLE_COSINE_MAX {
            return Ok(());
        }
        let degrees = cosine.clamp(-1.0, 1.0).acos().to_degrees();
        let what = if right.normalize().cross(up.normalize()).length() < RIGHT_ANGLE_COSINE_MAX {
            "corners lower_left, lower_right and upper_left lie on one line".to_owned()
        } else {
            format!(
                "the angle at lower_left is {degrees:.3}°, so that the corners span no rectangle"
            )
        };
        let square = screen.upper_left - right * (right.dot(up) / right.length_squared());
        let remedy = if square.distance(screen.lower_left) > SCREEN_SIDE_MIN_M {
            let [x, y, z] = square.to_array();
            format!("the angle must be 90°, as with upper_left = [{x:.4}, {y:.4}, {z:.4}]")
        } else {
            "upper_left must stand at a right angle above lower_left".to_owned()
        };
        Err(self.error("upper_left", what, &remedy))
    }

    fn projection(&self, canvas: UVec2) -> Result<FrustumMode, WallFileError> {
        let fits = canvas.max_element() <= SHARED_CANVAS_SIDE_MAX;
        match self.section.projection {
            Some(ProjectionChoice::Shared) if !fits => {
                let what = format!(
                    "a canvas of {}×{} pixels is too long for one shared matrix",
                    canvas.x, canvas.y
                );
                let remedy = format!(
                    "write \"own\", or leave it out; shared serves up to {SHARED_CANVAS_SIDE_MAX}"
                );
                Err(self.error("projection", what, &remedy))
            }
            Some(ProjectionChoice::Own) => Ok(FrustumMode::Own),
            None if !fits => Ok(FrustumMode::Own),
            Some(ProjectionChoice::Shared) | None => Ok(FrustumMode::Shared),
        }
    }

    /// Refuses channels without pixels and such as no driver can draw into.
    pub fn check_channel_size(&self, name: &str, pixels: [u32; 2]) -> Result<UVec2, WallFileError> {
        let Some(index) = pixels.iter().position(|p| !(1..=CHANNEL_SIDE_MAX).contains(p)) else {
            return Ok(UVec2::from_array(pixels));
        };
        let side = ["wide", "high"][index];
        let what = format!("a channel cannot be {} pixels {side}", pixels[index]);
        let remedy = format!("write 1 to {CHANNEL_SIDE_MAX}; split larger ones");
        Err(self.error(&format!("{name}[{index}]"), what, &remedy))
    }

    /// A channel of this screen.
    pub fn draft(
        &self,
        name: String,
        server: String,
        rect: Rect,
        name_key: String,
        key: String,
    ) -> ChannelDraft {
        let channel = Channel {
            name,
            screen: self.index,
            origin: rect.origin,
            size: rect.size,
            server,
            monitor: None,
            projection: FrustumMode::Shared,
            cover: ChannelKind::Tile,
            adjustment: ChannelCalibration::default(),
        };
        ChannelDraft { channel, name_key, key }
    }
}

/// The rectangle that frusta draw of measured corners: the upper left one is moved along the lower
/// edge to a right angle, so that projectors, warps and views find pixels where tiles draw them.
fn squared(plane: Plane) -> Plane {
    let right = (plane.lower_right - plane.lower_left).normalize();
    let lean_m = right.dot(plane.upper_left - plane.lower_left);
    if lean_m.abs() <= LEAN_MAX_M {
        return plane;
    }
    Plane { upper_left: plane.upper_left - right * lean_m, ..plane }
}

/// Roll about +Z, then pitch about +X, then yaw about +Y; [yaw, pitch, roll] in degrees. Quarter
/// turns are exact, so that rooms with right angles have them.
fn rotation_matrix(degrees: [f64; 3]) -> DMat3 {
    let [(sy, cy), (sp, cp), (sr, cr)] = degrees.map(|angle| match angle.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => angle.to_radians().sin_cos(),
    });
    let yaw = DMat3::from_cols(DVec3::new(cy, 0.0, -sy), DVec3::Y, DVec3::new(sy, 0.0, cy));
    let pitch = DMat3::from_cols(DVec3::X, DVec3::new(0.0, cp, sp), DVec3::new(0.0, -sp, cp));
    let roll = DMat3::from_cols(DVec3::new(cr, sr, 0.0), DVec3::new(-sr, cr, 0.0), DVec3::Z);
    yaw * pitch * roll
}
