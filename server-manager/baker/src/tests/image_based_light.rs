//! Light from all around that files bring along (`EXT_lights_image_based`), as it is read.

use polyptych_scene::EnvironmentMap;
use serde_json::{Value, json};

use super::bake_builder;
use super::builder::{Builder, png};
use crate::image_based_light::NAME;

/// A quad whose scene names this light, and six faces of one colour each: 100 and a share of alpha,
/// red by face.
fn lit(light: &Value) -> Builder {
    let mut builder = Builder::quad();
    for face in 0..6 {
        builder.image(&png(8, 8, |_, _| [40 * face as u8, 100, 0, 51]));
    }
    builder.json["extensionsRequired"] = json!([NAME]);
    builder.json["extensionsUsed"] = json!([NAME]);
    builder.json["extensions"] = json!({ NAME: { "lights": [{ "specularImages": [] }, light] } });
    builder.json["scenes"][0]["extensions"] = json!({ NAME: { "light": 1 } });
    builder
}

fn light() -> Value {
    let mut coefficients = [[0.0; 3]; 9];
    coefficients[0] = [3.0, 0.0, 0.0];
    json!({
        "intensity": 0.5,
        "irradianceCoefficients": coefficients,
        "specularImageSize": 8,
        "specularImages": [[0, 1, 2, 3, 4, 5]],
    })
}

/// The middle of a face of the largest level.
fn middle(map: &EnvironmentMap, face: usize) -> [f32; 3] {
    let side = map.side as usize;
    map.radiance().nth(face * side * side + side / 2 * side + side / 2).expect("a texel")
}

#[test]
fn a_light_of_the_scene_becomes_its_surroundings() {
    let (place, baked, scene) = bake_builder(&lit(&light()));
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let blob = scene.surroundings.expect("surroundings");
    assert!(scene.blobs().any(|of| of == blob), "they are delivered with the scene");
    assert!(polyptych_scene::SceneFeatures::from_scene(&scene).environment);
    let bytes = place.store.blobs().read(blob).expect("read").expect("there");
    let map = EnvironmentMap::decode(&bytes).expect("a map");
    let linear = |code: f32| ((code / 255.0 + 0.055) / 1.055).powf(2.4);
    for face in 0..6 {
        // Alpha is a fifth, and half of the light is asked for.
        let red = if face == 0 { 0.0 } else { linear(40.0 * face as f32) * 2.5 };
        let [r, g, b] = middle(&map, face);
        assert!((r - red).abs() < 1e-3 * red.max(1.0), "face {face}: {r}, not {red}");
        assert!((g - linear(100.0) * 2.5).abs() < 1e-3 && b == 0.0, "face {face}: {g}, {b}");
    }
    // Half of 3 Y₀₀ over π.
    let expected = 1.5 * 0.282_094_8 / std::f32::consts::PI;
    assert!((map.diffuse[0][0] - expected).abs() < 1e-6, "{:?}", map.diffuse[0]);
    assert!(map.diffuse[1..].iter().flatten().all(|of| of.abs() < 1e-6));
}

#[test]
fn whole_floats_name_lights_and_images_too() {
    let mut builder = lit(&light());
    let (_place, _, expected) = bake_builder(&builder);
    builder.json["scenes"][0]["extensions"][NAME]["light"] = json!(1.0);
    let images = &mut builder.json["extensions"][NAME]["lights"][1]["specularImages"];
    *images = json!([[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert!(scene.surroundings.is_some() && scene.surroundings == expected.surroundings);
}

#[test]
fn a_file_whose_scene_names_no_light_has_none() {
    let mut builder = lit(&light());
    builder.json["scenes"][0].as_object_mut().expect("a scene").remove("extensions");
    let (_place, _, scene) = bake_builder(&builder);
    assert_eq!(scene.surroundings, None);
}

#[test]
fn what_cannot_be_read_is_told_and_left_out() {
    let with = |key: &str, value: Value| {
        let mut light = light();
        light[key] = value;
        lit(&light)
    };
    let without_images = {
        let mut light = light();
        light.as_object_mut().expect("a light").remove("specularImages");
        lit(&light)
    };
    let of_scene = |value: Value| {
        let mut builder = lit(&light());
        builder.json["scenes"][0]["extensions"][NAME] = value;
        builder
    };
    let mut oblong = lit(&light());
    oblong.image(&png(8, 4, |_, _| [9; 4]));
    oblong.json["extensions"][NAME]["lights"][1]["specularImages"] = json!([[0, 1, 2, 3, 4, 6]]);
    let mut words = lit(&light());
    let view = words.view(b"no picture", None);
    words.json["images"][3]["bufferView"] = json!(view);
    for (builder, part) in [
        (with("intensity", json!(-1)), "its intensity is -1.0; 0 to 1000000 would be right"),
        (with("intensity", json!(1e300)), "is 1e300; 0 to 1000000 would be right"),
        (
            with("irradianceCoefficients", json!(vec![[1e39, 0.0, 0.0]; 9])),
            "at most 1000000 would be",
        ),
        (with("rotation", json!([0, 0, 0, 0])), "a quaternion would be right"),
        (with("rotation", json!([1, 2])), "cannot be read"),
        (with("irradianceCoefficients", json!([[1, 2, 3]])), "cannot be read"),
        (with("specularImages", json!([])), "it has no specularImages"),
        (with("specularImages", json!([[0, 1, 2]])), "cannot be read"),
        (with("specularImages", json!([[0, 1, 2, 3, 4, 99]])), "images[99] is not there; the file"),
        (without_images, "missing field `specularImages`"),
        (oblong, "images[6] has 8 × 4 pixels; six squares of one size"),
        (words, "images[3]: it is no image"),
        (of_scene(json!({ "light": 7 })), "lights[7] is not there; the file has 2"),
        (of_scene(json!({ "light": 0 })), "it has no specularImages"),
        (of_scene(json!("bright")), "cannot be read"),
    ] {
        let (_place, baked, scene) = bake_builder(&builder);
        assert_eq!(scene.surroundings, None, "{part}");
        let [note] = &baked.warnings[..] else { panic!("{part}: {:?}", baked.warnings) };
        assert!(note.starts_with(NAME) && note.contains(part), "{part}: {note}");
    }
}
