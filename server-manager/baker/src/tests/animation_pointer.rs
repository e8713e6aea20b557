//! Animations of what JSON pointers name: values against formulas, and pointers that are wrong.

use std::sync::Arc;

use polyptych_scene::{
    AssetManifests, ClipTime, LightKind, Material, MaterialProperty, Moment, Motion, PlacedNodes,
    PropertyKind, Scene, SceneEdits,
};
use serde_json::{Value, json};

use super::bake_builder;
use super::builder::{Builder, png};

/// Channels of one clip, each of a pointer.
#[derive(Default)]
struct Clip {
    channels: Vec<Value>,
    samplers: Vec<Value>,
}

impl Clip {
    /// A property that goes from one value to another in 2 s, evenly or in one step.
    fn add(&mut self, builder: &mut Builder, pointer: &str, kind: &str, keys: [&[f32]; 2]) {
        let bytes: Vec<u8> = [0.0f32, 2.0].iter().flat_map(|time| time.to_le_bytes()).collect();
        let input = builder.accessor("SCALAR", 5126, 2, &bytes, None);
        let values: Vec<u8> = keys.concat().iter().flat_map(|value| value.to_le_bytes()).collect();
        let output = builder.accessor(kind, 5126, 2, &values, None);
        self.push(pointer, json!({ "input": input, "output": output }));
    }

    fn push(&mut self, pointer: &str, sampler: Value) {
        let extension = json!({ "KHR_animation_pointer": { "pointer": pointer } });
        let target = json!({ "path": "pointer", "extensions": extension });
        self.channels.push(json!({ "sampler": self.samplers.len(), "target": target }));
        self.samplers.push(sampler);
    }

    fn finish(self, builder: &mut Builder) {
        builder.json["extensionsUsed"] = json!(["KHR_animation_pointer"]);
        builder.json["animations"] =
            json!([{ "channels": self.channels, "samplers": self.samplers }]);
    }
}

/// A quad with a picture on it that hangs from a node with a spot.
fn scene() -> Builder {
    let mut builder = Builder::quad();
    builder.image(&png(2, 2, |x, y| [x as u8 * 255, y as u8 * 255, 0, 255]));
    let texture = json!({ "index": 0, "extensions": {
        "KHR_texture_transform": { "offset": [0.5, 0.0] } } });
    builder.json["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorTexture": texture, "metallicFactor": 0.0 },
        "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 0.0 } },
    }, {}]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point" }, { "type": "spot", "intensity": 5.0, "spot": {} } ] } });
    builder.json["nodes"] = json!([
        { "mesh": 0 },
        { "children": [0], "extensions": {
            "KHR_lights_punctual": { "light": 1 }, "KHR_node_visibility": { "visible": false } } },
    ]);
    builder.json["scenes"] = json!([{ "nodes": [1] }]);
    builder
}

fn moment(scene: &Scene, clips: &[ClipTime]) -> Moment {
    let (base, edits) = (Arc::new(scene.clone()), scene.first_edits());
    let (placed, ids) = edits.apply_to(&base, &AssetManifests::new());
    let placed = PlacedNodes::new(&placed.nodes, ids, SceneEdits::default());
    Motion::new(&base, &placed, &edits).expect("it moves").at(clips)
}

fn material(scene: &Scene, moment: &Moment) -> Material {
    let [changed] = &moment.materials[..] else { panic!("{:?}", moment.materials) };
    let mut material = scene.materials[changed.material as usize].clone();
    changed.apply_to(&mut material);
    material
}

#[test]
fn what_pointers_name_is_at_twenty_times_as_formulas_have_it() {
    let (mut builder, mut clip) = (scene(), Clip::default());
    let material_of = |path: &str| format!("/materials/0/{path}");
    let light = "/extensions/KHR_lights_punctual/lights/1";
    for (pointer, kind, from, to) in [
        (
            material_of("pbrMetallicRoughness/metallicFactor"),
            "SCALAR",
            &[0.0f32][..],
            &[1.0f32][..],
        ),
        (material_of("emissiveFactor"), "VEC3", &[0.0; 3], &[1.0, 0.5, 0.0]),
        (
            material_of(
                "pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/scale",
            ),
            "VEC2",
            &[1.0, 1.0],
            &[3.0, 5.0],
        ),
        (
            material_of("extensions/KHR_materials_clearcoat/clearcoatFactor"),
            "SCALAR",
            &[0.0],
            &[0.5],
        ),
        (format!("{light}/intensity"), "SCALAR", &[5.0], &[25.0]),
        (format!("{light}/spot/outerConeAngle"), "SCALAR", &[0.2], &[0.6]),
        ("/nodes/1/translation".into(), "VEC3", &[0.0; 3], &[0.0, 4.0, 0.0]),
    ] {
        clip.add(&mut builder, &pointer, kind, [from, to]);
    }
    let on = builder.accessor("SCALAR", 5121, 2, &[1, 0], None);
    let input = clip.samplers[0]["input"].clone();
    clip.push(
        "/nodes/1/extensions/KHR_node_visibility/visible",
        json!({ "input": input, "output": on, "interpolation": "STEP" }),
    );
    clip.finish(&mut builder);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(baked.warnings, [] as [String; 0]);
    assert_eq!(scene.animations.clips[0].channels.len(), 8);
    for step in 0..20 {
        let time_s = f64::from(step) * 0.11;
        let t = (time_s / 2.0).min(1.0);
        let moment = moment(&scene, &[ClipTime { clip: 0, time_s, weight: 1.0 }]);
        let near = |got: f32, wanted: f64| {
            assert!((f64::from(got) - wanted).abs() < 1e-5, "{got} for {wanted} at {time_s}");
        };
        let material = material(&scene, &moment);
        near(material.metallic, t);
        near(material.emissive.y, 0.5 * t);
        let corner = material.base_color_texture.expect("a texture").uv_transform;
        let corner = corner.transform_point2(glam::Vec2::ONE);
        near(corner.x, 0.5 + 1.0 + 2.0 * t);
        near(corner.y, 1.0 + 4.0 * t);
        near(material.extensions.and_then(|of| of.clearcoat).expect("kept").factor, 0.5 * t);
        let [(0, lamp)] = &moment.lights[..] else { panic!("{:?}", moment.lights) };
        near(lamp.intensity, 5.0 + 20.0 * t);
        let LightKind::Spot { outer_rad, .. } = lamp.kind else { panic!("a spot") };
        near(outer_rad, 0.2 + 0.4 * t);
        near(moment.places[1].2.translation.y as f32, 4.0 * t);
        assert_eq!(moment.hidden, if t < 1.0 { vec![] } else { vec![0, 1] });
    }
    // Without the clip all is as in the file: hidden, though it is placed.
    assert_eq!(moment(&scene, &[]).hidden, [0, 1]);
}

#[test]
fn what_no_pointer_can_change_is_noted_by_name_and_the_rest_is_played() {
    let (mut builder, mut clip) = (scene(), Clip::default());
    for pointer in [
        "/materials/0/pbrMetallicRoughness/roughnessFactor",
        "/cameras/0/perspective/yfov",
        "materials/0",
        "/materials/9/alphaCutoff",
        "/materials/0/alphaCutoff",
        "/nodes/99/scale",
        "/materials/0/extensions/KHR_materials_sheen/sheenRoughnessFactor",
        "/extensions/KHR_lights_punctual/lights/1/range",
        // Of a material and a light that nothing shown has.
        "/materials/1/pbrMetallicRoughness/roughnessFactor",
        "/extensions/KHR_lights_punctual/lights/0/intensity",
    ] {
        clip.add(&mut builder, pointer, "SCALAR", [&[0.0], &[1.0]]);
    }
    let evenly = clip.samplers[0].clone();
    clip.push("/nodes/1/extensions/KHR_node_visibility/visible", evenly.clone());
    clip.push("/materials/0/emissiveFactor", evenly);
    clip.channels.push(json!({ "sampler": 0, "target": { "path": "pointer" } }));
    clip.finish(&mut builder);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(scene.animations.clips[0].channels.len(), 2, "the roughness and the range");
    assert_eq!(moment(&scene, &[]).hidden, [0, 1], "what no clip shows stays hidden");
    for (channel, part) in [
        (1, "/cameras/0/perspective/yfov"),
        (2, "materials/0' begins without a slash"),
        (3, "materials[9] is not there"),
        (4, "no such property"),
        (5, "nodes[99] is not there"),
        (6, "no such property"),
        (10, "STEP would be right"),
        (11, "VEC3 of float"),
        (12, "names no pointer"),
    ] {
        let place = format!("animations[0].channels[{channel}]");
        let said = baked.warnings.iter().any(|note| note.contains(part));
        assert!(said, "{place}: {part}: {:?}", baked.warnings);
    }
}

#[test]
fn a_property_changes_those_copies_of_its_material_that_have_it() {
    let (mut builder, mut clip) = (scene(), Clip::default());
    // Points without normals are unlit, and the first to use the material.
    let primitives = builder.json["meshes"][0]["primitives"].as_array_mut().expect("a list");
    let positions = primitives[0]["attributes"]["POSITION"].clone();
    let points = json!({ "attributes": { "POSITION": positions }, "mode": 0, "material": 0 });
    primitives.insert(0, points);
    let of = |path: &str| format!("/materials/0/pbrMetallicRoughness/{path}");
    clip.add(&mut builder, &of("roughnessFactor"), "SCALAR", [&[0.0], &[1.0]]);
    clip.add(&mut builder, &of("baseColorFactor"), "VEC4", [&[0.0; 4], &[1.0; 4]]);
    clip.finish(&mut builder);
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(!baked.warnings.iter().any(|note| note.contains("animations")), "{:?}", baked.warnings);
    assert_eq!(scene.animations.clips[0].channels.len(), 2);
    let changed = scene.animations.properties.iter().map(|of| {
        let lit = of.targets.iter().filter(|at| !scene.materials[**at as usize].unlit);
        (of.kind, of.targets.len(), lit.count())
    });
    let changed: Vec<(PropertyKind, usize, usize)> = changed.collect();
    let wanted = [(MaterialProperty::BaseColor, 2, 1), (MaterialProperty::Roughness, 1, 1)];
    let wanted = wanted.map(|(of, targets, lit)| (PropertyKind::Material(of), targets, lit));
    assert_eq!(changed, wanted);
    // Where none has it, it is a fault still.
    let primitives = builder.json["meshes"][0]["primitives"].as_array_mut().expect("a list");
    primitives.truncate(1);
    let (_place, baked, _) = bake_builder(&builder);
    assert!(baked.warnings.iter().any(|note| note.contains("no such property")));
}

#[test]
fn emission_whose_picture_is_missing_stays_dark_in_clips() {
    let (mut builder, mut clip) = (scene(), Clip::default());
    builder.json["images"].as_array_mut().expect("a list").push(json!({ "uri": "gone.png" }));
    builder.json["textures"].as_array_mut().expect("a list").push(json!({ "source": 1 }));
    builder.json["materials"][0]["emissiveTexture"] = json!({ "index": 1 });
    builder.json["materials"][0]["emissiveFactor"] = json!([1, 1, 1]);
    let of = |path: &str| format!("/materials/0/{path}");
    clip.add(&mut builder, &of("emissiveFactor"), "VEC3", [&[0.0; 3], &[1.0; 3]]);
    let metallic = of("pbrMetallicRoughness/metallicFactor");
    clip.add(&mut builder, &metallic, "SCALAR", [&[0.0], &[1.0]]);
    clip.finish(&mut builder);
    let (_place, baked, scene) = bake_builder(&builder);
    let [note] = &baked.warnings[..] else { panic!("{:?}", baked.warnings) };
    assert!(note.contains("gone.png") && note.contains("placeholder"), "{note}");
    let played = [ClipTime { clip: 0, time_s: 1.0, weight: 1.0 }];
    for clips in [&played[..], &played[..0]] {
        let moment = moment(&scene, clips);
        let material = material(&scene, &moment);
        assert_eq!(material.emissive, glam::Vec3::ZERO);
        let metallic = if clips.is_empty() { 0.0 } else { 0.5 };
        assert!((material.metallic - metallic).abs() < 1e-5, "the rest is changed");
    }
}

#[test]
fn factors_of_films_brushed_and_translucent_surfaces_move_from_nothing() {
    let (mut builder, mut clip) = (scene(), Clip::default());
    builder.json["materials"][0]["extensions"] = json!({
        "KHR_materials_anisotropy": {}, "KHR_materials_iridescence": {},
        "KHR_materials_diffuse_transmission": {} });
    let of = |path: &str| format!("/materials/0/extensions/KHR_materials_{path}");
    for (pointer, kind, to) in [
        ("anisotropy/anisotropyStrength", "SCALAR", &[0.5f32][..]),
        ("anisotropy/anisotropyRotation", "SCALAR", &[9.0]),
        ("iridescence/iridescenceFactor", "SCALAR", &[3.0]),
        ("iridescence/iridescenceIor", "SCALAR", &[0.5]),
        ("iridescence/iridescenceThicknessMinimum", "SCALAR", &[-10.0]),
        ("iridescence/iridescenceThicknessMaximum", "SCALAR", &[700.0]),
        ("diffuse_transmission/diffuseTransmissionFactor", "SCALAR", &[0.25]),
        ("diffuse_transmission/diffuseTransmissionColorFactor", "VEC3", &[0.5, 2.0, -1.0]),
    ] {
        clip.add(&mut builder, &of(pointer), kind, [to, to]);
    }
    clip.finish(&mut builder);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(baked.warnings, [] as [String; 0]);
    let moment = moment(&scene, &[ClipTime { clip: 0, time_s: 1.0, weight: 1.0 }]);
    let made = material(&scene, &moment).extensions.expect("kept");
    let grain = made.anisotropy.expect("kept");
    assert_eq!((grain.strength, grain.rotation_rad), (0.5, 9.0));
    let film = made.iridescence.expect("kept");
    assert_eq!((film.factor, film.ior), (1.0, 1.0), "in its range");
    assert_eq!((film.thickness_min_nm, film.thickness_max_nm), (0.0, 700.0));
    let through = made.diffuse_transmission.expect("kept");
    assert_eq!((through.factor, through.color.to_array()), (0.25, [0.5, 1.0, 0.0]));
}
