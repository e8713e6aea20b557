//! Large primitives in pieces, so that a channel draws only what it may see of them, and lights
//! reach only the pieces that are near them; and so that each piece can be stored.
//!
//! Pieces come from median splits of the elements' centroids along the longest axis. Every
//! primitive that is too large *as its nodes and joints scale it* is split, wherever it stands: the
//! wall's camera may go anywhere. Accuracy does not ask for it: the vertices stay as they are, and
//! the renderer measures them from the point of the mesh that is nearest to the eye. Levels of
//! detail do not part pieces: all those of a mesh are simplified together.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};

use super::check;
use super::error::BakeError;

/// Longest half side of a piece, in metres.
pub(super) const HALF_EXTENT_MAX: f64 = 50.0;

/// Splits that would leave fewer elements than this in a piece cost more in draw calls than
/// they give, up to [`HALF_EXTENT_COARSE`].
pub(super) const PIECE_ELEMENTS_MIN: usize = 1000;

/// Longest half side of a piece of few elements: something this large is seldom near the eye.
pub(super) const HALF_EXTENT_COARSE: f64 = 25.0 * HALF_EXTENT_MAX;

/// Maximum number of elements of a piece, whatever its size: with all levels and three vertices of
/// its own for each, a triangle takes up to some 400 bytes, and a blob has at most 2 GiB.
const PIECE_ELEMENTS_MAX: usize = 4 << 20;

/// Most pieces of one primitive: each is a draw call.
pub(super) const PIECES_MAX: usize = 4096;

/// A split must make one of its halves so much shorter along the split axis, or it is not worth a
/// draw call: an element that is large itself can't be made smaller.
const SHRINK: f64 = 0.9;

/// Elements in the order of their pieces.
#[derive(Debug)]
pub(super) struct Pieces {
    /// Numbers of elements; ascending within a piece, so that source order stays.
    pub elements: Vec<u32>,
    /// Each a piece, in `elements`.
    pub ranges: Vec<Range<usize>>,
}

/// Splits a list of elements of `arity` indices; `scale` is metres per unit.
pub(super) fn split(
    positions: &[[f32; 3]],
    indices: &[u32],
    arity: usize,
    scale: f64,
    cancel: &AtomicBool,
) -> Result<Pieces, BakeError> {
    let shape = SplitInput { positions, indices, arity, scale };
    let mut elements: Vec<u32> = (0..(indices.len() / arity) as u32).collect();
    let mut done = Vec::new();
    let mut queue = VecDeque::new();
    queue.push_back(0..elements.len());
    while let Some(range) = queue.pop_front() {
        check(cancel)?;
        let has_room = done.len() + queue.len() + 2 <= PIECES_MAX;
        match has_room.then(|| shape.halve(&mut elements[range.clone()])).flatten() {
            Some(middle) => {
                let middle = range.start + middle;
                queue.extend([range.start..middle, middle..range.end]);
            }
            None => done.push(range),
        }
    }
    done.sort_unstable_by_key(|range| range.start);
    for range in &done {
        elements[range.clone()].sort_unstable();
    }
    Ok(Pieces { elements, ranges: done })
}

struct SplitInput<'a> {
    positions: &'a [[f32; 3]],
    indices: &'a [u32],
    arity: usize,
    scale: f64,
}

impl SplitInput<'_> {
    /// Partitions the elements and says where, or `None` where they may stay together.
    fn halve(&self, elements: &mut [u32]) -> Option<usize> {
        let half_size = self.half_size(elements);
        let half_extent = half_size.max_element();
        let is_fine = half_extent <= HALF_EXTENT_MAX;
        let is_few = elements.len() < 2 * PIECE_ELEMENTS_MIN && half_extent <= HALF_EXTENT_COARSE;
        let may_stay = is_fine || is_few || elements.len() < 2 || !half_extent.is_finite();
        let is_too_many = elements.len() > PIECE_ELEMENTS_MAX;
        if may_stay && !is_too_many {
            return None;
        }
        let centroids = elements.iter().map(|&element| self.centroid(element));
        let axis = longest_axis(centroids);
        let middle = elements.len() / 2;
        elements.select_nth_unstable_by(middle, |&a, &b| {
            self.centroid(a)[axis].total_cmp(&self.centroid(b)[axis])
        });
        let (low, high) = elements.split_at(middle);
        let least = self.half_size(low)[axis].min(self.half_size(high)[axis]);
        (is_too_many || least <= half_size[axis] * SHRINK).then_some(middle)
    }

    fn corners(&self, element: u32) -> impl Iterator<Item = DVec3> + '_ {
        let first = element as usize * self.arity;
        let corners = self.indices[first..first + self.arity].iter();
        corners.map(|&index| Vec3::from(self.positions[index as usize]).as_dvec3())
    }

    /// The sum of the corners, which sorts as the centroid does.
    fn centroid(&self, element: u32) -> DVec3 {
        self.corners(element).sum()
    }

    /// Half of the sides of the box around these elements, in metres.
    fn half_size(&self, elements: &[u32]) -> DVec3 {
        let corners = elements.iter().flat_map(|&element| self.corners(element));
        let (min, max) = around(corners);
        (max - min) * 0.5 * self.scale
    }
}

fn around(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::MAX, DVec3::MIN), |(min, max), point| (min.min(point), max.max(point)))
}

fn longest_axis(points: impl Iterator<Item = DVec3>) -> usize {
    let (min, max) = around(points);
    let size = max - min;
    (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_has_no_more_elements_than_can_be_stored() {
        let pieces_of = |count: usize| {
            let cancel = AtomicBool::new(false);
            // All in one place, where no size asks for a split and none makes a half smaller.
            let pieces = split(&[[0.0; 3]], &vec![0; count], 1, 1.0, &cancel).expect("split");
            pieces.ranges.iter().map(ExactSizeIterator::len).collect::<Vec<_>>()
        };
        let half = PIECE_ELEMENTS_MAX / 2;
        assert_eq!(pieces_of(PIECE_ELEMENTS_MAX), [PIECE_ELEMENTS_MAX]);
        assert_eq!(pieces_of(PIECE_ELEMENTS_MAX + 2), [half + 1, half + 1]);
    }
}
