//! Brings a scene to the GPU piece by piece, as its meshes and textures arrive.

use std::collections::HashMap;
use std::sync::Arc;

use polyptych_scene::deformation::Deformer;
use polyptych_scene::{Fill, Primitive, Sampler, Scene, Texture};

use super::bent_vertices::BentVertices;
use super::geometry::{self, Geometry};
use super::geometry_room::{GeometryRoom, SharedRoom};
use super::layout::SceneLayout;
use super::meshlet::Meshlets;
use super::outline::Outline;
use super::part_bounds::PartBounds;
use super::{GpuScene, Materials, material, outline, texture, triangle_order};
use crate::gpu::Gpu;

/// Why a scene cannot be brought to the GPU.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// An index points nowhere, or a number is out of bounds.
    #[error("the scene's description is wrong: {0}")]
    Description(String),
    /// A texture or a primitive is larger than this GPU holds.
    #[error("{0}")]
    TooLarge(String),
    /// The bytes are not those of the description.
    #[error("{what} has {got} bytes, where its description says {wanted}")]
    Size {
        /// The texture or primitive.
        what: String,
        /// Bytes given.
        got: u64,
        /// Bytes described.
        wanted: u64,
    },
    /// An index in the data points behind the vertices.
    #[error("{what} has the index {index}, but only {vertex_count} vertices")]
    Index {
        /// The primitive.
        what: String,
        /// The largest index.
        index: u32,
        /// Vertices there are.
        vertex_count: u32,
    },
    /// Nobody wants it any more.
    #[error("the preparation was cancelled")]
    Cancelled,
    /// Not everything has been uploaded.
    #[error("not uploaded yet: {0}")]
    Missing(String),
    /// The adapter could not take it.
    #[error("the GPU did not take {what}: {reason}")]
    Gpu {
        /// The object that was being created.
        what: String,
        /// In the driver's words.
        reason: String,
    },
}

impl SceneLayout {
    /// Returns what of it is too large for a GPU, and the way out, if anything is: textures of a
    /// longer side than `side_max` pixels, primitives of more than `bytes_max` bytes.
    pub(crate) fn size_fault(&self, side_max: u32, bytes_max: u64) -> Option<String> {
        for (i, mesh) in self.desc.meshes.iter().enumerate() {
            let sizes = mesh.primitives.iter().map(Primitive::geometry_bytes);
            if let Some(bytes) = sizes.max().filter(|bytes| *bytes > bytes_max) {
                let name = &mesh.name;
                return Some(format!(
                    "mesh {i} ({name:?}) has a primitive of {bytes} bytes, where this server's GPU \
                     holds {bytes_max} in a buffer; divide it, or draw it with another GPU"
                ));
            }
        }
        let is_too_large = |of: &&Texture| of.width.max(of.height) > side_max;
        let (i, texture) =
            self.desc.textures.iter().enumerate().find(|(_, of)| is_too_large(of))?;
        let (width, height) = (texture.width, texture.height);
        Some(format!(
            "texture {i} has {width} × {height} pixels, where this server's GPU holds {side_max} a \
             side; give it a smaller image, or draw it with another GPU"
        ))
    }
}

/// A scene under way to the GPU.
#[derive(Debug)]
pub struct SceneBuilder {
    layout: Arc<SceneLayout>,
    /// By slot; `None` until its bytes come.
    textures: Vec<Option<wgpu::TextureView>>,
    geometries: Vec<Option<Geometry>>,
    /// Edges and vertices of some of them.
    outlines: Vec<Option<Geometry>>,
    /// Bindings of materials, where they are those of a scene that is there.
    materials: Option<Arc<Materials>>,
    /// The materials of a scene that is there, some of which may be the same.
    known: Option<(Arc<SceneLayout>, Arc<Materials>)>,
    levels_left_out: u32,
    /// `None` before the first primitive came.
    room: Option<GeometryRoom>,
}

impl SceneBuilder {
    /// Checks the description and makes room.
    ///
    /// # Errors
    /// An index points nowhere, a parent stands behind its child, a number is out of bounds.
    pub fn new(gpu: &Gpu, desc: Scene) -> Result<Self, SceneError> {
        Self::of(gpu, Arc::new(SceneLayout::new(desc, &|| false)?))
    }

    /// Makes room for a scene that was laid out elsewhere, which takes seconds for a large one.
    ///
    /// # Errors
    /// It has a texture or a primitive that is too large for this GPU.
    pub fn of(gpu: &Gpu, layout: Arc<SceneLayout>) -> Result<Self, SceneError> {
        let limits = gpu.device.limits();
        let (side_max, bytes_max) = (limits.max_texture_dimension_2d, limits.max_buffer_size);
        if let Some(fault) = layout.size_fault(side_max, bytes_max) {
            return Err(SceneError::TooLarge(fault));
        }
        let textures = (0..layout.textures.count).map(|_| None).collect();
        let geometries = (0..layout.geometries.count).map(|_| None).collect();
        let outlines = layout.outlines.iter().map(|_| None).collect();
        let (materials, known, levels_left_out, room) = (None, None, 0, None);
        Ok(Self { layout, textures, geometries, outlines, materials, known, levels_left_out, room })
    }

    /// Gives each primitive a buffer of its own: memory is given back as soon as one is left out of
    /// a scene that shares the others. Else many have one, which is faster to draw.
    #[must_use]
    pub fn in_separate_buffers(self) -> Self {
        Self { room: Some(GeometryRoom::Separate), ..self }
    }

    /// Leaves the largest levels of all textures out, where smaller ones remain: each takes a
    /// quarter of the memory of the level above it.
    #[must_use]
    pub fn without_levels(self, levels_left_out: u32) -> Self {
        Self { levels_left_out, ..self }
    }

    /// Takes what it has in common with a scene that is there already.
    #[must_use]
    pub fn sharing(mut self, with: &GpuScene) -> Self {
        let textures = self.layout.shared_textures(&with.layout).into_iter();
        self.textures = textures.map(|slot| Some(with.textures[slot?].clone())).collect();
        let geometries = self.layout.shared_geometries(&with.layout).into_iter();
        self.geometries = geometries.map(|slot| Some(with.geometries[slot?].clone())).collect();
        let outlines = self.layout.shared_outlines(&with.layout).into_iter();
        self.outlines = outlines.map(|slot| Some(with.geometries[slot?].clone())).collect();
        let is_same = self.layout.has_materials_of(&with.layout)
            && self.layout.desc.textures == with.layout.desc.textures
            && with.materials.serve(&self.layout);
        self.materials = is_same.then(|| Arc::clone(&with.materials));
        self.known = Some((Arc::clone(&with.layout), Arc::clone(&with.materials)));
        self
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
        let desc = self.layout.desc.textures.get(index).ok_or_else(|| nowhere(&what))?;
        check_size(&what, bytes, desc.bytes())?;
        let slot = &mut self.textures[self.layout.textures.of[index]];
        if slot.is_none() {
            *slot = Some(texture::upload(gpu, desc, bytes, self.levels_left_out));
        }
        Ok(())
    }

    /// Uploads a primitive's vertices and indices; does nothing where equal ones are there.
    ///
    /// # Errors
    /// No such primitive, not the described number of bytes, an index behind the vertices, or
    /// meshlets that are not those of its indices.
    pub fn upload_primitive(
        &mut self,
        gpu: &Gpu,
        mesh: usize,
        primitive: usize,
        bytes: &[u8],
    ) -> Result<(), SceneError> {
        let what = format!("primitive {primitive} of mesh {mesh}");
        let in_mesh = self.layout.desc.meshes.get(mesh).and_then(|m| m.primitives.get(primitive));
        let desc = in_mesh.ok_or_else(|| nowhere(&what))?;
        check_size(&what, bytes, desc.bytes())?;
        let slot = self.layout.geometries.of[self.layout.first_primitive[mesh] + primitive];
        let outlines = self.layout.outlines.of_slot(slot);
        if self.geometries[slot].is_some() && outlines.iter().all(|at| self.outlines[*at].is_some())
        {
            return Ok(());
        }
        if let Some(index) = geometry::index_beyond(desc, bytes) {
            return Err(SceneError::Index { what, index, vertex_count: desc.vertex_count });
        }
        let fault = |reason| SceneError::Gpu { what: what.clone(), reason };
        let geometry = if let Some(known) = &self.geometries[slot] {
            known.clone()
        } else {
            let meshlets = Meshlets::parse(desc, bytes)
                .map_err(|fault| SceneError::Description(format!("{what}: {fault}")))?;
            let room = self.room.get_or_insert_with(|| {
                GeometryRoom::Shared(missing_geometries(&self.layout, &self.geometries))
            });
            Geometry::upload(gpu, desc, (bytes, room), meshlets)
        };
        for &at in outlines {
            let (of, outline) = (&self.layout.outlines[at], &mut self.outlines[at]);
            if outline.is_none() {
                *outline = Some(if of.fill == Fill::Solid {
                    geometry.blended(desc, bytes)
                } else {
                    let indices = outline::indices(desc, bytes, of.fill);
                    geometry.with_indices(gpu, &indices).map_err(fault)?
                });
            }
        }
        self.geometries[slot] = Some(geometry);
        Ok(())
    }

    /// Takes what bends a primitive whose vertices are there.
    ///
    /// # Errors
    /// No such primitive, not the described number of bytes, or bytes that are not as described.
    pub fn upload_deformer(
        &mut self,
        mesh: usize,
        primitive: usize,
        bytes: &[u8],
    ) -> Result<(), SceneError> {
        let what = format!("what bends primitive {primitive} of mesh {mesh}");
        let in_mesh = self.layout.desc.meshes.get(mesh).and_then(|m| m.primitives.get(primitive));
        let desc = in_mesh.ok_or_else(|| nowhere(&what))?;
        let described = desc.deformed.as_ref().ok_or_else(|| nowhere(&what))?;
        check_size(&what, bytes, described.bytes)?;
        let deformer = Deformer::parse(desc, described, bytes)
            .map_err(|fault| SceneError::Description(format!("{what}: {fault}")))?;
        let slot = self.layout.geometries.of[self.layout.first_primitive[mesh] + primitive];
        let geometry = self.geometries[slot].as_mut().ok_or(SceneError::Missing(what))?;
        geometry.bent = Some(Arc::new(BentVertices::new(deformer)));
        Ok(())
    }

    /// Brings all that is not there yet to the GPU.
    ///
    /// # Errors
    /// A mesh or a texture has not been uploaded.
    pub fn finish(mut self, gpu: &Gpu) -> Result<GpuScene, SceneError> {
        if let Some(index) = self.layout.textures.first_missing(&self.textures) {
            return Err(SceneError::Missing(format!("texture {index}")));
        }
        if let Some(index) = self.layout.geometries.first_missing(&self.geometries) {
            let first_primitive = &self.layout.first_primitive;
            let mesh = first_primitive.partition_point(|&first| first <= index) - 1;
            let primitive = index - first_primitive[mesh];
            return Err(SceneError::Missing(format!("primitive {primitive} of mesh {mesh}")));
        }
        if let Some(at) = self.outlines.iter().position(Option::is_none) {
            let Outline { mesh, primitive, fill, .. } = self.layout.outlines[at];
            let what = format!("{fill:?} of primitive {primitive} of mesh {mesh}");
            return Err(SceneError::Missing(what));
        }
        let lamp_indices = index_buffer(gpu, &self.layout.lights.indices);
        // None is missing, so that each stays in its slot.
        let textures: Arc<Vec<_>> = Arc::new(self.textures.into_iter().flatten().collect());
        let known = self.known.as_ref().map(|(layout, materials)| (&**layout, &**materials));
        let made = || Arc::new(materials(gpu, &self.layout, &textures, known));
        let materials = self.materials.unwrap_or_else(made);
        for (of, outline) in self.layout.outlines.iter().zip(&mut self.outlines) {
            // Vertices are bent in the buffer that both read.
            let bent = self.geometries[of.slot].as_ref().and_then(|own| own.bent.clone());
            if let Some(outline) = outline {
                outline.bent = bent;
            }
        }
        let geometries = self.geometries.into_iter().chain(self.outlines).flatten();
        let geometries: Arc<Vec<Geometry>> = Arc::new(geometries.collect());
        let (content_bytes, layout) = (self.layout.content_bytes(), self.layout);
        Ok(GpuScene {
            ordered: triangle_order::ordered_batches(&layout, &geometries),
            layout,
            moved: None,
            part_bounds: PartBounds::default(),
            painted: Arc::default(),
            geometries,
            materials,
            lamp_indices,
            textures,
            content_bytes,
            environment: None,
        })
    }
}

/// Room for the geometries of a layout that are not there yet.
fn missing_geometries(layout: &SceneLayout, there: &[Option<Geometry>]) -> SharedRoom {
    let mut known: Vec<bool> = there.iter().map(Option::is_some).collect();
    let primitives = layout.desc.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let slots = layout.geometries.of.iter();
    let missing =
        slots.zip(primitives).filter(|(slot, _)| !std::mem::replace(&mut known[**slot], true));
    SharedRoom::new(missing.map(|(_, primitive)| primitive))
}

/// The bindings of the materials that a layout draws, whose textures are given by slot. Those that
/// a `known` scene has are shared, so that an addition or an edit binds no more than it brings.
pub(super) fn materials(
    gpu: &Gpu,
    layout: &SceneLayout,
    textures: &[wgpu::TextureView],
    known: Option<(&SceneLayout, &Materials)>,
) -> Materials {
    let mut made = HashMap::new();
    let mut sampler =
        |desc| made.entry(desc).or_insert_with(|| texture::sampler(gpu, desc)).clone();
    let described = layout.desc.textures.iter().map(|texture| texture.sampler);
    let samplers: Vec<_> = described.chain([Sampler::default()]).map(&mut sampler).collect();
    let uploaded = layout.textures.of.iter().map(|&slot| textures[slot].clone());
    let views: Vec<_> = uploaded.chain([texture::placeholder(gpu)]).collect();
    material::bind_groups(gpu, layout, (&views, &samplers), known)
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

pub(super) fn index_buffer(gpu: &Gpu, indices: &[u32]) -> wgpu::Buffer {
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
