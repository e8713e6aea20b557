//! One program drives one channel and four, blocking or async, and gets the outcome of every frame.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use polyptych_client::glam::{DQuat, DVec3};
use polyptych_client::{Camera, Client, FrameFeedback, Pacing};

use crate::harness::local_wall::{LocalWall, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count};
use crate::harness::process::Process;
use crate::harness::scenes::{Gltf, poses, town};
use crate::harness::wait;

fn start(columns: u32, rows: u32) -> LocalWall {
    LocalWall::start(&small(columns, rows), &[town().parent().expect("a folder")])
}

/// The program of `hello_wall.rs`; gives the picture.
fn hello(local: &LocalWall) -> image::RgbaImage {
    let wall = local.client();
    let scene = wall.open_scene("town.glb").expect("opened");
    let bounds = scene.bounds.expect("something to see");
    wall.set_camera(poses(&bounds)[4]).expect("moved");
    let drawn = wall.render_frame().expect("drawn");
    assert_eq!(drawn.channels.len(), wall.wall().expect("a wall").channels.len());
    assert!(drawn.channels.iter().all(|channel| channel.draw_us.is_some()), "{drawn:?}");
    screen_of(&wall.capture().expect("a picture"))
}

#[test]
fn one_program_drives_one_channel_and_four() {
    let [one, four] = [start(1, 1), start(2, 2)];
    let [a, b] = [&one, &four].map(hello);
    assert!(color_count(&a) > 100, "there is something to see");
    check("hello", &b, &a, &SEAMS);
}

#[test]
fn async_and_blocking_clients_show_the_same() {
    let local = start(2, 1);
    let blocking = local.client();
    let bounds = blocking.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let far = bounds.center() + DVec3::new(0.1, 0.2, 0.3) * bounds.radius();
    let camera = Camera::look_at(far, bounds.center(), DVec3::Y);
    let expected = shot(&blocking, camera);
    // Elsewhere, so that the same picture can't just be left over.
    shot(&blocking, Camera { rotation: DQuat::IDENTITY, ..camera });
    let options = local.connect_options();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.expect("a runtime");
    let (capture, status) = runtime.block_on(async {
        let client = Client::connect_with(options).await.expect("connected");
        client.look_at(far, bounds.center(), DVec3::Y).await.expect("moved");
        let capture = client.capture().await.expect("a picture");
        (capture, client.status().await.expect("a status"))
    });
    check("async", &screen_of(&capture), &screen_of(&expected), &IDENTICAL);
    assert_eq!(status.clients.len(), 2, "{:?}", status.clients);
    let of_blocking = blocking.status().expect("a status");
    assert_eq!((status.revision, status.digest), (of_blocking.revision, of_blocking.digest));
}

#[test]
fn feedback_comes_for_every_frame_in_order() {
    let local = start(2, 1);
    let client = local.client();
    client.open_scene("town.glb").expect("opened");
    let mut feedbacks = client.feedback().expect("a stream");
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    let some: Vec<FrameFeedback> =
        wait::within("feedback", move || feedbacks.by_ref().take(30).collect());
    client.pause().expect("paused");
    for pair in some.windows(2) {
        assert_eq!(pair[1].frame.0, pair[0].frame.0 + 1, "no frame is left out");
        assert!(pair[1].time_s > pair[0].time_s, "{pair:?}");
    }
    assert!(some.iter().all(|feedback| feedback.channels.len() == 2 && feedback.frame_us > 0));
    // A frame that is asked for goes on from there, and carries the time that it is given.
    let asked = client.render_frame_at(None, Some(7.5)).expect("drawn");
    assert!(asked.frame > some[29].frame && asked.time_s == 7.5, "{asked:?}");
}

/// An example beside this test's own program, as cargo builds it.
fn example(name: &str) -> PathBuf {
    let own = std::env::current_exe().expect("this program has a file");
    let target = own.ancestors().nth(2).expect("a folder of programs");
    let path = target.join("examples").join(name);
    assert!(path.is_file(), "no example {name}: cargo build --workspace --examples builds it");
    path
}

fn run_example(local: &LocalWall, path: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(path);
    command.args(arguments).env("POLYPTYCH_TOKEN_FILE", local.place.token_file());
    Process::start("example", &mut command).finish(wait::LIMIT).succeeded()
}

/// A triangle that stands high over the town, at this z.
fn gable(z: f64) -> Gltf {
    Gltf::triangle().with(|gltf| {
        let corners = [[0.0f32, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 2.0, 0.0]];
        let bytes: Vec<u8> = corners.iter().flatten().flat_map(|at| at.to_le_bytes()).collect();
        gltf.bin[..bytes.len()].copy_from_slice(&bytes);
        let place = serde_json::json!([0.0, 200.0, z]);
        gltf.json["nodes"] = serde_json::json!([
            { "name": "gable", "mesh": 0, "translation": place, "scale": [50, 50, 50] },
        ]);
    })
}

#[test]
fn the_examples_run() {
    let local = start(2, 1);
    let said = run_example(&local, &example("hello_wall"), &["town.glb", &local.address]);
    assert!(said.contains("town: frame") && said.contains("on 2 of 2 channels"), "{said}");
    let said = run_example(&local, &example("orbit"), &["town.glb", "1", "20", &local.address]);
    assert!(said.contains("slowest") && said.contains("median frame"), "{said}");
    let sail = ["town.glb", "boat", "1", &local.address];
    let said = run_example(&local, &example("sail"), &sail);
    assert!(said.contains("transactions, "), "{said}");
    let said = run_example(&local, &example("clock"), &["town.glb", "1", &local.address]);
    assert!(said.contains("9 nodes were made, and moved "), "{said}");
    let tour = ["town.glb", &local.address];
    let said = run_example(&local, &example("guided_tour"), &tour);
    assert!(said.lines().count() == 5 && said.contains(" at 8.00 s from ["), "{said}");
    for (name, z) in [("plan-a.glb", 0.0), ("plan-b.glb", -10.0)] {
        std::fs::write(town().with_file_name(name), gable(z).glb()).expect("written");
    }
    let plans = ["town.glb", "plan-a.glb", "plan-b.glb", &local.address];
    let said = run_example(&local, &example("plan_comparison"), &plans);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), 4, "{said}");
    assert!(
        lines[0].starts_with("plan a: node ") && lines[1].starts_with("plan b: node "),
        "{said}"
    );
    assert!(lines[0].contains(" gable, ") && lines[2].starts_with("there they are 1"), "{said}");
    // From the same pixel it is further away than from plane to plane.
    assert_eq!(lines[3], "plan b comes as near as 10.000 to what plan a shows there");
}

/// Packages that a program adds with the client library: more would be felt in every build of it.
const CLIENT_PACKAGES_MAX: usize = 50;

#[test]
fn a_client_program_pulls_in_few_packages() {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--package", "polyptych-client"])
        .args(["--edges", "normal", "--prefix", "none", "--no-dedupe"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo");
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let said = String::from_utf8(tree.stdout).expect("text");
    let packages: BTreeSet<&str> = said.lines().collect();
    let own = packages.iter().any(|package| package.starts_with("polyptych-client "));
    assert!(own && packages.len() <= CLIENT_PACKAGES_MAX, "{}: {packages:#?}", packages.len());
}
