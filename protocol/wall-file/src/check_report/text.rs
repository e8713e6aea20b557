//! A wall's numbers as text with units, and what its columns mean.

use std::fmt;

use polyptych_text::counted;
use polyptych_wall::{Eye, Orientation, StereoPacking};

use super::{
    BezelRow, BlendRow, ChannelRow, CheckReport, CoverageRow, OverlapRow, RegionRow, ScreenRow,
    Stereo,
};

/// Maximum number of overlaps and holes of a screen that are printed: `--json` has all.
const LINES_MAX: usize = 8;

/// Maximum difference between a part's pixels and its rectangle's that is a rectangle still.
const RECTANGLE_SLACK_PX: f64 = 0.5;

/// A column of the table of channels.
struct Column {
    head: &'static str,
    /// Numbers end in line.
    is_number: bool,
    cells: Vec<String>,
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.eye_m;
        writeln!(
            f,
            "wall {}: {} on {}, {} pixels, {} per pixel",
            self.name,
            counted(self.channels.len(), "channel"),
            counted(self.screens.len(), "screen"),
            thousands(self.pixels_total),
            counted(self.samples as usize, "sample")
        )?;
        writeln!(f, "eye at [{x}, {y}, {z}] m, near plane {} m from it", self.near_m)?;
        let stereo = match self.stereo {
            Stereo::None => String::new(),
            Stereo::Passive => "channels for the left and for the right eye".to_owned(),
            Stereo::Packed => "both eyes share a display".to_owned(),
            Stereo::Mixed => "some channels are for one eye, some for both".to_owned(),
        };
        if !stereo.is_empty() {
            let apart_mm = self.eye_separation_m * 1e3;
            write!(f, "stereo: {stereo}, eyes {apart_mm:.1} mm apart")?;
            let planes = self.channels.iter().filter_map(|channel| channel.stereo_planes).max();
            if let Some(planes) = planes {
                let errors = self.channels.iter().filter_map(|channel| channel.stereo_error_px);
                let error = errors.fold(0.0, f64::max);
                write!(
                    f,
                    " in all directions: {} or fewer for each eye of a channel, points on the \
                     screen and behind it within {error:.2} px",
                    counted(planes, "picture")
                )?;
            }
            writeln!(f)?;
        }
        writeln!(f)?;
        self.screens.iter().try_for_each(|screen| write!(f, "{screen}"))?;
        writeln!(f)?;
        let columns = self.columns();
        write_aligned(f, &columns)?;
        write_legend(f, &columns)?;
        self.blends.iter().try_for_each(|blend| writeln!(f, "{blend}"))?;
        let unknown = self.channels.iter().filter_map(|c| Some((&c.name, c.unknown.as_ref()?)));
        for (name, why) in unknown {
            writeln!(f, "–: channel {name}: {why}")?;
        }
        self.devices.iter().try_for_each(|device| writeln!(f, "{device}"))?;
        if !self.warnings.is_empty() {
            writeln!(f)?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}

impl fmt::Display for ScreenRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [columns, rows] = self.pixels;
        write!(f, "screen {}: ", self.name)?;
        if self.surface != "plane" {
            write!(f, "{}, ", self.surface)?;
        }
        if let Some([width, height]) = self.size_m {
            write!(f, "{width:.3} × {height:.3} m, ")?;
        }
        write!(f, "{columns} × {rows} pixels")?;
        if let Some([x, y]) = self.pitch_m {
            write!(f, " of {} × {} mm", millimetres(x), millimetres(y))?;
        }
        match self.eye_distance_m {
            Some(distance) => writeln!(f, ", {distance:.3} m from the eye")?,
            None => writeln!(f)?,
        }
        self.coverage.iter().try_for_each(|coverage| write!(f, "{coverage}"))?;
        let Some(BezelRow { asked_m, pixels, in_force_m }) = self.bezel else { return Ok(()) };
        writeln!(
            f,
            "  bezel: {:.2} × {:.2} mm asked, {} × {} pixels in force, which are {:.2} × {:.2} mm",
            asked_m[0] * 1e3,
            asked_m[1] * 1e3,
            pixels[0],
            pixels[1],
            in_force_m[0] * 1e3,
            in_force_m[1] * 1e3
        )
    }
}

impl fmt::Display for CoverageRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let eye = match self.eye {
            Eye::Center => "",
            Eye::Left => ", left eye",
            Eye::Right => ", right eye",
        };
        let open = if self.blends { "not covered" } else { "hidden" };
        let [x, y] = self.step_px;
        let looked = if x > 0.0 {
            format!(", looked at every {x:.1} × {y:.1} pixels")
        } else {
            String::new()
        };
        writeln!(
            f,
            "  coverage{eye}: {:.2} %, {} at most over one place, {} overlap{}{looked}",
            self.covered * 100.0,
            counted(self.layers_max as usize, "channel"),
            self.overlaps.len(),
            if self.overlaps.len() == 1 { "" } else { "s" }
        )?;
        for patch in self.uncovered.iter().take(LINES_MAX) {
            writeln!(f, "  {open}: {patch}")?;
        }
        for OverlapRow { channels, patch, is_blended } in self.overlaps.iter().take(LINES_MAX) {
            let [first, second] = channels;
            let blended = if *is_blended { "blended" } else { "not blended" };
            writeln!(f, "  overlap: {first} and {second}, {blended}, {patch}")?;
        }
        let more = self.uncovered.len().saturating_sub(LINES_MAX)
            + self.overlaps.len().saturating_sub(LINES_MAX);
        if more > 0 { writeln!(f, "  … and {more} more; see --json") } else { Ok(()) }
    }
}

impl fmt::Display for BlendRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.place;
        let eye = match self.eye {
            Eye::Center => "",
            Eye::Left => " for the left eye",
            Eye::Right => " for the right eye",
        };
        write!(
            f,
            "blends of screen {}{eye}: worst at [{x:.1}, {y:.1}] pixels, where {} give {:.4} of \
             the light",
            self.screen,
            self.channels.join(", "),
            self.light
        )
    }
}

impl fmt::Display for RegionRow {
    /// A rectangle by its sides; any other form by its own pixels, and the rectangle around it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([x, y], [width, height]) = (self.origin, self.pixels);
        let is_rectangle = (width * height - self.area).abs() < RECTANGLE_SLACK_PX;
        if !is_rectangle {
            write!(f, "{} pixels", thousands(self.area.round() as u64))?;
            if let Some(area) = self.area_m2 {
                write!(f, ", {area:.3} m²")?;
            }
            write!(f, ", within ")?;
        }
        write!(f, "{width:.0} × {height:.0} pixels at [{x:.0}, {y:.0}]")?;
        match self.size_m {
            Some([across, down]) => write!(f, ", {across:.3} × {down:.3} m"),
            None => Ok(()),
        }
    }
}

impl CheckReport {
    /// The columns that say anything of this wall.
    fn columns(&self) -> Vec<Column> {
        let column = |head, is_number, cell: &dyn Fn(&ChannelRow) -> String| Column {
            head,
            is_number,
            cells: self.channels.iter().map(cell).collect(),
        };
        let text = |head, cell: &dyn Fn(&ChannelRow) -> String| column(head, false, cell);
        let number = |head, cell: &dyn Fn(&ChannelRow) -> String| column(head, true, cell);
        let any = |is: &dyn Fn(&ChannelRow) -> bool| self.channels.iter().any(is);
        let mut columns = vec![
            text("channel", &|c| c.name.clone()),
            text("screen", &|c| c.screen.clone()),
            text("server", &|c| c.server.clone()),
            text("kind", &kind),
            number("pixels", &|c| sides(c.pixels)),
        ];
        if any(&|c| c.output_pixels != c.pixels) {
            columns.push(number("output", &|c| sides(c.output_pixels)));
        }
        if self.stereo != Stereo::None {
            columns.push(text("eye", &|c| eye(c).to_owned()));
        }
        if any(&|c| c.turn != Orientation::None || c.mirror) {
            columns.push(text("hangs", &hangs));
        }
        columns.extend([
            number("origin", &|c| format!("{}, {}", c.origin[0], c.origin[1])),
            number("metres", &|c| {
                known(c.size_m, |[w, h]| format!("{} × {}", metres(w), metres(h)))
            }),
            number("degrees", &|c| known(c.degrees, |[w, h]| format!("{w:.2} × {h:.2}"))),
            number("px/°", &|c| known(c.pixels_per_degree, |count| format!("{count:.1}"))),
            number("sampling", &|c| known(c.sampling, |[low, high]| format!("{low:.2}–{high:.2}"))),
            number("spill", &|c| known(c.spill, |share| format!("{:.1} %", share * 100.0))),
            text("frustum", &|c| c.projection.to_owned()),
        ]);
        columns
    }
}

/// Describes the means by which a channel's pixels are placed.
fn kind(channel: &ChannelRow) -> String {
    match (&channel.projector, &channel.warp) {
        (Some(projector), _) => {
            let distance = projector.distance_m.map(|metres| format!(", {metres:.2} m"));
            format!("projector {:.2}:1{}", projector.throw_ratio, distance.unwrap_or_default())
        }
        (None, Some(_)) => "warp file".to_owned(),
        (None, None) => channel.cover.to_owned(),
    }
}

fn eye(channel: &ChannelRow) -> &'static str {
    match (channel.packing, channel.eye) {
        (StereoPacking::SideBySide, _) => "both, side by side",
        (StereoPacking::TopBottom, _) => "both, top and bottom",
        (StereoPacking::Anaglyph, _) => "both, anaglyph",
        (StereoPacking::None, Eye::Center) => "middle",
        (StereoPacking::None, Eye::Left) => "left",
        (StereoPacking::None, Eye::Right) => "right",
    }
}

fn hangs(channel: &ChannelRow) -> String {
    let turn = match channel.turn {
        Orientation::None => "upright",
        Orientation::Left => "turned left",
        Orientation::Right => "turned right",
        Orientation::Half => "upside down",
    };
    let mirror = if channel.mirror { ", mirrored" } else { "" };
    format!("{turn}{mirror}")
}

fn sides([width, height]: [u32; 2]) -> String {
    format!("{width} × {height}")
}

/// Metres with four digits at least, also of things that are a few millimetres wide.
fn metres(length: f64) -> String {
    if length >= 0.1 { format!("{length:.3}") } else { format!("{length:.5}") }
}

/// Millimetres with three digits or more.
fn millimetres(metres: f64) -> String {
    match metres * 1e3 {
        length if length >= 1.0 => format!("{length:.2}"),
        length if length >= 0.01 => format!("{length:.4}"),
        length => format!("{length:.1e}"),
    }
}

/// Returns a cell, with a dash for an unknown value.
fn known<T>(number: Option<T>, cell: impl FnOnce(T) -> String) -> String {
    number.map_or_else(|| "–".to_owned(), cell)
}

/// Columns as wide as their widest cell.
fn write_aligned(f: &mut fmt::Formatter<'_>, columns: &[Column]) -> fmt::Result {
    let width = |column: &Column| {
        let cells = column.cells.iter().map(|cell| cell.chars().count());
        cells.max().unwrap_or(0).max(column.head.chars().count())
    };
    let widths: Vec<usize> = columns.iter().map(width).collect();
    let rows = columns.first().map_or(0, |column| column.cells.len());
    // The first line has the heads.
    for row in (0..=rows).map(|line| line.checked_sub(1)) {
        let mut line = String::new();
        for (column, width) in columns.iter().zip(&widths) {
            let cell = row.map_or(column.head, |row| &column.cells[row]);
            let padding = " ".repeat(width - cell.chars().count());
            let (before, after) =
                if column.is_number { (padding.as_str(), "") } else { ("", padding.as_str()) };
            line.extend([before, cell, after, "  "]);
        }
        writeln!(f, "{}", line.trim_end())?;
    }
    Ok(())
}

/// The meanings of the columns that are there, by their heads.
const LEGEND: [(&str, &str); 11] = [
    (
        "kind",
        "tile: its pixels lie on the screen (a panel, or warped elsewhere); projector: by its \
         pose, throw ratio and distance to what it lights; warp file: by a measured map",
    ),
    ("pixels", "width × height of the upright picture that one eye gets"),
    ("output", "width × height of what the display gets: turned, with both eyes in it"),
    ("eye", "the eye that a channel is for"),
    ("hangs", "the side of the viewer to which the display's upper edge is turned"),
    ("origin", "its upper left pixel on the screen; of projectors and warp files, of its window"),
    ("metres", "width × height of what it lights of the screen, through the middle"),
    ("degrees", "the same, as seen from the eye"),
    ("px/°", "pixels per degree in that middle, the lower of across and down; eyes tell about 60"),
    (
        "sampling",
        "pixels drawn for one of the display, least–most: 1 is exact, below 1 is blurred, above 1 \
         costs time",
    ),
    ("spill", "the share of its pixels that miss the screen, and light nothing"),
];

/// The ways in which a channel is drawn, by the words under `frustum`.
const FRUSTA: [(&str, &str); 3] = [
    ("shared", "drawn as a part of the picture of its whole screen"),
    ("own", "drawn by a frustum of its own"),
    ("warp", "drawn flat, then bent onto the screen"),
];

fn write_legend(f: &mut fmt::Formatter<'_>, columns: &[Column]) -> fmt::Result {
    writeln!(f)?;
    for (head, what) in LEGEND.iter().filter(|(head, _)| columns.iter().any(|c| c.head == *head)) {
        writeln!(f, "{head}: {what}")?;
    }
    let frusta = columns.iter().find(|column| column.head == "frustum");
    let is_there = |name: &str| frusta.is_some_and(|c| c.cells.iter().any(|cell| cell == name));
    let there = FRUSTA.iter().filter(|(name, _)| is_there(name));
    let there: Vec<String> = there.map(|(name, what)| format!("{name}: {what}")).collect();
    writeln!(f, "frustum: {}", there.join("; "))
}

/// 2073600 as 2,073,600.
pub(super) fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
