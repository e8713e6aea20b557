//! Statuses of servers become feedback and status for clients.

use std::collections::{BTreeMap, BTreeSet};

use polyptych_protocol::feedback::{
    ChannelFeedback, ChannelStatus, FrameFeedback, Statistics, WallStatus,
};
use polyptych_protocol::request::MessageToClient;
use polyptych_wall::ChannelId;

use super::barrier::Barrier;
use super::registry::ChannelEntry;
use super::{Cluster, Effect, Micros};

/// Servers that a warning names, of those that say the same.
const SERVERS_NAMED_MAX: usize = 4;

impl Cluster {
    pub(super) fn aggregate(&self, barrier: &Barrier, now: Micros) -> FrameFeedback {
        let frame_us = now.saturating_sub(barrier.began);
        let slowest_us = barrier.slowest_us().unwrap_or(0);
        let channel = |id: ChannelId, channel: &ChannelEntry| {
            let drawn = barrier.drawn.get(&id);
            ChannelFeedback {
                name: channel.name.clone(),
                state: channel.state,
                since_ms: now.saturating_sub(channel.since) / 1000,
                reason: channel.reason.clone(),
                shown_at_us: channel.shown_at_us,
                draw_us: drawn.map(|drawn| drawn.draw_us),
                triangles: drawn.map_or(0, |drawn| drawn.triangles),
                draw_calls: drawn.map_or(0, |drawn| drawn.draw_calls),
                skew: self.present_calls.skew_refreshed(id),
            }
        };
        let channels = self.registry.channels();
        FrameFeedback {
            frame: barrier.frame,
            time_s: barrier.time_s,
            revision: barrier.revision,
            frame_us,
            barrier_us: frame_us.saturating_sub(Micros::from(slowest_us)),
            navigations: self.navigator.count,
            detail: self.drawn_detail(barrier),
            channels: channels.map(|(id, of)| channel(id, of)).collect(),
        }
    }

    /// Sends the feedback of a frame to those who want it.
    pub(super) fn publish(&mut self, feedback: &FrameFeedback) {
        let detail = &feedback.detail;
        self.drawn_error_px = [detail.error_in_force_px, detail.largest_error_px];
        let subscribed = self.clients.iter().filter(|(_, client)| client.is_subscribed);
        for (&to, _) in subscribed {
            let answer = MessageToClient::Feedback(feedback.clone());
            self.outputs.push_back(Effect::Answer { to, answer });
        }
    }

    /// The wall as it stands.
    pub fn status(&self, now: Micros) -> WallStatus {
        let channels = self.registry.channels().map(|(id, channel)| {
            let server = channel.server.and_then(|session| self.registry.server(session));
            ChannelStatus {
                name: channel.name.clone(),
                state: channel.state,
                since_ms: now.saturating_sub(channel.since) / 1000,
                reason: channel.reason.clone(),
                pid: server.map(|server| server.pid),
                address: server.map(|server| server.address.clone()),
                adapter: server.map(|server| server.adapter.name.clone()),
                frame: channel.frame,
                revision: server.and_then(|server| server.prepared).unwrap_or_default(),
                late: channel.late,
                draw_us: channel.draw_us,
                skew: self.present_calls.skew(id),
                memory_bytes: server.map_or(0, |server| server.memory_bytes),
                scene_bytes: server.map_or(0, |server| server.scene_bytes),
            }
        });
        WallStatus {
            wall: self.wall.name.clone(),
            epoch: self.epoch,
            revision: self.shown.revision,
            digest: self.shown_digest,
            frame: self.swapped,
            scene: self.shown.scene.as_ref().map(|scene| scene.name.clone()),
            deadline_ms: self.deadline.length() as f64 / 1000.0,
            error_in_force_px: self.rate_bound.in_force_px(&self.presentation.bounds),
            presentation: self.presentation.clone(),
            channels: channels.collect(),
            clients: self.clients.values().map(|client| client.name.clone()).collect(),
            warnings: self.warnings(),
            notes: self.notes.clone(),
            opening: self.openings(),
            // The core has no system to ask.
            memory_bytes: 0,
            resolution_scale: self.resolution_scale(),
            environment: self.shown.environment.as_ref().map(|of| of.name.clone()),
            rest: self.rest.status(),
            devices: self.devices.statuses(now),
            // The core has no lease.
            leader: None,
        }
    }

    fn warnings(&self) -> Vec<String> {
        let displays = self.registry.channels();
        let displays = displays.filter_map(|(_, channel)| channel.display_warning.clone());
        let slow = self.rate_warning().into_iter().chain(self.budget_warning());
        let all = self.mixed_adapters().into_iter().chain(displays);
        all.chain(self.storage_warnings()).chain(slow).chain(self.devices.warnings()).collect()
    }

    /// The warnings of servers about object stores: once for all that say the same.
    fn storage_warnings(&self) -> Vec<String> {
        let mut told = BTreeMap::<&str, Vec<&str>>::new();
        for (_, server) in self.registry.servers() {
            if let Some(warning) = &server.storage_warning {
                told.entry(warning).or_default().push(&server.name);
            }
        }
        let sentence = |(warning, servers): (&str, Vec<&str>)| {
            let first = servers[..servers.len().min(SERVERS_NAMED_MAX)].join(", ");
            let more = match servers.len().saturating_sub(SERVERS_NAMED_MAX) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("{warning} (told by {first}{more})")
        };
        told.into_iter().map(sentence).collect()
    }

    fn mixed_adapters(&self) -> Option<String> {
        let drivers: BTreeSet<String> = self
            .registry
            .servers()
            .map(|(_, server)| format!("{} ({})", server.adapter.name, server.adapter.driver))
            .collect();
        if drivers.len() < 2 {
            return None;
        }
        let list: Vec<_> = drivers.into_iter().collect();
        Some(format!(
            "the wall mixes adapters or drivers, so its channels may differ by more than the \
             tolerance of one driver: {}",
            list.join("; ")
        ))
    }

    pub(super) fn statistics(&mut self, reset: bool) -> Statistics {
        for compared in self.present_calls.settle() {
            self.gathered.add_skews(&compared);
        }
        let asked_px = self.presentation.bounds.error_px;
        let statistics = self.gathered.report(&self.registry, &self.features, asked_px);
        if reset {
            self.gathered.restart();
        }
        statistics
    }
}
