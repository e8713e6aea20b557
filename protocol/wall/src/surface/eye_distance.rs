//! The distance of an eye from a surface.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::cylinder::place_of_angle;
use super::{Cylinder, Plane, Sphere, Surface};

impl Surface {
    /// Returns the distance of an eye before all of the surface, in metres: the minimum distance
    /// from its tangent planes, negative if some of it shows its back. `None` for a mesh, whose
    /// file has it, and for a degenerate rectangle.
    pub fn distance_m(&self, eye: DVec3) -> Option<f64> {
        match self {
            Self::Plane(plane) => plane.distance_m(eye),
            Self::Cylinder(cylinder) => Some(cylinder.distance_m(eye)),
            Self::Sphere(sphere) => Some(sphere.distance_m(eye)),
            Self::Mesh(_) => None,
        }
    }
}

impl Plane {
    fn distance_m(&self, eye: DVec3) -> Option<f64> {
        let (a, b, c) = (self.lower_left, self.lower_right, self.upper_left);
        Some((b - a).cross(c - a).try_normalize()?.dot(eye - a))
    }
}

impl Cylinder {
    /// Before the tangent plane at azimuth θ the eye stands by R − ρ·cos(θ − φ), seen from within,
    /// with its own azimuth φ and its distance ρ from the axis.
    fn distance_m(&self, eye: DVec3) -> f64 {
        let own = self.rotation.inverse() * (eye - self.center);
        let out = own.x.hypot(own.z);
        let own_azimuth = own.x.atan2(-own.z);
        if self.azimuth_rad[0] < self.azimuth_rad[1] {
            self.radius_m - out * nearest_cosine(own_azimuth, self.azimuth_rad)
        } else {
            -out * nearest_cosine(own_azimuth + PI, self.azimuth_rad) - self.radius_m
        }
    }
}

impl Sphere {
    /// Returns the distance as for a cylinder, with a second angle: at the best azimuth, the eye's
    /// part along the outward direction is A·cos(elevation) + B·sin(elevation).
    fn distance_m(&self, eye: DVec3) -> f64 {
        let own = self.rotation.inverse() * (eye - self.center);
        let is_inside = self.azimuth_rad[0] < self.azimuth_rad[1];
        // Of the outside the direction that points most away from the eye counts.
        let sign = if is_inside { 1.0 } else { -1.0 };
        let toward = own * sign;
        let cosine = nearest_cosine(toward.x.atan2(-toward.z), self.azimuth_rad);
        let (a, b) = (toward.x.hypot(toward.z) * cosine, toward.y);
        let [bottom, top] = self.elevation_rad;
        let along = |elevation: f64| a * elevation.cos() + b * elevation.sin();
        let best = b.atan2(a);
        let is_on_patch = (-FRAC_PI_2..=FRAC_PI_2).contains(&best) && best > bottom && best < top;
        let best = if is_on_patch { Some(best) } else { None };
        let most = [Some(bottom), Some(top), best].into_iter().flatten().map(along);
        sign * self.radius_m - most.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The cosine of the least angle from an azimuth to one of the patch.
fn nearest_cosine(azimuth: f64, [left, right]: [f64; 2]) -> f64 {
    if (0.0..=1.0).contains(&place_of_angle(azimuth, left, right)) {
        return 1.0;
    }
    (azimuth - left).cos().max((azimuth - right).cos())
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec2};

    use super::*;

    /// The least distance from the tangent planes at many points, by differences.
    fn by_points(surface: &Surface, eye: DVec3) -> f64 {
        const STEPS: u32 = 160;
        let at = |x: f64, y: f64| surface.display_from_uv(DVec2::new(x, y)).expect("a point");
        let step = 1e-6;
        let mut least = f64::INFINITY;
        for (x, y) in (0..=STEPS).flat_map(|x| (0..=STEPS).map(move |y| (x, y))) {
            let (u, v) = (f64::from(x) / f64::from(STEPS), f64::from(y) / f64::from(STEPS));
            let right = at(u + step, v) - at(u - step, v);
            let up = at(u, v - step) - at(u, v + step);
            let Some(normal) = right.cross(up).try_normalize() else { continue };
            least = least.min(normal.dot(eye - at(u, v)));
        }
        least
    }

    #[test]
    fn the_distance_is_that_of_the_nearest_tangent_plane() {
        let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.4, 0.3, -0.2);
        let center = DVec3::new(0.3, 1.2, -0.5);
        let mut surfaces =
            vec![Surface::Plane(Plane::upright(DVec3::new(0.2, 1.0, -2.0), DVec2::new(3.0, 2.0)))];
        for azimuth_rad in [[-1.0, 1.3], [-2.6, 2.9], [0.9, -0.8], [2.0, 3.5]] {
            let height_m = [-1.0, 1.5];
            let (radius_m, elevation_rad) = (2.0, [-0.3, 1.4]);
            let cylinder = Cylinder { center, rotation, radius_m, azimuth_rad, height_m };
            surfaces.push(Surface::Cylinder(cylinder));
            let sphere = Sphere { center, rotation, radius_m, azimuth_rad, elevation_rad };
            surfaces.push(Surface::Sphere(sphere));
        }
        let mut signs = [0; 2];
        for surface in &surfaces {
            for step in 0..60 {
                let t = f64::from(step);
                let eye = DVec3::new((t * 1.7).sin(), (t * 0.9).cos(), (t * 2.3).sin()) * 3.5;
                let (found, expected) =
                    (surface.distance_m(eye).expect("a distance"), by_points(surface, eye));
                assert!((found - expected).abs() < 2e-3, "{found} {expected} {eye} {surface:?}");
                signs[usize::from(found > 0.0)] += 1;
            }
        }
        assert!(signs.iter().all(|&count| count > 50), "both sides were seen: {signs:?}");
        assert_eq!(Surface::Mesh(0).distance_m(DVec3::ZERO), None);
    }
}
