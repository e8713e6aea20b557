//! The draw calls of an item: the levels of detail of its meshlets, without those that cannot show.

use glam::DVec3;

use super::cull::FrustumPlanes;
use super::draw_list::Draw;
use super::error_tolerance::{ErrorTolerance, ItemErrors};
use super::pipeline::Cull;
use super::scene::{GpuScene, MeshletCull, Meshlets, Stance, joined};

/// Fewer indices than this that follow each other are drawn without a look at which of them show:
/// it would cost more than it saves, and instances that are seen from different sides would no
/// longer be one draw.
const CULLED_INDICES_MIN: u32 = 3 * 2048;

/// The context that all items of a view share.
#[derive(Debug)]
pub(crate) struct ItemDraws<'a> {
    pub scene: &'a GpuScene,
    pub planes: &'a FrustumPlanes,
    pub tolerance: ErrorTolerance,
    /// Meshlets are drawn whichever way they face.
    pub both_sides: bool,
    /// Room for the meshlets of an item.
    pub chosen: &'a mut Vec<u32>,
}

/// The drawn part of an item.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawnItem {
    /// Within the rectangle, whichever way they face.
    pub triangles: u64,
    /// The largest error as a share of what is allowed: 0 to 1, or more where finer levels are not
    /// held. In pixels if nothing is allowed.
    pub error_share: f64,
}

impl ItemDraws<'_> {
    /// Appends the draws of an item, which stands with its origin in world space; `whole` is that
    /// of all of it.
    pub fn add(
        &mut self,
        (stance, origin): (&Stance, DVec3),
        whole: Draw,
        draws: &mut Vec<Draw>,
    ) -> DrawnItem {
        let scene = self.scene;
        let geometry = scene.geometry_of(whole.batch);
        let Some(meshlets) = &geometry.meshlets else {
            extend(draws, whole);
            let triangles = scene.layout.batches[whole.batch as usize].triangles;
            return DrawnItem { triangles, error_share: 0.0 };
        };
        let errors = self.tolerance.of_item(origin, stance);
        if let Some(run) = meshlets.one_level(&errors)
            && run.indices[1] < CULLED_INDICES_MIN
        {
            extend(draws, Draw { indices: run.indices, ..whole });
            let triangles = u64::from(run.indices[1] / 3);
            return DrawnItem { triangles, error_share: run.error_share };
        }
        self.add_meshlets((stance, origin), whole, (meshlets, &errors), draws)
    }

    /// Appends the draws of meshlets of several levels, or of so many that some may not show.
    fn add_meshlets(
        &mut self,
        (stance, origin): (&Stance, DVec3),
        whole: Draw,
        (meshlets, errors): (&Meshlets, &ItemErrors),
        draws: &mut Vec<Draw>,
    ) -> DrawnItem {
        let cull = self.scene.layout.keys[whole.pipeline as usize].cull;
        let culls_back = cull == Cull::Back && !self.both_sides;
        let cull = (whole.indices[1] >= CULLED_INDICES_MIN)
            .then(|| MeshletCull::new(self.planes, &stance.linear, origin, culls_back));
        self.chosen.clear();
        let error_share = meshlets.choose(errors, cull.as_ref(), self.chosen);
        let chosen = || self.chosen.iter().map(|&at| meshlets.get(at));
        let is_small = joined(chosen()).is_some_and(|[_, count]| count < CULLED_INDICES_MIN);
        let cull = cull.filter(|_| !is_small);
        let mut triangles = 0;
        let mut run: Option<[u32; 2]> = None;
        for meshlet in chosen() {
            if cull.as_ref().is_some_and(|cull| !cull.may_show_meshlet(meshlet)) {
                continue;
            }
            triangles += u64::from(meshlet.index_count / 3);
            if cull.as_ref().is_some_and(|cull| cull.hides(meshlet)) {
                continue;
            }
            let own = [meshlet.first_index, meshlet.index_count];
            match &mut run {
                Some([first, count]) if *first + *count == own[0] => *count += own[1],
                _ => {
                    if let Some(indices) = run.replace(own) {
                        extend(draws, Draw { indices, ..whole });
                    }
                }
            }
        }
        if let Some(indices) = run {
            extend(draws, Draw { indices, ..whole });
        }
        DrawnItem { triangles, error_share }
    }
}

/// Lengthens the last draw by an item that follows it and is drawn alike, or begins another. Items
/// stay in their order: all of one is drawn before anything of the next.
fn extend(draws: &mut Vec<Draw>, draw: Draw) {
    match draws.last_mut() {
        Some(last)
            if last.batch == draw.batch
                && last.pipeline == draw.pipeline
                && last.indices == draw.indices
                && last.first + last.count == draw.first =>
        {
            last.count += 1;
        }
        _ => draws.push(draw),
    }
}
