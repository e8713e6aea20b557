//! Rotations as trackers write them.

use std::ops::RangeInclusive;

use glam::{DMat3, DQuat, DVec3};
use polyptych_wall::device::{EulerOrder, RotationForm};

/// Range of the length of a quaternion, and of a row of a matrix: numbers of trackers are rounded.
const LENGTH_RANGE: RangeInclusive<f64> = 0.9..=1.1;

/// Maximum cosine of the angle between two rows of a matrix.
const SKEW_MAX: f64 = 0.1;

/// Returns how many numbers a rotation of this form has.
pub(crate) fn numbers_of(form: RotationForm) -> usize {
    match form {
        RotationForm::Quaternion | RotationForm::QuaternionWxyz => 4,
        RotationForm::Matrix => 9,
        RotationForm::Euler { .. } => 3,
    }
}

/// Returns the unit quaternion of finite numbers; `None` if they are no rotation.
pub(crate) fn rotation(form: RotationForm, numbers: &[f64]) -> Option<DQuat> {
    match (form, numbers) {
        (RotationForm::Quaternion, &[x, y, z, w])
        | (RotationForm::QuaternionWxyz, &[w, x, y, z]) => {
            let quaternion = DQuat::from_xyzw(x, y, z, w);
            LENGTH_RANGE.contains(&quaternion.length()).then(|| quaternion.normalize())
        }
        (RotationForm::Matrix, &[a, b, c, d, e, f, g, h, i]) => {
            from_rows([DVec3::new(a, b, c), DVec3::new(d, e, f), DVec3::new(g, h, i)])
        }
        (RotationForm::Euler { order, is_degrees }, &[a, b, c]) => {
            let angles = [a, b, c].map(|angle| if is_degrees { angle.to_radians() } else { angle });
            Some(from_angles(order, angles))
        }
        _ => None,
    }
}

fn from_rows(rows: [DVec3; 3]) -> Option<DQuat> {
    let [x, y, z] = rows;
    let is_unit = rows.iter().all(|row| LENGTH_RANGE.contains(&row.length()));
    let is_square = [x.dot(y), y.dot(z), z.dot(x)].iter().all(|cosine| cosine.abs() <= SKEW_MAX);
    let matrix = DMat3::from_cols(x, y, z).transpose();
    // A mirror is no rotation.
    if !(is_unit && is_square && matrix.determinant() > 0.0) {
        return None;
    }
    let quaternion = DQuat::from_mat3(&matrix);
    (quaternion.is_finite() && quaternion.length() > 0.5).then(|| quaternion.normalize())
}

fn from_angles(order: EulerOrder, angles: [f64; 3]) -> DQuat {
    let turn = |(axis, angle): (u8, f64)| match axis {
        0 => DQuat::from_rotation_x(angle),
        1 => DQuat::from_rotation_y(angle),
        _ => DQuat::from_rotation_z(angle),
    };
    let [a, b, c] = [0, 1, 2].map(|index| turn((order.0[index], angles[index])));
    (a * b * c).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_forms_of_one_rotation_are_one() {
        let expected = DQuat::from_euler(glam::EulerRot::YXZ, 0.4, -0.3, 0.2);
        let [x, y, z, w] = expected.to_array();
        let matrix = DMat3::from_quat(expected).transpose();
        let rows = matrix.to_cols_array();
        let order = EulerOrder([1, 0, 2]);
        let degrees = [0.4_f64, -0.3, 0.2].map(f64::to_degrees);
        for (form, numbers) in [
            (RotationForm::Quaternion, &[x, y, z, w][..]),
            (RotationForm::QuaternionWxyz, &[w * 1.01, x * 1.01, y * 1.01, z * 1.01]),
            (RotationForm::Matrix, &rows),
            (RotationForm::Euler { order, is_degrees: false }, &[0.4, -0.3, 0.2]),
            (RotationForm::Euler { order, is_degrees: true }, &degrees),
        ] {
            let found = rotation(form, numbers).expect("a rotation");
            assert_eq!(numbers.len(), numbers_of(form));
            assert!(found.dot(expected).abs() > 1.0 - 1e-9, "{form:?}: {found}");
        }
    }

    #[test]
    fn numbers_that_are_no_rotation_are_refused() {
        let mirror = [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let skewed = [1.0, 0.0, 0.0, 0.5, 0.866, 0.0, 0.0, 0.0, 1.0];
        for (form, numbers) in [
            (RotationForm::Quaternion, &[0.0; 4][..]),
            (RotationForm::Quaternion, &[0.5, 0.0, 0.0, 0.5]),
            (RotationForm::Quaternion, &[1.0; 3]),
            (RotationForm::Matrix, &[0.0; 9]),
            (RotationForm::Matrix, &mirror),
            (RotationForm::Matrix, &skewed),
        ] {
            assert_eq!(rotation(form, numbers), None, "{numbers:?}");
        }
    }
}
