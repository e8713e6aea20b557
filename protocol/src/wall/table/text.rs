//! A wall's numbers as text with units.

use std::fmt;

use super::{BezelRow, CoverageRow, OverlapRow, PatchRow, ScreenRow, WallTable};
use crate::wall::EyeOf;

/// Most overlaps and holes of a screen that are printed: `--json` has all.
const LINES_MAX: usize = 8;

impl fmt::Display for WallTable {
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
        let form = match self.surface {
            "plane" => String::new(),
            curved => format!("{curved}, "),
        };
        let metres = if w > 0.0 { format!("{w:.3} × {h:.3} m, ") } else { String::new() };
        let distance = match self.eye_distance_m {
            known if known.is_finite() => format!(", {known:.3} m from the eye"),
            _ => String::new(),
        };
        writeln!(f, "screen {}: {form}{metres}{columns} × {rows} pixels{distance}", self.name)?;
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
            EyeOf::Center => "",
            EyeOf::Left => ", left eye",
            EyeOf::Right => ", right eye",
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

impl fmt::Display for PatchRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([x, y], [width, height]) = (self.origin, self.pixels);
        write!(f, "{width:.0} × {height:.0} pixels at [{x:.0}, {y:.0}]")?;
        match self.size_m {
            [across, down] if across.is_finite() && down.is_finite() => {
                write!(f, ", {across:.3} × {down:.3} m")
            }
            _ => Ok(()),
        }
    }
}

impl WallTable {
    /// The channels as cells, under a row of heads.
    fn rows(&self) -> Vec<[String; 11]> {
        let heads = [
            "channel", "screen", "server", "pixels", "origin", "metres", "degrees", "px/°",
            "sampling", "spill", "frustum",
        ];
        let mut rows = vec![heads.map(str::to_owned)];
        rows.extend(self.channels.iter().map(|c| {
            [
                c.name.clone(),
                c.screen.clone(),
                c.server.clone(),
                format!("{} × {}", c.pixels[0], c.pixels[1]),
                format!("{}, {}", c.origin[0], c.origin[1]),
                known(c.size_m[0], format!("{:.3} × {:.3}", c.size_m[0], c.size_m[1])),
                known(c.degrees[0], format!("{:.2} × {:.2}", c.degrees[0], c.degrees[1])),
                known(c.pixels_per_degree, format!("{:.1}", c.pixels_per_degree)),
                known(c.sampling[0], format!("{:.2}–{:.2}", c.sampling[0], c.sampling[1])),
                format!("{:.1} %", c.spill * 100.0),
                c.projection.to_owned(),
            ]
        }));
        rows
    }
}

/// A cell, or a dash where only a file knows what would stand there.
fn known(number: f64, cell: String) -> String {
    if number.is_finite() { cell } else { "–".to_owned() }
}

/// Columns as wide as their widest cell; numbers, which are columns 3 to 9, to the right.
fn write_aligned<const N: usize>(f: &mut fmt::Formatter<'_>, rows: &[[String; N]]) -> fmt::Result {
    let widths: [usize; N] = std::array::from_fn(|column| {
        rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0)
    });
    for row in rows {
        let mut line = String::new();
        for (column, (cell, width)) in row.iter().zip(widths).enumerate() {
            let padding = " ".repeat(width - cell.chars().count());
            let (before, after) = if (3..10).contains(&column) {
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

/// A number of things in words.
fn counted(count: usize, thing: &str) -> String {
    if count == 1 { format!("1 {thing}") } else { format!("{count} {thing}s") }
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
