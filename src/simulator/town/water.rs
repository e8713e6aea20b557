//! The sea: square tiles, opaque; near the land their vertices are lighter, as shoals are.

use glam::{Vec3, vec2, vec3};

use super::color::{Color, srgb};
use super::glb::{Glb, Node, Placement};
use super::heightfield::{BLOCK, Heightfield, smooth};
use super::material::Material;
use super::surface::Model;

/// The side of a tile, in metres.
const TILE: f32 = 80.0;
/// Strips of a tile; every tile has the same, so that neighbours share their corners.
const STRIPS: usize = 4;
/// Sea around the land, in tiles.
const MARGIN: i32 = 1;
/// From the middle to the end of the open sea, in metres: as far as one sees from a hill of 20 m.
const HORIZON: f32 = 16_384.0;
/// Metres by which the open sea reaches under the tiles, and by which it lies lower.
const UNDER: f32 = 4.0;
const LOWER: f32 = 0.0625;
/// Beyond this distance from the land all tiles are one mesh.
const SHOAL: f32 = 100.0;

/// Returns the approximate distance of a point from the coast, in metres: 0 on land.
fn offshore(ground: &Heightfield, x: f32, z: f32) -> f32 {
    // The coast lies about a third into the rim; before the town it is the quay's edge.
    let beside = (x.abs() - ground.half_width - ground.rim * 0.35).max(0.0);
    let before = (z - 8.0).max(0.0);
    let behind = (-ground.depth - ground.rim * 0.35 - z).max(0.0);
    let along = before.max(behind);
    (beside * beside + along * along).sqrt()
}

fn color(ground: &Heightfield, x: f32, z: f32) -> Color {
    let deep = srgb(0x1a5066);
    let shoal = srgb(0x3c8688);
    let distance = offshore(ground, x, z) + (ground.noise(x, z, 45.0, 8) - 0.5) * 30.0;
    shoal.lerp(deep, smooth(distance / SHOAL).max(0.08))
}

fn tile(color: impl Fn(f32, f32) -> Color) -> Model {
    let mut model = Model::default();
    let surface = model.of(Material::Water);
    let step = TILE / STRIPS as f32;
    let line = |n: usize| n as f32 * step - TILE * 0.5;
    for j in 0..=STRIPS {
        for i in 0..=STRIPS {
            let (x, z) = (line(i), line(j));
            let uv = vec2(x, z) / Material::Water.repeat();
            surface.vertex(vec3(x, 0.0, z), Vec3::Y, uv, color(x, z));
        }
    }
    let at = |i: usize, j: usize| j * (STRIPS + 1) + i;
    for j in 0..STRIPS {
        for i in 0..STRIPS {
            surface.quad([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j), at(i, j)]);
        }
    }
    model
}

/// Returns whether a tile lies wholly under the land.
fn is_inland(ground: &Heightfield, middle: Vec3) -> bool {
    (0..=8).all(|j| {
        (0..=8).all(|i| {
            let x = middle.x + (i as f32 / 8.0 - 0.5) * TILE;
            let z = middle.z + (j as f32 / 8.0 - 0.5) * TILE;
            // The quay reaches into the sea: the ground before the first street is water.
            z < -1.0 && ground.height(x, z) > 0.5
        })
    })
}

/// Adds the open sea around tiles that reach to these lines, first and last of x and of z, out to
/// [`HORIZON`]. It lies a little lower and reaches under them, so that no gap is seen between.
fn open_sea(file: &mut Glb, [columns, rows]: [[f32; 2]; 2]) -> usize {
    let lines = |[first, last]: [f32; 2]| {
        let (first, last) = (first + UNDER, last - UNDER);
        // Cells grow with the distance.
        let (before, after) = ((first - 80.0).min(-1024.0), (last + 80.0).max(1024.0));
        let (far, beyond) = ((before - 80.0).min(-4096.0), (after + 80.0).max(4096.0));
        [-HORIZON, far, before, first, last, after, beyond, HORIZON]
    };
    let (xs, zs) = (lines(columns), lines(rows));
    let mut model = Model::default();
    let surface = model.of(Material::Water);
    let deep = srgb(0x1a5066);
    for &z in &zs {
        for &x in &xs {
            let uv = vec2(x, z) / Material::Water.repeat();
            surface.vertex(vec3(x, 0.0, z), Vec3::Y, uv, deep);
        }
    }
    let at = |i: usize, j: usize| j * xs.len() + i;
    for j in 0..zs.len() - 1 {
        for i in 0..xs.len() - 1 {
            if (i, j) != (3, 3) {
                surface.quad([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j), at(i, j)]);
            }
        }
    }
    let mesh = file.add_mesh("water-open", &model);
    let place = Placement::at(vec3(0.0, -LOWER, 0.0));
    file.add_node(&Node::with_mesh("water-open", place, mesh))
}

/// Adds the sea and gives its node.
pub(super) fn write(file: &mut Glb, ground: &Heightfield, has_open_sea: bool) -> usize {
    let reach = |metres: f32| (metres / TILE).ceil() as i32 + MARGIN;
    let columns = reach(ground.half_width + ground.rim);
    let rows = [-reach(ground.depth + ground.rim), reach(BLOCK)];
    let mut children = Vec::new();
    let mut open = Vec::new();
    for row in rows[0]..rows[1] {
        for column in -columns..columns {
            let middle = vec3((column as f32 + 0.5) * TILE, 0.0, (row as f32 + 0.5) * TILE);
            if is_inland(ground, middle) {
                continue;
            }
            // The far corner is at most half a diagonal away; noise moves the shoal by 15 m.
            let nearest = offshore(ground, middle.x, middle.z) - TILE * 0.7072 - 15.0;
            if nearest > SHOAL {
                open.push(Placement::at(middle));
                continue;
            }
            let model = tile(|x, z| color(ground, middle.x + x, middle.z + z));
            let name = format!("water-{column}-{row}");
            let mesh = file.add_mesh(&name, &model);
            children.push(file.add_node(&Node::with_mesh(name, Placement::at(middle), mesh)));
        }
    }
    // A small town has shoals only; a mesh without instances would stand once at the origin.
    if !open.is_empty() {
        let far = file.add_mesh("water-far", &tile(|_, _| srgb(0x1a5066)));
        let mut far = Node::with_mesh("water-far", Placement::at(Vec3::ZERO), far);
        far.instances = open;
        children.push(file.add_node(&far));
    }
    if has_open_sea {
        let line = |tiles: i32| tiles as f32 * TILE;
        let around = [[line(-columns), line(columns)], rows.map(line)];
        children.push(open_sea(file, around));
    }
    let mut sea = Node::new("sea", Placement::at(Vec3::ZERO));
    sea.children = children;
    file.add_node(&sea)
}
