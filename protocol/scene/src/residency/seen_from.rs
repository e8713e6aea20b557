//! The places that a scene is seen from, and how much an error of each mesh matters there.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::edit::NodeId;
use crate::{Instance, Mesh, MovedPlace, Scene};

/// Share of the radius of a mesh that an eye is never nearer to it than: an eye in the middle of a
/// terrain sees the ground from somewhere above it.
const NEAREST_SHARE: f64 = 1.0 / 16.0;

/// Share of the distance to a mesh by which an eye may move before what is held is chosen anew.
const REACH_SHARE: f64 = 1.0 / 4.0;

/// Maximum weight of a mesh, and the inverse of the minimum: products with errors stay finite.
const WEIGHT_MAX: f64 = 1e30;

/// A place that a scene is seen from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenFrom {
    /// In the world.
    pub position: DVec3,
    /// Pixels per radian around it, or per unit of the world where rays are parallel.
    pub density: f64,
    /// Rays are parallel: nothing looks smaller from further away.
    pub is_parallel: bool,
}

/// What of a scene matters most from where it is seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshWeights {
    /// For each mesh: pixels on the wall, or units of the world where no place is known, that a
    /// unit of it takes at most. Rounded down to 1 or 1.5 times a power of two, so that a small
    /// step of an eye or a node changes nothing. Next to 0 for what no node draws, or only
    /// without a size: all else has the budget first.
    pub each: Vec<f64>,
    /// The distance in units of the world by which each place may move before this is to be found
    /// anew; infinite where no place matters.
    pub reach: f64,
}

/// The weights of the meshes of a scene at each node that draws one: where nodes are moved, it
/// costs no more than they are to find whether all is as before.
#[derive(Debug)]
pub struct NodeWeights {
    places: Vec<SeenFrom>,
    /// The box of each mesh, and whether it has cuts: of another one all is held, wherever it is
    /// seen from.
    meshes: Vec<([DVec3; 2], bool)>,
    /// The mesh of each node, by the node's index.
    mesh_of: Vec<Option<usize>>,
    /// The weights of each mesh with the nodes that have them, the largest first.
    largest: Vec<Vec<(f64, u32)>>,
    /// The distances by which places may move for the sake of a node, the smallest first.
    nearest: Vec<(f64, u32)>,
}

impl SeenFrom {
    /// Returns whether what is held for one place serves another.
    pub fn is_near(&self, other: &Self, reach: f64) -> bool {
        let ratio = self.density / other.density;
        self.is_parallel == other.is_parallel
            && (2.0 / 3.0..=1.5).contains(&ratio)
            && (self.is_parallel || self.position.distance(other.position) <= reach)
    }
}

impl MeshWeights {
    /// Weighs the meshes of a scene, where its nodes stand, for places that it is seen from; by
    /// their size in the world alone if there are none.
    pub fn new(scene: &Scene, places: &[SeenFrom]) -> Self {
        NodeWeights::new(scene, places).mesh_weights()
    }
}

impl NodeWeights {
    /// Weighs the meshes of a scene as [`MeshWeights::new`] does.
    pub fn new(scene: &Scene, places: &[SeenFrom]) -> Self {
        let has_cuts = |mesh: &Mesh| mesh.primitives.iter().any(|of| !of.cuts.is_empty());
        let meshes = scene.meshes.iter().map(|mesh| (mesh_box(mesh), has_cuts(mesh)));
        let mesh = |of: Option<u32>| Some(of? as usize).filter(|mesh| *mesh < scene.meshes.len());
        let mut weights = Self {
            places: places.to_vec(),
            meshes: meshes.collect(),
            mesh_of: scene.nodes.iter().map(|node| mesh(node.mesh)).collect(),
            largest: vec![Vec::new(); scene.meshes.len()],
            nearest: Vec::new(),
        };
        let nodes = scene.nodes.iter().zip(scene.world_from_nodes());
        for (index, (node, world)) in (0..).zip(nodes) {
            let Some(mesh) = mesh(node.mesh) else { continue };
            let (weight, reach) = weights.weigh(mesh, world, &node.instances);
            weights.largest[mesh].push((weight, index));
            weights.nearest.extend(reach.map(|reach| (reach, index)));
        }
        for of in &mut weights.largest {
            of.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        }
        weights.nearest.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        weights
    }

    /// Returns the weights of the meshes.
    pub fn mesh_weights(&self) -> MeshWeights {
        let each = (0..self.meshes.len()).map(|mesh| self.mesh_weight(mesh)).collect();
        let reach = self.nearest.first().map_or(f64::INFINITY, |(reach, _)| *reach);
        MeshWeights { each, reach }
    }

    fn mesh_weight(&self, mesh: usize) -> f64 {
        rounded(self.largest[mesh].first().map_or(0.0, |(weight, _)| *weight))
    }

    /// Returns the [`MeshWeights::reach`] once these nodes, in the order of their indices, stand
    /// elsewhere; `None` if the weight of a mesh is another one then.
    pub fn reach_after<'a>(
        &self,
        moved: &[MovedPlace],
        instances: impl Fn(NodeId) -> &'a [Instance],
    ) -> Option<f64> {
        let has_moved = |node: u32| moved.binary_search_by_key(&node, |of| of.index).is_ok();
        let first_still = |of: &[(f64, u32)]| {
            of.iter().find(|(_, node)| !has_moved(*node)).map(|(value, _)| *value)
        };
        let mut reach = first_still(&self.nearest).unwrap_or(f64::INFINITY);
        let mut weights = BTreeMap::new();
        for of in moved {
            let Some(mesh) = *self.mesh_of.get(of.index as usize)? else { continue };
            let (weight, near) = self.weigh(mesh, of.world, instances(of.node));
            let still = || first_still(&self.largest[mesh]).unwrap_or(0.0);
            let largest: &mut f64 = weights.entry(mesh).or_insert_with(still);
            *largest = largest.max(weight);
            reach = reach.min(near.unwrap_or(f64::INFINITY));
        }
        let is_same = |(mesh, weight): (&usize, &f64)| rounded(*weight) == self.mesh_weight(*mesh);
        weights.iter().all(is_same).then_some(reach)
    }

    /// The weight of a mesh at a node, and by how far each place may move for its sake, if it
    /// matters.
    fn weigh(&self, mesh: usize, world: DAffine3, instances: &[Instance]) -> (f64, Option<f64>) {
        let (bounds, has_cuts) = self.meshes[mesh];
        let (mut weight, mut reach) = (0.0_f64, f64::INFINITY);
        for world_from_copy in copies(world, instances) {
            let (of_copy, near) = weigh(&world_from_copy, bounds, &self.places);
            (weight, reach) = (weight.max(of_copy), reach.min(near));
        }
        (weight, has_cuts.then_some(reach))
    }
}

/// The weight of a mesh in one place, and by how far each place may move before that is another.
fn weigh(
    world_from_copy: &DAffine3,
    [center, half]: [DVec3; 2],
    places: &[SeenFrom],
) -> (f64, f64) {
    let matrix = world_from_copy.matrix3;
    let scale = scale_max(&matrix);
    if places.is_empty() {
        return (scale, f64::INFINITY);
    }
    let center = world_from_copy.transform_point3(center);
    let extent = |axis: DVec3, half: f64| axis.abs() * half;
    let half = extent(matrix.x_axis, half.x)
        + extent(matrix.y_axis, half.y)
        + extent(matrix.z_axis, half.z);
    let nearest = half.length() * NEAREST_SHARE;
    let (mut pixels, mut reach) = (0.0_f64, f64::INFINITY);
    for place in places {
        pixels = pixels.max(if place.is_parallel {
            place.density
        } else {
            let beside = ((place.position - center).abs() - half).max(DVec3::ZERO);
            let distance = beside.length().max(nearest);
            reach = reach.min(distance * REACH_SHARE);
            place.density / distance
        });
    }
    (scale * pixels, reach)
}

/// The middle of a mesh's box and half of its sides, in the mesh's space.
fn mesh_box(mesh: &Mesh) -> [DVec3; 2] {
    let corners = mesh
        .primitives
        .iter()
        .flat_map(|of| [of.min, of.max].map(|corner| of.origin + corner.as_dvec3()));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = corners.fold(none, |(min, max), at| (min.min(at), max.max(at)));
    let half = (max - min) * 0.5;
    if half.is_finite() { [min + half, half] } else { [DVec3::ZERO; 2] }
}

/// World space from each copy of the mesh of a node.
fn copies(world: DAffine3, instances: &[Instance]) -> impl Iterator<Item = DAffine3> {
    let once = instances.is_empty().then_some(world);
    let copies = instances.iter().map(move |of| {
        let [scale, translation] = [of.scale, of.translation].map(glam::Vec3::as_dvec3);
        let local =
            DAffine3::from_scale_rotation_translation(scale, of.rotation.as_dquat(), translation);
        world * local
    });
    once.into_iter().chain(copies)
}

/// No less than the largest singular value: the Frobenius norm.
fn scale_max(matrix: &DMat3) -> f64 {
    let squares = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec3::length_squared);
    squares.iter().sum::<f64>().sqrt()
}

/// A weight with one bit behind its first: equal on all machines, since nothing but sums, products
/// and roots, which IEEE 754 rounds in one way, leads to it.
fn rounded(weight: f64) -> f64 {
    // Two bits of 52 decide: 1, 1.5, 2, 3, 4, 6 …
    const KEPT: u64 = !((1 << 51) - 1);
    if weight.is_nan() {
        return 1.0;
    }
    f64::from_bits(weight.clamp(WEIGHT_MAX.recip(), WEIGHT_MAX).to_bits() & KEPT)
}
