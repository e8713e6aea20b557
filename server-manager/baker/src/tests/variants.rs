//! `KHR_materials_variants`: which material each part has in which variant.

use glam::Vec4;
use polyptych_scene::{AssetManifests, Edit, Scene, SceneEdits};
use serde_json::{Value, json};

use super::builder::{Builder, png};
use super::{BakeFixture, bake_builder};

/// Two quads of one material each, and mappings of both.
fn quads(names: &Value, first: &Value, second: &Value) -> Builder {
    let mut builder = Builder::quad();
    let plain = |red: f32| json!({ "pbrMetallicRoughness": { "baseColorFactor": [red, 0, 0, 1] } });
    builder.json["materials"] = json!([plain(0.1), plain(0.2), plain(0.3)]);
    builder.json["extensionsUsed"] = json!(["KHR_materials_variants"]);
    builder.json["extensions"] = json!({ "KHR_materials_variants": { "variants": names } });
    let quad = builder.json["meshes"][0]["primitives"][0].clone();
    let with = |material: Option<u32>, mappings: &Value| {
        let mut quad = quad.clone();
        if let Some(material) = material {
            quad["material"] = json!(material);
        }
        quad["extensions"] = json!({ "KHR_materials_variants": { "mappings": mappings } });
        quad
    };
    let parts = json!([with(Some(0), first), with(None, second), with(Some(0), &json!([]))]);
    builder.json["meshes"][0]["primitives"] = parts;
    builder
}

fn named() -> Value {
    json!([{ "name": "Day" }, { "name": "Night" }])
}

/// The red of each part, and `None` for glTF's default material, as a variant shows it.
fn reds(scene: &Scene, variant: Option<&str>) -> Vec<Option<f32>> {
    let mut edits = SceneEdits::default();
    edits.apply(Edit::SetVariant(variant.map(str::to_owned)));
    let (shown, _) = edits.apply_to(scene, &AssetManifests::new());
    let red = |material: u32| shown.materials[material as usize].base_color;
    let parts = shown.meshes[0].primitives.iter().map(|of| of.material.map(red));
    parts.map(|color| color.filter(|of| *of != Vec4::ONE).map(|of| of.x)).collect()
}

#[test]
fn parts_have_the_material_of_the_variant_or_their_own() {
    let first = json!([{ "material": 1, "variants": [0] }, { "material": 2, "variants": [1] }]);
    let second = json!([{ "material": 2, "variants": [1] }]);
    let (_place, baked, scene) = bake_builder(&quads(&named(), &first, &second));
    assert_eq!(baked.warnings, [] as [String; 0]);
    let names: Vec<&str> = scene.variants.iter().map(|of| of.name.as_str()).collect();
    assert_eq!(names, ["Day", "Night"]);
    assert_eq!(reds(&scene, None), [Some(0.1), None, Some(0.1)]);
    assert_eq!(reds(&scene, Some("Day")), [Some(0.2), None, Some(0.1)]);
    assert_eq!(reds(&scene, Some("Night")), [Some(0.3), Some(0.3), Some(0.1)]);
}

#[test]
fn names_that_are_empty_or_stand_twice_are_noted_and_have_their_number() {
    let names = json!([{ "name": "Day" }, {}, { "name": "Day" }, { "name": "Day" }]);
    let first = json!([{ "material": 1, "variants": [0, 1] }, { "material": 2, "variants": [2] }]);
    let (_place, baked, scene) = bake_builder(&quads(&names, &first, &json!([])));
    let list = "extensions.KHR_materials_variants.variants";
    assert_eq!(
        baked.warnings,
        [
            format!("{list}[1]: it has no name; it is chosen by its number"),
            format!(
                "{list}[2] and 1 more: it is named as an earlier one; it is chosen by its number"
            ),
        ]
    );
    assert_eq!(reds(&scene, Some("Day"))[0], Some(0.2));
    assert_eq!(reds(&scene, Some("1"))[0], Some(0.2));
    assert_eq!(reds(&scene, Some("2"))[0], Some(0.3));
}

#[test]
fn mappings_that_point_nowhere_are_refused_and_the_first_of_two_counts() {
    let bake = |first: Value| {
        let place = BakeFixture::new();
        let path = place.write("model.glb", &quads(&named(), &first, &json!([])).glb());
        let baked = place.bake(&path);
        baked.map(|baked| (place.scene(&baked), baked.warnings)).map_err(|error| error.to_string())
    };
    let mappings = "meshes[0].primitives[0].KHR_materials_variants.mappings";
    for (first, parts) in [
        (json!([{ "material": 1, "variants": [2] }]), ["variants[2] is not there", "has 2", "[0]"]),
        (
            json!([{ "material": 3, "variants": [0] }]),
            ["materials[3] is not there", "has 3", "[0]"],
        ),
    ] {
        let error = bake(first).map(|_| ()).expect_err("refused");
        assert!(error.contains(mappings), "{error}");
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
    let twice = json!([{ "material": 1, "variants": [0, 0] }, { "material": 2, "variants": [0] }]);
    let (scene, warnings) = bake(twice).expect("drawn");
    assert_eq!(warnings, [format!("{mappings}[0] and 1 more: variant 0 has a material already")]);
    assert_eq!(reds(&scene, Some("Day"))[0], Some(0.2));
    let error = bake(json!([{ "variants": [0] }])).map(|_| ()).expect_err("refused");
    assert!(error.contains("material"), "{error}");
}

#[test]
fn vertices_have_what_the_materials_of_all_variants_need() {
    let mut builder = quads(
        &named(),
        &json!([{ "material": 1, "variants": [0] }, { "material": 2, "variants": [1] }]),
        &json!([]),
    );
    let texture = |set: u32| json!({ "index": 0, "texCoord": set });
    builder.json["materials"][1] =
        json!({ "pbrMetallicRoughness": { "baseColorTexture": texture(3) } });
    builder.json["materials"][2] = json!({ "normalTexture": texture(0), "alphaMode": "BLEND",
        "emissiveFactor": [1, 1, 1], "emissiveTexture": texture(3) });
    for part in builder.json["meshes"][0]["primitives"].as_array_mut().expect("parts") {
        part["attributes"]["TEXCOORD_3"] = part["attributes"]["TEXCOORD_0"].clone();
    }
    builder.image(&png(2, 2, |x, y| [x as u8 * 255, y as u8 * 255, 0, 255]));
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(baked.warnings, [] as [String; 0]);
    let layouts: Vec<_> = scene.meshes[0].primitives.iter().map(|of| of.layout).collect();
    let sets = layouts.iter().map(|of| (of.uv0, of.uv1, of.tangent)).collect::<Vec<_>>();
    assert_eq!(sets, [(true, true, true), (false, false, false), (false, false, false)]);
    let material = |at: usize| {
        let (replaced, other) = scene.variants[at].materials[0];
        assert_eq!(scene.meshes[0].primitives[0].material, Some(replaced));
        &scene.materials[other as usize]
    };
    // One set of uv stands at one place, whichever variant reads it.
    let day = material(0).base_color_texture.expect("a texture");
    let night = material(1);
    assert_eq!(night.emissive_texture.expect("a texture").uv_set, day.uv_set);
    assert_ne!(night.normal_texture.expect("a texture").uv_set, day.uv_set);
}
