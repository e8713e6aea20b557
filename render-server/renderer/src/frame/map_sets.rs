//! Maps of shadows that are kept from frame to frame: in sets, which are layers of one texture, and
//! drawn where they are not those of a frame before.
//!
//! They are drawn as a frame is submitted, after those that were submitted before: the queue does
//! one after the other, so a map that is drawn anew is read by no frame before.

use glam::{DAffine3, DVec3};
use polyptych_scene::SceneSubset;

use super::begun_frame::ShownView;
use super::{FrameResources, check_records};
use crate::DrawError;
use crate::draw_list::{DrawList, VisibleItems};
use crate::error_tolerance::ErrorTolerance;
use crate::gpu::Gpu;
use crate::lamp_map::LampMap;
use crate::pass::shadow::{self, ShadowPass};
use crate::scene::{Billboard, Bounds, GpuScene, SceneIdentity};
use crate::shadow_cascades::Cascade;
use crate::target::DEPTH_FORMAT;
use crate::view::ViewDesc;

/// Maps that were not used in so many frames of channels leave their memory.
const KEPT_FRAMES: u64 = 256;

/// Maximum number of maps that are drawn by one submission: each has the uniforms of a view.
const MAPS_TOGETHER_MAX: usize = 16;

/// Primitives from which on a submission takes no further map: a quarter of what a frame may have,
/// and a map has no more than half of that.
const RECORDS_TOGETHER: usize = super::RECORDS_MAX / 4;

/// A map: all that its depths depend on, but for the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ShadowMap {
    Sun(Cascade),
    Lamp(LampMap),
}

/// The surfaces in the maps of a view, whatever the places of the maps are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Subject {
    scene: SceneIdentity,
    subset: SceneSubset,
    /// The turns of billboards, which follow the camera.
    turns: Vec<DAffine3>,
}

/// The maps of one view.
#[derive(Debug)]
pub(super) struct MapSet {
    subject: Subject,
    /// The box of all that the view may show.
    extent: Bounds,
    /// Texels along each side of each.
    side: u32,
    /// By layer; `None` until it is drawn.
    drawn: Vec<Option<ShadowMap>>,
    /// By layer.
    maps: Vec<wgpu::TextureView>,
    pub all: wgpu::TextureView,
    /// The records of lamps that shaders read; made when they are needed.
    pub records: Option<wgpu::Buffer>,
    /// The number of the frame that used it last.
    used: u64,
}

/// A map that is to be drawn.
struct Order {
    /// The view that it is drawn for.
    view: usize,
    set: usize,
    layer: usize,
    map: ShadowMap,
}

/// All sets of one kind of lights.
#[derive(Debug, Default)]
pub(super) struct MapSets {
    sets: Vec<MapSet>,
    frame: u64,
}

/// Maps that a frame must draw.
#[derive(Default)]
pub(super) struct MapOrders(Vec<Order>);

impl MapOrders {
    /// Returns the number of maps.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

impl ShadowMap {
    /// The view that draws the map, of what a camera shows.
    fn view(&self, camera: &ViewDesc) -> ViewDesc {
        match self {
            Self::Sun(cascade) => cascade.view(camera),
            Self::Lamp(map) => map.view(camera),
        }
    }

    /// The errors up to which coarser levels of detail are drawn.
    fn tolerance(&self, camera: &ViewDesc) -> ErrorTolerance {
        match self {
            Self::Sun(cascade) => ErrorTolerance::new(&cascade.levels.view(camera)),
            Self::Lamp(map) => ErrorTolerance::new(&map.view(camera)),
        }
    }

    /// A sphere around all places that the map is for, in world space.
    fn receivers(&self) -> (DVec3, f64) {
        match self {
            Self::Sun(cascade) => cascade.around,
            Self::Lamp(map) => map.reached(),
        }
    }

    /// Finds the items that it has, with the turns of billboards.
    fn casting(&self, scene: &GpuScene, camera: &ViewDesc, turns: &[DAffine3]) -> VisibleItems {
        let (tolerance, turns) = (self.tolerance(camera), turns.to_vec());
        let (light, receivers) = (self.view(camera), self.receivers());
        let mut casting = VisibleItems::casting(scene, &light, (tolerance, turns), receivers);
        if let Self::Lamp(map) = self {
            casting.keep_casting(scene, map.reached());
        }
        casting
    }
}

impl Subject {
    pub fn new(scene: &GpuScene, view: &ViewDesc) -> Self {
        Self {
            scene: SceneIdentity::new(scene),
            subset: view.subset.clone(),
            turns: Billboard::turns(scene.billboards(), view),
        }
    }
}

impl MapSets {
    /// Begins a frame: leaves what was not used for long, or is of a scene that is gone.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        let kept = self.frame.saturating_sub(KEPT_FRAMES);
        self.sets.retain(|set| set.used >= kept && !set.subject.scene.is_gone());
    }

    /// The box of all that a view of a subject may show, if a set knows it.
    pub fn extent_of(&self, subject: &Subject) -> Option<Bounds> {
        self.sets.iter().find(|set| set.subject == *subject).map(|set| set.extent)
    }

    pub fn get(&self, set: usize) -> &MapSet {
        &self.sets[set]
    }

    pub fn get_mut(&mut self, set: usize) -> &mut MapSet {
        &mut self.sets[set]
    }

    /// The set that has most of these maps already, by layer, and is not used in this frame for
    /// others. Those that it lacks are ordered for a view.
    pub fn find(
        &mut self,
        gpu: &Gpu,
        (subject, extent): (&Subject, Bounds),
        (wanted, side): (&[ShadowMap], u32),
        (view, orders): (usize, &mut MapOrders),
    ) -> usize {
        let set = self.set_of(gpu, (subject, extent), (wanted, side));
        let drawn = &mut self.sets[set].drawn;
        for (layer, map) in wanted.iter().enumerate() {
            if drawn[layer].replace(*map) != Some(*map) {
                orders.0.push(Order { view, set, layer, map: *map });
            }
        }
        set
    }

    fn set_of(
        &mut self,
        gpu: &Gpu,
        (subject, extent): (&Subject, Bounds),
        (wanted, side): (&[ShadowMap], u32),
    ) -> usize {
        let layers = wanted.len();
        let equal = |set: &MapSet| {
            let is_fitting =
                set.subject == *subject && set.side == side && set.drawn.len() >= layers;
            let pairs = || wanted.iter().zip(&set.drawn);
            is_fitting.then(|| pairs().filter(|(map, drawn)| **drawn == Some(**map)).count())
        };
        let frame = self.frame;
        let is_free = |set: &MapSet, equal: usize| set.used < frame || equal == layers;
        let fitting = self.sets.iter().enumerate().filter_map(|(at, set)| {
            equal(set).filter(|equal| is_free(set, *equal)).map(|equal| (equal, at))
        });
        let found = fitting.max().map(|(_, at)| at);
        let at = found.unwrap_or_else(|| {
            // Of another place of the same camera, or of another scene: its memory is used again.
            let room = self
                .sets
                .iter()
                .position(|set| set.used < frame && set.side == side && set.drawn.len() == layers);
            let new = |all: wgpu::TextureView, maps| MapSet {
                subject: subject.clone(),
                extent,
                side,
                drawn: vec![None; layers],
                maps,
                all,
                records: None,
                used: 0,
            };
            if let Some(at) = room {
                let old = &self.sets[at];
                self.sets[at] = new(old.all.clone(), old.maps.clone());
                at
            } else {
                let texture = texture(gpu, side, layers as u32);
                let maps = (0..layers as u32).map(|layer| layer_view(&texture, layer)).collect();
                self.sets.push(new(array_view(&texture), maps));
                self.sets.len() - 1
            }
        });
        self.sets[at].used = frame;
        at
    }

    /// Draws the maps that were ordered.
    ///
    /// # Errors
    /// One map has more than is held for one frame.
    pub fn draw(
        &mut self,
        (frames, pass): (&mut FrameResources, &ShadowPass),
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &MapOrders),
    ) -> Result<(), DrawError> {
        let mut left = &orders.0[..];
        while !left.is_empty() {
            match self.encode((frames, pass), gpu, scene, (shown, left)) {
                Ok(count) => left = &left[count..],
                Err(error) => {
                    for Order { set, layer, .. } in left {
                        self.sets[*set].drawn[*layer] = None;
                    }
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Draws some of these maps, at least one, from the first on, and returns their number.
    fn encode(
        &self,
        (frames, pass): (&mut FrameResources, &ShadowPass),
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, orders): (&[ShownView], &[Order]),
    ) -> Result<usize, DrawError> {
        frames.clear_lists();
        let (mut lists, mut views) = (Vec::new(), Vec::new());
        for Order { view: index, set, map, .. } in orders.iter().take(MAPS_TOGETHER_MAX) {
            if frames.records.len() >= RECORDS_TOGETHER {
                break;
            }
            let camera = &shown[*index].0;
            let light = map.view(camera);
            let casting = map.casting(scene, camera, &self.sets[*set].subject.turns);
            let (scratch, records) = (&mut frames.scratch, &mut frames.records);
            lists.push(DrawList::new(scene, &light, (&casting, &casting.items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index: *index, reason })?;
            views.push(light);
        }
        let pipelines = pass.pipelines(&scene.layout.keys);
        let context =
            frames.context(gpu, (pipelines, None), scene, (views.iter().collect(), None), &lists);
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("shadows") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        for (at, Order { set, layer, .. }) in orders[..lists.len()].iter().enumerate() {
            let mut pass = shadow::begin(&mut encoder, &self.sets[*set].maps[*layer]);
            context.draw(&mut pass, at, &lists[at].opaque);
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(lists.len())
    }
}

/// Maps of so many texels along each side.
pub(super) fn texture(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
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
pub(super) fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
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
