//! How long a line on a screen is, in metres and in degrees as the eye sees it; and how densely
//! what is drawn fills a channel's pixels.

use glam::{DVec2, DVec3};

use super::pixels::PixelMap;
use super::source::SourcePlan;
use super::warp_mesh::{MeshRule, WarpMesh};
use super::{Channel, Cover, Wall};
use crate::limits::TEXTURE_SIDE_MAX;

/// Straight pieces that a line is measured in.
const PIECES: u32 = 32;

/// The metres and the degrees of the line through these places, which go from 0 to 1; NaN where a
/// part of it is nowhere.
pub(super) fn of_line(eye: DVec3, place: impl Fn(f64) -> Option<DVec3>) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut before = None;
    for step in 0..=PIECES {
        let Some(point) = place(f64::from(step) / f64::from(PIECES)) else {
            return [f64::NAN; 2];
        };
        if let Some(before) = before.replace(point) {
            sums[0] += point.distance(before);
            sums[1] += angle(before - eye, point - eye).to_degrees();
        }
    }
    sums
}

/// The angle between two directions in radians, exact for the tiny angles of one pixel, where the
/// arc cosine is not: W. Kahan, *How Futile are Mindless Assessments of Roundoff*, 2006, §12.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    let (scaled_a, scaled_b) = (a * b.length(), b * a.length());
    2.0 * (scaled_a - scaled_b).length().atan2((scaled_a + scaled_b).length())
}

/// How many pixels of the flat pictures that are drawn go into a pixel of the display: where and
/// in which direction they are fewest, and where they are most. Of the very plan that a server
/// draws by, with textures of the weakest supported driver; NaN where it has none, or where only
/// files know.
pub(super) fn sampling(wall: &Wall, channel: &Channel) -> [f64; 2] {
    let unknown = [f64::NAN; 2];
    let screen = wall.screen_of(channel);
    let is_file = screen.display_from_canvas(DVec2::ZERO).is_none();
    let map = PixelMap::new(channel, screen).filter(|_| channel.cover != Cover::Map && !is_file);
    let Some(map) = map else { return unknown };
    let place = |pixel| map.display_from_pixel(pixel);
    let mesh = WarpMesh::new(channel.size, MeshRule::default(), place);
    let plan = SourcePlan::new(&mesh, &[wall.eye], wall.near_m, TEXTURE_SIDE_MAX);
    plan.map_or(unknown, |plan| [plan.density_min, plan.density_max])
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, UVec2};

    use super::*;
    use crate::wall::surface::Cylinder;
    use crate::wall::{Screen, Surface};

    #[test]
    fn a_cylinder_is_drawn_finer_at_its_sides_than_it_needs() {
        // From its axis a cylinder's pixels are as many per radian; a plane's pixels widen by the
        // squared secant to the side across, and by the secant down.
        let half: f64 = 0.5;
        let cylinder = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: 3.0,
            azimuth_rad: [-half, half],
            height_m: [-0.3, 0.3],
        };
        let canvas = UVec2::new(1000, 200);
        let screen = Screen::new("round", Surface::Cylinder(cylinder), canvas);
        let channel = Channel::tile("round", 0, UVec2::ZERO, canvas);
        let wall = Wall::new("w", vec![screen], vec![channel]);
        let [fewest, most] = sampling(&wall, &wall.channels[0]);
        let expected = 1.0 / half.cos().powi(2);
        // Sides of what is drawn are rounded up to whole steps.
        assert!((1.0..1.1).contains(&fewest), "{fewest}");
        assert!((most / expected - 1.0).abs() < 0.2, "{most}, not about {expected}");
    }

    #[test]
    fn lines_are_as_long_as_they_are() {
        let quarter = |t: f64| {
            let (sin, cos) = (t * std::f64::consts::FRAC_PI_2).sin_cos();
            Some(DVec3::new(sin, 0.0, -cos) * 2.0)
        };
        let [metres, degrees] = of_line(DVec3::ZERO, quarter);
        assert!((degrees - 90.0).abs() < 1e-9, "{degrees}");
        assert!((metres / std::f64::consts::PI - 1.0).abs() < 2e-4, "{metres}");
        assert!(of_line(DVec3::ZERO, |_| None)[0].is_nan());
    }
}
