//! Markers drawn by f64 where they should not be: the reading must say by how much.

use polyptych_wall::surface::{Cylinder, Plane, Surface};
use polyptych_wall::{Channel, Screen};

use super::*;

const SIZE: UVec2 = UVec2::new(320, 240);
const EYE: DVec3 = DVec3::new(0.1, 0.05, 0.2);
const HALF: f64 = 24.0;

fn screens() -> [Screen; 2] {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.2, 2.4));
    let cylinder = Cylinder {
        center: DVec3::ZERO,
        rotation: glam::DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-0.8, 0.8],
        height_m: [-1.2, 1.2],
    };
    [Surface::Plane(plane), Surface::Cylinder(cylinder)]
        .map(|surface| Screen::new("s", surface, SIZE))
}

/// The codes of 8 bits that a channel would have if all of it were moved by some pixels.
fn drawn(marker: &Marker, map: &ChannelMapping<'_>, moved: DVec2) -> LuminanceImage {
    let at = |i: u32| {
        let pixel = DVec2::new(f64::from(i % SIZE.x), f64::from(i / SIZE.x)) + 0.5 - moved;
        let place =
            map.display_from_pixel(pixel).and_then(|p| marker.place((EYE, p - EYE), DVec3::ZERO));
        let light = place.filter(|place| place.abs().max_element() < 1.0).map_or(0.0, gauss);
        let code = (linear_code(light) * 255.0).round() / 255.0;
        linear_light(code) as f32
    };
    LuminanceImage { size: SIZE, grey: (0..SIZE.x * SIZE.y).map(at).collect() }
}

fn linear_code(light: f64) -> f64 {
    polyptych_wall::color::srgb_from_linear(light)
}

fn linear_light(code: f64) -> f64 {
    polyptych_wall::color::linear_from_srgb(code)
}

#[test]
fn a_picture_that_is_moved_is_read_as_moved() {
    for screen in screens() {
        let channel = Channel::tile("c", 0, UVec2::ZERO, SIZE);
        let map = ChannelMapping::new(&channel, &screen).expect("a picture");
        for (pixel, depth) in [([60.3, 70.1], 1.0), ([160.0, 120.5], 1.7), ([250.7, 180.2], 5.0)] {
            let pixel = DVec2::from(pixel);
            let marker = Marker::at((ChannelId(0), &map), EYE, pixel, HALF, depth);
            let marker = marker.expect("on the screen");
            let around = marker
                .seen_at(sight(&map, EYE), DVec3::ZERO, (SIZE, SIZE.as_dvec2() / 2.0))
                .expect("seen");
            assert!(around.distance(pixel) < 0.2, "{around} for {pixel}");
            for moved in [DVec2::ZERO, DVec2::new(0.02, 0.0), DVec2::new(-0.05, 0.1)] {
                let light = drawn(&marker, &map, moved);
                let read = marker.read(sight(&map, EYE), &light, DVec3::ZERO, (around, HALF));
                let Reading::Off(off) = read else { panic!("{read:?}") };
                assert!(off.distance(moved) < 0.004, "{off} for {moved} at {pixel}, {depth}");
            }
        }
    }
}

#[test]
fn what_is_not_there_is_missing_and_what_cannot_be_told_is_faint() {
    let [screen, _] = screens();
    let channel = Channel::tile("c", 0, UVec2::ZERO, SIZE);
    let map = ChannelMapping::new(&channel, &screen).expect("a picture");
    let pixel = DVec2::new(160.0, 120.0);
    let marker = Marker::at((ChannelId(0), &map), EYE, pixel, HALF, 1.0).expect("on the screen");
    let read =
        |light: &LuminanceImage| marker.read(sight(&map, EYE), light, DVec3::ZERO, (pixel, HALF));
    let mut light = drawn(&marker, &map, DVec2::ZERO);
    light.grey[120 * SIZE.x as usize + 165] = f32::NAN;
    assert_eq!(read(&light), Reading::Unclear);
    light.grey.fill(0.0);
    assert_eq!(read(&light), Reading::Missing);
}
