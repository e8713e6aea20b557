//! The sizes of things where they are drawn.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3};
use polyptych_scene::{Bounds, Instance, Mesh, Node, Scene};

use super::error::BakeError;

/// Farthest that a scene reaches, in world units: lengths in it, which are roots of sums of
/// squares, stay finite, and so do a camera's that sees all of it.
const COORDINATE_MAX: f64 = 1e100;

/// For every mesh that is drawn, the most world units that one of its units is drawn as.
pub(super) fn scales(nodes: &[Node], world: &[DAffine3]) -> BTreeMap<u32, f64> {
    let mut scales = BTreeMap::new();
    for (node, world) in nodes.iter().zip(world) {
        let Some(mesh) = node.mesh else { continue };
        let instance = |i: &Instance| i.scale.abs().max_element() as f64;
        let copies = node.instances.iter().map(instance).fold(0.0, f64::max);
        let copies = if node.instances.is_empty() { 1.0 } else { copies };
        let scale = stretch(world.matrix3) * copies;
        let known = scales.entry(mesh).or_insert(scale);
        *known = f64::max(*known, scale);
    }
    scales
}

/// The most that a matrix lengthens any vector, or a little more: exact for rotations, scales and
/// what they make together, at most 1.7 times too large where it shears.
///
/// The square of the largest singular value is the largest eigenvalue of MᵀM, which no sum of the
/// sizes of a row is below (Gershgorin, 1931).
fn stretch(matrix: DMat3) -> f64 {
    // The largest element is taken out, so that squares stay in range.
    let largest = matrix.to_cols_array().into_iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let matrix = matrix * largest.recip();
    let gram = matrix.transpose() * matrix;
    let row = |axis: DVec3| axis.abs().element_sum();
    row(gram.x_axis).max(row(gram.y_axis)).max(row(gram.z_axis)).sqrt() * largest
}

/// The box around everything drawn.
pub(super) fn of_scene(scene: &Scene) -> Result<Option<Bounds>, BakeError> {
    let mut sum = BoundsAccumulator { min: DVec3::MAX, max: DVec3::MIN };
    let mesh_boxes: Vec<_> = scene.meshes.iter().map(whole).collect();
    for (node, world) in scene.nodes.iter().zip(scene.world_from_nodes()) {
        let mut drawn = BoundsAccumulator { min: DVec3::MAX, max: DVec3::MIN };
        if !world.is_finite() {
            let place = format!("nodes '{}'", node.name);
            let right = "smaller numbers would be right";
            return Err(BakeError::at(place, "its world transform overflows", right));
        }
        let Some(mesh) = node.mesh.map(|mesh| mesh as usize) else { continue };
        if node.instances.is_empty() {
            for primitive in scene.meshes.get(mesh).iter().flat_map(|mesh| &mesh.primitives) {
                let (min, max) = (primitive.min.as_dvec3(), primitive.max.as_dvec3());
                drawn.add(world, primitive.origin + min, primitive.origin + max);
            }
        } else if let Some(Some((min, max))) = mesh_boxes.get(mesh) {
            for copy in &node.instances {
                let local = DAffine3::from_scale_rotation_translation(
                    copy.scale.as_dvec3(),
                    copy.rotation.as_dquat().normalize(),
                    copy.translation.as_dvec3(),
                );
                drawn.add(world * local, *min, *max);
            }
        }
        if drawn.min.cmple(drawn.max).all() {
            let farthest = drawn.min.abs().max(drawn.max.abs()).max_element();
            if farthest > COORDINATE_MAX {
                let place = format!("nodes '{}'", node.name);
                let what = format!("its mesh reaches as far as {farthest:.0e} units");
                return Err(BakeError::at(place, what, "smaller numbers would be right"));
            }
            (sum.min, sum.max) = (sum.min.min(drawn.min), sum.max.max(drawn.max));
        }
    }
    let is_drawn = sum.min.cmple(sum.max).all();
    Ok(is_drawn.then_some(Bounds { min: sum.min, max: sum.max }))
}

/// The box around all parts of a mesh, in its own space.
fn whole(mesh: &Mesh) -> Option<(DVec3, DVec3)> {
    let boxes = mesh.primitives.iter();
    let boxes = boxes.map(|p| (p.origin + p.min.as_dvec3(), p.origin + p.max.as_dvec3()));
    boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

struct BoundsAccumulator {
    min: DVec3,
    max: DVec3,
}

impl BoundsAccumulator {
    /// Adds the box around a box that was transformed.
    fn add(&mut self, world: DAffine3, min: DVec3, max: DVec3) {
        let center = world.transform_point3(min + (max - min) * 0.5);
        let half = (max - min) * 0.5;
        let matrix = world.matrix3;
        let reach = matrix.x_axis.abs() * half.x
            + matrix.y_axis.abs() * half.y
            + matrix.z_axis.abs() * half.z;
        (self.min, self.max) = (self.min.min(center - reach), self.max.max(center + reach));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stretch_of_rotated_scales_is_exact_and_of_shears_enough() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        let scaled = turn * DMat3::from_diagonal(DVec3::new(3.0, -7.0, 0.0));
        assert!((stretch(scaled) - 7.0).abs() < 1e-12);
        // Every column is 1 long, but the sum of the first two lengthens by almost 2.
        let close = DVec3::new(1.0, 0.01, 0.0).normalize();
        let shear = DMat3::from_cols(DVec3::X, close, DVec3::Z);
        let most = (shear * DVec3::new(1.0, 1.0, 0.0).normalize()).length();
        assert!(most > 1.41 && stretch(shear) >= most && stretch(shear) <= 1.7 * most);
        assert_eq!(stretch(DMat3::ZERO), 0.0);
        assert!(stretch(DMat3::from_diagonal(DVec3::splat(1e200))).is_finite());
    }
}
