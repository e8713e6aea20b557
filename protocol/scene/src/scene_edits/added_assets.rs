//! Assets that were added to a scene: their numbers, what uses them, and their place in the scene.
//!
//! Each addition has numbers of its own, also where the same file was added before: one client may
//! change the materials of what it added, and leaves those of others as they are. Blobs have the
//! names of their bytes, and are there once.

use std::collections::{BTreeMap, BTreeSet};

use polyptych_files::blob::BlobHash;

use super::mesh_crowds::MeshCrowds;
use super::{AssetManifests, SceneEdits};
use crate::edit::{AssetSet, AssetSetId, Edit};
use crate::{Material, Mesh, Scene};

/// Puts values into a list at their numbers, of which the first is given. Numbers before them that
/// the list lacks get the filler.
fn place<T: Clone>(list: &mut Vec<T>, first: u32, values: impl Iterator<Item = T>, filler: &T) {
    for (at, value) in (first as usize..).zip(values) {
        if list.len() < at {
            list.resize(at, filler.clone());
        }
        match list.get_mut(at) {
            Some(slot) => *slot = value,
            None => list.push(value),
        }
    }
}

/// Returns the meshes of a file, whose materials get these numbers. They are as they are at rest:
/// what would bend them names nodes of their file, and is left out of a scene that it is added to.
fn meshes_of(from: &Scene, number: impl Fn(u32) -> u32) -> impl Iterator<Item = Mesh> {
    from.meshes.iter().cloned().map(move |mut mesh| {
        for primitive in &mut mesh.primitives {
            primitive.material = primitive.material.map(&number);
            // With it, servers would hold the vertices once for each addition.
            primitive.deformed = None;
        }
        mesh
    })
}

impl SceneEdits {
    /// Returns the assets that were added.
    pub fn assets(&self) -> impl Iterator<Item = &AssetSet> {
        self.assets.values().map(|set| &set.value)
    }

    /// Returns whether the scene has a set of assets.
    pub fn has_assets(&self, id: AssetSetId) -> bool {
        self.assets.get(&id).is_some()
    }

    /// Returns the assets that came with the mesh, the material or the textures that an edit names;
    /// none of those of the scene's file.
    pub fn assets_named_by(&self, edit: &Edit) -> impl Iterator<Item = AssetSetId> {
        let names = |set: &AssetSet| match edit {
            Edit::Create { new, .. } => new.mesh.is_some_and(|of| set.mesh_range().contains(&of)),
            Edit::SetMesh { mesh, .. } => mesh.is_some_and(|of| set.mesh_range().contains(&of)),
            Edit::SetMaterial { material, to } => {
                let mut textures = to.textures().map(|of| of.texture);
                set.material_range().contains(material)
                    || textures.any(|of| set.texture_range().contains(&of))
            }
            _ => false,
        };
        self.assets.iter().filter(move |(_, set)| names(&set.value)).map(|(id, _)| *id)
    }

    /// The manifests of all assets that were added, each once.
    pub fn asset_manifests(&self) -> BTreeSet<BlobHash> {
        self.assets().map(|set| set.manifest).collect()
    }

    /// Assets that nothing uses any more: no node shows one of their meshes, and no material that
    /// was changed, of the scene or of assets in use, has one of their textures.
    pub fn unused_assets(&self) -> Vec<AssetSetId> {
        if self.assets.is_empty() {
            return Vec::new();
        }
        let of_nodes = self.nodes().filter_map(|(_, of)| of.given_mesh());
        let meshes: BTreeSet<u32> = of_nodes.collect();
        let all = self.assets.iter().map(|(id, set)| (*id, &set.value));
        let is_hidden =
            |(_, set): &(AssetSetId, &AssetSet)| meshes.range(set.mesh_range()).next().is_none();
        let mut unused: Vec<(AssetSetId, &AssetSet)> = all.filter(is_hidden).collect();
        loop {
            let before = unused.len();
            // A material that nobody sees keeps no textures, not even its own.
            let is_shown = |material: u32| {
                !unused.iter().any(|(_, set)| set.material_range().contains(&material))
            };
            let shown = self.materials.iter().filter(|(material, _)| is_shown(**material));
            let textures = shown.flat_map(|(_, to)| to.value.textures()).map(|of| of.texture);
            let textures: BTreeSet<u32> = textures.collect();
            unused.retain(|(_, set)| textures.range(set.texture_range()).next().is_none());
            if unused.len() == before {
                return unused.into_iter().map(|(id, _)| id).collect();
            }
        }
    }

    /// Returns the meshes of the scene, and those that were added, at their numbers. Each has the
    /// materials of its own addition, also while it is drawn with equal ones of another: a client
    /// that finds a material here changes that addition alone.
    pub fn all_meshes(&self, base: &Scene, added: &AssetManifests) -> Vec<Mesh> {
        let mut meshes = base.meshes.clone();
        for set in self.sets_in_order() {
            let Some(from) = added.get(&set.manifest) else { continue };
            let own = meshes_of(from, |material| set.material_number(material));
            place(&mut meshes, set.first_mesh, own, &Mesh::default());
        }
        meshes
    }

    /// The sets in the order of their numbers.
    pub(crate) fn sets_in_order(&self) -> Vec<&AssetSet> {
        let mut sets: Vec<&AssetSet> = self.assets().collect();
        sets.sort_by_key(|set| (set.first_mesh, set.first_material, set.first_texture));
        sets
    }

    /// Puts what was added to its places behind what a scene has. Of two sets, one may have the
    /// lower meshes and the other the lower materials. Numbers that nothing has are those of a mesh
    /// without primitives, of a default material, and of a texture that is there anyway.
    pub(super) fn add_assets(&self, scene: &mut Scene, added: &AssetManifests) {
        let mut unchanged = BTreeMap::new();
        for set in self.sets_in_order() {
            let Some(from) = added.get(&set.manifest) else { continue };
            if let Some(filler) = from.textures.first() {
                let textures = from.textures.iter().cloned();
                place(&mut scene.textures, set.first_texture, textures, filler);
            }
            let materials = from.materials.iter().cloned().map(|mut material| {
                for of in material.textures_mut() {
                    of.texture = of.texture.saturating_add(set.first_texture);
                }
                material
            });
            place(&mut scene.materials, set.first_material, materials, &Material::default());
            let numbers = self.drawn_materials(set, from, &mut unchanged);
            let number = |material: u32| {
                let known = numbers.get(material as usize).copied();
                known.unwrap_or_else(|| set.material_number(material))
            };
            place(&mut scene.meshes, set.first_mesh, meshes_of(from, number), &Mesh::default());
        }
    }

    /// The number of the material with which each one of a set is drawn: its own if it was changed,
    /// or else the first one that is as in the file, so that meshes of a file that was added many
    /// times are drawn together. `unchanged` has those by manifest and index in it.
    fn drawn_materials(
        &self,
        set: &AssetSet,
        from: &Scene,
        unchanged: &mut BTreeMap<(BlobHash, u32), u32>,
    ) -> Vec<u32> {
        let number = |material: u32| {
            let own = set.material_number(material);
            if self.has_material(own) {
                return own;
            }
            *unchanged.entry((set.manifest, material)).or_insert(own)
        };
        (0..from.materials.len() as u32).map(number).collect()
    }

    /// The crowds of so many meshes, of those that edits may have given to nodes.
    pub(super) fn mesh_crowds(
        &self,
        base: &Scene,
        added: &AssetManifests,
        meshes: usize,
    ) -> MeshCrowds {
        if self.nodes().all(|(_, of)| of.given_mesh().is_none()) {
            return MeshCrowds::default();
        }
        let mut crowds = MeshCrowds::new(meshes);
        crowds.add(0, &MeshCrowds::of_file(base));
        let mut known = BTreeMap::new();
        for set in self.assets() {
            if let Some(from) = added.get(&set.manifest) {
                let of_file = || MeshCrowds::of_file(from);
                crowds.add(set.first_mesh, known.entry(set.manifest).or_insert_with(of_file));
            }
        }
        crowds
    }
}
