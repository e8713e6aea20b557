//! `polyptych tour`: the camera moves through stops by itself.

mod tour_file;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use polyptych_text::counted;

use super::seen::{conclude, show};
use super::stored_view::TOUR_PACE;
use super::{ManagerAddress, say};

/// Maximum size of a file of a tour, in bytes: what 4,096 stops take, at 256 bytes each.
const FILE_BYTES_MAX: u64 = 1 << 20;

#[derive(Debug, clap::Subcommand)]
pub(super) enum TourCommand {
    /// Move the camera through the stops of a file; a wall that is paused runs from now on
    Play(PlayArguments),
    /// End the tour; the camera stays where it is
    Stop(StopArguments),
}

#[derive(Debug, clap::Args)]
pub(super) struct PlayArguments {
    /// A JSON file: {"loop": false, "stops": [{"view": "quay", "travel": 4, "stay": 2}, …]}
    file: PathBuf,
    /// Leave a paused wall paused: the tour begins with its next frame, such as a film's first
    #[arg(long)]
    paused: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct StopArguments {
    /// Pause the wall too
    #[arg(long)]
    pause: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(command: &TourCommand) -> anyhow::Result<ExitCode> {
    match command {
        TourCommand::Play(arguments) => play(arguments),
        TourCommand::Stop(arguments) => {
            let client = arguments.manager.connect()?;
            client.stop_tour()?;
            if arguments.pause {
                client.pause()?;
            }
            show(&client)
        }
    }
}

fn play(arguments: &PlayArguments) -> anyhow::Result<ExitCode> {
    let file = arguments.file.display();
    let facts = std::fs::metadata(&arguments.file).with_context(|| file.to_string())?;
    if !facts.is_file() || facts.len() > FILE_BYTES_MAX {
        bail!("{file}: not a file of at most {FILE_BYTES_MAX} bytes");
    }
    let text = std::fs::read(&arguments.file).with_context(|| file.to_string())?;
    let draft = tour_file::parse(&text).with_context(|| file.to_string())?;
    let client = arguments.manager.connect()?;
    let tour = draft.resolve(&client.stored_views()?).with_context(|| file.to_string())?;
    tour.validate().with_context(|| file.to_string())?;
    let (stops, seconds) = (counted(tour.stops.len(), "stop"), tour.round_s());
    let length = if tour.is_loop { "s a round" } else { "s" };
    client.play_tour(tour)?;
    let is_paused = client.tour()?.pace.is_none();
    if is_paused && !arguments.paused {
        client.start_rendering(TOUR_PACE)?;
    }
    let follows = match (is_paused, arguments.paused) {
        (false, _) => "",
        (true, false) => "; the wall was paused and runs from now on",
        (true, true) => "; the wall is paused: it begins with the next frame that is asked for",
    };
    say(format_args!("{file}: {stops}, {seconds} {length}{follows}"))?;
    conclude(&client, !(is_paused && arguments.paused))
}
