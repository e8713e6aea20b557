//! Channels as a grid of equal tiles, with bezels between them.

use glam::{DVec2, UVec2};
use polyptych_wall::limits::{CANVAS_SIDE_MAX, CHANNELS_MAX};
use polyptych_wall::{Bezel, Screen, Surface};

use super::check::{COORDINATE_MAX_M, check_name, check_numbers};
use super::document::TilesSection;
use super::error::WallFileError;
use super::screen::{ChannelDraft, PlacedSection};
use crate::tiling::{self, Rect};

impl PlacedSection<'_> {
    /// Channels as a grid; sets the screen's canvas and bezel.
    pub fn tiles(
        &self,
        tiles: &TilesSection,
        screen: &mut Screen,
    ) -> Result<Vec<ChannelDraft>, WallFileError> {
        self.check_grid(tiles)?;
        let grid = UVec2::new(tiles.columns, tiles.rows);
        let tile = self.check_channel_size("tiles.pixels", tiles.pixels)?;
        let gap = self.gap(tiles, tile, screen)?;
        let overlap = self.overlap(tiles, tile)?;
        let step = tile.saturating_add(gap) - overlap;
        let Some(canvas) = tiling::grid_canvas(grid, tile, step)
            .filter(|canvas| canvas.max_element() <= CANVAS_SIDE_MAX)
        else {
            let what = format!(
                "{}×{} tiles of {}×{} pixels and the bezels between them are too many pixels",
                grid.x, grid.y, tile.x, tile.y
            );
            let remedy = format!("a canvas has at most {CANVAS_SIDE_MAX} pixels on a side");
            return Err(self.error("tiles.pixels", what, &remedy));
        };
        screen.canvas = canvas;
        let asked_m = DVec2::from_array(tiles.bezel);
        screen.bezel = (asked_m != DVec2::ZERO).then_some(Bezel { asked_m, pixels: gap });
        let rects = tiling::grid_tiles(grid, tile, step).enumerate();
        rects.map(|(at, rect)| self.tile(tiles, at, rect)).collect()
    }

    fn check_grid(&self, tiles: &TilesSection) -> Result<(), WallFileError> {
        let alone = ["pixels", "hidden"];
        let given = [self.section.pixels.is_some(), !self.section.hidden.is_empty()];
        if let Some((name, _)) = alone.iter().zip(given).find(|(_, given)| *given) {
            let what = "tiles cover the whole screen, so that this follows from them";
            return Err(self.error(name, what, "leave it out, or write the channels by hand"));
        }
        let count = u64::from(tiles.columns) * u64::from(tiles.rows);
        if !(1..=CHANNELS_MAX as u64).contains(&count) {
            let what = format!("{} columns × {} rows are {count} tiles", tiles.columns, tiles.rows);
            let key = if tiles.columns == 0 { "tiles.columns" } else { "tiles.rows" };
            return Err(self.error(key, what, &format!("1 to {CHANNELS_MAX} tiles are possible")));
        }
        for (key, names) in [("tiles.names", &tiles.names), ("tiles.servers", &tiles.servers)] {
            if !names.is_empty() && names.len() as u64 != count {
                let what = format!("there are {} names for {count} tiles", names.len());
                let remedy = format!("write {count} names, row by row from the upper left");
                return Err(self.error(key, what, &remedy));
            }
        }
        Ok(())
    }

    /// By how many pixels neighbours overlap.
    fn overlap(&self, tiles: &TilesSection, tile: UVec2) -> Result<UVec2, WallFileError> {
        let overlap = UVec2::from_array(tiles.overlap);
        if overlap != UVec2::ZERO && tiles.bezel != [0.0, 0.0] {
            let what = "tiles cannot have both gaps and overlaps";
            return Err(self.error("tiles.overlap", what, "keep one of bezel and overlap"));
        }
        if let Some(axis) = (0..2).find(|axis| overlap[*axis] >= tile[*axis]) {
            let what = format!("{} of {} pixels overlap", overlap[axis], tile[axis]);
            let remedy = format!("write less than {}, such as 15 % of it", tile[axis]);
            return Err(self.error(&format!("tiles.overlap[{axis}]"), what, &remedy));
        }
        Ok(overlap)
    }

    fn gap(
        &self,
        tiles: &TilesSection,
        tile: UVec2,
        screen: &Screen,
    ) -> Result<UVec2, WallFileError> {
        let (source, size_m) = (self.source, screen.size_m());
        if tiles.bezel == [0.0, 0.0] {
            return Ok(UVec2::ZERO);
        }
        if let Surface::Mesh(_) = screen.surface {
            let what = "how many pixels a bezel of a mesh is, only its file knows";
            let remedy = "write the channels by hand, with [[screen.hidden]] between them";
            return Err(self.error("tiles.bezel", what, remedy));
        }
        check_numbers(source, &self.key("tiles.bezel"), &tiles.bezel, COORDINATE_MAX_M, "metres")?;
        let counts = [tiles.columns, tiles.rows];
        let mut gap = UVec2::ZERO;
        for axis in 0..2 {
            let (bezel_m, side_m) = (tiles.bezel[axis], size_m[axis]);
            let key = format!("tiles.bezel[{axis}]");
            if bezel_m < 0.0 {
                let what = format!("a gap of {bezel_m} metres would overlap tiles");
                return Err(self.error(&key, what, "write 0 or more"));
            }
            let pixels = tiling::gap_pixels(side_m, counts[axis], tile[axis], bezel_m);
            gap[axis] = pixels.ok_or_else(|| {
                let what = format!(
                    "{} gaps of {bezel_m} metres leave nothing of a screen of {side_m} metres",
                    counts[axis] - 1
                );
                self.error(&key, what, "write smaller bezels; the size includes them")
            })?;
        }
        Ok(gap)
    }

    /// The tile at this place of the list, row by row.
    fn tile(
        &self,
        tiles: &TilesSection,
        at: usize,
        rect: Rect,
    ) -> Result<ChannelDraft, WallFileError> {
        let default_name = || {
            let columns = tiles.columns as usize;
            let (column, row) = (at % columns + 1, at / columns + 1);
            match tiles.columns * tiles.rows {
                1 => self.section.name.clone(),
                _ => format!("{}-{column}-{row}", self.section.name),
            }
        };
        let key = self.key("tiles");
        let name = tiles.names.get(at).cloned().unwrap_or_else(default_name);
        let name_key =
            if tiles.names.is_empty() { key.clone() } else { format!("{key}.names[{at}]") };
        check_name(self.source, &name_key, &name)?;
        let server = tiles.servers.get(at).unwrap_or(&name).clone();
        check_name(self.source, &format!("{key}.servers[{at}]"), &server)?;
        Ok(self.draft(name, server, rect, name_key, key))
    }
}
