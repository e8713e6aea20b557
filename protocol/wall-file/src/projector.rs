//! From a projector's section to a [`Projector`].

use glam::DVec3;
use polyptych_wall::camera::Camera;
use polyptych_wall::projector::Projector;

use super::check::{COORDINATE_MAX_M, check_numbers};
use super::document::ProjectorSection;
use super::error::WallFileError;
use super::rotation::rotation;
use super::source::SourceText;

/// Narrowest and widest picture, across or down: a laser spot, and what a pinhole still can.
const DEGREES_RANGE: (f64, f64) = (0.001, 175.0);

/// Largest tangent of an edge: that of 89 degrees.
const TANGENT_MAX: f64 = 57.3;

/// Farthest lens shift, in widths of the picture; lenses for sale reach 1.3.
const SHIFT_MAX: f64 = 10.0;

/// Shortest distance between a projector and what it looks at.
const LOOK_DISTANCE_MIN_M: f64 = 1e-6;

/// The projector that a table of this key describes.
pub(super) fn projector(
    source: &SourceText<'_>,
    key: &str,
    section: &ProjectorSection,
) -> Result<Projector, WallFileError> {
    let of = |name: &str| format!("{key}.{name}");
    check_numbers(source, &of("position"), &section.position, COORDINATE_MAX_M, "metres")?;
    let position = DVec3::from_array(section.position);
    let rotation = match (section.look_at, section.rotation) {
        (Some(_), Some(_)) => {
            let what = "where it looks is given twice, by look_at and by rotation";
            return Err(source.error(of("rotation"), what, "keep one of the two"));
        }
        (None, None) => {
            let what = "nobody knows where the projector looks";
            let remedy = "give look_at = [x, y, z], or rotation = [yaw, pitch, roll]";
            return Err(source.error(of("look_at"), what, remedy));
        }
        (Some(point), None) => {
            check_numbers(source, &of("look_at"), &point, COORDINATE_MAX_M, "metres")?;
            let target = DVec3::from_array(point);
            if target.distance(position) < LOOK_DISTANCE_MIN_M {
                let what = "it looks at its own position";
                return Err(source.error(of("look_at"), what, "write a point of the screen"));
            }
            Camera::look_at(position, target, DVec3::Y).rotation
        }
        (None, given) => rotation(source, &of("rotation"), given)?,
    };
    Ok(Projector { position, rotation, tangents: tangents(source, key, section)? })
}

/// Left, right, bottom, top.
fn tangents(
    source: &SourceText<'_>,
    key: &str,
    section: &ProjectorSection,
) -> Result<[f64; 4], WallFileError> {
    let of = |name: &str| format!("{key}.{name}");
    match (section.degrees, section.tangents) {
        (Some(_), Some(_)) => {
            let what = "its picture is given twice, by degrees and by tangents";
            Err(source.error(of("tangents"), what, "keep one of the two"))
        }
        (None, None) => {
            let what = "nobody knows how wide the projector's picture is";
            let remedy = "give degrees = [across, down], or tangents = [left, right, bottom, top]";
            Err(source.error(of("degrees"), what, remedy))
        }
        (None, Some(tangents)) => {
            if section.shift.is_some() {
                let what = "tangents say already how the picture is shifted";
                return Err(source.error(of("shift"), what, "leave it out"));
            }
            check_numbers(source, &of("tangents"), &tangents, TANGENT_MAX, "an angle's tangent")?;
            let [left, right, bottom, top] = tangents;
            if left < right && bottom < top {
                return Ok(tangents);
            }
            let what = "the picture's edges are exchanged or coincide";
            let remedy = "write [left, right, bottom, top], left < right and bottom < top";
            Err(source.error(of("tangents"), what, remedy))
        }
        (Some(degrees), None) => {
            let (low, high) = DEGREES_RANGE;
            if let Some(index) = degrees.iter().position(|side| !(low..=high).contains(side)) {
                let what = format!("a picture of {:?} degrees is not possible", degrees[index]);
                let remedy = format!("write a number from {low} to {high}");
                return Err(source.error(format!("{key}.degrees[{index}]"), what, remedy));
            }
            let shift = section.shift.unwrap_or_default();
            check_numbers(source, &of("shift"), &shift, SHIFT_MAX, "pictures")?;
            let [x, y] = degrees.map(|side| (side / 2.0).to_radians().tan());
            let [right, up] = [2.0 * x * shift[0], 2.0 * y * shift[1]];
            Ok([right - x, right + x, up - y, up + y])
        }
    }
}
