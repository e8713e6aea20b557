//! `polyptych prove`: measures that a wall shows every pixel in its place and light.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall_file::check_report::CheckReport;

use super::bake_arguments::BakeArguments;
use super::surroundings::LookArguments;
use super::{bake_files, load_wall, log_file_warnings, say, simulate};
use crate::simulator::local_wall::{INTERRUPTED, is_interrupted};
use crate::simulator::look::Brightness;
use crate::simulator::verify::{self, ProofPage, Walls};
use crate::{logging, outputs, wall_drawing};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// The .gltf or .glb file to compare pictures of; without one, the generated town
    scene: Option<PathBuf>,
    /// A wall file of the same channels as they really hang and shine, to judge by
    #[arg(long, value_name = "FILE")]
    as_built: Option<PathBuf>,
    #[command(flatten)]
    look: LookArguments,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Where the table and its pictures go
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Write all of it as one page too, with pictures and plots: an HTML file
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if let Some(file) = &arguments.html {
        outputs::check(file)?;
    }
    if arguments.look.exposure == Some(Brightness::Automatic) {
        bail!("--exposure auto: pictures to compare need the same exposure; give a factor");
    }
    let look = arguments.look.look()?;
    let mut wall = load_wall(&arguments.wall)?;
    let baker = arguments.bake.baker()?;
    let files = bake_files(&mut wall, &arguments.wall, &baker)?;
    log_file_warnings(&files);
    let mut built = arguments.as_built.as_deref().map(load_wall).transpose()?;
    if let (Some(built), Some(file)) = (&mut built, &arguments.as_built) {
        log_file_warnings(&bake_files(built, file, &baker)?);
    }
    let shown = simulate::shown(arguments.scene.as_deref())?;
    let scene = shown.file.display().to_string();
    let walls = Walls { drawn: &wall, built: built.as_ref() };
    let proven = verify::verify(walls, (shown, look), &baker, &arguments.out);
    if proven.is_err() && is_interrupted() {
        logging::say_failure("prove", "interrupted");
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let verify::Proof { table, pictures } = proven?;
    if let Some(file) = &arguments.html {
        let shaped = ResolvedWall { wall: &wall, shapes: &files.shapes };
        let drawing = wall_drawing::svg(shaped, &CheckReport::with_files(shaped, &files.maps));
        let as_built = arguments.as_built.as_ref().map(|file| file.display().to_string());
        let page = ProofPage { wall: &wall, scene, as_built, table: &table, pictures, drawing };
        outputs::write(file, page.html().as_bytes())?;
    }
    if arguments.json {
        say(format_args!("{}", serde_json::to_string_pretty(&table)?))?;
    } else {
        say(format_args!("{table}"))?;
        say(format_args!("pictures and table: {}", arguments.out.display()))?;
        if let Some(file) = &arguments.html {
            say(format_args!("page: {}", file.display()))?;
        }
    }
    Ok(if table.is_met() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
