//! Meshes that reach beyond pictures and tiles, against each pixel asked by itself.

use glam::{DVec2, DVec3, UVec2, Vec2};
use proptest::prelude::{ProptestConfig, Strategy, any, prop_assert, proptest};

use super::super::{ImportedMesh, ImportedVertex, MapCoordinates, WarpGeometry, WarpMap};
use crate::channel_mapping::ChannelMapping;
use crate::surface::Plane;
use crate::wall_geometry::{ResolvedWall, WallGeometry};
use crate::{Channel, ChannelId, Screen, Surface, Wall};

/// A grid of cells over a rectangle of places, unevenly moved, whose values are a hill.
fn hill(cells: UVec2, low: DVec2, high: DVec2, seed: u64) -> ImportedMesh {
    let jitter = |index: u32, salt: u64| {
        let mixed = (u64::from(index) + 1).wrapping_mul(seed | 1).wrapping_mul(0x9e37_79b9 + salt);
        (mixed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let points = cells + 1;
    let vertex = |index: u32| {
        let at = UVec2::new(index % points.x, index / points.x).as_dvec2();
        let moved = at + DVec2::new(jitter(index, 3), jitter(index, 7)) * 0.5;
        let place = low + (high - low) * moved / cells.as_dvec2();
        let value = DVec3::new(place.x * 2.0 - 1.0, 0.5 - place.y, -2.0 + 0.3 * jitter(index, 5));
        ImportedVertex { place: place.as_vec2(), value: value.as_vec3(), light: 1.0 }
    };
    let cell = |index: u32| {
        let first = index / cells.x * points.x + index % cells.x;
        let (second, third, fourth) = (first + 1, first + points.x, first + points.x + 1);
        [[first, second, third], [fourth, third, second]]
    };
    ImportedMesh {
        vertices: (0..points.element_product()).map(vertex).collect(),
        triangles: (0..cells.element_product()).flat_map(cell).collect(),
    }
}

/// The value at a place, triangle by triangle; `None` also near an edge of the whole, where f32
/// decides.
fn value_at(mesh: &ImportedMesh, place: DVec2) -> Option<DVec3> {
    mesh.triangles.iter().find_map(|triangle| {
        let [a, b, c] = triangle.map(|corner| mesh.vertices[corner as usize]);
        let [p, q, r] = [a, b, c].map(|vertex: ImportedVertex| vertex.place.as_dvec2());
        let area = (q - p).perp_dot(r - p);
        let (u, v) = ((place - p).perp_dot(r - p) / area, (q - p).perp_dot(place - p) / area);
        let is_in = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        let [p, q, r] = [a, b, c].map(|vertex: ImportedVertex| vertex.value.as_dvec3());
        is_in.then(|| p + (q - p) * u + (r - p) * v)
    })
}

fn warp(mesh: ImportedMesh) -> WarpMap {
    WarpMap { space: MapCoordinates::Display, shape: WarpGeometry::Mesh(mesh) }
}

/// Checks that a channel's mesh shows at its pixels what the file has there, and nothing beside it.
fn check(
    channel: &Channel,
    screen: &Screen,
    map: &WarpMap,
    is_tile: bool,
    error_m: f64,
) -> Result<(), proptest::test_runner::TestCaseError> {
    let WarpGeometry::Mesh(source) = &map.shape else { return Ok(()) };
    let Some(pixels) = ChannelMapping::new(channel, screen) else { return Ok(()) };
    let ground = WallGeometry::empty().screen(screen);
    let mesh = if is_tile {
        map.screen_mesh(channel, &ground, &pixels)
    } else {
        map.channel_mesh(channel, &ground, &pixels)
    };
    let size = channel.size.as_dvec2();
    for vertex in &mesh.vertices {
        let is_on = vertex.pixel.cmpge(DVec2::ZERO).all() && vertex.pixel.cmple(size).all();
        prop_assert!(is_on, "{} is beside {size}", vertex.pixel);
    }
    for index in 0..400u32 {
        let at = UVec2::new(index % 20, index / 20).as_dvec2() + DVec2::new(0.37, 0.61);
        let pixel = at / 20.0 * size;
        let Some(meant) = pixels.ideal_from_pixel(pixel) else { continue };
        let place = if is_tile {
            (meant + channel.origin.as_dvec2()) / screen.canvas.as_dvec2()
        } else {
            meant / size
        };
        let is_on = place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all();
        let due = value_at(source, place).filter(|_| is_on);
        match (due, mesh.point_at(pixel)) {
            (Some(due), Some(found)) => {
                let off = found.distance(due);
                prop_assert!(off <= error_m, "{pixel}: {found}, not {due}: {off} m");
            }
            (None, None) => {}
            (due, found) => {
                // At the rim of the mesh or of the picture a hundredth of a pixel decides.
                let beside = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y].map(|by| {
                    let place = place + by * 0.05 / size;
                    let is_on = place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all();
                    is_on && value_at(source, place).is_some()
                });
                let is_rim = beside.contains(&true) && beside.contains(&false);
                prop_assert!(is_rim, "{pixel} at {place}: {found:?}, not {due:?}");
            }
        }
    }
    Ok(())
}

fn screen(canvas: UVec2) -> Screen {
    let plane = Plane::upright(DVec3::new(0.0, 0.0, -2.0), DVec2::new(2.0, 1.0));
    Screen::new("s", Surface::Plane(plane), canvas)
}

fn moves() -> impl Strategy<Value = [DVec2; 4]> {
    let corner = (-0.2f64..0.2, -0.2f64..0.2);
    [corner.clone(), corner.clone(), corner.clone(), corner].prop_map(|all| all.map(DVec2::from))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn meshes_around_the_border_of_a_picture_are_cut_at_it(
        (across, down) in (1u32..9, 1u32..9),
        low in (-0.6f64..0.2, -0.6f64..0.2),
        high in (0.8f64..1.6, 0.8f64..1.6),
        seed in any::<u64>(),
        pins in moves(),
        is_pinned in any::<bool>(),
    ) {
        let canvas = UVec2::new(320, 200);
        let mut channel = Channel::tile("c", 0, UVec2::ZERO, UVec2::new(160, 100));
        if is_pinned {
            channel.adjustment.pin = pins.map(|pin| pin * channel.size.as_dvec2());
        }
        let mesh = hill(UVec2::new(across, down), low.into(), high.into(), seed);
        // Two hundredths of a pixel of 2 m by 160, and what the hill rises.
        check(&channel, &screen(canvas), &warp(mesh), false, 1e-3)?;
    }

    #[test]
    fn tiles_of_a_mesh_in_any_number_of_columns_are_cut_from_it(
        (across, down) in (1u32..12, 1u32..8),
        (columns, rows) in (1u32..8, 1u32..5),
        seed in any::<u64>(),
        pins in moves(),
        is_pinned in any::<bool>(),
    ) {
        let canvas = UVec2::new(331, 197);
        let mesh = warp(hill(UVec2::new(across, down), DVec2::ZERO, DVec2::ONE, seed));
        let edge = |at: u32, count: u32, side: u32| side * at / count;
        for (column, row) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            let from = UVec2::new(edge(column, columns, canvas.x), edge(row, rows, canvas.y));
            let to = UVec2::new(edge(column + 1, columns, canvas.x), edge(row + 1, rows, canvas.y));
            let mut channel = Channel::tile("c", 0, from, to - from);
            if is_pinned {
                channel.adjustment.pin = pins.map(|pin| pin * channel.size.as_dvec2());
            }
            check(&channel, &screen(canvas), &mesh, true, 1e-3)?;
        }
    }
}

/// Pins that tip the picture so far that a part of the mesh lies behind their horizon.
#[test]
fn pins_may_tip_a_mesh_over_its_horizon() {
    let canvas = UVec2::new(400, 400);
    let mut channel = Channel::tile("c", 0, UVec2::ZERO, UVec2::new(100, 100));
    let narrow = [(45.0, 0.0), (-45.0, 0.0), (0.0, 0.0), (0.0, 0.0)];
    channel.adjustment.pin = narrow.map(DVec2::from);
    let mesh = hill(UVec2::new(7, 7), DVec2::ZERO, DVec2::ONE, 9);
    check(&channel, &screen(canvas), &warp(mesh), true, 2e-3).expect("cut at the horizon");
}

/// A wall whose file no server could draw is refused before, with the key that names the file.
#[test]
fn what_cannot_be_drawn_is_refused_by_its_key() {
    use std::sync::Arc;

    use crate::calibration_maps::CalibrationMaps;
    use crate::warp::CalibrationMap;
    use crate::{CalibrationFile, CalibrationFileKind, ChannelKind};
    use polyptych_files::blob::BlobHash;

    let size = UVec2::new(64, 32);
    let wall = |mesh: ImportedMesh| {
        let mut channel = Channel::tile("c", 0, UVec2::ZERO, size);
        channel.cover = ChannelKind::Map;
        channel.adjustment.warp = Some(0);
        let mut wall = Wall::new("w", vec![screen(size)], vec![channel]);
        wall.files.push(CalibrationFile {
            path: "a.obj".into(),
            kind: CalibrationFileKind::Warp,
            blob: Some(BlobHash([1; 32])),
            is_for_one_eye: false,
            front: Vec::new(),
        });
        let map = Arc::new(CalibrationMap::Warp(warp(mesh)));
        let maps = CalibrationMaps::load(&wall, |_| Ok(Arc::clone(&map))).expect("a map");
        let shapes = WallGeometry::new(&wall, &maps);
        let shaped = ResolvedWall { wall: &wall, shapes: &shapes };
        shaped.check_files(&maps).map(|()| shaped.drawn_mesh(&maps, ChannelId(0)).expect("drawn"))
    };
    let good = hill(UVec2::new(4, 3), DVec2::splat(-0.2), DVec2::splat(1.2), 5);
    assert!(wall(good.clone()).expect("good").triangles.len() >= 24);
    let refused = |mesh: ImportedMesh, parts: &[&str]| {
        let line = wall(mesh).expect_err("refused");
        assert!(line.starts_with("channel.c.warp: a.obj: channel c cannot be drawn: "), "{line}");
        assert!(parts.iter().all(|part| line.contains(part)), "{line}");
    };
    let moved = |place: Vec2, value: f32| {
        let mut mesh = good.clone();
        for vertex in &mut mesh.vertices {
            vertex.place += place;
            vertex.value *= value;
        }
        mesh
    };
    refused(moved(Vec2::X * 3.0, 1.0), &["none of its pixels", "check the units"]);
    refused(moved(Vec2::ZERO, 0.0), &["a point or a line"]);
}
