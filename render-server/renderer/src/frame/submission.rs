//! Work that the GPU was given.

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use crate::DrawError;
use crate::gpu::Gpu;

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
        gpu.wait(Some(self.index())).map_err(|fault| DrawError::Gpu(fault.reason))?;
        Ok(self.done.get().copied().unwrap_or_else(Instant::now))
    }
}
