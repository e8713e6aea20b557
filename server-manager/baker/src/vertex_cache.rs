//! The order of triangles and vertices: neighbours in space become neighbours in memory.
//!
//! Triangles are ordered by Tipsify (Sander, Nehab, Barczak: "Fast Triangle Reordering for
//! Vertex Locality and Reduced Overdraw", SIGGRAPH 2007) in linear time; vertices
//! follow in the order of their first use.

/// Vertices that a processor is taken to remember: small, so that the order serves all of them.
pub(super) const CACHE: u32 = 16;

/// Orders a list of triangles over `vertices` vertices, unless it is already better than that.
pub(super) fn triangles(indices: &mut Vec<u32>, vertices: usize) {
    let ordered = meshopt::optimize_vertex_cache_fifo(indices, vertices, CACHE);
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

/// Returns the number of vertices that a first-in-first-out cache must fetch.
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
