//! Contraction of pairs of vertices, whether an edge joins them or not.
//!
//! M. Garland, P. Heckbert, *Surface simplification using quadric error metrics* (1997): the pair
//! whose contraction moves the surface least comes first, by the distances to the planes of all
//! triangles that have met at a vertex. Vertices that are near to each other are pairs too, so that
//! parts grow together that share no vertex. Unlike there, planes count alike, whatever the areas
//! of their triangles: the largest distance is to be small, also that of a small part.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use glam::{DMat3, DVec3, DVec4};

use super::appearance::color_length;
use super::patch::by_surface;
use super::source::Source;

/// Vertices without a common edge that each is paired with at most, the nearest.
const NEAR_MAX: usize = 6;

/// A contraction must not turn a triangle further than by the angle of this cosine.
const COSINE_MIN: f64 = 0.2;

/// The share of a way's square that is added to the cost of a contraction: of those that leave all
/// planes where they are, the shortest comes first.
const LENGTH_WEIGHT: f64 = 1e-6;

/// How far triangles are contracted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// The number of triangles that may be left.
    pub target: usize,
    /// Vertices without a common edge are paired that are no farther apart.
    pub reach: f64,
    /// The root of the sum of squared distances to planes beyond which nothing is contracted.
    pub way_max: f64,
}

/// The sum of squared distances to planes.
#[derive(Clone, Copy, Debug)]
struct Quadric {
    square: DMat3,
    linear: DVec3,
    constant: f64,
}

impl Quadric {
    /// The quadric of no plane. The default of a matrix is the identity.
    const NONE: Self = Self { square: DMat3::ZERO, linear: DVec3::ZERO, constant: 0.0 };

    /// The quadric of the plane through a point with this normal, of unit length.
    fn of_plane(normal: DVec3, point: DVec3) -> Self {
        let offset = -normal.dot(point);
        let [x, y, z] = [normal * normal.x, normal * normal.y, normal * normal.z];
        Self {
            square: DMat3::from_cols(x, y, z),
            linear: normal * offset,
            constant: offset * offset,
        }
    }

    fn add(&mut self, other: &Self) {
        self.square += other.square;
        self.linear += other.linear;
        self.constant += other.constant;
    }

    /// The sum at a point.
    fn at(&self, point: DVec3) -> f64 {
        let sum = point.dot(self.square * point) + 2.0 * self.linear.dot(point) + self.constant;
        sum.max(0.0)
    }
}

/// A pair that may be contracted: the first vertex moves to the second one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    cost: f64,
    from: u32,
    to: u32,
    /// The changes of both when the cost was computed.
    changes: [u32; 2],
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let order = self.cost.total_cmp(&other.cost);
        order.then((self.from, self.to).cmp(&(other.from, other.to)))
    }
}

/// The colours that a surface had at the places that are one now, as lengths on the surface.
#[derive(Clone, Copy, Debug)]
struct ColorRange {
    surface: u32,
    /// The colour that it has there.
    own: DVec4,
    low: DVec4,
    high: DVec4,
}

impl ColorRange {
    /// The square of the largest way from a colour to that of another place.
    fn way_squared(&self, to: DVec4) -> f64 {
        (self.low - to).abs().max((self.high - to).abs()).length_squared()
    }
}

/// Triangles over places, some of which have been contracted.
struct Contraction {
    positions: Vec<DVec3>,
    quadrics: Vec<Quadric>,
    /// Those of surfaces that have colours.
    colors: Vec<Vec<ColorRange>>,
    is_locked: Vec<bool>,
    /// Those where a surface ends, which it goes on to do there.
    is_border: Vec<bool>,
    /// The place to which each one has moved.
    moved_to: Vec<u32>,
    changes: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// Those at each place, which may have lost their area since.
    triangles_at: Vec<Vec<u32>>,
    /// The places that each one is paired with, which may have moved since.
    pairs: Vec<BTreeSet<u32>>,
    /// Triangles that have an area.
    left: usize,
    queue: BinaryHeap<Reverse<Candidate>>,
}

/// Returns the place to which each place of triangles moves, so that no more of them have an area
/// than is the goal, if that goes. Places are named by the first vertex there; those that are
/// locked stay.
pub(super) fn contract(
    source: &Source<'_>,
    triangles: &[u32],
    is_locked: impl Fn(u32) -> bool,
    goal: Goal,
) -> BTreeMap<u32, u32> {
    let mut names: Vec<u32> =
        triangles.iter().map(|vertex| source.welded[*vertex as usize]).collect();
    let welded = names.clone();
    names.sort_unstable();
    names.dedup();
    let number = |name: &u32| names.partition_point(|known| known < name) as u32;
    let positions: Vec<DVec3> = names.iter().map(|name| source.position(*name)).collect();
    let center = positions.iter().sum::<DVec3>() / positions.len().max(1) as f64;
    let mut contraction = Contraction {
        positions: positions.iter().map(|position| *position - center).collect(),
        quadrics: vec![Quadric::NONE; names.len()],
        colors: vec![Vec::new(); names.len()],
        is_locked: names.iter().map(|name| is_locked(*name)).collect(),
        is_border: vec![false; names.len()],
        moved_to: (0..names.len() as u32).collect(),
        changes: vec![0; names.len()],
        triangles: Vec::with_capacity(triangles.len() / 3),
        triangles_at: vec![Vec::new(); names.len()],
        pairs: vec![BTreeSet::new(); names.len()],
        left: 0,
        queue: BinaryHeap::new(),
    };
    for corners in welded.as_chunks::<3>().0 {
        contraction.add(corners.map(|name| number(&name)));
    }
    let surfaces: Vec<u32> =
        triangles.as_chunks::<3>().0.iter().map(|[a, ..]| source.surface_of(*a)).collect();
    contraction.measure_planes(&surfaces);
    contraction.add_colors(source, triangles, number);
    contraction.pair_near(&surfaces, goal.reach);
    contraction.run(goal);
    let place = |at: usize| names[contraction.place_of(at as u32) as usize];
    names.iter().enumerate().map(|(at, name)| (*name, place(at))).collect()
}

impl Contraction {
    fn add(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners;
        let number = self.triangles.len() as u32;
        self.triangles.push(corners);
        if a == b || b == c || c == a {
            return;
        }
        self.left += 1;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            self.triangles_at[from as usize].push(number);
            self.pairs[from as usize].insert(to);
            self.pairs[to as usize].insert(from);
        }
    }

    /// Gives each place the colours that its surfaces have there.
    fn add_colors(&mut self, source: &Source<'_>, triangles: &[u32], number: impl Fn(&u32) -> u32) {
        for (surface, own) in by_surface(triangles, |vertex| source.surface_of(vertex)) {
            if !source.surfaces()[surface as usize].layout.color {
                continue;
            }
            let length = color_length(own.iter().map(|at| source.position(*at)));
            for vertex in own {
                let place = number(&source.welded[vertex as usize]);
                let color = DVec4::from_array(source.color(vertex)) * length;
                let of = ColorRange { surface, own: color, low: color, high: color };
                self.add_color(place, of);
            }
        }
    }

    fn add_color(&mut self, place: u32, color: ColorRange) {
        let known = &mut self.colors[place as usize];
        match known.iter_mut().find(|known| known.surface == color.surface) {
            Some(known) => {
                (known.low, known.high) = (known.low.min(color.low), known.high.max(color.high));
            }
            None => known.push(color),
        }
    }

    /// The square of the largest way that a colour of either place goes if one moves to the other.
    fn color_way_squared(&self, from: u32, to: u32) -> f64 {
        let there = &self.colors[to as usize];
        let way = |of: &ColorRange| {
            let to = there.iter().find(|there| there.surface == of.surface)?;
            Some(of.way_squared(to.own).max(to.way_squared(of.own)))
        };
        self.colors[from as usize].iter().filter_map(way).fold(0.0, f64::max)
    }

    /// Gives each place the planes of its triangles, and planes across the edges of surfaces.
    fn measure_planes(&mut self, surfaces: &[u32]) {
        // The normal of a triangle and their number, by the ends of the edge and the surface.
        let mut edges: BTreeMap<(u32, u32, u32), (DVec3, u32)> = BTreeMap::new();
        for (corners, surface) in self.triangles.iter().zip(surfaces) {
            let [a, b, c] = corners.map(|at| self.positions[at as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let plane = Quadric::of_plane(normal, a);
            for (at, to) in [(0, 1), (1, 2), (2, 0)] {
                let (from, to) = (corners[at], corners[to]);
                self.quadrics[from as usize].add(&plane);
                let key = (from.min(to), from.max(to), *surface);
                edges.entry(key).or_insert((normal, 0)).1 += 1;
            }
        }
        for ((from, to, _), (normal, count)) in edges {
            if count == 2 || from == to {
                continue;
            }
            let [start, end] = [from, to].map(|at| self.positions[at as usize]);
            let along = end - start;
            let across = along.cross(normal).normalize_or_zero();
            let plane = Quadric::of_plane(across, start);
            for at in [from, to] {
                self.quadrics[at as usize].add(&plane);
                self.is_border[at as usize] = true;
            }
        }
    }

    /// Pairs each place with the nearest ones within reach that a surface has too. What lies close
    /// over another surface stays over it, and does not take its place.
    fn pair_near(&mut self, surfaces: &[u32], reach: f64) {
        let mut surfaces_at = vec![BTreeSet::new(); self.positions.len()];
        for (corners, surface) in self.triangles.iter().zip(surfaces) {
            for at in corners {
                surfaces_at[*at as usize].insert(*surface);
            }
        }
        let cell = |at: DVec3| (at / reach).floor().to_array().map(|number| number as i64);
        let mut cells: foldhash::HashMap<[i64; 3], Vec<u32>> = foldhash::HashMap::default();
        for (at, position) in (0..).zip(&self.positions) {
            cells.entry(cell(*position)).or_default().push(at);
        }
        for at in 0..self.positions.len() as u32 {
            let position = self.positions[at as usize];
            let [x, y, z] = cell(position);
            let steps = (0..27).map(|step| [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1]);
            let cells = steps.filter_map(|[i, j, k]| {
                cells.get(&[x.saturating_add(i), y.saturating_add(j), z.saturating_add(k)])
            });
            let (own, known) = (&surfaces_at[at as usize], &self.pairs[at as usize]);
            let is_other =
                |at: u32| own.is_disjoint(&surfaces_at[at as usize]) || known.contains(&at);
            // The nearest first. Few get as far as a look at their surfaces.
            let mut near: Vec<(f64, u32)> = Vec::with_capacity(NEAR_MAX + 1);
            for &other in cells.flatten().filter(|other| **other != at) {
                let distance = self.positions[other as usize].distance(position);
                let order = |of: &(f64, u32)| of.0.total_cmp(&distance).then(of.1.cmp(&other));
                let rank = near.partition_point(|known| order(known).is_lt());
                if distance <= reach && rank < NEAR_MAX && !is_other(other) {
                    near.insert(rank, (distance, other));
                    near.truncate(NEAR_MAX);
                }
            }
            for (_, other) in near {
                self.pairs[at as usize].insert(other);
                self.pairs[other as usize].insert(at);
            }
        }
    }

    fn run(&mut self, goal: Goal) {
        for at in 0..self.positions.len() as u32 {
            self.push_pairs(at);
        }
        while self.left > goal.target {
            let Some(Reverse(candidate)) = self.queue.pop() else { break };
            let Candidate { cost, from, to, changes } = candidate;
            if cost > goal.way_max * goal.way_max {
                break;
            }
            if changes == [from, to].map(|at| self.changes[at as usize])
                && self.is_here(from)
                && self.is_here(to)
                && !self.turns_over(from, to)
            {
                self.contract(from, to);
            }
        }
    }

    fn is_here(&self, at: u32) -> bool {
        self.moved_to[at as usize] == at
    }

    fn place_of(&self, mut at: u32) -> u32 {
        while !self.is_here(at) {
            at = self.moved_to[at as usize];
        }
        at
    }

    /// Appends the better direction of each pair of a place to the queue.
    fn push_pairs(&mut self, at: u32) {
        for &other in &self.pairs[at as usize] {
            let mut sum = self.quadrics[at as usize];
            sum.add(&self.quadrics[other as usize]);
            let ends = [at, other].map(|at| self.positions[at as usize]);
            let length = ends[0].distance_squared(ends[1]);
            let cost = |from: u32, to: u32| {
                let is_free = !self.is_locked[from as usize]
                    && (!self.is_border[from as usize] || self.is_border[to as usize]);
                // A colour that is not taken over there is off by the way there.
                let color_way = self.color_way_squared(from, to).min(length);
                let way = sum.at(self.positions[to as usize]) + color_way + length * LENGTH_WEIGHT;
                is_free.then_some(Candidate {
                    cost: way,
                    from,
                    to,
                    changes: [from, to].map(|at| self.changes[at as usize]),
                })
            };
            let both = [cost(at, other), cost(other, at)];
            if let Some(best) = both.into_iter().flatten().min() {
                self.queue.push(Reverse(best));
            }
        }
    }

    /// Returns whether a triangle would turn too far if a place moved to another one.
    fn turns_over(&self, from: u32, to: u32) -> bool {
        let new = self.positions[to as usize];
        self.triangles_at[from as usize].iter().any(|triangle| {
            let corners = self.triangles[*triangle as usize];
            if !is_triangle(corners) || corners.contains(&to) {
                return false;
            }
            let before = corners.map(|at| self.positions[at as usize]);
            let after =
                corners.map(|at| if at == from { new } else { self.positions[at as usize] });
            let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).normalize_or_zero();
            normal(before).dot(normal(after)) < COSINE_MIN
        })
    }

    fn contract(&mut self, from: u32, to: u32) {
        self.moved_to[from as usize] = to;
        let quadric = self.quadrics[from as usize];
        self.quadrics[to as usize].add(&quadric);
        for color in std::mem::take(&mut self.colors[from as usize]) {
            self.add_color(to, color);
        }
        for triangle in std::mem::take(&mut self.triangles_at[from as usize]) {
            let corners = &mut self.triangles[triangle as usize];
            if !is_triangle(*corners) {
                continue;
            }
            *corners = corners.map(|at| if at == from { to } else { at });
            if is_triangle(*corners) {
                self.triangles_at[to as usize].push(triangle);
            } else {
                self.left -= 1;
            }
        }
        for other in std::mem::take(&mut self.pairs[from as usize]) {
            self.pairs[other as usize].remove(&from);
            if other != to {
                self.pairs[other as usize].insert(to);
                self.pairs[to as usize].insert(other);
            }
        }
        self.changes[to as usize] += 1;
        self.push_pairs(to);
    }
}

fn is_triangle([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::surface::Surface;
    use polyptych_scene::VertexLayout;

    /// Squares of side 1, none of which shares a vertex with another.
    fn squares(places: &[[f32; 3]]) -> (Vec<f32>, Vec<u32>) {
        let (mut vertices, mut indices) = (Vec::new(), Vec::new());
        for [x, y, z] in places {
            let first = vertices.len() as u32 / 6;
            for [right, up] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                vertices.extend([x + right, y + up, *z, 0.0, 0.0, 1.0]);
            }
            indices.extend([0, 1, 2, 0, 2, 3].map(|at| first + at));
        }
        (vertices, indices)
    }

    fn check(places: &[[f32; 3]], target: usize, is_locked: impl Fn(u32) -> bool) -> f64 {
        let (vertices, indices) = squares(places);
        let layout = VertexLayout::default();
        let surface = Surface {
            layout,
            vertices: &vertices,
            indices: &indices,
            keeps_order: false,
            locked: &[],
        };
        let surfaces = [surface];
        let source = Source::new(&surfaces);
        let goal = Goal { target, reach: 0.2, way_max: f64::INFINITY };
        let moved = contract(&source, &indices, &is_locked, goal);
        let way = |(from, to): (&u32, &u32)| {
            assert!(from == to || !is_locked(*from), "a locked place moved");
            source.position(*from).distance(source.position(*to))
        };
        let corners = indices.as_chunks::<3>().0.iter();
        let triangles = corners.map(|of| of.map(|at| moved[&source.welded[at as usize]]));
        let left = triangles.filter(|of| is_triangle(*of)).count();
        assert!(left <= target, "{left} triangles are left");
        moved.iter().map(way).fold(0.0, f64::max)
    }

    #[test]
    fn squares_that_nearly_touch_grow_together_first() {
        let near: Vec<[f32; 3]> = (0..8).map(|at| [1.1 * at as f32, 0.0, 0.0]).collect();
        // Eight squares in a row lose the corners between them, which move along the row.
        let way = check(&near, 4, |_| false);
        assert!(way > 0.0);
        let apart: Vec<[f32; 3]> =
            (0..8).map(|at| [1.1 * at as f32, 0.0, 9.0 * at as f32]).collect();
        let way = check(&apart, 8, |_| false);
        assert!(way <= 1.5, "no square reaches for another: {way}");
    }

    #[test]
    fn a_plane_costs_nothing_wherever_it_lies() {
        // A sheet of 8 by 8 squares, of which the corners are enough.
        let mut vertices = Vec::new();
        for at in 0..81_u8 {
            vertices.extend([f32::from(at % 9), f32::from(at / 9), 5.0, 0.0, 0.0, 1.0]);
        }
        let square = |at: u32| {
            let first = at % 8 + at / 8 * 9;
            [0, 1, 10, 0, 10, 9].map(|corner| first + corner)
        };
        let indices: Vec<u32> = (0..64).flat_map(square).collect();
        let (layout, keeps_order, locked) = (VertexLayout::default(), false, &[][..]);
        let surfaces =
            [Surface { layout, vertices: &vertices, indices: &indices, keeps_order, locked }];
        let source = Source::new(&surfaces);
        let goal = Goal { target: 0, reach: 0.1, way_max: 0.01 };
        let moved = contract(&source, &indices, |_| false, goal);
        let corners = indices.as_chunks::<3>().0.iter();
        let triangles = corners.map(|of| of.map(|at| moved[&source.welded[at as usize]]));
        assert_eq!(triangles.filter(|of| is_triangle(*of)).count(), 2);
    }

    #[test]
    fn locked_places_stay() {
        let near: Vec<[f32; 3]> = (0..8).map(|at| [1.1 * at as f32, 0.0, 0.0]).collect();
        check(&near, 8, |at| at < 4);
    }
}
