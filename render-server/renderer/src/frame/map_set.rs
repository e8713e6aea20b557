//! The maps of one view, which are layers of one texture.
//!
//! Where something moves, the map without it is kept beside the layer. Only what moves is drawn
//! anew then, over a copy of that: depth is the nearest of all, in whatever order it is drawn, so
//! the map is the same to the bit as one that is drawn whole. Maps that nothing moves in stay.

use glam::DAffine3;
use polyptych_scene::SceneSubset;

use super::shadow_map::ShadowMap;
use crate::draw_list::{ShadowItems, VisibleItems};
use crate::gpu::Gpu;
use crate::scene::{Billboard, Bounds, GpuScene, SceneIdentity};
use crate::target::DEPTH_FORMAT;
use crate::view::ViewDesc;

/// The surfaces in the maps of a view, whatever the places of the maps are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Subject {
    pub scene: SceneIdentity,
    subset: SceneSubset,
    /// The turns of billboards, which follow the camera.
    pub turns: Vec<DAffine3>,
}

/// The content of a layer.
#[derive(Debug, Default)]
struct Layer {
    /// `None` until it is drawn.
    map: Option<ShadowMap>,
    /// The moment of the set for which it is right.
    moment: u64,
    /// It has what moves, too.
    has_moving: bool,
}

/// A map without what moves.
#[derive(Debug)]
pub(super) struct StillMap {
    /// `None` until it is drawn.
    pub map: Option<ShadowMap>,
    /// Anything that stands still receives shadows from it.
    pub receives: bool,
    pub depths: wgpu::Texture,
}

/// What is to be drawn of a map.
pub(super) enum MapWork {
    /// What stands still.
    Still,
    /// These items, over what stands still.
    Moving(Box<VisibleItems>),
}

/// The maps of one view.
#[derive(Debug)]
pub(super) struct MapSet {
    subject: Subject,
    /// A number that grows with each change of the subject.
    moment: u64,
    /// The box of all that the view may show.
    extent: Bounds,
    /// Texels along each side of each.
    side: u32,
    layers: Vec<Layer>,
    /// By layer; `None` where nothing has moved yet.
    still: Vec<Option<StillMap>>,
    /// By layer.
    maps: Vec<wgpu::TextureView>,
    pub all: wgpu::TextureView,
    /// The records of lamps that shaders read; made when they are needed.
    pub records: Option<wgpu::Buffer>,
    /// The number of the frame that used it last.
    pub used: u64,
}

impl Subject {
    pub fn new(scene: &GpuScene, view: &ViewDesc) -> Self {
        Self {
            scene: SceneIdentity::new(scene),
            subset: view.subset.clone(),
            turns: Billboard::turns(scene.billboards(), view),
        }
    }

    /// Returns whether what stands still is the same in both.
    fn stands_as(&self, other: &Self) -> bool {
        self.scene.stands_as(&other.scene) && self.subset == other.subset
    }
}

impl MapSet {
    /// Makes a set of so many maps, of so many texels along each side.
    pub fn new(gpu: &Gpu, (subject, extent): (&Subject, Bounds), side: u32, count: usize) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let texture = texture(gpu, [side, count as u32], usage);
        Self {
            subject: subject.clone(),
            moment: 0,
            extent,
            side,
            layers: (0..count).map(|_| Layer::default()).collect(),
            still: (0..count).map(|_| None).collect(),
            maps: (0..count as u32).map(|layer| layer_view(&texture, layer)).collect(),
            all: array_view(&texture),
            records: None,
            used: 0,
        }
    }

    /// Makes a set that has as good as no memory, and no map that anything wants.
    pub fn empty(gpu: &Gpu, of: (&Subject, Bounds)) -> Self {
        Self::new(gpu, of, 1, 1)
    }

    /// Returns whether it was made empty.
    pub fn is_empty(&self) -> bool {
        self.side == 1
    }

    /// Bytes of its maps, without those of what stands still.
    pub fn bytes(&self) -> u64 {
        Self::bytes_of(self.side, self.layers.len())
    }

    /// Bytes of so many maps, of so many texels along each side.
    pub fn bytes_of(side: u32, count: usize) -> u64 {
        u64::from(side).pow(2) * (count * size_of::<f32>()) as u64
    }

    /// Returns whether it has so many maps of this size, no more and no less.
    pub fn has_size(&self, side: u32, count: usize) -> bool {
        self.side == side && self.layers.len() == count
    }

    /// Returns the numbers of maps that it has already, for this moment and for any; `None` if it
    /// is of other surfaces.
    pub fn equal_to(
        &self,
        subject: &Subject,
        (wanted, side): (&[ShadowMap], u32),
    ) -> Option<[usize; 2]> {
        let fits = self.side == side && self.layers.len() >= wanted.len();
        if !fits || !self.subject.stands_as(subject) {
            return None;
        }
        let equal = wanted.iter().zip(&self.layers).filter(|(map, of)| of.map == Some(**map));
        let is_now = self.subject == *subject;
        let now = equal.clone().filter(|(_, of)| is_now && of.moment == self.moment).count();
        Some([now, equal.count()])
    }

    /// The box of all that a view of a subject may show, if it knows it.
    pub fn extent_of(&self, subject: &Subject) -> Option<Bounds> {
        (self.subject == *subject).then_some(self.extent)
    }

    /// The subject of its maps.
    pub fn subject(&self) -> &Subject {
        &self.subject
    }

    /// Sets what its maps are of. They are not drawn yet if what stands still has changed.
    pub fn set_subject(&mut self, subject: &Subject, extent: Bounds) {
        if self.subject == *subject {
            return;
        }
        if !self.subject.stands_as(subject) {
            self.layers.fill_with(Layer::default);
            self.still.iter_mut().flatten().for_each(|still| still.map = None);
        }
        (self.subject, self.extent, self.records) = (subject.clone(), extent, None);
        self.moment += 1;
    }

    /// Returns what must be drawn so that a layer has a map, which then counts as drawn; `None` if
    /// it has it.
    pub fn work_on(
        &mut self,
        scene: &GpuScene,
        camera: &ViewDesc,
        (layer, map): (usize, &ShadowMap),
    ) -> Option<MapWork> {
        let has_map = self.layers[layer].map == Some(*map);
        if has_map && self.layers[layer].moment == self.moment {
            return None;
        }
        let of = (ShadowItems::Moving, &self.subject.turns[..]);
        let moving = scene.has_moving().then(|| map.casting(scene, camera, of));
        let moving = moving.filter(|(items, receives)| *receives || !items.items.is_empty());
        let has_moving = moving.is_some();
        let now = Layer { map: Some(*map), moment: self.moment, has_moving };
        let before = std::mem::replace(&mut self.layers[layer], now);
        let Some((moving, receives)) = moving else {
            return (!has_map || before.has_moving).then_some(MapWork::Still);
        };
        let still = self.still[layer].as_ref();
        let is_read = receives || still.is_none_or(|of| of.map != Some(*map) || of.receives);
        is_read.then(|| MapWork::Moving(Box::new(moving)))
    }

    /// Forgets that a layer was drawn, and its map without what moves.
    pub fn forget(&mut self, layer: usize) {
        self.layers[layer] = Layer::default();
        if let Some(still) = &mut self.still[layer] {
            still.map = None;
        }
    }

    /// A layer, as it is drawn.
    pub fn map(&self, layer: usize) -> &wgpu::TextureView {
        &self.maps[layer]
    }

    /// The map without what moves of a layer, if it is this one and drawn.
    pub fn still(&self, layer: usize, map: &ShadowMap) -> Option<&StillMap> {
        self.still[layer].as_ref().filter(|still| still.map == Some(*map))
    }

    /// Makes room for the map without what moves of a layer, and notes that it is this one.
    pub fn begin_still(
        &mut self,
        gpu: &Gpu,
        (layer, map, receives): (usize, &ShadowMap, bool),
    ) -> wgpu::TextureView {
        let make = || {
            let usage = wgpu::TextureUsages::COPY_SRC;
            StillMap { map: None, receives, depths: texture(gpu, [self.side, 1], usage) }
        };
        let still = self.still[layer].get_or_insert_with(make);
        (still.map, still.receives) = (Some(*map), receives);
        layer_view(&still.depths, 0)
    }

    /// Copies the map without what moves into its layer, if there is one.
    pub fn copy_still(&self, encoder: &mut wgpu::CommandEncoder, layer: usize) {
        let Some(still) = &self.still[layer] else { return };
        let mut to = self.all.texture().as_image_copy();
        to.origin.z = layer as u32;
        let size = wgpu::Extent3d { width: self.side, height: self.side, depth_or_array_layers: 1 };
        encoder.copy_texture_to_texture(still.depths.as_image_copy(), to, size);
    }
}

/// Maps of so many texels along each side, and their number, that can be drawn and used so.
pub(super) fn texture(
    gpu: &Gpu,
    [side, layers]: [u32; 2],
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    let layers = gpu.array_layers(layers);
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shadow/maps"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH_FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
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
