//! Triangles that replace others, and which of several to take.

use super::clustering::MovedVertex;

/// Errors that differ by less than this factor are nearly alike.
const ALIKE: f64 = 1.3;

/// A patch with fewer triangles.
#[derive(Debug)]
pub(super) struct Simplified {
    /// Three for each triangle, as the piece numbers vertices, and behind them those of `added`.
    pub indices: Vec<u32>,
    /// Vertices that the piece has not.
    pub added: Vec<MovedVertex>,
    /// An upper bound of the distance between each surface before and after, in both directions.
    /// Connected parts of a surface that are removed as a whole, as windows in a wall, count by
    /// their distance to what is left of all surfaces, and by their width, which is how far their
    /// outline moves; those side by side by the width of all together. Or how far a texture
    /// slides, if that is more. Above 0, in units of the primitive's space.
    pub error: f64,
    /// The largest angle by which the normal at a removed vertex differs, in radians.
    pub normal_angle: f64,
}

impl Simplified {
    /// Numbers its vertices as these are: those of a list, and from `first_added` on those that it
    /// adds.
    pub fn give_numbers(&mut self, vertices: &[u32], first_added: u32) {
        let number = |at: u32| {
            let beyond = first_added + at.saturating_sub(vertices.len() as u32);
            vertices.get(at as usize).copied().unwrap_or(beyond)
        };
        self.indices.iter_mut().for_each(|index| *index = number(*index));
        for vertex in &mut self.added {
            for of in [&mut vertex.from, &mut vertex.at, &mut vertex.origin] {
                *of = number(*of);
            }
        }
    }
}

/// Returns the better one of two ways to simplify: that of the smaller error, or of fewer triangles
/// where errors are nearly alike.
pub(super) fn best(one: Option<Simplified>, two: Option<Simplified>) -> Option<Simplified> {
    let (one, two) = match (one, two) {
        (Some(one), Some(two)) => (one, two),
        (one, two) => return one.or(two),
    };
    let is_alike = one.error.max(two.error) <= one.error.min(two.error) * ALIKE;
    let is_first =
        if is_alike { one.indices.len() <= two.indices.len() } else { one.error < two.error };
    Some(if is_first { one } else { two })
}

/// Returns the error beyond which [`best`] prefers what was found to any other way.
pub(super) fn error_worth_measuring(found: Option<&Simplified>) -> f64 {
    found.map_or(f64::INFINITY, |found| found.error * ALIKE)
}
