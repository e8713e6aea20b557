//! The camera moves by itself: stored views, tours from a file, and films that lose no frame.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use image::RgbaImage;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::Gltf;
use crate::harness::wait;
use polyptych_client::glam::DVec3;
use polyptych_client::{ChannelState, Pacing, QualityBounds};

/// Frames of a film: enough that a test stops it on its way on a busy machine.
const FRAMES: u32 = 90;

/// A wall of two channels, each with a server, that shows a triangle.
fn wall() -> LocalWall {
    let place = TestDir::new();
    let path = place.write("triangle.glb", Gltf::triangle().glb());
    let folder = path.parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, &small(2, 1), &[&folder], ANY_PORT);
    local.run(&["open", "triangle.glb"]).succeeded();
    local
}

fn stored(local: &LocalWall) -> Value {
    local.run(&["view", "list", "--json"]).json()["stored"].take()
}

/// The pictures of a film, by their numbers.
fn pictures(folder: &Path, screen: &str, frames: u32) -> Vec<RgbaImage> {
    let files = std::fs::read_dir(folder).expect("a folder").count();
    assert_eq!(files, frames as usize, "one file for each frame");
    let open = |frame: u32| {
        let path = folder.join(format!("{screen}-{frame:06}.png"));
        image::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).to_rgba8()
    };
    (0..frames).map(open).collect()
}

#[test]
fn views_are_saved_listed_gone_to_and_removed() {
    let local = wall();
    local.run(&["camera", "look-at", "0,0,3", "0,0,0"]).succeeded();
    local.run(&["view", "save", "near"]).succeeded();
    local.run(&["camera", "look-at", "0,0,9", "0,0,0"]).succeeded();
    local.run(&["view", "save", "far"]).succeeded();
    let list = stored(&local);
    assert_eq!((&list[0]["name"], &list[1]["name"]), (&"far".into(), &"near".into()));
    assert_eq!(list[1]["camera"]["position"], serde_json::json!([0.0, 0.0, 3.0]));
    let client = local.client();
    let z = || client.presentation().expect("a presentation").camera.position.z;
    local.run(&["view", "go", "near"]).succeeded();
    assert_eq!(z(), 3.0);
    // A wall that was paused moves meanwhile, and is paused again.
    local.run(&["view", "go", "far", "--over", "0.2"]).succeeded();
    assert_eq!(z(), 9.0);
    let tour = client.tour().expect("how it stands");
    assert_eq!((tour.tour, tour.pace), (None, None));
    local.run(&["view", "go", "middle"]).failed(&["no stored view middle; there are far, near"]);
    local.run(&["view", "remove", "far"]).succeeded();
    local.run(&["view", "remove", "far"]).failed(&["far", "there are near"]);
    let said = local.run(&["view", "list"]).succeeded();
    assert!(said.contains("stored near: from 0.0000,0.0000,3.0000"), "{said}");
}

#[test]
fn a_camera_on_its_way_stops_where_the_command_is_interrupted() {
    let local = wall();
    local.run(&["camera", "look-at", "0,0,9", "0,0,0"]).succeeded();
    local.run(&["view", "save", "far"]).succeeded();
    local.run(&["camera", "look-at", "0,0,3", "0,0,0"]).succeeded();
    let client = local.client();
    let z = || client.presentation().expect("a presentation").camera.position.z;
    let go = ["view", "go", "far", "--over", "600", "--manager", &local.address];
    for pace in [None, Some(Pacing::Rate(20.0))] {
        if let Some(pace) = pace {
            client.start_rendering(pace).expect("running");
        }
        let begin = z();
        let mut going = local.place.start("view", go);
        wait::until("the camera moves", || (z() > begin).then_some(()));
        going.signal(Signal::INT);
        let ended = going.finish(wait::LIMIT);
        assert_eq!(ended.code(), 130, "{}", ended.output);
        assert!(ended.output.contains("the camera stays on the way"), "{}", ended.output);
        // It stays there, and the wall is paused if it was before.
        let tour = client.tour().expect("how it stands");
        assert_eq!((tour.tour, tour.pace), (None, pace));
        assert!(z() > begin && z() < 9.0, "{}", z());
    }
}

#[test]
fn a_film_of_a_tour_is_the_same_again_whatever_happens_to_a_server() {
    let mut local = wall();
    local.run(&["camera", "look-at", "0,0,3", "0,0,0"]).succeeded();
    local.run(&["view", "save", "near"]).succeeded();
    let tour = r#"{ "stops": [
        { "position": [1, 0.5, 3], "target": [0, 0, 0], "travel": 1 },
        { "view": "near", "travel": 1, "easing": "linear" }
    ] }"#;
    let file = local.place.write("tour.json", tour).display().to_string();
    let said = local.run(&["tour", "play", &file, "--paused"]).succeeded();
    assert!(said.contains("2 stops, 2 s; the wall is paused"), "{said}");
    let screen = local.wall().screens[0].name.clone();
    let film = ["--frames", "90", "--fps", "10", "--json"];
    let out = |name: &str| local.place.path(name);
    let arguments = |name| [&["film", name][..], &film[..]].concat();
    let report = local.run(&arguments("first")).json();
    assert_eq!((&report["written"], &report["redrawn"]), (&FRAMES.into(), &serde_json::json!([])));
    let first = pictures(&out("first"), &screen, FRAMES);
    assert!(first.windows(2).take(20).all(|pair| pair[0] != pair[1]), "the camera moves");
    assert!(first[20..].iter().all(|picture| *picture == first[20]), "and stays at the end");

    // Again, while a server is killed and started again.
    let [second, third] = ["second", "third"].map(out);
    let (mut film, begun) = begin_film(&local, &arguments("second"), &second);
    assert!(begun < FRAMES as usize, "the film is not over yet");
    let client = local.client();
    let server = local.wall().channels[0].server.clone();
    local.servers.get_mut(&server).expect("a server").kill();
    local.await_lost(&client, &server);
    film.signal(Signal::CONT);
    local.start_server(&server);
    let report = film.finish(wait::LIMIT).json();
    assert_eq!(report["written"], FRAMES);
    let redrawn = &report["redrawn"][0];
    assert_eq!(redrawn["missing"][0][0], local.wall().channels[0].name.as_str(), "{report}");
    assert!(pictures(&second, &screen, FRAMES) == first, "the same pictures");
    await_states(&client, &[ChannelState::Live]);

    // And while the manager is, which goes on with the tour.
    let (mut film, begun) = begin_film(&local, &arguments("third"), &third);
    assert!(begun < FRAMES as usize, "the film is not over yet");
    local.manager.kill();
    film.signal(Signal::CONT);
    let wall = local.wall().clone();
    let LocalWall { place, address, servers, .. } = local;
    let scenes = place.path("");
    let mut local = LocalWall::manager(place, &wall, &[&scenes], &address);
    local.servers = servers;
    let report = film.finish(wait::LIMIT).json();
    assert_eq!(report["written"], FRAMES);
    // Nothing is lost between two captures: the next one waits for the manager. Its frame may
    // come before a server is back, and is drawn again.
    for frame in report["redrawn"].as_array().expect("a list") {
        let reason = if frame["lost"].is_null() { &frame["missing"][0][1] } else { &frame["lost"] };
        assert!(reason.is_string(), "{report}");
    }
    assert!(pictures(&third, &screen, FRAMES) == first, "the same pictures");
}

#[test]
fn a_film_that_is_interrupted_leaves_the_wall_at_its_pace() {
    let local = wall();
    let bounds = QualityBounds { error_px: 0.5, rate_fps: Some(30.0) };
    local.client().set_bounds(bounds).expect("bounds");
    let bounds_now = || local.client().presentation().expect("a presentation").bounds;
    let pace = Some(Pacing::Rate(20.0));
    local.client().start_rendering(Pacing::Rate(20.0)).expect("running");
    let arguments = ["film", "cut", "--frames", "1000000", "--fps", "10"];
    let (mut film, _) = begin_film(&local, &arguments, &local.place.path("cut"));
    assert_eq!(local.client().tour().expect("how it stands").pace, None, "the film has paused it");
    assert_eq!(bounds_now(), QualityBounds { rate_fps: None, ..bounds }, "a film takes its time");
    film.signal(Signal::INT);
    film.signal(Signal::CONT);
    film.finish(wait::LIMIT).failed(&["interrupted after", "of 1000000 frames"]);
    assert_eq!(local.client().tour().expect("how it stands").pace, pace);
    assert_eq!(bounds_now(), bounds);
}

#[test]
fn a_film_that_is_interrupted_again_ends_in_the_midst_of_a_frame() {
    const FROM_S: f64 = 1234.5;
    let local = wall();
    let client = local.client();
    // No frame of its own comes in the course of this test but the first one.
    let pace = Pacing::Rate(0.02);
    let before = client.status().expect("a status").frame;
    client.start_rendering(pace).expect("running");
    wait::until("the first frame", || {
        let status = client.status().expect("a status");
        let is_shown = status.channels.iter().all(|channel| channel.frame == status.frame);
        (status.frame > before && is_shown).then_some(())
    });
    // A display that does not draw holds the film's first frame up for longer than this takes.
    let server = local.servers.values().next().expect("a server");
    server.signal(Signal::STOP);
    let from = FROM_S.to_string();
    let film = ["film", "cut", "--frames", "3", "--fps", "10", "--from", &from];
    let mut film = local.place.start("film", [&film[..], &["--manager", &local.address]].concat());
    let time_s = || client.tour().expect("how it stands").time_s;
    wait::until("the film's first frame", || (time_s() == FROM_S).then_some(()));
    assert_eq!(client.tour().expect("how it stands").pace, None, "the film has paused it");
    film.signal(Signal::INT);
    film.await_line(&["interrupted: the film ends after this frame"]);
    assert!(!film.has_ended(), "it waits for its frame");
    film.signal(Signal::INT);
    let ended = film.finish(wait::SOON);
    assert_eq!(ended.code(), 130, "{}", ended.output);
    assert!(ended.output.contains("interrupted again: the film ends at once"), "{}", ended.output);
    assert_eq!(client.tour().expect("how it stands").pace, Some(pace));
    server.signal(Signal::CONT);
}

#[test]
fn settings_are_shown_on_a_paused_wall_at_the_moment_where_it_is() {
    let local = wall();
    local.place.write("cameras.glb", scene_with_cameras().glb());
    local.run(&["open", "cameras.glb"]).succeeded();
    let tour = r#"{ "stops": [{ "position": [0, 0, 90], "target": [0, 0, 0], "travel": 100 }] }"#;
    let file = local.place.write("tour.json", tour).display().to_string();
    local.run(&["tour", "play", &file]).succeeded();
    let client = local.client();
    let clip_s = || client.clips().expect("clips")[0].time_s;
    wait::until("tour and clip go on", || {
        let has_begun = client.tour().expect("a tour").began_s.is_some();
        (has_begun && clip_s() > 0.1).then_some(())
    });
    client.pause().expect("paused");
    let moment = || {
        let tour = client.tour().expect("a tour");
        assert!(tour.tour.is_some() && tour.pace.is_none(), "{tour:?}");
        let camera = client.presentation().expect("a presentation").camera;
        (tour.time_s, camera, client.clips().expect("clips"))
    };
    let paused = moment();
    let mut frame = client.status().expect("a status").frame;
    let settings: [&[&str]; 4] =
        [&["exposure", "1"], &["fog", "50"], &["glow", "0.1"], &["bound", "--error", "1"]];
    for setting in settings {
        local.run(setting).succeeded();
        assert_eq!(moment(), paused, "{setting:?}");
        let drawn = client.status().expect("a status").frame;
        assert!(drawn > frame, "{setting:?}: frame {drawn} after {frame}");
        frame = drawn;
    }
    // Both go on from there.
    client.start_rendering(Pacing::Rate(20.0)).expect("running");
    wait::until("tour and clip go on again", || {
        let camera = client.presentation().expect("a presentation").camera;
        (camera != paused.1 && clip_s() != paused.2[0].time_s).then_some(())
    });
}

/// Begins a film and stops its process after some frames; returns it and how many there are.
fn begin_film(local: &LocalWall, arguments: &[&str], folder: &Path) -> (Process, usize) {
    let film = local.place.start("film", [arguments, &["--manager", &local.address]].concat());
    let files = || std::fs::read_dir(folder).map_or(0, Iterator::count);
    wait::until("some frames", || (files() > 3).then_some(()));
    film.signal(Signal::STOP);
    (film, files())
}

/// A camera on a mast that leans by a quarter turn, and another whose name its node has not.
fn scene_with_cameras() -> Gltf {
    Gltf::triangle().with(|file| {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        file.json["nodes"] = json!([
            { "mesh": 0, "children": [1] },
            { "name": "mast", "translation": [1, 2, 3], "rotation": [0, half, 0, half],
              "scale": [2, 2, 2], "children": [2] },
            { "name": "Bridge", "translation": [0, 0.5, 0], "camera": 0 },
            { "translation": [0, 9, 0], "camera": 1 },
        ]);
        file.json["scenes"] = json!([{ "nodes": [0, 3] }]);
        let times = file.floats("SCALAR", &[0.0, 10.0]);
        let places = file.floats("VEC3", &[1.0, 2.0, 3.0, 11.0, 2.0, 3.0]);
        file.json["animations"] = json!([{
            "samplers": [{ "input": times, "output": places }],
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
        }]);
        file.json["cameras"] = json!([
            { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } },
            { "name": "From above", "type": "orthographic",
              "orthographic": { "xmag": 1, "ymag": 1, "zfar": 9, "znear": 0 } },
        ]);
    })
}

#[test]
fn the_camera_stands_where_a_camera_of_the_file_does_and_moves_with_it() {
    let local = wall();
    local.run(&["camera", "author"]).failed(&["no camera of its own", "look-at"]);
    assert!(local.run(&["camera", "list"]).succeeded().contains("no cameras"));
    local.place.write("cameras.glb", scene_with_cameras().glb());
    assert!(!local.run(&["open", "cameras.glb"]).succeeded().contains("note:"));
    local.run(&["animation", "pause"]).succeeded();
    local.run(&["animation", "seek", "0"]).succeeded();
    let list = local.run(&["camera", "list", "--json"]).json();
    assert_eq!(list[0]["name"], "Bridge");
    assert_eq!(list[0]["position"], json!([1.0, 3.0, 3.0]));
    assert_eq!(list[1]["camera"], "From above: orthographic, 2 units high");
    let client = local.client();
    let eye = client.wall().expect("a wall").eye;
    let stands_at = |position: DVec3, ahead: DVec3| {
        let camera = client.presentation().expect("a presentation").camera;
        let (at, to) = (camera.world_from_display(eye), camera.rotation * DVec3::NEG_Z);
        assert!(at.distance(position) < 1e-9 && to.distance(ahead) < 1e-9, "{at} {to}");
        assert!((camera.scale - 2.5).abs() < 1e-12, "the scale is the user's");
    };
    local.run(&["camera", "look-at", "0,0,9", "0,0,0", "--scale", "2.5"]).succeeded();
    for name in ["Bridge", "2", "mast/Bridge"] {
        local.run(&["camera", "look-at", "0,0,9", "0,0,0", "--scale", "2.5"]).succeeded();
        local.run(&["camera", "author", name]).succeeded();
        // glTF's cameras look along −Z, which a quarter turn about Y makes −X.
        stands_at(DVec3::new(1.0, 3.0, 3.0), DVec3::NEG_X);
    }
    local.run(&["node", "set", "mast", "position=6,2,3"]).succeeded();
    stands_at(DVec3::new(6.0, 3.0, 3.0), DVec3::NEG_X);
    // An animation of the file moves the camera with its node, from where that was put.
    local.run(&["camera", "author", "Bridge"]).succeeded();
    local.run(&["animation", "seek", "5"]).succeeded();
    stands_at(DVec3::new(11.0, 3.0, 3.0), DVec3::NEG_X);
    local.run(&["camera", "author", "From above"]).succeeded();
    stands_at(DVec3::new(0.0, 9.0, 0.0), DVec3::NEG_Z);
    local.run(&["camera", "author"]).failed(&["several cameras", "2 (Bridge)"]);
    local.run(&["camera", "author", "mast"]).failed(&["mast has no camera", "2 (Bridge)"]);
    local.run(&["camera", "author", "stern"]).failed(&["stern", "no such node", "2 (Bridge)"]);
}

#[test]
fn the_camera_follows_a_node_and_walks_over_the_ground_up_to_a_wall() {
    let local = wall();
    let made = |words: &[&str]| local.run(&[&["node", "add"], words].concat()).succeeded();
    made(&["name=ground", "mesh=box:40,1,40", "position=0,-0.5,0"]);
    made(&["name=step", "mesh=box:4,0.6,4", "position=0,0,10"]);
    made(&["name=gate", "mesh=box:9,9,1", "position=0,4,-9.5"]);
    made(&["name=boat", "mesh=box:1,1,1", "position=12,1,0"]);
    let client = local.client();
    let camera = || client.presentation().expect("a presentation").camera;
    let eye = client.wall().expect("a wall").eye;
    let seen_from = || camera().world_from_display(eye);
    local.run(&["camera", "follow", "boat", "--from", "0,2,6"]).succeeded();
    assert!(seen_from().distance(DVec3::new(12.0, 3.0, 6.0)) < 1e-9, "{}", seen_from());
    local.run(&["node", "set", "boat", "position=12,1,-5"]).succeeded();
    assert!(seen_from().distance(DVec3::new(12.0, 3.0, 1.0)) < 1e-9, "{}", seen_from());
    local.run(&["camera", "stay"]).succeeded();
    local.run(&["node", "set", "boat", "position=12,1,0"]).succeeded();
    assert!(seen_from().distance(DVec3::new(12.0, 3.0, 1.0)) < 1e-9, "it stays");

    // The triangle of the file stands in the way, unless it is hidden.
    local.run(&["node", "set", "0", "visible=false"]).succeeded();
    local.run(&["camera", "look-at", "0,3,12", "0,1,-9"]).succeeded();
    let walk = ["camera", "walk", "0,0,-15", "--speed", "100", "--json"];
    let said = local.run(&walk).json();
    assert!(said["end"].as_str().is_some_and(|end| end.contains("(gate)")), "{said}");
    wait::until("the end of the way", || {
        client.tour().expect("a tour").tour.is_none().then_some(())
    });
    assert!(seen_from().distance(DVec3::new(0.0, 1.7, -8.7)) < 0.02, "{}", seen_from());
    let blocked = local.run(&["camera", "walk", "0,0,-15"]);
    blocked.failed(&["cannot go there", "(gate)"]);
    local.run(&["camera", "follow", "ship"]).failed(&["ship", "no such node"]);
    local.run(&["camera", "follow", "999"]).failed(&["there is no node 999"]);
}

#[test]
fn files_and_films_that_cannot_be_are_refused_by_name() {
    let local = wall();
    let bad = |text: &str, parts: &[&str]| {
        let file = local.place.write("bad.json", text).display().to_string();
        local.run(&["tour", "play", &file]).failed(&[&["bad.json"], parts].concat());
    };
    let stop = |stop: &str, parts: &[&str]| bad(&format!(r#"{{ "stops": [{stop}] }}"#), parts);
    stop(r#"{ "view": "quay", "travel": 1 }"#, &["stop 0", "no stored view quay"]);
    stop("", &["1 to 4096 stops, not 0"]);
    let back = r#"{ "position": [0, 0, 1], "target": [0, 0, 0], "travel": -1 }"#;
    stop(back, &["stop 0", "from 0 to 86400, not -1"]);
    bad("{}", &["not a tour"]);
    let film = |out: &str, path: &Path| {
        let arguments = ["film", out, "--frames", "3", "--fps", "30", "--manager", &local.address];
        let mut command = local.place.command(arguments);
        Process::start("film", command.env("PATH", path)).finish(wait::LIMIT)
    };
    let empty = local.place.path("nothing");
    film("film.avi", &empty).failed(&["film.avi", ".mp4, .mkv, .webm"]);
    film("film.mp4", &empty).failed(&["ffmpeg is not installed", "name a folder"]);
    // One that keeps what it is sent.
    let script = "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\nfor last; do :; done\n\
                  exec /bin/cat > \"${last#file:}\"\n";
    let encoder = local.place.write("tools/ffmpeg", script);
    std::fs::set_permissions(&encoder, Permissions::from_mode(0o700)).expect("a program");
    film("film.mp4", encoder.parent().expect("a folder")).succeeded();
    let bytes = std::fs::metadata(local.place.path("film.mp4")).expect("a film").len();
    let canvas = local.wall().screens[0].canvas;
    assert_eq!(bytes, 3 * 4 * u64::from(canvas.x) * u64::from(canvas.y), "three raw frames");
    let said = local.run(&["tour", "stop", "--pause"]).succeeded();
    assert!(said.starts_with("shown at frame"), "{said}");
}
