//! Windows as their user meets them: unfolded, following the mouse, and closed.

use std::path::Path;

use polyptych_client::blocking::Client;
use polyptych_client::{Camera, ChannelState, Wall};
use polyptych_wall::unfold::WindowLayout;
use serde_json::Value;

use crate::harness::display::{Display, SIZE};
use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small, start_server_with};
use crate::harness::mouse::{LEFT, RIGHT, Rect, WHEEL_DOWN, WHEEL_UP};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// Three sides of a cube; 400 pixels each, so that they are scaled to a display of 1024.
const CAVE: &str = r#"[wall]
name = "cave"
eye = [0.0, 1.5, 0.0]
[[screen]]
name = "left"
lower_left = [-1.5, 0.0, 1.5]
lower_right = [-1.5, 0.0, -1.5]
upper_left = [-1.5, 3.0, 1.5]
tiles.pixels = [400, 400]
[[screen]]
name = "front"
lower_left = [-1.5, 0.0, -1.5]
lower_right = [1.5, 0.0, -1.5]
upper_left = [-1.5, 3.0, -1.5]
tiles.pixels = [400, 400]
[[screen]]
name = "right"
lower_left = [1.5, 0.0, -1.5]
lower_right = [1.5, 0.0, 1.5]
upper_left = [1.5, 3.0, -1.5]
tiles.pixels = [400, 400]
[[screen]]
name = "floor"
lower_left = [-1.5, 0.0, 1.5]
lower_right = [1.5, 0.0, 1.5]
upper_left = [-1.5, 0.0, -1.5]
tiles.pixels = [400, 400]
"#;

fn simulate(display: &Display, wall: &Wall, arguments: &[&str]) -> Simulation {
    let environment = [("DISPLAY", display.name.as_str())];
    let mut simulation =
        Simulation::start_with(TestDir::new(), wall, town(), arguments, &environment);
    simulation.process.await_line(&["scene town"]);
    simulation
}

fn report(simulation: &Simulation) -> Value {
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

fn camera(client: &Client) -> Camera {
    client.presentation().expect("a sight").camera
}

/// The camera once it is another one than before.
#[track_caller]
fn await_other(client: &Client, before: Camera) -> Camera {
    await_camera(client, "another camera", |now| *now != before)
}

/// The camera once it is as it should be.
#[track_caller]
fn await_camera(client: &Client, what: &str, is_so: impl Fn(&Camera) -> bool) -> Camera {
    wait::until(what, || Some(camera(client)).filter(&is_so))
}

/// The camera when the wall has shown it in two frames in a row.
#[track_caller]
fn await_rest(client: &Client) -> Camera {
    wait::until("a camera at rest", || {
        let (frame, now) = (client.status().expect("status").frame, camera(client));
        wait::until("two more frames", || {
            (client.status().expect("status").frame.0 > frame.0 + 2).then_some(())
        });
        (camera(client) == now).then_some(now)
    })
}

fn center([x, y, width, height]: Rect) -> [i32; 2] {
    [x + width / 2, y + height / 2]
}

#[test]
fn a_cave_in_windows_is_unfolded_and_closing_one_ends_it_with_a_whole_report() {
    let display = Display::start();
    let wall = polyptych_wall_file::parse(CAVE, Path::new("cave.toml")).expect("a wall");
    let mut simulation = simulate(&display, &wall, &["--windows", "--orbit"]);
    let layout = WindowLayout::new(&wall, SIZE.map(u32::from).into());
    let expected = wall.channels.iter().zip(&layout.windows).map(|(channel, window)| {
        let [x, y] = window.origin.as_ivec2().to_array();
        let [width, height] = window.size.as_ivec2().to_array();
        (channel.name.clone(), [x, y, width, height])
    });
    let expected = expected.collect();
    wait::until("windows side by side", || (display.channel_windows() == expected).then_some(()));
    let client = simulation.client();
    let frame = client.status().expect("status").frame;
    // Neither frames nor seconds were given: it goes on.
    wait::until("frames without end", || {
        (client.status().expect("status").frame.0 > frame.0 + 70).then_some(())
    });
    let seen = display.screenshot();
    let at = |name: &str| center(expected[name]).map(|place| place as u32);
    for name in ["left", "front", "right", "floor"] {
        let [x, y] = at(name);
        assert!(seen.get_pixel(x, y).0 != [0, 0, 0, 255], "{name} shows nothing");
    }
    if let Some(folder) = std::env::var_os("POLYPTYCH_KEEP_PICTURES") {
        seen.save(Path::new(&folder).join("cave.png")).expect("saved");
    }
    display.close("polyptych left");
    let said = simulation.process.finish(wait::LIMIT).succeeded();
    assert!(said.contains("pictures and report: "), "{said}");
    simulation.await_no_orphans("after a closed window");
    let report = report(&simulation);
    assert_eq!((&report["ended"], &report["restarts"]), (&"window-closed".into(), &0.into()));
    assert_eq!(report["missing"], Value::Array(Vec::new()), "the closed window's picture too");
    // Frames of the warm-up are not counted.
    assert!(report["frames"].as_u64() > Some(60), "{report}");
    image::open(simulation.place.path("out/wall.png")).expect("a picture");
}

#[test]
fn a_mouse_over_a_simulated_wall_takes_the_camera_over() {
    let display = Display::start();
    let mut simulation = simulate(&display, &small(2, 1), &["--windows", "--orbit"]);
    let client = simulation.client();
    await_states(&client, &[ChannelState::Live]);
    await_other(&client, camera(&client));
    let windows = display.channel_windows();
    let [x, y] = center(windows["front-2-1"]);
    display.drag(LEFT, [x, y], [x + 60, y + 20]);
    // The orbit would go on for ever.
    let turned = await_rest(&client);
    let middle = client.wall().expect("the wall").eye;
    let eye = |of: &Camera| of.world_from_display(middle);
    display.drag(LEFT, [x, y], [x - 100, y]);
    await_camera(&client, "it goes round", |now| eye(now).distance(eye(&turned)) > 0.1);
    let back = await_rest(&client);
    assert!((back.scale - turned.scale).abs() < 1e-9 * turned.scale);

    // A click may count twice: winit 0.30.13 reports buttons that nobody's wheel has pressed when
    // they are pressed and when they are released. The two may come in two messages.
    display.click(WHEEL_UP);
    await_camera(&client, "the scene is larger", |now| now.scale < back.scale);
    display.click(WHEEL_DOWN);
    let is_back = |now: &Camera| (now.scale / back.scale - 1.0).abs() < 1e-9;
    let far = await_camera(&client, "the scene is as large as it was", is_back);

    display.drag(RIGHT, [x, y], [x + 50, y]);
    let moved = await_other(&client, far);
    assert_eq!(moved.rotation, far.rotation);
    assert!(moved.position.distance(far.position) > 0.0);
    display.close("polyptych front-1-1");
    simulation.process.finish(wait::LIMIT).succeeded();
}

/// A manager and a server in windows, each started by hand, with the town open.
fn by_hand(display: &Display, options: &[&str], fullscreen: bool) -> LocalWall {
    let wall = small(1, 1);
    let folder = town().parent().expect("a folder");
    let mut local = LocalWall::manager_with(TestDir::new(), &wall, &[folder], ANY_PORT, options);
    let (name, environment) = ("front", [("DISPLAY", display.name.as_str())]);
    let how = [if fullscreen { "--fullscreen" } else { "--window" }];
    let server = start_server_with(&local.place, &wall, name, &local.address, &how, &environment);
    local.servers.insert(name.to_owned(), server);
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    client.open_scene("town.glb").expect("opened");
    client.render_frame().expect("a frame");
    local
}

#[test]
fn a_paused_wall_follows_the_mouse_and_a_closed_window_ends_its_server() {
    let display = Display::start();
    let mut local = by_hand(&display, &[], false);
    let client = local.client();
    let (before, frame) = (camera(&client), client.status().expect("status").frame);
    let [x, y] = center(display.channel_windows()["front"]);
    display.drag(LEFT, [x, y], [x + 40, y]);
    await_other(&client, before);
    wait::until("a frame that nobody has ordered", || {
        (client.status().expect("status").frame > frame).then_some(())
    });
    display.close("polyptych front");
    let mut server = local.servers.remove("front").expect("a server");
    server.finish(wait::LIMIT).succeeded();
}

#[test]
fn a_mouse_moves_nothing_where_the_manager_does_not_let_it_or_in_full_screen() {
    for (options, fullscreen) in [(&["--navigate=false"][..], false), (&[], true)] {
        let display = Display::start();
        let local = by_hand(&display, options, fullscreen);
        let client = local.client();
        let (before, frame) = (camera(&client), client.status().expect("status").frame);
        let [x, y] = center(display.channel_windows()["front"]);
        display.drag(LEFT, [x, y], [x + 40, y]);
        display.click(WHEEL_UP);
        // What the mouse did would have come before the pictures of a capture.
        for _ in 0..3 {
            client.capture().expect("a picture");
        }
        assert_eq!(camera(&client), before, "{options:?}");
        assert_eq!(client.status().expect("status").frame.0, frame.0 + 3);
    }
}

#[test]
fn the_demo_in_windows_stays_until_one_is_closed() {
    let (display, place) = (Display::start(), TestDir::new());
    let out = place.path("out").display().to_string();
    let mut command = place.command(["demo", "--windows", "--out", &out]);
    command.env("DISPLAY", &display.name);
    let mut demo = crate::harness::process::Process::start("demo", &mut command);
    demo.await_line(&["in windows, until one is closed"]);
    demo.await_line(&["scene harbour"]);
    display.close("polyptych front-2-2");
    demo.finish(wait::LIMIT).succeeded();
}
