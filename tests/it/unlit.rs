//! Unlit colours are shown as their files say, on every kind of channel and at any exposure.

use polyptych_client::Camera;
use polyptych_wall::{Eye, StereoPacking};
use serde_json::json;

use crate::harness::local_wall::{LocalWall, shot, tiled};
use crate::harness::pictures::image_of;
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::reference::tone;

/// A triangle of one colour that covers the wall.
fn card(codes: [u8; 3], mode: &str) -> Gltf {
    let [r, g, b] = codes.map(tone::linear);
    Gltf::triangle().with(|gltf| {
        gltf.json["nodes"][0]["scale"] = json!([400.0, 400.0, 1.0]);
        gltf.json["nodes"][0]["translation"] = json!([-100.0, -100.0, -5.0]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        gltf.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
        gltf.json["materials"] = json!([{
            "alphaMode": mode,
            "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0] },
            "extensions": { "KHR_materials_unlit": {} },
        }]);
    })
}

#[test]
fn unlit_colours_keep_their_codes_on_plain_warped_and_stereo_channels_at_any_exposure() {
    let mut wall = tiled([4, 1], [256, 48]);
    wall.channels[1].adjustment.eye = Eye::Right;
    wall.channels[2].adjustment.packing = StereoPacking::Anaglyph;
    wall.channels[3].adjustment.pin[1].x = -1.5;
    let place = TestDir::new();
    let local = LocalWall::start(&wall, &[&place.path(".")]);
    let client = local.client();
    for (codes, mode) in [([128; 3], "OPAQUE"), ([128; 3], "BLEND"), ([255, 0, 7], "BLEND")] {
        let name = format!("{mode}-{}.glb", codes[0]);
        let path = place.write(&name, card(codes, mode).glb());
        client.open_scene(path.display().to_string()).unwrap_or_else(|e| panic!("{name}: {e}"));
        for exposure in [1.0, 0.01, 30.0] {
            client.set_exposure(exposure).unwrap_or_else(|error| panic!("{error}"));
            let capture = shot(&client, Camera::IDENTITY);
            assert_eq!(capture.channels.len(), 4);
            for (index, channel) in capture.channels.iter().enumerate() {
                let image = image_of(channel);
                // Beside its moved corner the warped channel shows nothing.
                let width = image.width() - if index == 3 { 3 } else { 0 };
                let mut seen = image.enumerate_pixels().filter(|(x, ..)| *x < width);
                if let Some((x, y, pixel)) = seen.find(|(.., pixel)| pixel.0[..3] != codes) {
                    panic!("{name}, channel {index} at {exposure}: {pixel:?} at {x}, {y}");
                }
            }
        }
    }
}
