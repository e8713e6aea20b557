//! A sample in the text format of OpenMetrics, which Prometheus asks for first.
//!
//! Names follow <https://prometheus.io/docs/practices/naming/>: base units, `_total` for what only
//! grows; the crate appends unit and `_total`.

use std::fmt;

use polyptych_core::Histogram;
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::process;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Registry, Unit};

use super::MetricsSnapshot;

/// The media type of this format.
pub(super) const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// All states in words, as `status --json` has them.
const STATES: [(ChannelState, &str); 6] = [
    (ChannelState::Lost, "lost"),
    (ChannelState::Joining, "joining"),
    (ChannelState::Preparing, "preparing"),
    (ChannelState::Ready, "ready"),
    (ChannelState::Live, "live"),
    (ChannelState::Late, "late"),
];

/// The whole text.
///
/// # Errors
/// The encoder's, which has no reason to fail.
pub(super) fn render(sample: MetricsSnapshot) -> Result<String, fmt::Error> {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(Exposition(sample)));
    let mut text = String::new();
    text::encode(&mut text, &registry)?;
    Ok(text)
}

#[derive(Debug)]
struct Exposition(MetricsSnapshot);

impl Collector for Exposition {
    fn encode(&self, encoder: DescriptorEncoder) -> fmt::Result {
        let mut page = MetricsPage(encoder);
        self.wall(&mut page)?;
        self.channels(&mut page)?;
        self.machinery(&mut page)
    }
}

impl Exposition {
    fn wall(&self, page: &mut MetricsPage) -> fmt::Result {
        let (status, totals) = (&self.0.snapshot.status, &self.0.snapshot.totals);
        let mut info = page.metric("polyptych_manager", "This manager.", None, MetricType::Info)?;
        info.encode_info(&[
            ("version", env!("CARGO_PKG_VERSION")),
            ("wall", &status.wall),
            ("epoch", &status.epoch.to_string()),
        ])?;
        page.counter("polyptych_frames", "Frames swapped.", totals.frames)?;
        page.counter(
            "polyptych_complete_frames",
            "Frames that every channel of the wall had drawn when they were swapped.",
            totals.complete,
        )?;
        page.gauge(
            "polyptych_last_frame",
            "The last frame that was swapped.",
            status.frame.0 as f64,
        )?;
        page.gauge(
            "polyptych_revision",
            "Changes of the scene so far, over all managers of this wall.",
            status.revision.0 as f64,
        )?;
        page.histogram(
            "polyptych_frame",
            "From the frame command to the swap command.",
            &totals.frame_s,
        )?;
        page.histogram(
            "polyptych_barrier",
            "What of a frame the slowest channel did not draw: network, waiting, deciding.",
            &totals.barrier_s,
        )?;
        page.histogram(
            "polyptych_draw",
            "The slowest waited-for channel's own drawing time of a frame.",
            &totals.draw_s,
        )?;
        page.histogram(
            "polyptych_swap_skew",
            "From the first to the last channel's present call of a frame.",
            &totals.skew_s,
        )?;
        page.seconds(
            "polyptych_deadline",
            "How long the next frame waits for its channels.",
            status.deadline_ms / 1000.0,
        )?;
        page.gauge("polyptych_clients", "Connected clients.", status.clients.len() as f64)?;
        page.gauge("polyptych_warnings", "Warnings of the status.", status.warnings.len() as f64)
    }

    fn channels(&self, page: &mut MetricsPage) -> fmt::Result {
        let MetricsSnapshot { snapshot, .. } = &self.0;
        let channels = &snapshot.status.channels;
        let mut family = page.metric(
            "polyptych_channel_state",
            "1 for the state that the channel is in.",
            None,
            MetricType::Gauge,
        )?;
        for channel in channels {
            for (state, name) in STATES {
                let labels = [("channel", channel.name.as_str()), ("state", name)];
                let is_in = u32::from(channel.state == state);
                family.encode_family(&labels)?.encode_gauge(&is_in)?;
            }
        }
        let late = channels.iter().map(|channel| channel.late);
        let totals = &snapshot.totals.channels;
        self.of_channels(page, "late", "Deadlines missed.", late)?;
        self.of_channels(page, "lost", "Servers lost.", snapshot.lost.iter().copied())?;
        self.of_channels(page, "frames", "Frames shown.", totals.iter().map(|of| of.frames))?;
        self.of_channels(page, "drawn", "Frames drawn.", totals.iter().map(|of| of.drawn))?;
        self.of_channels(
            page,
            "compared",
            "Frames whose present call was compared with the other channels'.",
            totals.iter().map(|of| of.compared),
        )?;
        self.seconds_of_channels(
            page,
            "draw",
            "Spent on drawing; by `drawn`, the mean of a frame.",
            totals.iter().map(|of| of.draw_s),
        )?;
        self.seconds_of_channels(
            page,
            "swap_skew",
            "Presented after the first channel; by `compared`, the mean of a frame.",
            totals.iter().map(|of| of.skew_s),
        )
    }

    fn of_channels(
        &self,
        page: &mut MetricsPage,
        what: &str,
        help: &str,
        values: impl Iterator<Item = u64>,
    ) -> fmt::Result {
        let name = format!("polyptych_channel_{what}");
        let mut family = page.metric(&name, help, None, MetricType::Counter)?;
        for (channel, value) in self.0.snapshot.status.channels.iter().zip(values) {
            let labels = [("channel", channel.name.as_str())];
            family.encode_family(&labels)?.encode_counter::<NoLabelSet, _, f64>(&value, None)?;
        }
        Ok(())
    }

    fn seconds_of_channels(
        &self,
        page: &mut MetricsPage,
        what: &str,
        help: &str,
        values: impl Iterator<Item = f64>,
    ) -> fmt::Result {
        let name = format!("polyptych_channel_{what}");
        let mut family = page.metric(&name, help, Some(&Unit::Seconds), MetricType::Counter)?;
        for (channel, value) in self.0.snapshot.status.channels.iter().zip(values) {
            let labels = [("channel", channel.name.as_str())];
            family.encode_family(&labels)?.encode_counter::<NoLabelSet, _, f64>(&value, None)?;
        }
        Ok(())
    }

    fn machinery(&self, page: &mut MetricsPage) -> fmt::Result {
        let MetricsSnapshot { snapshot, queues, bytes } = &self.0;
        let mut family = page.metric(
            "polyptych_server_memory",
            "Resident memory of a server's process, as it said last.",
            Some(&Unit::Bytes),
            MetricType::Gauge,
        )?;
        for (server, memory_bytes) in &snapshot.servers {
            family.encode_family(&[("server", server)])?.encode_gauge(memory_bytes)?;
        }
        let mut family = page.metric(
            "polyptych_server_connection",
            "Of messages with servers, without the lengths before them.",
            Some(&Unit::Bytes),
            MetricType::Counter,
        )?;
        for &(connection, direction, bytes) in bytes {
            let labels = [("connection", connection), ("direction", direction)];
            family.encode_family(&labels)?.encode_counter::<NoLabelSet, _, f64>(&bytes, None)?;
        }
        let help = "What waits; of outboxes and orders, in the fullest.";
        let mut family = page.metric("polyptych_queue_length", help, None, MetricType::Gauge)?;
        for queue in queues {
            family.encode_family(&[("queue", queue.name)])?.encode_gauge(&queue.length)?;
        }
        let help = "What may wait; a peer beyond it is refused or let go.";
        let mut family = page.metric("polyptych_queue_limit", help, None, MetricType::Gauge)?;
        for queue in queues {
            family.encode_family(&[("queue", queue.name)])?.encode_gauge(&queue.limit)?;
        }
        if let Some(memory_bytes) = process::resident_bytes() {
            // The name that every program's memory has in Prometheus.
            let help = "Resident memory of the manager.";
            let unit = Some(&Unit::Bytes);
            page.metric("process_resident_memory", help, unit, MetricType::Gauge)?
                .encode_gauge(&memory_bytes)?;
        }
        Ok(())
    }
}

struct MetricsPage<'a>(DescriptorEncoder<'a>);

impl MetricsPage<'_> {
    fn metric<'s>(
        &'s mut self,
        name: &'s str,
        help: &str,
        unit: Option<&'s Unit>,
        metric_type: MetricType,
    ) -> Result<MetricEncoder<'s>, fmt::Error> {
        self.0.encode_descriptor(name, help, unit, metric_type)
    }

    fn counter(&mut self, name: &str, help: &str, value: u64) -> fmt::Result {
        let mut metric = self.metric(name, help, None, MetricType::Counter)?;
        metric.encode_counter::<NoLabelSet, _, f64>(&value, None)
    }

    fn gauge(&mut self, name: &str, help: &str, value: f64) -> fmt::Result {
        self.metric(name, help, None, MetricType::Gauge)?.encode_gauge(&value)
    }

    fn seconds(&mut self, name: &str, help: &str, value: f64) -> fmt::Result {
        self.metric(name, help, Some(&Unit::Seconds), MetricType::Gauge)?.encode_gauge(&value)
    }

    fn histogram(&mut self, name: &str, help: &str, histogram: &Histogram) -> fmt::Result {
        let buckets: Vec<(f64, u64)> = histogram.buckets().collect();
        let (sum, count) = (histogram.sum(), histogram.count());
        self.metric(name, help, Some(&Unit::Seconds), MetricType::Histogram)?
            .encode_histogram::<NoLabelSet>(sum, count, &buckets, None)
    }
}
