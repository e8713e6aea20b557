//! `polyptych prove`: measures that a wall shows every pixel in its place and light.

use std::path::PathBuf;
use std::process::ExitCode;

use super::{bake_files, load_wall, log_file_warnings, manager, say, simulate};
use crate::simulator::verify::{self, Walls};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// The .gltf or .glb file to compare pictures of; without one, the generated town
    scene: Option<PathBuf>,
    /// A wall file of the same channels as they really hang and shine, to judge by
    #[arg(long, value_name = "FILE")]
    as_built: Option<PathBuf>,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Where the table and its pictures go
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let mut wall = load_wall(&arguments.wall)?;
    let baker = manager::default_baker()?;
    log_file_warnings(&bake_files(&mut wall, &arguments.wall, &baker)?);
    let mut built = arguments.as_built.as_deref().map(load_wall).transpose()?;
    if let (Some(built), Some(file)) = (&mut built, &arguments.as_built) {
        log_file_warnings(&bake_files(built, file, &baker)?);
    }
    let shown = simulate::shown(arguments.scene.as_deref())?;
    let table = verify::verify(
        Walls { drawn: &wall, built: built.as_ref() },
        shown,
        &baker,
        &arguments.out,
    )?;
    if arguments.json {
        say(format_args!("{}", serde_json::to_string_pretty(&table)?))?;
    } else {
        say(format_args!("{table}"))?;
        say(format_args!("pictures and table: {}", arguments.out.display()))?;
    }
    Ok(if table.is_met() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
