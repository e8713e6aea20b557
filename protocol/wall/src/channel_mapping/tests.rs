//! Pixels to canvas and display space, and back.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DQuat, DVec2, DVec3, UVec2};

use super::super::calibration_maps::CalibrationMaps;
use super::super::channel_calibration::ControlGrid;
use super::super::projector::Projector;
use super::super::surface::{Cylinder, Plane, Sphere};
use super::super::{Channel, ChannelCalibration, ChannelKind, FrustumMode, Screen, Surface, Wall};
use super::{ChannelMapping, ResolvedWall};
use crate::ChannelId;

fn screen(surface: Surface) -> Screen {
    Screen { name: "front".into(), surface, canvas: UVec2::new(2000, 1000), bezel: None }
}

fn plane() -> Screen {
    screen(Surface::Plane(Plane {
        lower_left: DVec3::new(-2.0, 0.0, -3.0),
        lower_right: DVec3::new(2.0, 0.0, -3.0),
        upper_left: DVec3::new(-2.0, 2.0, -3.0),
    }))
}

fn channel(cover: ChannelKind, adjustment: ChannelCalibration) -> Channel {
    Channel {
        name: "front".into(),
        screen: 0,
        origin: UVec2::new(500, 100),
        size: UVec2::new(640, 480),
        server: "front".into(),
        monitor: None,
        projection: FrustumMode::Own,
        cover,
        adjustment,
    }
}

fn bent() -> ChannelCalibration {
    let pin = [
        DVec2::new(3.0, -2.0),
        DVec2::new(-12.0, 7.5),
        DVec2::new(0.25, 9.0),
        DVec2::new(20.0, 14.0),
    ];
    let moves = (0..12).map(|i| DVec2::new(f64::from(i * 7 % 5), f64::from(i * 3 % 4)) * 2.0);
    let bend = ControlGrid { points: UVec2::new(4, 3), moves: moves.collect() };
    ChannelCalibration { pin, bend: Some(bend), ..ChannelCalibration::default() }
}

fn there_and_back(screen: &Screen, channel: &Channel) {
    let map = ChannelMapping::new(channel, screen).expect("a picture");
    for x in 0..=8 {
        for y in 0..=8 {
            let pixel = DVec2::new(f64::from(x) * 80.0, f64::from(y) * 60.0);
            let canvas = map.canvas_from_pixel(pixel).expect("on the canvas");
            let back = map.pixel_from_canvas(canvas).expect("shown");
            assert!(back.distance(pixel) < 1e-6, "{pixel} comes back as {back}");
            let point = map.display_from_pixel(pixel).expect("on the screen");
            let same = screen.canvas_from_display(point).expect("on the canvas");
            assert!(same.distance(canvas) < 1e-6, "{canvas} and {same}");
        }
    }
}

#[test]
fn a_plain_tile_begins_at_its_origin() {
    let (screen, channel) = (plane(), channel(ChannelKind::Tile, ChannelCalibration::default()));
    let map = ChannelMapping::new(&channel, &screen).expect("a picture");
    assert_eq!(map.canvas_from_pixel(DVec2::new(0.5, 2.5)), Some(DVec2::new(500.5, 102.5)));
    let point = map.display_from_pixel(DVec2::new(500.0, 400.0)).expect("a point");
    assert!(point.distance(DVec3::new(0.0, 1.0, -3.0)) < 1e-12);
    there_and_back(&screen, &channel);
}

#[test]
fn pins_move_corners_and_bends_move_points() {
    let (screen, mut channel) = (plane(), channel(ChannelKind::Tile, bent()));
    there_and_back(&screen, &channel);
    channel.adjustment.bend = None;
    let map = ChannelMapping::new(&channel, &screen).expect("a picture");
    // What was meant for the lower right corner is shown where its pin moved it.
    let corner = DVec2::new(500.0 + 640.0, 100.0 + 480.0);
    let shown = map.pixel_from_canvas(corner).expect("shown");
    assert!(shown.distance(DVec2::new(660.0, 494.0)) < 1e-9, "{shown}");
    // A bend moves its own points by just as much.
    channel.adjustment = ChannelCalibration { pin: [DVec2::ZERO; 4], ..bent() };
    let map = ChannelMapping::new(&channel, &screen).expect("a picture");
    let at = DVec2::new(640.0 / 3.0, 240.0);
    let shown = map.pixel_from_canvas(at + DVec2::new(500.0, 100.0)).expect("shown");
    let moved = bent().bend.expect("a bend").moves[5];
    assert!(shown.distance(at + moved) < 1e-9, "{shown}, not {}", at + moved);
}

#[test]
fn projectors_light_planes_and_cylinders() {
    let projector = Projector {
        position: DVec3::new(0.5, 1.2, 1.0),
        rotation: DQuat::from_rotation_y(0.2) * DQuat::from_rotation_x(-0.05),
        tangents: [-0.3, 0.25, -0.1, 0.3],
    };
    let round = screen(Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-1.5, 1.5],
        height_m: [0.0, 3.0],
    }));
    for screen in [plane(), round] {
        let cover = ChannelKind::Projector(Box::new(projector));
        there_and_back(&screen, &channel(cover.clone(), ChannelCalibration::default()));
        there_and_back(&screen, &channel(cover, bent()));
    }
}

#[test]
fn pins_that_leave_no_picture_are_none() {
    let mut adjustment = ChannelCalibration::default();
    // The upper right corner on the line from the upper left to the lower right, and beyond.
    adjustment.pin[1] = DVec2::new(-320.0, 240.0);
    let channel = channel(ChannelKind::Tile, adjustment);
    assert!(ChannelMapping::new(&channel, &plane()).is_none());
}

/// A projector behind a screen lights the same places as one before it, from the other side.
#[test]
fn projectors_behind_a_screen_light_its_back() {
    let cylinder = screen(Surface::Cylinder(Cylinder {
        center: DVec3::new(0.0, 1.0, 0.0),
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-0.7, 0.7],
        height_m: [-1.0, 1.0],
    }));
    for screen in [plane(), cylinder] {
        for (z, is_rear) in [(-8.0, true), (-0.5, false)] {
            let position = DVec3::new(0.3, 1.2, z);
            let look =
                crate::camera::Camera::look_at(position, DVec3::new(0.1, 1.0, -3.0), DVec3::Y);
            let tangents = [-0.3, 0.25, -0.2, 0.2];
            let projector = Projector { position, rotation: look.rotation, tangents };
            let channel = channel(ChannelKind::Projector(Box::new(projector)), bent());
            let map = ChannelMapping::new(&channel, &screen).expect("a picture");
            assert_eq!(map.is_rear(), is_rear);
            let size = channel.size.as_dvec2();
            let at = |x: f64, y: f64| {
                let pixel = DVec2::new(x, y) * size;
                let canvas = map.canvas_from_pixel(pixel).expect("lit");
                let point = map.display_from_pixel(pixel).expect("lit");
                let back = map.pixel_from_canvas(canvas).expect("found");
                assert!(back.distance(pixel) < 1e-6, "{pixel}: {back}");
                let own = screen.display_from_canvas(canvas).expect("a surface");
                assert!(own.distance(point) < 1e-9, "{point}: {own}");
                canvas
            };
            // The viewer sees its picture through the screen: left and right are exchanged.
            assert_eq!(at(0.3, 0.5).x > at(0.7, 0.5).x, is_rear);
            assert!(at(0.5, 0.3).y < at(0.5, 0.7).y);
        }
    }
}

/// Light that overshoots a screen is not drawn, and a screen that is small in a picture is found.
#[test]
fn projectors_draw_on_their_screen_alone() {
    let flat = |x: f64, size_m: [f64; 2]| {
        let center = DVec3::new(x, 0.0, -3.0);
        screen(Surface::Plane(Plane::upright(center, DVec2::from(size_m))))
    };
    let round = screen(Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-0.31, 0.31],
        height_m: [-0.51, 0.51],
    }));
    let dome = screen(Surface::Sphere(Sphere {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 4.0,
        azimuth_rad: [-PI, PI],
        elevation_rad: [0.0, FRAC_PI_2],
    }));
    for (screen, pitch) in
        [(flat(0.0, [2.0, 1.0]), 0.0), (flat(0.525, [0.3, 0.2]), 0.0), (round, 0.0), (dome, 0.15)]
    {
        let rotation = DQuat::from_rotation_x(pitch);
        let tangents = [-0.5, 0.5, -0.3, 0.3];
        let projector = Projector { position: DVec3::ZERO, rotation, tangents };
        let cover = ChannelKind::Projector(Box::new(projector));
        let mut channel = channel(cover, ChannelCalibration::default());
        channel.size = UVec2::new(160, 100);
        let wall = Wall::new("w", vec![screen], vec![channel]);
        let shaped = ResolvedWall::from(&wall);
        let mesh = shaped.drawn_mesh(&CalibrationMaps::default(), ChannelId(0)).expect("drawn");
        let map = shaped.channel_mapping(ChannelId(0)).expect("a picture");
        let canvas = wall.screens[0].canvas.as_dvec2();
        let mut counts = [0; 2];
        for (x, y) in (0..100).step_by(3).flat_map(|y| (0..160).step_by(3).map(move |x| (x, y))) {
            let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let at = map.canvas_from_pixel(pixel);
            let is_due = at.is_some_and(|at| at.cmpge(DVec2::ZERO).all() && at.cmple(canvas).all());
            assert_eq!(mesh.point_at(pixel).is_some(), is_due, "{pixel} lights {at:?}");
            counts[usize::from(is_due)] += 1;
        }
        assert!(counts.iter().all(|count| *count >= 15), "{counts:?}");
    }
}
