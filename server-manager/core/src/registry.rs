//! Who is there: the servers, and the state of every channel of the wall.

mod lateness;

use std::collections::BTreeMap;

use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::{FrameId, Revision};
use polyptych_protocol::server_message::FramePresented;
use polyptych_wall::{ChannelId, Wall};
use serde::{Deserialize, Serialize};

use super::supersede::Owed;
use super::{Micros, SessionId};
use lateness::REJOIN_FRAMES_MIN;

/// Longest pause before a server that fails again and again is given the shown state anew. Pauses
/// double from failure to failure.
const RETRY_WAIT_MAX: Micros = 8_000_000;

/// First pause of a server that is given the shown state anew for the second time.
const RESYNCHRONISE_RETRY_FIRST: Micros = 250_000;

/// A server that did not fail for so long begins with the first pause again.
const FAILURES_FORGOTTEN_AFTER: Micros = 30_000_000;

/// Maximum number of changes of a channel's state that are logged in each [`LINES_PERIOD`]: 40
/// bytes per second and channel.
const LINES_MAX: u32 = 16;
const LINES_PERIOD: Micros = 60_000_000;

/// A connected render server.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ServerEntry {
    pub name: String,
    pub address: String,
    pub pid: u32,
    pub adapter: Adapter,
    pub channels: Vec<ChannelId>,
    /// The revision that it has prepared and could draw at once.
    pub prepared: Option<Revision>,
    /// The state that it was sent and has not answered yet.
    pub owes: Option<Owed>,
    /// The warning of its server about the wall's object stores.
    pub storage_warning: Option<String>,
    /// An obsolete revision that it was sent before and has not answered either. It is sent nothing
    /// more while it owes both.
    pub obsolete: Option<Revision>,
    pub memory_bytes: u64,
    pub scene_bytes: u64,
    /// See [`polyptych_protocol::server_message::Prepared::detail_reach`].
    #[serde(default)]
    pub detail_reach: Option<f64>,
    /// Both of what it had prepared before.
    #[serde(default)]
    pub held_before: (u64, Option<f64>),
    /// The time at which it is sent again what it could not prepare.
    retry_at: Option<Micros>,
    /// Pauses since it began to fail, and when the last one began.
    failures: u32,
    failed_at: Micros,
    last_heard: Micros,
}

impl ServerEntry {
    /// It has answered for a revision, for better or worse.
    pub fn answer(&mut self, revision: Revision) -> Answered {
        if self.obsolete.take_if(|obsolete| *obsolete == revision).is_some() {
            Answered::Obsolete
        } else if self.owes.take_if(|owed| owed.revision == revision).is_some() {
            Answered::Owed
        } else {
            Answered::Unasked
        }
    }

    /// Returns whether it may be sent another state. What it owes is given up for that if it is not
    /// wanted any more: the server stops to work on it.
    pub fn may_be_sent(&mut self, is_wanted: impl FnOnce(&Owed) -> bool) -> bool {
        if self.retry_at.is_some() {
            return false;
        }
        let Some(owed) = self.owes else { return true };
        if self.obsolete.is_some() || is_wanted(&owed) {
            return false;
        }
        self.obsolete = self.owes.take().map(|owed| owed.revision);
        true
    }

    /// It is asked again after a while: `first`, twice as long after each further failure.
    pub fn retry_later(&mut self, now: Micros, first: Micros) {
        let wait = first.saturating_mul(1 << self.count_failure(now).min(16)).min(RETRY_WAIT_MAX);
        self.retry_at = Some(now + wait);
    }

    /// It is given the shown state anew: at once, or after a pause if it was before.
    pub fn resynchronise(&mut self, now: Micros) {
        self.prepared = None;
        match self.count_failure(now) {
            0 => {}
            failures => {
                let wait = RESYNCHRONISE_RETRY_FIRST << (failures - 1).min(16);
                self.retry_at = Some(now + wait.min(RETRY_WAIT_MAX));
            }
        }
    }

    /// Returns how often it failed before.
    fn count_failure(&mut self, now: Micros) -> u32 {
        if now.saturating_sub(self.failed_at) >= FAILURES_FORGOTTEN_AFTER {
            self.failures = 0;
        }
        self.failed_at = now;
        self.failures = self.failures.saturating_add(1);
        self.failures - 1
    }
}

/// The state to which a server's answer refers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answered {
    /// The state that it owes.
    Owed,
    /// A state that it was sent and that is obsolete.
    Obsolete,
    /// Nothing: its loader may still be at work for the connection before this one.
    Unasked,
}

/// A channel of the wall and what is known of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ChannelEntry {
    pub name: String,
    pub state: ChannelState,
    pub since: Micros,
    pub reason: Option<String>,
    /// The warning of its server about its display.
    pub display_warning: Option<String>,
    pub server: Option<SessionId>,
    /// The last frame that it showed.
    pub frame: FrameId,
    /// When, in manager time as far as its server knew it.
    pub shown_at_us: Option<Micros>,
    pub late: u64,
    /// Times that its server was lost.
    pub lost: u64,
    /// Its last drawing time, in microseconds.
    pub draw_us: Option<u32>,
    /// Frames that it drew since it joined or the revision changed: the first ones warm up.
    pub frames_drawn: u32,
    /// Frames in time since it last missed one.
    in_time: u32,
    /// The time at which its last drawing was reported.
    drew_at: Micros,
    /// Changes of its state that were logged since then.
    lines: u32,
    lines_since: Micros,
    rejoin_frames: u32,
    /// The value that `rejoin_frames` takes after the next miss.
    next_rejoin_frames: u32,
    /// It missed a frame of this scene while it was waited for, and has not caught up since: a
    /// change that it prepares does not make it ready.
    #[serde(default)]
    is_behind: bool,
}

/// All servers and channels.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Registry {
    servers: BTreeMap<SessionId, ServerEntry>,
    channels: Vec<ChannelEntry>,
    heartbeat_us: Micros,
}

impl Registry {
    pub fn new(wall: &Wall, heartbeat_us: Micros) -> Self {
        let channel = |name: &String| ChannelEntry {
            name: name.clone(),
            state: ChannelState::Lost,
            since: 0,
            reason: Some("no server has claimed it yet".into()),
            display_warning: None,
            server: None,
            frame: FrameId(0),
            shown_at_us: None,
            late: 0,
            lost: 0,
            draw_us: None,
            frames_drawn: 0,
            in_time: 0,
            drew_at: 0,
            lines: 0,
            lines_since: 0,
            rejoin_frames: REJOIN_FRAMES_MIN,
            next_rejoin_frames: REJOIN_FRAMES_MIN,
            is_behind: false,
        };
        let channels = wall.channels.iter().map(|c| channel(&c.name)).collect();
        Self { servers: BTreeMap::new(), channels, heartbeat_us }
    }

    /// Checks a server's claim. `Ok` carries the channels, and the session that it replaces: the
    /// same process, come back before its old connection was found dead.
    pub fn check_claim(
        &self,
        hello: &ServerHello,
        address: &str,
    ) -> Result<(Vec<ChannelId>, Option<SessionId>), String> {
        if hello.channels.is_empty() {
            return Err(format!("server {} claims no channel", hello.name));
        }
        let mut claimed = Vec::new();
        let mut replaced = None;
        for name in &hello.channels {
            let Some(index) = self.channels.iter().position(|c| &c.name == name) else {
                let known: Vec<_> = self.channels.iter().map(|c| c.name.as_str()).collect();
                return Err(format!(
                    "this wall has no channel {name:?}; it has {}",
                    known.join(", ")
                ));
            };
            let id = ChannelId(index as u16);
            if claimed.contains(&id) {
                return Err(format!("channel {name} is claimed twice by the same server"));
            }
            if let Some(holder) = self.channels[index].server
                && let Some(server) = self.servers.get(&holder)
            {
                if server.pid != hello.pid || host_of(&server.address) != host_of(address) {
                    return Err(format!(
                        "channel {name} is driven by another server: {} (process {}, {})",
                        server.name, server.pid, server.address
                    ));
                }
                replaced = Some(holder);
            }
            claimed.push(id);
        }
        Ok((claimed, replaced))
    }

    pub fn add(
        &mut self,
        now: Micros,
        session: SessionId,
        hello: ServerHello,
        address: String,
        channels: Vec<ChannelId>,
    ) {
        for &id in &channels {
            let channel = &mut self.channels[usize::from(id.0)];
            channel.server = Some(session);
            channel.frames_drawn = 0;
            channel.in_time = 0;
            channel.is_behind = false;
        }
        let joining = channels.clone();
        let server = ServerEntry {
            name: hello.name,
            address,
            pid: hello.pid,
            adapter: hello.adapter,
            channels,
            prepared: None,
            owes: None,
            obsolete: None,
            memory_bytes: 0,
            storage_warning: None,
            scene_bytes: 0,
            detail_reach: None,
            held_before: (0, None),
            retry_at: None,
            failures: 0,
            failed_at: 0,
            last_heard: now,
        };
        self.servers.insert(session, server);
        self.set_states(&joining, ChannelState::Joining, None, now);
    }

    /// Takes a server out; its channels are lost for this reason.
    pub fn remove(&mut self, now: Micros, session: SessionId, reason: &str) -> Option<ServerEntry> {
        let server = self.servers.remove(&session)?;
        for &id in &server.channels {
            let channel = &mut self.channels[usize::from(id.0)];
            channel.server = None;
            channel.display_warning = None;
            channel.draw_us = None;
            channel.lost += 1;
        }
        let channels = server.channels.clone();
        self.set_states(&channels, ChannelState::Lost, Some(reason), now);
        Some(server)
    }

    /// Notes a sign of life; `false` where the session is no more.
    pub fn record_heartbeat(&mut self, session: SessionId, now: Micros) -> bool {
        let server = self.servers.get_mut(&session);
        server.map(|server| server.last_heard = server.last_heard.max(now)).is_some()
    }

    pub fn timed_out(&self, now: Micros) -> Vec<SessionId> {
        let is_silent =
            |server: &ServerEntry| now.saturating_sub(server.last_heard) > self.heartbeat_us;
        self.servers.iter().filter(|(_, s)| is_silent(s)).map(|(&id, _)| id).collect()
    }

    pub fn next_heartbeat_timeout(&self) -> Option<Micros> {
        self.servers.values().map(|s| s.last_heard + self.heartbeat_us + 1).min()
    }

    /// Servers that are to be asked again now.
    pub fn take_retries(&mut self, now: Micros) -> Vec<SessionId> {
        let due = self.servers.iter_mut().filter_map(|(&id, server)| {
            server.retry_at.take_if(|retry_at| *retry_at <= now).map(|_| id)
        });
        due.collect()
    }

    pub fn next_retry(&self) -> Option<Micros> {
        self.servers.values().filter_map(|server| server.retry_at).min()
    }

    pub fn server(&self, session: SessionId) -> Option<&ServerEntry> {
        self.servers.get(&session)
    }

    pub fn server_mut(&mut self, session: SessionId) -> Option<&mut ServerEntry> {
        self.servers.get_mut(&session)
    }

    pub fn servers(&self) -> impl Iterator<Item = (SessionId, &ServerEntry)> {
        self.servers.iter().map(|(&id, server)| (id, server))
    }

    pub fn channel(&self, id: ChannelId) -> Option<&ChannelEntry> {
        self.channels.get(usize::from(id.0))
    }

    pub fn channels(&self) -> impl Iterator<Item = (ChannelId, &ChannelEntry)> {
        self.channels.iter().enumerate().map(|(i, channel)| (ChannelId(i as u16), channel))
    }

    pub fn owns_channel(&self, session: SessionId, id: ChannelId) -> bool {
        self.channel(id).is_some_and(|channel| channel.server == Some(session))
    }

    pub fn set_memory(&mut self, session: SessionId, bytes: u64) {
        if let Some(server) = self.servers.get_mut(&session) {
            server.memory_bytes = bytes;
        }
    }

    /// Keeps what a server says of the wall's object stores.
    pub fn set_storage_warning(&mut self, session: SessionId, warning: Option<String>) {
        if let Some(server) = self.servers.get_mut(&session) {
            server.storage_warning = warning;
        }
    }

    /// Keeps what a server says of a channel's display.
    pub fn set_display_warning(&mut self, id: ChannelId, warning: Option<String>) {
        if let Some(channel) = self.channels.get_mut(usize::from(id.0)) {
            channel.display_warning = warning;
        }
    }

    pub fn shown(&mut self, shown: &FramePresented) {
        if let Some(channel) = self.channels.get_mut(usize::from(shown.channel.0)) {
            channel.frame = channel.frame.max(shown.frame);
            if shown.clock_error_us != u32::MAX {
                channel.shown_at_us = channel.shown_at_us.max(Some(shown.at_us));
            }
        }
    }

    pub fn set_state(
        &mut self,
        id: ChannelId,
        state: ChannelState,
        reason: Option<String>,
        now: Micros,
    ) {
        let Some(channel) = self.channel(id) else { return };
        let is_news = channel.state != state;
        if is_news && channel.lines < LINES_MAX {
            let is_last = channel.lines + 1 == LINES_MAX;
            let name = channel.name.as_str();
            let tell = || {
                tracing::info!(channel = name, ?state, reason, "channel changes state");
                if is_last {
                    let quiet_s = LINES_PERIOD / 1_000_000;
                    tracing::warn!(channel = name, quiet_s, "too many changes of state to log");
                }
            };
            match channel.server {
                Some(session) => self.session_span(session).in_scope(tell),
                None => tell(),
            }
        }
        let Some(channel) = self.channels.get_mut(usize::from(id.0)) else { return };
        if is_news {
            channel.state = state;
            channel.since = now;
            if now.saturating_sub(channel.lines_since) >= LINES_PERIOD {
                channel.lines_since = now;
                channel.lines = 0;
            }
            channel.lines += 1;
        }
        channel.reason = reason;
    }

    pub fn set_states(
        &mut self,
        ids: &[ChannelId],
        state: ChannelState,
        reason: Option<&str>,
        now: Micros,
    ) {
        for &id in ids {
            self.set_state(id, state, reason.map(str::to_owned), now);
        }
    }

    /// All channels warm up again: another scene may need new pipelines, and those that were behind
    /// may be fast enough for it.
    pub fn restart_warm_up(&mut self) {
        for channel in &mut self.channels {
            channel.frames_drawn = 0;
            channel.is_behind = false;
        }
    }
}

fn host_of(address: &str) -> &str {
    address.rsplit_once(':').map_or(address, |(host, _)| host)
}
