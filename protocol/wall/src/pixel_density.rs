//! Pixels per angle as the viewer sees the wall: what an error in pixels is in the scene.
//!
//! A small sphere of radius e at the distance d from the eye covers at most e / d × D pixels in any
//! direction, where D is the density of the pixel that is smallest to the eye. D is one number for
//! the whole wall, so that all channels decide alike.

use glam::{DMat2, DVec2, DVec3};

use super::channel_mapping::ChannelMapping;
use super::head::HeadPose;
use super::view::{Area, View, ViewProjection};
use super::{Channel, Eye, Wall};

/// Places across a channel, and down it, at which its pixels are measured. Densities of planes are
/// greatest in a corner, which is one of them; those of curved surfaces change slowly.
const PLACES: u32 = 5;

/// The share by which pixels may be smaller between the measured places of a curved surface.
const BETWEEN_FACTOR: f64 = 1.02;

/// The density of channels whose geometry only their files know: a pixel of a sixth of an arc
/// minute, smaller than any wall's, so that no error is drawn that is too large.
const UNKNOWN_PER_RAD: f64 = 20_000.0;

/// The same of plans: along a pixel of a screen's canvas there are no more pixels of a channel.
const UNKNOWN_PER_CANVAS_PIXEL: f64 = 4.0;

/// Half of the pixel over which a difference is taken.
const HALF_PX: f64 = 0.5;

/// A camera's own picture on a channel's screen.
struct Picture {
    /// In pixels of the canvas.
    size: DVec2,
    size_m: DVec2,
    /// The maximum number of the channel's pixels along a metre; `None` if only a file knows.
    pixels_per_m: Option<f64>,
}

impl Wall {
    /// Returns the maximum number of pixels for each unit of a view: per radian around its eye,
    /// and per metre of display space where its rays are parallel.
    pub fn pixel_density(&self, view: &View, head: &HeadPose) -> f64 {
        let whole = || self.channels.iter().filter(|channel| is_shown(channel, &view.area));
        match view.projection {
            ViewProjection::Wall => {
                let eyes = [Eye::Center, Eye::Left, Eye::Right].map(|eye| head.eye(eye));
                whole().map(|channel| self.density_of(channel, &eyes)).fold(0.0, f64::max)
            }
            ViewProjection::Perspective { fov_y_rad } => {
                let pictures = whole().filter_map(|channel| self.picture_of(channel, &view.area));
                let density = |Picture { size_m, pixels_per_m, .. }: Picture| {
                    let Some(pixels_per_m) = pixels_per_m else { return UNKNOWN_PER_RAD };
                    // Pixels of a plane at the distance 1, towards its corner: the farthest is seen
                    // at the distance 1 / cos, and slanted by as much again.
                    let top = (fov_y_rad * 0.5).tan();
                    let corner = top.hypot(top * size_m.x / size_m.y);
                    pixels_per_m * size_m.y / (2.0 * top) * (1.0 + corner * corner)
                };
                pictures.map(density).fold(0.0, f64::max)
            }
            ViewProjection::Orthographic { height_m } => {
                let pictures = whole().filter_map(|channel| self.picture_of(channel, &view.area));
                let density = |Picture { size, size_m, pixels_per_m }: Picture| {
                    let down = pixels_per_m.map(|pixels| pixels * size_m.y);
                    down.unwrap_or(UNKNOWN_PER_CANVAS_PIXEL * size.y) / height_m
                };
                pictures.map(density).fold(0.0, f64::max)
            }
        }
    }

    /// What a camera's own picture is like on a channel.
    fn picture_of(&self, channel: &Channel, area: &Area) -> Option<Picture> {
        let part = self.canvas_rect(channel, area).ok()?;
        let (size, size_m) = (part.end - part.begin, self.screen_of(channel).part_size_m(&part));
        let is_real = |of: DVec2| of.min_element() > 0.0 && of.is_finite();
        // Pixels need not be square; the smaller side counts.
        let canvas_pixels = (size / size_m).max_element();
        let pixels_per_m = self.canvas_factor(channel).map(|factor| factor * canvas_pixels);
        let picture = Picture { size, size_m, pixels_per_m };
        (is_real(size) && is_real(size_m)).then_some(picture)
    }

    /// The maximum number of a channel's pixels along a pixel of its screen's canvas; 1 for tiles,
    /// `None` if only a file knows.
    fn canvas_factor(&self, channel: &Channel) -> Option<f64> {
        let map = ChannelMapping::new(channel, self.screen_of(channel))?;
        let factors = places(channel).filter_map(|at| {
            let across = |step: DVec2| {
                Some(map.canvas_from_pixel(at + step)? - map.canvas_from_pixel(at - step)?)
            };
            let steps = [across(DVec2::X * HALF_PX)?, across(DVec2::Y * HALF_PX)?];
            inverse_of_least(DMat2::from_cols(steps[0], steps[1]))
        });
        factors.reduce(f64::max).map(|factor| factor.max(1.0))
    }

    /// The maximum number of a channel's pixels in a radian around any of the eyes.
    fn density_of(&self, channel: &Channel, eyes: &[DVec3]) -> f64 {
        let Some(map) = ChannelMapping::new(channel, self.screen_of(channel)) else { return 0.0 };
        let mut density: f64 = 0.0;
        for at in places(channel) {
            let across = |step: DVec2| {
                Some(map.display_from_pixel(at + step)? - map.display_from_pixel(at - step)?)
            };
            let (Some(point), Some(x), Some(y)) = (
                map.display_from_pixel(at),
                across(DVec2::X * HALF_PX),
                across(DVec2::Y * HALF_PX),
            ) else {
                continue;
            };
            let seen = eyes.iter().filter_map(|eye| density_at(point - *eye, x, y));
            density = seen.fold(density, f64::max);
        }
        let is_plane = self.screen_of(channel).plane().is_some();
        let density = if is_plane { density } else { density * BETWEEN_FACTOR };
        if density > 0.0 { density } else { UNKNOWN_PER_RAD }
    }
}

fn is_shown(channel: &Channel, area: &Area) -> bool {
    match area {
        Area::Wall => true,
        Area::Screen { screen, .. } => *screen == channel.screen,
    }
}

/// Places of a channel's picture from edge to edge, in pixels.
fn places(channel: &Channel) -> impl Iterator<Item = DVec2> {
    let size = channel.size.as_dvec2();
    let at = |index: u32, length: f64| {
        (length * f64::from(index) / f64::from(PLACES - 1)).clamp(HALF_PX, length - HALF_PX)
    };
    (0..PLACES * PLACES)
        .map(move |index| DVec2::new(at(index % PLACES, size.x), at(index / PLACES, size.y)))
}

/// The pixels in a radian around an eye that sees a pixel of these edges in this direction, along
/// the direction in which there are most; `None` if the pixel is seen edge-on.
fn density_at(from_eye: DVec3, x: DVec3, y: DVec3) -> Option<f64> {
    let distance = from_eye.length();
    let (right, up) = (from_eye / distance).any_orthonormal_pair();
    let seen = |edge: DVec3| DVec2::new(edge.dot(right), edge.dot(up)) / distance;
    inverse_of_least(DMat2::from_cols(seen(x), seen(y)))
}

/// The inverse of a matrix's least singular value.
fn inverse_of_least(matrix: DMat2) -> Option<f64> {
    let (a, b) = (matrix.x_axis, matrix.y_axis);
    let (sum, determinant) = (a.length_squared() + b.length_squared(), matrix.determinant());
    let spread = (sum * sum - 4.0 * determinant * determinant).max(0.0).sqrt();
    let greatest = ((sum + spread) * 0.5).sqrt();
    let inverse = greatest / determinant.abs();
    inverse.is_finite().then_some(inverse)
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, UVec2};

    use super::*;
    use crate::camera::Camera;
    use crate::surface::{Cylinder, Plane};
    use crate::{Screen, Surface};

    /// Two tiles side by side, 2 × 1 m and 2,000 × 1,000 pixels, seen from 1 m away.
    fn plane() -> Wall {
        let surface = Surface::Plane(Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0)));
        let screen = Screen::new("front", surface, UVec2::new(2000, 1000));
        let half = UVec2::new(1000, 1000);
        let channels = vec![
            Channel::tile("left", 0, UVec2::ZERO, half),
            Channel::tile("right", 0, UVec2::new(1000, 0), half),
        ];
        Wall::new("plane", vec![screen], channels)
    }

    /// The angle between neighbouring pixels in one direction, by brute force.
    fn density_by_angles(wall: &Wall, eye: DVec3) -> f64 {
        let screen = &wall.screens[0];
        let mut greatest: f64 = 0.0;
        for index in 0..441 {
            let at = DVec2::new(f64::from(index % 21) / 20.0, f64::from(index / 21) / 20.0);
            let at = at.min(DVec2::ONE) * screen.canvas.as_dvec2();
            for turn in 0..360 {
                let step = DVec2::from_angle(f64::from(turn).to_radians()) * 1e-3;
                let point = |at| screen.display_from_canvas(at).map(|p| (p - eye).normalize());
                let Some((a, b)) = point(at - step).zip(point(at + step)) else { continue };
                greatest = greatest.max(2e-3 / a.distance(b));
            }
        }
        greatest
    }

    #[test]
    fn a_plane_is_densest_in_its_farthest_corner() {
        let wall = plane();
        let view = View::of_wall(Camera::IDENTITY);
        for eye in [DVec3::ZERO, DVec3::new(0.4, -0.2, 0.3), DVec3::new(-0.9, 0.4, -0.5)] {
            let head = HeadPose::facing_forward(eye, 0.0);
            let (found, exact) = (wall.pixel_density(&view, &head), density_by_angles(&wall, eye));
            assert!((found / exact - 1.0).abs() < 3e-3, "{found} and {exact} from {eye}");
        }
        let both = wall.pixel_density(&view, &HeadPose::facing_forward(DVec3::ZERO, 0.1));
        assert!(both > wall.pixel_density(&view, &HeadPose::facing_forward(DVec3::ZERO, 0.0)));
    }

    #[test]
    fn a_cylinder_is_as_dense_as_it_is_made() {
        let cylinder = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: 3.0,
            azimuth_rad: [-1.0, 1.0],
            height_m: [-0.1, 0.1],
        };
        let screen = Screen::new("round", Surface::Cylinder(cylinder), UVec2::new(2000, 50));
        let channel = Channel::tile("round", 0, UVec2::ZERO, UVec2::new(2000, 50));
        let wall = Wall::new("round", vec![screen], vec![channel]);
        let density = wall.pixel_density(
            &View::of_wall(Camera::IDENTITY),
            &HeadPose::facing_forward(DVec3::ZERO, 0.0),
        );
        // 1,000 per radian around, and 3 m × 250 pixels per metre up.
        assert!((1000.0..1000.0 * BETWEEN_FACTOR * 1.01).contains(&density), "{density}");
    }

    #[test]
    fn cameras_own_pictures_have_the_density_of_their_matrix() {
        let wall = plane();
        let head = wall.head();
        let view = |projection| View { projection, ..View::of_wall(Camera::IDENTITY) };
        let plan = view(ViewProjection::Orthographic { height_m: 50.0 });
        assert!((wall.pixel_density(&plan, &head) - 20.0).abs() < 1e-9);
        // The same picture as the wall's own from 1 m before its middle.
        let fov_y_rad = 2.0 * 0.5_f64.atan();
        let camera = view(ViewProjection::Perspective { fov_y_rad });
        let own = HeadPose::facing_forward(DVec3::ZERO, 0.0);
        let (found, exact) =
            (wall.pixel_density(&camera, &head), density_by_angles(&wall, own.position));
        assert!((found / exact - 1.0).abs() < 3e-3, "{found} and {exact}");
        // A part of a screen has fewer pixels.
        let area = Area::Screen { screen: 0, rect: [0, 0, 200, 100] };
        let part = View { area, ..plan.clone() };
        assert!((wall.pixel_density(&part, &head) - 2.0).abs() < 1e-9);
        // Pixels twice as high as wide: the narrow side counts.
        let mut high = wall.clone();
        high.screens[0].canvas.y = 500;
        for channel in &mut high.channels {
            channel.size.y = 500;
        }
        assert!((high.pixel_density(&plan, &head) - 20.0).abs() < 1e-9);
        let (found, exact) =
            (high.pixel_density(&camera, &head), density_by_angles(&high, own.position));
        assert!(found >= exact * 0.999, "{found} and {exact}");
    }

    #[test]
    fn geometry_that_only_files_know_counts_as_finer_than_any() {
        let mut wall = plane();
        for channel in &mut wall.channels {
            channel.cover = crate::ChannelKind::Map;
        }
        let density = wall.pixel_density(&View::of_wall(Camera::IDENTITY), &wall.head());
        assert!(density >= UNKNOWN_PER_RAD, "{density}");
        for (projection, least) in [
            (ViewProjection::Perspective { fov_y_rad: 1.0 }, UNKNOWN_PER_RAD),
            (ViewProjection::Orthographic { height_m: 50.0 }, 80.0),
        ] {
            let view = View { projection, ..View::of_wall(Camera::IDENTITY) };
            assert!(wall.pixel_density(&view, &wall.head()) >= least, "{projection:?}");
        }
    }
}
