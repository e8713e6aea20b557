//! Remembered states that meet a changed wall.

use glam::{DVec2, DVec3};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::presentation::Presentation;
use polyptych_wall::camera::Camera;
use polyptych_wall::{ChannelCalibration, EYE_SEPARATION_DEFAULT_M};

use super::*;

const WALL: &str = r#"
    [wall]
    name = "w"
    [[screen]]
    name = "front"
    size = [4.0, 1.0]
    center = [0.0, 0.0, -2.0]
    [screen.tiles]
    columns = 2
    pixels = [100, 50]
    [[screen]]
    name = "floor"
    size = [4.0, 4.0]
    center = [0.0, -0.5, 0.0]
    rotation = [0, -90, 0]
    [screen.tiles]
    pixels = [100, 100]
"#;

fn parsed(text: &str) -> Wall {
    polyptych_wall_file::parse(text, "w.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

fn view(screen: u16, rect: [u32; 4]) -> View {
    View { area: Area::Screen { screen, rect }, ..View::of_wall(Camera::IDENTITY) }
}

/// The state of [`WALL`] with a view on each screen and a tuned channel.
fn saved() -> Saved {
    let wall = parsed(WALL);
    let mut tuned = ChannelCalibration::default();
    tuned.pin[0] = DVec2::ONE;
    let memory = PersistentState {
        revision: Revision(7),
        presentation: Presentation {
            camera: Camera { scale: 2.0, ..Camera::IDENTITY },
            views: vec![view(0, [0, 0, 50, 50]), view(1, [0, 0, 100, 100])],
            output_mode: OutputMode::Blank,
            ..Presentation::new(wall.head())
        },
        tunings: vec![("floor".to_owned(), tuned)],
        ..PersistentState::of_wall(&wall)
    };
    Saved { wall: wall.without_paths(), memory }
}

fn after(text: &str) -> Reconciled {
    reconcile(saved(), &parsed(text))
}

#[test]
fn the_same_wall_has_the_same_state() {
    let same = after(WALL);
    assert_eq!(same.memory, saved().memory);
    assert!(!same.has_changed() && !same.has_dropped(), "{same:?}");
}

#[test]
fn an_edited_eye_moves_a_head_that_stood_there_and_no_other() {
    let edited = WALL.replace("name = \"w\"", "name = \"w\"\neye = [0.0, 0.25, 0.0]");
    let new = after(&edited);
    assert_eq!(new.memory.presentation.head.position, DVec3::Y * 0.25);
    assert_eq!(new.memory.presentation.views, saved().memory.presentation.views);
    assert_eq!(new.memory.tunings, saved().memory.tunings);
    assert_eq!((new.changes.len(), new.changes[0].key.as_str()), (1, "wall.eye"));
    assert_eq!(new.memory.revision, Revision(8), "another state, another number");
    assert!(!new.has_dropped(), "{new:?}");

    let mut moved = saved();
    moved.memory.presentation.head.position = DVec3::X * 0.5;
    let new = reconcile(moved, &parsed(&edited));
    assert_eq!(
        new.memory.presentation.head,
        HeadPose::facing_forward(DVec3::X * 0.5, EYE_SEPARATION_DEFAULT_M)
    );
}

#[test]
fn a_view_follows_its_screen_and_is_dropped_with_it() {
    let at = WALL.rfind("[[screen]]").expect("two screens");
    let (front, floor) = WALL.split_at(at);
    let head = "[wall]\n    name = \"w\"\n";
    let swapped = [head, floor, &front.replace(head.trim_start(), "")].concat();
    let new = after(&swapped.replacen("    [wall]\n    name = \"w\"\n", "", 1));
    let screens: Vec<_> = new.memory.presentation.views.iter().map(|view| view.area).collect();
    let area = |screen, rect| Area::Screen { screen, rect };
    assert_eq!(screens, [area(1, [0, 0, 50, 50]), area(0, [0, 0, 100, 100])]);

    let new = after(front);
    assert_eq!(new.memory.presentation.views, [view(0, [0, 0, 50, 50])]);
    let [(what, reason)] = &new.dropped[..] else { panic!("{:?}", new.dropped) };
    assert_eq!(what, "view 2");
    assert!(reason.contains("no screen floor"), "{reason}");
    assert_eq!(new.tunings.dropped.len(), 1, "and its channel's tuning");
    assert_eq!(new.memory.presentation.camera, saved().memory.presentation.camera);
}

#[test]
fn a_view_beyond_the_canvas_and_a_head_behind_a_screen_are_dropped() {
    let new = after(&WALL.replace("pixels = [100, 100]", "pixels = [80, 80]"));
    assert_eq!(new.memory.presentation.views.len(), 1);
    assert_eq!(new.dropped.len(), 1, "{:?}", new.dropped);

    let mut moved = saved();
    moved.memory.presentation.head.position = DVec3::Z * -1.5;
    let nearer = parsed(&WALL.replace("[0.0, 0.0, -2.0]", "[0.0, 0.0, -1.0]"));
    let new = reconcile(moved, &nearer);
    assert_eq!(new.memory.presentation.head, nearer.head());
    let [(what, reason)] = &new.dropped[..] else { panic!("{:?}", new.dropped) };
    assert!(what.contains("head") && reason.contains("front"), "{what}: {reason}");
}
