//! Patterns to the pixel: where lines lie, what adds up, what is counted.

use glam::{DQuat, DVec2, DVec3, UVec2};
use polyptych_wall::blend::BlendModel;
use polyptych_wall::channel_calibration::ControlGrid;
use polyptych_wall::projector::Projector;
use polyptych_wall::surface::{Cylinder, Plane};
use polyptych_wall::{
    ChannelKind, Eye, FrustumMode, Screen, StereoPacking, Surface, TransferFunction, Wall,
};

use super::*;

const SIZE: UVec2 = UVec2::new(320, 180);

/// IEC 61966-2-1.
fn light(code: u8) -> f64 {
    let value = f64::from(code) / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn plane() -> Surface {
    Surface::Plane(Plane::upright(DVec3::new(0.0, 0.0, -2.0), DVec2::new(3.2, 1.8)))
}

fn tiles(screen: Screen, origins: &[UVec2]) -> Wall {
    let channel =
        |(index, origin): (usize, &UVec2)| Channel::tile(&format!("c{index}"), 0, *origin, SIZE);
    Wall::new("test", vec![screen], origins.iter().enumerate().map(channel).collect())
}

/// A wall of one tile.
fn single() -> Wall {
    tiles(Screen::new("front", plane(), SIZE), &[UVec2::ZERO])
}

/// Two projectors askew, which overlap on a cylinder; one has a bend and pins.
fn projectors() -> Wall {
    let cylinder = Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-0.9, 0.9],
        height_m: [-1.2, 1.2],
    };
    let screen = Screen::new("front", Surface::Cylinder(cylinder), UVec2::new(960, 420));
    let channel = |name: &str, yaw: f64, roll: f64| {
        let rotation = DQuat::from_rotation_y(yaw) * DQuat::from_rotation_z(roll);
        let position = DVec3::new(0.1, 0.05, 0.3);
        let projector = Projector { position, rotation, tangents: [-0.5, 0.5, -0.3, 0.3] };
        Channel {
            cover: ChannelKind::Projector(Box::new(projector)),
            projection: FrustumMode::Own,
            ..Channel::tile(name, 0, UVec2::ZERO, SIZE)
        }
    };
    let mut wall =
        Wall::new("test", vec![screen], vec![channel("a", 0.3, 0.02), channel("b", -0.25, -0.03)]);
    let adjustment = &mut wall.channels[1].adjustment;
    adjustment.pin[1] = DVec2::new(-4.0, 3.0);
    let moves = (0..9).map(|i| DVec2::new(f64::from(i * 5 % 4), f64::from(i * 7 % 3)) * 0.7);
    adjustment.bend = Some(ControlGrid { points: UVec2::splat(3), moves: moves.collect() });
    wall
}

fn draw(wall: &Wall, channel: u16, pattern: TestPattern) -> RgbaImage {
    let image =
        picture(wall.into(), &CalibrationMaps::default(), ChannelId(channel), pattern, wall.eye)
            .expect("a picture");
    assert_eq!(image.dimensions(), SIZE.into());
    image
}

fn rgb(image: &RgbaImage, x: u32, y: u32) -> [u8; 3] {
    let [red, green, blue, alpha] = image.get_pixel(x, y).0;
    assert_eq!(alpha, 255);
    [red, green, blue]
}

#[test]
fn the_border_is_one_pixel_and_nothing_else() {
    let image = draw(&single(), 0, TestPattern::Border);
    for (x, y, _) in image.enumerate_pixels() {
        let is_edge = x == 0 || y == 0 || x == SIZE.x - 1 || y == SIZE.y - 1;
        assert_eq!(rgb(&image, x, y), if is_edge { [255; 3] } else { [0; 3] }, "{x} {y}");
    }
}

#[test]
fn the_ramp_has_every_code_in_order_and_each_colour() {
    let image = draw(&single(), 0, TestPattern::Ramp);
    let row: Vec<u8> = (0..SIZE.x).map(|x| rgb(&image, x, 0)[1]).collect();
    assert!(row.is_sorted() && row[0] == 0 && row[319] == 255);
    assert!((0..=255).all(|code| row.contains(&code)), "{row:?}");
    for (row, [red, green, blue]) in [(1, [255, 0, 0]), (2, [0, 255, 0]), (3, [0, 0, 255])] {
        assert_eq!(rgb(&image, 319, row * 45), [red, green, blue]);
    }
}

#[test]
fn bars_fall_in_luminance_and_end_in_steps() {
    let image = draw(&single(), 0, TestPattern::ColorBars);
    let luminance = |[r, g, b]: [u8; 3]| 0.2126 * light(r) + 0.7152 * light(g) + 0.0722 * light(b);
    let bars: Vec<f64> = (0..8).map(|bar| luminance(rgb(&image, bar * 40 + 20, 10))).collect();
    assert!(bars.windows(2).all(|pair| pair[0] > pair[1]), "{bars:?}");
    let steps: Vec<u8> = (0..16).map(|step| rgb(&image, step * 20 + 10, 170)[0]).collect();
    assert_eq!(steps, (0..16).map(|step| step * 17).collect::<Vec<u8>>());
}

#[test]
fn focus_is_half_lit_everywhere() {
    let image = draw(&single(), 0, TestPattern::Focus);
    for (left, top) in [(0, 0), (32, 0), (0, 32), (32, 32), (288, 96)] {
        let lit = (0..32 * 32).filter(|i| rgb(&image, left + i % 32, top + i / 32)[0] == 255);
        assert_eq!(lit.count(), 512, "{left} {top}");
    }
    assert_ne!(rgb(&image, 0, 0), rgb(&image, 1, 0), "lines of one pixel");
}

#[test]
fn lines_of_a_plain_tile_are_two_whole_pixels_around_their_number() {
    let wall = single();
    let (step, image) =
        (canvas::line_spacing(&wall, &wall.screens[0]), draw(&wall, 0, TestPattern::Grid));
    assert_eq!(step, 8.0);
    // Rows between lines, below numbers of 16 pixels at 4 and 132, and beside the name.
    for (x, y) in (0..SIZE.x).flat_map(|x| [26, 36, 156, 163].map(|y| (x, y))) {
        let is_minor = [0, 7].contains(&(x % 8));
        let is_major = [0, 31].contains(&(x % 32));
        let expected = if is_major {
            255
        } else if is_minor {
            code(0.2)
        } else {
            0
        };
        assert_eq!(rgb(&image, x, y), [expected; 3], "{x} {y}");
    }
}

#[test]
fn a_checker_is_even_and_sharp() {
    let image = draw(&single(), 0, TestPattern::Checker);
    for (x, y, _) in image.enumerate_pixels() {
        let is_lit = (x / 16 + y / 16) % 2 == 0;
        assert_eq!(rgb(&image, x, y), if is_lit { [255; 3] } else { [0; 3] }, "{x} {y}");
    }
}

/// Returns the points of the canvas where bright lines cross a row, found by their light.
fn crossings(wall: &Wall, channel: u16, y: u32) -> Vec<f64> {
    let image = draw(wall, channel, TestPattern::Grid);
    let map = wall.channel_mapping(ChannelId(channel)).expect("a map");
    // Blue has no numbers in it.
    let row: Vec<f64> = (0..SIZE.x).map(|x| light(rgb(&image, x, y)[2])).collect();
    let mut found = Vec::new();
    for x in 4..SIZE.x as usize - 4 {
        let near = &row[x - 4..=x + 4];
        let is_peak = row[x] > 0.9 && row[x] >= row[x + 1] && row[x] > row[x - 1];
        // Alone, on black: neither another line nor the name is beside it.
        if is_peak && near[0].max(near[1]).max(near[7]).max(near[8]) == 0.0 {
            // Midway between its edges: each is in the pixel that is lit in part, by that much. The
            // mean of lit pixels is not that: light is not in the middle of these.
            let lit: Vec<usize> = (0..9).filter(|&at| near[at] > 0.0).collect();
            let (first, last) = (lit[0], lit[lit.len() - 1]);
            let edges = [(first + 1) as f64 - near[first], last as f64 + near[last]];
            let middle = (x - 4) as f64 + f64::midpoint(edges[0], edges[1]);
            let place = map.canvas_from_pixel(DVec2::new(middle, f64::from(y) + 0.5));
            found.push(place.expect("on the screen").x);
        }
    }
    found
}

#[test]
fn lines_of_overlapping_projectors_fall_together() {
    let mut wall = projectors();
    // A coarse canvas, so that lines stand alone: they are 10 pixels of a projector apart.
    wall.screens[0].canvas = UVec2::new(480, 210);
    let major = canvas::line_spacing(&wall, &wall.screens[0]) * 4.0;
    let (mut count, mut worst) = (0, 0.0_f64);
    for channel in [0, 1] {
        for y in (3..SIZE.y).step_by(7) {
            for x in crossings(&wall, channel, y) {
                let error = (x - (x / major).round() * major).abs();
                (count, worst) = (count + 1, worst.max(error));
            }
        }
    }
    assert!(count > 60, "only {count} lines were found");
    assert!(worst <= 0.01, "{worst} pixels of the canvas from their number");
}

#[test]
fn the_crosshair_is_at_the_foot_of_the_eye() {
    let mut wall = single();
    // 0.4 m right and 0.3 m up of the middle, 100 pixels a metre.
    wall.eye = DVec3::new(0.4, 0.3, 1.0);
    let image = draw(&wall, 0, TestPattern::Crosshair);
    let lit: Vec<u32> = (0..SIZE.x).filter(|&x| rgb(&image, x, 3)[0] == 255).collect();
    assert_eq!(lit, [199, 200]);
    let lit: Vec<u32> = (0..SIZE.y).filter(|&y| rgb(&image, 3, y)[0] == 255).collect();
    assert_eq!(lit, [59, 60]);
}

#[test]
fn overlaps_are_counted_as_brute_force_counts_them() {
    let mut wall = projectors();
    wall.channels.push(Channel { name: "c".into(), ..wall.channels[0].clone() });
    // To the right and up, so that either of the two lights what the other does not.
    wall.channels[2].adjustment.pin[0] = DVec2::new(40.0, -30.0);
    for channel in 0..3 {
        let image = draw(&wall, channel, TestPattern::Overlap);
        let map = wall.channel_mapping(ChannelId(channel)).expect("a map");
        let mut seen = [0; 4];
        // Not where the words are.
        for (x, y) in (0..SIZE.x).step_by(3).flat_map(|x| (0..120).step_by(3).map(move |y| (x, y)))
        {
            let place = map.canvas_from_pixel(DVec2::new(f64::from(x), f64::from(y)) + 0.5);
            let Some(place) = place else { continue };
            let lights = |id: ChannelId| {
                let at = wall.channel_mapping(id).and_then(|map| map.pixel_from_canvas(place));
                let size = SIZE.as_dvec2();
                id.0 == channel
                    || at.is_some_and(|at| at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all())
            };
            let count = wall.channel_ids().filter(|id| lights(*id)).count();
            let expected = [[0, 40, 120], [0, 160, 0], [230, 200, 0], [255, 0, 0]][count - 1];
            assert_eq!(rgb(&image, x, y), expected, "channel {channel} at {x} {y}");
            seen[count] += 1;
        }
        assert!(seen[1] > 50 && seen[2] > 50, "{seen:?}");
    }
}

/// Tiles need no point of their screen, and those far away are not asked at all.
#[test]
fn overlaps_of_pinned_tiles_of_a_mesh_are_counted_as_brute_force_counts_them() {
    let origins: Vec<_> = (0..9).map(|at| UVec2::new(at % 3 * 280, at / 3 * 150)).collect();
    let canvas = UVec2::new(880, 480);
    let mut wall = tiles(Screen::new("front", Surface::Mesh(0), canvas), &origins);
    for (at, channel) in wall.channels.iter_mut().enumerate() {
        channel.adjustment.pin[at % 4] = DVec2::new(-9.0, 6.0) * (at % 3) as f64;
        let moves = (0..9).map(|i| DVec2::new(f64::from(i * 5 % 4), f64::from(i * 7 % 3)) * 0.7);
        let bend = ControlGrid { points: UVec2::splat(3), moves: moves.collect() };
        channel.adjustment.bend = (at % 2 == 1).then_some(bend);
    }
    let size = SIZE.as_dvec2();
    let mut counts = [0; 4];
    for channel in [0, 4, 7] {
        let image = draw(&wall, channel, TestPattern::Overlap);
        let map = wall.channel_mapping(ChannelId(channel)).expect("a map");
        // Not where the words are.
        for (x, y) in (0..SIZE.x).step_by(3).flat_map(|x| (0..120).step_by(3).map(move |y| (x, y)))
        {
            let place = map.canvas_from_pixel(DVec2::new(f64::from(x), f64::from(y)) + 0.5);
            let place = place.expect("a place");
            let others = wall.channel_ids().filter(|id| id.0 != channel);
            let at = |id| wall.channel_mapping(id)?.pixel_from_canvas(place);
            let all: Vec<DVec2> = others.filter_map(at).collect();
            // On an edge the rounding of a place decides.
            let is_near = |at: DVec2, end: DVec2| at.abs().min((at - end).abs()).min_element();
            if all.iter().any(|at| is_near(*at, size) < 0.01)
                || is_near(place, canvas.as_dvec2()) < 0.01
            {
                continue;
            }
            let is_lit = |at: &&DVec2| at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all();
            let count = all.iter().filter(is_lit).count().min(3);
            let color = [[0, 40, 120], [0, 160, 0], [230, 200, 0], [255, 0, 0]][count];
            let expected = if map.is_on_canvas(place) { color } else { [0; 3] };
            assert_eq!(rgb(&image, x, y), expected, "channel {channel} at {x} {y}");
            counts[count] += 1;
        }
    }
    assert!([0, 1, 3].iter().all(|count| counts[*count] > 50), "{counts:?}");
}

#[test]
fn overlaps_are_counted_for_the_eye_of_the_channel() {
    let mut wall = tiles(Screen::new("front", plane(), SIZE), &[UVec2::ZERO; 3]);
    let middle = |wall: &Wall, channel| rgb(&draw(wall, channel, TestPattern::Overlap), 160, 60);
    wall.channels[1].adjustment.eye = Eye::Left;
    wall.channels[2].adjustment.eye = Eye::Right;
    // Each eye sees the channel of both and its own.
    assert_eq!([0, 1, 2].map(|channel| middle(&wall, channel)), [[0, 160, 0]; 3]);
    wall.channels[0].adjustment.eye = Eye::Right;
    assert_eq!([0, 1, 2].map(|channel| middle(&wall, channel)[1]), [160, 40, 160]);
    wall.channels[0].adjustment.eye = Eye::Center;
    wall.channels[0].adjustment.packing = StereoPacking::Anaglyph;
    assert_eq!([0, 1, 2].map(|channel| middle(&wall, channel)), [[0, 160, 0]; 3]);
}

#[test]
fn the_far_side_of_a_screen_is_no_overlap() {
    let mut wall = projectors();
    let Surface::Cylinder(cylinder) = &mut wall.screens[0].surface else { panic!("a cylinder") };
    cylinder.azimuth_rad = [-3.0, 3.0];
    // The first lights a side of the cylinder from behind; the second, in it, the other side, at
    // which the first one is aimed, too.
    for (channel, x) in wall.channels.iter_mut().zip([-5.0, 0.0]) {
        channel.adjustment = ChannelCalibration::default();
        let rotation = DQuat::from_rotation_y(-std::f64::consts::FRAC_PI_2);
        let position = DVec3::new(x, 0.0, 0.0);
        let projector = Projector { position, rotation, tangents: [-0.2, 0.2, -0.1, 0.1] };
        channel.cover = ChannelKind::Projector(Box::new(projector));
    }
    let is_aimed = wall.channel_mapping(ChannelId(0)).is_some_and(|map| map.is_rear());
    assert!(is_aimed, "the first one stands behind the screen");
    for channel in 0..2 {
        let image = draw(&wall, channel, TestPattern::Overlap);
        assert_eq!(rgb(&image, 160, 90), [0, 40, 120], "channel {channel}");
    }
}

#[test]
fn weights_of_all_channels_are_white_together() {
    let mut wall = projectors();
    wall.blend.leak = 0.003;
    let images = [0, 1].map(|channel| draw(&wall, channel, TestPattern::Weights));
    let map = |channel| wall.channel_mapping(ChannelId(channel)).expect("a map");
    let (from, to) = (map(0), map(1));
    let blend = BlendModel::new(&wall);
    let (mut shared, mut seen_together) = (0, 0);
    for (x, y, pixel) in images[0].enumerate_pixels() {
        let at = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
        let Some(canvas) = from.canvas_from_pixel(at) else { continue };
        let weights = blend.weights(ChannelId(0), canvas);
        let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
        let (_, exact) = weights.iter().find(|(id, _)| id.0 == 0).expect("it lights its place");
        assert!((sum - 1.0).abs() < 1e-9, "{sum} at {x} {y}");
        // In blocks a weight is off by less than a thousandth, with the steepest ramp.
        let [least, most] = [exact - 1e-3, exact + 1e-3].map(code);
        let own = pixel.0[0];
        assert!((least..=most).contains(&own), "{own}, not {least} to {most}, at {x} {y}");
        shared += usize::from(*exact < 0.9 && *exact > 0.1);
        let is_within = |place: &DVec2| {
            place.cmpge(DVec2::ONE).all() && place.cmple(SIZE.as_dvec2() - 1.0).all()
        };
        let Some(place) = to.pixel_from_canvas(canvas).filter(is_within) else { continue };
        // The other's pixels lie askew. Between them light is a line only where it changes slowly:
        // at the corners of what both light, a ramp is a few pixels wide.
        let Some(other) = bilinear_light(&images[1], place) else { continue };
        let own = light(own);
        assert!((own + other - 1.0).abs() < 0.02, "{own} + {other} at {x} {y}");
        seen_together += usize::from(*exact < 0.9 && *exact > 0.1);
    }
    assert!(shared > 500, "only {shared} pixels share their light");
    assert!(seen_together * 10 > shared * 8, "{seen_together} of {shared}");
    assert_eq!(rgb(&draw(&single(), 0, TestPattern::Weights), 7, 7), [255; 3], "alone");
}

/// `None` where four pixels differ by more than a twentieth of all light.
fn bilinear_light(image: &RgbaImage, place: DVec2) -> Option<f64> {
    let from = place - 0.5;
    let (low, t) = (from.floor().as_uvec2(), from - from.floor());
    let of = |x: u32, y: u32| light(rgb(image, (low.x + x).min(319), (low.y + y).min(179))[0]);
    let upper = of(0, 0) * (1.0 - t.x) + of(1, 0) * t.x;
    let four = [of(0, 0), of(1, 0), of(0, 1), of(1, 1)];
    let (least, most) =
        (four.into_iter().fold(1.0, f64::min), four.into_iter().fold(0.0, f64::max));
    let between = upper * (1.0 - t.y) + (of(0, 1) * (1.0 - t.x) + of(1, 1) * t.x) * t.y;
    (most - least < 0.05).then_some(between)
}

#[test]
fn patterns_of_light_are_not_corrected_and_others_are() {
    let mut wall = single();
    let color = &mut wall.channels[0].adjustment.color;
    color.gain = DVec3::new(1.0, 0.25, 1.0);
    color.curve = TransferFunction::Gamma(DVec3::splat(2.0));
    let see = |pattern| {
        draw_pattern(&wall, &CalibrationMaps::default(), ChannelId(0), pattern, (DVec3::ZERO, None))
    };
    let [bars, border] =
        [TestPattern::ColorBars, TestPattern::Border].map(|p| see(p).expect("drawn"));
    assert_eq!(rgb(&bars, 20, 10), [255, 128, 255], "√0.25 of 255");
    assert_eq!(rgb(&border, 0, 0), [255; 3]);
}

#[test]
fn sampling_is_that_of_a_flat_screen() {
    let wall = single();
    let map = wall.channel_mapping(ChannelId(0)).expect("a map");
    // 100 pixels a metre, 2 m away: a metre at the foot of the eye is a half in radians.
    let middle = diagnostic::density_at(&map, DVec3::ZERO, SIZE.as_dvec2() / 2.0).expect("seen");
    let expected = (0.01_f64 / 2.0).to_degrees().recip();
    assert!((middle / expected - 1.0).abs() < 1e-4, "{middle}, not {expected}");
    // To the side pixels are seen askew along their rows, but only further away along columns,
    // where they look longer.
    let right = diagnostic::density_at(&map, DVec3::ZERO, DVec2::new(319.0, 90.0)).expect("seen");
    let (x, z) = (159.0 * 0.01_f64, 2.0);
    let expected = (0.01 / x.hypot(z)).to_degrees().recip();
    assert!((right / expected - 1.0).abs() < 1e-4, "{right}, not {expected}");
    assert_eq!(
        diagnostic::density_at(&map, DVec3::new(0.0, 0.0, -2.0), SIZE.as_dvec2() / 2.0),
        None
    );
    // So many pixels a degree: below the first octave, in its upper half, and in both of the next.
    for (density, color) in
        [(3.5, [106, 0, 0]), (7.0, [160, 0, 0]), (10.0, [146, 66, 0]), (11.5, [220, 100, 0])]
    {
        let mut wall = wall.clone();
        wall.eye.z = 0.01 / 1.0_f64.to_radians() * density - 2.0;
        assert_eq!(rgb(&draw(&wall, 0, TestPattern::Density), 160, 90), color, "{density}");
    }
}

#[test]
fn displays_get_it_as_they_hang() {
    let mut wall = single();
    let upright = draw(&wall, 0, TestPattern::Ramp);
    for turn in [Orientation::None, Orientation::Left, Orientation::Right, Orientation::Half] {
        for packing in [
            StereoPacking::None,
            StereoPacking::SideBySide,
            StereoPacking::TopBottom,
            StereoPacking::Anaglyph,
        ] {
            let adjustment = &mut wall.channels[0].adjustment;
            (adjustment.turn, adjustment.packing) = (turn, packing);
            let image = draw_pattern(
                &wall,
                &CalibrationMaps::default(),
                ChannelId(0),
                TestPattern::Ramp,
                (DVec3::ZERO, None),
            )
            .expect("drawn");
            assert_eq!(image.dimensions(), wall.channels[0].display_size().into(), "{turn:?}");
        }
    }
    let adjustment = &mut wall.channels[0].adjustment;
    *adjustment = ChannelCalibration {
        turn: Orientation::Left,
        mirror: true,
        ..ChannelCalibration::default()
    };
    let image = draw_pattern(
        &wall,
        &CalibrationMaps::default(),
        ChannelId(0),
        TestPattern::Ramp,
        (DVec3::ZERO, None),
    )
    .expect("drawn");
    // The viewer's upper left is mirrored to the upper right, which is the display's lower right.
    assert_eq!(image.get_pixel(SIZE.y - 1, SIZE.x - 1), upright.get_pixel(0, 0));
    assert_eq!(image.get_pixel(0, 0), upright.get_pixel(SIZE.x - 1, SIZE.y - 1));
}

#[test]
fn a_channel_that_a_file_maps_says_so() {
    let mut wall = single();
    wall.channels[0].cover = ChannelKind::Map;
    let image = draw(&wall, 0, TestPattern::Grid);
    assert!(image.pixels().filter(|pixel| pixel.0[0] > 100).count() > 100, "there are words");
    assert_eq!(draw(&wall, 0, TestPattern::Border), draw(&single(), 0, TestPattern::Border));
}

#[test]
fn the_marked_point_is_lit_where_calibration_has_it() {
    use polyptych_wall::calibration_change::{Corner, Edge};
    let mut wall = single();
    let adjustment = &mut wall.channels[0].adjustment;
    adjustment.pin[0] = DVec2::new(40.0, 30.0);
    let moves = (0..9).map(|at| DVec2::splat(if at == 4 { 12.0 } else { 0.0 }));
    adjustment.bend = Some(ControlGrid { points: UVec2::splat(3), moves: moves.collect() });
    let see = |mark| {
        let maps = CalibrationMaps::default();
        draw_pattern(&wall, &maps, ChannelId(0), TestPattern::Border, (DVec3::ZERO, Some(mark)))
            .expect("drawn")
    };
    let red = [255, 32, 32];
    let corner = see(MarkedPoint::Corner(Corner::UpperLeft));
    let is_red = |image: &RgbaImage, at: DVec2| {
        (-4..=4).any(|by| rgb(image, (at.x as i32 + by) as u32, at.y as u32) == red)
    };
    assert!(is_red(&corner, DVec2::new(40.0, 30.0)), "the pinned corner, nearly where it was put");
    let middle = see(MarkedPoint::Bend { column: 1, row: 1 });
    assert_eq!(rgb(&middle, 160 + 12, 90 + 12), red);
    assert_eq!(middle.pixels().filter(|of| of.0[..3] == red).count(), 16, "one mark");
    let right = see(MarkedPoint::Edge(Edge::Right));
    assert!((0..180).any(|y| rgb(&right, 319, y) == red));
    // A point that the bend has no more is not lit.
    let gone = see(MarkedPoint::Bend { column: 9, row: 9 });
    assert!(gone.pixels().all(|of| of.0[..3] != red));
}
