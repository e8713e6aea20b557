//! Animations on walls of processes: skins, morph targets, nodes and lamps that move are the same
//! on all displays at every time, and are played by request.

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DQuat, DVec3};
use polyptych_client::{Camera, ClipAction, NodeId, Transaction};
use serde_json::{Value, json};

use crate::harness::local_wall::{ANY_PORT, LocalWall, patient, screen_of, small};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.6, 2.2), ..Camera::IDENTITY };

/// Times whose pictures differ, in seconds.
const TIMES: [f64; 4] = [0.0, 0.4, 1.1, 1.9];

/// A glTF whose buffer grows.
struct Moving(Gltf);

impl Moving {
    /// A strip of 8 squares that stands on the first of two joints; returns its attributes and
    /// indices.
    fn strip(&mut self) -> Value {
        let rows = || (0..9u8).flat_map(|row| [(row, -0.15f32), (row, 0.15)]);
        let positions: Vec<f32> =
            rows().flat_map(|(row, x)| [x, f32::from(row) / 8.0, 0.0]).collect();
        let joints: Vec<u8> = rows().flat_map(|_| [0, 1, 0, 0]).collect();
        let weights: Vec<f32> = rows()
            .flat_map(|(row, _)| {
                let upper = f32::from(row) / 8.0;
                [1.0 - upper, upper, 0.0, 0.0]
            })
            .collect();
        let square = |row: u16| {
            let at = 2 * row;
            [at, at + 1, at + 2, at + 2, at + 1, at + 3]
        };
        let indices: Vec<u8> = (0..8).flat_map(square).flat_map(u16::to_le_bytes).collect();
        let positions = self.0.floats("VEC3", &positions);
        let joints = self.0.accessor("VEC4", 5121, 18, &joints);
        let weights = self.0.floats("VEC4", &weights);
        let indices = self.0.accessor("SCALAR", 5123, 48, &indices);
        let attributes = json!({ "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights });
        json!({ "attributes": attributes, "indices": indices, "material": 0 })
    }

    /// A channel of the last clip, with its sampler.
    fn channel(&mut self, node: usize, path: &str, times: &[f32], values: &[f32]) {
        let kind = match path {
            "rotation" => "VEC4",
            "weights" => "SCALAR",
            _ => "VEC3",
        };
        let (input, output) = (self.0.floats("SCALAR", times), self.0.floats(kind, values));
        let target = json!({ "node": node, "path": path });
        self.add(&target, json!({ "input": input, "output": output }));
    }

    /// A channel of the last clip that changes what a pointer names, from one value to the next.
    fn pointer(&mut self, pointer: &str, kind: &str, times: &[f32], values: &[f32]) {
        let (input, output) = (self.0.floats("SCALAR", times), self.0.floats(kind, values));
        let is_switch = pointer.ends_with("/visible");
        let interpolation = if is_switch { "STEP" } else { "LINEAR" };
        let target = json!({ "path": "pointer",
            "extensions": { "KHR_animation_pointer": { "pointer": pointer } } });
        let sampler = json!({ "input": input, "output": output, "interpolation": interpolation });
        self.add(&target, sampler);
    }

    fn add(&mut self, target: &Value, sampler: Value) {
        let clips = self.0.json["animations"].as_array_mut().expect("a list");
        let clip = clips.last_mut().expect("a clip");
        let samplers = clip["samplers"].as_array_mut().expect("a list");
        samplers.push(sampler);
        let sampler = samplers.len() - 1;
        let channels = clip["channels"].as_array_mut().expect("a list");
        channels.push(json!({ "sampler": sampler, "target": target }));
    }

    fn clip(&mut self, name: &str) {
        let clips = self.0.json["animations"].as_array_mut().expect("a list");
        clips.push(json!({ "name": name, "channels": [], "samplers": [] }));
    }
}

/// A strip that bows, a triangle that turns, grows a corner and is hidden at last, and a lamp that
/// goes to and fro and fades while both begin to glow, of 2 s; and a second motion of the strip.
fn scene() -> Gltf {
    let mut scene = Moving(Gltf::triangle());
    scene.0.json["animations"] = json!([]);
    scene.0.json["materials"] = json!([{ "doubleSided": true,
        "pbrMetallicRoughness": { "baseColorFactor": [0.9, 0.5, 0.1, 1], "metallicFactor": 0 } }]);
    let strip = scene.strip();
    let raised = scene.0.floats("VEC3", &[0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let meshes = scene.0.json["meshes"].as_array_mut().expect("a list");
    meshes[0]["primitives"][0]["targets"] = json!([{ "POSITION": raised }]);
    meshes[0]["primitives"][0]["material"] = json!(0);
    meshes.push(json!({ "primitives": [strip] }));
    scene.0.json["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_animation_pointer"]);
    scene.0.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "intensity": 6 } ] } });
    scene.0.json["nodes"] = json!([
        { "name": "triangle", "mesh": 0, "translation": [0.5, 0.1, 0.0] },
        { "name": "strip", "mesh": 1, "skin": 0 },
        { "name": "figure", "translation": [-0.5, 0.0, 0.0], "children": [3] },
        { "name": "lower", "children": [4] },
        { "name": "upper", "translation": [0.0, 0.5, 0.0] },
        { "name": "lamp", "translation": [-1.0, 0.8, 1.0],
          "extensions": { "KHR_lights_punctual": { "light": 0 } } },
    ]);
    scene.0.json["scenes"] = json!([{ "nodes": [0, 1, 2, 5] }]);
    let down =
        |y: f32| [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, y, 0.0, 1.0];
    let binds: Vec<u8> =
        [down(0.0), down(-0.5)].concat().iter().flat_map(|number| number.to_le_bytes()).collect();
    let binds = scene.0.accessor("MAT4", 5126, 2, &binds);
    scene.0.json["skins"] = json!([{ "joints": [3, 4], "inverseBindMatrices": binds }]);
    let turned = |angle: f32| [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()];
    scene.clip("bow");
    let bow = [turned(0.0), turned(-1.2), turned(0.3)].concat();
    scene.channel(4, "rotation", &[0.0, 1.0, 2.0], &bow);
    let spin = [turned(0.0), turned(1.5), turned(3.0)].concat();
    scene.channel(0, "rotation", &[0.0, 1.0, 2.0], &spin);
    scene.channel(0, "weights", &[0.0, 2.0], &[0.0, 1.0]);
    scene.channel(5, "translation", &[0.0, 2.0], &[-1.0, 0.8, 1.0, 1.0, 0.8, 1.0]);
    scene.pointer(
        "/materials/0/emissiveFactor",
        "VEC3",
        &[0.0, 2.0],
        &[0.0, 0.0, 0.0, 0.2, 0.0, 0.4],
    );
    let lamp = "/extensions/KHR_lights_punctual/lights/0/intensity";
    scene.pointer(lamp, "SCALAR", &[0.0, 2.0], &[6.0, 2.0]);
    let triangle = "/nodes/0/extensions/KHR_node_visibility/visible";
    scene.pointer(triangle, "SCALAR", &[0.0, 1.5], &[1.0, 0.0]);
    scene.clip("jump");
    scene.channel(
        3,
        "translation",
        &[0.0, 0.5, 1.0],
        &[0.0, 0.0, 0.0, 0.0, 0.4, 0.0, 0.0, 0.0, 0.0],
    );
    scene.channel(4, "rotation", &[0.0], &turned(0.0));
    scene.0
}

/// A wall of so many tiles that shows the scene.
fn wall(columns: u32, rows: u32) -> LocalWall {
    let place = TestDir::new();
    let file = place.write("scenes/moving.glb", scene().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &patient(small(columns, rows)), &[&folder], ANY_PORT);
    let client = local.client();
    let opened = client.open_scene("moving.glb").expect("opened");
    assert_eq!(opened.notes, [] as [String; 0]);
    let clips: Vec<_> = opened.clips.iter().map(|of| (of.name.as_str(), of.is_played)).collect();
    assert_eq!(clips, [("bow", true), ("jump", false)]);
    client.set_camera(VIEW).expect("set");
    local
}

/// The picture at a scene time, all channels being there.
#[track_caller]
fn at(client: &Client, time_s: f64) -> RgbaImage {
    let capture = client.capture_at(Some(time_s)).expect("captured");
    assert_eq!(capture.missing, [], "channels that sent no picture");
    screen_of(&capture)
}

#[test]
fn tiles_show_every_moment_as_one_display_does_and_again_to_the_byte() {
    let [tiled, single] = [wall(2, 2), wall(1, 1)].map(|local| (local.client(), local));
    let pictures = TIMES.map(|time_s| {
        let whole = at(&single.0, time_s);
        check(&format!("tiles at {time_s} s"), &at(&tiled.0, time_s), &whole, &SEAMS);
        whole
    });
    for (index, picture) in pictures.iter().enumerate() {
        assert!(!pictures[..index].contains(picture), "nothing moved up to {} s", TIMES[index]);
    }
    for (time_s, before) in TIMES.iter().zip(&pictures).rev() {
        check(&format!("again at {time_s} s"), &at(&single.0, *time_s), before, &IDENTICAL);
    }
}

#[test]
fn a_server_that_joins_late_shows_the_moment_that_the_others_show() {
    let mut local = wall(2, 1);
    let client = local.client();
    let before = at(&client, TIMES[2]);
    let name = local.wall().channels[1].server.clone();
    local.servers.remove(&name).expect("a server").kill();
    local.await_lost(&client, &name);
    client.render_frame_at(None, Some(TIMES[1])).expect("drawn by the other");
    local.start_server(&name);
    let live = [polyptych_client::ChannelState::Ready, polyptych_client::ChannelState::Live];
    crate::harness::local_wall::await_states(&client, &live);
    check("after the restart", &at(&client, TIMES[2]), &before, &IDENTICAL);
}

#[test]
fn animations_are_played_held_and_put_to_a_time_by_the_command() {
    let local = wall(1, 1);
    let client = local.client();
    let listed = || local.run(&["animation", "list", "--json"]).json();
    assert_eq!(listed()[0]["clip"]["duration_s"], 2.0);
    let bow = at(&client, 0.4);
    local.run(&["animation", "pause"]).succeeded();
    local.run(&["animation", "seek", "0.4"]).succeeded();
    check("held", &at(&client, 7.0), &bow, &IDENTICAL);
    local.run(&["animation", "play", "jump", "--paused"]).succeeded();
    local.run(&["animation", "seek", "0.5", "1"]).succeeded();
    local.run(&["animation", "pause", "jump"]).succeeded();
    let jump = at(&client, 0.0);
    assert!(jump != bow);
    let text = local.run(&["animation", "list"]).succeeded();
    assert_eq!(text, "0 bow: 2.00 s, not played\n1 jump: 1.00 s, held at 0.50 s");
    local.run(&["animation", "play", "hop"]).failed(&["hop", "0 (bow), 1 (jump)"]);
    local.run(&["animation", "play", "bow", "--weight", "3"]).failed(&["0 to 1", "3"]);
    // What is edited while it is played moves from where it was put, and goes when it is removed.
    client.change_clips(Some("bow"), ClipAction::Seek(0.0)).expect("put");
    local.run(&["node", "remove", "/figure"]).succeeded();
    assert!(at(&client, 0.0) != jump);
    // A wall that is paused runs from now on; frames come by themselves.
    local.run(&["animation", "play", "bow"]).succeeded();
    let time = || listed()[0]["time_s"].as_f64().expect("a number");
    let start = time();
    let goes_on = || ((time() - start).abs() > 0.01).then_some(());
    wait::until("the clip goes on", goes_on);
    local.run(&["open", "moving.glb"]).succeeded();
    assert_eq!(listed()[0]["speed"], 1.0, "another scene begins with its own");
}

#[test]
fn a_joint_that_an_edit_turns_bends_what_follows_it_where_no_clip_does() {
    let place = TestDir::new();
    let still = |name: &str, rotation: [f64; 4]| {
        let file = scene().with(|file| {
            file.json["animations"] = json!([]);
            file.json["nodes"][4]["rotation"] = json!(rotation);
        });
        place.write(&format!("scenes/{name}.glb"), file.glb())
    };
    still("straight", [0.0, 0.0, 0.0, 1.0]);
    let file = still("bowed", [0.0, 0.0, 0.6, 0.8]);
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &patient(small(1, 1)), &[&folder], ANY_PORT);
    let client = local.client();
    let open = |file: &str| {
        client.open_scene(file).expect("opened");
        client.set_camera(VIEW).expect("set");
        at(&client, 0.0)
    };
    let (bowed, straight) = (open("bowed.glb"), open("straight.glb"));
    assert!(straight != bowed, "the joint bends the strip at rest");
    let turn = DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8);
    let turned = DAffine3::from_rotation_translation(turn, DVec3::new(0.0, 0.5, 0.0));
    let mut transaction = Transaction::default();
    transaction.set_transform(NodeId(4), turned);
    client.commit(transaction).expect("edited");
    check("turned", &at(&client, 0.0), &bowed, &SEAMS);
}

#[test]
fn a_simulation_begins_at_a_time_and_goes_on_in_steps() {
    let run = |arguments: &[&str]| {
        let place = TestDir::new();
        let file = place.write("moving.glb", scene().glb());
        let mut simulation = Simulation::start(place, &small(1, 1), &file, arguments);
        simulation.process.finish(wait::LIMIT).succeeded();
        read(&simulation.place.path("out/wall.png"))
    };
    let stepped = run(&["--frames", "5", "--fps", "10"]);
    check("fifth step", &run(&["--frames", "1", "--time", "0.4"]), &stepped, &IDENTICAL);
    assert!(run(&["--frames", "1"]) != stepped);
    let refused = TestDir::new().run(["simulate", "none.toml", "--time=-1"]);
    assert!(refused.code() == 2 && refused.output.contains("0 to"), "{}", refused.output);
}
