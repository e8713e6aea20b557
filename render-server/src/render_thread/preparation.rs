//! States become drawable: correctors, pipelines, and a frame that nobody sees.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use polyptych_protocol::command::Frame;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_renderer::{Environment, GpuScene, ImageEncoding, SceneBuilder, Target};
use polyptych_scene::Scene;

use super::{Correctors, ReadyState, RenderThread, STATES_MAX, WARM_UP_SIDE};
use crate::channel_output::ChannelOutput;
use crate::correction::Corrector;
use crate::frame_views;
use crate::loader::LoadedState;

impl RenderThread {
    /// Makes a state drawable. Gives the bytes of its scene.
    pub(super) fn finish(&mut self, state: Arc<LoadedState>) -> Result<u64, String> {
        let start = Instant::now();
        let relayout = self.relayout.take();
        let manifest = |state: &LoadedState| state.scene.map(|scene| scene.manifest);
        let is_built = self.building.is_some();
        let is_laid_out = is_built || relayout.is_some();
        let latest = self.states.back().filter(|latest| {
            let is_it = latest.state.scene == state.scene;
            is_it || (is_laid_out && manifest(&latest.state) == manifest(&state))
        });
        let is_known =
            latest.is_some_and(|latest| latest.state.plans.keys().eq(state.plans.keys()));
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
        let (scene, is_same_kind) = self.surrounded(&state, scene);
        self.arrange_windows(&state);
        let start = Instant::now();
        let correctors = self.correctors(&state)?;
        let correctors_us = start.elapsed().as_micros() as u64;
        tracing::debug!(correctors_us, "the channels' corrections are on the GPU");
        self.expect(&state);
        // Another wall around the same scene, as tunings bring it many times a second.
        if !is_known || !is_same_kind || state.samples() != Some(self.renderer.samples()) {
            self.warm_up(&state, &scene, &correctors)?;
        } else if is_built || relayout.is_some_and(|(_, moved)| moved.is_none()) {
            // An edit may need a pipeline that the scene did not; what moves needs none.
            self.prepare(&state, &scene);
        }
        if self.states.len() == STATES_MAX {
            self.states.remove(1);
        }
        let scene_bytes = scene.content_bytes();
        self.states.push_back(ReadyState { state, scene, correctors });
        Ok(scene_bytes)
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

    /// Makes the pipelines of a scene for the targets that this server's channels have.
    pub(super) fn prepare(&mut self, state: &LoadedState, scene: &GpuScene) {
        if let Some(wall) = state.replica.wall.as_deref() {
            self.renderer.set_shadows(wall.shadows);
        }
        let is_corrected = |output: &ChannelOutput| state.plans.contains_key(&output.name);
        for (content, corrected) in [(ImageEncoding::Srgb, false), (ImageEncoding::Light, true)] {
            if self.outputs.iter().any(|output| is_corrected(output) == corrected) {
                self.renderer.prepare_for(&self.gpu, scene, content);
            }
        }
    }

    /// Builds the pipelines of a scene and draws it once, small, where nobody sees it: a first
    /// use compiles for tens of milliseconds.
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
        let frame = Frame {
            epoch: state.epoch,
            frame: FrameId(0),
            time_s: 0.0,
            revision: state.replica.revision,
            presentation: Presentation {
                camera: state.warm_up,
                tone: self.renderer.tone(),
                fog: self.renderer.fog(),
                glow: self.renderer.glow(),
                ambient_occlusion: self.renderer.ambient_occlusion(),
                ..Presentation::new(wall.head())
            },
            capture: false,
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
        let is_linear = scene.needs_light(frame.presentation.glow);
        let target = Target::with_encoding(&self.gpu, side, wall.samples, is_linear, content);
        let mut target = target.map_err(|error| error.to_string())?;
        let drawn = self.renderer.draw(&self.gpu, scene, &mut target, &views);
        drawn.map(|_| ()).map_err(|error| error.to_string())
    }
}
