//! What `polyptych check` says about a wall: who shows what, how large, how sharp.

use std::fmt;

use glam::{DVec2, DVec3, UVec2};
use serde::Serialize;

use super::{Channel, Projection, Screen, Wall};

/// Pixels whose sides differ by more than this show circles as ellipses that one can see.
const ANISOTROPY_MAX: f64 = 0.01;

/// A wall in numbers. Displays as text with units; serialises for `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WallTable {
    /// The wall's name.
    pub name: String,
    /// Pixels of all channels together.
    pub pixels_total: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// Where the eye stands, in metres of display space.
    pub eye_m: [f64; 3],
    /// The near plane's distance from the eye in metres.
    pub near_m: f64,
    /// In the order of the wall file.
    pub screens: Vec<ScreenRow>,
    /// In the order of the wall file.
    pub channels: Vec<ChannelRow>,
    /// What works, but will not look its best.
    pub warnings: Vec<String>,
}

/// A screen in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScreenRow {
    /// The screen's name.
    pub name: String,
    /// Width and height in metres, bezels included.
    pub size_m: [f64; 2],
    /// Width and height of the canvas in pixels, bezels included.
    pub pixels: [u32; 2],
    /// From the eye to the screen's plane in metres.
    pub eye_distance_m: f64,
    /// The gaps between tiles, where the wall file asks for such.
    pub bezel: Option<BezelRow>,
}

/// How a bezel was rounded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BezelRow {
    /// What the wall file asks for, across and down, in metres.
    pub asked_m: [f64; 2],
    /// The even numbers of pixels nearest to it.
    pub pixels: [u32; 2],
    /// What these are in metres.
    pub in_force_m: [f64; 2],
}

/// A channel in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelRow {
    /// The channel's name.
    pub name: String,
    /// The name of its screen.
    pub screen: String,
    /// The server that drives it.
    pub server: String,
    /// Width and height.
    pub pixels: [u32; 2],
    /// The upper left pixel on the screen's canvas.
    pub origin: [u32; 2],
    /// Width and height in metres.
    pub size_m: [f64; 2],
    /// The angles between the middles of opposite edges as seen from the eye, across and down.
    pub degrees: [f64; 2],
    /// At the channel's centre, across or down, whichever is fewer. An eye with full sight tells
    /// about 60 apart.
    pub pixels_per_degree: f64,
    /// How it gets its frustum: `shared` or `own`.
    pub projection: &'static str,
}

impl WallTable {
    /// The numbers of a wall, from its own eye.
    pub fn of(wall: &Wall) -> Self {
        Self {
            name: wall.name.clone(),
            pixels_total: wall.channels.iter().map(|c| area(c.size)).sum(),
            samples: wall.samples,
            eye_m: wall.eye.to_array(),
            near_m: wall.near_m,
            screens: wall.screens.iter().map(|screen| screen_row(screen, wall.eye)).collect(),
            channels: wall.channels.iter().map(|channel| channel_row(wall, channel)).collect(),
            warnings: warnings(wall),
        }
    }
}

fn area(size: UVec2) -> u64 {
    u64::from(size.x) * u64::from(size.y)
}

fn pitch_m(screen: &Screen) -> DVec2 {
    screen.size_m() / screen.canvas.as_dvec2()
}

fn screen_row(screen: &Screen, eye: DVec3) -> ScreenRow {
    ScreenRow {
        name: screen.name.clone(),
        size_m: screen.size_m().to_array(),
        pixels: screen.canvas.to_array(),
        eye_distance_m: screen.frustum(eye).map_or(f64::NAN, |seen| seen.distance_m),
        bezel: screen.bezel.map(|bezel| BezelRow {
            asked_m: bezel.asked_m.to_array(),
            pixels: bezel.pixels.to_array(),
            in_force_m: (bezel.pixels.as_dvec2() * pitch_m(screen)).to_array(),
        }),
    }
}

fn channel_row(wall: &Wall, channel: &Channel) -> ChannelRow {
    let screen = wall.screen_of(channel);
    let size = channel.size.as_dvec2();
    let center = channel.origin.as_dvec2() + size / 2.0;
    let degrees_over = |step: DVec2| {
        let point = |at: DVec2| screen.display_from_canvas(at).map(|point| point - wall.eye);
        let ends = point(center - step / 2.0).zip(point(center + step / 2.0));
        ends.map_or(f64::NAN, |(from, to)| angle(from, to).to_degrees())
    };
    let degrees = [degrees_over(DVec2::X * size), degrees_over(DVec2::Y * size)];
    let degrees_per_pixel = degrees_over(DVec2::X).max(degrees_over(DVec2::Y));
    ChannelRow {
        name: channel.name.clone(),
        screen: screen.name.clone(),
        server: channel.server.clone(),
        pixels: channel.size.to_array(),
        origin: channel.origin.to_array(),
        size_m: (size * pitch_m(screen)).to_array(),
        degrees,
        pixels_per_degree: 1.0 / degrees_per_pixel,
        projection: match channel.projection {
            Projection::Shared => "shared",
            Projection::Own => "own",
        },
    }
}

/// The angle between two directions in radians, exact for the tiny angles of one pixel, where the
/// arc cosine is not: W. Kahan, *How Futile are Mindless Assessments of Roundoff*, 2006, §12.
fn angle(a: DVec3, b: DVec3) -> f64 {
    let (scaled_a, scaled_b) = (a * b.length(), b * a.length());
    2.0 * (scaled_a - scaled_b).length().atan2((scaled_a + scaled_b).length())
}

fn warnings(wall: &Wall) -> Vec<String> {
    let mut warnings = Vec::new();
    for screen in &wall.screens {
        let pitch = pitch_m(screen);
        let ratio = pitch.max_element() / pitch.min_element();
        if ratio > 1.0 + ANISOTROPY_MAX {
            let [x, y] = (pitch * 1e3).to_array();
            warnings.push(format!(
                "screen {}: its pixels are {x:.4} mm wide and {y:.4} mm high, {:.1} % apart; \
                 check its metres and pixels",
                screen.name,
                (ratio - 1.0) * 100.0
            ));
        }
    }
    for channel in &wall.channels {
        if channel.origin % 2 != UVec2::ZERO {
            warnings.push(format!(
                "channel {}: its origin [{}, {}] is odd, so that textures may differ from its \
                 neighbours'; even numbers are best",
                channel.name, channel.origin.x, channel.origin.y
            ));
        }
    }
    warnings
}

impl fmt::Display for WallTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.eye_m;
        let (channels, screens) = (self.channels.len(), self.screens.len());
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        writeln!(
            f,
            "wall {}: {channels} channel{} on {screens} screen{}, {} pixels, {} sample{} per pixel",
            self.name,
            plural(channels),
            plural(screens),
            thousands(self.pixels_total),
            self.samples,
            plural(self.samples as usize)
        )?;
        writeln!(f, "eye at [{x}, {y}, {z}] m, near plane {} m from it\n", self.near_m)?;
        self.screens.iter().try_for_each(|screen| write!(f, "{screen}"))?;
        writeln!(f)?;
        write_aligned(f, &self.rows())?;
        if !self.warnings.is_empty() {
            writeln!(f)?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}

impl fmt::Display for ScreenRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([w, h], [columns, rows]) = (self.size_m, self.pixels);
        writeln!(
            f,
            "screen {}: {w:.3} × {h:.3} m, {columns} × {rows} pixels, {:.3} m from the eye",
            self.name, self.eye_distance_m
        )?;
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

impl WallTable {
    /// The channels as cells, under a row of heads.
    fn rows(&self) -> Vec<[String; 9]> {
        let heads = [
            "channel", "screen", "server", "pixels", "origin", "metres", "degrees", "px/°",
            "frustum",
        ];
        let mut rows = vec![heads.map(str::to_owned)];
        rows.extend(self.channels.iter().map(|c| {
            [
                c.name.clone(),
                c.screen.clone(),
                c.server.clone(),
                format!("{} × {}", c.pixels[0], c.pixels[1]),
                format!("{}, {}", c.origin[0], c.origin[1]),
                format!("{:.3} × {:.3}", c.size_m[0], c.size_m[1]),
                format!("{:.2} × {:.2}", c.degrees[0], c.degrees[1]),
                format!("{:.1}", c.pixels_per_degree),
                c.projection.to_owned(),
            ]
        }));
        rows
    }
}

/// Columns as wide as their widest cell; numbers, which are columns 3 to 7, to the right.
fn write_aligned<const N: usize>(f: &mut fmt::Formatter<'_>, rows: &[[String; N]]) -> fmt::Result {
    let widths: [usize; N] = std::array::from_fn(|column| {
        rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0)
    });
    for row in rows {
        let mut line = String::new();
        for (column, (cell, width)) in row.iter().zip(widths).enumerate() {
            let padding = " ".repeat(width - cell.chars().count());
            let (before, after) = if (3..8).contains(&column) {
                (padding, String::new())
            } else {
                (String::new(), padding)
            };
            line.extend([before.as_str(), cell, &after, "  "]);
        }
        writeln!(f, "{}", line.trim_end())?;
    }
    Ok(())
}

/// 2073600 as 2,073,600.
fn thousands(number: u64) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wall::file;

    fn table(text: &str) -> WallTable {
        WallTable::of(&file::parse(text, "wall.toml".as_ref()).unwrap())
    }

    const TWO_BY_TWO: &str = r#"
        [wall]
        name = "wall"
        [[screen]]
        name = "front"
        size = [1.92, 1.08]
        center = [0.0, 0.0, -0.96]
        [screen.tiles]
        columns = 2
        rows = 2
        pixels = [960, 540]
    "#;

    #[test]
    fn a_wall_in_numbers() {
        let table = table(TWO_BY_TWO);
        assert_eq!(table.pixels_total, 1920 * 1080);
        let channel = &table.channels[3];
        assert_eq!((channel.name.as_str(), channel.origin), ("front-2-2", [960, 540]));
        assert!((channel.size_m[0] - 0.96).abs() < 1e-12);
        // The middle of the tile is 0.27 m below the eye: its edges 0.96 m apart at 0.9973 m.
        let half = (0.96_f64 * 0.96 + 0.27 * 0.27).sqrt();
        assert!((channel.degrees[0] - (0.96 / half).atan().to_degrees()).abs() < 1e-9);
        assert_eq!(table.screens[0].eye_distance_m, 0.96);
        assert_eq!(table.warnings, [] as [String; 0]);
    }

    #[test]
    fn a_pixel_at_the_foot_of_the_eye_has_the_angle_of_its_pitch() {
        let table = table(&TWO_BY_TWO.replace("columns = 2", "").replace("rows = 2", ""));
        // One tile of 960 × 540 on 1.92 × 1.08 m: 2 mm at 0.96 m.
        let expected = 1.0 / (2.0 * (0.001_f64 / 0.96).atan()).to_degrees();
        assert!((table.channels[0].pixels_per_degree / expected - 1.0).abs() < 1e-9);
    }

    #[test]
    fn bezels_are_reported_with_their_rounding() {
        let text = format!("{TWO_BY_TWO}\nbezel = [0.0137, 0.0]");
        let table = table(&text);
        let bezel = table.screens[0].bezel.unwrap();
        assert_eq!((bezel.asked_m, bezel.pixels), ([0.0137, 0.0], [14, 0]));
        assert!((bezel.in_force_m[0] - 14.0 * 1.92 / 1934.0).abs() < 1e-12);
        assert!(table.to_string().contains("13.70 × 0.00 mm asked, 14 × 0 pixels in force"));
    }

    #[test]
    fn odd_origins_and_uneven_pixels_are_warned_of() {
        let odd = table(&TWO_BY_TWO.replace("960, 540", "961, 540"));
        assert_eq!(odd.warnings.len(), 2, "{:?}", odd.warnings);
        assert!(odd.warnings[0].starts_with("channel front-2-1: its origin [961, 0] is odd"));
        let uneven = table(&TWO_BY_TWO.replace("960, 540", "960, 560"));
        assert!(uneven.warnings[0].contains("1.0000 mm wide and 0.9643 mm high, 3.7 % apart"));
    }

    #[test]
    fn the_text_is_aligned() {
        let text = table(TWO_BY_TWO).to_string();
        let expected = "wall wall: 4 channels on 1 screen, 2,073,600 pixels, 1 sample per pixel\n";
        assert!(text.starts_with(expected), "{text}");
        let ends: Vec<usize> = text
            .lines()
            .filter(|line| line.ends_with("shared"))
            .map(|line| line.chars().count())
            .collect();
        assert!(ends.len() == 4 && ends.iter().all(|end| *end == ends[0]), "{text}");
        assert!(serde_json::to_string(&table(TWO_BY_TWO)).unwrap().contains("\"degrees\":["));
    }

    #[test]
    fn thousands_are_grouped() {
        assert_eq!([0, 999, 1000, 2_073_600].map(thousands), ["0", "999", "1,000", "2,073,600"]);
    }
}
