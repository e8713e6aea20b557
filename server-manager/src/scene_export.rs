//! A scene as it stands, as a binary glTF file.
//!
//! Vertices and indices are copied as their blobs have them, textures are PNG of their largest
//! level, and transforms are the scene's own f64. The baker makes the same scene of it again, but
//! for what the notes say, and for the numbers of nodes, meshes and materials.

mod description;
mod finest_level;
mod picture;
mod surroundings;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use glam::{DAffine3, DVec3};
use polyptych_core::EditedScene;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::exported_scene::ExportedScene;
use polyptych_scene::glb::{
    AccessorDesc, Component, GlbWriter, JsonList, ViewTarget, is_decomposable, material_json,
    quoted,
};
use polyptych_scene::{
    AssetManifests, IndexFormat, NodeId, NodeStyle, Primitive, Scene, SceneEdits, VertexLayout,
};
use polyptych_text::counted;

use crate::import::read_scene;
use description::{NodeJson, left_out, light_json, mode, sampler_json};
use finest_level::FinestLevel;
use picture::png;

/// Writes a scene into a nameless file in `folder`, and returns its description and all of its
/// bytes. Calls `step` with the percentage that is done; `false` ends it.
///
/// # Errors
/// The blob that is missing, the disk's reason, or that the file would be too large.
pub fn write(
    scene: &EditedScene,
    store: &BlobStore,
    folder: &Path,
    step: &mut dyn FnMut(u8) -> bool,
) -> Result<(ExportedScene, impl Read + Send + use<>), String> {
    let cannot = |error: io::Error| {
        format!("the file of the export cannot be written in {}: {error}", folder.display())
    };
    let base = read_scene(store, scene.scene.manifest)?;
    let mut added = AssetManifests::new();
    for manifest in scene.edits.asset_manifests() {
        added.insert(manifest, Arc::new(read_scene(store, manifest)?));
    }
    let (whole, ids) = scene.edits.apply_with_hidden(&base, &added);
    let (notes, hidden_at_rest) = (left_out(&base), base.animations.hidden_at_rest());
    drop((base, added));
    let binary = tempfile::tempfile_in(folder).map_err(cannot)?;
    let binary = BufWriter::new(binary);
    let writer = SceneWriter::new(&whole, store, binary, step);
    let mut writer = SceneWriter { notes, hidden_at_rest, ..writer };
    let written = writer.write(&ids, &scene.edits).and_then(|lists| {
        let (notes, file) = (std::mem::take(&mut writer.notes), writer.file);
        let (head, binary) = lists.finish(file)?;
        let mut binary = binary.into_inner().map_err(io::IntoInnerError::into_error)?;
        binary.rewind()?;
        let bytes = head.len() as u64 + binary.metadata()?.len();
        let about = ExportedScene {
            name: scene.scene.name.clone(),
            bytes,
            nodes: ids.len() as u64,
            meshes: lists.meshes.len().into(),
            textures: lists.textures.len().into(),
            notes,
        };
        Ok((about, io::Cursor::new(head).chain(binary)))
    });
    written.map_err(|error| match error {
        ExportError::Io(error) => cannot(error),
        ExportError::Other(reason) => reason,
    })
}

/// Why a file cannot be written.
enum ExportError {
    /// The disk says so.
    Io(io::Error),
    /// For a person.
    Other(String),
}

impl From<io::Error> for ExportError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// The lists of the JSON.
#[derive(Debug, Default)]
struct Lists {
    scenes: JsonList,
    nodes: JsonList,
    meshes: JsonList,
    materials: JsonList,
    textures: JsonList,
    samplers: JsonList,
    images: JsonList,
    lights: JsonList,
    image_based_lights: JsonList,
}

impl Lists {
    fn finish<W: Write>(&self, file: GlbWriter<W>) -> io::Result<(Vec<u8>, W)> {
        let lists = [
            ("scenes", &self.scenes),
            ("nodes", &self.nodes),
            ("meshes", &self.meshes),
            ("materials", &self.materials),
            ("textures", &self.textures),
            ("samplers", &self.samplers),
            ("images", &self.images),
        ];
        let lights =
            [("KHR_lights_punctual", &self.lights), (surroundings::NAME, &self.image_based_lights)];
        let lights = lights.into_iter().filter(|(_, list)| !list.is_empty());
        let lights = lights.map(|(name, list)| format!(r#""{name}":{}"#, list.as_member("lights")));
        let lights = lights.collect::<Vec<_>>().join(",");
        file.finish(&lists, (!lights.is_empty()).then_some(&format!("{{{lights}}}")))
    }
}

/// The part of a mesh that has its zero at one place, as a mesh of the file.
#[derive(Clone, Copy, Debug)]
struct Part {
    origin: DVec3,
    mesh: u32,
}

/// A file under way.
struct SceneWriter<'a> {
    scene: &'a Scene,
    store: &'a BlobStore,
    file: GlbWriter<BufWriter<File>>,
    step: &'a mut dyn FnMut(u8) -> bool,
    /// Bytes of blobs that are in the file, and of all that will be.
    done: u64,
    total: u64,
    notes: Vec<String>,
    /// The nodes of the scene's file that are hidden until a clip shows them.
    hidden_at_rest: BTreeSet<u32>,
    /// Attributes and indices of primitives that are in the file.
    geometry: BTreeMap<(BlobHash, VertexLayout, u32, u8), String>,
}

impl<'a> SceneWriter<'a> {
    fn new(
        scene: &'a Scene,
        store: &'a BlobStore,
        binary: BufWriter<File>,
        step: &'a mut dyn FnMut(u8) -> bool,
    ) -> Self {
        let (notes, hidden_at_rest, geometry) = (Vec::new(), BTreeSet::new(), BTreeMap::new());
        let file = GlbWriter::new(binary);
        Self { scene, store, file, step, done: 0, total: 0, notes, hidden_at_rest, geometry }
    }

    fn write(&mut self, ids: &[NodeId], edits: &SceneEdits) -> Result<Lists, ExportError> {
        let scene = self.scene;
        let is_drawn = |mesh: &u32| {
            scene.meshes.get(*mesh as usize).is_some_and(|mesh| !mesh.primitives.is_empty())
        };
        let meshes: BTreeSet<u32> =
            scene.nodes.iter().filter_map(|node| node.mesh).filter(is_drawn).collect();
        let primitives = || meshes.iter().flat_map(|mesh| &scene.meshes[*mesh as usize].primitives);
        let materials: BTreeSet<u32> = primitives().filter_map(|of| of.material).collect();
        let textures: BTreeSet<u32> = materials
            .iter()
            .flat_map(|material| scene.materials[*material as usize].textures())
            .map(|of| of.texture)
            .collect();
        let sizes = textures.iter().map(|texture| scene.textures[*texture as usize].bytes());
        self.total = primitives().map(Primitive::bytes).chain(sizes).sum();

        let mut lists = Lists::default();
        let textures = self.textures(&textures, &mut lists)?;
        let materials = self.materials(&materials, &textures, &mut lists);
        let mut parts = BTreeMap::new();
        for mesh in meshes {
            parts.insert(mesh, self.mesh(mesh, &materials, &mut lists)?);
        }
        self.surroundings(&mut lists)?;
        self.nodes(ids, edits, &parts, &mut lists)?;
        if !scene.variants.is_empty() {
            self.notes.push("variants: the file has the look that is shown, no other".to_owned());
        }
        if scene.exposure.is_some() {
            self.notes.push("the exposure is not in the file: viewers choose their own".to_owned());
        }
        Ok(lists)
    }

    /// Reads a blob of a size that the manifest says.
    fn blob(&mut self, hash: BlobHash, bytes: u64) -> Result<Bytes, ExportError> {
        let percent = (self.done.min(self.total) * 100 / self.total.max(1)) as u8;
        if !(self.step)(percent) {
            return Err(ExportError::Other("nobody waits for the export any more".to_owned()));
        }
        self.done += bytes;
        let blob = self.stored(hash)?;
        if blob.len() as u64 != bytes {
            let reason = format!("blob {hash} has {} bytes instead of {bytes}", blob.len());
            return Err(ExportError::Other(reason));
        }
        Ok(blob)
    }

    fn stored(&self, hash: BlobHash) -> Result<Bytes, ExportError> {
        let blob = self.store.read(hash).map_err(|error| ExportError::Other(error.to_string()))?;
        blob.ok_or_else(|| ExportError::Other(format!("blob {hash} is not in the store")))
    }

    /// Writes these textures; returns the new number of each.
    fn textures(
        &mut self,
        used: &BTreeSet<u32>,
        lists: &mut Lists,
    ) -> Result<BTreeMap<u32, u32>, ExportError> {
        let (mut images, mut samplers) = (BTreeMap::new(), BTreeMap::new());
        let mut numbers = BTreeMap::new();
        for &number in used {
            let texture = &self.scene.textures[number as usize];
            let key = (texture.blob, texture.width, texture.height);
            let image = if let Some(&image) = images.get(&key) {
                image
            } else {
                let blob = self.blob(texture.blob, texture.bytes())?;
                let image = self.file.picture(&png(texture.width, texture.height, &blob)?)?;
                let image = lists.images.push(&image);
                images.insert(key, image);
                image
            };
            let json = sampler_json(texture.sampler);
            let next = lists.samplers.len();
            let sampler = *samplers.entry(json.clone()).or_insert(next);
            if sampler == next {
                lists.samplers.push(&json);
            }
            let json = format!(r#"{{"sampler":{sampler},"source":{image}}}"#);
            numbers.insert(number, lists.textures.push(&json));
        }
        Ok(numbers)
    }

    /// Describes these materials; returns the new number of each.
    fn materials(
        &mut self,
        used: &BTreeSet<u32>,
        textures: &BTreeMap<u32, u32>,
        lists: &mut Lists,
    ) -> BTreeMap<u32, u32> {
        let mut numbers = BTreeMap::new();
        let mut sheared = 0;
        for &number in used {
            let mut material = self.scene.materials[number as usize].clone();
            sheared += material.textures().filter(|of| !is_decomposable(&of.uv_transform)).count();
            for of in material.textures_mut() {
                of.texture = textures.get(&of.texture).copied().unwrap_or_default();
            }
            let json = material_json(&material, &mut self.file);
            numbers.insert(number, lists.materials.push(&json));
        }
        if sheared > 0 {
            let textures = counted(sheared, "texture");
            self.notes.push(format!("materials: {textures} are sheared, which glTF cannot say"));
        }
        numbers
    }

    /// Writes a mesh, in a part for each place where vertices have their zero.
    fn mesh(
        &mut self,
        number: u32,
        materials: &BTreeMap<u32, u32>,
        lists: &mut Lists,
    ) -> Result<Vec<Part>, ExportError> {
        let mesh = &self.scene.meshes[number as usize];
        let mut parts: Vec<(DVec3, JsonList)> = Vec::new();
        for primitive in &mesh.primitives {
            let mut json = self.geometry(primitive)?;
            if let Some(material) = primitive.material.and_then(|of| materials.get(&of)) {
                let _ = write!(json, r#","material":{material}"#);
            }
            let json = format!("{{{json}}}");
            let part = parts.iter().position(|(origin, _)| *origin == primitive.origin);
            let part = part.unwrap_or_else(|| {
                parts.push((primitive.origin, JsonList::default()));
                parts.len() - 1
            });
            parts[part].1.push(&json);
        }
        let name = if mesh.name.is_empty() {
            String::new()
        } else {
            format!(r#""name":{},"#, quoted(&mesh.name))
        };
        let part = |(origin, list): (DVec3, JsonList)| {
            let members = list.as_member("primitives");
            let json = format!("{{{name}{}", members.trim_start_matches('{'));
            Part { origin, mesh: lists.meshes.push(&json) }
        };
        Ok(parts.into_iter().map(part).collect())
    }

    /// Copies the vertices and indices of a primitive; returns the members that describe them.
    fn geometry(&mut self, of: &Primitive) -> Result<String, ExportError> {
        let mode = mode(of.topology);
        let key = (of.blob, of.layout, of.vertex_count, mode);
        if let Some(known) = self.geometry.get(&key) {
            return Ok(known.clone());
        }
        let blob = self.blob(of.blob, of.bytes())?;
        let FinestLevel { vertices, indices, vertex_count } = FinestLevel::of(of, &blob);
        let (layout, indices) = (of.layout, &*indices);
        let view = self.file.view(ViewTarget::Vertices(layout.stride()), &vertices)?;
        let file = &mut self.file;
        let mut attribute = |name: &str, offset: u32, width: u32, bounds| {
            let (component, count) = (Component::F32, vertex_count);
            let at = AccessorDesc { view, offset, component, count, width, bounds };
            format!(r#""{name}":{}"#, file.accessor(&at))
        };
        let mut attributes = vec![
            attribute("POSITION", 0, 3, Some((of.min, of.max))),
            attribute("NORMAL", 12, 3, None),
        ];
        if layout.tangent {
            attributes.push(attribute("TANGENT", VertexLayout::TANGENT_OFFSET, 4, None));
        }
        // The sets of glTF begin at 0: one that stands for nothing has the other's values.
        let first = if layout.uv0 { layout.uv0_offset() } else { layout.uv1_offset() };
        if layout.uv0 || layout.uv1 {
            attributes.push(attribute("TEXCOORD_0", first, 2, None));
        }
        if layout.uv1 {
            attributes.push(attribute("TEXCOORD_1", layout.uv1_offset(), 2, None));
        }
        if layout.color {
            attributes.push(attribute("COLOR_0", layout.color_offset(), 4, None));
        }
        let view = self.file.view(ViewTarget::Indices, indices)?;
        let component = match of.index_format {
            IndexFormat::U16 => Component::U16,
            IndexFormat::U32 => Component::U32,
        };
        let count = of.index_count;
        let indices = AccessorDesc { view, offset: 0, component, count, width: 1, bounds: None };
        let indices = self.file.accessor(&indices);
        let attributes = attributes.join(",");
        let json = format!(r#""attributes":{{{attributes}}},"indices":{indices},"mode":{mode}"#);
        self.geometry.insert(key, json.clone());
        Ok(json)
    }

    /// For each node, whether the wall's own picture shows it; notes what a file cannot say.
    fn hidden(&mut self, ids: &[NodeId], edits: &SceneEdits) -> Vec<Hidden> {
        let nodes = &self.scene.nodes;
        let traits = edits.traits(nodes, ids.to_vec());
        let in_hidden_layer = |at: usize| {
            let layer = traits.layer_of.get(at).copied().flatten();
            layer.is_some_and(|layer| traits.layers[usize::from(layer)].1)
        };
        // From the children up: something of each is shown if it is in a layer that is.
        let mut is_shown: Vec<bool> = (0..nodes.len()).map(|at| !in_hidden_layer(at)).collect();
        for (at, node) in nodes.iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                is_shown[parent as usize] |= is_shown[at];
            }
        }
        let mut hidden = Vec::with_capacity(nodes.len());
        let (mut looks, mut left_out) = (0, 0);
        for (at, node) in nodes.iter().enumerate() {
            let (id, above) = (ids[at], node.parent.map(|parent| ids[parent as usize]));
            let (own, of_file) = (edits.node(id), u32::try_from(id.0));
            let is_all = own.is_some_and(|own| own.is_hidden)
                || of_file.is_ok_and(|node| self.hidden_at_rest.contains(&node))
                || !edits.is_switched_on(above, id)
                || !is_shown[at];
            let is_own = in_hidden_layer(at) && is_shown[at];
            left_out += u64::from(is_own && (node.mesh.is_some() || node.light.is_some()));
            let is_plain = own.is_none_or(|own| {
                own.layer.is_none()
                    && own.switch.is_none()
                    && own.facing.is_none()
                    && own.style == NodeStyle::default()
            });
            looks += u64::from(!is_plain);
            hidden.push(Hidden { is_all, is_own });
        }
        if looks > 0 {
            let nodes = counted(looks, "node");
            self.notes.push(format!("layers, switches, styles and facing of {nodes} are not kept"));
        }
        if left_out > 0 {
            let nodes = counted(left_out, "node");
            self.notes.push(format!("meshes and lights of {nodes} in hidden layers are left out"));
        }
        hidden
    }

    /// Writes all nodes, in their order.
    fn nodes(
        &mut self,
        ids: &[NodeId],
        edits: &SceneEdits,
        parts: &BTreeMap<u32, Vec<Part>>,
        lists: &mut Lists,
    ) -> Result<(), ExportError> {
        let nodes = &self.scene.nodes;
        let (mut roots, mut children) = (JsonList::default(), vec![Vec::new(); nodes.len()]);
        let (mut lights, mut further) = (BTreeMap::new(), Vec::new());
        for (index, node) in (0u32..).zip(nodes) {
            match node.parent {
                Some(parent) => children[parent as usize].push(index),
                None => drop(roots.push(&index.to_string())),
            }
        }
        let hidden = self.hidden(ids, edits);
        for (index, ((node, id), mut children)) in nodes.iter().zip(ids).zip(children).enumerate() {
            let edits = edits.node(*id);
            let mut json = NodeJson { name: &node.name, local: node.local, ..NodeJson::default() };
            json.is_hidden = hidden[index].is_all;
            json.attributes = edits.map(|edits| &edits.attributes);
            json.light = node.light.filter(|_| !hidden[index].is_own).map(|light| {
                let of = &self.scene.lights[light as usize];
                *lights.entry(light).or_insert_with(|| lists.lights.push(&light_json(of)))
            });
            let own = node.mesh.filter(|_| !hidden[index].is_own);
            for part in own.and_then(|mesh| parts.get(&mesh)).into_iter().flatten() {
                if part.origin == DVec3::ZERO {
                    json.mesh = Some(part.mesh);
                    continue;
                }
                // Nodes of its own, which stand where its zero is.
                let zero = DAffine3::from_translation(part.origin);
                let places: Vec<DAffine3> =
                    node.instances.iter().map(|of| place_of(of) * zero).collect();
                for local in if places.is_empty() { vec![zero] } else { places } {
                    children.push((nodes.len() + further.len()) as u32);
                    further.push(NodeJson { local, mesh: Some(part.mesh), ..NodeJson::default() });
                }
            }
            if json.mesh.is_some() && !node.instances.is_empty() {
                json.instances = Some(description::instances(&mut self.file, &node.instances)?);
            }
            lists.nodes.push(&json.to_json(&children, &mut self.file));
        }
        for node in further {
            lists.nodes.push(&node.to_json(&[], &mut self.file));
        }
        if !lists.lights.is_empty() {
            self.file.use_extension("KHR_lights_punctual");
        }
        let mut scene = format!(r#"{{"name":{}"#, quoted(&self.scene.name));
        if !lists.image_based_lights.is_empty() {
            let _ = write!(scene, r#","extensions":{{"{}":{{"light":0}}}}"#, surroundings::NAME);
        }
        if !roots.is_empty() {
            scene += ",";
            scene += roots.as_member("nodes").trim_start_matches('{').trim_end_matches('}');
        }
        lists.scenes.push(&(scene + "}"));
        Ok(())
    }
}

/// The way in which a node is hidden.
#[derive(Clone, Copy, Debug, Default)]
struct Hidden {
    /// With all that hangs from it.
    is_all: bool,
    /// Without what hangs from it, of which something is shown: glTF cannot say that, so its mesh
    /// and light are left out.
    is_own: bool,
}

/// A node's space from that of one of its copies.
pub(crate) fn place_of(of: &polyptych_scene::Instance) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        of.scale.as_dvec3(),
        of.rotation.as_dquat(),
        of.translation.as_dvec3(),
    )
}
