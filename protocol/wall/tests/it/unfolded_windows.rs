//! Windows of walls on monitors: disjoint, on the monitor, of one scale, and where one looks for
//! them.

use std::path::Path;

use glam::{DQuat, DVec2, DVec3, EulerRot, UVec2};
use polyptych_wall::surface::Plane;
use polyptych_wall::unfold::{WindowLayout, WindowRect};
use polyptych_wall::{Channel, Eye, Orientation, Screen, StereoPacking, Surface, Wall};
use proptest::prelude::{Strategy, any, proptest};

const MONITORS: [UVec2; 4] =
    [UVec2::new(1024, 768), UVec2::new(1920, 1080), UVec2::new(1080, 1920), UVec2::new(3840, 2160)];

fn is_apart(a: &WindowRect, b: &WindowRect) -> bool {
    (a.origin + a.size).cmple(b.origin).any() || (b.origin + b.size).cmple(a.origin).any()
}

/// Checks all that holds of every layout; gives it.
#[track_caller]
fn checked(wall: &Wall, monitor: UVec2) -> WindowLayout {
    let layout = WindowLayout::new(wall, monitor);
    let name = &wall.name;
    assert_eq!(layout.windows.len(), wall.channels.len());
    assert!(layout.scale > 0.0 && layout.scale <= 1.0, "{name}: scale {}", layout.scale);
    for (channel, window) in wall.channels.iter().zip(&layout.windows) {
        let end = window.origin + window.size;
        assert!(end.cmple(monitor).all(), "{name}: {window:?} is not on {monitor}");
        let right = channel.display_size().as_dvec2() * layout.scale;
        let off = (window.size.as_dvec2() - right).abs().max_element();
        assert!(off <= 1.0, "{name}: {window:?} is {} of {right} pixels", channel.name);
    }
    for (index, a) in layout.windows.iter().enumerate() {
        for (other, b) in layout.windows[..index].iter().enumerate() {
            let names = [index, other].map(|id| &wall.channels[id].name);
            assert!(is_apart(a, b), "{name} on {monitor}: {names:?}: {a:?} and {b:?}");
        }
    }
    assert_eq!(layout, WindowLayout::new(wall, monitor));
    layout
}

fn config(name: &str) -> Wall {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    polyptych_wall_file::load(&configs.join(name)).unwrap_or_else(|error| panic!("{error}"))
}

/// The window of each channel by its name.
fn named<'a>(wall: &Wall, layout: &'a WindowLayout) -> impl Fn(&str) -> &'a WindowRect {
    let id = |wall: &Wall, name: &str| wall.channels.iter().position(|c| c.name == name);
    let wall = wall.clone();
    move |name| &layout.windows[id(&wall, name).unwrap_or_else(|| panic!("no channel {name}"))]
}

#[test]
fn windows_of_all_configs_are_disjoint_and_on_the_monitor() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut count = 0;
    for entry in std::fs::read_dir(configs).expect("the folder of wall files") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let wall = polyptych_wall_file::load(&path).unwrap_or_else(|error| panic!("{error}"));
            for monitor in MONITORS {
                checked(&wall, monitor);
            }
            count += 1;
        }
    }
    assert!(count >= 9, "{count} wall files");
}

#[test]
fn a_cave_is_unfolded_around_its_front() {
    let wall = config("cave-4.toml");
    let layout = checked(&wall, UVec2::new(1500, 1000));
    assert!((layout.scale - 0.5).abs() < 1e-12, "{}", layout.scale);
    let of = named(&wall, &layout);
    let origins = ["left", "front", "right", "floor"].map(|name| of(name).origin.to_array());
    assert_eq!(origins, [[0, 0], [500, 0], [1000, 0], [500, 500]]);
}

#[test]
fn a_cube_of_six_sides_has_its_ceiling_above_and_its_back_at_the_side() {
    let mut wall = config("cave-4.toml");
    let screen = |name: &str, corners: [[f64; 3]; 3]| {
        let [lower_left, lower_right, upper_left] = corners.map(DVec3::from_array);
        let plane = Plane { lower_left, lower_right, upper_left };
        Screen::new(name, Surface::Plane(plane), UVec2::new(1000, 800))
    };
    wall.screens.push(screen("back", [[1.5, 0.0, 1.5], [-1.5, 0.0, 1.5], [1.5, 3.0, 1.5]]));
    wall.screens.push(screen("ceiling", [[-1.5, 3.0, -1.5], [1.5, 3.0, -1.5], [-1.5, 3.0, 1.5]]));
    for (name, screen) in [("back", 4), ("ceiling", 5)] {
        wall.channels.push(Channel::tile(name, screen, UVec2::ZERO, UVec2::new(1000, 800)));
    }
    let layout = checked(&wall, UVec2::new(4000, 2800));
    let of = named(&wall, &layout);
    assert_eq!(of("ceiling").origin, UVec2::new(1000, 0));
    assert_eq!(of("front").origin, UVec2::new(1000, 800));
    assert_eq!(of("floor").origin, UVec2::new(1000, 1800));
    assert_eq!(of("back").origin.x, 3000, "it is seen when one turns to the right");
}

#[test]
fn screens_in_two_rows_keep_their_rows() {
    let size = UVec2::new(400, 300);
    let (mut screens, mut channels) = (Vec::new(), Vec::new());
    for (index, (x, y)) in [(-1, 1), (0, 1), (1, 1), (-1, 0), (0, 0), (1, 0)].iter().enumerate() {
        let center = DVec3::new(f64::from(*x) * 0.8, f64::from(*y) * 0.6 - 0.3, -2.0);
        let plane = Plane::upright(center, DVec2::new(0.8, 0.6));
        let name = format!("s{index}");
        screens.push(Screen::new(&name, Surface::Plane(plane), size));
        channels.push(Channel::tile(&name, index as u16, UVec2::ZERO, size));
    }
    let layout = checked(&Wall::new("rows", screens, channels), UVec2::new(1200, 600));
    let origins: Vec<_> = layout.windows.iter().map(|window| window.origin.to_array()).collect();
    assert_eq!(origins, [[0, 0], [400, 0], [800, 0], [0, 300], [400, 300], [800, 300]]);
}

/// A flat screen of so many tiles.
fn tiled(columns: u32, rows: u32, size: UVec2, overlap: u32) -> Wall {
    let step = size - overlap;
    let canvas = UVec2::new(columns - 1, rows - 1) * step + size;
    let plane = Plane::upright(DVec3::NEG_Z, canvas.as_dvec2() / 1000.0);
    let tile = |index: u32| {
        let origin = UVec2::new(index % columns, index / columns) * step;
        Channel::tile(&format!("c{index}"), 0, origin, size)
    };
    let screens = vec![Screen::new("front", Surface::Plane(plane), canvas)];
    Wall::new("tiled", screens, (0..columns * rows).map(tile).collect())
}

#[test]
fn tiles_that_fit_the_monitor_stand_pixel_for_pixel_from_its_corner() {
    let wall = tiled(2, 2, UVec2::new(240, 136), 0);
    let layout = checked(&wall, UVec2::new(1024, 768));
    assert!((layout.scale - 1.0).abs() < f64::EPSILON);
    for (channel, window) in wall.channels.iter().zip(&layout.windows) {
        assert_eq!((window.origin, window.size), (channel.origin, channel.size));
    }
}

#[test]
fn tiles_without_gaps_have_windows_without_gaps() {
    let layout = checked(&tiled(3, 2, UVec2::new(1921, 1081), 0), UVec2::new(1333, 777));
    for row in layout.windows.chunks(3) {
        for pair in row.windows(2) {
            assert_eq!(pair[0].origin.x + pair[0].size.x, pair[1].origin.x);
        }
    }
}

#[test]
fn channels_that_overlap_are_moved_apart_in_their_order() {
    let wall = tiled(3, 2, UVec2::new(320, 224), 80);
    let layout = checked(&wall, UVec2::new(1920, 1080));
    let x: Vec<u32> = layout.windows.iter().map(|window| window.origin.x).collect();
    assert_eq!(x, [0, 320, 640, 0, 320, 640]);
}

#[test]
fn the_eyes_of_a_stereo_wall_stand_side_by_side() {
    let mut wall = tiled(2, 1, UVec2::new(300, 200), 0);
    let mut right = wall.channels.clone();
    for (left, right) in wall.channels.iter_mut().zip(&mut right) {
        left.adjustment.eye = Eye::Left;
        right.adjustment.eye = Eye::Right;
        right.name.push('r');
    }
    wall.channels.extend(right);
    let layout = checked(&wall, UVec2::new(1200, 800));
    let x: Vec<u32> = layout.windows.iter().map(|window| window.origin.x).collect();
    assert_eq!(x, [0, 300, 600, 900]);
}

#[test]
fn channels_on_one_place_are_all_seen() {
    let mut wall = tiled(1, 1, UVec2::new(300, 200), 0);
    for index in 1..5 {
        let again = Channel { name: format!("again-{index}"), ..wall.channels[0].clone() };
        wall.channels.push(again);
    }
    checked(&wall, UVec2::new(1920, 1080));
}

#[test]
fn packed_and_turned_displays_have_room_for_their_pictures() {
    let mut wall = tiled(2, 2, UVec2::new(300, 200), 0);
    wall.channels[0].adjustment.packing = StereoPacking::SideBySide;
    wall.channels[3].adjustment.turn = Orientation::Right;
    checked(&wall, UVec2::new(1920, 1080));
}

/// Up to six screens anywhere around the eye, each with channels anywhere on it.
fn any_wall() -> impl Strategy<Value = Wall> {
    let channel = (0u32..600, 0u32..400, 40u32..500, 40u32..400, 0u32..3);
    let channels = proptest::collection::vec(channel, 1..5);
    let screen = (any::<[i8; 3]>(), any::<[i8; 3]>(), channels);
    proptest::collection::vec(screen, 1..7).prop_map(|all| {
        let (mut screens, mut channels) = (Vec::new(), Vec::new());
        for (index, (center, turn, on_it)) in all.into_iter().enumerate() {
            let [yaw, pitch, roll] = turn.map(|part| f64::from(part) / 20.0);
            let rotation = DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
            let center = DVec3::from_array(center.map(f64::from)) / 32.0;
            let corner = |x: f64, y: f64| center + rotation * DVec3::new(x, y, 0.0);
            let plane = Plane {
                lower_left: corner(-1.0, -0.75),
                lower_right: corner(1.0, -0.75),
                upper_left: corner(-1.0, 0.75),
            };
            let canvas = UVec2::new(1100, 800);
            screens.push(Screen::new(&format!("s{index}"), Surface::Plane(plane), canvas));
            for (x, y, width, height, eye) in on_it {
                let name = format!("c{}", channels.len());
                let (origin, size) = (UVec2::new(x, y), UVec2::new(width, height));
                let mut channel = Channel::tile(&name, index as u16, origin, size);
                channel.adjustment.eye = [Eye::Center, Eye::Left, Eye::Right][eye as usize];
                channels.push(channel);
            }
        }
        Wall::new("any", screens, channels)
    })
}

proptest! {
    #[test]
    fn windows_of_any_wall_are_disjoint_and_on_the_monitor(
        wall in any_wall(),
        monitor in 0..MONITORS.len(),
    ) {
        checked(&wall, MONITORS[monitor]);
    }
}
