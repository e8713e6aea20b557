//! Samples of a file's surface, with their normals: enough to tell where no eye can be without the
//! file itself.

use glam::{DVec2, DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::warp::{ImportedMesh, MapCoordinates, WarpGeometry, WarpGrid, WarpMap};
use super::{Channel, ChannelKind, Surface, Wall};

/// Most places of one file: each stands for a fourth of a percent of it, where servers refuse what
/// shows its back in one percent. Walls of 256 meshes then stay below 3 MiB.
pub const FRONT_PLACES_MAX: usize = 256;

/// Share of the places that may show their back, as of pixels where servers draw them: measured
/// surfaces are noisy where they are seen from the side.
const BACK_SHARE_MAX: f64 = 0.01;

/// A place of a surface that stands in a file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceSample {
    /// In its picture, from (0, 0) to (1, 1): the screen's canvas, or the channel.
    pub place: Vec2,
    /// In metres of display space.
    pub point: Vec3,
    /// The normal, of length 1, on the side from which the picture is upright and not mirrored.
    pub normal: Vec3,
}

impl WarpMap {
    /// Places that are spread evenly over its picture; none of a map of the canvas, which has no
    /// points.
    pub fn surface_samples(&self) -> Vec<SurfaceSample> {
        match (&self.shape, self.space) {
            (_, MapCoordinates::Canvas) => Vec::new(),
            (WarpGeometry::Mesh(mesh), _) => of_mesh(mesh),
            (WarpGeometry::Grid(grid), _) => of_grid(grid),
        }
    }
}

/// Triangle by triangle, each as often as its share of the picture has it.
fn of_mesh(mesh: &ImportedMesh) -> Vec<SurfaceSample> {
    let corners = |of: &[u32; 3]| of.map(|corner| mesh.vertices[corner as usize]);
    let doubled = |of: &[u32; 3]| {
        let [a, b, c] = corners(of).map(|corner| corner.place.as_dvec2());
        (b - a).perp_dot(c - a)
    };
    let all: f64 = mesh.triangles.iter().map(|of| doubled(of).abs()).sum();
    let step = all / FRONT_PLACES_MAX as f64;
    let (mut places, mut passed) = (Vec::new(), step / 2.0);
    for of in &mesh.triangles {
        let area = doubled(of);
        passed += area.abs();
        if passed < step || step == 0.0 {
            continue;
        }
        passed %= step;
        let [a, b, c] = corners(of);
        let [p, q, r] = [a, b, c].map(|corner| corner.value.as_dvec3());
        // y runs down in the picture.
        let normal = (r - p).cross(q - p) * area.signum();
        let place = (a.place + b.place + c.place) / 3.0;
        places.extend(front_place(place, (p + q + r) / 3.0, normal));
    }
    places.truncate(FRONT_PLACES_MAX);
    places
}

/// Lit cell by lit cell.
fn of_grid(grid: &WarpGrid) -> Vec<SurfaceSample> {
    let (across, down) = (grid.size.x as usize, grid.size.y as usize);
    if across < 2 || down < 2 {
        return Vec::new();
    }
    let value = |x: usize, y: usize| grid.values[y * across + x];
    let corners = |cell: usize| {
        let (x, y) = (cell % (across - 1), cell / (across - 1));
        let values = [value(x, y), value(x + 1, y), value(x, y + 1), value(x + 1, y + 1)];
        let place = Vec2::new(x as f32 + 1.0, y as f32 + 1.0) / grid.size.as_vec2();
        values.iter().all(|value| value.is_finite()).then_some((place, values))
    };
    let cells = 0..(across - 1) * (down - 1);
    let lit = cells.clone().filter(|cell| corners(*cell).is_some()).count();
    // So that neither a row nor a column is passed over for good.
    let step = lit.div_ceil(FRONT_PLACES_MAX).max(1);
    let chosen = cells.filter_map(corners).skip(step / 2).step_by(step);
    let place = |(place, values): (Vec2, [Vec3; 4])| {
        let [a, b, c, d] = values.map(Vec3::as_dvec3);
        let (right, below) = (b + d - a - c, c + d - a - b);
        front_place(place, (a + b + c + d) / 4.0, below.cross(right))
    };
    chosen.filter_map(place).collect()
}

fn front_place(place: Vec2, point: DVec3, normal: DVec3) -> Option<SurfaceSample> {
    let normal = normal.try_normalize()?.as_vec3();
    Some(SurfaceSample { place, point: point.as_vec3(), normal })
}

impl SurfaceSample {
    /// Returns whether all its numbers are finite.
    pub(super) fn is_valid(&self) -> bool {
        self.place.is_finite() && self.point.is_finite() && self.normal.is_finite()
    }

    /// Returns the distance of an eye before its tangent plane, in metres; negative behind it.
    fn distance_m(&self, eye: DVec3) -> f64 {
        self.normal.as_dvec3().dot(eye - self.point.as_dvec3())
    }
}

impl Wall {
    /// Returns the worst distance of an eye that is behind a channel's surface from a file, in
    /// metres, below 0; `None` if it sees the front of nearly all of it, or if no file gives the
    /// surface.
    pub(super) fn distance_behind_m(&self, channel: &Channel, eye: DVec3) -> Option<f64> {
        let places = |file: u16| self.files.get(usize::from(file)).map(|file| &file.front[..]);
        if let Some(places) = channel.adjustment.warp.and_then(places)
            && !places.is_empty()
        {
            let mut distances: Vec<f64> = places.iter().map(|p| p.distance_m(eye)).collect();
            // Of a picture from behind all is mirrored, which is as it should be.
            let backs = distances.iter().filter(|distance| **distance < 0.0).count();
            if backs * 2 > places.len() {
                for distance in &mut distances {
                    *distance = -*distance;
                }
            }
            return worst(&distances);
        }
        let screen = self.screen_of(channel);
        let Surface::Mesh(file) = screen.surface else { return None };
        let canvas = screen.canvas.as_dvec2();
        let is_shown = |front: &&SurfaceSample| match &channel.cover {
            ChannelKind::Tile => {
                let at = front.place.as_dvec2() * canvas - channel.origin.as_dvec2();
                at.cmpge(DVec2::ZERO).all() && at.cmple(channel.size.as_dvec2()).all()
            }
            ChannelKind::Projector(projector) => {
                let at = projector.project(front.point.as_dvec3());
                at.is_some_and(|at| at.cmpge(DVec2::ZERO).all() && at.cmple(DVec2::ONE).all())
            }
            ChannelKind::Map => true,
        };
        let shown = places(file)?.iter().filter(is_shown);
        worst(&shown.map(|front| front.distance_m(eye)).collect::<Vec<_>>())
    }
}

fn worst(distances: &[f64]) -> Option<f64> {
    let backs = distances.iter().filter(|distance| **distance < 0.0);
    let is_many = backs.clone().count() as f64 > BACK_SHARE_MAX * distances.len() as f64;
    backs.copied().min_by(f64::total_cmp).filter(|_| is_many)
}

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::super::{CalibrationFile, CalibrationFileKind, Screen};
    use super::*;
    use crate::head::HeadPose;

    /// A half cylinder around the origin as a grid of points, seen from within.
    fn arch(size: UVec2) -> WarpGrid {
        let value = |i: u32| {
            let place = UVec2::new(i % size.x, i / size.x).as_dvec2() + 0.5;
            let place = place / size.as_dvec2();
            let (sin, cos) = ((place.x - 0.5) * std::f64::consts::PI).sin_cos();
            DVec3::new(sin * 2.0, 1.0 - place.y * 2.0, -cos * 2.0).as_vec3()
        };
        WarpGrid::new(size, (0..size.x * size.y).map(value).collect())
    }

    /// Returns the arch with its cells as triangles.
    fn arch_mesh(size: UVec2) -> ImportedMesh {
        let values = arch(size).values;
        let vertex = |(i, value): (u32, &Vec3)| {
            let place = UVec2::new(i % size.x, i / size.x).as_vec2() / (size - 1).as_vec2();
            super::super::warp::ImportedVertex { place, value: *value, light: 1.0 }
        };
        let cell = |i: u32| {
            let at = i / (size.x - 1) * size.x + i % (size.x - 1);
            [[at, at + 1, at + size.x], [at + size.x + 1, at + size.x, at + 1]]
        };
        let vertices = (0..).zip(&values).map(vertex).collect();
        let triangles = (0..(size.x - 1) * (size.y - 1)).flat_map(cell).collect();
        ImportedMesh { vertices, triangles }
    }

    fn surface_samples(shape: WarpGeometry) -> Vec<SurfaceSample> {
        WarpMap { space: MapCoordinates::Display, shape }.surface_samples()
    }

    #[test]
    fn places_are_spread_over_all_and_look_inwards() {
        for shape in [
            WarpGeometry::Grid(arch(UVec2::new(160, 90))),
            WarpGeometry::Grid(arch(UVec2::new(5, 4))),
            WarpGeometry::Mesh(arch_mesh(UVec2::new(161, 91))),
            WarpGeometry::Mesh(arch_mesh(UVec2::new(5, 4))),
        ] {
            let places = surface_samples(shape);
            assert!((12..=FRONT_PLACES_MAX).contains(&places.len()), "{}", places.len());
            for front in &places {
                let inward = -front.point.as_dvec3() * DVec3::new(1.0, 0.0, 1.0);
                let cosine = front.normal.as_dvec3().dot(inward.normalize());
                assert!(cosine > 0.99, "{front:?}");
            }
            for quarter in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
                let is_in = |at: &&SurfaceSample| {
                    at.place.cmpgt(Vec2::splat(0.5)) == quarter.cmpgt(Vec2::splat(0.5))
                };
                let share = places.iter().filter(is_in).count() as f64 / places.len() as f64;
                assert!((0.1..0.5).contains(&share), "{quarter}: {share}");
            }
        }
    }

    fn wall(shape: WarpGeometry, is_screen: bool) -> Wall {
        let (surface, kind) = if is_screen {
            (Surface::Mesh(0), CalibrationFileKind::ScreenMesh)
        } else {
            let plane = super::super::surface::Plane::upright(DVec3::NEG_Z * 9.0, DVec2::ONE);
            (Surface::Plane(plane), CalibrationFileKind::Warp)
        };
        let mut channel = Channel::tile("c0", 0, UVec2::ZERO, UVec2::new(64, 32));
        if !is_screen {
            (channel.cover, channel.adjustment.warp) = (ChannelKind::Map, Some(0));
        }
        let screen = Screen::new("front", surface, UVec2::new(64, 32));
        let mut wall = Wall::new("w", vec![screen], vec![channel]);
        let front = surface_samples(shape);
        let path = "x".to_owned();
        wall.files.push(CalibrationFile { path, kind, blob: None, is_for_one_eye: false, front });
        wall
    }

    #[test]
    fn a_head_behind_a_mesh_or_a_map_is_refused_by_name() {
        let size = UVec2::new(161, 91);
        let by_map = wall(WarpGeometry::Grid(arch(size)), false);
        for wall in [wall(WarpGeometry::Mesh(arch_mesh(size)), true), by_map] {
            for within in [DVec3::ZERO, DVec3::new(1.0, 0.5, -1.0), DVec3::new(-1.5, 0.0, 0.0)] {
                assert_eq!(
                    wall.check_head(&HeadPose::facing_forward(within, 0.06)),
                    Ok(()),
                    "{within}"
                );
            }
            for beside in [DVec3::new(0.0, 0.0, -3.0), DVec3::new(2.5, 0.0, -1.0)] {
                let error =
                    wall.check_head(&HeadPose::facing_forward(beside, 0.06)).expect_err("behind");
                let error = error.to_string();
                assert!(error.contains("c0") && error.contains("m behind screen front"), "{error}");
            }
        }
        // From behind it all, a screen is refused; a map for a projector behind it is mirrored.
        let far = HeadPose::facing_forward(DVec3::new(0.0, 0.0, -300.0), 0.06);
        assert!(wall(WarpGeometry::Mesh(arch_mesh(size)), true).check_head(&far).is_err());
    }

    #[test]
    fn a_tile_minds_its_own_part_of_a_mesh_only() {
        let mut wall = wall(WarpGeometry::Mesh(arch_mesh(UVec2::new(161, 91))), true);
        wall.channels[0].size = UVec2::new(16, 32);
        // Behind the right side, before the left one.
        let aside = HeadPose::facing_forward(DVec3::new(2.5, 0.0, -0.5), 0.06);
        assert_eq!(wall.check_head(&aside), Ok(()));
        wall.channels[0].origin = UVec2::new(48, 0);
        assert!(wall.check_head(&aside).is_err());
    }
}
