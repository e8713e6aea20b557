//! The boxes of batches in the parts of a scene below its nodes.
//!
//! A view of a part has many lists of draws in each frame, and a million items must be looked at
//! for the boxes that order them: they are found once for each state of a scene.

use std::sync::{Arc, Mutex, PoisonError};

use super::GpuScene;
use super::draw_item::Bounds;
use super::subset::Selection;

/// Maximum number of parts whose boxes are kept, the latest ones: 5 MB each of 100,000 batches.
const PARTS_MAX: usize = 8;

/// The boxes of the parts that were asked for, of one state of a scene; clones share them.
#[derive(Clone, Debug, Default)]
pub(super) struct PartBounds {
    known: Arc<Mutex<Vec<KnownPart>>>,
}

/// A part with its boxes.
#[derive(Debug)]
struct KnownPart {
    /// Its places in the tree, from the first to before the last.
    places: [u32; 2],
    /// One for each batch.
    bounds: Arc<[Bounds]>,
}

impl GpuScene {
    /// Around the items of each batch that are in a part of it; `None` if it has all places.
    pub(crate) fn batch_bounds_of(&self, part: Selection) -> Option<Arc<[Bounds]>> {
        let places = part.places()?;
        // Held while they are found: another thread may want the same.
        let mut known = self.part_bounds.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(part) = known.iter().find(|known| known.places == places) {
            return Some(Arc::clone(&part.bounds));
        }
        let bounds: Arc<[Bounds]> = self.bounds_within(part).into();
        if known.len() == PARTS_MAX {
            known.remove(0);
        }
        known.push(KnownPart { places, bounds: Arc::clone(&bounds) });
        Some(bounds)
    }

    fn bounds_within(&self, part: Selection) -> Vec<Bounds> {
        let mut all = vec![Bounds::EMPTY; self.layout.batches.len()];
        for index in 0..self.layout.items.len() as u32 {
            let (item, _, bounds) = self.item(index);
            let is_hidden = || self.moved.as_ref().is_some_and(|moved| moved.hides(index));
            if part.has_place(item.place) && !is_hidden() {
                let batch = &mut all[item.batch as usize];
                *batch = batch.union(*bounds);
            }
        }
        all
    }

    /// The number of parts whose boxes are known.
    #[cfg(test)]
    pub(crate) fn known_parts(&self) -> usize {
        self.part_bounds.known.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}
