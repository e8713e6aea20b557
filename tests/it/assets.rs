//! Meshes, materials and whole files that come into a scene while it is shown.

use image::RgbaImage;
use polyptych_client::glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_client::{
    AssetSource, Assets, Camera, ChannelState, Material, MeshData, NewNode, NodeId, NodeQuery, Ray,
    RayQuery, Request, Response, Transaction, provisional_asset,
};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::transaction::BakedAssets;
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;

/// A painted triangle that hangs from a post.
fn flag() -> Gltf {
    Gltf::triangle().with(|gltf| {
        gltf.json["materials"] = json!([{
            "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.2, 0.1, 1.0],
                "metallicFactor": 0.0,
            },
        }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        gltf.json["nodes"] = json!([
            { "name": "post", "translation": [-0.5, 0.0, 0.0], "children": [1] },
            { "name": "cloth", "mesh": 0 },
        ]);
    })
}

/// The post by itself.
fn post() -> Gltf {
    flag().with(|gltf| gltf.json["nodes"][1] = json!({ "name": "cloth" }))
}

/// The post, and the flag below it, moved.
fn flag_below_post() -> Gltf {
    flag().with(|gltf| {
        gltf.json["nodes"] = json!([
            { "name": "post", "translation": [-0.5, 0.0, 0.0], "children": [1, 2] },
            { "name": "cloth" },
            { "name": "flag", "translation": [0.4, 0.2, 0.0], "children": [3] },
            { "name": "post", "translation": [-0.5, 0.0, 0.0], "children": [4] },
            { "name": "cloth", "mesh": 0 },
        ]);
    })
}

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.2, 1.5), ..Camera::IDENTITY };

fn wall() -> LocalWall {
    let place = TestDir::new();
    place.write("flag.glb", flag().glb());
    place.write("below.glb", flag_below_post().glb());
    let folder = place.write("post.glb", post().glb()).parent().expect("a folder").to_owned();
    LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT)
}

fn picture(local: &LocalWall) -> RgbaImage {
    screen_of(&shot(&local.client(), VIEW))
}

/// The picture of a file by itself.
fn picture_of(local: &LocalWall, file: &str) -> RgbaImage {
    local.client().open_scene(file).expect("opened");
    picture(local)
}

/// The cloth as a program makes it.
fn cloth() -> (Assets, u32) {
    let mut assets = Assets::default();
    let paint = Material {
        base_color: Vec4::new(0.8, 0.2, 0.1, 1.0),
        double_sided: true,
        ..Assets::matt()
    };
    let paint = assets.add_material(paint);
    let triangle = MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        indices: vec![0, 1, 2],
        ..MeshData::default()
    };
    let mesh = assets.add_mesh(triangle, Some(paint));
    (assets, mesh)
}

/// Bytes of scenes in graphics memory, of each display.
fn scene_bytes(client: &polyptych_client::blocking::Client) -> Vec<u64> {
    client.status().expect("status").channels.iter().map(|of| of.scene_bytes).collect()
}

#[test]
fn a_mesh_from_arrays_is_the_picture_of_the_file_that_has_it() {
    let mut local = wall();
    let client = local.client();
    let expected = picture_of(&local, "flag.glb");
    assert!(color_count(&expected) > 1, "there is something to see");
    let without = picture_of(&local, "post.glb");
    let before = scene_bytes(&client);
    let (assets, mesh) = cloth();
    let mut transaction = Transaction::default().with_assets(assets.to_source().expect("sound"));
    transaction.set_mesh(NodeId(1), Some(mesh));
    let edited = client.commit(transaction).expect("edited");
    assert!(edited.feedback.is_complete(), "{edited:?}");
    check("from arrays", &picture(&local), &expected, &IDENTICAL);
    assert!(scene_bytes(&client).iter().zip(&before).all(|(now, before)| now > before));
    // It is a mesh as any: a node more shows it without another upload, and a ray meets it.
    let own = edited.mesh(mesh).expect("a number");
    let mut again = Transaction::default();
    again.create(NewNode { mesh: Some(own), ..NewNode::default() });
    let copy = client.commit(again).expect("edited").created[0];
    let found = client.find_all_nodes(NodeQuery::default()).expect("found");
    let bounds = found.iter().find(|node| node.id == copy).and_then(|node| node.bounds);
    assert_eq!(bounds.map(|of| of.max), Some(DVec3::new(1.0, 1.0, 0.0)));
    let ray = Ray { origin: DVec3::new(0.2, 0.2, 5.0), direction: DVec3::NEG_Z };
    let hit = client.cast_ray(RayQuery::new(ray)).expect("asked");
    assert_eq!(hit.map(|hit| (hit.node, hit.distance)), Some((copy, 5.0)));
    let mut gone = Transaction::default();
    gone.remove(copy);
    client.commit(gone).expect("edited");

    // A server that comes later has it, and so has a manager.
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
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check("restarted", &picture(&local), &expected, &IDENTICAL);

    // Once nothing shows it, it is gone, and its number means nothing.
    let mut bare = Transaction::default();
    bare.set_mesh(NodeId(1), None);
    client.commit(bare).expect("edited");
    check("bare", &picture(&local), &without, &IDENTICAL);
    assert_eq!(scene_bytes(&client), before, "memory comes back");
    let mut late = Transaction::default();
    late.set_mesh(NodeId(1), Some(own));
    let refused = client.commit(late).expect_err("gone").to_string();
    assert!(refused.contains(&format!("there is no mesh {own}")), "{refused}");
}

#[test]
fn a_file_below_a_node_is_the_picture_of_the_file_that_has_both() {
    let local = wall();
    let expected = picture_of(&local, "below.glb");
    let without = picture_of(&local, "post.glb");
    let words = ["scene", "import", "flag.glb", "position=0.4,0.2,0", "--parent", "post"];
    local.run(&words).succeeded();
    check("imported", &picture(&local), &expected, &IDENTICAL);
    let tree = local.run(&["scene", "tree"]).succeeded();
    assert_eq!(tree, "0 post\n  1 cloth\n  2 flag\n    3 post\n      4 cloth  mesh 0");
    // Hidden, it is there without a byte to send; removed, it is not.
    local.run(&["node", "set", "flag", "visible=false"]).succeeded();
    check("hidden", &picture(&local), &without, &IDENTICAL);
    local.run(&["node", "set", "flag", "visible=true"]).succeeded();
    check("shown", &picture(&local), &expected, &IDENTICAL);
    local.run(&["node", "remove", "flag"]).succeeded();
    check("removed", &picture(&local), &without, &IDENTICAL);
    // A file without meshes brings its places, and says that nothing of it is drawn.
    let said = local.run(&["scene", "import", "post.glb"]).succeeded();
    assert!(said.contains("note: scenes: the shown scene has no mesh"), "{said}");
    check("a post more", &picture(&local), &without, &IDENTICAL);
}

#[test]
fn transactions_of_a_program_are_applied_in_its_order() {
    // Files that were not baked before take their time.
    let place = TestDir::unbaked();
    place.write("flag.glb", flag().glb());
    let folder = place.write("post.glb", post().glb()).parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT);
    let client = local.client();
    client.open_scene("post.glb").expect("opened");
    let (assets, mesh) = cloth();
    let below = NewNode { name: "flag".into(), ..NewNode::default() };
    let mut first = Transaction::default().with_scene(AssetSource::File("flag.glb".into()), below);
    first.set_name(NodeId(0), "first");
    let mut second = Transaction::default().with_assets(assets.to_source().expect("sound"));
    second.create(NewNode { mesh: Some(mesh), ..NewNode::default() });
    second.set_name(NodeId(0), "second");
    let mut third = Transaction::default();
    third.set_name(NodeId(0), "third");
    let sent = [first, second, third]
        .map(|transaction| client.submit(Request::Edit(transaction)).expect("sent"));
    let [first, second, third] = sent.map(|pending| match pending.wait() {
        Ok(Response::Edited(edited)) => edited,
        other => panic!("{other:?}"),
    });
    assert!(first.revision <= second.revision && first.revision <= third.revision);
    assert!(first.created.last() < second.created.first(), "{first:?} {second:?}");
    let found = client.find_all_nodes(NodeQuery::default()).expect("found");
    assert_eq!(found[0].name, "third", "it does not go ahead of what changes the same");
}

#[test]
fn a_file_of_the_managers_folders_is_imported_where_the_one_here_is_in_none_of_them() {
    let place = TestDir::new();
    place.write("scenes/flag.glb", flag().glb());
    let post = place.write("scenes/post.glb", post().glb());
    place.write("flag.glb", "no glTF");
    place.write("own.glb", flag().glb());
    let folder = post.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT);
    local.client().open_scene("post.glb").expect("opened");
    local.run(&["scene", "import", "flag.glb", "name=found"]).succeeded();
    let tree = local.run(&["scene", "tree"]).succeeded();
    assert!(tree.contains("2 found"), "{tree}");
    local.run(&["scene", "import", "own.glb"]).failed(&["own.glb", "the manager's scene folders"]);
}

#[test]
fn a_file_that_is_added_is_baked_as_one() {
    let place = TestDir::unbaked();
    // A skin that no clip moves: edits may bend it where its file is opened, and nowhere else.
    let skinned = Gltf::triangle().with(|gltf| {
        let joints = gltf.accessor("VEC4", 5121, 3, &[0; 12]);
        let weights = gltf.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(3));
        let attributes = &mut gltf.json["meshes"][0]["primitives"][0]["attributes"];
        (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(joints), json!(weights));
        gltf.json["nodes"] = json!([{ "mesh": 0, "skin": 0 }, { "name": "joint" }]);
        gltf.json["scenes"] = json!([{ "nodes": [0, 1] }]);
        gltf.json["skins"] = json!([{ "joints": [1] }]);
    });
    place.write("skinned.glb", skinned.glb());
    let folder = place.write("post.glb", post().glb()).parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT);
    local.client().open_scene("post.glb").expect("opened");
    let below = NewNode { name: "doll".into(), ..NewNode::default() };
    let source = AssetSource::File("skinned.glb".into());
    local.client().commit(Transaction::default().with_scene(source, below)).expect("added");
    let bake = |options: &[&str]| {
        let arguments = ["bake", "skinned.glb", "-o", "cache/polyptych/store", "--json"];
        local.place.run(arguments.iter().chain(options)).json()
    };
    // The manager's own baker has done so.
    let added = bake(&["--added"]);
    assert_eq!(added["reused"], true, "{added}");
    let opened = bake(&[]);
    assert_eq!(opened["reused"], false, "{opened}");
    assert_ne!(added["manifest"], opened["manifest"]);
}

#[test]
fn shapes_are_added_by_words() {
    let local = wall();
    let before = picture_of(&local, "post.glb");
    let words = ["node", "add", "name=crate", "mesh=box:0.5,0.5,0.5", "color=#ff8000"];
    local.run(&words).succeeded();
    let with = picture(&local);
    assert!(with != before && color_count(&with) > 1, "a box");
    local.run(&["node", "set", "crate", "mesh=sphere:0.3"]).succeeded();
    let round = picture(&local);
    assert!(round != with && round != before);
    local.run(&["node", "set", "crate", "mesh=cube:1"]).failed(&["no such shape", "cylinder"]);
    local.run(&["node", "set", "crate", "color=#ff0000"]).failed(&["goes with a new mesh"]);
    local.run(&["node", "remove", "crate"]).succeeded();
    check("removed", &picture(&local), &before, &IDENTICAL);
    // What of a file is not drawn is said as it is of a scene.
    let milk = flag().with(|gltf| {
        gltf.json["materials"][0]["extensions"] =
            json!({ "KHR_materials_volume_scatter": { "multiscatterColor": [1, 1, 0] } });
    });
    local.place.write("milk.glb", milk.glb());
    let note = "materials: 1 is drawn without KHR_materials_volume_scatter";
    let said = local.run(&["scene", "import", "milk.glb"]).succeeded();
    assert_eq!(said.lines().last(), Some(format!("note: {note}").as_str()), "{said}");
    let said = local.run(&["scene", "import", "milk.glb", "--json"]).json();
    assert_eq!(said["notes"], json!([note]));
    local.run(&["scene", "import", "none.glb"]).failed(&["none.glb", "not found"]);
    local.run(&["scene", "import", "flag.glb", "mesh=1"]).failed(&["name, position, rotation"]);
}

#[test]
fn assets_that_cannot_be_are_refused_and_the_wall_stays() {
    let local = wall();
    let client = local.client();
    let before = picture_of(&local, "post.glb");
    let (assets, mesh) = cloth();
    let source = assets.to_source().expect("sound");
    let showing = |source: AssetSource, mesh: u32| {
        let mut transaction = Transaction::default().with_assets(source);
        transaction.create(NewNode { mesh: Some(mesh), ..NewNode::default() });
        transaction
    };
    let outside = Gltf::triangle().with(|gltf| {
        gltf.json["images"] = json!([{ "uri": "/etc/passwd" }]);
        gltf.json["textures"] = json!([{ "source": 0 }]);
        gltf.json["materials"] =
            json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    });
    // A client must not name blobs of the manager by itself.
    let baked = BakedAssets {
        manifest: BlobHash([7; 32]),
        primitives: vec![1],
        materials: 0,
        textures: 0,
        notes: Vec::new(),
    };
    let nothing = NewNode { local: DAffine3::IDENTITY, ..NewNode::default() };
    let cases = [
        (showing(AssetSource::Glb(b"no file".as_slice().into()), mesh), "the assets"),
        (showing(AssetSource::Glb(outside.glb().into()), mesh), "passwd"),
        (showing(AssetSource::File("../none.glb".into()), mesh), "none.glb"),
        (showing(source.clone(), provisional_asset(1)), "brings no mesh 1; it brings 1"),
        (showing(source.clone(), 7), "there is no mesh 7"),
        (showing(AssetSource::Baked(baked), mesh), "or as the bytes of one"),
        (Transaction::default().with_assets(source), "nothing of the scene would use"),
        (
            Transaction::default().with_scene(AssetSource::File("none.glb".into()), nothing),
            "not found in the manager's scene folders",
        ),
    ];
    for (transaction, part) in cases {
        let refused = client.commit(transaction).expect_err(part).to_string();
        assert!(refused.contains(part), "{part:?} is not in {refused}");
        assert!(
            !refused.contains("polyptych-assets"),
            "where it lay is nobody's business: {refused}"
        );
    }
    check("as before", &picture(&local), &before, &IDENTICAL);
}

#[test]
fn each_paints_only_its_own_of_a_file_that_two_have_added() {
    let local = wall();
    picture_of(&local, "post.glb");
    let (ann, bob) = (local.client(), local.client());
    let (assets, mesh) = cloth();
    let add = |client: &polyptych_client::blocking::Client, x: f64| {
        let mut transaction =
            Transaction::default().with_assets(assets.to_source().expect("sound"));
        let local = DAffine3::from_translation(DVec3::X * x);
        transaction.create(NewNode { mesh: Some(mesh), local, ..NewNode::default() });
        let edited = client.commit(transaction).expect("edited");
        (edited.assets.expect("numbers").first_material, edited.created[0])
    };
    add(&bob, 0.1);
    let (alone, bytes) = (picture(&local), scene_bytes(&bob));
    let (paint, node) = add(&ann, -0.9);
    assert_eq!(scene_bytes(&ann), bytes, "its mesh is there");
    let both = picture(&local);
    assert!(both != alone);
    let mut green = Transaction::default();
    let base_color = Vec4::new(0.1, 0.8, 0.2, 1.0);
    green.set_material(paint, Material { base_color, double_sided: true, ..Assets::matt() });
    ann.commit(green).expect("edited");
    assert!(picture(&local) != both);
    let mut gone = Transaction::default();
    gone.remove(node);
    ann.commit(gone).expect("edited");
    check("the other's", &picture(&local), &alone, &IDENTICAL);
}

#[test]
fn assets_of_a_client_that_is_gone_go_with_its_nodes() {
    let local = wall();
    let before = picture_of(&local, "post.glb");
    let watcher = local.client();
    let (bytes, (assets, mesh)) = (scene_bytes(&watcher), cloth());
    let guest = local.client();
    let mut transaction = Transaction::temporary().with_assets(assets.to_source().expect("sound"));
    transaction.create(NewNode { mesh: Some(mesh), ..NewNode::default() });
    guest.commit(transaction).expect("edited");
    assert!(picture(&local) != before && scene_bytes(&watcher) > bytes);
    drop(guest);
    while watcher.find_all_nodes(NodeQuery::default()).expect("found").len() > 2 {
        watcher.render_frame().expect("a frame");
    }
    check("gone", &picture(&local), &before, &IDENTICAL);
    assert_eq!(scene_bytes(&watcher), bytes);
}
