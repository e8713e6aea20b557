//! `polyptych scene`: scenes made by code, and the one that is open.

use std::path::PathBuf;
use std::process::ExitCode;

use polyptych_text::counted;

use super::seen::show;
use super::{ManagerAddress, node, say};
use crate::outputs;
use crate::simulator::town::{TownOptions, generate};

#[derive(Debug, clap::Subcommand)]
pub(super) enum Scene {
    /// A small harbour town on a hill, the same bytes for the same blocks and seed
    Town(TownArguments),
    /// List the nodes of the open scene
    Tree(node::TreeArguments),
    /// Put all of another file into the open scene
    Import(node::ImportArguments),
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
    /// The .glb file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write over a file that is there
    #[arg(long)]
    force: bool,
}

pub(super) fn run(scene: &Scene) -> anyhow::Result<ExitCode> {
    match scene {
        Scene::Town(arguments) => town(arguments).map(|()| ExitCode::SUCCESS),
        Scene::Tree(arguments) => node::tree(arguments),
        Scene::Import(arguments) => node::import(arguments),
        Scene::Close(manager) => {
            let client = manager.connect()?;
            client.close_scene()?;
            show(&client)
        }
    }
}

fn town(arguments: &TownArguments) -> anyhow::Result<()> {
    outputs::check_source(&arguments.output, arguments.force)?;
    let bytes = generate(&TownOptions { blocks: arguments.blocks, seed: arguments.seed })?;
    outputs::write(&arguments.output, &bytes)?;
    say(format_args!("{}: {}", arguments.output.display(), counted(bytes.len(), "byte")))?;
    Ok(())
}
