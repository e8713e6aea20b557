//! Spheres around points and spheres, rounded so that f32 holds all of them.

use glam::DVec3;
use polyptych_scene::meshlet::ErrorSphere;

/// Returns the sphere around these points. Its middle is that of the box around them.
pub(super) fn around_points(points: impl Iterator<Item = DVec3> + Clone) -> ErrorSphere {
    around(points.map(|point| (point, 0.0)))
}

/// Returns a sphere around these spheres, which their own bits say lie within it.
pub(super) fn around_spheres(spheres: impl Iterator<Item = ErrorSphere> + Clone) -> ErrorSphere {
    around(spheres.map(|sphere| (sphere.center.as_dvec3(), f64::from(sphere.radius))))
}

fn around(spheres: impl Iterator<Item = (DVec3, f64)> + Clone) -> ErrorSphere {
    let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = spheres.clone().fold(bounds, |(low, high), (center, radius)| {
        (low.min(center - radius), high.max(center + radius))
    });
    let middle = ((low + high) * 0.5).as_vec3();
    let center = if middle.is_finite() { middle } else { DVec3::ZERO.as_vec3() };
    let reach = |(at, radius): (DVec3, f64)| at.distance(center.as_dvec3()) + radius;
    let radius = spheres.map(reach).fold(0.0, f64::max);
    ErrorSphere { center, radius: round_up(radius) }
}

/// Returns the least f32 that is not below a number of 0 or more, or infinity. A few roundings of
/// f64 that went into the number are covered too.
pub(super) fn round_up(number: f64) -> f32 {
    /// A share of the number, some thousand roundings of f64.
    const ROUNDING: f64 = 1e-12;
    let number = number * (1.0 + ROUNDING);
    let nearest = number as f32;
    if f64::from(nearest) < number { nearest.next_up() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn numbers_are_rounded_up() {
        for number in [0.1, 1.0 / 3.0, 1e-50, 1e30, 16_777_217.0] {
            assert!(f64::from(round_up(number)) >= number, "{number}");
            assert!(f64::from(round_up(number)) <= number * (1.0 + 1e-6) + 1e-44, "{number}");
        }
        assert_eq!(round_up(0.0), 0.0);
        assert_eq!(round_up(1e300), f32::INFINITY);
    }

    #[test]
    fn spheres_lie_within_the_one_around_them() {
        let one = ErrorSphere { center: Vec3::new(0.1, 0.2, 0.3), radius: 0.7 };
        let two = ErrorSphere { center: Vec3::new(-9.1, 1e3, 0.3), radius: 3.3 };
        let both = around_spheres([one, two].into_iter());
        for inner in [one, two] {
            let apart = inner.center.as_dvec3().distance(both.center.as_dvec3());
            assert!(apart + f64::from(inner.radius) <= f64::from(both.radius));
        }
        let far = ErrorSphere { center: Vec3::splat(f32::MAX), radius: f32::MAX };
        let near = ErrorSphere { center: Vec3::splat(f32::MIN), radius: f32::MAX };
        let all = around_spheres([far, near].into_iter());
        assert!(all.center.is_finite() && all.radius == f32::INFINITY);
    }
}
