//! `polyptych wall import`: another system's wall becomes a wall file, with its maps beside it.
//!
//! | file | system |
//! |---|---|
//! | archive | MPCDI |
//! | JSON or XML with a cluster of nodes | SGCT, OpenSpace |
//! | JSON with surfaces, XML with dimensions | Tide, DisplayCluster |
//! | text with canvases (`.eqc`) | Equalizer |
//!
//! Files are foreign, so this process limits itself as the baker does.

mod eqc;
mod json;
mod mask;
mod mesh;
mod sgct;
mod tide;
mod tree;
mod xml;

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use glam::{DVec2, DVec3, UVec2};
use polyptych_manager::bake::map::mpcdi::{self, Imported, ImportedRegion, Profile};
use polyptych_protocol::words::counted;

use super::super::{bake, manager, say};
use super::made::Made;
use crate::outputs;
use tree::{CONFIG_BYTES_MAX, Tree};

/// What can be imported, as a remedy.
const CONFIGURATIONS: &str =
    "MPCDI archives and configurations of SGCT, OpenSpace, Tide and Equalizer are read";

/// How far from the eye the planes of frusta stand, in metres: for one eye any distance is right.
const FRUSTUM_DISTANCE_M: f64 = 2.0;

#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// An MPCDI archive of profile 2d or 3d, or a configuration of SGCT, OpenSpace or Tide (JSON or
    /// XML) or Equalizer
    file: PathBuf,
    /// The folder for wall.toml and the maps; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Width of the screen in metres, of which profile 2d and Tide say nothing
    #[arg(long, value_name = "METRES", default_value_t = 4.0)]
    width: f64,
    /// From the eye to the screen in metres, of which profile 2d and Tide say nothing
    #[arg(long, value_name = "METRES", default_value_t = 4.0)]
    distance: f64,
    /// Replace a wall.toml that is there
    #[arg(long)]
    force: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    for (name, metres) in [("--width", arguments.width), ("--distance", arguments.distance)] {
        if !(0.01..=1000.0).contains(&metres) {
            bail!("{name} {metres}: 0.01 to 1000 metres would be right");
        }
    }
    let folder = &arguments.output;
    let wall_file = folder.join("wall.toml");
    outputs::make_folder(folder)?;
    outputs::check_source(&wall_file, arguments.force)?;
    bake::limit_memory(manager::BAKE_MEMORY_MIB_DEFAULT)?;
    if !starts_as_archive(&arguments.file)? {
        return configuration(arguments);
    }
    let imported = mpcdi::import(&arguments.file, folder, &AtomicBool::new(false))?;
    let text = wall_text(arguments, &imported);
    outputs::write(&wall_file, text.as_bytes())?;
    say(format_args!(
        "{}: {} of a buffer of {} × {} pixels",
        wall_file.display(),
        counted(imported.regions.len(), "channel"),
        imported.buffer.x,
        imported.buffer.y
    ))?;
    imported.notes.iter().try_for_each(|note| say(format_args!("note: {note}")))
}

fn starts_as_archive(file: &Path) -> anyhow::Result<bool> {
    let mut first = Vec::new();
    let opened = File::open(file).with_context(|| format!("cannot open {}", file.display()))?;
    opened.take(2).read_to_end(&mut first)?;
    Ok(first == b"PK")
}

/// Imports a configuration of text, and tells what is left out.
fn configuration(arguments: &Arguments) -> anyhow::Result<()> {
    let (made, tree) = read_configuration(arguments)?;
    made.write(&arguments.output, arguments.force)?;
    let tell = |kind: &str, lines: &[String]| {
        lines.iter().try_for_each(|line| say(format_args!("{kind}: {line}")))
    };
    tell("warning", &tree.warnings.borrow())?;
    tell("note", &tree.notes.borrow())?;
    say(format_args!("polyptych check {} prints it", arguments.output.join("wall.toml").display()))
}

/// The system and the wall of a tree, whose root element XML names.
fn text_of(
    arguments: &Arguments,
    tree: Tree,
    root: &str,
) -> anyhow::Result<(&'static str, Tree, Made)> {
    if tide::is_tide(&tree, root) {
        let made = tide::read(&tree, arguments.width, arguments.distance)?;
        return Ok(("Tide", tree, made));
    }
    if !["", "cluster"].contains(&root) {
        return Err(tree.at().error(format!("<{root}> is not known"), CONFIGURATIONS));
    }
    let made = sgct::read(&tree)?;
    Ok(("SGCT", tree, made))
}

/// A configuration as a wall, with comments on what is not as it was.
fn read_configuration(arguments: &Arguments) -> anyhow::Result<(Made, Tree)> {
    let path = &arguments.file;
    let name = path.display();
    let size = fs::metadata(path).with_context(|| format!("cannot open {name}"))?.len();
    if size > CONFIG_BYTES_MAX {
        bail!("{name} has {size} bytes; a configuration has {CONFIG_BYTES_MAX} at most");
    }
    let text = fs::read_to_string(path)
        .with_context(|| format!("cannot read {name}; JSON or XML in UTF-8 would be right"))?;
    let text = text.trim_start_matches('\u{feff}');
    let (system, tree, mut made) = match text.trim_start().chars().next() {
        Some('{') => {
            let tree = json::parse(path, text)?;
            text_of(arguments, tree, "")?
        }
        Some('<') => {
            let (tree, root) = xml::parse(path, text)?;
            text_of(arguments, tree, &root)?
        }
        _ if eqc::is_eqc(text) => {
            let tree = eqc::parse(path, text)?;
            let made = eqc::read(&tree)?;
            ("Equalizer", tree, made)
        }
        _ => bail!("{name} is no configuration; {CONFIGURATIONS}"),
    };
    for name in made.pair_eyes() {
        tree.warn(format!(
            "{name} is for one eye, and no channel shows its screen to the other: it shows what is \
             seen between the eyes"
        ));
    }
    let from = path.file_name().unwrap_or_default().to_string_lossy();
    let mut comments = vec![format!("Made of {from}, a configuration of {system}.")];
    comments.append(&mut made.comments);
    comments.extend(tree.warnings.borrow().iter().map(|line| format!("Warning: {line}.")));
    comments.extend(tree.notes.borrow().iter().map(|line| format!("Note: {line}.")));
    made.comments = comments;
    Ok((made, tree))
}

/// The wall file; every name in it is one that such a file may have.
fn wall_text(arguments: &Arguments, imported: &Imported) -> String {
    let mut text = String::from("#:schema ./wall.schema.json\n#\n");
    let from = arguments.file.file_name().unwrap_or_default().to_string_lossy();
    let from: String = from.chars().filter(|c| !c.is_control()).collect();
    let (profile, about) = match imported.profile {
        Profile::TwoD => {
            ("2d", "It says nothing of metres: put the screen and the eye where they are.")
        }
        Profile::ThreeD => ("3d", "Each screen is the plane of its projector's frustum."),
    };
    let _ = write!(text, "# Made of {from}, MPCDI of profile {profile}.\n# {about}\n");
    for note in &imported.notes {
        let _ = writeln!(text, "# Note: {note}.");
    }
    let name = wall_name(&arguments.file);
    let _ = write!(text, "\n[wall]\nname = \"{name}\"\neye = [0.0, 0.0, 0.0]           # metres\n");
    match imported.profile {
        Profile::TwoD => screen_of_buffer(&mut text, arguments, imported),
        Profile::ThreeD => imported.regions.iter().for_each(|region| frustum(&mut text, region)),
    }
    for region in &imported.regions {
        let _ = write!(text, "\n[channel.\"{}\"]\nwarp = \"{}\"\n", region.name, region.warp);
        for (key, file) in [("alpha", &region.alpha), ("beta", &region.beta)] {
            if let Some(file) = file {
                let _ = writeln!(text, "{key} = \"{file}\"");
            }
        }
    }
    text
}

/// One plane whose canvas is the buffer.
fn screen_of_buffer(text: &mut String, arguments: &Arguments, imported: &Imported) {
    let buffer = imported.buffer;
    let size = DVec2::new(1.0, f64::from(buffer.y) / f64::from(buffer.x)) * arguments.width;
    let _ = write!(
        text,
        "\n[[screen]]\nname = \"screen\"\nsize = [{:?}, {:?}]            # metres\n\
         center = [0.0, 0.0, {:?}]\npixels = [{}, {}]\n",
        size.x, size.y, -arguments.distance, buffer.x, buffer.y
    );
    for region in &imported.regions {
        channel(text, region, buffer);
    }
}

/// The plane of one region's frustum.
fn frustum(text: &mut String, region: &ImportedRegion) {
    let Some(pyramid) = &region.pyramid else { return };
    let corners = mpcdi::corners(pyramid, DVec3::ZERO, FRUSTUM_DISTANCE_M);
    let _ = write!(text, "\n[[screen]]\nname = \"{}\"\n", region.name);
    for (key, corner) in ["lower_left", "lower_right", "upper_left"].iter().zip(corners) {
        let _ = writeln!(text, "{key} = [{:?}, {:?}, {:?}]", corner.x, corner.y, corner.z);
    }
    let _ = writeln!(text, "pixels = [{}, {}]", region.size.x, region.size.y);
    channel(text, region, region.size);
}

/// A channel on a canvas: its warp says what it shows, so its origin is only its window's, and is
/// left out where so many pixels have no room there.
fn channel(text: &mut String, region: &ImportedRegion, canvas: UVec2) {
    let (name, size) = (&region.name, region.size);
    let _ = write!(text, "[[screen.channel]]\nname = \"{name}\"\n");
    let origin = if canvas == size { UVec2::ZERO } else { region.part.0 };
    if (origin + size).cmple(canvas).all() {
        let _ = writeln!(text, "origin = [{}, {}]", origin.x, origin.y);
    }
    let _ = writeln!(text, "pixels = [{}, {}]", size.x, size.y);
}

/// The archive's name in the letters that a wall's may have.
fn wall_name(file: &Path) -> String {
    const BYTES_MAX: usize = 64;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let letter = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    let name: String = stem.chars().take(BYTES_MAX).map(letter).collect();
    if name.is_empty() { "wall".to_owned() } else { name }
}

#[cfg(test)]
mod tests;
