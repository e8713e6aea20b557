//! Scenes that are edited while they are shown, on a wall of processes: what is seen is what a file
//! would show that had the same written in it.

use image::RgbaImage;
use polyptych_client::glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};
use polyptych_client::{
    Attribute, Camera, ChannelState, Light, LightKind, Material, NewNode, NodeId, NodeQuery,
    Transaction,
};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

/// A triangle that hangs from a frame, of a material that lights change.
fn signpost() -> Gltf {
    Gltf::triangle().with(|gltf| {
        gltf.json["materials"] = json!([{
            "name": "paint",
            "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.2, 0.1, 1.0],
                "metallicFactor": 0.0,
            },
        }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        gltf.json["nodes"] = json!([
            { "name": "post", "translation": [-0.5, 0.0, 0.0], "children": [1] },
            { "name": "arm", "mesh": 0 },
        ]);
    })
}

fn edited_file() -> Gltf {
    signpost().with(|gltf| {
        // Both turned and moved, and a second arm.
        let half = std::f64::consts::FRAC_PI_8;
        gltf.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] =
            json!([0.1, 0.3, 0.9, 1.0]);
        gltf.json["nodes"] = json!([
            { "name": "post", "translation": [-0.2, 0.1, 0.0], "children": [1, 2] },
            { "name": "arm", "mesh": 0, "rotation": [0.0, 0.0, half.sin(), half.cos()] },
            {
                "name": "second",
                "mesh": 0,
                "translation": [0.3, -0.6, 0.2],
                "scale": [0.5, 0.5, 0.5],
            },
        ]);
    })
}

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.2, 1.5), ..Camera::IDENTITY };

fn picture(local: &LocalWall) -> RgbaImage {
    screen_of(&shot(&local.client(), VIEW))
}

fn wall_of_files() -> LocalWall {
    let place = TestDir::new();
    place.write("post.glb", signpost().glb());
    let scenes = place.write("edited.glb", edited_file().glb());
    let folder = scenes.parent().expect("a folder").to_owned();
    LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT)
}

/// Returns the changes that turn the signpost into the edited file.
fn transaction() -> Transaction {
    let mut transaction = Transaction::default();
    let (post, arm) = (NodeId(0), NodeId(1));
    transaction.set_transform(post, DAffine3::from_translation(DVec3::new(-0.2, 0.1, 0.0)));
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4);
    transaction.set_transform(arm, DAffine3::from_quat(turn));
    let local = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.5),
        DQuat::IDENTITY,
        DVec3::new(0.3, -0.6, 0.2),
    );
    let name = "second".to_owned();
    transaction.create(NewNode { parent: Some(post), name, local, mesh: Some(0), light: None });
    let paint = Material {
        name: "paint".into(),
        base_color: Vec4::new(0.1, 0.3, 0.9, 1.0),
        metallic: 0.0,
        double_sided: true,
        ..Material::default()
    };
    transaction.set_material(0, paint);
    transaction
}

#[test]
fn an_edited_scene_is_the_picture_of_the_file_that_says_the_same() {
    let mut local = wall_of_files();
    let client = local.client();
    client.open_scene("edited.glb").expect("opened");
    let expected = picture(&local);
    assert!(color_count(&expected) > 1, "there is something to see");
    client.open_scene("post.glb").expect("opened");
    let before = picture(&local);
    assert!(before != expected);
    let edited = client.commit(transaction()).expect("edited");
    assert_eq!((edited.created.as_slice(), edited.frames), (&[NodeId(2)][..], 1));
    assert!(edited.feedback.is_complete(), "{edited:?}");
    check("edited", &picture(&local), &expected, &IDENTICAL);

    // A server that comes later has the same, and so has a manager.
    let name = local.servers.keys().next().expect("a server").clone();
    local.servers.remove(&name).expect("a server").kill();
    local.await_lost(&client, &name);
    local.start_server(&name);
    await_states(&client, &[ChannelState::Live]);
    check("joined", &picture(&local), &expected, &IDENTICAL);
    local.manager.kill();
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
    check("restarted", &picture(&local), &expected, &IDENTICAL);
    let client = local.client();
    let mut back = Transaction::default();
    back.remove(NodeId(2));
    back.set_transform(NodeId(0), DAffine3::from_translation(DVec3::X * -0.5));
    back.set_transform(NodeId(1), DAffine3::IDENTITY);
    back.set_visible(NodeId(0), false);
    client.commit(back).expect("edited");
    assert_eq!(color_count(&picture(&local)), 1, "hidden with all that hangs from it");
    let mut shown = Transaction::default();
    shown.set_visible(NodeId(0), true);
    client.commit(shown).expect("edited");
    client.open_scene("post.glb").expect("opened");
    check("opened anew", &picture(&local), &before, &IDENTICAL);
}

#[test]
fn lights_that_are_made_and_moved_light_what_is_there() {
    let local = wall_of_files();
    let client = local.client();
    client.open_scene("post.glb").expect("opened");
    let dark = picture(&local);
    let lamp = Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 3.0, range: None };
    let mut transaction = Transaction::default();
    let local_of = |z: f64| DAffine3::from_translation(DVec3::new(0.0, 0.2, z));
    let new = NewNode { light: Some(lamp), local: local_of(0.5), ..NewNode::default() };
    transaction.create(new);
    let node = client.commit(transaction).expect("edited").created[0];
    let mean = |picture: &RgbaImage| {
        let sum: u64 = picture.pixels().map(|p| u64::from(p.0[0])).sum();
        sum as f64 / f64::from(picture.width() * picture.height())
    };
    let near = picture(&local);
    assert!(mean(&near) > mean(&dark) + 0.5, "{} and {}", mean(&near), mean(&dark));
    let mut away = Transaction::default();
    away.set_transform(node, local_of(50.0));
    client.commit(away).expect("edited");
    let far = picture(&local);
    assert!(mean(&far) < mean(&near) - 0.5, "{} and {}", mean(&far), mean(&near));
    let mut gone = Transaction::default();
    gone.remove(node);
    client.commit(gone).expect("edited");
    check("dark again", &picture(&local), &dark, &IDENTICAL);
}

#[test]
fn nodes_are_found_as_they_stand() {
    let local = wall_of_files();
    let client = local.client();
    let refused = client.find_nodes(NodeQuery { count: 1, ..NodeQuery::default() });
    assert!(refused.expect_err("nothing is open").to_string().contains("no scene is open"));
    client.open_scene("post.glb").expect("opened");
    let mut transaction = transaction();
    transaction.set_attribute(NodeId(1), "kind", Some(Attribute::Text("pointer".into())));
    client.commit(transaction).expect("edited");
    let all = client.find_all_nodes(NodeQuery::default()).expect("found");
    let names: Vec<_> = all.iter().map(|node| (node.name.as_str(), node.depth)).collect();
    assert_eq!(names, [("post", 0), ("arm", 1), ("second", 1)]);
    let second = &all[2];
    assert_eq!(second.parent, Some(NodeId(0)));
    assert!(second.world.translation.abs_diff_eq(DVec3::new(0.1, -0.5, 0.2), 1e-12));
    let bounds = second.bounds.expect("it has a mesh");
    assert!(bounds.max.abs_diff_eq(DVec3::new(0.6, 0.0, 0.2), 1e-6), "{bounds:?}");
    let of_kind = NodeQuery {
        attribute: Some(("kind".into(), None)),
        below: Some(NodeId(0)),
        ..NodeQuery::default()
    };
    let found = client.find_all_nodes(of_kind).expect("found");
    assert_eq!(found.iter().map(|node| node.id).collect::<Vec<_>>(), [NodeId(1)]);
    let one = NodeQuery { name: Some("arm".into()), count: 1, skip: 1, ..NodeQuery::default() };
    let page = client.find_nodes(one).expect("found");
    assert_eq!((page.found, page.nodes.len()), (1, 0), "the page behind the last");
}
