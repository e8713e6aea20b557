//! `polyptych check`: what a wall file describes, or what is wrong with it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::anyhow;
use polyptych_manager::import::read_wall_files;
use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::wall::shapes::{Shaped, Shapes};
use polyptych_protocol::wall::{Wall, file, table::WallTable};

use super::{bake_files, manager, say};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// Print JSON instead of a table; what nobody knows is left out of it, never null
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match file::load(&arguments.wall) {
        Ok(mut wall) => {
            let shapes = shapes(&mut wall, &arguments.wall)?;
            let table = WallTable::of(Shaped { wall: &wall, shapes: &shapes });
            if arguments.json {
                say(serde_json::to_string_pretty(&table)?)?;
            } else {
                say(table)?;
            }
            Ok(ExitCode::SUCCESS)
        }
        Err(error) if arguments.json => {
            let what = serde_json::json!({ "error": {
                "file": error.path(),
                "line": error.line(),
                "column": error.column(),
                "key": error.key(),
                "what": error.what(),
                "remedy": error.remedy(),
            }});
            say(serde_json::to_string_pretty(&what)?)?;
            Ok(ExitCode::FAILURE)
        }
        Err(error) => Err(anyhow::anyhow!("{error}")),
    }
}

/// The geometry that the wall's calibration files give it.
fn shapes(wall: &mut Wall, path: &Path) -> anyhow::Result<Shapes> {
    if wall.files.is_empty() {
        return Ok(Shapes::default());
    }
    let baker = manager::default_baker()?;
    bake_files(wall, path, &baker)?;
    let files = read_wall_files(wall, &BlobFolder::new(baker.store.join("blobs")));
    let files = files.map_err(|reason| anyhow!("{}: {reason}", path.display()))?;
    Ok(Shapes::new(wall, &files))
}
