//! The lines at which the mesh of a screen ends, in the picture of a projector: holes may lie
//! between the places at which a cell of the picture is looked at.

use std::ops::ControlFlow;

use glam::{DVec2, DVec3};

use crate::projector::Projector;
use crate::triangle_bvh::TriangleBvh;
use crate::warp_mesh::reach::CellReach;

/// Depth of a line's nearest point that is thrown, as a share of its farthest: what is nearer is
/// far beside every picture.
const DEPTH_SHARE_MIN: f64 = 1e-6;

/// The ends of a mesh as a projector throws them, hidden ones among them.
#[derive(Debug)]
pub(super) struct ThrownOutline {
    /// Both ends of each line, in pixels before pins and bends.
    ends: Vec<DVec3>,
    /// Its triangles are the lines.
    tree: TriangleBvh,
}

impl ThrownOutline {
    /// The lines of these edges in a picture of this size.
    pub fn new(projector: &Projector, size: DVec2, edges: &[[DVec3; 2]]) -> Self {
        let lines = edges.iter().filter_map(|edge| thrown(projector, *edge));
        let ends: Vec<_> = lines.flatten().map(|place| (place * size).extend(0.0)).collect();
        let line = |index: u32| [2 * index, 2 * index + 1, 2 * index + 1];
        let lines: Vec<_> = (0..ends.len() as u32 / 2).map(line).collect();
        let tree = TriangleBvh::new(&ends, &lines);
        Self { ends, tree }
    }

    /// Returns whether the mesh may end within a cell of this reach.
    pub fn crosses(&self, reach: CellReach) -> bool {
        let CellReach::Within { low, high } = reach else { return reach == CellReach::Partly };
        let enters = |least: DVec3, most: DVec3| {
            let is_beside = least.truncate().cmpgt(high).any() || most.truncate().cmplt(low).any();
            ControlFlow::Continue(!is_beside)
        };
        let visit = |line: usize| {
            let [a, b] = [0, 1].map(|end| self.ends[2 * line + end].truncate());
            if meets(a, b, low, high) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        self.tree.visit(enters, visit).is_break()
    }
}

/// Returns the ends of the part of a line that is in front of a projector, in its picture from
/// (0, 0) to (1, 1) and beyond.
fn thrown(projector: &Projector, [a, b]: [DVec3; 2]) -> Option<[DVec2; 2]> {
    let axis = projector.rotation * DVec3::NEG_Z;
    let [near, far] = [a, b].map(|point| (point - projector.position).dot(axis));
    let least = near.max(far) * DEPTH_SHARE_MIN;
    if least <= 0.0 {
        return None;
    }
    let moved = |point: DVec3, depth: f64, other: DVec3, beyond: f64| {
        let share = if depth < least { (least - depth) / (beyond - depth) } else { 0.0 };
        projector.project(point.lerp(other, share))
    };
    Some([moved(a, near, b, far)?, moved(b, far, a, near)?])
}

/// Returns whether a line meets a rectangle: separating axes, along the sides and across the line.
fn meets(a: DVec2, b: DVec2, low: DVec2, high: DVec2) -> bool {
    let (least, most) = (a.min(b), a.max(b));
    let (along, half) = (b - a, (high - low) / 2.0);
    let off = along.perp_dot(low + half - a).abs();
    !least.cmpgt(high).any()
        && !most.cmplt(low).any()
        && off <= half.x * along.y.abs() + half.y * along.x.abs()
}
