//! Checks that the channels of a screen cover it, for each eye: holes and hidden parts.

use glam::UVec2;
use polyptych_text::counted;
use polyptych_wall::{ChannelKind, Eye, Screen};

use super::document::ScreenSection;
use super::error::WallFileError;
use super::screen::{ChannelDraft, PlacedSection};
use crate::coverage::{eyes, is_plain_tile, is_seen_by};
use crate::tiling::{self, Rect};

/// Most hidden rectangles of one screen: more than a grid of 1,024 tiles has gaps.
const HIDDEN_MAX: usize = 4096;

impl PlacedSection<'_> {
    /// Every pixel of the canvas must be shown or hidden where channels are plain tiles that do
    /// not overlap. Where they blend, a hole is what [`coverage`](crate::coverage) reports:
    /// the light of projectors has no straight ends.
    pub fn check_cover(
        &self,
        screen: &Screen,
        drafts: &[ChannelDraft],
    ) -> Result<(), WallFileError> {
        let on_screen: Vec<&ChannelDraft> =
            drafts.iter().filter(|draft| draft.channel.screen == self.index).collect();
        self.check_inside(screen.canvas, &on_screen)?;
        let hidden = self.hidden(screen.canvas, &on_screen)?;
        for eye in eyes(on_screen.iter().map(|draft| &draft.channel)) {
            let seen: Vec<&ChannelDraft> =
                on_screen.iter().copied().filter(|d| is_seen_by(&d.channel, *eye)).collect();
            let shown: Vec<Rect> = seen.iter().map(|draft| draft.rect()).collect();
            let is_tiled = seen.iter().all(|draft| is_plain_tile(&draft.channel))
                && tiling::overlap(&shown).is_none();
            if is_tiled {
                self.check_holes(screen.canvas, *eye, &shown, &hidden)?;
            }
        }
        Ok(())
    }

    fn check_inside(&self, canvas: UVec2, drafts: &[&ChannelDraft]) -> Result<(), WallFileError> {
        let is_outside = |draft: &&&ChannelDraft| {
            draft.channel.cover == ChannelKind::Tile && !draft.rect().lies_on(canvas)
        };
        let Some(draft) = drafts.iter().find(is_outside) else { return Ok(()) };
        let what = format!(
            "channel {:?}, {}, leaves the canvas of {}×{} pixels",
            draft.channel.name,
            rect_words(draft.rect()),
            canvas.x,
            canvas.y
        );
        let remedy = "move it, make it smaller, or the screen's pixels larger";
        Err(self.source.error(format!("{}.origin", draft.key), what, remedy))
    }

    fn check_holes(
        &self,
        canvas: UVec2,
        eye: Eye,
        shown: &[Rect],
        hidden: &[Rect],
    ) -> Result<(), WallFileError> {
        let gaps = tiling::gaps(canvas, &[shown, hidden].concat());
        let Some(gap) = gaps.first() else { return Ok(()) };
        let total: u64 = gaps.iter().map(|gap| gap.area()).sum();
        let count = shown.len();
        let of_eye = match eye {
            Eye::Center => "",
            Eye::Left => " for the left eye",
            Eye::Right => " for the right eye",
        };
        let leave = if count == 1 { "leaves" } else { "leave" };
        let what = format!(
            "{}{of_eye} {leave} a hole: none shows {} ({} missing in all)",
            counted(count, "channel"),
            rect_words(*gap),
            counted(total, "pixel")
        );
        let remedy = "add the channel that is missing, or [[screen.hidden]] for a bezel";
        let key = if self.section.tiles.is_some() { "tiles" } else { "channel" };
        Err(self.error(key, what, remedy))
    }

    /// Returns the parts that channels need not show: what the file hides, and the gaps between the
    /// tiles of a grid.
    fn hidden(&self, canvas: UVec2, drafts: &[&ChannelDraft]) -> Result<Vec<Rect>, WallFileError> {
        let ScreenSection { hidden, tiles, .. } = self.section;
        if tiles.is_some() {
            let tiles: Vec<Rect> = drafts.iter().map(|draft| draft.rect()).collect();
            return Ok(tiling::gaps(canvas, &tiles));
        }
        if hidden.len() > HIDDEN_MAX {
            let what = format!("the screen has {} hidden rectangles", hidden.len());
            return Err(self.error("hidden", what, &format!("{HIDDEN_MAX} are possible")));
        }
        let mut rects = Vec::with_capacity(hidden.len());
        for (index, section) in hidden.iter().enumerate() {
            let rect = Rect {
                origin: UVec2::from_array(section.origin),
                size: UVec2::from_array(section.pixels),
            };
            let mut tiles = drafts.iter().filter(|draft| is_plain_tile(&draft.channel));
            let over = tiles.find(|draft| draft.rect().intersection(rect).is_some());
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
        Ok(rects)
    }
}

/// A rectangle for people.
fn rect_words(rect: Rect) -> String {
    let Rect { origin, size } = rect;
    format!("{}×{} pixels at [{}, {}]", size.x, size.y, origin.x, origin.y)
}
