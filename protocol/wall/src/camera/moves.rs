//! Moves of the camera, each a new camera made of another. Numbers that are not finite make one
//! that has a [fault](Camera::fault), which a manager refuses.

use glam::{DQuat, DVec3};

use super::Camera;

impl Camera {
    /// This camera moved by so many metres along the axes of display space: X to the right, Y up,
    /// Z backwards.
    #[must_use]
    pub fn moved_by(self, by_m: DVec3) -> Self {
        Self { position: self.world_from_display(by_m), ..self }
    }

    /// This camera turned about its own axes by angles in radians: to the left about its Y, then
    /// upwards about its X, then its top to the left about its Z. The eye, a point of display space
    /// in metres, stays where it is in the world.
    #[must_use]
    pub fn turned(self, eye: DVec3, yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        let turn = DQuat::from_rotation_y(yaw_rad)
            * DQuat::from_rotation_x(pitch_rad)
            * DQuat::from_rotation_z(roll_rad);
        self.with_rotation_about(eye, (self.rotation * turn).normalize())
    }

    /// This camera turned by `angle_rad` about the axis through `pivot`, a point of the world, that
    /// points against gravity, `up`: an orbit, counterclockwise as seen from above. The same camera
    /// if `up` has no direction.
    #[must_use]
    pub fn turned_around(self, pivot: DVec3, up: DVec3, angle_rad: f64) -> Self {
        let Some(axis) = up.try_normalize() else { return self };
        let turn = DQuat::from_axis_angle(axis, angle_rad);
        let position = pivot + turn * (self.position - pivot);
        Self { position, rotation: (turn * self.rotation).normalize(), ..self }
    }

    /// This camera turned on the spot by `angle_rad` about the axis through the eye that points
    /// against gravity, `up`: to the left, and level as it was before.
    #[must_use]
    pub fn panned(self, eye: DVec3, up: DVec3, angle_rad: f64) -> Self {
        self.turned_around(self.world_from_display(eye), up, angle_rad)
    }

    /// This camera with the eye moved towards `point`, in the world, by a share of the way: 0
    /// stays, 1 is there, below 0 goes away.
    #[must_use]
    pub fn towards(self, eye: DVec3, point: DVec3, share: f64) -> Self {
        let way = point - self.world_from_display(eye);
        Self { position: self.position + way * share, ..self }
    }

    /// This camera with the eye moved towards the box from `min` to `max`, in the world, by a share
    /// of the way to its nearest point. One whose eye is in the box stays.
    #[must_use]
    pub fn towards_box(self, eye: DVec3, min: DVec3, max: DVec3, share: f64) -> Self {
        // A box that is turned inside out is the same one; `clamp` would refuse it.
        let (low, high) = (min.min(max), min.max(max));
        let nearest = self.world_from_display(eye).max(low).min(high);
        self.towards(eye, nearest, share)
    }

    /// This camera with the eye, a point of display space in metres, at a point of the world.
    #[must_use]
    pub fn with_eye_at(self, eye: DVec3, point: DVec3) -> Self {
        Self { position: point - self.rotation * (self.scale * eye), ..self }
    }

    /// This camera with another rotation and the eye where it is in the world.
    fn with_rotation_about(self, eye: DVec3, rotation: DQuat) -> Self {
        let position = self.world_from_display(eye) - rotation * (self.scale * eye);
        Self { position, rotation, ..self }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    use super::*;

    const EYE: DVec3 = DVec3::new(0.3, 1.6, 0.8);

    fn camera() -> Camera {
        let position = DVec3::new(10.0, 2.0, -5.0);
        Camera::look_at(position, DVec3::new(3.0, 1.0, 4.0), DVec3::Y).with_scale(2.5)
    }

    fn is_near(a: &Camera, b: &Camera) -> bool {
        let angle = a.rotation.angle_between(b.rotation);
        a.position.distance(b.position) < 1e-9 && angle < 1e-6 && (a.scale - b.scale).abs() < 1e-12
    }

    fn eye_of(camera: &Camera) -> DVec3 {
        camera.world_from_display(EYE)
    }

    #[test]
    fn a_move_goes_along_the_axes_of_display_space_and_back() {
        let moved = camera().moved_by(DVec3::new(1.0, -2.0, 3.0));
        let by = camera().world_from_display(DVec3::new(1.0, -2.0, 3.0)) - camera().position;
        assert!(moved.position.distance(camera().position + by) < 1e-12);
        assert!((moved.position.distance(camera().position) - 14.0_f64.sqrt() * 2.5).abs() < 1e-9);
        assert!(is_near(&moved.moved_by(DVec3::new(-1.0, 2.0, -3.0)), &camera()));
        assert_eq!(camera().moved_by(DVec3::ZERO), camera());
    }

    #[test]
    fn a_turn_about_its_own_axes_keeps_the_eye_and_the_named_directions() {
        let left = Camera::IDENTITY.turned(EYE, FRAC_PI_2, 0.0, 0.0);
        assert!((left.rotation * DVec3::NEG_Z).distance(DVec3::NEG_X) < 1e-12, "to the left");
        let up = Camera::IDENTITY.turned(EYE, 0.0, FRAC_PI_2, 0.0);
        assert!((up.rotation * DVec3::NEG_Z).distance(DVec3::Y) < 1e-12, "upwards");
        let rolled = Camera::IDENTITY.turned(EYE, 0.0, 0.0, FRAC_PI_2);
        assert!((rolled.rotation * DVec3::Y).distance(DVec3::NEG_X) < 1e-12, "top to the left");
        let turned = camera().turned(EYE, 0.4, -1.1, 2.0);
        assert!(eye_of(&turned).distance(eye_of(&camera())) < 1e-12);
        assert_eq!(turned.fault(), None);
    }

    #[test]
    fn an_orbit_keeps_the_distance_and_the_level_and_comes_round() {
        let pivot = DVec3::new(1.0, 2.0, 3.0);
        for up in [DVec3::Y, DVec3::Z * 7.0, DVec3::new(1.0, 1.0, 0.2)] {
            let turned = camera().turned_around(pivot, up, 0.7);
            let height = |of: &Camera| (eye_of(of) - pivot).dot(up.normalize());
            assert!((height(&turned) - height(&camera())).abs() < 1e-9);
            let distance = |of: &Camera| eye_of(of).distance(pivot);
            assert!((distance(&turned) - distance(&camera())).abs() < 1e-9);
            let tilt = |of: &Camera| (of.rotation * DVec3::NEG_Z).dot(up.normalize());
            assert!((tilt(&turned) - tilt(&camera())).abs() < 1e-9);
            assert!(is_near(&camera().turned_around(pivot, up, TAU), &camera()));
        }
        assert_eq!(camera().turned_around(pivot, DVec3::ZERO, 1.0), camera());
        let half = camera().turned_around(pivot, DVec3::Y, PI);
        let across = (eye_of(&camera()) + eye_of(&half)) / 2.0;
        assert!((across - pivot).with_y(0.0).length() < 1e-9, "on the other side");
    }

    #[test]
    fn a_pan_keeps_the_eye_and_the_tilt() {
        let panned = camera().panned(EYE, DVec3::Y, 0.6);
        assert!(eye_of(&panned).distance(eye_of(&camera())) < 1e-12);
        let ahead = |of: &Camera| of.rotation * DVec3::NEG_Z;
        assert!((ahead(&panned).y - ahead(&camera()).y).abs() < 1e-12);
        assert!(ahead(&panned).distance(ahead(&camera())) > 0.3);
    }

    #[test]
    fn a_way_to_a_point_is_gone_by_its_share() {
        let point = DVec3::new(-3.0, 0.0, 2.0);
        let distance = |share: f64| eye_of(&camera().towards(EYE, point, share)).distance(point);
        for share in [0.0, 0.25, 1.0, -1.0, 2.0] {
            let expected = distance(0.0) * (1.0_f64 - share).abs();
            assert!((distance(share) - expected).abs() < 1e-9, "share {share}");
        }
        assert_eq!(camera().towards(EYE, point, 0.5).rotation, camera().rotation);
    }

    #[test]
    fn a_way_to_a_box_ends_at_its_side_and_none_is_gone_inside() {
        let (min, max) = (DVec3::splat(-1.0), DVec3::ONE);
        let there = camera().towards_box(EYE, min, max, 1.0);
        let nearest = eye_of(&camera()).clamp(min, max);
        assert!(eye_of(&there).distance(nearest) < 1e-9);
        assert!(is_near(&camera().towards_box(EYE, max, min, 1.0), &there), "inside out");
        let inside = camera().towards(EYE, DVec3::ZERO, 1.0);
        assert!(is_near(&inside.towards_box(EYE, min, max, 1.0), &inside));
    }

    #[test]
    fn numbers_that_are_not_finite_make_a_camera_that_is_refused() {
        let bad = DVec3::splat(f64::NAN);
        for camera in [
            camera().moved_by(bad),
            camera().turned(EYE, f64::NAN, 0.0, 0.0),
            camera().turned_around(bad, DVec3::Y, 0.1),
            camera().panned(EYE, DVec3::Y, f64::INFINITY),
            camera().towards(EYE, bad, 0.5),
            camera().towards_box(EYE, DVec3::ZERO, DVec3::ONE, f64::NAN),
        ] {
            assert!(camera.fault().is_some(), "{camera:?}");
        }
    }
}
