//! The camera as a tour moves it: a function of scene time, evaluated for every frame.
//!
//! ```text
//! played --a frame is asked for or paced--> moves --own clock beyond the end--> over
//! ```
//!
//! As a clip, a tour has two clocks: frames whose time a client gives have the tour at that time,
//! others go on by the wall's own clock. Scene time begins anew with every life of the manager,
//! unless clients give it. The wall's own clock therefore goes on where it was, after a pause too;
//! that of clients keeps the time at which it began.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::tour_status::TourStatus;
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::Tour;
use serde::{Deserialize, Serialize};

use super::clips::Beginning;
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
    /// No frame of it was begun.
    Waiting {
        /// The tour's time at its next frame on the wall's own clock.
        at_s: f64,
    },
    /// A frame of it was begun.
    Begun {
        /// Its beginning on the wall's own clock; `None` before a frame on that.
        own: Option<Beginning>,
        /// Scene time at which it began on the clock of clients; `None` before one gave a time.
        given_s: Option<f64>,
        /// The tour's time in the last frame.
        at_s: f64,
    },
}

impl TourClock {
    /// Returns the tour's time in the last frame; before its first frame, that with which it
    /// begins.
    pub(super) fn at_s(&self) -> f64 {
        let (Self::Waiting { at_s } | Self::Begun { at_s, .. }) = self;
        *at_s
    }

    fn beginnings(&self) -> (Option<Beginning>, Option<f64>) {
        match *self {
            Self::Waiting { .. } => (None, None),
            Self::Begun { own, given_s, .. } => (own, given_s),
        }
    }

    /// Goes on to a frame at this scene time, which a client gave or not. Returns whether the clock
    /// of clients began with it. That is to be persisted at once: a film that goes on after a
    /// restart of the manager has the same cameras then.
    ///
    /// The clock of clients agrees with the wall's own if that goes on, so that a film can begin
    /// where the tour did; else the tour begins with the frame.
    pub(super) fn advance(&mut self, is_given: bool, time_s: f64) -> bool {
        let (mut own, given_s) = self.beginnings();
        if is_given {
            let began_s = given_s.or(own.and_then(own_began_s)).unwrap_or(time_s);
            // Finite times that are far apart can have an infinite difference.
            let at_s = (time_s - began_s).clamp(-f64::MAX, f64::MAX);
            *self = Self::Begun { own, given_s: Some(began_s), at_s };
            return given_s.is_none();
        }
        let clock = own.get_or_insert(Beginning { scene_s: None, at_s: self.at_s() });
        let at_s = clock.advance(time_s, 1.0);
        *self = Self::Begun { own, given_s, at_s };
        false
    }

    /// Returns the clock with which the wall goes on after a pause, or another life of the manager,
    /// whose scene time begins anew. `own_s` is scene time of the last frame on the wall's own
    /// clock.
    pub(super) fn remembered(self, own_s: f64) -> Self {
        match self {
            Self::Waiting { .. } => self,
            Self::Begun { own, given_s, at_s } => {
                Self::Begun { own: own.map(|own| own.held(own_s, 1.0)), given_s, at_s }
            }
        }
    }

    fn began_s(&self) -> Option<f64> {
        let (own, given_s) = self.beginnings();
        given_s.or(own.and_then(own_began_s))
    }

    pub(super) fn is_finite(&self) -> bool {
        let (own, given_s) = self.beginnings();
        self.at_s().is_finite()
            && own.is_none_or(|own| own.is_finite())
            && given_s.is_none_or(f64::is_finite)
    }
}

/// Returns scene time at which the tour began on the wall's own clock; `None` if that has had no
/// frame since a pause, or in this life of the manager.
fn own_began_s(own: Beginning) -> Option<f64> {
    own.scene_s.map(|scene_s| (scene_s - own.at_s).clamp(-f64::MAX, f64::MAX))
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
    /// asked for, or a preview, shows what the last one did: it neither begins nor ends a tour.
    pub(super) fn follow_tour(&mut self, order: Option<&FrameRequest>, time_s: f64, now: Micros) {
        if !self.is_timed(order) {
            return;
        }
        let is_given = order.is_some_and(|order| order.time_s.is_some());
        let Some(PlayedTour { tour, from, clock }) = &mut self.tour else { return };
        let is_first = clock.advance(is_given, time_s);
        let tour_s = clock.at_s();
        self.presentation.camera = tour.camera_at(from, self.wall.eye, tour_s);
        // A client that gives times may go back to one that was.
        if !is_given && tour.is_over(tour_s) {
            self.tour = None;
            self.navigator.remember_at.get_or_insert(now + REMEMBER_WAIT);
        }
        if is_first {
            self.persist();
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

    /// The tour as the wall goes on with it after a pause, or another life of the manager.
    pub(super) fn remembered_tour(&self) -> Option<PlayedTour> {
        let mut played = self.tour.clone()?;
        played.clock = played.clock.remembered(self.pacer.own_s);
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
