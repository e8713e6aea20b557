//! The state of a server's connection, as text for displays that have room for it.

use std::time::{SystemTime, UNIX_EPOCH};

/// The state of the connection, reported by the network thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectionStatus {
    /// In words.
    pub what: String,
    /// Since when, in UTC: hours, minutes and seconds.
    pub since: String,
    /// This machine's, on its way to the manager; with the port once connected.
    pub address: Option<String>,
    /// The state of the manager.
    pub manager: ManagerState,
}

/// The state of the manager, as far as displays show it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ManagerState {
    /// It is there, or there was none.
    #[default]
    Expected,
    /// The connection was lost: the last frame stays, with these words.
    Lost,
    /// Its process was asked to end, and may be started again: the last frame stays likewise.
    Ended,
    /// A person stopped the wall: displays say so instead of the last frame.
    Stopped,
}

/// The identity of a server, beside its channels and its address.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServerInfo {
    /// The server's name in logs and status.
    pub server: String,
    /// The name of the adapter that it draws with.
    pub adapter: String,
}

impl ServerInfo {
    /// The lines by which a person finds out which display stands before them, and where its
    /// pictures come from.
    pub fn identify_lines(
        &self,
        channel: &str,
        size: [u32; 2],
        notice: Option<&ConnectionStatus>,
    ) -> Vec<String> {
        let mut lines = self.head(channel, notice);
        lines.push(format!("{} x {} pixels", size[0], size[1]));
        lines.push(self.adapter.clone());
        lines
    }

    /// The lines of a display that has no picture: what it is, why, and since when.
    pub fn idle_lines(
        &self,
        channel: &str,
        notice: &ConnectionStatus,
        is_frozen: bool,
    ) -> Vec<String> {
        let mut lines = self.head(channel, Some(notice));
        lines.push(if is_frozen {
            "the displays are frozen, and this one had no picture to keep".to_owned()
        } else {
            notice.what.clone()
        });
        // A stop is an event, and its time is in the line above.
        if notice.manager != ManagerState::Stopped || is_frozen {
            lines.push(format!("since {}", notice.since));
        }
        lines
    }

    fn head(&self, channel: &str, notice: Option<&ConnectionStatus>) -> Vec<String> {
        let mut lines = vec![channel.to_owned(), format!("server {}", self.server)];
        lines.extend(notice.and_then(|notice| notice.address.clone()));
        lines
    }
}

/// Hours, minutes and seconds in UTC, which all machines of a wall agree on.
pub fn time_of_day() -> String {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let of_day = since_1970.as_secs() % 86_400;
    format!("{:02}:{:02}:{:02} UTC", of_day / 3600, of_day / 60 % 60, of_day % 60)
}
