//! Light maps of materials (`MOZ_lightmap`), as they are read.

use glam::{Affine2, Vec2};
use polyptych_scene::{BakedLight, Scene, TextureFormat, Wrap};
use serde_json::{Value, json};

use super::bake_builder;
use super::builder::{Builder, png};
use super::materials::{quad, refusal};

/// A quad with two sets of coordinates and one material with this light map, and an image.
fn lit(light_map: &Value) -> Builder {
    let mut builder =
        quad(&json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "extensions": { "MOZ_lightmap": light_map } }));
    let second = builder.floats("VEC2", [[0.25, 0.75]; 4].as_flattened());
    attributes(&mut builder)["TEXCOORD_1"] = json!(second);
    builder.json["extensionsUsed"] = json!(["MOZ_lightmap", "KHR_texture_transform"]);
    builder.json["samplers"] = json!([{ "wrapS": 33071 }]);
    builder.image(&png(4, 4, |x, y| [x as u8 * 60, y as u8 * 60, 188, 255]));
    builder.json["textures"][0]["sampler"] = json!(0);
    builder
}

fn attributes(builder: &mut Builder) -> &mut Value {
    &mut builder.json["meshes"][0]["primitives"][0]["attributes"]
}

fn baked_light(scene: &Scene) -> Option<BakedLight> {
    scene.materials[0].extensions.as_ref()?.baked_light.clone()
}

#[test]
fn a_light_map_is_linear_and_lies_along_the_second_set_of_coordinates() {
    let (place, baked, scene) = bake_builder(&lit(&json!({ "index": 0 })));
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let light = baked_light(&scene).expect("there");
    assert_eq!(light.intensity, 1.0);
    let used = light.texture.expect("a texture");
    assert_eq!((used.uv_set, used.uv_transform), (1, Affine2::IDENTITY));
    let layout = scene.meshes[0].primitives[0].layout;
    assert!(layout.uv0 && layout.uv1);
    // One image, read as both is to be.
    let color = scene.materials[0].base_color_texture.expect("a colour");
    let of = |at: u32| &scene.textures[at as usize];
    assert_eq!(of(color.texture).format, TextureFormat::Rgba8Srgb);
    assert_eq!(of(used.texture).format, TextureFormat::Rgba8Linear);
    assert_eq!(of(used.texture).sampler.wrap_u, Wrap::Clamp);
    let pixels = |at: u32| place.store.blobs().read(of(at).blob).expect("read").expect("there");
    let (as_color, as_light) = (pixels(color.texture), pixels(used.texture));
    assert_eq!(as_color[..64], as_light[..64], "the image itself");
    assert_ne!(as_color[64..], as_light[64..], "coarser levels are means of light");
    assert!(as_light[64..].iter().zip([30u8, 30]).all(|(got, wanted)| *got == wanted), "linear");
    assert!(polyptych_scene::SceneFeatures::from_scene(&scene).baked_light);
}

#[test]
fn numbers_of_a_light_map_are_read_and_brought_to_their_range() {
    let moved = json!({ "KHR_texture_transform": { "offset": [0.5, 0.25], "texCoord": 0 } });
    let offset = Affine2::from_translation(Vec2::new(0.5, 0.25));
    for (read, wanted) in [
        (json!({ "index": 0, "texCoord": 0, "intensity": 2.5 }), Some((2.5, 0, Affine2::IDENTITY))),
        (json!({ "index": 0, "texCoord": 1 }), Some((1.0, 1, Affine2::IDENTITY))),
        (json!({ "index": 0, "extensions": moved }), Some((1.0, 0, offset))),
        (json!({ "index": 0, "intensity": 1e300 }), Some((65504.0, 1, Affine2::IDENTITY))),
        (json!({ "index": 0, "intensity": 0 }), None),
        (json!({ "index": 0, "intensity": -2 }), None),
    ] {
        let (_place, baked, scene) = bake_builder(&lit(&read));
        let got = baked_light(&scene).map(|of| {
            let used = of.texture.expect("a texture");
            (of.intensity, used.uv_set, used.uv_transform)
        });
        assert_eq!(got, wanted, "{read}");
        assert_eq!(scene.materials[0].extensions.is_some(), wanted.is_some(), "{read}");
        assert!(baked.warnings.is_empty(), "{read}: {:?}", baked.warnings);
    }
}

#[test]
fn a_wrong_light_map_is_refused_with_its_place() {
    for (read, part) in [
        (json!({ "intensity": 1 }), "materials[0].extensions.MOZ_lightmap: missing field `index`"),
        (json!({ "index": 0, "intensity": "x" }), "materials[0].extensions.MOZ_lightmap.intensity"),
        (json!({ "index": 0, "texCoord": -1 }), "materials[0].extensions.MOZ_lightmap.texCoord"),
        (json!(3), "materials[0].extensions.MOZ_lightmap"),
        (json!({ "index": 9 }), "materials[0]"),
    ] {
        let message = refusal(&lit(&read));
        assert!(message.contains(part), "{read}: {message}");
    }
}

#[test]
fn a_light_map_that_cannot_be_drawn_is_noted_and_gives_no_light() {
    // Its image is broken.
    let mut broken = lit(&json!({ "index": 1 }));
    broken.image(b"broken");
    // It is Radiance HDR beside glTF's own images.
    let mut hdr = lit(&json!({ "index": 1 }));
    let texture = json!({ "extensions": { "MOZ_texture_rgbe": { "source": 0 } } });
    hdr.json["textures"].as_array_mut().expect("a list").push(texture);
    // Displays show colours that are unlit as they are.
    let mut unlit = lit(&json!({ "index": 0 }));
    unlit.json["materials"][0]["extensions"]["KHR_materials_unlit"] = json!({});
    // Further textures than shaders hold.
    let mut sixth = lit(&json!({ "index": 5 }));
    let texture = |index: u32| json!({ "index": index });
    let extensions = &mut sixth.json["materials"][0]["extensions"];
    extensions["KHR_materials_specular"] =
        json!({ "specularTexture": texture(0), "specularColorTexture": texture(1) });
    extensions["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 1,
        "clearcoatTexture": texture(2), "clearcoatRoughnessTexture": texture(3),
        "clearcoatNormalTexture": texture(4) });
    for shade in 0..5 {
        sixth.image(&png(2, 2, |_, _| [shade, 9, 9, 255]));
    }
    for (builder, part) in [
        (broken, "images[1]: a placeholder is shown"),
        (hdr, "textures[1]: a placeholder is shown, since its image is Radiance HDR"),
        (unlit, "materials[0]: drawn without its MOZ_lightmap, since it is unlit"),
        (sixth, "more than 5"),
    ] {
        let (_place, baked, scene) = bake_builder(&builder);
        assert_eq!(baked.warnings.len(), 1, "{:?}", baked.warnings);
        assert!(baked.warnings[0].contains(part), "{part}: {:?}", baked.warnings);
        assert_eq!(baked_light(&scene), None, "{part}");
        let rest = &scene.materials[0].extensions;
        assert_eq!(rest.is_some(), part == "more than 5", "{rest:?}");
    }
}

#[test]
fn a_part_without_the_coordinates_of_its_light_map_is_noted() {
    let mut builder = lit(&json!({ "index": 0 }));
    attributes(&mut builder).as_object_mut().expect("attributes").remove("TEXCOORD_1");
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings[0].contains("TEXCOORD_1, which it has not"), "{:?}", baked.warnings);
    assert!(baked_light(&scene).is_some(), "with zeros, as other textures");
}
