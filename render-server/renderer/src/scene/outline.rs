//! Edges and vertices of triangles, for nodes whose style shows only these, and triangles that are
//! drawn in the order of their distances.
//!
//! Lines are drawn from indices, and not by a GPU that fills no polygons: that is an option which
//! not every GPU has, and it would draw an edge of two triangles twice.

use std::collections::HashMap;
use std::ops::Deref;

use polyptych_scene::{Fill, Primitive, Topology};

/// A primitive of which edges or vertices are drawn, or whose triangles are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Outline {
    /// The slot of its geometry.
    pub slot: usize,
    /// [`Fill::Solid`] where its triangles are blended.
    pub fill: Fill,
    /// One of the meshes that have it, and its index there.
    pub mesh: usize,
    pub primitive: usize,
}

/// The outlines of a layout, each once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Outlines {
    all: Vec<Outline>,
    /// The indices of those of each slot that has any: one for each fill at most.
    of_slots: HashMap<usize, Vec<usize>>,
}

impl Outlines {
    /// Returns the index of an outline of its slot and fill, which is added if there is none.
    pub fn add(&mut self, outline: Outline) -> usize {
        let of_slot = self.of_slots.entry(outline.slot).or_default();
        let known = of_slot.iter().copied().find(|at| self.all[*at].fill == outline.fill);
        known.unwrap_or_else(|| {
            self.all.push(outline);
            of_slot.push(self.all.len() - 1);
            self.all.len() - 1
        })
    }

    /// The indices of the outlines of a slot.
    pub fn of_slot(&self, slot: usize) -> &[usize] {
        self.of_slots.get(&slot).map_or(&[][..], Vec::as_slice)
    }
}

impl Deref for Outlines {
    type Target = [Outline];

    fn deref(&self) -> &Self::Target {
        &self.all
    }
}

/// The topology that is drawn of a primitive in a style, if that is not all of it.
pub(super) fn drawn(topology: Topology, fill: Fill) -> Option<Topology> {
    match (fill, topology) {
        (Fill::Wireframe, Topology::Triangles) => Some(Topology::Lines),
        (Fill::Points, Topology::Triangles | Topology::Lines) => Some(Topology::Points),
        _ => None,
    }
}

/// The indices of the edges or vertices of the finest level in a primitive's checked bytes, each
/// once, in the order of their numbers.
pub(super) fn indices(desc: &Primitive, bytes: &[u8], fill: Fill) -> Vec<u32> {
    let of_primitive = desc.finest_indices_of(bytes);
    let all: Vec<u32> = desc.index_format.numbers(&of_primitive).collect();
    if fill != Fill::Wireframe {
        let mut all = all;
        all.sort_unstable();
        all.dedup();
        return all;
    }
    let edges = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]];
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let mut edges: Vec<[u32; 2]> =
        all.as_chunks::<3>().0.iter().flat_map(edges).map(sorted).collect();
    edges.sort_unstable();
    edges.dedup();
    edges.retain(|[a, b]| a != b);
    edges.into_flattened()
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use polyptych_files::blob::BlobHash;
    use polyptych_scene::{IndexFormat, VertexLayout};

    use super::*;

    fn quad(index_format: IndexFormat) -> (Primitive, Vec<u8>) {
        // Two triangles with one edge in common, and one that is a point.
        let finest = [3u32, 1, 0, 0, 1, 2, 2, 2, 2];
        // Behind the finest level, and of no outline.
        let indices = finest.into_iter().chain([1, 3, 2]);
        let primitive = Primitive {
            blob: BlobHash([0; 32]),
            layout: VertexLayout::default(),
            vertex_count: 4,
            index_count: finest.len() as u32,
            coarser_index_count: 3,
            meshlet_count: 0,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
            index_format,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::ZERO,
            min: Vec3::ZERO,
            max: Vec3::ONE,
        };
        let mut bytes = vec![0; primitive.vertex_bytes() as usize];
        for index in indices {
            match index_format {
                IndexFormat::U16 => bytes.extend((index as u16).to_le_bytes()),
                IndexFormat::U32 => bytes.extend(index.to_le_bytes()),
            }
        }
        (primitive, bytes)
    }

    #[test]
    fn outlines_are_found_by_slot_and_fill() {
        let fills = [Fill::Wireframe, Fill::Points, Fill::Solid];
        let mut outlines = Outlines::default();
        for at in (0..1000).chain(0..1000) {
            // Slots come back after others, and not each has all fills.
            let (slot, fill) = (at * 7 % 40, fills[at % 4 % 3]);
            let known = outlines.iter().position(|of| of.slot == slot && of.fill == fill);
            let wanted = known.unwrap_or(outlines.len());
            assert_eq!(outlines.add(Outline { slot, fill, mesh: at, primitive: 0 }), wanted);
        }
        for slot in 0..41 {
            let all = outlines.iter().enumerate().filter(|(_, of)| of.slot == slot);
            let wanted: Vec<usize> = all.map(|(at, _)| at).collect();
            assert_eq!(outlines.of_slot(slot), wanted, "slot {slot}");
        }
    }

    #[test]
    fn each_edge_and_each_vertex_comes_once() {
        for format in [IndexFormat::U16, IndexFormat::U32] {
            let (desc, bytes) = quad(format);
            let edges = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]].concat();
            assert_eq!(indices(&desc, &bytes, Fill::Wireframe), edges);
            assert_eq!(indices(&desc, &bytes, Fill::Points), [0, 1, 2, 3]);
        }
    }
}
