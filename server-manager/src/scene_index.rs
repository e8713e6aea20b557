//! The open scene as it stands, for questions about it.

mod shown;

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{
    NODE_TEXT_BYTES_MAX, NODES_MAX, NodeInfo, NodePage, NodeQuery,
};
use polyptych_scene::{
    AssetManifests, Attribute, Bounds, FilePlace, Light, Mesh, MovedPlace, Node, NodeEdits, NodeId,
    NodeTraits, PlacedNodes, Primitive, Scene, SceneEdits, SceneSubset,
};

use crate::import::read_scene;

/// A state of a scene, with what questions need of it.
#[derive(Debug)]
pub(crate) struct SceneIndex {
    manifest: BlobHash,
    base: Arc<Scene>,
    /// Manifests of what was added.
    added: AssetManifests,
    /// Those of the scene, where something was added, and what was.
    meshes: Option<Vec<Mesh>>,
    edits: SceneEdits,
    /// Parents before their children; hidden ones too.
    nodes: Vec<Node>,
    lights: Vec<Light>,
    /// The number of each node, and the layers.
    traits: NodeTraits,
    /// Finds the nodes that a move moves.
    placed: PlacedNodes,
    /// World space from each node's space.
    world: Vec<DAffine3>,
}

impl SceneIndex {
    /// The index of a state. Where no more than places and names differ from the one before, and
    /// that is in use nowhere else, only these are changed.
    ///
    /// # Errors
    /// The scene's manifest cannot be read.
    pub fn new(
        before: Option<Arc<Self>>,
        store: &BlobStore,
        manifest: BlobHash,
        edits: SceneEdits,
    ) -> Result<Arc<Self>, String> {
        let mut known = before.filter(|known| known.manifest == manifest);
        if let Some(known) = &mut known
            && (known.edits == edits
                || Arc::get_mut(known).is_some_and(|known| known.follow(&edits).is_some()))
        {
            return Ok(Arc::clone(known));
        }
        let mut added = AssetManifests::new();
        for asset in edits.asset_manifests() {
            let read = known.as_ref().and_then(|known| known.added.get(&asset)).cloned();
            let read = read.map_or_else(|| read_scene(store, asset).map(Arc::new), Ok)?;
            added.insert(asset, read);
        }
        let base = match known {
            Some(known) => Arc::clone(&known.base),
            None => Arc::new(read_scene(store, manifest)?),
        };
        let (nodes, lights, ids) = edits.all_nodes(&base);
        let meshes = (!added.is_empty()).then(|| edits.all_meshes(&base, &added));
        let mut world: Vec<DAffine3> = Vec::with_capacity(nodes.len());
        for node in &nodes {
            let parent = node.parent.map(|parent| world[parent as usize]);
            world.push(parent.map_or(node.local, |parent| parent * node.local));
        }
        let placed = PlacedNodes::new(&nodes, ids.clone(), edits.clone());
        let traits = edits.traits(&nodes, ids);
        Ok(Arc::new(Self {
            manifest,
            base,
            added,
            meshes,
            edits,
            nodes,
            lights,
            traits,
            placed,
            world,
        }))
    }

    /// Goes over to a state in which no more than places and names differ. `None`, and nothing is
    /// changed, where more does.
    fn follow(&mut self, edits: &SceneEdits) -> Option<()> {
        let changed = edits.moved_since(&self.edits)?;
        let moved = self.placed.moved(&self.base, edits)?;
        for node in changed {
            let Some(at) = self.placed.index_of(node) else { continue };
            let (name, own) = (edits.name_of(&self.base, node), &mut self.nodes[at as usize].name);
            if name != Some(own) {
                name.unwrap_or_default().clone_into(own);
            }
        }
        for MovedPlace { index, local, world, .. } in moved {
            self.nodes[index as usize].local = local;
            self.world[index as usize] = world;
        }
        self.placed.follow(edits.clone());
        self.edits = edits.clone();
        Some(())
    }

    /// The nodes that a query asks for, of those whose index is `wanted`.
    ///
    /// # Errors
    /// It names a node that is not there, or `wanted` fails.
    pub fn find(
        &self,
        query: &NodeQuery,
        revision: Revision,
        mut wanted: impl FnMut(usize) -> Result<bool, String>,
    ) -> Result<NodePage, String> {
        let below = query.below.map(|node| self.below(node)).transpose()?;
        let is_found = |at: &usize| {
            below.as_ref().is_none_or(|below| below[*at])
                && query.layer.as_ref().is_none_or(|layer| self.layer(*at) == Some(layer.as_str()))
                && query.kind.is_none_or(|kind| self.is_of_kind(*at, kind))
                && query.name.as_ref().is_none_or(|name| self.nodes[*at].name == *name)
                && query.attribute.as_ref().is_none_or(|(key, value)| {
                    let edits = self.edits.node(self.id(*at));
                    let has = edits.and_then(|edits| edits.attributes.get(key));
                    has.is_some_and(|has| value.as_ref().is_none_or(|value| has == value))
                })
        };
        let (mut page, mut text) = (NodePage { revision, found: 0, nodes: Vec::new() }, 0);
        let mut is_full = false;
        let count = query.count.min(NODES_MAX) as usize;
        for at in (0..self.nodes.len()).filter(is_found) {
            if !wanted(at)? {
                continue;
            }
            if page.found >= query.skip && page.nodes.len() < count && !is_full {
                let info = self.info(at);
                text += text_bytes(&info);
                // One is always given, or there would be no end.
                is_full = text > NODE_TEXT_BYTES_MAX && !page.nodes.is_empty();
                if !is_full {
                    page.nodes.push(info);
                }
            }
            page.found += 1;
        }
        Ok(page)
    }

    /// The place of a node in the scene's file.
    pub fn file_place(&self, node: NodeId) -> Option<FilePlace> {
        FilePlace::of(&self.base, node)
    }

    /// The number of a node by its index.
    pub fn id(&self, at: usize) -> NodeId {
        self.traits.ids[at]
    }

    /// Returns the name of a node, by its index.
    pub fn name(&self, at: usize) -> &str {
        &self.nodes[at].name
    }

    /// Returns the primitives of a node's mesh, by the node's index.
    pub fn primitives(&self, at: usize) -> &[Primitive] {
        let meshes = self.meshes.as_ref().unwrap_or(&self.base.meshes);
        let mesh = self.nodes[at].mesh.and_then(|mesh| meshes.get(mesh as usize));
        mesh.map_or(&[], |mesh| &mesh.primitives)
    }

    /// Visits every mesh in every place where a part of the scene shows it: the index of its node,
    /// its box in its
    /// own space, and world space from there.
    pub fn visit_meshes(
        &self,
        subset: &SceneSubset,
        mut visit: impl FnMut(usize, &Bounds, &DAffine3),
    ) {
        let shown = self.shown(subset);
        for at in (0..self.nodes.len()).filter(|at| shown[*at]) {
            if let Some(own) = mesh_bounds(self.primitives(at)) {
                self.places(at).for_each(|place| visit(at, &own, &place));
            }
        }
    }

    /// World space from the space of a node's mesh, for each of its places.
    pub fn places(&self, at: usize) -> impl Iterator<Item = DAffine3> {
        let (instances, world) = (&self.nodes[at].instances, self.world[at]);
        let alone = instances.is_empty().then_some(world);
        let placed = instances.iter().map(move |instance| {
            world
                * DAffine3::from_scale_rotation_translation(
                    instance.scale.as_dvec3(),
                    instance.rotation.as_dquat(),
                    instance.translation.as_dvec3(),
                )
        });
        alone.into_iter().chain(placed)
    }

    /// For each node, whether it is this one or hangs from it.
    fn below(&self, node: NodeId) -> Result<Vec<bool>, String> {
        let top = self.traits.ids.iter().position(|id| *id == node);
        let top =
            top.ok_or_else(|| format!("there is no {node}; it was removed, or never made"))?;
        let mut below: Vec<bool> = Vec::with_capacity(self.nodes.len());
        for (at, node) in self.nodes.iter().enumerate() {
            let parent = node.parent.is_some_and(|parent| below[parent as usize]);
            below.push(at == top || parent);
        }
        Ok(below)
    }

    fn info(&self, at: usize) -> NodeInfo {
        let (node, id) = (&self.nodes[at], self.id(at));
        let edits = self.edits.node(id);
        let up = std::iter::successors(node.parent, |at| self.nodes[*at as usize].parent);
        NodeInfo {
            id,
            parent: node.parent.map(|parent| self.id(parent as usize)),
            name: node.name.clone(),
            depth: up.count() as u32,
            local: node.local,
            world: self.world[at],
            visible: edits.is_none_or(|edits| !edits.is_hidden),
            mesh: node.mesh,
            light: node.light.and_then(|light| self.lights.get(light as usize)).cloned(),
            attributes: edits.map(|of: &NodeEdits| of.attributes.clone()).unwrap_or_default(),
            bounds: self.bounds(at),
            own_layer: edits.and_then(|edits| edits.layer.clone()),
            layer: self.layer(at).map(str::to_owned),
            switch: edits.and_then(|edits| edits.switch),
            style: edits.map(|edits| edits.style).unwrap_or_default(),
            facing: edits.and_then(|edits| edits.facing),
        }
    }

    /// Around a node's own mesh in all its places, in world space; by the node's index.
    pub fn bounds(&self, at: usize) -> Option<Bounds> {
        let own = mesh_bounds(self.primitives(at))?;
        self.places(at).map(|place| moved(&own, &place)).reduce(union)
    }
}

/// Around the primitives of a mesh, in its space.
fn mesh_bounds(primitives: &[Primitive]) -> Option<Bounds> {
    primitives.iter().map(primitive_bounds).reduce(union)
}

/// Around a primitive, in the space of its mesh.
pub(crate) fn primitive_bounds(primitive: &Primitive) -> Bounds {
    Bounds {
        min: primitive.origin + primitive.min.as_dvec3(),
        max: primitive.origin + primitive.max.as_dvec3(),
    }
}

fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds { min: a.min.min(b.min), max: a.max.max(b.max) }
}

/// The box around a box that was moved.
fn moved(of: &Bounds, by: &DAffine3) -> Bounds {
    let corners = (0..8u8).map(|corner| {
        let along =
            |axis: u8, low: f64, high: f64| if corner >> axis & 1 == 0 { low } else { high };
        let (min, max) = (of.min, of.max);
        let corner =
            DVec3::new(along(0, min.x, max.x), along(1, min.y, max.y), along(2, min.z, max.z));
        let corner = by.transform_point3(corner);
        Bounds { min: corner, max: corner }
    });
    corners.reduce(union).unwrap_or(*of)
}

fn text_bytes(info: &NodeInfo) -> usize {
    let attribute = |(key, value): (&String, &Attribute)| {
        key.len() + if let Attribute::Text(text) = value { text.len() } else { 8 }
    };
    info.name.len() + info.attributes.iter().map(attribute).sum::<usize>()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use polyptych_scene::Edit;

    use super::*;

    /// Edits of a scene of some nodes, each below the one before but for every third.
    fn edit() -> impl Strategy<Value = Edit> {
        let node = (0u64..12).prop_map(NodeId);
        prop_oneof![
            6 => (node.clone(), -9.0..9.0).prop_map(|(node, at)| Edit::SetTransform {
                node,
                local: DAffine3::from_translation(DVec3::new(at, 1.0, -at)),
            }),
            1 => (node.clone(), "[ab]").prop_map(|(node, name)| Edit::SetName { node, name }),
            1 => (node.clone(), any::<bool>())
                .prop_map(|(node, visible)| Edit::SetVisible { node, visible }),
            1 => node.prop_map(|node| Edit::SetAttribute {
                node,
                key: "k".into(),
                value: Some(Attribute::Bool(true)),
            }),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn an_index_that_followed_is_as_one_made_anew(
            steps in prop::collection::vec(prop::collection::vec(edit(), 1..4), 1..8),
        ) {
            let folder = tempfile::tempdir().expect("a folder");
            let store = BlobStore::new(folder.path());
            let node = |index: u32| Node {
                parent: index.checked_sub(1).filter(|_| !index.is_multiple_of(3)),
                local: DAffine3::from_rotation_y(f64::from(index)),
                name: format!("node {index}"),
                ..Node::default()
            };
            let base = Scene { nodes: (0..12).map(node).collect(), ..Scene::default() };
            let manifest = store.write(&polyptych_codec::encode(&base)).expect("written");
            let mut edits = SceneEdits::default();
            let index = |before, edits: &SceneEdits| {
                SceneIndex::new(before, &store, manifest, edits.clone()).expect("an index")
            };
            let mut followed = index(None, &edits);
            for step in steps {
                for edit in step {
                    edits.apply(edit);
                }
                followed = index(Some(followed), &edits);
                let anew = index(None, &edits);
                let all = |index: &SceneIndex| {
                    index.find(&NodeQuery::default(), Revision(1), |_| Ok(true)).expect("nodes")
                };
                prop_assert_eq!(all(&followed), all(&anew));
                let whole = SceneSubset::default();
                prop_assert_eq!(followed.shown(&whole), anew.shown(&whole));
            }
        }
    }
}
