//! What frames took: gathered frame by frame, reported as spreads.

use std::collections::VecDeque;

use polyptych_protocol::feedback::{ChannelStatistics, Feedback, Spread, Statistics};
use polyptych_protocol::status::{Drawn, Shown};

use super::Micros;
use super::registry::Registry;
use super::skew::Compared;
use super::totals::Totals;

/// Measurements kept of each kind, the newest ones: 18 minutes at 60 frames per second, and at
/// most 0.5 MiB for a kind.
const SAMPLES_MAX: usize = 1 << 16;

/// The newest measurements of one kind.
#[derive(Debug, Default)]
struct Samples {
    values: VecDeque<f64>,
    count: u64,
    max: f64,
}

impl Samples {
    fn add(&mut self, value: f64) {
        if self.values.len() == SAMPLES_MAX {
            self.values.pop_front();
        }
        self.values.push_back(value);
        self.count += 1;
        self.max = self.max.max(value);
    }

    fn spread(&self) -> Spread {
        // The number and the largest are of all measurements, the rest of those kept.
        let kept = Spread::of(self.values.iter().copied());
        Spread { count: self.count, max: self.max, ..kept }
    }
}

#[derive(Debug, Default)]
struct OfChannel {
    frame_ms: Samples,
    draw_ms: Samples,
    skew_us: Samples,
    clock_error_us: u32,
    frames: u64,
    last_shown_us: Option<u64>,
    longest_gap_us: u64,
    late_before: u64,
    triangles: u64,
    draw_calls: u64,
}

/// All that was measured since the last reset.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    channels: Vec<OfChannel>,
    frame_ms: Samples,
    draw_ms: Samples,
    barrier_us: Samples,
    skew_us: Samples,
    frames: u64,
    first: Option<Micros>,
    last: Micros,
    wire_bytes: u64,
    late: Vec<u64>,
    totals: Totals,
}

impl Gathered {
    pub fn new(channels: usize) -> Self {
        let totals = Totals::new(channels);
        let channels = (0..channels).map(|_| OfChannel::default()).collect();
        Self { channels, totals, ..Self::default() }
    }

    /// Forgets everything but the totals, and the channels' late counts, from which it counts on.
    pub fn restart(&mut self) {
        let late = std::mem::take(&mut self.late);
        let mut fresh = Self::new(self.channels.len());
        for (channel, &late) in fresh.channels.iter_mut().zip(&late) {
            channel.late_before = late;
        }
        std::mem::swap(&mut fresh.totals, &mut self.totals);
        *self = fresh;
    }

    /// Since the manager started.
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    pub fn add_wire_bytes(&mut self, bytes: usize) {
        self.wire_bytes += bytes as u64;
    }

    pub fn add_drawn(&mut self, drawn: &Drawn, frame_us: Micros) {
        self.totals.add_drawn(usize::from(drawn.channel.0), drawn.draw_us);
        let Some(channel) = self.channels.get_mut(usize::from(drawn.channel.0)) else { return };
        channel.frame_ms.add(frame_us as f64 / 1000.0);
        channel.draw_ms.add(f64::from(drawn.draw_us) / 1000.0);
        channel.triangles = drawn.triangles;
        channel.draw_calls = u64::from(drawn.draw_calls);
    }

    pub fn add_frame(&mut self, feedback: &Feedback, slowest_us: Option<u32>, now: Micros) {
        self.totals.add_frame(feedback.frame_us, feedback.barrier_us, slowest_us);
        self.frames += 1;
        self.first.get_or_insert(now);
        self.last = now;
        self.frame_ms.add(feedback.frame_us as f64 / 1000.0);
        self.barrier_us.add(feedback.barrier_us as f64);
        if let Some(slowest) = slowest_us {
            self.draw_ms.add(f64::from(slowest) / 1000.0);
        }
    }

    pub fn add_shown(&mut self, shown: &Shown) {
        self.totals.add_shown(usize::from(shown.channel.0));
        let Some(channel) = self.channels.get_mut(usize::from(shown.channel.0)) else { return };
        channel.frames += 1;
        channel.clock_error_us = shown.clock_error_us;
        // A server that has just come does not know the manager's time yet.
        if shown.clock_error_us == u32::MAX {
            return;
        }
        if let Some(last) = channel.last_shown_us {
            channel.longest_gap_us = channel.longest_gap_us.max(shown.at_us.saturating_sub(last));
        }
        channel.last_shown_us = Some(shown.at_us);
    }

    /// The present calls of one frame, each against the first.
    pub fn add_skews(&mut self, compared: &Compared) {
        for &(id, skew_us) in &compared.skews_us {
            self.totals.add_skew(usize::from(id.0), skew_us);
            if let Some(channel) = self.channels.get_mut(usize::from(id.0)) {
                channel.skew_us.add(skew_us as f64);
            }
        }
        if let Some(widest_us) = compared.widest_us() {
            self.totals.add_widest_skew(widest_us);
            self.skew_us.add(widest_us as f64);
        }
    }

    pub fn report(&mut self, registry: &Registry, features: &[String]) -> Statistics {
        self.late = registry.channels().map(|(_, channel)| channel.late).collect();
        let channels: Vec<ChannelStatistics> = registry
            .channels()
            .zip(&self.channels)
            .map(|((_, channel), of)| {
                let server = channel.server.and_then(|session| registry.server(session));
                // A gap that never ended counts up to the last frame.
                let since_us = of.last_shown_us.or(self.first).unwrap_or(self.last);
                let open_gap_us = self.last.saturating_sub(since_us);
                ChannelStatistics {
                    name: channel.name.clone(),
                    state: channel.state,
                    frames: of.frames,
                    frame_ms: of.frame_ms.spread(),
                    draw_ms: of.draw_ms.spread(),
                    swap_skew_us: of.skew_us.spread(),
                    clock_error_us: of.clock_error_us,
                    longest_gap_ms: of.longest_gap_us.max(open_gap_us) as f64 / 1000.0,
                    late: channel.late - of.late_before.min(channel.late),
                    triangles: of.triangles,
                    draw_calls: of.draw_calls,
                    adapter: server.map(|server| server.adapter.name.clone()),
                    memory_bytes: server.map_or(0, |server| server.memory_bytes),
                }
            })
            .collect();
        let seconds = self.first.map_or(0.0, |first| (self.last - first) as f64 * 1e-6);
        Statistics {
            frames: self.frames,
            seconds,
            frame_ms: self.frame_ms.spread(),
            draw_ms: self.draw_ms.spread(),
            barrier_us: self.barrier_us.spread(),
            swap_skew_us: self.skew_us.spread(),
            late: channels.iter().map(|channel| channel.late).sum(),
            // Servers say how many; whatever they say, it is added up.
            triangles: channels.iter().fold(0, |sum, c| sum.saturating_add(c.triangles)),
            draw_calls: channels.iter().fold(0, |sum, c| sum.saturating_add(c.draw_calls)),
            bytes_per_frame: self.wire_bytes as f64 / self.frames.max(1) as f64,
            features: features.to_vec(),
            channels,
        }
    }
}
