//! `polyptych wall`: makes wall files, and writes to them.

mod arch;
mod cave;
mod cylinder;
mod dome;
mod grid;
mod import;
mod made;
mod optics;
mod pose;
mod projectors;
mod save;
mod warps;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::anyhow;
use polyptych_text::counted;
use polyptych_wall_file::check_report::CheckReport;

use super::say;
use crate::outputs;

#[derive(Debug, clap::Subcommand)]
pub(super) enum WallCommand {
    /// Displays or projectors in columns and rows on one plane, with bezels or overlaps
    Grid(grid::Arguments),
    /// Flat screens in an arch around the viewer, displays or each with a projector
    Arch(arch::Arguments),
    /// Displays or projectors side by side on a cylinder around the viewer
    Cylinder(cylinder::Arguments),
    /// Walls of a room: left, front, right, floor, ceiling, back
    Cave(cave::Arguments),
    /// Projectors at the rim of a dome
    Dome(dome::Arguments),
    /// A fisheye picture: one lens in a dome, or a dome master
    Fisheye(warps::FisheyeArguments),
    /// A picture of all directions: longitude across, latitude up
    Equirectangular(warps::EquirectangularArguments),
    /// Six pictures of 90 degrees each around the eye
    CubeMap(warps::CubeMapArguments),
    /// A projector that lights a dome over a spherical mirror
    Mirror(warps::MirrorArguments),
    /// Make a wall file of another system's wall: MPCDI, SGCT, OpenSpace, Tide, Equalizer
    Import(import::Arguments),
    /// Write what was tuned on the running wall into its wall file
    Save(save::Arguments),
    /// Print the JSON Schema of wall files, for editors and programs
    Schema,
}

/// What every kind of wall has.
#[derive(Debug, clap::Args)]
pub(super) struct Common {
    /// What to call the wall
    #[arg(long)]
    name: Option<String>,
    /// How high the viewer's eye is above the floor, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "1.6")]
    eye_height: f64,
    /// The wall file to write [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write over a file that is there
    #[arg(long, requires = "output")]
    force: bool,
}

pub(super) fn run(wall: &WallCommand) -> anyhow::Result<ExitCode> {
    match wall {
        WallCommand::Grid(arguments) => write(|| arguments.text(), &arguments.common)?,
        WallCommand::Arch(arguments) => write(|| arguments.text(), &arguments.common)?,
        WallCommand::Cylinder(arguments) => write(|| arguments.text(), &arguments.common)?,
        WallCommand::Cave(arguments) => write(|| arguments.text(), &arguments.common)?,
        WallCommand::Dome(arguments) => write(|| arguments.text(), &arguments.common)?,
        WallCommand::Fisheye(arguments) => arguments.run()?,
        WallCommand::Equirectangular(arguments) => arguments.run()?,
        WallCommand::CubeMap(arguments) => arguments.run()?,
        WallCommand::Mirror(arguments) => arguments.run()?,
        WallCommand::Import(arguments) => import::run(arguments)?,
        WallCommand::Save(arguments) => save::run(arguments)?,
        WallCommand::Schema => say(polyptych_wall_file::schema().trim_end())?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Makes and writes a wall file that passes its own check, if its path can be written.
fn write(make: impl FnOnce() -> anyhow::Result<String>, common: &Common) -> anyhow::Result<()> {
    // Before the work: the lenses of a dome take a second.
    if let Some(path) = &common.output {
        outputs::check_source(path, common.force)?;
    }
    let text = make()?;
    let path = common.output.as_deref().unwrap_or(Path::new("wall.toml"));
    let wall = polyptych_wall_file::parse(&text, path).map_err(|error| {
        anyhow!("these numbers make no wall: {}: {}; {}", error.key(), error.what(), error.remedy())
    })?;
    let Some(path) = &common.output else { return say(text.trim_end()) };
    outputs::write(path, text.as_bytes())?;
    let table = CheckReport::from_wall(&wall);
    say(format_args!("{}: {}", path.display(), kind(&table)))?;
    table.warnings.iter().try_for_each(|warning| say(format_args!("warning: {warning}")))?;
    say(format_args!("polyptych check {} prints it", path.display()))
}

/// What the channels of a wall are, in one line.
fn kind(table: &CheckReport) -> String {
    let count = counted(table.channels.len(), "channel");
    let projectors: Vec<_> = table.channels.iter().filter_map(|row| row.projector).collect();
    let Some(first) = projectors.first() else {
        return format!("{count} on the surface: panels, or projectors that something else warps");
    };
    let distances = projectors.iter().filter_map(|projector| projector.distance_m);
    let near = distances.clone().fold(f64::INFINITY, f64::min);
    let far = distances.fold(0.0, f64::max);
    let low = projectors.iter().map(|of| of.position_m[1]).fold(f64::INFINITY, f64::min);
    format!(
        "{count} of projectors by pose, throw {:.2}:1, {near:.2} to {far:.2} m from what they \
         light, lenses {low:.2} m above the floor or higher",
        first.throw_ratio
    )
}

/// The beginning of every wall file: comments, and what holds for the whole wall.
fn head(common: &Common, kind: &str, comments: &[String], eye: [f64; 3]) -> String {
    let name = common.name.as_deref().unwrap_or(kind);
    let mut text = String::new();
    for line in comments {
        let _ = writeln!(text, "{}", format!("# {line}").trim_end());
    }
    let [x, y, z] = eye.map(round);
    let _ = writeln!(
        text,
        "\n[wall]\nname = {name:?}\n\
         eye = [{x:?}, {y:?}, {z:?}]   # metres: x right, y up, the viewer looks along -z\n"
    );
    text
}

/// A square pattern of displays, for people: at most a few are drawn.
fn drawing(columns: u32, rows: u32) -> Vec<String> {
    let (columns, rows) = (columns.min(8) as usize, rows.min(4) as usize);
    let line = format!("  {}+", "+-------".repeat(columns));
    let mut lines = vec![line.clone()];
    for row in 1..=rows {
        let cells: Vec<String> = (1..=columns).map(|c| format!("|  {c}-{row}  ")).collect();
        lines.push(format!("  {}|", cells.concat()));
        lines.push(line.clone());
    }
    lines
}

/// To a ten-millionth of a metre, which no wall is measured to.
fn round(number: f64) -> f64 {
    // Adding zero takes the sign from a zero.
    (number * 1e7).round() / 1e7 + 0.0
}

/// A length in metres, as an argument.
fn metres(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of metres"))?;
    let fits = (1e-3..=1e5).contains(&number);
    fits.then_some(number).ok_or_else(|| format!("{text} metres are not within 0.001 to 100000"))
}

/// An angle in degrees, as an argument.
fn degrees(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of degrees"))?;
    let fits = (1.0..=360.0).contains(&number);
    fits.then_some(number).ok_or_else(|| format!("{text} degrees are not within 1 to 360"))
}

/// Width and height in pixels, as an argument: `1920x1080`.
pub(super) fn pixels(text: &str) -> Result<[u32; 2], String> {
    let pair = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    pair.ok_or_else(|| format!("{text:?} is no size in pixels; write WIDTHxHEIGHT"))
}

/// Lengths across and down in metres, as an argument: `0.02x0.03`.
fn gaps(text: &str) -> Result<[f64; 2], String> {
    let pair = text.split_once('x').and_then(|(x, y)| Some([x.parse().ok()?, y.parse().ok()?]));
    let fits = |pair: &[f64; 2]| pair.iter().all(|gap| (0.0..=1e3).contains(gap));
    pair.filter(fits).ok_or_else(|| format!("{text:?} are no gaps; write ACROSSxDOWN in metres"))
}

#[cfg(test)]
mod tests;
