//! A scene from numbers that are written as glTF for the program, and given to the reference in
//! f64: both see the same, by ways that have nothing in common.

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3, Quat, Vec3};
use serde_json::{Value, json};

use super::scenes::Gltf;
use crate::reference::facet::{Corner, Facet, Texels};
use crate::reference::tone;

/// Parts without light, each below a chain of nodes.
#[derive(Clone, Default)]
pub struct Model {
    pub parts: Vec<Part>,
    /// A square picture of grey codes, which parts with coordinates show.
    pub picture: Option<(u32, Vec<u8>)>,
}

/// Triangles in one place.
#[derive(Clone)]
pub struct Part {
    /// The nodes' matrices, from the root down.
    pub chain: Vec<DMat4>,
    pub positions: Vec<Vec3>,
    /// Linear RGB of each vertex.
    pub colors: Vec<Vec3>,
    /// The picture's coordinates at each vertex; empty without the picture.
    pub uvs: Vec<[f32; 2]>,
    pub indices: Vec<u32>,
    pub is_double_sided: bool,
    /// If not empty, the part stands at each of these in the last node's space, and not at the node
    /// itself.
    pub copies: Vec<Instance>,
}

/// Translation, rotation and scale, as `EXT_mesh_gpu_instancing` has them.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    pub translation: Vec3,
    pub rotation: Quat,
    pub scale: Vec3,
}

impl Instance {
    fn matrix(&self) -> DMat4 {
        DMat4::from_scale_rotation_translation(
            self.scale.as_dvec3(),
            self.rotation.as_dquat().normalize(),
            self.translation.as_dvec3(),
        )
    }
}

impl Part {
    /// Triangles of one colour.
    pub fn flat(place: DMat4, positions: &[Vec3], color: Vec3) -> Self {
        Self {
            chain: vec![place],
            positions: positions.to_vec(),
            colors: vec![color; positions.len()],
            uvs: Vec::new(),
            indices: (0..positions.len() as u32).collect(),
            is_double_sided: false,
            copies: Vec::new(),
        }
    }

    /// A rectangle around `middle`, whose half sides go to the right and up as its front is seen.
    pub fn rectangle(place: DMat4, middle: Vec3, right: Vec3, up: Vec3, color: Vec3) -> Self {
        let corners = [-right - up, right - up, right + up, -right + up].map(|c| middle + c);
        let uvs = vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
        Self { uvs, indices: vec![0, 1, 2, 0, 2, 3], ..Self::flat(place, &corners, color) }
    }

    /// Returns the part without the picture.
    pub fn plain(self) -> Self {
        Self { uvs: Vec::new(), ..self }
    }

    /// Joins the triangles of another part; both stand in the same place.
    pub fn join(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.colors.extend(&other.colors);
        self.uvs.extend(&other.uvs);
        self.indices.extend(other.indices.iter().map(|index| first + index));
    }
}

impl Model {
    pub fn of(parts: Vec<Part>) -> Self {
        Self { parts, picture: None }
    }

    /// Returns the triangles that the reference draws.
    pub fn facets(&self) -> Vec<Facet> {
        let picture = self.picture.as_ref().map(|(side, codes)| {
            let linear = codes.iter().map(|&code| DVec3::splat(tone::linear(code))).collect();
            Arc::new(Texels { width: *side, linear })
        });
        let mut facets = Vec::new();
        let places = self.parts.iter().flat_map(|part| {
            let world = part.chain.iter().fold(DMat4::IDENTITY, |world, node| world * *node);
            let whole = part.copies.is_empty().then_some(world);
            let copies = part.copies.iter().map(move |copy| world * copy.matrix());
            copies.chain(whole).map(move |place| (part, place))
        });
        for (part, world) in places {
            let corner = |&index: &u32| {
                let index = index as usize;
                let uv = part.uvs.get(index).copied().unwrap_or_default();
                Corner {
                    place: world.transform_point3(part.positions[index].as_dvec3()),
                    color: part.colors[index].as_dvec3(),
                    uv: DVec2::new(f64::from(uv[0]), f64::from(uv[1])),
                }
            };
            // glTF: where a transform mirrors, the front is the other way around.
            let is_mirrored = world.determinant() < 0.0;
            facets.extend(part.indices.chunks(3).map(|triangle| {
                let mut corners = [0, 1, 2].map(|i| corner(&triangle[i]));
                if is_mirrored {
                    corners.swap(1, 2);
                }
                let picture = picture.clone().filter(|_| !part.uvs.is_empty());
                Facet { corners, picture, is_double_sided: part.is_double_sided }
            }));
        }
        facets
    }

    /// Returns the file that the program draws.
    pub fn gltf(&self) -> Gltf {
        let mut file = Writer::default();
        for part in &self.parts {
            file.part(part);
        }
        let material = |is_double_sided: bool, has_picture: bool| {
            let mut material = json!({
                "doubleSided": is_double_sided,
                "extensions": { "KHR_materials_unlit": {} },
            });
            if has_picture {
                material["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": 0 } });
            }
            material
        };
        let materials: Vec<Value> =
            (0..4).map(|i| material(i & 1 == 1, i & 2 == 2 && self.picture.is_some())).collect();
        let mut json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": file.roots }],
            "extensionsUsed": ["KHR_materials_unlit", "EXT_mesh_gpu_instancing"],
            "materials": materials,
            "meshes": file.meshes, "nodes": file.nodes, "accessors": file.accessors,
        });
        if let Some((side, codes)) = &self.picture {
            let png = grey(*side, codes);
            let view = file.view(&png);
            json["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
            // No smaller levels: the reference has none.
            let clamp = 33071;
            json["samplers"] = json!([
                { "magFilter": 9729, "minFilter": 9729, "wrapS": clamp, "wrapT": clamp },
            ]);
            json["textures"] = json!([{ "source": 0, "sampler": 0 }]);
        }
        json["bufferViews"] = json!(file.views);
        Gltf { json, bin: file.bin }
    }
}

/// A glTF under construction.
#[derive(Default)]
struct Writer {
    nodes: Vec<Value>,
    roots: Vec<usize>,
    meshes: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    bin: Vec<u8>,
}

impl Writer {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len(),
        }));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "count": count, "type": kind,
        }));
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, count: usize, floats: impl Iterator<Item = f32>) -> usize {
        let bytes: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
        self.accessor(kind, 5126, count, &bytes)
    }

    fn copies(&mut self, copies: &[Instance]) -> Value {
        let count = copies.len();
        let each = |floats: fn(&Instance) -> Vec<f32>| copies.iter().flat_map(floats);
        let translations = each(|copy| copy.translation.to_array().to_vec());
        let translations = self.floats("VEC3", count, translations);
        let rotations = self.floats("VEC4", count, each(|copy| copy.rotation.to_array().to_vec()));
        let scales = self.floats("VEC3", count, each(|copy| copy.scale.to_array().to_vec()));
        json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales })
    }

    fn part(&mut self, part: &Part) {
        let count = part.positions.len();
        let vectors = |list: &[Vec3]| list.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
        let positions = self.floats("VEC3", count, vectors(&part.positions).into_iter());
        let colors = self.floats("VEC3", count, vectors(&part.colors).into_iter());
        let mut attributes = json!({ "POSITION": positions, "COLOR_0": colors });
        if !part.uvs.is_empty() {
            let uvs = self.floats("VEC2", count, part.uvs.iter().flatten().copied());
            attributes["TEXCOORD_0"] = json!(uvs);
        }
        let bytes: Vec<u8> = part.indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        let indices = self.accessor("SCALAR", 5125, part.indices.len(), &bytes);
        let material = usize::from(part.is_double_sided) + 2 * usize::from(!part.uvs.is_empty());
        self.meshes.push(json!({ "primitives": [
            { "attributes": attributes, "indices": indices, "material": material },
        ] }));
        self.roots.push(self.nodes.len());
        for (depth, matrix) in part.chain.iter().enumerate() {
            let mut node = json!({ "matrix": matrix.to_cols_array() });
            if depth + 1 < part.chain.len() {
                node["children"] = json!([self.nodes.len() + 1]);
            } else {
                node["mesh"] = json!(self.meshes.len() - 1);
                if !part.copies.is_empty() {
                    let attributes = self.copies(&part.copies);
                    node["extensions"] =
                        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
                }
            }
            self.nodes.push(node);
        }
    }
}

fn grey(side: u32, codes: &[u8]) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(side, side, |x, y| {
        image::Rgb([codes[(y * side + x) as usize]; 3])
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("encoded");
    bytes.into_inner()
}
