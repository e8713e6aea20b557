//! The changes of a scene since it was opened: the fold of its edits.
//!
//! It knows nothing of the scene that it changes, so manager and servers fold alike, whatever each
//! has of the scene. [`SceneEdits::apply_to`] makes the scene as it stands.

mod added_assets;
mod mesh_crowds;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DAffine3;
use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

use crate::edit::{AssetSet, AssetSetId, Edit, NodeId};
use crate::layers::Layers;
use crate::measured::Measured;
use crate::node_edits::NodeEdits;
use crate::shared_map::SharedMap;
use crate::{Animations, Light, Material, Node, Scene};
use mesh_crowds::MeshCrowds;

/// The manifests of assets that were added to a scene.
pub type AssetManifests = BTreeMap<BlobHash, Arc<Scene>>;

/// All that differs from the scene's file. Copies share what they have in common.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Entries")]
pub struct SceneEdits {
    nodes: SharedMap<NodeId, Arc<Measured<NodeEdits>>>,
    materials: SharedMap<u32, Arc<Measured<Material>>>,
    /// Assets that were added.
    assets: SharedMap<AssetSetId, Arc<Measured<AssetSet>>>,
    layers: Layers,
    /// The variant that is shown, by its name or number.
    variant: Option<String>,
    /// A sum over the fingerprints of all entries, so that a change costs what it changes.
    fingerprint: u64,
    /// The sum of the encoded sizes of all entries, in bytes; updated with each change.
    bytes: u64,
}

/// [`SceneEdits`] as they are encoded. All that follows from the entries is computed again; a
/// peer's values for it are ignored.
#[derive(Deserialize)]
struct Entries {
    nodes: SharedMap<NodeId, NodeEdits>,
    materials: SharedMap<u32, Material>,
    assets: SharedMap<AssetSetId, AssetSet>,
    layers: Layers,
    variant: Option<String>,
    #[serde(rename = "fingerprint")]
    _fingerprint: u64,
    #[serde(rename = "bytes")]
    _bytes: u64,
}

impl From<Entries> for SceneEdits {
    fn from(Entries { nodes, materials, assets, layers: encoded, variant, .. }: Entries) -> Self {
        let (nodes, materials) = (Measured::all(&nodes), Measured::all(&materials));
        let (assets, layers) = (Measured::all(&assets), Layers::default());
        let mut edits = Self { nodes, materials, assets, layers, ..Self::default() };
        for of in edits.nodes.values() {
            if let Some(layer) = &of.value.layer {
                edits.layers.enter(layer);
            }
        }
        let of_nodes = edits.nodes.values().map(|of| (of.print, of.bytes));
        let of_materials = edits.materials.values().map(|of| (of.print, of.bytes));
        let of_assets = edits.assets.values().map(|of| (of.print, of.bytes));
        let all = of_nodes.chain(of_materials).chain(of_assets);
        (edits.fingerprint, edits.bytes) = all.fold((0u64, 0u64), |sum, (print, bytes)| {
            (sum.0.wrapping_add(print), sum.1.wrapping_add(bytes))
        });
        for (layer, _) in encoded.all().filter(|(_, is_hidden)| *is_hidden) {
            edits.hide_layer(layer, true);
        }
        edits.set_variant(variant);
        edits
    }
}

/// The place of a node among those of the scene as it is made.
#[derive(Clone, Copy, Debug)]
enum Place {
    Unknown,
    Nowhere,
    At(u32),
}

impl SceneEdits {
    /// Returns whether the scene is as its file has it.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
            && self.materials.is_empty()
            && self.assets.is_empty()
            && self.layers.is_empty()
            && self.variant.is_none()
    }

    /// A number that two with the same changes share, and others hardly ever.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The size of all entries, encoded.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Returns the changes of a node, if any.
    pub fn node(&self, node: NodeId) -> Option<&NodeEdits> {
        self.nodes.get(&node).map(|edits| &edits.value)
    }

    /// The nodes of which the place in their parents' spaces, the name or the attributes differ
    /// from the edits before, in rising order; `None` where more of what is drawn may. It costs
    /// what differs.
    pub fn moved_since(&self, before: &Self) -> Option<Vec<NodeId>> {
        let is_alike = self.materials == before.materials && self.assets == before.assets;
        if !is_alike || (&self.layers, &self.variant) != (&before.layers, &before.variant) {
            return None;
        }
        let (mut moved, none) = (Vec::new(), NodeEdits::default());
        let all = before.nodes.diff(&self.nodes, |node, before, now| {
            let before = before.map_or(&none, |edits| &edits.value);
            let now = now.map_or(&none, |edits| &edits.value);
            moved.push(node);
            before.differs_in_place_only(now)
        });
        all.then_some(moved)
    }

    /// A node's name as it stands. `None` if there is no such node.
    pub fn name_of<'a>(&'a self, base: &'a Scene, node: NodeId) -> Option<&'a str> {
        let edits = self.node(node);
        if let Some(name) = edits.and_then(|edits| edits.name.as_ref()) {
            return Some(name);
        }
        if let Some(made) = edits.and_then(|edits| edits.created.as_ref()) {
            return Some(&made.name);
        }
        Some(&base.nodes.get(usize::try_from(node.0).ok()?)?.name)
    }

    /// A node's transform as it stands: parent space from its space. `None` if there is no such
    /// node.
    pub fn local_of(&self, base: &Scene, node: NodeId) -> Option<DAffine3> {
        let edits = self.node(node);
        if let Some(local) = edits.and_then(|edits| edits.local) {
            return Some(local);
        }
        if let Some(made) = edits.and_then(|edits| edits.created.as_ref()) {
            return Some(made.local);
        }
        Some(base.nodes.get(usize::try_from(node.0).ok()?)?.local)
    }

    /// All nodes of which something differs, in the order of their numbers.
    pub fn nodes(&self) -> impl Iterator<Item = (NodeId, &NodeEdits)> {
        self.nodes.iter().map(|(node, edits)| (*node, &edits.value))
    }

    /// The layers of the scene.
    pub fn layers(&self) -> &Layers {
        &self.layers
    }

    /// Applies the next edit.
    pub fn apply(&mut self, edit: Edit) {
        match edit {
            Edit::SetMaterial { material, to } => {
                let new = self.added(Measured::new(&material, *to));
                let old = self.materials.insert(material, new);
                self.discount(old.as_deref());
            }
            Edit::AddAssets(set) => {
                let id = set.id();
                let new = self.added(Measured::new(&id, *set));
                let old = self.assets.insert(id, new);
                self.discount(old.as_deref());
            }
            Edit::RemoveAssets(id) => {
                let old = self.assets.remove(&id);
                self.discount(old.as_deref());
                // The next assets may get the numbers.
                let range = old.map_or(0..0, |set| set.value.material_range());
                let changed = self.materials.iter_from(range.start).map(|(material, _)| *material);
                let changed: Vec<u32> = changed.take_while(|it| range.contains(it)).collect();
                for material in changed {
                    let old = self.materials.remove(&material);
                    self.discount(old.as_deref());
                }
            }
            Edit::SetLayerVisible { layer, visible } => self.hide_layer(&layer, !visible),
            Edit::SetVariant(variant) => self.set_variant(variant),
            _ => {
                let Some(node) = edit.node() else { return };
                let mut entry = self.node(node).cloned().unwrap_or_default();
                entry.apply(edit);
                if let Some(layer) = &entry.layer {
                    self.layers.enter(layer);
                }
                // A node of the file that is as it was again needs no entry.
                let old = if entry == NodeEdits::default() {
                    self.nodes.remove(&node)
                } else {
                    let new = self.added(Measured::new(&node, entry));
                    self.nodes.insert(node, new)
                };
                if let Some(layer) = old.as_ref().and_then(|old| old.value.layer.as_ref()) {
                    self.layers.leave(layer);
                }
                self.discount(old.as_deref());
            }
        }
    }

    /// Hides a layer, or does not. One that is hidden counts as an entry.
    fn hide_layer(&mut self, layer: &str, is_hidden: bool) {
        let was_hidden = self.layers.hide(layer, is_hidden);
        let entry = Measured::new(&layer, ());
        match (was_hidden, is_hidden) {
            (false, true) => drop(self.added(entry)),
            (true, false) => self.discount(Some(&entry)),
            _ => {}
        }
    }

    /// Shows a variant. It counts as an entry.
    fn set_variant(&mut self, variant: Option<String>) {
        let entry = |name: &String| Measured::new(&("variant", name), ());
        let old = self.variant.as_ref().map(entry);
        self.discount(old.as_ref());
        if let Some(new) = variant.as_ref().map(entry) {
            self.added(new);
        }
        self.variant = variant;
    }

    /// Returns whether a material was edited.
    pub(crate) fn has_material(&self, material: u32) -> bool {
        self.materials.get(&material).is_some()
    }

    /// The variant that is shown, by its name or number.
    pub fn variant(&self) -> Option<&str> {
        self.variant.as_deref()
    }

    /// Adds an entry to the sums.
    fn added<T>(&mut self, new: Measured<T>) -> Arc<Measured<T>> {
        self.fingerprint = self.fingerprint.wrapping_add(new.print);
        self.bytes = self.bytes.wrapping_add(new.bytes);
        Arc::new(new)
    }

    /// Takes an entry out of the sums.
    fn discount<T>(&mut self, old: Option<&Measured<T>>) {
        let (print, bytes) = old.map_or((0, 0), |old| (old.print, old.bytes));
        self.fingerprint = self.fingerprint.wrapping_sub(print);
        self.bytes = self.bytes.wrapping_sub(bytes);
    }

    /// The scene as it stands, and the number of each of its nodes. What moves by itself is not in
    /// it: [`Motion`](crate::Motion) has that. What is removed, hidden or not
    /// chosen by a switch, and what hangs from it, is left out; what hidden layers have is not,
    /// since views may show it ([`Self::traits`]). Parents stand before their children, and
    /// otherwise nodes in the order of their numbers. Added meshes whose manifest is not given are
    /// empty. Meshes of one file that was added several times share those of its materials that
    /// were not changed.
    pub fn apply_to(&self, base: &Scene, added: &AssetManifests) -> (Scene, Vec<NodeId>) {
        self.applied(base, added, false)
    }

    /// The scene of [`SceneEdits::apply_to`], with what is hidden.
    pub fn apply_with_hidden(&self, base: &Scene, added: &AssetManifests) -> (Scene, Vec<NodeId>) {
        self.applied(base, added, true)
    }

    fn applied(
        &self,
        base: &Scene,
        added: &AssetManifests,
        with_hidden: bool,
    ) -> (Scene, Vec<NodeId>) {
        // Without its nodes, which may be a million.
        let mut scene = Scene {
            name: base.name.clone(),
            nodes: Vec::new(),
            meshes: base.meshes.clone(),
            materials: base.materials.clone(),
            textures: base.textures.clone(),
            lights: base.lights.clone(),
            sky: base.sky,
            surroundings: base.surroundings,
            bounds: base.bounds,
            notes: base.notes.clone(),
            exposure: base.exposure,
            extras: Vec::new(),
            animations: Animations::default(),
            deformations: Vec::new(),
            variants: base.variants.clone(),
        };
        self.add_assets(&mut scene, added);
        for (&material, to) in self.materials.iter() {
            if let Some(slot) = scene.materials.get_mut(material as usize) {
                slot.clone_from(&to.value);
            }
        }
        if let Some(variant) = &self.variant {
            scene.show_variant(variant, |material| self.materials.get(&material).is_some());
        }
        let crowds = self.mesh_crowds(base, added, scene.meshes.len());
        let ids = self.placed(base, &mut scene, &crowds, with_hidden);
        (scene, ids)
    }

    /// The nodes as they stand, hidden ones too, and the number of each. Their lights are indices
    /// into the lights that come with them. Those whose mesh edits gave are in no crowd.
    pub fn all_nodes(&self, base: &Scene) -> (Vec<Node>, Vec<Light>, Vec<NodeId>) {
        let mut scene = Scene { lights: base.lights.clone(), ..Scene::default() };
        let ids = self.placed(base, &mut scene, &MeshCrowds::default(), true);
        (scene.nodes, scene.lights, ids)
    }

    /// Places the nodes in `scene`; gives their numbers.
    fn placed(
        &self,
        base: &Scene,
        scene: &mut Scene,
        crowds: &MeshCrowds,
        with_hidden: bool,
    ) -> Vec<NodeId> {
        let first_made = self.nodes.iter_from(NodeId(base.nodes.len() as u64));
        let made =
            first_made.filter(|(_, edits)| edits.value.created.is_some()).map(|(node, _)| *node);
        let all: Vec<NodeId> = (0..base.nodes.len() as u64).map(NodeId).chain(made).collect();
        let mut places = vec![Place::Unknown; all.len()];
        let place_of = |places: &[Place], node: NodeId| {
            all.binary_search(&node).map_or(Place::Nowhere, |slot| places[slot])
        };
        let (mut ids, mut way) = (Vec::with_capacity(all.len()), Vec::new());
        for slot in 0..all.len() {
            // Up to the first whose place is known, and down again.
            let mut next = Some(slot);
            while let Some(slot) = next.filter(|slot| matches!(places[*slot], Place::Unknown)) {
                // Until it has its place, it has none: a circle ends here.
                places[slot] = Place::Nowhere;
                way.push(slot);
                let parent = self.parent_of(base, all[slot]);
                next = parent.and_then(|parent| all.binary_search(&parent).ok());
            }
            while let Some(slot) = way.pop() {
                let node = all[slot];
                let edits = self.node(node);
                let above = self.parent_of(base, node);
                let is_shown = edits
                    .is_none_or(|edits| !edits.is_removed && (with_hidden || !edits.is_hidden))
                    && (with_hidden || self.is_switched_on(above, node));
                let parent = match above.map(|parent| place_of(&places, parent)) {
                    None => None,
                    Some(Place::At(index)) => Some(index),
                    // What hangs from what is not there is not there either.
                    Some(_) => continue,
                };
                if is_shown && let Some(placed) = self.node_as_it_stands(base, node, scene, crowds)
                {
                    places[slot] = Place::At(scene.nodes.len() as u32);
                    scene.nodes.push(Node { parent, ..placed });
                    ids.push(node);
                }
            }
        }
        ids
    }

    /// Returns whether the switch of the node above a node, if it has one, shows it.
    pub fn is_switched_on(&self, above: Option<NodeId>, node: NodeId) -> bool {
        let switch = above.and_then(|above| self.node(above)?.switch);
        switch.is_none_or(|shown| shown == node)
    }

    /// The node that a node hangs from now; `None` too where there is no such node.
    pub fn parent_of(&self, base: &Scene, node: NodeId) -> Option<NodeId> {
        let edits = self.node(node);
        if let Some(parent) = edits.and_then(|edits| edits.parent) {
            return parent;
        }
        if let Some(made) = edits.and_then(|edits| edits.created.as_ref()) {
            return made.parent;
        }
        let of_file = usize::try_from(node.0).ok().and_then(|index| base.nodes.get(index));
        of_file.and_then(|of_file| of_file.parent).map(|parent| NodeId(parent.into()))
    }

    /// The node without its parent; a light of its own is put behind those of `scene`.
    fn node_as_it_stands(
        &self,
        base: &Scene,
        node: NodeId,
        scene: &mut Scene,
        crowds: &MeshCrowds,
    ) -> Option<Node> {
        let edits = self.node(node);
        let made = edits.and_then(|edits| edits.created.as_ref());
        let mut placed = match made {
            Some(new) => {
                let mut placed =
                    Node { name: new.name.clone(), local: new.local, ..Node::default() };
                crowds.give_mesh(&mut placed, new.mesh, &scene.meshes);
                placed
            }
            None => base.nodes.get(usize::try_from(node.0).ok()?)?.clone(),
        };
        placed.parent = None;
        let mut light = made.and_then(|new| new.light.clone()).map(Some);
        if let Some(edits) = edits {
            placed.local = edits.local.unwrap_or(placed.local);
            if let Some(mesh) = edits.mesh {
                crowds.give_mesh(&mut placed, mesh, &scene.meshes);
                placed.is_sky = false;
            }
            if let Some(name) = &edits.name {
                placed.name.clone_from(name);
            }
            light = edits.light.clone().or(light);
        }
        if let Some(light) = light {
            placed.light = light.map(|light| {
                scene.lights.push(light);
                scene.lights.len() as u32 - 1
            });
        }
        Some(placed)
    }
}

#[cfg(test)]
mod tests;
