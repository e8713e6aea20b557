//! The items of a scene that may look otherwise from frame to frame: all others stand still.

use std::sync::Arc;

use polyptych_scene::{AlphaMode, ChangedMaterial};

use super::GpuScene;
use super::draw_item::{DrawItem, Stance};
use super::items_by_batch::ItemsByBatch;
use super::layout::SceneLayout;
use crate::cull::FrustumPlanes;

/// The items of a layout that are moved, or that clips paint anew. Those that turn towards the
/// viewer move too; they are known by the layout.
#[derive(Clone, Debug, Default)]
pub(crate) struct MovingItems {
    /// A bit for each item of the layout that is moved or hidden; `None` if there are none.
    moved: Option<Arc<[u64]>>,
    /// Items with masks whose material is changed by clips, rising.
    painted: Arc<[u32]>,
}

impl PartialEq for MovingItems {
    fn eq(&self, other: &Self) -> bool {
        let is_moved_alike = match (&self.moved, &other.moved) {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other) || one == other,
            (one, other) => one.is_none() && other.is_none(),
        };
        is_moved_alike && self.painted == other.painted
    }
}

impl MovingItems {
    /// The items with masks in these materials of a layout, rising.
    pub fn painted(layout: &SceneLayout, materials: &[ChangedMaterial]) -> Arc<[u32]> {
        let of_scene = layout.desc.materials.len();
        let has_mask = |material: u32| {
            let styled = || layout.styled.get((material as usize).checked_sub(of_scene + 1)?);
            let own = styled().map_or(material, |of| of.material);
            let desc = layout.desc.materials.get(own as usize);
            desc.is_some_and(|of| matches!(of.alpha_mode, AlphaMode::Mask(_)))
                && materials.iter().any(|changed| changed.material == own)
        };
        let mut items = Vec::new();
        if !materials.is_empty() {
            for (batch, of) in layout.batches.iter().enumerate() {
                if has_mask(of.material) {
                    items.extend_from_slice(layout.items_by_batch().of_batch(batch));
                }
            }
        }
        items.sort_unstable();
        items.into()
    }
}

/// Items that turn with a billboard, rising.
pub(super) fn turning_items(items: &[DrawItem], stances: &[Stance]) -> Vec<u32> {
    let is_turning = |item: &DrawItem| stances[item.stance as usize].billboard.is_some();
    (0..).zip(items).filter(|(_, item)| is_turning(item)).map(|(index, _)| index).collect()
}

impl SceneLayout {
    /// The indices of the items of a described node; `None` if there is no such node.
    pub(super) fn items_of(&self, node: u32) -> Option<std::ops::Range<u32>> {
        let at = node as usize;
        Some(*self.first_items.get(at)?..*self.first_items.get(at + 1)?)
    }

    /// The items of each batch.
    pub(super) fn items_by_batch(&self) -> &ItemsByBatch {
        let make = || ItemsByBatch::new(&self.items, &self.bounds, self.batches.len());
        self.by_batch.get_or_init(make)
    }
}

impl GpuScene {
    /// The items that may look otherwise in the next frame.
    pub(crate) fn moving(&self) -> MovingItems {
        let moved = self.moved.as_ref().map(|moved| Arc::clone(moved.bits()));
        MovingItems { moved, painted: Arc::clone(&self.painted) }
    }

    /// Returns whether any item may look otherwise in the next frame.
    pub(crate) fn has_moving(&self) -> bool {
        self.moved.is_some() || !self.layout.turning.is_empty() || !self.painted.is_empty()
    }

    /// Returns whether an item may look otherwise in the next frame.
    pub(crate) fn is_moving(&self, item: u32) -> bool {
        self.moved.as_ref().is_some_and(|moved| moved.holds(item))
            || self.layout.turning.binary_search(&item).is_ok()
            || self.painted.binary_search(&item).is_ok()
    }

    /// Appends those of the moving items that may be visible, in no particular order.
    pub(crate) fn visible_moving(&self, planes: &FrustumPlanes, found: &mut Vec<u32>) {
        let moved = self.moved.as_ref();
        let may_be_seen = |item: &u32| {
            let bounds = &self.layout.bounds[*item as usize];
            !moved.is_some_and(|moved| moved.holds(*item))
                && planes.test(bounds.center(), bounds.half(), FrustumPlanes::ALL).is_some()
        };
        let turning = &self.layout.turning;
        let painted = self.painted.iter().filter(|item| turning.binary_search(item).is_err());
        found.extend(turning.iter().chain(painted).filter(|item| may_be_seen(item)));
        if let Some(moved) = moved {
            moved.visible(planes, found);
        }
    }
}
