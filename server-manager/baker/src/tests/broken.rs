//! Broken files: each gives its error, none a panic or a large allocation.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::builder::{Builder, glb, png};
use super::missing::textured;
use super::{BakeError, BakeFixture};

/// Bakes and gives the message.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let place = BakeFixture::new();
    let path = place.write(name, bytes);
    match place.bake(&path) {
        Ok(baked) => panic!("{name} was baked: {baked:?}"),
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with(&path.display().to_string()), "{message}");
            message
        }
    }
}

/// The quad with one change, which must be refused with a message that has all these parts.
#[track_caller]
fn refused(change: impl Fn(&mut Builder), parts: &[&str]) {
    let mut builder = Builder::quad();
    change(&mut builder);
    let message = refusal("scene.glb", &builder.glb());
    for part in parts {
        assert!(message.contains(part), "'{part}' is not in: {message}");
    }
}

#[test]
fn many_nodes_of_many_instances() {
    // A file of a kilobyte that would take forty gigabytes.
    let change = |builder: &mut Builder| {
        let zeros = json!({ "componentType": 5126, "type": "VEC3", "count": 1 << 21 });
        let accessors = builder.json["accessors"].as_array_mut().expect("a list");
        accessors.push(zeros);
        let attributes = json!({ "TRANSLATION": accessors.len() - 1 });
        let extensions = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
        let node = json!({ "mesh": 0, "extensions": extensions });
        builder.json["nodes"] = json!(vec![node; 500]);
        builder.json["scenes"] = json!([{ "nodes": (0..500).collect::<Vec<_>>() }]);
    };
    refused(change, &["nodes[1]", "2097152 instances, 2097152 before them", "a scene can have"]);
}

#[test]
fn many_nodes_of_many_primitives() {
    // Two megabytes that took 18 GB on every display machine.
    let change = |builder: &mut Builder| {
        let primitive = builder.json["meshes"][0]["primitives"][0].clone();
        builder.json["meshes"][0]["primitives"] = json!(vec![primitive; 1000]);
        builder.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 100_000]);
        builder.json["scenes"] = json!([{ "nodes": (0..100_000).collect::<Vec<_>>() }]);
    };
    let numbers = "100000 nodes draw 100000000 primitives in all, where 2097152 can be drawn";
    refused(change, &["nodes", numbers, "join primitives"]);
}

#[test]
fn scenes_beyond_all_measure() {
    let scaled = |scale: f64| {
        move |builder: &mut Builder| builder.json["nodes"][0]["scale"] = json!([scale, scale, 1])
    };
    refused(scaled(1e300), &["nodes[0] ''", "reaches as far as", "smaller numbers"]);
    let nested = |builder: &mut Builder| {
        let scale = json!([1e300, 1e300, 1e300]);
        let name = "n".repeat(999);
        builder.json["nodes"] = json!([
            { "scale": scale.clone(), "children": [1] },
            { "scale": scale, "mesh": 0, "name": name },
        ]);
    };
    refused(nested, &["nodes[1] 'nnn", "world transform overflows", "smaller numbers"]);
    let place = BakeFixture::new();
    let mut builder = Builder::quad();
    scaled(1e30)(&mut builder);
    place.bake(&place.write("large.glb", &builder.glb())).expect("only very large");
}

#[test]
fn files_that_are_not_gltf() {
    let whole = Builder::quad().glb();
    let says = |bytes: &[u8], part: &str| {
        let message = refusal("scene.glb", bytes);
        assert!(message.contains(part), "'{part}' is not in: {message}");
    };
    says(b"", "not glTF");
    says(b"\x89PNG\r\n", "not glTF");
    says(b"{ \"asset\": ", "truncated");
    says(&whole[..whole.len() - 5], "truncated");
    says(&whole[..9], "truncated");
    says(b"{}", "asset.version");
    says(br#"{"asset":{"version":"1.0"},"nodes":{}}"#, "glTF \"1.0\"");
    says(br#"{"asset":{"version":"2.0","minVersion":"2.1"}}"#, "minVersion");
    let mut old = whole.clone();
    old[4] = 1;
    says(&old, "version 1");
    says(br#"{"asset":{"version":"2.0"},"accessors":[{"count":-1}]}"#, "accessors[0]");
    let place = BakeFixture::new();
    let gone = place.bake(&place.folder.path().join("gone.glb")).expect_err("not there");
    assert!(matches!(gone, BakeError::Io { .. }) && gone.to_string().contains("gone.glb"));
}

#[test]
fn indices_and_lengths_out_of_range() {
    let unknown = json!(["ACME_shape"]);
    refused(
        |b| b.json["extensionsRequired"] = unknown.clone(),
        &["ACME_shape", "supported are", "KHR_texture_transform"],
    );
    refused(|b| b.json["scene"] = json!(7), &["scene", "scenes[7]"]);
    refused(|b| b.json["nodes"][0]["mesh"] = json!(9), &["nodes[0].mesh", "meshes[9]"]);
    let primitive = |b: &mut Builder, key: &str, value: Value| {
        b.json["meshes"][0]["primitives"][0][key] = value;
    };
    refused(|b| primitive(b, "indices", json!(99)), &["primitives[0].indices", "accessors[99]"]);
    refused(|b| primitive(b, "material", json!(3)), &["primitives[0]", "materials[3]"]);
    refused(|b| primitive(b, "mode", json!(7)), &["mode 7", "0 to 6"]);
    refused(|b| primitive(b, "indices", json!(0)), &["accessors[0]", "unsigned"]);
    refused(|b| b.json["accessors"][0]["count"] = json!(5), &["accessors[0]", "bufferViews[0]"]);
    refused(
        |b| b.json["accessors"][0]["count"] = json!(u64::MAX),
        &["accessors[0]", "reach out of"],
    );
    refused(
        |b| b.json["accessors"][0]["byteOffset"] = json!(u64::MAX - 3),
        &["accessors[0]", "reach out of"],
    );
    refused(|b| b.json["accessors"][0]["type"] = json!("VEC9"), &["accessors[0]", "VEC9"]);
    refused(|b| b.json["accessors"][0]["componentType"] = json!(5124), &["componentType 5124"]);
    refused(|b| b.json["accessors"][1]["count"] = json!(3), &["NORMAL has 3", "POSITION 4"]);
    refused(
        |b| b.json["bufferViews"][0]["byteLength"] = json!(1u64 << 40),
        &["bufferViews[0]", "buffers[0]"],
    );
    refused(|b| b.json["bufferViews"][0]["buffer"] = json!(4), &["bufferViews[0]", "buffers[4]"]);
    refused(|b| b.json["bufferViews"][0]["byteStride"] = json!(4), &["byteStride 4"]);
    refused(
        |b| {
            b.json["accessors"][1] =
                json!({ "componentType": 5126, "count": 1u64 << 40, "type": "VEC3" });
        },
        &["accessors[1]", "without a bufferView"],
    );
    refused(|b| b.json["buffers"] = json!([{ "byteLength": 9999 }]), &["buffers[0]", "truncated"]);
    refused(
        |b| {
            let indices = b.indices(&[0, 1, 4]);
            b.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        },
        &["index 2 is 4", "4 vertices"],
    );
}

#[test]
fn broken_numbers_and_trees() {
    for value in [f32::NAN, f32::INFINITY] {
        refused(
            |b| b.bin[4..8].copy_from_slice(&value.to_le_bytes()),
            &["accessors[0]", "POSITION 0", "finite"],
        );
    }
    refused(|b| b.json["nodes"][0]["rotation"] = json!([0, 0, 0, 0]), &["nodes[0].rotation"]);
    refused(
        |b| b.json["nodes"][0]["matrix"] = json!([1.0; 16].to_vec()),
        &["nodes[0].matrix", "affine"],
    );
    refused(|b| b.json["nodes"][0]["scale"] = json!([1, 2]), &["nodes[0]", "line 1"]);
    let nodes = |nodes: Value| move |b: &mut Builder| b.json["nodes"] = nodes.clone();
    refused(
        nodes(json!([{ "name": "a", "children": [1] }, { "name": "b", "children": [0] }])),
        &["cycle", "'a'", "'b'"],
    );
    refused(nodes(json!([{ "name": "self", "children": [0] }])), &["cycle", "'self'"]);
    refused(
        nodes(json!([{ "children": [2] }, { "name": "p", "children": [2] }, { "name": "c" }])),
        &["'c'", "two parents", "'p'"],
    );
    refused(nodes(json!([{ "children": [5] }])), &["nodes[0].children", "nodes[5]"]);
    refused(|b| b.json["scenes"][0]["nodes"] = json!([0, 0]), &["nodes[0]", "twice"]);
    refused(|b| b.json["scenes"][0]["nodes"] = json!([8]), &["nodes[8]"]);

    // Deep trees and singular matrices are no faults.
    let count = 100_000;
    let node = |i: u32| json!({ "children": if i + 1 < count { vec![i + 1] } else { vec![] } });
    let mut deep = Builder::quad();
    deep.json["nodes"] = (0..count).map(node).collect();
    deep.json["nodes"][count as usize - 1] = json!({ "mesh": 0, "scale": [0, 0, 0] });
    let place = BakeFixture::new();
    let baked = place.bake(&place.write("deep.glb", &deep.glb())).expect("baked");
    assert_eq!(baked.nodes, u64::from(count));
}

#[test]
fn files_that_are_named() {
    for (name, part) in [
        ("../outside.bin", "folder"),
        ("..%2foutside.bin", "leads out"),
        ("/etc/hostname", "leads out"),
        ("a/../../outside.bin", "leads out"),
        ("https://example.org/a.bin", "https"),
        ("file:///etc/hostname", "file"),
        ("gone.bin", "can't be found"),
        ("data:application/octet-stream;base64,****", "base64"),
    ] {
        let message = refusal("folder/scene.gltf", &Builder::quad().gltf(name));
        assert!(message.contains("buffers[0]") && message.contains(part), "{name}: {message}");
    }
}

#[test]
fn whole_floats_are_integers_and_others_are_refused_with_their_path() {
    let mut builder = textured(&png(2, 2, |_, _| [1, 2, 3, 255]));
    builder.json["buffers"] = json!([{ "byteLength": builder.bin.len() as f64 }]);
    builder.json["materials"][0]["normalTexture"]["extensions"] =
        json!({ "KHR_texture_transform": { "texCoord": 0.0, "offset": [1, 0] } });
    builder.json["samplers"] = json!([{ "magFilter": 9728.0, "wrapS": 33071.0 }]);
    builder.json["textures"][0]["sampler"] = json!(0.0);
    fn floats(json: &mut Value) {
        match json {
            Value::Number(number) => *json = json!(number.as_f64()),
            Value::Array(values) => values.iter_mut().for_each(floats),
            Value::Object(values) => values.values_mut().for_each(floats),
            _ => {}
        }
    }
    let integers = builder.glb();
    floats(&mut builder.json);
    let place = BakeFixture::new();
    let bake = |bytes: &[u8]| {
        let baked = place.bake(&place.write("scene.glb", bytes)).expect("baked");
        (baked.manifest, baked.warnings)
    };
    assert_eq!(bake(&builder.glb()), bake(&integers));

    let with = |path: &[&str], value: &str| {
        let mut builder = textured(&png(2, 2, |_, _| [1, 2, 3, 255]));
        let key = path.iter().fold(&mut builder.json, |json, key| match key.parse::<usize>() {
            Ok(index) => &mut json[index],
            Err(_) => &mut json[*key],
        });
        *key = json!("HERE");
        let text = String::from_utf8(builder.gltf("a.bin")).expect("text");
        refusal("scene.gltf", text.replace("\"HERE\"", value).as_bytes())
    };
    for (path, value, parts) in [
        (&["accessors", "0", "count"][..], "1.5", ["accessors[0].count", "1.5 is not an integer"]),
        (&["nodes", "0", "mesh"], "0.25", ["nodes[0].mesh", "0.25 is not an integer"]),
        (&["scene"], "-1.0", ["scene", "-1"]),
        (&["bufferViews", "1", "byteOffset"], "1e400", ["bufferViews[1].byteOffset", "range"]),
        (
            &["meshes", "0", "primitives", "0", "attributes", "POSITION"],
            "true",
            ["meshes[0].primitives[0].attributes.POSITION", "true"],
        ),
        (
            &["materials", "0", "pbrMetallicRoughness", "baseColorTexture", "index"],
            "7.5",
            ["materials[0].pbrMetallicRoughness.baseColorTexture.index", "7.5 is not an integer"],
        ),
    ] {
        let message = with(path, value);
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    }
}

#[test]
fn keys_that_stand_twice_are_refused_by_name() {
    let text = String::from_utf8(Builder::quad().gltf("scene.bin")).expect("text");
    let with = |once: &str, twice: &str| {
        assert!(text.contains(once), "{once} is not in {text}");
        text.replacen(once, twice, 1)
    };
    for (once, twice, parts) in [
        ("\"POSITION\":0", "\"POSITION\":0,\"POSITION\":1", ["attributes.POSITION", "`POSITION`"]),
        ("{\"mesh\":0}", "{\"mesh\":0,\"mesh\":0}", ["nodes[0]", "`mesh`"]),
        ("\"images\":[]", "\"images\":[],\"images\":[]", ["JSON", "`images`"]),
        ("\"asset\":", "\"asset\":{},\"asset\":", ["JSON", "`asset`"]),
    ] {
        let message = refusal("scene.gltf", with(once, twice).as_bytes());
        for part in parts.into_iter().chain(["duplicate field", "each key once would be right"]) {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    }
    // What programs keep beside a scene is read as by others: the last value counts.
    let place = BakeFixture::new();
    place.write("scene.bin", &Builder::quad().bin);
    let twice = with("{\"mesh\":0}", "{\"mesh\":0,\"extras\":{\"kind\":\"a\",\"kind\":\"b\"}}");
    let baked = place.bake(&place.write("scene.gltf", twice.as_bytes())).expect("baked");
    let kind = place.scene(&baked).extras[0].attributes["kind"].clone();
    assert_eq!(kind, polyptych_scene::Attribute::Text("b".into()));
}

#[test]
fn indices_into_empty_lists_are_not_told_to_be_below_zero() {
    let without = |list: &str, parts: &[&str]| {
        let mut builder = textured(&png(2, 2, |_, _| [1, 2, 3, 255]));
        builder.json[list] = json!([]);
        let message = refusal("scene.glb", &builder.glb());
        assert!(!message.contains("below 0"), "{message}");
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    };
    without("meshes", &["nodes[0].mesh", "meshes[0] is not there", "the file has 0"]);
    without("accessors", &["POSITION", "accessors[0]"]);
    without("bufferViews", &["accessors[0]", "bufferViews[0]"]);
    without("buffers", &["bufferViews[0]", "buffers[0]"]);
    without("materials", &["materials[0]"]);
    without("textures", &["textures[0]"]);
    without("images", &["textures[0] images[0]: images[0] is not there"]);
    without("nodes", &["nodes[0]"]);
    refused(
        |b| {
            b.json["accessors"][0]["count"] = json!(0);
            b.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
        },
        &["the primitive has 0 vertices", "a POSITION with vertices would be right"],
    );
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_are_not_followed() {
    let place = BakeFixture::new();
    place.write("secret.bin", &Builder::quad().bin);
    let path = place.write("folder/scene.gltf", &Builder::quad().gltf("link.bin"));
    let link = place.folder.path().join("folder/link.bin");
    std::os::unix::fs::symlink(place.folder.path().join("secret.bin"), link).expect("linked");
    let message = place.bake(&path).expect_err("outside").to_string();
    assert!(message.contains("link.bin") && message.contains("leads out"), "{message}");
}

#[test]
fn many_vertices_in_one_place_take_no_time() {
    let mut builder = textured(&png(1, 1, |_, _| [9; 4]));
    let count = 150_000;
    let mut positions = vec![[0.0f32; 3]; count];
    positions[0] = [1.0, 2.0, 3.0];
    let uvs: Vec<[f32; 2]> = (0..count).map(|i| [i as f32, (i % 7) as f32]).collect();
    let positions = builder.floats("VEC3", positions.as_flattened());
    let normals = builder.floats("VEC3", vec![[0.0, 0.0, 1.0]; count].as_flattened());
    let uvs = builder.floats("VEC2", uvs.as_flattened());
    builder.json["meshes"][0]["primitives"][0] = json!({ "material": 0, "attributes": {
        "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs } });
    let place = BakeFixture::new();
    let baked = place.bake(&place.write("scene.glb", &builder.glb())).expect("baked");
    assert!(baked.warnings[0].contains("too many vertices or triangles in one place"));
}

#[test]
fn a_hub_of_many_triangles_takes_no_stack() {
    let mut builder = textured(&png(1, 1, |_, _| [9; 4]));
    let count = 100_000_u32;
    let angle = |index: u32| std::f32::consts::TAU * index as f32 / count as f32;
    let rim = (0..count).map(|index| [angle(index).cos(), angle(index).sin(), 0.0]);
    let positions: Vec<[f32; 3]> = std::iter::once([0.0; 3]).chain(rim).collect();
    let uvs: Vec<[f32; 2]> = positions.iter().map(|[x, y, _]| [*x, *y]).collect();
    let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
    let positions = builder.floats("VEC3", positions.as_flattened());
    let normals = builder.floats("VEC3", normals.as_flattened());
    let uvs = builder.floats("VEC2", uvs.as_flattened());
    builder.json["meshes"][0]["primitives"][0] = json!({ "material": 0, "mode": 6,
        "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs } });
    let place = BakeFixture::new();
    let baked = place.bake(&place.write("scene.glb", &builder.glb())).expect("baked");
    assert!(baked.warnings[0].contains("too many vertices or triangles in one place"));
}

/// Replaces the `nth` number of the JSON, counted from the front and around.
fn replace_number(json: &mut Value, nth: usize, by: &Value) {
    fn numbers<'a>(json: &'a mut Value, out: &mut Vec<&'a mut Value>) {
        match json {
            Value::Number(_) => out.push(json),
            Value::Array(values) => values.iter_mut().for_each(|value| numbers(value, out)),
            Value::Object(values) => values.values_mut().for_each(|value| numbers(value, out)),
            _ => {}
        }
    }
    let mut all = Vec::new();
    numbers(json, &mut all);
    let count = all.len();
    *all[nth % count] = by.clone();
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 500,
        failure_persistence: None,
        ..Default::default()
    })]

    #[test]
    fn no_mutation_panics(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        numbers in prop::collection::vec((any::<usize>(), prop_oneof![
            (-2i64..20).prop_map(|n| json!(n)),
            (0u64..u64::MAX).prop_map(|n| json!(n)),
            any::<f64>().prop_map(|n| json!(n)),
            (5120i64..5127).prop_map(|n| json!(n)),
        ]), 0..4),
        cut in prop::option::weighted(0.1, any::<prop::sample::Index>()),
    ) {
        let mut builder = textured(&png(8, 8, |x, y| [x as u8 * 9, y as u8, 7, 200]));
        builder.json["buffers"] = json!([{ "byteLength": builder.bin.len() }]);
        for (nth, by) in &numbers {
            replace_number(&mut builder.json, *nth, by);
        }
        let mut bytes = glb(&builder.json.to_string(), &builder.bin);
        for (at, by) in &flips {
            let at = at.index(bytes.len());
            bytes[at] = *by;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let place = BakeFixture::new();
        let path = place.write("scene.glb", &bytes);
        if let Err(error) = place.bake(&path) {
            prop_assert!(error.to_string().contains("scene.glb"), "{error}");
        }
    }
}
