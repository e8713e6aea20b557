//! `polyptych unit`: writes the files with which other systems run a wall.

use std::path::PathBuf;

use polyptych_text::counted;

use super::say;
use crate::launch::plan::LaunchPlan;
use crate::launch::{container, kubernetes, shell, slurm, systemd};

/// The image of containers, unless another one is named.
const IMAGE_DEFAULT: &str = concat!("polyptych:", env!("CARGO_PKG_VERSION"));

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The system that runs the wall
    #[arg(value_enum)]
    kind: Kind,
    /// The wall file; its [launch] and [server.NAME] say which process runs where, and how
    wall: PathBuf,
    /// The folder for the files, which is made if it is missing
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The image of containers
    #[arg(long, value_name = "IMAGE", default_value = IMAGE_DEFAULT)]
    image: String,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// Services with watchdogs, for each machine
    Systemd,
    /// A batch script for any number of nodes
    Slurm,
    /// Manifests with a deployment for each server
    Kubernetes,
    /// A Containerfile, and a compose file for each machine
    Container,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let plan = LaunchPlan::load(&arguments.wall)?;
    let units = match arguments.kind {
        Kind::Systemd => systemd::units(&plan)?,
        Kind::Slurm => slurm::units(&plan)?,
        Kind::Kubernetes => kubernetes::units(&plan, &arguments.image)?,
        Kind::Container => container::units(&plan, &arguments.image)?,
    };
    let folder = &arguments.output;
    units.write(folder, arguments.force)?;
    say(format_args!("{}: {}; next:", folder.display(), counted(units.files.len(), "file")))?;
    let place = shell::quoted(&folder.display().to_string());
    for step in &units.steps {
        let step = step.replace("{DIR}", &place);
        say(format_args!("  {step}"))?;
    }
    Ok(())
}
