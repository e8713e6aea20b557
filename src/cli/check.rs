//! `polyptych check`: what a wall file describes, or what is wrong with it.

use std::path::PathBuf;
use std::process::ExitCode;

use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall_file::check_report::CheckReport;

use super::{WallFiles, bake_files, manager, say};
use crate::{outputs, wall_drawing};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// Print JSON instead of a table; what nobody knows is left out of it, never null
    #[arg(long)]
    json: bool,
    /// Draw the wall too, to scale: plan, side view and unrolled canvases, as one SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if let Some(file) = &arguments.svg {
        outputs::check(file)?;
    }
    match polyptych_wall_file::load(&arguments.wall) {
        Ok(mut wall) => {
            let files = if wall.files.is_empty() {
                WallFiles::default()
            } else {
                bake_files(&mut wall, &arguments.wall, &manager::default_baker()?)?
            };
            let shaped = ResolvedWall { wall: &wall, shapes: &files.shapes };
            let mut table = CheckReport::with_files(shaped, &files.maps);
            table.warnings.extend(files.warnings);
            if let Some(file) = &arguments.svg {
                outputs::write(file, wall_drawing::svg(shaped, &table).as_bytes())?;
            }
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
