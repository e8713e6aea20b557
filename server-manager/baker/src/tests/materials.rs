//! Extensions of materials, as they are read.

use glam::{Vec3, Vec4};
use polyptych_scene::{Clearcoat, Scene, Specular, TextureFormat};
use serde_json::{Value, json};

use super::builder::{Builder, png};
use super::{BakeFixture, bake_builder};

/// A quad with one material.
pub(super) fn quad(material: &Value) -> Builder {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([material]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder
}

pub(super) fn refusal(builder: &Builder) -> String {
    let place = BakeFixture::new();
    let path = place.write("scene.glb", &builder.glb());
    place.bake(&path).expect_err("refused").to_string()
}

fn clearcoat(scene: &Scene) -> Option<Clearcoat> {
    scene.materials[0].extensions.as_ref()?.clearcoat.clone()
}

fn specular(scene: &Scene) -> Option<Specular> {
    scene.materials[0].extensions.as_ref()?.specular.clone()
}

#[test]
fn materials_keep_the_numbers_of_the_file_whichever_is_used_first() {
    let red = |red: f32| json!({ "pbrMetallicRoughness": { "baseColorFactor": [red, 0, 0, 1] } });
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([red(0.125), red(0.25), red(0.5), red(0.75)]);
    let quad = builder.json["meshes"][0]["primitives"][0].clone();
    let mut lines = quad.clone();
    lines["mode"] = json!(1);
    lines["attributes"].as_object_mut().expect("attributes").remove("NORMAL");
    let mut parts = [quad.clone(), quad.clone(), lines, quad];
    for (part, material) in parts.iter_mut().zip([3, 1, 1, 0]) {
        part["material"] = json!(material);
    }
    builder.json["meshes"][0]["primitives"] = json!(parts);
    let (_place, _, scene) = bake_builder(&builder);
    let numbers: Vec<_> = scene.meshes[0].primitives.iter().map(|of| of.material).collect();
    assert_eq!(numbers, [Some(3), Some(1), Some(4), Some(0)]);
    let looks: Vec<_> = scene.materials.iter().map(|of| (of.base_color.x, of.unlit)).collect();
    let unused = (1.0f32, false);
    let lit = [(0.125, false), (0.25, false), unused, (0.75, false)];
    assert_eq!(looks, [&lit[..], &[(0.25, true)]].concat(), "the unlit copy is behind all");
}

#[test]
fn index_of_refraction_and_specular_are_read_and_brought_to_their_range() {
    for (extensions, wanted) in [
        (json!({}), None),
        (json!({ "KHR_materials_ior": { "ior": 1.5 } }), None),
        (json!({ "KHR_materials_specular": { "specularColorFactor": [1, 1, 1] } }), None),
        (json!({ "KHR_materials_ior": { "ior": 1.33 } }), Some((1.33, 1.0, Vec3::ONE))),
        (json!({ "KHR_materials_ior": { "ior": 0 } }), Some((0.0, 1.0, Vec3::ONE))),
        (json!({ "KHR_materials_ior": { "ior": -7 } }), Some((1.0, 1.0, Vec3::ONE))),
        (
            json!({ "KHR_materials_specular": {
                "specularFactor": 1e300, "specularColorFactor": [0.5, -1, 1e39] } }),
            Some((1.5, 1.0, Vec3::new(0.5, 0.0, 65504.0))),
        ),
    ] {
        let name = extensions.to_string();
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let got = specular(&scene).map(|of| (of.ior, of.factor, of.color));
        assert_eq!(got, wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn numbers_of_a_wrong_kind_are_refused_with_their_place() {
    for (name, value, part) in [
        ("KHR_materials_ior", json!({ "ior": "glass" }), "KHR_materials_ior.ior"),
        (
            "KHR_materials_specular",
            json!({ "specularColorFactor": [1, 1] }),
            "KHR_materials_specular.specularColorFactor",
        ),
        ("KHR_materials_pbrSpecularGlossiness", json!(3), "KHR_materials_pbrSpecularGlossiness"),
        (
            "KHR_materials_sheen",
            json!({ "sheenColorFactor": [1, 1, "red"] }),
            "KHR_materials_sheen.sheenColorFactor[2]",
        ),
        (
            "KHR_materials_clearcoat",
            json!({ "clearcoatFactor": 1, "clearcoatNormalTexture": { "scale": 1 } }),
            "KHR_materials_clearcoat.clearcoatNormalTexture",
        ),
    ] {
        let message = refusal(&quad(&json!({ "extensions": { name: value } })));
        assert!(message.contains(&format!("materials[0].extensions.{part}")), "{message}");
    }
    let missing = json!({ "KHR_materials_specular": { "specularTexture": { "index": 9 } } });
    let message = refusal(&quad(&json!({ "extensions": missing })));
    assert!(message.contains("materials[0]"), "{message}");
}

#[test]
fn textures_of_extensions_are_baked_and_one_image_of_two_uses_once() {
    let mut builder = quad(&json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
        "extensions": { "KHR_materials_specular": {
            "specularTexture": { "index": 0 }, "specularColorTexture": { "index": 0 } } },
    }));
    builder.image(&png(4, 4, |x, y| [x as u8, y as u8, 9, 200]));
    let (_place, _, scene) = bake_builder(&builder);
    let specular = specular(&scene).expect("there");
    assert_eq!(specular.texture, specular.color_texture);
    assert_eq!(scene.textures.len(), 2, "the base colour has no use of alpha");
    assert!(scene.textures.iter().all(|of| of.format == TextureFormat::Rgba8Srgb));
}

#[test]
fn a_missing_image_of_an_extension_changes_nothing() {
    let mut builder = quad(&json!({ "extensions": { "KHR_materials_specular": {
        "specularFactor": 0.5, "specularTexture": { "index": 0 } } } }));
    builder.image(b"");
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings[0].contains("a placeholder is shown"), "{:?}", baked.warnings);
    let bytes = place.store.blobs().read(scene.textures[0].blob).expect("read").expect("there");
    assert!(bytes.iter().all(|byte| *byte == 255), "white and whole");
}

#[test]
fn specular_glossiness_becomes_a_dielectric_of_the_same_reflection() {
    let (_place, baked, scene) = bake_builder(&quad(&json!({
        "pbrMetallicRoughness": { "baseColorFactor": [1, 0, 0, 1], "metallicFactor": 1 },
        "extensions": { "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.25, 0.5, 0.75, 0.5], "specularFactor": [0.9, 0.5, 0.1],
            "glossinessFactor": 0.75 } },
    })));
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let material = &scene.materials[0];
    assert_eq!(material.base_color, Vec4::new(0.25, 0.5, 0.75, 0.5));
    assert_eq!((material.metallic, material.roughness), (0.0, 0.25));
    let specular = specular(&scene).expect("there");
    assert_eq!((specular.ior, specular.factor), (0.0, 1.0));
    assert_eq!(specular.color, Vec3::new(0.9, 0.5, 0.1));
}

#[test]
fn textures_of_specular_glossiness_may_differ_in_size_and_in_transform() {
    let moved = json!({ "KHR_texture_transform": { "scale": [2, 2] } });
    let mut builder = quad(&json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 } },
        "extensions": { "KHR_materials_pbrSpecularGlossiness": {
            "glossinessFactor": 0.5, "diffuseTexture": { "index": 0 },
            "specularGlossinessTexture": { "index": 1, "extensions": moved } } },
    }));
    builder.image(&png(2, 2, |_, _| [10, 20, 30, 255]));
    builder.image(&png(8, 4, |x, _| [200, 100, 50, if x < 4 { 255 } else { 51 }]));
    let (place, _, scene) = bake_builder(&builder);
    let material = &scene.materials[0];
    let blob_of = |at: u32| scene.textures[at as usize].blob;
    let pixels = |at: u32| place.store.blobs().read(blob_of(at)).expect("read").expect("there");
    let color = material.base_color_texture.expect("a colour");
    assert_eq!(pixels(color.texture)[..4], [10, 20, 30, 255]);
    let rough = material.metallic_roughness_texture.expect("a roughness");
    let tint = specular(&scene).expect("there").color_texture.expect("a tint");
    assert_eq!(rough.uv_transform, tint.uv_transform);
    assert_ne!(rough.uv_transform, color.uv_transform);
    assert_eq!(scene.textures[rough.texture as usize].format, TextureFormat::Rgba8Linear);
    // 1 - 0.5 · 1 and 1 - 0.5 · 0.2.
    let rows = pixels(rough.texture);
    assert_eq!((rows[1], rows[2], rows[7 * 4 + 1]), (128, 0, 230));
    assert_eq!((material.roughness, material.metallic), (1.0, 0.0));
    assert_eq!(scene.textures.len(), 3, "the image that is not used is not baked");
}

#[test]
fn what_is_unlit_has_the_base_colour_alone() {
    let mut builder = quad(&json!({
        "extensions": { "KHR_materials_unlit": {}, "KHR_materials_ior": { "ior": 2 } } }));
    builder.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    let (_place, _, scene) = bake_builder(&builder);
    assert!(scene.materials[0].extensions.is_none());
}

#[test]
fn a_clear_coat_is_read_and_brought_to_its_range() {
    for (read, wanted) in [
        (json!({}), None),
        (json!({ "clearcoatFactor": 0, "clearcoatRoughnessFactor": 0.3 }), None),
        (json!({ "clearcoatFactor": -1 }), None),
        (json!({ "clearcoatFactor": 0.25 }), Some((0.25, 0.0))),
        (json!({ "clearcoatFactor": 1e300, "clearcoatRoughnessFactor": -7 }), Some((1.0, 0.0))),
    ] {
        let name = read.to_string();
        let extensions = json!({ "KHR_materials_clearcoat": read });
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let got = clearcoat(&scene).map(|of| (of.factor, of.roughness));
        assert_eq!(got, wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn a_normal_map_of_a_clear_coat_gets_tangents() {
    let mut builder = quad(&json!({ "extensions": { "KHR_materials_clearcoat": {
        "clearcoatFactor": 1, "clearcoatTexture": { "index": 0 },
        "clearcoatRoughnessTexture": { "index": 0 },
        "clearcoatNormalTexture": { "index": 1, "scale": 0.5, "extensions": {
            "KHR_texture_transform": { "offset": [0.5, 0] } } } } } }));
    builder.image(&png(4, 4, |_, _| [255, 128, 0, 255]));
    builder.image(&png(4, 4, |_, _| [128, 128, 255, 255]));
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let layout = scene.meshes[0].primitives[0].layout;
    assert!(layout.tangent && layout.uv0 && !layout.uv1);
    let coat = clearcoat(&scene).expect("a coat");
    assert_eq!((coat.normal_scale, coat.texture), (0.5, coat.roughness_texture));
    let normals = coat.normal_texture.expect("normals");
    assert_eq!(normals.uv_transform.translation.x, 0.5);
    assert!(scene.textures.iter().all(|of| of.format == TextureFormat::Rgba8Linear));
}

#[test]
fn a_sheen_is_read_and_brought_to_its_range() {
    for (read, wanted) in [
        (json!({}), None),
        (json!({ "sheenColorFactor": [0, 0, -1], "sheenRoughnessFactor": 1 }), None),
        (json!({ "sheenColorFactor": [0, 0.5, 0] }), Some((Vec3::Y * 0.5, 0.0))),
        (
            json!({ "sheenColorFactor": [7, 1, 0], "sheenRoughnessFactor": 1e39 }),
            Some((Vec3::new(1.0, 1.0, 0.0), 1.0)),
        ),
    ] {
        let name = read.to_string();
        let extensions = json!({ "KHR_materials_sheen": read });
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let sheen = scene.materials[0].extensions.as_ref().and_then(|of| of.sheen.clone());
        assert_eq!(sheen.map(|of| (of.color, of.roughness)), wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn textures_of_extensions_beyond_those_that_shaders_hold_are_left_out_with_a_note() {
    let texture = |index: u32| json!({ "index": index });
    let mut builder = quad(&json!({ "extensions": {
        "KHR_materials_specular": {
            "specularTexture": texture(0), "specularColorTexture": texture(1) },
        "KHR_materials_clearcoat": { "clearcoatFactor": 1, "clearcoatTexture": texture(2),
            "clearcoatRoughnessTexture": texture(3) },
        "KHR_materials_sheen": { "sheenColorFactor": [1, 1, 1],
            "sheenColorTexture": texture(4), "sheenRoughnessTexture": texture(5) } } }));
    for shade in 0..6 {
        builder.image(&png(2, 2, |_, _| [shade, 9, 9, 255]));
    }
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings[0].contains("more than 5"), "{:?}", baked.warnings);
    let extensions = scene.materials[0].extensions.as_ref().expect("there");
    assert_eq!(extensions.distinct_textures().len(), 5);
    assert!(extensions.sheen.as_ref().is_some_and(|of| of.roughness_texture.is_none()));
}

#[test]
fn transmission_and_volume_are_read_and_brought_to_their_range() {
    let volume = |json: Value| {
        json!({ "KHR_materials_transmission": { "transmissionFactor": 0.5 },
            "KHR_materials_dispersion": { "dispersion": 2 }, "KHR_materials_volume": json })
    };
    let thin = Some((0.5, None));
    let infinity = f32::INFINITY;
    for (extensions, wanted) in [
        (json!({ "KHR_materials_transmission": {} }), None),
        (json!({ "KHR_materials_volume": { "thicknessFactor": 1 } }), None),
        (json!({ "KHR_materials_transmission": { "transmissionFactor": -1 } }), None),
        (json!({ "KHR_materials_transmission": { "transmissionFactor": 0.5 } }), thin),
        (volume(json!({})), thin),
        (volume(json!({ "thicknessFactor": 3 })), Some((0.5, Some((3.0, infinity, Vec3::ONE))))),
        (
            volume(json!({ "thicknessFactor": 1e39, "attenuationDistance": 0.25,
                "attenuationColor": [0.5, -1, 9] })),
            Some((0.5, Some((65504.0, 0.25, Vec3::new(0.5, 0.0, 1.0))))),
        ),
        (
            volume(json!({ "thicknessFactor": 1, "attenuationDistance": 0 })),
            Some((0.5, Some((1.0, infinity, Vec3::ONE)))),
        ),
    ] {
        let name = extensions.to_string();
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let made = scene.materials[0].extensions.clone();
        let got = made.and_then(|of| {
            let volume = of.volume.map(|of| {
                assert_eq!(of.dispersion, 2.0);
                (of.thickness, of.attenuation_distance, of.attenuation_color)
            });
            of.transmission.map(|of| (of.factor, volume))
        });
        assert_eq!(got, wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn anisotropy_is_read_and_brought_to_its_range() {
    for (read, wanted) in [
        (json!({}), None),
        (json!({ "anisotropyStrength": 0, "anisotropyRotation": 1 }), None),
        (json!({ "anisotropyStrength": -1 }), None),
        (json!({ "anisotropyStrength": 0.25, "anisotropyRotation": -7 }), Some((0.25, -7.0))),
        (json!({ "anisotropyStrength": 7, "anisotropyRotation": 1e300 }), Some((1.0, 0.0))),
    ] {
        let name = read.to_string();
        let extensions = json!({ "KHR_materials_anisotropy": read });
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let made = scene.materials[0].extensions.as_ref().and_then(|of| of.anisotropy.clone());
        assert_eq!(made.map(|of| (of.strength, of.rotation_rad)), wanted, "{name}");
        let layout = scene.meshes[0].primitives[0].layout;
        assert_eq!(layout.tangent, wanted.is_some(), "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn an_anisotropic_part_without_tangents_and_coordinates_is_noted() {
    let mut builder =
        quad(&json!({ "extensions": { "KHR_materials_anisotropy": { "anisotropyStrength": 1 } } }));
    let attributes = &mut builder.json["meshes"][0]["primitives"][0]["attributes"];
    attributes.as_object_mut().expect("attributes").remove("TEXCOORD_0");
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings[0].contains("direction of its highlights"), "{:?}", baked.warnings);
    let layout = scene.meshes[0].primitives[0].layout;
    assert!(layout.tangent && !layout.uv0);
}

#[test]
fn iridescence_is_read_and_brought_to_its_range() {
    for (read, wanted) in [
        (json!({}), None),
        (json!({ "iridescenceFactor": 0, "iridescenceIor": 2 }), None),
        (json!({ "iridescenceFactor": -1 }), None),
        (json!({ "iridescenceFactor": 0.25 }), Some([0.25, 1.3, 100.0, 400.0])),
        (
            json!({ "iridescenceFactor": 7, "iridescenceIor": 0.5,
                "iridescenceThicknessMinimum": -3, "iridescenceThicknessMaximum": 1e300 }),
            Some([1.0, 1.0, 0.0, 65504.0]),
        ),
    ] {
        let name = read.to_string();
        let extensions = json!({ "KHR_materials_iridescence": read });
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let made = scene.materials[0].extensions.as_ref().and_then(|of| of.iridescence.clone());
        let got = made.map(|of| [of.factor, of.ior, of.thickness_min_nm, of.thickness_max_nm]);
        assert_eq!(got, wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn diffuse_transmission_is_read_and_brought_to_its_range() {
    for (read, wanted) in [
        (json!({}), None),
        (json!({ "diffuseTransmissionColorFactor": [1, 0, 0] }), None),
        (json!({ "diffuseTransmissionFactor": -1 }), None),
        (json!({ "diffuseTransmissionFactor": 0.25 }), Some((0.25, Vec3::ONE))),
        (
            json!({ "diffuseTransmissionFactor": 1e39,
                "diffuseTransmissionColorFactor": [0.5, -1, 7] }),
            Some((1.0, Vec3::new(0.5, 0.0, 1.0))),
        ),
    ] {
        let name = read.to_string();
        let extensions = json!({ "KHR_materials_diffuse_transmission": read,
            "KHR_materials_volume": { "thicknessFactor": 2 } });
        let (_place, baked, scene) = bake_builder(&quad(&json!({ "extensions": extensions })));
        let made = scene.materials[0].extensions.clone();
        let got = made.and_then(|of| {
            assert_eq!(of.volume.map(|of| of.thickness), Some(2.0), "{name}");
            of.diffuse_transmission.map(|of| (of.factor, of.color))
        });
        assert_eq!(got, wanted, "{name}");
        assert!(baked.warnings.is_empty(), "{name}: {:?}", baked.warnings);
    }
}

#[test]
fn a_mask_draws_the_same_share_of_each_mip_level() {
    for draws_discs in [true, false] {
        // Discs of radius 3 until 30 % of the texels are in one.
        let (mut is_in_disc, mut seed, mut count) = ([[false; 64]; 64], 1_u32, 0_u32);
        while count < 1229 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let [middle_x, middle_y] = [seed >> 26, (seed >> 20) & 63];
            for (y, row) in (0_u32..).zip(&mut is_in_disc) {
                for (x, is_in) in (0_u32..).zip(row) {
                    if x.abs_diff(middle_x).pow(2) + y.abs_diff(middle_y).pow(2) <= 9 {
                        count += u32::from(!*is_in);
                        *is_in = true;
                    }
                }
            }
        }
        let wanted = f64::from(if draws_discs { count } else { 4096 - count }) / 4096.0;
        let alpha = |x: u32, y: u32| {
            if is_in_disc[y as usize][x as usize] == draws_discs { 255 } else { 0 }
        };
        // With its factor, the alpha that is drawn is 0.5.
        let mut builder = quad(&json!({ "alphaMode": "MASK", "alphaCutoff": 0.25,
            "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.5],
                "baseColorTexture": { "index": 0 } } }));
        builder.image(&png(64, 64, |x, y| [90, 90, 90, alpha(x, y)]));
        let (place, _, scene) = bake_builder(&builder);
        assert_eq!(scene.textures[0].mip_count, 7);
        let bytes = place.store.blobs().read(scene.textures[0].blob).expect("read").expect("there");
        let mut rest = &bytes[..];
        for side in [64, 32, 16, 8, 4] {
            let (level, coarser) = rest.split_at(side * side * 4);
            let drawn = level.chunks(4).filter(|texel| texel[3] >= 128).count();
            let share = drawn as f64 / (side * side) as f64;
            assert!((share - wanted).abs() < 0.1, "{share} of {side} × {side}, not {wanted}");
            rest = coarser;
        }
    }
}
