//! Light maps of projectors that lie anyhow, pixel by pixel against the formula.

use std::f64::consts::PI;

use glam::{DQuat, DVec2, DVec3, UVec2};

use super::super::*;
use super::walls::tiles;
use crate::projector::Projector;
use crate::surface::{Cylinder, Plane, Sphere, Surface};
use crate::{ChannelKind, Wall};

/// Maximum error of a light map's weight: the sum of four keeps 1/4096 twice over.
const WEIGHT_ERROR_MAX: f64 = 1.0 / 32768.0 + 1.0 / 65535.0;

/// Numbers from -1 to 1 out of a seed: G. Marsaglia, *Xorshift RNGs*, 2003.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Projectors on a plane, around in a cylinder, or around in a dome: rolled, tilted, aside of the
/// middle, and overlapping by little or much.
fn wall(seed: u64, size: [u32; 2]) -> Wall {
    let mut next = numbers(seed);
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, next() * 0.2, next(), next() * 0.2);
    let count = 2 + (seed % 6) as usize;
    let (surface, around) = match seed % 3 {
        0 => (Surface::Plane(Plane::upright(DVec3::NEG_Z * 3.0, DVec2::new(12.0, 6.0))), 0.9),
        1 => {
            let (azimuth_rad, height_m) = ([-PI, PI], [-3.0, 3.0]);
            let center = DVec3::ZERO;
            let round = Cylinder { center, rotation, radius_m: 3.0, azimuth_rad, height_m };
            (Surface::Cylinder(round), 2.0 * PI)
        }
        _ => {
            let (azimuth_rad, elevation_rad) = ([-PI, PI], [-0.3, PI / 2.0]);
            let center = DVec3::ZERO;
            let dome = Sphere { center, rotation, radius_m: 3.0, azimuth_rad, elevation_rad };
            (Surface::Sphere(dome), 2.0 * PI)
        }
    };
    let mut wall = tiles([900, 400], &vec![([0, 0], size); count]);
    wall.screens[0].surface = surface;
    wall.blend.exponent = 1.0 + 0.7 * next();
    for (at, channel) in wall.channels.iter_mut().enumerate() {
        let step = around / count as f64;
        let half = (step * (0.65 + 0.12 * next())).clamp(0.2, 1.05).tan();
        let turn = DQuat::from_rotation_y(step * (at as f64 + 0.5) - around / 2.0 + 0.1 * next());
        let tilt = DQuat::from_rotation_x(0.25 + 0.15 * next());
        channel.cover = ChannelKind::Projector(Box::new(Projector {
            position: DVec3::new(next(), next(), next()) * 0.3,
            rotation: turn * tilt * DQuat::from_rotation_z(0.3 * next()),
            tangents: [-half, half * 0.9, -half * 0.6, half * 0.7],
        }));
    }
    wall
}

/// Looks at each `step`th pixel of each row and column.
fn for_pixels(wall: &Wall, step: usize, mut look: impl FnMut(ChannelId, &BlendMap, UVec2, DVec2)) {
    for id in wall.channel_ids() {
        let Some(map) = blend_map(wall, id, &ChannelMasks::default()) else { continue };
        let pixels = wall.channel_mapping(id).expect("a projector");
        let rows = (0..map.size.y).step_by(step);
        for at in rows.flat_map(|y| (0..map.size.x).step_by(step).map(move |x| UVec2::new(x, y))) {
            if let Some(canvas) = pixels.canvas_from_pixel(at.as_dvec2() + 0.5) {
                look(id, &map, at, canvas);
            }
        }
    }
}

#[test]
fn weights_are_exact_in_every_pixel_also_where_outer_edges_cross() {
    let (mut worst, mut count) = (0.0_f64, 0);
    for seed in [3, 4, 5, 9] {
        // Places are nearly linear from pixel to pixel, and some ramps as steep as may be.
        let mut wall = wall(seed, [480, 320]);
        if seed % 3 == 0 {
            for (at, channel) in wall.channels.iter_mut().enumerate() {
                let (turn, at) = (DQuat::from_rotation_y(0.02 * (at as f64 - 1.0)), at as f64);
                channel.cover = ChannelKind::Projector(Box::new(Projector {
                    position: DVec3::new(0.9 * at - 1.5, 0.07 * at, 0.0),
                    rotation: turn * DQuat::from_rotation_z(0.03 * at),
                    tangents: [-0.4, 0.4, -0.25, 0.25],
                }));
            }
        }
        wall.channels[0].adjustment.edges.left = Some(3.0);
        wall.channels[1].adjustment.edges.right = Some(2.0);
        let blend = BlendModel::new(&wall);
        for_pixels(&wall, 3, |id, map, at, canvas| {
            let weights = blend.weights(id, canvas);
            let (_, due) = weights.iter().find(|(own, _)| *own == id).expect("its own");
            let off = (map.texel(at.x, at.y, 0)[0] - due).abs();
            worst = worst.max(off);
            count += usize::from(weights.len() > 1);
        });
    }
    println!("{count} shared pixels are off by {worst:.2e} at most");
    assert!(count > 20_000 && worst <= WEIGHT_ERROR_MAX, "{worst:e}, {count} shared pixels");
}

/// A pixel through which an edge of another picture runs raises the other's black by as much as is
/// missing in all of it.
#[test]
fn black_is_right_in_the_mean_of_each_pixel() {
    const PARTS: u32 = 12;
    let (mut worst, mut count) = (0.0_f64, 0);
    for seed in 1..=6 {
        let mut wall = wall(seed, [150, 100]);
        wall.blend.leak = 0.01;
        let blend = BlendModel::new(&wall);
        let (leak, most) = (wall.blend.leak, blend.overlap_max() as f64);
        let raised = |count: f64| (most - count) * leak / (1.0 - leak);
        for_pixels(&wall, 1, |id, map, at, canvas| {
            let pixels = wall.channel_mapping(id).expect("a projector");
            let lit = |place: DVec2| {
                let canvas = pixels.canvas_from_pixel(at.as_dvec2() + place)?;
                Some(blend.weights(id, canvas).len())
            };
            let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(lit);
            let weights = blend.weights(id, canvas);
            // Nor is a pixel looked at of which a part misses the screen.
            let is_whole = corners.iter().all(|corner| *corner == Some(weights.len()));
            if is_whole || corners.contains(&None) {
                return;
            }
            let part = |at: u32| (f64::from(at) + 0.5) / f64::from(PARTS);
            let all = (0..PARTS * PARTS).map(|at| DVec2::new(part(at % PARTS), part(at / PARTS)));
            let lit: Vec<usize> = all.filter_map(lit).collect();
            let mean = lit.iter().sum::<usize>() as f64 / lit.len() as f64;
            let (_, weight) = weights.iter().find(|(own, _)| *own == id).expect("its own");
            let off = (map.texel(at.x, at.y, 0)[1] - weight * raised(mean)).abs();
            count += 1;
            worst = worst.max(off / wall.blend.leak);
        });
    }
    // Eighths of a pixel in the map, twelfths here: 1/16 + 1/24.
    println!("{count} pixels at edges are off by {worst:.3} of a projector's black at most");
    assert!(count > 1000 && worst < 0.12, "{count} pixels, {worst}");
}
