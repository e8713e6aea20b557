//! Places of curved screens that light does not reach, or that no eye sees.

use glam::DQuat;
use polyptych_wall::projector::Projector;
use polyptych_wall::surface::{Cylinder, Sphere};
use polyptych_wall::{ChannelId, Screen};

use super::*;

/// Where the viewer stands, outside of a drum of 1 m radius around the origin.
const EYE: DVec3 = DVec3::new(0.0, 0.0, -9.0);

/// A pixel of the canvas for each degree across.
fn canvas(azimuth_rad: [f64; 2]) -> UVec2 {
    UVec2::new((azimuth_rad[0] - azimuth_rad[1]).to_degrees().round() as u32, 40)
}

/// A drum seen from outside, from one azimuth to another that is less.
fn drum(azimuth_rad: [f64; 2]) -> Screen {
    let (center, rotation, radius_m) = (DVec3::ZERO, DQuat::IDENTITY, 1.0);
    let height_m = [-0.5, 0.5];
    let cylinder = Cylinder { center, rotation, radius_m, azimuth_rad, height_m };
    Screen::new("drum", Surface::Cylinder(cylinder), canvas(azimuth_rad))
}

/// A ball seen from outside, like a drum.
fn ball(azimuth_rad: [f64; 2]) -> Screen {
    let (center, rotation, radius_m) = (DVec3::ZERO, DQuat::IDENTITY, 1.0);
    let elevation_rad = [-0.5, 0.5];
    let sphere = Sphere { center, rotation, radius_m, azimuth_rad, elevation_rad };
    Screen::new("ball", Surface::Sphere(sphere), canvas(azimuth_rad))
}

/// A projector 3 m from the middle of the drum, at this azimuth in degrees.
fn projector(azimuth: f64) -> ChannelKind {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    let position = DVec3::new(sin, 0.0, -cos) * 3.0;
    let rotation = DQuat::from_rotation_arc(DVec3::NEG_Z, -position / 3.0);
    ChannelKind::Projector(Box::new(Projector {
        position,
        rotation,
        tangents: [-0.5, 0.5, -0.5, 0.5],
    }))
}

fn wall(screen: Screen, cover: ChannelKind) -> Wall {
    let channel = Channel::tile("c", 0, UVec2::ZERO, screen.canvas);
    let channel = Channel { cover, ..channel };
    Wall { eye: EYE, ..Wall::new("w", vec![screen], vec![channel]) }
}

fn lamp(wall: &Wall) -> LitChannel<'_> {
    let shaped = ResolvedWall::from(wall);
    let channel = &wall.channels[0];
    LitChannel {
        channel,
        ground: shaped.shapes.screen(wall.screen_of(channel)),
        eyes: wall.viewpoints(channel),
        pixels: shaped.channel_mapping(ChannelId(0)).expect("a picture"),
        shown: Vec::new(),
        built: DMat3::IDENTITY,
        leak: DVec3::ZERO,
        is_masked: false,
        is_exact: false,
        axes: &[0, 1, 2],
    }
}

#[test]
fn a_projector_does_not_light_the_far_side_of_a_drum_or_ball() {
    let side = 80_f64.to_radians();
    for screen in [drum([side, -side]), ball([side, -side])] {
        let wall = wall(screen, projector(60.0));
        let lamp = lamp(&wall);
        // From 3 m it sees 70° to each side: the canvas begins at 80°, and 60° is its axis.
        for azimuth in [79.0, 60.0, 0.0, -10.0] {
            let place = DVec2::new(80.0 - azimuth, 20.5);
            assert!(lamp.lit(place).is_some(), "{azimuth}");
        }
        for azimuth in [-12.0, -40.0, -60.0] {
            let place = DVec2::new(80.0 - azimuth, 20.5);
            let through = lamp.pixels.pixel_from_canvas(place).expect("a pixel");
            let size = lamp.channel.size.as_dvec2();
            assert!(through.cmpge(DVec2::ZERO).all() && through.cmplt(size).all(), "{through}");
            assert_eq!(lamp.lit(place), None, "{azimuth}");
        }
    }
}

#[test]
fn no_eye_sees_the_far_side_of_a_drum_or_ball() {
    let half = std::f64::consts::PI;
    for screen in [drum([half, -half]), ball([half, -half])] {
        let wall = wall(screen, ChannelKind::Tile);
        let lamp = lamp(&wall);
        let is_seen = |azimuth: f64| lamp.is_seen(DVec2::new(180.0 - azimuth, 20.5));
        // From 9 m, up to 83°.
        for azimuth in [-83.0, -40.0, 0.0, 40.0, 83.0] {
            assert!(is_seen(azimuth), "{azimuth}");
        }
        for azimuth in [-180.0, -90.0, -85.0, 85.0, 90.0, 179.0] {
            assert!(!is_seen(azimuth), "{azimuth}");
        }
    }
}

#[test]
fn an_eye_within_a_ring_sees_all_of_it() {
    let half = std::f64::consts::PI;
    let mut screen = drum([half, -half]);
    if let Surface::Cylinder(cylinder) = &mut screen.surface {
        cylinder.azimuth_rad = [-half, half];
    }
    let wall = Wall { eye: DVec3::new(0.3, 0.1, -0.2), ..wall(screen, ChannelKind::Tile) };
    let lamp = lamp(&wall);
    for step in 0..=360 {
        assert!(lamp.is_seen(DVec2::new(f64::from(step), 20.5)), "{step}");
    }
}
