//! Channels by hand: each with its rectangle, all together without overlap or hole.

use glam::UVec2;

use super::check::check_name;
use super::document::ChannelSection;
use super::error::WallFileError;
use super::screen::{Draft, Place};
use crate::limits::{CANVAS_SIDE_MAX, CHANNELS_MAX};
use crate::wall::Screen;
use crate::wall::tiling::{self, Rect};

/// Most hidden rectangles of one screen: more than a grid of 1,024 tiles has gaps.
const HIDDEN_MAX: usize = 4096;

impl Place<'_> {
    /// Channels by hand; sets the screen's canvas.
    pub fn channels(&self, screen: &mut Screen) -> Result<Vec<Draft>, WallFileError> {
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
        let drafts = sections
            .map(|(at, section)| self.channel(at, section, canvas))
            .collect::<Result<Vec<Draft>, _>>()?;
        self.check_cover(canvas, &drafts)?;
        Ok(drafts)
    }

    fn channel(
        &self,
        at: usize,
        section: &ChannelSection,
        canvas: UVec2,
    ) -> Result<Draft, WallFileError> {
        let ChannelSection { name, origin, pixels, server } = section;
        let key = format!("channel[{at}]");
        let name_key = self.key(&format!("{key}.name"));
        check_name(self.source, &name_key, name)?;
        let server = server.as_ref().unwrap_or(name);
        check_name(self.source, &self.key(&format!("{key}.server")), server)?;
        let size = self.check_channel_size(&format!("{key}.pixels"), *pixels)?;
        let rect = Rect { origin: UVec2::from_array(*origin), size };
        if !rect.lies_on(canvas) {
            let what = format!(
                "channel {name:?}, {}, leaves the canvas of {}×{} pixels",
                rect_words(rect),
                canvas.x,
                canvas.y
            );
            let remedy = "move it, make it smaller, or the screen's pixels larger";
            return Err(self.error(&format!("{key}.origin"), what, remedy));
        }
        Ok(self.draft(name.clone(), server.clone(), rect, name_key, self.key(&key)))
    }

    /// Every pixel of the canvas must be shown by one channel or be hidden.
    fn check_cover(&self, canvas: UVec2, drafts: &[Draft]) -> Result<(), WallFileError> {
        let mut rects: Vec<Rect> = drafts.iter().map(Draft::rect).collect();
        if let Some((first, second, both)) = tiling::overlap(&rects) {
            let (first, second) = (&drafts[first], &drafts[second]);
            let what = format!(
                "channels {:?} and {:?} overlap: both show {}",
                first.channel.name,
                second.channel.name,
                rect_words(both)
            );
            let key = format!("{}.origin", second.key);
            return Err(self.source.error(key, what, "move one, or make it smaller"));
        }
        let shown = rects.len();
        self.add_hidden(canvas, drafts, &mut rects)?;
        let gaps = tiling::gaps(canvas, &rects);
        if let Some(gap) = gaps.first() {
            let total: u64 = gaps.iter().map(|gap| gap.area()).sum();
            let what = format!(
                "{shown} channels leave a hole: none shows {} ({total} pixels are missing in all)",
                rect_words(*gap)
            );
            let remedy = "add the channel that is missing, or [[screen.hidden]] for a bezel";
            return Err(self.error("channel", what, remedy));
        }
        Ok(())
    }

    fn add_hidden(
        &self,
        canvas: UVec2,
        drafts: &[Draft],
        rects: &mut Vec<Rect>,
    ) -> Result<(), WallFileError> {
        let hidden = &self.section.hidden;
        if hidden.len() > HIDDEN_MAX {
            let what = format!("the screen has {} hidden rectangles", hidden.len());
            return Err(self.error("hidden", what, &format!("{HIDDEN_MAX} are possible")));
        }
        for (index, section) in hidden.iter().enumerate() {
            let rect = Rect {
                origin: UVec2::from_array(section.origin),
                size: UVec2::from_array(section.pixels),
            };
            let over = drafts.iter().find(|draft| draft.rect().intersection(rect).is_some());
            let what = if rect.area() == 0 {
                "a hidden rectangle without pixels hides nothing".to_owned()
            } else if !rect.lies_on(canvas) {
                format!("{} leaves the canvas of {}×{}", rect_words(rect), canvas.x, canvas.y)
            } else if let Some(over) = over {
                format!("{} lies over channel {:?}", rect_words(rect), over.channel.name)
            } else {
                rects.push(rect);
                continue;
            };
            let remedy = "hide only what no channel shows";
            return Err(self.error(&format!("hidden[{index}].origin"), what, remedy));
        }
        Ok(())
    }
}

fn rect_words(rect: Rect) -> String {
    let Rect { origin, size } = rect;
    format!("{}×{} pixels at [{}, {}]", size.x, size.y, origin.x, origin.y)
}
