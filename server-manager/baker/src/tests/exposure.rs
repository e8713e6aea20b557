//! Lights in real units are exposed for; those of artists are left as they are.

use serde_json::{Value, json};

use super::bake_builder;
use super::builder::Builder;

/// The exposure of a ground of 20 m by 20 m, 4 m below lights of these kinds.
fn exposure(lights: &[Value]) -> Option<f32> {
    exposure_with(lights, &json!({}))
}

fn exposure_with(lights: &[Value], material: &Value) -> Option<f32> {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([material]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.json["nodes"][0]["scale"] = json!([20, 20, 1]);
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    for i in 0..lights.len() {
        let nodes = builder.json["nodes"].as_array_mut().expect("a list");
        let light = json!({ "KHR_lights_punctual": { "light": i } });
        nodes.push(json!({ "translation": [10, 10, 4], "extensions": light }));
        builder.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(json!(i + 1));
    }
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(scene.exposure.is_some(), !baked.warnings.is_empty(), "{:?}", baked.warnings);
    if let Some(exposure) = scene.exposure {
        let note = format!("lit in real units: exposure set to {exposure}; --exposure changes it");
        assert_eq!(baked.warnings, [note]);
    }
    scene.exposure
}

fn light(kind: &str, intensity: f32) -> Value {
    json!({ "type": kind, "intensity": intensity })
}

#[test]
fn artists_lights_keep_exposure_1() {
    assert_eq!(exposure(&[]), None);
    for intensity in [0.0, 0.1, 1.0, 3.0, 10.0] {
        assert_eq!(exposure(&[light("directional", intensity)]), None);
        assert_eq!(exposure(&vec![light("directional", intensity); 4]), None);
        assert_eq!(exposure(&[light("point", intensity * 10.0)]), None);
        assert_eq!(exposure(&[light("spot", intensity * 10.0)]), None);
    }
    for strength in [1.0, 4.0, 16.0] {
        let glow = json!({ "emissiveFactor": [1, 1, 1], "extensions":
            { "KHR_materials_emissive_strength": { "emissiveStrength": strength } } });
        assert_eq!(exposure_with(&[], &glow), None, "{strength}");
    }
}

#[test]
fn suns_in_lux_bring_mid_grey_to_the_middle() {
    for lux in [1_000.0, 10_000.0, 100_000.0] {
        let exposure = f64::from(exposure(&[light("directional", lux)]).expect("real units"));
        // Of 18 % of the light, π parts a steradian, 18 % of display white.
        let grey = 0.18 * f64::from(lux) / std::f64::consts::PI * exposure;
        assert!((grey - 0.18).abs() < 0.01, "{lux} lux: {grey}");
    }
    let two = exposure(&vec![light("directional", 5_000.0); 2]);
    assert_eq!(two, exposure(&[light("directional", 10_000.0)]));
}

#[test]
fn lamps_in_candela_count_at_the_distance_of_what_they_light() {
    for kind in ["point", "spot"] {
        let exposure = f64::from(exposure(&[light(kind, 100_000.0)]).expect("real units"));
        // Beneath it fall 6250 lux, in the corners 460: somewhere between comes to the middle.
        let lux = std::f64::consts::PI / exposure;
        assert!((460.0..6250.0).contains(&lux), "{kind}: {lux} lux");
    }
    // A narrow one lights a little of the ground, which is what one looks at.
    let mut narrow = light("spot", 100_000.0);
    narrow["spot"] = json!({ "outerConeAngle": 0.2 });
    let lux = std::f64::consts::PI / f64::from(exposure(&[narrow]).expect("real units"));
    assert!((4000.0..6500.0).contains(&lux), "{lux} lux");
    // Far too weak to be seen there, whatever its number.
    let mut near = light("point", 1000.0);
    near["range"] = json!(0.5);
    assert_eq!(exposure(&[near]), None);
}

#[test]
fn surfaces_that_glow_in_candela_come_to_white() {
    let glow = json!({ "emissiveFactor": [1, 1, 1], "extensions":
        { "KHR_materials_emissive_strength": { "emissiveStrength": 5000.0 } } });
    let exposure = f64::from(exposure_with(&[], &glow).expect("real units"));
    assert!((5000.0 * exposure - 1.0).abs() < 0.05, "{exposure}");
    let unlit = json!({ "extensions": { "KHR_materials_unlit": {} } });
    assert_eq!(exposure_with(&[light("directional", 1e5)], &unlit), None);
}

#[test]
fn hidden_lights_set_no_exposure_and_take_no_maps_of_shadows() {
    let mut builder = Builder::quad();
    let mut lights = vec![light("directional", 3.0), light("directional", 1e5)];
    // Twice as many as there are maps for.
    lights.resize(22, light("point", 1e6));
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    let of = |light: usize| json!({ "KHR_lights_punctual": { "light": light } });
    let nodes = builder.json["nodes"].as_array_mut().expect("a list");
    nodes.push(json!({ "extensions": of(0) }));
    // What hangs from a node is hidden with it.
    let below: Vec<usize> = (3..24).collect();
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    nodes.push(json!({ "children": below, "extensions": hidden }));
    nodes.extend((1..22).map(|at| json!({ "translation": [0, 0, 4], "extensions": of(at) })));
    builder.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert_eq!(scene.exposure, None);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);

    builder.json["nodes"][2]["extensions"] = json!({});
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(scene.exposure.is_some() && baked.warnings.len() == 2, "{:?}", baked.warnings);
}
