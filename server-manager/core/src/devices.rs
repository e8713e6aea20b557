//! Trackers, wands and pads of the wall file, as their bridges report them.

use polyptych_protocol::device_status::{DeviceState, DeviceStatus};
use polyptych_protocol::feedback::Quantiles;
use polyptych_text::make_printable;
use polyptych_wall::Wall;
use polyptych_wall::limits::DEVICES_MAX;
use serde::{Deserialize, Serialize};

use super::head_return::HeadReturn;
use super::{Cluster, Micros, REASON_BYTES_MAX, SessionId};

/// The reason of a device that no client has reported yet.
const UNREAD: &str = "no bridge reads it; run polyptych devices WALL.toml";

/// The reason of a device whose client has left.
const BRIDGE_GONE: &str = "its bridge has left; run polyptych devices WALL.toml";

/// A device and the client that reads it.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct DeviceEntry {
    /// The last report, which came at `at`.
    status: DeviceStatus,
    at: Micros,
    client: Option<SessionId>,
}

/// The devices of the wall file, in its order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Devices {
    entries: Vec<DeviceEntry>,
    /// The client that has placed the head; `None` if a session, the wall file or another manager
    /// has.
    #[serde(default)]
    pub head_of: Option<SessionId>,
    /// The way of a head whose bridge has left.
    #[serde(default)]
    pub head_return: Option<HeadReturn>,
}

impl Devices {
    /// Creates the devices of a wall, which no client reads yet.
    pub fn new(wall: &Wall) -> Self {
        let entry = |name: &str| DeviceEntry {
            status: DeviceStatus::waiting(name, UNREAD),
            at: 0,
            client: None,
        };
        let entries = wall.devices.iter().map(|device| entry(&device.name)).collect();
        Self { entries, head_of: None, head_return: None }
    }

    /// Returns the time at which a head that returns is moved next.
    pub fn next_head_place(&self) -> Option<Micros> {
        self.head_return.map(|way| way.next)
    }

    /// Returns every device as it stands at `now`.
    pub fn statuses(&self, now: Micros) -> Vec<DeviceStatus> {
        let status = |entry: &DeviceEntry| {
            let elapsed_ms = now.saturating_sub(entry.at) / 1000;
            let since_ms = entry.status.since_ms.saturating_add(elapsed_ms);
            DeviceStatus { since_ms, ..entry.status.clone() }
        };
        self.entries.iter().map(status).collect()
    }

    /// Returns a sentence for each device without readings.
    pub fn warnings(&self) -> Vec<String> {
        let dead = self.entries.iter().filter(|entry| entry.status.state != DeviceState::Live);
        dead.map(|DeviceEntry { status, .. }| {
            let reason = status.reason.as_deref().unwrap_or("its bridge gives no reason");
            format!("device {} is {}: {reason}", status.name, status.state.name())
        })
        .collect()
    }

    /// Returns the places in `entries` of the devices of a report.
    fn places(&self, client: SessionId, report: &[DeviceStatus]) -> Result<Vec<usize>, String> {
        if report.len() > DEVICES_MAX {
            return Err(format!("{} devices, where {DEVICES_MAX} can be", report.len()));
        }
        let place = |status: &DeviceStatus| {
            let name = &status.name;
            let found = self.entries.iter().position(|entry| entry.status.name == *name);
            let Some(place) = found else {
                let all: Vec<&str> = self.entries.iter().map(|e| e.status.name.as_str()).collect();
                let all = if all.is_empty() { "none".to_owned() } else { all.join(", ") };
                return Err(format!(
                    "the manager's wall file has no device {name:?}, only: {all}; give the bridge \
                     the same wall file"
                ));
            };
            match self.entries[place].client {
                Some(other) if other != client => {
                    Err(format!("another bridge reads device {name} already; end one of them"))
                }
                _ => Ok(place),
            }
        };
        report.iter().map(place).collect()
    }
}

impl Cluster {
    /// Handles a client's report of the devices that it reads; applies all of it or nothing.
    ///
    /// # Errors
    /// A device that the wall file does not have, or that another client reads.
    pub(super) fn report_devices(
        &mut self,
        now: Micros,
        client: SessionId,
        report: Vec<DeviceStatus>,
    ) -> Result<(), String> {
        let places = self.devices.places(client, &report)?;
        for (place, mut status) in places.into_iter().zip(report) {
            if let Some(reason) = &mut status.reason {
                reason.truncate(reason.floor_char_boundary(REASON_BYTES_MAX));
                make_printable(reason);
            }
            // JSON has no NaN: one would make the status unreadable for every client.
            let Quantiles { p50, p95, p99, max, .. } = &mut status.latency_ms;
            for number in [&mut status.rate_hz, p50, p95, p99, max] {
                if !number.is_finite() {
                    *number = 0.0;
                }
            }
            self.set_device(now, place, status, Some(client));
        }
        Ok(())
    }

    /// Returns whether a bridge has placed the head with a device that it reads, or the head
    /// returns from there.
    pub(super) fn is_head_tracked(&self) -> bool {
        let Devices { entries, head_of, head_return } = &self.devices;
        let is_read = |entry: &DeviceEntry| head_of.is_some() && entry.client == *head_of;
        let mut all = self.wall.devices.iter().zip(entries);
        head_return.is_some() || all.any(|(device, entry)| device.head.is_some() && is_read(entry))
    }

    /// Marks the devices of a client as lost: its connection has ended. The head is held, and then
    /// returns to its place in the wall file, if the client has placed it with one of them.
    pub(super) fn lose_devices(&mut self, now: Micros, client: SessionId) {
        let is_its_head = self.devices.head_of == Some(client) && self.is_head_tracked();
        for place in 0..self.devices.entries.len() {
            let entry = &self.devices.entries[place];
            if entry.client == Some(client) {
                let status = DeviceStatus {
                    state: DeviceState::Lost,
                    since_ms: 0,
                    reason: Some(BRIDGE_GONE.into()),
                    rate_hz: 0.0,
                    ..entry.status.clone()
                };
                self.set_device(now, place, status, None);
            }
        }
        if is_its_head {
            self.begin_head_return(now);
        }
    }

    fn set_device(
        &mut self,
        now: Micros,
        place: usize,
        status: DeviceStatus,
        client: Option<SessionId>,
    ) {
        let entry = &mut self.devices.entries[place];
        let is_news = entry.status.state != status.state || entry.client != client;
        *entry = DeviceEntry { status, at: now, client };
        let status = &entry.status;
        let (device, state) = (&status.name, status.state.name());
        // A device that comes and goes all the time fills no log.
        let what = format!("device {device} is {state}");
        let Some(times) = is_news.then(|| self.repetitions.should_log(now, &what)).flatten() else {
            return;
        };
        match status.reason.as_deref() {
            Some(reason) if status.state != DeviceState::Live => {
                tracing::warn!(device, state, reason, times, "device has no readings");
            }
            _ => tracing::info!(device, state, times, "device is read"),
        }
    }
}
