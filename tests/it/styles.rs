//! Styles, nodes that turn towards the viewer, and labels, on a wall of processes.

use image::{Rgba, RgbaImage};
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_client::{
    Assets, Camera, Facing, Fill, HeadPose, Highlight, Material, MeshData, NewNode, NodeId,
    NodeStyle, Shading, Topology, Transaction,
};
use serde_json::json;

use crate::harness::local_wall::{LocalWall, screen_of, shot};
use crate::harness::pictures::{IDENTICAL, Policy, SEAMS, check, color_count};

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.1, 1.5), ..Camera::IDENTITY };

fn picture(local: &LocalWall) -> RgbaImage {
    screen_of(&shot(&local.client(), VIEW))
}

/// [`SEAMS`] for lines: one that runs between two rows of pixels lies in either, as f32 rounds,
/// and an edge of a box is 70 of 130,560 pixels long.
const LINES: Policy = Policy { within_1_share_min: 0.999, above_8_ppm_max: 1000.0, ..SEAMS };

fn style(client: &Client, node: NodeId, style: NodeStyle) {
    let mut transaction = Transaction::default();
    transaction.set_style(node, style);
    client.commit(transaction).expect("edited");
}

/// A group, and below it a red box and a blue, turned box; with the material of the second.
fn boxes(client: &Client) -> ([NodeId; 3], u32) {
    let mut assets = Assets::default();
    let paint = |color: [f32; 3]| Material {
        base_color: Vec4::new(color[0], color[1], color[2], 1.0),
        ..Assets::matt()
    };
    let [red, blue] =
        [[0.8, 0.2, 0.1], [0.1, 0.3, 0.9]].map(|color| assets.add_material(paint(color)));
    let size = Vec3::new(0.5, 0.4, 0.3);
    let red = assets.add_mesh(MeshData::cuboid(size), Some(red));
    let blue = assets.add_mesh(MeshData::cuboid(size), Some(blue));
    let mut transaction = Transaction::default().with_assets(assets.to_source().expect("a source"));
    let group = transaction.create(NewNode::default());
    let node = |x: f64, turn: f64, mesh| NewNode {
        parent: Some(group),
        local: DAffine3::from_translation(DVec3::new(x, 0.1, -1.0))
            * DAffine3::from_rotation_y(turn),
        mesh: Some(mesh),
        ..NewNode::default()
    };
    let _ = transaction.create(node(-0.4, 0.3, red));
    let _ = transaction.create(node(0.4, 0.7, blue));
    let edited = client.commit(transaction).expect("edited");
    let made = edited.created;
    ([made[0], made[1], made[2]], edited.assets.expect("assets").first_material + 1)
}

/// The edges of a box as a mesh of lines, those across its faces too.
fn edges(of: &MeshData) -> MeshData {
    let triangles = of.indices.chunks_exact(3);
    let indices = triangles.flat_map(|t| [t[0], t[1], t[1], t[2], t[2], t[0]]).collect();
    MeshData { indices, topology: Topology::Lines, ..of.clone() }
}

fn share_of(picture: &RgbaImage, color: Rgba<u8>) -> f64 {
    let same = picture.pixels().filter(|pixel| **pixel == color).count();
    same as f64 / f64::from(picture.width() * picture.height())
}

#[test]
fn styles_are_inherited_and_what_materials_and_meshes_would_show() {
    let local = LocalWall::with_nothing(2, 2);
    let client = local.client();
    let ([group, red, blue], paint) = boxes(&client);
    let plain = picture(&local);
    let unlit = NodeStyle { shading: Some(Shading::Unlit), ..NodeStyle::default() };
    style(&client, blue, unlit);
    let flat = picture(&local);
    style(&client, blue, NodeStyle::default());
    check("as before", &picture(&local), &plain, &IDENTICAL);
    let mut transaction = Transaction::default();
    let material =
        Material { base_color: Vec4::new(0.1, 0.3, 0.9, 1.0), unlit: true, ..Assets::matt() };
    transaction.set_material(paint, material.clone());
    client.commit(transaction).expect("edited");
    check("unlit", &flat, &picture(&local), &IDENTICAL);
    assert!(flat != plain);

    // Lines of a box are those of a mesh of lines.
    let wires = NodeStyle { fill: Some(Fill::Wireframe), ..unlit };
    style(&client, group, wires);
    style(&client, red, NodeStyle { fill: Some(Fill::Solid), ..NodeStyle::default() });
    let wired = picture(&local);
    let mut assets = Assets::default();
    let lines = edges(&MeshData::cuboid(Vec3::new(0.5, 0.4, 0.3)));
    let material = assets.add_material(material);
    let lines = assets.add_mesh(lines, Some(material));
    let mut transaction = Transaction::default().with_assets(assets.to_source().expect("a source"));
    transaction.set_style(group, unlit);
    transaction.set_mesh(blue, Some(lines));
    client.commit(transaction).expect("edited");
    check("wireframe", &wired, &picture(&local), &IDENTICAL);

    // Points are shown where vertices are, and nothing else.
    style(&client, group, NodeStyle { fill: Some(Fill::Points), ..unlit });
    let points = picture(&local);
    assert!(points != wired && color_count(&points) > 1);
}

#[test]
fn highlights_are_what_they_say_at_any_exposure_and_across_seams() {
    let local = LocalWall::with_nothing(2, 2);
    let client = local.client();
    let ([group, red, _], _) = boxes(&client);
    let plain = picture(&local);
    let tint = |share: f32| NodeStyle {
        highlight: Some(Highlight::Tint { color: Vec3::new(1.0, 0.0, 0.0), share }),
        ..NodeStyle::default()
    };
    style(&client, group, tint(1.0));
    style(&client, red, NodeStyle { highlight: Some(Highlight::Off), ..NodeStyle::default() });
    let pure = Rgba([255, 0, 0, 255]);
    let marked = picture(&local);
    let share = share_of(&marked, pure);
    assert!((0.02..0.3).contains(&share) && share_of(&plain, pure) == 0.0, "{share}");
    client.set_exposure(7.0).expect("set");
    assert!((share_of(&picture(&local), pure) - share).abs() < 1e-9);
    client.set_exposure(1.0).expect("set");
    style(&client, group, tint(0.5));
    let half = picture(&local);
    assert!(half != plain && half != marked);
    let single = LocalWall::with_nothing(1, 1);
    let ([group, red, _], _) = boxes(&single.client());
    style(&single.client(), group, tint(0.5));
    let off = NodeStyle { highlight: Some(Highlight::Off), ..NodeStyle::default() };
    style(&single.client(), red, off);
    println!("{}", check("highlight", &picture(&single), &half, &SEAMS));
    let wires = NodeStyle { fill: Some(Fill::Wireframe), ..tint(0.5) };
    style(&client, group_of(&client), wires);
    style(&single.client(), group, wires);
    println!("{}", check("wires", &picture(&single), &picture(&local), &LINES));
    let wrong = Highlight::Tint { color: Vec3::new(2.0, 0.0, 0.0), share: 0.5 };
    let mut transaction = Transaction::default();
    transaction.set_style(red, NodeStyle { highlight: Some(wrong), ..NodeStyle::default() });
    let error = client.commit(transaction).expect_err("no colour").to_string();
    assert!(error.contains("a highlight's color is 0 to 1 in all three"), "{error}");
}

/// The node that both boxes hang from.
fn group_of(client: &Client) -> NodeId {
    let nodes = client.find_all_nodes(polyptych_client::NodeQuery::default()).expect("found");
    nodes.iter().find_map(|node| node.parent).expect("a parent")
}

#[test]
fn what_faces_the_viewer_is_turned_alike_on_all_tiles() {
    let local = LocalWall::with_nothing(2, 2);
    let client = local.client();
    let single = LocalWall::with_nothing(1, 1);
    let turn = |client: &Client, facing| {
        let ([group, _, _], _) = boxes(client);
        let mut transaction = Transaction::default();
        let local = DAffine3::from_translation(DVec3::new(0.05, 0.1, -0.2))
            * DAffine3::from_rotation_y(2.0);
        transaction.set_transform(group, local);
        transaction.set_facing(group, facing);
        client.commit(transaction).expect("edited");
        group
    };
    let group = turn(&client, Some(Facing::Upright));
    turn(&single.client(), Some(Facing::Upright));
    let upright = picture(&local);
    println!("{}", check("facing", &picture(&single), &upright, &SEAMS));

    // The same group, turned by hand: its front points at the eye, seen from above.
    let head = client.presentation().expect("a presentation").head;
    let eye = VIEW.world_from_display(head.position);
    let by_hand = |eye: DVec3| {
        let pivot = DVec3::new(0.05, 0.1, -0.2);
        let (sin, cos) = ((eye.x - pivot.x), (eye.z - pivot.z));
        DAffine3::from_translation(pivot) * DAffine3::from_rotation_y(sin.atan2(cos))
    };
    let mut transaction = Transaction::default();
    transaction.set_facing(group, None);
    transaction.set_transform(group, by_hand(eye));
    client.commit(transaction).expect("edited");
    println!("{}", check("by hand", &picture(&local), &upright, &SEAMS));

    // It follows the head, and goes up and down if it faces the eye.
    let mut transaction = Transaction::default();
    transaction.set_facing(group, Some(Facing::Eye));
    client.commit(transaction).expect("edited");
    client.set_head(HeadPose { position: DVec3::new(0.5, 0.6, 0.3), ..head }).expect("set");
    let looked_at = picture(&local);
    let mut transaction = Transaction::default();
    transaction.set_facing(group, Some(Facing::Upright));
    client.commit(transaction).expect("edited");
    assert!(picture(&local) != looked_at, "it leans back");
}

#[test]
fn labels_and_styles_are_typed() {
    let local = LocalWall::with_nothing(2, 1);
    let run = |words: &[&str]| local.run(words).succeeded();
    let before = picture(&local);
    let label = ["node", "add", "name=sign", "label=Hafen Ägäis", "size=0.3", "color=#ffcc00"];
    run(&[&label[..], &["position=0,0.1,-0.5", "facing=upright"]].concat());
    let shown = picture(&local);
    let share = share_of(&shown, Rgba([255, 204, 0, 255]));
    assert!(before != shown && (0.005..0.2).contains(&share), "{share}");
    let nodes = local.run(&["scene", "tree", "--kind", "label", "--json"]).json();
    assert_eq!(nodes.as_array().map(Vec::len), Some(1));
    assert_eq!(nodes[0]["attributes"]["label"], json!("Hafen Ägäis"));
    assert_eq!(
        (&nodes[0]["facing"], &nodes[0]["style"]["fill"]),
        (&"upright".into(), &json!(null))
    );
    run(&["node", "set", "sign", "fill=wireframe", "highlight=#00ff0080"]);
    let wired = picture(&local);
    assert!(wired != shown && wired != before);
    run(&["node", "set", "sign", "shading=unlit", "facing=eye"]);
    let nodes = local.run(&["scene", "tree", "--kind", "label", "--json"]).json();
    let style = &nodes[0]["style"];
    assert_eq!((&style["fill"], &style["shading"]), (&"wireframe".into(), &"unlit".into()));
    assert_eq!(style["highlight"][1], json!(1.0));
    run(&["node", "set", "sign", "fill=none", "shading=none", "highlight=none", "facing=upright"]);
    check("as it was", &picture(&local), &shown, &IDENTICAL);
    run(&["node", "set", "sign", "label=Tor", "size=0.3", "color=#ffcc00"]);
    assert!(picture(&local) != shown);

    let long = json!([{ "op": "add", "label": "x".repeat(1_000_000) }]).to_string();
    let long = local.place.write("long.json", long.as_bytes()).display().to_string();
    let refused = local.run(&["transaction", &long]);
    refused.failed(&["operation 0", "1000000 bytes, where 512 can be"]);
    local.run(&["node", "add", "label=港"]).failed(&["no letter '港'"]);
    local.run(&["node", "add", "size=2"]).failed(&["a size goes with a text"]);
    local.run(&["node", "set", "sign", "fill=hollow"]).failed(&["solid, wireframe, points"]);
}
