//! The harbour: the quay before the town, two moles around the basin, boats, the lighthouse.

use glam::{Vec3, vec3};

use super::color::{Color, srgb};
use super::glb::{Glb, Node, Placement};
use super::heightfield::{BLOCK, Heightfield, QUAY_HEIGHT};
use super::lamp::LAMP_HEIGHT;
use super::material::Material;
use super::random::Random;
use super::surface::{Extent, Hidden, LocalFrame, Model};
use super::terrain::LINES;
use super::{TownExtras, boat, landmark};

/// From the first street to the water, in metres.
const APRON: f32 = 8.0;
/// Height at which walls end, below the sea.
const DEEP: f32 = -4.0;
const MOLE_LENGTH: f32 = 62.0;
const MOLE_WIDTH: f32 = 6.0;

fn stone() -> Color {
    srgb(0xcfc4b2)
}

/// The quay before one block: paving, a coping of larger stones, the wall, bollards.
fn apron() -> Model {
    let mut model = Model::default();
    for x in LINES.windows(2) {
        let corner = |x: f32, z: f32| vec3(x, QUAY_HEIGHT, z);
        let (near, far) = (APRON - 0.7, 0.0);
        let paving = [corner(x[0], near), corner(x[1], near), corner(x[1], far), corner(x[0], far)];
        let shade = [stone() * 0.92, stone() * 0.92, stone() * 0.82, stone() * 0.82];
        model.polygon(Material::Stone, &paving, Vec3::X, &shade);
    }
    let half = BLOCK * 0.5;
    // Its ends lie between this block and the next, so they are left out.
    let strip = |y: [f32; 2], z: [f32; 2]| {
        [
            vec3(-half, y[0], z[0]),
            vec3(half, y[0], z[0]),
            vec3(half, y[1], z[1]),
            vec3(-half, y[1], z[1]),
        ]
    };
    let (rim, top) = (APRON - 0.7, QUAY_HEIGHT + 0.22);
    let pale = stone() * 1.12;
    let [a, b, c, d] = strip([QUAY_HEIGHT, top], [rim, rim]);
    let inner = [b, a, d, c];
    model.polygon(Material::Stone, &inner, Vec3::NEG_X, &[pale * 0.8]);
    model.polygon(Material::Stone, &strip([top, top], [APRON, rim]), Vec3::X, &[pale]);
    model.polygon(Material::Stone, &strip([0.5, top], [APRON, APRON]), Vec3::X, &[stone() * 0.9]);
    // Weed darkens the stones that the tide wets.
    let weed = srgb(0x6c7458);
    let wet = [weed * 0.6, weed * 0.6, stone() * 0.8, stone() * 0.8];
    model.polygon(Material::Stone, &strip([DEEP, 0.5], [APRON, APRON]), Vec3::X, &wet);
    for n in 0..4 {
        let x = (n as f32 - 1.5) * 10.0 - 2.5;
        let iron = Color::ONE;
        let bollard =
            [(0.17, -0.1, iron), (0.14, 0.45, iron), (0.24, 0.55, iron), (0.0, 0.68, iron)];
        model.lathe(Material::Iron, vec3(x, QUAY_HEIGHT, APRON - 1.3), 6, &bollard);
    }
    model
}

/// A mole of cut stone towards +Z; `side` is where its parapet stands: 1 at +X, -1 at -X.
fn mole(side: f32) -> Model {
    let mut model = Model::default();
    let frame = LocalFrame::MODEL;
    let span = |a: f32, b: f32| [(a * side).min(b * side), (a * side).max(b * side)];
    let deck = QUAY_HEIGHT + 0.5;
    let body = Extent { x: span(-0.4, MOLE_WIDTH), y: [DEEP, deck], z: [-2.5, MOLE_LENGTH] };
    model.cuboid(Material::Stone, &frame, body, Hidden::Bottom, stone() * 0.9);
    let (outer, thick) = (MOLE_WIDTH, 0.9);
    let parapet = Extent {
        x: span(outer - thick, outer + 0.08),
        y: [DEEP, deck + 1.1],
        z: [-2.42, MOLE_LENGTH + 0.08],
    };
    model.cuboid(Material::Stone, &frame, parapet, Hidden::Bottom, stone());
    let head = Extent {
        x: span(-3.4, MOLE_WIDTH + 1.0),
        y: [DEEP, deck + 0.25],
        z: [MOLE_LENGTH - 8.4, MOLE_LENGTH + 1.4],
    };
    model.cuboid(Material::Stone, &frame, head, Hidden::Bottom, stone() * 0.95);
    let step =
        Extent { x: span(0.2, MOLE_WIDTH - 1.2), y: [0.0, QUAY_HEIGHT + 0.25], z: [-3.1, -2.4] };
    model.cuboid(Material::Stone, &frame, step, Hidden::Bottom, stone());
    model
}

/// Crates and barrels that wait for a ship.
fn cargo() -> Model {
    let mut model = Model::default();
    let wood = srgb(0xb88c58);
    for (x, z, y, size) in [(0.0, 0.0, 0.0, 1.1), (1.3, 0.25, 0.0, 0.9), (0.25, 0.1, 1.1, 0.8)] {
        let crate_of = Extent { x: [x, x + size], y: [y, y + size], z: [z, z + size] };
        model.cuboid(Material::Timber, &LocalFrame::MODEL, crate_of, Hidden::Bottom, wood);
    }
    for (x, z) in [(-0.7, 0.4), (-0.5, 1.2), (-1.4, 0.8)] {
        let barrel = [
            (0.30, 0.0, wood * 0.6),
            (0.38, 0.45, wood * 0.8),
            (0.30, 0.92, wood * 0.7),
            (0.28, 0.90, wood * 0.5),
            (0.0, 0.88, wood * 0.5),
        ];
        model.lathe(Material::Timber, vec3(x, 0.0, z), 8, &barrel);
    }
    model
}

/// Boats along the quay of one block.
fn moor(
    file: &mut Glb,
    (meshes, has_waves): (&[usize; 3], bool),
    middle: f32,
    random: &mut Random,
) -> Vec<usize> {
    let mut nodes = Vec::new();
    for berth in 0..4 {
        if random.chance(0.15) {
            continue;
        }
        let kind = [0, 1, 1, 0, 2][random.below(5)];
        // Dinghies lie along the wall, larger boats with the bow to the sea.
        let (turn, z) = match kind {
            0 => (if random.chance(0.5) { 0.5 } else { 0.0 }, APRON + 1.5),
            _ => (-0.25, APRON + 6.2),
        };
        let place = vec3(
            middle + (berth as f32 - 1.5) * 9.6 + random.between(-1.4, 1.4),
            random.between(-0.06, 0.04),
            z + random.between(0.0, 0.7),
        );
        let placement = Placement {
            translation: super::surface::on_grid(place),
            turn: turn + random.between(-0.012, 0.012),
            scale: Vec3::splat(random.between(0.92, 1.08)),
        };
        let name = format!("boat-{}", file.node_count());
        nodes.push(afloat(file, name, placement, meshes[kind], has_waves));
    }
    nodes
}

/// Sails in the roads.
fn sails(
    file: &mut Glb,
    (mesh, has_waves): (usize, bool),
    ground: &Heightfield,
    random: &mut Random,
) -> Vec<usize> {
    let count = 3 + (ground.half_width / 160.0) as usize;
    let mut nodes = Vec::new();
    for n in 0..count {
        let share = (n as f32 + random.between(0.2, 0.8)) / count as f32;
        let x = (share * 2.0 - 1.0) * (ground.half_width * 0.9 + 10.0);
        let placement = Placement {
            translation: super::surface::on_grid(vec3(x, 0.0, random.between(48.0, 96.0))),
            turn: random.between(-0.15, 0.65),
            scale: Vec3::splat(random.between(0.95, 1.15)),
        };
        let name = format!("sail-{n}");
        nodes.push(afloat(file, name, placement, mesh, has_waves));
    }
    nodes
}

/// Adds a boat at its berth. On waves its hull is a node of its own, which moves.
fn afloat(file: &mut Glb, name: String, berth: Placement, mesh: usize, has_waves: bool) -> usize {
    if !has_waves {
        return file.add_node(&Node::with_mesh(name, berth, mesh));
    }
    let hull = Node::with_mesh(format!("{name}-hull"), Placement::at(Vec3::ZERO), mesh);
    let hull = file.add_node(&hull);
    file.add_bobbing(hull);
    let mut node = Node::new(name, berth);
    node.children = vec![hull];
    file.add_node(&node)
}

/// Lamps along the quay of one block.
fn light_up(
    file: &mut Glb,
    (mesh, light): (usize, usize),
    block: u32,
    middle: f32,
) -> impl Iterator<Item = usize> {
    [-10.0, 10.0].into_iter().zip(["left", "right"]).map(move |(x, side)| {
        let place = vec3(middle + x, QUAY_HEIGHT + LAMP_HEIGHT, APRON - 2.2);
        let mut node =
            Node::with_mesh(format!("quay-lamp-{block}-{side}"), Placement::at(place), mesh);
        node.light = Some(light);
        file.add_node(&node)
    })
}

/// The options of a harbour.
#[derive(Debug)]
pub(super) struct Harbour {
    pub blocks: u32,
    pub seed: u64,
    pub extras: TownExtras,
    /// The mesh and the light of lamps that burn along the quay.
    pub lamp: Option<(usize, usize)>,
}

/// Adds the harbour and gives its node.
pub(super) fn write(file: &mut Glb, ground: &Heightfield, of: &Harbour) -> usize {
    let Harbour { blocks, seed, extras: TownExtras { has_waves, .. }, lamp } = *of;
    let mut random = Random::new(seed, 301);
    let apron = file.add_mesh("quay", &apron());
    let cargo = file.add_mesh("cargo", &cargo());
    let boats = boat::models().map(|(name, model)| file.add_mesh(name, &model));
    let mut children = Vec::new();
    for block in 0..blocks {
        let middle = (block as f32 + 0.5) * BLOCK - ground.half_width;
        let at = |x: f32, y: f32, z: f32| Placement::at(vec3(middle + x, y, z));
        let quay = Node::with_mesh(format!("quay-{block}"), at(0.0, 0.0, 0.0), apron);
        children.push(file.add_node(&quay));
        let place = Placement { turn: random.unit(), ..at(6.0, QUAY_HEIGHT, 4.5) };
        children.push(file.add_node(&Node::with_mesh(format!("cargo-{block}"), place, cargo)));
        children.extend(moor(file, (&boats, has_waves), middle, &mut random));
        if let Some(lamp) = lamp {
            children.extend(light_up(file, lamp, block, middle));
        }
    }
    children.extend(sails(file, (boats[2], has_waves), ground, &mut random));
    for (name, side) in [("mole-east", 1.0), ("mole-west", -1.0)] {
        let mesh = file.add_mesh(name, &mole(side));
        let place = Placement::at(vec3(ground.half_width * side, 0.0, 0.0));
        children.push(file.add_node(&Node::with_mesh(name, place, mesh)));
    }
    let lighthouse = file.add_mesh("lighthouse", &landmark::lighthouse());
    let place = vec3(ground.half_width + 1.2, QUAY_HEIGHT + 0.75, MOLE_LENGTH - 3.5);
    children.push(file.add_node(&Node::with_mesh("lighthouse", Placement::at(place), lighthouse)));
    let mut harbour = Node::new("harbour", Placement::at(Vec3::ZERO));
    harbour.children = children;
    file.add_node(&harbour)
}
