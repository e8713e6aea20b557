//! Boats: a dinghy, a fishing boat and a sailing boat.

use glam::{Vec3, vec3};

use super::color::{Color, srgb};
use super::material::Material;
use super::surface::{Extent, Hidden, LocalFrame, Model};

const STATIONS: usize = 6;

/// A hull whose bow points to +X; the sea is at y = 0.
#[derive(Clone, Copy, Debug)]
struct Hull {
    length: f32,
    beam: f32,
    freeboard: f32,
    topside: Color,
    below: Color,
}

impl Hull {
    /// The section's points from keel to gunwale, to the left of the bow (-Z).
    fn section(&self, station: usize) -> [Vec3; 4] {
        let t = station as f32 / STATIONS as f32;
        let fore = 2.0 * t - 1.0;
        // Full to midships, then drawn in to the bow; the stern stays half as wide.
        let taper = if fore < 0.0 { 1.0 - 0.42 * fore * fore } else { 1.0 - fore * fore * fore };
        let half = self.beam * 0.5 * taper;
        let sheer = self.freeboard * (1.0 + 0.55 * fore * fore.abs().max(0.3 * fore.abs()));
        let x = self.length * 0.5 * fore;
        let rake = 0.12 * self.length * fore.max(0.0) * fore.max(0.0);
        [
            vec3(x - rake * 0.5, -0.5, 0.0),
            vec3(x - rake * 0.4, -0.25, -half * 0.72),
            vec3(x, 0.12, -half * 0.92),
            vec3(x + rake, sheer.max(self.freeboard * 0.8), -half),
        ]
    }

    fn build(&self, model: &mut Model) {
        let bands = [self.below, self.below, self.topside];
        let rail = srgb(0xc9a26b);
        for station in 0..STATIONS {
            let (aft, fore) = (self.section(station), self.section(station + 1));
            for (band, &color) in bands.iter().enumerate() {
                let skin = [aft[band], aft[band + 1], fore[band + 1], fore[band]];
                both_sides(model, skin, color);
            }
            let inboard = |p: Vec3, down: f32| vec3(p.x, p.y - down, p.z * 0.86);
            let cap = [aft[3], inboard(aft[3], 0.0), inboard(fore[3], 0.0), fore[3]];
            both_sides(model, cap, rail);
            let bulwark = [
                inboard(aft[3], 0.0),
                inboard(aft[3], 0.3),
                inboard(fore[3], 0.3),
                inboard(fore[3], 0.0),
            ];
            both_sides(model, bulwark, self.topside * 0.7);
            let middle = |p: Vec3| vec3(p.x, p.y - 0.3, 0.0);
            let deck =
                [inboard(aft[3], 0.3), middle(aft[3]), middle(fore[3]), inboard(fore[3], 0.3)];
            both_sides(model, deck, rail * 0.8);
        }
        let stern = self.section(0);
        for band in 0..3 {
            let flip = |p: Vec3| vec3(p.x, p.y, -p.z);
            let plank = [stern[band], flip(stern[band]), flip(stern[band + 1]), stern[band + 1]];
            model.polygon(Material::Timber, &tidy(plank), Vec3::Z, &[bands[band]]);
        }
    }
}

/// Drops a corner that falls on its neighbour.
fn tidy(corners: [Vec3; 4]) -> Vec<Vec3> {
    let mut kept: Vec<Vec3> = Vec::with_capacity(4);
    for corner in corners {
        if kept.iter().all(|&other| other.distance_squared(corner) > 1e-6) {
            kept.push(corner);
        }
    }
    kept
}

/// A quadrilateral of the hull's -Z side and its mirror image.
fn both_sides(model: &mut Model, corners: [Vec3; 4], color: Color) {
    let mirrored = corners.map(|p| vec3(p.x, p.y, -p.z));
    let [a, b, c, d] = corners;
    let [e, f, g, h] = mirrored;
    for face in [tidy([a, b, c, d]), tidy([h, g, f, e])] {
        if face.len() > 2 {
            model.polygon(Material::Timber, &face, Vec3::X, &[color]);
        }
    }
}

fn dinghy() -> Model {
    let mut model = Model::default();
    let hull = Hull {
        length: 4.2,
        beam: 1.7,
        freeboard: 0.5,
        topside: srgb(0xf2e8d2),
        below: srgb(0x2f6b8e),
    };
    hull.build(&mut model);
    for x in [-0.9, 0.5] {
        let thwart = Extent { x: [x, x + 0.32], y: [0.30, 0.36], z: [-0.68, 0.68] };
        model.cuboid(Material::Timber, &LocalFrame::MODEL, thwart, Hidden::Nothing, srgb(0xb08450));
    }
    model
}

fn fishing_boat() -> Model {
    let mut model = Model::default();
    let hull = Hull {
        length: 9.5,
        beam: 3.2,
        freeboard: 1.15,
        topside: srgb(0x2c628c),
        below: srgb(0x9e3d30),
    };
    hull.build(&mut model);
    let white = srgb(0xf2ecde);
    let cabin = Extent { x: [-2.6, 0.2], y: [0.6, 2.7], z: [-0.95, 0.95] };
    model.cuboid(Material::Timber, &LocalFrame::MODEL, cabin, Hidden::Bottom, white);
    let roof = Extent { x: [-2.8, 0.5], y: [2.68, 2.84], z: [-1.1, 1.1] };
    model.cuboid(Material::Timber, &LocalFrame::MODEL, roof, Hidden::Nothing, srgb(0xc85a3c));
    for (z, right) in [(0.98, Vec3::X), (-0.98, Vec3::NEG_X)] {
        for x in [-1.9, -0.6] {
            let centre = vec3(x, 2.0, z);
            let (right, up) = (right * 0.42, Vec3::Y * 0.32);
            let corners = [
                centre - right - up,
                centre + right - up,
                centre + right + up,
                centre - right + up,
            ];
            model.picture(Material::Window, corners, Vec3::ONE);
        }
    }
    let wood = srgb(0xa88054);
    let mast = [(0.09, 0.6, wood), (0.05, 6.4, wood), (0.0, 6.5, wood)];
    model.lathe(Material::Timber, vec3(1.1, 0.0, 0.0), 6, &mast);
    let hold = Extent { x: [1.6, 3.0], y: [0.6, 1.3], z: [-0.6, 0.6] };
    model.cuboid(Material::Timber, &LocalFrame::MODEL, hold, Hidden::Bottom, srgb(0x5e7d6a));
    model
}

fn sailing_boat() -> Model {
    let mut model = Model::default();
    let hull = Hull {
        length: 8.4,
        beam: 2.7,
        freeboard: 0.9,
        topside: srgb(0xf6f0e4),
        below: srgb(0x2e4f5e),
    };
    hull.build(&mut model);
    let cabin = Extent { x: [-1.0, 1.6], y: [0.45, 1.35], z: [-0.7, 0.7] };
    model.cuboid(Material::Timber, &LocalFrame::MODEL, cabin, Hidden::Bottom, srgb(0xd9bf94));
    let wood = srgb(0xb89262);
    let mast = [(0.09, 0.4, wood), (0.05, 10.4, wood), (0.0, 10.5, wood)];
    model.lathe(Material::Timber, vec3(0.8, 0.0, 0.0), 6, &mast);
    let boom = Extent { x: [-3.4, 0.8], y: [1.95, 2.07], z: [-0.05, 0.05] };
    model.cuboid(Material::Timber, &LocalFrame::MODEL, boom, Hidden::Nothing, wood);
    let cream = srgb(0xfbf4e2);
    let main = [vec3(-3.3, 2.2, 0.25), vec3(0.68, 2.2, 0.0), vec3(0.72, 9.9, 0.0)];
    model.polygon(Material::Canvas, &main, Vec3::X, &[cream]);
    let jib = [vec3(1.1, 1.9, 0.2), vec3(4.6, 1.5, 0.0), vec3(0.94, 8.8, 0.0)];
    model.polygon(Material::Canvas, &jib, Vec3::X, &[srgb(0xd96a4a)]);
    model
}

/// Every boat with the name of its mesh.
pub(super) fn models() -> [(&'static str, Model); 3] {
    [("boat-dinghy", dinghy()), ("boat-fishing", fishing_boat()), ("boat-sailing", sailing_boat())]
}
