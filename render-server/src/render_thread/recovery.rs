//! Recovery from the loss of the GPU: another device is opened, and all that was on the lost one is
//! made anew. The process, its connection and its windows stay.
//!
//! The manager is told, and sends the shown state, which the loader prepares from the blobs on this
//! machine; the other channels of the wall go on.

use std::time::{Duration, Instant};

use polyptych_protocol::server_message::ServerMessage;
use polyptych_renderer::{Gpu, GpuFault, GpuFaultKind, GpuScene};

use super::preparation::Preparation;
use super::{ReadyState, RenderTask, RenderThread};
use crate::render_event::RenderEvent;

/// Maximum time for which a driver may refuse to open its adapter again, while it is reset.
const REOPEN_TIME_MAX: Duration = Duration::from_secs(20);

/// Pause between two tries to open it.
const REOPEN_PAUSE: Duration = Duration::from_millis(100);

/// Maximum number of losses within [`LOSSES_PERIOD`]: a device that is lost more often needs a new
/// process, or a person.
const LOSSES_MAX: u32 = 8;
const LOSSES_PERIOD: Duration = Duration::from_mins(1);

/// Maximum number of devices that hung in the life of a process: nothing of them can be given back.
const HANGS_MAX: u32 = 3;

/// Maximum number of levels of textures that are left out for want of memory: a sixteenth of each
/// side is left then, and 1/256 of the memory.
const LEVELS_LEFT_OUT_MAX: u32 = 4;

/// What an operator can do about too little memory.
const MEMORY_REMEDY: &str = "open a smaller scene, set budget.gpu_mib in the wall file, or use a \
                             GPU with more memory";

/// The losses so far.
#[derive(Debug, Default)]
pub(super) struct Losses {
    /// Largest levels of textures that are left out, since the GPU ran out of memory.
    pub levels_left_out: u32,
    /// Size of the last scene that shared nothing with the one before, with all levels, in bytes.
    scene_bytes: u64,
    /// The size of the scene for which levels were left out last.
    bytes_too_large: u64,
    count: u32,
    since: Option<Instant>,
    hangs: u32,
}

impl Losses {
    /// Counts a loss. `holds_two` tells whether the GPU held a scene beside the one to come.
    ///
    /// # Errors
    /// It was one too many.
    fn add(&mut self, fault: &GpuFault, holds_two: bool, now: Instant) -> Result<(), String> {
        if self.since.is_none_or(|since| now.duration_since(since) > LOSSES_PERIOD) {
            self.since = Some(now);
            self.count = 0;
        }
        self.count += 1;
        let GpuFault { kind, reason } = fault;
        match kind {
            GpuFaultKind::Lost => {}
            GpuFaultKind::Hangs => self.hangs += 1,
            // The one to come may fit without the other one, which is tried once.
            GpuFaultKind::OutOfMemory if holds_two && self.count == 1 => {}
            GpuFaultKind::OutOfMemory if self.levels_left_out == LEVELS_LEFT_OUT_MAX => {
                return Err(format!(
                    "{reason}; textures can't be made smaller than they are; {MEMORY_REMEDY}"
                ));
            }
            GpuFaultKind::OutOfMemory => {
                self.levels_left_out += 1;
                self.bytes_too_large = self.scene_bytes;
            }
        }
        if self.hangs > HANGS_MAX {
            return Err(format!("{reason}; it hung {HANGS_MAX} times before"));
        }
        if self.count > LOSSES_MAX {
            let seconds = LOSSES_PERIOD.as_secs();
            return Err(format!("{reason}; it was lost {LOSSES_MAX} times within {seconds} s"));
        }
        Ok(())
    }

    /// Notes the size in bytes of a scene that begins and shares nothing with the one before. All
    /// levels of its textures are kept if it is clearly smaller than the one that was too large.
    ///
    /// Returns whether levels were left out until now, and are not any more.
    pub fn begin_scene(&mut self, bytes: u64) -> bool {
        self.scene_bytes = bytes;
        // It was too large without all of these levels but one; each leaves out half or more.
        let too_large = self.bytes_too_large >> self.levels_left_out.saturating_sub(1);
        if self.levels_left_out == 0 || bytes >= too_large / 4 * 3 {
            return false;
        }
        self.levels_left_out = 0;
        true
    }

    /// Returns what the operator should know of the GPU's memory, if anything.
    pub fn warning(&self) -> Option<String> {
        let side = 1 << self.levels_left_out;
        (side > 1).then(|| {
            format!(
                "the GPU's memory is too small for the scene: textures are shown with 1/{side} of \
                 their width and height; {MEMORY_REMEDY}"
            )
        })
    }
}

impl RenderThread {
    /// Opens the GPU again after a fault, and tells the manager that nothing is left of its state.
    ///
    /// # Errors
    /// The GPU was lost too often, or can't be opened.
    pub(super) fn recover(&mut self, fault: &GpuFault) -> Result<(), String> {
        let begun = Instant::now();
        let reason = fault.reason.as_str();
        tracing::error!(reason, "the GPU was lost and is opened again");
        self.losses.add(fault, self.holds_two_scenes(), begun)?;
        self.is_completing = false;
        if fault.kind == GpuFaultKind::Hangs {
            // To drop what is on a device waits for the device.
            std::mem::forget(std::mem::take(&mut self.states));
            std::mem::forget((self.building.take(), self.moment.take()));
            std::mem::forget(self.preparation.take().map(Preparation::into_gpu_parts));
            std::mem::forget((std::mem::take(&mut self.patterns), self.delayed_metering.take()));
        }
        self.states.clear();
        (self.building, self.relayout, self.moment) = (None, None, None);
        (self.preparation, self.delayed_metering) = (None, None);
        self.patterns.clear();
        let Some(gpu) = self.reopen(begun)? else { return Ok(()) };
        let renderer = self.drawing.renderer(&gpu, self.renderer.samples())?;
        let old = std::mem::replace(&mut self.renderer, renderer);
        let old = (old, std::mem::replace(&mut self.gpu, gpu));
        if fault.kind == GpuFaultKind::Hangs {
            std::mem::forget(old);
        }
        for output in &mut self.outputs {
            output.reopen(&self.gpu, fault.kind == GpuFaultKind::Hangs)?;
        }
        let ms = begun.elapsed().as_millis() as u64;
        tracing::info!(ms, "the GPU is open again");
        let reason = format!("its GPU was lost: {reason}");
        self.send(RenderEvent::Status(ServerMessage::StateLost { reason }));
        self.check_displays();
        // Without a manager no frame follows; what was told meanwhile must be seen.
        for index in 0..self.outputs.len() {
            self.show_again(index);
        }
        Ok(())
    }

    /// Returns whether a scene is on the GPU beside one that is made ready to take its place, or
    /// waits for other servers to do so.
    fn holds_two_scenes(&self) -> bool {
        let mut held: Vec<&GpuScene> = Vec::new();
        for ReadyState { scene, .. } in &self.states {
            if scene.content_bytes() > 0 && !held.iter().any(|of| of.has_content_of(scene)) {
                held.push(scene);
            }
        }
        let is_made_ready = self.building.is_some() || self.preparation.is_some();
        held.len() + usize::from(is_made_ready || self.is_completing) > 1
    }

    /// Opens the adapter again as soon as its driver lets it. `None` if this server is to end.
    fn reopen(&mut self, begun: Instant) -> Result<Option<Gpu>, String> {
        loop {
            match self.gpu.reopened() {
                Ok(gpu) => return Ok(Some(gpu)),
                Err(error) if begun.elapsed() > REOPEN_TIME_MAX => return Err(error.to_string()),
                Err(error) => tracing::debug!(%error, "the GPU can't be opened yet"),
            }
            // The queue must not fill up meanwhile; frames can't be drawn.
            while let Ok(job) = self.queues.jobs.try_recv() {
                match job {
                    RenderTask::ShowLife(notifier) => notifier.alive(),
                    RenderTask::Stop => self.is_stopping = true,
                    RenderTask::Notice(notice) => self.showing.set_connection_status(notice),
                    RenderTask::Connected => self.reset_reported(),
                    RenderTask::Disconnected => {
                        self.playback.reset();
                        self.reset_reported();
                    }
                    RenderTask::MonitorAssigned { channel, assignment } => {
                        if let Some(index) = self.index_of(&channel) {
                            self.outputs[index].set_assignment(assignment);
                        }
                    }
                    // Windows are set up with the size that they have then.
                    RenderTask::Frame(_)
                    | RenderTask::Swap(_)
                    | RenderTask::Resized { .. }
                    | RenderTask::Redraw { .. } => {}
                }
            }
            if self.is_stopping {
                return Ok(None);
            }
            std::thread::sleep(REOPEN_PAUSE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(kind: GpuFaultKind) -> GpuFault {
        GpuFault { kind, reason: "device lost".to_owned() }
    }

    #[test]
    fn a_gpu_that_is_lost_too_often_ends_the_process_with_the_reason() {
        let (mut losses, now) = (Losses::default(), Instant::now());
        for _ in 0..LOSSES_MAX {
            losses.add(&fault(GpuFaultKind::Lost), false, now).expect("borne");
        }
        let later = now + LOSSES_PERIOD + Duration::from_secs(1);
        let error = losses.add(&fault(GpuFaultKind::Lost), false, now).expect_err("too often");
        assert_eq!(error, "device lost; it was lost 8 times within 60 s");
        losses.add(&fault(GpuFaultKind::Lost), false, later).expect("it was long ago");
        assert_eq!(losses.warning(), None);
    }

    #[test]
    fn too_little_memory_halves_textures_until_there_is_nothing_to_halve() {
        let (mut losses, mut now) = (Losses::default(), Instant::now());
        let full = fault(GpuFaultKind::OutOfMemory);
        for side in [2, 4, 8, 16] {
            losses.add(&full, false, now).expect("less is kept");
            let warning = losses.warning().expect("the operator is told");
            assert!(warning.contains(&format!("1/{side} of")), "{warning}");
            now += LOSSES_PERIOD;
        }
        let error = losses.add(&full, false, now).expect_err("no more");
        assert!(error.contains("smaller") && error.contains("budget.gpu_mib"), "{error}");
    }

    #[test]
    fn a_clearly_smaller_scene_has_all_levels_of_its_textures_again() {
        let (mut losses, now) = (Losses::default(), Instant::now());
        let full = fault(GpuFaultKind::OutOfMemory);
        assert!(!losses.begin_scene(1000));
        losses.add(&full, false, now).expect("less is kept");
        // The same again, one that is hardly smaller, and one that is clearly smaller.
        assert!(!losses.begin_scene(1000) && !losses.begin_scene(800));
        assert!(losses.begin_scene(700) && losses.warning().is_none());
        // What was too large with a level less asks for an even smaller one.
        for _ in 0..2 {
            losses.add(&full, false, now).expect("less is kept");
        }
        assert!(!losses.begin_scene(300) && losses.levels_left_out == 2);
        assert!(losses.begin_scene(250) && losses.levels_left_out == 0);
    }

    #[test]
    fn a_scene_that_was_too_large_beside_another_one_is_tried_alone_once() {
        let (mut losses, now) = (Losses::default(), Instant::now());
        for levels in [0, 1] {
            losses.add(&fault(GpuFaultKind::OutOfMemory), true, now).expect("borne");
            assert_eq!(losses.levels_left_out, levels);
        }
    }
}
