//! The light of walls, against the single picture that they should show.

use std::sync::Arc;

use glam::{DQuat, Vec2, Vec3};
use polyptych_files::blob::BlobHash;

use super::super::blend::tests::walls::{askew, grid, tiles};
use super::super::blend::{BlendMap, BlendModel, ChannelMasks, blend_map};
use super::super::calibration_maps::CalibrationMaps;
use super::super::projector::Projector;
use super::super::wall_geometry::WallGeometry;
use super::super::warp::{
    CalibrationMap, ImportedMesh, ImportedVertex, MapCoordinates, WarpGeometry, WarpMap,
};
use super::super::{CalibrationFile, CalibrationFileKind, Surface};
use super::*;

/// Beside the rounding of codes there is that of weights to 16 bits: this share of a level.
const MAP_LEVELS: f64 = 0.002;

fn of_gamma(mut wall: Wall, gamma: f64, leak: f64) -> Wall {
    wall.blend.leak = leak;
    for channel in &mut wall.channels {
        channel.adjustment.color.curve = TransferFunction::Gamma(DVec3::splat(gamma));
    }
    wall
}

/// The codes of a channel that is to show `light` at each of its pixels, as its renderer makes
/// them.
fn codes(
    blend: &BlendModel<'_>,
    (id, channel): (ChannelId, &Channel),
    map: Option<&BlendMap>,
    light: impl Fn(UVec2) -> Option<f64>,
) -> Vec<u8> {
    let pixels = (0..channel.size.y).flat_map(|y| (0..channel.size.x).map(move |x| (x, y)));
    let color = blend.color(id).expect("a channel");
    let code = |(x, y)| {
        let plain = [DVec3::ONE, DVec3::ZERO];
        let [multiply, add] = map.map_or(plain, |map| map.light_at(x, y));
        let light = light(UVec2::new(x, y)).unwrap_or(0.0);
        let code = color.codes(DVec3::splat(light), multiply, add);
        let [r, g, b] = (code * 255.0).round().to_array();
        [r as u8, g as u8, b as u8, 255]
    };
    pixels.flat_map(code).collect()
}

fn superposition<'a>(wall: &'a Wall, codes: &'a [Vec<u8>]) -> LightComposite<'a> {
    let pictures: Vec<_> = wall
        .channel_ids()
        .zip(codes)
        .map(|(channel, rgba)| DisplayImage { channel, rgba })
        .collect();
    LightComposite::new(wall, 0, StereoEye::Left, &pictures)
}

/// Levels from the single picture, by how many channels light a place: the worst ones of all
/// pixels and of lights from black to white.
fn worst_levels(wall: &Wall, gamma: f64) -> Vec<f64> {
    let maps: Vec<_> =
        wall.channel_ids().map(|id| blend_map(wall, id, &ChannelMasks::default())).collect();
    let blend = BlendModel::new(wall);
    let (leak, most) = (wall.blend.leak, blend.overlap_max());
    let mut worst = vec![0.0_f64; most + 1];
    let counts = |at: UVec2| {
        let has = |c: &&Channel| at.cmpge(c.origin).all() && at.cmplt(c.origin + c.size).all();
        wall.channels.iter().filter(has).count()
    };
    for step in 0..=128 {
        let light = (f64::from(step) / 128.0).powf(gamma);
        let all: Vec<_> = wall
            .channel_ids()
            .zip(&wall.channels)
            .zip(&maps)
            .map(|(channel, map)| codes(&blend, channel, map.as_ref(), |_| Some(light)))
            .collect();
        let shown = superposition(wall, &all);
        let due = most as f64 * leak + (1.0 - most as f64 * leak) * light;
        let level = |light: f64| 255.0 * light.powf(1.0 / gamma);
        for y in 0..wall.screens[0].canvas.y {
            for (x, found) in (0..).zip(shown.row(y)) {
                let count = counts(UVec2::new(x, y));
                assert_eq!(found.is_some(), count > 0);
                let Some(found) = found else { continue };
                worst[count] = worst[count].max((level(found.x) - level(due)).abs());
            }
        }
    }
    worst
}

#[test]
fn codes_of_tiles_add_up_to_the_single_picture() {
    let walls = [
        grid(UVec2::new(2, 2), UVec2::new(22, 20), UVec2::new(9, 8)),
        tiles([34, 26], &[([0, 0], [24, 16]), ([10, 0], [24, 16]), ([5, 6], [24, 20])]),
        tiles([9, 9], &[([0, 0], [9, 9]); 3]),
    ];
    for gamma in [1.8, 2.2, 2.6] {
        for leak in [0.0, 0.003] {
            for wall in &walls {
                let wall = of_gamma(wall.clone(), gamma, leak);
                for (count, levels) in worst_levels(&wall, gamma).into_iter().enumerate().skip(1) {
                    let limit = 0.5 * (count as f64).powf(1.0 / gamma);
                    println!("γ {gamma}, leak {leak}, k {count}: {levels:.3} of {limit:.3} levels");
                    assert!(levels <= limit + MAP_LEVELS, "{levels} levels");
                }
            }
        }
    }
}

#[test]
fn codes_of_projectors_add_up_to_the_single_picture() {
    let gamma = 2.2;
    for (is_round, leak) in [(false, 0.0), (true, 0.0), (false, 0.003), (true, 0.003)] {
        let wall = of_gamma(askew(is_round, UVec2::new(240, 150), 0.06), gamma, leak);
        let blend = BlendModel::new(&wall);
        let most = blend.overlap_max() as f64;
        let level = |light: f64| 255.0 * light.powf(1.0 / gamma);
        let picture = |at: DVec2| 0.5 + 0.3 * (at.x / 13.0).sin() * (at.y / 17.0).cos();
        let due = |at: DVec2| most * leak + (1.0 - most * leak) * picture(at);
        let codes = |id: ChannelId| {
            let (channel, map) = (wall.channel(id)?, wall.channel_mapping(id)?);
            let light =
                |pixel: UVec2| Some(picture(map.canvas_from_pixel(pixel.as_dvec2() + 0.5)?));
            Some(codes(
                &blend,
                (id, channel),
                blend_map(&wall, id, &ChannelMasks::default()).as_ref(),
                light,
            ))
        };
        let all: Vec<_> = wall.channel_ids().filter_map(codes).collect();
        let shown = superposition(&wall, &all);
        let mut off = Vec::new();
        for y in 0..wall.screens[0].canvas.y {
            for (x, found) in (0..).zip(shown.row(y)) {
                let at = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                assert_eq!(shown.light(at), found);
                let count = |at: DVec2| blend.weights(ChannelId(0), at).len();
                let around = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y];
                // At an edge of a picture that leaks, half of a pixel counts as a whole one.
                let is_even = || around.iter().all(|d| count(at + *d * 1.5) == count(at));
                let Some(found) = found.filter(|_| leak == 0.0 || is_even()) else { continue };
                off.push((level(found.x) - level(due(at))).abs());
            }
        }
        off.sort_unstable_by(f64::total_cmp);
        // Where outer edges of two pictures cross, weights change within a pixel, and no picture
        // of pixels is exact: a few places of thousands.
        let (most_off, largest) = (off[off.len() * 999 / 1000], off[off.len() - 1]);
        let above = off.iter().filter(|levels| **levels > 1.0).count();
        println!(
            "round {is_round}, leak {leak}: 99.9 % of {} pixels within {most_off:.3} levels, \
             {above} above 1, at most {largest:.1}",
            off.len()
        );
        assert!(off.len() > 40_000 && most_off < 1.0, "{most_off} levels");
    }
}

/// A screen of three sheets in a file: a slit between two of them is dark, and a strip beside them
/// lit, although both are narrower than what is looked at of a row.
#[test]
fn slits_of_a_mesh_are_dark_and_its_strips_lit() {
    let mut wall = tiles([96, 8], &[([0, 0], [100, 20])]);
    wall.channels[0].cover = ChannelKind::Projector(Box::new(Projector {
        position: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        tangents: [-0.5, 0.5, -0.1, 0.1],
    }));
    let sheets: [[u16; 2]; 3] = [[0, 34], [39, 80], [83, 86]];
    let vertex = |column: u16, v: f32| {
        let place = Vec2::new(f32::from(column) / 96.0, v);
        let value = Vec3::new(place.x - 0.5, 0.04 - 0.08 * v, -2.0);
        ImportedVertex { place, value, light: 1.0 }
    };
    let corners = |[left, right]: [u16; 2]| {
        [vertex(left, 0.0), vertex(right, 0.0), vertex(left, 1.0), vertex(right, 1.0)]
    };
    let vertices = sheets.map(corners).concat();
    let triangles = [0, 4, 8].map(|at| [[at, at + 1, at + 2], [at + 2, at + 1, at + 3]]).concat();
    let shape = WarpGeometry::Mesh(ImportedMesh { vertices, triangles });
    let map = Arc::new(CalibrationMap::Warp(WarpMap { space: MapCoordinates::Display, shape }));
    wall.screens[0].surface = Surface::Mesh(0);
    wall.files.push(CalibrationFile {
        path: "sheets.obj".into(),
        kind: CalibrationFileKind::ScreenMesh,
        blob: Some(BlobHash([7; 32])),
        is_for_one_eye: false,
        front: Vec::new(),
    });
    let maps = CalibrationMaps::load(&wall, |_| Ok(Arc::clone(&map))).expect("sound");
    let shapes = WallGeometry::new(&wall, &maps);
    let rgba = vec![255; 4 * 100 * 20];
    let picture = [DisplayImage { channel: ChannelId(0), rgba: &rgba }];
    let of = ResolvedWall { wall: &wall, shapes: &shapes };
    let shown = LightComposite::new(of, 0, StereoEye::Left, &picture);
    for y in 0..8 {
        for (x, light) in (0..).zip(shown.row(y)) {
            let is_lit = sheets.iter().any(|[left, right]| (*left..*right).contains(&x));
            assert_eq!(light.is_some(), is_lit, "({x}, {y})");
        }
    }
}

/// The upright code of each pixel, in red.
fn upright_codes(channel: &Channel, rgba: &[u8], side: StereoEye, wall: &Wall) -> Vec<u8> {
    let picture = [DisplayImage { channel: ChannelId(0), rgba }];
    let shown = LightComposite::new(wall, 0, side, &picture);
    let codes = super::super::color::SrgbCodes::default();
    let rows = (0..channel.size.y).flat_map(|y| shown.row(y));
    rows.map(|light| codes.code(light.expect("lit").x)).collect()
}

#[test]
fn displays_that_hang_otherwise_are_put_upright() {
    let (none, left) = (StereoPacking::None, StereoEye::Left);
    let (sbs, tb, right) = (StereoPacking::SideBySide, StereoPacking::TopBottom, StereoEye::Right);
    let a = [1, 2, 3, 4, 5, 6];
    let b = [11, 12, 13, 14, 15, 16];
    // A picture of 3 × 2, as displays get it.
    type Case<'a> = (Orientation, bool, StereoPacking, StereoEye, &'a [u8], [u8; 6]);
    let cases: [Case<'_>; 11] = [
        (Orientation::None, false, none, left, &[1, 2, 3, 4, 5, 6], a),
        (Orientation::None, true, none, left, &[3, 2, 1, 6, 5, 4], a),
        (Orientation::Half, false, none, left, &[6, 5, 4, 3, 2, 1], a),
        (Orientation::Left, false, none, left, &[4, 1, 5, 2, 6, 3], a),
        (Orientation::Right, false, none, left, &[3, 6, 2, 5, 1, 4], a),
        (Orientation::Left, true, none, left, &[6, 3, 5, 2, 4, 1], a),
        (Orientation::None, false, sbs, left, &[1, 2, 3, 11, 12, 13, 4, 5, 6, 14, 15, 16], a),
        (Orientation::None, false, sbs, right, &[1, 2, 3, 11, 12, 13, 4, 5, 6, 14, 15, 16], b),
        (Orientation::None, true, tb, right, &[3, 2, 1, 6, 5, 4, 13, 12, 11, 16, 15, 14], b),
        (Orientation::Half, false, sbs, right, &[6, 5, 4, 16, 15, 14, 3, 2, 1, 13, 12, 11], b),
        (Orientation::Left, false, tb, left, &[4, 1, 5, 2, 6, 3, 14, 11, 15, 12, 16, 13], a),
    ];
    for (turn, mirror, packing, side, display, expected) in cases {
        let mut wall = tiles([3, 2], &[([0, 0], [3, 2])]);
        let adjustment =
            ChannelCalibration { turn, mirror, packing, ..ChannelCalibration::default() };
        wall.channels[0].adjustment = adjustment;
        let rgba: Vec<u8> = display.iter().flat_map(|code| [*code, 0, 0, 255]).collect();
        let found = upright_codes(&wall.channels[0], &rgba, side, &wall);
        assert_eq!(found, expected, "{turn:?}, {mirror}, {packing:?}, {side:?}");
        let is_plain = turn == Orientation::None && !mirror && packing == StereoPacking::None;
        assert_eq!(needs_composite(&wall, 0, side), !is_plain);
    }
}

#[test]
fn tiles_that_overlap_are_superposed_whatever_shares_their_light() {
    let mut wall = tiles([3, 1], &[([0, 0], [2, 1]), ([1, 0], [2, 1])]);
    assert!(needs_composite(&wall, 0, StereoEye::Left));
    for channel in &mut wall.channels {
        channel.adjustment.ramps = crate::Ramps::Alpha;
    }
    assert!(needs_composite(&wall, 0, StereoEye::Left));
    wall.channels[1].origin.x = 2;
    assert!(!needs_composite(&wall, 0, StereoEye::Left));
}

#[test]
fn each_eye_sees_its_own_channels() {
    let mut wall = tiles([2, 1], &[([0, 0], [2, 1]), ([0, 0], [2, 1])]);
    assert_eq!(StereoEye::of(&wall, 0), [StereoEye::Left]);
    assert!(needs_composite(&wall, 0, StereoEye::Left));
    wall.channels[0].adjustment.eye = Eye::Left;
    wall.channels[1].adjustment.eye = Eye::Right;
    assert_eq!(StereoEye::of(&wall, 0), [StereoEye::Left, StereoEye::Right]);
    assert!(
        !needs_composite(&wall, 0, StereoEye::Left) && !needs_composite(&wall, 0, StereoEye::Right)
    );
    let pictures = [[255; 8], [0; 8]];
    let pictures: Vec<_> = wall
        .channel_ids()
        .zip(&pictures)
        .map(|(channel, rgba)| DisplayImage { channel, rgba })
        .collect();
    let seen = |side| LightComposite::new(&wall, 0, side, &pictures).light(DVec2::splat(0.5));
    assert_eq!(seen(StereoEye::Left), Some(DVec3::ONE));
    assert_eq!(seen(StereoEye::Right), Some(DVec3::ZERO));
    // Coloured glasses let through what is theirs.
    let mut wall = tiles([2, 1], &[([0, 0], [2, 1])]);
    wall.channels[0].adjustment.packing = StereoPacking::Anaglyph;
    let picture = [DisplayImage { channel: ChannelId(0), rgba: &[255; 8] }];
    let seen = |side| LightComposite::new(&wall, 0, side, &picture).light(DVec2::splat(0.5));
    assert_eq!(seen(StereoEye::Left), Some(DVec3::X));
    assert_eq!(seen(StereoEye::Right), Some(DVec3::new(0.0, 1.0, 1.0)));
}

#[test]
fn pictures_that_do_not_fit_give_no_light() {
    let wall = tiles([4, 1], &[([0, 0], [2, 1]), ([2, 0], [2, 1])]);
    let pictures = [
        DisplayImage { channel: ChannelId(0), rgba: &[255; 7] },
        DisplayImage { channel: ChannelId(1), rgba: &[255; 8] },
        DisplayImage { channel: ChannelId(7), rgba: &[255; 8] },
    ];
    let shown = LightComposite::new(&wall, 0, StereoEye::Left, &pictures);
    assert_eq!(shown.row(0), [None, None, Some(DVec3::ONE), Some(DVec3::ONE)]);
    assert_eq!(shown.row(1), [None; 4]);
    assert_eq!(LightComposite::new(&wall, 9, StereoEye::Left, &pictures).row(0), []);
}
