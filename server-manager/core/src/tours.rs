//! The camera as a tour moves it: a function of scene time, evaluated for every frame.
//!
//! ```text
//! played --a frame is asked for or paced--> moves --own clock beyond the end--> over
//! ```
//!
//! Scene time begins anew with every life of the manager, unless clients give it with each frame.
//! A tour on the wall's own clock therefore goes on where it was; one on a client's clock keeps the
//! time at which it began.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::tour_status::TourStatus;
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::Tour;
use serde::{Deserialize, Serialize};

use super::frame_request::FrameRequest;
use super::navigate::REMEMBER_WAIT;
use super::presentation::checked_camera;
use super::{Cluster, Micros};

/// A tour that is played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlayedTour {
    /// Its stops.
    pub tour: Tour,
    /// The camera with which it begins.
    pub from: Camera,
    /// The relation of its time to scene time.
    pub clock: TourClock,
}

/// The relation of the time of a tour, or of a followed node, to scene time; all in seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum TourClock {
    /// No frame of it was begun in this life of the manager.
    Waiting {
        /// The tour's time at its next frame.
        at_s: f64,
    },
    /// It was begun by a frame on the wall's own clock.
    Own {
        /// Scene time of its first frame in this life of the manager.
        scene_s: f64,
        /// The tour's time at that frame.
        at_s: f64,
    },
    /// It was begun by a frame whose time a client gave.
    Given {
        /// Scene time at which it began.
        began_s: f64,
    },
}

impl TourClock {
    /// The tour's time in a frame at this scene time; `None` before its first frame.
    fn tour_time_s(&self, time_s: f64) -> Option<f64> {
        let time_s = match self {
            Self::Waiting { .. } => return None,
            Self::Own { scene_s, at_s } => at_s + (time_s - scene_s),
            Self::Given { began_s } => time_s - began_s,
        };
        // Finite times that are far apart can have an infinite difference.
        Some(time_s.clamp(-f64::MAX, f64::MAX))
    }

    /// Begins with a frame at this scene time, which a client gave or not, if it has not yet.
    pub(super) fn begin(&mut self, is_given: bool, time_s: f64) {
        let Self::Waiting { at_s } = *self else { return };
        *self = if is_given {
            Self::Given { began_s: time_s - at_s }
        } else {
            Self::Own { scene_s: time_s, at_s }
        };
    }

    /// The time in a frame at this scene time, that with which it will begin before.
    pub(super) fn time_at(&self, time_s: f64) -> f64 {
        match self {
            Self::Waiting { at_s } => *at_s,
            _ => self.tour_time_s(time_s).unwrap_or_default(),
        }
    }

    /// The clock with which another life of the manager goes on, whose scene time begins anew.
    pub(super) fn remembered(self, time_s: f64) -> Self {
        match self {
            Self::Own { at_s, .. } => {
                Self::Waiting { at_s: self.tour_time_s(time_s).unwrap_or(at_s) }
            }
            other => other,
        }
    }

    fn began_s(&self) -> Option<f64> {
        match self {
            Self::Waiting { .. } => None,
            Self::Own { scene_s, at_s } => Some(scene_s - at_s),
            Self::Given { began_s } => Some(*began_s),
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        match self {
            Self::Waiting { at_s } => at_s.is_finite(),
            Self::Own { scene_s, at_s } => scene_s.is_finite() && at_s.is_finite(),
            Self::Given { began_s } => began_s.is_finite(),
        }
    }
}

impl PlayedTour {
    /// Returns whether only the time differs.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.tour == other.tour && self.from == other.from
    }
}

impl Cluster {
    /// Places the camera for good, which ends what moves it.
    pub(super) fn place_camera(&mut self, camera: Camera) {
        self.end_motion();
        self.presentation.camera = camera;
    }

    /// Does what a client asks of stored views and tours.
    ///
    /// # Errors
    /// The fault, and what would be right.
    pub(super) fn guide(&mut self, request: Request) -> Result<Response, String> {
        match request {
            Request::PlayTour(tour) => self.play_tour(tour)?,
            Request::StopTour => self.end_motion(),
            Request::DescribeTour => return Ok(Response::Tour(Box::new(self.tour_status()))),
            other => return self.stored_view(other),
        }
        Ok(Response::Done)
    }

    fn play_tour(&mut self, mut tour: Tour) -> Result<(), String> {
        tour.validate().map_err(|error| error.to_string())?;
        for stop in &mut tour.stops {
            stop.camera = checked_camera(stop.camera)?;
        }
        self.end_motion();
        let clock = TourClock::Waiting { at_s: 0.0 };
        self.tour = Some(PlayedTour { tour, from: self.presentation.camera, clock });
        Ok(())
    }

    /// Moves the camera to where the tour has it in the frame that begins. A frame that nobody has
    /// asked for is no beginning: it shows what the last one did.
    pub(super) fn follow_tour(&mut self, order: Option<&FrameRequest>, time_s: f64, now: Micros) {
        let is_timed = self.is_timed(order);
        let is_given = order.is_some_and(|order| order.time_s.is_some());
        let Some(PlayedTour { tour, from, clock }) = &mut self.tour else { return };
        if is_timed {
            clock.begin(is_given, time_s);
        }
        let Some(tour_s) = clock.tour_time_s(time_s) else { return };
        self.presentation.camera = tour.camera_at(from, self.wall.eye, tour_s);
        // A client that gives times may go back to one that was.
        if !is_given && tour.is_over(tour_s) {
            self.tour = None;
            self.navigator.remember_at.get_or_insert(now + REMEMBER_WAIT);
        }
    }

    pub(super) fn tour_status(&self) -> TourStatus {
        let played = self.tour.as_ref();
        TourStatus {
            tour: played.map(|played| played.tour.clone()),
            following: self.followed(),
            began_s: played.and_then(|played| played.clock.began_s()),
            time_s: self.time_s,
            pace: self.pacer.pace(),
        }
    }

    /// The tour as another life of the manager goes on with it.
    pub(super) fn remembered_tour(&self) -> Option<PlayedTour> {
        let mut played = self.tour.clone()?;
        played.clock = played.clock.remembered(self.time_s);
        Some(played)
    }

    /// Takes over the tour of another life of the manager, looked at as that of a client is.
    pub(super) fn restore_tour(&mut self, remembered: Option<&PlayedTour>) {
        let Some(played) = remembered else { return };
        let fault = played.from.fault();
        let fault = fault.or_else(|| played.tour.validate().err().map(|error| error.to_string()));
        let is_timeless = !played.clock.is_finite();
        let fault = fault.or_else(|| is_timeless.then(|| "its time is not finite".to_owned()));
        match fault {
            None => self.tour = Some(played.clone()),
            Some(reason) => tracing::warn!(reason, "the tour in the state file was dropped"),
        }
    }
}
