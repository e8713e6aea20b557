//! What meets at the positions of a patch, which the simplifier must keep apart.

use meshopt::SimplifyVertex;

use super::Patch;

/// Triangles that meet at a position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Neighbors {
    /// A vertex of one of them.
    first: Option<u32>,
    /// They are of several surfaces, or a texture is mirrored there.
    is_border: bool,
    /// They have several texture coordinates, or tangents that are not alike.
    is_seam: bool,
}

impl Neighbors {
    /// Returns the flags of a vertex for the simplifier. Seams of textures may be given up if
    /// nothing can be spared otherwise, borders of surfaces never, nor where a texture is mirrored:
    /// a triangle across would be lit from sides where no light is.
    pub fn flags(self, is_locked: bool, keeps_seams: bool) -> SimplifyVertex {
        let Self { is_border, is_seam, .. } = self;
        let is_protected = is_border || (keeps_seams && is_seam);
        let protect = if is_protected { SimplifyVertex::Protect } else { SimplifyVertex::None };
        if is_locked { protect | SimplifyVertex::Lock } else { protect }
    }
}

impl Patch<'_> {
    /// What meets at each vertex in these triangles.
    pub(super) fn neighbors(&self, triangles: &[u32]) -> Vec<Neighbors> {
        let source = self.source;
        let mut all = vec![Neighbors::default(); self.vertices.len()];
        for &index in triangles {
            let vertex = self.vertices[index as usize];
            let of = &mut all[self.welded[index as usize] as usize];
            let first = *of.first.get_or_insert(vertex);
            of.is_border |= source.surface_of(vertex) != source.surface_of(first)
                || source.is_mirrored(vertex, first);
            of.is_seam |= of.is_border
                || source.uvs(vertex) != source.uvs(first)
                || !source.has_tangents_alike(vertex, first);
        }
        self.welded.iter().map(|at| all[*at as usize]).collect()
    }

    /// Returns whether a texture is mirrored at some corners of a triangle and not at others.
    pub(super) fn has_mixed(&self, triangles: &[u32]) -> bool {
        triangles.as_chunks::<3>().0.iter().any(|corners| {
            let [a, b, c] = corners.map(|index| self.vertices[index as usize]);
            self.source.is_mirrored(a, b) || self.source.is_mirrored(a, c)
        })
    }
}
