//! Small files that expand to a lot: refused with the numbers, or given up once nobody wants them.

use std::time::{Duration, Instant};

use polyptych_client::{ChannelState, OpenStage};
use serde_json::json;

use crate::harness::local_wall::{LocalWall, await_states, shot, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, poses, town};
use crate::harness::wait;

/// Maximum time of the next scene from its request until it is live: a bake that exists, half a
/// second for the scene before it, and the time that a busy machine needs for a few pixels.
const NEXT_TIME_MAX: Duration = Duration::from_secs(2);

/// Maximum number of times that it is tried: the machine may be busy with something else.
const TRIES: usize = 4;

/// The triangle as a mesh of so many primitives, drawn by so many nodes.
fn multiplied(primitives: usize, nodes: usize) -> Vec<u8> {
    let change = |gltf: &mut Gltf| {
        let primitive = gltf.json["meshes"][0]["primitives"][0].clone();
        gltf.json["meshes"][0]["primitives"] = json!(vec![primitive; primitives]);
        gltf.json["nodes"] = json!(vec![json!({ "mesh": 0 }); nodes]);
        gltf.json["scenes"] = json!([{ "nodes": (0..nodes).collect::<Vec<_>>() }]);
    };
    Gltf::triangle().with(change).glb()
}

#[test]
fn a_bomb_of_nodes_and_primitives_is_refused_and_the_next_scene_is_shown() {
    let scenes = TestDir::new();
    let bomb = multiplied(1000, 100_000);
    assert!(bomb.len() < 4 << 20, "{} bytes", bomb.len());
    let folder = scenes.write("bomb.glb", bomb).parent().expect("a folder").to_owned();
    let wall = small(2, 1);
    let local = LocalWall::start(&wall, &[town().parent().expect("one"), &folder]);
    let parts = ["bomb.glb", "100000000 primitives", "2097152", "join primitives"];
    local.run(&["open", "bomb.glb"]).failed(&parts);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    assert_eq!(shot(&client, poses(&bounds)[4]).missing, []);
    let mib = client.status().expect("a status").channels[0].memory_bytes >> 20;
    assert!(mib < 2048, "a server holds {mib} MiB");
}

#[test]
fn a_heavy_scene_that_nobody_waits_for_any_more_holds_up_no_other() {
    let scenes = TestDir::new();
    // As many draws as can be.
    let folder =
        scenes.write("heavy.glb", multiplied(1000, 2000)).parent().expect("one").to_owned();
    let wall = small(1, 1);
    let local = LocalWall::start(&wall, &[town().parent().expect("one"), &folder]);
    let client = local.client();
    client.open_scene("town.glb").expect("baked, and shown once");
    let mut took = Vec::new();
    for _ in 0..TRIES {
        client.close_scene().expect("closed");
        let asked = local.client();
        let heavy = std::thread::Builder::new()
            .name("client".into())
            .spawn(move || asked.open_scene("heavy.glb").map(drop))
            .expect("a thread");
        wait::until("the heavy scene on its way to the servers", || {
            let status = client.status().expect("a status");
            let mut opening = status.opening.iter();
            opening.any(|it| it.progress.stage == OpenStage::Preparing).then_some(())
        });
        let begun = Instant::now();
        client.open_scene("town.glb").expect("opened");
        await_states(&client, &[ChannelState::Live, ChannelState::Ready]);
        took.push(begun.elapsed());
        let refused = heavy.join().expect("no panic").expect_err("it was replaced").to_string();
        assert!(refused.contains("another scene was opened"), "{refused}");
        if took.iter().any(|took| *took < NEXT_TIME_MAX) {
            return;
        }
    }
    panic!("the next scene took {took:?}");
}
