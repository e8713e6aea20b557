//! The time that the GPU takes for each pass of a frame, by timestamps where the adapter has them.
//!
//! One round of frames in [`ROUNDS`] is measured: timestamps split the work of some drivers. A
//! round is what a server draws for one frame of the wall: a frame for each channel and overlay.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use polyptych_scene::{FramePass, PassTimes};

use super::submission::Submission;
use crate::gpu::Gpu;

/// One round of so many is measured; the first one is not, since it draws what others keep.
const ROUNDS: u64 = 8;

/// Timestamps of a frame; what comes after them is not measured.
const TIMESTAMPS_MAX: u32 = 256;

/// The queries and buffers of one frame.
#[derive(Debug)]
struct Measurement {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    /// The pass between each two timestamps.
    passes: Mutex<Vec<FramePass>>,
    /// The times of the last frame can be read.
    is_there: Arc<AtomicBool>,
}

/// Measures the passes of one frame; most frames are not measured.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameTimer(Option<Arc<Measurement>>);

/// The measurements of all frames.
#[derive(Debug, Default)]
pub(super) struct PassTimer {
    idle: Vec<Arc<Measurement>>,
    rounds: u64,
    /// A frame was begun since the last one was finished. All of a round are measured: of a server
    /// with two channels, one would else be measured always and the other one never.
    is_round_open: bool,
}

impl Measurement {
    fn new(gpu: &Gpu) -> Self {
        let size = u64::from(TIMESTAMPS_MAX) * u64::from(wgpu::QUERY_SIZE);
        let buffer = |label, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let (write, copy) = (wgpu::BufferUsages::COPY_DST, wgpu::BufferUsages::COPY_SRC);
        Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes/timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: TIMESTAMPS_MAX,
            }),
            resolved: buffer("passes/resolved", wgpu::BufferUsages::QUERY_RESOLVE | copy),
            read: buffer("passes/read", wgpu::BufferUsages::MAP_READ | write),
            passes: Mutex::default(),
            is_there: Arc::default(),
        }
    }

    fn passes(&self) -> std::sync::MutexGuard<'_, Vec<FramePass>> {
        self.passes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FrameTimer {
    /// Begins a pass, which [`Self::end`] ends before the next one begins.
    pub fn begin(&self, encoder: &mut wgpu::CommandEncoder) {
        let Some(of) = &self.0 else { return };
        let first = of.passes().len() as u32 * 2;
        if first < TIMESTAMPS_MAX {
            encoder.write_timestamp(&of.queries, first);
        }
    }

    /// Ends what was begun.
    pub fn end(&self, encoder: &mut wgpu::CommandEncoder, pass: FramePass) {
        let Some(of) = &self.0 else { return };
        let mut passes = of.passes();
        let last = passes.len() as u32 * 2 + 1;
        if last < TIMESTAMPS_MAX {
            encoder.write_timestamp(&of.queries, last);
            passes.push(pass);
        }
    }

    /// Submits that the times are read, after all passes. Returns that work, which is waited for
    /// before [`PassTimer::finish`]; `None` for a frame that is not measured.
    pub fn submit(&self, gpu: &Gpu) -> Option<Submission> {
        let of = self.0.as_ref()?;
        let count = of.passes().len() as u32 * 2;
        if count == 0 {
            return None;
        }
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("passes") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        encoder.resolve_query_set(&of.queries, 0..count, &of.resolved, 0);
        let size = u64::from(count) * u64::from(wgpu::QUERY_SIZE);
        encoder.copy_buffer_to_buffer(&of.resolved, 0, &of.read, 0, size);
        let submission = Submission::new(gpu, encoder);
        let is_there = Arc::clone(&of.is_there);
        of.read.slice(..size).map_async(wgpu::MapMode::Read, move |mapped| {
            is_there.store(mapped.is_ok(), Ordering::SeqCst);
        });
        Some(submission)
    }
}

impl PassTimer {
    /// Begins a frame.
    pub fn begin(&mut self, gpu: &Gpu) -> FrameTimer {
        if !self.is_round_open {
            (self.rounds, self.is_round_open) = (self.rounds + 1, true);
        }
        if self.rounds % ROUNDS != 2 || !gpu.has_timestamps() {
            return FrameTimer::default();
        }
        let of = self.idle.pop().unwrap_or_else(|| Arc::new(Measurement::new(gpu)));
        of.passes().clear();
        FrameTimer(Some(of))
    }

    /// Returns the times of a frame that was waited for.
    pub fn finish(&mut self, gpu: &Gpu, timer: FrameTimer) -> PassTimes {
        self.is_round_open = false;
        let mut times = PassTimes::default();
        let Some(of) = timer.0 else { return times };
        if !of.is_there.swap(false, Ordering::SeqCst) {
            return times;
        }
        let passes = std::mem::take(&mut *of.passes());
        let size = passes.len() as u64 * 2 * u64::from(wgpu::QUERY_SIZE);
        let stamps: Vec<u64> = match of.read.slice(..size).get_mapped_range() {
            Ok(bytes) => bytes.as_chunks().0.iter().copied().map(u64::from_le_bytes).collect(),
            Err(_) => return times,
        };
        of.read.unmap();
        let nanoseconds = f64::from(gpu.queue.get_timestamp_period());
        for (pass, [begin, end]) in passes.iter().zip(stamps.as_chunks().0) {
            let us = end.saturating_sub(*begin) as f64 * nanoseconds / 1000.0;
            // One that took less was there, too.
            times.add(*pass, (us as u64).max(1));
        }
        self.idle.push(of);
        times
    }
}
