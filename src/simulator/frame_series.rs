//! The times of the frames of a run, in a bounded number of samples.

use polyptych_client::FrameFeedback;

/// Maximum number of samples: beyond it, two neighbours become one. 1,024 channels have 4 MiB.
const SAMPLES_MAX: usize = 1024;

/// The frames of a run, one or more in each sample.
#[derive(Debug, Default)]
pub(crate) struct FrameSeries {
    /// The names of the channels, in the order of `draw_ms`.
    pub names: Vec<String>,
    pub samples: Vec<FrameSample>,
    /// The number of frames in each sample but the last one.
    stride: u32,
}

/// One frame, or the worst of several that follow each other.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameSample {
    /// The time from the beginning of the run to the answer of the first frame, in seconds.
    pub at_s: f64,
    /// The time from frame command to swap command, in ms.
    pub frame_ms: f64,
    /// The part of `frame_ms` in which the slowest channel did not draw.
    pub barrier_ms: f64,
    /// The error bound in force, in pixels of the wall.
    pub error_in_force_px: f64,
    /// The pixels that were drawn along each side, as a share of the wall's.
    pub resolution_scale: f64,
    /// Drawing time of each channel in ms; NaN where it did not show a frame.
    pub draw_ms: Vec<f32>,
    frames: u32,
}

impl FrameSeries {
    /// Adds a frame that was answered so long after the beginning of the run.
    pub fn note(&mut self, at_s: f64, frame: &FrameFeedback) {
        if self.names.is_empty() {
            self.names = frame.channels.iter().map(|channel| channel.name.clone()).collect();
            self.stride = 1;
        }
        let draw_ms = frame.channels.iter().map(|channel| {
            let draw_us = channel.draw_us.filter(|_| channel.has_shown());
            draw_us.map_or(f32::NAN, |us| us as f32 / 1000.0)
        });
        let sample = FrameSample {
            at_s,
            frame_ms: frame.frame_us as f64 / 1000.0,
            barrier_ms: frame.barrier_us as f64 / 1000.0,
            error_in_force_px: frame.detail.error_in_force_px,
            resolution_scale: frame.detail.resolution_scale,
            draw_ms: draw_ms.collect(),
            frames: 1,
        };
        self.push(sample);
    }

    fn push(&mut self, sample: FrameSample) {
        if let Some(last) = self.samples.last_mut().filter(|last| last.frames < self.stride) {
            last.merge(&sample);
            return;
        }
        if self.samples.len() >= SAMPLES_MAX {
            self.stride *= 2;
            let merged = self.samples.chunks(2).map(|pair| {
                let mut first = pair[0].clone();
                pair[1..].iter().for_each(|second| first.merge(second));
                first
            });
            self.samples = merged.collect();
        }
        self.samples.push(sample);
    }
}

impl FrameSample {
    /// Takes the worse of each number of another one; a frame that is missing in one stays missing.
    fn merge(&mut self, other: &Self) {
        self.frame_ms = self.frame_ms.max(other.frame_ms);
        self.barrier_ms = self.barrier_ms.max(other.barrier_ms);
        self.error_in_force_px = self.error_in_force_px.max(other.error_in_force_px);
        self.resolution_scale = self.resolution_scale.min(other.resolution_scale);
        for (own, other) in self.draw_ms.iter_mut().zip(&other.draw_ms) {
            *own = if own.is_nan() || other.is_nan() { f32::NAN } else { own.max(*other) };
        }
        self.frames += other.frames;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(number: u32) -> FrameSample {
        let is_missing = number == 4321;
        FrameSample {
            at_s: f64::from(number),
            frame_ms: if number == 777 { 99.0 } else { 5.0 },
            barrier_ms: 1.0,
            error_in_force_px: 0.0,
            resolution_scale: 1.0,
            draw_ms: vec![if is_missing { f32::NAN } else { 4.0 }],
            frames: 1,
        }
    }

    #[test]
    fn a_long_run_is_bounded_and_loses_neither_a_slow_nor_a_missing_frame() {
        let mut series = FrameSeries { stride: 1, ..FrameSeries::default() };
        (0..10_000).for_each(|number| series.push(sample(number)));
        assert!(series.samples.len() <= SAMPLES_MAX, "{}", series.samples.len());
        assert_eq!(series.samples.iter().map(|sample| sample.frames).sum::<u32>(), 10_000);
        let slow: Vec<_> = series.samples.iter().filter(|s| s.frame_ms > 50.0).collect();
        assert_eq!(slow.len(), 1);
        assert!((700.0..=777.0).contains(&slow[0].at_s), "{}", slow[0].at_s);
        assert_eq!(series.samples.iter().filter(|s| s.draw_ms[0].is_nan()).count(), 1);
        assert!(series.samples.windows(2).all(|pair| pair[0].at_s < pair[1].at_s));
    }
}
