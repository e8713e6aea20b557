//! Edits against a model that keeps every node with its children, and what they leave behind.

mod added_assets;

use std::collections::{BTreeMap, BTreeSet};

use glam::{Affine2, DVec3, Vec2, Vec3};
use proptest::prelude::*;

use super::*;
use crate::NewNode;
use crate::{
    AlphaMode, IndexFormat, LightKind, Mesh, Primitive, Sampler, SceneOutline, Texture,
    TextureFormat, TextureRef, Topology, VertexLayout,
};

/// Two roots, the first with two children, of which the first has one.
fn base() -> Scene {
    let node = |name: &str, parent| Node {
        name: name.into(),
        parent,
        local: DAffine3::from_translation(DVec3::X),
        ..Node::default()
    };
    let nodes = vec![
        node("house", None),
        node("door", Some(0)),
        node("handle", Some(1)),
        node("roof", Some(0)),
        node("tree", None),
    ];
    let materials = vec![Material::default(); 2];
    Scene { name: "base".into(), nodes, materials, ..Scene::default() }
}

fn names(edits: &SceneEdits) -> Vec<(String, Option<String>)> {
    let (scene, ids) = edits.apply_to(&base(), &AssetManifests::new());
    assert_eq!(scene.nodes.len(), ids.len());
    assert_eq!(scene.fault(), None);
    let name = |index: u32| scene.nodes[index as usize].name.clone();
    scene.nodes.iter().map(|node| (node.name.clone(), node.parent.map(name))).collect()
}

fn pair(name: &str, parent: &str) -> (String, Option<String>) {
    (name.into(), (!parent.is_empty()).then(|| parent.into()))
}

#[test]
fn an_unedited_scene_is_its_file() {
    let (scene, ids) = SceneEdits::default().apply_to(&base(), &AssetManifests::new());
    assert_eq!(scene, base());
    assert_eq!(ids, [0, 1, 2, 3, 4].map(NodeId));
}

#[test]
fn what_hangs_from_what_is_removed_or_hidden_goes_with_it() {
    let mut edits = SceneEdits::default();
    edits.apply(Edit::Remove(NodeId(1)));
    let left = [pair("house", ""), pair("roof", "house"), pair("tree", "")];
    assert_eq!(names(&edits), left);
    edits.apply(Edit::SetVisible { node: NodeId(0), visible: false });
    assert_eq!(names(&edits), [pair("tree", "")]);
    edits.apply(Edit::SetVisible { node: NodeId(0), visible: true });
    assert_eq!(names(&edits), left);
    let (nodes, _, ids) = edits.all_nodes(&base());
    assert_eq!((nodes.len(), ids), (3, [0, 3, 4].map(NodeId).to_vec()));
}

#[test]
fn a_node_that_hangs_from_a_later_one_comes_behind_it() {
    let mut edits = SceneEdits::default();
    edits.apply(Edit::SetParent { node: NodeId(1), parent: Some(NodeId(4)) });
    let expected = [
        pair("house", ""),
        pair("tree", ""),
        pair("door", "tree"),
        pair("handle", "door"),
        pair("roof", "house"),
    ];
    assert_eq!(names(&edits), expected);
}

#[test]
fn made_nodes_have_lights_and_materials_of_their_own() {
    let mut edits = SceneEdits::default();
    let light = Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 9.0, range: None };
    let new = NewNode {
        parent: Some(NodeId(4)),
        name: "lamp".into(),
        light: Some(light.clone()),
        ..NewNode::default()
    };
    edits.apply(Edit::Create { node: NodeId(5), new: Box::new(new) });
    let red = Material { metallic: 0.0, ..Material::default() };
    edits.apply(Edit::SetMaterial { material: 1, to: Box::new(red.clone()) });
    let (scene, ids) = edits.apply_to(&base(), &AssetManifests::new());
    assert_eq!((ids.last(), &scene.lights[..]), (Some(&NodeId(5)), &[light][..]));
    assert_eq!(scene.nodes[5].light, Some(0));
    assert_eq!(scene.materials, [Material::default(), red]);
    edits.apply(Edit::SetLight { node: NodeId(5), light: None });
    assert_eq!(edits.apply_to(&base(), &AssetManifests::new()).0.nodes[5].light, None);
    edits.apply(Edit::Remove(NodeId(5)));
    assert_eq!(names(&edits).len(), 5);
}

#[test]
fn circles_and_parents_that_are_not_there_lose_nodes_and_nothing_else() {
    let mut edits = SceneEdits::default();
    edits.apply(Edit::SetParent { node: NodeId(0), parent: Some(NodeId(2)) });
    edits.apply(Edit::SetParent { node: NodeId(4), parent: Some(NodeId(77)) });
    assert!(names(&edits).is_empty());
}

/// A node of the model.
#[derive(Clone, Debug, PartialEq)]
struct Known {
    parent: Option<NodeId>,
    x: f64,
    is_hidden: bool,
}

#[derive(Clone, Debug)]
enum Step {
    Create(Option<usize>, f64),
    Remove(usize),
    Hang(usize, Option<usize>),
    Move(usize, f64),
    Show(usize, bool),
}

fn step() -> impl Strategy<Value = Step> {
    let (node, x) = (0usize..16, -9.0..9.0);
    prop_oneof![
        (proptest::option::of(node.clone()), x.clone()).prop_map(|(at, x)| Step::Create(at, x)),
        node.clone().prop_map(Step::Remove),
        (node.clone(), proptest::option::of(node.clone())).prop_map(|(a, b)| Step::Hang(a, b)),
        (node.clone(), x).prop_map(|(node, x)| Step::Move(node, x)),
        (node, any::<bool>()).prop_map(|(node, shown)| Step::Show(node, shown)),
    ]
}

fn place(x: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, 0.0, 0.0))
}

impl Step {
    fn edit(&self, next: u64) -> Edit {
        let id = |index: usize| NodeId(index as u64);
        match *self {
            Self::Create(parent, x) => {
                let new = NewNode { parent: parent.map(id), local: place(x), ..NewNode::default() };
                Edit::Create { node: NodeId(next), new: Box::new(new) }
            }
            Self::Remove(node) => Edit::Remove(id(node)),
            Self::Hang(node, parent) => Edit::SetParent { node: id(node), parent: parent.map(id) },
            Self::Move(node, x) => Edit::SetTransform { node: id(node), local: place(x) },
            Self::Show(node, visible) => Edit::SetVisible { node: id(node), visible },
        }
    }
}

type Model = BTreeMap<NodeId, Known>;

fn is_below(model: &Model, node: NodeId, from: NodeId) -> bool {
    let up = std::iter::successors(Some(node), |node| model[node].parent);
    up.into_iter().any(|node| node == from)
}

/// Does to the model what an edit says, where that can be.
fn change(model: &mut Model, edit: &Edit) -> bool {
    match edit {
        Edit::Create { node, new } => {
            if new.parent.is_some_and(|parent| !model.contains_key(&parent)) {
                return false;
            }
            let x = new.local.translation.x;
            model.insert(*node, Known { parent: new.parent, x, is_hidden: false });
        }
        Edit::Remove(node) => {
            if !model.contains_key(node) {
                return false;
            }
            let whole = model.clone();
            model.retain(|id, _| !is_below(&whole, *id, *node));
        }
        Edit::SetParent { node, parent } => {
            let is_there = |id: &NodeId| model.contains_key(id);
            if !is_there(node) || parent.is_some_and(|p| !is_there(&p) || is_below(model, p, *node))
            {
                return false;
            }
            model.get_mut(node).expect("there").parent = *parent;
        }
        Edit::SetTransform { node, local } => match model.get_mut(node) {
            Some(known) => known.x = local.translation.x,
            None => return false,
        },
        Edit::SetVisible { node, visible } => match model.get_mut(node) {
            Some(known) => known.is_hidden = !visible,
            None => return false,
        },
        other => panic!("{other:?}"),
    }
    true
}

proptest! {
    #[test]
    fn random_edits_are_what_a_model_makes_of_them(
        steps in proptest::collection::vec(step(), 0..60),
    ) {
        let base = base();
        let outline = SceneOutline::from(&base);
        let mut model: Model = (0u64..).zip(&base.nodes).map(|(id, node)| {
            let parent = node.parent.map(|parent| NodeId(parent.into()));
            (NodeId(id), Known { parent, x: node.local.translation.x, is_hidden: false })
        }).collect();
        let (mut edits, mut next) = (SceneEdits::default(), 5);
        for step in steps {
            let edit = step.edit(next);
            let may = outline.check(&edits, &edit);
            let did = change(&mut model, &edit);
            prop_assert_eq!(may.is_ok(), did, "{:?}: {:?}", edit, may);
            if !did {
                continue;
            }
            next += u64::from(matches!(edit, Edit::Create { .. }));
            edits.apply(edit);
            for orphan in outline.orphans(&edits) {
                edits.apply(Edit::Remove(orphan));
            }
        }
        // Moved below what was removed and back is as removed: the model has it gone.
        let (nodes, _, ids) = edits.all_nodes(&base);
        let found: Model = nodes.iter().zip(&ids).map(|(node, id)| {
            let parent = node.parent.map(|parent| ids[parent as usize]);
            let is_hidden = edits.node(*id).is_some_and(|of| of.is_hidden);
            (*id, Known { parent, x: node.local.translation.x, is_hidden })
        }).collect();
        prop_assert_eq!(&found, &model);
        let made = |id: &NodeId| id.0 >= 5;
        let kept = edits.nodes().map(|(id, _)| id).filter(made).count();
        prop_assert_eq!(kept, model.keys().copied().filter(made).count(), "nothing is left behind");
        // The same state by another way has the same sums, whatever is said of them.
        let none = BTreeMap::<u32, bool>::new();
        let variant: Option<String> = None;
        let entries = (&edits.nodes, &none, &none, &none, variant, 1u64, 1u64);
        let bytes = polyptych_codec::encode(&entries);
        let again = polyptych_codec::decode_within::<SceneEdits, 65536>(&bytes);
        prop_assert_eq!(again.as_ref(), Ok(&edits));
    }
}

fn triangle(name: &str, material: Option<u32>) -> Primitive {
    Primitive {
        blob: BlobHash::of(name.as_bytes()),
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
        material,
        origin: DVec3::ZERO,
        min: Vec3::ZERO,
        max: Vec3::ONE,
    }
}

#[test]
fn another_mesh_is_drawn_in_each_place_of_its_node() {
    let mut base = base();
    let copies = crate::limits::DRAWS_MAX / 4 + 1;
    let (translation, rotation, scale) = (Vec3::ZERO, glam::Quat::IDENTITY, Vec3::ONE);
    let copy = crate::Instance { translation, rotation, scale, crowd: 0.0 };
    base.nodes[0].instances = vec![copy; copies as usize];
    let primitives = vec![triangle("wall", None); 4];
    base.meshes.push(Mesh { primitives, ..Mesh::default() });
    let outline = SceneOutline::from(&base);
    for (node, is_held) in [(0, false), (1, true)] {
        let mut edits = SceneEdits::default();
        edits.apply(Edit::SetMesh { node: NodeId(node), mesh: Some(base.meshes.len() as u32 - 1) });
        assert_eq!(outline.check_size(&edits).is_ok(), is_held, "{node}");
    }
}

#[test]
fn a_chain_of_many_nodes_is_taken_away_at_once_and_too_deep_a_one_is_told() {
    let base = base();
    let outline = SceneOutline::from(&base);
    let mut edits = SceneEdits::default();
    let mut deepest = None;
    for id in 5..1000 {
        let new = NewNode { parent: deepest, ..NewNode::default() };
        let create = Edit::Create { node: NodeId(id), new: Box::new(new) };
        match outline.check(&edits, &create) {
            Ok(()) => edits.apply(create),
            Err(error) => {
                assert!(error.to_string().contains("at most 256 nodes"), "{error}");
                break;
            }
        }
        deepest = Some(NodeId(id));
    }
    assert_eq!(edits.nodes().count(), 257);
    edits.apply(Edit::Remove(NodeId(5)));
    assert_eq!(outline.orphans(&edits).len(), 256);
}

#[test]
fn the_way_up_ends_at_the_root_of_a_file_that_is_deeper_than_edits_look() {
    let node = |index: u32| Node { parent: index.checked_sub(1), ..Node::default() };
    let chain = Scene { nodes: (0..300).map(node).collect(), ..Scene::default() };
    let way = SceneOutline::from(&chain).way_up(&SceneEdits::default(), NodeId(299));
    assert!(way.expect("all are there").into_iter().eq((0..300).rev().map(NodeId)));
}

/// A texture of one texel.
fn texture(name: &[u8]) -> Texture {
    Texture {
        blob: BlobHash::of(name),
        format: TextureFormat::Rgba8Srgb,
        width: 1,
        height: 1,
        mip_count: 1,
        sampler: Sampler::default(),
    }
}

#[test]
fn a_material_with_numbers_that_are_not_finite_is_refused() {
    let outline = SceneOutline::from(&Scene { textures: vec![texture(b"a")], ..base() });
    let check = |x: f32, cutoff: f32| {
        let uv_transform = Affine2::from_translation(Vec2::new(x, 0.0));
        let used = TextureRef { texture: 0, uv_set: 0, uv_transform };
        let alpha_mode = AlphaMode::Mask(cutoff);
        let to = Material { base_color_texture: Some(used), alpha_mode, ..Material::default() };
        outline.check(&SceneEdits::default(), &Edit::SetMaterial { material: 1, to: to.into() })
    };
    assert_eq!(check(2.0, 0.5), Ok(()));
    for (x, cutoff, what) in [(f32::INFINITY, 0.5, "uv_transform"), (2.0, f32::NAN, "cutoff")] {
        let error = check(x, cutoff).expect_err("refused").to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn added_assets_stand_at_their_numbers_whatever_was_there_before() {
    let textured = || TextureRef { texture: 0, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let set = |name: &str, meshes: usize| {
        let material = Material { base_color_texture: Some(textured()), ..Material::default() };
        let primitive = triangle(name, Some(0));
        let mesh = Mesh { name: name.into(), primitives: vec![primitive] };
        let textures = vec![texture(name.as_bytes())];
        let (meshes, materials) = (vec![mesh; meshes], vec![material]);
        Arc::new(Scene { meshes, materials, textures, ..Scene::default() })
    };
    let outline = SceneOutline::from(&base());
    let (mut edits, mut manifests) = (SceneEdits::default(), AssetManifests::new());
    for (name, meshes) in [("a", 2), ("b", 1), ("c", 3)] {
        let (hash, scene) = (BlobHash::of(name.as_bytes()), set(name, meshes));
        let placed = outline.place_assets(&edits, hash, vec![1; meshes], [1, 1]).expect("room");
        edits.apply(Edit::AddAssets(Box::new(placed)));
        manifests.insert(hash, scene);
    }
    let names = |edits: &SceneEdits| {
        let (scene, _) = edits.apply_to(&base(), &manifests);
        assert_eq!(scene.fault(), None);
        for mesh in scene.meshes.iter().filter(|mesh| !mesh.primitives.is_empty()) {
            let material = &scene.materials[mesh.primitives[0].material.expect("one") as usize];
            let texture = material.base_color_texture.expect("one").texture;
            let name = BlobHash::of(mesh.name.as_bytes());
            assert_eq!(scene.textures[texture as usize].blob, name, "each has its own picture");
        }
        scene.meshes.iter().map(|mesh| mesh.name.clone()).collect::<Vec<_>>().join(",")
    };
    assert_eq!(names(&edits), "a,a,b,c,c,c");
    let before = (edits.fingerprint(), edits.bytes());
    let set_of = |edits: &SceneEdits, name: &[u8]| {
        edits.assets().find(|set| set.manifest == BlobHash::of(name)).expect("there").clone()
    };
    let again = set_of(&edits, b"a");
    edits.apply(Edit::RemoveAssets(again.id()));
    assert_eq!(names(&edits), ",,b,c,c,c", "the others keep their numbers");
    edits.apply(Edit::AddAssets(again.into()));
    assert_eq!((edits.fingerprint(), edits.bytes()), before);
    let of_c = set_of(&edits, b"c");
    let own = TextureRef { texture: of_c.first_texture, ..textured() };
    let own = Material { base_color_texture: Some(own), ..Material::default() };
    edits.apply(Edit::SetMaterial { material: of_c.first_material, to: own.into() });
    assert_eq!(edits.unused_assets().len(), 3, "what is not shown keeps none of its textures");
    edits.apply(Edit::RemoveAssets(of_c.id()));
    assert!(!edits.has_material(of_c.first_material), "what comes next is as it is");
    assert_eq!(names(&edits), "a,a,b");
    assert_eq!(edits.unused_assets().len(), 2, "no node shows any");
    let shown = NewNode { mesh: Some(2), ..NewNode::default() };
    edits.apply(Edit::Create { node: NodeId(5), new: shown.into() });
    assert_eq!(edits.unused_assets(), [set_of(&edits, b"a").id()]);
    assert_eq!(edits.apply_to(&base(), &AssetManifests::new()).0.meshes.len(), 0, "none is read");
}

/// A file of two materials and of a mesh that has both, which stands in a crowd.
fn painted() -> Scene {
    let material = |name: &str| Material { name: name.into(), ..Material::default() };
    let primitives = vec![triangle("wall", Some(0)), triangle("sill", Some(1))];
    let node = |crowd: f32| Node { mesh: Some(0), crowd, ..Node::default() };
    Scene {
        nodes: vec![node(12.0), node(30.0), node(0.0)],
        meshes: vec![Mesh { primitives, ..Mesh::default() }],
        materials: ["red", "white"].map(material).to_vec(),
        ..Scene::default()
    }
}

/// So many additions of one file, each with a node that shows its mesh.
fn added_times(base: &Scene, file: &Scene, times: u64) -> (SceneEdits, AssetManifests) {
    let (outline, manifest) = (SceneOutline::from(base), BlobHash::of(b"painted"));
    let mut edits = SceneEdits::default();
    for at in 0..times {
        let counts = [file.materials.len() as u32, file.textures.len() as u32];
        let primitives = file.meshes.iter().map(|mesh| mesh.primitives.len() as u32).collect();
        let set = outline.place_assets(&edits, manifest, primitives, counts).expect("room");
        let new = NewNode { mesh: Some(set.first_mesh), ..NewNode::default() };
        edits.apply(Edit::AddAssets(set.into()));
        let node = NodeId(base.nodes.len() as u64 + at);
        edits.apply(Edit::Create { node, new: new.into() });
    }
    (edits, AssetManifests::from([(manifest, Arc::new(file.clone()))]))
}

#[test]
fn a_file_that_is_added_again_has_materials_of_its_own_to_change() {
    let (base, file) = (base(), painted());
    let (mut edits, manifests) = added_times(&base, &file, 3);
    assert_eq!((edits.assets().count(), edits.asset_manifests().len()), (3, 1));
    // The names of the materials with which each of the three nodes is drawn, and their number.
    let drawn = |edits: &SceneEdits| {
        let (scene, _) = edits.apply_to(&base, &manifests);
        assert_eq!(scene.fault(), None);
        let mut used = BTreeSet::new();
        let mut looks = |node: &Node| {
            let mesh = &scene.meshes[node.mesh.expect("a mesh") as usize];
            let materials = mesh.primitives.iter().map(|of| of.material.expect("one") as usize);
            let materials: Vec<usize> = materials.collect();
            used.extend(materials.iter().copied());
            materials.iter().map(|at| scene.materials[*at].name.as_str()).collect::<String>()
        };
        let looks: Vec<String> = scene.nodes[base.nodes.len()..].iter().map(&mut looks).collect();
        (looks.join(" "), used.len())
    };
    assert_eq!(drawn(&edits), ("redwhite redwhite redwhite".into(), 2), "drawn together");
    let paint = |edits: &mut SceneEdits, material: u32, name: &str| {
        let to = Material { name: name.into(), ..Material::default() };
        edits.apply(Edit::SetMaterial { material, to: to.into() });
    };
    let firsts: Vec<u32> = edits.sets_in_order().iter().map(|set| set.first_material).collect();
    assert_eq!(firsts, [2, 4, 6]);
    paint(&mut edits, firsts[0], "blue");
    assert_eq!(drawn(&edits), ("bluewhite redwhite redwhite".into(), 3));
    paint(&mut edits, firsts[2] + 1, "black");
    assert_eq!(drawn(&edits), ("bluewhite redwhite redblack".into(), 4));
    // One goes, and the others stay as they are; what comes then is as in the file.
    let gone = edits.sets_in_order()[0].id();
    edits.apply(Edit::Remove(NodeId(base.nodes.len() as u64)));
    assert_eq!(edits.unused_assets(), [gone]);
    edits.apply(Edit::RemoveAssets(gone));
    assert_eq!(drawn(&edits), ("redwhite redblack".into(), 3));
}

#[test]
fn what_is_made_of_a_mesh_is_in_the_crowd_that_the_mesh_has_in_its_file() {
    let mut base = base();
    base.meshes = vec![Mesh { primitives: vec![triangle("tile", None)], ..Mesh::default() }; 2];
    (base.nodes[1].mesh, base.nodes[1].crowd) = (Some(0), 4.0);
    base.nodes[4].mesh = Some(1);
    let (mut edits, manifests) = added_times(&base, &painted(), 2);
    let crowds = |edits: &SceneEdits| -> Vec<f32> {
        let (scene, _) = edits.apply_to(&base, &manifests);
        scene.nodes.iter().map(|node| node.crowd).collect()
    };
    let of_file = [0.0, 4.0, 0.0, 0.0, 0.0];
    assert_eq!(crowds(&edits), [&of_file[..], &[30.0; 2]].concat());
    // Wherever it stands: a server that joins later must draw the same.
    let local = DAffine3::from_translation(DVec3::Y * 100.0);
    edits.apply(Edit::SetTransform { node: NodeId(5), local });
    assert_eq!(crowds(&edits), [&of_file[..], &[30.0; 2]].concat());
    // A tree becomes a wall, and a tile one that stands alone in its file, at the same place.
    edits.apply(Edit::SetMesh { node: NodeId(4), mesh: Some(2) });
    edits.apply(Edit::SetMesh { node: NodeId(1), mesh: Some(1) });
    edits.apply(Edit::SetMesh { node: NodeId(5), mesh: None });
    let now = crowds(&edits);
    assert!((4.0..4.001).contains(&now[1]) && now[4] == 30.0, "{now:?}");
    assert_eq!(now[5..], [0.0, 30.0]);
}
