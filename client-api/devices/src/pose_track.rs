//! Readings of a head that belong together, and where they lead.

use std::collections::VecDeque;

use glam::DVec3;
use polyptych_wall::device::HeadTracking;

use crate::sensor_pose::HeadSample;
use crate::{Micros, seconds};

/// Time that the velocity is taken over: long enough to divide noise by, shorter than a nod.
const VELOCITY_SPAN: Micros = 50_000;

/// Maximum number of readings within [`VELOCITY_SPAN`]: those of a tracker at 1 kHz.
const SAMPLES_MAX: usize = 64;

/// Maximum speed of a turning head that is predicted, in radians per second: fast sports.
const ANGULAR_SPEED_MAX: f64 = 15.0;

/// Maximum time that the last reading explains how far the head has gone meanwhile.
const ELAPSED_MAX: Micros = 1_000_000;

/// Readings that follow each other without a jump, oldest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct PoseTrack {
    samples: VecDeque<(Micros, HeadSample)>,
}

impl PoseTrack {
    /// Returns the last reading and when it came.
    pub fn last(&self) -> Option<(Micros, HeadSample)> {
        self.samples.back().copied()
    }

    /// Returns how far a reading is beyond what a head can have moved since the last one, in
    /// metres; `None` if it can be there.
    pub fn jump_m(&self, tracking: &HeadTracking, at: Micros, sample: &HeadSample) -> Option<f64> {
        let (last_at, last) = self.last()?;
        let elapsed_s = seconds(at.saturating_sub(last_at).min(ELAPSED_MAX));
        let distance_m = sample.position.distance(last.position);
        let reach_m = tracking.jump_m + tracking.speed_max * elapsed_s;
        (distance_m > reach_m).then_some(distance_m)
    }

    /// Adds the newest reading.
    pub fn add(&mut self, at: Micros, sample: HeadSample) {
        self.samples.push_back((at, sample));
        // The one before the span begins stays: a slow tracker has a velocity too.
        let is_old = |of: Option<&(Micros, HeadSample)>| {
            of.is_some_and(|(of, _)| at.saturating_sub(*of) >= VELOCITY_SPAN)
        };
        while self.samples.len() > SAMPLES_MAX || is_old(self.samples.get(1)) {
            self.samples.pop_front();
        }
    }

    /// Returns the pose at a time after the last reading, with constant velocities of the last
    /// readings, bounded by the speed of a head. `ahead` is the time since the last reading.
    pub fn predicted(&self, speed_max: f64, ahead: Micros) -> Option<HeadSample> {
        let (last_at, last) = self.last()?;
        let &(first_at, first) = self.samples.front()?;
        let span_s = seconds(last_at.saturating_sub(first_at));
        if ahead == 0 || span_s <= 0.0 {
            return Some(last);
        }
        let velocity = (last.position - first.position) / span_s;
        let turn = last.rotation * first.rotation.inverse();
        // The shorter of both ways.
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let angular = turn.to_scaled_axis() / span_s;
        let ahead_s = seconds(ahead);
        let offset = velocity.clamp_length_max(speed_max) * ahead_s;
        let angle = angular.clamp_length_max(ANGULAR_SPEED_MAX) * ahead_s;
        let rotation = turned(angle) * last.rotation;
        let pose = HeadSample { position: last.position + offset, rotation: rotation.normalize() };
        Some(pose).filter(HeadSample::is_finite).or(Some(last))
    }
}

/// The rotation by a vector along its axis with the angle as its length.
fn turned(scaled_axis: DVec3) -> glam::DQuat {
    glam::DQuat::from_scaled_axis(scaled_axis)
}
