//! Servers and clients come and go.

use polyptych_protocol::command::{Command, Prepare};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::server_message::Prepared;
use polyptych_text::make_printable;
use polyptych_wall::ChannelId;
use polyptych_wall::limits::NAME_BYTES_MAX;

use super::registry::Answered;
use super::supersede::Owed;
use super::{ClientState, Cluster, Effect, Micros, SessionId};

/// Most features of a scene that are reported; there are ten.
const FEATURES_MAX: usize = 64;

/// After this long a server that could not prepare the shown state is asked again, for the first
/// time: a full disk or a busy device passes, and what fails for good costs a snapshot each time.
const PREPARE_RETRY_FIRST: Micros = 2_000_000;

impl Cluster {
    /// A render server claims its channels. After `Ok` the session belongs to it.
    ///
    /// # Errors
    /// Why it may not have them: an unknown channel, one that another server drives.
    pub(crate) fn handle_server(
        &mut self,
        now: Micros,
        session: SessionId,
        mut hello: ServerHello,
        address: String,
    ) -> Result<(), String> {
        let Adapter { name, driver, backend, .. } = &mut hello.adapter;
        [&mut hello.name, name, driver, backend].into_iter().for_each(make_printable);
        let (channels, replaced) = self.registry.check_claim(&hello, &address)?;
        self.check_adapter(&hello, &channels)?;
        if let Some(old) = replaced {
            self.close(old, "the same server has connected again".into());
            self.handle_server_gone(now, old, "replaced by a new connection");
        }
        let adapter = hello.adapter.name.clone();
        self.registry.add(now, session, hello, address, channels.clone());
        self.session_span(session).in_scope(|| tracing::info!(adapter, "server joins"));
        self.present_calls.forget(&channels);
        self.registry.set_states(&channels, ChannelState::Preparing, None, now);
        self.send_due_prepares(vec![session]);
        Ok(())
    }

    fn check_adapter(&self, hello: &ServerHello, channels: &[ChannelId]) -> Result<(), String> {
        let side_max = hello.adapter.texture_side_max;
        for channel in channels.iter().filter_map(|&id| self.wall.channel(id)) {
            let side = channel.size.max_element();
            if side > side_max {
                return Err(format!(
                    "channel {} is {} × {} pixels, and the adapter {} draws at most \
                     {side_max} a side",
                    channel.name, channel.size.x, channel.size.y, hello.adapter.name
                ));
            }
        }
        Ok(())
    }

    /// Sends each of these servers what it must prepare next, if it owes no answer: the shown
    /// state whole, or the change on its way from there. A server that is busy with an older
    /// state is so never sent more than one thing; one that is busy with another scene, or with a
    /// change that was refused, is sent one thing beside it, and stops. One that failed is left its
    /// pause.
    pub(super) fn send_due_prepares(&mut self, sessions: Vec<SessionId>) {
        let (mut to_snapshot, mut to_change) = (Vec::new(), Vec::new());
        let shown = self.shown.revision;
        let shown_scene = self.shown.scene.as_ref().map(|scene| scene.manifest);
        let next = self.changes.revision();
        let next_scene = next.map_or(shown_scene, |_| self.changes.scene());
        let changes = &self.changes;
        let is_wanted = |owed: &Owed| {
            [shown_scene, next_scene].contains(&owed.scene)
                && !changes.is_refused(shown, owed.revision)
        };
        for session in sessions {
            let Some(server) = self.registry.server_mut(session) else { continue };
            if next.is_some() && server.prepared == next {
                continue;
            }
            let is_behind = server.prepared != Some(shown);
            let may_change = next.is_some() && !changes.has_failed_on(session);
            if !(is_behind || may_change) || !server.may_be_sent(is_wanted) {
                continue;
            }
            if is_behind {
                server.owes = Some(Owed { revision: shown, scene: shown_scene });
                to_snapshot.push(session);
            } else {
                server.owes = next.map(|revision| Owed { revision, scene: next_scene });
                to_change.push(session);
            }
        }
        let snapshot = Prepare {
            epoch: self.epoch,
            base: None,
            revision: shown,
            shown,
            operations: self.shown.snapshot(),
        };
        self.command(to_snapshot, Command::Prepare(snapshot));
        self.send_change_to(to_change);
    }

    /// A server's connection has ended.
    pub(crate) fn handle_server_gone(&mut self, now: Micros, session: SessionId, reason: &str) {
        let span = self.registry.session_span(session);
        let Some(server) = span.in_scope(|| self.registry.remove(now, session, reason)) else {
            return;
        };
        span.in_scope(|| tracing::warn!(reason, "server is lost"));
        self.changes.forget_catch_up(now, session);
        self.stop_waiting_for(&server.channels, now);
        self.advance_change(now);
    }

    /// The channels that a server drives.
    pub fn channels_of(&self, session: SessionId) -> Vec<ChannelId> {
        self.registry.server(session).map_or_else(Vec::new, |server| server.channels.clone())
    }

    /// The connected servers, each with its name.
    pub fn server_names(&self) -> impl Iterator<Item = (SessionId, &str)> {
        self.registry.servers().map(|(session, server)| (session, server.name.as_str()))
    }

    /// The connected clients, each with its name.
    pub fn client_names(&self) -> impl Iterator<Item = (SessionId, &str)> {
        self.clients.iter().map(|(&session, client)| (session, client.name.as_str()))
    }

    /// A client has come.
    pub(crate) fn handle_client(&mut self, session: SessionId, mut name: String) {
        make_printable(&mut name);
        self.clients.insert(session, ClientState { name, is_subscribed: false });
        self.session_span(session).in_scope(|| tracing::info!("client joins"));
    }

    /// A client's connection has ended. The wall stays as it is, but for what
    /// was to end with it.
    pub(crate) fn handle_client_gone(&mut self, now: Micros, session: SessionId) {
        self.clients.remove(&session);
        self.orders.retain(|order| order.job.client != session);
        self.tuners.forget(session);
        self.editing.forget(session);
        self.lose_devices(now, session);
        self.end_temporary(now);
    }

    /// A replica that disagrees is given the state anew, not believed; what it has drawn of the
    /// frames on their way is not shown.
    pub(super) fn handle_divergence(&mut self, now: Micros, session: SessionId, why: &str) {
        self.pipeline.exclude(session);
        self.resynchronise(now, &[session], why);
    }

    /// Gives servers the shown state anew; frames do not wait for them.
    pub(super) fn resynchronise(&mut self, now: Micros, sessions: &[SessionId], why: &str) {
        let mut channels = Vec::new();
        for &session in sessions {
            let Some(server) = self.registry.server_mut(session) else { continue };
            server.resynchronise(now);
            channels.extend_from_slice(&server.channels);
            let what = format!("server {}: {why}", server.name);
            // A server that never gets it right would come here as fast as it can.
            if let Some(times) = self.repetitions.should_log(now, &what) {
                let tell = || tracing::error!(why, times, "resynchronising a server");
                self.session_span(session).in_scope(tell);
            }
        }
        self.registry.forgive(&channels);
        self.registry.set_states(&channels, ChannelState::Preparing, Some(why), now);
        self.send_due_prepares(sessions.to_vec());
        // Last: this may begin a frame, which must not go to them.
        self.stop_waiting_for(&channels, now);
    }

    pub(super) fn handle_prepared(&mut self, now: Micros, from: SessionId, prepared: &Prepared) {
        if prepared.epoch != self.epoch {
            return;
        }
        let Some(server) = self.registry.server_mut(from) else { return };
        let scene = server.owes.and_then(|owed| owed.scene);
        match server.answer(prepared.revision) {
            Answered::Unasked => return,
            Answered::Obsolete => return self.send_due_prepares(vec![from]),
            Answered::Owed => {}
        }
        if self.is_rejected(now, from, prepared.revision) {
            return;
        }
        let expected = if prepared.revision == self.shown.revision {
            Some(self.shown_digest)
        } else {
            self.changes.digest_of(prepared.revision)
        };
        if expected.is_some_and(|digest| digest != prepared.digest) {
            self.resynchronise(now, &[from], "it prepared another state than was sent");
            return self.advance_change(now);
        }
        let Some(server) = self.registry.server_mut(from) else { return };
        server.prepared = Some(prepared.revision);
        server.held_before = (server.scene_bytes, server.detail_reach);
        (server.scene_bytes, server.detail_reach) = (prepared.scene_bytes, prepared.detail_reach);
        let channels = server.channels.clone();
        if prepared.revision < self.shown.revision {
            self.begin_catch_up(now, from, scene);
        }
        if prepared.revision == self.shown.revision {
            self.changes.end_catch_up(now, from);
            // A server is asked what it knows best, but not for a book.
            let is_name = |name: &&String| name.len() <= NAME_BYTES_MAX;
            let names = prepared.features.iter().filter(is_name).take(FEATURES_MAX);
            self.features = names.cloned().collect();
            for id in channels {
                let state = self.registry.channel(id).map(|channel| channel.state);
                if state == Some(ChannelState::Preparing) {
                    self.registry.set_prepared(id, now);
                    self.wants_frame |= self.must_see_a_frame(now);
                }
            }
        }
        self.tell_preparing();
        self.advance_change(now);
        self.send_due_prepares(vec![from]);
        self.advance_frame(now);
    }

    pub(super) fn handle_prepare_failed(
        &mut self,
        now: Micros,
        from: SessionId,
        revision: Revision,
        reason: &str,
    ) {
        let span = self.session_span(from);
        let Some(server) = self.registry.server_mut(from) else { return };
        match server.answer(revision) {
            Answered::Unasked => return,
            Answered::Obsolete => return self.send_due_prepares(vec![from]),
            Answered::Owed => {}
        }
        let (name, channels) = (server.name.clone(), server.channels.clone());
        let what = format!("server {name} cannot prepare: {reason}");
        if let Some(times) = self.repetitions.should_log(now, &what) {
            let revision = revision.0;
            span.in_scope(|| tracing::error!(revision, reason, times, "a server cannot prepare"));
        }
        if self.changes.digest_of(revision).is_some() {
            self.changes.add_failure(from, format!("server {name}: {reason}"));
        } else if revision == self.shown.revision {
            if let Some(server) = self.registry.server_mut(from) {
                server.retry_later(now, PREPARE_RETRY_FIRST);
            }
            self.registry.set_states(&channels, ChannelState::Preparing, Some(reason), now);
            self.stop_waiting_for(&channels, now);
        }
        self.advance_change(now);
        // Asked for the same at once it would fail again; for anything newer it may not.
        if revision != self.shown.revision {
            self.send_due_prepares(vec![from]);
        }
    }

    /// Returns whether a channel that has become ready is given a frame though no client has
    /// ordered one. Otherwise its display would still report a lost manager, show an older picture
    /// than its neighbours, or light up on a wall that is to be black.
    fn must_see_a_frame(&self, now: Micros) -> bool {
        let comes_soon = self.pacer.is_soon(now);
        let has_shown = self.swapped.0 > 0;
        let is_other = self.presentation.output_mode != OutputMode::Normal
            || self.presentation.pattern.is_some();
        !comes_soon && (self.is_going_on || has_shown || is_other)
    }

    /// Ends a connection, and tells the peer why.
    pub(super) fn close(&mut self, session: SessionId, reason: String) {
        self.outputs.push_back(Effect::Close { session, reason });
    }
}
