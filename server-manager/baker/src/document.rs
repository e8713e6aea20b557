//! The JSON of a glTF file, as far as a static scene needs it.
//!
//! Nodes and everything that points at bytes have types of our own: transforms stay f64, and no
//! index is followed before it was checked. Materials, textures, samplers and lights are those of
//! the `gltf` crate. What a file leaves out has glTF's default.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;

use gltf::json;
use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, SeqAccess, Visitor};

use super::animation_json::Animation;
use super::camera::Camera;
use super::error::BakeError;
use super::extensions::ExtensionUses;
use super::numbers;

/// The part of the JSON that must be understood before anything else is looked at.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct AssetHeader {
    pub asset: Option<Asset>,
    #[serde(default)]
    pub extensions_required: Vec<String>,
}

/// Who wrote the file, in which version of glTF.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub version: Option<serde_json::Value>,
    pub min_version: Option<String>,
}

/// A whole file.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub extensions_used: Vec<String>,
    pub scene: Option<u32>,
    pub scenes: List<Scene>,
    pub nodes: List<Node>,
    pub meshes: List<Mesh>,
    pub accessors: List<Accessor>,
    pub buffer_views: List<BufferView>,
    pub buffers: List<Buffer>,
    pub materials: List<json::Material>,
    pub textures: List<json::Texture>,
    pub samplers: List<json::texture::Sampler>,
    pub images: List<Image>,
    pub skins: List<Skin>,
    pub animations: List<Animation>,
    pub cameras: List<Camera>,
    pub extensions: DocumentExtensions,
    /// Counted in the JSON as a whole.
    #[serde(skip)]
    pub extension_uses: ExtensionUses,
}

impl Document {
    /// Returns the number of primitives that have more than one set of colours.
    pub(super) fn further_colors(&self) -> usize {
        let primitives = self.meshes.iter().flat_map(|mesh| &mesh.primitives);
        primitives.filter(|primitive| primitive.attributes.contains_key("COLOR_1")).count()
    }

    /// A part of a mesh, both of which must be there.
    pub(super) fn primitive_mut(&mut self, mesh: usize, part: usize) -> &mut Primitive {
        &mut self.meshes.0[mesh].primitives[part]
    }
}

/// Extensions of the whole file.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct DocumentExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub lights: Lights,
    #[serde(rename = "KHR_materials_variants")]
    pub variants: Variants,
    /// Read once a scene names one of its lights.
    #[serde(rename = "EXT_lights_image_based")]
    pub image_based_lights: serde_json::Value,
}

/// `KHR_materials_variants` of the file: the names of all.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Variants {
    pub variants: Vec<VariantName>,
}

/// A variant.
#[derive(Debug, Deserialize)]
pub(super) struct VariantName {
    #[serde(default)]
    pub name: String,
}

/// `KHR_lights_punctual`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Lights {
    pub lights: List<JsonLight>,
}

/// A light as the `gltf` crate reads it.
pub(super) type JsonLight = json::extensions::scene::khr_lights_punctual::Light;

/// The roots of what is shown together.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub name: String,
    pub nodes: Vec<u32>,
    pub extensions: BTreeMap<String, serde_json::Value>,
}

/// A place, in f64.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub name: String,
    pub children: Vec<u32>,
    pub mesh: Option<u32>,
    pub skin: Option<u32>,
    pub camera: Option<u32>,
    pub weights: Option<Vec<f64>>,
    #[serde(deserialize_with = "numbers::matrix")]
    pub matrix: Option<[f64; 16]>,
    #[serde(deserialize_with = "numbers::translation")]
    pub translation: Option<[f64; 3]>,
    #[serde(deserialize_with = "numbers::rotation")]
    pub rotation: Option<[f64; 4]>,
    #[serde(deserialize_with = "numbers::scale")]
    pub scale: Option<[f64; 3]>,
    pub extensions: NodeExtensions,
    /// Null where there are none.
    pub extras: serde_json::Value,
}

/// Extensions of a node.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub light: Option<NodeLight>,
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    pub visibility: Visibility,
    #[serde(rename = "MSFT_lod")]
    msft_lod: CoarserLevels,
    #[serde(rename = "EXT_lod")]
    ext_lod: CoarserLevels,
}

impl NodeExtensions {
    /// The nodes that are coarser levels of this one.
    pub(super) fn coarser(&self) -> impl Iterator<Item = u32> + '_ {
        self.msft_lod.ids.iter().chain(&self.ext_lod.ids).copied()
    }
}

/// `MSFT_lod`: other forms of what has it, from the second finest on.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct CoarserLevels {
    ids: Vec<u32>,
}

/// `KHR_node_visibility`.
#[derive(Debug, Deserialize)]
#[serde(default)]
pub(super) struct Visibility {
    pub visible: bool,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { visible: true }
    }
}

/// The light that stands at a node.
#[derive(Debug, Deserialize)]
pub(super) struct NodeLight {
    pub light: u32,
}

/// `EXT_mesh_gpu_instancing`: accessors by the name of the attribute.
#[derive(Debug, Deserialize)]
pub(super) struct Instancing {
    pub attributes: BTreeMap<String, u32>,
}

/// Parts that are drawn together.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub name: String,
    pub primitives: Vec<Primitive>,
    pub weights: Vec<f64>,
}

/// Geometry with one material.
#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub attributes: BTreeMap<String, u32>,
    pub indices: Option<u32>,
    pub material: Option<u32>,
    #[serde(default = "triangles")]
    pub mode: u32,
    #[serde(default)]
    pub targets: Vec<BTreeMap<String, u32>>,
    #[serde(default)]
    pub extensions: PrimitiveExtensions,
}

/// Extensions of a primitive.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub draco: Option<DracoStream>,
    #[serde(rename = "KHR_materials_variants")]
    pub variants: VariantMappings,
}

/// `KHR_materials_variants` of a primitive.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct VariantMappings {
    pub mappings: Vec<VariantMapping>,
}

/// The material of a primitive in some variants.
#[derive(Debug, Deserialize)]
pub(super) struct VariantMapping {
    pub material: u32,
    #[serde(default)]
    pub variants: Vec<u32>,
}

/// `KHR_draco_mesh_compression`: a view, and the stream's attributes by their names.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct DracoStream {
    pub buffer_view: u32,
    #[serde(default)]
    pub attributes: BTreeMap<String, u32>,
    /// The reason why it could not be unpacked.
    #[serde(skip)]
    pub fault: Option<String>,
}

fn triangles() -> u32 {
    4
}

/// The layout of values in a view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<u32>,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Sparse>,
}

/// Values that replace others.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: u64,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

/// The indices of the replaced values.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub buffer_view: u32,
    #[serde(default)]
    pub byte_offset: u64,
    pub component_type: u32,
}

/// The values that replace them.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub buffer_view: u32,
    #[serde(default)]
    pub byte_offset: u64,
}

/// A part of a buffer.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: u32,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: Option<u64>,
    #[serde(default)]
    pub extensions: ViewExtensions,
}

/// Extensions of a view: one, which has two names.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext_meshopt: Option<MeshoptView>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr_meshopt: Option<MeshoptView>,
}

impl ViewExtensions {
    /// The stream that the view is unpacked from, with the extension's name.
    pub(super) fn meshopt(&self) -> Option<(&'static str, &MeshoptView)> {
        let khr = self.khr_meshopt.as_ref().map(|view| ("KHR_meshopt_compression", view));
        khr.or(self.ext_meshopt.as_ref().map(|view| ("EXT_meshopt_compression", view)))
    }
}

/// The place of a compressed view, and the way in which it is compressed.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct MeshoptView {
    pub buffer: u32,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    pub byte_stride: u64,
    pub count: u64,
    pub mode: String,
    pub filter: Option<String>,
}

/// Bytes in a file, a `data:` URI, or the binary chunk of a GLB.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: u64,
    #[serde(default)]
    pub extensions: BufferExtensions,
}

/// Extensions of a buffer.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext_meshopt: Option<IgnoredAny>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr_meshopt: Option<IgnoredAny>,
}

impl BufferExtensions {
    /// Returns whether it says that it stands for bytes that views are unpacked to.
    fn is_for_unpacked(&self) -> bool {
        self.ext_meshopt.is_some() || self.khr_meshopt.is_some()
    }
}

impl Document {
    /// The buffers that stand for bytes that views are unpacked to: they may say so, and all of
    /// their views are compressed, in other buffers.
    pub(super) fn unpacked_buffers(&self) -> BTreeSet<u32> {
        let (mut unpacked, mut read) = (BTreeSet::new(), BTreeSet::new());
        for view in self.buffer_views.iter() {
            match view.extensions.meshopt() {
                Some((_, stream)) => {
                    unpacked.insert(view.buffer);
                    read.insert(stream.buffer);
                }
                None => _ = read.insert(view.buffer),
            }
        }
        let tagged =
            (0..).zip(self.buffers.iter()).filter(|(_, of)| of.extensions.is_for_unpacked());
        unpacked.difference(&read).copied().chain(tagged.map(|(at, _)| at)).collect()
    }
}

/// A picture in a file, a `data:` URI or a view.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Image {
    pub name: String,
    pub uri: Option<String>,
    pub mime_type: Option<String>,
    pub buffer_view: Option<u32>,
}

/// The joints that deform a mesh, and the matrices that take the mesh into the space of each.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Skin {
    pub joints: Vec<u32>,
    pub inverse_bind_matrices: Option<u32>,
}

/// One of the top-level lists, for messages.
pub(super) trait Listed {
    /// Its key in the JSON.
    const LIST: &'static str;
}

macro_rules! listed {
    ($($kind:ty => $list:literal),* $(,)?) => {$(
        impl Listed for $kind {
            const LIST: &'static str = $list;
        }
    )*};
}
listed! {
    Scene => "scenes", Node => "nodes", Mesh => "meshes", Accessor => "accessors",
    BufferView => "bufferViews", Buffer => "buffers", json::Material => "materials",
    json::Texture => "textures", json::texture::Sampler => "samplers", Image => "images",
    Skin => "skins", Animation => "animations", Camera => "cameras",
    JsonLight => "extensions.KHR_lights_punctual.lights",
}

/// A top-level list, of which messages know the key.
#[derive(Debug)]
pub(super) struct List<T>(Vec<T>);

impl<T> Default for List<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Deref for List<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T: Listed> List<T> {
    /// The element that `place` points at.
    pub(super) fn at(&self, index: u32, place: &str) -> Result<&T, BakeError> {
        let found = self.0.get(index as usize);
        found.ok_or_else(|| BakeError::beyond(place, T::LIST, index.into(), self.0.len()))
    }

    /// Appends an element that was not in the file. Returns its index.
    pub(super) fn push(&mut self, element: T) -> u32 {
        self.0.push(element);
        // Lists of a file that can be read are far shorter.
        u32::try_from(self.0.len() - 1).unwrap_or(u32::MAX)
    }

    /// Puts an element in place of one that must be there.
    pub(super) fn replace(&mut self, index: usize, element: T) {
        self.0[index] = element;
    }
}

impl<'de, T: Deserialize<'de> + Listed> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(ListVisitor(PhantomData))
    }
}

struct ListVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de> + Listed> Visitor<'de> for ListVisitor<T> {
    type Value = List<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to be an array", T::LIST)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<List<T>, A::Error> {
        let mut list = Vec::new();
        while let Some(element) = seq.next_element()? {
            list.push(element);
        }
        Ok(List(list))
    }
}
