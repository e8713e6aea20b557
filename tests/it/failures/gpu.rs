//! GPUs that are lost, run out of memory or hang, and what displays show then.

use std::fs;
use std::path::PathBuf;

use image::imageops;
use polyptych_client::blocking::Client;
use polyptych_client::{Capture, ChannelState, WallStatus};

use crate::harness::display::Display;
use crate::harness::local_wall::{
    ANY_PORT, LocalWall, await_states, screen_of, shot, small, start_server_with,
};
use crate::harness::pictures::{Difference, IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

/// A server whose GPU fails when a file says so.
struct Stage {
    local: LocalWall,
    client: Client,
    server: Process,
    file: PathBuf,
}

impl Stage {
    fn start(output: &str, environment: &[(&str, &str)]) -> Self {
        let wall = small(1, 1);
        let folder = town().parent().expect("a folder");
        let local = LocalWall::manager(TestDir::new(), &wall, &[folder], ANY_PORT);
        let client = local.client();
        let file = local.place.path("trouble");
        let name = wall.channels[0].server.as_str();
        let more = [output, "--slow-draw", file.to_str().expect("a name in UTF-8")];
        let server =
            start_server_with(&local.place, &wall, name, &local.address, &more, environment);
        await_states(&client, &[ChannelState::Ready]);
        Self { local, client, server, file }
    }

    /// The GPU fails with the next frame; returns the wall's state once its channel is back.
    fn fail(&mut self, how: &str) -> WallStatus {
        fs::write(&self.file, how).expect("written");
        let feedback = self.client.render_frame().expect("the wall goes on");
        assert_ne!(feedback.channels[0].state, ChannelState::Live, "{how}");
        let status = await_states(&self.client, &[ChannelState::Ready, ChannelState::Live]);
        assert!(!self.server.has_ended(), "{how}: the process stays");
        status
    }

    fn shot(&self, bounds: &polyptych_client::Bounds) -> Capture {
        shot(&self.client, poses(bounds)[2])
    }
}

#[test]
fn a_gpu_that_was_lost_or_hung_shows_the_same_picture_again() {
    let mut stage = Stage::start("--headless", &[]);
    let bounds = stage.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let before = stage.shot(&bounds);
    for how in ["lose", "hang", "lose"] {
        let status = stage.fail(how);
        assert_eq!(status.warnings, Vec::<String>::new(), "{how}");
        assert!(stage.shot(&bounds).screens == before.screens, "another picture after {how:?}");
    }
    let line = stage.server.await_line(&["the GPU is open again", "ms="]);
    assert!(line.contains("INFO"), "{line}");
    // And other scenes are opened on the new device as on any.
    stage.client.close_scene().expect("closed");
    stage.client.open_scene("town.glb").expect("opened");
    assert!(stage.shot(&bounds).screens == before.screens);
    assert_eq!(stage.local.manager.output().matches("server is lost").count(), 0);
}

#[test]
fn a_gpu_without_memory_gets_smaller_textures_and_the_status_says_so() {
    let mut stage = Stage::start("--headless", &[]);
    let bounds = stage.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    stage.shot(&bounds);
    stage.fail("fill");
    let warning = wait::until("a warning", || {
        let status = stage.client.status().expect("a status");
        status.warnings.into_iter().find(|warning| warning.contains("memory"))
    });
    for part in ["textures are shown with 1/2 of", "open a smaller scene"] {
        assert!(warning.contains(part), "{part:?} is not in {warning:?}");
    }
    let after = screen_of(&stage.shot(&bounds));
    assert!(color_count(&after) > 100, "still a town");
}

#[test]
fn a_window_is_drawn_to_again_after_its_gpu_was_lost() {
    let display = Display::start();
    let mut stage = Stage::start("--window", &[("DISPLAY", display.name.as_str())]);
    let bounds = stage.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    stage.shot(&bounds);
    stage.fail("lose");
    let expected = screen_of(&stage.shot(&bounds));
    assert!(color_count(&expected) > 100);
    let seen = || {
        let all = display.screenshot();
        imageops::crop_imm(&all, 0, 0, expected.width(), expected.height()).to_image()
    };
    let settled = || Difference::of(&seen(), &expected).holds(&IDENTICAL).then_some(());
    if wait::look_for(wait::SOON, settled).is_none() {
        check("lost-gpu", &seen(), &expected, &IDENTICAL);
    }
}
