//! Skins and morph targets at rest, against a small reference of their own in f64.

use glam::{DVec3, Vec3};
use polyptych_scene::Scene;
use serde_json::{Value, json};

use super::builder::Builder;
use super::{BakeFixture, bake_builder, vertices};

/// Rows of a matrix.
type Matrix = [[f64; 4]; 4];

const IDENTITY: Matrix =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

fn point(matrix: &Matrix, p: [f64; 3]) -> DVec3 {
    let [x, y, z] = p;
    let row = |r: [f64; 4]| r[0] * x + r[1] * y + r[2] * z + r[3];
    DVec3::new(row(matrix[0]), row(matrix[1]), row(matrix[2]))
}

/// A node's translation, rotation (a unit quaternion) and scale.
#[derive(Clone, Copy)]
struct Trs([f64; 3], [f64; 4], [f64; 3]);

impl Trs {
    fn json(&self) -> Value {
        json!({ "translation": self.0, "rotation": self.1, "scale": self.2 })
    }

    /// glTF 2.0, 3.5.2; the matrix of a quaternion as in any textbook.
    fn matrix(&self) -> Matrix {
        let Self(t, [x, y, z, w], s) = *self;
        let r = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let row = |i: usize| [r[i][0] * s[0], r[i][1] * s[1], r[i][2] * s[2], t[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }
}

/// Three joints, each below the one before, under an armature that stands somewhere.
fn skeleton(origin: [f64; 3]) -> [Trs; 4] {
    [
        Trs(origin, [0.0, 0.6, 0.0, 0.8], [1.0, 1.0, 1.0]),
        Trs([0.3, 1.0, -0.2], [0.0, 0.0, 0.28, 0.96], [1.0, 1.5, 1.0]),
        Trs([0.0, 1.0, 0.0], [0.48, 0.0, 0.6, 0.64], [1.0, 1.0, 2.0]),
        Trs([0.1, 1.0, 0.4], [0.0, 0.8, 0.0, 0.6], [0.5, 0.5, 0.5]),
    ]
}

/// Inverse bind matrices that f32 holds exactly.
fn inverse_binds() -> [Matrix; 3] {
    let mut matrices = [IDENTITY; 3];
    matrices[0][1][3] = -0.5;
    matrices[1] =
        [[0.0, -1.0, 0.0, 0.25], [1.0, 0.0, 0.0, -1.5], [0.0, 0.0, 1.0, 0.5], IDENTITY[3]];
    matrices[2][0] = [0.5, 0.25, 0.0, 0.0];
    matrices
}

const POSITIONS: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.0, 0.25, -0.5], [0.5, 2.0, 0.125], [-1.0, 3.0, 1.0]];
const JOINTS: [[u8; 4]; 4] = [[0, 1, 2, 0], [1, 0, 2, 0], [2, 2, 1, 0], [0, 0, 0, 0]];
/// In 255ths; the sums are not 255, and readers make them so.
const WEIGHTS: [[u8; 4]; 4] = [[255, 0, 0, 0], [100, 55, 100, 0], [10, 20, 60, 0], [0, 0, 0, 0]];

fn flat(values: &[[f64; 3]]) -> Vec<f32> {
    values.iter().flatten().map(|value| *value as f32).collect()
}

/// The component type of joints and weights in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    Bytes,
    Shorts,
    Floats,
}

fn skin_attributes(builder: &mut Builder, form: Form) -> [usize; 2] {
    let joints = JOINTS.as_flattened();
    let weights = WEIGHTS.as_flattened();
    let shorts = |values: &[u8], by: u16| -> Vec<u8> {
        values.iter().flat_map(|value| (u16::from(*value) * by).to_le_bytes()).collect()
    };
    let joints = match form {
        Form::Bytes => builder.accessor("VEC4", 5121, 4, joints, None),
        _ => builder.accessor("VEC4", 5123, 4, &shorts(joints, 1), None),
    };
    let weights = match form {
        Form::Bytes => builder.accessor("VEC4", 5121, 4, weights, None),
        Form::Shorts => builder.accessor("VEC4", 5123, 4, &shorts(weights, 257), None),
        Form::Floats => {
            let floats: Vec<f32> = weights.iter().map(|w| f32::from(*w) / 64.0).collect();
            builder.floats("VEC4", &floats)
        }
    };
    if form != Form::Floats {
        builder.json["accessors"][weights]["normalized"] = json!(true);
    }
    [joints, weights]
}

/// Two triangles on three joints. The node of the mesh is turned and moved, which means nothing.
fn skinned(origin: [f64; 3], form: Form) -> Builder {
    let mut builder = Builder::empty();
    let positions = builder.floats("VEC3", &flat(&POSITIONS));
    let normals = builder.floats("VEC3", [[0.0, 0.0, 1.0]; 4].as_flattened());
    let indices = builder.indices(&[0, 1, 2, 2, 1, 3]);
    let [joints, weights] = skin_attributes(&mut builder, form);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals, "JOINTS_0": joints,
        "WEIGHTS_0": weights });
    builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
    let columns: Vec<f32> =
        inverse_binds().iter().flat_map(|m| (0..16).map(|i| m[i % 4][i / 4] as f32)).collect();
    let bytes: Vec<u8> = columns.iter().flat_map(|value| value.to_le_bytes()).collect();
    let matrices = builder.accessor("MAT4", 5126, 3, &bytes, None);
    let mut nodes: Vec<Value> = skeleton(origin).iter().map(Trs::json).collect();
    for (i, node) in nodes.iter_mut().enumerate().take(3) {
        node["children"] = json!([i + 2]);
    }
    let node = json!({ "mesh": 0, "skin": 0, "translation": [50, 60, 70], "scale": [3, 3, 3] });
    nodes.insert(0, node);
    builder.json["nodes"] = json!(nodes);
    builder.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    builder.json["skins"] = json!([{ "joints": [2, 3, 4], "inverseBindMatrices": matrices }]);
    builder
}

/// Returns the four vertices as glTF defines them: the weighted sum of joint · inverse bind.
fn reference(origin: [f64; 3]) -> Vec<DVec3> {
    let mut world = IDENTITY;
    let mut joints = Vec::new();
    for (i, node) in skeleton(origin).iter().enumerate() {
        world = times(&world, &node.matrix());
        if i > 0 {
            joints.push(times(&world, &inverse_binds()[i - 1]));
        }
    }
    let vertex = |i: usize| {
        let total: f64 = WEIGHTS[i].iter().map(|w| f64::from(*w)).sum();
        if total == 0.0 {
            return point(&joints[usize::from(JOINTS[i][0])], POSITIONS[i]);
        }
        let part = |k: usize| {
            let joint = &joints[usize::from(JOINTS[i][k])];
            point(joint, POSITIONS[i]) * (f64::from(WEIGHTS[i][k]) / total)
        };
        (0..4).map(part).sum()
    };
    (0..4).map(vertex).collect()
}

/// World positions of all vertices that are drawn.
fn drawn(place: &BakeFixture, scene: &Scene) -> Vec<DVec3> {
    let world = scene.world_from_nodes();
    let mut points = Vec::new();
    for (node, world) in scene.nodes.iter().zip(world) {
        let Some(mesh) = node.mesh.map(|mesh| mesh as usize) else { continue };
        for (i, primitive) in scene.meshes[mesh].primitives.iter().enumerate() {
            for row in vertices(place, scene, mesh, i) {
                let local = DVec3::new(row[0].into(), row[1].into(), row[2].into());
                points.push(world.transform_point3(primitive.origin + local));
            }
        }
    }
    points
}

#[track_caller]
fn assert_same(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{found:?}, expected {expected:?}");
    for point in expected {
        let nearest = found.iter().map(|p| p.distance(*point)).fold(f64::MAX, f64::min);
        assert!(nearest <= tolerance, "{point} is {nearest} off in {found:?}");
    }
}

#[test]
fn skinned_meshes_stand_where_their_joints_put_them() {
    for form in [Form::Bytes, Form::Shorts, Form::Floats] {
        for origin in [[0.0; 3], [6_378_137.25, -40.0, 1e7]] {
            let (place, baked, scene) = bake_builder(&skinned(origin, form));
            // As exact far away as near: f64 has 2e-9 there, f32 half a metre.
            assert_same(&drawn(&place, &scene), &reference(origin), 1e-6);
            assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
            let bounds = scene.bounds.expect("bounds");
            let expected = reference(origin);
            let least = expected.iter().copied().fold(DVec3::MAX, DVec3::min);
            let most = expected.iter().copied().fold(DVec3::MIN, DVec3::max);
            // Of a turned mesh the box around its box.
            let size = (most - least).length();
            assert!(bounds.min.cmple(least + 1e-6).all() && bounds.max.cmpge(most - 1e-6).all());
            assert!((bounds.max - bounds.min).max_element() < 2.0 * size, "{bounds:?}");
        }
    }
}

#[test]
fn joints_in_several_trees_and_outside_the_scene_count() {
    let mut builder = skinned([0.0; 3], Form::Bytes);
    // The same joints without a common parent, given by matrices, and not shown themselves.
    let mut world = IDENTITY;
    let mut nodes = vec![builder.json["nodes"][0].clone()];
    for node in skeleton([1e6, 0.0, 0.5]) {
        world = times(&world, &node.matrix());
        let columns: Vec<f64> = (0..16).map(|i| world[i % 4][i / 4]).collect();
        nodes.push(json!({ "matrix": columns }));
    }
    builder.json["nodes"] = json!(nodes);
    builder.json["scenes"] = json!([{ "nodes": [0] }]);
    let (place, _, scene) = bake_builder(&builder);
    assert_same(&drawn(&place, &scene), &reference([1e6, 0.0, 0.5]), 1e-6);
}

#[test]
fn a_skin_without_inverse_bind_matrices_has_identities() {
    let mut builder = skinned([0.0; 3], Form::Bytes);
    builder.json["skins"] = json!([{ "joints": [2, 3, 4] }]);
    builder.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "scale": [9, 9, 9] },
        {}, { "translation": [1, 2, 3] }, { "translation": [1, 2, 3] }, { "translation": [1, 2, 3] }
    ]);
    let (place, _, scene) = bake_builder(&builder);
    let expected = POSITIONS.iter().map(|p| DVec3::from(*p) + DVec3::new(1.0, 2.0, 3.0));
    assert_same(&drawn(&place, &scene), &expected.collect::<Vec<_>>(), 1e-7);
}

#[test]
fn copies_of_a_skeleton_in_one_pose_share_their_mesh_and_others_do_not() {
    let mut builder = skinned([0.0; 3], Form::Floats);
    let nodes = builder.json["nodes"].as_array_mut().expect("a list");
    let armature: Vec<Value> = nodes[1..].to_vec();
    // Three more of them: elsewhere, elsewhere again, and with a joint that is turned.
    for copy in 0..3usize {
        let first = nodes.len() + 1;
        nodes.push(json!({ "mesh": 0, "skin": copy + 1 }));
        let mut bones = armature.clone();
        bones[0]["translation"] = json!([1e6 * copy as f64, 7.1, 3.3]);
        for (i, bone) in bones.iter_mut().enumerate().take(3) {
            bone["children"] = json!([first + i + 1]);
        }
        if copy == 2 {
            bones[2]["rotation"] = json!([0, 0, 0, 1]);
        }
        nodes.extend(bones);
    }
    let matrices = builder.json["skins"][0]["inverseBindMatrices"].clone();
    let skin = |first: usize| {
        let joints = [first, first + 1, first + 2];
        json!({ "joints": joints, "inverseBindMatrices": matrices })
    };
    builder.json["skins"] = json!([skin(2), skin(7), skin(12), skin(17)]);
    // The joints are not in the scene, so that no edit bends what follows them.
    builder.json["scenes"] = json!([{ "nodes": [0, 5, 10, 15] }]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((scene.meshes.len(), baked.triangles), (2, 8));
    assert_ne!(scene.meshes[0].primitives[0].blob, scene.meshes[1].primitives[0].blob);
    // Where they are, each is bent by itself.
    builder.json["scenes"] = json!([{ "nodes": [0, 1, 5, 6, 10, 11, 15, 16] }]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((scene.deformations.len(), baked.triangles), (4, 8));
}

/// The quad of the builder with a target that moves, turns and colours it.
fn morphed() -> Builder {
    let mut builder = Builder::quad();
    // Sparse: only the third corner moves.
    let moved = builder.view(&[0.0f32, 0.0, 2.0].map(f32::to_le_bytes).concat(), None);
    let at = builder.view(&[2, 0], None);
    let accessors = builder.json["accessors"].as_array_mut().expect("a list");
    accessors.push(json!({ "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
        "count": 1, "indices": { "bufferView": at, "componentType": 5121 },
        "values": { "bufferView": moved } } }));
    let sparse = accessors.len() - 1;
    // Quantised: bytes that stand for -1 to 1.
    let bytes = [127i8, 0, 0, 0].map(|value| value as u8).repeat(4);
    let quantised = builder.accessor("VEC3", 5120, 4, &bytes, Some(4));
    builder.json["accessors"][quantised]["normalized"] = json!(true);
    let normals = builder.floats("VEC3", [[1.0, 0.0, -1.0]; 4].as_flattened());
    builder.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": sparse, "NORMAL": normals }, { "POSITION": quantised }]);
    builder
}

#[test]
fn morph_weights_of_the_node_come_before_those_of_the_mesh() {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let expected = |weights: [f64; 2]| -> Vec<DVec3> {
        let corner = |i: usize| {
            let raised = if i == 2 { 2.0 * weights[0] } else { 0.0 };
            DVec3::new(corners[i][0] + weights[1], corners[i][1], raised)
        };
        (0..4).map(corner).collect()
    };
    let mut builder = morphed();
    let check = |builder: &Builder, weights: [f64; 2]| {
        let (place, baked, scene) = bake_builder(builder);
        assert_same(&drawn(&place, &scene), &expected(weights), 1e-6);
        assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
        vertices(&place, &scene, 0, 0)
    };
    check(&builder, [0.0, 0.0]);
    builder.json["meshes"][0]["weights"] = json!([0.25, 0.0]);
    check(&builder, [0.25, 0.0]);
    builder.json["nodes"][0]["weights"] = json!([1.0, -0.5]);
    for row in check(&builder, [1.0, -0.5]) {
        assert_eq!(row[3..6], [1.0, 0.0, 0.0], "the normal follows its target");
    }
    // Weights that are not given are 0, and those of targets that are not there are nothing.
    builder.json["nodes"][0]["weights"] = json!([0.5]);
    check(&builder, [0.5, 0.0]);
    builder.json["nodes"][0]["weights"] = json!([0, 2, 3, 4]);
    check(&builder, [0.0, 2.0]);
}

#[test]
fn colors_of_targets_may_have_an_alpha_where_those_of_the_mesh_have_none_and_the_reverse() {
    for (base, delta, expected) in [
        (&[0.5f32, 0.25, 0.0][..], &[0.25f32, 0.25, 0.5][..], [0.625f32, 0.375, 0.25, 1.0]),
        (&[0.5, 0.25, 0.0], &[0.25, 0.25, 0.5, -0.5], [0.625, 0.375, 0.25, 0.75]),
        (&[0.5, 0.25, 0.0, 0.5], &[0.25, 0.25, 0.5], [0.625, 0.375, 0.25, 0.5]),
        (&[0.5, 0.25, 0.0, 0.5], &[0.25, 0.25, 0.5, -0.5], [0.625, 0.375, 0.25, 0.25]),
    ] {
        let mut builder = Builder::quad();
        let kind = |of: &[f32]| if of.len() == 3 { "VEC3" } else { "VEC4" };
        let [base, delta] = [base, delta].map(|of| builder.floats(kind(of), &of.repeat(4)));
        let mesh = &mut builder.json["meshes"][0];
        mesh["primitives"][0]["attributes"]["COLOR_0"] = json!(base);
        mesh["primitives"][0]["targets"] = json!([{ "COLOR_0": delta }]);
        mesh["weights"] = json!([0.5]);
        let check = |builder: &Builder, bent: usize| {
            let (place, baked, scene) = bake_builder(builder);
            assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
            assert_eq!(scene.deformations.len(), bent);
            for row in vertices(&place, &scene, 0, 0) {
                assert_eq!(row[6..10], expected);
            }
        };
        check(&builder, 0);
        // The same where a clip may change the weight.
        let [input, output] = [0.0f32, 0.5]
            .map(|number| builder.accessor("SCALAR", 5126, 1, &number.to_le_bytes(), None));
        let target = json!({ "node": 0, "path": "weights" });
        builder.json["animations"] = json!([{ "channels": [{ "sampler": 0, "target": target }],
            "samplers": [{ "input": input, "output": output }] }]);
        check(&builder, 1);
    }
}

#[test]
fn nodes_share_a_mesh_in_several_poses_and_zero_weights_cost_nothing() {
    let mut builder = morphed();
    builder.json["nodes"] = json!([
        { "mesh": 0, "weights": [1, 0] }, { "mesh": 0 }, { "mesh": 0, "weights": [0, 0] },
        { "mesh": 0, "weights": [1.0] },
    ]);
    builder.json["scenes"] = json!([{ "nodes": [0, 1, 2, 3] }]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!((scene.meshes.len(), baked.triangles), (2, 8));
    assert_eq!(scene.nodes[0].mesh, scene.nodes[3].mesh);
    assert_eq!(scene.nodes[1].mesh, scene.nodes[2].mesh);
    // The unmorphed one is the very blob that it is without targets.
    let (_place, _, plain) = bake_builder(&Builder::quad());
    let blob = |scene: &Scene, node: usize| {
        scene.meshes[scene.nodes[node].mesh.expect("a mesh") as usize].primitives[0].blob
    };
    assert_eq!(blob(&scene, 1), blob(&plain, 0));
}

#[test]
fn mirrored_joints_turn_triangles_so_that_fronts_stay_fronts() {
    let mut builder = skinned([0.0; 3], Form::Bytes);
    builder.json["skins"] = json!([{ "joints": [2, 3, 4] }]);
    let joint = json!({ "scale": [-1, 1, 1] });
    builder.json["nodes"] =
        json!([{ "mesh": 0, "skin": 0 }, {}, joint.clone(), joint.clone(), joint]);
    let attributes = &mut builder.json["meshes"][0]["primitives"][0]["attributes"];
    attributes.as_object_mut().expect("an object").remove("NORMAL");
    let (place, _, scene) = bake_builder(&builder);
    let p = POSITIONS.map(DVec3::from);
    // Flat normals are made of the turned triangles: those of the file, mirrored.
    let normal = |[a, b, c]: [usize; 3]| {
        let normal = (p[b] - p[a]).cross(p[c] - p[a]).normalize();
        (normal * DVec3::new(-1.0, 1.0, 1.0)).as_vec3()
    };
    let expected = [normal([0, 1, 2]), normal([2, 1, 3])];
    for row in vertices(&place, &scene, 0, 0) {
        let found = Vec3::new(row[3], row[4], row[5]);
        let is_one = expected.iter().any(|normal| normal.distance(found) < 1e-5);
        assert!(is_one, "{found} is none of {expected:?}");
    }
}

#[test]
fn primitives_without_joints_stay_with_their_node() {
    let mut builder = skinned([0.0; 3], Form::Bytes);
    let mut rigid = builder.json["meshes"][0]["primitives"][0].clone();
    let attributes = rigid["attributes"].as_object_mut().expect("an object");
    attributes.remove("JOINTS_0");
    attributes.remove("WEIGHTS_0");
    builder.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(rigid.clone());
    let (place, _, scene) = bake_builder(&builder);
    let of_node = POSITIONS.iter().map(|p| DVec3::from(*p) * 3.0 + DVec3::new(50.0, 60.0, 70.0));
    let expected: Vec<_> = reference([0.0; 3]).into_iter().chain(of_node.clone()).collect();
    assert_same(&drawn(&place, &scene), &expected, 1e-4);

    builder.json["meshes"][0]["primitives"] = json!([rigid]);
    let (place, baked, scene) = bake_builder(&builder);
    assert_same(&drawn(&place, &scene), &of_node.collect::<Vec<_>>(), 1e-4);
    assert!(baked.warnings[0].contains("nodes[0].skin"), "{:?}", baked.warnings);
}

#[test]
fn broken_skins_and_targets_are_refused_with_their_path() {
    let refused = |change: &dyn Fn(&mut Builder), parts: &[&str]| {
        let mut builder = skinned([0.0; 3], Form::Bytes);
        change(&mut builder);
        let place = BakeFixture::new();
        let path = place.write("scene.glb", &builder.glb());
        let message = place.bake(&path).expect_err("broken").to_string();
        assert!(message.contains("scene.glb") && !message.contains('\n'), "{message}");
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    };
    let skin = |key: &'static str, value: Value| {
        move |b: &mut Builder| b.json["skins"][0][key] = value.clone()
    };
    refused(&|b| b.json["nodes"][0]["skin"] = json!(3), &["nodes[0].skin", "skins[3]", "has 1"]);
    refused(&skin("joints", json!([])), &["skins[0]", "no joints"]);
    refused(&skin("joints", json!([2, 3, 99])), &["skins[0].joints", "nodes[99]"]);
    refused(&skin("joints", json!([2, 3])), &["vertex 1", "joint 2", "has 2", "below 2"]);
    refused(&skin("joints", json!([2, 3, 4, 4])), &["inverseBindMatrices", "3 matrices for 4"]);
    refused(&skin("inverseBindMatrices", json!(0)), &["accessors[0]", "MAT4"]);
    refused(&skin("inverseBindMatrices", json!(77)), &["inverseBindMatrices", "accessors[77]"]);
    refused(&|b| b.json["skins"] = json!([]), &["skins[0]", "file has 0"]);
    let attribute = |name: &'static str, index: usize| {
        move |b: &mut Builder| {
            b.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(index);
        }
    };
    refused(&attribute("JOINTS_0", 1), &["accessors[1]", "unsigned"]);
    refused(&attribute("WEIGHTS_0", 0), &["accessors[0]", "VEC4"]);
    let target = |b: &mut Builder| {
        b.json["meshes"][0]["weights"] = json!([1]);
        b.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 2 }]);
    };
    refused(&target, &["targets[0].POSITION", "6 elements", "POSITION 4"]);
}

/// The pieces of a square with so many units a side, which its joint scales by this.
fn pieces_of_square(units: f32, scale: f32) -> usize {
    let side = 60_u32;
    let mut builder = Builder::empty();
    let at = |i: u32| [i % (side + 1), 0, i / (side + 1)].map(|at| at as f32 * units / side as f32);
    let count = ((side + 1) * (side + 1)) as usize;
    let positions: Vec<f32> = (0..count as u32).flat_map(at).collect();
    let positions = builder.floats("VEC3", &positions);
    let normals = builder.floats("VEC3", &[0.0, 1.0, 0.0].repeat(count));
    let joints = builder.accessor("VEC4", 5121, count, &vec![0; 4 * count], None);
    let weights = builder.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(count));
    let quad = |i: u32| {
        let at = i / side * (side + 1) + i % side;
        [at, at + side + 1, at + 1, at + 1, at + side + 1, at + side + 2]
    };
    let indices = builder.indices(&(0..side * side).flat_map(quad).collect::<Vec<u32>>());
    let attributes = json!({ "POSITION": positions, "NORMAL": normals, "JOINTS_0": joints,
        "WEIGHTS_0": weights });
    builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
    let mut columns = [0.0_f32; 16];
    (columns[0], columns[5], columns[10], columns[15]) = (scale, scale, scale, 1.0);
    let bytes: Vec<u8> = columns.iter().flat_map(|value| value.to_le_bytes()).collect();
    let matrices = builder.accessor("MAT4", 5126, 1, &bytes, None);
    builder.json["nodes"] = json!([{ "mesh": 0, "skin": 0 }, {}]);
    builder.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    builder.json["skins"] = json!([{ "joints": [1], "inverseBindMatrices": matrices }]);
    let (_place, _, scene) = bake_builder(&builder);
    assert_eq!(scene.deformations.len(), 1, "edits bend it");
    scene.meshes[0].primitives.len()
}

#[test]
fn bent_meshes_are_split_by_the_metres_that_joints_make_of_their_units() {
    assert_eq!(pieces_of_square(2000.0, 1.0), 4, "2 km with 7,200 triangles");
    assert_eq!(pieces_of_square(1.0, 2000.0), 4, "the same, quantised");
    assert_eq!(pieces_of_square(2000.0, 0.001), 1, "2 m in millimetres");
}
