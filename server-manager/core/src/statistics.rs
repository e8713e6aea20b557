//! Times of frames: gathered frame by frame, reported as quantiles.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use polyptych_protocol::feedback::{
    ChannelStatistics, FrameFeedback, Quantiles, ResolutionScales, Statistics,
};
use polyptych_protocol::quality_bounds::{RESOLUTION_STEPS_MAX, resolution_scale};
use polyptych_protocol::server_message::{FramePresented, FrameRendered};
use polyptych_scene::FramePass;
use polyptych_wall::ChannelId;

use super::Micros;
use super::counters::Counters;
use super::registry::Registry;
use super::skew::FrameSkew;

/// Digits of a quantile that are right: it lies at most a thousandth below a measured value.
const DIGITS: u8 = 3;

/// The longest time that is told apart from longer ones; it bounds what one kind takes to some
/// hundred kibibytes.
const LONGEST_US: u64 = 3_600_000_000;

/// Units of error bounds in a pixel, as they are counted.
const ERROR_UNITS: f64 = 1000.0;

/// Measurements of one kind, counted by their size: noting one and asking for quantiles cost the
/// same after a minute and after a year, which a list of all that was measured would not.
#[derive(Debug)]
struct Samples {
    histogram: Option<Histogram<u32>>,
    max_us: u64,
}

impl Default for Samples {
    fn default() -> Self {
        // It refuses a number of digits beyond five.
        Self { histogram: Histogram::new(DIGITS).ok(), max_us: 0 }
    }
}

impl Samples {
    fn add_us(&mut self, us: u64) {
        self.max_us = self.max_us.max(us);
        if let Some(histogram) = &mut self.histogram {
            // It grows to the longest time and not beyond.
            let _ = histogram.record(us.min(LONGEST_US));
        }
    }

    /// In units of so many microseconds.
    fn spread(&self, unit_us: f64) -> Quantiles {
        let Some(histogram) = &self.histogram else { return Quantiles::default() };
        let at = |share: f64| {
            let us = histogram.lowest_equivalent(histogram.value_at_quantile(share));
            us as f64 / unit_us
        };
        let (p50, p95, p99) = (at(0.5), at(0.95), at(0.99));
        let max = self.max_us as f64 / unit_us;
        Quantiles { count: histogram.len(), p50, p95, p99, max }
    }

    fn spread_us(&self) -> Quantiles {
        self.spread(1.0)
    }

    fn spread_ms(&self) -> Quantiles {
        self.spread(1000.0)
    }
}

#[derive(Debug, Default)]
struct ChannelSamples {
    frame: Samples,
    draw: Samples,
    skew: Samples,
    clock_error_us: u32,
    unscheduled: u64,
    frames: u64,
    last_shown_us: Option<u64>,
    longest_gap_us: u64,
    late_before: u64,
    triangles: u64,
    draw_calls: u64,
    draws_occluded: u64,
    /// Microseconds of each pass, of so many frames that tell.
    passes_us: BTreeMap<FramePass, u64>,
    measured: u64,
    /// Frames that it limited: it drew longest on the server that did.
    limiting: u64,
}

/// Facts about a swapped frame that its feedback does not have.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FrameFacts {
    /// It waited for at least one channel.
    pub is_awaited: bool,
    /// Every channel of the wall had drawn it.
    pub is_complete: bool,
    /// It was sent while another frame was on its way.
    pub is_ahead: bool,
    /// The longest drawing time of a server for the channels that it waited for, in microseconds;
    /// `None` if none of these had drawn.
    pub slowest_us: Option<u32>,
    /// The channel that drew longest on the server that drew longest.
    pub limiting: Option<ChannelId>,
    /// The steps by which its resolution was lowered.
    pub resolution_steps: u8,
}

/// All that was measured since the last reset.
#[derive(Debug, Default)]
pub(super) struct StatisticsCollector {
    channels: Vec<ChannelSamples>,
    frame: Samples,
    draw: Samples,
    barrier: Samples,
    skew: Samples,
    /// Error bounds in force, in thousandths of a pixel.
    error: Samples,
    largest_error_px: f64,
    /// Frames by the steps by which their resolution was lowered.
    by_resolution: [u64; RESOLUTION_STEPS_MAX as usize + 1],
    frames: u64,
    complete: u64,
    ahead: u64,
    /// The time at which the first frame began.
    first: Option<Micros>,
    last: Micros,
    late: Vec<u64>,
    totals: Counters,
}

impl StatisticsCollector {
    pub fn new(channels: usize) -> Self {
        let totals = Counters::new(channels);
        let channels = (0..channels).map(|_| ChannelSamples::default()).collect();
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
    pub fn totals(&self) -> &Counters {
        &self.totals
    }

    /// Counts a drawing, `frame_us` after its frame began: one that came after the swap too, since
    /// a channel that is always late would otherwise have no times.
    pub fn add_drawn(&mut self, drawn: &FrameRendered, frame_us: Micros) {
        self.totals.add_drawn(usize::from(drawn.channel.0), drawn.draw_us);
        let Some(channel) = self.channels.get_mut(usize::from(drawn.channel.0)) else { return };
        channel.frame.add_us(frame_us);
        channel.draw.add_us(u64::from(drawn.draw_us));
        channel.triangles = drawn.triangles;
        channel.draw_calls = u64::from(drawn.draw_calls);
        channel.draws_occluded = channel.draws_occluded.max(u64::from(drawn.draws_occluded));
        channel.measured += u64::from(drawn.passes.is_measured());
        for (pass, us) in drawn.passes.iter().filter(|(_, us)| *us > 0) {
            *channel.passes_us.entry(pass).or_default() += u64::from(us);
        }
    }

    /// Counts a frame that is swapped at `now`.
    pub fn add_frame(&mut self, feedback: &FrameFeedback, facts: FrameFacts, now: Micros) {
        self.totals.add_frame(feedback.frame_us, feedback.barrier_us, facts);
        self.frames += 1;
        self.complete += u64::from(facts.is_complete);
        self.ahead += u64::from(facts.is_ahead);
        self.first.get_or_insert(now.saturating_sub(feedback.frame_us));
        self.last = now;
        self.error.add_us((feedback.detail.error_in_force_px * ERROR_UNITS) as u64);
        self.largest_error_px = self.largest_error_px.max(feedback.detail.largest_error_px);
        self.by_resolution[usize::from(facts.resolution_steps)] += 1;
        let limiting = facts.limiting.and_then(|id| self.channels.get_mut(usize::from(id.0)));
        if let Some(channel) = limiting {
            channel.limiting += 1;
        }
        // A frame that waits for no channel takes no time, and says nothing of those that do. One
        // whose deadline passed took that long, even if no channel drew it.
        if facts.is_awaited {
            self.frame.add_us(feedback.frame_us);
        }
        // Without a drawing there is nothing to divide the frame's time by.
        if let Some(slowest) = facts.slowest_us {
            self.barrier.add_us(feedback.barrier_us);
            self.draw.add_us(u64::from(slowest));
        }
    }

    pub fn add_shown(&mut self, shown: &FramePresented) {
        self.totals.add_shown(usize::from(shown.channel.0));
        let Some(channel) = self.channels.get_mut(usize::from(shown.channel.0)) else { return };
        channel.frames += 1;
        channel.clock_error_us = shown.clock_error_us;
        channel.unscheduled += u64::from(shown.is_unscheduled);
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
    pub fn add_skews(&mut self, compared: &FrameSkew) {
        for &(id, skew_us) in &compared.skews_us {
            self.totals.add_skew(usize::from(id.0), skew_us);
            if let Some(channel) = self.channels.get_mut(usize::from(id.0)) {
                channel.skew.add_us(skew_us);
            }
        }
        if let Some(widest_us) = compared.widest_us() {
            self.totals.add_widest_skew(widest_us);
            self.skew.add_us(widest_us);
        }
    }

    /// The report; `asked_px` is the error bound that is asked for.
    pub fn report(
        &mut self,
        registry: &Registry,
        features: &[String],
        asked_px: f64,
    ) -> Statistics {
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
                    frame_ms: of.frame.spread_ms(),
                    draw_ms: of.draw.spread_ms(),
                    swap_skew_us: of.skew.spread_us(),
                    clock_error_us: of.clock_error_us,
                    longest_gap_ms: of.longest_gap_us.max(open_gap_us) as f64 / 1000.0,
                    unscheduled: of.unscheduled,
                    late: channel.late - of.late_before.min(channel.late),
                    triangles: of.triangles,
                    draw_calls: of.draw_calls,
                    draws_occluded: of.draws_occluded,
                    passes_us: of.passes_us.iter().map(|(p, us)| (*p, us / of.measured)).collect(),
                    adapter: server.map(|server| server.adapter.name.clone()),
                    memory_bytes: server.map_or(0, |server| server.memory_bytes),
                }
            })
            .collect();
        let seconds = self.first.map_or(0.0, |first| (self.last - first) as f64 * 1e-6);
        Statistics {
            frames: self.frames,
            complete: self.complete,
            ahead: self.ahead,
            seconds,
            frame_ms: self.frame.spread_ms(),
            draw_ms: self.draw.spread_ms(),
            barrier_us: self.barrier.spread_us(),
            swap_skew_us: self.skew.spread_us(),
            late: channels.iter().map(|channel| channel.late).sum(),
            // Servers say how many; whatever they say, it is added up.
            triangles: channels.iter().fold(0, |sum, c| sum.saturating_add(c.triangles)),
            draw_calls: channels.iter().fold(0, |sum, c| sum.saturating_add(c.draw_calls)),
            draws_occluded: channels.iter().fold(0, |sum, c| sum.saturating_add(c.draws_occluded)),
            error_bound_px: asked_px,
            error_in_force_px: self.error.spread(ERROR_UNITS),
            largest_error_px: self.largest_error_px,
            gpu_bytes: registry.servers().map(|(_, server)| server.scene_bytes).max().unwrap_or(0),
            limiting_channel: self.limiting_channel(registry),
            // The core sees no bytes.
            bytes_per_frame: 0.0,
            features: features.to_vec(),
            channels,
            resolution_scale: self.resolution_scales(),
        }
    }

    fn resolution_scales(&self) -> ResolutionScales {
        let all: u64 = self.by_resolution.iter().sum();
        let (mut scales, mut counted) = (ResolutionScales::FULL, 0);
        let mut is_lowest = true;
        for (steps, &frames) in (0..=RESOLUTION_STEPS_MAX).zip(&self.by_resolution).rev() {
            if frames > 0 && std::mem::take(&mut is_lowest) {
                scales.min = resolution_scale(steps);
            }
            if 2 * counted < all {
                scales.p50 = resolution_scale(steps);
            }
            counted += frames;
        }
        scales
    }

    fn limiting_channel(&self, registry: &Registry) -> Option<String> {
        let all = registry.channels().zip(&self.channels).filter(|(_, of)| of.limiting > 0);
        let most = all.max_by_key(|(_, of)| of.limiting);
        most.map(|((_, channel), _)| channel.name.clone())
    }
}
