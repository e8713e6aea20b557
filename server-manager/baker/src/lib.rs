//! The baker: foreign scene files in, content-addressed blobs and a manifest out.
//!
//! Only this module reads glTF and images. It runs in a child process, but trusts nothing all the
//! same: every index, length and number of a file is checked before it is used, and what a
//! message says names the file, the place in it, what is wrong and what would be right.
//!
//! Some small meshes, or one large mesh, or one image are in memory at a time, beside the document
//! and what was unpacked. Buffers stay in their files.
//!
//! ```text
//! container -> document -> compressed -> node (pose) -> mesh -> texture (mip) -> manifest
//!      \-> source, source_file, uri, buffer, accessor: bytes  \-> material, light
//! mesh: geometry, tangent, split, levels
//! ```

mod accessor;
mod animated_property;
mod animation;
mod animation_json;
mod animation_pointer;
mod backgrounds;
mod bake_cache;
mod bounds;
mod buffer;
mod camera;
mod compressed;
mod container;
mod crowd;
mod deformation;
mod document;
pub mod environment;
mod error;
mod exposure;
mod extensions;
mod extras;
mod geometry;
mod image_based_light;
mod image_format;
mod json;
mod ktx2;
mod levels;
mod light;
pub mod map;
mod material;
mod material_extensions;
mod mesh;
mod mesh_use;
mod mip;
mod node;
mod notes;
mod numbers;
mod piece;
mod placeholder;
mod pose;
mod scene_choice;
mod shared_borders;
mod skies;
mod source;
mod source_file;
mod specular_glossiness;
mod split;
mod tangent;
#[cfg(test)]
mod tests;
mod texture;
mod topology;
mod uri;
mod variants;
mod vertex_cache;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use polyptych_files::blob::{BLOB_BYTES_MAX, BlobHash, BlobStore};
use polyptych_scene::limits::MANIFEST_BYTES_MAX;
use polyptych_scene::{self, EXPOSURE_NOTE, Light, Mesh, Node, Scene};
use serde::{Deserialize, Serialize};

pub use bake_cache::BakeCache;
pub use error::BakeError;

use animation::ClipTargets;
use levels::LevelFacts;
use material::Palette;
use notes::Notes;
use scene_choice::SceneChoice;
use shared_borders::SharedBorders;
use source::GltfSource;
use variants::ReplacedMaterials;

/// Part of every bake's key: a baker that writes other bytes must have another number.
const BAKER_VERSION: u32 = 39;

/// The sky of a scene that brings none: linear RGB of a clear morning, dim enough that
/// lit surfaces stand out against it.
pub const SKY_DEFAULT: Vec3 = Vec3::new(0.20, 0.32, 0.50);

/// The progress of a bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// `reading`, `nodes`, `meshes` and `levels` by turns, `textures` or `manifest`, in this order.
    pub stage: &'static str,
    /// Number of the stage's parts that are done.
    pub done: u64,
    /// Number of the stage's parts.
    pub total: u64,
}

impl Progress {
    /// Returns the share of the whole bake that is done, in percent: 0 to 100. Meshes and images
    /// take nearly all of the time; how they share it differs from file to file, so this is rough.
    pub fn percent(&self) -> u8 {
        let (from, to) = match self.stage {
            "reading" => (0, 5),
            "nodes" => (5, 10),
            "meshes" | "levels" => (10, 45),
            "textures" => (45, 98),
            _ => (98, 100),
        };
        let done = self.done.min(self.total) * (to - from) / self.total.max(1);
        u8::try_from(from + done).unwrap_or(100)
    }
}

/// One level of detail of all meshes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakedLevel {
    /// Its triangles, those of a mesh that is drawn several times counted once. A mesh without so
    /// many levels has none.
    pub triangles: u64,
    /// The largest stated error of any of them, as its node scales it, in metres.
    pub error_m: f64,
}

/// The result of a bake.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Baked {
    /// The blob that is the scene; 64 hexadecimal digits in JSON.
    #[serde(with = "hex")]
    pub manifest: BlobHash,
    /// `true` if the store had it already.
    #[serde(default)]
    pub reused: bool,
    /// The scene's name: the file's stem.
    pub name: String,
    /// Nodes of the shown scene.
    pub nodes: u64,
    /// Meshes that are drawn.
    pub meshes: u64,
    /// Textures that are used.
    pub textures: u64,
    /// Triangles drawn, each instance counted.
    pub triangles: u64,
    /// Bytes of all blobs, the manifest among them; one that is used twice counts once.
    pub bytes: u64,
    /// The levels of detail of all meshes, the finest first.
    #[serde(default)]
    pub levels: Vec<BakedLevel>,
    /// The largest angle by which a normal of a coarser level differs from that of a vertex that it
    /// leaves out, in degrees; the sum of steps where errors are, 180 at most.
    #[serde(default)]
    pub normal_angle_deg: f64,
    /// Notes on what is not drawn, or not as it is there; see [`Scene::notes`].
    #[serde(default)]
    pub warnings: Vec<String>,
}

mod hex {
    //! Hashes as text, for people and for `jq`.

    use polyptych_files::blob::BlobHash;
    use serde::{Deserialize, Deserializer, Serializer, de};

    pub(super) fn serialize<S: Serializer>(hash: &BlobHash, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(hash)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<BlobHash, D::Error> {
        let text = String::deserialize(from)?;
        BlobHash::from_hex(&text).ok_or_else(|| de::Error::custom("a hash has 64 hex digits"))
    }
}

/// Bakes a scene file into the store, or finds that it is there already.
///
/// # Errors
/// [`BakeError`], with the store as consistent as before: what was written is whole blobs.
pub fn bake(
    source: &Path,
    store: &BakeCache,
    progress: &mut dyn FnMut(Progress),
    cancel: &AtomicBool,
) -> Result<Baked, BakeError> {
    bake_scene(source, None, store, progress, cancel)
}

/// Bakes a file that is added to an open scene, where edits bend no meshes: those with skins have
/// levels of detail and share what they can. Of a file without skins this is the same as [`bake`].
///
/// # Errors
/// Those of [`bake`].
pub fn bake_added(
    source: &Path,
    store: &BakeCache,
    progress: &mut dyn FnMut(Progress),
    cancel: &AtomicBool,
) -> Result<Baked, BakeError> {
    bake_file(source, (None, false), store, progress, cancel).map_err(|error| error.about(source))
}

/// Bakes one scene of a file, by its name, or by its number from 0 on if none has that name. `None`
/// is the scene that the file names, or else its first.
///
/// # Errors
/// Those of [`bake`]; for an unknown scene also a list of those that the file has.
pub fn bake_scene(
    source: &Path,
    scene: Option<&str>,
    store: &BakeCache,
    progress: &mut dyn FnMut(Progress),
    cancel: &AtomicBool,
) -> Result<Baked, BakeError> {
    bake_file(source, (scene, true), store, progress, cancel).map_err(|error| error.about(source))
}

fn bake_file(
    path: &Path,
    (scene, edits_bend): (Option<&str>, bool),
    store: &BakeCache,
    progress: &mut dyn FnMut(Progress),
    cancel: &AtomicBool,
) -> Result<Baked, BakeError> {
    progress(Progress { stage: "reading", done: 0, total: 1 });
    let mut source = GltfSource::open(path, cancel)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let choice = SceneChoice::of(&source.document, scene)?;
    // Nothing else of a bake depends on it.
    let edits_bend = edits_bend || source.document.skins.is_empty();
    let key = key(&source, &name, (choice, edits_bend));
    if let Some(baked) = store.find(key) {
        return Ok(baked);
    }
    source.unpack(cancel)?;
    source.check_reads()?;
    let mut job = BakeJob::new(&source, choice, store.blobs(), progress, cancel);
    let scene = job.scene(name, edits_bend)?;
    let baked = job.finish(&scene)?;
    // A part that a disk withheld is no part that the scene lacks.
    source.check_reads()?;
    store.record(key, &baked)?;
    Ok(baked)
}

fn key(source: &GltfSource, name: &str, (choice, edits_bend): (SceneChoice, bool)) -> BlobHash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&BAKER_VERSION.to_le_bytes());
    hasher.update(&source.digest.0);
    hasher.update(name.as_bytes());
    if let Some(scene) = choice.key(&source.document) {
        // No name of a file has this character.
        hasher.update(b"\0");
        hasher.update(&scene.to_le_bytes());
    }
    if !edits_bend {
        // No number of a scene has so many bytes.
        hasher.update(b"\0added");
    }
    BlobHash(*hasher.finalize().as_bytes())
}

/// Stops a bake whose caller wants no more.
fn check(cancel: &AtomicBool) -> Result<(), BakeError> {
    if cancel.load(Ordering::Relaxed) { Err(BakeError::Cancelled) } else { Ok(()) }
}

/// One bake under way.
struct BakeJob<'a> {
    source: &'a GltfSource,
    choice: SceneChoice,
    blobs: &'a BlobStore,
    progress: &'a mut dyn FnMut(Progress),
    cancel: &'a AtomicBool,
    clips: Arc<ClipTargets>,
    notes: Notes,
    /// The first part that is not drawn, as a place, what is wrong, and what would be right.
    left_out: Option<[String; 3]>,
    written: BTreeMap<BlobHash, u64>,
    levels: LevelFacts,
}

impl<'a> BakeJob<'a> {
    fn new(
        source: &'a GltfSource,
        choice: SceneChoice,
        blobs: &'a BlobStore,
        progress: &'a mut dyn FnMut(Progress),
        cancel: &'a AtomicBool,
    ) -> Self {
        let (notes, left_out, written) = (Notes::default(), None, BTreeMap::new());
        let levels = LevelFacts::default();
        let clips = Arc::new(ClipTargets::of(&source.document));
        Self { source, choice, blobs, progress, cancel, clips, notes, left_out, written, levels }
    }
}

impl BakeJob<'_> {
    fn check(&self) -> Result<(), BakeError> {
        check(self.cancel)
    }

    /// Reports how far a stage is, and stops if no one wants to know.
    fn step(&mut self, stage: &'static str, done: u64, total: u64) -> Result<(), BakeError> {
        (self.progress)(Progress { stage, done, total });
        self.check()
    }

    /// Keeps a note, `PLACE: WHAT`; see [`Notes::add`].
    fn warn(&mut self, note: &str) {
        self.notes.add(note);
    }

    /// Notes a part that is not drawn.
    fn leave_out(&mut self, place: &str, what: &str, right: &str) {
        self.warn(&format!("{place}: {what} and is not drawn"));
        self.left_out.get_or_insert_with(|| [place, what, right].map(str::to_owned));
    }

    fn write(&mut self, bytes: &[u8], place: &str) -> Result<BlobHash, BakeError> {
        let length = bytes.len() as u64;
        if length > BLOB_BYTES_MAX {
            let right = format!("at most {BLOB_BYTES_MAX} can be stored");
            return Err(BakeError::at(place, format!("it takes {length} bytes"), right));
        }
        let hash = self.blobs.write(bytes)?;
        self.written.insert(hash, length);
        Ok(hash)
    }

    fn scene(&mut self, name: String, edits_bend: bool) -> Result<Scene, BakeError> {
        self.note_what_is_left_out();
        let clips = Arc::clone(&self.clips);
        let node::Placed { nodes, file_nodes, meshes, extras, place_of, hidden_with } =
            node::read(self, &clips, edits_bend)?;
        let extras = extras.into_list(self);
        let mut scene = Scene { name, nodes, sky: SKY_DEFAULT, extras, ..Scene::default() };
        let world = scene.world_from_nodes();
        let scales = bounds::scales(&scene.nodes, &world);
        let json: &[document::Mesh] = &self.source.document.meshes;
        let primitives = |used: u32| {
            let used = meshes.uses.get(used as usize);
            let mesh = used.and_then(|used| json.get(used.mesh as usize));
            mesh.map_or(0, |mesh| mesh.primitives.len() as u64)
        };
        let draws = polyptych_scene::draws(&scene.nodes, primitives);
        check_expansion(&scene.nodes, &[], draws)?;
        let mut palette = Palette::new(self.source.document.materials.len());
        let borders = SharedBorders::find(self, &meshes, &scene.nodes, &world)?;
        let mut replaced = ReplacedMaterials::default();
        let materials = (&mut palette, &mut replaced);
        scene.meshes = mesh::write_all(self, materials, (&meshes, &borders), &scales)?;
        drop(borders);
        let materials_of = palette.by_file(&replaced.copies());
        scene.variants = replaced.variants(self);
        self.check_anything_is_drawn(&scene.meshes)?;
        let mesh_of: BTreeMap<u32, u32> = scales.keys().copied().zip(0..).collect();
        renumber(&mut scene.nodes, |node| &mut node.mesh, &mesh_of);

        let used = scene.nodes.iter().filter_map(|node| node.light);
        let light_of: BTreeMap<u32, u32> = used.map(|light| (light, 0)).collect();
        let light_of: BTreeMap<u32, u32> = light_of.into_keys().zip(0..).collect();
        let lights = light_of.keys().map(|&light| light::convert(self, light));
        scene.lights = lights.collect::<Result<_, _>>()?;
        renumber(&mut scene.nodes, |node| &mut node.light, &light_of);
        // Again, since large primitives were split, and with lights.
        check_expansion(&scene.nodes, &scene.lights, scene.draws())?;
        let parts = animated_property::SceneParts {
            place_of: &place_of,
            hidden_with: &hidden_with,
            light_of: &light_of,
            lights: &scene.lights,
            materials_of: &materials_of,
            materials: &palette.materials,
        };
        let (animations, animated) = animation::read(self, parts, &scene.nodes)?;
        scene.animations = animations;
        let hidden = extras::hidden_nodes(&scene);
        light::note_without_shadows(self, &scene, &hidden);
        scene.deformations = meshes.deformations(&mesh_of, &animated, &scene.meshes);

        let [overview, whole] = bounds::overviews(&scene, &file_nodes, &hidden)?;
        scene.bounds = overview.bounds;
        if let Some(note) = overview.note(&scene.nodes) {
            self.warn(&note);
        }
        let textures = texture::write_all(self, &palette.textures)?;
        scene.textures = textures.list;
        scene.materials = palette.materials;
        crowd::find(self, &mut scene)?;
        placeholder::darken(&mut scene, &textures.placeholders);
        // What is hidden may be shown later, as a sky too.
        skies::find(&mut scene, &whole);
        scene.surroundings = image_based_light::write(self)?;
        scene.exposure = exposure::suggest(&scene, &hidden);
        if let Some(exposure) = scene.exposure {
            // The sky is ours, and stays as bright beside what it lights.
            scene.sky /= exposure;
            self.warn(&format!(
                "{EXPOSURE_NOTE}: exposure set to {exposure}; --exposure changes it"
            ));
        }
        scene.notes = std::mem::take(&mut self.notes).into_lines();
        Ok(scene)
    }

    /// A scene of which nothing is left is no success; one that is empty is shown, with a note.
    fn check_anything_is_drawn(&mut self, meshes: &[Mesh]) -> Result<(), BakeError> {
        if meshes.iter().any(|mesh| !mesh.primitives.is_empty()) {
            return Ok(());
        }
        if let Some([place, what, right]) = self.left_out.take() {
            return Err(BakeError::at(place, format!("{what}; nothing is left to draw"), right));
        }
        self.warn("scenes: the shown scene has no mesh, so nothing is drawn");
        Ok(())
    }

    fn note_what_is_left_out(&mut self) {
        let document = &self.source.document;
        for note in document.extension_uses.notes(&document.extensions_used) {
            self.warn(&note);
        }
        if let Some(note) = self.choice.note(document) {
            self.warn(&note);
        }
        let further = document.further_colors();
        if further > 0 {
            self.warn(&format!("COLOR_1: {further}, not drawn: a part has one set of colours"));
        }
    }

    fn finish(mut self, scene: &Scene) -> Result<Baked, BakeError> {
        self.step("manifest", 0, 1)?;
        if let Some(fault) = scene.fault() {
            return Err(BakeError::at("manifest", fault, "please report this as a bug"));
        }
        let bytes = polyptych_codec::encode(scene);
        if bytes.is_empty() || bytes.len() > MANIFEST_BYTES_MAX {
            let what = format!("the scene's list of nodes takes {} bytes", bytes.len());
            let right = format!("at most {MANIFEST_BYTES_MAX} can be stored");
            return Err(BakeError::at("nodes", what, right));
        }
        let manifest = self.write(&bytes, "manifest")?;
        let levels = self.levels.list();
        tracing::info!(?levels, normal_angle_rad = self.levels.normal_angle, "levels were made");
        self.step("manifest", 1, 1)?;
        Ok(Baked {
            manifest,
            reused: false,
            name: scene.name.clone(),
            nodes: scene.nodes.len() as u64,
            meshes: scene.meshes.len() as u64,
            textures: scene.textures.len() as u64,
            triangles: scene.triangles(),
            bytes: self.written.values().sum(),
            levels,
            normal_angle_deg: self.levels.normal_angle.to_degrees(),
            warnings: scene.notes.clone(),
        })
    }
}

/// Refuses a scene that render servers could not hold; see [`limits::DRAWS_MAX`].
///
/// [`limits::DRAWS_MAX`]: polyptych_scene::limits::DRAWS_MAX
fn check_expansion(nodes: &[Node], lights: &[Light], draws: u64) -> Result<(), BakeError> {
    let right = "join primitives of one material, draw fewer copies, or give lights a range";
    let fault = polyptych_scene::expansion_fault(nodes, lights, draws);
    fault.map_or(Ok(()), |fault| Err(BakeError::at("nodes", fault, right)))
}

/// Replaces the file's indices by the scene's.
fn renumber(
    nodes: &mut [Node],
    index_of: impl Fn(&mut Node) -> &mut Option<u32>,
    new_of: &BTreeMap<u32, u32>,
) {
    for node in nodes {
        let index = index_of(node);
        *index = index.and_then(|old| new_of.get(&old).copied());
    }
}
