//! Both eyes, and views of other cameras on parts of the wall: each shows what a display shows
//! that has nothing else to show.

use glam::{DVec3, UVec2};
use image::{RgbaImage, imageops};
use polyptych_client::{Area, Camera, HeadPose, Presentation, View, ViewProjection, Wall};
use polyptych_protocol::command::Frame;
use polyptych_render::frame_views;
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, ChannelId, Eye, Screen, Surface};

use crate::harness::local_wall::{LocalWall, screen_of, small, tiled};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, poses, town};
use crate::harness::stage::{RenderFixture, frame};

const CANVAS: [u32; 2] = [320, 176];

/// A display of so many pixels of this wall, alone.
fn alone(wall: &Wall, [width, height]: [u32; 2]) -> Wall {
    let pixels = UVec2::new(width, height);
    let size_m = wall.screens[0].size_m() * pixels.as_dvec2() / wall.screens[0].canvas.as_dvec2();
    let plane = Plane::upright(DVec3::new(0.3, 1.0, -2.0), size_m);
    let screen = Screen::new("alone", Surface::Plane(plane), pixels);
    Wall::new("alone", vec![screen], vec![Channel::tile("alone", 0, UVec2::ZERO, pixels)])
}

fn part(picture: &RgbaImage, [x, y, width, height]: [u32; 4]) -> RgbaImage {
    imageops::crop_imm(picture, x, y, width, height).to_image()
}

/// A plan and a camera's picture side by side, over all tiles; neither ends where a tile does.
fn two_plans(stage: &RenderFixture) -> [(View, [u32; 4]); 2] {
    let (center, radius) = (stage.bounds.center(), stage.bounds.radius());
    let above = Camera::look_at(center + DVec3::Y * radius, center, DVec3::NEG_Z);
    let beside = poses(&stage.bounds)[4];
    [
        ([0, 0, 200, 176], above, ViewProjection::Orthographic { height_m: radius }),
        ([200, 0, 120, 176], beside, ViewProjection::Perspective { fov_y_rad: 0.9 }),
    ]
    .map(|(rect, camera, projection)| {
        let area = Area::Screen { screen: 0, rect };
        (View { area, projection, ..View::of_wall(camera) }, rect)
    })
}

fn with_views(wall: &Wall, views: Vec<View>) -> Frame {
    let presentation = Presentation { views, ..Presentation::new(wall.head()) };
    Frame { presentation, ..frame(wall, Camera::IDENTITY) }
}

#[test]
fn two_plans_over_four_tiles_are_what_two_displays_show() {
    let mut stage = RenderFixture::new(town());
    let wall = tiled([2, 2], CANVAS);
    let views = two_plans(&stage);
    let both = with_views(&wall, views.iter().map(|(view, _)| view.clone()).collect());
    let mut stitched = RgbaImage::new(CANVAS[0], CANVAS[1]);
    for (id, channel) in (0..).map(ChannelId).zip(&wall.channels) {
        let tile = frame_views::views(&wall, id, &both).expect("views");
        let [x, y] = channel.origin.to_array().map(i64::from);
        imageops::replace(&mut stitched, &stage.draw(channel.size, &tile), x, y);
    }
    for (number, (view, rect)) in views.into_iter().enumerate() {
        let size = UVec2::new(rect[2], rect[3]);
        let display = alone(&wall, size.to_array());
        let whole = View { area: Area::Wall, ..view.clone() };
        let described =
            frame_views::views(&display, ChannelId(0), &with_views(&display, vec![whole]));
        let expected = stage.draw(size, &described.expect("views"));
        assert!(color_count(&expected) > 100, "view {number} shows nothing");
        let shown = part(&stitched, rect);
        println!("{}", check(&format!("view {number}"), &shown, &expected, &SEAMS));

        // The same tiles, each rasterised on the window's own canvas: no pixel differs.
        let mut oracle = RgbaImage::new(size.x, size.y);
        let only = with_views(&wall, vec![view]);
        for (id, channel) in (0..).map(ChannelId).zip(&wall.channels) {
            for mut tile in frame_views::views(&wall, id, &only).expect("views") {
                let whole_tile = [0, 0, channel.size.x, channel.size.y];
                let [x, y, width, height] = tile.scissor.unwrap_or(whole_tile);
                let at = UVec2::new(x, y) + channel.origin;
                let corner = UVec2::new(rect[0], rect[1]);
                if at.cmplt(corner).any() || at.cmpge(corner + size).any() {
                    // The wall's own picture, beside the window.
                    continue;
                }
                let at = at - corner;
                tile.viewport = [0.0, 0.0, f64::from(size.x), f64::from(size.y)];
                tile.scissor = Some([at.x, at.y, width, height]);
                let drawn = part(&stage.draw(size, &[tile]), [at.x, at.y, width, height]);
                imageops::replace(&mut oracle, &drawn, i64::from(at.x), i64::from(at.y));
            }
        }
        check(&format!("oracle of view {number}"), &oracle, &expected, &IDENTICAL);
    }
}

#[test]
fn a_view_over_another_has_its_own_depth() {
    let mut stage = RenderFixture::new(town());
    let wall = tiled([1, 1], [160, 88]);
    let rect = [30, 20, 70, 50];
    let base = View::of_wall(poses(&stage.bounds)[0]);
    let inset = View { area: Area::Screen { screen: 0, rect }, ..two_plans(&stage)[0].0.clone() };
    let mut draw = |views: Vec<View>| {
        let described = frame_views::views(&wall, ChannelId(0), &with_views(&wall, views));
        stage.draw(UVec2::new(160, 88), &described.expect("views"))
    };
    let (below, above) = (draw(vec![base.clone()]), draw(vec![inset.clone()]));
    let mut expected = below.clone();
    imageops::replace(&mut expected, &part(&above, rect), i64::from(rect[0]), i64::from(rect[1]));
    assert!(color_count(&part(&above, rect)) > 100 && expected != below);
    check("inset", &draw(vec![base, inset]), &expected, &IDENTICAL);
}

/// The mean column of what is not background.
fn middle_column(picture: &RgbaImage) -> f64 {
    let background = picture.get_pixel(0, 0);
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, _, _) in picture.enumerate_pixels().filter(|(_, _, pixel)| *pixel != background) {
        sum += f64::from(x) + 0.5;
        count += 1.0;
    }
    assert!(count > 50.0, "the triangle is seen");
    sum / count
}

#[test]
fn each_eye_has_its_own_picture_and_near_things_are_apart() {
    let place = TestDir::new();
    // Half as far as the screen, in front of its middle.
    let near = Gltf::triangle().with(|gltf| {
        gltf.json["nodes"][0]["scale"] = serde_json::json!([0.2, 0.2, 0.2]);
        gltf.json["nodes"][0]["translation"] = serde_json::json!([-0.07, -0.07, -0.652]);
    });
    let mut stage = RenderFixture::new(&place.write("near.glb", near.glb()));
    let mut wall = tiled([1, 1], CANVAS);
    let second = Channel { name: "right".into(), ..wall.channels[0].clone() };
    wall.channels.push(second);
    wall.channels[0].adjustment.eye = Eye::Left;
    wall.channels[1].adjustment.eye = Eye::Right;
    let head = HeadPose { eye_separation_m: 0.06, ..wall.head() };
    let seen_from = |wall: &Wall, head: HeadPose| {
        let presentation = Presentation::new(head);
        Frame { presentation, ..frame(wall, Camera::IDENTITY) }
    };
    let stereo = seen_from(&wall, head);
    let size = UVec2::from_array(CANVAS);
    let [left, right] = [(0, Eye::Left), (1, Eye::Right)].map(|(index, eye)| {
        let drawn = frame_views::views(&wall, ChannelId(index), &stereo).expect("views");
        let drawn = stage.draw(size, &drawn);
        // What one eye alone sees from there.
        let mono = tiled([1, 1], CANVAS);
        let moved = HeadPose::facing_forward(head.eye(eye), 0.0);
        let mono_frame = seen_from(&mono, moved);
        let expected = frame_views::views(&mono, ChannelId(0), &mono_frame).expect("views");
        check("one eye", &drawn, &stage.draw(size, &expected), &IDENTICAL);
        drawn
    });
    // At half the distance they are one separation apart, 6 mm of 6 mm a pixel.
    let apart = middle_column(&left) - middle_column(&right);
    assert!((apart - 0.06 / 0.006).abs() < 0.3, "{apart} pixels");
}

#[test]
fn a_client_moves_the_head_and_lays_views_over_a_wall_of_processes() {
    let folder = town().parent().expect("a folder");
    let [one, two] = [small(1, 1), small(2, 1)].map(|wall| LocalWall::start(&wall, &[folder]));
    let clients = [&one, &two].map(LocalWall::client);
    let [single, client] = &clients;
    let bounds = clients.each_ref().map(|client| {
        client.open_scene("town.glb").expect("opened").bounds.expect("something to see")
    })[0];
    let pictures = || {
        let [expected, shown] = clients.each_ref().map(|client| {
            let capture = client.capture().expect("a capture");
            assert_eq!(capture.missing, [], "channels that sent no picture");
            screen_of(&capture)
        });
        check("both walls", &shown, &expected, &SEAMS);
        shown
    };
    for client in &clients {
        client.set_camera(poses(&bounds)[4]).expect("set");
    }
    let at_rest = pictures();
    let head = HeadPose::facing_forward(DVec3::new(0.4, 0.1, 0.2), 0.07);
    for client in &clients {
        client.set_head(head).expect("set");
    }
    let moved = pictures();
    assert_ne!(moved, at_rest, "all frusta follow the head");
    assert_eq!(client.presentation().expect("sight").head, head);

    let refused = two.run(&["eye", "0,0,-3"]).failed(&["behind screen front", "1.696"]);
    assert!(refused.contains(&small(2, 1).channels[0].name), "{refused}");
    let said = two.run(&["eye"]).succeeded();
    assert!(said.contains("0.4000,0.1000,0.2000") && said.contains("70.0 mm"), "{said}");
    single.set_head(small(1, 1).head()).expect("set");
    two.run(&["eye", "--reset"]).succeeded();
    assert_eq!(pictures(), at_rest, "back at rest");

    // A plan over the middle, where both tiles meet; once by the command, once by the library.
    let DVec3 { x, y, z } = bounds.center();
    let (target, above) = (format!("{x},{y},{z}"), format!("{x},{},{z}", y + bounds.radius()));
    let plan = ["view", "add", &above, &target, "--up", "0,0,-1", "--rect", "120,60,240,140"];
    two.run(&[&plan[..], &["--ortho", "200"]].concat()).succeeded();
    let views = client.presentation().expect("sight").views;
    single.set_views(views).expect("set");
    let inset = pictures();
    let rect = [120, 60, 240, 140];
    assert!(color_count(&part(&inset, rect)) > 100 && part(&inset, rect) != part(&at_rest, rect));
    assert_eq!(part(&inset, [0, 0, 480, 60]), part(&at_rest, [0, 0, 480, 60]), "beside it");
    let said = two.run(&["view", "list"]).succeeded();
    assert!(said.contains("front 120,60,240,140") && said.contains("200.0000 m"), "{said}");
    let far = ["view", "add", "0,9,0", "0,0,0", "--rect", "400,0,100,10", "--fov", "40"];
    two.run(&far).failed(&["not on screen front", "480 × 272"]);
    for client in &clients {
        client.clear_views().expect("cleared");
    }
    assert_eq!(pictures(), at_rest, "no views, and a head at rest");
}
