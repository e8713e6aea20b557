//! A static tree of boxes over the items, so that culling does not look at each of them.

use glam::DVec3;

use super::draw_item::Bounds;
use crate::cull::FrustumPlanes;

/// Items in a leaf. Testing a few boxes costs less than descending further.
const LEAF_ITEMS: usize = 4;

/// Ranges of more items than this are split only after a look at whether to stop: some
/// milliseconds.
const ITEMS_BETWEEN_CHECKS: usize = 1 << 14;

/// Error of the middle and the half of a box, relative to its coordinates: some roundings.
const ROUNDING: f64 = 1e-15 * 8.0;

/// A binary tree; the left child of node `i` is node `i + 1`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    /// Item indices; every node owns a range of them.
    order: Vec<u32>,
    /// Boxes in the order of `order`, so that a leaf reads them in one stretch.
    boxes: Vec<(DVec3, DVec3)>,
}

#[derive(Clone, Debug)]
struct Node {
    center: DVec3,
    half: DVec3,
    first: u32,
    count: u32,
    /// 0 for a leaf.
    right: u32,
}

impl Bvh {
    /// Splits at the median along the longest side, down to leaves of a few items. `None` if
    /// `is_cancelled` says so meanwhile.
    pub fn new(bounds: &[Bounds], is_cancelled: &dyn Fn() -> bool) -> Option<Self> {
        let mut order: Vec<u32> = (0..bounds.len() as u32).collect();
        let mut nodes = Vec::with_capacity(bounds.len());
        if !order.is_empty() {
            split(&mut nodes, &mut order, 0, (bounds, is_cancelled))?;
        }
        let half_of = |&i: &u32| (bounds[i as usize].center(), bounds[i as usize].half());
        let boxes = order.iter().map(half_of).collect();
        Some(Self { nodes, order, boxes })
    }

    /// Appends the items that may be visible, in no particular order. Never leaves one out that
    /// is.
    pub fn visible(&self, planes: &FrustumPlanes, found: &mut Vec<u32>) {
        if self.nodes.is_empty() {
            return;
        }
        let mut open = vec![(0, FrustumPlanes::ALL)];
        while let Some((index, mask)) = open.pop() {
            let node: &Node = &self.nodes[index as usize];
            let Some(mask) = planes.test(node.center, node.half, mask) else { continue };
            let range = node.first as usize..(node.first + node.count) as usize;
            if mask == 0 {
                found.extend_from_slice(&self.order[range]);
            } else if node.right == 0 {
                let inside = range.filter(|&at| {
                    let (center, half) = self.boxes[at];
                    planes.test(center, half, mask).is_some()
                });
                found.extend(inside.map(|at| self.order[at]));
            } else {
                open.push((node.right, mask));
                open.push((index + 1, mask));
            }
        }
    }
}

impl Bvh {
    /// Appends the items whose box meets this one, in no particular order. Never leaves one out
    /// that does.
    pub fn meeting(&self, bounds: &Bounds, found: &mut Vec<u32>) {
        let (center, half) = (bounds.center(), bounds.half());
        let meets = |of: DVec3, half_of: DVec3| {
            // Middles and halves were rounded.
            let slack = (of.abs() + center.abs() + half_of + half) * ROUNDING;
            (of - center).abs().cmple(half_of + half + slack).all()
        };
        let mut open: Vec<u32> = (!self.nodes.is_empty()).then_some(0).into_iter().collect();
        while let Some(index) = open.pop() {
            let node = &self.nodes[index as usize];
            if !meets(node.center, node.half) {
                continue;
            }
            if node.right == 0 {
                let range = node.first as usize..(node.first + node.count) as usize;
                let met = range.filter(|&at| meets(self.boxes[at].0, self.boxes[at].1));
                found.extend(met.map(|at| self.order[at]));
            } else {
                open.extend([node.right, index + 1]);
            }
        }
    }
}

fn split(
    nodes: &mut Vec<Node>,
    order: &mut [u32],
    first: u32,
    (bounds, is_cancelled): (&[Bounds], &dyn Fn() -> bool),
) -> Option<()> {
    if order.len() > ITEMS_BETWEEN_CHECKS && is_cancelled() {
        return None;
    }
    let all = order.iter().fold(Bounds::EMPTY, |all, &i| all.union(bounds[i as usize]));
    let index = nodes.len();
    let count = order.len() as u32;
    nodes.push(Node { center: all.center(), half: all.half(), first, count, right: 0 });
    if order.len() <= LEAF_ITEMS {
        return Some(());
    }
    let axis = all.half().max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        let along = |i: u32| bounds[i as usize].center()[axis];
        along(a).total_cmp(&along(b)).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(middle);
    split(nodes, left, first, (bounds, is_cancelled))?;
    nodes[index].right = nodes.len() as u32;
    split(nodes, right, first + middle as u32, (bounds, is_cancelled))
}
