//! The hard cases of numbers, each a test, against the reference.
//!
//! Those that are no matter of a picture stand where their code is: an eye in or behind a screen's
//! plane in `protocol`'s `frustum::tests`; NaN and infinity in accessors in the baker's
//! `tests::broken`; node numbers that are none in its `tests::numbers`; degenerate triangles and
//! tangents, lights at the surface, cones of no width, an infinite pixel, and light beyond all
//! measure in the renderer's `tests::robustness`.

use std::path::Path;

use glam::{DMat4, DVec3, UVec2, Vec3};
use polyptych_client::{Camera, Wall};
use polyptych_render::frame_views;
use polyptych_wall::{ChannelId, ChannelKind};

use super::shapes::cube;
use super::{assert_right, channels, verdict};
use crate::harness::local_wall::of_repository;
use crate::harness::model::{Model, Part};
use crate::harness::stage::{RenderFixture, frame, reference_view};

/// A wall file of the repository with fewer pixels.
pub fn shrunk(name: &str, by: u32) -> Wall {
    let mut wall = of_repository(name);
    for screen in &mut wall.screens {
        screen.canvas /= by;
    }
    for channel in &mut wall.channels {
        channel.origin /= by;
        channel.size /= by;
    }
    wall
}

/// Every wall file of the repository, without channels on curved screens and those of projectors:
/// their pixels go through a warp.
pub fn all_planar() -> Vec<(String, Wall)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let files = std::fs::read_dir(folder).expect("the wall files");
    let names = files.map(|file| file.expect("a file").file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> =
        names.filter(|name| name.rsplit('.').next() == Some("toml")).collect();
    names.sort();
    let planar = |name: String| {
        let mut wall = of_repository(&name);
        let screens = wall.screens.clone();
        wall.channels.retain(|channel| {
            channel.cover == ChannelKind::Tile
                && channel.adjustment.warp.is_none()
                && screens[usize::from(channel.screen)].plane().is_some()
        });
        (name, wall)
    };
    let walls: Vec<_> = names.into_iter().map(planar).collect();
    walls.into_iter().filter(|(_, wall)| !wall.channels.is_empty()).collect()
}

/// One screen of two metres by one, rows of it turned as the corners say.
fn one_screen(corners: [DVec3; 3], eye: DVec3) -> Wall {
    let [a, b, c] = corners.map(|corner| corner.to_array());
    let text = format!(
        r#"
        [wall]
        name = "one"
        eye = {:?}
        near = 0.0001
        [[screen]]
        name = "front"
        lower_left = {a:?}
        lower_right = {b:?}
        upper_left = {c:?}
        tiles = {{ columns = 2, rows = 1, pixels = [128, 128] }}
        "#,
        eye.to_array(),
    );
    polyptych_wall_file::parse(&text, "one.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Two metres by one, a metre before the origin.
const PLAIN: [DVec3; 3] =
    [DVec3::new(-1.0, -0.5, -1.0), DVec3::new(1.0, -0.5, -1.0), DVec3::new(-1.0, 0.5, -1.0)];

/// Cubes of several sizes all around a place, and a ground that passes below and behind it.
fn surroundings(place: DVec3, unit: f64) -> Model {
    let mut random = fastrand::Rng::with_seed(21);
    let mut parts = Vec::new();
    for _ in 0..60 {
        let mut along = || random.f64() * 2.0 - 1.0;
        let away = DVec3::new(along(), along(), along()).normalize() * (2.0 + 4.0 * along().abs());
        let at = DMat4::from_translation(place + away * unit);
        let size = unit * (0.4 + along().abs());
        let turned = DMat4::from_axis_angle(away.normalize(), along() * 3.0);
        parts.push(cube(at * turned * DMat4::from_scale(DVec3::splat(size))));
    }
    let ground = DMat4::from_translation(place - DVec3::Y * (1.2 * unit));
    let scaled = ground * DMat4::from_scale(DVec3::splat(unit));
    let brown = Vec3::new(0.3, 0.15, 0.05);
    let ground = Part::rectangle(scaled, Vec3::ZERO, Vec3::X * 500.0, Vec3::Z * -500.0, brown);
    parts.push(ground.plain());
    Model::of(parts)
}

/// All channels of a wall that looks around at a place, with metres of a length.
fn check_around(name: &str, wall: &Wall, place: DVec3, unit: f64) {
    let model = surroundings(place, unit);
    let mut stage = RenderFixture::of(&model.gltf());
    let camera = Camera { position: place, ..Camera::IDENTITY }.with_scale(unit);
    for id in channels(wall) {
        let name = format!("{name}, channel {}", id.0);
        assert_right(&name, verdict(&mut stage, &model, wall, id, camera));
    }
}

/// Checks that no sure pixel is wrong, however few show something: for frusta that see nearly
/// everything edge-on.
fn check_none_wrong(name: &str, wall: &Wall) {
    check_wrong(name, wall, 0.0);
}

/// Checks that at most this share of the sure pixels is wrong.
fn check_wrong(name: &str, wall: &Wall, most: f64) {
    let model = surroundings(DVec3::ZERO, 1.0);
    let mut stage = RenderFixture::of(&model.gltf());
    for id in channels(wall) {
        let verdict = verdict(&mut stage, &model, wall, id, Camera::IDENTITY);
        println!("{name}, channel {}: {verdict:?}", id.0);
        let share = verdict.wrong as f64 / verdict.sure as f64;
        assert!(share <= most, "{name}: {verdict:?}");
        assert!(verdict.sure > verdict.unsure, "{name}: {verdict:?}");
    }
}

#[test]
fn eye_nearly_in_a_screen_plane() {
    // A millimetre before two metres of screen: its edges are seen at 0.06°.
    for distance_m in [1e-1, 1e-2, 1e-3] {
        let before = DVec3::new(0.3, 0.1, -1.0 + distance_m);
        check_none_wrong(&format!("{distance_m} m before it"), &one_screen(PLAIN, before));
    }
    // As near as it may be, where f32 shows another pixel's colour at some edges: 1.3 % of all.
    // Nearer, it tells pixels apart ever less, and no head is let there.
    let mut wall = one_screen(PLAIN, DVec3::new(0.3, 0.1, 0.0));
    let least = |channel| wall.screens[0].eye_distance_min_m(channel, wall.eye - DVec3::Z);
    let least_m = wall.channels.iter().filter_map(least).fold(0.0, f64::max);
    // A little more, for the last digit of the distance.
    let least_m = least_m * 1.001;
    wall.eye.z = -1.0 + least_m;
    assert_eq!(wall.check_head(&wall.head()), Ok(()));
    check_wrong(&format!("{least_m} m before it"), &wall, 0.02);
    wall.eye.z = -1.0 + least_m * 0.9;
    let refused = wall.check_head(&wall.head()).expect_err("too near").to_string();
    assert!(refused.contains("before screen front"), "{refused}");
    // Beside the screen, where the frustum is all slant.
    for distance_m in [0.2, 0.05] {
        let beside = DVec3::new(2.0, 0.1, -1.0 + distance_m);
        check_none_wrong(&format!("{distance_m} m, beside"), &one_screen(PLAIN, beside));
    }
}

#[test]
fn eye_on_a_corner() {
    for corner in [PLAIN[0], PLAIN[1], PLAIN[2]] {
        check_around("before a corner", &one_screen(PLAIN, corner + DVec3::Z), DVec3::ZERO, 1.0);
        let on_it = one_screen(PLAIN, DVec3::ZERO);
        let on_it = Wall { eye: corner, ..on_it };
        let refused = frame_views::views(&on_it, ChannelId(0), &frame(&on_it, Camera::IDENTITY));
        assert!(refused.expect_err("in the plane").contains("in the plane of screen front"));
        assert!(reference_view(&on_it, ChannelId(0), Camera::IDENTITY).is_err());
    }
}

#[test]
fn screens_at_right_angles() {
    check_around("cave", &shrunk("cave-4.toml", 8), DVec3::ZERO, 1.0);
}

#[test]
fn screens_behind_the_eye() {
    let wall = Wall { eye: DVec3::new(0.0, 0.0, -1.25), ..one_screen(PLAIN, DVec3::ZERO) };
    for id in channels(&wall) {
        let error =
            frame_views::views(&wall, id, &frame(&wall, Camera::IDENTITY)).expect_err("behind");
        let name = &wall.channels[usize::from(id.0)].name;
        assert!(error.contains(name) && error.contains("0.250000 m behind"), "{error}");
        let reference = reference_view(&wall, id, Camera::IDENTITY).unwrap_err();
        assert!(reference.contains("0.25 m behind"), "{reference}");
    }
}

#[test]
fn screen_rolled_by_half_a_turn() {
    // The corners as they hang: its lower left is where the upper right would be.
    let [a, b, c] = PLAIN;
    let rolled = one_screen([b + c - a, c, b], DVec3::new(0.2, 0.1, 0.0));
    check_around("rolled", &rolled, DVec3::ZERO, 1.0);
    let upright = one_screen(PLAIN, rolled.eye);
    let model = surroundings(DVec3::ZERO, 1.0);
    let mut stage = RenderFixture::of(&model.gltf());
    let [first, last] = [ChannelId(0), ChannelId(1)];
    let upright = stage.channel(&upright, first, Camera::IDENTITY);
    let rolled = image::imageops::rotate180(&stage.channel(&rolled, last, Camera::IDENTITY));
    let differing = upright.pixels().zip(rolled.pixels()).filter(|(a, b)| a != b).count();
    assert!(differing * 50 < upright.pixels().len(), "{differing} pixels");
}

#[test]
fn a_channel_of_one_pixel() {
    let mut wall = one_screen(PLAIN, DVec3::ZERO);
    wall.channels.truncate(1);
    let model = surroundings(DVec3::ZERO, 1.0);
    let mut stage = RenderFixture::of(&model.gltf());
    let mut seen = 0;
    for (x, y) in [(0, 0), (37, 21), (200, 90), (255, 127), (128, 64), (129, 65)] {
        wall.channels[0].origin = UVec2::new(x, y);
        wall.channels[0].size = UVec2::ONE;
        let verdict = verdict(&mut stage, &model, &wall, ChannelId(0), Camera::IDENTITY);
        assert_eq!(verdict.wrong, 0, "{x}, {y}: {verdict:?}");
        seen += verdict.sure;
    }
    assert!(seen > 2, "{seen}");
}

#[test]
fn a_triangle_through_all_channels_and_behind_the_eye() {
    for name in ["wall-2x2.toml", "cave-4.toml"] {
        let wall = shrunk(name, 8);
        // From high up ahead down to both sides behind the eye.
        let corners = [
            Vec3::new(0.0, 40.0, -60.0),
            Vec3::new(-80.0, -40.0, 20.0),
            Vec3::new(80.0, -40.0, 20.0),
        ];
        let mut part = Part::flat(DMat4::from_translation(wall.eye), &corners, Vec3::ZERO);
        part.colors = vec![Vec3::X, Vec3::Y, Vec3::Z];
        let model = Model::of(vec![part]);
        let mut stage = RenderFixture::of(&model.gltf());
        for id in channels(&wall) {
            assert_right(name, verdict(&mut stage, &model, &wall, id, Camera::IDENTITY));
        }
    }
}

#[test]
fn a_vertex_exactly_beside_the_eye() {
    let wall = one_screen(PLAIN, DVec3::ZERO);
    // w is 0 at the first corner, at two corners, and at the eye itself.
    let far = [Vec3::new(-3.0, -2.0, -4.0), Vec3::new(2.0, 3.0, -5.0)];
    for beside in [Vec3::new(2.0, -1.0, 0.0), Vec3::new(0.0, 0.0, 0.0)] {
        let triangles = [[beside, far[1], far[0]], [beside, Vec3::new(-1.0, 1.5, 0.0), far[0]]];
        for corners in triangles {
            let mut part = Part::flat(DMat4::IDENTITY, &corners, Vec3::new(0.9, 0.5, 0.1));
            part.is_double_sided = true;
            let model = Model::of(vec![part, cube(DMat4::from_translation(DVec3::Z * -3.0))]);
            let mut stage = RenderFixture::of(&model.gltf());
            for id in channels(&wall) {
                let verdict = verdict(&mut stage, &model, &wall, id, Camera::IDENTITY);
                assert_eq!(verdict.wrong, 0, "{corners:?}: {verdict:?}");
                assert!(verdict.covered > 100, "{corners:?}: {verdict:?}");
            }
        }
    }
}

#[test]
fn slivers_and_triangles_without_area() {
    let wall = one_screen(PLAIN, DVec3::ZERO);
    let mut positions = Vec::new();
    // A fan of ever thinner triangles, corners in a line, and corners in one place.
    for i in 0..24 {
        let turn = i as f32 * 0.26;
        let (along, width) = (Vec3::new(turn.cos(), turn.sin(), 0.0), 0.5f32.powi(i));
        let across = Vec3::new(-along.y, along.x, 0.0) * width;
        positions.extend([Vec3::ZERO, along * 3.0 - across, along * 3.0 + across]);
        positions.extend([Vec3::ZERO, along, along * 2.0]);
        positions.extend([along; 3]);
    }
    let at = DMat4::from_translation(DVec3::new(0.05, 0.02, -2.0));
    let mut fan = Part::flat(at, &positions, Vec3::new(0.1, 0.8, 0.2));
    fan.is_double_sided = true;
    let model = Model::of(vec![fan]);
    let mut stage = RenderFixture::of(&model.gltf());
    for id in channels(&wall) {
        let verdict = verdict(&mut stage, &model, &wall, id, Camera::IDENTITY);
        println!("slivers: {verdict:?}");
        assert!(verdict.wrong == 0 && verdict.covered > 0, "{verdict:?}");
        // Those that lie over each other in the fan's plane are as near as each other.
        assert!(verdict.unsure * 4 < verdict.sure, "{verdict:?}");
    }
}

#[test]
fn a_scene_at_ten_million_metres_and_one_of_a_tenth_of_a_millimetre() {
    let wall = shrunk("wall-2x2.toml", 8);
    check_around("1e7 m", &wall, DVec3::new(1e7, -3e6, 0.6e7), 1.0);
    check_around("1e-4 m", &wall, DVec3::ZERO, 1e-4);
    check_around("1e-4 m, a metre away", &wall, DVec3::new(0.3, -1.0, 0.1), 1e-4);
    check_around("1e7 m wide", &wall, DVec3::ZERO, 1e7);
}

#[test]
fn up_parallel_to_the_view() {
    let wall = shrunk("wall-2x2.toml", 8);
    let model = surroundings(DVec3::ZERO, 1.0);
    let mut stage = RenderFixture::of(&model.gltf());
    for target in [DVec3::Y, DVec3::NEG_Y, DVec3::new(1e-12, 1.0, 0.0), DVec3::ZERO] {
        let camera = Camera::look_at(DVec3::ZERO, target, DVec3::Y);
        for id in channels(&wall) {
            assert_right("up along the view", verdict(&mut stage, &model, &wall, id, camera));
        }
    }
}
