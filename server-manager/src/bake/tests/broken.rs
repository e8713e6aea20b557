//! Broken files: each gives its error, none a panic or a large allocation.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::builder::{Builder, glb, png};
use super::{BakeError, Place};

/// Bakes and gives the message.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let place = Place::new();
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
    refused(change, &["nodes[2]", "2097152 instances, 4194304 before them", "4194304"]);
}

#[test]
fn scenes_beyond_all_measure() {
    let scaled = |scale: f64| {
        move |builder: &mut Builder| builder.json["nodes"][0]["scale"] = json!([scale, scale, 1])
    };
    refused(scaled(1e300), &["nodes", "reaches as far as", "smaller numbers"]);
    let place = Place::new();
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
    let place = Place::new();
    let gone = place.bake(&place.folder.path().join("gone.glb")).expect_err("not there");
    assert!(matches!(gone, BakeError::Io { .. }) && gone.to_string().contains("gone.glb"));
}

#[test]
fn indices_and_lengths_out_of_range() {
    let draco = json!(["KHR_draco_mesh_compression"]);
    refused(
        |b| b.json["extensionsRequired"] = draco.clone(),
        &["KHR_draco_mesh_compression", "supported are", "KHR_texture_transform"],
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
            b.json["accessors"][0] =
                json!({ "componentType": 5126, "count": 1u64 << 40, "type": "VEC3" });
        },
        &["accessors[0]", "without a bufferView"],
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
    let place = Place::new();
    let baked = place.bake(&place.write("deep.glb", &deep.glb())).expect("baked");
    assert_eq!(baked.nodes, u64::from(count));
}

#[test]
fn files_that_are_named() {
    let uri = |uri: &str| {
        let mut builder = Builder::quad();
        builder.json["images"] = json!([{ "uri": uri }]);
        refusal("folder/scene.glb", &builder.glb())
    };
    for (name, part) in [
        ("../outside.png", "folder"),
        ("..%2foutside.png", "leads out"),
        ("/etc/hostname", "leads out"),
        ("a/../../outside.png", "leads out"),
        ("https://example.org/a.png", "https"),
        ("file:///etc/hostname", "file"),
        ("gone.png", "can't be found"),
        ("data:image/png;base64,****", "base64"),
    ] {
        let message = uri(name);
        assert!(message.contains("images[0]") && message.contains(part), "{name}: {message}");
    }
    let message = refusal("scene.gltf", &Builder::quad().gltf("gone.bin"));
    assert!(message.contains("buffers[0]") && message.contains("gone.bin"), "{message}");
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_are_not_followed() {
    let place = Place::new();
    place.write("secret.bin", &Builder::quad().bin);
    let path = place.write("folder/scene.gltf", &Builder::quad().gltf("link.bin"));
    let link = place.folder.path().join("folder/link.bin");
    std::os::unix::fs::symlink(place.folder.path().join("secret.bin"), link).expect("linked");
    let message = place.bake(&path).expect_err("outside").to_string();
    assert!(message.contains("link.bin") && message.contains("leads out"), "{message}");
}

fn textured(encoded: &[u8]) -> Builder {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
        "normalTexture": { "index": 0 },
    }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.image(encoded);
    builder
}

#[test]
fn broken_images() {
    let whole = png(8, 8, |x, y| [x as u8, y as u8, 0, 255]);
    for encoded in [&b"not an image"[..], &whole[..whole.len() / 2], b""] {
        let message = refusal("scene.glb", &textured(encoded).glb());
        assert!(message.contains("images[0]"), "{message}");
    }
    // A head that promises 16,384 × 16,384 pixels; its check sum is made right again.
    let mut large = whole.clone();
    large[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    let crc = crc32(&large[12..29]);
    large[29..33].copy_from_slice(&crc.to_be_bytes());
    let message = refusal("scene.glb", &textured(&large).glb());
    assert!(message.contains("can't hold 16384 × 16384"), "{message}");
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
    let place = Place::new();
    let baked = place.bake(&place.write("scene.glb", &builder.glb())).expect("baked");
    assert!(baked.warnings[0].contains("too many vertices in one place"));
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
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
        let place = Place::new();
        let path = place.write("scene.glb", &bytes);
        if let Err(error) = place.bake(&path) {
            prop_assert!(error.to_string().contains("scene.glb"), "{error}");
        }
    }
}
