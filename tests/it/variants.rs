//! Variants of a scene's file on walls of processes: chosen while the wall runs, the same on all
//! displays, and kept over restarts.

use image::{Rgba, RgbaImage};
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DVec2, DVec3, Vec4};
use polyptych_client::{Camera, ChannelState, Material, Pacing, Transaction};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, patient, screen_of, small};
use crate::harness::pictures::{IDENTICAL, SEAMS, check};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

/// Near enough that the triangle crosses the middle of the wall.
const VIEW: Camera = Camera { position: DVec3::new(0.3, 0.3, 0.7), ..Camera::IDENTITY };

/// A triangle that is green, and in its variants red, blue or as it is.
fn scene() -> Vec<u8> {
    let plain = |color: [f32; 4]| {
        json!({ "pbrMetallicRoughness": { "baseColorFactor": color },
            "extensions": { "KHR_materials_unlit": {} } })
    };
    let gltf = Gltf::triangle().with(|gltf| {
        gltf.json["extensionsUsed"] = json!(["KHR_materials_variants", "KHR_materials_unlit"]);
        gltf.json["extensions"] = json!({ "KHR_materials_variants": {
            "variants": [{ "name": "Red" }, { "name": "Blue" }, { "name": "Plain" }] } });
        gltf.json["materials"] = json!([
            plain([0.0, 1.0, 0.0, 1.0]),
            plain([1.0, 0.0, 0.0, 1.0]),
            plain([0.0, 0.0, 1.0, 1.0]),
        ]);
        let part = &mut gltf.json["meshes"][0]["primitives"][0];
        part["material"] = json!(0);
        part["extensions"] = json!({ "KHR_materials_variants": { "mappings": [
            { "material": 1, "variants": [0] }, { "material": 2, "variants": [1] } ] } });
    });
    gltf.glb()
}

fn wall(columns: u32) -> LocalWall {
    let place = TestDir::new();
    let file = place.write("scenes/chair.glb", scene());
    place.write("scenes/plain.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &patient(small(columns, 1)), &[&folder], ANY_PORT);
    let client = local.client();
    let opened = client.open_scene("chair.glb").expect("opened");
    assert_eq!(opened.notes, [] as [String; 0]);
    client.set_camera(VIEW).expect("set");
    local
}

#[track_caller]
fn picture(client: &Client) -> RgbaImage {
    let capture = client.capture().expect("captured");
    assert_eq!(capture.missing, [], "channels that sent no picture");
    screen_of(&capture)
}

/// The number of pixels that are mostly red, green and blue, the sky left out.
fn counts(picture: &RgbaImage) -> [usize; 3] {
    let mut counts = [0; 3];
    for Rgba([r, g, b, _]) in picture.pixels() {
        let pure = [(*r, *g, *b), (*g, *r, *b), (*b, *r, *g)];
        if let Some(at) =
            pure.iter().position(|(most, one, other)| *most > 200 && *one < 60 && *other < 60)
        {
            counts[at] += 1;
        }
    }
    counts
}

#[test]
fn a_variant_shows_on_all_displays_and_outlives_servers_managers_and_saves() {
    let mut local = wall(2);
    let client = local.client();
    let own = picture(&client);
    let pixels = counts(&own)[1];
    assert!(pixels > 1000, "{pixels} pixels are green");
    assert_eq!(
        local.run(&["variant"]).succeeded(),
        "0 Red\n1 Blue\n2 Plain\nnone is shown: parts have their own materials"
    );
    local.run(&["variant", "Red"]).succeeded();
    let red = picture(&client);
    assert_eq!(counts(&red), [pixels, 0, 0]);
    local.run(&["variant", "1"]).succeeded();
    let blue = picture(&client);
    assert_eq!(counts(&blue), [0, 0, pixels]);
    let single = wall(1);
    single.run(&["variant", "Blue"]).succeeded();
    check("one display", &blue, &picture(&single.client()), &SEAMS);
    local.run(&["variant", "Plain"]).succeeded();
    check("a variant without mappings", &picture(&client), &own, &IDENTICAL);
    local.run(&["variant", "none"]).succeeded();
    check("none", &picture(&client), &own, &IDENTICAL);
    local.run(&["variant", "Green"]).failed(&["Green", "0 (Red), 1 (Blue), 2 (Plain)"]);
    check("refused", &picture(&client), &own, &IDENTICAL);

    local.run(&["variant", "Blue"]).succeeded();
    let listed = local.run(&["variant", "list", "--json"]).json();
    assert_eq!(listed[1], json!({ "number": 1, "name": "Blue", "shown": true }));
    client.save_scene("sold").expect("saved");

    // A server that comes later shows it, and so does a manager.
    let name = local.wall().channels[1].server.clone();
    local.servers.remove(&name).expect("a server").kill();
    local.await_lost(&client, &name);
    client.set_variant(Some("Red")).expect("chosen");
    local.start_server(&name);
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check("joined", &picture(&client), &red, &IDENTICAL);
    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("scenes");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check("restarted", &picture(&client), &red, &IDENTICAL);
    assert_eq!(client.variants().expect("listed").chosen, Some(0));
    client.open_scene("saved:sold").expect("opened");
    client.set_camera(VIEW).expect("set");
    check("saved", &picture(&client), &blue, &IDENTICAL);
    client.open_scene("plain.glb").expect("opened");
    assert_eq!(local.run(&["variant"]).succeeded(), "the open scene has no variants");
    local.run(&["variant", "Blue"]).failed(&["the scene has no variants"]);
    client.close_scene().expect("closed");
    local.run(&["variant"]).failed(&["no scene is open"]);
}

#[test]
fn a_material_that_was_edited_stays_in_all_variants() {
    let local = wall(1);
    let client = local.client();
    let pixels = counts(&picture(&client))[1];
    client.set_variant(Some("Red")).expect("chosen");
    let set = |material: u32, color: Vec4| {
        let mut transaction = Transaction::default();
        let material =
            (material, Material { base_color: color, unlit: true, ..Material::default() });
        transaction.set_material(material.0, material.1);
        client.commit(transaction).expect("edited");
    };
    // The red material, which only the variant shows; and then the triangle's own.
    set(1, Vec4::new(0.0, 1.0, 0.0, 1.0));
    assert_eq!(counts(&picture(&client)), [0, pixels, 0], "an edit shows through the variant");
    let hit = client.pick("front", DVec2::new(240.0, 136.0));
    let own = hit.ok().flatten().and_then(|hit| hit.material).expect("the triangle is hit");
    set(own, Vec4::new(0.0, 0.0, 1.0, 1.0));
    assert_eq!(counts(&picture(&client)), [0, 0, pixels]);
    client.set_variant(None).expect("chosen");
    assert_eq!(counts(&picture(&client)), [0, 0, pixels], "the edit stays without a variant");
}

#[test]
fn no_frame_mixes_two_variants_while_the_wall_runs() {
    let local = wall(2);
    let client = local.client();
    let pixels = counts(&picture(&client))[1];
    client.start_rendering(Pacing::Free).expect("runs");
    let other = local.client();
    let name = std::thread::Builder::new().name("chooser".into());
    let chooser = name.spawn(move || {
        for _ in 0..20 {
            for name in [Some("Red"), Some("Blue"), None] {
                other.set_variant(name).expect("chosen");
            }
        }
    });
    let chooser = chooser.expect("a thread");
    let mut seen = [0; 3];
    while !chooser.is_finished() {
        let counts = counts(&picture(&client));
        let at = counts.iter().position(|count| *count == pixels);
        assert_eq!(counts.iter().sum::<usize>(), pixels, "{counts:?}");
        seen[at.unwrap_or_else(|| panic!("two variants in one frame: {counts:?}"))] += 1;
    }
    chooser.join().expect("chosen");
    assert!(seen.iter().filter(|count| **count > 0).count() >= 2, "{seen:?}");
}
