//! Files with several scenes: one of them is baked, by its name or its number.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::builder::Builder;
use super::{BakeFixture, Baked, bake_scene};

/// A triangle that three nodes show, and these scenes.
fn file(scenes: &Value, default: Option<u32>) -> Vec<u8> {
    let mut builder = Builder::triangle();
    builder.json["nodes"] =
        json!([{ "mesh": 0, "name": "a" }, { "mesh": 0, "name": "b" }, { "mesh": 0, "name": "c" }]);
    builder.json["scenes"] = scenes.clone();
    match default {
        Some(index) => builder.json["scene"] = json!(index),
        None => {
            builder.json.as_object_mut().expect("an object").remove("scene");
        }
    }
    builder.glb()
}

/// Two scenes with names, and one without.
fn three(default: Option<u32>) -> Vec<u8> {
    let scenes = json!([{ "name": "day", "nodes": [0] }, { "name": "night", "nodes": [1] },
        { "nodes": [2] }]);
    file(&scenes, default)
}

fn bake(place: &BakeFixture, path: &Path, scene: Option<&str>) -> Result<Baked, String> {
    let cancel = AtomicBool::new(false);
    let baked = bake_scene(path, scene, &place.store, &mut |_| {}, &cancel);
    baked.map_err(|error| error.to_string())
}

/// The names of the nodes that are shown.
fn shown(place: &BakeFixture, path: &Path, scene: Option<&str>) -> Vec<String> {
    let baked = bake(place, path, scene).expect("baked");
    place.scene(&baked).nodes.iter().map(|node| node.name.clone()).collect()
}

#[test]
fn a_scene_is_chosen_by_its_name_or_its_number() {
    let place = BakeFixture::new();
    let path = place.write("town.glb", &three(Some(1)));
    for (wanted, node) in [
        (None, "b"),
        (Some("day"), "a"),
        (Some("night"), "b"),
        (Some("0"), "a"),
        (Some("1"), "b"),
        (Some("2"), "c"),
    ] {
        assert_eq!(shown(&place, &path, wanted), [node], "{wanted:?}");
    }
    let first = place.write("first.glb", &three(None));
    assert_eq!(shown(&place, &first, None), ["a"]);
    // A name counts before a number.
    let scenes = json!([{ "name": "1", "nodes": [0] }, { "name": "x", "nodes": [1] }]);
    let numbers = place.write("numbers.glb", &file(&scenes, None));
    assert_eq!(shown(&place, &numbers, Some("1")), ["a"]);
}

#[test]
fn the_note_names_the_other_scenes_unless_one_was_chosen() {
    let place = BakeFixture::new();
    let path = place.write("town.glb", &three(Some(1)));
    let said = "3 scenes: day, night, 2; this is night; --scene chooses another";
    assert_eq!(bake(&place, &path, None).expect("baked").warnings, [said]);
    assert_eq!(bake(&place, &path, Some("night")).expect("baked").warnings, [] as [String; 0]);
    let alone = place.write("alone.glb", &file(&json!([{ "name": "day", "nodes": [0] }]), None));
    for wanted in [None, Some("day"), Some("0")] {
        let baked = bake(&place, &alone, wanted).expect("baked");
        assert_eq!(baked.warnings, [] as [String; 0], "{wanted:?}");
        assert_eq!(baked.reused, wanted.is_some(), "one scene is one bake");
    }
    // Long names, and many of them, leave room for what chooses.
    let long = "é".repeat(500);
    let many: Vec<Value> = (0..300).map(|_| json!({ "name": long, "nodes": [0] })).collect();
    let path = place.write("many.glb", &file(&json!(many), None));
    let baked = bake(&place, &path, None).expect("baked");
    let [note] = &baked.warnings[..] else { panic!("{:?}", baked.warnings) };
    assert!(note.starts_with("300 scenes: éééé"), "{note}");
    assert!(
        note.ends_with(
            "…, 1, 2, 3, 4, 5, 6, 7 and 292 more; this is éééééééééééééééééééé…; \
        --scene chooses another"
        ),
        "{note}"
    );
}

#[test]
fn the_cache_tells_scenes_apart() {
    let place = BakeFixture::new();
    let path = place.write("town.glb", &three(Some(1)));
    let first = [None, Some("day"), Some("night"), Some("2")].map(|wanted| {
        let baked = bake(&place, &path, wanted).expect("baked");
        assert!(!baked.reused, "{wanted:?}");
        (wanted, baked.manifest)
    });
    for (wanted, manifest) in first {
        let again = bake(&place, &path, wanted).expect("baked");
        assert!(again.reused && again.manifest == manifest, "{wanted:?}");
    }
    let by_number = bake(&place, &path, Some("0")).expect("baked");
    assert!(by_number.reused && by_number.manifest == first[1].1, "a number is the same scene");
    let manifests: std::collections::BTreeSet<_> = first.iter().map(|(_, hash)| hash).collect();
    assert_eq!(manifests.len(), 4, "the note is a part of the scene that was not asked for");
}

#[test]
fn a_scene_that_is_not_there_is_refused_with_those_that_are() {
    let place = BakeFixture::new();
    let path = place.write("town.glb", &three(Some(1)));
    for wanted in ["dusk", "3", "-1", "", "day ", "1e0"] {
        let message = bake(&place, &path, Some(wanted)).expect_err("refused");
        for part in ["town.glb", &format!("no scene '{wanted}'"), "of day, night, 2"] {
            assert!(message.contains(part), "{part}: {message}");
        }
    }
    let path = place.write("none.glb", &file(&json!([]), None));
    assert_eq!(shown(&place, &path, None), ["a", "b", "c"]);
    let message = bake(&place, &path, Some("0")).expect_err("refused");
    assert!(message.contains("no list of scenes; open it without --scene"), "{message}");
    let path = place.write("beyond.glb", &file(&json!([{ "nodes": [0] }]), Some(4)));
    let message = bake(&place, &path, None).expect_err("refused");
    assert!(message.contains("scene: scenes[4] is not there"), "{message}");
}
