//! The order of levels in a blob: what is needed longest as finer levels are left out stands first.
//!
//! A cut at a level L shows each part of the surface by its finest meshlet of a level of at least
//! L, or by the coarsest one that there is. A meshlet is needed for that, or for something coarser,
//! if what replaces it has a level above L. So meshlets in the order of the level that replaces
//! them, the highest first, have every cut as a beginning. All primitives of a mesh are cut at the
//! same levels: groups of meshlets reach over their borders, and are replaced as a whole.

use polyptych_scene::LevelCut;

use super::Levels;

/// Minimum growth of the triangles from one kept cut to the next finer one: less spares too little
/// memory to be worth its entry in the manifest.
const GROWTH_MIN: f64 = 1.5;

/// Maximum number of kept levels of a mesh: see [`polyptych_scene::CUTS_MAX`].
const KEPT_MAX: usize = polyptych_scene::CUTS_MAX;

/// Puts meshlets and their indices into the order of the blob; `first_index` of a meshlet stays its
/// place in the order of drawing.
pub(crate) fn ordered(levels: Levels) -> Levels {
    let mut order: Vec<usize> = (0..levels.meshlets.len()).collect();
    order.sort_by_key(|at| std::cmp::Reverse(levels.replaced_at[*at]));
    let mut indices = Vec::with_capacity(levels.indices.len());
    for at in &order {
        let meshlet = &levels.meshlets[*at];
        let first = meshlet.first_index as usize;
        indices.extend_from_slice(&levels.indices[first..first + meshlet.index_count as usize]);
    }
    let meshlets = order.iter().map(|at| levels.meshlets[*at]).collect();
    let replaced_at = order.iter().map(|at| levels.replaced_at[*at]).collect();
    Levels { indices, meshlets, replaced_at, ..levels }
}

/// Returns the levels at which the surfaces of a mesh are cut, the coarsest first.
pub(crate) fn kept_levels(surfaces: &[Option<Levels>]) -> Vec<u32> {
    let all = || surfaces.iter().flatten();
    let coarsest = all().flat_map(|of| of.meshlets.iter().map(|meshlet| meshlet.level)).max();
    let whole = all().map(|of| of.indices.len() as u64).sum::<u64>() as f64;
    let mut kept = Vec::new();
    let mut least = 0.0;
    for level in (1..=coarsest.unwrap_or(0)).rev() {
        let at_level: Vec<LevelCut> = all().flat_map(|of| cuts(of, &[level])).collect();
        let indices = at_level.iter().map(LevelCut::index_count_of_all).sum::<u64>() as f64;
        // A part without a triangle has no place on a GPU.
        let has_all = at_level.iter().all(|cut| cut.index_count > 0);
        if has_all && indices >= least && indices * GROWTH_MIN <= whole && kept.len() < KEPT_MAX {
            kept.push(level);
            least = indices * GROWTH_MIN;
        }
    }
    kept
}

/// The cuts of a surface at these levels, whose vertices have yet to be counted.
pub(crate) fn cuts(levels: &Levels, at: &[u32]) -> Vec<LevelCut> {
    let cut = |&level: &u32| {
        let mut cut = LevelCut {
            level,
            vertex_count: 0,
            index_count: 0,
            coarser_index_count: 0,
            meshlet_count: 0,
            error: 0.0,
        };
        for (meshlet, replaced_at) in levels.meshlets.iter().zip(&levels.replaced_at) {
            if *replaced_at <= level {
                // Also where nothing of this surface is left to say so.
                cut.error = cut.error.max(meshlet.coarser_error);
                continue;
            }
            cut.meshlet_count += 1;
            if meshlet.level <= level {
                cut.index_count += meshlet.index_count;
                cut.error = cut.error.max(meshlet.error);
            } else {
                cut.coarser_index_count += meshlet.index_count;
            }
        }
        cut
    };
    at.iter().map(cut).collect()
}
