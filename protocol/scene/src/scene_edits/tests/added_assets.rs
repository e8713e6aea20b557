//! Assets that were added: their numbers, and what is drawn and found of them.

use super::*;
use crate::deformation::DeformedPrimitive;

/// The names of the materials of a mesh, one behind the other.
fn names_of(mesh: &Mesh, materials: &[Material]) -> String {
    let numbers = mesh.primitives.iter().filter_map(|of| of.material);
    numbers.map(|material| materials[material as usize].name.as_str()).collect()
}

/// The names of the materials with which each node is drawn that was made.
fn drawn(base: &Scene, edits: &SceneEdits, manifests: &AssetManifests) -> String {
    let (scene, _) = edits.apply_to(base, manifests);
    assert_eq!(scene.fault(), None);
    let made = &scene.nodes[base.nodes.len()..];
    let meshes = made.iter().filter_map(|node| scene.meshes.get(node.mesh? as usize));
    let looks: Vec<String> = meshes.map(|mesh| names_of(mesh, &scene.materials)).collect();
    looks.join(" ")
}

fn paint(material: u32, name: &str) -> Edit {
    let to = Material { name: name.into(), ..Material::default() };
    Edit::SetMaterial { material, to: to.into() }
}

#[test]
fn a_pick_names_the_material_that_paints_what_was_picked_alone() {
    let (base, file) = (base(), painted());
    let (mut edits, manifests) = added_times(&base, &file, 3);
    assert_eq!(drawn(&base, &edits, &manifests), "redwhite redwhite redwhite");
    let second = edits.sets_in_order()[1].clone();
    let found = |edits: &SceneEdits, primitive: usize| {
        let meshes = edits.all_meshes(&base, &manifests);
        assert_eq!(meshes.len(), 3);
        meshes[second.first_mesh as usize].primitives[primitive].material.expect("one")
    };
    let picked = found(&edits, 0);
    edits.apply(paint(picked, "blue"));
    assert_eq!(drawn(&base, &edits, &manifests), "redwhite bluewhite redwhite");
    assert_eq!(found(&edits, 0), picked, "the material is the same once it is changed");
    let picked = found(&edits, 1);
    edits.apply(paint(picked, "black"));
    assert_eq!(drawn(&base, &edits, &manifests), "redwhite blueblack redwhite");
}

#[test]
fn nothing_bends_what_was_added_so_that_its_vertices_are_held_once() {
    let (mut base, mut file) = (base(), painted());
    let described = DeformedPrimitive {
        blob: BlobHash::of(b"joints"),
        bytes: 8,
        joint_sets: 1,
        joint_count: 1,
        target_count: 0,
        is_flat: false,
    };
    for primitive in &mut file.meshes[0].primitives {
        primitive.deformed = Some(described);
    }
    base.meshes.clone_from(&file.meshes);
    let (edits, manifests) = added_times(&base, &file, 2);
    let (scene, _) = edits.apply_to(&base, &manifests);
    assert_eq!(scene.fault(), None);
    for meshes in [scene.meshes, edits.all_meshes(&base, &manifests)] {
        let is_bent = |mesh: &Mesh| mesh.primitives.iter().all(|of| of.deformed.is_some());
        assert_eq!(meshes.iter().map(is_bent).collect::<Vec<_>>(), [true, false, false]);
        let blobs = |mesh: &Mesh| mesh.primitives.iter().map(|of| of.blob).collect::<Vec<_>>();
        assert_eq!(blobs(&meshes[1]), blobs(&meshes[2]));
    }
}

#[test]
fn what_nodes_draw_of_many_additions_is_counted() {
    use crate::limits::DRAWS_MAX;

    let (outline, mut edits) = (SceneOutline::from(&base()), SceneEdits::default());
    // Of three additions of three meshes each, the last mesh of the second is too large.
    for (manifest, last) in [(1, 2), (2, DRAWS_MAX as u32 + 1), (3, 4)] {
        let manifest = BlobHash([manifest; 32]);
        let set = outline.place_assets(&edits, manifest, vec![1, 1, last], [1, 0]).expect("room");
        edits.apply(Edit::AddAssets(set.into()));
    }
    let gone = edits.sets_in_order()[0].id();
    let may_show = |edits: &SceneEdits, mesh: u32| {
        let mut edits = edits.clone();
        let shown = Edit::SetMesh { node: NodeId(4), mesh: Some(mesh) };
        let is_there = outline.check(&edits, &shown).is_ok();
        edits.apply(shown);
        (is_there, outline.check_size(&edits).is_ok())
    };
    for mesh in 0..10 {
        assert_eq!(may_show(&edits, mesh), (mesh < 9, mesh != 5), "{mesh}");
    }
    edits.apply(Edit::RemoveAssets(gone));
    for mesh in 0..10 {
        let is_there = (3..9).contains(&mesh);
        assert_eq!(may_show(&edits, mesh), (is_there, mesh != 5), "{mesh}, with a gap");
    }
}

#[test]
fn each_addition_has_the_crowds_of_its_file() {
    let (base, mut file) = (base(), painted());
    file.meshes.insert(0, Mesh::default());
    for node in &mut file.nodes {
        node.mesh = Some(1);
    }
    let (edits, manifests) = added_times(&base, &file, 3);
    let (scene, _) = edits.apply_to(&base, &manifests);
    let crowds = edits.mesh_crowds(&base, &manifests, scene.meshes.len());
    for first in [0, 2, 4] {
        let given = |mesh: u32| {
            let mut node = Node::default();
            crowds.give_mesh(&mut node, Some(mesh), &scene.meshes);
            node.crowd
        };
        assert_eq!([given(first), given(first + 1)], [0.0, 30.0], "{first}");
    }
}
