//! `polyptych prove`: whether a wall shows every pixel in its place, in numbers.

use std::path::PathBuf;
use std::process::ExitCode;

use super::{bake_files, load_wall, log_file_warnings, manager, say, simulate};
use crate::prove;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// The .gltf or .glb file to compare pictures of; without one, the generated town
    scene: Option<PathBuf>,
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
    let shown = simulate::shown(arguments.scene.as_deref())?;
    let table = prove::prove(&wall, shown, baker, &arguments.out)?;
    if arguments.json {
        say(format_args!("{}", serde_json::to_string_pretty(&table)?))?;
    } else {
        say(format_args!("{table}"))?;
        say(format_args!("pictures and table: {}", arguments.out.display()))?;
    }
    Ok(if table.is_kept() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
