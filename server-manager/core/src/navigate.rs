//! The camera as the mouse over a window, or a wand or a pad, moves it.
//!
//! The wall turns about the middle of the open scene and is scaled about it, as a whole: what the
//! eyes see changes together, and stereo stays comfortable. The elevation stops before the poles,
//! and no message moves the camera to where numbers are not exact any more.

use glam::{DQuat, DVec2, DVec3};
use polyptych_protocol::navigation::{Flight, Navigation};
use polyptych_scene::Bounds;
use polyptych_wall::camera::Camera;
use polyptych_wall::{ChannelCalibration, ChannelId, ChannelKind, Orientation, Surface, Wall};
use serde::{Deserialize, Serialize};

use super::{Cluster, Micros, SessionId};

/// Highest and lowest elevation of the view, in radians: 89 degrees.
const ELEVATION_MAX_RAD: f64 = 1.553_343;

/// Factor by which one message makes the scene larger or smaller at most.
const ZOOM_MAX: f64 = 100.0;

/// Smallest and largest radius of the scene in metres of display space, to which it is zoomed.
const RADIUS_M: [f64; 2] = [1e-3, 1e6];

/// Maximum distance to which the middle of the scene is moved away from the eye, in radii of the
/// scene.
const DISTANCE_MAX_RADII: f64 = 1e6;

/// Shortest distance that a pan counts with, in distances of the screen: inside the middle of the
/// scene a pan would otherwise move nothing.
const PAN_DEPTH_MIN: f64 = 0.05;

/// Time after a move at which the camera is persisted; until then others may follow.
pub(super) const REMEMBER_WAIT: Micros = 500_000;

/// The permission to move the camera by mouse, the pivot, and moves that are not persisted yet.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Navigator {
    is_allowed: bool,
    /// The bounds of the open scene.
    pub bounds: Option<Bounds>,
    /// Moves so far.
    pub count: u64,
    /// The time at which the moved camera is persisted.
    pub remember_at: Option<Micros>,
}

/// A channel's picture in display space.
#[derive(Clone, Copy, Debug)]
struct Picture {
    /// The vector along its width, in metres at the depth of the screen; `down` along its height.
    right: DVec3,
    down: DVec3,
    /// The distance from the eye to its middle, in metres.
    distance_m: f64,
}

impl Picture {
    /// The channel's picture as seen from `eye`, by the middle of its pixels; an upright one that
    /// is as wide as it is far away if only the screen's file knows more.
    fn new(wall: &Wall, id: ChannelId, eye: DVec3) -> Self {
        let unknown = Self { right: DVec3::X, down: DVec3::NEG_Y, distance_m: 1.0 };
        let (Some(channel), Some(pixels)) = (wall.channel(id), wall.channel_mapping(id)) else {
            return unknown;
        };
        let (screen, size) = (wall.screen_of(channel), channel.size.as_dvec2());
        // Only the file of a warp knows its pixels. Of a plane it has those about its window's
        // place, which is upright on it; of other screens any.
        let is_map = channel.cover == ChannelKind::Map;
        let display_from = |place| {
            if is_map {
                screen.display_from_canvas(place)
            } else {
                pixels.display_from_pixel(place)
            }
        };
        let middle = match screen.surface {
            Surface::Plane(_) if is_map => channel.origin.as_dvec2() + size / 2.0,
            _ if is_map => screen.canvas.as_dvec2() / 2.0,
            _ => size / 2.0,
        };
        let along = |step: DVec2| {
            let ends = [middle - step / 2.0, middle + step / 2.0];
            let [from, to] = ends.map(display_from);
            Some(to? - from?)
        };
        let point = display_from(middle);
        let (Some(right), Some(down), Some(point)) = (along(DVec2::X), along(DVec2::Y), point)
        else {
            return unknown;
        };
        let picture =
            Self { right: right * size.x, down: down * size.y, distance_m: point.distance(eye) };
        let is_sound = picture.right.is_finite()
            && picture.down.is_finite()
            && picture.distance_m.is_finite()
            && picture.distance_m > 0.0;
        if is_sound { picture } else { unknown }
    }
}

impl Cluster {
    /// Sets whether the mouse over windows moves the camera.
    pub fn set_navigable(&mut self, is_navigable: bool) {
        self.navigator.is_allowed = is_navigable;
    }

    /// Moves the camera by the mouse over a window of this server, from the next frame on.
    pub(super) fn handle_navigation(
        &mut self,
        now: Micros,
        from: SessionId,
        navigation: &Navigation,
    ) {
        if !self.navigator.is_allowed {
            return;
        }
        let Some((id, channel)) = self.wall.channel_by_name(&navigation.channel) else { return };
        let navigation = &upright(&channel.adjustment, navigation);
        let Some(bounds) = self.navigator.bounds.filter(|_| self.registry.owns_channel(from, id))
        else {
            return;
        };
        let eye = self.presentation.head.position;
        let picture = Picture::new(&self.wall, id, eye);
        let Some(camera) = moved(&self.presentation.camera, eye, &bounds, &picture, navigation)
        else {
            return;
        };
        self.navigate_to(now, camera);
        self.advance_frame(now);
    }

    /// Moves the camera by a wand or a pad, from the next frame on.
    ///
    /// # Errors
    /// A move that leads to where no camera can be.
    pub(super) fn fly(&mut self, now: Micros, flight: &Flight) -> Result<(), String> {
        let (eye, bounds) = (self.presentation.head.position, self.navigator.bounds);
        let camera = flown(&self.presentation.camera, eye, bounds.as_ref(), flight);
        self.navigate_to(now, camera.ok_or("a flight that leads too far, or is not finite")?);
        Ok(())
    }

    fn navigate_to(&mut self, now: Micros, camera: Camera) {
        if camera == self.presentation.camera {
            return;
        }
        self.note_use(now);
        self.place_camera(camera);
        self.navigator.count += 1;
        self.navigator.remember_at.get_or_insert(now + REMEMBER_WAIT);
        self.wants_frame |= !self.pacer.is_soon(now);
    }

    /// Persists the camera once it was moved.
    pub(super) fn remember_navigation(&mut self, now: Micros) {
        if self.navigator.remember_at.take_if(|due| *due <= now).is_some() {
            self.persist();
        }
    }
}

/// The camera after a move; `None` if it cannot be moved so.
fn moved(
    camera: &Camera,
    eye: DVec3,
    bounds: &Bounds,
    picture: &Picture,
    navigation: &Navigation,
) -> Option<Camera> {
    let pivot = bounds.center();
    let radius = radius_of(bounds);
    if !navigation.is_sound() || !pivot.is_finite() {
        return None;
    }
    let zoomed = zoomed(camera, pivot, radius, navigation.zoom);
    let turned = turned(&zoomed, pivot, navigation.orbit_rad);
    let next = panned(&turned, eye, pivot, picture, navigation.pan);
    is_in_reach(camera, &next, eye, bounds).then_some(next)
}

/// Returns what a movement on a display is for who looks at its picture, which may be mirrored,
/// turned and packed for two eyes on it.
fn upright(adjustment: &ChannelCalibration, navigation: &Navigation) -> Navigation {
    let seen = |by: DVec2| {
        let turned = match adjustment.turn {
            Orientation::None => by,
            Orientation::Left => DVec2::new(by.y, -by.x),
            Orientation::Right => DVec2::new(-by.y, by.x),
            Orientation::Half => -by,
        };
        turned * DVec2::new(if adjustment.mirror { -1.0 } else { 1.0 }, 1.0)
    };
    let pictures = adjustment.packing.parts().as_dvec2();
    let (orbit_rad, pan) = (seen(navigation.orbit_rad), seen(navigation.pan * pictures));
    Navigation { orbit_rad, pan, ..navigation.clone() }
}

/// Returns whether a camera is valid, and not further from the scene than it was and may be.
fn is_in_reach(camera: &Camera, next: &Camera, eye: DVec3, bounds: &Bounds) -> bool {
    let distance = |of: &Camera| of.world_from_display(eye).distance(bounds.center());
    let reach = distance(camera).max(DISTANCE_MAX_RADII * radius_of(bounds));
    next.fault().is_none() && distance(next) <= reach
}

/// The radius of the scene, 1 if it has no extent.
fn radius_of(bounds: &Bounds) -> f64 {
    Some(bounds.radius()).filter(|r| r.is_finite() && *r > 0.0).unwrap_or(1.0)
}

/// The camera after a flight: turned about the viewer, then moved; `None` if it cannot be.
fn flown(camera: &Camera, eye: DVec3, bounds: Option<&Bounds>, flight: &Flight) -> Option<Camera> {
    let &Flight { offset_m, turn_rad } = flight;
    if !flight.is_valid() {
        return None;
    }
    // The mouse turns the scene to the right, so the view to the left, and tips its top down.
    let viewer = camera.world_from_display(eye);
    let turned = turned(camera, viewer, DVec2::new(turn_rad.x, -turn_rad.y));
    let offset = turned.rotation * (offset_m * turned.scale);
    let next = Camera { position: turned.position + offset, ..turned };
    let is_near = bounds.is_none_or(|bounds| is_in_reach(camera, &next, eye, bounds));
    (next.fault().is_none() && is_near).then_some(next)
}

/// Scales display space about the pivot.
fn zoomed(camera: &Camera, pivot: DVec3, radius: f64, zoom: f64) -> Camera {
    // To scale by nothing would still round.
    if zoom == 1.0 {
        return *camera;
    }
    let [least, most] = [radius / RADIUS_M[1], radius / RADIUS_M[0]];
    let wanted = camera.scale / zoom.clamp(1.0 / ZOOM_MAX, ZOOM_MAX);
    // A camera that a client has set beyond the limits may come back.
    let scale = wanted.clamp(least.min(camera.scale), most.max(camera.scale));
    let position = pivot + (camera.position - pivot) * (scale / camera.scale);
    Camera { position, scale, ..*camera }
}

/// Turns display space about the pivot: to the side about the vertical, and up and down as far as
/// the elevation of its view may go.
fn turned(camera: &Camera, pivot: DVec3, orbit_rad: DVec2) -> Camera {
    // To turn by nothing would still round.
    if orbit_rad == DVec2::ZERO {
        return *camera;
    }
    let whole = std::f64::consts::TAU;
    let forward = camera.rotation * DVec3::NEG_Z;
    let own_right = camera.rotation * DVec3::X;
    let level = forward.cross(DVec3::Y);
    // Straight up or down the camera's own right tells which way it is turned.
    let right = if level.length() > 1e-6 { level } else { own_right.with_y(0.0) };
    let right = right.try_normalize().unwrap_or(DVec3::X);
    let elevation = forward.y.clamp(-1.0, 1.0).asin();
    let limit = ELEVATION_MAX_RAD.max(elevation.abs());
    let to = (elevation - orbit_rad.y.clamp(-whole, whole)).clamp(-limit, limit);
    let tilt = DQuat::from_axis_angle(right, to - elevation);
    let turn = DQuat::from_rotation_y(-(orbit_rad.x % whole)) * tilt;
    let rotation = (turn * camera.rotation).normalize();
    Camera { position: pivot + turn * (camera.position - pivot), rotation, ..*camera }
}

/// Moves display space so that what is as far away as the pivot follows the mouse.
fn panned(camera: &Camera, eye: DVec3, pivot: DVec3, picture: &Picture, pan: DVec2) -> Camera {
    let depth_m = (pivot - camera.world_from_display(eye)).length() / camera.scale;
    let depth = (depth_m / picture.distance_m).max(PAN_DEPTH_MIN);
    let by = (picture.right * pan.x + picture.down * pan.y) * depth;
    Camera { position: camera.position - camera.rotation * (by * camera.scale), ..*camera }
}

#[cfg(test)]
mod tests {
    use glam::UVec2;
    use polyptych_wall::projector::Projector;
    use polyptych_wall::surface::{Cylinder, Plane};
    use polyptych_wall::{Channel, Screen};

    use super::*;

    const BOUNDS: Bounds =
        Bounds { min: DVec3::new(8.0, -1.0, -2.0), max: DVec3::new(12.0, 3.0, 2.0) };

    fn wall() -> Wall {
        let plane = Plane::upright(DVec3::new(0.0, 0.0, -2.0), DVec2::new(4.0, 2.0));
        let size = UVec2::new(400, 200);
        let screens = vec![Screen::new("front", Surface::Plane(plane), size)];
        Wall::new("w", screens, vec![Channel::tile("a", 0, UVec2::ZERO, size)])
    }

    fn picture() -> Picture {
        Picture::new(&wall(), ChannelId(0), DVec3::ZERO)
    }

    /// Ten units before the middle of the scene.
    fn camera() -> Camera {
        Camera { position: DVec3::new(10.0, 1.0, 10.0), ..Camera::IDENTITY }
    }

    fn after(camera: &Camera, change: impl Fn(&mut Navigation)) -> Camera {
        let mut navigation = Navigation::none("a");
        change(&mut navigation);
        let next = moved(camera, DVec3::ZERO, &BOUNDS, &picture(), &navigation);
        next.unwrap_or_else(|| panic!("{navigation:?} is refused"))
    }

    /// The pivot in display space.
    fn seen(camera: &Camera, point: DVec3) -> DVec3 {
        camera.rotation.inverse() * (point - camera.position) / camera.scale
    }

    #[test]
    fn an_orbit_keeps_the_middle_of_the_scene_where_it_is_on_the_wall() {
        let mut camera = camera();
        let middle = seen(&camera, BOUNDS.center());
        for (x, y) in [(0.3, 0.0), (0.0, 0.4), (-2.0, -9.0), (7.0, 3.0), (1e9, -1e9)] {
            camera = after(&camera, |it| it.orbit_rad = DVec2::new(x, y));
            assert!(seen(&camera, BOUNDS.center()).distance(middle) < 1e-6, "{camera:?}");
        }
    }

    #[test]
    fn a_drag_to_the_right_turns_the_near_side_to_the_right_and_one_down_shows_it_from_above() {
        let near = BOUNDS.center() + DVec3::Z;
        let right = after(&camera(), |it| it.orbit_rad.x = 0.2);
        assert!(seen(&right, near).x > 0.1, "{}", seen(&right, near));
        let above = after(&camera(), |it| it.orbit_rad.y = 0.2);
        assert!(above.position.y > camera().position.y + 1.0 && seen(&above, near).y < -0.1);
    }

    #[test]
    fn no_drag_reaches_a_pole_or_turns_the_camera_over() {
        for step in [0.01, 0.5, 100.0] {
            for sign in [-1.0, 1.0] {
                let mut camera = camera();
                for _ in 0..500 {
                    camera = after(&camera, |it| it.orbit_rad = DVec2::new(0.1, sign * step));
                    assert_eq!(camera.fault(), None);
                    let up = camera.rotation * DVec3::Y;
                    assert!(up.y > 0.0, "it stands upright: {up}");
                }
            }
        }
        // A camera that looks straight down may come up again.
        let down =
            Camera { rotation: DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2), ..camera() };
        let up = after(&down, |it| it.orbit_rad.y = -0.5);
        let forward = up.rotation * DVec3::NEG_Z;
        assert!((forward.y.asin() + 1.0708).abs() < 1e-3, "{forward}");
    }

    #[test]
    fn zooming_in_and_out_again_comes_back_and_has_limits() {
        let start = camera();
        let near = after(&start, |it| it.zoom = 2.0);
        let offset = |of: &Camera| seen(of, BOUNDS.max) - seen(of, BOUNDS.center());
        assert!((offset(&near).length() / offset(&start).length() - 2.0).abs() < 1e-9);
        let back = after(&near, |it| it.zoom = 0.5);
        assert!(back.position.distance(start.position) < 1e-9, "{back:?}");
        for zoom in [1e-300, 1e300] {
            let mut camera = start;
            for _ in 0..100 {
                camera = after(&camera, |it| it.zoom = zoom);
                let radius_m = BOUNDS.radius() / camera.scale;
                assert!((9e-4..=1.1e6).contains(&radius_m), "{radius_m} m");
            }
            let back = after(&camera, |it| it.zoom = 1.0 / zoom);
            assert!(back != camera, "it comes back from the limit");
        }
    }

    #[test]
    fn a_move_by_nothing_changes_no_bit() {
        for x in 0..100 {
            let start = Camera { position: DVec3::new(f64::from(x) / 7.0, 0.1, 0.7), ..camera() };
            assert_eq!(after(&start, |_| {}), start);
        }
    }

    #[test]
    fn what_is_panned_at_the_depth_of_the_scene_follows_the_mouse() {
        // Half of a screen 4 m wide and 2 m away, at a depth of 10: 10 units.
        let camera = after(&camera(), |it| it.pan = DVec2::new(0.5, 0.0));
        assert!((seen(&camera, BOUNDS.center()) - DVec3::new(10.0, 0.0, -10.0)).length() < 1e-6);
    }

    /// The way in which the scene follows a mouse that moves to the right in this wall's window.
    fn way_of_a_pan(wall: &Wall) -> DVec3 {
        let picture = Picture::new(wall, ChannelId(0), DVec3::ZERO);
        let navigation = Navigation { pan: DVec2::new(0.1, 0.0), ..Navigation::none("a") };
        let next = moved(&camera(), DVec3::ZERO, &BOUNDS, &picture, &navigation);
        let next = next.expect("in reach");
        (seen(&next, BOUNDS.center()) - seen(&camera(), BOUNDS.center())).normalize()
    }

    #[test]
    fn a_pan_goes_along_the_pixels_of_projectors_and_lenses() {
        let mut wall = wall();
        let mut thrown = |position: DVec3, rotation: DQuat| {
            let tangents = [-0.3, 0.3, -0.2, 0.2];
            let projector = Projector { position, rotation, tangents };
            wall.channels[0].cover = ChannelKind::Projector(Box::new(projector));
            way_of_a_pan(&wall)
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        let rolled = thrown(DVec3::ZERO, DQuat::from_rotation_z(quarter));
        assert!(rolled.abs_diff_eq(DVec3::Y, 1e-6), "{rolled}");
        // Who looks at the picture of a rear projector sees the screen from behind.
        let rear = thrown(DVec3::NEG_Z * 6.0, DQuat::from_rotation_y(2.0 * quarter));
        assert!(rear.abs_diff_eq(DVec3::NEG_X, 1e-6), "{rear}");
        // A lens, whose file alone says where pixels are, and a screen all around.
        let round = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: 3.0,
            azimuth_rad: [-2.0 * quarter, 2.0 * quarter],
            height_m: [-1.0, 1.0],
        };
        let screen = Screen::new("round", Surface::Cylinder(round), UVec2::new(4096, 1024));
        let mut lens = Channel::tile("a", 0, UVec2::ZERO, UVec2::splat(2048));
        lens.cover = ChannelKind::Map;
        let lens = way_of_a_pan(&Wall::new("w", vec![screen], vec![lens]));
        assert!(lens.abs_diff_eq(DVec3::X, 1e-6), "{lens}");
    }

    #[test]
    fn a_pan_over_a_warped_tile_goes_along_its_screen() {
        let mut wall = wall();
        let plain = Picture::new(&wall, ChannelId(0), DVec3::ZERO);
        wall.channels[0].cover = ChannelKind::Map;
        let warped = Picture::new(&wall, ChannelId(0), DVec3::ZERO);
        assert!(warped.right.abs_diff_eq(plain.right, 1e-9), "{} {}", warped.right, plain.right);
        assert!(warped.down.abs_diff_eq(plain.down, 1e-9), "{} {}", warped.down, plain.down);
        assert!((warped.distance_m - plain.distance_m).abs() < 1e-9);
    }

    #[test]
    fn a_flight_turns_about_the_viewer_and_moves_along_the_view() {
        let eye = DVec3::new(0.1, 1.6, 0.3);
        let start = Camera { scale: 2.0, ..camera() };
        let viewer = start.world_from_display(eye);
        let fly = |offset_m, turn_rad| {
            let flight = Flight { offset_m, turn_rad };
            flown(&start, eye, Some(&BOUNDS), &flight).expect("in reach")
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        let right = fly(DVec3::NEG_Z * 3.0, DVec2::new(quarter, 0.0));
        // Two units of the scene are a metre of the room.
        let moved = right.world_from_display(eye) - viewer;
        assert!(moved.abs_diff_eq(DVec3::X * 6.0, 1e-9), "{moved}");
        let up = fly(DVec3::ZERO, DVec2::new(0.0, 0.5));
        assert!((up.rotation * DVec3::NEG_Z).y > 0.4, "{up:?}");
        assert!(up.world_from_display(eye).abs_diff_eq(viewer, 1e-9), "{up:?}");
        assert_eq!(fly(DVec3::ZERO, DVec2::ZERO), start);
        for bad in [DVec3::NAN, DVec3::splat(1e300), DVec3::splat(1e12)] {
            let flight = Flight { offset_m: bad, turn_rad: DVec2::ZERO };
            assert_eq!(flown(&start, eye, Some(&BOUNDS), &flight), None, "{bad}");
        }
    }

    #[test]
    fn numbers_that_are_none_move_nothing() {
        for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            let mut navigation = Navigation::none("a");
            navigation.zoom = bad;
            assert_eq!(moved(&camera(), DVec3::ZERO, &BOUNDS, &picture(), &navigation), None);
        }
        for bad in [f64::NAN, f64::INFINITY, f64::MAX] {
            let mut navigation = Navigation::none("a");
            navigation.pan.x = bad;
            assert_eq!(moved(&camera(), DVec3::ZERO, &BOUNDS, &picture(), &navigation), None);
            let bounds = Bounds { min: DVec3::splat(-bad), max: DVec3::splat(bad) };
            let turn = Navigation { orbit_rad: DVec2::ONE, ..Navigation::none("a") };
            if let Some(next) = moved(&camera(), DVec3::ZERO, &bounds, &picture(), &turn) {
                assert_eq!(next.fault(), None);
            }
        }
    }

    #[test]
    fn a_scene_without_extent_can_be_looked_at_from_all_sides() {
        let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        let navigation = Navigation { orbit_rad: DVec2::splat(0.3), ..Navigation::none("a") };
        let at_point = Camera { position: DVec3::ONE, ..Camera::IDENTITY };
        for camera in [camera(), at_point] {
            let next = moved(&camera, DVec3::ZERO, &point, &picture(), &navigation);
            assert!(next.is_some_and(|next| next.rotation != camera.rotation));
        }
    }
}
