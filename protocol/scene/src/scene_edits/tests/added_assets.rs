//! Assets that were added: their numbers, and what is drawn and found of them.

use std::ops::Range;

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
    // There are three additions of three meshes; the last mesh of the second is too large.
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
        assert_eq!([given(first), given(first + 1)], [f32::INFINITY, 30.0], "{first}");
    }
}

#[test]
fn a_file_that_replaces_itself_again_and_again_takes_the_numbers_of_two() {
    let (base, file) = (base(), painted());
    let (mut edits, manifests) = added_times(&base, &file, 1);
    let (outline, manifest) = (SceneOutline::from(&base), BlobHash::of(b"painted"));
    edits.apply(paint(2, "blue"));
    for node in 5..100 {
        let set = outline.place_assets(&edits, manifest, vec![2], [2, 0]).expect("room");
        let new = NewNode { mesh: Some(set.first_mesh), ..NewNode::default() };
        let blue = paint(set.first_material, "blue");
        edits.apply(Edit::AddAssets(set.into()));
        edits.apply(Edit::Create { node: NodeId(node + 1), new: new.into() });
        assert_eq!(drawn(&base, &edits, &manifests), "bluewhite redwhite", "{node}");
        edits.apply(Edit::Remove(NodeId(node)));
        for unused in edits.unused_assets() {
            edits.apply(Edit::RemoveAssets(unused));
        }
        let (scene, _) = edits.apply_to(&base, &manifests);
        assert!(scene.meshes.len() <= 2 && scene.materials.len() <= 6, "{node}");
        assert_eq!(drawn(&base, &edits, &manifests), "redwhite", "not what was painted before");
        edits.apply(blue);
        assert_eq!(drawn(&base, &edits, &manifests), "bluewhite");
    }
}

/// A file of which the meshes, materials and textures say which they are.
fn titled(name: u8) -> Scene {
    let title = |what: &str, at: usize| format!("{what} {at} of {name}");
    let [meshes, materials, textures] =
        [name % 3 + 1, name / 3 % 3 + 1, name / 9 % 3].map(usize::from);
    let texture = |at: usize| Texture {
        blob: BlobHash::of(title("texture", at).as_bytes()),
        format: TextureFormat::Rgba8Srgb,
        width: 1,
        height: 1,
        mip_count: 1,
        sampler: Sampler::default(),
    };
    let textured = |at: usize| TextureRef {
        texture: (at % textures) as u32,
        uv_set: 0,
        uv_transform: Affine2::IDENTITY,
    };
    let material = |at: usize| Material {
        name: title("material", at),
        base_color_texture: (textures > 0).then(|| textured(at)),
        ..Material::default()
    };
    let mesh = |at: usize| Mesh {
        name: title("mesh", at),
        primitives: vec![triangle("part", Some((at % materials) as u32))],
    };
    Scene {
        meshes: (0..meshes).map(mesh).collect(),
        materials: (0..materials).map(material).collect(),
        textures: (0..textures).map(texture).collect(),
        ..Scene::default()
    }
}

/// The picture on the material of a mesh.
fn picture_of(mesh: &Mesh, scene: &Scene) -> Option<BlobHash> {
    let material = &scene.materials[mesh.primitives[0].material? as usize];
    let texture = material.base_color_texture?.texture;
    Some(scene.textures[texture as usize].blob)
}

/// Checks that each addition has all of its file at its numbers, and that no other has these.
fn check_places(base: &Scene, edits: &SceneEdits, manifests: &AssetManifests) {
    let ranges: [fn(&AssetSet) -> Range<u32>; 3] =
        [AssetSet::mesh_range, AssetSet::material_range, AssetSet::texture_range];
    for range in ranges {
        let numbers: Vec<u32> = edits.assets().flat_map(range).collect();
        let different: BTreeSet<u32> = numbers.iter().copied().collect();
        assert_eq!(numbers.len(), different.len(), "none is given twice");
    }
    let (scene, _) = edits.apply_to(base, manifests);
    assert_eq!(scene.fault(), None);
    let found = edits.all_meshes(base, manifests);
    assert_eq!(found.len(), scene.meshes.len());
    for set in edits.assets() {
        let from = &manifests[&set.manifest];
        for (at, own) in (set.first_mesh as usize..).zip(&from.meshes) {
            let picked = found[at].primitives[0].material.expect("one");
            assert!(set.material_range().contains(&picked));
            for mesh in [&scene.meshes[at], &found[at]] {
                assert_eq!(mesh.name, own.name);
                assert_eq!(names_of(mesh, &scene.materials), names_of(own, &from.materials));
                assert_eq!(picture_of(mesh, &scene), picture_of(own, from));
            }
        }
    }
}

proptest! {
    #[test]
    fn additions_that_come_and_go_have_numbers_of_their_own(
        steps in proptest::collection::vec((any::<bool>(), 0u8..27), 1..40),
    ) {
        let base = base();
        let outline = SceneOutline::from(&base);
        let (mut edits, mut manifests) = (SceneEdits::default(), AssetManifests::new());
        for (is_added, name) in steps {
            if is_added {
                let (file, manifest) = (titled(name), BlobHash([name; 32]));
                let counts = [file.materials.len() as u32, file.textures.len() as u32];
                let primitives = vec![1; file.meshes.len()];
                let set = outline.place_assets(&edits, manifest, primitives, counts);
                edits.apply(Edit::AddAssets(set.expect("room").into()));
                manifests.insert(manifest, Arc::new(file));
            } else {
                let all: Vec<AssetSetId> = edits.assets().map(AssetSet::id).collect();
                if let Some(gone) = all.get(usize::from(name) % all.len().max(1)) {
                    edits.apply(Edit::RemoveAssets(*gone));
                }
            }
            check_places(&base, &edits, &manifests);
        }
    }
}
