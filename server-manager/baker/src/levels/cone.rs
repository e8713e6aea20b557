//! The directions that a run of triangles faces, for culling what faces away from the eye.

use glam::{DVec3, Vec3};

use super::enclosing_sphere::round_up;

/// Cosine of 80 degrees: around wider cones hardly any eye sees none of the triangles.
const COSINE_MIN: f64 = 0.17;

/// A cone of normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    /// The middle of the normals, of unit length; zero if they point in too many directions.
    pub axis: Vec3,
    /// At least the sine of the widest angle between a normal and the axis.
    pub sine: f32,
}

/// Returns the cone around the normals of triangles. One without an area is not drawn, wherever it
/// faces.
pub(super) fn around_normals(triangles: impl Iterator<Item = [DVec3; 3]> + Clone) -> Cone {
    let normals = triangles.filter_map(|[a, b, c]| (b - a).cross(c - a).try_normalize());
    let axis = normals.clone().sum::<DVec3>().try_normalize().map(DVec3::as_vec3);
    let cone = axis.and_then(|axis| {
        // Measured from the axis as it was rounded.
        let direction = axis.as_dvec3().try_normalize()?;
        let cosine = normals.map(|normal| normal.dot(direction)).fold(1.0, f64::min);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        (cosine > COSINE_MIN).then(|| Cone { axis, sine: round_up(sine) })
    });
    cone.unwrap_or(Cone { axis: Vec3::ZERO, sine: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cones_hold_all_normals() {
        let roof = [
            [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 0.9, 0.4)],
            [DVec3::ZERO, DVec3::X, DVec3::new(0.1, 0.8, -0.3)],
            [DVec3::ONE; 3],
        ];
        let cone = around_normals(roof.into_iter());
        let axis = cone.axis.as_dvec3();
        for [a, b, c] in &roof[..2] {
            let normal = (*b - *a).cross(*c - *a).normalize();
            let sine = normal.cross(axis).length() / axis.length();
            assert!(normal.dot(axis) > 0.0 && sine <= f64::from(cone.sine) + 1e-12);
            assert!(f64::from(cone.sine) < sine + 0.5, "the cone is far too wide");
        }
        let back = [roof[0], [roof[0][0], roof[0][2], roof[0][1]]];
        assert_eq!(around_normals(back.into_iter()).axis, Vec3::ZERO);
        assert_eq!(around_normals([[DVec3::ONE; 3]].into_iter()).axis, Vec3::ZERO);
    }
}
