//! Meshes, materials and pictures that a program makes, as the bytes of a glTF file.

use std::fmt::Write;

use bytes::{BufMut, Bytes, BytesMut};
use glam::{Affine2, Vec3};
use polyptych_protocol::transaction::AssetSource;
use polyptych_scene::{AlphaMode, Material, TextureRef, Topology, provisional_asset};

use crate::mesh_data::MeshData;

/// Assets for a transaction.
///
/// ```
/// use polyptych_client::glam::{Vec3, Vec4};
/// use polyptych_client::{Assets, Material, MeshData, NewNode, Transaction};
///
/// let mut assets = Assets::default();
/// let red = Material { base_color: Vec4::new(1.0, 0.0, 0.0, 1.0), ..Assets::matt() };
/// let red = assets.add_material(red);
/// let brick = assets.add_mesh(MeshData::cuboid(Vec3::new(0.2, 0.1, 0.1)), Some(red));
/// let mut transaction = Transaction::default().with_assets(assets.to_source()?);
/// transaction.create(NewNode { mesh: Some(brick), ..NewNode::default() });
/// # Ok::<(), polyptych_client::AssetError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Assets {
    meshes: Vec<(MeshData, Option<u32>)>,
    materials: Vec<Material>,
    pictures: Vec<Bytes>,
}

/// Why assets cannot be sent.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssetError {
    /// A mesh whose arrays do not fit.
    #[error("mesh {mesh}: {what}")]
    Mesh {
        /// Its index among those that were added.
        mesh: usize,
        /// The fault, and what would be right.
        what: String,
    },
    /// A material that names what is not there, or has a number that is none.
    #[error("material {material}: {what}")]
    Material {
        /// Its index among those that were added.
        material: usize,
        /// The fault.
        what: String,
    },
}

impl Assets {
    /// A white surface without gloss, which suits as a beginning better than glTF's default, a
    /// metal.
    pub fn matt() -> Material {
        Material { metallic: 0.0, ..Material::default() }
    }

    /// Adds a picture, the bytes of a PNG or JPEG file. Returns its index, for
    /// [`TextureRef::texture`] of these materials.
    pub fn add_picture(&mut self, file: impl Into<Bytes>) -> u32 {
        self.pictures.push(file.into());
        self.pictures.len() as u32 - 1
    }

    /// Adds a material, whose textures are pictures of these assets. Returns its index, for meshes
    /// of these assets.
    pub fn add_material(&mut self, material: Material) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Adds a mesh, with a material of these assets or with glTF's default one. Returns its number
    /// in the transaction that brings it; `Edited::mesh` says its own number once that is done.
    pub fn add_mesh(&mut self, mesh: MeshData, material: Option<u32>) -> u32 {
        self.meshes.push((mesh, material));
        provisional_asset(self.meshes.len() as u32 - 1)
    }

    /// Returns whether there are none.
    pub fn is_empty(&self) -> bool {
        self.meshes.is_empty() && self.materials.is_empty() && self.pictures.is_empty()
    }

    /// All of them, for [`Transaction::with_assets`](crate::Transaction::with_assets).
    ///
    /// # Errors
    /// [`AssetError`].
    pub fn to_source(&self) -> Result<AssetSource, AssetError> {
        self.to_glb().map(AssetSource::Glb)
    }

    /// All of them as the bytes of a binary glTF file (glTF 2.0, section 4.4).
    ///
    /// # Errors
    /// [`AssetError`].
    pub fn to_glb(&self) -> Result<Bytes, AssetError> {
        let mut file = GlbWriter::default();
        let mut meshes = Vec::new();
        for (mesh, (data, material)) in self.meshes.iter().enumerate() {
            check_mesh(data, *material, self.materials.len())
                .map_err(|what| AssetError::Mesh { mesh, what })?;
            meshes.push(file.mesh(data, *material));
        }
        let mut materials = Vec::new();
        for (index, material) in self.materials.iter().enumerate() {
            check_material(material, self.pictures.len())
                .map_err(|what| AssetError::Material { material: index, what })?;
            materials.push(material_json(material));
        }
        let images: Vec<String> = self.pictures.iter().map(|bytes| file.picture(bytes)).collect();
        let textures = (0..images.len()).map(|image| format!(r#"{{"source":{image}}}"#)).collect();
        // What no node shows is not read.
        let nodes = (0..meshes.len()).map(|mesh| format!(r#"{{"mesh":{mesh}}}"#)).collect();
        let all: Vec<String> = (0..meshes.len()).map(|node| node.to_string()).collect();
        let scenes = vec![format!(r#"{{"nodes":[{}]}}"#, all.join(","))];
        let scenes = if meshes.is_empty() { Vec::new() } else { scenes };
        Ok(file.finish(&[
            ("scenes", scenes),
            ("nodes", nodes),
            ("meshes", meshes),
            ("materials", materials),
            ("images", images),
            ("textures", textures),
        ]))
    }
}

fn check_mesh(mesh: &MeshData, material: Option<u32>, materials: usize) -> Result<(), String> {
    let vertices = mesh.positions.len();
    if let Some(material) = material.filter(|material| *material as usize >= materials) {
        return Err(format!("there is no material {material}; {materials} were added"));
    }
    for (what, count) in
        [("normals", mesh.normals.len()), ("uvs", mesh.uvs.len()), ("colors", mesh.colors.len())]
    {
        if count != 0 && count != vertices {
            return Err(format!("{count} {what} for {vertices} positions; give one for each"));
        }
    }
    let all = mesh.positions.iter().chain(&mesh.normals).all(|of| of.is_finite());
    if !(all
        && mesh.uvs.iter().all(|of| of.is_finite())
        && mesh.colors.iter().all(|of| of.is_finite()))
    {
        return Err("a number of it is not finite".to_owned());
    }
    let count = if mesh.indices.is_empty() { vertices } else { mesh.indices.len() };
    let each = match mesh.topology {
        Topology::Triangles => 3,
        Topology::Lines => 2,
        Topology::Points => 1,
    };
    if count == 0 || !count.is_multiple_of(each) {
        return Err(format!("{count} indices, where a multiple of {each} is needed"));
    }
    match mesh.indices.iter().find(|index| **index as usize >= vertices) {
        Some(index) => Err(format!("there is no vertex {index}; it has {vertices} positions")),
        None => Ok(()),
    }
}

fn check_material(material: &Material, pictures: usize) -> Result<(), String> {
    if let Some(of) = material.textures().find(|of| of.texture as usize >= pictures) {
        return Err(format!("there is no picture {}; {pictures} were added", of.texture));
    }
    let numbers =
        [material.metallic, material.roughness, material.normal_scale, material.occlusion_strength];
    let cutoff = if let AlphaMode::Mask(cutoff) = material.alpha_mode { cutoff } else { 0.0 };
    let transforms = material.textures().all(|of| of.uv_transform.is_finite());
    let is_finite = numbers.iter().all(|number| number.is_finite()) && cutoff.is_finite();
    if is_finite && material.base_color.is_finite() && material.emissive.is_finite() && transforms {
        return Ok(());
    }
    Err("a number of it is not finite".to_owned())
}

/// A material in glTF's terms. No text of it comes from outside, so nothing is to be escaped.
fn material_json(of: &Material) -> String {
    let texture = |of: TextureRef| {
        let (scale, angle, offset) = of.uv_transform.to_scale_angle_translation();
        let moved = if of.uv_transform == Affine2::IDENTITY {
            String::new()
        } else {
            // glTF turns the other way: its v points down (KHR_texture_transform).
            let offset = format!(r#""offset":[{},{}],"rotation":{}"#, offset.x, offset.y, -angle);
            let transform = format!(r#"{{{offset},"scale":[{},{}]}}"#, scale.x, scale.y);
            format!(r#","extensions":{{"KHR_texture_transform":{transform}}}"#)
        };
        (of.texture, of.uv_set, moved)
    };
    let slot = |key: &str, of: Option<TextureRef>, more: &str| {
        of.map(texture).map_or_else(String::new, |(index, set, moved)| {
            format!(r#","{key}":{{"index":{index},"texCoord":{set}{more}{moved}}}"#)
        })
    };
    let [r, g, b, a] = of.base_color.to_array();
    let strength = of.emissive.max_element().max(1.0);
    let Vec3 { x, y, z } = of.emissive / strength;
    let factors = format!(
        r#""baseColorFactor":[{r},{g},{b},{a}],"metallicFactor":{},"roughnessFactor":{}"#,
        of.metallic, of.roughness,
    );
    let base_color = slot("baseColorTexture", of.base_color_texture, "");
    let metallic_roughness = slot("metallicRoughnessTexture", of.metallic_roughness_texture, "");
    let mut json =
        format!(r#"{{"pbrMetallicRoughness":{{{factors}{base_color}{metallic_roughness}}}"#);
    let _ = write!(json, r#","emissiveFactor":[{x},{y},{z}],"doubleSided":{}"#, of.double_sided);
    let scale = format!(r#","scale":{}"#, of.normal_scale);
    json += &slot("normalTexture", of.normal_texture, &scale);
    let strength_of_occlusion = format!(r#","strength":{}"#, of.occlusion_strength);
    json += &slot("occlusionTexture", of.occlusion_texture, &strength_of_occlusion);
    json += &slot("emissiveTexture", of.emissive_texture, "");
    match of.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            let _ = write!(json, r#","alphaMode":"MASK","alphaCutoff":{cutoff}"#);
        }
        AlphaMode::Blend => json.push_str(r#","alphaMode":"BLEND""#),
    }
    let mut extensions = Vec::new();
    if of.unlit {
        extensions.push(r#""KHR_materials_unlit":{}"#.to_owned());
    }
    if strength > 1.0 {
        extensions.push(format!(
            r#""KHR_materials_emissive_strength":{{"emissiveStrength":{strength}}}"#
        ));
    }
    if !extensions.is_empty() {
        let _ = write!(json, r#","extensions":{{{}}}"#, extensions.join(","));
    }
    json + "}"
}

/// A binary glTF file under way.
#[derive(Debug, Default)]
struct GlbWriter {
    bytes: BytesMut,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl GlbWriter {
    /// Begins what comes next on a multiple of four bytes.
    fn view(&mut self, write: impl FnOnce(&mut BytesMut)) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        write(&mut self.bytes);
        let length = self.bytes.len() - offset;
        self.views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}}}"#));
        self.views.len() - 1
    }

    fn accessor<const N: usize>(
        &mut self,
        rows: impl ExactSizeIterator<Item = [f32; N]>,
        bounds: Option<(Vec3, Vec3)>,
    ) -> usize {
        let count = rows.len();
        let view = self.view(|bytes| rows.flatten().for_each(|number| bytes.put_f32_le(number)));
        let bounds = bounds.map_or_else(String::new, |(min, max)| {
            format!(
                r#","min":[{},{},{}],"max":[{},{},{}]"#,
                min.x, min.y, min.z, max.x, max.y, max.z
            )
        });
        let floats = format!(r#""bufferView":{view},"componentType":5126,"count":{count}"#);
        self.accessors.push(format!(r#"{{{floats},"type":"VEC{N}"{bounds}}}"#));
        self.accessors.len() - 1
    }

    fn mesh(&mut self, mesh: &MeshData, material: Option<u32>) -> String {
        let positions = mesh.positions.iter();
        let min = positions.clone().copied().reduce(Vec3::min).unwrap_or_default();
        let max = positions.copied().reduce(Vec3::max).unwrap_or_default();
        let at = self.accessor(mesh.positions.iter().map(Vec3::to_array), Some((min, max)));
        let mut attributes = format!(r#""POSITION":{at}"#);
        if !mesh.normals.is_empty() {
            let at = self.accessor(mesh.normals.iter().map(Vec3::to_array), None);
            let _ = write!(attributes, r#","NORMAL":{at}"#);
        }
        if !mesh.uvs.is_empty() {
            let at = self.accessor(mesh.uvs.iter().map(glam::Vec2::to_array), None);
            let _ = write!(attributes, r#","TEXCOORD_0":{at}"#);
        }
        if !mesh.colors.is_empty() {
            let at = self.accessor(mesh.colors.iter().map(glam::Vec4::to_array), None);
            let _ = write!(attributes, r#","COLOR_0":{at}"#);
        }
        let mode = match mesh.topology {
            Topology::Points => 0,
            Topology::Lines => 1,
            Topology::Triangles => 4,
        };
        let mut json = format!(r#"{{"primitives":[{{"attributes":{{{attributes}}},"mode":{mode}"#);
        if !mesh.indices.is_empty() {
            let view =
                self.view(|bytes| mesh.indices.iter().for_each(|index| bytes.put_u32_le(*index)));
            self.accessors.push(format!(
                r#"{{"bufferView":{view},"componentType":5125,"count":{},"type":"SCALAR"}}"#,
                mesh.indices.len()
            ));
            let _ = write!(json, r#","indices":{}"#, self.accessors.len() - 1);
        }
        if let Some(material) = material {
            let _ = write!(json, r#","material":{material}"#);
        }
        json + "}]}"
    }

    fn picture(&mut self, file: &[u8]) -> String {
        let kind = if file.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
        let view = self.view(|bytes| bytes.put_slice(file));
        format!(r#"{{"bufferView":{view},"mimeType":"{kind}"}}"#)
    }

    fn finish(mut self, lists: &[(&str, Vec<String>)]) -> Bytes {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let used = ["texture_transform", "materials_unlit", "materials_emissive_strength"];
        let used = used.map(|name| format!("\"KHR_{name}\"")).join(",");
        let buffers = format!(r#"[{{"byteLength":{}}}]"#, self.bytes.len());
        let mut json = format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":[{used}],"buffers":{buffers}"#
        );
        let own = [("bufferViews", &self.views), ("accessors", &self.accessors)];
        for (key, list) in own.into_iter().chain(lists.iter().map(|(key, list)| (*key, list))) {
            if !list.is_empty() {
                let _ = write!(json, r#","{key}":[{}]"#, list.join(","));
            }
        }
        json.push('}');
        while !json.len().is_multiple_of(4) {
            json.push(' ');
        }
        let mut file = BytesMut::new();
        let length = 12 + 8 + json.len() + 8 + self.bytes.len();
        file.put_slice(b"glTF");
        file.put_u32_le(2);
        file.put_u32_le(length as u32);
        file.put_u32_le(json.len() as u32);
        file.put_slice(b"JSON");
        file.put_slice(json.as_bytes());
        file.put_u32_le(self.bytes.len() as u32);
        file.put_slice(b"BIN\0");
        file.put_slice(&self.bytes);
        file.freeze()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assets_that_do_not_fit_are_refused_by_name() {
        let one = MeshData::cuboid(Vec3::ONE);
        let cases: [(MeshData, Option<u32>, &str); 5] = [
            (
                MeshData { normals: vec![Vec3::X], ..one.clone() },
                None,
                "1 normals for 24 positions",
            ),
            (MeshData { indices: vec![0, 1, 24], ..one.clone() }, None, "there is no vertex 24"),
            (MeshData { indices: vec![0, 1], ..one.clone() }, None, "a multiple of 3"),
            (MeshData { positions: vec![Vec3::NAN; 24], ..one.clone() }, None, "not finite"),
            (one, Some(0), "there is no material 0; 0 were added"),
        ];
        for (mesh, material, part) in cases {
            let mut assets = Assets::default();
            assets.add_mesh(mesh, material);
            let error = assets.to_glb().expect_err(part).to_string();
            assert!(error.starts_with("mesh 0: ") && error.contains(part), "{error}");
        }
        let mut assets = Assets::default();
        let texture = TextureRef { texture: 3, uv_set: 0, uv_transform: Affine2::IDENTITY };
        assets.add_material(Material { base_color_texture: Some(texture), ..Assets::matt() });
        let error = assets.to_glb().expect_err("no picture").to_string();
        assert_eq!(error, "material 0: there is no picture 3; 0 were added");
    }
}
