//! The pictures of a corrected channel's frame that are metered, by the part of each that is seen.

use polyptych_protocol::command::Frame;
use polyptych_renderer::{Gpu, ViewDesc};
use polyptych_wall::Wall;

use super::Corrector;
use super::overlay::{self, Overlay};

/// A picture that is metered.
#[derive(Debug)]
pub(crate) struct MeteredPicture {
    /// In pixels.
    pub size: [u32; 2],
    /// The views that the renderer draws into it.
    pub views: Vec<ViewDesc>,
    /// The share of it that is seen, from 0 to 1.
    pub share: f64,
}

impl Corrector {
    /// Returns the pictures of a frame that are seen: the channel's own one, and those of views
    /// that lie over it. Where several views lie over the same part of another one, that part
    /// counts as covered several times.
    ///
    /// # Errors
    /// An eye that sees no picture, or a view that cannot be shown.
    pub fn metered_pictures(
        &mut self,
        gpu: &Gpu,
        wall: &Wall,
        frame: &Frame,
    ) -> Result<Vec<MeteredPicture>, String> {
        let layers = self.layers(gpu, wall, frame)?;
        let own_pixels = self.plan.warp.as_deref().map_or(1.0, overlay::pixels);
        let mut above: Vec<&Overlay> = Vec::new();
        let mut covered = 0.0;
        let mut pictures = Vec::with_capacity(layers.len());
        for layer in layers.into_iter().rev() {
            let lay = layer.lay.map(|index| &self.lays[index]);
            let share = lay.map_or(1.0 - covered / own_pixels, |lay| lay.seen_share(&above));
            if share > 0.0 {
                let (size, views) = (layer.shots.size, layer.views);
                pictures.push(MeteredPicture { size, views, share });
            }
            let Some(lay) = lay else { continue };
            if lay.is_whole() {
                break;
            }
            covered += share * lay.pixels();
            above.push(lay);
        }
        Ok(pictures)
    }
}
