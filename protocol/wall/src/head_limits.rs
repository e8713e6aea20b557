//! Limits of the viewer's head: each of its eyes must stand in front of all that is drawn for it.

use glam::{DVec2, DVec3, UVec2};

use super::frustum::{EYE_DISTANCE_MIN_M, FrustumError, seen_from_front};
use super::view_atlas::SOURCE_DISTANCE_MIN_M;
use super::{Channel, ChannelKind, Eye, Screen, StereoPacking, Wall};
use crate::head::HeadPose;

/// By how much the rounding of directions from the eye to f32 may move anything on a display, in
/// pixels.
///
/// A pixel of side p, as far as r from an eye that is d before the plane, spans an angle of p·d/r²
/// there, and f32 rounds directions by 2⁻²⁴: the eye must be at least 2⁻²⁴·r² / (p·this) away. Of
/// displays of 4K and two metres that is three millimetres, nearer than any head gets; one pixel
/// of 80 is another one there, none from sixteen times as far on.
pub const EYE_ROUNDING_MAX_PX: f64 = 0.25;

/// The reason why a head cannot be at a requested pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HeadError {
    /// The pose contains NaN or an out-of-range value.
    #[error("{0}")]
    Numbers(String),
    /// A channel's pixels are known for the eye of the wall file only.
    #[error(
        "channel {channel} is warped by {path}, which is right for the eye of the wall file only; \
         maps of points in metres follow a head"
    )]
    OneEye {
        /// The channel's name.
        channel: String,
        /// The path of its warp file.
        path: String,
    },
    /// An eye does not see the front of a screen.
    #[error("the {} does not see its screen: {error}", name(*.of))]
    Eye {
        /// The eye.
        of: Eye,
        /// Channel, eye and distance.
        error: FrustumError,
    },
    /// So near to a screen's plane that its pixels are not told apart.
    #[error(
        "channel {channel}: the {} at {eye} m is {distance_m:.6} m before screen {screen}, too \
         near for its pixels to be right; {least_m:.6} m is enough",
        name(*.of)
    )]
    TooNear {
        /// The channel's name.
        channel: String,
        /// The screen's name.
        screen: String,
        /// The eye.
        of: Eye,
        /// In metres of display space.
        eye: DVec3,
        /// From the screen's plane, in metres.
        distance_m: f64,
        /// The minimum distance there, in metres.
        least_m: f64,
    },
}

fn name(of: Eye) -> &'static str {
    match of {
        Eye::Center => "middle of the eyes",
        Eye::Left => "left eye",
        Eye::Right => "right eye",
    }
}

impl Channel {
    /// Returns the eyes that it is drawn for: both if their pictures share its display.
    pub fn eyes(&self) -> &'static [Eye] {
        match (self.adjustment.packing, self.adjustment.eye) {
            (StereoPacking::None, Eye::Center) => &[Eye::Center],
            (StereoPacking::None, Eye::Left) => &[Eye::Left],
            (StereoPacking::None, Eye::Right) => &[Eye::Right],
            _ => &[Eye::Left, Eye::Right],
        }
    }
}

impl Screen {
    /// Returns the minimum distance from this plane of an eye about there, for a channel's pixels
    /// on it to be right, in metres ([`EYE_ROUNDING_MAX_PX`]); `None` if the screen is no plane.
    pub fn eye_distance_min_m(&self, channel: &Channel, eye: DVec3) -> Option<f64> {
        const F32_ROUNDING: f64 = 0.5 * f32::EPSILON as f64;
        self.plane()?;
        let (begin, end) = match channel.cover {
            ChannelKind::Tile => (channel.origin, channel.origin + channel.size),
            ChannelKind::Projector(_) | ChannelKind::Map => (UVec2::ZERO, self.canvas),
        };
        let (begin, end) = (begin.as_dvec2(), end.as_dvec2());
        let corners = [begin, end, DVec2::new(begin.x, end.y), DVec2::new(end.x, begin.y)];
        let corners = corners.into_iter().filter_map(|at| self.display_from_canvas(at));
        let farthest = corners.map(|corner| corner.distance_squared(eye)).fold(0.0, f64::max);
        let pitch_m = (self.size_m() / self.canvas.as_dvec2()).min_element();
        Some(F32_ROUNDING * farthest / (pitch_m * EYE_ROUNDING_MAX_PX))
    }
}

impl Wall {
    /// The viewer's head as the wall file has it, until a client moves it.
    pub fn head(&self) -> HeadPose {
        HeadPose::facing_forward(self.eye, self.eye_separation_m)
    }

    /// Checks that every channel can be drawn for its eyes of this head.
    ///
    /// # Errors
    /// The first channel that cannot, by name, with the eye and its distance from the screen.
    pub fn check_head(&self, head: &HeadPose) -> Result<(), HeadError> {
        if let Some(fault) = head.fault() {
            return Err(HeadError::Numbers(fault));
        }
        for channel in &self.channels {
            for &of in channel.eyes() {
                self.check_warp(channel, head.eye(of) == self.head().eye(of))?;
                for eye in self.viewpoint(head, of).places() {
                    let seen = self.check_eye(channel, eye);
                    seen.map_err(|error| HeadError::Eye { of, error })?;
                    self.check_nearness(channel, of, eye)?;
                }
            }
        }
        Ok(())
    }

    fn check_warp(&self, channel: &Channel, is_at_rest: bool) -> Result<(), HeadError> {
        let file = channel.adjustment.warp.and_then(|file| self.files.get(usize::from(file)));
        match file.filter(|file| file.is_for_one_eye && !is_at_rest) {
            None => Ok(()),
            Some(file) => {
                let (channel, path) = (channel.name.clone(), file.path.clone());
                Err(HeadError::OneEye { channel, path })
            }
        }
    }

    fn check_nearness(&self, channel: &Channel, of: Eye, eye: DVec3) -> Result<(), HeadError> {
        if channel.cover == ChannelKind::Map {
            // Its own points count, wherever its screen is.
            return Ok(());
        }
        let screen = self.screen_of(channel);
        let distances = match screen.eye_distance_min_m(channel, eye) {
            Some(least_m) => screen.frustum(eye).map(|seen| (seen.distance_m, least_m)),
            // Nearer, it is on the curve for who draws.
            None => screen.surface.distance_m(eye).map(|of| (of, 2.0 * SOURCE_DISTANCE_MIN_M)),
        };
        let Some((distance_m, least_m)) = distances else { return Ok(()) };
        if distance_m >= least_m {
            return Ok(());
        }
        let (channel, screen) = (channel.name.clone(), screen.name.clone());
        Err(HeadError::TooNear { channel, screen, of, eye, distance_m, least_m })
    }

    fn check_eye(&self, channel: &Channel, eye: DVec3) -> Result<(), FrustumError> {
        let screen = self.screen_of(channel);
        if let Some(distance_m) = self.distance_behind_m(channel, eye) {
            let (channel, screen) = (channel.name.clone(), screen.name.clone());
            return Err(FrustumError::EyeBehind { channel, screen, eye, distance_m });
        }
        if channel.cover == ChannelKind::Map {
            // Its own points count, wherever its screen is.
            return Ok(());
        }
        if screen.plane().is_some() {
            return seen_from_front(channel, screen, eye).map(|_| ());
        }
        let Some(distance_m) = screen.surface.distance_m(eye) else { return Ok(()) };
        let (channel, screen) = (channel.name.clone(), screen.name.clone());
        if distance_m.abs() <= EYE_DISTANCE_MIN_M {
            return Err(FrustumError::EyeInPlane { channel, screen, eye, distance_m });
        }
        if distance_m < 0.0 {
            return Err(FrustumError::EyeBehind { channel, screen, eye, distance_m });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec2, UVec2};

    use super::*;
    use crate::surface::{Cylinder, Plane};
    use crate::{CalibrationFile, CalibrationFileKind, Screen, Surface};

    fn wall(surface: Surface) -> Wall {
        let screen = Screen::new("front", surface, UVec2::new(64, 32));
        let channel = Channel::tile("c0", 0, UVec2::ZERO, UVec2::new(64, 32));
        Wall::new("test", vec![screen], vec![channel])
    }

    fn plane() -> Wall {
        wall(Surface::Plane(Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0))))
    }

    #[test]
    fn an_eye_behind_a_screen_is_named_with_channel_and_distance() {
        let wall = plane();
        assert_eq!(wall.check_head(&wall.head()), Ok(()));
        let behind = HeadPose::facing_forward(DVec3::new(0.25, 0.0, -1.5), 0.06);
        let error = wall.check_head(&behind).expect_err("behind").to_string();
        for part in ["c0", "front", "0.25", "-1.5", "0.500000 m behind", "middle"] {
            assert!(error.contains(part), "{part} is not in {error}");
        }
        let within = HeadPose::facing_forward(DVec3::NEG_Z, 0.06);
        let error = wall.check_head(&within).expect_err("in the plane").to_string();
        assert!(error.contains("in the plane of screen front"), "{error}");
        // Of a channel with mapped points the screen's place says nothing.
        let mut mapped = wall;
        mapped.channels[0].cover = ChannelKind::Map;
        for head in [behind, within] {
            assert_eq!(mapped.check_head(&head), Ok(()));
        }
    }

    #[test]
    fn an_eye_so_near_that_pixels_are_one_is_told_how_near_it_may_be() {
        let wall = plane();
        let at = |distance_m: f64| {
            HeadPose::facing_forward(DVec3::new(0.9, 0.0, -1.0 + distance_m), 0.06)
        };
        let error = wall.check_head(&at(1e-6)).expect_err("too near");
        let HeadError::TooNear { least_m, .. } = error else { panic!("{error}") };
        // Two metres with pixels of 31 mm.
        assert!((2.5e-5..3.5e-5).contains(&least_m), "{least_m}");
        for part in ["channel c0", "0.000001 m before screen front", "is enough"] {
            assert!(error.to_string().contains(part), "{part} is not in {error}");
        }
        assert_eq!(wall.check_head(&at(least_m * 1.01)), Ok(()));
        assert!(wall.check_head(&at(least_m * 0.99)).is_err());
    }

    #[test]
    fn an_eye_almost_on_a_curve_is_refused_before_a_server_must() {
        let cylinder = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: 3.0,
            azimuth_rad: [-0.5, 0.5],
            height_m: [-0.5, 0.5],
        };
        let wall = wall(Surface::Cylinder(cylinder));
        let at = |distance_m: f64| HeadPose::facing_forward(DVec3::NEG_Z * (3.0 - distance_m), 0.0);
        let error = wall.check_head(&at(1e-7)).expect_err("too near").to_string();
        assert!(error.contains("channel c0") && error.contains("is enough"), "{error}");
        assert_eq!(wall.check_head(&at(2.0)), Ok(()));
    }

    #[test]
    fn each_eye_of_a_separated_pair_is_looked_at() {
        // Turned by a quarter to the left, the right eye is ahead: through the screen.
        let rotation = DQuat::from_rotation_y(90_f64.to_radians());
        let head = HeadPose { position: DVec3::Z * -0.99, rotation, eye_separation_m: 0.06 };
        let of = |eye: Eye, packing: StereoPacking| {
            let mut wall = plane();
            wall.channels[0].adjustment.eye = eye;
            wall.channels[0].adjustment.packing = packing;
            wall.check_head(&head)
        };
        assert_eq!(of(Eye::Center, StereoPacking::None), Ok(()));
        assert_eq!(of(Eye::Left, StereoPacking::None), Ok(()));
        for error in
            [of(Eye::Right, StereoPacking::None), of(Eye::Center, StereoPacking::TopBottom)]
        {
            let error = error.expect_err("the right eye is behind").to_string();
            assert!(error.contains("right eye") && error.contains("0.020000 m behind"), "{error}");
        }
    }

    #[test]
    fn what_is_near_is_farther_to_the_right_for_the_left_eye() {
        let mut wall = plane();
        wall.eye_separation_m = 0.06;
        let head = wall.head();
        let x = |of: Eye, point: DVec3| {
            let seen = wall.pixel_from_display(crate::ChannelId(0), head.eye(of), point);
            seen.expect("ahead").x
        };
        let apart = |z: f64| x(Eye::Left, DVec3::Z * z) - x(Eye::Right, DVec3::Z * z);
        // Of 64 pixels over 2 m, at half the distance both pictures are one separation apart.
        assert!((apart(-0.5) - 0.06 * 32.0).abs() < 1e-9, "{}", apart(-0.5));
        assert!(apart(-1.0).abs() < 1e-9, "on the screen they are one");
        assert!((apart(-2.0) + 0.03 * 32.0).abs() < 1e-9, "{}", apart(-2.0));
    }

    #[test]
    fn a_warp_for_one_eye_refuses_to_follow_a_head() {
        let mut wall = plane();
        let (path, kind) = ("left.png".to_owned(), CalibrationFileKind::Warp);
        wall.files.push(CalibrationFile {
            path,
            kind,
            blob: None,
            is_for_one_eye: true,
            front: Vec::new(),
        });
        wall.channels[0].adjustment.warp = Some(0);
        assert_eq!(wall.check_head(&wall.head()), Ok(()), "where the wall file has it");
        let moved = HeadPose::facing_forward(DVec3::X * 0.1, wall.eye_separation_m);
        let error = wall.check_head(&moved).expect_err("moved").to_string();
        assert!(error.contains("c0") && error.contains("left.png"), "{error}");
        wall.files[0].is_for_one_eye = false;
        assert_eq!(wall.check_head(&moved), Ok(()));
    }

    #[test]
    fn an_eye_outside_a_cylinder_is_refused_and_one_within_moves_freely() {
        let (center, rotation) = (DVec3::ZERO, DQuat::IDENTITY);
        let (azimuth_rad, height_m) = ([-3.0, 3.0], [0.0, 2.0]);
        let cylinder = Cylinder { center, rotation, radius_m: 3.0, azimuth_rad, height_m };
        let wall = wall(Surface::Cylinder(cylinder));
        assert_eq!(
            wall.check_head(&HeadPose::facing_forward(DVec3::new(2.0, 1.0, -2.0), 0.06)),
            Ok(())
        );
        let outside = wall.check_head(&HeadPose::facing_forward(DVec3::X * 3.5, 0.06));
        let error = outside.expect_err("outside").to_string();
        assert!(error.contains("c0") && error.contains("0.500000 m behind"), "{error}");
        let numbers =
            wall.check_head(&HeadPose::facing_forward(DVec3::NAN, 0.06)).expect_err("no numbers");
        assert!(matches!(numbers, HeadError::Numbers(_)), "{numbers}");
    }
}
