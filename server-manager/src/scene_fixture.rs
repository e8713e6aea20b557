//! A scene in a store, and every triangle of it in the world: what questions are judged by.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use polyptych_files::blob::BlobStore;
use polyptych_scene::{
    AssetManifests, IndexFormat, Instance, Mesh, Node, NodeId, Primitive, Scene, SceneEdits,
    Topology, VertexLayout,
};
use proptest::prelude::*;

use crate::scene_index::SceneIndex;

/// A scene in a store, with what was changed of it.
pub(crate) struct Stage {
    _folder: tempfile::TempDir,
    pub store: BlobStore,
    base: Scene,
    edits: SceneEdits,
    pub index: Arc<SceneIndex>,
    soup: Vec<[Vec3; 3]>,
}

pub(crate) fn corner(numbers: [f32; 3]) -> Vec3 {
    Vec3::from(numbers)
}

impl Stage {
    /// One mesh of these triangles, which stands in these places; the last one twice, by instances.
    pub fn new(soup: &[[Vec3; 3]], places: &[DAffine3], edits: SceneEdits) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = BlobStore::new(folder.path());
        let points = soup.iter().flatten();
        let vertex = |point: &Vec3| [point.to_array(), [0.0; 3]].concat();
        let vertices = points.clone().flat_map(vertex).flat_map(f32::to_le_bytes);
        let indices = (0..soup.len() as u16 * 3).flat_map(u16::to_le_bytes);
        let bytes: Vec<u8> = vertices.chain(indices).collect();
        let origin = DVec3::new(10.0, 0.0, 0.0);
        let around = |of: fn(Vec3, Vec3) -> Vec3| points.clone().copied().reduce(of).expect("some");
        let primitive = Primitive {
            blob: store.write(&bytes).expect("written"),
            layout: VertexLayout::default(),
            vertex_count: soup.len() as u32 * 3,
            index_count: soup.len() as u32 * 3,
            coarser_index_count: 0,
            meshlet_count: 0,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
            index_format: IndexFormat::U16,
            topology: Topology::Triangles,
            material: None,
            origin,
            min: around(Vec3::min),
            max: around(Vec3::max),
        };
        let mesh = Mesh { name: String::new(), primitives: vec![primitive] };
        let node = |local: &DAffine3| Node { local: *local, mesh: Some(0), ..Node::default() };
        let mut nodes: Vec<Node> = places.iter().map(node).collect();
        let instance = |x: f32| Instance {
            translation: Vec3::X * x,
            rotation: Quat::from_rotation_z(x),
            scale: Vec3::new(1.0, -0.5, 2.0),
            crowd: 0.0,
        };
        nodes.last_mut().expect("a place").instances = [0.5, 7.0].map(instance).into();
        let base = Scene { nodes, meshes: vec![mesh], ..Scene::default() };
        let manifest = store.write(&polyptych_codec::encode(&base)).expect("written");
        let index = SceneIndex::new(None, &store, manifest, edits.clone()).expect("an index");
        Self { _folder: folder, store, base, edits, index, soup: soup.to_vec() }
    }

    /// Every triangle in the world, with its node.
    pub fn triangles(&self) -> Vec<(NodeId, [DVec3; 3])> {
        let (scene, ids) = self.edits.apply_to(&self.base, &AssetManifests::new());
        let world = scene.world_from_nodes();
        let mut all = Vec::new();
        for ((node, id), world) in scene.nodes.iter().zip(ids).zip(world) {
            let places: Vec<DAffine3> = match &node.instances[..] {
                [] => vec![world],
                instances => instances
                    .iter()
                    .map(|one| {
                        world
                            * DAffine3::from_scale_rotation_translation(
                                one.scale.as_dvec3(),
                                one.rotation.as_dquat(),
                                one.translation.as_dvec3(),
                            )
                    })
                    .collect(),
            };
            for place in places {
                for corners in &self.soup {
                    let point = |p: &Vec3| DVec3::new(10.0, 0.0, 0.0) + p.as_dvec3();
                    all.push((id, corners.each_ref().map(|p| place.transform_point3(point(p)))));
                }
            }
        }
        all
    }
}

/// Triangles near the origin of their mesh.
pub(crate) fn soup() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let point = prop::array::uniform3(-2.0f32..2.0);
    prop::collection::vec(prop::array::uniform3(point).prop_map(|t| t.map(corner)), 1..30)
}

/// Places of nodes, mirrored, turned, and some kilometres apart.
pub(crate) fn places() -> impl Strategy<Value = Vec<DAffine3>> {
    let place = (prop::array::uniform3(-6.0..6.0), 0.1..3.0f64, 0.0..6.0f64);
    let place = place.prop_map(|(at, scale, turn)| {
        DAffine3::from_scale_rotation_translation(
            DVec3::new(scale, -scale, 1.0),
            DQuat::from_rotation_y(turn),
            DVec3::from(at) * 1e3,
        )
    });
    prop::collection::vec(place, 1..8)
}
