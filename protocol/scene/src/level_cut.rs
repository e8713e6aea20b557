//! Cuts through the levels of detail of a primitive: the beginnings of its blob's vertices, indices
//! and meshlets that are a complete surface by themselves.
//!
//! The blob has the coarsest meshlets first, and vertices in the order in which these name them.
//! A [`LevelCut`] says how much of each list a level needs, so that bytes and error are known
//! without the blob, and a server reads and holds no more than the levels that fit its memory.

use std::borrow::Cow;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::meshlet::Meshlet;
use super::{Mesh, Primitive};

/// Maximum number of cuts of a primitive: each has half as many triangles again as the one before.
pub const CUTS_MAX: usize = 32;

/// The beginning of a primitive's blob that a level of detail needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelCut {
    /// The finest level in it, 1 or more: meshlets of this level and of finer ones that nothing
    /// replaces up to it are the surface.
    pub level: u32,
    /// Vertices that it needs, from the first on.
    pub vertex_count: u32,
    /// Indices of the surface.
    pub index_count: u32,
    /// Indices of what replaces parts of the surface.
    pub coarser_index_count: u32,
    /// Meshlets that it needs, from the first on.
    pub meshlet_count: u32,
    /// An upper bound of the distance between the surface and that of the finest level, in units
    /// of the primitive's space; 0 or more.
    pub error: f32,
}

impl LevelCut {
    /// The number of all its indices, from the first of the blob on.
    pub fn index_count_of_all(&self) -> u64 {
        u64::from(self.index_count) + u64::from(self.coarser_index_count)
    }

    /// Returns whether nothing of it is beyond another one that is finer, or of the whole.
    fn is_within(&self, finer: &Self) -> bool {
        self.vertex_count <= finer.vertex_count
            && self.index_count_of_all() <= finer.index_count_of_all()
            && self.meshlet_count <= finer.meshlet_count
            && self.error >= finer.error
            && self.level > finer.level
    }
}

impl Primitive {
    /// The cut that is all of it.
    pub fn whole(&self) -> LevelCut {
        LevelCut {
            level: self.finest_level,
            vertex_count: self.vertex_count,
            index_count: self.index_count,
            coarser_index_count: self.coarser_index_count,
            meshlet_count: self.meshlet_count,
            error: 0.0,
        }
    }

    /// The coarsest cut that has a level, or all of it.
    pub fn cut_at(&self, level: u32) -> LevelCut {
        let cut = self.cuts.iter().find(|cut| cut.level <= level);
        cut.copied().unwrap_or_else(|| self.whole())
    }

    /// The primitive with nothing finer than a cut of it; its blob is [`Self::parts_of`] that.
    #[must_use]
    pub fn limited_to(&self, cut: &LevelCut) -> Self {
        Self {
            vertex_count: cut.vertex_count,
            index_count: cut.index_count,
            coarser_index_count: cut.coarser_index_count,
            meshlet_count: cut.meshlet_count,
            cuts: self.cuts.iter().copied().filter(|of| of.level > cut.level).collect(),
            finest_level: cut.level,
            ..self.clone()
        }
    }

    /// The parts of this primitive's blob that one that is limited to a cut of it needs, in bytes:
    /// vertices, indices, meshlets.
    pub fn parts_of(&self, limited: &Self) -> [Range<u64>; 3] {
        let (indices, meshlets) = (self.vertex_bytes(), self.first_meshlet_byte());
        [
            0..limited.vertex_bytes(),
            indices..indices + limited.geometry_bytes() - limited.vertex_bytes(),
            meshlets..meshlets + limited.bytes() - limited.first_meshlet_byte(),
        ]
    }

    /// The blob of a primitive that is limited to a cut of this one, from the bytes of
    /// [`Self::parts_of`].
    pub fn joined(limited: &Self, [vertices, indices, meshlets]: [&[u8]; 3]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(limited.bytes() as usize);
        bytes.extend_from_slice(vertices);
        bytes.extend_from_slice(indices);
        bytes.resize(limited.first_meshlet_byte() as usize, 0);
        bytes.extend_from_slice(meshlets);
        bytes
    }

    /// The meshlets of its blob, from the coarsest on.
    pub fn meshlets_of(&self, blob: &[u8]) -> Vec<Meshlet> {
        let bytes = blob.get(self.first_meshlet_byte() as usize..).unwrap_or_default();
        bytes.as_chunks::<{ Meshlet::BYTES }>().0.iter().map(Meshlet::from_bytes).collect()
    }

    /// The bytes of the indices of the finest level in its blob, in the order in which they are
    /// drawn; short if the blob is not what its description says.
    pub fn finest_indices_of<'a>(&self, blob: &'a [u8]) -> Cow<'a, [u8]> {
        let first = self.vertex_bytes() as usize;
        let range = |of: Range<usize>| blob.get(of).unwrap_or_default();
        if self.meshlet_count == 0 {
            return range(first..first + self.index_bytes() as usize).into();
        }
        let width = self.index_width() as usize;
        let mut at = first;
        let mut runs: Vec<(u32, Range<usize>)> = Vec::new();
        for meshlet in self.meshlets_of(blob) {
            let end = at.saturating_add(meshlet.index_count as usize * width);
            if self.is_finest(&meshlet) {
                runs.push((meshlet.first_index, at..end));
            }
            at = end;
        }
        runs.sort_by_key(|(first, _)| *first);
        let bytes: Vec<u8> = runs.into_iter().flat_map(|(_, of)| range(of)).copied().collect();
        bytes.into()
    }

    /// Returns whether nothing finer than a meshlet is there.
    pub fn is_finest(&self, meshlet: &Meshlet) -> bool {
        meshlet.error == 0.0 || (self.finest_level > 0 && meshlet.level <= self.finest_level)
    }

    /// Returns what is wrong with its cuts, if anything.
    fn cuts_fault(&self) -> Option<&'static str> {
        let whole = self.whole();
        let finer = self.cuts.iter().skip(1).chain([&whole]);
        if self.cuts.len() > CUTS_MAX || (self.meshlet_count == 0 && !self.cuts.is_empty()) {
            return Some("more levels than it may have");
        }
        for (cut, finer) in self.cuts.iter().zip(finer) {
            let is_surface = cut.index_count > 0 && cut.index_count.is_multiple_of(3);
            let has_all = cut.vertex_count > 0 && cut.meshlet_count > 0;
            if !(is_surface && has_all && cut.error.is_finite() && cut.is_within(finer)) {
                return Some("levels whose counts or errors are not in order");
            }
        }
        None
    }
}

impl Mesh {
    /// Returns what is wrong with the cuts of its primitives, if anything. All that have some have
    /// those of the same levels, since parts that meet are replaced together.
    pub(super) fn cuts_fault(&self) -> Option<&'static str> {
        if let Some(fault) = self.primitives.iter().find_map(Primitive::cuts_fault) {
            return Some(fault);
        }
        let levels = |of: &Primitive| of.cuts.iter().map(|cut| cut.level).collect::<Vec<_>>();
        let mut all = self.primitives.iter().filter(|of| !of.cuts.is_empty()).map(levels);
        let first = all.next();
        all.any(|of| Some(of) != first).then_some("primitives with different levels")
    }
}

#[cfg(test)]
mod tests;
