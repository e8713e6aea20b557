//! Signs of life of the loop for the supervisor of this process.

use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_text::counted;
use tokio::time::Instant;

use super::EventLoop;

/// Signs of life at equal periods; nothing at all without a supervisor.
#[derive(Debug)]
pub(super) struct LifeSigns {
    notifier: Option<ServiceNotifier>,
    due: Instant,
}

impl LifeSigns {
    pub fn new(notifier: Option<ServiceNotifier>) -> Self {
        Self { notifier, due: Instant::now() }
    }

    /// The time of the next sign; `None` without a supervisor.
    pub fn due(&self) -> Option<Instant> {
        self.notifier.as_ref().map(|_| self.due)
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
    /// Tells the supervisor, once a period, that the loop has come around, and the wall's state.
    pub(super) fn show_life(&mut self) {
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
}
