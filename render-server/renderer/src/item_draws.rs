//! The draw calls of items: the levels of detail of their meshlets, without those that cannot show.

use glam::DVec3;

use super::cull::FrustumPlanes;
use super::draw_list::Draw;
use super::error_tolerance::{ErrorTolerance, ItemErrors};
use super::pipeline::Cull;
use super::scene::{MeshletCull, Meshlets, Stance, TriangleOrder, joined};
use super::seen_from::SeenFrom;
use super::view::ViewDesc;

/// Fewer indices than this that follow each other are drawn without a look at which of them show:
/// it would cost more than it saves, and instances that are seen from different sides would no
/// longer be one draw.
const CULLED_INDICES_MIN: u32 = 3 * 2048;

/// The context that all items of a list share.
#[derive(Debug)]
pub(crate) struct ItemDraws<'a> {
    pub view: &'a ViewDesc,
    pub seen_from: SeenFrom<'a>,
    pub planes: &'a FrustumPlanes,
    pub tolerance: ErrorTolerance,
    /// Meshlets are drawn whichever way they face.
    pub both_sides: bool,
}

/// The draws of items that follow each other in a list.
#[derive(Debug, Default)]
pub(crate) struct SomeDraws {
    pub draws: Vec<Draw>,
    /// Indices of triangles in the order of their distances.
    pub ordered_indices: Vec<u32>,
    pub triangles: u64,
    /// See [`DrawnItem::error_share`].
    pub error_share: f64,
}

/// Room for the parts of an item.
#[derive(Debug, Default)]
struct Room {
    /// Meshlets that are drawn, by their places.
    chosen: Vec<u32>,
    /// Runs of indices.
    runs: Vec<Draw>,
    /// Depths of triangles.
    depths: Vec<(u64, u32)>,
}

/// The drawn part of an item.
#[derive(Clone, Copy, Debug)]
struct DrawnItem {
    /// Within the rectangle, whichever way they face.
    triangles: u64,
    /// The largest error as a share of what is allowed: 0 to 1, or more where finer levels are not
    /// held. In pixels if nothing is allowed.
    error_share: f64,
}

impl ItemDraws<'_> {
    /// The draws of items, given with their batches, whose records begin at a place; of an item
    /// those of its back faces come first if it has any.
    pub fn of(&self, items: &[(u32, u32)], mut first: u32) -> SomeDraws {
        let mut room = Room::default();
        let mut all = SomeDraws::default();
        for of_batch in items.chunk_by(|(_, a), (_, b)| a == b) {
            if let Some(whole) = self.whole(of_batch[0].1, (first, of_batch.len() as u32)) {
                let scene = self.seen_from.scene;
                let of_each = scene.layout.batches[whole.batch as usize].triangles;
                all.triangles += of_each * of_batch.len() as u64;
                extend(&mut all.draws, whole);
            } else {
                for (first, &(item, batch)) in (first..).zip(of_batch) {
                    self.add_item((item, batch), first, &mut room, &mut all);
                }
            }
            first += of_batch.len() as u32;
        }
        all
    }

    /// The one draw of so many items of a batch, if all of them are drawn whole whatever their
    /// places are.
    fn whole(&self, batch: u32, (first, count): (u32, u32)) -> Option<Draw> {
        let scene = self.seen_from.scene;
        let geometry = scene.geometry_of(batch);
        let of = &scene.layout.batches[batch as usize];
        let has_levels = geometry.meshlets.as_ref().is_some_and(|meshlets| {
            let is_small = geometry.index_count < CULLED_INDICES_MIN;
            !(is_small && self.tolerance.is_zero() && meshlets.is_held_whole())
        });
        let is_whole = !has_levels && of.back_pipeline.is_none() && scene.order_of(batch).is_none();
        let indices = [0, geometry.index_count];
        let pipeline = of.pipeline;
        is_whole.then_some(Draw { batch, pipeline, first, count, indices, ordered: false })
    }

    /// Adds the draws of an item whose record is in a place.
    fn add_item(
        &self,
        (index, batch): (u32, u32),
        first: u32,
        room: &mut Room,
        all: &mut SomeDraws,
    ) {
        let scene = self.seen_from.scene;
        let (_, stance, origin) = self.seen_from.place(index);
        let place = (&*stance, origin);
        let of = &scene.layout.batches[batch as usize];
        let indices = [0, scene.geometry_of(batch).index_count];
        let pipeline = of.pipeline;
        let whole = Draw { batch, pipeline, first, count: 1, indices, ordered: false };
        let drawn = if let Some((triangles, pipeline)) = scene.order_of(batch) {
            let whole = Draw { pipeline, ..whole };
            room.runs.clear();
            let drawn = self.add(place, whole, (&mut room.chosen, &mut room.runs));
            let indices = &mut all.ordered_indices;
            all.draws.extend(self.in_order((triangles, place), whole, room, indices));
            drawn
        } else {
            let Room { chosen, .. } = room;
            if let Some(pipeline) = of.back_pipeline {
                let back = Draw { pipeline, ..whole };
                self.add(place, back, (&mut *chosen, &mut all.draws));
            }
            self.add(place, whole, (chosen, &mut all.draws))
        };
        all.triangles += drawn.triangles;
        all.error_share = all.error_share.max(drawn.error_share);
    }

    /// Puts the triangles in the runs of an item in the order of their distances, and appends their
    /// indices; `None` without any.
    fn in_order(
        &self,
        (triangles, (stance, origin)): (&TriangleOrder, (&Stance, DVec3)),
        whole: Draw,
        room: &mut Room,
        indices: &mut Vec<u32>,
    ) -> Option<Draw> {
        let first = indices.len() as u32;
        let geometry = self.seen_from.scene.geometry_of(whole.batch);
        let bent = geometry.bent.as_ref().and_then(|bent| bent.positions());
        let runs = room.runs.iter().map(|run| run.indices);
        let depth = |at: DVec3| self.view.point_depth(origin + stance.linear * at);
        triangles.append((runs, bent.as_deref()), depth, (&mut room.depths, indices));
        let count = indices.len() as u32 - first;
        (count > 0).then_some(Draw { indices: [first, count], ordered: true, ..whole })
    }

    /// Appends the draws of an item, which stands with its origin in world space; `whole` is that
    /// of all of it.
    fn add(
        &self,
        (stance, origin): (&Stance, DVec3),
        whole: Draw,
        (chosen, draws): (&mut Vec<u32>, &mut Vec<Draw>),
    ) -> DrawnItem {
        let scene = self.seen_from.scene;
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
        self.add_meshlets((stance, origin), whole, (meshlets, &errors), (chosen, draws))
    }

    /// Appends the draws of meshlets of several levels, or of so many that some may not show.
    fn add_meshlets(
        &self,
        (stance, origin): (&Stance, DVec3),
        whole: Draw,
        (meshlets, errors): (&Meshlets, &ItemErrors),
        (chosen, draws): (&mut Vec<u32>, &mut Vec<Draw>),
    ) -> DrawnItem {
        let cull = self.seen_from.scene.layout.keys[whole.pipeline as usize].cull;
        let culls_back = cull == Cull::Back && !self.both_sides;
        let cull = (whole.indices[1] >= CULLED_INDICES_MIN)
            .then(|| MeshletCull::new(self.planes, &stance.linear, origin, culls_back));
        chosen.clear();
        let error_share = meshlets.choose(errors, cull.as_ref(), chosen);
        let chosen = || chosen.iter().map(|&at| meshlets.get(at));
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

/// Lengthens the last draw by one whose items follow and are drawn alike, or appends it. Items stay
/// in their order: all of one is drawn before anything of the next.
pub(crate) fn extend(draws: &mut Vec<Draw>, draw: Draw) {
    match draws.last_mut() {
        Some(last)
            if last.batch == draw.batch
                && last.pipeline == draw.pipeline
                && last.indices == draw.indices
                && last.ordered == draw.ordered
                && last.first + last.count == draw.first =>
        {
            last.count += draw.count;
        }
        _ => draws.push(draw),
    }
}
