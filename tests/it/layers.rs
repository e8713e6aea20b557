//! Layers, switches and views with a part of the scene of their own, on a wall of processes: what
//! is left out leaves the picture of the scene without it.

use image::{RgbaImage, imageops};
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};
use polyptych_client::{
    Area, Assets, Camera, Light, LightKind, Material, MeshData, NewNode, NodeId, NodeKind,
    NodeQuery, Transaction, View, ViewProjection,
};
use serde_json::json;

use crate::harness::local_wall::{LocalWall, screen_of, shot};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count};

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.1, 1.5), ..Camera::IDENTITY };

fn picture(local: &LocalWall) -> RgbaImage {
    screen_of(&shot(&local.client(), VIEW))
}

/// The nodes of a street: a floor in no layer, a house and its lamp in the layer `night`, and what
/// hangs from the house: a door of the same layer, and a roof in a layer of its own.
struct Street {
    floor: NodeId,
    house: NodeId,
    door: NodeId,
    roof: NodeId,
}

fn build(client: &Client) -> Street {
    let mut assets = Assets::default();
    let mut paint = |color: [f32; 3]| {
        let base_color = Vec4::new(color[0], color[1], color[2], 1.0);
        assets.add_material(Material { base_color, ..Assets::matt() })
    };
    let [grey, red, blue] = [[0.5; 3], [0.8, 0.2, 0.1], [0.1, 0.3, 0.9]].map(&mut paint);
    let floor = assets.add_mesh(MeshData::cuboid(Vec3::new(3.0, 0.1, 3.0)), Some(grey));
    let house = assets.add_mesh(MeshData::cuboid(Vec3::splat(0.5)), Some(red));
    let round = assets.add_mesh(MeshData::sphere(0.3), Some(blue));
    let mut transaction = Transaction::default().with_assets(assets.to_source().expect("a source"));
    let at = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
    let node = |name: &str, parent, local, mesh| NewNode {
        name: name.into(),
        parent,
        local,
        mesh: Some(mesh),
        light: None,
    };
    let floor = transaction.create(node("floor", None, at(0.0, -0.5, -1.0), floor));
    // In one plane with the floor's top, so that depths are equal.
    let house = transaction.create(node("house", None, at(-0.3, -0.25, -1.0), house));
    let lamp = Light { kind: LightKind::Point, color: Vec3::ONE, intensity: 4.0, range: None };
    transaction.set_light(house, Some(lamp));
    let door = transaction.create(node("door", Some(house), at(0.7, 0.0, 0.4), round));
    let roof = transaction.create(node("roof", Some(house), at(0.0, 0.4, 0.0), round));
    transaction.set_layer(house, Some("night"));
    transaction.set_layer(roof, Some("roofs"));
    let made = client.commit(transaction).expect("edited").created;
    assert_eq!(made.len(), 4, "{floor} {house} {door} {roof}");
    Street { floor: made[0], house: made[1], door: made[2], roof: made[3] }
}

fn hide(client: &Client, layer: &str, visible: bool) {
    let mut transaction = Transaction::default();
    transaction.set_layer_visible(layer, visible);
    client.commit(transaction).expect("edited");
}

/// Takes the meshes and lights of these nodes away, and not what hangs from them.
fn bare(client: &Client, nodes: &[NodeId]) {
    let mut transaction = Transaction::default();
    for node in nodes {
        transaction.set_mesh(*node, None);
        transaction.set_light(*node, None);
    }
    client.commit(transaction).expect("edited");
}

#[test]
fn a_hidden_layer_leaves_the_picture_of_the_scene_without_it() {
    let local = LocalWall::with_nothing(2, 2);
    let client = local.client();
    let street = build(&client);
    let whole = picture(&local);
    hide(&client, "night", false);
    let hidden = picture(&local);
    assert!(hidden != whole && color_count(&hidden) > 20);
    let only = |kind, layer: &str| {
        let layer = Some(layer.to_owned());
        let query = NodeQuery { kind, layer, ..NodeQuery::default() };
        let found = client.find_all_nodes(query).expect("found");
        found.into_iter().map(|node| node.id).collect::<Vec<_>>()
    };
    assert_eq!(only(None, "night"), [street.house, street.door]);
    assert_eq!(only(Some(NodeKind::Light), "night"), [street.house]);
    assert_eq!(only(Some(NodeKind::Empty), "roofs"), []);
    let layers = client.layers().expect("layers");
    let layers: Vec<_> = layers.iter().map(|of| (of.name.as_str(), of.nodes, of.visible)).collect();
    assert_eq!(layers, [("night", 2, false), ("roofs", 1, true)]);
    hide(&client, "night", true);
    check("shown again", &picture(&local), &whole, &IDENTICAL);

    // The sun that shines on a scene without lights shines on one whose lights are hidden.
    bare(&client, &[street.house, street.door]);
    check("hidden layer", &hidden, &picture(&local), &IDENTICAL);
    let refused = client.commit({
        let mut transaction = Transaction::default();
        transaction.set_layer_visible("day", false);
        transaction
    });
    let error = refused.expect_err("there is none").to_string();
    assert!(error.contains("layer day: no node is in it; of layers there are night"), "{error}");
}

#[test]
fn a_switch_shows_one_child() {
    let local = LocalWall::with_nothing(1, 1);
    let client = local.client();
    let street = build(&client);
    let switch = |shown: Option<NodeId>| {
        let mut transaction = Transaction::default();
        transaction.set_switch(street.house, shown);
        client.commit(transaction).map(|_| picture(&local))
    };
    let all = picture(&local);
    let roof = switch(Some(street.roof)).expect("switched");
    let mut transaction = Transaction::default();
    transaction.set_visible(street.door, false);
    transaction.set_switch(street.house, None);
    client.commit(transaction).expect("edited");
    check("switched", &roof, &picture(&local), &IDENTICAL);
    assert!(roof != all);
    let error = switch(Some(street.floor)).expect_err("no child").to_string();
    assert!(error.contains("its switch shows one of its children"), "{error}");
}

/// The left half of the wall from above with this part of the scene, and the right half as a
/// camera's own picture with another; their border is no border of tiles.
fn two_plans(
    left: (Option<u64>, Option<&[&str]>),
    right: (Option<u64>, Option<&[&str]>),
) -> Vec<View> {
    let named = |layers: Option<&[&str]>| {
        layers.map(|of| of.iter().map(|name| (*name).to_owned()).collect())
    };
    let middle = DVec3::new(0.0, -0.2, -1.0);
    let above = Camera::look_at(middle + DVec3::Y * 4.0, middle, DVec3::NEG_Z);
    let beside = Camera::look_at(middle + DVec3::new(1.0, 1.2, 2.0), middle, DVec3::Y);
    let plan = ViewProjection::Orthographic { height_m: 2.5 };
    let front = ViewProjection::Perspective { fov_y_rad: 0.9 };
    [([0, 0, 200, 272], above, plan, left), ([200, 0, 280, 272], beside, front, right)]
        .map(|(rect, camera, projection, (root, layers))| View {
            area: Area::Screen { screen: 0, rect },
            projection,
            root,
            layers: named(layers),
            ..View::of_wall(camera)
        })
        .into()
}

fn halves(picture: &RgbaImage) -> [RgbaImage; 2] {
    [(0, 200), (200, 280)]
        .map(|(x, width)| imageops::crop_imm(picture, x, 0, width, 272).to_image())
}

#[test]
fn views_side_by_side_show_layers_and_roots_of_their_own() {
    let local = LocalWall::with_nothing(2, 2);
    let client = local.client();
    let street = build(&client);
    let show = |views: Vec<View>| {
        client.set_views(views).expect("set");
        picture(&local)
    };
    let (day, night): (&[&str], &[&str]) = (&["roofs"], &["night", "roofs"]);
    let mixed = show(two_plans((None, Some(day)), (None, Some(night))));
    // The wall's own visibility does not matter to them.
    hide(&client, "roofs", false);
    check("own layers", &picture(&local), &mixed, &IDENTICAL);
    hide(&client, "roofs", true);
    let of_night = show(two_plans((None, None), (None, None)));
    hide(&client, "night", false);
    let of_day = picture(&local);
    let [[left, right], [day, _], [_, night]] = [&mixed, &of_day, &of_night].map(halves);
    check("day", &left, &day, &IDENTICAL);
    check("night", &right, &night, &IDENTICAL);
    assert!(of_day != of_night && color_count(&mixed) > 50);

    // One channel shows the same.
    let single = LocalWall::with_nothing(1, 1);
    build(&single.client());
    let views = two_plans((None, Some(&["roofs"])), (None, Some(&["night", "roofs"])));
    single.client().set_views(views).expect("set");
    println!("{}", check("one channel", &picture(&single), &mixed, &SEAMS));

    // What hangs from the house, in the light of all, beside what is elsewhere.
    hide(&client, "night", true);
    let rooted = show(two_plans((Some(street.house.0), None), (Some(street.floor.0), None)));
    let pick = |x: f64| {
        let screen = local.wall().screens[0].name.clone();
        client.pick(&screen, DVec2::new(x, 136.0)).expect("picked").map(|hit| hit.node)
    };
    let picked = [190.0, 100.0, 340.0].map(pick);
    assert_eq!(picked, [None, Some(street.roof), Some(street.floor)], "of what views show");
    let mut transaction = Transaction::default();
    transaction.remove(street.roof);
    client.commit(transaction).expect("edited");
    let without_roof = picture(&local);
    assert!(halves(&without_roof)[0] != halves(&rooted)[0]);
    check("no roof here", &halves(&without_roof)[1], &halves(&rooted)[1], &IDENTICAL);
    show(two_plans((None, None), (None, None)));
    let mut transaction = Transaction::default();
    transaction.set_mesh(street.floor, None);
    client.commit(transaction).expect("edited");
    check("root", &halves(&without_roof)[0], &halves(&picture(&local))[0], &IDENTICAL);
    let gone = show(two_plans((Some(street.house.0), None), (None, None)));
    let mut transaction = Transaction::default();
    transaction.remove(street.house);
    client.commit(transaction).expect("edited");
    assert!(color_count(&halves(&gone)[0]) > 1);
    assert_eq!(color_count(&halves(&picture(&local))[0]), 1, "the sky alone");

    for (root, layers, part) in [
        (Some(99), None, "view 0: there is no node 99; it was removed, or never made"),
        (None, Some(&["dusk"][..]), "view 0: layer dusk: no node is in it"),
    ] {
        let refused = client.set_views(two_plans((root, layers), (None, None)));
        let error = refused.expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    }
    client.open_scene("empty.glb").expect("opened");
    let views = client.presentation().expect("a presentation").views;
    assert!(views.iter().all(|view| view.root.is_none() && view.layers.is_none()), "{views:?}");
}

#[test]
fn layers_and_switches_are_typed() {
    let local = LocalWall::with_nothing(1, 1);
    build(&local.client());
    let run = |words: &[&str]| local.run(words).succeeded();
    assert_eq!(run(&["scene", "layer"]), "night: 2 nodes\nroofs: 1 node");
    run(&["scene", "layer", "night", "hide"]);
    let listed = local.run(&["scene", "layer", "--json"]).json();
    assert_eq!(listed[0], json!({ "name": "night", "nodes": 2, "visible": false }));
    assert_eq!(run(&["scene", "layer"]), "night: 2 nodes, hidden\nroofs: 1 node");
    run(&["node", "set", "/house/door", "layer=plan-a"]);
    run(&["node", "set", "house", "switch=roof"]);
    let tree = run(&["scene", "tree", "--layer", "plan-a"]);
    assert!(tree.ends_with("door  mesh 2, layer plan-a"), "{tree}");
    let nodes = local.run(&["scene", "tree", "--below", "house", "--json"]).json();
    assert_eq!((&nodes[0]["switch"], &nodes[0]["layer"]), (&nodes[2]["id"], &"night".into()));
    run(&["node", "set", "house", "switch=all", "layer=none"]);
    let lit = run(&["scene", "tree", "--kind", "light"]);
    assert!(
        lit.contains("house") && !lit.contains("shows only") && !lit.contains("night"),
        "{lit}"
    );
    local.run(&["node", "set", "house", "switch=floor"]).failed(&["its switch shows one of its"]);
    local.run(&["scene", "layer", "day", "hide"]).failed(&["layer day: no node is in it"]);
    let view = ["view", "add", "0,4,-1", "0,0,-1", "--up", "0,0,-1", "--ortho", "3"];
    run(&[&view[..], &["--layers", "roofs", "--root", "house"]].concat());
    let said = run(&["view", "list"]);
    assert!(said.contains(", only node 2, layers roofs"), "{said}");
    local.run(&[&view[..], &["--layers", "dusk"]].concat()).failed(&["layer dusk: no node"]);
}
