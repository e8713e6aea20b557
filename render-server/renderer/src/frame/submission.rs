//! Work that the GPU was given.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use crate::DrawError;
use crate::gpu::{Gpu, GpuFaultKind};

/// A frame that takes longer is taken for a GPU that hangs.
const GPU_WAIT_MAX: Duration = Duration::from_secs(30);

/// Work that the GPU was given, and that is to be waited for.
///
/// The end of each submission tells how long the work between two ends took; timestamps would say
/// the same of a GPU that does one after the other, and software drivers without any have it, too.
#[derive(Debug)]
pub struct Submission {
    index: wgpu::SubmissionIndex,
    at: Instant,
    /// Set by the first call into the device after the work was done.
    done: Arc<OnceLock<Instant>>,
}

impl Submission {
    /// Gives the GPU what was encoded.
    pub(crate) fn new(gpu: &Gpu, encoder: wgpu::CommandEncoder) -> Self {
        let index = gpu.queue.submit([encoder.finish()]);
        let done = Arc::new(OnceLock::new());
        let noticed = Arc::clone(&done);
        gpu.queue.on_submitted_work_done(move || {
            // It is called once.
            let _ = noticed.set(Instant::now());
        });
        Self { index, at: Instant::now(), done }
    }

    /// Returns when the work was submitted.
    pub(crate) fn at(&self) -> Instant {
        self.at
    }

    /// Returns what the device knows the work by.
    pub(crate) fn index(&self) -> wgpu::SubmissionIndex {
        self.index.clone()
    }

    /// Waits until the work is done, not for what was submitted after it. Returns when it was
    /// done, as far as was noticed.
    ///
    /// # Errors
    /// The device is lost, hangs, or is out of memory.
    pub(crate) fn wait(&self, gpu: &Gpu) -> Result<Instant, DrawError> {
        // A device that hangs is waited for once, and not again for each target.
        if let Some(fault) = gpu.take_error() {
            return Err(DrawError::Gpu(fault));
        }
        let waited = gpu.device.poll(wgpu::PollType::Wait {
            submission_index: Some(self.index()),
            timeout: Some(GPU_WAIT_MAX),
        });
        if matches!(waited, Err(wgpu::PollError::Timeout)) {
            // One that is only busy ends within this time, and its channel is late.
            let seconds = GPU_WAIT_MAX.as_secs();
            let reason = format!("the GPU or its driver hangs: no frame within {seconds} s");
            gpu.give_up(GpuFaultKind::Hangs, &reason);
        }
        match (gpu.take_error(), waited) {
            (Some(fault), _) => Err(DrawError::Gpu(fault)),
            (None, Err(error)) => Err(DrawError::Gpu(error.to_string())),
            (None, Ok(_)) => Ok(self.done.get().copied().unwrap_or_else(Instant::now)),
        }
    }
}
