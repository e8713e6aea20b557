//! Walls that overlap, of tiles and of projectors.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec2, DVec3, UVec2};

use crate::channel_calibration::ControlGrid;
use crate::projector::Projector;
use crate::surface::{Cylinder, Plane, Surface};
use crate::{Channel, ChannelKind, Screen, Wall};

/// Tiles by origin and size on a planar canvas.
pub(crate) fn tiles(canvas: [u32; 2], rects: &[([u32; 2], [u32; 2])]) -> Wall {
    let canvas = UVec2::from(canvas);
    let plane = Plane::upright(DVec3::NEG_Z * 3.0, canvas.as_dvec2() / 100.0);
    let tile = |(at, (origin, size)): (usize, &([u32; 2], [u32; 2]))| {
        Channel::tile(&format!("front-{at}"), 0, UVec2::from(*origin), UVec2::from(*size))
    };
    let channels = rects.iter().enumerate().map(tile).collect();
    Wall::new("w", vec![Screen::new("front", Surface::Plane(plane), canvas)], channels)
}

/// Equal tiles that overlap by some pixels across and down.
pub(crate) fn grid(count: UVec2, tile: UVec2, overlap: UVec2) -> Wall {
    let step = tile - overlap;
    let places = (0..count.y).flat_map(|y| (0..count.x).map(move |x| UVec2::new(x, y)));
    let rects: Vec<_> = places.map(|at| ((at * step).to_array(), tile.to_array())).collect();
    tiles((step * (count - 1) + tile).to_array(), &rects)
}

/// Four projectors that look at a plane or into a cylinder, each turned by `turn` another way.
pub(crate) fn askew(is_round: bool, size: UVec2, turn: f64) -> Wall {
    let surface = if is_round {
        Surface::Cylinder(Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::from_rotation_z(0.02),
            radius_m: 3.0,
            azimuth_rad: [-FRAC_PI_2, FRAC_PI_2],
            height_m: [-2.0, 2.0],
        })
    } else {
        Surface::Plane(Plane::upright(DVec3::NEG_Z * 3.0, DVec2::new(8.0, 4.0)))
    };
    let mut wall = tiles([size.x * 2, size.y * 2], &[([0, 0], size.to_array()); 4]);
    wall.screens[0].surface = surface;
    for (channel, place) in wall.channels.iter_mut().zip([(0, 0), (1, 0), (0, 1), (1, 1)]) {
        let side = DVec2::new(f64::from(place.0) - 0.5, 0.5 - f64::from(place.1));
        let roll = DQuat::from_rotation_z(turn * side.x * (1.0 + side.y));
        let yaw = DQuat::from_rotation_y(turn * side.y - side.x * 0.45);
        channel.cover = ChannelKind::Projector(Box::new(Projector {
            position: DVec3::new(side.x * 0.4, side.y * 0.3, 0.2),
            rotation: yaw * DQuat::from_rotation_x(side.y * 0.32) * roll,
            tangents: [-0.4, 0.38, -0.24, 0.26],
        }));
    }
    wall
}

/// Pins and bends every channel another way.
pub(crate) fn bend(wall: &mut Wall) {
    for (at, channel) in wall.channels.iter_mut().enumerate() {
        let unit = channel.size.as_dvec2() / 200.0;
        let moved = |i: usize| {
            let (x, y) = ((i * 7 + at * 3) % 5, (i * 3 + at) % 4);
            (DVec2::new(x as f64, y as f64) - 1.5) * unit
        };
        channel.adjustment.pin = [3, 5, 8, 13].map(moved);
        let moves = (0..12).map(moved).collect();
        channel.adjustment.bend = Some(ControlGrid { points: UVec2::new(4, 3), moves });
    }
}
