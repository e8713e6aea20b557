//! States become drawable: correctors, pipelines, and a frame that nobody sees.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::Instant;

use crossbeam_channel::{Receiver, TryRecvError, bounded, never};
use polyptych_protocol::command::Frame;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_renderer::{
    Environment, GpuScene, ImageEncoding, PipelineNeeds, SceneBuilder, ScenePipelines, Target,
};
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, Scene};

use super::{Correctors, ReadyState, RenderThread, STATES_MAX, WARM_UP_SIDE};
use crate::channel_output::ChannelOutput;
use crate::correction::Corrector;
use crate::frame_views;
use crate::loader::LoadedState;

/// A state whose pipelines are made and warmed up beside the frames.
pub(super) struct Preparation {
    state: Arc<LoadedState>,
    scene: Rc<GpuScene>,
    needs: Vec<PipelineNeeds>,
    /// Gives the pipelines once they are made; its sender is gone if that failed.
    made: Receiver<ScenePipelines>,
    is_made: bool,
    /// The steps that are left of those that have the driver compile what it has not yet: the index
    /// of the needs, and the step.
    warm_up: Option<(usize, usize)>,
    start: Instant,
    answer: SyncSender<Result<u64, String>>,
}

impl Preparation {
    /// Returns what of it is on the GPU.
    pub fn into_gpu_parts(self) -> (Rc<GpuScene>, Receiver<ScenePipelines>) {
        (self.scene, self.made)
    }
}

impl RenderThread {
    /// Begins to make a state drawable. Its answer, the bytes of its scene, may come later: between
    /// frames, which go on with the state before.
    pub(super) fn begin_preparation(
        &mut self,
        state: Arc<LoadedState>,
        answer: SyncSender<Result<u64, String>>,
    ) {
        match self.built(&state) {
            // The loader waits for this; should it have ended, nobody does.
            Err(reason) => drop(answer.send(Err(reason))),
            Ok((scene, _, false)) => drop(answer.send(self.complete(state, scene, false))),
            Ok((scene, is_new, true)) => self.prepare_beside_frames(state, scene, is_new, answer),
        }
    }

    fn prepare_beside_frames(
        &mut self,
        state: Arc<LoadedState>,
        scene: Rc<GpuScene>,
        is_new: bool,
        answer: SyncSender<Result<u64, String>>,
    ) {
        if state.samples().is_some_and(|samples| samples != self.renderer.samples()) {
            // It needs another renderer, which frames of the state before cannot share.
            drop(answer.send(self.complete(state, scene, true)));
            return;
        }
        if let Some(wall) = state.replica.wall.as_deref() {
            self.renderer.set_shadows(wall.shadows);
        }
        let needs = self.needs_and_metering(&state, &scene);
        let own = self.renderer.pipelines();
        let is_made = needs.iter().all(|needs| own.meet(needs));
        if is_made && !is_new {
            drop(answer.send(self.complete(state, scene, false)));
            return;
        }
        let made = if is_made { never() } else { self.make_pipelines(needs.clone()) };
        let warm_up = (!needs.is_empty()).then_some((0, 0));
        let start = Instant::now();
        self.preparation =
            Some(Preparation { state, scene, needs, made, is_made, warm_up, start, answer });
    }

    /// Makes what is missing for these needs on a thread of its own. Gives all pipelines once they
    /// are made; its sender is gone if that failed.
    pub(super) fn make_pipelines(&self, needs: Vec<PipelineNeeds>) -> Receiver<ScenePipelines> {
        let (sender, made) = bounded(1);
        let (gpu, mut pipelines) = (self.gpu.clone(), self.renderer.pipelines().clone());
        let make = move || {
            for needs in &needs {
                pipelines.complete(&gpu, needs);
            }
            // Those that they are for may have been given up meanwhile.
            let _ = sender.send(pipelines);
        };
        if let Err(error) = thread::Builder::new().name("pipelines".into()).spawn(make) {
            tracing::warn!(%error, "pipelines are made between frames");
        }
        made
    }

    /// The pipelines of the state that is prepared, once they are made on their thread; never ready
    /// if none is.
    pub(super) fn pipelines_made(&self) -> Receiver<ScenePipelines> {
        let waiting = self.preparation.as_ref().filter(|of| !of.is_made);
        waiting.map_or_else(never, |of| of.made.clone())
    }

    /// Takes pipelines that were made on their thread. Without them, since that failed, the rest is
    /// made here.
    pub(super) fn take_pipelines(&mut self, pipelines: Option<ScenePipelines>) {
        let Some(of) = &mut self.preparation else { return };
        of.is_made = true;
        let pipelines_us = of.start.elapsed().as_micros() as u64;
        tracing::debug!(pipelines_us, "the scene's pipelines are made");
        if let Some(pipelines) = pipelines {
            self.renderer.add_pipelines(pipelines);
        }
    }

    /// Returns whether there is something to be done for the state that is prepared.
    pub(super) fn continues_preparation(&mut self) -> bool {
        match self.pipelines_made().try_recv() {
            Ok(pipelines) => self.take_pipelines(Some(pipelines)),
            Err(TryRecvError::Disconnected) => self.take_pipelines(None),
            Err(TryRecvError::Empty) => {}
        }
        self.preparation.as_ref().is_some_and(|of| of.is_made)
    }

    /// Does the next step of what [`Self::continues_preparation`] tells of: about as long as a
    /// driver takes to compile one pipeline, but for the last, which draws the scene once.
    pub(super) fn continue_preparation(&mut self) {
        let Some(mut of) = self.preparation.take() else { return };
        if let Some((index, step)) = of.warm_up {
            let needs = &of.needs[index];
            let has_next = self.renderer.pipelines().meet(needs)
                && self.renderer.warm(&self.gpu, &of.scene, needs, step);
            let next = if has_next { (index, step + 1) } else { (index + 1, 0) };
            of.warm_up = (next.0 < of.needs.len()).then_some(next);
            self.preparation = Some(of);
            return;
        }
        let warm_up_us = of.start.elapsed().as_micros() as u64;
        tracing::debug!(warm_up_us, "the driver has compiled the scene's pipelines");
        let completed = self.complete(of.state, of.scene, true);
        // As above.
        let _ = of.answer.send(completed);
    }

    /// The scene of a state, whether it is another one than that of the state before or has another
    /// wall around it, and whether it may need pipelines that are not there.
    fn built(&mut self, state: &LoadedState) -> Result<(Rc<GpuScene>, bool, bool), String> {
        let start = Instant::now();
        if let Some(reason) = self.build_fault.take() {
            return Err(format!("the scene could not be built: {reason}"));
        }
        let relayout = self.relayout.take();
        let manifest = |state: &LoadedState| state.scene.map(|scene| scene.manifest);
        let is_built = self.building.is_some();
        let is_laid_out = is_built || relayout.is_some();
        let latest = self.states.back().filter(|latest| {
            let is_it = latest.state.scene == state.scene;
            is_it || (is_laid_out && manifest(&latest.state) == manifest(state))
        });
        let is_known =
            latest.is_some_and(|latest| latest.state.plans.keys().eq(state.plans.keys()));
        let has_effects =
            latest.is_some_and(|latest| latest.state.replica.effects == state.replica.effects);
        let scene = if let Some(builder) = self.building.take() {
            let scene = builder.finish(&self.gpu).map_err(|error| error.to_string())?;
            Rc::new(scene)
        } else if let (Some((layout, moved)), Some(latest)) = (&relayout, latest) {
            let scene = latest.scene.with_layout(&self.gpu, Arc::clone(layout), moved.clone());
            Rc::new(scene.map_err(|error| error.to_string())?)
        } else if let Some(latest) = latest {
            Rc::clone(&latest.scene)
        } else if state.scene.is_none() {
            let nothing = SceneBuilder::new(&self.gpu, Scene::default());
            let nothing = nothing.and_then(|builder| builder.finish(&self.gpu));
            Rc::new(nothing.map_err(|error| error.to_string())?)
        } else {
            return Err("the scene could not be built; the server's log says why".to_owned());
        };
        let scene_us = start.elapsed().as_micros() as u64;
        tracing::debug!(scene_us, is_built, "the scene is on the GPU");
        let (scene, is_same_kind) = self.surrounded(state, scene);
        // Another wall around the same scene, as tunings bring it many times a second, is not new.
        let has_samples = state.samples() == Some(self.renderer.samples());
        let is_new = !is_known || !is_same_kind || !has_samples;
        // An edit may need a pipeline that the scene did not; what moves needs none.
        let is_edited = is_built || relayout.is_some_and(|(_, moved)| moved.is_none());
        Ok((scene, is_new, is_new || is_edited || !has_effects))
    }

    /// Makes a state whose pipelines are there the latest one. Gives the bytes of its scene.
    pub(super) fn complete(
        &mut self,
        state: Arc<LoadedState>,
        scene: Rc<GpuScene>,
        is_new: bool,
    ) -> Result<u64, String> {
        self.is_completing = !self.states.iter().any(|of| of.scene.has_content_of(&scene));
        let correctors = self.finish_drawable(&state, &scene, is_new);
        // This took the most memory of all steps: a recovery must know what was held then.
        self.is_completing &= correctors.is_err() && self.gpu.first_fault().is_some();
        let correctors = correctors?;
        if self.states.len() == STATES_MAX {
            self.states.remove(1);
        }
        let scene_bytes = scene.content_bytes();
        self.states.push_back(ReadyState { state, scene, correctors });
        Ok(scene_bytes)
    }

    /// Makes all that is left to be made for a state. Returns its correctors.
    fn finish_drawable(
        &mut self,
        state: &LoadedState,
        scene: &GpuScene,
        is_new: bool,
    ) -> Result<Correctors, String> {
        self.arrange_windows(state);
        let start = Instant::now();
        let correctors = self.correctors(state)?;
        let correctors_us = start.elapsed().as_micros() as u64;
        tracing::debug!(correctors_us, "the channels' corrections are on the GPU");
        self.expect(state);
        if is_new {
            self.warm_up(state, scene, &correctors)?;
        } else {
            // Nothing is left to be made, unless another thread failed to.
            self.prepare(state, scene);
        }
        Ok(correctors)
    }

    /// A scene in what surrounds it in a state, and whether the pipelines of the state before
    /// draw that.
    fn surrounded(&self, state: &LoadedState, scene: Rc<GpuScene>) -> (Rc<GpuScene>, bool) {
        let latest = self.states.back();
        let held = latest.and_then(|latest| {
            let of = latest.state.environment.as_ref()?;
            Some((of.blob, latest.scene.environment()?))
        });
        let environment = state.environment.as_ref().map(|wanted| match held {
            Some((blob, held)) if blob == wanted.blob => Arc::clone(held),
            _ => Arc::new(Environment::new(&self.gpu, &wanted.map)),
        });
        let is_same_kind = held.is_some() == environment.is_some();
        let is_it = match (scene.environment(), &environment) {
            (Some(has), Some(wanted)) => Arc::ptr_eq(has, wanted),
            (None, None) => true,
            _ => false,
        };
        if is_it {
            return (scene, is_same_kind);
        }
        (Rc::new(scene.with_environment(environment)), is_same_kind)
    }

    /// Returns the correctors of a state's channels: those of an earlier state if its wall is the
    /// same.
    fn correctors(&self, state: &LoadedState) -> Result<Correctors, String> {
        let is_it = |d: &&ReadyState| Arc::ptr_eq(&d.state.plans, &state.plans);
        if let Some(drawable) = self.states.iter().rfind(is_it) {
            return Ok(Rc::clone(&drawable.correctors));
        }
        let latest = self.states.back().map(|latest| Rc::clone(&latest.correctors));
        let latest = latest.as_ref().map(|correctors| correctors.borrow());
        let mut correctors = BTreeMap::new();
        for (name, plan) in state.plans.iter() {
            let Some(wall) = state.replica.wall.as_deref() else { break };
            let mut outputs = self.outputs.iter().filter(|output| output.name == *name);
            let plan = plan.shown_by(name, outputs.any(|it| it.supports_10_bit(&self.gpu)));
            let known = latest.as_ref().and_then(|correctors| correctors.get(name));
            let corrector = Corrector::new(&self.gpu, plan, wall, known)?;
            correctors.insert(name.clone(), corrector);
        }
        Ok(Rc::new(RefCell::new(correctors)))
    }

    /// The needs of a scene for the targets that this server's channels have.
    pub(super) fn needs(&self, state: &LoadedState, scene: &GpuScene) -> Vec<PipelineNeeds> {
        let is_corrected = |output: &ChannelOutput| state.plans.contains_key(&output.name);
        let contents = [(ImageEncoding::Srgb, false), (ImageEncoding::Light, true)];
        let used = contents.into_iter().filter(|(_, corrected)| {
            self.outputs.iter().any(|output| is_corrected(output) == *corrected)
        });
        let effects = state.replica.effects;
        used.map(|(content, _)| PipelineNeeds::new(scene, content, effects)).collect()
    }

    /// The needs of a scene like [`Self::needs`], and those of its metering where frames have
    /// automatic exposure.
    pub(super) fn needs_and_metering(
        &self,
        state: &LoadedState,
        scene: &GpuScene,
    ) -> Vec<PipelineNeeds> {
        let effects = state.replica.effects;
        let metering = self.is_metering.then(|| PipelineNeeds::metering(scene, effects));
        self.needs(state, scene).into_iter().chain(metering).collect()
    }

    /// Makes the pipelines of a scene for these targets at once; those of metering are never
    /// waited for.
    pub(super) fn prepare(&mut self, state: &LoadedState, scene: &GpuScene) {
        if let Some(wall) = state.replica.wall.as_deref() {
            self.renderer.set_shadows(wall.shadows);
        }
        for needs in self.needs(state, scene) {
            self.renderer.prepare_with(&self.gpu, scene, &needs);
        }
    }

    /// Draws a scene once, small, where nobody sees it: a first use takes more than the next.
    fn warm_up(
        &mut self,
        state: &LoadedState,
        scene: &GpuScene,
        correctors: &Correctors,
    ) -> Result<(), String> {
        let Some(wall) = state.replica.wall.as_deref() else { return Ok(()) };
        self.use_wall(wall)?;
        self.prepare(state, scene);
        let Some((id, channel)) = self.outputs.first().and_then(|o| wall.channel_by_name(&o.name))
        else {
            return Ok(());
        };
        let effects = state.replica.effects;
        let frame = Frame {
            epoch: state.epoch,
            frame: FrameId(0),
            time_s: 0.0,
            revision: state.replica.revision,
            presentation: Presentation {
                camera: state.warm_up,
                // Their numbers do not matter.
                fog: effects.fog.then(|| Fog::even(1000.0)),
                glow: effects.glow.then(|| Glow::new(0.1)),
                ambient_occlusion: effects
                    .ambient_occlusion
                    .then_some(AmbientOcclusion { radius: 1.0 }),
                depth_of_field: effects.depth_of_field.then(|| DepthOfField::new(1.0)),
                ..Presentation::new(wall.head())
            },
            capture: None,
            detail: DetailBound::default(),
            clips: Vec::new(),
            is_metered: false,
        };
        let (mut views, content) = match correctors.borrow_mut().get_mut(&channel.name) {
            Some(corrector) => (corrector.views(&self.gpu, wall, &frame)?, ImageEncoding::Light),
            None => (frame_views::views(wall, id, &frame)?, ImageEncoding::Srgb),
        };
        // Planes share their depth here, where only one is drawn.
        views.truncate(1);
        for view in &mut views {
            view.viewport = [0.0, 0.0, f64::from(WARM_UP_SIDE), f64::from(WARM_UP_SIDE)];
            view.scissor = None;
        }
        let side = [WARM_UP_SIDE; 2];
        let is_linear = scene.needs_light(frame.presentation.effects());
        let target = Target::with_encoding(&self.gpu, side, wall.samples, is_linear, content);
        let mut target = target.map_err(|error| error.to_string())?;
        let start = Instant::now();
        let drawn = self.renderer.draw(&self.gpu, scene, &mut target, &views);
        let first_frame_us = start.elapsed().as_micros() as u64;
        tracing::debug!(first_frame_us, "the scene was drawn once, unseen");
        drawn.map(|_| ()).map_err(|error| error.to_string())
    }
}
