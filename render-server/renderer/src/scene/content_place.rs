//! The places of bytes in a scene.

/// A place for bytes in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContentPlace {
    /// A texture, by its index.
    Texture {
        /// In the scene's textures.
        index: usize,
    },
    /// A primitive of a mesh.
    Primitive {
        /// Its index in the scene's meshes.
        mesh: usize,
        /// Its index in the mesh's primitives.
        primitive: usize,
    },
    /// The data that move the vertices of a primitive, which has its place before.
    Deformer {
        /// Its index in the scene's meshes.
        mesh: usize,
        /// Its index in the mesh's primitives.
        primitive: usize,
    },
}
