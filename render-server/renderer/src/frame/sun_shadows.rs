//! The maps of directional lights: drawn where they are not those of a frame before, for all
//! channels that show a scene from one place.
//!
//! They are drawn as a frame is submitted, after those that were submitted before: the queue does
//! one after the other, so a map that is drawn anew is read by no frame before.

use glam::DAffine3;
use polyptych_scene::SceneSubset;

use super::begun_frame::ShownView;
use super::{FrameResources, check_records};
use crate::DrawError;
use crate::bindings;
use crate::draw_list::{DrawList, VisibleItems};
use crate::error_tolerance::ErrorTolerance;
use crate::gpu::Gpu;
use crate::pass::shadow::{self, ShadowPass};
use crate::scene::{Billboard, Bounds, GpuScene, SceneIdentity};
use crate::shadow_cascades::{CASCADES_MAX, Cascade, MAP_SIDE};
use crate::shadow_uniform::ShadowUniform;
use crate::target::DEPTH_FORMAT;
use crate::view::ViewDesc;

/// Maximum number of maps for one camera: 256 MiB on the GPU. A scene with three or four suns has
/// fewer for each.
const SHADOW_MAPS_MAX: usize = 16;

/// Maps that were not used in so many frames of channels leave their memory.
const KEPT_FRAMES: u64 = 256;

/// The maps of each light of a view: the layer of the widest one and all of them, widest first;
/// `None` of one that casts no shadow.
type SunMaps = Vec<Option<(u32, Vec<Cascade>)>>;

/// The surfaces in the maps of a camera, whatever the places of the maps are.
#[derive(Clone, Debug, PartialEq)]
struct Subject {
    scene: SceneIdentity,
    subset: SceneSubset,
    /// The turns of billboards, which follow the camera.
    turns: Vec<DAffine3>,
}

/// The maps of one camera.
#[derive(Debug)]
struct MapSet {
    subject: Subject,
    /// The box of all that the camera may show.
    extent: Bounds,
    /// By layer; `None` until it is drawn.
    drawn: Vec<Option<Cascade>>,
    /// By layer.
    maps: Vec<wgpu::TextureView>,
    all: wgpu::TextureView,
    /// The number of the frame that used it last.
    used: u64,
}

/// The maps of a frame.
#[derive(Debug, Default)]
pub(super) struct FrameShadows {
    /// The bindings of each view; empty where no light casts shadows.
    pub groups: Vec<wgpu::BindGroup>,
    /// Maps that were drawn anew.
    pub drawn: u32,
}

/// A map that is to be drawn.
struct Order {
    view: usize,
    set: usize,
    layer: usize,
    cascade: Cascade,
}

/// The maps of all cameras, and the pass that draws them.
#[derive(Debug)]
pub(crate) struct SunShadows {
    pass: ShadowPass,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    /// One map of one texel, for views without shadows; made where one is needed.
    none: Option<wgpu::TextureView>,
    sets: Vec<MapSet>,
    frame: u64,
    /// No view has shadows.
    pub is_off: bool,
}

impl SunShadows {
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            pass: ShadowPass::new(gpu),
            group_layout: bindings::shadow_layout(&gpu.device),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow/sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            none: None,
            sets: Vec::new(),
            frame: 0,
            is_off: false,
        }
    }

    /// Makes what is missing for a scene; nothing for one without lights that cast shadows.
    pub fn prepare(&mut self, gpu: &Gpu, scene: &GpuScene) {
        self.pass.prepare(gpu, &scene.layout.keys);
        if scene.layout.lights.cast_shadows() && self.none.is_none() {
            self.none = Some(array_view(&texture(gpu, 1, 1)));
        }
    }

    /// The bindings that pipelines are warmed with: no shadows.
    pub(super) fn none(&self, gpu: &Gpu, scene: &GpuScene) -> Vec<wgpu::BindGroup> {
        let is_used = !self.is_off && scene.layout.lights.cast_shadows();
        let maps = self.none.as_ref().filter(|_| is_used);
        maps.map(|maps| self.group(gpu, maps, &ShadowUniform::none())).into_iter().collect()
    }

    /// Draws the maps that views need and that are not there yet.
    ///
    /// # Errors
    /// More casts shadows than is held for one frame, or the scene was not prepared.
    pub(super) fn draw(
        &mut self,
        frames: &mut FrameResources,
        gpu: &Gpu,
        scene: &GpuScene,
        shown: &[ShownView],
    ) -> Result<FrameShadows, DrawError> {
        self.frame += 1;
        let kept = self.frame.saturating_sub(KEPT_FRAMES);
        self.sets.retain(|set| set.used >= kept && !set.subject.scene.is_gone());
        if self.is_off || !scene.layout.lights.cast_shadows() {
            return Ok(FrameShadows::default());
        }
        let none = self.none.clone().ok_or(DrawError::NotPrepared)?;
        let (mut orders, mut of_views) = (Vec::new(), Vec::with_capacity(shown.len()));
        for (index, (view, _)) in shown.iter().enumerate() {
            let found = self.maps_of(gpu, scene, view);
            if let Some((set, suns)) = &found {
                self.order(index, *set, suns, &mut orders);
            }
            of_views.push(found);
        }
        self.draw_maps(frames, gpu, scene, (shown, &orders))?;
        let groups = shown.iter().zip(&of_views).map(|((view, _), found)| match found {
            Some((set, suns)) => {
                self.group(gpu, &self.sets[*set].all, &ShadowUniform::new(view, suns))
            }
            None => self.group(gpu, &none, &ShadowUniform::none()),
        });
        Ok(FrameShadows { groups: groups.collect(), drawn: orders.len() as u32 })
    }

    /// The set of a view's maps, and the maps; `None` if it has no shadows.
    fn maps_of(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        view: &ViewDesc,
    ) -> Option<(usize, SunMaps)> {
        if !view.has_shadows {
            return None;
        }
        let subject = Subject {
            scene: SceneIdentity::new(scene),
            subset: view.subset.clone(),
            turns: Billboard::turns(scene.billboards(), view),
        };
        let is_same = |set: &&MapSet| set.subject == subject;
        let part = scene.layout.tree.select(&view.subset);
        let known = self.sets.iter().find(is_same).map(|set| set.extent);
        let extent = known.unwrap_or_else(|| scene.extent(part));
        let suns = scene.suns();
        let casts: Vec<bool> = suns
            .iter()
            .map(|sun| {
                sun.casts_shadows && sun.on.color_in(sun.irradiance, part) != glam::Vec3::ZERO
            })
            .collect();
        let count = casts.iter().filter(|casts| **casts).count();
        if count == 0 {
            return None;
        }
        let each_max = CASCADES_MAX.min(SHADOW_MAPS_MAX / count);
        let mut base = 0;
        let maps: SunMaps = suns
            .iter()
            .zip(&casts)
            .map(|(sun, casts)| {
                let cascades = casts
                    .then(|| Cascade::all(sun.toward.as_dvec3(), &extent, view, each_max))
                    .filter(|cascades| !cascades.is_empty())?;
                let first = base;
                base += cascades.len() as u32;
                Some((first, cascades))
            })
            .collect();
        (base > 0).then(|| (self.set_of(gpu, &subject, extent, &maps), maps))
    }

    /// The set that has most of these maps already and is not used in this frame for others.
    fn set_of(&mut self, gpu: &Gpu, subject: &Subject, extent: Bounds, maps: &SunMaps) -> usize {
        let wanted = || maps.iter().flatten().flat_map(|(first, all)| (*first as usize..).zip(all));
        let layers = wanted().count();
        let equal = |set: &MapSet| {
            let is_drawn = |(layer, of): &(usize, &Cascade)| set.drawn[*layer] == Some(**of);
            if set.subject == *subject && set.drawn.len() >= layers {
                Some(wanted().filter(is_drawn).count())
            } else {
                None
            }
        };
        let frame = self.frame;
        let is_free = |set: &MapSet, equal: usize| set.used < frame || equal == layers;
        let fitting = self.sets.iter().enumerate().filter_map(|(at, set)| {
            equal(set).filter(|equal| is_free(set, *equal)).map(|equal| (equal, at))
        });
        let found = fitting.max().map(|(_, at)| at);
        let at = found.unwrap_or_else(|| {
            // Of another place of the same camera, or of another scene: its memory is used again.
            let room =
                self.sets.iter().position(|set| set.used < frame && set.drawn.len() == layers);
            let new = |all: wgpu::TextureView, maps| MapSet {
                subject: subject.clone(),
                extent,
                drawn: vec![None; layers],
                maps,
                all,
                used: 0,
            };
            if let Some(at) = room {
                let old = &self.sets[at];
                self.sets[at] = new(old.all.clone(), old.maps.clone());
                at
            } else {
                let texture = texture(gpu, MAP_SIDE, layers as u32);
                let maps = (0..layers as u32).map(|layer| layer_view(&texture, layer)).collect();
                self.sets.push(new(array_view(&texture), maps));
                self.sets.len() - 1
            }
        });
        self.sets[at].used = frame;
        at
    }

    /// Appends the maps of a set that are to be drawn for a view.
    fn order(&mut self, view: usize, set: usize, suns: &SunMaps, orders: &mut Vec<Order>) {
        let drawn = &mut self.sets[set].drawn;
        for (first, cascades) in suns.iter().flatten() {
            for (layer, cascade) in (*first as usize..).zip(cascades) {
                if drawn[layer].replace(*cascade) != Some(*cascade) {
                    orders.push(Order { view, set, layer, cascade: *cascade });
                }
            }
        }
    }

    fn draw_maps(
        &mut self,
        frames: &mut FrameResources,
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &[Order]),
    ) -> Result<(), DrawError> {
        if orders.is_empty() {
            return Ok(());
        }
        let drawn = self.encode(frames, gpu, scene, (shown, orders));
        if drawn.is_err() {
            for Order { set, layer, .. } in orders {
                self.sets[*set].drawn[*layer] = None;
            }
        }
        drawn
    }

    fn encode(
        &self,
        frames: &mut FrameResources,
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &[Order]),
    ) -> Result<(), DrawError> {
        frames.clear_lists();
        let (mut lists, mut views) = (Vec::new(), Vec::new());
        for Order { view: index, set, cascade, .. } in orders {
            let camera = &shown[*index].0;
            let light = cascade.view(camera);
            let tolerance = ErrorTolerance::new(&cascade.levels.view(camera));
            let turns = self.sets[*set].subject.turns.clone();
            let casting = VisibleItems::casting(scene, &light, (tolerance, turns), cascade.around);
            let (scratch, records) = (&mut frames.scratch, &mut frames.records);
            lists.push(DrawList::new(scene, &light, (&casting, &casting.items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index: *index, reason })?;
            views.push(light);
        }
        let pipelines = self.pass.pipelines(&scene.layout.keys);
        let context =
            frames.context(gpu, (pipelines, None), scene, (views.iter().collect(), None), &lists);
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("shadows") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        for (at, Order { set, layer, .. }) in orders.iter().enumerate() {
            let mut pass = shadow::begin(&mut encoder, &self.sets[*set].maps[*layer]);
            context.draw(&mut pass, at, &lists[at].opaque);
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    fn group(
        &self,
        gpu: &Gpu,
        maps: &wgpu::TextureView,
        uniform: &ShadowUniform,
    ) -> wgpu::BindGroup {
        use wgpu::util::DeviceExt;
        let uniforms = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("shadow/uniforms"),
            contents: bytemuck::bytes_of(uniform),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow/group"),
            layout: &self.group_layout,
            entries: &[
                entry(0, uniforms.as_entire_binding()),
                entry(1, wgpu::BindingResource::TextureView(maps)),
                entry(2, wgpu::BindingResource::Sampler(&self.sampler)),
            ],
        })
    }
}

fn texture(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shadow/maps"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH_FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}

/// All layers, as shaders read them.
fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// One layer, as it is drawn.
fn layer_view(texture: &wgpu::Texture, layer: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}
