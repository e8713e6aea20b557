//! The numbers of added assets, and what a scene has at them.

use std::ops::Range;

use polyptych_files::blob::BlobHash;

use super::{EditError, SceneOutline};
use crate::edit::AssetSet;
use crate::scene_edits::SceneEdits;

/// Maximum number of meshes, materials or textures of a scene. Numbers count that nothing has and
/// that lie before others: an entry of each is kept.
const ASSETS_MAX: u32 = 1 << 20;

/// Returns the first number from `own` on at which so many follow that are in no range.
fn first_gap(own: u32, count: u32, taken: impl Iterator<Item = Range<u32>>) -> u32 {
    let mut taken: Vec<Range<u32>> = taken.filter(|range| !range.is_empty()).collect();
    taken.sort_unstable_by_key(|range| range.start);
    let mut first = own;
    for range in taken {
        if range.start >= first.saturating_add(count) {
            break;
        }
        first = first.max(range.end);
    }
    first
}

impl SceneOutline {
    /// Returns the numbers that added assets get: of each kind the first gap behind those of the
    /// scene's file that is large enough, so that the numbers of what has gone are given again.
    /// `primitives` are those of each mesh.
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
        let first = |own: u32, count: u32, range: fn(&AssetSet) -> Range<u32>| {
            first_gap(own, count, edits.assets().map(range))
        };
        let (own_meshes, meshes) = (self.meshes.len() as u32, primitives.len() as u32);
        let set = AssetSet {
            manifest,
            first_mesh: first(own_meshes, meshes, AssetSet::mesh_range),
            primitives,
            first_material: first(self.materials, materials, AssetSet::material_range),
            materials,
            first_texture: first(self.textures, textures, AssetSet::texture_range),
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
