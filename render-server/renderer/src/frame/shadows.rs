//! The shadows of a frame: the maps of directional, point and spot lights, and their bindings.

use polyptych_wall::ShadowFilter;

use super::FrameResources;
use super::begun_frame::ShownView;
use super::lamp_shadows::LampMaps;
use super::map_set::{Subject, array_view, texture};
use super::map_sets::{MapOrders, MapSets};
use super::sun_shadows::SunMaps;
use crate::DrawError;
use crate::bindings;
use crate::gpu::Gpu;
use crate::lamp_map::LampShadowRecord;
use crate::pass::shadow::CasterPass;
use crate::scene::GpuScene;
use crate::shadow_cascades::MAP_SIDE;
use crate::shadow_uniform::ShadowUniform;
use crate::view::ViewDesc;

/// The maps of a frame.
#[derive(Debug, Default)]
pub(super) struct FrameShadows {
    /// The bindings of each view; empty where no light casts shadows.
    pub groups: Vec<wgpu::BindGroup>,
    /// Maps that were drawn anew.
    pub drawn: u32,
}

/// The maps of a view.
#[derive(Debug, Default)]
struct ViewMaps {
    /// The set, and the maps.
    suns: Option<(usize, SunMaps)>,
    /// The set.
    lamps: Option<usize>,
}

/// The bindings of a view: maps of suns, and the records and maps of lamps if a scene has any.
struct Bound<'a> {
    suns: &'a wgpu::TextureView,
    uniform: ShadowUniform,
    lamps: Option<(&'a wgpu::Buffer, &'a wgpu::TextureView)>,
}

/// The maps of all cameras, and the pass that draws them.
#[derive(Debug)]
pub(crate) struct Shadows {
    sampler: wgpu::Sampler,
    /// One map of one texel, for views without shadows; made where one is needed.
    none: Option<wgpu::TextureView>,
    suns: MapSets,
    lamps: MapSets,
    pub filter: ShadowFilter,
}

impl Shadows {
    /// Sets how edges look; maps of another filter have other borders, and are drawn anew.
    pub fn set_filter(&mut self, filter: ShadowFilter) {
        if std::mem::replace(&mut self.filter, filter) != filter {
            (self.suns, self.lamps) = (MapSets::default(), MapSets::default());
        }
    }

    pub fn new(gpu: &Gpu) -> Self {
        Self {
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow/sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            none: None,
            suns: MapSets::default(),
            lamps: MapSets::default(),
            filter: ShadowFilter::default(),
        }
    }

    /// Bytes of the maps of suns, and of those of lamps.
    #[cfg(test)]
    pub fn held_bytes(&self) -> [u64; 2] {
        [self.suns.bytes(), self.lamps.bytes()]
    }

    /// Makes what a scene needs beside pipelines; nothing for one without lights that cast shadows.
    pub fn prepare(&mut self, gpu: &Gpu, scene: &GpuScene) {
        if scene.layout.lights.has_shadows() {
            let none = || array_view(&texture(gpu, [1, 1], wgpu::TextureUsages::TEXTURE_BINDING));
            self.none.get_or_insert_with(none);
        }
    }

    /// The bindings that pipelines are warmed with: no shadows.
    pub(super) fn none(&self, gpu: &Gpu, scene: &GpuScene) -> Vec<wgpu::BindGroup> {
        let is_used = self.filter != ShadowFilter::Off && scene.layout.lights.has_shadows();
        let maps = self.none.as_ref().filter(|_| is_used);
        let no_lamps = no_lamp_records(gpu, scene);
        let group = |suns| {
            let lamps = no_lamps.as_ref().map(|records| (records, suns));
            self.group(gpu, &Bound { suns, uniform: ShadowUniform::none(), lamps })
        };
        maps.map(group).into_iter().collect()
    }

    /// Draws the maps that views need and that are not there yet.
    ///
    /// # Errors
    /// More casts shadows than is held for one frame, or the scene was not prepared.
    pub(super) fn draw(
        &mut self,
        (frames, casters): (&mut FrameResources, &CasterPass),
        gpu: &Gpu,
        scene: &GpuScene,
        shown: &[ShownView],
    ) -> Result<FrameShadows, DrawError> {
        let begins_round = std::mem::take(&mut frames.begins_round);
        self.suns.begin_frame(begins_round);
        self.lamps.begin_frame(begins_round);
        if self.filter == ShadowFilter::Off || !scene.layout.lights.has_shadows() {
            return Ok(FrameShadows::default());
        }
        let none = self.none.clone().ok_or(DrawError::NotPrepared)?;
        let (mut suns, mut lamps) = (MapOrders::default(), MapOrders::default());
        let mut of_views = Vec::with_capacity(shown.len());
        for (index, (view, _)) in shown.iter().enumerate() {
            of_views.push(self.maps_of(gpu, scene, (index, view), [&mut suns, &mut lamps]));
        }
        self.suns.draw((&mut *frames, casters), gpu, scene, (shown, &suns))?;
        self.lamps.draw((frames, casters), gpu, scene, (shown, &lamps))?;
        let no_lamps = no_lamp_records(gpu, scene);
        let groups = shown.iter().zip(&of_views).map(|((view, _), of)| {
            let (maps, uniform) = match &of.suns {
                Some((set, suns)) => (&self.suns.get(*set).all, ShadowUniform::new(view, &suns.0)),
                None => (&none, ShadowUniform::new(view, &[])),
            };
            let lamps = of.lamps.map(|set| self.lamps.get(set));
            let own = lamps.and_then(|set| Some((set.records.as_ref()?, &set.all)));
            let lamps = own.or(no_lamps.as_ref().map(|records| (records, &none)));
            self.group(gpu, &Bound { suns: maps, uniform, lamps })
        });
        let drawn = (suns.len() + lamps.len()) as u32;
        Ok(FrameShadows { groups: groups.collect(), drawn })
    }

    /// The maps of a view, and orders for those that are not drawn yet; none if it has no shadows.
    fn maps_of(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        (index, view): (usize, &ViewDesc),
        [sun_orders, lamp_orders]: [&mut MapOrders; 2],
    ) -> ViewMaps {
        if !view.has_shadows {
            return ViewMaps::default();
        }
        let subject = Subject::new(scene, view);
        let known = self.suns.extent_of(&subject).or_else(|| self.lamps.extent_of(&subject));
        let part = scene.layout.tree.select(&view.subset);
        let extent = known.unwrap_or_else(|| scene.shadowed_extent(part).rounded_out());
        let of = (&subject, extent);
        let suns = SunMaps::new(scene, view, &extent).map(|suns| {
            let wanted = suns.by_layer();
            let wanted = (&wanted[..], MAP_SIDE);
            let set = self.suns.find((gpu, scene), of, wanted, (index, view, sun_orders));
            (set, suns)
        });
        let lamps = LampMaps::new(scene, view, &extent, self.filter);
        let lamps = lamps.filter(|_| gpu.has_lamp_maps()).map(|lamps| {
            let wanted = (&lamps.maps[..], lamps.side);
            let set = self.lamps.find((gpu, scene), of, wanted, (index, view, lamp_orders));
            let records = &mut self.lamps.get_mut(set).records;
            records.get_or_insert_with(|| record_buffer(gpu, &lamps.records));
            set
        });
        ViewMaps { suns, lamps }
    }

    fn group(&self, gpu: &Gpu, bound: &Bound<'_>) -> wgpu::BindGroup {
        use wgpu::util::DeviceExt;
        let uniforms = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("shadow/uniforms"),
            contents: bytemuck::bytes_of(&bound.uniform),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let mut entries = vec![
            entry(0, uniforms.as_entire_binding()),
            entry(1, wgpu::BindingResource::TextureView(bound.suns)),
            entry(2, wgpu::BindingResource::Sampler(&self.sampler)),
        ];
        if let Some((records, maps)) = bound.lamps {
            entries.push(entry(3, records.as_entire_binding()));
            entries.push(entry(4, wgpu::BindingResource::TextureView(maps)));
        }
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow/group"),
            layout: &bindings::shadow_layout(&gpu.device, bound.lamps.is_some()),
            entries: &entries,
        })
    }
}

/// Records of lamps without shadows; `None` if the scene has no lamp that casts any, or the GPU no
/// maps for them.
fn no_lamp_records(gpu: &Gpu, scene: &GpuScene) -> Option<wgpu::Buffer> {
    let is_used = scene.layout.lights.has_lamp_shadows && gpu.has_lamp_maps();
    is_used.then(|| record_buffer(gpu, &vec![LampShadowRecord::default(); scene.lamps().len()]))
}

fn record_buffer(gpu: &Gpu, records: &[LampShadowRecord]) -> wgpu::Buffer {
    use wgpu::util::DeviceExt;
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("shadow/lamps"),
        contents: bytemuck::cast_slice(records),
        usage: wgpu::BufferUsages::STORAGE,
    })
}
