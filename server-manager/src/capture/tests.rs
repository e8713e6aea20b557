//! Pictures of walls, from those of their channels.

use std::num::NonZeroU32;

use glam::{DVec2, DVec3, UVec2};
use polyptych_core::SessionId;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::ids::RequestId;
use polyptych_wall::blend::{BlendModel, ChannelMasks};
use polyptych_wall::surface::{Plane, Surface};
use polyptych_wall::{
    CalibrationFile, CalibrationFileKind, ChannelKind, Eye, Orientation, Screen, StereoPacking,
};

use super::*;

/// A wall of two tiles of 6 × 4 pixels, the second one `apart` pixels behind the first one's
/// begin.
fn two_tiles(apart: u32) -> Wall {
    let (size, canvas) = (UVec2::new(6, 4), UVec2::new(6 + apart, 4));
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0));
    let channels = [0, apart]
        .map(|x| Channel::tile(&format!("front-{x}"), 0, UVec2::new(x, 0), size))
        .to_vec();
    Wall::new("w", vec![Screen::new("front", Surface::Plane(plane), canvas)], channels)
}

/// Stitches pictures that came in whole, one for each channel; `None` is one that did not come.
fn stitched(wall: &Wall, pictures: &[Option<Vec<u8>>]) -> Vec<CaptureImage> {
    stitched_by(NonZeroU32::MIN, wall, pictures)
}

/// Stitches pictures of squares of pixels.
fn stitched_by(side: NonZeroU32, wall: &Wall, pictures: &[Option<Vec<u8>>]) -> Vec<CaptureImage> {
    collected(side, wall, pictures).stitch().0
}

/// Collects pictures of squares of pixels; no blob of the wall is there.
fn collected(side: NonZeroU32, wall: &Wall, pictures: &[Option<Vec<u8>>]) -> CaptureJob {
    let room = CaptureBudget::default().reserve(wall, NonZeroU32::MIN).expect("room");
    let ids: Vec<_> = wall.channel_ids().collect();
    let shapes = GeometryCache::new(BlobStore::new("/nonexistent"));
    let job = ClientRequest { client: SessionId(1), id: RequestId(1) };
    let mut collection =
        CaptureJob::new(job, (FrameId(7), side), &ids, Vec::new(), (wall, &shapes), room);
    for ((channel, of), picture) in wall.channel_ids().zip(&wall.channels).zip(pictures) {
        let Some(bytes) = picture else { continue };
        let size = of.display_size().to_array();
        let [width, height] = size.map(|pixels| pixels.div_ceil(side.get()));
        let bytes = bytes.clone().into();
        let chunk = CaptureChunk { channel, frame: FrameId(7), width, height, offset: 0, bytes };
        collection.add(&chunk).expect("a piece that fits");
    }
    collection.expire();
    collection
}

/// Pixels that all differ.
fn mixed(count: usize, seed: u8) -> Vec<u8> {
    let byte = |at: usize| if at % 4 == 3 { 255 } else { (at as u8).wrapping_mul(37) ^ seed };
    (0..4 * count).map(byte).collect()
}

#[test]
fn captures_share_their_room_and_give_it_back() {
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.0]\n\
                center = [0.0, 0.0, -1.0]\n[screen.tiles]\ncolumns = 4\nrows = 2\n\
                pixels = [2048, 2048]\n";
    let mut wall = polyptych_wall_file::parse(text, "w.toml".as_ref()).expect("a wall");
    let memory = CaptureBudget::default();
    // 32 Mi pixels as a screen, and again as channels: 256 MiB.
    let mut rooms: Vec<_> =
        (0..4).map(|_| memory.reserve(&wall, NonZeroU32::MIN).expect("room")).collect();
    let reason = memory.reserve(&wall, NonZeroU32::MIN).expect_err("no more");
    assert!(reason.contains("1024 MiB of 1024 MiB") && reason.contains("256 MiB"), "{reason}");
    rooms.pop();
    memory.reserve(&wall, NonZeroU32::MIN).expect("given back");
    drop(rooms);
    // Two pictures of the screen, and twice as many pixels on one of eight displays.
    wall.channels[0].adjustment.packing = StereoPacking::SideBySide;
    let room = memory.reserve(&wall, NonZeroU32::MIN).expect("room");
    assert_eq!(room.bytes >> 20, 128 * 2 + 128 + 16);
}

#[test]
fn previews_of_walls_that_are_too_large_for_captures_have_room() {
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.0]\n\
                center = [0.0, 0.0, -1.0]\n[screen.tiles]\ncolumns = 5\nrows = 4\n\
                pixels = [3840, 2160]\n";
    let mut wall = polyptych_wall_file::parse(text, "w.toml".as_ref()).expect("a wall");
    let memory = CaptureBudget::default();
    let reason = memory.reserve(&wall, NonZeroU32::MIN).expect_err("1.3 GB");
    assert!(reason.contains("takes 1265 MiB"), "{reason}");
    let side = NonZeroU32::new(40).expect("not 0");
    let room = memory.reserve(&wall, side).expect("room");
    assert_eq!(room.bytes, 4 * 2 * 20 * 96 * 54);
    // Where pictures are superposed, all of the screen's are enlarged for that.
    wall.channels[0].adjustment.mirror = true;
    let enlarged = memory.reserve(&wall, side).expect("room");
    assert_eq!(enlarged.bytes - room.bytes, 4 * 20 * 3840 * 2160);
}

#[test]
fn plain_tiles_are_pasted_byte_for_byte() {
    let wall = two_tiles(6);
    let [left, right] = [mixed(24, 1), mixed(24, 99)];
    let pictures = stitched(&wall, &[Some(left.clone()), Some(right.clone())]);
    assert_eq!(pictures.len(), 3);
    assert_eq!((pictures[0].info.width, pictures[0].info.height), (12, 4));
    for y in 0..4 {
        let row = &pictures[0].rgba[y * 48..][..48];
        assert_eq!(row[..24], left[y * 24..][..24]);
        assert_eq!(row[24..], right[y * 24..][..24]);
    }
    assert_eq!((&pictures[1].rgba, &pictures[2].rgba), (&left, &right));
    // What is turned is stitched by its light, and comes out the same.
    let mut turned = two_tiles(6);
    turned.channels[1].adjustment.turn = Orientation::Half;
    let half: Vec<u8> = right.chunks_exact(4).rev().flatten().copied().collect();
    let also = stitched(&turned, &[Some(left), Some(half.clone())]);
    assert_eq!(also[0], pictures[0]);
    assert_eq!(also[2].rgba, half);
    assert!(also[2].info.name == "front-6" && !also[2].info.is_screen);
}

#[test]
fn squares_show_what_stands_in_their_middle() {
    // At 7 pixels the second tile begins in a square, and a gap of a pixel is before it.
    for (apart, side) in [(6, 2), (6, 4), (7, 2), (7, 3), (7, 5), (4, 3), (6, 100)] {
        let wall = two_tiles(apart);
        let squares = |pixels: u32| pixels.div_ceil(side) as usize;
        let (across, count) = (squares(6), squares(6) * squares(4));
        let tiles = [mixed(count, 1), mixed(count, 99)];
        let given = tiles.clone().map(Some);
        let side_of = NonZeroU32::new(side).expect("squares");
        let shown = stitched_by(side_of, &wall, &given);
        let size = (shown[0].info.width as usize, shown[0].info.height as usize);
        assert_eq!(size, (squares(6 + apart), squares(4)));
        if apart < 6 {
            // They overlap: light adds up, so that only what one of them shows is as it was sent.
            assert_eq!(shown[0].rgba[..3], tiles[0][..3]);
            continue;
        }
        for (at, pixel) in shown[0].rgba.chunks_exact(4).enumerate() {
            let middle = |square: usize, all: u32| (square as u32 * side + side / 2).min(all - 1);
            let (x, y) = (middle(at % size.0, 6 + apart), middle(at / size.0, 4));
            let due = [(0, &tiles[0]), (apart, &tiles[1])].into_iter().find_map(|(left, of)| {
                let x = x.checked_sub(left).filter(|x| *x < 6)?;
                let square = (y / side) as usize * across + (x / side) as usize;
                Some(&of[4 * square..][..4])
            });
            assert_eq!(pixel, due.unwrap_or(&DARK), "{apart}, {side}: square {at}");
        }
        assert_eq!((&shown[1].rgba, &shown[2].rgba), (&tiles[0], &tiles[1]));
    }
}

#[test]
fn overlaps_are_the_sum_of_their_light() {
    for leak in [0.0, 0.01] {
        let mut wall = two_tiles(4);
        wall.blend.leak = leak;
        let codes = |id: ChannelId| {
            let blend = BlendModel::new(&wall);
            let map = blend.blend_map(id, &ChannelMasks::default()).expect("a map");
            let color = blend.color(id).expect("a channel");
            let code = |at: u32| {
                let [multiply, add] = map.light_at(at % 6, at / 6);
                let light = DVec3::splat(0.2 + 0.1 * f64::from(at / 6));
                let codes = color.codes(light, multiply, add) * 255.0;
                codes.round().extend(255.0).to_array().map(|code| code as u8)
            };
            Some((0..24).flat_map(code).collect::<Vec<u8>>())
        };
        let all: Vec<_> = wall.channel_ids().map(codes).collect();
        assert_ne!(all[0], all[1], "a ramp falls on one side and rises on the other");
        let shown = stitched(&wall, &all);
        for (at, pixel) in shown[0].rgba.chunks_exact(4).enumerate() {
            let light = 2.0 * leak + (1.0 - 2.0 * leak) * (0.2 + 0.1 * (at / 10) as f64);
            let due = wall.channels[0].adjustment.color.curve.encode(DVec3::splat(light));
            let off = (f64::from(pixel[1]) - due.y * 255.0).abs();
            assert!(off <= 1.2 && pixel[3] == 255, "leak {leak}, pixel {at}: {off} levels");
        }
        // A channel that is missing leaves its own part dark, and its share of the overlap.
        let one = stitched(&wall, &[all[0].clone(), None]);
        assert_eq!(one[0].rgba[4 * 9..][..4], DARK);
        let (alone, both) = (&one[0].rgba[4 * 5..][..3], &shown[0].rgba[4 * 5..][..3]);
        assert!(alone[0] > DARK[0] && alone[0] < both[0], "{alone:?} of {both:?}");
    }
}

#[test]
fn each_eye_has_its_picture() {
    let mut wall = two_tiles(0);
    wall.channels[0].adjustment.eye = Eye::Left;
    wall.channels[1].adjustment.eye = Eye::Right;
    let [left, right] = [mixed(24, 1), mixed(24, 99)];
    let pictures = stitched(&wall, &[Some(left.clone()), Some(right.clone())]);
    let shown: Vec<_> = pictures.iter().map(|p| (p.info.name.as_str(), &p.rgba)).collect();
    let due = [("front", &left), ("front-right", &right), ("front-0", &left), ("front-0", &right)];
    assert_eq!(shown, due);
    // Both on one display, beside each other.
    let mut wall = two_tiles(0);
    wall.channels.truncate(1);
    wall.channels[0].adjustment.packing = StereoPacking::SideBySide;
    let rows = left.chunks_exact(24).zip(right.chunks_exact(24));
    let packed: Vec<u8> = rows.flat_map(|(l, r)| [l, r].concat()).collect();
    let pictures = stitched(&wall, &[Some(packed.clone())]);
    let shown: Vec<_> = pictures.iter().map(|p| (p.info.name.as_str(), &p.rgba)).collect();
    assert_eq!(shown, [("front", &left), ("front-right", &right), ("front-0", &packed)]);
    assert_eq!((pictures[2].info.width, pictures[2].info.height), (12, 4));
    // A screen beside it has that name.
    wall.screens.push(Screen { name: "front-right".to_owned(), ..wall.screens[0].clone() });
    let pictures = stitched(&wall, &[Some(packed)]);
    let names: Vec<_> = pictures.iter().map(|picture| picture.info.name.as_str()).collect();
    assert_eq!(names, ["front", "front-right-eye", "front-right", "front-0"]);
}

#[test]
fn a_channel_whose_place_cannot_be_read_is_said_to_be_missing() {
    let mut wall = two_tiles(6);
    wall.files.push(CalibrationFile {
        path: "warp.pfm".to_owned(),
        kind: CalibrationFileKind::Warp,
        blob: Some(BlobHash([1; 32])),
        is_for_one_eye: false,
        front: Vec::new(),
    });
    wall.channels[1].cover = ChannelKind::Map;
    wall.channels[1].adjustment.warp = Some(0);
    let given = [Some(mixed(24, 1)), Some(mixed(24, 99))];
    let (pictures, missing, _room) = collected(NonZeroU32::MIN, &wall, &given).stitch();
    let [(name, reason)] = &missing[..] else { panic!("{missing:?}") };
    assert_eq!(name, "front-6");
    assert!(reason.contains("could not be read") && reason.contains("warp.pfm"), "{reason}");
    let row = &pictures[0].rgba[..48];
    assert!(row[..24] != DARK.repeat(6) && row[24..] == DARK.repeat(6), "its part is dark");
    assert_eq!(Some(&pictures[2].rgba), given[1].as_ref(), "its own picture is there");
}
