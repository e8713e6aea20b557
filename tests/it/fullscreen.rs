//! Servers in windows and in full screen, on X servers that have no window manager.

use std::path::Path;

use image::{Rgba, RgbaImage, imageops};
use polyptych_client::{ChannelState, Wall};

use crate::harness::display::{Display, SIZE};
use crate::harness::local_wall::{
    ANY_PORT, LocalWall, await_states, screen_of, shot, start_server_with, tiled,
};
use crate::harness::pictures::{Difference, IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

const BLACK: Rgba<u8> = Rgba([0, 0, 0, 255]);
/// The colour of the panels that words stand on.
const PANEL: Rgba<u8> = Rgba([18, 22, 28, 255]);
/// Two monitors side by side.
const HALVES: [(&str, [i16; 4]); 2] = [("A", [0, 0, 512, 768]), ("B", [512, 0, 512, 768])];

fn split() -> Display {
    let display = Display::start();
    display.set_monitors(&HALVES);
    display
}

/// Two channels side by side, driven by one server.
fn pair(pixels: [u32; 2]) -> Wall {
    let mut wall = tiled([2, 1], pixels);
    for channel in &mut wall.channels {
        channel.server = "both".into();
    }
    wall.deadline.min_ms = 20_000;
    wall.deadline.max_ms = 20_000;
    wall.heartbeat_ms = 20_000;
    wall
}

fn manager(wall: &Wall) -> LocalWall {
    let scenes: &Path = town().parent().expect("a folder");
    LocalWall::manager(TestDir::new(), wall, &[scenes], ANY_PORT)
}

fn server(
    local: &LocalWall,
    wall: &Wall,
    name: &str,
    display: &Display,
    arguments: &[&str],
) -> Process {
    let environment = [("DISPLAY", display.name.as_str())];
    start_server_with(&local.place, wall, name, &local.address, arguments, &environment)
}

/// The town from its first pose; the channels must be there.
fn picture(local: &LocalWall) -> RgbaImage {
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let picture = screen_of(&shot(&client, poses(&bounds)[0]));
    assert!(color_count(&picture) > 100);
    picture
}

#[track_caller]
fn await_screen(name: &str, display: &Display, expected: &RgbaImage) {
    let is_it = || Difference::of(&display.screenshot(), expected).holds(&IDENTICAL).then_some(());
    if wait::look_for(wait::LIMIT, is_it).is_none() {
        check(name, &display.screenshot(), expected, &IDENTICAL);
    }
}

fn warnings(local: &LocalWall) -> Vec<String> {
    local.client().status().expect("status").warnings
}

#[test]
fn two_channels_of_one_server_fill_two_monitors_without_a_window_manager() {
    let display = split();
    let wall = pair(SIZE.map(u32::from));
    let local = manager(&wall);
    let mut both = server(&local, &wall, "both", &display, &["--fullscreen"]);
    let expected = picture(&local);
    await_screen("fullscreen pair", &display, &expected);
    assert_eq!(warnings(&local), [""; 0]);
    assert!(!display.shows_pointer([100, 700]) && !display.shows_pointer([900, 50]));
    display.close("polyptych front-1-1");
    both.finish(wait::SOON).succeeded();
    assert!(display.shows_pointer([100, 700]), "where no window hides it, it is seen");
}

#[test]
fn servers_of_one_machine_take_different_monitors() {
    let display = split();
    let wall = tiled([2, 1], SIZE.map(u32::from));
    let local = manager(&wall);
    let mut first = server(&local, &wall, "front-1-1", &display, &["--fullscreen"]);
    first.await_line(&["full screen", "monitor=A 512x768 at 0,0"]);
    let mut second = server(&local, &wall, "front-2-1", &display, &["--fullscreen"]);
    second.await_line(&["full screen", "monitor=B 512x768 at 512,0"]);
    let expected = picture(&local);
    await_screen("fullscreen servers", &display, &expected);
    // What a server that was killed has filled is free again.
    first.kill();
    let mut again = server(&local, &wall, "front-1-1", &display, &["--fullscreen"]);
    again.await_line(&["full screen", "monitor=A"]);
}

#[test]
fn channels_fill_the_monitors_that_wall_file_and_command_line_name() {
    let display = split();
    let mut wall = pair(SIZE.map(u32::from));
    wall.channels[0].monitor = Some("B".into());
    let local = manager(&wall);
    let both = server(&local, &wall, "both", &display, &["--fullscreen"]);
    let upright = picture(&local);
    let mut exchanged = upright.clone();
    imageops::replace(&mut exchanged, &upright, 512, 0);
    imageops::replace(
        &mut exchanged,
        &imageops::crop_imm(&upright, 512, 0, 512, 768).to_image(),
        0,
        0,
    );
    await_screen("fullscreen by wall file", &display, &exchanged);
    drop(both);
    local.await_lost(&local.client(), "both");
    let named = ["--fullscreen", "--monitor", "front-1-1=A"];
    let _both = server(&local, &wall, "both", &display, &named);
    await_screen("fullscreen by command", &display, &picture(&local));
}

#[test]
fn wrong_monitors_are_one_line_that_lists_those_that_are_there() {
    let display = split();
    let known = "A 512x768 at 0,0, B 512x768 at 512,0";
    let mut wall = pair(SIZE.map(u32::from));
    wall.channels[1].monitor = Some("HDMI-9".into());
    let local = manager(&wall);
    let wrong = ["--fullscreen", "--monitor", "front-1-1=DP-7"];
    let mut both = server(&local, &wall, "both", &display, &wrong);
    let error = both.finish(wait::LIMIT).failed(&["front-1-1", "no monitor \"DP-7\"", known]);
    assert_eq!(error.lines().count(), 1);

    // That of the wall file is known once the server has it; the manager hears it too.
    let mut both = server(&local, &wall, "both", &display, &["--fullscreen"]);
    both.finish(wait::LIMIT).failed(&["front-2-1", "no monitor \"HDMI-9\"", known]);
    let status = local.run(&["status"]).succeeded();
    assert!(status.contains("no monitor \"HDMI-9\"") && status.contains(known), "{status}");

    let wall = tiled([3, 1], [960, 272]);
    let mut three = wall.clone();
    three.channels.iter_mut().for_each(|channel| channel.server = "three".into());
    let mut server = server(&local, &three, "three", &display, &["--fullscreen"]);
    server.finish(wait::LIMIT).failed(&["no monitor is left for 3 channels", known]);

    let list = |name: &str| {
        let mut command = local.place.command(["server", "--list-monitors"]);
        command.env("DISPLAY", name);
        Process::start("list", &mut command).finish(wait::LIMIT)
    };
    assert_eq!(list(&display.name).succeeded(), known.replace(", B", "\nB"));
    list(":4711").failed(&["there is no X display here"]);
}

#[test]
fn a_picture_of_another_size_is_letterboxed_and_told_until_it_fits() {
    let display = split();
    let wall = pair([480, 272]);
    let local = manager(&wall);
    let mut both = server(&local, &wall, "both", &display, &["--fullscreen"]);
    let expected = picture(&local);
    let warning = |channel: &str, monitor: &str| {
        format!(
            "channel {channel} has 240x272 pixels and its monitor {monitor} 512x768, so that it \
             is scaled: set the monitor to 240x272, or write pixels = [512, 768] for it in the \
             wall file"
        )
    };
    let due = [warning("front-1-1", "A"), warning("front-2-1", "B")];
    wait::until("two warnings", || (warnings(&local) == due).then_some(()));
    both.await_line(&["WARN", &due[0]]);
    let status = local.run(&["status"]).succeeded();
    assert!(status.contains(&format!("warning: {}", due[1])), "{status}");
    // 240×272 on 512×768: 512×580 between bars of 94 pixels.
    let seen = wait::until("a letterboxed picture", || {
        let seen = display.screenshot();
        let colors = color_count(&imageops::crop_imm(&seen, 0, 94, 512, 580).to_image());
        // Idle pictures fill their windows to the edge.
        let is_idle = [0, 1023].iter().any(|x| *seen.get_pixel(*x, 0) != BLACK);
        (colors > 100 && !is_idle).then_some(seen)
    });
    for x in [0, 511, 512, 1023] {
        assert_eq!(*seen.get_pixel(x, 0), BLACK);
        assert_eq!(*seen.get_pixel(x, 93), BLACK);
        assert_ne!(*seen.get_pixel(x, 94), BLACK, "the sky of the town at {x}");
    }
    for monitor in [0, 512] {
        assert_eq!(*seen.get_pixel(monitor, 767), PANEL, "the note in the lower left");
        assert_eq!(*seen.get_pixel(monitor + 511, 767), BLACK);
    }

    // The monitors get the mode that was advised.
    display.set_monitors(&[("A", [0, 0, 240, 272]), ("B", [240, 0, 240, 272])]);
    wait::until("no warning any more", || warnings(&local).is_empty().then_some(()));
    wait::until("the picture as it is", || {
        let seen = imageops::crop_imm(&display.screenshot(), 0, 0, 480, 272).to_image();
        Difference::of(&seen, &expected).holds(&IDENTICAL).then_some(())
    });
    display.set_monitors(&[("A", [0, 0, 240, 272])]);
    wait::until("a monitor that is gone", || {
        let warnings = warnings(&local);
        (warnings.len() == 1 && warnings[0].contains("its monitor B is gone")).then_some(())
    });
    display.set_monitors(&[("A", [0, 0, 240, 272]), ("B", [240, 0, 240, 272])]);
    wait::until("it is back", || warnings(&local).is_empty().then_some(()));
}

#[test]
fn a_window_that_was_resized_is_letterboxed_and_one_that_was_closed_ends_its_server() {
    let display = Display::start();
    let wall = pair([480, 272]);
    let local = manager(&wall);
    let mut both = server(&local, &wall, "both", &display, &["--window"]);
    let expected = picture(&local);
    let part = |x, width| imageops::crop_imm(&display.screenshot(), x, 0, width, 272).to_image();
    wait::until("both windows side by side", || {
        Difference::of(&part(0, 480), &expected).holds(&IDENTICAL).then_some(())
    });
    display.resize("polyptych front-2-1", [440, 272]);
    // Bars of 100 pixels, and between them every pixel as it was drawn.
    let right = imageops::crop_imm(&expected, 240, 0, 240, 272).to_image();
    let mut boxed = RgbaImage::from_pixel(440, 272, BLACK);
    imageops::replace(&mut boxed, &right, 100, 0);
    wait::until("bars at both sides", || {
        Difference::of(&part(240, 440), &boxed).holds(&IDENTICAL).then_some(())
    });
    assert_eq!(warnings(&local), [""; 0], "a window may have any size");

    display.close("polyptych front-1-1");
    both.finish(wait::SOON).succeeded();
    let status = wait::until("both channels lost", || {
        let status = local.client().status().expect("status");
        let is_lost = status.channels.iter().all(|it| it.state == ChannelState::Lost);
        is_lost.then_some(status)
    });
    for channel in status.channels {
        assert_eq!(channel.reason.as_deref(), Some("it left: its window was closed"));
    }
}

#[test]
fn a_server_in_full_screen_keeps_the_screen_from_being_blanked() {
    let display = Display::start();
    let wall = tiled([1, 1], [480, 272]);
    let local = manager(&wall);
    let mut server = server(&local, &wall, "front", &display, &["--fullscreen"]);
    server.await_line(&["full screen"]);
    await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
    display.blank_after(1);
    let since = display.is_blanked().1;
    wait::until("three times as long as that", || {
        let (is_blanked, untouched_ms) = display.is_blanked();
        assert!(!is_blanked, "after {untouched_ms} ms");
        (untouched_ms > since + 3_000).then_some(())
    });
    server.kill();
    wait::until("a screen that is blanked", || display.is_blanked().0.then_some(()));
}
