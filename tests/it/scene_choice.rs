//! Scenes of one file on walls of processes: chosen by command and client, the same on all
//! displays, and kept over restarts of servers and manager.

use image::{Rgba, RgbaImage};
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ChannelState, SceneFile};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, patient, screen_of, small};
use crate::harness::pictures::{IDENTICAL, check, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// Near enough that the triangle crosses the middle of the wall.
const VIEW: Camera = Camera { position: DVec3::new(0.3, 0.3, 0.7), ..Camera::IDENTITY };

/// A file of which a scene is a red triangle, another a blue one, and the default one a green one.
fn scenes() -> Vec<u8> {
    let plain = |color: [f32; 4]| {
        json!({ "pbrMetallicRoughness": { "baseColorFactor": color },
            "extensions": { "KHR_materials_unlit": {} } })
    };
    let gltf = Gltf::triangle().with(|gltf| {
        let part = gltf.json["meshes"][0]["primitives"][0].clone();
        let mesh = |material: u32| {
            let mut part = part.clone();
            part["material"] = json!(material);
            json!({ "primitives": [part] })
        };
        gltf.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
        gltf.json["materials"] = json!([
            plain([1.0, 0.0, 0.0, 1.0]),
            plain([0.0, 0.0, 1.0, 1.0]),
            plain([0.0, 1.0, 0.0, 1.0]),
        ]);
        gltf.json["meshes"] = json!([mesh(0), mesh(1), mesh(2)]);
        gltf.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }, { "mesh": 2 }]);
        gltf.json["scenes"] = json!([{ "name": "Red", "nodes": [0] },
            { "name": "-Blue", "nodes": [1] }, { "nodes": [2] }]);
        gltf.json["scene"] = json!(2);
    });
    gltf.glb()
}

#[track_caller]
fn picture(client: &Client) -> RgbaImage {
    client.set_camera(VIEW).expect("set");
    let capture = client.capture().expect("captured");
    assert_eq!(capture.missing, [], "channels that sent no picture");
    screen_of(&capture)
}

/// The number of pixels that are mostly red, green and blue, the sky left out.
fn counts(picture: &RgbaImage) -> [usize; 3] {
    let mut counts = [0; 3];
    for Rgba([r, g, b, _]) in picture.pixels() {
        let pure = [(*r, *g, *b), (*g, *r, *b), (*b, *r, *g)];
        let is_pure = |of: &(u8, u8, u8)| of.0 > 200 && of.1 < 60 && of.2 < 60;
        if let Some(at) = pure.iter().position(is_pure) {
            counts[at] += 1;
        }
    }
    counts
}

/// Checks that the picture has this colour, of red, green and blue, and no other.
#[track_caller]
fn check_color(picture: &RgbaImage, color: usize) {
    let counts = counts(picture);
    assert!(counts[color] > 1000, "{counts:?}");
    assert_eq!(counts.iter().sum::<usize>(), counts[color], "{counts:?}");
}

#[test]
fn a_chosen_scene_shows_on_all_displays_and_outlives_servers_and_managers() {
    let place = TestDir::new();
    let file = place.write("scenes/lamps.glb", scenes());
    let folder = file.parent().expect("a folder").to_owned();
    let mut local = LocalWall::start_in(place, &patient(small(2, 1)), &[&folder], ANY_PORT);
    let client = local.client();
    let opened = local.run(&["open", "lamps.glb"]).succeeded();
    let note = "note: 3 scenes: Red, -Blue, 2; this is 2; --scene chooses another";
    assert!(opened.lines().any(|line| line == note), "{opened}");
    check_color(&picture(&client), 1);
    let opened = local.run(&["open", "lamps.glb", "--scene", "Red"]).succeeded();
    assert!(!opened.contains("note:"), "{opened}");
    check_color(&picture(&client), 0);
    local.run(&["open", "lamps.glb", "--scene", "Green"]).failed(&["'Green'", "Red, -Blue, 2"]);
    local.run(&["open", "saved:lamps", "--scene", "Red"]).failed(&["saved:lamps is one scene"]);
    check_color(&picture(&client), 0);
    // A name that looks like an option of the baker is a name.
    client.open_scene(SceneFile::from("lamps.glb").scene("-Blue")).expect("opened");
    let blue = picture(&client);
    check_color(&blue, 2);

    let name = local.wall().channels[1].server.clone();
    local.servers.remove(&name).expect("a server").kill();
    local.await_lost(&client, &name);
    local.start_server(&name);
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check("joined", &picture(&client), &blue, &IDENTICAL);
    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let mut local = LocalWall::manager(place, &wall, &[&folder], &address);
    local.servers = servers;
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check("restarted", &picture(&client), &blue, &IDENTICAL);
}

#[test]
fn a_simulation_and_a_bake_take_the_name_of_a_scene() {
    let place = TestDir::new();
    let file = place.write("lamps.glb", scenes());
    let bake = |scene: &str| place.run(["bake", "lamps.glb", "-o", "baked", "--scene", scene]);
    bake("Red").succeeded();
    bake("Dusk").failed(&["lamps.glb", "'Dusk'", "Red, -Blue, 2"]);
    for (scene, color) in [("0", 0), ("2", 1)] {
        let arguments = ["--frames", "1", "--scene", scene];
        let place = TestDir::new();
        let mut simulation = Simulation::start(place, &small(1, 1), &file, &arguments);
        simulation.process.finish(wait::LIMIT).succeeded();
        check_color(&read(&simulation.place.path("out/wall.png")), color);
    }
}
