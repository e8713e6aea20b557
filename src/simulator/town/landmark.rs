//! The landmarks of the town: the church on its square and the lighthouse on the mole.

use glam::{Vec3, vec3};

use super::color::{Color, srgb};
use super::facade_wall::{FacadeWall, Opening, door};
use super::material::Material;
use super::roof::Roof;
use super::surface::{Extent, Hidden, LocalFrame, Model};

const WHITE: u32 = 0xf8f1e4;

/// Walls around a rectangle, each with `columns` tall windows from `y[0]` to `y[1]`.
fn hall(model: &mut Model, centre: Vec3, half: [f32; 2], top: f32, columns: [u32; 4], y: [f32; 2]) {
    let [x, z] = half;
    let at = |dx: f32, dz: f32, right: Vec3| LocalFrame::upright(centre + vec3(dx, 0.0, dz), right);
    let sides = [
        (at(-x, z, Vec3::X), x * 2.0),
        (at(x, z, Vec3::NEG_Z), z * 2.0),
        (at(x, -z, Vec3::NEG_X), x * 2.0),
        (at(-x, -z, Vec3::Z), z * 2.0),
    ];
    for ((frame, width), columns) in sides.into_iter().zip(columns) {
        let tint = srgb(WHITE);
        let wall = FacadeWall { frame, material: Material::Plaster, tint, width, bottom: 0.4, top };
        let bay = width / columns.max(1) as f32;
        let opening = |n: u32| {
            let middle = bay * (n as f32 + 0.5);
            Opening { x: [middle - 0.55, middle + 0.55], y, shutters: None }
        };
        let openings: Vec<Opening> = (0..columns).map(opening).collect();
        wall.build(model, &openings);
    }
    let frame = LocalFrame { origin: centre, ..LocalFrame::MODEL };
    // Not the same height for nave and tower: their tops would lie in one plane.
    let ledge = 0.45 + 0.02 * x;
    let plinth = Extent { x: [-x - 0.08, x + 0.08], y: [-6.0, ledge], z: [-z - 0.08, z + 0.08] };
    model.cuboid(Material::Stone, &frame, plinth, Hidden::Bottom, Color::new(0.52, 0.49, 0.44));
}

/// A church: nave, tower with a spire, apse. Its door faces +Z.
pub(super) fn church() -> Model {
    let mut model = Model::default();
    let red = srgb(0xc86a48);
    hall(&mut model, vec3(0.0, 0.0, -2.0), [5.2, 9.0], 8.6, [0, 4, 0, 4], [2.6, 6.2]);
    let nave = Roof {
        frame: LocalFrame {
            origin: vec3(0.0, 8.6, -2.0),
            right: Vec3::Z,
            up: Vec3::Y,
            out: Vec3::NEG_X,
        },
        along: 9.0,
        across: 5.2,
        rise: 4.4,
        tint: red,
    };
    nave.gable(&mut model, Material::Plaster, srgb(WHITE));
    let tower = vec3(0.0, 0.0, 9.4);
    hall(&mut model, tower, [2.7, 2.7], 19.5, [1, 1, 1, 1], [14.6, 17.6]);
    let front = LocalFrame::upright(tower + vec3(-2.7, 0.0, 2.7), Vec3::X);
    door(&mut model, &front, 2.7, srgb(0x6a3f2c));
    let stone = Color::new(0.78, 0.74, 0.67);
    for y in [6.0, 13.2, 19.3] {
        let band = Extent { x: [-2.95, 2.95], y: [y, y + 0.4], z: [-2.95, 2.95] };
        let frame = LocalFrame { origin: tower, ..LocalFrame::MODEL };
        model.cuboid(Material::Stone, &frame, band, Hidden::Nothing, stone);
    }
    let lid = Roof {
        frame: LocalFrame { origin: tower + Vec3::Y * 19.6, ..LocalFrame::MODEL },
        along: 2.7,
        across: 2.7,
        rise: 7.4,
        tint: red,
    };
    lid.hip(&mut model);
    let gold = srgb(0xe4b04a);
    let finial = [(0.07, 0.0, gold), (0.07, 1.0, gold), (0.22, 1.2, gold), (0.0, 1.5, gold)];
    model.lathe(Material::Timber, tower + Vec3::Y * 26.9, 6, &finial);
    let white = srgb(WHITE);
    let apse = [(3.3, -6.0, white * 0.7), (3.3, 1.0, white * 0.95), (3.3, 6.0, white * 0.85)];
    model.lathe(Material::Plaster, vec3(0.0, 0.0, -11.0), 16, &apse);
    let dome = [(3.6, 5.96, red * 0.8), (3.7, 6.15, red), (2.2, 7.6, red), (0.0, 8.5, red * 1.1)];
    model.lathe(Material::Tile, vec3(0.0, 0.0, -11.0), 16, &dome);
    model
}

/// A lighthouse of 18 metres.
pub(super) fn lighthouse() -> Model {
    let mut model = Model::default();
    let (white, red) = (srgb(WHITE), srgb(0xc84a36));
    let stone = Color::new(0.60, 0.57, 0.52);
    let base = [(3.2, -1.0, stone * 0.7), (3.1, 1.5, stone), (2.5, 1.52, stone)];
    model.lathe(Material::Stone, Vec3::ZERO, 16, &base);
    // Bands of colour meet in a ring of their own, so that no colour bleeds into the next.
    let radius = |y: f32| 2.3 - y * 0.075;
    let bands = [(1.4, 5.0, white), (5.0, 8.2, red), (8.2, 11.4, white), (11.4, 13.2, red)];
    for (low, high, color) in bands {
        let band = [(radius(low), low, color * 0.92), (radius(high), high, color)];
        model.lathe(Material::Plaster, Vec3::ZERO, 16, &band);
    }
    let gallery = [
        (1.2, 12.9, stone * 0.7),
        (2.1, 13.15, stone),
        (2.1, 13.4, stone),
        (1.0, 13.42, stone * 0.9),
    ];
    model.lathe(Material::Stone, Vec3::ZERO, 16, &gallery);
    for n in 0..8 {
        let (sine, cosine) = super::trig::sin_cos(n as f32 / 8.0);
        let place = vec3(cosine * 1.98, 13.3, sine * 1.98);
        let post = [(0.05, 0.0, Vec3::ONE), (0.05, 1.0, Vec3::ONE), (0.0, 1.05, Vec3::ONE)];
        model.lathe(Material::Iron, place, 4, &post);
    }
    let rail = [(1.93, 14.2, Vec3::ONE), (2.03, 14.2, Vec3::ONE), (2.03, 14.3, Vec3::ONE)];
    model.lathe(Material::Iron, Vec3::ZERO, 16, &rail);
    let glass = [(1.05, 13.4, Vec3::ONE), (1.05, 15.6, Vec3::ONE)];
    model.lathe(Material::Lantern, Vec3::ZERO, 12, &glass);
    let cap = [(0.9, 15.5, red), (1.4, 15.55, red), (0.8, 16.5, red), (0.12, 17.2, red)];
    model.lathe(Material::Timber, Vec3::ZERO, 12, &cap);
    let tip = [(0.12, 17.15, red), (0.05, 18.2, red), (0.0, 18.25, red)];
    model.lathe(Material::Timber, Vec3::ZERO, 6, &tip);
    let f = LocalFrame::upright(vec3(-2.2, 1.5, 2.18), Vec3::X);
    door(&mut model, &f, 2.2, srgb(0x2c5b86));
    model
}
