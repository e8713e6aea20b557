//! `polyptych scene`: scenes made by code, and the one that is open.

mod export;

use std::path::PathBuf;
use std::process::ExitCode;

use polyptych_client::{SAVED_PREFIX, SavedScene};
use polyptych_text::{counted, printable};
use serde_json::{Value, json};

use super::seen::show;
use super::{ManagerAddress, node, say};
use crate::outputs;
use crate::simulator::town::{TownExtras, TownOptions, generate};

#[derive(Debug, clap::Subcommand)]
pub(super) enum Scene {
    /// A small harbour town on a hill, the same bytes for the same blocks and seed
    Town(TownArguments),
    /// List the nodes of the open scene
    Tree(node::TreeArguments),
    /// Keep the open scene, as it was edited, under a name; `open saved:NAME` shows it again
    Save(SaveArguments),
    /// List the scenes that were saved
    List(ListArguments),
    /// Forget a scene that was saved
    Remove(SaveArguments),
    /// Write the open scene, as it was edited, as a .glb file on this machine
    Export(export::ExportArguments),
    /// Put all of another file into the open scene
    Import(node::ImportArguments),
    /// List the layers of the open scene, or show or hide one
    Layer(node::LayerArguments),
    /// Show no scene
    Close(ManagerAddress),
}

#[derive(Debug, clap::Args)]
pub(super) struct TownArguments {
    /// Blocks along each side: 4 make about 100,000 triangles, 64 tens of millions
    #[arg(long, default_value_t = 4)]
    blocks: u32,
    /// Another number, another town
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Let the sea reach to the horizon
    #[arg(long)]
    sea: bool,
    /// Let boats ride on waves: an animation
    #[arg(long)]
    boats: bool,
    /// Let the sun be about to set, and lamps burn along the quay too
    #[arg(long)]
    dusk: bool,
    /// The .glb file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write over a file that is there
    #[arg(long)]
    force: bool,
}

#[derive(Debug, clap::Args)]
pub(super) struct SaveArguments {
    /// What it is called
    name: String,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct ListArguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(scene: &Scene) -> anyhow::Result<ExitCode> {
    match scene {
        Scene::Town(arguments) => town(arguments).map(|()| ExitCode::SUCCESS),
        Scene::Tree(arguments) => node::tree(arguments),
        Scene::Save(SaveArguments { name, manager }) => {
            manager.connect()?.save_scene(name.as_str())?;
            say(format_args!("saved; polyptych open {SAVED_PREFIX}{} shows it", printable(name)))?;
            Ok(ExitCode::SUCCESS)
        }
        Scene::Remove(SaveArguments { name, manager }) => {
            manager.connect()?.remove_saved_scene(name.as_str())?;
            Ok(ExitCode::SUCCESS)
        }
        Scene::List(arguments) => list(arguments).map(|()| ExitCode::SUCCESS),
        Scene::Export(arguments) => export::run(arguments),
        Scene::Import(arguments) => node::import(arguments),
        Scene::Layer(arguments) => node::layers(arguments),
        Scene::Close(manager) => {
            let client = manager.connect()?;
            client.close_scene()?;
            show(&client)
        }
    }
}

fn list(arguments: &ListArguments) -> anyhow::Result<()> {
    let scenes = arguments.manager.connect()?.saved_scenes()?;
    if arguments.json {
        let scene = |of: &SavedScene| {
            json!({
                "name": of.name,
                "scene": of.scene,
                "edited_nodes": of.edited_nodes,
                "saved_at_s": of.saved_at_s,
            })
        };
        return say(Value::Array(scenes.iter().map(scene).collect()));
    }
    for SavedScene { name, scene, edited_nodes, .. } in &scenes {
        let edited = counted(edited_nodes, "edited node");
        say(format_args!("{}: {}, {edited}", printable(name), printable(scene)))?;
    }
    Ok(())
}

fn town(arguments: &TownArguments) -> anyhow::Result<()> {
    outputs::check_source(&arguments.output, arguments.force)?;
    let TownArguments { blocks, seed, sea, boats, dusk, .. } = *arguments;
    let extras = TownExtras { has_open_sea: sea, has_waves: boats, is_dusk: dusk };
    let bytes = generate(&TownOptions { blocks, seed, extras })?;
    outputs::write(&arguments.output, &bytes)?;
    say(format_args!("{}: {}", arguments.output.display(), counted(bytes.len(), "byte")))?;
    Ok(())
}
