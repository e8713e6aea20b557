//! Displays that go dark by themselves: outside hours, or because the wall is not used.
//!
//! ```text
//! lit --no use for so long--> resting --use, or other rules--> lit
//! ```
//!
//! The wall's own mode stays what it is; frames of a resting wall carry black instead. Only a
//! frozen wall is not frozen any more: black has taken the place of its picture. Use is a request
//! that changes what the wall shows, or a mouse over a display. Poses of a tracked head, frames of
//! a program that only draws, and those who watch are no use.

use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::request::Request;
use polyptych_protocol::screen_rest::{RestRules, RestStatus};
use serde::{Deserialize, Serialize};

use super::{Cluster, Micros};

/// Time for which use lights the displays outside hours: whoever works at night is not left in the
/// dark between two actions.
const AWAKE_TIME: Micros = 600_000_000;

/// The rest of one wall.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Rest {
    rules: RestRules,
    /// The minute of the day; `None` until the core was told it.
    minute: Option<u16>,
    /// The time of the last use since hours or rules changed, if there was one.
    used_at: Option<Micros>,
    /// The time from which the time without use counts.
    since: Micros,
    is_resting: bool,
}

impl Rest {
    fn is_outside_hours(&self) -> bool {
        let hours = self.rules.hours.zip(self.minute);
        hours.is_some_and(|(hours, minute)| !hours.contains(minute))
    }

    /// Returns the time at which displays go dark unless the wall is used, if ever.
    fn dark_at(&self) -> Option<Micros> {
        let idle = self.rules.idle_s.map(|idle_s| self.since + (idle_s * 1e6) as Micros);
        let outside = || self.used_at.map_or(0, |at| at + AWAKE_TIME);
        let closed = self.is_outside_hours().then(outside);
        [idle, closed].into_iter().flatten().min()
    }

    fn next_change(&self) -> Option<Micros> {
        self.dark_at().filter(|_| !self.is_resting)
    }

    /// Moves on to this time. Returns whether displays go dark or are lit again.
    fn update(&mut self, now: Micros) -> bool {
        let is_resting = self.dark_at().is_some_and(|at| now >= at);
        std::mem::replace(&mut self.is_resting, is_resting) != is_resting
    }

    fn begin(&mut self, rules: RestRules, now: Micros) {
        let Self { is_resting, .. } = *self;
        // Without hours nobody told the minute: the one that is known may be hours old.
        let minute = self.minute.filter(|_| self.rules.hours.is_some());
        *self = Self { rules, minute, used_at: None, since: now, is_resting };
    }

    pub fn rules(&self) -> RestRules {
        self.rules
    }

    pub fn status(&self) -> RestStatus {
        RestStatus { rules: self.rules, is_resting: self.is_resting }
    }

    /// Returns the mode that frames carry instead of the wall's own.
    pub fn output_mode(&self, own: OutputMode) -> OutputMode {
        if self.is_resting { OutputMode::Blank } else { own }
    }
}

/// Returns whether a request uses the wall.
fn is_use(request: &Request) -> bool {
    match request {
        Request::RenderFrame { camera, .. } | Request::Redraw(camera) => camera.is_some(),
        Request::OpenScene { .. }
        | Request::OpenSession { .. }
        | Request::CloseScene
        | Request::SetCamera(_)
        | Request::SetExposure(_)
        | Request::SetDisplays(_)
        | Request::SetViews(_)
        | Request::SetPattern(_)
        | Request::MarkPoint(_)
        | Request::Tune { .. }
        | Request::Edit(_)
        | Request::Run(_)
        | Request::PlayTour(_)
        | Request::FollowNode(_)
        | Request::ChangeClips(_)
        | Request::SetEnvironment(_)
        | Request::SetTone(_)
        | Request::SetFog(_)
        | Request::SetGlow(_)
        | Request::SetAmbientOcclusion(_)
        | Request::SetDepthOfField(_)
        | Request::SetAutomaticExposure => true,
        _ => false,
    }
}

impl Cluster {
    /// Sets the rules by which displays go dark; the time without use begins anew.
    ///
    /// # Errors
    /// A number that cannot be.
    pub(super) fn set_rest(&mut self, now: Micros, rules: RestRules) -> Result<(), String> {
        rules.validate()?;
        self.rest.begin(rules, now);
        self.update_rest(now);
        Ok(())
    }

    /// Takes over the rules of another life of the manager.
    pub(super) fn restore_rest(&mut self, rules: RestRules) {
        match rules.validate() {
            Ok(()) => self.rest.begin(rules, 0),
            Err(reason) => tracing::warn!(reason, "the rest in the state file was dropped"),
        }
    }

    /// Returns whether the core must be told the minute of the day.
    pub fn has_hours(&self) -> bool {
        self.rest.rules.hours.is_some()
    }

    /// Takes the minute of the day, from 0 at midnight.
    pub(crate) fn handle_minute(&mut self, now: Micros, minute: u16) {
        let was_outside = self.rest.is_outside_hours();
        self.rest.minute = Some(minute);
        if self.rest.is_outside_hours() != was_outside {
            // Hours begin or end, whoever used the wall before.
            self.rest.used_at = None;
            self.rest.since = now;
        }
        self.update_rest(now);
        self.advance_frame(now);
    }

    /// Notes that a client asks for this, if that uses the wall.
    pub(super) fn note_request(&mut self, now: Micros, request: &Request) {
        if is_use(request) {
            self.note_use(now);
        }
    }

    /// Counts a use of the wall: displays that are dark by themselves are lit.
    pub(super) fn note_use(&mut self, now: Micros) {
        self.rest.used_at = Some(now);
        self.rest.since = now;
        self.update_rest(now);
    }

    /// Returns the time at which displays go dark if nothing happens before; `None` if never.
    pub(super) fn next_rest(&self) -> Option<Micros> {
        self.rest.next_change()
    }

    /// Lets displays go dark or lights them, where it is time.
    pub(super) fn update_rest(&mut self, now: Micros) {
        if self.rest.update(now) {
            let is_resting = self.rest.is_resting;
            tracing::info!(is_resting, "displays go dark by themselves, or are lit again");
            if is_resting && self.presentation.output_mode == OutputMode::Freeze {
                // Frozen again afterwards, displays would keep the black that they show.
                self.presentation.output_mode = OutputMode::Normal;
            }
            // A wall that is paused shows it too.
            self.wants_frame = true;
        }
    }
}
