//! The sizes of things where they are drawn.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3};
use polyptych_scene::{Bounds, Instance, Mesh, Node, Primitive, Scene, Topology};

use super::backgrounds::{BackgroundSearch, DrawnBox, Overview};
use super::error::BakeError;
use super::uri;

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
pub(super) fn stretch(matrix: DMat3) -> f64 {
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

/// Returns the overview of a scene without its `hidden` nodes, and that of all of it, which is both
/// if nothing is shown. `file_nodes` are the numbers in the file of the scene's nodes.
pub(super) fn overviews(
    scene: &Scene,
    file_nodes: &[u32],
    hidden: &[bool],
) -> Result<[Overview; 2], BakeError> {
    let (mut shown, mut all) = (BackgroundSearch::default(), BackgroundSearch::default());
    let whole: Vec<_> = scene.meshes.iter().map(whole).collect();
    let nodes = (0..).zip(&scene.nodes).zip(file_nodes.iter().zip(hidden));
    for (((node, of), (number, is_hidden)), world) in nodes.zip(scene.world_from_nodes()) {
        let place = || format!("nodes[{number}] '{}'", uri::shorten(&of.name));
        if !world.is_finite() {
            let right = "smaller numbers would be right";
            return Err(BakeError::at(place(), "its world transform overflows", right));
        }
        let Some(mesh) = of.mesh.map(|mesh| mesh as usize) else { continue };
        let mut add = |drawn: DrawnBox| {
            let Bounds { min, max } = drawn.bounds;
            if !min.cmple(max).all() {
                return Ok(());
            }
            let farthest = min.abs().max(max.abs()).max_element();
            if farthest > COORDINATE_MAX {
                let what = format!("its mesh reaches as far as {farthest:.0e} units");
                return Err(BakeError::at(place(), what, "smaller numbers would be right"));
            }
            all.add(drawn);
            if !is_hidden {
                shown.add(drawn);
            }
            Ok(())
        };
        let Some(Some((corners_of_all, elements))) = whole.get(mesh) else { continue };
        if of.instances.is_empty() {
            // Tighter than the box around the box of all.
            let parts = scene.meshes[mesh].primitives.iter().map(corners);
            let boxes = parts.map(|(min, max)| around(world, min, max));
            if let Some(bounds) = boxes.reduce(union) {
                add(DrawnBox { bounds, elements: *elements, node })?;
            }
        }
        for copy in &of.instances {
            let bounds = around(world * place_of(copy), corners_of_all.0, corners_of_all.1);
            add(DrawnBox { bounds, elements: *elements, node })?;
        }
    }
    let (shown, all) = (shown.overview(), all.overview());
    Ok([if shown.bounds.is_some() { shown } else { all.clone() }, all])
}

/// The space of a node, from that of one of its copies.
pub(super) fn place_of(copy: &Instance) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        copy.scale.as_dvec3(),
        copy.rotation.as_dquat().normalize(),
        copy.translation.as_dvec3(),
    )
}

/// The box around all parts of a mesh, in its own space, and their elements.
pub(super) fn whole(mesh: &Mesh) -> Option<((DVec3, DVec3), u64)> {
    let parts = mesh.primitives.iter().map(|of| (corners(of), elements(of)));
    parts.reduce(|(a, some), (b, more)| ((a.0.min(b.0), a.1.max(b.1)), some.saturating_add(more)))
}

/// The least and the greatest corner of a primitive, in the space of its mesh.
fn corners(primitive: &Primitive) -> (DVec3, DVec3) {
    let (min, max) = (primitive.min.as_dvec3(), primitive.max.as_dvec3());
    (primitive.origin + min, primitive.origin + max)
}

/// Triangles of a primitive, or its indices if it has lines or points.
fn elements(primitive: &Primitive) -> u64 {
    match primitive.topology {
        Topology::Triangles => primitive.triangles(),
        Topology::Points | Topology::Lines => u64::from(primitive.index_count),
    }
}

/// The box around both.
fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds { min: a.min.min(b.min), max: a.max.max(b.max) }
}

/// The box around a box that was transformed.
pub(super) fn around(world: DAffine3, min: DVec3, max: DVec3) -> Bounds {
    let center = world.transform_point3(min + (max - min) * 0.5);
    let half = (max - min) * 0.5;
    let matrix = world.matrix3;
    let reach =
        matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
    Bounds { min: center - reach, max: center + reach }
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
