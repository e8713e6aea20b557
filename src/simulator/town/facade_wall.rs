//! A wall with windows and doors: a grid of panels with recesses in it.

use glam::Vec3;

use super::color::Color;
use super::material::Material;
use super::surface::{Extent, Hidden, LocalFrame, Model};

/// Depth of a window in its wall, in metres.
const RECESS: f32 = 0.14;
/// Height up to which walls are darkened by the ground, in metres.
const GRIME: f32 = 0.98;

/// A hole in a wall, in metres from its lower left corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub x: [f32; 2],
    pub y: [f32; 2],
    /// The colour of its shutters, if it has any.
    pub shutters: Option<Color>,
}

/// A wall's face: what it is made of and how large.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacadeWall {
    pub frame: LocalFrame,
    pub material: Material,
    pub tint: Color,
    pub width: f32,
    pub bottom: f32,
    pub top: f32,
}

impl FacadeWall {
    /// Light that reaches a height: less near the ground and under the eaves.
    fn tint_at(&self, y: f32) -> Color {
        let ground = 0.72 + 0.28 * (y / GRIME).clamp(0.0, 1.0);
        let eaves = 0.80 + 0.20 * ((self.top - y) / 0.75).clamp(0.0, 1.0);
        self.tint * ground * eaves
    }

    fn panel(&self, model: &mut Model, x: [f32; 2], y: [f32; 2]) {
        let f = &self.frame;
        let corners = [
            f.point(x[0], y[0], 0.0),
            f.point(x[1], y[0], 0.0),
            f.point(x[1], y[1], 0.0),
            f.point(x[0], y[1], 0.0),
        ];
        let (low, high) = (self.tint_at(y[0]), self.tint_at(y[1]));
        model.polygon(self.material, &corners, f.right, &[low, low, high, high]);
    }

    /// Builds the wall around its openings, and the windows in them.
    pub fn build(&self, model: &mut Model, openings: &[Opening]) {
        let columns = cuts(openings.iter().flat_map(|o| o.x), 0.0, self.width);
        let heights = openings.iter().flat_map(|o| o.y).chain([GRIME]);
        let rows = cuts(heights, self.bottom, self.top);
        for y in rows.windows(2) {
            for x in columns.windows(2) {
                let middle = [(x[0] + x[1]) * 0.5, (y[0] + y[1]) * 0.5];
                let open = openings.iter().any(|o| {
                    (o.x[0]..o.x[1]).contains(&middle[0]) && (o.y[0]..o.y[1]).contains(&middle[1])
                });
                if !open {
                    self.panel(model, [x[0], x[1]], [y[0], y[1]]);
                }
            }
        }
        for opening in openings {
            self.window(model, opening);
        }
    }

    fn window(&self, model: &mut Model, opening: &Opening) {
        let f = &self.frame;
        let ([left, right], [low, high]) = (opening.x, opening.y);
        let front = [(left, low), (right, low), (right, high), (left, high)];
        let at = |n: usize, z: f32| f.point(front[n % 4].0, front[n % 4].1, z);
        let shade = self.tint * 0.68;
        for n in 0..4 {
            let reveal = [at(n, 0.0), at(n + 1, 0.0), at(n + 1, -RECESS), at(n, -RECESS)];
            let along = (reveal[1] - reveal[0]).normalize_or(Vec3::X);
            model.polygon(self.material, &reveal, along, &[shade]);
        }
        let pane = [at(0, -RECESS), at(1, -RECESS), at(2, -RECESS), at(3, -RECESS)];
        model.picture(Material::Window, pane, Vec3::ONE);
        let sill = Extent {
            x: [left - 0.08, right + 0.08],
            y: [low - 0.11, low + 0.02],
            z: [-0.05, 0.09],
        };
        model.cuboid(Material::Stone, f, sill, Hidden::BackAndBottom, Color::new(0.80, 0.77, 0.72));
        if let Some(color) = opening.shutters {
            let wide = (right - left) * 0.46;
            for x in [[left - 0.03 - wide, left - 0.03], [right + 0.03, right + 0.03 + wide]] {
                let leaf = Extent { x, y: [low + 0.03, high + 0.02], z: [-0.03, 0.05] };
                model.cuboid(Material::Timber, f, leaf, Hidden::BackAndBottom, color);
            }
        }
    }
}

/// The sorted, distinct places among some, with the ends of a range.
fn cuts(places: impl Iterator<Item = f32>, least: f32, most: f32) -> Vec<f32> {
    let inside = places.filter(|&place| place > least + 0.05 && place < most - 0.05);
    let mut all: Vec<f32> = inside.chain([least, most]).collect();
    all.sort_by(f32::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < 0.004);
    all
}

/// A door with its stone frame and step, standing before the wall; `x` is its middle.
pub(super) fn door(model: &mut Model, frame: &LocalFrame, x: f32, color: Color) {
    let stone = Color::new(0.66, 0.63, 0.58);
    let f = frame.moved(x, 0.0, 0.0);
    let jambs = [([-0.74, -0.52], [-0.4, 2.3]), ([0.52, 0.74], [-0.4, 2.3])];
    for (x, y) in jambs {
        let jamb = Extent { x, y, z: [-0.05, 0.17] };
        model.cuboid(Material::Stone, &f, jamb, Hidden::BackAndBottom, stone);
    }
    let lintel = Extent { x: [-0.84, 0.84], y: [2.27, 2.52], z: [-0.05, 0.21] };
    model.cuboid(Material::Stone, &f, lintel, Hidden::Back, stone);
    let leaf = Extent { x: [-0.54, 0.54], y: [-0.3, 2.29], z: [-0.05, 0.10] };
    model.cuboid(Material::Timber, &f, leaf, Hidden::BackAndBottom, color);
    let step = Extent { x: [-0.95, 0.95], y: [-1.6, 0.06], z: [-0.05, 0.55] };
    model.cuboid(Material::Stone, &f, step, Hidden::BackAndBottom, stone);
}

/// A striped awning over a shop window from `x[0]` to `x[1]`, its upper edge at `y`.
pub(super) fn awning(model: &mut Model, frame: &LocalFrame, x: [f32; 2], y: f32, color: Color) {
    let stripes = ((x[1] - x[0]) / 0.5).round().max(1.0) as usize;
    let wide = (x[1] - x[0]) / stripes as f32;
    for n in 0..stripes {
        let (left, right) = (x[0] + wide * n as f32, x[0] + wide * (n + 1) as f32);
        let tint = if n % 2 == 0 { color } else { Color::new(0.86, 0.83, 0.76) };
        let edge = |at: f32, y: f32, z: f32| frame.point(at, y, z);
        let cloth = [
            edge(left, y - 0.55, 1.25),
            edge(right, y - 0.55, 1.25),
            edge(right, y, 0.02),
            edge(left, y, 0.02),
        ];
        model.polygon(Material::Canvas, &cloth, frame.right, &[tint]);
        let fringe = [
            edge(left, y - 0.78, 1.25),
            edge(right, y - 0.78, 1.25),
            edge(right, y - 0.55, 1.25),
            edge(left, y - 0.55, 1.25),
        ];
        model.polygon(Material::Canvas, &fringe, frame.right, &[tint]);
    }
}
