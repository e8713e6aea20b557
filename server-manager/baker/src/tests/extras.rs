//! Hidden nodes, and attributes out of `extras`.

use std::collections::BTreeMap;

use glam::DVec3;
use polyptych_scene::limits::{ATTRIBUTES_MAX, EXTRAS_BYTES_MAX};
use polyptych_scene::{Attribute, Bounds, CAMERA_KEY, NodeExtras, NodeId};
use serde_json::{Value, json};

use super::bake_builder;
use super::builder::Builder;

fn nodes(nodes: &Value) -> Builder {
    let mut builder = Builder::triangle();
    builder.json["nodes"] = nodes.clone();
    builder
}

#[test]
fn extras_of_nodes_are_their_attributes() {
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let mut builder = nodes(&json!([
        { "mesh": 0, "children": [1, 2, 3] },
        { "extras": { "load": 2.5, "is_open": true, "note": "a\nb", "list": [1, {"a": null}],
                      "none": null }, "extensions": hidden },
        { "extras": "by hand", "extensions": { "KHR_node_visibility": {} } },
        { "extras": null },
    ]));
    builder.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
    let (_place, baked, scene) = bake_builder(&builder);
    let text = |text: &str| Attribute::Text(text.to_owned());
    let attributes = |list: Vec<(&str, Attribute)>| -> BTreeMap<String, Attribute> {
        list.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    };
    let expected = attributes(vec![
        ("load", Attribute::Number(2.5)),
        ("is_open", Attribute::Bool(true)),
        ("note", text("a\nb")),
        ("list", text("[1,{\"a\":null}]")),
    ]);
    assert_eq!(
        scene.extras,
        [
            NodeExtras { node: 1, is_hidden: true, attributes: expected.clone() },
            NodeExtras {
                node: 2,
                is_hidden: false,
                attributes: attributes(vec![("extras", text("by hand"))]),
            },
        ]
    );
    assert_eq!(baked.warnings, [] as [String; 0]);
    let edits = scene.first_edits();
    let first = edits.node(NodeId(1)).expect("edited");
    assert_eq!((first.is_hidden, &first.attributes), (true, &expected));
    assert_eq!(edits.nodes().count(), 2);
}

#[test]
fn cameras_are_attributes_of_their_nodes() {
    let mut builder = nodes(&json!([
        { "mesh": 0, "camera": 0, "extras": { "camera": "mine", "lens": 35 } },
        { "camera": 1 },
        { "camera": 2 },
        { "camera": 3 },
    ]));
    builder.json["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let perspective = json!({ "yfov": std::f64::consts::FRAC_PI_4, "znear": 0.1 });
    builder.json["cameras"] = json!([
        { "name": "Front", "type": "perspective", "perspective": perspective },
        { "type": "orthographic", "orthographic": { "xmag": 3, "ymag": 2, "zfar": 9, "znear": 0 } },
        {},
    ]);
    let (_place, baked, scene) = bake_builder(&builder);
    let camera = |of: &NodeExtras| match of.attributes.get(CAMERA_KEY) {
        Some(Attribute::Text(text)) => (of.node, text.clone()),
        other => panic!("{other:?}"),
    };
    let told: Vec<_> = scene.extras.iter().map(camera).collect();
    let expected =
        [(0, "Front: perspective, 45.0° high"), (1, "orthographic, 4 units high"), (2, "camera")];
    assert_eq!(told, expected.map(|(node, text)| (node, text.to_owned())));
    assert_eq!(scene.extras[0].attributes["lens"], Attribute::Number(35.0));
    let [beyond, entry] = &baked.warnings[..] else { panic!("{:?}", baked.warnings) };
    assert!(beyond.contains("nodes[3].camera") && beyond.contains("cameras[3]"), "{beyond}");
    assert!(beyond.ends_with("the node has no camera"), "{beyond}");
    assert_eq!(entry, "nodes: 1 value of extras are beyond the limits of attributes");
}

#[test]
fn what_breaks_a_limit_is_counted_in_a_note() {
    let many: BTreeMap<String, u64> = (0..70).map(|at| (format!("key {at:02}"), at)).collect();
    let mut broken = json!(many);
    broken["a\nb"] = json!(1);
    broken["a long one"] = json!("x".repeat(1025));
    broken[""] = json!(true);
    let (_place, baked, scene) = bake_builder(&nodes(&json!([{ "mesh": 0, "extras": broken }])));
    assert_eq!(scene.extras[0].attributes.len(), ATTRIBUTES_MAX);
    assert_eq!(baked.warnings, ["nodes: 9 values of extras are beyond the limits of attributes"]);

    // Together they are more than can be; those that are hidden still are.
    let text = "y".repeat(1000);
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let mut list: Vec<Value> =
        (0..600).map(|at| json!({ "extras": { "at": at, "text": text } })).collect();
    list.push(json!({ "mesh": 0, "extensions": hidden }));
    let mut builder = nodes(&Value::Array(list));
    builder.json["scenes"][0]["nodes"] = json!((0..601).collect::<Vec<_>>());
    let (_place, baked, scene) = bake_builder(&builder);
    let edits = scene.first_edits();
    assert!(edits.bytes() <= EXTRAS_BYTES_MAX as u64 && edits.bytes() > 500_000);
    assert_eq!(scene.extras.last().map(|of| (of.node, of.is_hidden)), Some((600, true)));
    let kept = scene.extras.len() as u64 - 1;
    let note =
        format!("nodes: {} values of extras are beyond the limits of attributes", (600 - kept) * 2);
    assert_eq!(baked.warnings, [note]);
}

#[test]
fn overviews_leave_out_what_is_hidden_unless_all_is() {
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let mut builder = nodes(&json!([
        { "mesh": 0 },
        { "children": [2], "extensions": hidden },
        { "mesh": 0, "translation": [1000, 0, 0] },
    ]));
    builder.json["scenes"][0]["nodes"] = json!([0, 1]);
    let bounds = |builder: &Builder| bake_builder(builder).2.bounds;
    let up_to = |x: f64| Some(Bounds { min: DVec3::ZERO, max: DVec3::new(x, 1.0, 0.0) });
    assert_eq!(bounds(&builder), up_to(1.0));

    // A clip shows it after a second.
    let mut all_hidden = builder.clone();
    let times = [0.0f32, 1.0].map(f32::to_le_bytes).concat();
    let input = builder.accessor("SCALAR", 5126, 2, &times, None);
    let output = builder.accessor("SCALAR", 5121, 2, &[0, 1], None);
    let pointer = "/nodes/1/extensions/KHR_node_visibility/visible";
    let extension = json!({ "KHR_animation_pointer": { "pointer": pointer } });
    let channel = json!({ "sampler": 0, "target": { "path": "pointer", "extensions": extension } });
    let sampler = json!({ "input": input, "output": output, "interpolation": "STEP" });
    builder.json["animations"] = json!([{ "channels": [channel], "samplers": [sampler] }]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty() && scene.extras.is_empty(), "{:?}", baked.warnings);
    assert_eq!(scene.bounds, up_to(1001.0));

    all_hidden.json["nodes"][0]["extensions"] = hidden;
    assert_eq!(bounds(&all_hidden), up_to(1001.0));
}
