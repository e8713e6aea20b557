//! Numbers of nodes: they become the f64 that the text says, or a message that names their key.

use glam::{DAffine3, DMat3, DVec3};

use super::builder::Builder;
use super::{BakeFixture, bake_builder};

/// The triangle as JSON text with this text as its only node's key.
fn with(key: &str, value: &str) -> Vec<u8> {
    let mut builder = Builder::triangle();
    builder.json["nodes"][0]["name"] = "house".into();
    let uri = "scene.bin";
    let text = String::from_utf8(builder.gltf(uri)).expect("text");
    let name = "\"name\":\"house\"";
    assert!(text.contains(name), "{text}");
    text.replace(name, &format!("{name},\"{key}\":{value}")).into_bytes()
}

/// Bakes it.
fn baked(key: &str, value: &str) -> Result<DAffine3, String> {
    let place = BakeFixture::new();
    place.write("scene.bin", &Builder::triangle().bin);
    let path = place.write("scene.gltf", &with(key, value));
    let baked = place.bake(&path).map_err(|error| error.to_string())?;
    Ok(place.scene(&baked).nodes[0].local)
}

#[test]
fn places_are_the_nearest_f64_of_the_text() {
    let near = baked("translation", "[6378137.123456, -0.1, 1e-7]").expect("baked");
    assert_eq!(near.translation, DVec3::new(6_378_137.123_456, -0.1, 1e-7));
    // What a quick reader of numbers gets wrong in the last bit; f32 would say 6378137 and 0.5.
    let hard = baked("translation", "[9007199254740993.0, 6378137.1234567891, 5e-324]");
    let hard = hard.expect("baked").translation;
    assert_eq!(hard.to_array(), [9_007_199_254_740_992.0, 6_378_137.123_456_789, 5e-324]);
    let scaled = baked("scale", "[0.1, -123456.789012, 1e-12]").expect("baked");
    let wanted = DMat3::from_diagonal(DVec3::new(0.1, -123_456.789_012, 1e-12));
    assert_eq!(scaled.matrix3, wanted);
}

#[test]
fn matrices_stay_as_they_are_given() {
    // Sheared and mirrored: no translation, rotation and scale could say it.
    let text = "[1,0.25,0,0, 0.5,-1,0.125,0, 0,0.3333333333333333,2,0, 6378137.123456,0,-1e7,1]";
    let local = baked("matrix", text).expect("baked");
    let columns = [1.0, 0.25, 0.0, 0.5, -1.0, 0.125, 0.0, 0.333_333_333_333_333_3, 2.0];
    assert_eq!(local.matrix3, DMat3::from_cols_array(&columns));
    assert_eq!(local.translation, DVec3::new(6_378_137.123_456, 0.0, -1e7));
    // Singular ones too: what has no volume may still have a face.
    let flat = baked("matrix", "[1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]").expect("baked");
    assert_eq!(flat.matrix3.determinant(), 0.0);
}

#[test]
fn parents_are_multiplied_in_f64() {
    let mut builder = Builder::triangle();
    builder.json["nodes"] = serde_json::json!([
        { "translation": [6378137.123456, 0.0, 0.0], "children": [1] },
        { "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, -6378137.0, 2, 0, 1], "mesh": 0 },
    ]);
    let (_place, _, scene) = bake_builder(&builder);
    let world = scene.world_from_nodes()[1];
    assert!((world.translation.x - 0.123456).abs() < 1e-9, "{}", world.translation.x);
    assert_eq!(world.matrix3.y_axis, DVec3::new(0.5, 1.0, 0.0));
}

#[test]
fn wrong_numbers_are_refused_with_node_and_key() {
    let check = |key: &str, value: &str, parts: &[&str]| {
        let message = baked(key, value).expect_err(value);
        assert!(message.contains("scene.gltf") && !message.contains('\n'), "{message}");
        for part in parts {
            assert!(message.contains(part), "'{part}' is not in: {message}");
        }
    };
    check("translation", "[1e400, 0, 0]", &["nodes[0]", "translation[0]", "out of range"]);
    check("scale", "[1, -1e999, 1]", &["nodes[0]", "scale[1]", "out of range"]);
    check("translation", "[0, NaN, 0]", &["nodes[0]", "translation[1]", "expected value"]);
    check("rotation", "[0, 0, 0, \"NaN\"]", &["nodes[0]", "rotation[3]", "NaN"]);
    check("rotation", "[0, 0, Infinity, 1]", &["nodes[0]", "rotation[2]"]);
    check("translation", "[0, 0]", &["nodes[0]", "translation has 2 numbers, 3 would be right"]);
    check("rotation", "[0, 0, 0, 1, 0]", &["nodes[0]", "rotation has more than 4 numbers"]);
    check("matrix", "[]", &["nodes[0]", "matrix has 0 numbers, 16 would be right"]);
    check("scale", "2.0", &["nodes[0]", "scale to be an array of 3 numbers"]);
    check("matrix", "{}", &["nodes[0]", "matrix to be an array of 16 numbers"]);
    check("translation", "[0, null, 0]", &["nodes[0]", "translation[1]"]);
    assert!(baked("translation", "null").is_ok(), "null is as good as nothing");
}
