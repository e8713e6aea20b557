//! Meshes, materials and pictures that a program makes, as the bytes of a glTF file.

use std::fmt::Write as _;
use std::io;

use bytes::Bytes;
use glam::Vec3;
use polyptych_protocol::transaction::AssetSource;
use polyptych_scene::glb::{
    AccessorDesc, Component, GlbWriter, JsonList, ViewTarget, material_json,
};
use polyptych_scene::{AlphaMode, Material, Topology, provisional_asset};

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

/// The reason why assets cannot be sent.
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
    /// A text that cannot be a mesh.
    #[error("the label: {what}")]
    Label {
        /// The fault, and what would be right.
        what: String,
    },
    /// A material that names what is not there, or has an invalid number.
    #[error("material {material}: {what}")]
    Material {
        /// Its index among those that were added.
        material: usize,
        /// The fault.
        what: String,
    },
    /// All of them together make no file.
    #[error("the file of the assets: {0}")]
    File(String),
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
        for (mesh, (data, material)) in self.meshes.iter().enumerate() {
            check_mesh(data, *material, self.materials.len())
                .map_err(|what| AssetError::Mesh { mesh, what })?;
        }
        for (index, material) in self.materials.iter().enumerate() {
            check_material(material, self.pictures.len())
                .map_err(|what| AssetError::Material { material: index, what })?;
        }
        self.write().map_err(|error| AssetError::File(error.to_string()))
    }

    /// The bytes of [`Assets::to_glb`], of assets that are sound.
    fn write(&self) -> io::Result<Bytes> {
        let mut file = GlbWriter::new(Vec::new());
        let [mut meshes, mut nodes, mut materials, mut images, mut textures, mut scenes] =
            [(); 6].map(|()| JsonList::default());
        let mut roots = JsonList::default();
        for (data, material) in &self.meshes {
            let mesh = meshes.push(&mesh_json(&mut file, data, *material)?);
            // Meshes that no node shows are not read.
            let node = nodes.push(&format!(r#"{{"mesh":{mesh}}}"#));
            roots.push(&node.to_string());
        }
        for material in &self.materials {
            materials.push(&material_json(material, &mut file));
        }
        for picture in &self.pictures {
            let image = images.push(&file.picture(picture)?);
            textures.push(&format!(r#"{{"source":{image}}}"#));
        }
        scenes.push(&roots.as_member("nodes"));
        let lists = [
            ("scenes", &scenes),
            ("nodes", &nodes),
            ("meshes", &meshes),
            ("materials", &materials),
            ("images", &images),
            ("textures", &textures),
        ];
        let (mut head, binary) = file.finish(&lists, None)?;
        head.extend(binary);
        Ok(head.into())
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
    if let Some(fault) = material.extensions.as_ref().and_then(|of| of.fault()) {
        return Err(fault);
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

/// Writes a mesh; returns its value in the list of meshes.
fn mesh_json(
    file: &mut GlbWriter<Vec<u8>>,
    mesh: &MeshData,
    material: Option<u32>,
) -> io::Result<String> {
    let positions = mesh.positions.iter();
    let min = positions.clone().copied().reduce(Vec3::min).unwrap_or_default();
    let max = positions.copied().reduce(Vec3::max).unwrap_or_default();
    let rows = mesh.positions.iter().map(Vec3::to_array);
    let at = file.floats(true, rows, Some((min, max)))?;
    let mut attributes = format!(r#""POSITION":{at}"#);
    if !mesh.normals.is_empty() {
        let at = file.floats(true, mesh.normals.iter().map(Vec3::to_array), None)?;
        let _ = write!(attributes, r#","NORMAL":{at}"#);
    }
    if !mesh.uvs.is_empty() {
        let at = file.floats(true, mesh.uvs.iter().map(glam::Vec2::to_array), None)?;
        let _ = write!(attributes, r#","TEXCOORD_0":{at}"#);
    }
    if !mesh.colors.is_empty() {
        let at = file.floats(true, mesh.colors.iter().map(glam::Vec4::to_array), None)?;
        let _ = write!(attributes, r#","COLOR_0":{at}"#);
    }
    let mode = match mesh.topology {
        Topology::Points => 0,
        Topology::Lines => 1,
        Topology::Triangles => 4,
    };
    let mut json = format!(r#"{{"primitives":[{{"attributes":{{{attributes}}},"mode":{mode}"#);
    if !mesh.indices.is_empty() {
        let bytes: Vec<u8> = mesh.indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        let view = file.view(ViewTarget::Indices, &bytes)?;
        let count = mesh.indices.len() as u32;
        let component = Component::U32;
        let of = AccessorDesc { view, offset: 0, component, count, width: 1, bounds: None };
        let _ = write!(json, r#","indices":{}"#, file.accessor(&of));
    }
    if let Some(material) = material {
        let _ = write!(json, r#","material":{material}"#);
    }
    Ok(json + "}]}")
}

#[cfg(test)]
mod tests {
    use glam::Affine2;
    use polyptych_scene::TextureRef;

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
