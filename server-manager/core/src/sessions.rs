//! Sessions: all that the wall shows and how it shows it, as the manager keeps it under a name.
//!
//! A session is a [`PersistentState`] without what belongs to the wall and not to the show: its
//! calibration, its hours, and what ends with a client. It is shown as a scene is: servers prepare
//! it, and from one frame on the wall shows all of it.

use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::request::{RequestError, Response, SceneSummary};
use polyptych_protocol::saved_session::{OpenedSession, name_fault};
use polyptych_protocol::state_log::Operation;
use serde::{Deserialize, Serialize};

use super::change_queue::ChangeOrigin;
use super::{ClientRequest, Cluster, Effect, ImportedScene, Micros, PersistentState, StateChange};

/// A session that was read and can be shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImportedSession {
    /// Its scene, if it shows one.
    pub scene: Option<ImportedScene>,
    /// All else, as far as it is valid for this wall.
    pub state: PersistentState,
    /// The parts of it that are not, each with its reason.
    pub left_out: Vec<String>,
}

impl Cluster {
    /// Returns what a session keeps of the wall as it stands.
    pub fn session_state(&self) -> PersistentState {
        let edited = self.edited_scene();
        PersistentState {
            edits: edited.map(|scene| scene.edits).unwrap_or_default(),
            temporary: Vec::new(),
            tunings: Vec::new(),
            presentation: Presentation { marker: None, ..self.presentation.clone() },
            ..self.persistent_state()
        }
    }

    /// Begins to open a session for a client; it is read beside the core.
    ///
    /// # Errors
    /// The name cannot be one, or too much is being opened already.
    pub(super) fn open_session(
        &mut self,
        job: ClientRequest,
        name: String,
    ) -> Result<Option<Response>, String> {
        if let Some(fault) = name_fault(&name) {
            return Err(fault);
        }
        self.begin_import(job, name.clone())?;
        self.outputs.push_back(Effect::OpenSession { job, name });
        Ok(None)
    }

    /// Handles a session that was read, or could not be.
    pub(crate) fn handle_session(
        &mut self,
        now: Micros,
        job: ClientRequest,
        session: Result<Box<ImportedSession>, String>,
    ) {
        self.end_import(job);
        let mut session = match session {
            Ok(session) => session,
            Err(reason) => {
                let tell = || tracing::warn!(reason, "a session could not be opened");
                self.request_span(job).in_scope(tell);
                return self.reply(job, Err(RequestError::new(reason)));
            }
        };
        let surroundings = Operation::SetEnvironment(session.state.environment.clone());
        let mut change = match session.scene.take() {
            Some(scene) => StateChange::opening(job, scene),
            None => StateChange::closing(job),
        };
        let effects = Operation::SetEffects(session.state.presentation.effects());
        change.operations.extend([surroundings, effects]);
        if let ChangeOrigin::Scene { session: of, .. } = &mut change.purpose {
            *of = Some(session);
        }
        self.request_change(now, change);
    }

    /// Presents the rest of a session, once frames name the state that has its scene.
    pub(super) fn show_session(
        &mut self,
        now: Micros,
        session: ImportedSession,
        scene: Option<SceneSummary>,
    ) -> Response {
        let ImportedSession { state, mut left_out, .. } = session;
        left_out.extend(self.resume(&state, now));
        // A wall that is paused shows it too.
        self.wants_frame |= !self.pacer.is_soon(now);
        Response::SessionOpened(Box::new(OpenedSession { scene, left_out }))
    }
}
