//! The head of a viewer whose bridge has left, or has not come back to a restarted manager: it is
//! held, then eased to its place in the wall file, as the bridge does for a tracker that falls
//! silent.

use polyptych_protocol::head_update::HeadUpdate;
use polyptych_wall::device::HeadTracking;
use polyptych_wall::head::HeadPose;
use serde::{Deserialize, Serialize};

use super::{Cluster, Micros, SessionId};

/// Time between two places of a head that moves: as often as most displays show a frame.
const STEP: Micros = 16_667;

/// The greatest slope of the ease, whose ends are at rest.
const EASE_SLOPE_MAX: f64 = 1.5;

/// The way of a head from where its bridge left it to its place in the wall file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct HeadReturn {
    from: HeadPose,
    /// The end of the hold.
    begins: Micros,
    ends: Micros,
    /// The time of the next place.
    pub next: Micros,
}

impl HeadReturn {
    /// Begins the return of a head from one pose to another. A long way takes longer than the wall
    /// file's `ease_ms`, so that the head never moves faster than its `speed_max`.
    fn new(now: Micros, tracking: &HeadTracking, from: HeadPose, to: &HeadPose) -> Self {
        let way_m = from.position.distance(to.position);
        let least_us = EASE_SLOPE_MAX * way_m / tracking.speed_max * 1e6;
        let ease_us = (Micros::from(tracking.ease_ms) * 1000).max(least_us as Micros);
        let begins = now + Micros::from(tracking.hold_ms) * 1000;
        Self { from, begins, ends: begins + ease_us, next: begins }
    }

    /// Returns the pose at a time, on the way to another.
    fn pose(&self, now: Micros, to: &HeadPose) -> HeadPose {
        let length = self.ends.saturating_sub(self.begins).max(1);
        let t = (now.saturating_sub(self.begins) as f64 / length as f64).min(1.0);
        let eased = t * t * (3.0 - 2.0 * t);
        HeadPose {
            position: self.from.position.lerp(to.position, eased),
            rotation: self.from.rotation.slerp(to.rotation, eased).normalize(),
            ..*to
        }
    }
}

impl Cluster {
    /// Moves the head as a client asks for, or a session or another manager (`None`); that ends a
    /// return.
    pub(super) fn place_head(
        &mut self,
        client: Option<SessionId>,
        update: HeadUpdate,
    ) -> Result<(), String> {
        self.set_head(update)?;
        (self.devices.head_of, self.devices.head_return) = (client, None);
        Ok(())
    }

    /// Begins the return of a head whose bridge has left.
    pub(super) fn begin_head_return(&mut self, now: Micros) {
        let (from, to) = (self.presentation.head, self.resting_head());
        let mut trackers = self.wall.devices.iter().filter_map(|device| device.head.as_ref());
        let Some(tracking) = trackers.next() else {
            // The tracker is no longer in the wall file: its bridge cannot come back.
            self.presentation.head = to;
            return;
        };
        let way = HeadReturn::new(now, tracking, from, &to);
        self.devices.head_return = (from != to).then_some(way);
    }

    /// The head at its place in the wall file, with the eyes as far apart as they are.
    fn resting_head(&self) -> HeadPose {
        let eye_separation_m = self.presentation.head.eye_separation_m;
        HeadPose { eye_separation_m, ..self.wall.head() }
    }

    /// Moves a head that returns to where it is by now.
    pub(super) fn update_head_return(&mut self, now: Micros) {
        let Some(way) = self.devices.head_return.as_mut().filter(|way| now >= way.next) else {
            return;
        };
        way.next = now + STEP;
        let (way, to) = (*way, self.resting_head());
        let is_over = now >= way.ends;
        // A pose on the way may be one from which a display cannot be seen.
        if is_over || self.set_head(way.pose(now, &to).into()).is_err() {
            self.presentation.head = to;
            self.devices.head_return = None;
            self.persist();
        }
        self.wants_frame |= !self.pacer.is_soon(now);
    }
}
