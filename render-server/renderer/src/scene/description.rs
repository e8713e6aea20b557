//! A scene as plain data, before its meshes and textures arrive.

use glam::{Affine2, DAffine3, DVec3, Quat, Vec3, Vec4};

/// Names equal bytes: two slots with the same name share one buffer or texture. A blob's hash
/// serves.
pub type ContentName = [u8; 32];

/// A whole scene. Every index is checked by [`SceneLayout::new`](super::SceneLayout::new).
#[derive(Clone, Debug, Default)]
pub struct SceneDesc {
    /// Parents stand before their children.
    pub nodes: Vec<NodeDesc>,
    /// Each a list of primitives.
    pub meshes: Vec<MeshDesc>,
    /// Named by primitives.
    pub materials: Vec<MaterialDesc>,
    /// Named by materials.
    pub textures: Vec<TextureDesc>,
    /// Named by nodes.
    pub lights: Vec<LightDesc>,
    /// Linear RGB radiance behind everything; also the ambient light from above.
    pub sky: Vec3,
    /// Linear RGB radiance from below. `None`: what a matt, warm ground makes of the sky's.
    pub ground: Option<Vec3>,
}

impl SceneDesc {
    /// Returns what is wrong with its indices and numbers, if anything.
    pub(super) fn fault(&self) -> Option<String> {
        let beyond = |index: Option<u32>, len: usize| index.is_some_and(|i| i as usize >= len);
        for (i, node) in self.nodes.iter().enumerate() {
            if beyond(node.parent, i) {
                return Some(format!("node {i} stands before its parent"));
            }
            if beyond(node.mesh, self.meshes.len()) || beyond(node.light, self.lights.len()) {
                return Some(format!("node {i} names a mesh or light that is not there"));
            }
            if !node.local.is_finite() {
                return Some(format!("node {i} has a transform that is not finite"));
            }
        }
        for (i, mesh) in self.meshes.iter().enumerate() {
            for primitive in &mesh.primitives {
                if beyond(primitive.material, self.materials.len()) {
                    return Some(format!("mesh {i} names a material that is not there"));
                }
                if primitive.index_count == 0 || primitive.vertex_count == 0 {
                    return Some(format!("mesh {i} has a primitive of nothing"));
                }
            }
        }
        for (i, material) in self.materials.iter().enumerate() {
            let uses = material.texture_uses();
            if uses.iter().flatten().any(|one| one.texture as usize >= self.textures.len()) {
                return Some(format!("material {i} names a texture that is not there"));
            }
        }
        None
    }

    /// Returns what of it is too large for a GPU, if anything: textures of a longer side than
    /// `side_max` pixels, primitives of more than `bytes_max` bytes.
    pub(super) fn size_fault(&self, side_max: u32, bytes_max: u64) -> Option<String> {
        for (i, mesh) in self.meshes.iter().enumerate() {
            let sizes = mesh.primitives.iter().map(PrimitiveDesc::bytes);
            if let Some(bytes) = sizes.max().filter(|bytes| *bytes > bytes_max) {
                return Some(format!("mesh {i}: {bytes} bytes, where {bytes_max} can be"));
            }
        }
        self.textures.iter().enumerate().find_map(|(i, texture)| {
            let (width, height) = (texture.width, texture.height);
            if !(1..=side_max).contains(&width) || !(1..=side_max).contains(&height) {
                return Some(format!(
                    "texture {i}: {width} × {height}, where 1 to {side_max} can be"
                ));
            }
            let (levels, levels_max) = (texture.mip_count, width.max(height).ilog2() + 1);
            let is_wrong = !(1..=levels_max).contains(&levels);
            is_wrong.then(|| format!("texture {i}: {levels} levels, 1 to {levels_max} can be"))
        })
    }
}

/// One place in the scene.
#[derive(Clone, Debug, Default)]
pub struct NodeDesc {
    /// An index below this node's own.
    pub parent: Option<u32>,
    /// Parent space from this node's space.
    pub local: DAffine3,
    /// An index into [`SceneDesc::meshes`].
    pub mesh: Option<u32>,
    /// An index into [`SceneDesc::lights`]; it shines along −Z.
    pub light: Option<u32>,
    /// Where not empty, the mesh stands at each of these, in this node's space, instead of once.
    pub instances: Vec<InstanceDesc>,
}

/// One copy of a node's mesh.
#[derive(Clone, Copy, Debug)]
pub struct InstanceDesc {
    /// In units of the node's space.
    pub translation: Vec3,
    /// A unit quaternion.
    pub rotation: Quat,
    /// Along the three axes.
    pub scale: Vec3,
}

/// Primitives that stand together.
#[derive(Clone, Debug, Default)]
pub struct MeshDesc {
    /// Each has one material.
    pub primitives: Vec<PrimitiveDesc>,
}

/// Geometry with one material. Its bytes are the vertices, interleaved as [`VertexLayout`] says,
/// then the indices, all little-endian.
#[derive(Clone, Debug)]
pub struct PrimitiveDesc {
    /// Shares a buffer with others of the same name, layout and counts.
    pub content: Option<ContentName>,
    /// What each vertex holds.
    pub layout: VertexLayout,
    /// Number of vertices.
    pub vertex_count: u32,
    /// Number of indices.
    pub index_count: u32,
    /// Whether indices have 4 bytes instead of 2.
    pub wide_indices: bool,
    /// What indices make.
    pub topology: Topology,
    /// An index into [`SceneDesc::materials`]; glTF's default material where `None`.
    pub material: Option<u32>,
    /// Where the vertices' zero stands in the mesh's space.
    pub origin: DVec3,
    /// The least corner of the vertices, relative to `origin`.
    pub min: Vec3,
    /// The greatest corner of the vertices, relative to `origin`.
    pub max: Vec3,
}

/// Which attributes a vertex has: position 3 and normal 3 floats, then as present: tangent 4,
/// uv0 2, uv1 2, color 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct VertexLayout {
    /// xyz along +u of the normal map, w the sign of the bitangent.
    pub tangent: bool,
    /// First set of texture coordinates.
    pub uv0: bool,
    /// Second set of texture coordinates.
    pub uv1: bool,
    /// Linear RGBA; multiplies the base colour.
    pub color: bool,
}

impl VertexLayout {
    /// Bytes of one vertex.
    pub fn stride(self) -> u64 {
        self.color_offset() + 16 * u64::from(self.color)
    }

    /// Bytes before the tangent.
    pub(crate) fn tangent_offset() -> u64 {
        24
    }

    /// Bytes before the first texture coordinates.
    pub(crate) fn uv0_offset(self) -> u64 {
        Self::tangent_offset() + 16 * u64::from(self.tangent)
    }

    /// Bytes before the second texture coordinates.
    pub(crate) fn uv1_offset(self) -> u64 {
        self.uv0_offset() + 8 * u64::from(self.uv0)
    }

    /// Bytes before the colour.
    pub(crate) fn color_offset(self) -> u64 {
        self.uv1_offset() + 8 * u64::from(self.uv1)
    }
}

/// What indices make.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Topology {
    /// Points of one pixel.
    Points,
    /// Lines of one pixel.
    Lines,
    /// Triangles, counter-clockwise from their front.
    Triangles,
}

impl PrimitiveDesc {
    /// Bytes of the vertices, which come first.
    pub fn vertex_bytes(&self) -> u64 {
        u64::from(self.vertex_count) * self.layout.stride()
    }

    /// Bytes of vertices and indices together.
    pub fn bytes(&self) -> u64 {
        let width = if self.wide_indices { 4 } else { 2 };
        self.vertex_bytes() + u64::from(self.index_count) * width
    }

    /// Triangles that it draws.
    pub fn triangles(&self) -> u64 {
        if self.topology == Topology::Triangles { u64::from(self.index_count) / 3 } else { 0 }
    }
}

/// A surface of glTF's metallic-roughness model. Factors multiply the textures; all linear.
#[derive(Clone, Debug)]
pub struct MaterialDesc {
    /// Linear RGBA.
    pub base_color: Vec4,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Perceptual; its square is GGX's α.
    pub roughness: f32,
    /// Linear RGB radiance.
    pub emissive: Vec3,
    /// Multiplies x and y of the normal map.
    pub normal_scale: f32,
    /// 0 none, 1 as the texture says.
    pub occlusion_strength: f32,
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Whether back faces are drawn, with the normal turned.
    pub double_sided: bool,
    /// Whether the base colour is shown without light.
    pub unlit: bool,
    /// sRGB colour and alpha.
    pub base_color_texture: Option<TextureUse>,
    /// Roughness in G, metallic in B.
    pub metallic_roughness_texture: Option<TextureUse>,
    /// Tangent-space normals, +Y up. Used where the vertices have tangents.
    pub normal_texture: Option<TextureUse>,
    /// Occlusion of indirect light in R.
    pub occlusion_texture: Option<TextureUse>,
    /// sRGB radiance.
    pub emissive_texture: Option<TextureUse>,
}

/// How alpha is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Not at all.
    Opaque,
    /// Below this cutoff nothing is drawn.
    Mask(f32),
    /// Drawn over what lies behind.
    Blend,
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureUse {
    /// An index into [`SceneDesc::textures`].
    pub texture: u32,
    /// Which set of coordinates: 0 or 1.
    pub uv_set: u8,
    /// Applied to the coordinates.
    pub uv_transform: Affine2,
}

impl Default for MaterialDesc {
    /// glTF's default material.
    fn default() -> Self {
        Self {
            base_color: Vec4::ONE,
            metallic: 1.0,
            roughness: 1.0,
            emissive: Vec3::ZERO,
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            occlusion_texture: None,
            emissive_texture: None,
        }
    }
}

impl MaterialDesc {
    /// Its five textures in the order of the shader's bindings: base colour, metallic-roughness,
    /// normal, occlusion, emissive.
    pub fn texture_uses(&self) -> [Option<TextureUse>; 5] {
        [
            self.base_color_texture,
            self.metallic_roughness_texture,
            self.normal_texture,
            self.occlusion_texture,
            self.emissive_texture,
        ]
    }
}

/// An image with mip levels: rows from the top, 4 bytes a pixel, the largest level first, each
/// next one half as large, rounded down, at least 1 pixel.
#[derive(Clone, Debug)]
pub struct TextureDesc {
    /// Shares a texture with others of the same name, format and size.
    pub content: Option<ContentName>,
    /// Whether RGB is sRGB; linear otherwise.
    pub srgb: bool,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Levels in the bytes.
    pub mip_count: u32,
    /// How it is sampled.
    pub sampler: SamplerDesc,
}

impl TextureDesc {
    /// Width and height of a level, in pixels.
    pub fn level_size(&self, level: u32) -> [u32; 2] {
        let side = |pixels: u32| pixels.checked_shr(level).unwrap_or(0).max(1);
        [side(self.width), side(self.height)]
    }

    /// Bytes of all levels.
    pub fn bytes(&self) -> u64 {
        let level = |level| {
            let [width, height] = self.level_size(level);
            u64::from(width) * u64::from(height) * 4
        };
        (0..self.mip_count).map(level).sum()
    }
}

/// How a texture is sampled; glTF's samplers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SamplerDesc {
    /// Linear, or nearest, where it is seen larger than it is.
    pub mag_linear: bool,
    /// Linear, or nearest, where it is seen smaller than it is.
    pub min_linear: bool,
    /// Between levels.
    pub mip: MipFilter,
    /// Beyond 0 and 1 along u.
    pub wrap_u: Wrap,
    /// Beyond 0 and 1 along v.
    pub wrap_v: Wrap,
}

impl Default for SamplerDesc {
    /// Trilinear and repeated.
    fn default() -> Self {
        Self {
            mag_linear: true,
            min_linear: true,
            mip: MipFilter::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
        }
    }
}

/// Between levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MipFilter {
    /// The largest level only.
    None,
    /// The nearest level.
    Nearest,
    /// Between two levels.
    Linear,
}

/// Beyond the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The edge goes on.
    Clamp,
    /// Every second copy is mirrored.
    Mirror,
    /// Copies side by side.
    Repeat,
}

/// A light of `KHR_lights_punctual`.
#[derive(Clone, Debug)]
pub struct LightDesc {
    /// Where it shines.
    pub kind: LightKind,
    /// Linear RGB.
    pub color: Vec3,
    /// Lux for a directional light, candela for the others. At exposure 1, π lux on a white
    /// matt surface give display white.
    pub intensity: f32,
    /// Distance in world units at which it ends; infinite where `None`.
    pub range: Option<f32>,
}

/// The three kinds of light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// From infinitely far.
    Directional,
    /// In all directions from a point.
    Point,
    /// In a cone; half angles in radians.
    Spot {
        /// Full strength inside.
        inner_rad: f32,
        /// Nothing outside.
        outer_rad: f32,
    },
}
