//! A wall of tiles shows what one channel shows.

use std::path::{Path, PathBuf};

use glam::DVec3;
use image::{RgbaImage, imageops};
use polyptych_client::Camera;
use polyptych_client::blocking::Client;
use polyptych_render::frame_views;
use polyptych_wall::{ChannelId, Wall};

use crate::harness::local_wall::{LocalWall, of_repository, screen_of, shot};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::{asset, poses, town};
use crate::harness::stage::{RenderFixture, frame};

/// Colours below which a picture shows too little to say anything about seams.
const COLORS_MIN: usize = 100;

#[test]
fn tiles_show_what_one_channel_shows() {
    check_walls(&[town().to_owned()]);
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn tiles_show_what_one_channel_shows_of_a_helmet() {
    check_walls(&[asset("FlightHelmet/FlightHelmet.gltf")]);
}

fn check_walls(scenes: &[PathBuf]) {
    let folders: Vec<&Path> = scenes.iter().filter_map(|scene| scene.parent()).collect();
    let walls = ["single.toml", "wall-2x2.toml", "wall-3x1.toml"]
        .map(|name| (name, LocalWall::start(&of_repository(name), &folders)));
    let clients = walls.each_ref().map(|(name, wall)| (*name, wall.client()));
    let [(_, single), tiled @ ..] = &clients;
    for path in scenes {
        let path = path.display().to_string();
        let [summary, ..] = clients.each_ref().map(|(name, client)| {
            client.open_scene(&path).unwrap_or_else(|error| panic!("{name}: {error}"))
        });
        let poses = poses(&summary.bounds.expect("a scene with something in it"));
        for (number, camera) in poses.into_iter().enumerate() {
            let expected = screen_of(&shot(single, camera));
            assert_eq!(expected.dimensions(), (1920, 1080));
            assert!(color_count(&expected) > COLORS_MIN, "pose {number} shows nothing");
            for (wall, client) in tiled {
                check_tiles(
                    &format!("{} {number} {wall}", summary.name),
                    client,
                    camera,
                    &expected,
                );
            }
        }
    }
}

fn check_tiles(name: &str, client: &Client, camera: Camera, expected: &RgbaImage) {
    let capture = shot(client, camera);
    let difference = check(name, &screen_of(&capture), expected, &SEAMS);
    println!("{name}: {difference}");
}

/// Each tile with its own culling and matrix, but rasterised on the whole canvas: what is left of
/// a seam then is a mistake of ours, not of the hardware's arithmetic. Every tile is a pass over
/// the whole canvas, so half of its pixels along each side and half of the poses have to do.
fn check_oracle(path: &Path) {
    let single = halved(of_repository("single.toml"));
    let canvas = single.screens[0].canvas;
    let mut stage = RenderFixture::new(path);
    for (number, camera) in poses(&stage.bounds).into_iter().enumerate().step_by(2) {
        let views =
            frame_views::views(&single, ChannelId(0), &frame(&single, camera)).expect("views");
        let expected = stage.draw(canvas, &views);
        assert!(color_count(&expected) > COLORS_MIN, "pose {number} shows nothing");
        for name in ["wall-2x2.toml", "wall-3x1.toml"] {
            let wall = halved(of_repository(name));
            let mut stitched = RgbaImage::new(canvas.x, canvas.y);
            for (id, channel) in (0..).map(ChannelId).zip(&wall.channels) {
                let mut tile = frame_views::views(&wall, id, &frame(&wall, camera)).expect("views");
                let [origin, size] = [channel.origin, channel.size];
                for view in &mut tile {
                    let [x, y] = origin.as_dvec2().to_array();
                    assert_eq!(view.clip_from_view, views[0].clip_from_view, "one matrix for all");
                    assert_eq!(view.viewport[..2], [-x, -y], "whole pixels");
                    view.viewport = views[0].viewport;
                    view.scissor = Some([origin.x, origin.y, size.x, size.y]);
                }
                let drawn = stage.draw(canvas, &tile);
                let part = imageops::crop_imm(&drawn, origin.x, origin.y, size.x, size.y);
                imageops::replace(&mut stitched, &*part, i64::from(origin.x), i64::from(origin.y));
            }
            check(&format!("oracle {number} {name}"), &stitched, &expected, &IDENTICAL);
        }
    }
}

/// Returns the wall with half of its pixels along each side.
fn halved(mut wall: Wall) -> Wall {
    for screen in &mut wall.screens {
        screen.canvas /= 2;
    }
    for channel in &mut wall.channels {
        channel.origin /= 2;
        channel.size /= 2;
    }
    wall
}

#[test]
fn with_the_scissor_oracle_no_pixel_of_the_town_differs() {
    check_oracle(town());
}

#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn with_the_scissor_oracle_no_pixel_of_the_helmet_differs() {
    check_oracle(&asset("FlightHelmet/FlightHelmet.gltf"));
}

/// One adapter draws all; a corner of all four tiles lies in the middle of a triangle's edge.
#[test]
fn a_triangle_over_all_tiles_and_behind_the_eye_has_no_seam() {
    let place = TestDir::new();
    let big = crate::harness::scenes::Gltf::triangle().with(|gltf| {
        gltf.json["nodes"][0]["scale"] = serde_json::json!([40.0, 40.0, 40.0]);
        gltf.json["nodes"][0]["translation"] = serde_json::json!([-13.0, -13.0, 0.0]);
    });
    let path = place.write("big.glb", big.glb());
    let mut stage = RenderFixture::new(&path);
    let wall = of_repository("wall-2x2.toml");
    let single = of_repository("single.toml");
    // Nearly in its plane, and rolled: one corner is behind the eye, and the edge between the
    // others goes aslant through the middle, where all tiles meet.
    let (eye, target) = (DVec3::new(0.0, 0.0, 0.4), DVec3::new(1.0, 1.0, 0.3));
    let camera = Camera::look_at(eye, target, DVec3::new(1.0, -1.0, 1.4));
    let views = frame_views::views(&single, ChannelId(0), &frame(&single, camera)).expect("views");
    let expected = stage.draw(single.screens[0].canvas, &views);
    assert!(color_count(&expected) > 1, "the triangle is not seen");
    let mut stitched = RgbaImage::new(expected.width(), expected.height());
    for (id, channel) in (0..).map(ChannelId).zip(&wall.channels) {
        let tile = frame_views::views(&wall, id, &frame(&wall, camera)).expect("views");
        let drawn = stage.draw(channel.size, &tile);
        let [x, y] = channel.origin.to_array().map(i64::from);
        imageops::replace(&mut stitched, &drawn, x, y);
    }
    println!("{}", check("one big triangle", &stitched, &expected, &SEAMS));
}
