//! `polyptych scene export`: a scene leaves the wall as a file.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use polyptych_text::counted;
use serde_json::json;

use super::super::progress::ProgressReport;
use super::super::remote::say_notes;
use super::super::{ManagerAddress, say};
use crate::outputs;

#[derive(Debug, clap::Args)]
pub(in super::super) struct ExportArguments {
    /// The .glb file to write
    file: PathBuf,
    /// A scene that was saved, instead of the open one
    #[arg(long, value_name = "NAME")]
    saved: Option<String>,
    /// Write over a file that is there
    #[arg(long)]
    force: bool,
    /// Print JSON: what is in the file, and what is not
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &ExportArguments) -> anyhow::Result<ExitCode> {
    let ExportArguments { file: path, saved, force, json: is_json, manager } = arguments;
    if !path.extension().is_some_and(|end| end.eq_ignore_ascii_case("glb")) {
        bail!("{}: scenes are binary glTF; write a name that ends in .glb", path.display());
    }
    outputs::check_source(path, *force)?;
    let client = manager.connect()?;
    let mut file = outputs::create(path)?;
    let progress = ProgressReport::start();
    let scene = client.export_scene_with(saved.as_deref(), &mut file, |come| {
        progress.say(&come.to_string(), Some(come.percent));
    });
    drop(progress);
    let scene = scene.with_context(|| format!("{} is not written", path.display()))?;
    outputs::finish(path, file)?;
    if *is_json {
        say(json!({
            "scene": scene.name,
            "file": path.display().to_string(),
            "bytes": scene.bytes,
            "nodes": scene.nodes,
            "meshes": scene.meshes,
            "textures": scene.textures,
            "notes": scene.notes,
        }))?;
        return Ok(ExitCode::SUCCESS);
    }
    let (nodes, bytes) = (counted(scene.nodes, "node"), counted(scene.bytes, "byte"));
    say(format_args!("{}: {nodes}, {bytes}", path.display()))?;
    say_notes(&scene.notes)?;
    Ok(ExitCode::SUCCESS)
}
