//! From a wall's channel to what its picture goes through: the only file that knows walls and the
//! renderer's corrections.
//!
//! A plan is made by the loader, being pure and slow; the render thread takes it to the GPU, and
//! brings to each frame only where the eyes are.

pub(crate) mod eye_views;
pub(crate) mod metered;
mod overlay;

use std::collections::BTreeMap;
use std::sync::Arc;

use eye_views::EyeViews;
use glam::DVec3;
use overlay::{Overlay, OverlayContext};
use polyptych_protocol::command::Frame;
use polyptych_renderer::{
    self, BegunFrame, BlendMapDesc, Correction, CorrectionDesc, DrawStats, Enlargement, Gpu,
    GpuScene, ImageEncoding, Renderer, Submission, SubmittedFrame, Target, ViewDesc,
};
use polyptych_scene::FramePass;
use polyptych_wall::blend::{self, BlendModel, ChannelMasks, LightInputs};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::{Area, View, ViewProjection};
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};
use polyptych_wall::warp::Mask;
use polyptych_wall::warp_mesh::WarpMesh;
use polyptych_wall::{
    self, BitDepth, CalibrationFile, ChannelCalibration, ChannelId, ChannelKind, Eye, Viewpoint,
    Wall,
};

use crate::channel_output::ChannelOutput;
use crate::frame_views;
use crate::reduced_grid::ReducedGrid;

/// The plans of a server's channels, by name; those that need none are not there.
pub(crate) type CorrectionPlans = BTreeMap<String, CorrectionPlan>;

/// The correction of a channel that is not shown as it is drawn.
#[derive(Clone, Debug)]
pub(crate) struct CorrectionPlan {
    channel: ChannelId,
    desc: CorrectionDesc,
    /// The inputs that its light map was made from.
    light_inputs: LightInputs,
    /// The inputs that its mesh was made from.
    form: Form,
    /// The positions of its pixels; `None` if they are pixels of its screen.
    warp: Option<Arc<WarpMesh>>,
    /// The eyes whose pictures it shows.
    eyes: Vec<Eye>,
    /// The decoded files of the wall, from which views of their own find their pixels.
    maps: CalibrationMaps,
    shapes: WallGeometry,
}

/// The inputs that decide the positions of a channel's pixels: equal ones make equal meshes.
#[derive(Clone, Debug, PartialEq)]
struct Form {
    eye: DVec3,
    eyes: Vec<Viewpoint>,
    screen: polyptych_wall::Screen,
    /// Without its colours and the widths of its blends.
    channel: polyptych_wall::Channel,
    files: Vec<CalibrationFile>,
}

impl Form {
    fn new(wall: &Wall, channel: &polyptych_wall::Channel) -> Self {
        let mut channel = channel.clone();
        let ChannelCalibration { pin, bend, warp, .. } = std::mem::take(&mut channel.adjustment);
        channel.adjustment =
            ChannelCalibration { pin, bend, warp, ..ChannelCalibration::default() };
        let screen = wall.screen_of(&channel).clone();
        let eyes = wall.viewpoints(&channel);
        Self { eye: wall.eye, eyes, screen, channel, files: wall.files.clone() }
    }
}

/// The plans of these channels. What did not change of `known` plans is theirs.
///
/// # Errors
/// A channel cannot be shown; the error names it and says why.
pub(crate) fn correction_plans<'a>(
    of: impl Into<ResolvedWall<'a>>,
    maps: &CalibrationMaps,
    channels: &[String],
    known: Option<&CorrectionPlans>,
) -> Result<CorrectionPlans, String> {
    let shaped = of.into();
    let wall = shaped.wall;
    let blend = BlendModel::new(shaped);
    let mut plans = CorrectionPlans::new();
    for name in channels {
        let Some((id, _)) = wall.channel_by_name(name) else { continue };
        let known = known.and_then(|plans| plans.get(name));
        let plan = CorrectionPlan::after(shaped, &blend, maps, id, known);
        let plan = plan.map_err(|reason| format!("channel {name}: {reason}"))?;
        if let Some(plan) = plan {
            plans.insert(name.clone(), plan);
        }
    }
    Ok(plans)
}

impl CorrectionPlan {
    /// The plan of a channel; `None` where it is shown as it is drawn.
    ///
    /// # Errors
    /// Nothing of its picture lies on its screen.
    #[cfg(test)]
    pub fn new<'a>(
        of: impl Into<ResolvedWall<'a>>,
        maps: &CalibrationMaps,
        id: ChannelId,
    ) -> Result<Option<Self>, String> {
        let shaped = of.into();
        Self::after(shaped, &BlendModel::new(shaped), maps, id, None)
    }

    /// The plan of a channel after a `known` one of it, whose light map and mesh it has where
    /// nothing has changed that they are made from.
    fn after(
        shaped: ResolvedWall<'_>,
        blend: &BlendModel<'_>,
        maps: &CalibrationMaps,
        id: ChannelId,
        known: Option<&Self>,
    ) -> Result<Option<Self>, String> {
        let wall = shaped.wall;
        let channel = wall.channel(id).ok_or("the wall has no such channel")?;
        let adjustment = &channel.adjustment;
        let is_flat =
            channel.cover == ChannelKind::Tile && wall.screen_of(channel).plane().is_some();
        // Parts of a picture with eyes of their own are drawn as those of a curve are.
        let is_tile = is_flat && !wall.is_omnidirectional(channel);
        let light_inputs = blend.light_inputs(id).ok_or("the wall has no such channel")?;
        let light_map = match known.filter(|known| known.light_inputs == light_inputs) {
            Some(known) => known.desc.light_map.clone(),
            None => light_map(shaped, blend, maps, id).map(renderer_light).map(Arc::new),
        };
        if is_tile && adjustment.is_identity() && light_map.is_none() {
            return Ok(None);
        }
        let form = Form::new(wall, channel);
        let is_bent = !form.channel.adjustment.is_identity() || adjustment.warp.is_some();
        let known = known.filter(|known| known.form == form);
        let (warp, drawn) = match known {
            _ if is_tile && !is_bent => (None, None),
            Some(known) => (known.warp.clone(), known.desc.warp.clone()),
            None => {
                let warp = shaped.drawn_mesh(maps, id)?.refined_for(&wall.viewpoints(channel));
                let warp = Arc::new(warp);
                (Some(Arc::clone(&warp)), Some(warp))
            }
        };
        let eyes = channel.eyes().to_vec();
        let color = blend.color(id).ok_or("the wall has no such channel")?;
        let desc = CorrectionDesc {
            upright: channel.size.to_array(),
            turn: adjustment.turn,
            is_mirrored: adjustment.mirror,
            packing: adjustment.packing,
            warp: drawn,
            light_map,
            color: color.made(),
            curve: color.curve.clone(),
            dither: wall.dither.then_some(u32::from(id.0)),
            is_fine: adjustment.bits == BitDepth::Ten,
        };
        let (maps, shapes) = (maps.clone(), shaped.shapes.clone());
        Ok(Some(Self { channel: id, desc, light_inputs, form, warp, eyes, maps, shapes }))
    }
}

impl CorrectionPlan {
    fn viewpoints(&self, wall: &Wall, head: &HeadPose) -> Vec<Viewpoint> {
        self.eyes.iter().map(|eye| wall.viewpoint(head, *eye)).collect()
    }

    /// The plan as the display of the channel of this name can show it.
    pub fn shown_by(&self, name: &str, takes_fine_codes: bool) -> Self {
        let mut plan = self.clone();
        if plan.desc.is_fine && !takes_fine_codes {
            tracing::warn!(channel = name, "the display takes no codes of 10 bits: it is given 8");
            plan.desc.is_fine = false;
        }
        plan
    }
}

/// Returns the factors and addends of a channel's light, for its blends, its masks, and the light
/// of its warp's corners; `None` if there is nothing to correct.
pub(crate) fn light_map(
    shaped: ResolvedWall<'_>,
    blend: &BlendModel<'_>,
    maps: &CalibrationMaps,
    id: ChannelId,
) -> Option<blend::BlendMap> {
    let channel = shaped.wall.channel(id)?;
    let light = shaped.channel_mapping(id).and_then(|map| maps.mesh_light_mask(channel, &map));
    let light = light.as_ref().and_then(Mask::texels);
    let masks = ChannelMasks { light, ..maps.masks(&channel.adjustment) };
    blend.blend_map(id, &masks)
}

fn renderer_light(map: blend::BlendMap) -> BlendMapDesc {
    BlendMapDesc { texels: map.texels, multiply: 1.0, add: map.add }
}

/// The last view that a warped channel shows through its own frusta on all of its pixels: those
/// before it are not seen.
fn beneath(views: &[View]) -> Option<usize> {
    let is_whole = |view: &View| view.area == Area::Wall && view.projection == ViewProjection::Wall;
    views.iter().rposition(is_whole)
}

/// The views that are drawn and corrected in one go.
#[derive(Debug)]
struct Layer {
    shots: EyeViews,
    views: Vec<ViewDesc>,
    /// The index of the overlay whose pixels it has; `None` for all of the channel's.
    lay: Option<usize>,
}

/// A corrected channel's frame of which it is known what is seen.
#[derive(Debug)]
pub(crate) struct BegunCorrection {
    layers: Vec<Layer>,
    /// The first layer.
    begun: BegunFrame,
    /// The place of its source in one with all pixels; `None` if it has them.
    enlargement: Option<Enlargement>,
}

/// The layers of a corrected channel's frame that the GPU draws: their sources and corrections.
#[derive(Debug)]
pub(crate) struct SubmittedCorrection(Vec<(SubmittedFrame, Submission)>);

impl SubmittedCorrection {
    /// Waits until the picture is there.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn finish(
        self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        output: &mut ChannelOutput,
    ) -> Result<DrawStats, String> {
        let mut stats = DrawStats::default();
        for (drawn, corrected) in self.0 {
            let drawn = renderer.finish(gpu, output.target()?, drawn);
            stats = stats.and(drawn.map_err(|error| error.to_string())?);
            let corrected = renderer.finish_submission(gpu, &corrected);
            let corrected = corrected.map_err(|error| error.to_string())?.as_micros() as u64;
            stats.gpu_us += corrected;
            stats.passes.add_if_measured(FramePass::Correction, corrected);
        }
        Ok(stats)
    }
}

/// A plan on the GPU.
#[derive(Debug)]
pub(crate) struct Corrector {
    plan: CorrectionPlan,
    correction: Correction,
    /// The wall's.
    near_m: f64,
    /// The pictures of the last eyes. A tracked eye costs a fit for each frame, others none.
    shots: Option<EyeViews>,
    /// The overlays of the last frame's views. One is made if its view is new or was moved.
    lays: Vec<Overlay>,
}

impl Corrector {
    /// Takes a plan to the GPU, and draws with it once where nobody sees it, for a head that is
    /// there, so that no frame waits for a compiler. What did not change of a `known` corrector is
    /// shared with it.
    ///
    /// # Errors
    /// The plan or the head leave no picture, or the GPU failed; the channel's name is said.
    pub fn new(
        gpu: &Gpu,
        plan: CorrectionPlan,
        wall: &Wall,
        known: Option<&Self>,
    ) -> Result<Self, String> {
        let name = wall.channel(plan.channel).map_or("", |channel| &channel.name);
        // Who tunes wants to know which, where its reason does not say.
        Self::warmed(gpu, plan, wall, known).map_err(|reason| {
            match reason.strip_prefix("channel ") {
                Some(_) => reason,
                None => format!("channel {name}: {reason}"),
            }
        })
    }

    fn warmed(
        gpu: &Gpu,
        plan: CorrectionPlan,
        wall: &Wall,
        known: Option<&Self>,
    ) -> Result<Self, String> {
        let before = known.map(|known| &known.correction);
        let correction = Correction::after(gpu, plan.desc.clone(), before);
        let correction = correction.map_err(|error| error.to_string())?;
        let is_same = |known: &&Self| match (&known.plan.warp, &plan.warp) {
            (Some(before), Some(now)) => Arc::ptr_eq(before, now) && known.near_m == wall.near_m,
            _ => false,
        };
        let shots = known.filter(is_same).and_then(|known| known.shots.clone());
        let near_m = wall.near_m;
        let mut corrector = Self { plan, correction, near_m, shots, lays: Vec::new() };
        let head = wall.head();
        let shots = corrector.shots(gpu, wall, (&head, 0))?.clone();
        if corrector.correction.is_warm(&shots.eyes, shots.taps) {
            return Ok(corrector);
        }
        let source = Target::with_encoding(gpu, shots.size, 1, false, ImageEncoding::Light);
        let source = source.map_err(|error| error.to_string())?;
        let picture = corrector.correction.picture(gpu);
        let warmed = corrector.correction.draw(gpu, &source, &shots.eyes, shots.taps, &picture);
        warmed.map_err(|error| error.to_string())?;
        Ok(corrector)
    }

    /// Begins a frame of the channel, from its scene to the display's codes.
    ///
    /// # Errors
    /// An eye that sees no picture, a view that cannot be shown, or the GPU failed.
    pub fn begin(
        &mut self,
        gpu: &Gpu,
        (renderer, scene): (&mut Renderer, &GpuScene),
        wall: &Wall,
        frame: &Frame,
        output: &mut ChannelOutput,
    ) -> Result<BegunCorrection, String> {
        frame_views::check_frame(frame)?;
        let layers = self.layers(gpu, wall, frame)?;
        let sides = layers.iter().map(|layer| layer.shots.size);
        let size = sides.fold([0, 0], |[w, h], side| [w.max(side[0]), h.max(side[1])]);
        let like = (renderer.samples(), scene.needs_light(frame.presentation.effects()));
        let grid = self.reduced_grid(wall, frame.detail.resolution_steps);
        let eyes = self.plan.eyes.len() as u32;
        let size = grid.map_or(size, |grid| grid.size(eyes));
        let source = output.ensure_atlas_target(gpu, size, like)?;
        let views = layers.first().map_or(&[][..], |layer| &layer.views);
        let reduced = grid.map(|grid| grid.views(views, eyes));
        let views = reduced.as_deref().unwrap_or(views);
        let begun = renderer.begin(gpu, scene, source, views).map_err(|error| error.to_string())?;
        Ok(BegunCorrection { layers, begun, enlargement: grid.map(|grid| grid.enlargement(eyes)) })
    }

    /// Submits a frame that was begun with this output. One source serves all layers: the queue
    /// draws the next one into it after the one before was corrected.
    ///
    /// # Errors
    /// Those of [`Self::begin`].
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        (renderer, scene): (&mut Renderer, &GpuScene),
        output: &mut ChannelOutput,
        BegunCorrection { layers, begun, enlargement }: BegunCorrection,
    ) -> Result<SubmittedCorrection, String> {
        let (mut begun, mut submitted) = (Some(begun), Vec::with_capacity(layers.len()));
        for layer in layers {
            let source = output.target()?;
            let begun = match begun.take() {
                Some(begun) => Ok(begun),
                None => renderer.begin(gpu, scene, source, &layer.views),
            };
            let drawn = begun.and_then(|begun| renderer.submit(gpu, scene, source, begun));
            let drawn = drawn.map_err(|error| error.to_string())?;
            let EyeViews { size, eyes, taps, .. } = &layer.shots;
            let enlargement = enlargement.map(|place| (place, *size));
            output.enlarge_source(gpu, renderer, enlargement)?;
            let (source, picture) = output.ensure_corrected(gpu, &self.correction)?;
            let sheet = layer.lay.and_then(|index| self.lays[index].mesh());
            let corrected = match sheet {
                None => self.correction.draw(gpu, source, eyes, *taps, picture),
                Some(sheet) => {
                    let shape = &sheet.shape;
                    self.correction.draw_overlay(gpu, shape, source, (eyes, *taps), picture)
                }
            };
            submitted.push((drawn, corrected.map_err(|error| error.to_string())?));
        }
        Ok(SubmittedCorrection(submitted))
    }

    /// Draws a frame of the channel, and waits for it.
    #[cfg(test)]
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        (renderer, scene): (&mut Renderer, &GpuScene),
        wall: &Wall,
        frame: &Frame,
        output: &mut ChannelOutput,
    ) -> Result<DrawStats, String> {
        let begun = self.begin(gpu, (renderer, scene), wall, frame, output)?;
        self.submit(gpu, (renderer, scene), output, begun)?.finish(gpu, renderer, output)
    }

    /// The pixels of the source of a channel that is not warped, if its resolution is lowered.
    fn reduced_grid(&self, wall: &Wall, steps: u8) -> Option<ReducedGrid> {
        let channel = wall.channel(self.plan.channel).filter(|_| self.plan.warp.is_none())?;
        ReducedGrid::new(channel, wall.screen_of(channel), steps)
    }

    /// Returns the layers of a frame: the channel's own picture first, then the overlays.
    fn layers(&mut self, gpu: &Gpu, wall: &Wall, frame: &Frame) -> Result<Vec<Layer>, String> {
        let views = self.views(gpu, wall, frame)?;
        let seen = (&frame.presentation.head, frame.detail.resolution_steps);
        let shots = self.shots(gpu, wall, seen)?.clone();
        let mut layers = vec![Layer { shots, views, lay: None }];
        if self.plan.warp.is_none() {
            return Ok(layers);
        }
        let eyes = self.plan.viewpoints(wall, &frame.presentation.head);
        let (maps, shapes) = (self.plan.maps.clone(), self.plan.shapes.clone());
        let shaped = ResolvedWall { wall, shapes: &shapes };
        let ground = OverlayContext { gpu, shaped, maps: &maps, channel: self.plan.channel };
        let mut known = std::mem::take(&mut self.lays);
        let all = frame.presentation.all_views();
        let first = beneath(&all).map_or(0, |beneath| beneath + 1);
        for (number, view) in all.iter().enumerate().skip(first) {
            let mut lay = match known.iter().position(|lay| lay.matches(view)) {
                Some(index) => known.swap_remove(index),
                None => Overlay::new(ground, view, &self.correction)?,
            };
            if let Some(sheet) = lay.mesh() {
                let shots =
                    sheet.eye_views(ground, view, (&eyes, frame.detail.resolution_steps))?;
                let views = shots.view_descs((number, view), frame);
                layers.push(Layer { shots, views, lay: Some(self.lays.len()) });
            }
            self.lays.push(lay);
        }
        Ok(layers)
    }

    /// Returns the views of a frame that the renderer draws into the source of the channel's own
    /// picture.
    ///
    /// # Errors
    /// An eye that sees no picture, or a view that cannot be shown.
    pub fn views(
        &mut self,
        gpu: &Gpu,
        wall: &Wall,
        frame: &Frame,
    ) -> Result<Vec<ViewDesc>, String> {
        let (channel, is_warped) = (self.plan.channel, self.plan.warp.is_some());
        let seen = (&frame.presentation.head, frame.detail.resolution_steps);
        let shots = self.shots(gpu, wall, seen)?;
        if !is_warped {
            return shots.unwarped_views(wall, channel, frame);
        }
        let all = frame.presentation.all_views();
        let beneath = beneath(&all).map(|number| (number, &all[number]));
        Ok(beneath.map_or_else(Vec::new, |view| shots.view_descs(view, frame)))
    }

    /// The pictures that a head sees; of a channel that is not warped all of its pixels.
    fn shots(
        &mut self,
        gpu: &Gpu,
        wall: &Wall,
        (head, resolution_steps): (&HeadPose, u8),
    ) -> Result<&EyeViews, String> {
        let eyes = self.plan.viewpoints(wall, head);
        let steps = if self.plan.warp.is_some() { resolution_steps } else { 0 };
        let known = self.shots.take().filter(|shots| shots.matches(&eyes, steps));
        let shots = if let Some(shots) = known {
            shots
        } else {
            let side_max = gpu.info().texture_side_max;
            EyeViews::new(
                wall,
                self.plan.channel,
                self.plan.warp.as_deref(),
                &eyes,
                (side_max, steps),
            )?
        };
        Ok(self.shots.insert(shots))
    }
}

#[cfg(test)]
pub(crate) mod tests;
