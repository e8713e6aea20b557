//! Nodes that are moved while they are shown, a few of many: servers lay what was moved over the
//! scene as it was laid out, and the picture is that of a file that has the nodes there.

use std::collections::BTreeMap;

use image::RgbaImage;
use polyptych_client::glam::{DAffine3, DVec3};
use polyptych_client::{Camera, ChannelState, NodeId, NodeQuery, Transaction};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

const NODES: u32 = 60;
const FRAMES: u32 = 12;

/// Sees all of the rows.
const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.0, 6.0), ..Camera::IDENTITY };

/// A node's place: in rows, and away from there by a multiple of `moved`.
fn place(node: u32, moved: u32) -> DVec3 {
    let at = DVec3::new(f64::from(node % 10) - 4.5, f64::from(node / 10) - 2.5, 0.0) * 0.5;
    at + DVec3::new(0.1, 0.05, 0.02) * f64::from(moved)
}

/// The nodes that a frame moves: half of them hang from others.
fn movers(frame: u32) -> impl Iterator<Item = u32> {
    [7, 20, 41].into_iter().map(move |node| (node + frame * 13) % NODES)
}

/// Rows of triangles before each other, of which every fifth has one that hangs from it.
fn rows(moved: impl Fn(u32) -> u32) -> Gltf {
    Gltf::triangle().with(|gltf| {
        let paint = |red: f64| {
            json!({
                "doubleSided": true,
                "pbrMetallicRoughness": { "baseColorFactor": [red, 0.5, 0.2, 1.0] },
            })
        };
        gltf.json["materials"] = json!([paint(0.9), paint(0.1)]);
        let mesh = gltf.json["meshes"][0].clone();
        gltf.json["meshes"] = json!([mesh, mesh]);
        for (index, material) in [(0, 0), (1, 1)] {
            gltf.json["meshes"][index]["primitives"][0]["material"] = json!(material);
        }
        let node = |node: u32| {
            let at = place(node, moved(node));
            let mut described = json!({
                "name": node.to_string(),
                "mesh": node % 2,
                "translation": at.to_array(),
                "scale": [0.4, 0.4, 0.4],
            });
            if node.is_multiple_of(5) {
                described["children"] = json!([NODES + node / 5]);
            }
            described
        };
        let child = |_: u32| json!({ "mesh": 0, "translation": [0.2, 0.3, 0.4] });
        let nodes: Vec<_> = (0..NODES).map(node).chain((0..NODES / 5).map(child)).collect();
        gltf.json["nodes"] = json!(nodes);
        gltf.json["scenes"] = json!([{ "nodes": (0..NODES).collect::<Vec<_>>() }]);
    })
}

/// Number of times that a node is moved until the end of a frame.
fn times(node: u32, frames: u32) -> u32 {
    (0..frames).filter(|frame| movers(*frame).any(|moved| moved == node)).count() as u32
}

fn picture(local: &LocalWall) -> RgbaImage {
    screen_of(&shot(&local.client(), VIEW))
}

#[test]
fn moved_nodes_are_the_picture_of_a_file_that_has_them_there() {
    let folder = TestDir::new();
    folder.write("rows.glb", rows(|_| 0).glb());
    folder.write("half.glb", rows(|node| times(node, FRAMES / 2)).glb());
    let scenes = folder.write("moved.glb", rows(|node| times(node, FRAMES)).glb());
    let scenes = scenes.parent().expect("a folder").to_owned();
    let mut local = LocalWall::start_in(folder, &small(2, 1), &[&scenes], ANY_PORT);
    let client = local.client();
    let [before, half, expected] = ["rows.glb", "half.glb", "moved.glb"].map(|file| {
        client.open_scene(file).expect("opened");
        picture(&local)
    });
    assert!(color_count(&before) > 2, "there is something to see");
    assert!(before != half && half != expected && before != expected);
    client.open_scene("rows.glb").expect("opened");
    let nodes = || client.find_all_nodes(NodeQuery::default()).expect("found");
    let named = nodes().into_iter().filter_map(|node| Some((node.name.parse().ok()?, node.id)));
    let ids: BTreeMap<u32, NodeId> = named.collect();
    assert_eq!(ids.len() as u32, NODES);
    for frame in 0..FRAMES {
        let mut transaction = Transaction::default();
        for node in movers(frame) {
            let at = DAffine3::from_translation(place(node, times(node, frame + 1)));
            let local = at * DAffine3::from_scale(DVec3::splat(0.4));
            transaction.set_transform(ids[&node], local);
        }
        let edited = client.commit(transaction).expect("edited");
        assert!(edited.feedback.is_complete(), "{edited:?}");
        if frame + 1 == FRAMES / 2 {
            check("half way", &picture(&local), &half, &IDENTICAL);
            // Which a question sees in the index that it left behind for the next.
            nodes();
        }
    }
    check("moved", &picture(&local), &expected, &IDENTICAL);
    for node in nodes() {
        let Ok(number) = node.name.parse() else { continue };
        assert_eq!(node.local.translation, place(number, times(number, FRAMES)), "{}", node.id);
    }

    // A server that comes later has laid out all as it stands.
    let name = local.servers.keys().next().expect("a server").clone();
    local.servers.remove(&name).expect("a server").kill();
    local.await_lost(&client, &name);
    local.start_server(&name);
    await_states(&client, &[ChannelState::Live]);
    check("joined", &picture(&local), &expected, &IDENTICAL);
}
