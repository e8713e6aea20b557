//! Signs of life of the loop: for the supervisor of this process, and for clients.

use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::limits::CLIENT_HEARTBEAT_PERIOD;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_text::counted;
use tokio::sync::watch;
use tokio::time::Instant;

use super::EventLoop;

/// Signs of life at equal periods.
#[derive(Debug)]
pub(super) struct LifeSigns {
    /// The supervisor, if there is one.
    notifier: Option<ServiceNotifier>,
    due: Instant,
    /// Heartbeats for clients. They wait in no outbox: who reads slowly misses some.
    heartbeats: watch::Sender<()>,
    heartbeat_due: Instant,
}

impl LifeSigns {
    pub fn new(notifier: Option<ServiceNotifier>) -> Self {
        let now = Instant::now();
        Self { notifier, due: now, heartbeats: watch::Sender::new(()), heartbeat_due: now }
    }

    /// The time of the next sign; `None` without a supervisor and clients.
    pub fn due(&self, has_clients: bool) -> Option<Instant> {
        let sign = self.notifier.as_ref().map(|_| self.due);
        sign.into_iter().chain(has_clients.then_some(self.heartbeat_due)).min()
    }

    /// Returns the heartbeats, for a connection of a client to pass on.
    pub fn heartbeats(&self) -> watch::Receiver<()> {
        self.heartbeats.subscribe()
    }

    pub fn ready(&self) {
        if let Some(notifier) = &self.notifier {
            notifier.ready();
        }
    }

    pub fn stopping(&self) {
        if let Some(notifier) = &self.notifier {
            notifier.stopping();
        }
    }
}

impl EventLoop {
    /// Tells clients and the supervisor, once a period each, that the loop has come around, and
    /// the latter the wall's state.
    pub(super) fn show_life(&mut self) {
        self.beat();
        let now = Instant::now();
        let Some(notifier) = self.life_signs.notifier.as_ref() else { return };
        if now < self.life_signs.due {
            return;
        }
        notifier.alive();
        let channels = self.cluster.snapshot(self.now()).status.channels;
        let live = channels.iter().filter(|channel| channel.state == ChannelState::Live).count();
        let there = channels.iter().filter(|channel| channel.state != ChannelState::Lost).count();
        let all = counted(channels.len(), "channel");
        let wall = &self.options.wall.name;
        notifier.status(&format!("wall {wall}: {live} of {all} live, {there} connected"));
        self.life_signs.due = now + notifier.period();
    }

    /// Sends clients a heartbeat if one is due and this manager leads; returns the time of the
    /// next.
    pub(super) fn beat(&mut self) -> Instant {
        let now = Instant::now();
        if now >= self.life_signs.heartbeat_due {
            self.life_signs.heartbeat_due = now + CLIENT_HEARTBEAT_PERIOD;
            if self.leads() {
                self.life_signs.heartbeats.send_replace(());
            }
        }
        self.life_signs.heartbeat_due
    }
}
