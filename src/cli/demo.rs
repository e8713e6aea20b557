//! `polyptych demo`: what a stranger runs first.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use super::bake_arguments::BakeArguments;
use super::surroundings::LookArguments;
use super::{http, say, seconds, server, simulate};
use crate::simulator::town::TownExtras;

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
    /// Serve the page for browsers while the demo runs [default without ADDR: 127.0.0.1:7880]
    #[arg(long, value_name = "ADDR", value_parser = http::address)]
    #[arg(num_args = 0..=1, default_missing_value = "127.0.0.1")]
    http: Option<String>,
    /// Draw into pictures only
    #[arg(long)]
    headless: bool,
    /// Draw one frame into pictures only, and write that of the whole wall here, with half of its
    /// pixels along each side: .png or .jpg
    #[arg(long, value_name = "FILE", conflicts_with_all = ["windows", "seconds"])]
    picture: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let path = Path::new("configs/wall-2x2.toml");
    let wall =
        polyptych_wall_file::parse(WALL, path).map_err(|error| anyhow::anyhow!("{error}"))?;
    let is_still = arguments.picture.is_some();
    let is_headless = arguments.headless || is_still;
    let windows = arguments.windows || (server::has_display() && !is_headless);
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
        frames: is_still.then_some(1),
        seconds: arguments.seconds.or((!windows && !is_still).then_some(LENGTH_UNSEEN)),
        rate: windows.then_some(RATE_SEEN),
        time: 0.0,
        fps: None,
        orbit: true,
        walk: Vec::new(),
        no_occlusion: false,
        windows,
        bake: arguments.bake,
        record: None,
        look: LookArguments { environment: Some("sky".into()), ..LookArguments::default() },
        error_bound: 0.0,
        rate_bound: None,
        out: arguments.out.clone(),
        picture: arguments.picture.clone(),
        is_picture_halved: true,
        extras: TownExtras { has_open_sea: true, has_waves: true, is_dusk: false },
        http: arguments.http.clone(),
        fault: Vec::new(),
        fault_seed: 0,
    };
    simulate::simulate(&wall, &simulation)
}
