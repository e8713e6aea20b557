//! The head as its readings say it, without jumps and without gaps.
//!
//! A reading that no head can have reached is refused until readings there are steady. A device
//! that falls silent leaves its last pose, which is held and then moved back to the wall file's
//! head. Each such change of the target is eased from where the head was.

use polyptych_wall::device::HeadTracking;

use crate::pose_track::PoseTrack;
use crate::sensor_pose::HeadSample;
use crate::{Micros, micros_from_ms, seconds};

/// Time for which readings at another place must follow each other before the head goes there.
pub const STEADY_TIME: Micros = 300_000;

/// Maximum time between the last reading and the time that is predicted for, beyond the prediction
/// that the wall file asks for: some readings of a slow tracker may be missing.
const GAP_MAX: Micros = 50_000;

/// The greatest slope of the ease, whose ends are at rest.
const EASE_SLOPE_MAX: f64 = 1.5;

/// A change that is logged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterEvent {
    /// The head follows readings again.
    Tracked,
    /// A reading is further away than a head can have gone.
    Jumped {
        /// The distance from the reading before, in metres.
        distance_m: f64,
    },
    /// The head moves to the place of a jump because readings there are steady.
    Steady,
    /// No reading came for the time that the wall file names.
    Lost,
    /// The last pose was held long enough; the head moves back to its place in the wall file.
    Released,
}

/// The goal of the head.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    /// The wall file's head.
    Rest,
    /// The track.
    Track,
    /// The last pose of the track, since a time.
    Held(Micros),
}

/// A move from a pose to the target.
#[derive(Clone, Copy, Debug)]
struct Ease {
    from: HeadSample,
    began: Micros,
    length: Micros,
}

/// The head of a wall as one device tracks it.
#[derive(Clone, Debug)]
pub struct PoseFilter {
    tracking: HeadTracking,
    lost_after: Micros,
    rest: HeadSample,
    target: Target,
    track: PoseTrack,
    /// Readings elsewhere, and when they began.
    candidate: Option<(Micros, PoseTrack)>,
    ease: Option<Ease>,
    /// The last pose that was handed out.
    shown: Option<HeadSample>,
    events: Vec<FilterEvent>,
}

impl PoseFilter {
    /// Creates a head that rests at its place in the wall file. `lost_ms` is the silence after
    /// which the device is lost, in milliseconds.
    pub fn new(tracking: HeadTracking, lost_ms: u32, rest: HeadSample) -> Self {
        Self {
            tracking,
            lost_after: micros_from_ms(lost_ms),
            rest,
            target: Target::Rest,
            track: PoseTrack::default(),
            candidate: None,
            ease: None,
            shown: None,
            events: Vec::new(),
        }
    }

    /// Takes a reading. Returns whether the head follows it.
    pub fn add(&mut self, now: Micros, sample: HeadSample) -> bool {
        if !sample.is_finite() {
            return false;
        }
        self.advance(now);
        if self.target == Target::Rest {
            // Nothing is followed that a reading could jump from.
            self.follow(now, PoseTrack::default(), FilterEvent::Tracked);
        }
        match self.track.jump_m(&self.tracking, now, &sample) {
            None => {
                if matches!(self.target, Target::Held(_)) {
                    let track = std::mem::take(&mut self.track);
                    self.follow(now, track, FilterEvent::Tracked);
                }
                self.candidate = None;
                self.track.add(now, sample);
                true
            }
            Some(distance_m) => self.add_elsewhere(now, sample, distance_m),
        }
    }

    fn add_elsewhere(&mut self, now: Micros, sample: HeadSample, distance_m: f64) -> bool {
        let is_far = |track: &PoseTrack| track.jump_m(&self.tracking, now, &sample).is_some();
        // Two reflections with a silence between them are not steady.
        let lost_after = self.lost_after;
        let is_old = |track: &PoseTrack| {
            track.last().is_none_or(|(last, _)| now.saturating_sub(last) >= lost_after)
        };
        let (began, mut track) = match self.candidate.take() {
            Some((began, track)) if !is_far(&track) && !is_old(&track) => (began, track),
            // One event for a place, or for many that follow each other.
            Some(_) => (now, PoseTrack::default()),
            None => {
                self.events.push(FilterEvent::Jumped { distance_m });
                (now, PoseTrack::default())
            }
        };
        track.add(now, sample);
        if now.saturating_sub(began) < STEADY_TIME {
            self.candidate = Some((began, track));
            return false;
        }
        self.follow(now, track, FilterEvent::Steady);
        true
    }

    /// Follows a track from now on, eased from where the head is.
    fn follow(&mut self, now: Micros, track: PoseTrack, event: FilterEvent) {
        let from = self.ease_origin(now);
        (self.track, self.target) = (track, Target::Track);
        self.events.push(event);
        self.begin_ease(now, from);
    }

    /// Returns the pose that an ease begins at: the last one that was handed out. Predictions have
    /// gone on since the last reading, but no frame has shown them.
    fn ease_origin(&self, now: Micros) -> HeadSample {
        self.shown.unwrap_or_else(|| self.raw(now))
    }

    fn begin_ease(&mut self, now: Micros, from: HeadSample) {
        self.ease = Some(Ease { from, began: now, length: micros_from_ms(self.tracking.ease_ms) });
    }

    /// Applies the changes that the passing of time causes: a silent device is lost, and a held
    /// pose is released.
    pub fn advance(&mut self, now: Micros) {
        if let (Target::Track, Some((last, pose))) = (self.target, self.track.last())
            && now.saturating_sub(last) >= self.lost_after
        {
            let from = self.ease_origin(now);
            let mut held = PoseTrack::default();
            held.add(last, pose);
            (self.track, self.target) = (held, Target::Held(now));
            self.events.push(FilterEvent::Lost);
            self.begin_ease(now, from);
        }
        if let Target::Held(since) = self.target
            && now.saturating_sub(since) >= micros_from_ms(self.tracking.hold_ms)
        {
            let from = self.ease_origin(now);
            self.target = Target::Rest;
            self.events.push(FilterEvent::Released);
            self.begin_ease(now, from);
        }
        if self.ease.is_some_and(|ease| self.progress(&ease, now) >= 1.0) {
            self.ease = None;
        }
    }

    /// Returns the pose of the head for a frame that begins at `now`, within the bounds of the wall
    /// file; call [`Self::advance`] before.
    pub fn pose(&mut self, now: Micros) -> HeadSample {
        let mut pose = self.raw(now);
        if let Some([low, high]) = self.tracking.bounds {
            pose.position = pose.position.clamp(low, high);
        }
        self.shown = Some(pose);
        pose
    }

    fn raw(&self, now: Micros) -> HeadSample {
        let target = self.goal(now);
        let Some(ease) = self.ease else { return target };
        let t = self.progress(&ease, now).clamp(0.0, 1.0);
        ease.from.mix(&target, t * t * (3.0 - 2.0 * t))
    }

    /// Returns the elapsed fraction of an ease, 1 and more after its end. A long way takes longer,
    /// so that the head never moves faster than `speed_max`.
    fn progress(&self, ease: &Ease, now: Micros) -> f64 {
        let way_m = self.goal(now).position.distance(ease.from.position);
        let least_s = EASE_SLOPE_MAX * way_m / self.tracking.speed_max;
        let length_s = seconds(ease.length).max(least_s);
        seconds(now.saturating_sub(ease.began)) / length_s
    }

    fn goal(&self, now: Micros) -> HeadSample {
        let speed_max = self.tracking.speed_max;
        let followed = match self.target {
            Target::Rest => None,
            Target::Held(_) => self.track.last().map(|(_, pose)| pose),
            Target::Track => self.track.last().and_then(|(last, _)| {
                let ahead = micros_from_ms(self.tracking.prediction_ms);
                // Without a prediction the pose is the last reading, however old.
                let gap = if ahead == 0 { 0 } else { now.saturating_sub(last).min(GAP_MAX) };
                self.track.predicted(speed_max, gap + ahead)
            }),
        };
        followed.unwrap_or(self.rest)
    }

    /// Returns whether the head moves at `now` without readings.
    pub fn is_moving(&self) -> bool {
        self.ease.is_some()
    }

    /// Returns whether the head follows a device.
    pub fn is_tracked(&self) -> bool {
        self.target == Target::Track
    }

    /// Returns the time at which [`Self::advance`] is due next.
    pub fn poll_timeout(&self) -> Option<Micros> {
        match self.target {
            Target::Rest => None,
            Target::Held(since) => Some(since + micros_from_ms(self.tracking.hold_ms)),
            Target::Track => self.track.last().map(|(last, _)| last + self.lost_after),
        }
    }

    /// Returns the events since the last call.
    pub fn take_events(&mut self) -> Vec<FilterEvent> {
        std::mem::take(&mut self.events)
    }
}

#[cfg(test)]
mod tests;
