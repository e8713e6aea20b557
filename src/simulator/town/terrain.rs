//! The ground of one cell: street, pavement and lot within the town, grass around it.

use glam::{Vec2, Vec3, vec2, vec3};

use super::color::{Color, srgb};
use super::heightfield::{BLOCK, Heightfield, QUAY_HEIGHT, smooth};
use super::material::Material;
use super::surface::{MeshBuffer, Model};

/// Lines that cut a cell, in metres from its middle. All cells are cut alike, so that neighbours
/// share the corners on their border: half a street, the pavement, the lot in four strips, and
/// back.
pub(super) const LINES: [f32; 9] = [-20.0, -17.25, -15.5, -7.75, 0.0, 7.75, 15.5, 17.25, 20.0];
/// The pavement's height above the street.
pub(super) const CURB: f32 = 0.14;

/// The use of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GroundCover {
    /// Houses and gardens.
    Lot,
    /// A paved square.
    Square,
    /// Open land.
    Wild,
}

/// The middle of a cell at sea level; columns run to +X, rows away from the sea.
pub(super) fn cell_middle(ground: &Heightfield, column: i32, row: i32) -> Vec3 {
    let x = (column as f32 + 0.5) * BLOCK - ground.half_width;
    vec3(x, 0.0, -(row as f32 + 0.5) * BLOCK)
}

/// The cell's node stands here: a whole number of metres high, so that sums stay exact.
pub(super) fn cell_origin(ground: &Heightfield, column: i32, row: i32) -> Vec3 {
    let middle = cell_middle(ground, column, row);
    middle.with_y(ground.height(middle.x, middle.z).floor())
}

/// One sheet of a cell's ground; it knows which corners it has already placed.
struct GroundMesh<'a> {
    ground: &'a Heightfield,
    origin: Vec3,
    lift: f32,
    repeat: f32,
    placed: [[Option<usize>; LINES.len()]; LINES.len()],
}

impl GroundMesh<'_> {
    /// The index of a corner, with a colour made of its place in the world.
    fn corner(
        &mut self,
        surface: &mut MeshBuffer,
        [i, j]: [usize; 2],
        color: impl Fn(Vec3, Vec3) -> Color,
    ) -> usize {
        if let Some(index) = self.placed[i][j] {
            return index;
        }
        let (x, z) = (self.origin.x + LINES[i], self.origin.z + LINES[j]);
        let height = self.ground.height(x, z);
        let normal = self.ground.normal(x, z);
        let color = color(vec3(x, height, z), normal);
        let local = vec3(LINES[i], height - self.origin.y + self.lift, LINES[j]);
        let uv: Vec2 = vec2(LINES[i], LINES[j]) / self.repeat;
        let index = surface.vertex(local, normal, uv, color);
        self.placed[i][j] = Some(index);
        index
    }
}

/// Streets are a ring of half width, then comes the pavement, then the lot.
fn ring(i: usize, j: usize) -> usize {
    let last = LINES.len() - 2;
    i.min(j).min(last - i).min(last - j)
}

/// The ground of a cell, relative to its origin.
pub(super) fn model(ground: &Heightfield, column: i32, row: i32, cover: GroundCover) -> Model {
    let origin = cell_origin(ground, column, row);
    let mut model = Model::default();
    match cover {
        GroundCover::Wild => {
            let wild = |place: Vec3, normal: Vec3| grass_color(ground, place, normal);
            lay(&mut model, Material::Grass, ground, origin, 0.0, |_| true, wild);
        }
        GroundCover::Lot | GroundCover::Square => {
            let stone = |tint: u32| {
                move |place: Vec3, _: Vec3| {
                    srgb(tint) * (0.9 + 0.2 * ground.noise(place.x, place.z, 17.0, 5))
                }
            };
            lay(&mut model, Material::Cobble, ground, origin, 0.0, |r| r == 0, stone(0xccc2b4));
            lay(&mut model, Material::Cobble, ground, origin, CURB, |r| r == 1, stone(0xf2e6d2));
            curb(&mut model, ground, origin);
            if cover == GroundCover::Square {
                let paving = stone(0xe0d0b8);
                lay(&mut model, Material::Cobble, ground, origin, CURB, |r| r > 1, paving);
            } else {
                let garden = |place: Vec3, normal: Vec3| {
                    let local = (place - origin).abs();
                    let worn = smooth((local.x.max(local.z) - 9.0) / 6.0) * 0.6;
                    let earth = srgb(0xb8a07c);
                    grass_color(ground, place, normal).lerp(earth, worn)
                };
                lay(&mut model, Material::Grass, ground, origin, CURB, |r| r > 1, garden);
            }
        }
    }
    model
}

/// Lays the quadrilaterals whose ring is wanted.
fn lay(
    model: &mut Model,
    material: Material,
    ground: &Heightfield,
    origin: Vec3,
    lift: f32,
    wanted: impl Fn(usize) -> bool,
    color: impl Fn(Vec3, Vec3) -> Color,
) {
    let surface = model.of(material);
    let placed = [[None; LINES.len()]; LINES.len()];
    let mut sheet = GroundMesh { ground, origin, lift, repeat: material.repeat(), placed };
    for j in 0..LINES.len() - 1 {
        for i in 0..LINES.len() - 1 {
            if !wanted(ring(i, j)) || is_drowned(ground, origin, i, j) {
                continue;
            }
            let corners = [[i, j + 1], [i + 1, j + 1], [i + 1, j], [i, j]];
            let corners = corners.map(|at| sheet.corner(surface, at, &color));
            surface.quad(corners);
        }
    }
}

/// Returns whether a quadrilateral lies wholly well below the surface of the sea.
fn is_drowned(ground: &Heightfield, origin: Vec3, i: usize, j: usize) -> bool {
    [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]]
        .into_iter()
        .all(|[i, j]| ground.height(origin.x + LINES[i], origin.z + LINES[j]) < -0.75)
}

/// The upright faces between street and pavement.
fn curb(model: &mut Model, ground: &Heightfield, origin: Vec3) {
    let edge = LINES[LINES.len() - 2];
    let color = srgb(0xc8c0b2);
    let surface = model.of(Material::Cobble);
    let repeat = Material::Cobble.repeat();
    let sides = [
        (Vec3::X, Vec3::Z),
        (Vec3::Z, Vec3::NEG_X),
        (Vec3::NEG_X, Vec3::NEG_Z),
        (Vec3::NEG_Z, Vec3::X),
    ];
    for (along, out) in sides {
        let mut before: Option<[usize; 2]> = None;
        for &line in &LINES[1..LINES.len() - 1] {
            let flat = along * line + out * edge;
            let height = ground.height(origin.x + flat.x, origin.z + flat.z) - origin.y;
            let pair = [(0.0, 0.75), (CURB, 1.0)].map(|(lift, shade): (f32, f32)| {
                let uv = vec2(line, -lift) / repeat;
                surface.vertex(flat.with_y(height + lift), out, uv, color * shade)
            });
            if let Some([low, high]) = before {
                // `along` runs to the right of one who looks at the face, for two of the sides.
                let right = along.cross(Vec3::Y).dot(out) > 0.0;
                let [l, r] = if right { [[low, high], pair] } else { [pair, [low, high]] };
                surface.quad([l[0], r[0], r[1], l[1]]);
            }
            before = Some(pair);
        }
    }
}

/// Grass, dry grass, rock where it is steep, sand at the water.
fn grass_color(ground: &Heightfield, place: Vec3, normal: Vec3) -> Color {
    let dry = ground.noise(place.x, place.z, 27.0, 6);
    let green = srgb(0x8cb05c).lerp(srgb(0xc4bc78), dry * 0.7);
    let rock = srgb(0xc4b49c);
    let steep = smooth((0.88 - normal.y) / 0.14);
    let sand = smooth((QUAY_HEIGHT - place.y) / 0.9);
    let wet = 1.0 - 0.35 * smooth((0.35 - place.y) / 0.5);
    green.lerp(rock, steep).lerp(srgb(0xecdcb4), sand) * wet
}
