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
use std::slice;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use glam::{DVec2, DVec3, UVec2};
use polyptych_baker::map::mpcdi::{
    self, Imported, ImportedBuffer, ImportedRegion, Profile, RegionFrustum,
};
use polyptych_text::counted;
use tree::{CONFIG_BYTES_MAX, Tree};

use super::super::bake_arguments::BAKE_MEMORY_MIB_DEFAULT;
use super::super::{bake, say};
use super::made::{Made, check_text, plain_name};
use crate::outputs;

/// What can be imported, as a remedy.
const CONFIGURATIONS: &str =
    "MPCDI archives and configurations of SGCT, OpenSpace, Tide and Equalizer are read";

/// How far from the eye the planes of frusta stand, in metres: for one eye any distance is right.
const FRUSTUM_DISTANCE_M: f64 = 2.0;

/// Cosine of how far a projector's axis may be from the middle of all.
const AXIS_COSINE_MIN: f64 = 0.34;

/// An axis whose height changes by more than this share looks up or down.
const UPRIGHT_MAX: f64 = 0.99;

/// Rays nearer to the plane than this, as a cosine with its normal, end there.
const GRAZING_COSINE: f64 = 0.1;

/// Most pixels of the plane's canvas along a side.
const CANVAS_MAX: f64 = 32_768.0;

/// How far into a text its root element is looked for, in bytes: comments may stand before it.
const ROOT_BYTES_MAX: u64 = 4096;

#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// An MPCDI archive of profile 2d, 3d or sl (of sl, the text alone suffices), or a
    /// configuration of SGCT, OpenSpace or Tide (JSON or XML) or Equalizer
    file: PathBuf,
    /// The folder for wall.toml and the maps; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Width of each screen in metres, of which profile 2d and Tide say nothing
    #[arg(long, value_name = "METRES", default_value_t = 4.0)]
    width: f64,
    /// From the eye to the screen in metres, of which profiles 2d and sl and Tide say nothing
    #[arg(long, value_name = "METRES", default_value_t = 4.0)]
    distance: f64,
    /// Replace a wall.toml and maps that are there
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
    let is_new = fs::symlink_metadata(folder).is_err();
    outputs::make_folder(folder)?;
    outputs::check_made(&wall_file, arguments.force, slice::from_ref(&arguments.file))?;
    bake::limit_memory(BAKE_MEMORY_MIB_DEFAULT)?;
    let done = is_mpcdi(&arguments.file).and_then(|is_mpcdi| {
        if is_mpcdi { archive(arguments, &wall_file) } else { configuration(arguments) }
    });
    if is_new && done.is_err() {
        // Removes nothing but an empty folder: of a file that was refused before it was read.
        let _ = fs::remove_dir(folder);
    }
    done
}

/// Imports an archive, and tells what was assumed.
fn archive(arguments: &Arguments, wall_file: &Path) -> anyhow::Result<()> {
    let names = mpcdi::file_names(&arguments.file)?;
    let maps: Vec<PathBuf> = names.iter().map(|name| arguments.output.join(name)).collect();
    for map in &maps {
        outputs::check_made(map, arguments.force, slice::from_ref(&arguments.file))?;
    }
    let is_new = |map: &&PathBuf| fs::symlink_metadata(map).is_err();
    let new: Vec<&PathBuf> = maps.iter().filter(is_new).collect();
    let done = unpack(arguments, wall_file);
    if done.is_err() {
        // Another try would refuse to replace them.
        for map in new {
            let _ = fs::remove_file(map);
        }
    }
    let imported = done?;
    let size = |buffer: &ImportedBuffer| format!("{} × {}", buffer.size.x, buffer.size.y);
    let sizes: Vec<String> = imported.buffers.iter().map(size).collect();
    say(format_args!(
        "{}: {} of {} of {} pixels",
        wall_file.display(),
        counted(imported.regions.len(), "channel"),
        if sizes.len() == 1 { "a buffer".to_owned() } else { counted(sizes.len(), "buffer") },
        sizes.join(", ")
    ))?;
    imported.notes.iter().try_for_each(|note| say(format_args!("note: {note}")))
}

/// Writes the maps of an archive and its wall file.
fn unpack(arguments: &Arguments, wall_file: &Path) -> anyhow::Result<Imported> {
    let imported = mpcdi::import(&arguments.file, &arguments.output, &AtomicBool::new(false))?;
    let text = wall_text(arguments, &imported)?;
    check_text(&text, wall_file)?;
    outputs::write(wall_file, text.as_bytes())?;
    Ok(imported)
}

/// Returns whether a file is an archive, or the text of one alone.
fn is_mpcdi(file: &Path) -> anyhow::Result<bool> {
    let mut begin = Vec::new();
    let opened = File::open(file).with_context(|| format!("cannot open {}", file.display()))?;
    opened.take(ROOT_BYTES_MAX).read_to_end(&mut begin)?;
    let is_root = |name: &[u8]| name.eq_ignore_ascii_case(b"<mpcdi");
    Ok(begin.starts_with(b"PK") || begin.windows(6).any(is_root))
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
    made.inputs = tree.inputs.take();
    made.inputs.push(path.clone());
    Ok((made, tree))
}

/// The wall file; every name in it is one that such a file may have.
fn wall_text(arguments: &Arguments, imported: &Imported) -> anyhow::Result<String> {
    let mut text = String::from("#:schema ./wall.schema.json\n#\n");
    let from = arguments.file.file_name().unwrap_or_default().to_string_lossy();
    let from: String = from.chars().filter(|c| !c.is_control()).collect();
    let (profile, about) = match imported.profile {
        Profile::TwoD => {
            ("2d", "It says nothing of metres: put the screen and the eye where they are.")
        }
        Profile::ThreeD => ("3d", "Each screen is the plane of its projector's frustum."),
        Profile::ShaderLamps => ("sl", "The screen is a plane that all projectors light."),
    };
    let _ = write!(text, "# Made of {from}, MPCDI of profile {profile}.\n# {about}\n");
    for note in &imported.notes {
        let _ = writeln!(text, "# Note: {note}.");
    }
    let name = wall_name(&arguments.file);
    let lit = match imported.profile {
        Profile::ShaderLamps => Some(LitPlane::new(&imported.regions, arguments.distance)?),
        Profile::TwoD | Profile::ThreeD => None,
    };
    let eye = lit.as_ref().map_or(DVec3::ZERO, |lit| lit.eye);
    let _ = write!(
        text,
        "\n[wall]\nname = \"{name}\"\neye = {}           # metres\n",
        numbers(eye.to_array())
    );
    match (&lit, imported.profile) {
        (Some(lit), _) => projectors(&mut text, lit, imported),
        (None, Profile::TwoD) => {
            (0..imported.buffers.len()).for_each(|index| {
                screen_of_buffer(&mut text, arguments, imported, index);
            });
        }
        (None, _) => imported.regions.iter().for_each(|region| frustum(&mut text, region)),
    }
    for region in &imported.regions {
        let keys = [("warp", &region.warp), ("alpha", &region.alpha), ("beta", &region.beta)];
        let files = keys.iter().filter_map(|(key, file)| Some((key, file.as_ref()?)));
        let mut lines: Vec<String> =
            files.map(|(key, file)| format!("{key} = \"{file}\"\n")).collect();
        if lit.is_some() && region.alpha.is_some() {
            // The archive shares the light already.
            lines.push("ramps = \"alpha\"\n".to_owned());
        }
        if !lines.is_empty() {
            let _ = write!(text, "\n[channel.\"{}\"]\n{}", region.name, lines.concat());
        }
    }
    Ok(text)
}

/// Numbers as TOML has them.
fn numbers<const N: usize>(numbers: [f64; N]) -> String {
    format!("{:?}", numbers.map(|number| number + 0.0))
}

/// One plane whose canvas is a buffer; planes of several buffers stand side by side.
fn screen_of_buffer(text: &mut String, arguments: &Arguments, imported: &Imported, index: usize) {
    let ImportedBuffer { name, size: buffer } = &imported.buffers[index];
    let is_only = imported.buffers.len() == 1;
    let name = if is_only { "screen" } else { name };
    let size = DVec2::new(1.0, f64::from(buffer.y) / f64::from(buffer.x)) * arguments.width;
    let x = (index as f64 - (imported.buffers.len() - 1) as f64 / 2.0) * arguments.width;
    let _ = write!(
        text,
        "\n[[screen]]\nname = \"{name}\"\nsize = [{:?}, {:?}]            # metres\n\
         center = {}\npixels = [{}, {}]\n",
        size.x,
        size.y,
        numbers([x, 0.0, -arguments.distance]),
        buffer.x,
        buffer.y
    );
    for region in imported.regions.iter().filter(|region| region.buffer == index) {
        channel(text, region, *buffer);
    }
}

/// A plane that projectors light, and an eye before it.
struct LitPlane {
    eye: DVec3,
    /// Lower left, lower right and upper left.
    corners: [DVec3; 3],
    pixels: UVec2,
}

impl LitPlane {
    /// The plane at a right angle to the middle of all axes, so far from the lenses, and as large
    /// as what they light of it.
    ///
    /// # Errors
    /// There is no plane that all of them light.
    fn new(regions: &[ImportedRegion], distance: f64) -> anyhow::Result<Self> {
        let all = || regions.iter().filter_map(|region| Some((region, region.pyramid?)));
        let axis = |pyramid: &RegionFrustum| pyramid.display_from_view() * DVec3::NEG_Z;
        let ahead = all().map(|(_, pyramid)| axis(&pyramid)).sum::<DVec3>().normalize_or_zero();
        if all().any(|(_, pyramid)| axis(&pyramid).dot(ahead) < AXIS_COSINE_MIN) {
            bail!(
                "{}: the projectors look in so different directions that no plane is lit by all; \
                 write the wall file by hand, with [screen.channel.projector] and a mesh",
                "profile sl"
            );
        }
        let count = regions.len() as f64;
        let lens = all().map(|(region, _)| region.position).sum::<DVec3>() / count;
        let upright = if ahead.y.abs() > UPRIGHT_MAX { DVec3::Z } else { DVec3::Y };
        let right = ahead.cross(upright).normalize_or_zero();
        let up = right.cross(ahead);
        let middle = lens + ahead * distance;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut density = 0.0f64;
        for (region, pyramid) in all() {
            let turn = pyramid.display_from_view();
            let [left, right_edge, down, up_edge] = pyramid.tangents();
            let depth = (middle - region.position).dot(ahead);
            density = density.max(f64::from(region.size.x) / (right_edge - left) / depth);
            for (x, y) in [(left, down), (right_edge, down), (left, up_edge), (right_edge, up_edge)]
            {
                let ray = turn * DVec3::new(x, y, -1.0);
                // Corners beyond the horizon end where the plane does.
                let along = depth / ray.dot(ahead).max(GRAZING_COSINE * ray.length());
                let at = region.position + ray * along - middle;
                let place = DVec2::new(at.dot(right), at.dot(up));
                (low, high) = (low.min(place), high.max(place));
            }
        }
        let size = high - low;
        let pixels = (size * density).ceil().clamp(DVec2::ONE, DVec2::splat(CANVAS_MAX));
        let corner = |x: f64, y: f64| middle + right * x + up * y;
        let corners = [corner(low.x, low.y), corner(high.x, low.y), corner(low.x, high.y)];
        if !corners.iter().all(|corner| corner.is_finite()) || size.min_element() <= 0.0 {
            bail!("profile sl: the poses leave no plane that is lit; check the coordinateFrame");
        }
        Ok(Self { eye: lens, corners, pixels: pixels.as_uvec2() })
    }
}

/// The plane that projectors light, and their poses.
fn projectors(text: &mut String, lit: &LitPlane, imported: &Imported) {
    let _ = write!(text, "\n[[screen]]\nname = \"screen\"\n");
    for (key, corner) in ["lower_left", "lower_right", "upper_left"].iter().zip(lit.corners) {
        let _ = writeln!(text, "{key} = {}", numbers(corner.to_array()));
    }
    let _ = writeln!(text, "pixels = [{}, {}]", lit.pixels.x, lit.pixels.y);
    for region in &imported.regions {
        let Some(pyramid) = &region.pyramid else { continue };
        let [yaw, pitch, roll] = pyramid.turn;
        let (position, tangents) = (region.position.to_array(), pyramid.tangents());
        let _ = write!(
            text,
            "\n[[screen.channel]]\nname = \"{}\"\npixels = [{}, {}]\n\n\
             [screen.channel.projector]\nposition = {}           # metres\n\
             rotation = {}           # yaw, pitch, roll\n\
             tangents = {}           # left, right, bottom, top\n",
            region.name,
            region.size.x,
            region.size.y,
            numbers(position),
            numbers([-yaw, pitch, -roll]),
            numbers(tangents)
        );
    }
}

/// The plane of one region's frustum.
fn frustum(text: &mut String, region: &ImportedRegion) {
    let Some(pyramid) = &region.pyramid else { return };
    let corners = mpcdi::corners(pyramid, DVec3::ZERO, FRUSTUM_DISTANCE_M);
    let _ = write!(text, "\n[[screen]]\nname = \"{}\"\n", region.name);
    for (key, corner) in ["lower_left", "lower_right", "upper_left"].iter().zip(corners) {
        let _ = writeln!(text, "{key} = {}", numbers(corner.to_array()));
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
    plain_name(&file.file_stem().unwrap_or_default().to_string_lossy(), "wall")
}

#[cfg(test)]
mod tests;
