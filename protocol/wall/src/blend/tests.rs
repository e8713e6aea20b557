//! Weights and black, against what the formulas promise.

mod eyes;
mod random;
pub(crate) mod walls;

use glam::{DQuat, DVec2, UVec2};
use proptest::prelude::*;
use walls::{askew, grid, tiles};

use super::super::{BlendWidths, Eye, Ramps, Wall};
use super::*;
use crate::ChannelKind;
use crate::projector::Projector;
use crate::surface::{Cylinder, Surface};

/// Maximum error of the sum of weights.
const SUM_ERROR_MAX: f64 = 1.0 / 4096.0;

/// The light maps of all channels; what has none, has weight 1.
fn maps(wall: &Wall) -> Vec<Option<BlendMap>> {
    wall.channel_ids().map(|id| blend_map(wall, id, &ChannelMasks::default())).collect()
}

/// The largest error of a sum of rounded weights over all pixels of a wall of tiles, and how many
/// channels light its places at most.
fn tile_error(wall: &Wall) -> (f64, usize) {
    let maps = maps(wall);
    let canvas = wall.screens[0].canvas;
    let (mut sums, mut counts) =
        (vec![0.0; (canvas.x * canvas.y) as usize], vec![0; (canvas.x * canvas.y) as usize]);
    for (channel, map) in wall.channels.iter().zip(&maps) {
        for y in 0..channel.size.y {
            for x in 0..channel.size.x {
                let at = channel.origin + UVec2::new(x, y);
                let at = (at.y * canvas.x + at.x) as usize;
                sums[at] += map.as_ref().map_or(1.0, |map| map.texel(x, y, 0)[0]);
                counts[at] += 1;
            }
        }
    }
    let lit = sums.iter().zip(&counts).filter(|(_, count)| **count > 0);
    let error = lit.map(|(sum, _)| (sum - 1.0).abs()).fold(0.0, f64::max);
    (error, counts.into_iter().max().unwrap_or(0))
}

/// The largest error over some pixels of every channel: its own rounded weight, and the others'
/// exact ones at the same place.
fn askew_error(wall: &Wall, step: u32) -> (f64, usize) {
    let blend = BlendModel::new(wall);
    let (mut error, mut most) = (0.0_f64, 0);
    for (id, map) in wall.channel_ids().zip(maps(wall)) {
        let (Some(pixels), Some(channel)) = (wall.channel_mapping(id), wall.channel(id)) else {
            continue;
        };
        for y in (0..channel.size.y).step_by(step as usize) {
            for x in (0..channel.size.x).step_by(step as usize) {
                let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let Some(canvas) = pixels.canvas_from_pixel(pixel) else { continue };
                let own = map.as_ref().map_or(1.0, |map| map.texel(x, y, 0)[0]);
                let weights = blend.weights(id, canvas);
                let others = weights.iter().filter(|(other, _)| *other != id);
                let sum: f64 = own + others.map(|(_, weight)| weight).sum::<f64>();
                error = error.max((sum - 1.0).abs());
                most = most.max(weights.len());
            }
        }
    }
    (error, most)
}

fn assert_sums((error, most): (f64, usize), expected: usize, name: &str) {
    println!("{name}: sums of up to {most} weights are off by {error:.2e} at most");
    assert_eq!(most, expected, "{name}");
    assert!(error <= SUM_ERROR_MAX, "{name}: {error:e}");
}

#[test]
fn weights_of_a_power_wall_add_up_to_one() {
    let wall = grid(UVec2::new(3, 2), UVec2::new(200, 120), UVec2::new(30, 18));
    assert_sums(tile_error(&wall), 4, "3 × 2 with 15 %");
    let blend = BlendModel::new(&wall);
    assert_eq!(blend.overlap_max(), 4);
    assert_eq!(blend.ramp_widths(ChannelId(1)), [Some(30.0), Some(30.0), None, Some(18.0)]);
    // The ramp itself: a smooth step between both edges, the same in every row.
    let map = blend_map(&wall, ChannelId(0), &ChannelMasks::default()).expect("a map");
    for x in 0..30 {
        let t = (30.0 - f64::from(x) - 0.5) / 30.0;
        let expected = t * t * (3.0 - 2.0 * t);
        let found = map.texel(170 + x, 50, 0)[0];
        assert!((found - expected).abs() < 1e-5, "{found}, not {expected}");
    }
    assert_eq!(map.texel(100, 50, 0), [1.0, 0.0]);
}

#[test]
fn one_to_four_channels_share_a_point() {
    for count in 1..=4 {
        let offsets = [[0, 0], [40, 0], [0, 30], [40, 30]];
        let rects: Vec<_> = offsets[..count].iter().map(|at| (*at, [100, 80])).collect();
        let wall = tiles([140, 110], &rects);
        let name = format!("{count} over a point");
        assert_sums(tile_error(&wall), count, &name);
        assert_eq!(BlendModel::new(&wall).overlap_max(), count);
    }
    // All of four pictures on each other: no edge is beside another, so that each has a quarter.
    let wall = tiles([64, 48], &[([0, 0], [64, 48]); 4]);
    assert_sums(tile_error(&wall), 4, "stacked");
    assert!((maps(&wall)[3].as_ref().expect("a map").texel(0, 0, 0)[0] - 0.25).abs() < 1e-5);
}

#[test]
fn an_overlap_of_parts_per_million_is_shared() {
    let wall = tiles([16383, 4], &[([0, 0], [8192, 4]), ([8191, 0], [8192, 4])]);
    assert_sums(tile_error(&wall), 2, "one pixel of 8,192");
    let map = maps(&wall)[0].clone().expect("a map");
    assert!((map.texel(8191, 2, 0)[0] - 0.5).abs() < 1e-5);
    assert_eq!(map.texel(8190, 2, 0)[0], 1.0);
    // One corner pixel of two pictures.
    let wall = tiles([199, 99], &[([0, 0], [100, 50]), ([99, 49], [100, 50])]);
    assert_sums(tile_error(&wall), 2, "one pixel at a corner");
}

#[test]
fn edges_of_no_width_divide_by_nothing() {
    for (left, right) in [(Some(0.0), Some(0.0)), (Some(0.0), None), (Some(7.5), Some(0.0))] {
        let mut wall = grid(UVec2::new(2, 2), UVec2::new(60, 40), UVec2::new(20, 10));
        for channel in &mut wall.channels {
            channel.adjustment.edges =
                BlendWidths { left, right, top: Some(0.0), bottom: Some(500.0) };
        }
        assert_sums(tile_error(&wall), 4, "edges of no width");
    }
    // Tiles that touch have no map.
    let wall = grid(UVec2::new(2, 2), UVec2::new(60, 40), UVec2::ZERO);
    assert_eq!(maps(&wall), vec![None; 4]);
    // No exponent makes a weight of nothing.
    for exponent in [1e-300, 0.5, 3.0, 1e300] {
        let mut wall = grid(UVec2::new(2, 1), UVec2::new(60, 40), UVec2::new(20, 0));
        wall.blend.exponent = exponent;
        assert_sums(tile_error(&wall), 2, &format!("exponent {exponent:e}"));
    }
}

#[test]
fn projectors_askew_share_planes_and_cylinders() {
    for (is_round, expected) in [(false, 4), (true, 4)] {
        let wall = askew(is_round, UVec2::new(160, 100), 0.06);
        let name = if is_round { "askew on a cylinder" } else { "askew on a plane" };
        assert_sums(askew_error(&wall, 1), expected, name);
        assert_eq!(BlendModel::new(&wall).overlap_max(), expected, "{name}");
    }
}

/// A screen that of each picture only the middle finds, where places are looked at.
#[test]
fn projectors_share_a_screen_that_is_small_in_their_pictures() {
    let mut wall = tiles([100, 80], &[([0, 0], [480, 320]); 2]);
    wall.screens[0].surface = Surface::Cylinder(Cylinder {
        center: DVec3::Z * 2.0,
        rotation: DQuat::IDENTITY,
        radius_m: 12.0,
        azimuth_rad: [-0.5 / 12.0, 0.5 / 12.0],
        height_m: [-0.4, 0.4],
    });
    for (channel, side) in wall.channels.iter_mut().zip([-1.0, 1.0]) {
        channel.cover = ChannelKind::Projector(Box::new(Projector {
            position: DVec3::X * (0.2 * side),
            rotation: DQuat::from_rotation_y(0.045 * side),
            tangents: [-0.577, 0.577, -0.385, 0.385],
        }));
    }
    let blend = BlendModel::new(&wall);
    assert_eq!(blend.neighbours(ChannelId(0)), [ChannelId(1)]);
    assert_eq!(blend.overlap_max(), 2, "along the edges of the screen");
    assert_sums(askew_error(&wall, 1), 2, "small");
}

#[test]
fn bent_and_pinned_pictures_share_too() {
    let mut wall = askew(false, UVec2::new(160, 100), 0.05);
    walls::bend(&mut wall);
    assert_sums(askew_error(&wall, 3), 4, "bent");
}

#[test]
fn eyes_share_nothing_with_each_other() {
    let mut wall = tiles([90, 40], &[([0, 0], [50, 40]), ([40, 0], [50, 40])]);
    let mut right = wall.channels.clone();
    wall.channels.iter_mut().for_each(|channel| channel.adjustment.eye = Eye::Left);
    for channel in &mut right {
        channel.adjustment.eye = Eye::Right;
        channel.name.push_str("-right");
    }
    let alone = maps(&wall);
    wall.channels.extend(right);
    let both = maps(&wall);
    assert_eq!(both[..2], alone);
    assert_eq!(both[2..], alone);
    assert_eq!(BlendModel::new(&wall).overlap_max(), 2);
}

/// Returns what a display shows at a pixel where the wall should show this light, in light of the
/// wall.
fn shown(wall: &Wall, id: ChannelId, at: (f64, [DVec3; 2]), color: &ColorCorrection) -> DVec3 {
    let (light, [factor, addend]) = at;
    let channel = wall.channel(id).expect("a channel");
    let own = color.made() * DVec3::splat(light) * factor + addend;
    assert!(own.cmpge(DVec3::ZERO).all() && own.cmple(DVec3::splat(1.0 + 1e-5)).all(), "{own}");
    let leak = wall.leak_of(channel);
    channel.adjustment.color.made().inverse() * (leak + (DVec3::ONE - leak) * own)
}

/// The most that the light of a wall of tiles is off B + (1 − B)·I, over black, grey and white.
fn black_error(wall: &Wall, black: DVec3) -> f64 {
    let (maps, blend) = (maps(wall), BlendModel::new(wall));
    assert!((blend.black() - black).abs().max_element() < 1e-12, "{}", blend.black());
    let canvas = wall.screens[0].canvas;
    let mut worst = 0.0_f64;
    for light in [0.0, 0.4, 0.7] {
        let mut sums = vec![DVec3::ZERO; (canvas.x * canvas.y) as usize];
        for (id, map) in wall.channel_ids().zip(&maps) {
            let (channel, color) = (wall.channel(id).expect("one"), blend.color(id).expect("one"));
            for y in 0..channel.size.y {
                for x in 0..channel.size.x {
                    let place = channel.origin + UVec2::new(x, y);
                    let plain = [DVec3::ONE, DVec3::ZERO];
                    let by = map.as_ref().map_or(plain, |map| map.light_at(x, y));
                    sums[(place.y * canvas.x + place.x) as usize] +=
                        shown(wall, id, (light, by), &color);
                }
            }
        }
        let due = black + (DVec3::ONE - black) * light;
        let off = sums.iter().map(|sum| (*sum - due).abs().max_element());
        worst = off.fold(worst, f64::max);
    }
    worst
}

#[test]
fn black_is_one_black() {
    for leak in [0.003, 0.05, 0.2] {
        let mut wall = grid(UVec2::new(3, 2), UVec2::new(80, 60), UVec2::new(12, 10));
        wall.blend.leak = leak;
        let worst = black_error(&wall, DVec3::splat(4.0 * leak));
        println!("leak {leak}: black and white are off by {worst:.2e} of white at most");
        assert!(worst < 6e-5, "{worst}");
    }
    // One channel, or none beside another: its own black is the wall's.
    let mut wall = grid(UVec2::new(2, 1), UVec2::new(60, 40), UVec2::ZERO);
    wall.blend.leak = 0.01;
    assert_eq!(maps(&wall), [None, None]);
    // Four that leak more than all the light there is: black, and no number that is none.
    let mut wall = tiles([64, 48], &[([0, 0], [64, 48]); 4]);
    wall.blend.leak = 0.5;
    let blend = BlendModel::new(&wall);
    let color = blend.color(ChannelId(0)).expect("a channel");
    assert_eq!((blend.black(), color.made()), (DVec3::ONE, DMat3::ZERO));
    let map = blend_map(&wall, ChannelId(0), &ChannelMasks::default()).expect("a map");
    assert_eq!(map.texel(3, 3, 1), [0.25, 0.0].map(|part: f64| (part * 65535.0).round() / 65535.0));
}

/// Projectors whose leaks, gains and colours differ show one black, and one white.
#[test]
fn blacks_that_differ_become_one() {
    let mut wall = grid(UVec2::new(3, 1), UVec2::new(80, 60), UVec2::new(12, 0));
    wall.blend.leak = 0.01;
    wall.channels[0].adjustment.color.gain = DVec3::splat(0.8);
    // 0.0125 and 0.01 where both leak.
    let worst = black_error(&wall, DVec3::splat(0.0225));
    assert!(worst < 4e-5, "{worst}");
    assert_eq!(
        BlendModel::new(&wall)
            .blend_map(ChannelId(1), &ChannelMasks::default())
            .map(|m| m.add.x > 0.0),
        Some(true)
    );
    // A warm leak beside a cold one, and colours that are mixed.
    wall.channels[1].adjustment.color.leak = Some(DVec3::new(0.02, 0.01, 0.002));
    wall.channels[2].adjustment.color.leak = Some(DVec3::new(0.0, 0.004, 0.03));
    wall.channels[1].adjustment.color.matrix =
        DMat3::from_cols_array(&[0.9, 0.05, 0.0, 0.04, 0.85, 0.02, 0.0, 0.03, 0.95]);
    let own: Vec<_> = wall
        .channels
        .iter()
        .map(|channel| channel.adjustment.color.made().inverse() * wall.leak_of(channel))
        .collect();
    let black = (own[0] + own[1]).max(own[1] + own[2]);
    let worst = black_error(&wall, black);
    println!("blacks of their own: off by {worst:.2e} of white at most");
    assert!(worst < 4e-5, "{worst}");
    let texels = maps(&wall)[1].as_ref().expect("a map").texels.len();
    assert_eq!(texels, 3 * 80 * 60, "colours of their own");
    // Nothing undoes a gain of about 0: no light is lost to a black without bound.
    for gain in [0.0, 0.003, 0.03] {
        wall.channels[0].adjustment.color.gain = DVec3::splat(gain);
        assert!(BlendModel::new(&wall).black().max_element() < 0.1, "{gain}");
    }
    // Nor a matrix that leaves almost no colour, before gains that tint.
    let [red, green, blue] = [0.2126, 0.7152, 0.0722].map(DVec3::splat);
    let grey = DMat3::from_cols(red, green, blue);
    wall.channels[0].adjustment.color.gain = DVec3::new(1.0, 0.9, 1.0);
    for colour in [0.0, 0.001] {
        wall.channels[0].adjustment.color.matrix =
            grey + DMat3::from_diagonal(DVec3::splat(colour));
        assert!(BlendModel::new(&wall).black().max_element() < 0.1, "{colour}");
    }
}

#[test]
fn masks_multiply_and_add() {
    let mut wall = grid(UVec2::new(2, 1), UVec2::new(60, 40), UVec2::new(20, 0));
    wall.blend.leak = 0.01;
    let bare = blend_map(&wall, ChannelId(0), &ChannelMasks::default()).expect("a map");
    let texels: Vec<u16> = (0..60 * 40).map(|at| (at * 27) as u16).collect();
    let beta = [6553, 13106, 0];
    let masks = ChannelMasks {
        alpha: MaskTexels::new(UVec2::new(60, 40), 1, &texels),
        beta: MaskTexels::new(UVec2::ONE, 3, &beta),
        light: None,
    };
    let map = blend_map(&wall, ChannelId(0), &masks).expect("a map");
    for (x, y) in [(0, 0), (17, 30), (59, 39), (45, 3)] {
        let alpha = f64::from(texels[(y * 60 + x) as usize]) / 65535.0;
        let [factor, addend] = bare.texel(x, y, 0);
        // P·α·(1 − β) + β: *MPCDI 2.0*, §2.4.
        for (colour, beta) in beta.iter().enumerate() {
            let [own, added] = map.texel(x, y, colour);
            let beta = f64::from(*beta) / 65535.0;
            let due = alpha * (1.0 - beta);
            assert!((own - factor * due).abs() < 2e-5, "{own}");
            assert!((added - (addend * due + beta)).abs() < 2e-5, "{added}");
        }
    }
    // Half as large as the picture: between its pixels.
    let ramp: Vec<u16> = (0..30).map(|x| x * 2000).collect();
    let masks = ChannelMasks {
        alpha: MaskTexels::new(UVec2::new(30, 1), 1, &ramp),
        ..ChannelMasks::default()
    };
    let map = blend_map(&wall, ChannelId(0), &masks).expect("a map");
    let [left, right] = [10, 11].map(|x| map.texel(x, 5, 0)[0]);
    assert!((right - left - 1000.0 / 65535.0).abs() < 3e-5);
    assert!(MaskTexels::new(UVec2::new(30, 2), 1, &ramp).is_none());
    assert!(MaskTexels::new(UVec2::ZERO, 1, &[]).is_none());
}

/// An alpha file that says how light fades is all that shares it.
#[test]
fn ramps_of_an_alpha_file_replace_those_that_are_computed() {
    let mut wall = askew(false, UVec2::new(160, 100), 0.06);
    wall.blend.leak = 0.003;
    let size = UVec2::new(160, 100);
    let texels: Vec<u16> = (0..160 * 100).map(|at| (at * 4) as u16).collect();
    let masks =
        ChannelMasks { alpha: MaskTexels::new(size, 1, &texels), ..ChannelMasks::default() };
    let shared = blend_map(&wall, ChannelId(0), &masks).expect("a map");
    for channel in &mut wall.channels {
        (channel.adjustment.alpha, channel.adjustment.ramps) = (Some(0), Ramps::Alpha);
    }
    let map = blend_map(&wall, ChannelId(0), &masks).expect("a map");
    let mut replaced = 0;
    for (at, texel) in (0_u32..).zip(&texels) {
        let (x, y) = (at % 160, at / 160);
        let alpha = f64::from(*texel) / 65535.0;
        assert!((map.texel(x, y, 0)[0] - alpha).abs() < 1e-9, "{x}, {y}");
        replaced += usize::from((shared.texel(x, y, 0)[0] - alpha).abs() > 1e-3);
    }
    assert!(replaced > 1_000, "{replaced} pixels had a ramp");
    let blend = BlendModel::new(&wall);
    assert_eq!(blend.overlap_max(), 1);
    assert!(blend.may_light_same());
    // Where both light a place, each gives all that its own file leaves.
    let middle = blend.weights(ChannelId(0), wall.screens[0].canvas.as_dvec2() / 2.0);
    assert!(middle.len() > 1 && middle.iter().all(|(_, weight)| *weight == 1.0), "{middle:?}");
}

fn random_wall() -> impl Strategy<Value = Wall> {
    let rect = (0_u32..60, 0_u32..40, 1_u32..80, 1_u32..60);
    let edge = prop_oneof![Just(None), (0.0..40.0).prop_map(Some)];
    let edges = (edge.clone(), edge.clone(), edge.clone(), edge);
    let channel = (rect, edges);
    (prop::collection::vec(channel, 1..6), 0.3..4.0).prop_map(|(channels, exponent)| {
        let rects: Vec<_> = channels.iter().map(|((x, y, w, h), _)| ([*x, *y], [*w, *h])).collect();
        let mut wall = tiles([140, 100], &rects);
        for (channel, (_, (left, right, top, bottom))) in wall.channels.iter_mut().zip(channels) {
            channel.adjustment.edges = BlendWidths { left, right, top, bottom };
        }
        wall.blend.exponent = exponent;
        wall
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn weights_of_random_walls_add_up_to_one(wall in random_wall()) {
        let (error, most) = tile_error(&wall);
        prop_assert!(error <= SUM_ERROR_MAX, "{error:e} of {most}");
        prop_assert_eq!(BlendModel::new(&wall).overlap_max(), most);
    }

    #[test]
    fn weights_of_random_projectors_add_up_to_one(
        is_round in any::<bool>(), turn in -0.3..0.3, exponent in 0.5..3.0,
    ) {
        let mut wall = askew(is_round, UVec2::new(96, 64), turn);
        wall.blend.exponent = exponent;
        let (error, _) = askew_error(&wall, 5);
        prop_assert!(error <= SUM_ERROR_MAX, "{error:e}");
    }
}
