//! The order of triangles and vertices: neighbours in space become neighbours in memory.
//!
//! Triangles are ordered by Tipsify (Sander, Nehab, Barczak: "Fast Triangle Reordering for
//! Vertex Locality and Reduced Overdraw", SIGGRAPH 2007), which takes linear time; vertices
//! follow in the order of their first use.

/// Vertices that a processor is taken to remember: small, so that the order serves all of them.
const CACHE: u32 = 16;

/// Orders a list of triangles over `vertices` vertices, unless it is already better than that.
pub(super) fn triangles(indices: &mut Vec<u32>, vertices: usize) {
    let ordered = tipsify(indices, vertices);
    if misses(&ordered, vertices) < misses(indices, vertices) {
        *indices = ordered;
    }
}

/// Numbers vertices by first use; gives the old number of each new one. All must be used.
pub(super) fn vertices(indices: &mut [u32], vertices: usize) -> Vec<u32> {
    let mut new_of = vec![u32::MAX; vertices];
    let mut old_of = Vec::with_capacity(vertices);
    for index in indices {
        let new = &mut new_of[*index as usize];
        if *new == u32::MAX {
            *new = old_of.len() as u32;
            old_of.push(*index);
        }
        *index = *new;
    }
    old_of
}

/// How often a first-in-first-out cache must fetch a vertex.
fn misses(indices: &[u32], vertices: usize) -> usize {
    let mut entered = vec![0u32; vertices];
    let mut time = CACHE + 1;
    for &index in indices {
        let entered = &mut entered[index as usize];
        if time - *entered > CACHE {
            *entered = time;
            time = time.saturating_add(1);
        }
    }
    (time - CACHE - 1) as usize
}

/// Which triangles each vertex has: those of vertex `v` are `list[start[v]..start[v + 1]]`.
struct Adjacency {
    start: Vec<u32>,
    list: Vec<u32>,
}

impl Adjacency {
    fn new(indices: &[u32], vertices: usize) -> Self {
        let mut start = vec![0u32; vertices + 1];
        for &index in indices {
            start[index as usize + 1] += 1;
        }
        (0..vertices).for_each(|vertex| start[vertex + 1] += start[vertex]);
        let mut next = start.clone();
        let mut list = vec![0u32; indices.len()];
        for (corner, &index) in indices.iter().enumerate() {
            let slot = &mut next[index as usize];
            list[*slot as usize] = (corner / 3) as u32;
            *slot += 1;
        }
        Self { start, list }
    }

    fn of(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.list[self.start[vertex] as usize..self.start[vertex + 1] as usize]
    }
}

fn tipsify(indices: &[u32], vertices: usize) -> Vec<u32> {
    let adjacency = Adjacency::new(indices, vertices);
    let mut live: Vec<u32> = (0..vertices as u32).map(|v| adjacency.of(v).len() as u32).collect();
    let mut entered = vec![0u32; vertices];
    let mut is_done = vec![false; indices.len() / 3];
    let mut out = Vec::with_capacity(indices.len());
    let mut dead_ends: Vec<u32> = Vec::new();
    let mut ring: Vec<u32> = Vec::new();
    let (mut time, mut cursor) = (CACHE + 1, 0usize);
    let mut fan = indices.first().copied();
    while let Some(hub) = fan {
        ring.clear();
        for &triangle in adjacency.of(hub) {
            if std::mem::replace(&mut is_done[triangle as usize], true) {
                continue;
            }
            let first = triangle as usize * 3;
            for &vertex in &indices[first..first + 3] {
                out.push(vertex);
                ring.push(vertex);
                live[vertex as usize] -= 1;
                if time - entered[vertex as usize] > CACHE {
                    entered[vertex as usize] = time;
                    time += 1;
                }
            }
        }
        dead_ends.extend(&ring);
        // The vertex that entered longest ago and will still be there when its fan is drawn.
        let age = |&vertex: &u32| {
            let age = time - entered[vertex as usize];
            if age + 2 * live[vertex as usize] <= CACHE { age } else { 0 }
        };
        let alive = ring.iter().copied().filter(|&vertex| live[vertex as usize] > 0);
        fan = alive.max_by_key(age).or_else(|| {
            while let Some(vertex) = dead_ends.pop() {
                if live[vertex as usize] > 0 {
                    return Some(vertex);
                }
            }
            let rest = live.get(cursor..)?.iter().position(|&live| live > 0)?;
            cursor += rest;
            Some(cursor as u32)
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shuffled_grid_is_put_in_order() {
        let side = 40u32;
        let quad = |i: u32| {
            let at = i / side * (side + 1) + i % side;
            [at, at + 1, at + side + 1, at + 1, at + side + 2, at + side + 1]
        };
        let scattered = (0..side * side).map(|i| i * 611 % (side * side));
        let mut indices: Vec<u32> = scattered.flat_map(quad).collect();
        let count = ((side + 1) * (side + 1)) as usize;
        let sorted = |indices: &[u32]| {
            let mut all: Vec<[u32; 3]> =
                indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
            all.sort_unstable();
            all
        };
        let (before, set) = (misses(&indices, count), sorted(&indices));
        triangles(&mut indices, count);
        assert_eq!(sorted(&indices), set);
        assert!(misses(&indices, count) * 2 < before, "{} {before}", misses(&indices, count));
        let old_of = vertices(&mut indices, count);
        assert_eq!(old_of.len(), count);
        assert_eq!(indices[0], 0);
    }
}
