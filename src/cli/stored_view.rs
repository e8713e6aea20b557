//! `polyptych view save`, `go`, `remove` and `list`: places of the camera that the manager keeps.

use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Duration;

use anyhow::anyhow;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, Pacing, StoredView, Tour, TourStop};
use polyptych_text::printable;
use serde_json::{Value, json};

use super::seen::show;
use super::shutdown_signal::watch_shutdown_signals;
use super::{ManagerAddress, say, seconds};
use crate::logging;
use crate::simulator::local_wall::INTERRUPTED;

/// Pace of a wall that was paused while the camera moves by itself, in frames per second.
pub(super) const TOUR_PACE: Pacing = Pacing::Rate(60.0);

/// Between two looks at a tour.
const LOOK_PERIOD: Duration = Duration::from_millis(20);

#[derive(Debug, clap::Args)]
pub(super) struct NameArguments {
    /// What it is called
    name: String,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct GoArguments {
    /// What it is called
    name: String,
    /// Go there in this time, and not at once; Ctrl-C stops on the way
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    over: Option<Duration>,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn save(arguments: &NameArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    client.store_view(arguments.name.as_str(), None)?;
    let at = in_words(&client.presentation()?.camera);
    say(format_args!("{}: {at}", printable(&arguments.name)))?;
    Ok(ExitCode::SUCCESS)
}

pub(super) fn remove(arguments: &NameArguments) -> anyhow::Result<ExitCode> {
    arguments.manager.connect()?.remove_view(arguments.name.as_str())?;
    Ok(ExitCode::SUCCESS)
}

pub(super) fn go(arguments: &GoArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let camera = find(&client.stored_views()?, &arguments.name)?;
    match arguments.over {
        None => client.set_camera(camera)?,
        Some(time) if travel(&client, camera, time)? => {}
        Some(_) => {
            logging::say_warning("interrupted: the camera stays on the way");
            return Ok(ExitCode::from(INTERRUPTED));
        }
    }
    show(&client)
}

/// The camera of a stored view.
///
/// # Errors
/// There is none of this name; names those that there are.
pub(super) fn find(views: &[StoredView], name: &str) -> anyhow::Result<Camera> {
    let found = views.iter().find(|view| view.name == name);
    found.map(|view| view.camera).ok_or_else(|| {
        let names: Vec<_> = views.iter().map(|view| printable(&view.name)).collect();
        let name = printable(name);
        match names.len() {
            0 => anyhow!("there is no stored view {name}; polyptych view save makes one"),
            _ => anyhow!("there is no stored view {name}; there are {}", names.join(", ")),
        }
    })
}

/// Moves the camera there, and waits until it is, or something else moves it. A wall that was
/// paused runs meanwhile. Returns `false` if Ctrl-C has stopped the camera on the way.
fn travel(client: &Client, camera: Camera, time: Duration) -> anyhow::Result<bool> {
    let asked = stop_requests()?;
    let tour = Tour { stops: vec![TourStop::new(camera, time.as_secs_f64())], is_loop: false };
    client.play_tour(tour)?;
    let played = client.tour()?;
    let is_paused = played.pace.is_none();
    if is_paused {
        client.start_rendering(TOUR_PACE)?;
    }
    let mut is_stopped = false;
    // As the manager has it: its rotation may differ in the last bit.
    while played.tour.is_some() {
        let now = client.tour()?;
        if now.tour != played.tour || now.pace.is_none() {
            break;
        }
        if asked.recv_timeout(LOOK_PERIOD).is_ok() {
            client.stop_tour()?;
            is_stopped = true;
            break;
        }
    }
    if is_paused {
        client.pause()?;
    }
    Ok(!is_stopped)
}

/// Returns where the first request to end arrives; the second ends this process at once, as a
/// manager that is away may be waited for.
fn stop_requests() -> std::io::Result<mpsc::Receiver<()>> {
    let (ask, asked) = mpsc::sync_channel(1);
    let mut is_asked = false;
    watch_shutdown_signals(None, move || {
        if is_asked {
            std::process::exit(i32::from(INTERRUPTED));
        }
        is_asked = true;
        // Nobody waits for it where the camera is there already.
        let _ = ask.try_send(());
    })?;
    Ok(asked)
}

/// A line for `view list`.
pub(super) fn line(view: &StoredView) -> String {
    format!("stored {}: {}", printable(&view.name), in_words(&view.camera))
}

pub(super) fn in_json(view: &StoredView) -> Value {
    json!({ "name": view.name, "camera": view.camera })
}

fn in_words(camera: &Camera) -> String {
    let list = |v: DVec3| format!("{:.4},{:.4},{:.4}", v.x, v.y, v.z);
    let ahead = list(camera.rotation * DVec3::NEG_Z);
    let at = list(camera.position);
    format!("from {at} along {ahead}, {:.4} units per metre", camera.scale)
}
