//! The place of an eye for each point of a screen: one place for all of them, or another one for
//! each direction, for viewers who look all around.
//!
//! Omnidirectional stereo (H. Ishiguro, M. Yamamoto, S. Tsuji, *Omni-directional stereo*, 1992;
//! S. Peleg, M. Ben-Ezra, Y. Pritch, *Omnistereo: panoramic stereo imaging*, 2001): both eyes are
//! on a circle around the head, at right angles to the horizontal direction of each point. So the
//! right eye is at the right wherever a viewer looks, and a point on the screen is where it is.
//! Towards zenith and nadir, which have no such direction, the eyes come together as in Blender's
//! pole merge with its defaults: by a quarter of a cosine, from 60° of elevation to 75°.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::{Channel, Eye, Wall};
use crate::head::HeadPose;

/// Elevations in radians from where on, and up to where, the eyes come together.
const MERGE_RAD: [f64; 2] = [std::f64::consts::FRAC_PI_3, 5.0 * std::f64::consts::PI / 12.0];

/// Places of an eye around the head that stand for all of them.
const PLACES: u32 = 16;

/// Default of [`StereoRule::error_max_px`].
pub const STEREO_ERROR_DEFAULT_PX: f64 = 0.5;

/// Range of [`StereoRule::error_max_px`]: below it pictures would be single columns.
pub const STEREO_ERROR_RANGE_PX: (f64, f64) = (0.05, 16.0);

/// Where the eyes of stereo channels are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StereoMode {
    /// Left and right of the middle of the head, which looks one way.
    #[default]
    Head,
    /// Left and right of each direction in which a viewer may look.
    Omnidirectional,
}

/// The rule for the pictures of stereo channels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StereoRule {
    /// The positions of the eyes.
    pub mode: StereoMode,
    /// With omnidirectional stereo: by how many pixels a point may be off for each eye, on the
    /// screen or anywhere behind it, since eyes stand still within each part of the picture.
    pub error_max_px: f64,
}

impl Default for StereoRule {
    fn default() -> Self {
        Self { mode: StereoMode::Head, error_max_px: STEREO_ERROR_DEFAULT_PX }
    }
}

impl StereoRule {
    /// Returns whether the numbers are in range.
    pub fn is_sound(&self) -> bool {
        let (low, high) = STEREO_ERROR_RANGE_PX;
        (low..=high).contains(&self.error_max_px)
    }
}

/// The place of an eye for each point of a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// One place in metres of display space.
    Fixed(DVec3),
    /// A place for each direction.
    Around(Around),
}

/// An eye of omnidirectional stereo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// The middle of the head, in metres of display space. Up is +Y.
    pub head: DVec3,
    /// From there to the right, in metres: negative for a left eye.
    pub offset_m: f64,
    /// The maximum error in pixels; see [`StereoRule::error_max_px`].
    pub error_max_px: f64,
}

impl From<DVec3> for Viewpoint {
    fn from(eye: DVec3) -> Self {
        Self::Fixed(eye)
    }
}

impl Viewpoint {
    /// The place of the eye that sees a point, both in metres of display space.
    pub fn eye_for(&self, point: DVec3) -> DVec3 {
        match self {
            Self::Fixed(eye) => *eye,
            Self::Around(around) => around.eye_for(point),
        }
    }

    /// Its place, or some of its places that are spread evenly around the head.
    pub fn places(&self) -> Vec<DVec3> {
        match self {
            Self::Fixed(eye) => vec![*eye],
            Self::Around(Around { head, offset_m, .. }) => (0..PLACES)
                .map(|step| DQuat::from_rotation_y(TAU * f64::from(step) / f64::from(PLACES)))
                .map(|turn| *head + turn * DVec3::X * *offset_m)
                .collect(),
        }
    }

    /// The middle of all its places.
    pub fn middle(&self) -> DVec3 {
        match self {
            Self::Fixed(eye) => *eye,
            Self::Around(around) => around.head,
        }
    }
}

impl Around {
    fn eye_for(&self, point: DVec3) -> DVec3 {
        let ray = point - self.head;
        let ahead = DVec3::new(ray.x, 0.0, ray.z);
        let distance = ahead.length();
        let kept = kept(ray.y.abs().atan2(distance));
        if kept == 0.0 {
            return self.head;
        }
        self.head + ahead.cross(DVec3::Y) * (self.offset_m * kept / distance)
    }
}

/// The share of the eyes' distance that is kept at an elevation in radians, 0 to π/2.
fn kept(elevation: f64) -> f64 {
    let [from, to] = MERGE_RAD;
    let part = (elevation - from) / (to - from);
    if part >= 1.0 { 0.0 } else { (part.max(0.0) * std::f64::consts::FRAC_PI_2).cos() }
}

impl Wall {
    /// Returns whether the eyes of a channel are other ones for each direction.
    pub fn is_omnidirectional(&self, channel: &Channel) -> bool {
        let is_for_one = *channel.eyes() != [Eye::Center];
        self.stereo.mode == StereoMode::Omnidirectional && is_for_one
    }

    /// Returns the viewpoints of a channel's eyes, for the head at rest.
    pub fn viewpoints(&self, channel: &Channel) -> Vec<Viewpoint> {
        let head = self.head();
        channel.eyes().iter().map(|eye| self.viewpoint(&head, *eye)).collect()
    }

    /// Returns the viewpoint of an eye of a head, for the points of this wall's screens.
    pub fn viewpoint(&self, head: &HeadPose, of: Eye) -> Viewpoint {
        let side = match of {
            Eye::Center => 0.0,
            Eye::Left => -0.5,
            Eye::Right => 0.5,
        };
        let offset_m = side * head.eye_separation_m;
        if self.stereo.mode == StereoMode::Head || offset_m == 0.0 {
            return Viewpoint::Fixed(head.eye(of));
        }
        let error_max_px = self.stereo.error_max_px;
        Viewpoint::Around(Around { head: head.position, offset_m, error_max_px })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye(offset_m: f64) -> Viewpoint {
        let head = DVec3::new(0.2, 1.6, -0.3);
        Viewpoint::Around(Around { head, offset_m, error_max_px: 0.5 })
    }

    /// A point by azimuth (to the right of −Z) and elevation in radians, at a distance of 3 m.
    fn point(azimuth: f64, elevation: f64) -> DVec3 {
        let (sin, cos) = azimuth.sin_cos();
        let flat = DVec3::new(sin, 0.0, -cos) * elevation.cos();
        eye(0.0).middle() + (flat + DVec3::Y * elevation.sin()) * 3.0
    }

    #[test]
    fn the_right_eye_is_at_the_right_wherever_one_looks() {
        for step in 0..72 {
            let azimuth = f64::from(step) * 5_f64.to_radians();
            for elevation in [-0.9, 0.0, 0.4, 1.0] {
                let at = point(azimuth, elevation);
                let (left, right) = (eye(-0.03).eye_for(at), eye(0.03).eye_for(at));
                let (sin, cos) = azimuth.sin_cos();
                let expected = DVec3::new(cos, 0.0, sin) * 0.06;
                assert!((right - left).distance(expected) < 1e-12, "{azimuth}, {elevation}");
                assert!(left.midpoint(right).distance(eye(0.0).middle()) < 1e-12);
            }
        }
        // Ahead it is what a head has that looks there.
        let ahead = eye(0.03).eye_for(point(0.0, 0.2));
        assert!(ahead.distance(eye(0.0).middle() + DVec3::X * 0.03) < 1e-12);
    }

    #[test]
    fn eyes_come_together_towards_the_zenith_and_the_nadir() {
        let apart = |degrees: f64| {
            let at = point(1.0, degrees.to_radians());
            eye(0.5).eye_for(at).distance(eye(-0.5).eye_for(at))
        };
        assert!((apart(59.9) - 1.0).abs() < 1e-12, "{}", apart(59.9));
        assert!((apart(65.0) - 30_f64.to_radians().cos()).abs() < 1e-9, "{}", apart(65.0));
        assert!((apart(-70.0) - 0.5).abs() < 1e-9, "{}", apart(-70.0));
        for degrees in [75.1, 89.0, 90.0, -90.0] {
            assert_eq!(apart(degrees), 0.0, "{degrees}");
        }
    }

    #[test]
    fn a_middle_eye_or_no_distance_between_eyes_is_one_place() {
        let mut wall = Wall::new("w", Vec::new(), Vec::new());
        wall.stereo.mode = StereoMode::Omnidirectional;
        let head = HeadPose::facing_forward(DVec3::Y, 0.06);
        assert_eq!(wall.viewpoint(&head, Eye::Center), Viewpoint::Fixed(DVec3::Y));
        let flat = HeadPose::facing_forward(DVec3::Y, 0.0);
        assert_eq!(wall.viewpoint(&flat, Eye::Left), Viewpoint::Fixed(DVec3::Y));
        let Viewpoint::Around(around) = wall.viewpoint(&head, Eye::Left) else {
            panic!("one place for all directions");
        };
        assert_eq!((around.head, around.offset_m), (DVec3::Y, -0.03));
        wall.stereo.mode = StereoMode::Head;
        let left = wall.viewpoint(&head, Eye::Left);
        assert_eq!(left, Viewpoint::Fixed(DVec3::new(-0.03, 1.0, 0.0)));
    }
}
