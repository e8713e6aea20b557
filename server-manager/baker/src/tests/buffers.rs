//! Buffers that stay in their files: one or several, read part by part while the scene is baked.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::builder::{Builder, png};
use super::missing::textured;
use super::{BakeFixture, Progress, bake, bake_builder, vertices};

/// Writes a scene whose views lie in so many files in turn.
fn write_parts(place: &BakeFixture, builder: &Builder, count: usize) -> PathBuf {
    let mut json = builder.json.clone();
    let mut files = vec![Vec::new(); count];
    let views = json["bufferViews"].as_array_mut().expect("a list");
    for (number, view) in views.iter_mut().enumerate() {
        let [first, length] =
            ["byteOffset", "byteLength"].map(|key| view[key].as_u64().expect("a number") as usize);
        let file: &mut Vec<u8> = &mut files[number % count];
        view["buffer"] = json!(number % count);
        view["byteOffset"] = json!(file.len());
        file.extend_from_slice(&builder.bin[first..first + length]);
        file.resize(file.len().next_multiple_of(4), 0);
    }
    let buffer = |(number, bytes): (usize, &Vec<u8>)| {
        let name = format!("part-{number}.bin");
        place.write(&name, bytes);
        json!({ "uri": name, "byteLength": bytes.len() })
    };
    json["buffers"] = files.iter().enumerate().map(buffer).collect();
    place.write("scene.gltf", json.to_string().as_bytes())
}

#[test]
fn a_scene_is_baked_alike_from_one_file_from_several_and_from_its_text() {
    let builder = textured(&png(8, 8, |x, y| [x as u8 * 9, y as u8, 7, 200]));
    let place = BakeFixture::new();
    let whole = place.bake(&place.write("scene.glb", &builder.glb())).expect("baked");
    for count in [1, 3] {
        let parts = place.bake(&write_parts(&place, &builder, count)).expect("baked");
        assert!(!parts.reused, "its files are others");
        assert_eq!(parts.manifest, whole.manifest, "{count} files");
    }
    let mut uri = "data:application/octet-stream,".to_owned();
    builder.bin.iter().for_each(|byte| write!(uri, "%{byte:02x}").expect("written"));
    let text = place.bake(&place.write("scene.gltf", &builder.gltf(&uri))).expect("baked");
    assert_eq!(text.manifest, whole.manifest);
}

#[test]
fn elements_of_several_reads_come_in_order() {
    let at = |point: u16| {
        let [x, y, z] = [point % 64, point / 64 % 64, point / 4096].map(f32::from);
        [x * 0.5, y * 0.5, z]
    };
    // The stride is one that reads do not end with.
    let row = |point: u16| {
        let mut row = at(point).map(f32::to_le_bytes).concat();
        row.resize(100, 0xff);
        row
    };
    let mut builder = Builder::empty();
    let points = 0..50_000;
    let bytes: Vec<u8> = points.clone().flat_map(row).collect();
    let positions = builder.accessor("VEC3", 5126, points.len(), &bytes, Some(100));
    builder.mesh(&json!({ "mode": 0, "attributes": { "POSITION": positions } }));
    let (place, _, scene) = bake_builder(&builder);
    let rows = vertices(&place, &scene, 0, 0);
    assert_eq!(rows.len(), points.len());
    for (row, point) in rows.iter().zip(points) {
        assert_eq!(row[..3], at(point), "{point}");
    }
}

#[test]
fn a_buffer_that_changes_meanwhile_is_refused() {
    let place = BakeFixture::new();
    let builder = Builder::quad();
    let path = place.write("scene.gltf", &builder.gltf("a.bin"));
    let buffer = place.write("a.bin", &builder.bin);
    let mut change = |progress: Progress| {
        if progress.stage == "nodes" {
            fs::write(&buffer, [&builder.bin[..], &[0; 4]].concat()).expect("written");
        }
    };
    let baked = bake(&path, &place.store, &mut change, &AtomicBool::new(false));
    let message = baked.expect_err("changed").to_string();
    assert!(message.contains("a.bin changed while it was read"), "{message}");
    place.bake(&path).expect("it rests by now");
}
