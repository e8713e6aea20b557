//! Colours of vertices: a coarser level states how far they slide.

use std::sync::atomic::AtomicBool;

use glam::{DVec2, DVec3};
use polyptych_scene::VertexLayout;

use super::Drawn;
use super::shapes::Shape;
use crate::levels::appearance::UvLengths;
use crate::levels::clustering::MovedVertex;
use crate::levels::patch::Patch;
use crate::levels::source::Source;
use crate::levels::{Levels, Surface, build};

const LAYOUT: VertexLayout = VertexLayout { tangent: false, uv0: false, uv1: false, color: true };

/// Cells along each side.
const CELLS: u32 = 60;

/// The levels of a flat sheet of 60 × 60 m, white but for a red band of this width in cells.
fn banded(width: u32) -> (Levels, Vec<bool>) {
    let (mut vertices, mut indices, mut is_red) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=CELLS {
        for column in 0..=CELLS {
            let red = (20..20 + width).contains(&column);
            let other = if red { 0.0 } else { 1.0 };
            vertices.extend([
                column as f32,
                row as f32,
                0.0,
                0.0,
                0.0,
                1.0,
                1.0,
                other,
                other,
                1.0,
            ]);
            is_red.push(red);
        }
    }
    for row in 0..CELLS {
        for column in 0..CELLS {
            let at = row * (CELLS + 1) + column;
            let below = at + CELLS + 1;
            indices.extend([at, at + 1, below, at + 1, below + 1, below]);
        }
    }
    let surface = Surface {
        layout: LAYOUT,
        vertices: &vertices,
        indices: &indices,
        keeps_order: false,
        locked: &[],
    };
    let levels = build(&[surface], &AtomicBool::new(false)).expect("not cancelled");
    (levels.into_iter().next().flatten().expect("levels"), is_red)
}

/// The vertices that are drawn at an allowed error.
fn drawn(levels: &Levels, limit: f32) -> Vec<u32> {
    let is_drawn =
        levels.meshlets.iter().filter(|of| of.error <= limit && of.coarser_error > limit);
    let run = is_drawn.flat_map(|of| {
        let first = of.first_index as usize;
        &levels.indices[first..first + of.index_count as usize]
    });
    run.copied().collect()
}

#[test]
fn a_band_is_drawn_until_the_error_is_as_wide() {
    let (plain, _) = banded(0);
    assert!(drawn(&plain, 0.01).len() < 300, "{} corners", drawn(&plain, 0.01).len());
    let (levels, is_red) = banded(8);
    for limit in [0.01, 0.5, 1.0, 2.0] {
        let corners = drawn(&levels, limit);
        let rows = |row: std::ops::Range<u32>| {
            let mut corners = corners.iter().filter(|at| row.contains(&(**at / (CELLS + 1))));
            corners.any(|at| is_red[*at as usize])
        };
        assert!(rows(0..20) && rows(41..61), "the band is not whole at {limit} m");
    }
    let all = levels.meshlets.iter().map(|of| of.error).fold(0.0, f32::max);
    assert!(all > 4.0, "the band is gone for {all} m");
}

/// Tiles along each side of the mosaic.
const TILES: u32 = 24;

/// The column and row of a vertex's tile in the mosaic.
fn tile_of(vertex: u32) -> [u32; 2] {
    [vertex / 4 % TILES, vertex / 4 / TILES]
}

/// The place of a vertex's tile in a palette of 16 colours.
fn texel(vertex: u32) -> u32 {
    let [x, y] = tile_of(vertex);
    (x * 7 + y * 5 + x * y) % 16
}

/// Tiles of 1 m, each with vertices and a colour of a palette of its own.
fn mosaic() -> Shape {
    let mut mosaic = Shape::new("mosaic");
    for tile in 0..TILES * TILES {
        let [x, y] = tile_of(4 * tile).map(f64::from);
        let uv = DVec2::new(f64::from(texel(4 * tile)) / 16.0, 0.5);
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let [a, b, c, d] =
            corners.map(|[dx, dy]| mosaic.vertex(DVec3::new(x + dx, y + dy, 0.0), uv));
        mosaic.indices.extend([a, b, c, b, d, c]);
    }
    mosaic
}

/// A palette has one place of a texture for each face: its area there is none.
#[test]
fn tiles_of_a_palette_keep_their_colours() {
    let levels = super::levels(&mosaic());
    for limit in [0.001, 0.25] {
        let corners = drawn(&levels, limit);
        let triangles = corners.as_chunks::<3>().0;
        let is_mixed = |of: &&[u32; 3]| of.iter().any(|at| texel(*at) != texel(of[0]));
        assert_eq!(triangles.iter().filter(is_mixed).count(), 0, "{limit} m");
        assert!(triangles.len() > 500, "{} triangles at {limit} m", triangles.len());
    }
}

/// Returns whether triangles show a place of the mosaic's palette at a point of its plane.
fn shows(drawn: &Drawn, at: DVec2, u: f64) -> bool {
    let triangles = drawn.indices.as_chunks::<3>().0.iter().zip(&drawn.triangles);
    let mut shown = triangles.filter_map(|(corners, places)| {
        let [a, b, c] = places.map(|place| place.truncate() - at);
        let area = (b - a).perp_dot(c - a);
        let shares = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)].map(|own| own / area);
        let us = corners.map(|corner| f64::from(drawn.vertices[corner as usize * 8 + 6]));
        let is_inside = shares.iter().all(|share| *share >= 0.0);
        is_inside.then(|| us.iter().zip(shares).map(|(one, share)| one * share).sum::<f64>())
    });
    shown.any(|shown| (shown - u).abs() < 0.01)
}

/// Charts side by side that are left out count together, however narrow each of them is.
#[test]
fn a_mosaic_is_not_lost_for_the_width_of_a_tile() {
    let mosaic = mosaic();
    let levels = super::levels(&mosaic);
    // At 4 m, the place of a tile's colour may be that far away: it is found again within that.
    for (limit, least) in [(0.0, 576), (1.2, 300), (2.0, 300)] {
        let drawn = Drawn::within(&mosaic, &levels, limit);
        let is_right = |tile: &u32| {
            let [x, y] = tile_of(4 * *tile).map(f64::from);
            let at = DVec2::new(x + 0.3, y + 0.4);
            shows(&drawn, at, f64::from(texel(4 * *tile)) / 16.0)
        };
        let right = (0..TILES * TILES).filter(is_right).count();
        assert!(right >= least, "{right} of 576 tiles have their colours at {limit} m");
    }
}

/// A surface of one colour has the levels that it has without a texture.
#[test]
fn one_place_of_a_texture_costs_no_detail() {
    let ball = |uv: DVec2| {
        let mut ball = Shape::new("ball");
        for row in 0..=40_u32 {
            for column in 0..=40_u32 {
                let [around, up] = [column, row].map(|at| f64::from(at) / 40.0);
                let (sin, cos) = (around * std::f64::consts::TAU).sin_cos();
                let (high, wide) = ((up - 0.5) * std::f64::consts::PI).sin_cos();
                ball.vertex(DVec3::new(cos * wide, sin * wide, high), uv);
            }
        }
        for at in (0..40 * 40).map(|cell| cell / 40 * 41 + cell % 40) {
            ball.indices.extend([at, at + 1, at + 41, at + 1, at + 42, at + 41]);
        }
        // A tile of another colour, far away, so that it is no texture of one place.
        let tile = [[9.0, 0.0], [9.1, 0.0], [9.0, 0.1]]
            .map(|[x, y]| ball.vertex(DVec3::new(x, y, 0.0), uv + DVec2::new(0.25, 0.0)));
        ball.indices.extend(tile);
        let levels = build(&[ball.surface()], &AtomicBool::new(false)).expect("not cancelled");
        levels.into_iter().next().flatten().expect("levels")
    };
    let [at_zero, elsewhere] = [DVec2::ZERO, DVec2::new(0.71, 0.33)].map(ball);
    for limit in [0.001, 0.01, 0.05] {
        let [one, other] = [&at_zero, &elsewhere].map(|levels| drawn(levels, limit).len());
        assert!(one.abs_diff(other) * 20 < one, "{one} and {other} corners at {limit} m");
        assert!(other < 2 * 41 * 41 * 3, "{other}");
    }
}

/// Returns how far along x it is from a point of a strip to where triangles show the same first
/// texture coordinate, at least; 0 if they show it nowhere.
fn way_along(drawn: &Drawn, at: f64, u: f64) -> f64 {
    let triangles = drawn.indices.as_chunks::<3>().0.iter().zip(&drawn.triangles);
    let ways = triangles.filter_map(|(corners, places)| {
        let us = corners.map(|corner| f64::from(drawn.vertices[corner as usize * 8 + 6]));
        let crossing = |[one, two]: [usize; 2]| {
            let share = (u - us[one]) / (us[two] - us[one]);
            let x = places[one].x + (places[two].x - places[one].x) * share;
            (0.0..=1.0).contains(&share).then_some(x)
        };
        let xs = [[0, 1], [1, 2], [2, 0]].map(crossing).into_iter().flatten();
        let (low, high) =
            xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        if low <= high { Some((low - at).max(at - high).max(0.0)) } else { None }
    });
    ways.reduce(f64::min).unwrap_or(0.0)
}

/// A texture along a road slides along it by more than the road is wide. A vertex's slide counts
/// in space and on the texture at once, at the average length of a unit: by half of it at least.
#[test]
fn a_texture_of_a_long_strip_slides_by_its_own_length() {
    let along = |u: f64| 50.0 * (u + u * u);
    let road = Shape::new("road").all([64, 4], |u, v| DVec3::new(along(u), 5.0 * v, 0.0));
    let levels = super::levels(&road);
    for error in levels.facts.errors.iter().map(|error| *error as f32) {
        let drawn = Drawn::within(&road, &levels, error);
        let ways = (0..=64).map(|at| f64::from(at) / 64.0).map(|u| way_along(&drawn, along(u), u));
        let way = ways.fold(0.0, f64::max);
        assert!(way <= 2.0 * drawn.error + 1e-3, "{way} m for an error of {} m", drawn.error);
    }
}

/// What lies on a triangle with a vertex that only a coarser level has is drawn there, if that
/// came from the same chart: it slides along a marking by more than that is wide.
#[test]
fn a_texture_beside_an_added_vertex_slides_by_its_own_length() {
    let mut marking = Shape::new("marking");
    for (u, x) in [(0.0, 0.0), (1.0, 100.0), (2.0, 300.0)] {
        for v in [0.0, 1.0] {
            marking.vertex(DVec3::new(x, 0.05 * v, 0.0), DVec2::new(u, v));
        }
    }
    for at in [0, 2] {
        marking.indices.extend([at, at + 2, at + 1, at + 2, at + 3, at + 1]);
    }
    let surfaces = [marking.surface()];
    let mut source = Source::new(&surfaces);
    let [low, high] = [4, 5].map(|end| {
        let [uv, other] = source.uvs(end);
        let uvs = [uv + DVec2::new(0.01, 0.0), other];
        source.add(&MovedVertex { from: end, at: end, uvs, origin: end })
    });
    let after = [0, low, 1, low, high, 1];
    let patch = Patch::new(&source, &after, &marking.indices);
    let simplified = patch.measured(patch.current(), (0.0, f64::INFINITY)).expect("measured");
    // What stood at 100 m stands at 149 m now, and counts in space and on the texture at once.
    assert!(simplified.error > 30.0, "{} m", simplified.error);
}

/// The places of the nodes of a strip, from 0 on: segments of 10 m and of 1 m in turn, on each of
/// which one unit of a texture is drawn.
fn uneven_nodes() -> Vec<f64> {
    let mut nodes = vec![0.0];
    let mut x = 0.0;
    for segment in 0..39 {
        x += if segment % 2 == 0 { 10.0 } else { 1.0 };
        nodes.push(x);
    }
    nodes
}

/// Vertices that move take texture coordinates along that may be those of another place. What is
/// stated counts by half of what is off at least, as along a road.
#[test]
fn corners_that_move_along_a_strip_state_how_far_its_texture_slides() {
    let nodes = uneven_nodes();
    let mut strip = Shape::new("strip");
    for (node, x) in (0_u32..).zip(&nodes) {
        for v in [0.0, 1.0] {
            strip.vertex(DVec3::new(*x, 2.0 * v, 0.0), DVec2::new(node.into(), v));
        }
    }
    for at in (0..39).map(|segment| 2 * segment) {
        strip.indices.extend([at, at + 2, at + 1, at + 2, at + 3, at + 1]);
    }
    // A mesh of several surfaces is contracted, whatever connects it.
    let quad = Shape::new("quad").all([1, 1], |u, v| DVec3::new(10.0 * u, 10.0 + 10.0 * v, 0.0));
    let surfaces = [strip.surface(), quad.surface()];
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let levels = levels.into_iter().next().flatten().expect("levels of the strip");
    assert!(levels.facts.errors.len() > 1, "{:?}", levels.facts);
    for error in levels.facts.errors.iter().map(|error| *error as f32) {
        let drawn = Drawn::within(&strip, &levels, error);
        for (corner, place) in drawn.indices.iter().zip(drawn.points()) {
            let u = f64::from(drawn.vertices[*corner as usize * 8 + 6]);
            let node = nodes.iter().position(|x| (x - place.x).abs() < 1e-3).expect("a node");
            // A unit is at least 1 m long.
            let way = (u - node as f64).abs();
            assert!(way <= 2.0 * drawn.error + 1e-3, "{way} m for {} m at {place}", drawn.error);
        }
    }
}

/// Units of both coordinates have a length each.
#[test]
fn units_along_a_strip_are_longer_than_across_it() {
    let at = |index: u32| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]][index as usize];
    let uv = |index: u32| DVec2::from(at(index));
    let position = |index: u32| (uv(index) * DVec2::new(100.0, 5.0)).extend(0.0);
    let lengths = UvLengths::new(&[0, 1, 2, 1, 3, 2], position, uv);
    assert!(lengths.along(0).distance(DVec2::new(100.0, 5.0)) < 1e-9, "{}", lengths.along(0));
    assert_eq!(lengths.at(0), lengths.along(0).x);
}

/// Where a part of a surface has the colours of a palette, and another one a texture, each has the
/// length of its own.
#[test]
fn a_texture_beside_a_palette_has_its_own_length() {
    let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 0.0], [9.0, 0.0], [5.0, 4.0]];
    let uvs = [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.9, 0.9], [0.9, 0.9], [0.9, 0.9]];
    let at = |of: [[f64; 2]; 6], index: u32| DVec2::from(of[index as usize]);
    let lengths = |indices: &[u32]| {
        UvLengths::new(indices, |of| at(positions, of).extend(0.0), |of| at(uvs, of))
    };
    let both = lengths(&[0, 1, 2, 3, 4, 5]);
    assert_eq!((both.at(0), both.at(2)), (2.0, 2.0));
    assert!(both.at(3) > 1000.0 && both.at(5) == both.at(3));
    let shared = lengths(&[0, 1, 2, 3, 4, 5, 0, 1, 3]);
    assert!(shared.at(3) == shared.at(0) && shared.at(4) > 1000.0);
    assert_eq!(lengths(&[3, 4, 5]).at(3), 0.0, "nothing to tell apart");
}

/// One coordinate that is far off says nothing about the units of all other vertices.
#[test]
fn a_stray_coordinate_leaves_the_units_of_others_as_they_are() {
    let side = 40_u32;
    let at = |index: u32| DVec2::new(f64::from(index % side), f64::from(index / side));
    let cells = (0..(side - 1) * (side - 1)).map(|at| at / (side - 1) * side + at % (side - 1));
    let corners = cells.flat_map(|at| [at, at + 1, at + side, at + 1, at + side + 1, at + side]);
    let corners: Vec<u32> = corners.collect();
    let length = |stray: DVec2| {
        let uv = |index: u32| if index == 777 { stray } else { at(index) / 39.0 };
        UvLengths::new(&corners, |index| at(index).extend(0.0), uv).at(0)
    };
    let plain = length(at(777) / 39.0);
    assert!((plain - 39.0).abs() < 1e-6, "{plain}");
    for stray in [DVec2::new(1e6, 0.3), DVec2::new(-7.0, 1e30), DVec2::splat(30.0)] {
        let length = length(stray);
        assert!((length - plain).abs() < 0.02 * plain, "{length} with {stray}");
    }
}

/// Vertices that only a coarser level has are of a palette as those of the finest one, whatever
/// triangles without an area lie beside.
#[test]
fn vertices_that_are_added_to_a_palette_have_its_length() {
    let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [5.0, 0.0], [9.0, 0.0]];
    let positions = [&positions[..], &[[5.0, 4.0], [5.0, 0.0], [9.0, 0.0], [0.0, 1.0]]].concat();
    let position = |index: u32| DVec2::from(positions[index as usize]).extend(0.0);
    let uv = |index: u32| DVec2::splat(if index < 4 { 0.1 } else { 0.9 });
    let mut lengths = UvLengths::new(&[0, 1, 2, 0, 1, 3, 4, 5, 6], position, uv);
    assert!(lengths.at(0) > 1000.0 && lengths.at(1) == lengths.at(4), "a line beside it");
    lengths.add(&[7, 8, 9, 4, 5, 6], |index| index > 6, position, uv);
    assert_eq!([7, 8, 9].map(|index| lengths.at(index)), [lengths.at(4); 3]);
}

/// Quads of which each has vertices of its own, by their corners, normal and grey.
#[derive(Default)]
struct Quads {
    vertices: Vec<f32>,
    indices: Vec<u32>,
}

impl Quads {
    fn add(&mut self, corners: [[f32; 3]; 4], normal: [f32; 3], greys: [f32; 4]) {
        let first = self.vertices.len() as u32 / 10;
        for (corner, grey) in corners.into_iter().zip(greys) {
            self.vertices.extend(corner.into_iter().chain(normal).chain([grey, grey, grey, 1.0]));
        }
        self.indices.extend([0, 1, 2, 0, 2, 3].map(|at| first + at));
    }

    fn surface(&self) -> Surface<'_> {
        Surface {
            layout: LAYOUT,
            vertices: &self.vertices,
            indices: &self.indices,
            keeps_order: false,
            locked: &[],
        }
    }
}

/// A wall of 6 × 4 bays of 3 m, each with a window of 1 m in a recess of 0.1 m that is darker; the
/// topmost 0.8 m are a shade darker.
fn facade() -> [Quads; 2] {
    let (mut wall, mut panes) = (Quads::default(), Quads::default());
    let ys = (0..4_u8).flat_map(|at| [0.0, 1.0, 2.0].map(|y| y + 3.0 * f32::from(at)));
    let ys: Vec<f32> = ys.chain([12.0, 12.8]).collect();
    let xs: Vec<f32> = (0..=18_u8).map(f32::from).collect();
    for (row, y) in ys.windows(2).enumerate() {
        for (column, x) in xs.windows(2).enumerate() {
            let ([left, right], [low, high]) = ([x[0], x[1]], [y[0], y[1]]);
            let at = |z: f32| [[left, low, z], [right, low, z], [right, high, z], [left, high, z]];
            if row % 3 != 1 || column % 3 != 1 {
                let top = if high > 12.0 { 0.8 } else { 1.0 };
                wall.add(at(0.0), [0.0, 0.0, 1.0], [1.0, 1.0, top, top]);
                continue;
            }
            panes.add(at(-0.1), [0.0, 0.0, 1.0], [0.2; 4]);
            let (front, back) = (at(0.0), at(-0.1));
            let inwards = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]];
            for (side, normal) in inwards.into_iter().enumerate() {
                let next = (side + 1) % 4;
                let corners = [front[side], front[next], back[next], back[side]];
                wall.add(corners, normal, [0.6; 4]);
            }
        }
    }
    [wall, panes]
}

/// A ring of another colour is as wide as its band, not as what it encloses.
#[test]
fn reveals_of_windows_go_and_the_shade_of_the_eaves_stays() {
    let [wall, panes] = facade();
    let surfaces = [wall.surface(), panes.surface()];
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let levels = levels.into_iter().next().flatten().expect("levels");
    let corners = drawn(&levels, 0.3);
    assert!(corners.len() * 2 < wall.indices.len(), "{} of {}", corners.len(), wall.indices.len());
    let vertices = [&wall.vertices[..], &levels.added].concat();
    let row = |at: u32| &vertices[at as usize * 10..][..10];
    for at in corners {
        let [y, grey] = [row(at)[1], row(at)[6]];
        let expected = if y > 12.0 { 0.8 } else { 1.0 };
        assert!((grey - expected).abs() < 0.01, "{grey} at a height of {y} m");
    }
}
