//! `polyptych wall`: makes wall files.

mod import;

use std::process::ExitCode;

#[derive(Debug, clap::Subcommand)]
pub(super) enum Wall {
    /// Make a wall file of an MPCDI archive
    Import(import::Arguments),
}

pub(super) fn run(wall: &Wall) -> anyhow::Result<ExitCode> {
    match wall {
        Wall::Import(arguments) => import::run(arguments)?,
    }
    Ok(ExitCode::SUCCESS)
}
