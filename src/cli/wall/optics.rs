//! What lenses and mirrors do: for places of a picture, the points of the room that they show.
//!
//! A place is 0 to 1 to the right and 0 to 1 up.

use std::f64::consts::FRAC_PI_2;

use anyhow::bail;
use glam::{DMat3, DQuat, DVec2, DVec3, UVec2};

/// Widest picture of a fisheye lens, in degrees: then its rim is one point.
const FISHEYE_DEGREES_MAX: f64 = 360.0;

/// An equidistant fisheye, as of dome masters: the angle from its axis grows evenly from the middle
/// of the circle to its rim (Bourke, "Computer generated angular fisheye projections", 2001).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fisheye {
    /// The angle across its circle, in degrees.
    pub degrees: f64,
    /// How far the dome is tilted forward, in degrees: at 0 the zenith is in the middle of the
    /// circle and what is ahead at its bottom, at 90 what is ahead is in the middle.
    pub tilt_degrees: f64,
}

impl Fisheye {
    /// Checks that a lens can do it.
    pub fn check(&self) -> anyhow::Result<()> {
        if !(self.degrees > 0.0 && self.degrees <= FISHEYE_DEGREES_MAX) {
            bail!(
                "no lens sees {} degrees; more than 0 and up to 360 would be right",
                self.degrees
            );
        }
        if !(-360.0..=360.0).contains(&self.tilt_degrees) {
            bail!("a tilt of {} degrees; -360 to 360 would be right", self.tilt_degrees);
        }
        Ok(())
    }

    /// From the lens's own axes (x right, y up in its picture, its axis along −z) to the room's.
    pub fn rotation(&self) -> DQuat {
        DQuat::from_rotation_x((90.0 - self.tilt_degrees).to_radians())
    }

    /// The direction that a place of the square around the circle shows; `None` outside of it.
    pub fn direction(&self, place: DVec2) -> Option<DVec3> {
        let from_middle = place * 2.0 - 1.0;
        let radius = from_middle.length();
        if radius > 1.0 {
            return None;
        }
        let (sin, cos) = (radius * self.degrees.to_radians() / 2.0).sin_cos();
        let side = from_middle.normalize_or_zero() * sin;
        Some(self.rotation() * side.extend(-cos))
    }
}

/// The direction that a place of an equirectangular picture of the whole sphere shows: ahead (−z)
/// in its middle, longitude growing to the right, latitude up.
pub(super) fn equirectangular(place: DVec2) -> DVec3 {
    let azimuth = (place.x * 2.0 - 1.0) * 2.0 * FRAC_PI_2;
    let (up, out) = ((place.y * 2.0 - 1.0) * FRAC_PI_2).sin_cos();
    DVec3::new(out * azimuth.sin(), up, -out * azimuth.cos())
}

/// The faces of a cube around the eye and their rotations from the face ahead.
pub(super) fn cube_faces() -> [(&'static str, DQuat); 6] {
    [
        ("front", DQuat::IDENTITY),
        ("right", DQuat::from_rotation_y(-FRAC_PI_2)),
        ("back", DQuat::from_rotation_y(2.0 * FRAC_PI_2)),
        ("left", DQuat::from_rotation_y(FRAC_PI_2)),
        ("top", DQuat::from_rotation_x(FRAC_PI_2)),
        ("bottom", DQuat::from_rotation_x(-FRAC_PI_2)),
    ]
}

/// A projector whose light a spherical mirror throws onto a dome (Bourke, "Using a spherical mirror
/// for projection into immersive environments", Graphite 2005): each ray by the law of reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MirrorDome {
    /// Where the projector's light comes from, in metres.
    pub projector: DVec3,
    /// The point in the middle of its picture.
    pub look_at: DVec3,
    /// Tangents of half of its picture's angles, across and up; the picture is upright.
    pub tangents: DVec2,
    /// By what share of its height the lens moves the picture up.
    pub shift: f64,
    pub mirror: Ball,
    pub dome: Ball,
    /// How far the dome is tilted forward, in degrees.
    pub tilt_degrees: f64,
}

/// A sphere, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    pub center: DVec3,
    pub radius: f64,
}

impl Ball {
    /// The distances at which a ray of unit direction enters and leaves it; `None` if it misses.
    fn hits(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let to = self.center - origin;
        let along = to.dot(direction);
        let half = (self.radius.powi(2) - (to - direction * along).length_squared()).sqrt();
        half.is_finite().then_some([along - half, along + half])
    }
}

impl MirrorDome {
    /// Checks that light can go from the projector over the mirror to the dome.
    pub fn check(&self) -> anyhow::Result<()> {
        let Self { projector, mirror, dome, .. } = self;
        if projector.distance(mirror.center) <= mirror.radius {
            bail!("the projector is within the mirror; move it or the mirror");
        }
        for (what, point) in [("projector", *projector), ("mirror", mirror.center)] {
            if point.distance(dome.center) >= dome.radius {
                let remedy = "move it, or make the dome larger";
                bail!("the {what} at {point} is outside of the dome's sphere; {remedy}");
            }
        }
        if self.axes().is_none() {
            bail!("the projector looks nowhere, or straight up or down; give it another aim");
        }
        Ok(())
    }

    /// Right, up and ahead of the projector.
    fn axes(&self) -> Option<DMat3> {
        let ahead = (self.look_at - self.projector).try_normalize()?;
        let right = ahead.cross(DVec3::Y).try_normalize()?;
        Some(DMat3::from_cols(right, right.cross(ahead), ahead))
    }

    /// The point of the dome that a place of the projector's picture lights; `None` where its light
    /// misses the mirror or leaves below the dome's rim.
    pub fn point(&self, place: DVec2) -> Option<DVec3> {
        let at = (place * 2.0 - 1.0 + DVec2::new(0.0, 2.0 * self.shift)) * self.tangents;
        let ray = (self.axes()? * at.extend(1.0)).normalize();
        let [enters, _] = self.mirror.hits(self.projector, ray)?;
        let on_mirror = (enters > 0.0).then(|| self.projector + ray * enters)?;
        let normal = (on_mirror - self.mirror.center) / self.mirror.radius;
        let reflected = ray - 2.0 * ray.dot(normal) * normal;
        let [_, leaves] = self.dome.hits(on_mirror, reflected)?;
        let point = on_mirror + reflected * leaves;
        let zenith = DQuat::from_rotation_x(-self.tilt_degrees.to_radians()) * DVec3::Y;
        ((point - self.dome.center).dot(zenith) >= 0.0).then_some(point)
    }
}

/// The centres of a picture's pixels, row by row from the upper left, as places.
pub(super) fn places(size: [u32; 2]) -> impl Iterator<Item = DVec2> {
    let scale = UVec2::from_array(size).as_dvec2();
    let place = move |x: u32, y: u32| {
        let at = (UVec2::new(x, y).as_dvec2() + 0.5) / scale;
        DVec2::new(at.x, 1.0 - at.y)
    };
    (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| place(x, y)))
}
