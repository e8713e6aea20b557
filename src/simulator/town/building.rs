//! Houses: a catalogue of designs, each built once and shared by many nodes.

use glam::{Vec3, vec3};

use super::color::{Color, srgb};
use super::facade_wall::{FacadeWall, Opening, awning, door};
use super::material::Material;
use super::roof::Roof;
use super::surface::{Extent, Hidden, LocalFrame, Model};

/// Depth of a house's plinth in the ground, in metres: more than a block's fall.
const FOUNDATION: f32 = 4.5;
/// Height of the plinth above the door's threshold.
const PLINTH: f32 = 0.5;
/// From floor to floor.
const STOREY: f32 = 2.9;

/// The shape of a roof.
#[derive(Clone, Copy, Debug, PartialEq)]
enum RoofKind {
    /// The ridge runs along the street.
    Gable,
    /// The gable faces the street.
    FrontGable,
    Hip,
    Flat,
}

/// The part of the town that a design belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quarter {
    /// Tall and narrow, at the water.
    Harbour,
    /// In the streets behind it.
    Town,
    /// Low, on the hill and in courtyards.
    Cottage,
}

/// One design.
#[derive(Clone, Copy, Debug)]
pub(super) struct Design {
    pub quarter: Quarter,
    wall: Material,
    /// sRGB.
    wall_tint: u32,
    roof_tint: u32,
    wood_tint: u32,
    width: f32,
    depth: f32,
    storeys: u32,
    windows: u32,
    top: RoofKind,
    has_shutters: bool,
    is_shop: bool,
    dormers: u32,
}

const TERRACOTTA: u32 = 0xd97a52;
const RUST: u32 = 0xc26444;
const OCHRE: u32 = 0xd89462;
const SLATE: u32 = 0x7c848e;

/// Wall, its tint, roof, woodwork, width, depth, storeys, windows, top, shutters, shop, dormers.
type Row = (Material, u32, u32, u32, f32, f32, u32, u32, RoofKind, bool, bool, u32);

const fn row(quarter: Quarter, row: Row) -> Design {
    let (wall, wall_tint, roof_tint, wood_tint, width, depth, storeys, windows, top, ..) = row;
    let (.., has_shutters, is_shop, dormers) = row;
    Design {
        quarter,
        wall,
        wall_tint,
        roof_tint,
        wood_tint,
        width,
        depth,
        storeys,
        windows,
        top,
        has_shutters,
        is_shop,
        dormers,
    }
}

/// Every design: warm plasters with a few cool ones among them, so that no street is monotonous.
#[rustfmt::skip]
pub(super) const CATALOGUE: [Design; 18] = {
    use Material::{Brick, Plaster, Stone};
    use Quarter::{Cottage, Harbour, Town};
    use RoofKind::{Flat, FrontGable, Gable, Hip};
    [
        row(Harbour, (Plaster, 0xf2c68e, TERRACOTTA, 0x2f6b6e,
            7.6, 8.0, 4, 3, Gable, true, true, 1)),
        row(Harbour, (Plaster, 0xe88f74, RUST, 0x3e6a4f,
            7.0, 8.0, 4, 2, FrontGable, true, true, 0)),
        row(Harbour, (Plaster, 0xf4e3c2, TERRACOTTA, 0x2c5b86,
            8.6, 8.2, 3, 3, Gable, true, true, 2)),
        row(Harbour, (Plaster, 0x9fc1c4, OCHRE, 0xf0e4cc,
            7.2, 7.8, 4, 3, Gable, false, true, 0)),
        row(Harbour, (Brick, 0xfff4ea, RUST, 0x2b4a44,
            8.8, 8.4, 3, 3, FrontGable, false, false, 0)),
        row(Harbour, (Plaster, 0xe7b4a2, TERRACOTTA, 0x5b7c66,
            8.0, 8.0, 4, 3, Hip, true, false, 0)),
        row(Town, (Plaster, 0xf0d9ae, TERRACOTTA, 0x7c3f35,
            8.4, 8.2, 3, 3, Gable, true, false, 0)),
        row(Town, (Plaster, 0xe9a87c, OCHRE, 0x2f6b6e,
            7.8, 8.0, 3, 3, Gable, false, false, 2)),
        row(Town, (Plaster, 0xf7eedd, RUST, 0x4b7a9b,
            8.8, 8.0, 2, 3, Hip, true, false, 0)),
        row(Town, (Stone, 0xf4e6cf, TERRACOTTA, 0x6a4a34,
            8.2, 8.2, 3, 3, Gable, false, false, 0)),
        row(Town, (Brick, 0xfff4ea, SLATE, 0xe6dcc8,
            8.6, 8.2, 3, 3, Gable, false, false, 1)),
        row(Town, (Plaster, 0xc9cfa6, TERRACOTTA, 0x8a4b3a,
            8.0, 7.8, 2, 3, FrontGable, true, false, 0)),
        row(Town, (Plaster, 0xf3d27e, RUST, 0x3e6a4f,
            8.6, 8.0, 3, 3, Hip, true, false, 0)),
        row(Town, (Plaster, 0xf6e8d4, 0xd8c8b0, 0x2c5b86,
            8.4, 8.2, 3, 3, Flat, false, false, 0)),
        row(Cottage, (Plaster, 0xf8f0e2, TERRACOTTA, 0x2c5b86,
            7.6, 6.4, 1, 2, Gable, true, false, 0)),
        row(Cottage, (Stone, 0xf4e6cf, OCHRE, 0x3e6a4f,
            7.4, 6.4, 2, 2, Gable, false, false, 0)),
        row(Cottage, (Plaster, 0xefc9b0, RUST, 0x2f6b6e,
            7.0, 6.2, 2, 2, Hip, true, false, 0)),
        row(Cottage, (Plaster, 0xe6d8b4, TERRACOTTA, 0x7c3f35,
            7.8, 6.6, 2, 3, FrontGable, true, false, 0)),
    ]
};

impl Design {
    /// From front to back, in metres.
    pub fn depth(&self) -> f32 {
        self.depth
    }

    fn height(&self) -> f32 {
        self.storeys as f32 * STOREY + 0.25
    }

    /// The four walls, the front first: frame, width, columns of windows.
    fn sides(&self) -> [(LocalFrame, f32, u32); 4] {
        let (x, z) = (self.width * 0.5, self.depth * 0.5);
        let at = |x: f32, z: f32, right: Vec3| LocalFrame::upright(vec3(x, 0.0, z), right);
        [
            (at(-x, z, Vec3::X), self.width, self.windows),
            (at(x, z, Vec3::NEG_Z), self.depth, 1),
            (at(x, -z, Vec3::NEG_X), self.width, 2),
            (at(-x, -z, Vec3::Z), self.depth, 1),
        ]
    }

    /// The whole house: its door faces +Z, its threshold is at y = 0.
    pub fn model(&self) -> Model {
        let mut model = Model::default();
        let tint = srgb(self.wall_tint);
        for (side, (frame, width, columns)) in self.sides().into_iter().enumerate() {
            let wall = FacadeWall {
                frame,
                material: self.wall,
                tint,
                width,
                bottom: PLINTH - 0.05,
                top: self.height(),
            };
            wall.build(&mut model, &self.openings(side, width, columns));
        }
        let (x, z) = (self.width * 0.5 + 0.05, self.depth * 0.5 + 0.05);
        let plinth = Extent { x: [-x, x], y: [-FOUNDATION, PLINTH], z: [-z, z] };
        let stone = Color::new(0.50, 0.47, 0.42);
        model.cuboid(Material::Stone, &LocalFrame::MODEL, plinth, Hidden::Bottom, stone);
        self.front(&mut model);
        self.roof(&mut model);
        model
    }

    /// The middle of the door, from the left end of the front.
    fn door_place(&self) -> f32 {
        let bay = self.width / self.windows as f32;
        bay * (0.5 + (self.windows / 2) as f32)
    }

    fn openings(&self, side: usize, width: f32, columns: u32) -> Vec<Opening> {
        let shutters = self.has_shutters.then(|| srgb(self.wood_tint));
        let mut openings = Vec::new();
        let bay = width / columns as f32;
        for storey in 0..self.storeys {
            // Side walls look at the neighbour: they have windows above the ground floor only,
            // the left one under the roof only.
            // So does the back, which the hill may reach.
            if side != 0 && storey == 0 || side == 3 && storey + 1 < self.storeys {
                continue;
            }
            let floor = storey as f32 * STOREY;
            for column in 0..columns {
                let middle = bay * (column as f32 + 0.5);
                if side == 0 && storey == 0 {
                    if (middle - self.door_place()).abs() < 0.1 {
                        continue;
                    }
                    if self.is_shop {
                        let half = bay * 0.5 - 0.32;
                        let x = [middle - half, middle + half];
                        openings.push(Opening { x, y: [0.72, 2.25], shutters: None });
                        continue;
                    }
                }
                let half = if side == 0 { 0.46 } else { 0.42 };
                let shutters = shutters.filter(|_| side == 0 && bay > 2.0);
                let x = [middle - half, middle + half];
                openings.push(Opening { x, y: [floor + 0.98, floor + 2.38], shutters });
            }
        }
        openings
    }

    fn front(&self, model: &mut Model) {
        let (frame, width, _) = self.sides()[0];
        door(model, &frame, self.door_place(), srgb(self.wood_tint));
        if self.is_shop {
            awning(model, &frame, [0.15, width - 0.15], 3.12, srgb(self.wood_tint));
        }
    }

    fn roof(&self, model: &mut Model) {
        let tint = srgb(self.wall_tint);
        let turned = self.top == RoofKind::FrontGable
            || self.width < self.depth && self.top == RoofKind::Hip;
        let (right, out) = if turned { (Vec3::Z, Vec3::NEG_X) } else { (Vec3::X, Vec3::Z) };
        let (along, across) =
            if turned { (self.depth, self.width) } else { (self.width, self.depth) };
        let roof = Roof {
            frame: LocalFrame { origin: vec3(0.0, self.height(), 0.0), right, up: Vec3::Y, out },
            along: along * 0.5,
            across: across * 0.5,
            rise: across * 0.5 * if self.top == RoofKind::Hip { 0.56 } else { 0.66 },
            tint: srgb(self.roof_tint),
        };
        match self.top {
            RoofKind::Gable | RoofKind::FrontGable => roof.gable(model, self.wall, tint),
            RoofKind::Hip => roof.hip(model),
            RoofKind::Flat => roof.flat(model, self.wall, tint),
        }
        if self.top != RoofKind::Flat {
            roof.chimney(model, along * 0.27, self.wall, tint);
        }
        for n in 0..self.dormers {
            let x = if self.dormers == 1 { 0.0 } else { (n as f32 - 0.5) * along * 0.42 };
            roof.dormer(model, x, self.wall, tint);
        }
    }
}
