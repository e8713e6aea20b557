//! Automatic exposure: what all displays together show becomes middle grey, on all alike.

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ChannelState};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::wait;

/// The middle of the triangle, on both displays.
const VIEW: Camera = Camera { position: DVec3::new(0.3, 0.3, 0.5), ..Camera::IDENTITY };

/// A black triangle that glows with so much light.
fn glowing(strength: f64) -> Vec<u8> {
    let gltf = Gltf::triangle().with(|gltf| {
        gltf.json["extensionsUsed"] = json!(["KHR_materials_emissive_strength"]);
        gltf.json["materials"] = json!([{
            "doubleSided": true,
            "emissiveFactor": [1.0, 1.0, 1.0],
            "pbrMetallicRoughness": { "baseColorFactor": [0.0, 0.0, 0.0, 1.0] },
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": strength } },
        }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    });
    gltf.glb()
}

fn wall() -> LocalWall {
    let place = TestDir::new();
    place.write("dim.glb", glowing(0.02));
    let scene = place.write("bright.glb", glowing(20_000.0));
    let folder = scene.parent().expect("a folder").to_owned();
    LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT)
}

/// Waits for the exposure that shows this light as middle grey, to a quarter of a stop; returns
/// the picture.
fn await_exposure_of(client: &Client, light: f64) -> RgbaImage {
    let due = (0.18 / light).log2();
    let mut picture = None;
    wait::until("the exposure", || {
        // A client may look at any time, and does not disturb.
        picture = Some(screen_of(&shot(client, VIEW)));
        let shown = client.presentation().expect("a presentation");
        assert!(shown.is_exposure_automatic);
        ((f64::from(shown.exposure).log2() - due).abs() < 0.25).then_some(())
    });
    // It stands still there, and a frame is of one exposure.
    let exposure = client.presentation().expect("a presentation").exposure;
    let picture = screen_of(&shot(client, VIEW));
    let (width, height) = picture.dimensions();
    let [left, right] = [width / 2 - 2, width / 2 + 1].map(|x| picture.get_pixel(x, height / 2).0);
    assert_eq!(left, right, "one light on both displays, at {exposure}");
    // The neutral tone mapper takes 0.04 off.
    assert!((90..=120).contains(&left[1]), "middle grey is 105: {left:?}");
    picture
}

#[test]
fn what_all_displays_show_becomes_middle_grey_and_goes_on_so() {
    let mut local = wall();
    let client = local.client();
    client.open_scene("bright.glb").expect("opened");
    client.set_exposure(1.0).expect("set");
    let white = screen_of(&shot(&client, VIEW));
    let said = local.run(&["exposure", "auto"]).succeeded();
    assert!(said.contains("automatic"), "{said}");
    let grey = await_exposure_of(&client, 20_000.0);
    assert_ne!(grey, white);
    let said = local.run(&["exposure"]).succeeded();
    assert!(said.contains("automatic, now -16."), "{said}");

    // Without a server the others go on; it comes back to the same light.
    let server = local.wall().channels[0].server.clone();
    local.servers.remove(&server).expect("a server").kill();
    local.await_lost(&client, &server);
    client.open_scene("dim.glb").expect("opened");
    local.start_server(&server);
    await_states(&client, &[ChannelState::Live]);
    let grey = await_exposure_of(&client, 0.02);

    // A manager that is started again goes on with it.
    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    assert!(client.presentation().expect("a presentation").is_exposure_automatic);
    let again = await_exposure_of(&client, 0.02);
    assert_eq!(again.dimensions(), grey.dimensions());

    // A number ends it.
    local.run(&["exposure", "2"]).succeeded();
    let shown = client.presentation().expect("a presentation");
    assert_eq!((shown.is_exposure_automatic, shown.exposure), (false, 4.0));
    let wrong = local.run(&["exposure", "automatic"]);
    assert_eq!(wrong.code(), 2, "neither a number nor auto");
}
