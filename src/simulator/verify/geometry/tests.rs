//! Displays with the pictures of two eyes, drawn by f64 as they should be and not: both are read.

use glam::UVec2;
use polyptych_client::FrameId;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::surface::{Plane, Surface};
use polyptych_wall::{Screen, StereoPacking};

use super::*;

const SIZE: UVec2 = UVec2::new(320, 240);

fn wall(packing: StereoPacking) -> Wall {
    let plane = Plane::upright(DVec3::NEG_Z * 1.5, DVec2::new(2.0, 1.5));
    let screen = Screen::new("front", Surface::Plane(plane), SIZE);
    let mut channel = Channel::tile("c", 0, UVec2::ZERO, SIZE);
    channel.adjustment.packing = packing;
    Wall::new("w", vec![screen], vec![channel])
}

/// The codes of 8 bits of one eye's picture, row by row.
fn drawn(view: &ChannelView<'_>, markers: &[Marker]) -> Vec<u8> {
    let sight = marker::sight(&view.map, view.eye);
    let light = |pixel: DVec2| {
        let ray = sight(pixel).expect("on the screen");
        let places = markers.iter().filter_map(|marker| marker.place(ray, DVec3::ZERO));
        let mut lit = places.filter(|place| place.abs().max_element() < 1.0);
        lit.next().map_or(0.0, marker::gauss)
    };
    let code = |at: u32| {
        let pixel = UVec2::new(at % SIZE.x, at / SIZE.x).as_dvec2() + 0.5;
        (polyptych_wall::color::srgb_from_linear(light(pixel)) * 255.0).round() as u8
    };
    (0..SIZE.x * SIZE.y).map(code).collect()
}

/// The picture of a display that gets these pictures of a left and a right eye.
fn packed(packing: StereoPacking, [left, right]: [&[u8]; 2]) -> Capture {
    let rows = |codes: &[u8]| -> Vec<Vec<u8>> {
        codes.chunks(SIZE.x as usize).map(<[u8]>::to_vec).collect()
    };
    let (left, right) = (rows(left), rows(right));
    let grey = |code: &u8| [*code, *code, *code, 255];
    let rgba: Vec<u8> = match packing {
        StereoPacking::SideBySide => {
            let rows = left.iter().zip(&right);
            rows.flat_map(|(left, right)| left.iter().chain(right)).flat_map(grey).collect()
        }
        StereoPacking::TopBottom => left.iter().chain(&right).flatten().flat_map(grey).collect(),
        _ => {
            let pixels = left.iter().flatten().zip(right.iter().flatten());
            pixels.flat_map(|(left, right)| [*left, *right, *right, 255]).collect()
        }
    };
    let size = SIZE * packing.parts();
    let picture = Image { name: "c".to_owned(), width: size.x, height: size.y, rgba };
    let (screens, missing) = (Vec::new(), Vec::new());
    Capture { frame: FrameId(1), screens, channels: vec![picture], missing }
}

#[test]
fn both_eyes_of_a_display_are_read() {
    for packing in [StereoPacking::SideBySide, StereoPacking::TopBottom, StereoPacking::Anaglyph] {
        let wall = wall(packing);
        let shaped = ResolvedWall::from(&wall);
        let seen = channels(shaped);
        let labels: Vec<String> = seen.iter().map(ChannelView::label).collect();
        assert_eq!(labels, ["c, left eye", "c, right eye"]);
        let markers = markers(&wall, &seen);
        assert!(markers.iter().filter(|marker| !marker.is_on_screen).count() > 1);
        let corrections = light::corrections(shaped, &CalibrationMaps::default());
        let on_display = Drawn { wall: &wall, corrections: &corrections };
        let read = |pictures: [&[u8]; 2]| {
            let capture = packed(packing, pictures);
            let found = find((&wall, on_display), &seen, &markers, &capture, DVec3::ZERO);
            let found = found.expect("a picture");
            [0, 1].map(|view| {
                let of_view = found.iter().filter(|error| error.channel == view);
                of_view.map(|error| error.error_px.length()).collect::<Vec<f64>>()
            })
        };
        let [left, right] = [0, 1].map(|view| drawn(&seen[view], &markers));
        let is_right = |errors: &[f64]| errors.len() > 2 && errors.iter().all(|px| *px < 0.02);
        let is_lost = |px: &f64| px.is_nan() || *px > 1.0;
        let [first, second] = read([&left, &right]);
        assert!(is_right(&first) && is_right(&second), "{packing:?}: {first:?}, {second:?}");
        // Both eyes are shown one picture: what is behind the screen is not where it should be.
        let [first, second] = read([&left, &left]);
        assert!(is_right(&first), "{packing:?}: {first:?}");
        assert!(second.iter().any(is_lost), "{packing:?}: {second:?}");
        let black = vec![0; left.len()];
        let [first, second] = read([&left, &black]);
        assert!(is_right(&first), "{packing:?}: {first:?}");
        assert!(!second.is_empty() && second.iter().all(is_lost), "{packing:?}: {second:?}");
    }
}
