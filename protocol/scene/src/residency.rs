//! The part of a scene that servers hold on their GPUs where all of it is more than the budget.
//!
//! It is a function of the replicated state alone, so that all servers hold the same, whenever they
//! join. Each mesh is held up to one of its cuts. The coarsest cut of everything is always held.
//! Then the mesh with the largest error where it is seen is refined by one cut, again and again,
//! as long as one fits. Textures take what meshes leave, at least half of the budget if they need
//! it; if it is not enough, all are left without as many of their largest levels as it takes, and
//! meshes have the rest. With as many of them no larger budget has a larger error.
//!
//! While a server gets another part ready, it holds both. So refined meshes count twice: what two
//! parts hold together is within the budget too.

mod seen_from;

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

use polyptych_files::blob::BlobHash;

use super::{IndexFormat, Mesh, Primitive, Scene, Texture, Topology, VertexLayout};
pub use seen_from::{MeshWeights, NodeWeights, SeenFrom};

/// Longest side in pixels of a texture of which no level is left out: others take the memory.
pub const SMALL_TEXTURE_SIDE: u32 = 64;

/// Maximum number of levels of textures that are left out: 16,384 pixels become
/// [`SMALL_TEXTURE_SIDE`].
const TEXTURE_LEVELS_LEFT_OUT_MAX: u32 = 8;

/// The part of a scene that fits a budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Residency {
    /// The finest level of each mesh; 0 for all of it.
    pub levels: Vec<u32>,
    /// The largest levels of textures that are left out.
    pub texture_levels_left_out: u32,
    /// Bytes of meshes and textures on the GPU.
    pub gpu_bytes: u64,
    /// The largest error of a mesh times its weight: in pixels on the wall, or in units of the
    /// world where no place is known that it is seen from.
    pub error: f64,
}

/// The scene's coarsest cuts and smallest textures are more than the budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BudgetTooSmall {
    /// The smallest budget that works, in bytes.
    pub least: u64,
}

/// Meshes that share bytes on the GPU, and are held up to one level.
#[derive(Debug, Default)]
struct Unit {
    meshes: Vec<usize>,
    /// Levels of its cuts, the coarsest first, and 0.
    levels: Vec<u32>,
    /// Bytes and error at each of these levels.
    steps: Vec<(u64, f64)>,
}

/// A unit that can be refined.
#[derive(PartialEq)]
struct Candidate {
    error: f64,
    unit: usize,
    step: usize,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then(other.unit.cmp(&self.unit))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Residency {
    /// Chooses what is held within a budget in bytes. `weights` are those of [`MeshWeights`], by
    /// mesh.
    ///
    /// # Errors
    /// Even the coarsest of everything does not fit.
    pub fn choose(
        meshes: &[Mesh],
        textures: &[Texture],
        weights: &[f64],
        budget: u64,
    ) -> Result<Self, BudgetTooSmall> {
        let units = units(meshes, weights);
        let sum = |bytes: &mut dyn Iterator<Item = u64>| bytes.fold(0, u64::saturating_add);
        let coarsest = sum(&mut units.iter().filter_map(|unit| Some(unit.steps.first()?.0)));
        let finest = sum(&mut units.iter().filter_map(|unit| Some(unit.steps.last()?.0)));
        let of_textures = |left_out| texture_bytes(textures, left_out);
        let (smallest, largest) = (of_textures(TEXTURE_LEVELS_LEFT_OUT_MAX), of_textures(0));
        let least = coarsest.saturating_add(smallest);
        if least > budget {
            return Err(BudgetTooSmall { least });
        }
        // At least the smallest textures, and never so many that the coarsest meshes do not fit.
        let share = (budget / 2).max(budget.saturating_sub(finest));
        let for_textures = share.min(budget - coarsest).clamp(smallest, largest.max(smallest));
        let fits = |left_out: &u32| of_textures(*left_out) <= for_textures;
        let left_out = (0..=TEXTURE_LEVELS_LEFT_OUT_MAX).find(fits);
        let texture_levels_left_out = left_out.unwrap_or(TEXTURE_LEVELS_LEFT_OUT_MAX);
        // A level of textures is four times the next: what they leave is much.
        let for_meshes = budget - of_textures(texture_levels_left_out);
        let steps = if finest <= for_meshes {
            units.iter().map(|unit| unit.steps.len() - 1).collect()
        } else {
            refine(&units, for_meshes - coarsest)
        };
        let mut levels = vec![0; meshes.len()];
        let (mut gpu_bytes, mut error) = (of_textures(texture_levels_left_out), 0.0_f64);
        for (unit, &step) in units.iter().zip(&steps) {
            for &mesh in &unit.meshes {
                levels[mesh] = unit.levels[step];
            }
            gpu_bytes += unit.steps[step].0;
            error = error.max(unit.steps[step].1);
        }
        Ok(Self { levels, texture_levels_left_out, gpu_bytes, error })
    }

    /// Limits the meshes and textures of a scene to what is held.
    pub fn limit(&self, scene: &mut Scene) {
        for (mesh, &level) in scene.meshes.iter_mut().zip(&self.levels) {
            for primitive in mesh.primitives.iter_mut().filter(|_| level > 0) {
                *primitive = primitive.limited_to(&primitive.cut_at(level));
            }
        }
        for texture in &mut scene.textures {
            *texture = texture.without_levels(self.texture_levels_left_out);
        }
    }
}

/// Returns the step of each unit, where the refined ones may take half of `room` bytes beside the
/// coarsest of all.
fn refine(units: &[Unit], room: u64) -> Vec<usize> {
    let mut steps = vec![0; units.len()];
    let mut bytes: u64 = 0;
    let candidate = |unit: usize, step: usize| {
        let of: &Unit = &units[unit];
        (step + 1 < of.steps.len()).then(|| Candidate { error: of.steps[step].1, unit, step })
    };
    let mut open: BinaryHeap<Candidate> =
        (0..units.len()).filter_map(|unit| candidate(unit, 0)).collect();
    while let Some(Candidate { unit, step, .. }) = open.pop() {
        let of = &units[unit].steps;
        // The coarsest stays in the other part.
        let before = if step == 0 { 0 } else { of[step].0 };
        let refined = bytes.saturating_add(of[step + 1].0.saturating_sub(before));
        // What does not fit stays; others may fit.
        if refined <= room / 2 {
            bytes = refined;
            steps[unit] = step + 1;
            open.extend(candidate(unit, step + 1));
        }
    }
    steps
}

/// The key of primitives that share bytes on the GPU: all that servers tell them apart by.
type Slot = (BlobHash, (VertexLayout, Topology), IndexFormat, [u32; 4], Option<usize>);

/// The slot of a primitive of this mesh. Where clips bend it, each mesh has vertices of its own.
fn slot(mesh: usize, of: &Primitive) -> Slot {
    let counts = [of.vertex_count, of.index_count, of.coarser_index_count, of.meshlet_count];
    let shape = (of.layout, of.topology);
    (of.blob, shape, of.index_format, counts, of.deformed.map(|_| mesh))
}

/// Joins meshes with primitives in common, in the order of the first of each.
fn units(meshes: &[Mesh], weights: &[f64]) -> Vec<Unit> {
    let mut unit_of: Vec<usize> = (0..meshes.len()).collect();
    let root = |unit_of: &[usize], mut at: usize| {
        while unit_of[at] != at {
            at = unit_of[at];
        }
        at
    };
    let mut known = HashMap::new();
    for (index, mesh) in meshes.iter().enumerate() {
        for primitive in &mesh.primitives {
            let first = *known.entry(slot(index, primitive)).or_insert(index);
            let (a, b) = (root(&unit_of, first), root(&unit_of, index));
            unit_of[a.max(b)] = a.min(b);
        }
    }
    let mut units: Vec<Unit> = Vec::new();
    let mut place: HashMap<usize, usize> = HashMap::new();
    for index in 0..meshes.len() {
        let at = *place.entry(root(&unit_of, index)).or_insert(units.len());
        if at == units.len() {
            units.push(Unit::default());
        }
        units[at].meshes.push(index);
    }
    for unit in &mut units {
        unit.measure(meshes, weights);
    }
    units
}

impl Unit {
    /// Finds its levels, with the bytes and the error of each.
    fn measure(&mut self, meshes: &[Mesh], weights: &[f64]) {
        let primitives = || {
            let weight = |mesh: usize| weights.get(mesh).copied().unwrap_or(1.0);
            self.meshes.iter().flat_map(move |&mesh| {
                meshes[mesh].primitives.iter().map(move |of| (mesh, of, weight(mesh)))
            })
        };
        let mut levels: Vec<u32> =
            primitives().flat_map(|(_, of, _)| of.cuts.iter().map(|cut| cut.level)).collect();
        levels.push(0);
        levels.sort_unstable_by(|a, b| b.cmp(a));
        levels.dedup();
        let step = |&level: &u32| {
            let (mut bytes, mut error) = (HashMap::new(), 0.0_f64);
            for (mesh, primitive, weight) in primitives() {
                let cut = primitive.cut_at(level);
                // Equal blobs have equal cuts, but a manifest may lie.
                let limited = primitive.limited_to(&cut);
                bytes.insert(slot(mesh, &limited), limited.geometry_bytes());
                error = error.max(f64::from(cut.error) * weight);
            }
            let all = bytes.values().copied().fold(0, u64::saturating_add);
            (all, error)
        };
        self.steps = levels.iter().map(step).collect();
        self.levels = levels;
    }
}

/// Bytes of all textures without their largest levels, each counted once.
fn texture_bytes(textures: &[Texture], left_out: u32) -> u64 {
    let each: HashMap<_, u64> = textures
        .iter()
        .map(|of| {
            let name = (of.blob, of.format, [of.width, of.height, of.mip_count]);
            (name, of.without_levels(left_out).bytes())
        })
        .collect();
    each.values().copied().fold(0, u64::saturating_add)
}

impl Texture {
    /// The first level that is kept where so many of the largest are left out.
    pub fn first_level(&self, left_out: u32) -> u32 {
        let is_small =
            |level: &u32| self.level_size(*level).into_iter().max() <= Some(SMALL_TEXTURE_SIDE);
        let last = self.mip_count.saturating_sub(1);
        left_out.min((0..self.mip_count).find(is_small).unwrap_or(last))
    }

    /// The texture without so many of its largest levels, where smaller ones remain. Its bytes are
    /// the end of the blob.
    #[must_use]
    pub fn without_levels(&self, left_out: u32) -> Self {
        let first = self.first_level(left_out);
        let [width, height] = self.level_size(first);
        Self { width, height, mip_count: self.mip_count - first, ..self.clone() }
    }
}

#[cfg(test)]
mod tests;
