//! Levels of detail that a file brings (`MSFT_lod`): the finest is drawn, and nothing twice.

use serde_json::{Value, json};

use super::bake_builder;
use super::builder::Builder;

/// A node with two coarser ones, which name of an extension says.
fn levels(name: &str, scenes: &Value) -> Builder {
    let mut builder = Builder::triangle();
    builder.json["extensionsUsed"] = json!([name]);
    builder.json["extensionsRequired"] = json!([name]);
    builder.json["nodes"] = json!([
        { "name": "fine", "mesh": 0, "extensions": { name: { "ids": [1, 2] } } },
        { "name": "coarse", "mesh": 0 },
        { "name": "coarsest", "mesh": 0, "children": [3] },
        { "name": "part", "mesh": 0 },
        { "name": "other", "mesh": 0 },
    ]);
    builder.json["scenes"] = scenes.clone();
    builder.json.as_object_mut().expect("an object").remove("scene");
    builder
}

#[test]
fn coarser_levels_of_a_node_are_not_drawn_beside_it() {
    for name in ["MSFT_lod", "EXT_lod"] {
        for (scenes, notes) in [(json!([{ "nodes": [0, 4] }]), 0), (json!([]), 1)] {
            let (_place, baked, scene) = bake_builder(&levels(name, &scenes));
            let shown: Vec<&str> = scene.nodes.iter().map(|node| node.name.as_str()).collect();
            assert_eq!(shown, ["fine", "other"], "{name}, {scenes}");
            assert_eq!((baked.triangles, baked.warnings.len()), (2, notes), "{:?}", baked.warnings);
        }
    }
}

#[test]
fn a_level_that_is_a_child_too_is_drawn_as_one() {
    let mut builder = levels("MSFT_lod", &json!([{ "nodes": [0, 2, 4] }]));
    builder.json["nodes"][0]["extensions"]["MSFT_lod"]["ids"] = json!([3, 99]);
    let (_place, _, scene) = bake_builder(&builder);
    let shown: Vec<&str> = scene.nodes.iter().map(|node| node.name.as_str()).collect();
    assert_eq!(shown, ["fine", "coarsest", "part", "other"]);
}
