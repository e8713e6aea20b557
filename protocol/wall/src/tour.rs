//! A way of the camera through stops, as a function of time alone.
//!
//! ```text
//! start --travel--> stop 0 --stay, travel--> stop 1 --stay, travel--> ... [--travel--> stop 0]
//! ```
//!
//! The position follows from the place of the eye, which goes straight or along a centripetal
//! Catmull–Rom curve (C. Yuksel, S. Schaefer, J. Keyser, *Parameterization and applications of
//! Catmull–Rom curves*, 2011): what the viewer sees moves evenly, whatever the display space turns
//! about. Rotation goes the shortest way, or along the same curve in rotation vectors (M.-J. Kim,
//! M.-S. Kim, S. Y. Shin, *A general construction scheme for unit quaternion curves with simple
//! high order derivatives*, 1995), so that it turns through a stop without a jerk too. Scale goes
//! in its logarithm.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::limits::{TOUR_SECONDS_MAX, TOUR_STOPS_MAX};

/// Maximum distance of a stop from the origin and maximum scale, in world units: squares of
/// distances stay finite.
const REACH_MAX: f64 = 1e100;

/// The way in which a tour gets to a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Easing {
    /// Along a curve, without a jerk: from rest, to rest, and through stops without a stay.
    #[default]
    Smooth,
    /// Straight, at one speed.
    Linear,
}

/// A place where a tour goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TourStop {
    /// The camera at the stop.
    pub camera: Camera,
    /// Seconds from the stop before to this one, from 0; 0 is a cut. Those of the first stop begin
    /// where the camera is when the tour begins and, in a loop, at the last stop.
    pub travel_s: f64,
    /// Seconds at the stop, from 0.
    pub stay_s: f64,
    /// The way in which it gets here.
    pub easing: Easing,
}

impl TourStop {
    /// A smooth travel of so many seconds to this camera, without a stay.
    pub fn new(camera: Camera, travel_s: f64) -> Self {
        Self { camera, travel_s, stay_s: 0.0, easing: Easing::Smooth }
    }

    /// Returns the stop with a stay of so many seconds.
    pub fn with_stay(self, stay_s: f64) -> Self {
        Self { stay_s, ..self }
    }

    /// Returns the stop with this easing.
    pub fn with_easing(self, easing: Easing) -> Self {
        Self { easing, ..self }
    }
}

/// A way of the camera through stops.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tour {
    /// In order; 1 to [`TOUR_STOPS_MAX`].
    pub stops: Vec<TourStop>,
    /// `true` if the tour goes on from the last stop to the first one, indefinitely.
    pub is_loop: bool,
}

/// The reason why stops are not a tour.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TourError {
    /// There are none, or too many.
    #[error("a tour has 1 to {TOUR_STOPS_MAX} stops, not {0}")]
    Stops(usize),
    /// A stop is wrong.
    #[error("stop {stop}: {reason}")]
    Stop {
        /// Its index, from 0.
        stop: usize,
        /// The fault, and what would be right.
        reason: String,
    },
    /// A loop takes no time.
    #[error("a tour in a loop takes 0 seconds; give a stop seconds to travel or to stay")]
    EmptyLoop,
}

/// One travel of a tour.
struct Travel<'a> {
    tour: &'a Tour,
    /// The camera with which the tour begins.
    from: &'a Camera,
    /// The eye in display space.
    eye: DVec3,
    /// The number of the camera it goes from: 0 is the tour's start, 1 the first stop.
    at: usize,
}

impl Tour {
    /// A tour that goes from place to place in straight lines at one speed, in world units per
    /// second, above 0. It begins where the camera is; `eye` is the point of display space that is
    /// at each of the points of the world in turn.
    pub fn along(camera: Camera, eye: DVec3, points: &[DVec3], speed: f64) -> Self {
        let mut at = camera.world_from_display(eye);
        let stops = points.iter().map(|point| {
            let travel_s = at.distance(*point) / speed;
            at = *point;
            TourStop::new(camera.with_eye_at(eye, at), travel_s).with_easing(Easing::Linear)
        });
        Self { stops: stops.collect(), is_loop: false }
    }

    /// This tour with a camera that looks, level, where it goes next; at the end of its way it
    /// looks as before.
    #[must_use]
    pub fn looking_ahead(mut self, eye: DVec3) -> Self {
        let eyes: Vec<DVec3> =
            self.stops.iter().map(|stop| stop.camera.world_from_display(eye)).collect();
        let mut ahead = None;
        for (index, stop) in self.stops.iter_mut().enumerate() {
            let way = eyes.get(index + 1).map(|next| (*next - eyes[index]).with_y(0.0));
            ahead = way.filter(|way| way.length_squared() > 0.0).or(ahead);
            if let Some(way) = ahead {
                let turned = Camera::look_at(DVec3::ZERO, way, DVec3::Y);
                let camera = Camera { rotation: turned.rotation, ..stop.camera };
                stop.camera = camera.with_eye_at(eye, eyes[index]);
            }
        }
        self
    }

    /// Checks numbers that came from outside.
    ///
    /// # Errors
    /// The first stop that is wrong, with its index from 0, or what else is.
    pub fn validate(&self) -> Result<(), TourError> {
        if !(1..=TOUR_STOPS_MAX).contains(&self.stops.len()) {
            return Err(TourError::Stops(self.stops.len()));
        }
        for (index, stop) in self.stops.iter().enumerate() {
            if let Some(reason) = stop.fault() {
                return Err(TourError::Stop { stop: index, reason });
            }
        }
        if self.is_loop && self.round_s() <= 0.0 {
            return Err(TourError::EmptyLoop);
        }
        Ok(())
    }

    /// Seconds from the beginning to the end of the last stop's stay, of a loop those of a round.
    pub fn round_s(&self) -> f64 {
        self.stops.iter().fold(0.0, |sum, stop| sum + stop.travel_s + stop.stay_s)
    }

    /// Returns whether the tour is over at this time; a loop never is.
    pub fn is_over(&self, time_s: f64) -> bool {
        !self.is_loop && time_s >= self.round_s()
    }

    /// The camera at `time_s` seconds from the beginning, of a tour that begins at `from` and is
    /// [valid](Self::validate). `eye` is the point of display space, in metres, that moves evenly.
    ///
    /// From the arrival at a stop to the end of its stay it is the stop's camera, bit for bit;
    /// before the beginning it is `from`, and after the end the last stop's.
    pub fn camera_at(&self, from: &Camera, eye: DVec3, time_s: f64) -> Camera {
        let mut rest = if time_s.is_nan() { 0.0 } else { time_s.clamp(0.0, f64::MAX) };
        let (round_s, count) = (self.round_s(), self.stops.len());
        let mut at = 0;
        if self.is_loop && round_s > 0.0 && rest >= round_s {
            // The second round still has the tour's start two cameras back.
            at = if rest >= 2.0 * round_s { 2 * count } else { count };
            rest %= round_s;
        }
        let mut began = 0.0;
        for stop in &self.stops {
            let arrival = began + stop.travel_s;
            if rest < arrival {
                return Travel { tour: self, from, eye, at }.camera_at(rest - began);
            }
            began = arrival + stop.stay_s;
            if rest < began {
                return stop.camera;
            }
            at += 1;
        }
        self.stops.last().map_or(*from, |stop| stop.camera)
    }
}

impl TourStop {
    /// Returns the fault of these numbers, if they have one.
    fn fault(&self) -> Option<String> {
        if let Some(fault) = self.camera.fault() {
            return Some(fault);
        }
        let Camera { position, scale, .. } = self.camera;
        if position.abs().max_element() > REACH_MAX {
            return Some(format!("camera position {position} is further than {REACH_MAX:e} away"));
        }
        if !(1.0 / REACH_MAX..=REACH_MAX).contains(&scale) {
            return Some(format!("camera scale {scale} is not from 1e-100 to {REACH_MAX:e}"));
        }
        for (what, seconds) in [("travel", self.travel_s), ("stay", self.stay_s)] {
            if !(0.0..=TOUR_SECONDS_MAX).contains(&seconds) {
                let range = format!("from 0 to {TOUR_SECONDS_MAX}");
                return Some(format!("the seconds of its {what} are {range}, not {seconds}"));
            }
        }
        None
    }

    fn is_smooth(&self) -> bool {
        self.travel_s > 0.0 && self.easing == Easing::Smooth
    }
}

impl Travel<'_> {
    fn camera_at(&self, elapsed_s: f64) -> Camera {
        let (Some(begin), Some(end)) = (self.camera(self.at), self.camera(self.at + 1)) else {
            return *self.from;
        };
        let Some(stop) = self.stop(self.at + 1) else { return end };
        let time = (elapsed_s / stop.travel_s).clamp(0.0, 1.0);
        let progress = match stop.easing {
            Easing::Linear => time,
            Easing::Smooth => self.eased(stop.travel_s, time),
        };
        if progress <= 0.0 {
            return begin;
        }
        let eye = match stop.easing {
            Easing::Linear => {
                let eyes = [begin, end].map(|camera| camera.world_from_display(self.eye));
                eyes[0].lerp(eyes[1], progress)
            }
            Easing::Smooth => self.on_curve(progress),
        };
        let rotation = match stop.easing {
            Easing::Linear => begin.rotation.slerp(end.rotation, progress),
            Easing::Smooth => self.on_rotation_curve(begin.rotation, end.rotation, progress),
        };
        let rotation = rotation.normalize();
        let scale = if begin.scale == end.scale {
            end.scale
        } else {
            let logs = [begin.scale.ln(), end.scale.ln()];
            (logs[0] + (logs[1] - logs[0]) * progress).exp()
        };
        let position = eye - rotation * (scale * self.eye);
        let camera = Camera { position, rotation, scale };
        // Finite numbers that are far apart can still end up as none.
        if camera.fault().is_none() { camera } else { end }
    }

    /// A camera of the tour by its number.
    fn camera(&self, number: usize) -> Option<Camera> {
        if number == 0 { Some(*self.from) } else { self.stop(number).map(|stop| stop.camera) }
    }

    /// The stop that the travel to camera `number` leads to.
    fn stop(&self, number: usize) -> Option<&TourStop> {
        let (index, count) = (number.checked_sub(1)?, self.tour.stops.len());
        if index >= count && !self.tour.is_loop {
            return None;
        }
        self.tour.stops.get(index % count.max(1))
    }

    fn eye(&self, number: usize) -> Option<DVec3> {
        self.camera(number).map(|camera| camera.world_from_display(self.eye))
    }

    /// The length of the travel to camera `number` in the parameter of the curve: the root of
    /// the distance of its ends. `None` if it is no travel but a cut, or there is none.
    fn length(&self, number: usize) -> Option<f64> {
        self.stop(number).filter(|stop| stop.travel_s > 0.0)?;
        Some(self.eye(number)?.distance(self.eye(number - 1)?).sqrt())
    }

    /// The share of the travel that is done at a share of its time: a cubic that begins and ends
    /// with the speed at the stops, without going back (F. Fritsch, J. Butland, *A method for
    /// constructing local monotone piecewise cubic interpolants*, 1984).
    fn eased(&self, travel_s: f64, time: f64) -> f64 {
        let to = self.at + 1;
        let mine = self.length(to).map_or(0.0, |length| length / travel_s);
        // From 0 to 2; up to 3 the cubic is monotone.
        let slope = |through: usize, other: usize| {
            let stops = [self.stop(to), self.stop(other)];
            let are_smooth = stops.iter().all(|stop| stop.is_some_and(TourStop::is_smooth));
            let stays = self.stop(through).is_none_or(|stop| stop.stay_s > 0.0);
            if !are_smooth || stays {
                return 0.0;
            }
            let other_s = self.stop(other).map_or(1.0, |stop| stop.travel_s);
            let other = self.length(other).map_or(0.0, |length| length / other_s);
            let sum = mine + other;
            if sum > 0.0 && mine > 0.0 { 2.0 * other / sum } else { 0.0 }
        };
        let (begin, end) = (slope(self.at, self.at), slope(to, to + 1));
        let cubic = ((begin - 2.0 + end) * time + (3.0 - 2.0 * begin - end)) * time + begin;
        (cubic * time).clamp(0.0, 1.0)
    }

    /// The rotation at a share of the way along the curve: cumulative cubic Bézier, whose inner
    /// control rotations are a third of the turns at the ends away.
    fn on_rotation_curve(&self, begin: DQuat, end: DQuat, progress: f64) -> DQuat {
        let (from, to) = (self.at, self.at + 1);
        let chord = turn_between(begin, end);
        let rotation = |number| self.camera(number).map(|camera: Camera| camera.rotation);
        let before = rotation(from.saturating_sub(1)).map(|before| turn_between(before, begin));
        let after = rotation(to + 1).map(|after| turn_between(end, after));
        let at_begin = self.tangent(chord, from, before) / 3.0;
        let at_end = self.tangent(chord, to + 1, after) / 3.0;
        let (u, turn) = (progress, DQuat::from_scaled_axis);
        let middle = turn_between(begin * turn(at_begin), end * turn(-at_end));
        let first = turn(at_begin * (1.0 - (1.0 - u).powi(3)));
        let second = turn(middle * (u * u * (3.0 - 2.0 * u)));
        begin * first * second * turn(at_end * u.powi(3))
    }

    /// The direction at an end of this travel, for all of its length, where another one continues
    /// it, or its own chord where none does. The other one leads to camera `number`, along `other`.
    fn tangent(&self, chord: DVec3, number: usize, other: Option<DVec3>) -> DVec3 {
        let length = self.length(self.at + 1).unwrap_or(0.0);
        let other = other.zip(self.length(number).filter(|length| *length > 0.0));
        let Some((other, other_length)) = other.filter(|_| length > 0.0) else { return chord };
        let across = (chord + other) / (length + other_length);
        length * (chord / length + other / other_length - across)
    }

    /// The eye in the world at a share of the way along the curve.
    fn on_curve(&self, progress: f64) -> DVec3 {
        let (from, to) = (self.at, self.at + 1);
        let (Some(begin), Some(end)) = (self.eye(from), self.eye(to)) else { return DVec3::ZERO };
        let chord = end - begin;
        let before = self.eye(from.saturating_sub(1)).map(|before| begin - before);
        let after = self.eye(to + 1).map(|after| after - end);
        let at_begin = self.tangent(chord, from, before);
        let at_end = self.tangent(chord, to + 1, after);
        let u = progress;
        let bend = (at_begin - chord) * (u - 1.0) + (at_end - chord) * u;
        begin + chord * u + bend * (u * (u - 1.0))
    }
}

/// The shortest turn from one rotation to another, as a rotation vector in the space of either:
/// along its axis, as long as its angle in radians.
fn turn_between(from: DQuat, to: DQuat) -> DVec3 {
    let turn = from.inverse() * to;
    let turn = if turn.w < 0.0 { -turn } else { turn };
    turn.to_scaled_axis()
}

#[cfg(test)]
mod tests;
