//! The mouse over windows of a wall: a frame follows it, and what it set is persisted.

use polyptych_protocol::navigation::Navigation;

use super::*;
use polyptych_wall::ChannelCalibration;
use polyptych_wall::camera::Camera;

fn turn(channel: &str) -> ServerMessage {
    let orbit_rad = DVec2::new(0.5, 0.1);
    ServerMessage::Navigate(Navigation { orbit_rad, ..Navigation::none(channel) })
}

/// A wall of two channels that shows a scene, before its camera.
fn with_scene() -> ClusterFixture {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports.pop().expect("an import");
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    stage.prepare_all();
    stage.request(Request::SetCamera(Camera { position: DVec3::Z * 5.0, ..Camera::IDENTITY }));
    stage.order_frame();
    stage.draw(&[0, 1], 1_000);
    stage.clear();
    stage.memories.clear();
    stage
}

#[test]
fn a_paused_wall_draws_one_frame_for_each_move_and_all_channels_see_it() {
    let mut stage = with_scene();
    let before = stage.cluster.presentation.camera;
    stage.say(SessionId(1), turn("c1"));
    stage.wait(1_000);
    let cameras: Vec<_> = stage.frames.iter().map(|(_, frame)| frame.presentation.camera).collect();
    assert_eq!(cameras, [stage.cluster.presentation.camera; 2]);
    assert!(stage.cluster.presentation.camera != before);
    // Two moves while it is drawn make one frame more.
    stage.say(SessionId(1), turn("c1"));
    stage.say(SessionId(0), turn("c0"));
    stage.draw(&[0, 1], 1_000);
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    stage.wait(1_000_000);
    assert_eq!(stage.frames.len(), 4, "two frames for two servers");
    assert_eq!(stage.frames[3].1.presentation.camera, stage.cluster.presentation.camera);
}

#[test]
fn a_camera_that_a_mouse_has_set_is_persisted_once_it_rests() {
    let mut stage = with_scene();
    for _ in 0..10 {
        stage.say(SessionId(0), turn("c0"));
    }
    stage.wait(10_000);
    stage.draw(&[0, 1], 1_000);
    stage.wait(600_000);
    let memory = stage.memories.last().expect("it is persisted").clone();
    assert_eq!(memory.presentation.camera, stage.cluster.presentation.camera);
    assert!(stage.memories.len() <= 2, "{} times", stage.memories.len());
    // Another manager turns about the same scene.
    let mut restored = Cluster::restore(wall(2), Epoch(8), &memory);
    restored.set_navigable(true);
    assert_eq!(restored.presentation.camera, stage.cluster.presentation.camera);
    assert_eq!(restored.navigator.bounds, stage.cluster.navigator.bounds);
}

#[test]
fn feedback_counts_moves_so_that_a_client_can_yield() {
    let mut stage = with_scene();
    stage.say(SessionId(0), turn("c0"));
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    stage.order_frame();
    stage.draw(&[0, 1], 1_000);
    let Some((_, Ok(Response::Frame(feedback)))) = stage.replies.pop() else { panic!("feedback") };
    assert_eq!(feedback.navigations, 1);
}

#[test]
fn moves_that_no_window_of_the_server_can_make_are_ignored() {
    let mut stage = with_scene();
    let before = stage.cluster.presentation.camera;
    let none = Navigation::none("c0");
    for (from, status) in [
        (0, turn("c1")),
        (0, turn("nowhere")),
        (0, ServerMessage::Navigate(Navigation { zoom: f64::NAN, ..none.clone() })),
        (
            0,
            ServerMessage::Navigate(Navigation {
                pan: DVec2::splat(f64::INFINITY),
                ..none.clone()
            }),
        ),
        (0, ServerMessage::Navigate(none)),
        (77, turn("c0")),
    ] {
        stage.say(SessionId(from), status);
    }
    stage.cluster.set_navigable(false);
    stage.say(SessionId(0), turn("c0"));
    stage.wait(100_000);
    assert_eq!((stage.cluster.presentation.camera, stage.frames.len()), (before, 0));
    // Without a scene there is nothing to turn about.
    let mut stage = ClusterFixture::new(1);
    stage.say(SessionId(0), turn("c0"));
    stage.wait(100_000);
    assert_eq!(stage.frames.len(), 0);
}

#[test]
fn a_finger_moves_the_picture_as_it_hangs() {
    use polyptych_wall::{Orientation, StereoPacking};
    let after = |change: &dyn Fn(&mut ChannelCalibration), pan: [f64; 2], orbit_rad: [f64; 2]| {
        let mut stage = with_scene();
        change(&mut stage.cluster.wall.channels[1].adjustment);
        let moved = Navigation {
            pan: DVec2::from(pan),
            orbit_rad: DVec2::from(orbit_rad),
            ..Navigation::none("c1")
        };
        stage.say(SessionId(1), ServerMessage::Navigate(moved));
        stage.cluster.presentation.camera
    };
    let upright = after(&|_| {}, [0.1, 0.2], [0.3, 0.4]);
    // The upper side of the display is at the viewer's left.
    let left = after(&|of| of.turn = Orientation::Left, [-0.2, 0.1], [-0.4, 0.3]);
    let right = after(&|of| of.turn = Orientation::Right, [0.2, -0.1], [0.4, -0.3]);
    let half = after(&|of| of.turn = Orientation::Half, [-0.1, -0.2], [-0.3, -0.4]);
    let mirrored = after(&|of| of.mirror = true, [-0.1, 0.2], [-0.3, 0.4]);
    let packed = after(&|of| of.packing = StereoPacking::SideBySide, [0.05, 0.2], [0.3, 0.4]);
    // The eyes are beside each other on the display, whatever is up to the viewer.
    let on_side = |of: &mut ChannelCalibration| {
        (of.turn, of.packing) = (Orientation::Left, StereoPacking::SideBySide);
    };
    let packed_left = after(&on_side, [-0.1, 0.1], [-0.4, 0.3]);
    assert_eq!([left, right, half, mirrored, packed, packed_left], [upright; 6]);
    assert!(upright != after(&|_| {}, [0.0; 2], [0.0; 2]));
}
