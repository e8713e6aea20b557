//! Roofs: gabled, hipped, flat; chimneys and dormers.

use glam::Vec3;

use super::color::Color;
use super::facade_wall::{FacadeWall, Opening};
use super::material::Material;
use super::surface::{Extent, Hidden, LocalFrame, Model};

/// Distance by which a roof reaches beyond the walls, in metres.
const EAVES: f32 = 0.38;
/// Distance by which it reaches beyond a gable.
const VERGE: f32 = 0.16;
/// Its thickness.
const THICK: f32 = 0.16;

/// A roof over a rectangle: `x` runs along the ridge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Roof {
    /// At the middle of the rectangle, at the top of the walls.
    pub frame: LocalFrame,
    /// Half of the rectangle along the ridge.
    pub along: f32,
    /// Half of the rectangle across.
    pub across: f32,
    /// From the top of the walls to the ridge.
    pub rise: f32,
    pub tint: Color,
}

impl Roof {
    /// Two slopes, and the gables' walls.
    pub fn gable(&self, model: &mut Model, wall: Material, wall_tint: Color) {
        let Self { frame: f, along, across, rise, tint } = *self;
        let end = along + VERGE;
        let pitch = rise / across;
        let (edge, low) = (across + EAVES, -EAVES * pitch);
        let lid = |x: f32, z: f32, y: f32| f.point(x, y, z);
        for side in [1.0_f32, -1.0] {
            // Seen from outside, `a` is at the left of the slope's lower edge.
            let (a, b) = (-end * side, end * side);
            let right = f.right * side;
            let high = [
                lid(a, edge * side, low + THICK),
                lid(b, edge * side, low + THICK),
                lid(b, 0.0, rise + THICK),
                lid(a, 0.0, rise + THICK),
            ];
            let under = [
                lid(a, edge * side, low),
                lid(b, edge * side, low),
                lid(b, 0.0, rise),
                lid(a, 0.0, rise),
            ];
            model.polygon(Material::Tile, &high, right, &[tint, tint, tint * 1.08, tint * 1.08]);
            let dark = Color::new(0.20, 0.15, 0.11);
            let below = [under[3], under[2], under[1], under[0]];
            model.polygon(Material::Timber, &below, right, &[dark]);
            let fascia = Color::new(0.62, 0.57, 0.50);
            let front = [under[0], under[1], high[1], high[0]];
            model.polygon(Material::Timber, &front, right, &[fascia]);
            let verges =
                [[under[1], under[2], high[2], high[1]], [under[3], under[0], high[0], high[3]]];
            for verge in verges {
                let along = (verge[1] - verge[0]).normalize_or(Vec3::X);
                model.polygon(Material::Timber, &verge, along, &[fascia]);
            }
            let gable = [
                lid(along * side, across * side, 0.0),
                lid(along * side, -across * side, 0.0),
                lid(along * side, 0.0, rise),
            ];
            model.polygon(wall, &gable, -f.out * side, &[wall_tint]);
        }
        let cap = Extent {
            x: [-end - 0.03, end + 0.03],
            y: [rise + 0.03, rise + 0.24],
            z: [-0.11, 0.11],
        };
        model.cuboid(Material::Tile, &f, cap, Hidden::Bottom, tint * 0.85);
    }

    /// Four slopes.
    pub fn hip(&self, model: &mut Model) {
        let Self { frame: f, along, across, rise, tint } = *self;
        let pitch = rise / across;
        let (end, edge, low) = (along + EAVES, across + EAVES, -EAVES * pitch);
        let ridge = (along - across).max(0.0);
        let corners = [(-end, edge), (end, edge), (end, -edge), (-end, -edge)];
        let tops = [(-ridge, 0.0), (ridge, 0.0), (ridge, 0.0), (-ridge, 0.0)];
        for n in 0..4 {
            let m = (n + 1) % 4;
            let at = |(x, z): (f32, f32), y: f32| f.point(x, y, z);
            let (a, b) = (at(corners[n], low + THICK), at(corners[m], low + THICK));
            let (c, d) = (at(tops[m], rise + THICK), at(tops[n], rise + THICK));
            let right = (b - a).normalize_or(Vec3::X);
            let shades = [tint, tint, tint * 1.08, tint * 1.08];
            if (c - d).length_squared() < 1e-4 {
                model.polygon(Material::Tile, &[a, b, c], right, &shades);
            } else {
                model.polygon(Material::Tile, &[a, b, c, d], right, &shades);
            }
            let (e, g) = (at(corners[n], low), at(corners[m], low));
            model.polygon(Material::Timber, &[e, g, b, a], right, &[Color::new(0.62, 0.57, 0.50)]);
            // The soffit slopes like the roof and meets the walls at their top.
            let inner = [(-along, across), (along, across), (along, -across), (-along, -across)];
            let soffit = [at(inner[n], 0.0), at(inner[m], 0.0), g, e];
            model.polygon(Material::Timber, &soffit, right, &[Color::new(0.20, 0.15, 0.11)]);
        }
    }

    /// A terrace behind a parapet of the walls' material.
    pub fn flat(&self, model: &mut Model, wall: Material, wall_tint: Color) {
        let Self { frame: f, along, across, tint, .. } = *self;
        let deck = [
            f.point(-along, 0.05, across),
            f.point(along, 0.05, across),
            f.point(along, 0.05, -across),
            f.point(-along, 0.05, -across),
        ];
        model.polygon(Material::Cobble, &deck, f.right, &[tint]);
        let thick = 0.28;
        let (x, z) = (along + 0.06, across + 0.06);
        let sides = [
            ([-x, x], [z - thick, z]),
            ([-x, x], [-z, thick - z]),
            ([x - thick, x], [thick - z, z - thick]),
            ([-x, thick - x], [thick - z, z - thick]),
        ];
        for (x, z) in sides {
            let parapet = Extent { x, y: [-0.12, 0.85], z };
            model.cuboid(wall, &f, parapet, Hidden::Bottom, wall_tint * 0.95);
            let grow = |[a, b]: [f32; 2]| [a - 0.05, b + 0.05];
            let coping = Extent { x: grow(x), y: [0.82, 0.95], z: grow(z) };
            let stone = Color::new(0.74, 0.70, 0.64);
            model.cuboid(Material::Stone, &f, coping, Hidden::Nothing, stone);
        }
    }

    /// A chimney at `x` along the ridge, on the slope behind it.
    pub fn chimney(&self, model: &mut Model, x: f32, wall: Material, wall_tint: Color) {
        let z = -self.across * 0.35;
        let top = self.rise + 0.95;
        let f = self.frame.moved(x, 0.0, z);
        let shaft = Extent { x: [-0.36, 0.36], y: [self.rise * 0.3, top], z: [-0.28, 0.28] };
        model.cuboid(wall, &f, shaft, Hidden::TopAndBottom, wall_tint * 0.92);
        let cap = Extent { x: [-0.44, 0.44], y: [top - 0.02, top + 0.14], z: [-0.36, 0.36] };
        let stone = Color::new(0.58, 0.55, 0.50);
        model.cuboid(Material::Stone, &f, cap, Hidden::Nothing, stone);
        let clay = self.tint * 0.9;
        let pot = [(0.12, 0.0, clay), (0.10, 0.42, clay), (0.0, 0.40, clay * 0.2)];
        model.lathe(Material::Tile, f.point(0.12, top + 0.1, 0.0), 6, &pot);
    }

    /// A dormer at `x` along the ridge, on the front slope.
    pub fn dormer(&self, model: &mut Model, x: f32, wall: Material, wall_tint: Color) {
        let pitch = self.rise / self.across;
        let front = self.across * 0.72;
        let sill = (self.across - front) * pitch;
        let f = self.frame.moved(x, sill, front);
        let (half, high) = (0.72, 1.35);
        let face = LocalFrame::upright(f.point(-half, 0.0, 0.0), f.right);
        let front_wall = FacadeWall {
            frame: face,
            material: wall,
            tint: wall_tint,
            width: half * 2.0,
            bottom: -0.1,
            top: high,
        };
        let window = Opening { x: [0.36, half * 2.0 - 0.36], y: [0.28, 1.22], shutters: None };
        front_wall.build(model, &[window]);
        let deep = (self.across * 0.95).min(high / pitch + 0.4);
        for side in [1.0_f32, -1.0] {
            let p = |y: f32, z: f32| f.point(half * side, y, z);
            let mut cheek = [p(-0.1, 0.0), p(-0.1, -deep), p(high, -deep), p(high, 0.0)];
            if side < 0.0 {
                cheek.reverse();
            }
            model.polygon(wall, &cheek, -f.out * side, &[wall_tint * 0.8]);
        }
        let lid = Self {
            frame: LocalFrame {
                origin: f.point(0.0, high, -deep * 0.5),
                right: f.out,
                up: f.up,
                out: -f.right,
            },
            along: deep * 0.5,
            across: half,
            rise: 0.55,
            tint: self.tint,
        };
        lid.small_gable(model, wall, wall_tint);
    }

    /// The two slopes and the front gable of a dormer.
    fn small_gable(&self, model: &mut Model, wall: Material, wall_tint: Color) {
        let Self { frame: f, along, across, rise, tint } = *self;
        let (front, back) = (along + 0.14, -along);
        let (edge, low) = (across + 0.16, -0.16 * rise / across);
        for side in [1.0_f32, -1.0] {
            let mut lid = [
                f.point(back, low + 0.08, edge * side),
                f.point(front, low + 0.08, edge * side),
                f.point(front, rise + 0.08, 0.0),
                f.point(back, rise + 0.08, 0.0),
            ];
            let mut under = lid.map(|corner| corner - f.up * 0.08);
            let mut rim = [under[1], under[2], lid[2], lid[1]];
            let mut gutter = [under[0], under[1], lid[1], lid[0]];
            if side < 0.0 {
                lid.reverse();
                rim.reverse();
                gutter.reverse();
            } else {
                under.reverse();
            }
            let right = f.right * side;
            model.polygon(Material::Tile, &lid, right, &[tint]);
            let wood = Color::new(0.62, 0.57, 0.50);
            model.polygon(Material::Timber, &under, right, &[wood * 0.4]);
            model.polygon(Material::Timber, &rim, -f.out * side, &[wood]);
            model.polygon(Material::Timber, &gutter, right, &[wood]);
        }
        let gable =
            [f.point(along, 0.0, across), f.point(along, 0.0, -across), f.point(along, rise, 0.0)];
        model.polygon(wall, &gable, -f.out, &[wall_tint]);
    }
}
