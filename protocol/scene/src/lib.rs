//! The scene as plain data: what the baker writes and what every replica holds alike.
//!
//! A [`Scene`] is the manifest of a baked scene. It is itself a blob, so its hash names the whole
//! scene; meshes and textures are further blobs, named in it by hash. Indices between its lists
//! are checked once, by [`Scene::fault`], where a manifest comes in.

mod ambient_occlusion;
mod animated_property;
mod animation;
pub mod deformation;
mod depth_of_field;
mod edit;
pub mod environment_map;
mod features;
mod file_place;
mod fog;
pub mod glb;
mod glow;
mod lamp_maps;
mod layers;
mod level_cut;
mod light_effects;
pub mod limits;
mod material;
mod material_extensions;
mod measured;
mod mesh;
pub mod meshlet;
mod motion;
mod node_edits;
mod node_extras;
mod outline;
mod pass_times;
mod placed_nodes;
pub mod residency;
mod scene_edits;
mod shared_map;
mod style;
mod texture;
mod tone_mapper;
mod variants;

use glam::{DAffine3, DVec3, Quat, Vec3};
use serde::{Deserialize, Serialize};

pub use ambient_occlusion::AmbientOcclusion;
pub use animated_property::{
    AnimatedProperty, ChangedMaterial, LightProperty, MaterialProperty, PropertyKind,
};
pub use animation::{
    AnimatedNode, AnimatedPath, Animations, CLIPS_MAX, Channel, Clip, ClipTime, Interpolation,
};
pub use deformation::Deformation;
pub use depth_of_field::DepthOfField;
pub use edit::{
    AssetSet, AssetSetId, Attribute, Edit, NewNode, NodeId, provisional_asset,
    provisional_asset_index,
};
pub use environment_map::EnvironmentMap;
pub use features::SceneFeatures;
pub use file_place::FilePlace;
pub use fog::Fog;
pub use glow::{GLOW_OCTAVES, Glow};
pub use lamp_maps::{LAMP_MAPS_MAX, SPOT_MAP_RAD_MAX, lamps_with_maps};
pub use layers::{Layers, NodeTraits, SceneSubset};
pub use level_cut::{CUTS_MAX, LevelCut};
pub use light_effects::LightEffects;
pub use material::{AlphaMode, Material, TextureRef};
pub use material_extensions::{
    Anisotropy, BakedLight, Clearcoat, DiffuseTransmission, EXTENSION_SLOTS,
    EXTENSION_TEXTURES_MAX, Iridescence, MaterialExtensions, Sheen, Specular, Transmission, Volume,
};
pub use mesh::{IndexFormat, Mesh, Primitive, Topology, VertexLayout};
pub use motion::{Moment, Motion};
pub use node_edits::NodeEdits;
pub use node_extras::NodeExtras;
pub use outline::{CAMERA_KEY, EditError, SceneOutline, check_attribute};
pub use pass_times::{FramePass, PassTimes};
pub use placed_nodes::{MovedPlace, PlacedNodes};
pub use scene_edits::{AssetManifests, SceneEdits};
pub use style::{Facing, Fill, Highlight, NodeStyle, Shading};
pub use texture::{Filter, MipFilter, Sampler, Texture, TextureFormat, Wrap};
pub use tone_mapper::ToneMapper;
pub use variants::{VARIANTS_MAX, Variant, find_variant};

use crate::limits::{DRAWS_MAX, LIT_DRAWS_MAX, MANIFEST_BYTES_MAX, NOTE_BYTES_MAX, NOTES_MAX};
use polyptych_codec::{DecodeError, decode_within};
use polyptych_files::blob::BlobHash;

/// The beginning of the note that a scene's lights set the exposure. They do not where it comes
/// into another scene.
pub const EXPOSURE_NOTE: &str = "lit in real units";

/// The beginning of the note that an overview does not show all of a scene. It concerns where the
/// camera goes, not what is drawn.
pub const OVERVIEW_NOTE: &str = "the overview leaves out";

/// The direction towards the sun that shines where a scene has no light of its own: from above, the
/// right and behind a viewer who looks along -Z.
pub const DEFAULT_SUN_TOWARD: Vec3 = Vec3::new(0.453, 0.754, 0.476);

/// A whole scene: nodes, and the lists that they point into.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The scene's name: the source file's stem.
    pub name: String,
    /// Parents stand before their children, so one pass from the front gives world transforms.
    pub nodes: Vec<Node>,
    /// Shared by nodes; two nodes with one mesh are two instances of it.
    pub meshes: Vec<Mesh>,
    /// Shared by primitives. A primitive without one has glTF's default material.
    pub materials: Vec<Material>,
    /// Shared by materials.
    pub textures: Vec<Texture>,
    /// Placed by the nodes that name them.
    pub lights: Vec<Light>,
    /// Linear RGB radiance behind everything.
    pub sky: Vec3,
    /// The blob of an [`EnvironmentMap`]: light from all around that the source brings along.
    pub surroundings: Option<BlobHash>,
    /// The box that an overview shows, in world space: around everything drawn but what surrounds a
    /// far smaller rest, such as a sky or a sea; `None` if nothing is drawn.
    pub bounds: Option<Bounds>,
    /// Parts of the source that are not drawn, or not as they are there: lines for people, without
    /// control characters. At most [`NOTES_MAX`] of at most [`NOTE_BYTES_MAX`] bytes each.
    pub notes: Vec<String>,
    /// The exposure that suits its lights, above 0, if they are in real units; `None` for 1.
    pub exposure: Option<f32>,
    /// Facts of the source about nodes beside their picture, by node; most have none.
    pub extras: Vec<NodeExtras>,
    /// All that moves by itself.
    pub animations: Animations,
    /// The meshes whose vertices move, each at most once.
    pub deformations: Vec<Deformation>,
    /// Looks that can be chosen instead of its own.
    pub variants: Vec<Variant>,
}

/// One place in the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// The source's name; may be empty or stand twice.
    pub name: String,
    /// An index into [`Scene::nodes`], below this node's own.
    pub parent: Option<u32>,
    /// Parent space from this node's space, in f64: a scene may stand anywhere.
    pub local: DAffine3,
    /// An index into [`Scene::meshes`].
    pub mesh: Option<u32>,
    /// An index into [`Scene::lights`].
    pub light: Option<u32>,
    /// The mesh's copies, in this node's space; if empty, the mesh is drawn once at the node.
    pub instances: Vec<Instance>,
    /// How far the meshes of about its size that touch it in the file, and touch each other, reach
    /// from its middle, in radii of the mesh: more than 1, or 0 for one that stands alone. They are
    /// one surface, which is left out as small only as a whole. Endless where a clip may move it to
    /// others. The largest of its copies, if it has copies.
    pub crowd: f32,
    /// It surrounds all else in the file, as a dome with a sky does: it casts no shadow, and maps
    /// of shadows need no room for it.
    pub is_sky: bool,
}

impl Node {
    /// The crowd of its mesh in one of its places, by the index of the copy.
    pub fn crowd_of(&self, copy: usize) -> f32 {
        self.instances.get(copy).map_or(self.crowd, |copy| copy.crowd)
    }
}

/// One copy of a node's mesh, in the node's space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Instance {
    /// In units of the node's space.
    pub translation: Vec3,
    /// A unit quaternion.
    pub rotation: Quat,
    /// Along the three axes.
    pub scale: Vec3,
    /// Its own, as [`Node::crowd`]: of the copies of one node some may make up a wall, and others
    /// stand alone.
    pub crowd: f32,
}

/// A light of `KHR_lights_punctual`; it shines along −Z of its node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// The kind of light.
    pub kind: LightKind,
    /// Linear RGB.
    pub color: Vec3,
    /// Lux for a directional light, candela for the others.
    pub intensity: f32,
    /// Distance in world units at which it ends; infinite where `None`.
    pub range: Option<f32>,
}

impl Light {
    /// Returns whether what it does not reach lies in shadow: it shines.
    pub fn casts_shadows(&self) -> bool {
        self.color * self.intensity != Vec3::ZERO
    }

    /// The distance in world units at which it ends. A range of 0 or less is no range: the schema
    /// asks for more than 0.
    pub fn finite_range(&self) -> Option<f32> {
        self.range.filter(|range| *range > 0.0 && range.is_finite())
    }
}

/// The three kinds of `KHR_lights_punctual`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum LightKind {
    /// From infinitely far.
    Directional,
    /// In all directions from a point.
    Point,
    /// In a cone; half angles in radians, `inner_rad < outer_rad`.
    Spot {
        /// Full strength inside.
        inner_rad: f32,
        /// Nothing outside.
        outer_rad: f32,
    },
}

/// An axis-aligned box in world space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// The least corner.
    pub min: DVec3,
    /// The greatest corner.
    pub max: DVec3,
}

impl Bounds {
    /// The middle of the box.
    pub fn center(&self) -> DVec3 {
        self.min + (self.max - self.min) * 0.5
    }

    /// Half of its diagonal.
    pub fn radius(&self) -> f64 {
        (self.max - self.min).length() * 0.5
    }
}

/// Decodes a manifest; [`Scene::fault`] says whether what it holds is sound.
///
/// # Errors
/// [`DecodeError`] if these bytes are not one scene.
pub fn decode(bytes: &[u8]) -> Result<Scene, DecodeError> {
    decode_within::<Scene, MANIFEST_BYTES_MAX>(bytes)
}

impl Scene {
    /// World space from each node's space, in the order of the nodes.
    pub fn world_from_nodes(&self) -> Vec<DAffine3> {
        let mut world: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let parent = node.parent.and_then(|p| world.get(p as usize));
            world.push(parent.map_or(node.local, |p| *p * node.local));
        }
        world
    }

    /// Triangles that the whole scene draws, each instance counted.
    pub fn triangles(&self) -> u64 {
        // A manifest from outside may claim more than there are numbers for.
        let add = |sum: u64, triangles: u64| sum.saturating_add(triangles);
        let of_mesh = |m: &Mesh| m.primitives.iter().map(Primitive::triangles).fold(0, add);
        let per_mesh: Vec<u64> = self.meshes.iter().map(of_mesh).collect();
        let copies = |node: &Node| node.instances.len().max(1) as u64;
        let of_node = |node: &Node| {
            let mesh = node.mesh.and_then(|mesh| per_mesh.get(mesh as usize));
            mesh.map_or(0, |triangles| triangles.saturating_mul(copies(node)))
        };
        self.nodes.iter().map(of_node).fold(0, add)
    }

    /// Returns the number of draws: primitives, each in every place where it is drawn.
    pub fn draws(&self) -> u64 {
        draws(&self.nodes, |mesh| {
            self.meshes.get(mesh as usize).map_or(0, |mesh| mesh.primitives.len() as u64)
        })
    }

    /// The hashes of every mesh, of what moves it, of every texture, and of the surroundings; one
    /// may stand twice.
    pub fn blobs(&self) -> impl Iterator<Item = BlobHash> + '_ {
        let primitives = self.meshes.iter().flat_map(|m| &m.primitives);
        let of_primitive = |p: &Primitive| [Some(p.blob), p.deformed.map(|of| of.blob)];
        let of_primitives = primitives.flat_map(of_primitive).flatten();
        of_primitives.chain(self.textures.iter().map(|t| t.blob)).chain(self.surroundings)
    }

    /// Returns the fault of this manifest, if any: an index that points nowhere, a parent behind
    /// its child, a size that contradicts itself.
    pub fn fault(&self) -> Option<String> {
        let beyond = |index: Option<u32>, len: usize| index.is_some_and(|i| i as usize >= len);
        let is_note =
            |n: &String| n.len() <= NOTE_BYTES_MAX && !n.contains(|c: char| c.is_control());
        if self.notes.len() > NOTES_MAX || !self.notes.iter().all(is_note) {
            return Some(format!(
                "notes: at most {NOTES_MAX} lines of at most {NOTE_BYTES_MAX} bytes can be kept"
            ));
        }
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
        if let Some(fault) = expansion_fault(&self.nodes, &self.lights, self.draws()) {
            return Some(fault);
        }
        if let Some(fault) = node_extras::fault(&self.extras, self.nodes.len()) {
            return Some(fault);
        }
        if let Some(fault) = self.motion_fault().or_else(|| self.variants_fault()) {
            return Some(fault);
        }
        if let Some(exposure) = self.exposure.filter(|e| !(e.is_finite() && *e > 0.0)) {
            return Some(format!("its exposure is {exposure}, not a number above 0"));
        }
        for (i, mesh) in self.meshes.iter().enumerate() {
            if mesh.primitives.iter().any(|p| beyond(p.material, self.materials.len())) {
                return Some(format!("mesh {i} names a material that is not there"));
            }
            if mesh.primitives.iter().any(|p| p.index_count == 0 || p.vertex_count == 0) {
                return Some(format!("mesh {i} has a primitive of nothing"));
            }
            if mesh.primitives.iter().any(Primitive::has_unusable_levels) {
                return Some(format!("mesh {i} has levels of detail that cannot be drawn"));
            }
            let deformed = mesh.primitives.iter().filter_map(|of| of.deformed?.fault(of));
            if let Some(fault) = { deformed }.next() {
                return Some(format!("mesh {i} {fault}"));
            }
            if let Some(fault) = mesh.cuts_fault() {
                return Some(format!("mesh {i} has {fault}"));
            }
        }
        for (i, material) in self.materials.iter().enumerate() {
            if material.textures().any(|t| t.texture as usize >= self.textures.len()) {
                return Some(format!("material {i} names a texture that is not there"));
            }
        }
        let bad = self.textures.iter().position(|t| t.fault().is_some());
        bad.and_then(|i| Some(format!("texture {i}: {}", self.textures[i].fault()?)))
    }
}

impl Scene {
    /// Returns what is wrong with what moves by itself, if anything.
    fn motion_fault(&self) -> Option<String> {
        if let Some(fault) = self.animations.fault(self.nodes.len()) {
            return Some(fault);
        }
        if let Some(at) = self.animations.properties.iter().position(|of| !of.is_sound(self)) {
            return Some(format!("animated property {at} is of what is not there, or no number"));
        }
        let mut is_deformed = vec![false; self.meshes.len()];
        let animated = self.animations.nodes.len();
        for (at, of) in self.deformations.iter().enumerate() {
            let (Some(mesh), Some(known)) =
                (self.meshes.get(of.mesh as usize), is_deformed.get_mut(of.mesh as usize))
            else {
                return Some(format!("deformation {at} names a mesh that is not there"));
            };
            if std::mem::replace(known, true) {
                return Some(format!("mesh {} has two deformations", of.mesh));
            }
            if let Some(fault) = of.fault(&mesh.primitives, self.nodes.len(), animated) {
                return Some(format!("deformation {at} {fault}"));
            }
            let weights_of = of.weights_of.map(|at| &self.animations.nodes[at as usize].weights);
            if weights_of.is_some_and(|weights| weights.len() != of.weights.len()) {
                return Some(format!("deformation {at} has not as many weights as its node"));
            }
        }
        None
    }
}

/// Returns the number of draws of these nodes, whose meshes have so many primitives each.
/// Saturates.
pub fn draws(nodes: &[Node], primitives_of: impl Fn(u32) -> u64) -> u64 {
    let of_node = |node: &Node| {
        let copies = node.instances.len().max(1) as u64;
        node.mesh.map_or(0, |mesh| primitives_of(mesh).saturating_mul(copies))
    };
    nodes.iter().map(of_node).fold(0, u64::saturating_add)
}

/// Returns the number of nodes whose light has no range, and shines on everything.
pub(crate) fn endless_lights(nodes: &[Node], lights: &[Light]) -> u64 {
    let is_endless = |node: &&Node| {
        let light = node.light.and_then(|light| lights.get(light as usize));
        light.is_some_and(|light| light.finite_range().is_none())
    };
    nodes.iter().filter(is_endless).count() as u64
}

/// Returns why a scene of so many draws is too large to be held or prepared; `None` if it is not.
pub fn expansion_fault(nodes: &[Node], lights: &[Light], draws: u64) -> Option<String> {
    if draws > DRAWS_MAX {
        return Some(format!(
            "{} nodes draw {draws} primitives in all, where {DRAWS_MAX} can be drawn",
            nodes.iter().filter(|node| node.mesh.is_some()).count()
        ));
    }
    let lights = endless_lights(nodes, lights);
    (draws.saturating_mul(lights) > LIT_DRAWS_MAX).then(|| {
        format!(
            "{lights} lights without a range shine on {draws} primitives, where the product can be \
             {LIT_DRAWS_MAX}"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(nodes: usize, primitives: usize) -> Scene {
        let primitive = Primitive {
            blob: BlobHash([0; 32]),
            layout: VertexLayout::default(),
            vertex_count: 3,
            index_count: 3,
            coarser_index_count: 0,
            meshlet_count: 0,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
            index_format: IndexFormat::U16,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::ZERO,
            min: Vec3::ZERO,
            max: Vec3::ONE,
        };
        let node = Node { mesh: Some(0), ..Node::default() };
        let mesh = Mesh { name: String::new(), primitives: vec![primitive; primitives] };
        Scene { nodes: vec![node; nodes], meshes: vec![mesh], ..Scene::default() }
    }

    #[test]
    fn rejects_manifests_that_expand_beyond_the_limit() {
        assert_eq!(scene(2048, 1024).fault(), None, "as many as can be drawn");
        let bomb = scene(100_000, 1000);
        assert_eq!(bomb.draws(), 100_000_000);
        let fault = bomb.fault().expect("a bomb");
        for part in ["100000 nodes", "100000000 primitives", "2097152"] {
            assert!(fault.contains(part), "{part:?} is not in {fault:?}");
        }
        let mut copies = scene(1, 2);
        let (translation, rotation) = (Vec3::ZERO, Quat::IDENTITY);
        let one = Instance { translation, rotation, scale: Vec3::ONE, crowd: 0.0 };
        copies.nodes[0].instances = vec![one; (1 << 20) + 1];
        assert!(copies.fault().is_some_and(|fault| fault.contains("2097154")));
    }

    #[test]
    fn rejects_more_lights_than_can_be_tested_against_all_draws() {
        let mut lit = scene(100_000, 1);
        lit.lights =
            vec![Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 1.0, range: None }];
        lit.nodes.iter_mut().take(80_000).for_each(|node| node.light = Some(0));
        assert_eq!(lit.fault(), None);
        lit.nodes.iter_mut().for_each(|node| node.light = Some(0));
        assert!(lit.fault().is_some_and(|fault| fault.contains("100000 lights")), "10 G pairs");
        // What reaches little is not tested against all.
        lit.lights[0].range = Some(10.0);
        assert_eq!(lit.fault(), None);
        lit.lights[0].range = Some(0.0);
        assert!(lit.fault().is_some(), "no range");
    }
}
