//! The length of a line on a screen, in metres and in degrees as the eye sees it; and the density
//! at which drawn pictures fill a channel's pixels.

use glam::DVec3;
use polyptych_wall::Channel;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use polyptych_wall::view_atlas::{AtlasError, ViewAtlas};
use polyptych_wall::wall_geometry::ResolvedWall;

/// Straight pieces that a line is measured in.
const PIECES: u32 = 32;

/// Bisections by which the end of what lies on a surface is found: a piece to its 2⁻³²nd part.
const BISECTIONS: usize = 32;

/// The length of a line, as far as it lies on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Extent {
    /// Along the surface, in metres.
    pub metres: f64,
    /// Seen from the eye, in degrees.
    pub degrees: f64,
}

/// The extent of the line through these places, which go from 0 to 1: the sum of all parts that
/// lie somewhere. `None` if none of 33 places does, the middle among them.
pub(super) fn line_length_and_angle(
    eye: DVec3,
    place: impl Fn(f64) -> Option<DVec3>,
) -> Option<Extent> {
    let at = |step: u32| f64::from(step) / f64::from(PIECES);
    let points: Vec<Option<DVec3>> = (0..=PIECES).map(|step| place(at(step))).collect();
    points.iter().flatten().next()?;
    let mut sum = Extent::default();
    for (step, pair) in (0..PIECES).zip(points.windows(2)) {
        let ends = match *pair {
            [Some(a), Some(b)] => (a, b),
            [Some(a), None] => (a, last_place(&place, at(step), at(step + 1)).unwrap_or(a)),
            [None, Some(b)] => (last_place(&place, at(step + 1), at(step)).unwrap_or(b), b),
            _ => continue,
        };
        sum.metres += ends.0.distance(ends.1);
        sum.degrees += angle(ends.0 - eye, ends.1 - eye).to_degrees();
    }
    (sum.metres.is_finite() && sum.degrees.is_finite()).then_some(sum)
}

/// The last point on the way from a place that lies somewhere to one that lies nowhere.
fn last_place(place: impl Fn(f64) -> Option<DVec3>, mut on: f64, mut off: f64) -> Option<DVec3> {
    let mut last = None;
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(on, off);
        match place(middle) {
            Some(point) => (on, last) = (middle, Some(point)),
            None => off = middle,
        }
    }
    last
}

/// The angle between two directions in radians, exact for the tiny angles of one pixel, where the
/// arc cosine is not: W. Kahan, *How Futile are Mindless Assessments of Roundoff*, 2006, §12.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    let (scaled_a, scaled_b) = (a * b.length(), b * a.length());
    2.0 * (scaled_a - scaled_b).length().atan2((scaled_a + scaled_b).length())
}

/// The very plan that a server draws a channel by, with textures of the weakest supported driver.
///
/// # Errors
/// The reason why a server cannot draw the channel: nothing of it is lit, or the eye is on or
/// behind it.
pub(super) fn plan(
    of: ResolvedWall<'_>,
    maps: &CalibrationMaps,
    channel: &Channel,
    map: &ChannelMapping<'_>,
) -> Result<ViewAtlas, AtlasError> {
    let known = of.wall.channel_by_name(&channel.name).filter(|_| !maps.is_empty());
    let drawn = known.and_then(|(id, _)| of.drawn_mesh(maps, id).ok());
    let mesh = drawn.unwrap_or_else(|| map.drawn_mesh());
    let eyes = if of.wall.is_omnidirectional(channel) {
        of.wall.viewpoints(channel)
    } else {
        vec![of.wall.eye.into()]
    };
    let mesh = mesh.refined_for(&eyes);
    let plan = ViewAtlas::new(&mesh, &eyes, of.wall.near_m, CHANNEL_SIDE_MAX)?;
    let is_finite = plan.density_min.is_finite() && plan.density_max.is_finite();
    if is_finite { Ok(plan) } else { Err(AtlasError::Nothing) }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, UVec2};

    use super::*;
    use polyptych_wall::surface::Cylinder;
    use polyptych_wall::{Screen, Surface, Wall};

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
        let map = wall.channel_mapping(polyptych_wall::ChannelId(0)).unwrap();
        let plan =
            plan(ResolvedWall::from(&wall), &CalibrationMaps::default(), &wall.channels[0], &map)
                .unwrap();
        let (fewest, most) = (plan.density_min, plan.density_max);
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
        let Extent { metres, degrees } = line_length_and_angle(DVec3::ZERO, quarter).unwrap();
        assert!((degrees - 90.0).abs() < 1e-9, "{degrees}");
        assert!((metres / std::f64::consts::PI - 1.0).abs() < 2e-4, "{metres}");
        assert_eq!(line_length_and_angle(DVec3::ZERO, |_| None), None);
    }

    #[test]
    fn a_line_that_leaves_its_surface_is_measured_up_to_the_edge() {
        let piece = |low: f64, high: f64| {
            let line = move |t: f64| {
                (low..=high).contains(&t).then_some(DVec3::new(4.0 * t - 2.0, 0.0, -1.0))
            };
            line_length_and_angle(DVec3::ZERO, line)
        };
        let Extent { metres, degrees } = piece(0.31, 0.735).unwrap();
        assert!((metres - 4.0 * 0.425).abs() < 1e-8, "{metres}");
        let expected = (0.94_f64.atan() + 0.76_f64.atan()).to_degrees();
        assert!((degrees - expected).abs() < 1e-6, "{degrees}");
        // Thinner than a piece, around the middle.
        let thin = piece(0.4999, 0.5002).unwrap();
        assert!((thin.metres - 0.0012).abs() < 1e-8, "{thin:?}");
    }
}
