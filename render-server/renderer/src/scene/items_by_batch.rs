//! The items of each batch, so that a batch's box can be found again after some were moved.

use super::draw_item::{Bounds, DrawItem};

/// Items of a batch whose boxes are joined once: few enough to be looked at again where one of them
/// was moved, many enough that all joined boxes of a million items are few thousand.
const CHUNK_ITEMS: usize = 128;

/// The items in the order of their batches.
#[derive(Debug)]
pub(super) struct ItemsByBatch {
    /// Indices of items, rising within each batch.
    order: Vec<u32>,
    /// Place of each item in `order`.
    place: Vec<u32>,
    /// Place of each batch's first item in `order`, and the number of all items behind the last.
    first: Vec<u32>,
    /// Box around each chunk of a batch. A chunk holds items of one batch only.
    chunks: Vec<Bounds>,
    /// Index of each batch's first chunk, and the number of all chunks behind the last.
    first_chunk: Vec<u32>,
}

impl ItemsByBatch {
    /// Sorts the items of so many batches, whose boxes are given.
    pub fn new(items: &[DrawItem], bounds: &[Bounds], batches: usize) -> Self {
        let mut first = vec![0u32; batches + 1];
        for item in items {
            first[item.batch as usize + 1] += 1;
        }
        for batch in 0..batches {
            first[batch + 1] += first[batch];
        }
        let mut next = first.clone();
        let (mut order, mut place) = (vec![0; items.len()], Vec::with_capacity(items.len()));
        for (index, item) in (0..).zip(items) {
            let at = &mut next[item.batch as usize];
            order[*at as usize] = index;
            place.push(*at);
            *at += 1;
        }
        let (mut chunks, mut first_chunk) = (Vec::new(), vec![0]);
        for ends in first.windows(2) {
            let own = &order[ends[0] as usize..ends[1] as usize];
            chunks.extend(own.chunks(CHUNK_ITEMS).map(|chunk| around(chunk, |at| bounds[at])));
            first_chunk.push(chunks.len() as u32);
        }
        Self { order, place, first, chunks, first_chunk }
    }

    /// Returns the box around each batch where these items were moved, whose boxes are now given
    /// by `bounds`. `known` are the boxes of the batches before.
    pub fn moved(
        &self,
        items: &[DrawItem],
        known: impl Iterator<Item = Bounds>,
        moved: &[u32],
        bounds: impl Fn(usize) -> Bounds,
    ) -> Vec<Bounds> {
        let mut places: Vec<(u32, u32)> = moved
            .iter()
            .map(|&item| (items[item as usize].batch, self.chunk(items, item)))
            .collect();
        places.sort_unstable();
        places.dedup();
        let mut all: Vec<Bounds> = known.collect();
        for of_batch in places.chunk_by(|a, b| a.0 == b.0) {
            let batch = of_batch[0].0 as usize;
            let chunks = self.first_chunk[batch]..self.first_chunk[batch + 1];
            let mut changed = of_batch.iter().map(|(_, chunk)| *chunk).peekable();
            all[batch] = chunks.fold(Bounds::EMPTY, |all, chunk| {
                all.union(if changed.next_if_eq(&chunk).is_some() {
                    around(self.items_of(batch, chunk), &bounds)
                } else {
                    self.chunks[chunk as usize]
                })
            });
        }
        all
    }

    /// The items of a batch, as it was laid out, rising.
    pub fn of_batch(&self, batch: usize) -> &[u32] {
        &self.order[self.first[batch] as usize..self.first[batch + 1] as usize]
    }

    fn chunk(&self, items: &[DrawItem], item: u32) -> u32 {
        let batch = items[item as usize].batch as usize;
        let within = (self.place[item as usize] - self.first[batch]) as usize / CHUNK_ITEMS;
        self.first_chunk[batch] + within as u32
    }

    fn items_of(&self, batch: usize, chunk: u32) -> &[u32] {
        let own = &self.order[self.first[batch] as usize..self.first[batch + 1] as usize];
        let from = (chunk - self.first_chunk[batch]) as usize * CHUNK_ITEMS;
        &own[from..own.len().min(from + CHUNK_ITEMS)]
    }
}

fn around(items: &[u32], bounds: impl Fn(usize) -> Bounds) -> Bounds {
    items.iter().fold(Bounds::EMPTY, |all, &item| all.union(bounds(item as usize)))
}
