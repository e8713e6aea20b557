//! Groups of views, so that what all views of a frame need takes no more than a bounded texture.

use std::ops::Range;

use crate::guarded_region::{GuardedRegion, TEXELS_MAX, has_room_behind, pack};

/// The region of a view, if it has one, and the pictures of what is behind glass in that.
pub(crate) type GlassRegion = (Option<GuardedRegion>, Vec<GuardedRegion>);

/// Views of a frame, one after the other, whose regions have room in one texture.
#[derive(Debug)]
pub(crate) struct RegionGroup {
    pub views: Range<usize>,
    /// By view; `None` for one that has none.
    pub regions: Vec<Option<GuardedRegion>>,
    /// Of the texture.
    pub sides: [u32; 2],
    /// The pictures of what is behind glass in all of them.
    behind: Vec<GuardedRegion>,
}

impl RegionGroup {
    /// Divides the views of a frame into groups of up to [`TEXELS_MAX`] texels in textures of sides
    /// up to `side_max`, and of as much behind glass as a group may have; a view alone may have
    /// more. None if no view has a region.
    pub fn of_frame(regions: impl Iterator<Item = GlassRegion>, side_max: u32) -> Vec<Self> {
        let mut groups: Vec<Self> = Vec::new();
        for (index, region) in regions.enumerate() {
            if !groups.last_mut().is_some_and(|group| group.add(&region, side_max)) {
                let (views, regions, behind) = (index..index, Vec::new(), Vec::new());
                let mut group = Self { views, regions, sides: [0, 0], behind };
                group.add(&region, side_max);
                groups.push(group);
            }
        }
        groups.retain(|group| group.sides != [0, 0]);
        groups
    }

    /// Takes the next view, unless others have regions and it has no room beside them.
    fn add(&mut self, (region, behind): &GlassRegion, side_max: u32) -> bool {
        let needs_none = region.is_none() && behind.is_empty();
        let mut all = self.regions.clone();
        all.push(*region);
        let behind = [&self.behind[..], behind].concat();
        let texels = all.iter().flatten().map(|of| u64::from(of.size[0]) * u64::from(of.size[1]));
        let is_small = texels.sum::<u64>() <= TEXELS_MAX && has_room_behind(&behind, side_max);
        let has_room = is_small || needs_none || self.sides == [0, 0];
        let Some(sides) = pack(all.iter_mut().flatten(), side_max).filter(|_| has_room) else {
            return false;
        };
        (self.regions, self.behind, self.sides) = (all, behind, sides);
        self.views.end += 1;
        true
    }
}
