//! `polyptych demo`: what a stranger runs first.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use super::{say, seconds, server, simulate};

/// The wall of the demo, the same file that a user finds in the repository.
const WALL: &str = include_str!("../../configs/wall-2x2.toml");

/// How long the demo draws where nobody sees it.
const LENGTH_UNSEEN: Duration = Duration::from_secs(10);

/// Frames per second in windows: the town turns at the same speed on all machines that can.
const RATE_SEEN: f64 = 30.0;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Where wall.png, channel-NAME.png and report.json go
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// How long to draw [default: in windows until one is closed, else 10]
    #[arg(long, value_parser = seconds)]
    seconds: Option<Duration>,
    /// Show a window for each channel [default where there is a display]. The mouse turns the scene
    /// (drag), moves it (drag with another button or Shift) and zooms (wheel)
    #[arg(long, conflicts_with = "headless")]
    windows: bool,
    /// Draw into pictures only
    #[arg(long)]
    headless: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let path = Path::new("configs/wall-2x2.toml");
    let wall =
        polyptych_wall_file::parse(WALL, path).map_err(|error| anyhow::anyhow!("{error}"))?;
    let windows = arguments.windows || (server::has_display() && !arguments.headless);
    let how = match (windows, arguments.seconds) {
        (true, None) => "in windows, until one is closed",
        (true, Some(_)) => "in windows",
        (false, _) => "without a display, into pictures",
    };
    say(format_args!("a wall of four displays with a generated harbour town, {how}"))?;
    let simulation = simulate::Arguments {
        wall: path.to_owned(),
        scene: None,
        scene_name: None,
        frames: None,
        seconds: arguments.seconds.or((!windows).then_some(LENGTH_UNSEEN)),
        rate: windows.then_some(RATE_SEEN),
        time: 0.0,
        fps: None,
        orbit: true,
        walk: Vec::new(),
        no_occlusion: false,
        windows,
        record: None,
        exposure: None,
        error_bound: 0.0,
        rate_bound: None,
        out: arguments.out.clone(),
        fault: Vec::new(),
        fault_seed: 0,
    };
    simulate::simulate(&wall, &simulation)
}
