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
    AssetManifests, Attribute, Bounds, Light, Mesh, Node, NodeEdits, NodeId, NodeTraits, Primitive,
    Scene, SceneEdits, SceneSubset,
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
    /// World space from each node's space.
    world: Vec<DAffine3>,
}

impl SceneIndex {
    /// The index of a state, which shares with the one before what they have in common.
    ///
    /// # Errors
    /// The scene's manifest cannot be read.
    pub fn new(
        before: Option<Arc<Self>>,
        store: &BlobStore,
        manifest: BlobHash,
        edits: SceneEdits,
    ) -> Result<Arc<Self>, String> {
        let known = before.filter(|known| known.manifest == manifest);
        if let Some(known) = known.as_ref().filter(|known| known.edits == edits) {
            return Ok(Arc::clone(known));
        }
        let mut added = AssetManifests::new();
        for set in edits.assets() {
            let read = known.as_ref().and_then(|known| known.added.get(&set.manifest)).cloned();
            let read = read.map_or_else(|| read_scene(store, set.manifest).map(Arc::new), Ok)?;
            added.insert(set.manifest, read);
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
        let traits = edits.traits(&nodes, ids);
        Ok(Arc::new(Self { manifest, base, added, meshes, edits, nodes, lights, traits, world }))
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

    /// Parent space from the space of a node, as the scene's file has it.
    pub fn file_place(&self, node: NodeId) -> Option<DAffine3> {
        self.base.nodes.get(usize::try_from(node.0).ok()?).map(|node| node.local)
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
