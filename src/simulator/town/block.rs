//! The content of a block: houses around a court, trees, lamps; or a church; or open land.

use glam::{Vec3, vec3};

use super::building::{CATALOGUE, Quarter};
use super::glb::{Glb, Node, Placement};
use super::heightfield::Heightfield;
use super::lamp::LAMP_HEIGHT;
use super::random::Random;
use super::surface::on_grid;
use super::terrain::{CURB, GroundCover, cell_origin, model};
use super::tree::Tree;

/// The meshes that blocks share.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    /// One per design of the catalogue.
    pub houses: Vec<usize>,
    /// One per kind of tree.
    pub trees: [usize; 4],
    pub lamp: usize,
    pub lamp_light: usize,
    pub church: usize,
}

/// One block while it is furnished.
pub(super) struct Block<'a> {
    file: &'a mut Glb,
    ground: &'a Heightfield,
    shared: &'a Shared,
    name: String,
    origin: Vec3,
    row: i32,
    random: Random,
    /// The designs of the two houses that were built last.
    before: [usize; 2],
    children: Vec<usize>,
    /// Two kinds of trees to a block: a grove looks planted, and large towns stay small files.
    kinds: [Tree; 2],
    trees: [Vec<Placement>; 4],
    mesh: Option<usize>,
}

impl<'a> Block<'a> {
    /// Begins a block with its ground.
    pub fn new(
        file: &'a mut Glb,
        ground: &'a Heightfield,
        shared: &'a Shared,
        seed: u64,
        [column, row]: [i32; 2],
        cover: GroundCover,
    ) -> Self {
        let kind = if cover == GroundCover::Wild { "land" } else { "block" };
        let name = format!("{kind}-{column}-{row}");
        let mut block = Self {
            file,
            ground,
            shared,
            name,
            origin: cell_origin(ground, column, row),
            row,
            random: Random::of_block(seed, column, row),
            before: [usize::MAX; 2],
            children: Vec::new(),
            kinds: [Tree::Olive, Tree::Cypress],
            trees: Default::default(),
            mesh: None,
        };
        let first = block.random.below(4);
        block.kinds = [Tree::ALL[first], Tree::ALL[(first + 1 + block.random.below(3)) % 4]];
        let model = model(ground, column, row, cover);
        if model.surfaces.values().any(|surface| !surface.indices.is_empty()) {
            block.mesh = Some(block.file.add_mesh(&format!("ground-{column}-{row}"), &model));
        }
        block
    }

    fn add(&mut self, name: &str, placement: Placement, mesh: usize) {
        let name = format!("{}/{name}", self.name);
        self.children.push(self.file.add_node(&Node::with_mesh(name, placement, mesh)));
    }

    /// The ground at a place of the block, relative to its origin.
    fn on_ground(&self, x: f32, z: f32) -> Vec3 {
        let height = self.ground.height(self.origin.x + x, self.origin.z + z);
        on_grid(vec3(x, height - self.origin.y, z))
    }

    /// Houses, a court with trees, lamps.
    pub fn populate(&mut self) {
        if self.random.chance(0.06) && self.row > 0 {
            self.park();
        } else {
            self.houses();
        }
        self.lamps();
    }

    /// Six houses along two streets, and cottages between the rows.
    fn houses(&mut self) {
        let mut number = 0;
        for (turn, facing) in [(0.0, 1.0_f32), (0.5, -1.0)] {
            for slot in [-10.2_f32, 0.0, 10.2] {
                if self.random.chance(if self.row == 0 && facing > 0.0 { 0.0 } else { 0.07 }) {
                    self.tree(slot, 10.0 * facing);
                    continue;
                }
                let quarter = match self.row {
                    0 if facing > 0.0 => Quarter::Harbour,
                    0..2 if self.random.chance(0.4) => Quarter::Harbour,
                    _ if self.random.chance(0.12) => Quarter::Cottage,
                    _ => Quarter::Town,
                };
                number += 1;
                self.house(number, quarter, [slot, 15.25 * facing], turn);
            }
        }
        let mut is_open = [true; 2];
        for (side, facing) in [1.0_f32, -1.0].into_iter().enumerate() {
            if self.random.chance(0.5) {
                number += 1;
                is_open[side] = false;
                self.house(number, Quarter::Cottage, [15.25 * facing, 0.0], 0.25 * facing);
            }
        }
        let reach = is_open.map(|open| if open { 13.5 } else { 5.5 });
        for _ in 0..7 {
            let x = self.random.between(-reach[1], reach[0]);
            let z = self.random.between(-3.8, 3.8);
            self.tree(x, z);
        }
    }

    /// A house whose front is at `front`, seen from the middle of the block.
    fn house(&mut self, number: u32, quarter: Quarter, front: [f32; 2], turn: f32) {
        // Neighbours differ.
        let fits = |n: &usize| CATALOGUE[*n].quarter == quarter && !self.before.contains(n);
        let fitting: Vec<usize> = (0..CATALOGUE.len()).filter(fits).collect();
        let design = fitting[self.random.below(fitting.len())];
        self.before = [self.before[1], design];
        // Neighbours keep 30 cm between them: 10.2 m a slot, at most 8.8 m × 1.09.
        let scale = vec3(
            self.random.between(0.94, 1.09),
            self.random.between(0.92, 1.1),
            self.random.between(0.92, 1.08),
        );
        let setback = self.random.between(0.1, 0.7);
        let half = CATALOGUE[design].depth() * 0.5 * scale.z + setback;
        let inward = vec3(front[0], 0.0, front[1]).normalize_or(Vec3::Z);
        let inward = if turn.abs() == 0.25 { inward } else { Vec3::Z * front[1].signum() };
        let threshold = self.on_ground(front[0], front[1]);
        let place = vec3(front[0], threshold.y + CURB + 0.03, front[1]) - inward * half;
        let placement = Placement { translation: on_grid(place), turn, scale };
        let mesh = self.shared.houses[design];
        self.add(&format!("house-{number}"), placement, mesh);
    }

    /// A garden with trees on the whole lot.
    fn park(&mut self) {
        for j in 0..4 {
            for i in 0..4 {
                let x = (i as f32 - 1.5) * 7.4 + self.random.between(-2.0, 2.0);
                let z = (j as f32 - 1.5) * 7.4 + self.random.between(-2.0, 2.0);
                self.tree(x, z);
            }
        }
    }

    /// A church in the middle of a square, with trees at its corners.
    pub fn church(&mut self) {
        let place = self.on_ground(0.0, 12.0) + Vec3::Y * (CURB + 0.05);
        let place = on_grid(vec3(0.0, place.y, -0.5));
        self.add("church", Placement::at(place), self.shared.church);
        for (x, z) in [(-11.5, 11.5), (11.5, 11.5), (-12.0, 1.0), (12.0, 1.0)] {
            self.plant(Tree::Cypress, x, z);
        }
        self.lamps();
    }

    /// Three lamps to a block: two along the street before it, one along the street beside it.
    fn lamps(&mut self) {
        for (number, (x, z)) in [(-15.0, 16.9), (5.1, 16.9), (16.9, -5.1)].into_iter().enumerate() {
            let foot = self.on_ground(x, z);
            let place = on_grid(foot + Vec3::Y * (CURB + LAMP_HEIGHT));
            let name = format!("{}/lamp-{}", self.name, number + 1);
            let mut node = Node::with_mesh(name, Placement::at(place), self.shared.lamp);
            node.light = Some(self.shared.lamp_light);
            self.children.push(self.file.add_node(&node));
        }
    }

    /// Trees of the open land: in groves, above the beach, not on cliffs.
    pub fn plant_trees(&mut self) {
        for _ in 0..15 {
            let x = self.random.between(-18.0, 18.0);
            let z = self.random.between(-18.0, 18.0);
            let world = self.origin + vec3(x, 0.0, z);
            let is_grove = self.ground.noise(world.x, world.z, 38.0, 7) > 0.36;
            let is_flat = self.ground.normal(world.x, world.z).y > 0.80;
            if is_grove && is_flat && self.ground.height(world.x, world.z) > 1.8 {
                self.tree(x, z);
            }
        }
    }

    fn tree(&mut self, x: f32, z: f32) {
        let kind = self.kinds[self.random.below(2)];
        self.plant(kind, x, z);
    }

    fn plant(&mut self, kind: Tree, x: f32, z: f32) {
        let size = self.random.between(0.8, 1.2);
        let scale = vec3(size, size * self.random.between(0.9, 1.1), size);
        let turn = self.random.unit();
        let translation = self.on_ground(x, z);
        self.trees[kind as usize].push(Placement { translation, turn, scale });
    }

    /// Adds the trees and the block's own node, and gives it; `None` where nothing is to be seen.
    pub fn finish(mut self) -> Option<usize> {
        for (kind, instances) in std::mem::take(&mut self.trees).into_iter().enumerate() {
            if !instances.is_empty() {
                let name = format!("{}/{}", self.name, Tree::ALL[kind].name());
                let mesh = self.shared.trees[kind];
                let mut node = Node::with_mesh(name, Placement::at(Vec3::ZERO), mesh);
                node.instances = instances;
                self.children.push(self.file.add_node(&node));
            }
        }
        if self.children.is_empty() && self.mesh.is_none() {
            return None;
        }
        let mut node = Node::new(self.name, Placement::at(self.origin));
        node.mesh = self.mesh;
        node.children = self.children;
        Some(self.file.add_node(&node))
    }
}
