//! Brings a scene to the GPU piece by piece, as its meshes and textures arrive.

use std::collections::HashMap;

use super::description::{
    AlphaMode, ContentName, MaterialDesc, PrimitiveDesc, SamplerDesc, SceneDesc, TextureDesc,
    Topology,
};
use super::geometry::{self, Geometry};
use super::light::{GROUND, Lights};
use super::placement::{self, Bounds, Placement};
use super::tree::Tree;
use super::{Batch, Scene, material, texture};
use crate::renderer::gpu::Gpu;
use crate::renderer::pipeline::{Alpha, Cull, PipelineKey};

/// Why a scene cannot be brought to the GPU.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// An index points nowhere, or a number is out of bounds.
    #[error("the scene's description is wrong: {0}")]
    Description(String),
    /// The bytes are not those of the description.
    #[error("{what} has {got} bytes, where its description says {wanted}")]
    Size {
        /// Which texture or primitive.
        what: String,
        /// Bytes given.
        got: u64,
        /// Bytes described.
        wanted: u64,
    },
    /// An index in the data points behind the vertices.
    #[error("{what} has the index {index}, but only {vertex_count} vertices")]
    Index {
        /// Which primitive.
        what: String,
        /// The largest index.
        index: u32,
        /// Vertices there are.
        vertex_count: u32,
    },
    /// Not everything has been uploaded.
    #[error("not uploaded yet: {0}")]
    Missing(String),
    /// The adapter could not take it.
    #[error("the GPU did not take {what}: {reason}")]
    Gpu {
        /// What was being made.
        what: String,
        /// In the driver's words.
        reason: String,
    },
}

/// Slots that stay empty until their bytes come; equal contents have one slot.
#[derive(Debug)]
struct Slots<T> {
    /// Slot of each described thing, in the order of the description.
    of: Vec<usize>,
    filled: Vec<Option<T>>,
}

impl<T> Slots<T> {
    fn new<K: std::hash::Hash + Eq>(names: impl Iterator<Item = Option<K>>) -> Self {
        let (mut of, mut count) = (Vec::new(), 0);
        let mut known = HashMap::new();
        for name in names {
            let next = count;
            let slot = name.map_or(next, |name| *known.entry(name).or_insert(next));
            count += usize::from(slot == next);
            of.push(slot);
        }
        Self { of, filled: (0..count).map(|_| None).collect() }
    }

    fn first_missing(&self) -> Option<usize> {
        self.of.iter().position(|&slot| self.filled[slot].is_none())
    }
}

/// A scene under way to the GPU.
#[derive(Debug)]
pub struct SceneBuilder {
    desc: SceneDesc,
    textures: Slots<wgpu::TextureView>,
    geometries: Slots<Geometry>,
    /// Index of each mesh's first primitive in the order of all primitives.
    first_primitive: Vec<usize>,
}

impl SceneBuilder {
    /// Checks the description and makes room.
    ///
    /// # Errors
    /// An index points nowhere, a parent stands behind its child, a number is out of bounds.
    pub fn new(gpu: &Gpu, desc: SceneDesc) -> Result<Self, SceneError> {
        let limits = gpu.device.limits();
        if let Some(fault) = fault(&desc, limits.max_texture_dimension_2d, limits.max_buffer_size) {
            return Err(SceneError::Description(fault));
        }
        let texture_name =
            |t: &TextureDesc| t.content.map(|c| (c, t.srgb, t.width, t.height, t.mip_count));
        let textures = Slots::new(desc.textures.iter().map(texture_name));
        let mut first_primitive = Vec::new();
        let mut count = 0;
        for mesh in &desc.meshes {
            first_primitive.push(count);
            count += mesh.primitives.len();
        }
        let primitives = desc.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let geometries = Slots::new(primitives.map(geometry_name));
        Ok(Self { desc, textures, geometries, first_primitive })
    }

    /// Uploads a texture; does nothing where an equal one is there already.
    ///
    /// # Errors
    /// No such texture, or not the described number of bytes.
    pub fn upload_texture(
        &mut self,
        gpu: &Gpu,
        index: usize,
        bytes: &[u8],
    ) -> Result<(), SceneError> {
        let what = format!("texture {index}");
        let desc = self.desc.textures.get(index).ok_or_else(|| nowhere(&what))?;
        check_size(&what, bytes, desc.bytes())?;
        let slot = &mut self.textures.filled[self.textures.of[index]];
        if slot.is_none() {
            *slot = Some(texture::upload(gpu, desc, bytes));
        }
        Ok(())
    }

    /// Uploads a primitive's vertices and indices; does nothing where equal ones are there.
    ///
    /// # Errors
    /// No such primitive, not the described number of bytes, or an index behind the vertices.
    pub fn upload_primitive(
        &mut self,
        gpu: &Gpu,
        mesh: usize,
        primitive: usize,
        bytes: &[u8],
    ) -> Result<(), SceneError> {
        let what = format!("primitive {primitive} of mesh {mesh}");
        let in_mesh = self.desc.meshes.get(mesh).and_then(|m| m.primitives.get(primitive));
        let desc = in_mesh.ok_or_else(|| nowhere(&what))?;
        check_size(&what, bytes, desc.bytes())?;
        let slot = self.geometries.of[self.first_primitive[mesh] + primitive];
        if self.geometries.filled[slot].is_some() {
            return Ok(());
        }
        if let Some(index) = geometry::index_beyond(desc, bytes) {
            return Err(SceneError::Index { what, index, vertex_count: desc.vertex_count });
        }
        let geometry = Geometry::upload(gpu, desc, bytes)
            .map_err(|reason| SceneError::Gpu { what, reason })?;
        self.geometries.filled[slot] = Some(geometry);
        Ok(())
    }

    /// Places everything in the world.
    ///
    /// # Errors
    /// A mesh or a texture has not been uploaded.
    pub fn finish(self, gpu: &Gpu) -> Result<Scene, SceneError> {
        if let Some(index) = self.textures.first_missing() {
            return Err(SceneError::Missing(format!("texture {index}")));
        }
        if let Some(index) = self.geometries.first_missing() {
            let mesh = self.first_primitive.partition_point(|&first| first <= index) - 1;
            let primitive = index - self.first_primitive[mesh];
            return Err(SceneError::Missing(format!("primitive {primitive} of mesh {mesh}")));
        }
        let world = placement::world_from_nodes(&self.desc.nodes);
        let placements = placement::place(&self.desc, &world);
        let mut lights = Lights::new(&self.desc, &world);
        let mut sorter = Sorter::new(&self, &lights, &placements);
        let mut items = Vec::with_capacity(placements.len());
        for placement in &placements {
            let lamps = lights.reaching(placement);
            let mesh_box =
                self.first_primitive[placement.mesh as usize] as u32 + placement.primitive;
            items.push(placement.item(sorter.batch_of(&self, placement), mesh_box, lamps));
        }
        let bounds: Vec<Bounds> = placements.iter().map(|placement| placement.bounds).collect();
        let (batches, keys, blends) = (sorter.batches, sorter.keys, sorter.template.linear);
        let lamp_indices = index_buffer(gpu, &lights.indices);
        let materials = self.materials(gpu);
        Ok(Scene {
            tree: Tree::new(&bounds),
            items,
            bounds,
            mesh_boxes: placement::mesh_boxes(&self.desc),
            batches,
            keys,
            geometries: self.geometries.filled.into_iter().flatten().collect(),
            materials,
            lights,
            lamp_indices,
            sky: self.desc.sky,
            ground: self.desc.ground.unwrap_or(self.desc.sky * GROUND),
            blends,
        })
    }

    fn materials(&self, gpu: &Gpu) -> Vec<wgpu::BindGroup> {
        let mut known = HashMap::new();
        let mut sampler =
            |desc| known.entry(desc).or_insert_with(|| texture::sampler(gpu, desc)).clone();
        let described = self.desc.textures.iter().map(|texture| texture.sampler);
        let samplers: Vec<_> =
            described.chain([SamplerDesc::default()]).map(&mut sampler).collect();
        let view = |&slot: &usize| self.textures.filled[slot].clone();
        let uploaded = self.textures.of.iter().filter_map(view);
        let views: Vec<_> = uploaded.chain([texture::placeholder(gpu)]).collect();
        material::bind_groups(gpu, &self.desc, &views, &samplers)
    }
}

/// Finds the batch of each placement, and collects the pipelines that they need.
struct Sorter {
    default_material: MaterialDesc,
    /// What all pipelines of the scene have in common.
    template: Template,
    batches: Vec<Batch>,
    keys: Vec<PipelineKey>,
    known: HashMap<(usize, u32, bool), u32>,
}

struct Template {
    sun_count: u8,
    lamps: bool,
    linear: bool,
}

impl Sorter {
    fn new(builder: &SceneBuilder, lights: &Lights, placements: &[Placement]) -> Self {
        let blends = |placement: &Placement| {
            let material = builder.primitive(placement).material;
            let material = material.and_then(|m| builder.desc.materials.get(m as usize));
            material.is_some_and(|material| material.alpha_mode == AlphaMode::Blend)
        };
        let template = Template {
            sun_count: lights.suns.len() as u8,
            lamps: !lights.lamps.is_empty(),
            linear: placements.iter().any(blends),
        };
        Self {
            default_material: MaterialDesc::default(),
            template,
            batches: Vec::new(),
            keys: Vec::new(),
            known: HashMap::new(),
        }
    }

    fn batch_of(&mut self, builder: &SceneBuilder, placement: &Placement) -> u32 {
        let primitive = builder.primitive(placement);
        let first = builder.first_primitive[placement.mesh as usize];
        let geometry = builder.geometries.of[first + placement.primitive as usize];
        // The default material stands behind all others.
        let material = primitive.material.unwrap_or(builder.desc.materials.len() as u32);
        let mirrored = placement.mirrored();
        let next = self.batches.len() as u32;
        let index = *self.known.entry((geometry, material, mirrored)).or_insert(next);
        if index == next {
            let desc = builder.desc.materials.get(material as usize);
            let features =
                material::features(desc.unwrap_or(&self.default_material), primitive.layout);
            let batch = self.batch(primitive, features, mirrored);
            self.batches.push(Batch { geometry: geometry as u32, material, ..batch });
        }
        let batch = &mut self.batches[index as usize];
        batch.bounds = batch.bounds.union(placement.bounds);
        index
    }

    fn batch(
        &mut self,
        primitive: &PrimitiveDesc,
        features: crate::renderer::pipeline::MaterialFeatures,
        mirrored: bool,
    ) -> Batch {
        let blended = features.alpha == Alpha::Blend;
        let key = PipelineKey {
            layout: primitive.layout,
            topology: primitive.topology,
            material: features,
            cull: if features.double_sided { Cull::Nothing } else { Cull::Back },
            mirrored,
            sun_count: self.template.sun_count,
            lamps: self.template.lamps,
            linear: self.template.linear,
        };
        let two_passes =
            blended && features.double_sided && primitive.topology == Topology::Triangles;
        let (pipeline, back_pipeline) = if two_passes {
            let back = self.key_index(PipelineKey { cull: Cull::Front, ..key });
            (self.key_index(PipelineKey { cull: Cull::Back, ..key }), Some(back))
        } else {
            (self.key_index(key), None)
        };
        Batch {
            geometry: 0,
            material: 0,
            pipeline,
            back_pipeline,
            blended,
            bounds: Bounds::EMPTY,
            triangles: primitive.triangles(),
        }
    }

    fn key_index(&mut self, key: PipelineKey) -> u32 {
        let known = self.keys.iter().position(|one| *one == key);
        known.unwrap_or_else(|| {
            self.keys.push(key);
            self.keys.len() - 1
        }) as u32
    }
}

impl SceneBuilder {
    fn primitive(&self, placement: &Placement) -> &PrimitiveDesc {
        &self.desc.meshes[placement.mesh as usize].primitives[placement.primitive as usize]
    }
}

fn geometry_name(p: &PrimitiveDesc) -> Option<(ContentName, impl std::hash::Hash + Eq + use<>)> {
    let rest = (p.layout, p.vertex_count, p.index_count, p.wide_indices);
    p.content.map(|content| (content, rest))
}

fn nowhere(what: &str) -> SceneError {
    SceneError::Description(format!("there is no {what}"))
}

fn check_size(what: &str, bytes: &[u8], wanted: u64) -> Result<(), SceneError> {
    let got = bytes.len() as u64;
    if got == wanted {
        Ok(())
    } else {
        Err(SceneError::Size { what: what.to_owned(), got, wanted })
    }
}

fn index_buffer(gpu: &Gpu, indices: &[u32]) -> wgpu::Buffer {
    // A binding must hold at least one element.
    let indices = if indices.is_empty() { &[0] } else { indices };
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("frame/lamp_indices"),
        size: size_of_val(indices) as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(indices));
    buffer
}

/// What is wrong with a description, if anything.
fn fault(desc: &SceneDesc, side_max: u32, buffer_max: u64) -> Option<String> {
    let beyond = |index: Option<u32>, len: usize| index.is_some_and(|i| i as usize >= len);
    for (i, node) in desc.nodes.iter().enumerate() {
        if beyond(node.parent, i) {
            return Some(format!("node {i} stands before its parent"));
        }
        if beyond(node.mesh, desc.meshes.len()) || beyond(node.light, desc.lights.len()) {
            return Some(format!("node {i} names a mesh or light that is not there"));
        }
        if !node.local.is_finite() {
            return Some(format!("node {i} has a transform that is not finite"));
        }
    }
    for (i, mesh) in desc.meshes.iter().enumerate() {
        for primitive in &mesh.primitives {
            if beyond(primitive.material, desc.materials.len()) {
                return Some(format!("mesh {i} names a material that is not there"));
            }
            if primitive.index_count == 0 || primitive.vertex_count == 0 {
                return Some(format!("mesh {i} has a primitive of nothing"));
            }
            if primitive.bytes() > buffer_max {
                let bytes = primitive.bytes();
                return Some(format!("mesh {i}: {bytes} bytes, where {buffer_max} can be"));
            }
        }
    }
    for (i, material) in desc.materials.iter().enumerate() {
        let uses = material.texture_uses();
        if uses.iter().flatten().any(|one| one.texture as usize >= desc.textures.len()) {
            return Some(format!("material {i} names a texture that is not there"));
        }
    }
    desc.textures.iter().enumerate().find_map(|(i, texture)| {
        let (width, height) = (texture.width, texture.height);
        if !(1..=side_max).contains(&width) || !(1..=side_max).contains(&height) {
            return Some(format!("texture {i}: {width} × {height}, where 1 to {side_max} can be"));
        }
        let levels_max = width.max(height).ilog2() + 1;
        let wrong = !(1..=levels_max).contains(&texture.mip_count);
        wrong
            .then(|| format!("texture {i}: {} levels, 1 to {levels_max} can be", texture.mip_count))
    })
}
