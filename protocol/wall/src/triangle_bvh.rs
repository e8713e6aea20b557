//! Look-ups of triangles that a ray meets, or that are in a region or near a point: f64, in a tree
//! of boxes.
//!
//! Own code, because the crates for it bring another linear algebra with them, and what is needed
//! is three walks through a tree: I. Wald, *On fast construction of SAH-based bounding volume
//! hierarchies*, 2007, calls the division at the median the simplest tree; meshes of walls, and of
//! most scenes, are nearly as even as it takes for that one to be good.

use std::ops::ControlFlow;

use glam::DVec3;

/// Triangles that are looked at one by one.
const LEAF_MAX: usize = 4;

/// Distance beyond its edges at which a triangle is met, as a share of them: no ray slips between
/// two that share an edge.
pub const EDGE_SHARE: f64 = 1e-9;

/// Distance beyond its edges at which a triangle is met if the ray meets nothing else, as a share
/// of them: cells of a warp that were divided unlike each other leave cracks, 0.02 pixels wide
/// where cells have 64 of them.
pub const CRACK_SHARE: f64 = 1e-3;

/// A ray nearer to the plane of a triangle than this, as a sine, does not meet it.
const GRAZING: f64 = 1e-12;

/// Nearer than this to where it was asked for, nothing else is looked for: layers that lie in each
/// other, as of a folded map, cost no more than one.
pub(super) const CLOSE: f64 = 1e-12;

/// Boxes on the way down a tree of 2^32 triangles, and their siblings.
const STACK_MAX: usize = 64;

/// A box, and what is in it.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// The first of its triangles; or of its two boxes, where `count` is zero.
    first: u32,
    count: u32,
}

/// Boxes in boxes, with triangles in the smallest ones.
#[derive(Clone, Debug, Default)]
pub struct TriangleBvh {
    /// The first one holds all.
    nodes: Vec<Node>,
    /// Triangles, box after box.
    order: Vec<u32>,
}

impl TriangleBvh {
    /// The tree of these triangles.
    pub fn new(points: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let corners = |triangle: u32| triangles[triangle as usize].map(|at| points[at as usize]);
        let mut tree = Self { nodes: Vec::new(), order: (0..triangles.len() as u32).collect() };
        if triangles.is_empty() {
            return tree;
        }
        let empty = Node { low: DVec3::ZERO, high: DVec3::ZERO, first: 0, count: 0 };
        tree.nodes.push(empty);
        let mut waiting = vec![(0, 0, triangles.len())];
        while let Some((node, first, end)) = waiting.pop() {
            let part = &mut tree.order[first..end];
            let all = part.iter().flat_map(|triangle| corners(*triangle));
            let (low, high) = around(all);
            // Room for cracks, and for a ray that runs along a side of a flat box.
            let reach = low.abs().max(high.abs()).max_element();
            let slack = CRACK_SHARE * (high - low).max_element() + EDGE_SHARE * reach;
            let slack = DVec3::splat(slack.max(f64::MIN_POSITIVE));
            let mut made = Node { low: low - slack, high: high + slack, ..empty };
            if part.len() <= LEAF_MAX {
                (made.first, made.count) = (first as u32, part.len() as u32);
            } else {
                let middle = |triangle: &u32| corners(*triangle).iter().sum::<DVec3>();
                let (low, high) = around(part.iter().map(middle));
                let axis = (high - low).max_position();
                let half = part.len() / 2;
                let by = |a: &u32, b: &u32| middle(a)[axis].total_cmp(&middle(b)[axis]);
                part.select_nth_unstable_by(half, by);
                made.first = tree.nodes.len() as u32;
                waiting.push((made.first as usize, first, first + half));
                waiting.push((made.first as usize + 1, first + half, end));
                tree.nodes.extend([empty; 2]);
            }
            tree.nodes[node] = made;
        }
        tree
    }

    /// The triangle that a ray meets nearest to `near` of its lengths, with how far along the ray
    /// that is and how far towards its second and third corner; of several as near, one. It is met
    /// `edge_share` of its edges beyond them: [`EDGE_SHARE`], so that no ray slips through.
    pub fn nearest(
        &self,
        edge_share: f64,
        (from, direction, near): (DVec3, DVec3, f64),
        corners: impl Fn(usize) -> [DVec3; 3],
    ) -> Option<(usize, [f64; 3])> {
        let inverse = direction.recip();
        let gap = |node: u32| self.nodes[node as usize].gap(from, inverse, near);
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        let mut stack = [(f64::INFINITY, 0); STACK_MAX];
        let mut height = 0;
        if !self.nodes.is_empty() {
            stack[0] = (gap(0), 0);
            height = 1;
        }
        while height > 0 {
            height -= 1;
            let (least, node) = stack[height];
            if least == f64::INFINITY || best.is_some_and(|(gap, ..)| least > gap) {
                continue;
            }
            let Node { first, count, .. } = self.nodes[node as usize];
            if count == 0 {
                let (one, two) = ((gap(first), first), (gap(first + 1), first + 1));
                let (nearer, farther) = if one.0 <= two.0 { (one, two) } else { (two, one) };
                // The nearer one is looked at first.
                stack[height] = farther;
                stack[height + 1] = nearer;
                height += 2;
                continue;
            }
            for &triangle in &self.order[first as usize..(first + count) as usize] {
                let met = meet(edge_share, from, direction, corners(triangle as usize));
                let Some(met) = met else { continue };
                let found = ((met[0] - near).abs(), triangle);
                if best.is_none_or(|(gap, of, _)| found < (gap, of)) {
                    best = Some((found.0, found.1, met));
                }
            }
            if best.is_some_and(|(gap, ..)| gap <= CLOSE) {
                break;
            }
        }
        best.map(|(_, triangle, met)| (triangle as usize, met))
    }

    /// Visits the triangles of all boxes that `enters` says yes to, given their lowest and highest
    /// corner, and of no box around which it has said no; ends early if either breaks. Triangles
    /// lie well within their boxes.
    pub fn visit<B>(
        &self,
        mut enters: impl FnMut(DVec3, DVec3) -> ControlFlow<B, bool>,
        mut visit: impl FnMut(usize) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let mut stack = [0u32; STACK_MAX];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let Node { low, high, first, count } = self.nodes[stack[height] as usize];
            if !enters(low, high)? {
                continue;
            }
            if count == 0 {
                (stack[height], stack[height + 1]) = (first + 1, first);
                height += 2;
            }
            for &triangle in &self.order[first as usize..][..count as usize] {
                visit(triangle as usize)?;
            }
        }
        ControlFlow::Continue(())
    }

    /// Visits triangles, those of the nearest boxes first, and leaves out boxes that are farther
    /// than `visit` says of each triangle that it wishes to go on; ends early if `visit` breaks.
    /// `distance` is that of a box, from its lowest and highest corner; at most that of anything
    /// in it.
    pub fn visit_nearest<B>(
        &self,
        mut limit: f64,
        distance: impl Fn(DVec3, DVec3) -> f64,
        mut visit: impl FnMut(usize) -> ControlFlow<B, f64>,
    ) -> ControlFlow<B> {
        let of = |node: u32| {
            let Node { low, high, .. } = self.nodes[node as usize];
            (distance(low, high), node)
        };
        let mut stack = [(f64::INFINITY, 0); STACK_MAX];
        let mut height = 0;
        if !self.nodes.is_empty() {
            stack[0] = of(0);
            height = 1;
        }
        while height > 0 {
            height -= 1;
            let (least, node) = stack[height];
            if least > limit {
                continue;
            }
            let Node { first, count, .. } = self.nodes[node as usize];
            if count == 0 {
                let (one, two) = (of(first), of(first + 1));
                let (nearer, farther) = if one.0 <= two.0 { (one, two) } else { (two, one) };
                (stack[height], stack[height + 1]) = (farther, nearer);
                height += 2;
                continue;
            }
            for &triangle in &self.order[first as usize..][..count as usize] {
                limit = visit(triangle as usize)?;
            }
        }
        ControlFlow::Continue(())
    }
}

impl Node {
    /// Returns the minimum distance from `near` to the ray's part in this box, in lengths of the
    /// direction; infinity if the ray passes by the box, or meets it only behind its beginning.
    fn gap(&self, from: DVec3, inverse: DVec3, near: f64) -> f64 {
        let (one, two) = ((self.low - from) * inverse, (self.high - from) * inverse);
        let (mut begin, mut end) = (0.0_f64, f64::INFINITY);
        for (one, two) in one.to_array().into_iter().zip(two.to_array()) {
            begin = begin.max(one.min(two));
            end = end.min(one.max(two));
        }
        if begin > end { f64::INFINITY } else { (begin - near).max(near - end).max(0.0) }
    }
}

fn around(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.fold(none, |(low, high), point| (low.min(point), high.max(point)))
}

/// Returns the distance along a ray to a triangle, in lengths of the direction, and the barycentric
/// coordinates towards its second and third corner: T. Möller, B. Trumbore, *Fast, minimum storage
/// ray/triangle intersection*, 1997.
pub(super) fn meet(
    edge_share: f64,
    from: DVec3,
    direction: DVec3,
    [a, b, c]: [DVec3; 3],
) -> Option<[f64; 3]> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let volume = ab.dot(across);
    // A triangle without an area has no volume with any ray.
    if volume.abs() <= GRAZING * ab.length() * ac.length() * direction.length() {
        return None;
    }
    let to = from - a;
    let u = to.dot(across) / volume;
    let beside = to.cross(ab);
    let (v, along) = (direction.dot(beside) / volume, ac.dot(beside) / volume);
    let is_inside = u >= -edge_share && v >= -edge_share && u + v <= 1.0 + edge_share;
    (is_inside && along > 0.0).then_some([along, u, v])
}
