//! Channels by hand: each with its rectangle, its projector or its warp file.

use glam::{DVec2, UVec2};
use polyptych_wall::limits::{CANVAS_SIDE_MAX, CHANNELS_MAX};
use polyptych_wall::projector::Projector;
use polyptych_wall::{ChannelKind, Screen};

use super::check::check_name;
use super::document::ChannelSection;
use super::error::WallFileError;
use super::projector::projector;
use super::screen::{ChannelDraft, PlacedSection};
use crate::tiling::Rect;

impl PlacedSection<'_> {
    /// Channels by hand; sets the screen's canvas.
    pub fn channels(&self, screen: &mut Screen) -> Result<Vec<ChannelDraft>, WallFileError> {
        let Some(canvas) = self.section.pixels.map(UVec2::from_array) else {
            let what = "with channels by hand the canvas must be given";
            return Err(self.error("pixels", what, "add pixels = [width, height]"));
        };
        if let Some(index) = (0..2).find(|i| !(1..=CANVAS_SIDE_MAX).contains(&canvas[*i])) {
            let what = format!("a canvas cannot have {} pixels on a side", canvas[index]);
            let remedy = format!("write 1 to {CANVAS_SIDE_MAX}");
            return Err(self.error(&format!("pixels[{index}]"), what, &remedy));
        }
        screen.canvas = canvas;
        let count = self.section.channel.len();
        if count > CHANNELS_MAX {
            let what = format!("the screen has {count} channels");
            return Err(self.error("channel", what, &format!("{CHANNELS_MAX} are possible")));
        }
        let sections = self.section.channel.iter().enumerate();
        sections.map(|(at, section)| self.channel(at, section, screen)).collect()
    }

    fn channel(
        &self,
        at: usize,
        section: &ChannelSection,
        screen: &Screen,
    ) -> Result<ChannelDraft, WallFileError> {
        let ChannelSection { name, origin, pixels, projector: thrown, server } = section;
        let key = format!("channel[{at}]");
        let name_key = self.key(&format!("{key}.name"));
        check_name(self.source, &name_key, name)?;
        let server = server.as_ref().unwrap_or(name);
        check_name(self.source, &self.key(&format!("{key}.server")), server)?;
        let size = self.check_channel_size(&format!("{key}.pixels"), *pixels)?;
        let origin = origin.map(UVec2::from_array);
        let cover = match (thrown, origin) {
            (Some(section), _) => {
                let key = self.key(&format!("{key}.projector"));
                ChannelKind::Projector(Box::new(projector(self.source, &key, section)?))
            }
            (None, Some(_)) => ChannelKind::Tile,
            // A warp file must say it, which stands in another table.
            (None, None) => ChannelKind::Map,
        };
        let origin = origin.unwrap_or_else(|| match &cover {
            ChannelKind::Projector(projector) => window_origin(projector, screen, size),
            _ => UVec2::ZERO,
        });
        let rect = Rect { origin, size };
        let mut draft = self.draft(name.clone(), server.clone(), rect, name_key, self.key(&key));
        draft.channel.cover = cover;
        Ok(draft)
    }
}

/// Returns the origin of a projector's window: in the middle of what it lights, on the canvas.
fn window_origin(projector: &Projector, screen: &Screen, size: UVec2) -> UVec2 {
    let middle = projector.intersect(&screen.surface, DVec2::splat(0.5));
    let middle = middle.and_then(|point| screen.canvas_from_display(point)).unwrap_or_default();
    let last = screen.canvas.saturating_sub(size).as_dvec2();
    // Even, as origins are best.
    let origin = (middle - size.as_dvec2() / 2.0).clamp(DVec2::ZERO, last) / 2.0;
    origin.floor().as_uvec2() * 2
}
