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

    /// Returns whether a new image would equal this one. Tunings of other channels matter to few
    /// patterns.
    fn is_of(&self, wall: &Wall, id: ChannelId, pattern: TestPattern, eye: DVec3) -> bool {
        let is_same_wall = || {
            let (old, new) = (self.wall.channel(id), wall.channel(id));
            let is_near = old == new
                && new.is_some_and(|new| {
                    self.wall.screens.get(usize::from(new.screen)) == Some(wall.screen_of(new))
                });
            is_near && (pattern.ignores_neighbours() || self.wall == *wall)
        };
        self.pattern == pattern && (!pattern.depends_on_eye() || self.eye == eye) && is_same_wall()
    }
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
