//! Costs of timed frames, one by one and in sum.

use polyptych_client::FrameFeedback;
use serde::Serialize;

/// Measurements of all frames of one setting.
#[derive(Clone, Debug, Default)]
pub(super) struct FrameSamples {
    frame_ms: Vec<f64>,
    draw_ms: Vec<f64>,
    triangles: Vec<f64>,
    draw_calls: Vec<f64>,
    error_in_force_px: Vec<f64>,
    largest_error_px: f64,
}

impl FrameSamples {
    /// Adds a frame that all channels have drawn.
    pub fn add(&mut self, feedback: &FrameFeedback) {
        let channels = &feedback.channels;
        let draw_us: u64 = channels.iter().filter_map(|c| c.draw_us).map(u64::from).sum();
        let triangles: u64 = channels.iter().map(|channel| channel.triangles).sum();
        let draw_calls: u64 = channels.iter().map(|channel| u64::from(channel.draw_calls)).sum();
        self.frame_ms.push(feedback.frame_us as f64 / 1e3);
        self.draw_ms.push(draw_us as f64 / 1e3);
        self.triangles.push(triangles as f64);
        self.draw_calls.push(draw_calls as f64);
        self.error_in_force_px.push(feedback.detail.error_in_force_px);
        self.largest_error_px = self.largest_error_px.max(feedback.detail.largest_error_px);
    }

    /// Returns what a frame costs.
    pub fn costs(&self) -> FrameCosts {
        let frame_ms_spread = Spread::from_samples(&self.frame_ms);
        FrameCosts {
            frame_ms: frame_ms_spread.p50,
            frame_ms_spread,
            draw_ms: Spread::from_samples(&self.draw_ms).p50,
            triangles: Spread::from_samples(&self.triangles).p50 as u64,
            draw_calls: Spread::from_samples(&self.draw_calls).p50 as u64,
            error_in_force_px: Spread::from_samples(&self.error_in_force_px),
            largest_error_px: self.largest_error_px,
        }
    }
}

/// The cost of a frame: medians, unless a field says otherwise.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct FrameCosts {
    /// From the frame command to the swap command, in milliseconds.
    pub frame_ms: f64,
    /// The spread of the times of all frames.
    pub frame_ms_spread: Spread,
    /// Drawing times of all channels together, in milliseconds.
    pub draw_ms: f64,
    /// Triangles that all channels drew together, each instance counted.
    pub triangles: u64,
    /// Calls that drew them.
    pub draw_calls: u64,
    /// The error bounds in force, in pixels of the wall.
    pub error_in_force_px: Spread,
    /// The largest error that any frame is stated to have, in pixels of the wall.
    pub largest_error_px: f64,
}

/// Quantiles of measurements: the quantile q is the smallest one that q of all do not exceed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Spread {
    /// Number of measurements.
    pub count: usize,
    pub p25: f64,
    pub p50: f64,
    pub p75: f64,
    pub p95: f64,
    pub max: f64,
}

impl Spread {
    pub fn from_samples(samples: &[f64]) -> Self {
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quantile = |percent: usize| {
            let rank = (sorted.len() * percent).div_ceil(100);
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let [p25, p50, p75, p95, max] = [25, 50, 75, 95, 100].map(quantile);
        Self { count: sorted.len(), p25, p50, p75, p95, max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let samples: Vec<f64> = (1..=200).rev().map(f64::from).collect();
        let expected =
            Spread { count: 200, p25: 50.0, p50: 100.0, p75: 150.0, p95: 190.0, max: 200.0 };
        assert_eq!(Spread::from_samples(&samples), expected);
        assert_eq!(Spread::from_samples(&[]), Spread::default());
        let one = Spread::from_samples(&[7.0]);
        assert_eq!((one.p25, one.p50, one.max), (7.0, 7.0, 7.0));
    }
}
