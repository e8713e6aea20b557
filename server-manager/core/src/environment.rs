//! The surroundings of scenes, in the place of their own sky.

use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::request::Response;
use polyptych_protocol::state_log::Operation;

use super::change_queue::ChangeOrigin;
use super::{ClientRequest, Cluster, Micros, SessionId, StateChange};

impl Cluster {
    /// Surrounds scenes by what was baked. Answered once it is shown.
    ///
    /// # Errors
    /// It was not baked.
    pub(super) fn set_environment(
        &mut self,
        now: Micros,
        job: ClientRequest,
        source: EnvironmentSource,
    ) -> Result<Option<Response>, String> {
        let environment = match source {
            EnvironmentSource::None => None,
            EnvironmentSource::Baked(environment) => Some(environment),
            EnvironmentSource::File { .. } | EnvironmentSource::Sky => {
                return Err("this manager bakes no environments".into());
            }
        };
        let operations = vec![Operation::SetEnvironment(environment)];
        let purpose = ChangeOrigin::Environment { job };
        self.request_change(now, StateChange { operations, purpose });
        Ok(None)
    }

    /// The state that frames name has other surroundings.
    pub(super) fn commit_environment(
        &mut self,
        now: Micros,
        job: ClientRequest,
        failed: &[(SessionId, String)],
    ) {
        self.demote_unprepared(now, failed);
        let name = self.shown.environment.as_ref().map(|environment| &environment.name);
        let revision = self.shown.revision.0;
        let tell = || tracing::info!(revision, environment = name, "the wall has surroundings");
        self.request_span(job).in_scope(tell);
        // A wall that is paused shows them too.
        self.wants_frame |= !self.pacer.is_soon(now);
        self.persist();
        self.reply(job, Ok(Response::Done));
    }
}
