//! `polyptych demo`: what a stranger runs first.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use polyptych_protocol::wall::file;

use super::{say, seconds, server, simulate};

/// The wall of the demo, the same file that a user finds in the repository.
const WALL: &str = include_str!("../../configs/wall-2x2.toml");

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Where wall.png, channel-NAME.png and report.json go
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// How long to draw
    #[arg(long, default_value = "10", value_parser = seconds)]
    seconds: Duration,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let path = Path::new("configs/wall-2x2.toml");
    let wall = file::parse(WALL, path).map_err(|error| anyhow::anyhow!("{error}"))?;
    let windows = server::has_display();
    let how = if windows { "in windows" } else { "without a display, into pictures" };
    say(format_args!("a wall of four displays with a generated harbour town, {how}"))?;
    let simulation = simulate::Arguments {
        wall: path.to_owned(),
        scene: None,
        frames: None,
        seconds: Some(arguments.seconds),
        rate: None,
        orbit: true,
        windows,
        record: None,
        exposure: None,
        out: arguments.out.clone(),
        fault: Vec::new(),
        fault_seed: 0,
    };
    simulate::simulate(&wall, &simulation)
}
