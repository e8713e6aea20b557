//! The event loop's work for clients: lets them in, serves their requests in turn, and answers.

use polyptych_core::{ClientRequest, Input, Micros, SessionId};
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::delivery::QUEUED_REQUESTS_MAX;
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::process;
use polyptych_protocol::request::{MessageToClient, Request, Response};
use tokio::time::{Duration, Instant};

use super::EventLoop;
use super::querying::Query;
use crate::leadership::Leadership;
use crate::requests::{Asked, RequestQueues};
use crate::session::ClientHandle;
use crate::state_file::keeper::{Keeper, tells_of_change};

/// Maximum number of clients: control desks, dashboards and scripts of the largest wall. One more
/// may come from the manager's own machine, so that its operator is never locked out.
const CLIENTS_MAX: usize = 256;

/// Minimum time without a request after which a client that expects nothing makes room for another
/// one.
const IDLE_TIME_MIN: Duration = Duration::from_mins(1);

/// A client that was let in.
#[derive(Debug)]
pub(super) struct ClientSeat {
    pub link: ClientHandle,
    asked_at: Instant,
}

impl EventLoop {
    /// Lets a client in, if there is a place or one that is idle leaves its own.
    pub(super) fn let_client_in(
        &mut self,
        now: Micros,
        name: String,
        is_local: bool,
        link: ClientHandle,
    ) -> Result<Welcome, String> {
        if self.clients.len() >= CLIENTS_MAX {
            let idle = self.idlest_client();
            let reason = "it asked nothing, and another client needs its place";
            match idle {
                Some(idle) => self.let_client_go(idle, reason),
                None if is_local && self.clients.len() == CLIENTS_MAX => {}
                None => {
                    return Err(format!(
                        "{CLIENTS_MAX} clients are connected, and no more may be; end one of them"
                    ));
                }
            }
        }
        let session = self.new_session();
        self.clients.insert(session, ClientSeat { link, asked_at: Instant::now() });
        self.tell(now, Input::Client { session, name });
        Ok(self.welcome(session))
    }

    /// The client that has asked nothing for longest, if that is long enough. One whose request is
    /// under way, such as files that are being baked or an export, is not idle.
    fn idlest_client(&self) -> Option<SessionId> {
        let quiet = self.clients.iter().filter(|(session, _)| {
            let awaits_answer = self.turns.queues().awaits_answer(**session);
            !awaits_answer && !self.cluster.expects_more(**session)
        });
        let (session, seat) = quiet.min_by_key(|(_, seat)| seat.asked_at)?;
        (seat.asked_at.elapsed() >= IDLE_TIME_MIN).then_some(*session)
    }

    /// Serves the requests that wait, in turn and within the budget.
    pub(super) fn serve_clients(&mut self) {
        while self.leads() {
            let now = self.now();
            let clients = &self.clients;
            let may_ask = |session| {
                let seat = clients.get(&session);
                seat.is_none_or(|seat| seat.link.has_room() || seat.link.outbox.is_closed())
            };
            let Some((from, asked)) = self.turns.next(now, may_ask) else { return };
            let mut is_reset = false;
            match asked {
                Asked::Call(call, _room) => {
                    if let Some(seat) = self.clients.get_mut(&from) {
                        seat.asked_at = Instant::now();
                    }
                    let (id, request) = (call.id, call.request);
                    is_reset = matches!(request, Request::Statistics { reset: true });
                    match request {
                        Request::Edit(transaction) => self.edit(from, id, transaction),
                        Request::SetEnvironment(source) if source != EnvironmentSource::None => {
                            self.bake_environment(from, id, source);
                        }
                        request @ (Request::SaveScene { .. }
                        | Request::ListSavedScenes
                        | Request::RemoveSavedScene { .. }
                        | Request::SaveSession { .. }
                        | Request::ListSessions
                        | Request::RemoveSession { .. }) => {
                            self.ask_stores(from, id, request);
                        }
                        Request::ListSceneFiles => self.list_scene_files(from, id),
                        Request::ExportScene { saved } => self.export(from, id, saved),
                        Request::FindNodes(query) => self.query(from, id, Query::Nodes(query)),
                        Request::CastRay(query) => self.query(from, id, Query::Ray(query)),
                        Request::FindInRegion(query) => {
                            self.query(from, id, Query::Region(query));
                        }
                        Request::ListLayers => self.query(from, id, Query::Layers),
                        Request::NearestPoint(query) => {
                            self.query(from, id, Query::Nearest(query));
                        }
                        Request::FindWay(query) => self.query(from, id, Query::Way(query)),
                        request => self.tell(now, Input::Request { client: from, id, request }),
                    }
                }
                Asked::Beyond(id) => {
                    let reason = format!(
                        "{QUEUED_REQUESTS_MAX} requests of this client are queued already, or 2 \
                         MiB of them; await some first"
                    );
                    self.refuse(ClientRequest { client: from, id }, reason);
                }
                Asked::Gone(reason) => self.forget(from, &reason),
            }
            self.carry_out();
            if is_reset {
                self.frame_bytes = 0;
            }
            self.turns.spend(self.now() - now);
            if self.stopping.is_some() {
                return;
            }
        }
    }

    /// Sends an answer; one that tells of a change once the change is kept.
    pub(super) fn answer(&mut self, to: SessionId, answer: MessageToClient) {
        let Some(keeper) = &mut self.keeper else { return self.send_answer(to, answer) };
        let Some(answer) = keeper.hold(to, answer) else { return };
        // What it tells of may have been tried already, in vain.
        let warning = tells_of_change(&answer).then(|| keeper.warning()).flatten();
        self.send_with(to, warning, answer);
    }

    fn send_answer(&mut self, to: SessionId, mut answer: MessageToClient) {
        // Another manager answers for the wall; the connection is closed with the reason.
        if self.is_replaced() {
            return;
        }
        let Some(seat) = self.clients.get(&to) else { return };
        let link = &seat.link;
        // Feedback and progress that nobody reads may be lost; an answer may not.
        let may_be_lost =
            matches!(answer, MessageToClient::Feedback(_) | MessageToClient::Progress { .. });
        if may_be_lost && !link.has_room() {
            return;
        }
        if let MessageToClient::Reply { reply: Ok(Response::Status(status)), .. } = &mut answer {
            status.warnings.extend(self.keeper.as_ref().and_then(Keeper::warning));
            status.warnings.extend(self.cluster.warning());
            status.leader = self.options.leadership.as_ref().map(Leadership::status);
            status.memory_bytes = process::resident_bytes().unwrap_or(0);
        }
        if let MessageToClient::Reply { reply: Ok(Response::Statistics(statistics)), .. } =
            &mut answer
        {
            statistics.bytes_per_frame = self.frame_bytes as f64 / statistics.frames.max(1) as f64;
        }
        let is_sent = link.send(polyptych_codec::encode(&answer));
        if let MessageToClient::Reply { id, .. } = &answer {
            self.turns.queues().finish(to, *id);
        }
        // One that is gone already says why itself.
        if !is_sent && !may_be_lost && !link.outbox.is_closed() {
            self.let_client_go(to, "it does not read its answers");
        }
    }

    /// Ends a client's connection, telling it why.
    fn let_client_go(&mut self, session: SessionId, reason: &str) {
        if let Some(seat) = self.clients.get(&session) {
            // Behind its answers, if it reads on after all.
            let goodbye =
                polyptych_codec::encode(&MessageToClient::Goodbye(Goodbye::closed(reason)));
            let _ = seat.link.pieces.try_send(goodbye);
            self.forget(session, reason);
        }
    }

    /// Sends the answers that have waited for the disk.
    pub(super) fn release_answers(&mut self) {
        if !self.leads() {
            return;
        }
        let Some(keeper) = &mut self.keeper else { return };
        for (to, answer, warning) in keeper.release() {
            self.send_with(to, warning, answer);
        }
    }

    /// Sends an answer behind what its client should know.
    fn send_with(&mut self, to: SessionId, warning: Option<String>, answer: MessageToClient) {
        if let (Some(warning), MessageToClient::Reply { id, .. }) = (warning, &answer) {
            self.send_answer(to, MessageToClient::Warning { id: *id, warning });
        }
        self.send_answer(to, answer);
    }

    /// Sends all answers that wait for the disk: the manager ends.
    pub(super) async fn settle_answers(&mut self) {
        if let Some(keeper) = &mut self.keeper {
            keeper.settle().await;
        }
        self.release_answers();
    }

    /// Tells the core that a client is gone, if it is one.
    pub(super) fn forget_client(&mut self, now: Micros, session: SessionId, reason: &str) {
        let Some(seat) = self.clients.remove(&session) else { return };
        let tell = || tracing::info!(reason, "client leaves");
        self.cluster.session_span(session).in_scope(tell);
        seat.link.close.cancel();
        self.turns.forget(session);
        self.transactions.forget(session);
        self.tell(now, Input::ClientGone { session });
    }
}

/// Ready when the state has been kept, or could not be.
pub(super) async fn progress_of(keeper: &mut Option<Keeper>) {
    match keeper {
        Some(keeper) => keeper.progressed().await,
        None => std::future::pending().await,
    }
}

/// Ready when a client has asked something.
pub(super) async fn wait_for_news(queues: RequestQueues) {
    queues.news().await;
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use bytes::Bytes;
    use polyptych_protocol::ids::RequestId;
    use polyptych_protocol::request::RequestMessage;
    use tokio::sync::Semaphore;

    use super::*;
    use crate::run::importing::tests::start;

    #[tokio::test(start_paused = true)]
    async fn a_client_whose_request_is_under_way_is_not_idle() {
        let (mut hub, client, _answers) = start();
        tokio::time::advance(IDLE_TIME_MIN).await;
        assert_eq!(hub.idlest_client(), Some(client));
        let room = Arc::new(Semaphore::new(1)).try_acquire_owned().expect("free");
        let id = RequestId(1);
        let call = RequestMessage::new(id, Request::ListSceneFiles);
        hub.turns.queues().push(client, Asked::Call(call, room));
        hub.serve_clients();
        tokio::time::advance(IDLE_TIME_MIN).await;
        assert_eq!(hub.idlest_client(), None, "the folders are still being read");
        hub.answer(client, MessageToClient::Reply { id, reply: Ok(Response::Done) });
        assert_eq!(hub.idlest_client(), Some(client));
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_vanished_gives_its_place_and_its_share_back() {
        let (mut hub, ghost, answers) = start();
        let mut others = Vec::new();
        while hub.clients.len() < CLIENTS_MAX {
            let (link, waiting) = ClientHandle::new();
            hub.let_client_in(0, "ben".into(), false, link).expect("let in");
            others.push(waiting);
        }
        let full = hub.let_client_in(0, "cem".into(), false, ClientHandle::new().0);
        assert!(full.is_err_and(|reason| reason.contains("256 clients are connected")));
        // It reads nothing, and what it has asked waits.
        let link = hub.clients[&ghost].link.clone();
        while link.has_room() {
            assert!(link.send(Bytes::from(vec![0; 64 << 10])));
        }
        let room = Arc::new(Semaphore::new(2));
        for id in 1..=2 {
            let share = Arc::clone(&room).try_acquire_owned().expect("free");
            let call = RequestMessage::new(RequestId(id), Request::Status);
            hub.turns.queues().push(ghost, Asked::Call(call, share));
        }
        hub.serve_clients();
        assert_eq!(room.available_permits(), 0, "it has no room for an answer");
        // Its connection ends without a word from it.
        drop(answers);
        hub.turns.queues().push(ghost, Asked::Gone("it has read nothing for 10 s".into()));
        hub.serve_clients();
        assert_eq!((room.available_permits(), hub.clients.len()), (2, CLIENTS_MAX - 1));
        assert!(link.close.is_cancelled());
        hub.let_client_in(0, "cem".into(), false, ClientHandle::new().0).expect("a place is free");
    }
}
