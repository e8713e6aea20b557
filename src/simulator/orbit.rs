//! The path of the camera around a scene, the same for runs, reports and other renderers.

use std::f64::consts::TAU;

use polyptych_client::{Bounds, Camera, orbit};
use polyptych_wall::Wall;

/// The heading from which the camera looks at first, in radians around the vertical.
pub(crate) const HEADING_RAD: f64 = 0.52;

/// One turn of the camera, in seconds of scene time.
const TURN_SECONDS: f64 = 12.0;

/// Frames for each second of scene time, if no rate is given: the camera turns by 1° a frame.
pub(crate) const TIME_RATE: f64 = 30.0;

/// Returns the camera at a scene time in seconds.
pub(crate) fn camera_at(wall: &Wall, focus: &Bounds, time_s: f64) -> Camera {
    orbit(wall, focus, HEADING_RAD + TAU * time_s / TURN_SECONDS)
}

/// Returns `count` scene times in seconds, evenly spaced over one turn.
pub(crate) fn times_of_turn(count: u32) -> impl Iterator<Item = f64> {
    (0..count).map(move |index| TURN_SECONDS * f64::from(index) / f64::from(count))
}
