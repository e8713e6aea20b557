//! `polyptych check`: what a wall file describes, or what is wrong with it.

use std::path::PathBuf;
use std::process::ExitCode;

use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall_file::check_report::CheckReport;

use super::bake_arguments::BakeArguments;
use super::{WallFiles, bake_files, say};
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
    #[command(flatten)]
    bake: BakeArguments,
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
                let baker = arguments.bake.baker();
                let baked = baker.and_then(|of| bake_files(&mut wall, &arguments.wall, &of));
                match baked {
                    Err(error) if arguments.json => return refuse_in_json(arguments, &error),
                    baked => baked?,
                }
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
            let (file, what, remedy) = (error.path(), error.what(), error.remedy());
            let mut said = serde_json::json!({ "file": file, "what": what, "remedy": remedy });
            // A file that could not be read has no lines.
            if error.line() > 0 {
                said["line"] = error.line().into();
                said["column"] = error.column().into();
                said["key"] = error.key().into();
            }
            say(serde_json::to_string_pretty(&serde_json::json!({ "error": said }))?)?;
            Ok(ExitCode::FAILURE)
        }
        Err(error) => Err(anyhow::anyhow!("{error}")),
    }
}

/// Says as JSON why a file that the wall file names cannot be used.
fn refuse_in_json(arguments: &Arguments, error: &anyhow::Error) -> anyhow::Result<ExitCode> {
    let what = format!("{error:#}");
    let what = serde_json::json!({ "error": { "file": arguments.wall, "what": what } });
    say(serde_json::to_string_pretty(&what)?)?;
    Ok(ExitCode::FAILURE)
}
