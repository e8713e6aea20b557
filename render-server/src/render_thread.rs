//! The thread that owns the GPU. It empties its queues between frames and never waits for a socket.

mod arrangement;
mod displays;
mod drawing;
mod images;
mod metering;
mod moment;
mod patterns;
mod preparation;
mod recovery;

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, select};
use metering::DelayedMetering;
use moment::DrawnMoment;
use patterns::PatternImage;
use polyptych_protocol::command::{Frame, Swap};
use polyptych_protocol::ids::{Epoch, Revision};
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_renderer::{
    Gpu, GpuScene, MovedItems, OcclusionCulling, Renderer, SceneBuilder, SceneLayout,
};
use polyptych_wall::Wall;
use preparation::Preparation;
use recovery::Losses;
use tokio::sync::mpsc;
use winit::dpi::PhysicalSize;

use crate::channel_output::ChannelOutput;
use crate::clock::Clock;
use crate::connection_status::{ConnectionStatus, ServerInfo};
use crate::correction::Corrector;
use crate::draw_delay::DrawDelay;
use crate::frame_scheduler::{FrameAction, FrameScheduler};
use crate::loader::{LoadedState, Upload};
use crate::mismatch::MonitorAssignment;
use crate::presentation_state::PresentationState;
use crate::render_event::RenderEvent;

/// States that are held at once: the one shown, and those that the next frames may name.
const STATES_MAX: usize = 4;

/// Uploads take one part in so many of the time of frames that follow each other without a pause,
/// and one upload at least behind each frame.
const UPLOAD_SHARE: u32 = 8;

/// Maximum time of uploads behind a frame, but for the last one of them.
const UPLOAD_TIME_MAX: Duration = Duration::from_millis(20);

/// Maximum time for which a frame's end waits for the next upload.
const UPLOAD_WAIT_MAX: Duration = Duration::from_micros(500);

/// Jobs that wait for the render thread: a wall that stood still for two seconds at 60 frames
/// per second left 240.
pub(crate) const JOBS_MAX: usize = 512;

/// Side of the target that a new scene is drawn into once before anyone sees it, in pixels.
const WARM_UP_SIDE: u32 = 64;

/// A task that other threads give to the render thread.
#[derive(Debug)]
pub enum RenderTask {
    /// Draw this, unless a newer one comes.
    Frame(Box<Frame>),
    /// Show what was drawn.
    Swap(Swap),
    /// The words for displays that have no picture to show, or an old one.
    Notice(ConnectionStatus),
    /// A connection begins: nothing that was reported until now reaches its manager.
    Connected,
    /// The connection ended: what waits belongs to it.
    Disconnected,
    /// A window has another size.
    Resized {
        /// Its channel.
        channel: String,
        /// In pixels.
        size: PhysicalSize<u32>,
    },
    /// In full screen: the monitor that a channel's window fills is this one now.
    MonitorAssigned {
        /// The channel.
        channel: String,
        /// With its place and size.
        assignment: MonitorAssignment,
    },
    /// A window was uncovered.
    Redraw {
        /// Its channel.
        channel: String,
    },
    /// Tell the supervisor that this thread works, and so does the one that asks.
    ShowLife(Arc<ServiceNotifier>),
    /// End.
    Stop,
}

/// The queues of the render thread.
pub(crate) struct Queues {
    pub jobs: Receiver<RenderTask>,
    pub uploads: Receiver<Upload>,
    pub reports: mpsc::Sender<RenderEvent>,
    /// Takes what a wall file says of the monitors of this server's channels; `None` where there
    /// are no windows.
    pub monitor_names: Option<SendMonitorNames>,
}

/// The way in which a server draws and shows.
pub(crate) struct DrawOptions {
    pub present_delay: Duration,
    pub slowness: DrawDelay,
    /// See [`crate::ServerOptions::culls_occluded`].
    pub culls_occluded: bool,
}

impl DrawOptions {
    fn renderer(&self, gpu: &Gpu, samples: u32) -> Result<Renderer, String> {
        let mut renderer = Renderer::new(gpu, samples).map_err(|error| error.to_string())?;
        if !self.culls_occluded {
            renderer.set_occlusion(OcclusionCulling::Never);
        }
        Ok(renderer)
    }
}

/// Sends the window system's thread the names of monitors, by channel.
pub(crate) type SendMonitorNames = Box<dyn Fn(BTreeMap<String, String>) + Send>;

/// A state whose scene is on the GPU.
struct ReadyState {
    state: Arc<LoadedState>,
    scene: Rc<GpuScene>,
    correctors: Correctors,
}

/// By channel, those of a wall; shared by states of one wall.
type Correctors = Rc<RefCell<BTreeMap<String, Corrector>>>;

/// The state of the render thread.
pub(crate) struct RenderThread {
    gpu: Gpu,
    renderer: Renderer,
    outputs: Vec<ChannelOutput>,
    queues: Queues,
    clock: Arc<Clock>,
    drawing: DrawOptions,
    playback: FrameScheduler,
    /// Oldest first; the last one was finished last.
    states: VecDeque<ReadyState>,
    /// The end of the last uploads behind a frame.
    uploads_ended: Instant,
    /// The scene as clips moved it in the last frame, if they did.
    moment: Option<DrawnMoment>,
    /// The beginning of the last frame, before its scene was moved.
    frame_began: Instant,
    /// The time that moving a scene seems to take, though none passes.
    #[cfg(test)]
    moving_takes: Duration,
    building: Option<SceneBuilder>,
    /// The reason why the scene that comes cannot be built.
    build_fault: Option<String>,
    /// The layout of the latest scene in the state that is finished next.
    relayout: Option<(Arc<SceneLayout>, Option<Arc<MovedItems>>)>,
    /// The state that is made drawable, if one is.
    preparation: Option<Preparation>,
    /// The last step to make a state drawable is being done, or was when the GPU had a fault, and
    /// its scene is none of those of `states`.
    is_completing: bool,
    showing: PresentationState,
    /// The last frame that was drawn and is to be metered, until it is shown; ordinary ones may
    /// have been drawn since.
    to_meter: Option<Box<Frame>>,
    /// One that was shown and waits for its pipelines.
    delayed_metering: Option<DelayedMetering>,
    /// Frames have automatic exposure.
    is_metering: bool,
    /// The test patterns of channels, by their names, while there are any.
    patterns: BTreeMap<String, PatternImage>,
    identity: ServerInfo,
    /// The names of monitors that the window system's thread was told last.
    names_sent: Option<BTreeMap<String, String>>,
    losses: Losses,
    is_stopping: bool,
}

impl RenderThread {
    pub fn new(
        gpu: Gpu,
        outputs: Vec<ChannelOutput>,
        queues: Queues,
        clock: Arc<Clock>,
        identity: ServerInfo,
        drawing: DrawOptions,
    ) -> Result<Self, String> {
        let renderer = drawing.renderer(&gpu, 1)?;
        Ok(Self {
            gpu,
            renderer,
            outputs,
            queues,
            clock,
            drawing,
            playback: FrameScheduler::default(),
            states: VecDeque::new(),
            uploads_ended: Instant::now(),
            moment: None,
            frame_began: Instant::now(),
            #[cfg(test)]
            moving_takes: Duration::ZERO,
            building: None,
            build_fault: None,
            relayout: None,
            preparation: None,
            is_completing: false,
            showing: PresentationState::default(),
            to_meter: None,
            delayed_metering: None,
            is_metering: false,
            patterns: BTreeMap::new(),
            identity,
            names_sent: None,
            losses: Losses::default(),
            is_stopping: false,
        })
    }

    /// Runs until it is told to stop.
    ///
    /// # Errors
    /// The GPU failed in a way that only a new process mends.
    pub fn run(mut self) -> Result<(), String> {
        while !self.is_stopping {
            // Everything that waits is taken before anything is done.
            while let Ok(job) = self.queues.jobs.try_recv() {
                self.handle(job);
            }
            match self.playback.poll(self.manager_us()) {
                Some(act) => self.perform(act),
                None if self.continues_preparation() => self.continue_preparation(),
                None => self.wait(),
            }
            // What is shown again on a device may find that it is lost, too.
            while !self.is_stopping
                && let Some(fault) = self.gpu.first_fault()
            {
                self.recover(&fault)?;
            }
        }
        Ok(())
    }

    fn manager_us(&self) -> Option<u64> {
        (self.clock.error_us() != u32::MAX).then(|| self.clock.manager_us())
    }

    /// Returns whether this instant of manager time is ahead, as far as it is known.
    fn is_before(&self, at_us: u64) -> bool {
        self.manager_us().is_some_and(|now| now < at_us)
    }

    /// Time until a drawn frame is to be shown at a stated instant.
    fn show_wait(&self) -> Duration {
        let due = self.playback.next_show_us().zip(self.manager_us());
        due.map_or(Duration::MAX, |(due, now)| Duration::from_micros(due.saturating_sub(now)))
    }

    fn wait(&mut self) {
        select! {
            recv(self.queues.jobs) -> job => match job {
                Ok(job) => self.handle(job),
                Err(_) => self.is_stopping = true,
            },
            recv(self.queues.uploads) -> upload => match upload {
                Ok(upload) => self.upload(upload),
                Err(_) => self.is_stopping = true,
            },
            recv(self.pipelines_made()) -> pipelines => self.take_pipelines(pipelines.ok()),
            recv(self.metering_pipelines()) -> pipelines => {
                self.take_metering_pipelines(pipelines.ok());
            }
            default(self.note_wait().min(self.show_wait())) => self.end_notes(),
        }
    }

    fn handle(&mut self, job: RenderTask) {
        match job {
            RenderTask::Frame(frame) => self.playback.handle_frame(frame),
            RenderTask::Swap(swap) => {
                if let Some(act) = self.playback.handle_swap(swap, self.manager_us()) {
                    self.perform(act);
                }
            }
            RenderTask::Notice(notice) => {
                self.showing.set_connection_status(notice);
                self.show_news();
            }
            RenderTask::Connected => self.reset_reported(),
            RenderTask::Disconnected => {
                self.playback.reset();
                self.reset_reported();
            }
            RenderTask::Resized { channel, size } => {
                if let Some(index) = self.index_of(&channel) {
                    self.outputs[index].resize(&self.gpu, size);
                    self.check_displays();
                    self.show_again(index);
                }
            }
            RenderTask::MonitorAssigned { channel, assignment } => {
                if let Some(index) = self.index_of(&channel) {
                    self.outputs[index].set_assignment(assignment);
                    self.check_displays();
                    self.show_again(index);
                }
            }
            RenderTask::Redraw { channel } => {
                if let Some(index) = self.index_of(&channel) {
                    self.show_again(index);
                }
            }
            RenderTask::ShowLife(notifier) => notifier.alive(),
            RenderTask::Stop => self.is_stopping = true,
        }
    }

    fn index_of(&self, name: &str) -> Option<usize> {
        self.outputs.iter().position(|output| output.name == name)
    }

    fn perform(&mut self, act: FrameAction) {
        match act {
            FrameAction::Draw { frame, keep } => {
                if let Some(key) = keep {
                    self.outputs.iter_mut().for_each(|output| output.keep_aside(&self.gpu, key));
                }
                self.is_metering = frame.presentation.is_exposure_automatic;
                self.draw(&frame);
                self.upload_behind_frame();
            }
            FrameAction::Show { epoch, frame, display, at_us, is_unscheduled } => {
                let _span = tracing::error_span!("show", frame = frame.0).entered();
                while at_us.is_some_and(|at_us| self.is_before(at_us)) {
                    std::hint::spin_loop();
                }
                self.show((epoch, frame), display, is_unscheduled);
                self.meter((epoch, frame));
            }
        }
    }

    /// Makes the state of this revision the one that is drawn, and forgets older ones.
    fn promote(&mut self, epoch: Epoch, revision: Revision) -> bool {
        let is_it = |d: &ReadyState| d.state.epoch == epoch && d.state.replica.revision == revision;
        // The newest: one that was resynchronised holds a wrong state of the same number before it.
        let Some(index) = self.states.iter().rposition(is_it) else { return false };
        self.states.drain(..index);
        true
    }

    /// Makes the renderer that of a wall: other samples, and other shadows, need other pipelines.
    fn use_wall(&mut self, wall: &Wall) -> Result<(), String> {
        let samples = wall.samples;
        if self.renderer.samples() != samples {
            self.renderer = self.drawing.renderer(&self.gpu, samples)?;
            // Its pipelines are those of the renderer before.
            self.delayed_metering = None;
            let states: Vec<_> =
                self.states.iter().map(|d| (Arc::clone(&d.state), Rc::clone(&d.scene))).collect();
            for (state, scene) in states {
                self.prepare(&state, &scene);
            }
        }
        self.renderer.set_shadows(wall.shadows);
        Ok(())
    }

    /// Takes uploads for a share of the time since it last did: where the next frame is here
    /// already, there is no other time for them.
    fn upload_behind_frame(&mut self) {
        let begun = Instant::now();
        let room = begun.duration_since(self.uploads_ended) / UPLOAD_SHARE;
        let end = begun + room.min(UPLOAD_TIME_MAX);
        loop {
            if self.continues_preparation() {
                self.continue_preparation();
                if Instant::now() >= end {
                    break;
                }
                continue;
            }
            // The next one is being read, unless it comes over a network.
            let wait = if self.building.is_some() { UPLOAD_WAIT_MAX } else { Duration::ZERO };
            let patience = end.saturating_duration_since(Instant::now()).min(wait);
            let Ok(upload) = self.queues.uploads.recv_timeout(patience) else { break };
            self.upload(upload);
            if Instant::now() >= end {
                break;
            }
        }
        self.uploads_ended = Instant::now();
    }

    fn upload(&mut self, upload: Upload) {
        let uploaded = match upload {
            Upload::Begin { layout, shares, is_part, shown } => {
                self.build_fault = None;
                if !shares && self.losses.begin_scene(layout.content_bytes()) {
                    self.check_displays();
                }
                let latest = self.states.back().filter(|_| shares);
                let begun = SceneBuilder::of(&self.gpu, layout)
                    .map(|builder| builder.without_levels(self.losses.levels_left_out))
                    .map(|builder| if is_part { builder.in_separate_buffers() } else { builder })
                    .map(|builder| match latest {
                        Some(latest) => builder.sharing(&latest.scene),
                        None => builder,
                    })
                    .map(|builder| self.building = Some(builder))
                    .map_err(|error| error.to_string());
                let is_named = |of: &LoadedState| shown.allows(of.epoch, of.replica.revision);
                self.states.retain(|of| is_named(&of.state));
                begun
            }
            Upload::Relayout { layout, moved } => {
                self.relayout = Some((layout, moved));
                Ok(())
            }
            Upload::Texture { index, bytes } => {
                self.build(|gpu, builder| builder.upload_texture(gpu, index, &bytes))
            }
            Upload::Primitive { mesh, primitive, bytes } => {
                self.build(|gpu, builder| builder.upload_primitive(gpu, mesh, primitive, &bytes))
            }
            Upload::Deformer { mesh, primitive, bytes } => {
                self.build(|_, builder| builder.upload_deformer(mesh, primitive, &bytes))
            }
            Upload::Finish { state, answer } => {
                self.begin_preparation(state, answer);
                Ok(())
            }
            Upload::Abandon => {
                (self.building, self.relayout, self.preparation) = (None, None, None);
                self.build_fault = None;
                Ok(())
            }
        };
        if let Err(reason) = uploaded {
            // The finish that follows says so to the loader.
            tracing::error!(reason, "a scene could not be built");
            (self.building, self.build_fault) = (None, Some(reason));
        }
    }

    fn build<E: std::fmt::Display>(
        &mut self,
        upload: impl FnOnce(&Gpu, &mut SceneBuilder) -> Result<(), E>,
    ) -> Result<(), String> {
        let Some(builder) = &mut self.building else { return Ok(()) };
        upload(&self.gpu, builder).map_err(|error| error.to_string())?;
        // Staging memory is given back only when the queue has run.
        self.gpu.queue.submit([]);
        let _ = self.gpu.device.poll(wgpu::PollType::Poll);
        Ok(())
    }

    fn send(&self, report: RenderEvent) {
        // A full queue means that the network stands still; the manager knows that already.
        if self.queues.reports.try_send(report).is_err() {
            tracing::debug!("a report was dropped");
        }
    }
}

#[cfg(test)]
mod tests;
