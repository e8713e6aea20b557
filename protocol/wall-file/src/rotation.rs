//! Angles between the wall file's degrees and the wall's radians and quaternions, such that what
//! is written is read as exactly the same numbers.

use glam::DQuat;

use super::check::check_numbers;
use super::document::Rotation;
use super::error::WallFileError;
use super::source::SourceText;

/// Maximum deviation of a quaternion's length from 1; the bound for walls on the wire, too.
const LENGTH_ERROR_MAX: f64 = 1e-6;

/// Steps beside the nearest number of degrees that may be needed to meet radians exactly: dividing
/// and multiplying round once each.
const ULPS_MAX: i64 = 4;

/// Returns the rotation that the file states; the identity if it states none.
pub(super) fn rotation(
    source: &SourceText<'_>,
    key: &str,
    rotation: Option<Rotation>,
) -> Result<DQuat, WallFileError> {
    match rotation {
        None => Ok(DQuat::IDENTITY),
        Some(Rotation::Angles(angles)) => {
            check_numbers(source, key, &angles, 360.0, "degrees")?;
            Ok(from_angles(angles))
        }
        Some(Rotation::Quaternion(numbers)) => {
            check_numbers(source, key, &numbers, 1.0, "a quaternion")?;
            let quaternion = DQuat::from_array(numbers);
            let length = quaternion.length();
            if (length - 1.0).abs() < LENGTH_ERROR_MAX {
                return Ok(quaternion);
            }
            let what = format!("a quaternion of length {length}");
            let remedy = "its length must be 1; or write [yaw, pitch, roll] in degrees";
            Err(source.error(key, what, remedy))
        }
    }
}

/// Roll about +Z, then pitch about +X, then yaw about +Y, as planar screens are turned.
fn from_angles(degrees: [f64; 3]) -> DQuat {
    let [yaw, pitch, roll] = degrees.map(f64::to_radians);
    DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(roll)
}

/// Returns a rotation as a file states it: in angles if round ones give exactly this one; `None`
/// for the identity.
pub(super) fn written(rotation: DQuat) -> Option<Rotation> {
    if rotation == DQuat::IDENTITY {
        return None;
    }
    let (yaw, pitch, roll) = rotation.to_euler(glam::EulerRot::YXZ);
    let angles = [yaw, pitch, roll].map(|angle| rounded(angle.to_degrees()));
    Some(if from_angles(angles) == rotation {
        Rotation::Angles(angles)
    } else {
        Rotation::Quaternion(rotation.to_array())
    })
}

/// To a billionth of a degree, which no wall is measured to.
fn rounded(degrees: f64) -> f64 {
    // Adding zero takes the sign from a zero.
    (degrees * 1e9).round() / 1e9 + 0.0
}

/// The degrees that are read as these radians; the nearest ones where there are none, which no
/// file can have said.
pub(super) fn degrees(radians: f64) -> f64 {
    let nearest = radians.to_degrees();
    let beside = (0..=ULPS_MAX).flat_map(|step| [step, -step]).map(|step| {
        let mut degrees = nearest;
        for _ in 0..step.abs() {
            degrees = if step > 0 { degrees.next_up() } else { degrees.next_down() };
        }
        degrees
    });
    let mut candidates = std::iter::once(rounded(nearest)).chain(beside);
    candidates.find(|degrees| degrees.to_radians() == radians).unwrap_or(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_come_back() {
        for step in -3600_i32..=3600 {
            for text in [f64::from(step) / 10.0, f64::from(step) / 7.0, f64::from(step) * 1e-7] {
                let radians = text.to_radians();
                assert_eq!(degrees(radians).to_radians(), radians, "{text}");
            }
        }
        assert_eq!(degrees(0.3_f64.to_radians()), 0.3);
    }

    #[test]
    fn rotations_come_back_and_round_ones_as_angles() {
        assert_eq!(written(from_angles([0.0; 3])), None);
        for angles in [[90.0, 0.0, 0.0], [-30.0, 12.5, 0.0], [12.0, -45.0, 7.0]] {
            let turned = from_angles(angles);
            match written(turned) {
                Some(Rotation::Angles(again)) => assert_eq!(from_angles(again), turned),
                Some(Rotation::Quaternion(again)) => {
                    assert_eq!(DQuat::from_array(again), turned);
                }
                None => panic!("{angles:?} is a rotation"),
            }
        }
        assert!(matches!(written(from_angles([90.0, 0.0, 0.0])), Some(Rotation::Angles(_))));
    }
}
