//! Files of small scenes, and what stands in the way of one.

use glam::{Quat, Vec3};
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{
    AnimatedProperty, Clip, Edit, Instance, Light, LightKind, Mesh, NewNode, Node, PropertyKind,
    Topology,
};
use serde_json::{Value, json};

use super::*;

/// A scene in a store.
struct Stored {
    folder: tempfile::TempDir,
    store: BlobStore,
    scene: EditedScene,
}

/// A triangle whose zero stands at this place.
fn triangle(store: &BlobStore, origin: DVec3) -> Primitive {
    let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|at| [at.to_array(), [0.0, 0.0, 1.0]]);
    let vertices = vertices.as_flattened().as_flattened().iter().flat_map(|of| of.to_le_bytes());
    let bytes: Vec<u8> =
        vertices.chain([0u16, 1, 2].iter().flat_map(|of| of.to_le_bytes())).collect();
    Primitive {
        blob: store.write(&bytes).expect("written"),
        layout: VertexLayout::default(),
        vertex_count: 3,
        index_count: 3,
        coarser_index_count: 0,
        meshlet_count: 0,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: None,
        origin,
        min: Vec3::ZERO,
        max: Vec3::new(1.0, 1.0, 0.0),
    }
}

impl Stored {
    fn new(make: impl FnOnce(&BlobStore) -> Scene, edits: impl IntoIterator<Item = Edit>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = BlobStore::new(folder.path().join("blobs"));
        let scene = make(&store);
        assert_eq!(scene.fault(), None);
        let manifest = store.write(&polyptych_codec::encode(&scene)).expect("written");
        let mut all = scene.first_edits();
        edits.into_iter().for_each(|edit| all.apply(edit));
        let scene = SceneRef { name: "evening".into(), manifest };
        let scene = EditedScene { scene, edits: all, next_node: 100 };
        Self { folder, store, scene }
    }

    fn write(&self) -> Result<(ExportedScene, Vec<u8>), String> {
        let mut percent = 0;
        let mut step = |now| {
            assert!((percent..=100).contains(&now), "{now} after {percent}");
            percent = now;
            true
        };
        let written = write(&self.scene, &self.store, self.folder.path(), &mut step);
        written.map(|(about, mut file)| {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).expect("read");
            assert_eq!(bytes.len() as u64, about.bytes);
            (about, bytes)
        })
    }

    fn json(&self) -> Value {
        let (_, bytes) = self.write().expect("exported");
        let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        serde_json::from_slice(&bytes[20..20 + length]).expect("JSON")
    }
}

fn scene(meshes: Vec<Mesh>, nodes: Vec<Node>) -> Scene {
    Scene { name: "file".into(), meshes, nodes, ..Scene::default() }
}

#[test]
fn vertices_with_a_zero_of_their_own_hang_from_their_node() {
    let far = DVec3::new(6_378_137.123_456_789, 0.0, -1e-3);
    let instance = Instance {
        translation: Vec3::X,
        rotation: Quat::from_rotation_z(1.0),
        scale: Vec3::splat(2.0),
        crowd: 0.0,
    };
    let stored = Stored::new(
        |store| {
            let [near, away] = [DVec3::ZERO, far].map(|origin| triangle(store, origin));
            let node = |mesh, instances| Node { mesh: Some(mesh), instances, ..Node::default() };
            let mesh = |primitives| Mesh { name: "m".into(), primitives };
            scene(
                vec![mesh(vec![near, away.clone()]), mesh(vec![away])],
                vec![node(0, Vec::new()), node(1, vec![instance; 2])],
            )
        },
        [],
    );
    let json = stored.json();
    assert_eq!(json["scenes"], json!([{ "name": "file", "nodes": [0, 1] }]));
    let nodes = json["nodes"].as_array().expect("nodes");
    assert_eq!(nodes[0], json!({ "children": [2], "mesh": 0 }));
    assert_eq!(nodes[2], json!({ "translation": far.to_array(), "mesh": 1 }), "in f64");
    assert_eq!(nodes[1], json!({ "children": [3, 4] }), "its copies stand by themselves");
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::splat(2.0),
        instance.rotation.as_dquat(),
        DVec3::X,
    );
    let expected = (place * DAffine3::from_translation(far)).translation;
    let found: Vec<f64> = serde_json::from_value(nodes[3]["matrix"].clone()).expect("numbers");
    assert!((DVec3::new(found[12], found[13], found[14]) - expected).length() < 1e-6);
    assert_eq!(nodes[3]["matrix"], nodes[4]["matrix"]);
    assert_eq!(json["accessors"].as_array().map(Vec::len), Some(3), "one blob, once");
}

#[test]
fn what_moves_is_told_and_points_are_no_triangles_of_the_same_bytes() {
    let stored = Stored::new(
        |store| {
            let solid = triangle(store, DVec3::ZERO);
            let points = Primitive { topology: Topology::Points, ..solid.clone() };
            let mesh = Mesh { name: "m".into(), primitives: vec![solid, points] };
            let mut scene = scene(vec![mesh], vec![Node { mesh: Some(0), ..Node::default() }]);
            scene.animations.clips.push(Clip { name: "wave".into(), channels: Vec::new() });
            let (kind, targets, rest) = (PropertyKind::Visible, vec![0], vec![0.0]);
            scene.animations.properties.push(AnimatedProperty { kind, targets, rest });
            scene
        },
        [],
    );
    let (about, _) = stored.write().expect("written");
    assert_eq!(about.notes, ["animations are not in the file: 1 clip"]);
    let modes = [0, 1].map(|at| stored.json()["meshes"][0]["primitives"][at]["mode"].clone());
    assert_eq!(modes, [4, 0]);
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    assert_eq!(stored.json()["nodes"][0]["extensions"], hidden, "as without the clip");
}

#[test]
fn what_was_edited_is_in_the_file_and_what_nothing_shows_is_not() {
    let mesh = |store: &BlobStore| Mesh {
        name: String::new(),
        primitives: vec![triangle(store, DVec3::ZERO)],
    };
    let node =
        |name: &str, parent| Node { name: name.into(), parent, mesh: Some(0), ..Node::default() };
    let created = NewNode { parent: Some(NodeId(1)), name: "a\"b".into(), ..NewNode::default() };
    let key = "load".to_owned();
    let value = Some(polyptych_scene::Attribute::Number(2.5));
    let edits = [
        Edit::SetVisible { node: NodeId(1), visible: false },
        Edit::Remove(NodeId(0)),
        Edit::Create { node: NodeId(7), new: Box::new(created) },
        Edit::SetAttribute { node: NodeId(7), key, value },
        Edit::SetMesh { node: NodeId(1), mesh: Some(1) },
    ];
    let stored = Stored::new(
        |store| {
            scene(
                vec![mesh(store), mesh(store), mesh(store)],
                vec![node("gone", None), node("kept", None), node("gone too", Some(0))],
            )
        },
        edits,
    );
    let json = stored.json();
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let expected = json!([
        { "name": "kept", "children": [1], "mesh": 0, "extensions": hidden },
        { "name": "a\"b", "extras": { "load": 2.5 } },
    ]);
    assert_eq!(json["nodes"], expected);
    assert_eq!(json["meshes"].as_array().map(Vec::len), Some(1));
    assert_eq!(json["extensionsUsed"], json!(["KHR_node_visibility"]));
    let (about, _) = stored.write().expect("exported");
    assert_eq!((about.name.as_str(), about.nodes, about.meshes), ("evening", 2, 1));
}

#[test]
fn a_light_brighter_than_numbers_go_leaves_the_file_readable() {
    let (kind, color) = (LightKind::Directional, Vec3::new(2.0, 0.0, 0.0));
    let light = Light { kind, color, intensity: 2e38, range: None };
    let node = Node { light: Some(0), ..Node::default() };
    let lit = Scene { lights: vec![light], ..scene(Vec::new(), vec![node]) };
    let json = Stored::new(|_| lit, []).json();
    let light = &json["extensions"]["KHR_lights_punctual"]["lights"][0];
    assert_eq!(light["color"], json!([1.0, 0.0, 0.0]));
    assert_eq!(light["intensity"].as_f64().map(|of| of as f32), Some(f32::MAX));
}

#[test]
fn blobs_that_are_missing_or_of_another_size_are_named() {
    let stored = Stored::new(
        |store| {
            let mut primitive = triangle(store, DVec3::ZERO);
            primitive.vertex_count = 4;
            let mesh = Mesh { name: String::new(), primitives: vec![primitive] };
            scene(vec![mesh], vec![Node { mesh: Some(0), ..Node::default() }])
        },
        [],
    );
    let blob = read_scene(&stored.store, stored.scene.scene.manifest).expect("there").meshes[0]
        .primitives[0]
        .blob;
    let error = stored.write().expect_err("another size");
    assert!(error.contains(&blob.to_string()) && error.contains("78 bytes"), "{error}");
    std::fs::remove_file(stored.store.path_of(blob)).expect("there");
    let error = stored.write().expect_err("missing");
    assert!(error.contains(&blob.to_string()) && error.contains("not in the store"), "{error}");
    let nowhere = stored.folder.path().join("none");
    let error = write(&stored.scene, &stored.store, &nowhere, &mut |_| true);
    let error = error.map(drop).expect_err("no folder");
    assert!(error.contains("none") && error.contains("cannot be written"), "{error}");
}

#[test]
fn an_empty_scene_is_a_file_too_and_nobody_gets_what_nobody_waits_for() {
    let empty = Stored::new(|_| scene(Vec::new(), Vec::new()), []);
    assert_eq!(empty.json()["scenes"], json!([{ "name": "file" }]));
    let one = Stored::new(
        |store| {
            let mesh = Mesh { name: String::new(), primitives: vec![triangle(store, DVec3::ZERO)] };
            scene(vec![mesh], vec![Node { mesh: Some(0), ..Node::default() }])
        },
        [],
    );
    let ended = write(&one.scene, &one.store, one.folder.path(), &mut |_| false);
    assert!(ended.map(drop).expect_err("ended").contains("nobody waits"));
}
