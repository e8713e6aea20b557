//! Planes a centimetre apart, ten kilometres away, with a near plane of ten centimetres: the one
//! behind must not show, in any channel, wherever the viewer goes.

use glam::{DMat4, DQuat, DVec3, Vec3};
use polyptych_client::{Camera, Wall};

use super::channels;
use super::hard_cases::shrunk;
use crate::harness::model::{Model, Part};
use crate::harness::stage::RenderFixture;

const AWAY_M: f64 = 10_000.0;
const APART_M: f64 = 0.01;

/// A red plane before a green one that is a tenth smaller, each of so many cells across.
fn planes(place: DVec3, half_m: f32, cells: i32) -> Model {
    let at = |z: f64, half: f32, color: Vec3| {
        let node = DMat4::from_translation(place + DVec3::new(0.0, 0.0, -z));
        let half = half / cells as f32;
        let middle = |cell: i32| (2 * cell + 1 - cells) as f32 * half;
        let cell = |i: i32| {
            let middle = Vec3::new(middle(i % cells), middle(i / cells), 0.0);
            Part::rectangle(node, middle, Vec3::X * half, Vec3::Y * half, color).plain()
        };
        let mut whole = cell(0);
        (1..cells * cells).for_each(|i| whole.join(&cell(i)));
        whole
    };
    // The hidden one is drawn first, so that only depth can hide it.
    Model::of(vec![at(AWAY_M + APART_M, half_m * 0.9, Vec3::Y), at(AWAY_M, half_m, Vec3::X)])
}

/// Draws every channel from every pose; gives the pixels of the near plane and of the far one.
fn count(wall: &Wall, place: DVec3, cells: i32) -> [u64; 2] {
    let mut stage = RenderFixture::of(&planes(place, 9000.0, cells).gltf());
    let mut counts = [0; 2];
    for step in 0..24 {
        let t = f64::from(step);
        // Across and towards the planes, turning: every channel comes to look at them, aslant too.
        let position = place + DVec3::new(t * 13.7 - 160.0, t * 3.1, t * 1.37);
        let rotation = DQuat::from_rotation_y((t - 12.0) * 0.11) * DQuat::from_rotation_x(t * 0.01);
        let camera = Camera { position, rotation, scale: 1.0 };
        for id in channels(wall) {
            for pixel in stage.channel(wall, id, camera).pixels() {
                let [red, green, blue, _] = pixel.0;
                counts[0] += u64::from(red > 128 && green < 64 && blue < 64);
                counts[1] += u64::from(green > 128 && red < 64 && blue < 64);
            }
        }
    }
    counts
}

#[test]
fn a_plane_a_centimetre_behind_another_at_ten_kilometres_never_shows() {
    for (name, by) in [("wall-2x2.toml", 4), ("cave-4.toml", 5)] {
        let wall = Wall { near_m: 0.1, ..shrunk(name, by) };
        for place in [DVec3::ZERO, DVec3::new(1e7, -2.5e6, 6.4e6)] {
            let [near, far] = count(&wall, place, 1);
            println!("{name} at {place}: {near} pixels of the near plane, {far} of the far one");
            assert!(near > 500_000, "{name}: the planes are not seen: {near}");
            assert_eq!(far, 0, "{name} at {place}: the far plane shows");
        }
        // Of many triangles, each with corners of its own that are rounded: what a driver's own
        // arithmetic adds then is seldom, but not never, more than the centimetre.
        let [near, far] = count(&wall, DVec3::ZERO, 32);
        println!("{name}, 2048 triangles: {near} pixels of the near plane, {far} of the far one");
        assert!(far * 100_000 <= near, "{name}: {far} of {near} pixels show the far plane");
    }
}
