//! Slots of the contents of a scene: equal ones are on the GPU once.

use std::collections::HashMap;

use polyptych_files::blob::BlobHash;
use polyptych_scene::{
    IndexFormat, Mesh, Primitive, Scene, Texture, TextureFormat, Topology, VertexLayout,
};

/// The slots of described things; equal ones share one.
#[derive(Debug)]
pub(super) struct Slots {
    /// Slot of each described thing, in the order of the description.
    pub of: Vec<usize>,
    pub count: usize,
}

impl Slots {
    pub fn new<K: std::hash::Hash + Eq>(names: impl Iterator<Item = K>) -> Self {
        let (mut of, mut count) = (Vec::new(), 0);
        let mut known = HashMap::new();
        for name in names {
            let next = count;
            let slot = *known.entry(name).or_insert(next);
            count += usize::from(slot == next);
            of.push(slot);
        }
        Self { of, count }
    }

    /// For each slot, that of the same name among others. `names` are those of what is described.
    pub fn shared<K: std::hash::Hash + Eq>(
        &self,
        names: impl Iterator<Item = K>,
        others: &HashMap<K, usize>,
    ) -> Vec<Option<usize>> {
        let mut shared = vec![None; self.count];
        for (name, &slot) in names.zip(&self.of) {
            shared[slot] = others.get(&name).copied();
        }
        shared
    }

    /// Returns the first described thing whose slot is empty.
    pub fn first_missing<T>(&self, filled: &[Option<T>]) -> Option<usize> {
        self.of.iter().position(|&slot| filled[slot].is_none())
    }
}

/// The name of a texture's slot: bytes, format, width, height and number of levels.
pub(super) type TextureName = (BlobHash, TextureFormat, [u32; 3]);

/// The name of a primitive's slot: bytes, layout, topology, and the numbers of vertices, indices,
/// indices of coarser levels, and meshlets; where clips bend it, its mesh too, which has vertices
/// of its own.
pub(super) type GeometryName =
    (BlobHash, (VertexLayout, Topology), IndexFormat, [u32; 4], Option<usize>);

/// Textures of one name share a slot.
pub(super) fn texture_name(t: &Texture) -> TextureName {
    (t.blob, t.format, [t.width, t.height, t.mip_count])
}

/// Primitives of a mesh. Those of one name share a slot.
pub(super) fn geometry_name(mesh: usize, p: &Primitive) -> GeometryName {
    let counts = [p.vertex_count, p.index_count, p.coarser_index_count, p.meshlet_count];
    // The bytes of points may be those of lines.
    let shape = (p.layout, p.topology);
    (p.blob, shape, p.index_format, counts, p.deformed.map(|_| mesh))
}

/// Returns the name of each primitive's slot.
pub(super) fn geometry_names(desc: &Scene) -> impl Iterator<Item = GeometryName> {
    let meshes = desc.meshes.iter().enumerate();
    meshes.flat_map(|(mesh, of)| of.primitives.iter().map(move |one| geometry_name(mesh, one)))
}

/// Returns the index of each mesh's first primitive in the order of all primitives.
pub(super) fn first_primitives(desc: &Scene) -> Vec<usize> {
    let mut next = 0;
    let first = |mesh: &Mesh| {
        next += mesh.primitives.len();
        next - mesh.primitives.len()
    };
    desc.meshes.iter().map(first).collect()
}
