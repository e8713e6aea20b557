//! The numbers of added assets, and what a scene has at them.

use std::ops::Range;

use polyptych_files::blob::BlobHash;

use super::{EditError, SceneOutline};
use crate::edit::AssetSet;
use crate::scene_edits::SceneEdits;

/// Most meshes, materials or textures of a scene, those included that were added and are gone: an
/// entry of each is kept.
const ASSETS_MAX: u32 = 1 << 20;

impl SceneOutline {
    /// The numbers that added assets get: behind all that are there. `primitives` are those of each
    /// mesh.
    ///
    /// # Errors
    /// [`EditError::TooLarge`].
    pub fn place_assets(
        &self,
        edits: &SceneEdits,
        manifest: BlobHash,
        primitives: Vec<u32>,
        [materials, textures]: [u32; 2],
    ) -> Result<AssetSet, EditError> {
        let end = |own: u32, range: fn(&AssetSet) -> Range<u32>| {
            edits.assets().map(|set| range(set).end).fold(own, u32::max)
        };
        let set = AssetSet {
            manifest,
            first_mesh: end(self.meshes.len() as u32, AssetSet::mesh_range),
            primitives,
            first_material: end(self.materials, AssetSet::material_range),
            materials,
            first_texture: end(self.textures, AssetSet::texture_range),
            textures,
        };
        let ends = [set.mesh_range(), set.material_range(), set.texture_range()].map(|of| of.end);
        if ends.into_iter().any(|end| end > ASSETS_MAX) {
            return Err(EditError::TooLarge(format!(
                "the scene would have more than {ASSETS_MAX} meshes, materials or textures"
            )));
        }
        Ok(set)
    }

    /// Returns whether a mesh is there.
    pub(super) fn has_mesh(&self, edits: &SceneEdits, mesh: u32) -> bool {
        (mesh as usize) < self.meshes.len()
            || edits.assets().any(|set| set.mesh_range().contains(&mesh))
    }

    /// Returns the number of primitives of a mesh, if it is there. `sets` are those that were
    /// added, in the order of their meshes.
    pub(super) fn primitives(&self, sets: &[&AssetSet], mesh: u32) -> Option<u32> {
        self.meshes.get(mesh as usize).copied().or_else(|| {
            let before = sets.partition_point(|set| set.first_mesh <= mesh);
            let set = sets[..before].last()?;
            set.primitives.get((mesh - set.first_mesh) as usize).copied()
        })
    }
}
