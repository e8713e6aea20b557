//! Test patterns instead of the scene.

use std::sync::Arc;

use glam::DVec3;
use polyptych_protocol::calibration_marker::MarkedPoint;
use polyptych_protocol::command::Frame;
use polyptych_protocol::pattern::TestPattern;
use polyptych_renderer::{DrawStats, Gpu, OutputTexture};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{ChannelId, Eye, Wall};

use super::RenderThread;
use crate::pattern;

/// A pattern that was drawn, on the GPU, and what it depends on.
#[derive(Debug)]
pub(super) struct PatternImage {
    pattern: TestPattern,
    eye: DVec3,
    mark: Option<MarkedPoint>,
    wall: Wall,
    picture: OutputTexture,
}

impl PatternImage {
    fn new(
        gpu: &Gpu,
        (shaped, maps): (ResolvedWall<'_>, &CalibrationMaps),
        id: ChannelId,
        pattern: TestPattern,
        (eye, mark): (DVec3, Option<MarkedPoint>),
    ) -> Result<Self, String> {
        let image = pattern::draw_pattern(shaped, maps, id, pattern, (eye, mark))?;
        let picture = OutputTexture::of_pixels(gpu, [image.width(), image.height()], &image);
        Ok(Self { pattern, eye, mark, wall: shaped.wall.clone(), picture })
    }

    /// Returns whether a new image would equal this one.
    fn is_of(&self, wall: &Wall, id: ChannelId, pattern: TestPattern, eye: DVec3) -> bool {
        self.pattern == pattern
            && (!pattern.depends_on_eye() || self.eye == eye)
            && is_alike(&self.wall, wall, id, pattern)
    }
}

/// Returns whether a pattern on a channel is the same on both walls. Tunings of other channels
/// matter to few patterns; files that changed may give the channel's pixels other places.
fn is_alike(old: &Wall, new: &Wall, id: ChannelId, pattern: TestPattern) -> bool {
    if !pattern.ignores_neighbours() {
        return old == new;
    }
    let (Some(before), Some(now)) = (old.channel(id), new.channel(id)) else { return false };
    before == now && old.screen_of(before) == new.screen_of(now) && old.files == new.files
}

impl RenderThread {
    /// Draws a pattern on a channel; `is_linear` is the scene's, so that targets stay as they are.
    pub(super) fn draw_pattern(
        &mut self,
        index: usize,
        (wall, id): (&Wall, ChannelId),
        frame: &Frame,
        pattern: TestPattern,
        is_linear: bool,
    ) -> Result<DrawStats, String> {
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        let eye = frame.presentation.head.eye(Eye::Center);
        let mark = frame.presentation.marker.as_ref();
        let mark = mark.filter(|mark| mark.channel == channel.name).map(|mark| mark.point);
        let known = self.patterns.remove(&channel.name);
        let known = known.filter(|of| of.mark == mark && of.is_of(wall, id, pattern, eye));
        let drawn = if let Some(known) = known {
            known
        } else {
            let state = self.states.front().map(|drawable| &drawable.state);
            let maps = state.map(|state| state.maps.clone()).unwrap_or_default();
            let shapes = state.map(|state| Arc::clone(&state.shapes)).unwrap_or_default();
            let shaped = ResolvedWall { wall, shapes: &shapes };
            PatternImage::new(&self.gpu, (shaped, &maps), id, pattern, (eye, mark))?
        };
        let (size, output) = (drawn.picture.size(), &mut self.outputs[index]);
        let target = output.ensure_target(&self.gpu, size, (wall.samples, is_linear))?;
        target.copy_from(&self.gpu, &drawn.picture);
        self.patterns.insert(channel.name.clone(), drawn);
        self.gpu.wait(None).map_err(|fault| fault.reason)?;
        Ok(DrawStats::default())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, UVec2};
    use polyptych_files::blob::BlobHash;
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{CalibrationFile, CalibrationFileKind, Channel, Screen, Surface};

    use super::*;

    #[test]
    fn a_file_that_changed_makes_a_pattern_another_one_and_a_neighbour_does_not() {
        let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(3.2, 1.8));
        let size = UVec2::new(160, 90);
        let screens = vec![Screen::new("front", Surface::Plane(plane), size * 2)];
        let channel = |name, x| Channel::tile(name, 0, UVec2::new(x, 0), size);
        let mut wall = Wall::new("test", screens, vec![channel("a", 0), channel("b", 160)]);
        wall.files.push(CalibrationFile {
            path: "warp.pfm".to_owned(),
            kind: CalibrationFileKind::Warp,
            blob: Some(BlobHash([1; 32])),
            is_for_one_eye: false,
            front: Vec::new(),
        });
        let (id, _) = wall.channel_by_name("a").expect("a channel");
        let mut beside = wall.clone();
        beside.channels[1].adjustment.mirror = true;
        let mut changed = wall.clone();
        changed.files[0].blob = Some(BlobHash([2; 32]));
        for (pattern, is_near) in [(TestPattern::Density, true), (TestPattern::Overlap, false)] {
            assert!(is_alike(&wall, &wall, id, pattern));
            assert_eq!(is_alike(&wall, &beside, id, pattern), is_near, "{pattern:?}");
            assert!(!is_alike(&wall, &changed, id, pattern), "{pattern:?}");
        }
    }
}
