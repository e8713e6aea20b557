//! Camera poses that show a whole scene.

use glam::{DMat3, DQuat, DVec2, DVec3};
use polyptych_scene::Bounds;
use polyptych_wall::Wall;
use polyptych_wall::camera::Camera;

use crate::window::{Window, front_screen, last};

/// Angle above the horizon from which a scene is seen: high enough to see behind the first row.
const ELEVATION_RAD: f64 = 0.35;

/// Depth of the nearest corner, at least, as a share of the depth of the box's middle. A rod
/// that is seen from its end would fit at any size, with the eye at its end.
const NEAREST_MIN: f64 = 0.15;

/// Distance of the nearest corner from the eye, at least, in near planes: nothing is cut off.
const NEAR_PLANES_MIN: f64 = 1.05;

/// A camera that shows all of `bounds`, as large as the wall can, from `heading_rad` around +Y
/// (0 sees the scene from its +Z side, a quarter turn from +X) and 0.35 rad above the horizon.
///
/// The eight corners of the box, as the wall's eye sees them, fit the outline of the screen in
/// front of the eye (towards −Z), and touch two opposite edges of it; across the other direction
/// the box is centred. (A rod that points to the eye keeps its middle in the middle of the screen,
/// and touches one edge.) Screens that continue that one in its plane count as one with it. Of
/// curved screens a rectangle in front of the eye is used, 77° wide where they surround the eye.
/// The centre of the box lies at the depth of the screen. Bounds without extent count as a cube
/// with a half diagonal of one unit.
pub fn fit_bounds(wall: &Wall, bounds: &Bounds, heading_rad: f64) -> Camera {
    let rotation = rotation(heading_rad);
    let window = Window::of_wall(wall);
    let radius = radius(bounds);
    let half = ((bounds.max - bounds.min) * (0.5 / radius)).max(DVec3::ZERO);
    let half = if half == DVec3::ZERO { DVec3::splat(1.0 / 3.0_f64.sqrt()) } else { half };
    let window_from_world = (DMat3::from_quat(rotation) * window.axes).transpose();
    let corners: [DVec3; 8] = std::array::from_fn(|i| {
        let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
        window_from_world * (half * DVec3::new(sign(1), sign(2), sign(4)))
    });
    let (center, metres) = fit(&window, &corners, wall.near_m);
    let scale = radius / metres;
    let middle = wall.eye + window.axes * center;
    Camera { position: bounds.center() - rotation * (scale * middle), rotation, scale }
}

/// The centre of a box in the window's axes, in metres from the eye, and the metres that one unit
/// of `corners` takes, such that all corners are seen within the window and as large as can be.
fn fit(window: &Window, corners: &[DVec3; 8], near_m: f64) -> (DVec3, f64) {
    let d = window.distance_m;
    let sides = [0, 1].map(|axis| {
        let corners = corners.map(|q| DVec2::new(q[axis], q.z));
        Side { corners, min: window.min[axis], max: window.max[axis], d }
    });
    let nearest = corners.iter().map(|q| q.z).fold(f64::MIN, f64::max);
    let metres = sides[0].metres(0.0).min(sides[1].metres(0.0));
    if d - nearest * metres >= NEAREST_MIN * d {
        return (DVec3::new(sides[0].middle(metres), sides[1].middle(metres), -d), metres);
    }
    let metres = sides[0].metres_around_middle().min(sides[1].metres_around_middle());
    let uncut = (d - (near_m * NEAR_PLANES_MIN).min(d / 2.0)) / nearest;
    let metres = if uncut > 0.0 { metres.min(uncut) } else { metres };
    let middle = (window.min + window.max) * (d / 2.0);
    (middle.extend(-d), metres)
}

/// Two opposite edges of a window, at the tangents `min` and `max`, and where the corners of a box
/// lie between them: across, and towards the eye from the plane at distance `d`.
struct Side {
    corners: [DVec2; 8],
    min: f64,
    max: f64,
    d: f64,
}

impl Side {
    /// The most metres that a unit can take for the corners to stay `margin` within both edges.
    ///
    /// A corner q of a box at x that is drawn s times as large is right of the lower edge where
    /// x + s·qx ≥ l·(d − s·qz), l being the edge's tangent. Both edges bound x by linear functions
    /// of s, which meet at the largest s.
    fn metres(&self, margin: f64) -> f64 {
        let (low, high) = self.reach(margin);
        let metres = (self.max - self.min - 2.0 * margin) * self.d / (low + high);
        // Nothing reaches to either side: the box is a line towards the eye.
        if metres.is_nan() { f64::MAX } else { metres }
    }

    /// The most metres that a unit can take, with the middle of the box between both edges.
    fn metres_around_middle(&self) -> f64 {
        let (low, high) = self.reach(0.0);
        (self.max - self.min) / 2.0 * self.d / low.max(high)
    }

    /// Returns how far the corners reach beyond the lower and the upper edge, per metre of a unit.
    fn reach(&self, margin: f64) -> (f64, f64) {
        let (min, max) = (self.min + margin, self.max - margin);
        let most = |of: &dyn Fn(DVec2) -> f64| self.corners.map(of).into_iter().fold(0.0, f64::max);
        (most(&|q| -min * q.y - q.x), most(&|q| q.x + max * q.y))
    }

    /// Returns the position of the middle of the box at which its corners are as far from one edge
    /// as from the other.
    fn middle(&self, metres: f64) -> f64 {
        let half = (self.max - self.min) / 2.0;
        let margin = last(0.0, half, |margin| self.metres(margin) >= metres);
        let (low, high) = self.reach(margin);
        f64::midpoint((self.min + self.max) * self.d, (low - high) * metres)
    }
}

/// A camera on a circle around `bounds`: seen from `heading_rad`, as for [`fit_bounds`], but always
/// from the same distance, so that a scene that is turned does not change its size.
///
/// The centre of the box comes to stand in the centre of the screen in front of the eye, and its
/// bounding sphere fits the screen's shorter side: what the wall shows then lies at the depth of
/// the wall. Bounds without extent count as one unit.
pub fn orbit(wall: &Wall, bounds: &Bounds, heading_rad: f64) -> Camera {
    let rotation = rotation(heading_rad);
    let radius = radius(bounds);
    let (middle_in_display, half_side_m) = match front_screen(wall) {
        Some((screen, middle)) => (middle, screen.size_m().min_element() * 0.5),
        None => (wall.eye + DVec3::NEG_Z, 0.5),
    };
    let distance_m = (middle_in_display - wall.eye).length();
    // The sphere touches the cone of half angle a where radius = distance * sin a.
    let half_angle = half_side_m.atan2(distance_m);
    let radius_m = distance_m * half_angle.sin();
    let scale = if radius_m > 0.0 { radius / radius_m } else { radius };
    let position = bounds.center() - rotation * (scale * middle_in_display);
    Camera { position, rotation, scale }
}

/// The world from display space, for a viewer who looks along −Z.
fn rotation(heading_rad: f64) -> DQuat {
    let (sin_h, cos_h) = heading_rad.sin_cos();
    let (sin_e, cos_e) = ELEVATION_RAD.sin_cos();
    let outward = DVec3::new(sin_h * cos_e, sin_e, cos_h * cos_e);
    Camera::look_at(outward, DVec3::ZERO, DVec3::Y).rotation
}

fn radius(bounds: &Bounds) -> f64 {
    Some(bounds.radius()).filter(|r| r.is_finite() && *r > 0.0).unwrap_or(1.0)
}

#[cfg(test)]
mod tests;
