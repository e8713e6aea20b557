//! Clips: what moves is at every time where a reference in f64 has it, and what is broken is noted.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DQuat, DVec3};
use polyptych_scene::deformation::Deformer;
use polyptych_scene::{CLIPS_MAX, ClipTime, Edit, Motion, NodeId, PlacedNodes, Scene, SceneEdits};
use serde_json::{Value, json};

use super::builder::Builder;
use super::{BakeFixture, bake_added, bake_builder};

/// World positions of all vertices that meshes without instances draw at a time of a clip.
fn drawn_at(place: &BakeFixture, scene: &Scene, clip: u32, time_s: f64) -> Vec<DVec3> {
    let clips = [ClipTime { clip, time_s, weight: 1.0 }];
    drawn_with(place, scene, &SceneEdits::default(), &clips)
}

/// The same with edits that put nodes elsewhere.
fn drawn_with(
    place: &BakeFixture,
    scene: &Scene,
    edits: &SceneEdits,
    clips: &[ClipTime],
) -> Vec<DVec3> {
    let base = Arc::new(scene.clone());
    let ids = (0..scene.nodes.len() as u64).map(NodeId).collect();
    let placed = PlacedNodes::new(&scene.nodes, ids, SceneEdits::default());
    let motion = Motion::new(&base, &placed, edits).expect("it moves");
    let moment = motion.at(clips);
    let mut world = scene.world_from_nodes();
    for (index, _, moved) in &moment.places {
        world[*index as usize] = *moved;
    }
    let mut points = Vec::new();
    for (node, world) in scene.nodes.iter().zip(world) {
        let Some(mesh) = node.mesh else { continue };
        let deformation = scene.deformations.iter().position(|of| of.mesh == mesh);
        for primitive in &scene.meshes[mesh as usize].primitives {
            let read = |blob| place.store.blobs().read(blob).expect("read").expect("there");
            let floats = if let (Some(described), Some(at)) = (&primitive.deformed, deformation) {
                let deformer = Deformer::parse(primitive, described, &read(described.blob));
                let mut floats = Vec::new();
                deformer.expect("sound").apply(&moment.shapes[at], &mut floats);
                floats
            } else {
                let bytes = read(primitive.blob);
                let bytes = &bytes[..primitive.vertex_bytes() as usize];
                bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>()
            };
            for row in floats.chunks_exact(primitive.layout.stride() as usize / 4) {
                let local = DVec3::new(row[0].into(), row[1].into(), row[2].into());
                points.push(world.transform_point3(primitive.origin + local));
            }
        }
    }
    points
}

#[track_caller]
fn assert_same(found: &[DVec3], expected: &[DVec3], tolerance: f64) -> f64 {
    assert_eq!(found.len(), expected.len(), "{found:?}, expected {expected:?}");
    let off = |point: &DVec3| {
        let distances = found.iter().map(|of| of.distance(*point));
        distances.fold(f64::MAX, f64::min)
    };
    let worst = expected.iter().map(off).fold(0.0, f64::max);
    assert!(worst <= tolerance, "{worst} off: {found:?}, expected {expected:?}");
    worst
}

fn times(builder: &mut Builder, times: &[f32]) -> usize {
    let bytes: Vec<u8> = times.iter().flat_map(|time| time.to_le_bytes()).collect();
    builder.accessor("SCALAR", 5126, times.len(), &bytes, None)
}

fn clip(channels: &Value, samplers: &Value) -> Value {
    json!([{ "name": "move", "channels": channels, "samplers": samplers }])
}

const POSITIONS: [[f32; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.0, 0.25, -0.5], [0.5, 2.0, 0.125], [-1.0, 3.0, 1.0]];
const JOINTS: [[u8; 4]; 4] = [[0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]];
const WEIGHTS: [[f32; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0], [0.6, 0.2, 0.0, 0.0]];
/// The upper joint's place below the lower one.
const UPPER: [f64; 3] = [0.25, 1.5, 0.0];

/// The angle about z of the upper joint at a time: keys at 0, 1 and 3 s.
fn angle(time_s: f64) -> f64 {
    let t = time_s.clamp(0.0, 3.0);
    if t < 1.0 { 1.2 * t } else { 1.2 - (t - 1.0) * 0.9 }
}

/// A bar on two joints, one of which turns and the other of which walks along x at 2 m/s.
fn bar(origin: [f64; 3]) -> Builder {
    let mut builder = Builder::empty();
    let positions = builder.floats("VEC3", POSITIONS.as_flattened());
    let normals = builder.floats("VEC3", [[0.0, 0.0, 1.0]; 4].as_flattened());
    let joints = builder.accessor("VEC4", 5121, 4, JOINTS.as_flattened(), None);
    let weights = builder.floats("VEC4", WEIGHTS.as_flattened());
    let indices = builder.indices(&[0, 1, 2, 2, 1, 3]);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals, "JOINTS_0": joints,
        "WEIGHTS_0": weights });
    builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
    builder.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "translation": [9, 9, 9] },
        { "translation": origin, "children": [2] },
        { "children": [3] },
        { "translation": UPPER },
    ]);
    builder.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    builder.json["skins"] = json!([{ "joints": [2, 3] }]);
    let turns = times(&mut builder, &[0.0, 1.0, 3.0]);
    let half = [0.0, 1.0, 3.0].map(|time| (angle(time) / 2.0) as f32);
    let rotations: Vec<f32> = half.iter().flat_map(|of| [0.0, 0.0, of.sin(), of.cos()]).collect();
    let rotations = builder.floats("VEC4", &rotations);
    let walk = times(&mut builder, &[0.0, 3.0]);
    let way = builder.floats("VEC3", &[0.0, 0.0, 0.0, 6.0, 0.0, 0.0]);
    let channels = json!([
        { "sampler": 0, "target": { "node": 3, "path": "rotation" } },
        { "sampler": 1, "target": { "node": 2, "path": "translation" } },
    ]);
    let samplers =
        json!([{ "input": turns, "output": rotations }, { "input": walk, "output": way }]);
    builder.json["animations"] = clip(&channels, &samplers);
    builder
}

/// Returns the bar's vertices at a time, as glTF defines them.
fn bar_at(origin: [f64; 3], time_s: f64) -> Vec<DVec3> {
    let walked = DVec3::new(2.0 * time_s.clamp(0.0, 3.0), 0.0, 0.0);
    let lower = DAffine3::from_translation(DVec3::from(origin) + walked);
    let turn = DQuat::from_rotation_z(angle(time_s));
    let upper = lower * DAffine3::from_rotation_translation(turn, DVec3::from(UPPER));
    let joints = [lower, upper];
    let vertex = |at: usize| {
        let point = DVec3::from(POSITIONS[at].map(f64::from));
        let total: f64 = WEIGHTS[at].iter().map(|weight| f64::from(*weight)).sum();
        let part = |of: usize| {
            let joint = joints[usize::from(JOINTS[at][of])];
            joint.transform_point3(point) * (f64::from(WEIGHTS[at][of]) / total)
        };
        (0..4).map(part).sum()
    };
    (0..4).map(vertex).collect()
}

#[test]
fn skinned_meshes_are_where_a_reference_has_them_at_every_time() {
    let mut worst = 0.0f64;
    for origin in [[0.0; 3], [6_378_137.25, -40.0, 1e7]] {
        let (place, baked, scene) = bake_builder(&bar(origin));
        assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
        assert_eq!((scene.animations.clips[0].duration_s(), scene.deformations.len()), (3.0, 1));
        for step in 0..20 {
            let time_s = f64::from(step) * 0.19 - 0.2;
            let found = drawn_at(&place, &scene, 0, time_s);
            worst = worst.max(assert_same(&found, &bar_at(origin, time_s), 1e-6));
        }
    }
    println!("at most {worst:.1e} m off");
}

/// The bar with these weights in two sets of joints, of which the second names them the other way
/// around.
fn bar_with_weights(sets: [[[f32; 4]; 4]; 2]) -> Builder {
    let mut builder = bar([0.0; 3]);
    let swapped = JOINTS.map(|of| [of[1], of[0], of[2], of[3]]);
    let swapped = builder.accessor("VEC4", 5121, 4, swapped.as_flattened(), None);
    let [first, second] = sets.map(|of| builder.floats("VEC4", of.as_flattened()));
    let attributes = &mut builder.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["WEIGHTS_0"] = json!(first);
    attributes["JOINTS_1"] = json!(swapped);
    attributes["WEIGHTS_1"] = json!(second);
    builder
}

/// The weights of all vertices of the bar as they are baked: in each set, for each vertex.
fn baked_weights(place: &BakeFixture, scene: &Scene) -> Vec<Vec<[f32; 4]>> {
    let primitive = &scene.meshes[0].primitives[0];
    let described = primitive.deformed.as_ref().expect("it is bent");
    let blob = place.store.blobs().read(described.blob).expect("read").expect("there");
    let deformer = Deformer::parse(primitive, described, &blob).expect("sound");
    let sets = deformer.influences.chunks_exact(deformer.vertex_count());
    sets.map(|set| set.iter().map(|of| of.weights).collect()).collect()
}

/// glTF 2.0, 3.7.3.3: the weights of a vertex are of all sets together, and sum to 1; what does not
/// is made to.
#[test]
fn weights_that_do_not_sum_to_one_are_made_to() {
    let none = [[0.0; 4]; 4];
    let times = |by: [f32; 4]| -> [[f32; 4]; 4] {
        std::array::from_fn(|vertex| WEIGHTS[vertex].map(|weight| weight * by[vertex]))
    };
    let check = |sets: [[[f32; 4]; 4]; 2]| {
        let (place, baked, scene) = bake_builder(&bar_with_weights(sets));
        assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
        let weights = baked_weights(&place, &scene);
        for vertex in 0..4 {
            let sum: f32 = weights.iter().flat_map(|set| set[vertex]).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{sum}: {weights:?}");
        }
        // Weights that were multiplied were rounded once more.
        assert_same(&drawn_at(&place, &scene, 0, 1.3), &bar_at([0.0; 3], 1.3), 2e-6);
    };
    check([WEIGHTS, none]);
    check([times([3.0, 1e-4, 0.5, 100.0]), none]);
    // The same parts by the other set, and the half of each by either.
    let swapped = WEIGHTS.map(|of| [of[1], of[0], of[2], of[3]]);
    check([none, swapped.map(|of| of.map(|weight| weight * 7.0))]);
    check([times([2.0; 4]), swapped.map(|of| of.map(|weight| weight * 2.0))]);
    // Values that are no weights count for nothing.
    let mut broken = times([0.25; 4]);
    for weights in &mut broken {
        (weights[2], weights[3]) = (-5.0, f32::NAN);
    }
    check([broken, none]);
}

#[test]
fn edits_of_joints_bend_a_mesh_that_no_clip_bends() {
    for origin in [[0.0; 3], [6_378_137.25, -40.0, 1e7]] {
        let mut builder = bar(origin);
        builder.json["animations"] = json!([]);
        let unused = builder.floats("VEC3", &[1.0; 12]);
        builder.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": unused }]);
        let (place, baked, scene) = bake_builder(&builder);
        assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
        let bent = &scene.deformations[0];
        assert!(scene.deformations.len() == 1 && bent.weights.is_empty(), "{bent:?}");
        let mut edits = SceneEdits::default();
        assert_same(&drawn_with(&place, &scene, &edits, &[]), &bar_at(origin, 0.0), 1e-6);
        // The joints stand so in the clip after 0.7 s.
        let turn = DQuat::from_rotation_z(angle(0.7));
        let upper = DAffine3::from_rotation_translation(turn, DVec3::from(UPPER));
        let lower = DAffine3::from_translation(DVec3::new(1.4, 0.0, 0.0));
        for (node, local) in [(3, upper), (2, lower)] {
            edits.apply(Edit::SetTransform { node: NodeId(node), local });
        }
        assert_same(&drawn_with(&place, &scene, &edits, &[]), &bar_at(origin, 0.7), 1e-6);
    }
}

#[test]
fn targets_that_no_clip_can_weigh_may_be_broken() {
    let mut builder = bar([0.0; 3]);
    builder.json["animations"] = json!([]);
    let targets = [vec![f32::NAN; 12], vec![1.0; 3], vec![0.5; 12]];
    let targets = targets.map(|of| json!({ "POSITION": builder.floats("VEC3", &of) }));
    builder.json["meshes"][0]["primitives"][0]["targets"] = json!(targets);
    builder.json["meshes"][0]["weights"] = json!([0, 0, 1]);
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert_eq!(scene.deformations[0].weights, [0.0, 0.0, 1.0]);
    let raised = bar_at([0.0; 3], 0.0).into_iter().map(|at| at + DVec3::splat(0.5));
    let raised: Vec<DVec3> = raised.collect();
    assert_same(&drawn_with(&place, &scene, &SceneEdits::default(), &[]), &raised, 1e-6);
}

#[test]
fn skins_of_many_vertices_are_bent_by_clips_alone() {
    for (vertices, bent) in [(1 << 18, 1), ((1 << 18) + 1, 0)] {
        let mut builder = bar([0.0; 3]);
        let clips = std::mem::replace(&mut builder.json["animations"], json!([]));
        let mut positions = POSITIONS.as_flattened().to_vec();
        positions.resize(vertices * 3, 0.0);
        let positions = builder.floats("VEC3", &positions);
        // Without a view all are 0, and all follow the first joint.
        let accessors = builder.json["accessors"].as_array_mut().expect("a list");
        for component in [5121, 5126] {
            let zeros = json!({ "componentType": component, "count": vertices, "type": "VEC4" });
            accessors.push(zeros);
        }
        let attributes = json!({ "POSITION": positions, "JOINTS_0": accessors.len() - 2,
            "WEIGHTS_0": accessors.len() - 1 });
        builder.json["meshes"][0]["primitives"][0]["attributes"] = attributes;
        assert_eq!(bake_builder(&builder).2.deformations.len(), bent, "{vertices} vertices");
        builder.json["animations"] = clips;
        assert_eq!(bake_builder(&builder).2.deformations.len(), 1, "{vertices} vertices");
    }
}

#[test]
fn edits_bend_no_skins_of_files_that_are_added_to_a_scene() {
    let place = BakeFixture::new();
    let added = |path: &Path| {
        let baked = bake_added(path, &place.store, &mut |_| {}, &AtomicBool::new(false));
        baked.expect("baked")
    };
    let mut builder = bar([0.0; 3]);
    builder.json["animations"] = json!([]);
    let path = place.write("bar.glb", &builder.glb());
    let opened = place.bake(&path).expect("baked");
    let first = added(&path);
    assert!(!first.reused && added(&path).reused);
    assert_eq!([&opened, &first].map(|of| place.scene(of).deformations.len()), [1, 0]);
    // Without a skin there is no difference.
    let path = place.write("triangle.glb", &Builder::triangle().glb());
    let opened = place.bake(&path).expect("baked");
    assert!(added(&path).reused && added(&path).manifest == opened.manifest);
}

#[test]
fn a_mesh_goes_with_its_whole_skeleton() {
    let mut builder = bar([0.0; 3]);
    // The clip moves the whole skeleton, and bends nothing.
    let channel = json!([{ "sampler": 1, "target": { "node": 1, "path": "translation" } }]);
    builder.json["animations"][0]["channels"] = channel;
    let (place, _, scene) = bake_builder(&builder);
    let start = drawn_at(&place, &scene, 0, 0.0);
    let moved = drawn_at(&place, &scene, 0, 1.5);
    let wanted: Vec<DVec3> = start.iter().map(|point| *point + DVec3::new(3.0, 0.0, 0.0)).collect();
    assert_same(&moved, &wanted, 1e-6);
}

#[test]
fn a_skinned_mesh_with_targets_that_no_clip_weighs_is_bent_by_its_skin() {
    let mut builder = bar([0.0; 3]);
    let target = builder.floats("VEC3", &[1.0; 12]);
    builder.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": target }]);
    // Many exporters write such channels of every node; this one moves nothing.
    let own = json!({ "sampler": 1, "target": { "node": 0, "path": "translation" } });
    builder.json["animations"][0]["channels"].as_array_mut().expect("a list").push(own);
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert_same(&drawn_at(&place, &scene, 0, 1.3), &bar_at([0.0; 3], 1.3), 1e-6);
}

#[test]
fn a_skin_that_only_edits_bend_keeps_its_weights_where_a_clip_moves_its_node() {
    let mut builder = bar([0.0; 3]);
    let target = builder.floats("VEC3", &[1.0; 12]);
    builder.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": target }]);
    builder.json["animations"][0]["channels"] =
        json!([{ "sampler": 1, "target": { "node": 0, "path": "translation" } }]);
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert_same(&drawn_at(&place, &scene, 0, 1.3), &bar_at([0.0; 3], 0.0), 1e-6);
}

#[test]
fn a_mesh_whose_skeleton_is_hidden_is_seen_and_moves() {
    let mut builder = bar([1.0, 2.0, 3.0]);
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    builder.json["nodes"][1]["extensions"] = hidden.clone();
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let drawn = scene.nodes.iter().find(|node| node.mesh.is_some()).expect("a mesh");
    assert_eq!(drawn.parent, None, "it would be hidden with what it hangs from");
    let found = drawn_at(&place, &scene, 0, 1.3);
    assert_same(&found, &bar_at([1.0, 2.0, 3.0], 1.3), 1e-6);
    // The mesh's own node hides it.
    builder.json["nodes"][0]["extensions"] = hidden;
    let (_place, _, scene) = bake_builder(&builder);
    let drawn = scene.nodes.iter().position(|node| node.mesh.is_some()).expect("a mesh") as u32;
    assert!(scene.extras.iter().any(|of| of.node == drawn && of.is_hidden), "{:?}", scene.extras);
}

#[test]
fn a_lost_blob_that_bends_a_mesh_is_made_anew() {
    let (place, _, scene) = bake_builder(&bar([0.0; 3]));
    let deformed = scene.meshes[0].primitives[0].deformed.expect("it is bent");
    let file = place.store.blobs().path_of(deformed.blob);
    let path = place.folder.path().join("scene.glb");
    assert!(place.bake(&path).expect("baked").reused);
    std::fs::remove_file(&file).expect("removed");
    assert!(!place.bake(&path).expect("baked").reused);
    assert!(file.exists());
}

#[test]
fn meshes_that_differ_in_their_targets_alone_are_not_one() {
    let mut builder = Builder::triangle();
    let targets =
        [[0.0, 0.0, 2.0], [0.0, 5.0, 0.0]].map(|to| builder.floats("VEC3", &to.repeat(3)));
    let mut mesh = builder.json["meshes"][0].clone();
    mesh["weights"] = json!([1.0]);
    builder.json["meshes"] = json!([mesh, mesh]);
    for (at, target) in targets.into_iter().enumerate() {
        let primitive = &mut builder.json["meshes"][at]["primitives"][0];
        primitive["targets"] = json!([{ "POSITION": target }]);
    }
    builder.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }]);
    builder.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    let (place, _, scene) = bake_builder(&builder);
    let origins = [0, 1].map(|at| {
        let first = &super::vertices(&place, &scene, at, 0)[0];
        scene.meshes[at].primitives[0].origin + glam::Vec3::from_slice(first).as_dvec3()
    });
    assert_eq!(origins[1] - origins[0], DVec3::new(0.0, 5.0, -2.0));
}

/// Crowds of two squares side by side below a group, where a clip scales `scaled` from `rest`, the
/// scale of the squares, and where a third one stands apart or is not shown.
fn crowds_where_a_clip_scales(scaled: &[u32], rest: f32, has_third: bool) -> Vec<f32> {
    let mut builder = Builder::quad();
    let scale = [rest, rest, rest];
    builder.json["nodes"] = json!([
        { "children": [1, 2] },
        { "mesh": 0, "scale": scale },
        { "mesh": 0, "scale": scale, "translation": [1, 0, 0] },
        { "mesh": 0, "translation": [0, 9, 0] },
    ]);
    let roots: &[u32] = if has_third { &[0, 3] } else { &[0] };
    builder.json["scenes"] = json!([{ "nodes": roots }]);
    let input = times(&mut builder, &[0.0, 1.0]);
    let output = builder.floats("VEC3", &[rest, rest, rest, 2.0, 2.0, 2.0]);
    let channel = |node: &u32| json!({ "sampler": 0, "target": { "node": node, "path": "scale" } });
    let channels: Vec<Value> = scaled.iter().map(channel).collect();
    let samplers = json!([{ "input": input, "output": output }]);
    builder.json["animations"] = clip(&json!(channels), &samplers);
    let (_place, _, scene) = bake_builder(&builder);
    scene.nodes.iter().map(|node| node.crowd).collect()
}

#[test]
fn what_a_clip_may_put_together_is_in_a_crowd_without_end() {
    let endless = [0.0, f32::INFINITY, f32::INFINITY, 0.0];
    assert_eq!(crowds_where_a_clip_scales(&[1, 2], 0.0, true), endless, "points that grow");
    assert_eq!(crowds_where_a_clip_scales(&[1, 2], 0.5, true), endless, "squares that are apart");
    assert_eq!(crowds_where_a_clip_scales(&[0], 1.0, true), endless, "a group beside another");
    // All that is shown moves as one: 1.62 m, where the radius of a square is 0.71.
    let alone = crowds_where_a_clip_scales(&[0], 1.0, false);
    assert!(alone[1..].iter().all(|crowd| (2.28..2.3).contains(crowd)), "{alone:?}");
}

/// A triangle without normals that two targets raise, in turn.
fn morphed() -> Builder {
    let mut builder = Builder::triangle();
    let up = builder.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
    let aside = builder.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let input = times(&mut builder, &[0.0, 2.0]);
    let bytes: Vec<u8> = [0.0f32, 1.0, 1.0, 0.5].iter().flat_map(|w| w.to_le_bytes()).collect();
    let output = builder.accessor("SCALAR", 5126, 4, &bytes, None);
    builder.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up }, { "POSITION": aside }]);
    let channels = json!([{ "sampler": 0, "target": { "node": 0, "path": "weights" } }]);
    let samplers = json!([{ "input": input, "output": output }]);
    builder.json["animations"] = clip(&channels, &samplers);
    builder
}

#[test]
fn weights_of_morph_targets_are_animated() {
    let (place, baked, scene) = bake_builder(&morphed());
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    for (time_s, up, aside) in [(0.0, 0.0, 1.0), (1.0, 0.5, 0.75), (5.0, 1.0, 0.5)] {
        let wanted = [[aside, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 2.0 * up]].map(DVec3::from);
        assert_same(&drawn_at(&place, &scene, 0, time_s), &wanted, 1e-6);
    }
    let Some(flat) = scene.meshes[0].primitives[0].deformed else { panic!("it is bent") };
    assert!(flat.is_flat, "without normals each triangle has its own at any time");
}

#[test]
fn broken_channels_are_noted_and_the_rest_is_played() {
    let noted = |change: &dyn Fn(&mut Builder), parts: &[&str], channels: usize| {
        let mut builder = bar([0.0; 3]);
        change(&mut builder);
        let (_place, baked, scene) = bake_builder(&builder);
        let note = baked.warnings.first().expect("a note");
        for part in parts {
            assert!(note.contains(part), "'{part}' is not in: {note}");
        }
        assert_eq!(scene.animations.clips[0].channels.len(), channels, "{note}");
    };
    let channel = |key: &'static str, value: Value| {
        move |b: &mut Builder| b.json["animations"][0]["channels"][0]["target"][key] = value.clone()
    };
    let sampler = |key: &'static str, value: Value| {
        move |b: &mut Builder| b.json["animations"][0]["samplers"][0][key] = value.clone()
    };
    noted(&channel("path", json!("colour")), &["animations[0].channels[0]", "'colour'"], 1);
    noted(&channel("path", json!("weights")), &["no morph targets"], 1);
    noted(&channel("node", json!(77)), &["nodes[77]"], 1);
    noted(&sampler("input", json!(99)), &["accessors[99]"], 1);
    noted(&sampler("output", json!(0)), &["VEC4"], 1);
    noted(&sampler("interpolation", json!("BEZIER")), &["'BEZIER'"], 1);
    noted(&sampler("interpolation", json!("CUBICSPLINE")), &["36 would be right"], 1);
    let late = |times_of: [f32; 3]| {
        move |b: &mut Builder| {
            let input = times(b, &times_of);
            b.json["animations"][0]["samplers"][0]["input"] = json!(input);
        }
    };
    noted(&late([0.0, 2.0, 1.0]), &["do not rise"], 1);
    noted(&late([0.0, f32::NAN, 1.0]), &["not finite"], 1);
    noted(&late([-1.0, 0.0, 1.0]), &["rising seconds from 0 on"], 1);
    let twice = |b: &mut Builder| {
        let first = b.json["animations"][0]["channels"][0].clone();
        b.json["animations"][0]["channels"].as_array_mut().expect("a list").push(first);
    };
    noted(&twice, &["channels[2]", "twice"], 2);
    let hidden_joints = |b: &mut Builder| b.json["scenes"] = json!([{ "nodes": [0] }]);
    noted(&hidden_joints, &["nodes[0].skin", "not in the shown scene"], 0);
}

#[test]
fn names_and_numbers_of_clips_are_limited() {
    let mut builder = bar([0.0; 3]);
    let mut clips = vec![builder.json["animations"][0].clone()];
    clips[0]["name"] = json!("ä".repeat(200));
    clips.resize(CLIPS_MAX + 1, json!({}));
    builder.json["animations"] = json!(clips);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(scene.animations.clips.len(), CLIPS_MAX);
    assert_eq!(scene.animations.clips[0].name, "ä".repeat(128));
    assert!(baked.warnings[0].contains("4097") && baked.warnings[0].contains("first 4096"));
}

/// Every animated asset bakes without a note about its clips, and is finite at many times.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn animated_assets_move() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets");
    let names = [
        ("animated/Fox.glb", 3),
        ("animated/MorphStressTest.gltf", 3),
        ("blender-io/03_skinned_cylinder/03_skinned_cylinder.gltf", 1),
        ("blender-io/03_all_animations/03_all_animations.gltf", 3),
        ("blender-io/07_nla-anim/07_nla-anim.gltf", 3),
    ];
    for (name, clips) in names {
        let place = BakeFixture::new();
        let baked = place.bake(&folder.join(name)).expect(name);
        let about = baked.warnings.iter().find(|note| note.contains("animation"));
        assert_eq!(about, None, "{name}");
        let scene = place.scene(&baked);
        assert_eq!(scene.animations.clips.len(), clips, "{name}");
        for (at, clip) in (0..).zip(&scene.animations.clips) {
            let first = drawn_at(&place, &scene, at, 0.0);
            let moves = (1..20).any(|step| {
                let time_s = clip.duration_s() * f64::from(step) / 20.0;
                let points = drawn_at(&place, &scene, at, time_s);
                assert!(points.iter().all(|point| point.is_finite()), "{name} at {time_s} s");
                points != first
            });
            assert!(moves, "{name}: {} stands still", clip.name);
        }
    }
}
