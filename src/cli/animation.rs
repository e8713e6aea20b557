//! `polyptych animation`: how the animations of the open scene are played.

use std::process::ExitCode;

use polyptych_client::{ClipAction, ClipStatus};

use super::seen::show;
use super::stored_view::TOUR_PACE;
use super::{ManagerAddress, say};

#[derive(Debug, clap::Subcommand)]
pub(super) enum AnimationCommand {
    /// Let animations go on; a wall that is paused runs from now on
    Play(PlayArguments),
    /// Hold animations where they are
    Pause(PauseArguments),
    /// Put animations to a time
    Seek(SeekArguments),
    /// List the animations of the open scene, and how each is played
    List(ListArguments),
}

#[derive(Debug, clap::Args)]
pub(super) struct PlayArguments {
    /// The name of an animation, or its number; it is played alone then [default: all that were
    /// played last]
    name: Option<String>,
    /// Seconds of it in a second; negative for backwards
    #[arg(long, allow_hyphen_values = true)]
    speed: Option<f64>,
    /// Its part beside the others, 0 to 1: it is played with those that are played already
    #[arg(long, requires = "name")]
    weight: Option<f32>,
    /// Stay at the end
    #[arg(long)]
    once: bool,
    /// Begin anew at the end, as is done unless told otherwise
    #[arg(long = "loop", conflicts_with = "once")]
    is_loop: bool,
    /// Leave a paused wall paused
    #[arg(long)]
    paused: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct PauseArguments {
    /// The name of an animation, or its number [default: all that are played]
    name: Option<String>,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct SeekArguments {
    /// Seconds since the beginning
    seconds: f64,
    /// The name of an animation, or its number [default: all that are played]
    name: Option<String>,
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

pub(super) fn run(command: &AnimationCommand) -> anyhow::Result<ExitCode> {
    match command {
        AnimationCommand::Play(arguments) => play(arguments),
        AnimationCommand::Pause(PauseArguments { name, manager }) => {
            let client = manager.connect()?;
            client.change_clips(name.as_deref(), ClipAction::Pause)?;
            show(&client)
        }
        AnimationCommand::Seek(SeekArguments { seconds, name, manager }) => {
            let client = manager.connect()?;
            client.change_clips(name.as_deref(), ClipAction::Seek(*seconds))?;
            show(&client)
        }
        AnimationCommand::List(ListArguments { json, manager }) => {
            let clips = manager.connect()?.clips()?;
            if *json {
                say(serde_json::to_string_pretty(&clips)?)?;
            } else if clips.is_empty() {
                say("the open scene has no animations")?;
            } else {
                clips.iter().enumerate().try_for_each(|(at, of)| say(line(at, of)))?;
            }
            Ok(ExitCode::SUCCESS)
        }
    }
}

fn play(arguments: &PlayArguments) -> anyhow::Result<ExitCode> {
    let PlayArguments { name, speed, weight, once, is_loop, paused, manager } = arguments;
    let client = manager.connect()?;
    let is_looping = (*once || *is_loop).then_some(*is_loop);
    let action = ClipAction::Play { speed: *speed, weight: *weight, is_looping };
    client.change_clips(name.as_deref(), action)?;
    if !paused && client.tour()?.pace.is_none() {
        client.start_rendering(TOUR_PACE)?;
        say("the wall was paused and runs from now on")?;
    }
    show(&client)
}

fn line(at: usize, of: &ClipStatus) -> String {
    let ClipStatus { clip, is_running, is_looping, time_s, speed, weight } = of;
    let name = if clip.name.is_empty() { "without a name" } else { &clip.name };
    let end_s = if *speed < 0.0 { 0.0 } else { clip.duration_s };
    let is_over = !is_looping && *speed != 0.0 && *time_s == end_s;
    let state = match (*weight > 0.0, is_running) {
        (false, _) => "not played".to_owned(),
        (true, true) if is_over => format!("over at {time_s:.2} s"),
        (true, true) => format!("playing at {time_s:.2} s"),
        (true, false) => format!("held at {time_s:.2} s"),
    };
    let is_part = *weight > 0.0 && *weight < 1.0;
    let weight = if is_part { format!(", weight {weight}") } else { String::new() };
    let is_plain = (*speed - 1.0).abs() == 0.0;
    let speed = if is_plain { String::new() } else { format!(", speed {speed}") };
    let once = if *is_looping { "" } else { ", once" };
    format!("{at} {name}: {:.2} s, {state}{weight}{speed}{once}", clip.duration_s)
}

#[cfg(test)]
mod tests {
    use polyptych_client::ClipSummary;

    use super::*;

    #[test]
    fn a_clip_that_is_played_once_is_over_at_its_end() {
        let clip = ClipSummary { name: "bow".to_owned(), duration_s: 2.0, is_played: true };
        let (is_running, weight) = (true, 1.0);
        let at = |time_s: f64, speed: f64, is_looping: bool| {
            let clip = clip.clone();
            line(0, &ClipStatus { clip, is_running, is_looping, time_s, speed, weight })
        };
        assert_eq!(at(0.5, 1.0, false), "0 bow: 2.00 s, playing at 0.50 s, once");
        assert_eq!(at(2.0, 1.0, false), "0 bow: 2.00 s, over at 2.00 s, once");
        assert_eq!(at(2.0, 1.0, true), "0 bow: 2.00 s, playing at 2.00 s");
        assert_eq!(at(2.0, -1.0, false), "0 bow: 2.00 s, playing at 2.00 s, speed -1, once");
        assert_eq!(at(0.0, -1.0, false), "0 bow: 2.00 s, over at 0.00 s, speed -1, once");
    }
}
