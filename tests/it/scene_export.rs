//! Scenes leave a wall as files, and come back as they were.

mod round_trip;

use std::io::{self, Write};
use std::sync::mpsc;

use image::RgbaImage;
use polyptych_client::glam::{Affine2, DAffine3, DVec3, Vec2, Vec3, Vec4};
use polyptych_client::{
    AlphaMode, Assets, Attribute, Camera, ClientError, Light, LightKind, Material, MeshData,
    NewNode, NodeInfo, NodeQuery, TextureRef, Transaction, blocking::Client, fit_bounds,
};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, town};
use crate::harness::wait;

/// A wall that shows the town.
fn wall() -> (LocalWall, Camera) {
    let place = TestDir::new();
    let town = place.write("town.glb", std::fs::read(town()).expect("the town"));
    let folder = town.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let camera = fit_bounds(&client.wall().expect("a wall"), &bounds, 0.5);
    (local, camera)
}

fn picture(client: &Client, camera: Camera) -> RgbaImage {
    screen_of(&shot(client, camera))
}

fn nodes(client: &Client) -> Vec<NodeInfo> {
    client.find_all_nodes(NodeQuery::default()).expect("found")
}

/// A box with a picture on it, a lamp, and changes of what is there.
fn edit(client: &Client) {
    let all = nodes(client);
    let of_root = |node: &&NodeInfo| node.depth == 1 && node.mesh.is_some();
    let shown: Vec<_> = all.iter().filter(of_root).map(|node| node.id).collect();
    let [moved, hidden, removed, renamed] = shown[..4] else { panic!("{} nodes", shown.len()) };
    let mut assets = Assets::default();
    let mut png = io::Cursor::new(Vec::new());
    let checks = RgbaImage::from_fn(16, 8, |x, y| {
        image::Rgba([(x * 16) as u8, (y * 32) as u8, 128, if (x + y) % 4 == 0 { 0 } else { 255 }])
    });
    checks.write_to(&mut png, image::ImageFormat::Png).expect("encoded");
    let texture = assets.add_picture(png.into_inner());
    let uv_transform = Affine2::from_scale(Vec2::new(2.0, 3.0));
    let paint = Material {
        name: "paint".into(),
        base_color: Vec4::new(0.9, 0.7, 0.4, 1.0),
        emissive: Vec3::new(0.1, 2.5, 0.3),
        alpha_mode: AlphaMode::Mask(0.5),
        double_sided: true,
        base_color_texture: Some(TextureRef { texture, uv_set: 0, uv_transform }),
        ..Assets::matt()
    };
    let paint = assets.add_material(paint);
    let mesh = assets.add_mesh(MeshData::cuboid(Vec3::splat(30.0)), Some(paint));
    let mut change = Transaction::default().with_assets(assets.to_source().expect("sound"));
    let at = |y| DAffine3::from_translation(DVec3::new(0.1, y, 0.3));
    let crate_ = change.create(NewNode {
        name: "crate \"1\"".into(),
        local: at(40.0) * DAffine3::from_rotation_y(0.7),
        mesh: Some(mesh),
        ..NewNode::default()
    });
    let kind = LightKind::Spot { inner_rad: 0.2, outer_rad: 1.1 };
    let light = Light { kind, color: Vec3::new(1.0, 0.6, 0.2), intensity: 900.0, range: None };
    change.create(NewNode { parent: Some(crate_), light: Some(light), ..NewNode::default() });
    change.set_transform(moved, at(15.25));
    change.set_visible(hidden, false);
    change.remove(removed);
    change.set_name(renamed, "Rathaus – alt");
    change.set_attribute(renamed, "floors", Some(Attribute::Number(4.0)));
    change.set_attribute(renamed, "note", Some(Attribute::Text("{\"a\": \"ü\n\"}".into())));
    change.set_attribute(hidden, "is_open", Some(Attribute::Bool(true)));
    change
        .set_material(0, Material { base_color: Vec4::new(0.9, 0.1, 0.1, 1.0), ..Assets::matt() });
    client.commit(change).expect("edited");
    // What ends with a client is in no file.
    let mut pointer = Transaction::temporary();
    pointer.create(NewNode { name: "pointer".into(), ..NewNode::default() });
    client.commit(pointer).expect("edited");
}

/// A tree as a person reads it, without the numbers of nodes and meshes, which are a file's own.
/// Siblings are in the order of their names, since a file lists roots before what hangs from them.
fn tree(all: &[NodeInfo]) -> Vec<String> {
    let mut paths: Vec<String> = Vec::new();
    let mut lines = Vec::new();
    for node in all {
        let above = node.parent.and_then(|parent| all.iter().position(|of| of.id == parent));
        let path = format!("{}/{}", above.map_or("", |at| paths[at].as_str()), node.name);
        let (visible, light) = (node.visible, &node.light);
        let (is_drawn, attributes) = (node.bounds.is_some(), &node.attributes);
        let world = node.world.to_cols_array().map(f64::to_bits);
        lines.push(format!("{path} {visible} {is_drawn} {light:?} {attributes:?} {world:?}"));
        paths.push(path);
    }
    lines.sort();
    lines
}

#[test]
fn an_export_is_the_edited_scene_node_by_node_and_pixel_by_pixel() {
    let (local, camera) = wall();
    let client = local.client();
    let before = picture(&client, camera);
    edit(&client);
    local.run(&["scene", "save", "evening"]).succeeded();
    let expected = picture(&client, camera);
    assert!(expected != before && color_count(&expected) > 100);
    let mut edited = nodes(&client);
    edited.retain(|node| node.name != "pointer");
    assert!(edited.len() > 50, "{} nodes", edited.len());

    let path = local.place.path("evening.glb").display().to_string();
    let said = local.run(&["scene", "export", &path]).succeeded();
    assert!(said.contains(" nodes, ") && said.lines().count() == 1, "{said}");
    local.run(&["scene", "export", &path]).failed(&["is there already; --force writes over it"]);
    let json = local.run(&["scene", "export", &path, "--force", "--json"]).json();
    let size = std::fs::metadata(&path).expect("there").len();
    assert_eq!((&json["bytes"], &json["nodes"]), (&size.into(), &edited.len().into()));
    // Another reader finds nothing wrong with it.
    let bytes = std::fs::read(&path).expect("read");
    let glb = gltf::Glb::from_slice(&bytes).expect("a GLB");
    let root = gltf::json::Root::from_slice(&glb.json).expect("the schema of glTF");
    let mut faults = Vec::new();
    gltf::json::validation::Validate::validate(
        &root,
        &root,
        gltf::json::Path::new,
        &mut |path, error| faults.push(format!("{}: {error}", path())),
    );
    assert_eq!(faults, [] as [String; 0]);

    for name in ["evening.glb", "saved.glb"] {
        if name == "saved.glb" {
            let path = local.place.path(name).display().to_string();
            local.run(&["scene", "export", &path, "--saved", "evening"]).succeeded();
        }
        client.open_scene(name).expect("opened");
        check(name, &picture(&client, camera), &expected, &IDENTICAL);
        assert_eq!(tree(&nodes(&client)), tree(&edited), "{name}");
    }
    // What was hidden is there, and what was noted can be changed as any edit.
    let hidden = nodes(&client).into_iter().find(|node| !node.visible).expect("hidden");
    let id = hidden.id.0.to_string();
    local.run(&["node", "set", &id, "visible=true", "attribute.is_open=false"]).succeeded();
    assert!(picture(&client, camera) != expected, "it is seen");
    // It may be hung into another scene, hidden nodes and attributes too.
    client.open_scene("town.glb").expect("opened");
    local.run(&["scene", "import", "evening.glb", "name=all"]).succeeded();
    let all = nodes(&client);
    let found: Vec<_> = all.iter().filter(|node| !node.visible).collect();
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].attributes.get("is_open"), Some(&Attribute::Bool(true)));
}

#[test]
fn what_layers_and_switches_leave_out_is_hidden_in_an_export() {
    let (local, camera) = wall();
    let client = local.client();
    let before = picture(&client, camera);
    let all = nodes(&client);
    let of_root = |node: &&NodeInfo| node.depth == 1 && node.mesh.is_some();
    let shown: Vec<_> = all.iter().filter(of_root).map(|node| node.id).collect();
    let [plan, above, below, one, other] = shown[..5] else { panic!("{} nodes", shown.len()) };
    let mut change = Transaction::default();
    let switch = change.create(NewNode { name: "switch".into(), ..NewNode::default() });
    change.set_parent(one, Some(switch));
    change.set_parent(other, Some(switch));
    change.set_switch(switch, Some(other));
    change.set_layer(plan, Some("plan"));
    // What hangs from a node of a hidden layer may be in one that is shown.
    change.set_layer(above, Some("plan"));
    change.set_parent(below, Some(above));
    change.set_layer(below, Some("real"));
    change.set_layer_visible("plan", false);
    client.commit(change).expect("edited");
    let expected = picture(&client, camera);
    assert!(expected != before);
    let path = local.place.path("layers.glb").display().to_string();
    let said = local.run(&["scene", "export", &path]).succeeded();
    for part in ["facing of 4 nodes are not kept", "1 node in hidden layers are left out"] {
        assert!(said.contains(part), "{said}");
    }
    client.open_scene("layers.glb").expect("opened");
    check("layers", &picture(&client, camera), &expected, &IDENTICAL);
}

#[test]
fn what_cannot_be_exported_is_said_and_leaves_no_file() {
    let place = TestDir::new();
    let file = place.write("flag.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT);
    let to = local.place.path("out.glb").display().to_string();
    local.run(&["scene", "export", &to]).failed(&["no scene is open", "out.glb is not written"]);
    local.run(&["open", "flag.glb"]).succeeded();
    local.run(&["scene", "export", "a.gltf"]).failed(&["a.gltf", "ends in .glb"]);
    local.run(&["scene", "export", "none/a.glb"]).failed(&["none", "does not exist"]);
    let saved = ["scene", "export", &to, "--saved", "noon"];
    local.run(&saved).failed(&["no scene is saved as noon"]);
    assert!(!local.place.path("out.glb").exists());
    let names = std::fs::read_dir(&folder).expect("listed");
    let left = names.filter(|of| of.as_ref().is_ok_and(|of| of.file_name().len() < 3));
    assert_eq!(left.count(), 0, "nothing half written");

    /// A disk that is full after some bytes.
    struct Full(usize);
    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let client = local.client();
    let error = client.export_scene(None, &mut Full(10)).expect_err("full");
    assert!(matches!(error, ClientError::Write(_)), "{error}");
    let written = client.export_scene(None, &mut Full(1 << 20)).expect("exported");
    assert_eq!((written.nodes, written.meshes), (1, 1));
}

/// Gives every piece to another thread, and waits until it is taken.
struct Handed(mpsc::SyncSender<usize>);

impl Write for Handed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.send(bytes.len()).map_err(|_| io::ErrorKind::BrokenPipe)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Points in a square, in a file of 36 MB: more than sockets and queues hold of it.
fn many_points() -> Gltf {
    const POINTS: usize = 1_500_000;
    Gltf::triangle().with(|gltf| {
        let mut random = fastrand::Rng::with_seed(1);
        let position = |random: &mut fastrand::Rng| [random.f32(), random.f32(), 0.0];
        let positions: Vec<[f32; 3]> = (0..POINTS).map(|_| position(&mut random)).collect();
        let rows = positions.into_iter().chain(std::iter::repeat_n([0.0, 0.0, 1.0], POINTS));
        gltf.bin = rows.flatten().flat_map(f32::to_le_bytes).collect();
        let view = |at: usize| json!({ "buffer": 0, "byteOffset": at, "byteLength": POINTS * 12 });
        gltf.json["bufferViews"] = json!([view(0), view(POINTS * 12)]);
        let of = |view| {
            json!({ "bufferView": view, "componentType": 5126, "count": POINTS, "type": "VEC3" })
        };
        gltf.json["accessors"] = json!([of(0), of(1)]);
        let attributes = json!({ "POSITION": 0, "NORMAL": 1 });
        gltf.json["meshes"] = json!([{ "primitives": [{ "attributes": attributes, "mode": 0 }] }]);
    })
}

#[test]
fn clients_that_read_slowly_or_go_away_hold_nothing_up() {
    let place = TestDir::new();
    let file = place.write("points.glb", many_points().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(1, 1), &[&folder], ANY_PORT);
    let watcher = local.client();
    watcher.open_scene("points.glb").expect("opened");
    let camera = Camera { position: DVec3::new(0.5, 0.5, 1.5), ..Camera::IDENTITY };
    let expected = picture(&watcher, camera);
    let begin = || {
        let (client, (pieces, taken)) = (local.client(), mpsc::sync_channel(0));
        let work = move || client.export_scene(None, &mut Handed(pieces));
        let work = std::thread::Builder::new().name("export".into()).spawn(work).expect("spawned");
        (work, taken)
    };
    for _ in 0..2 {
        // Two at a time, of which each has begun.
        let begun = [begin(), begin()];
        for (_, taken) in &begun {
            assert!(taken.recv_timeout(wait::LIMIT).expect("a piece") > 0);
        }
        let refused = watcher.export_scene(None, &mut Vec::new()).expect_err("too many");
        assert!(refused.to_string().contains("2 scenes are being exported"), "{refused}");
        // Nobody waits for them: frames and other requests go on.
        check("meanwhile", &picture(&watcher, camera), &expected, &IDENTICAL);
        let [(slow, taken), (gone, dropped)] = begun;
        // One goes away in the middle, the other one reads on.
        drop(dropped);
        let ended = gone.join().expect("a thread").expect_err("gone");
        assert!(matches!(ended, ClientError::Write(_)), "{ended}");
        let rest: usize = taken.iter().sum();
        let written = slow.join().expect("a thread").expect("exported");
        assert!(rest > 1 << 20 && written.bytes > rest as u64, "several pieces");
        wait::until("both places are free", || {
            watcher.export_scene(None, &mut Vec::new()).ok().map(drop)
        });
    }
}
