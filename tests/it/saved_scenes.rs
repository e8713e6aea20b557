//! Scenes that are kept as they were edited, and sessions, also when the manager is killed.

use image::RgbaImage;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ChannelState, NodeQuery};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

const VIEW: Camera = Camera { position: DVec3::new(0.3, 0.3, 2.0), ..Camera::IDENTITY };

#[test]
fn a_saved_scene_is_what_it_was_after_a_kill() {
    let place = TestDir::new();
    let file = place.write("post.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let mut local = LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT);
    local.run(&["scene", "save", "early"]).failed(&["no scene is open"]);
    local.run(&["open", "post.glb"]).succeeded();
    local.run(&["node", "add", "name=crate", "mesh=box:0.4", "position=0.2,0.1,0"]).succeeded();
    local.run(&["node", "set", "0", "scale=0.5", "attribute.kind=sail"]).succeeded();
    local.run(&["scene", "save", "evening"]).succeeded();
    let (tree, picture) =
        (local.run(&["scene", "tree"]).succeeded(), screen_of(&shot(&local.client(), VIEW)));
    local.run(&["node", "remove", "crate"]).succeeded();
    local.run(&["scene", "save", "bare"]).succeeded();
    local.run(&["exposure", "1"]).succeeded();
    local.run(&["view", "save", "quay"]).succeeded();
    local.run(&["session", "save", "show"]).succeeded();
    let (session, lit) =
        (local.run(&["scene", "tree"]).succeeded(), screen_of(&shot(&local.client(), VIEW)));
    local.run(&["session", "save", "show"]).succeeded();
    local.run(&["exposure", "0"]).succeeded();
    local.run(&["view", "remove", "quay"]).succeeded();
    local.run(&["scene", "save", "a\tb"]).failed(&["without control characters"]);

    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
    let list = "bare: post, 1 edited node\nevening: post, 2 edited nodes";
    assert_eq!(local.run(&["scene", "list"]).succeeded(), list);
    let json = local.run(&["scene", "list", "--json"]).json();
    assert_eq!((&json[1]["name"], &json[1]["edited_nodes"]), (&"evening".into(), &2.into()));
    local.run(&["open", "saved:evening", "--keep-camera"]).succeeded();
    assert_eq!(local.run(&["scene", "tree"]).succeeded(), tree);
    check("opened", &screen_of(&shot(&local.client(), VIEW)), &picture, &IDENTICAL);
    check_session(&local, &session, &lit);
    local.run(&["open", "saved:evening", "--keep-camera"]).succeeded();
    // It goes on as before: what is made gets a number that was never given.
    local.run(&["node", "add", "name=next"]).succeeded();
    let nodes = local.client().find_all_nodes(NodeQuery::default()).expect("found");
    assert_eq!(nodes.iter().map(|node| node.id.0).collect::<Vec<_>>(), [0, 1, 2]);
    local.run(&["open", "saved:evning"]).failed(&["no scene is saved as evning", "bare, evening"]);
    local.run(&["scene", "remove", "evening"]).succeeded();
    local.run(&["scene", "remove", "evening"]).failed(&["no scene is saved as evening"]);
    assert_eq!(local.run(&["scene", "list"]).succeeded(), "bare: post, 1 edited node");
}

/// A session shows what it showed: the scene with its edits, the light and the camera.
fn check_session(local: &LocalWall, tree: &str, picture: &RgbaImage) {
    let list = local.run(&["session", "list"]).succeeded();
    assert_eq!(list, "show: post, 0 views, 1 stored view");
    local.client().set_camera(Camera::IDENTITY).expect("set");
    local.run(&["session", "open", "show"]).succeeded();
    assert_eq!(local.run(&["scene", "tree"]).succeeded(), tree);
    let client = local.client();
    assert_eq!(client.presentation().expect("shown").camera, VIEW);
    assert_eq!(client.stored_views().expect("stored")[0].name, "quay");
    let capture = client.capture().expect("pictures");
    check("session", &screen_of(&capture), picture, &IDENTICAL);
    client.set_exposure(1.0).expect("set");
    local.run(&["session", "open", "shaw"]).failed(&["no session is saved as shaw", "show"]);
    local.run(&["session", "delete", "show"]).succeeded();
    assert_eq!(local.run(&["session", "list"]).succeeded(), "");
}
