//! The file: glTF 2.0 binary, <https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html>.
//!
//! Objects are written with their keys in the order of the alphabet, so that the bytes do not hang
//! on whether serde_json keeps the order of insertion. Accessors of one kind share one buffer view:
//! a large town has tens of thousands of them.

use glam::Vec3;
use serde_json::{Map, Value, json};

use super::TownError;
use super::bobbing::{self, KEYS, LENGTH_S, MOTIONS};
use super::material::Material;
use super::surface::{MeshBuffer, Model};
use super::trig::sin_cos;

const F32: u32 = 5126;
const U16: u32 = 5123;
const U8: u32 = 5121;

/// The kinds of numbers in the buffer, each with a buffer view of its own.
#[derive(Clone, Copy, Debug)]
enum Pool {
    Positions,
    Normals,
    Uvs,
    Colors,
    Indices,
    Places,
    Rotations,
    Scales,
}

impl Pool {
    const COUNT: usize = 8;

    /// Stride and target of its buffer view, for vertices; the target, for indices.
    fn layout(index: usize) -> (Option<u32>, Option<u32>) {
        const VERTICES: Option<u32> = Some(34962);
        const INDICES: Option<u32> = Some(34963);
        match index {
            0 | 1 => (Some(12), VERTICES),
            2 => (Some(8), VERTICES),
            3 => (Some(4), VERTICES),
            4 => (None, INDICES),
            _ => (None, None),
        }
    }
}

/// The placement of an object: metres, turns about +Y, factors of size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub translation: Vec3,
    pub turn: f32,
    pub scale: Vec3,
}

impl Placement {
    /// Upright at a place.
    pub fn at(translation: Vec3) -> Self {
        Self { translation, turn: 0.0, scale: Vec3::ONE }
    }

    fn rotation(&self) -> [f32; 4] {
        let (sine, cosine) = sin_cos(self.turn * 0.5);
        [0.0, sine, 0.0, cosine]
    }
}

/// A node of the scene.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub name: String,
    pub placement: Placement,
    pub mesh: Option<usize>,
    pub light: Option<usize>,
    pub children: Vec<usize>,
    /// The placements of copies of the mesh, relative to the node; if empty, the node itself has
    /// the mesh.
    pub instances: Vec<Placement>,
    /// Turns about +X before it is turned about +Y: raises what it faces.
    pub tilt: f32,
}

impl Node {
    /// A node without content.
    pub fn new(name: impl Into<String>, placement: Placement) -> Self {
        let name = name.into();
        let (children, instances) = (vec![], vec![]);
        Self { name, placement, mesh: None, light: None, children, instances, tilt: 0.0 }
    }

    /// A node with a mesh.
    pub fn with_mesh(name: impl Into<String>, placement: Placement, mesh: usize) -> Self {
        Self { mesh: Some(mesh), ..Self::new(name, placement) }
    }
}

/// A glTF file under construction.
#[derive(Debug, Default)]
pub(super) struct Glb {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    images: Vec<(String, Vec<u8>)>,
    accessors: Vec<Value>,
    lights: Vec<Value>,
    /// Nodes that ride on waves.
    bobbing: Vec<usize>,
    pools: [Vec<u8>; Pool::COUNT],
}

impl Glb {
    /// Adds a material and gives its index.
    pub fn add_material(&mut self, material: Value) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Adds a PNG and the texture that shows it, and gives the texture's index.
    pub fn add_texture(&mut self, name: &str, png: Vec<u8>) -> usize {
        self.images.push((name.to_owned(), png));
        self.images.len() - 1
    }

    /// Adds a light of `KHR_lights_punctual` and gives its index.
    pub fn add_light(&mut self, light: Value) -> usize {
        self.lights.push(light);
        self.lights.len() - 1
    }

    /// Adds a mesh with a primitive for every surface, and gives its index.
    pub fn add_mesh(&mut self, name: &str, model: &Model) -> usize {
        let mut primitives = Vec::new();
        for (material, surface) in &model.surfaces {
            if !surface.indices.is_empty() {
                primitives.push(self.primitive(surface, *material));
            }
        }
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.meshes.len() - 1
    }

    /// Adds a node and gives its index.
    pub fn add_node(&mut self, node: &Node) -> usize {
        let mut object = Map::new();
        if !node.children.is_empty() {
            object.insert("children".into(), json!(node.children));
        }
        if !node.instances.is_empty() {
            let attributes = self.instance_attributes(&node.instances);
            object.insert(
                "extensions".into(),
                json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } }),
            );
        } else if let Some(light) = node.light {
            object
                .insert("extensions".into(), json!({ "KHR_lights_punctual": { "light": light } }));
        }
        if let Some(mesh) = node.mesh {
            object.insert("mesh".into(), json!(mesh));
        }
        object.insert("name".into(), json!(node.name));
        let Placement { translation, turn, scale } = node.placement;
        if turn != 0.0 || node.tilt != 0.0 {
            let ([_, y, _, w], (sine, cosine)) =
                (node.placement.rotation(), sin_cos(node.tilt * 0.5));
            let rotation = [w * sine, y * cosine, -y * sine, w * cosine];
            object.insert("rotation".into(), json!(rotation.map(decimal)));
        }
        if scale != Vec3::ONE {
            object.insert("scale".into(), json!(scale.to_array().map(decimal)));
        }
        if translation != Vec3::ZERO {
            object.insert("translation".into(), json!(translation.to_array().map(decimal)));
        }
        self.nodes.push(Value::Object(object));
        self.nodes.len() - 1
    }

    /// Lets a node ride on waves in the space of its parent.
    pub fn add_bobbing(&mut self, node: usize) {
        self.bobbing.push(node);
    }

    /// The animation of all that rides on waves: some motions, one for each node in turn.
    fn waves(&mut self) -> Value {
        let times: Vec<f32> = (0..KEYS).map(bobbing::time_s).collect();
        let input = self.add_accessor(Pool::Scales, &floats_of(&times), KEYS, F32, "SCALAR");
        self.accessors[input]["max"] = json!([LENGTH_S]);
        self.accessors[input]["min"] = json!([0.0]);
        let mut samplers = Vec::new();
        for motion in 0..MOTIONS {
            let poses: Vec<_> = (0..KEYS).map(|key| bobbing::pose(motion, key)).collect();
            let places: Vec<Vec3> = poses.iter().map(|pose| pose.translation).collect();
            let places = self.add_vec3s(Pool::Places, &places);
            let turns: Vec<u8> = poses.iter().flat_map(|pose| floats_of(&pose.rotation)).collect();
            let turns = self.add_accessor(Pool::Rotations, &turns, KEYS, F32, "VEC4");
            samplers.extend([places, turns].map(|of| json!({ "input": input, "output": of })));
        }
        let channels = self.bobbing.iter().enumerate().flat_map(|(number, node)| {
            let first = number % MOTIONS * 2;
            [(first, "translation"), (first + 1, "rotation")].map(|(sampler, path)| {
                json!({ "sampler": sampler, "target": { "node": node, "path": path } })
            })
        });
        let channels: Vec<Value> = channels.collect();
        json!([{ "channels": channels, "name": "waves", "samplers": samplers }])
    }

    /// Returns the number of nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    fn primitive(&mut self, surface: &MeshBuffer, material: Material) -> Value {
        let positions = self.add_vec3s(Pool::Positions, &surface.positions);
        let least = surface.positions.iter().fold(Vec3::INFINITY, |a, &p| a.min(p));
        let most = surface.positions.iter().fold(Vec3::NEG_INFINITY, |a, &p| a.max(p));
        self.accessors[positions]["max"] = json!(most.to_array());
        self.accessors[positions]["min"] = json!(least.to_array());
        let normals = self.add_vec3s(Pool::Normals, &surface.normals);
        let indices: Vec<u8> = surface.indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let count = surface.indices.len();
        let indices = self.add_accessor(Pool::Indices, &indices, count, U16, "SCALAR");
        let mut attributes = Map::new();
        if material.is_tinted() {
            let colors = surface.colors.as_flattened();
            let count = surface.colors.len();
            let colors = self.add_accessor(Pool::Colors, colors, count, U8, "VEC4");
            attributes.insert("COLOR_0".into(), json!(colors));
        }
        attributes.insert("NORMAL".into(), json!(normals));
        attributes.insert("POSITION".into(), json!(positions));
        if material.is_textured() {
            let uvs: Vec<u8> =
                surface.uvs.iter().flat_map(|uv| floats_of(&uv.to_array())).collect();
            let uvs = self.add_accessor(Pool::Uvs, &uvs, surface.uvs.len(), F32, "VEC2");
            attributes.insert("TEXCOORD_0".into(), json!(uvs));
        }
        json!({ "attributes": attributes, "indices": indices, "material": material.index() })
    }

    fn instance_attributes(&mut self, instances: &[Placement]) -> Value {
        let rotations: Vec<u8> =
            instances.iter().flat_map(|instance| floats_of(&instance.rotation())).collect();
        let rotations =
            self.add_accessor(Pool::Rotations, &rotations, instances.len(), F32, "VEC4");
        let scales: Vec<Vec3> = instances.iter().map(|instance| instance.scale).collect();
        let scales = self.add_vec3s(Pool::Scales, &scales);
        let places: Vec<Vec3> = instances.iter().map(|instance| instance.translation).collect();
        let places = self.add_vec3s(Pool::Places, &places);
        json!({ "ROTATION": rotations, "SCALE": scales, "TRANSLATION": places })
    }

    fn add_vec3s(&mut self, pool: Pool, values: &[Vec3]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| floats_of(&v.to_array())).collect();
        self.add_accessor(pool, &bytes, values.len(), F32, "VEC3")
    }

    fn add_accessor(
        &mut self,
        pool: Pool,
        bytes: &[u8],
        count: usize,
        component: u32,
        kind: &str,
    ) -> usize {
        let pool_bytes = &mut self.pools[pool as usize];
        let offset = pool_bytes.len();
        pool_bytes.extend_from_slice(bytes);
        pad(pool_bytes, 0);
        let mut accessor = Map::new();
        // Pools that stay empty are left out of the file; `finish` puts the right index here.
        accessor.insert("bufferView".into(), json!(pool as usize));
        accessor.insert("byteOffset".into(), json!(offset));
        accessor.insert("componentType".into(), json!(component));
        accessor.insert("count".into(), json!(count));
        if pool as usize == Pool::Positions as usize || (component, kind) == (F32, "SCALAR") {
            accessor.insert("max".into(), Value::Null);
            accessor.insert("min".into(), Value::Null);
        }
        if component == U8 {
            accessor.insert("normalized".into(), json!(true));
        }
        accessor.insert("type".into(), json!(kind));
        self.accessors.push(Value::Object(accessor));
        self.accessors.len() - 1
    }

    /// Puts the pools and the images one after the other; gives the bytes and their views.
    fn buffer(&mut self) -> (Vec<u8>, Vec<Value>) {
        let mut bytes = Vec::new();
        let mut views = Vec::new();
        for (index, pool) in self.pools.iter().enumerate() {
            let (stride, target) = Pool::layout(index);
            let mut view = Map::new();
            view.insert("buffer".into(), json!(0));
            view.insert("byteLength".into(), json!(pool.len()));
            view.insert("byteOffset".into(), json!(bytes.len()));
            if let Some(stride) = stride {
                view.insert("byteStride".into(), json!(stride));
            }
            if let Some(target) = target {
                view.insert("target".into(), json!(target));
            }
            views.push(Value::Object(view));
            bytes.extend_from_slice(pool);
        }
        for (_, png) in &self.images {
            let (length, offset) = (png.len(), bytes.len());
            views.push(json!({ "buffer": 0, "byteLength": length, "byteOffset": offset }));
            bytes.extend_from_slice(png);
            pad(&mut bytes, 0);
        }
        (bytes, views)
    }

    /// The whole file, with the given nodes at the root of its scene.
    pub fn finish(mut self, roots: &[usize]) -> Result<Vec<u8>, TownError> {
        let animations = (!self.bobbing.is_empty()).then(|| self.waves());
        let (mut bytes, views) = self.buffer();
        let image = |(n, (name, _)): (usize, &(String, Vec<u8>))| {
            let view = Pool::COUNT + n;
            json!({ "bufferView": view, "mimeType": "image/png", "name": name })
        };
        let images: Vec<Value> = self.images.iter().enumerate().map(image).collect();
        let textures: Vec<Value> =
            (0..images.len()).map(|n| json!({ "sampler": 0, "source": n })).collect();
        let mut document = json!({
            "accessors": self.accessors,
            "asset": { "generator": "polyptych", "version": "2.0" },
            "bufferViews": views,
            "buffers": [{ "byteLength": bytes.len() }],
            "extensions": { "KHR_lights_punctual": { "lights": self.lights } },
            "extensionsRequired": ["EXT_mesh_gpu_instancing"],
            "extensionsUsed": ["EXT_mesh_gpu_instancing", "KHR_lights_punctual"],
            "images": images,
            "materials": self.materials,
            "meshes": self.meshes,
            "nodes": self.nodes,
            "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }],
            "scene": 0,
            "scenes": [{ "name": "town", "nodes": roots }],
            "textures": textures,
        });
        if let (Some(animations), Some(keys)) = (animations, document.as_object_mut()) {
            keys.insert("animations".into(), animations);
        }
        let mut text = serde_json::to_vec(&document).map_err(TownError::Json)?;
        pad(&mut text, b' ');
        pad(&mut bytes, 0);
        container(&text, &bytes)
    }
}

/// Header and two chunks, glTF 2.0 §4.4.
fn container(text: &[u8], bytes: &[u8]) -> Result<Vec<u8>, TownError> {
    let length = |bytes: usize| u32::try_from(bytes).map_err(|_| TownError::TooLarge { bytes });
    let total = length(12 + 8 + text.len() + 8 + bytes.len())?;
    let mut file = Vec::with_capacity(total as usize);
    file.extend_from_slice(b"glTF");
    file.extend_from_slice(&2u32.to_le_bytes());
    file.extend_from_slice(&total.to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", bytes)] {
        file.extend_from_slice(&length(chunk.len())?.to_le_bytes());
        file.extend_from_slice(kind);
        file.extend_from_slice(chunk);
    }
    Ok(file)
}

/// Up to the next multiple of four.
fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

fn floats_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// A number of at most six decimals, so that the text stays short.
fn decimal(value: f32) -> f64 {
    let rounded = (f64::from(value) * 1e6).round() / 1e6;
    // Minus zero would be written as such.
    rounded + 0.0
}
