//! `polyptych session`: all that a wall shows, saved, opened and deleted by a name.

use std::process::ExitCode;

use polyptych_client::SavedSession;
use polyptych_text::{counted, printable};
use serde_json::{Value, json};

use super::seen::show;
use super::{ManagerAddress, say};
use crate::logging;

#[derive(Debug, clap::Subcommand)]
pub(super) enum Session {
    /// Keep all that the wall shows and how it shows it under a name
    Save(NameArguments),
    /// Show a saved session in the place of all that is shown
    Open(NameArguments),
    /// List the sessions that were saved
    List(ListArguments),
    /// Forget a saved session
    Delete(NameArguments),
}

#[derive(Debug, clap::Args)]
pub(super) struct NameArguments {
    /// The name of the session
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

pub(super) fn run(session: &Session) -> anyhow::Result<ExitCode> {
    match session {
        Session::Save(NameArguments { name, manager }) => {
            manager.connect()?.save_session(name.as_str())?;
            say(format_args!("saved; polyptych session open {} shows it", printable(name)))?;
        }
        Session::Open(NameArguments { name, manager }) => {
            let client = manager.connect()?;
            for left_out in client.open_session(name.as_str())?.left_out {
                logging::say_warning(&format!("left out: {}", printable(&left_out)));
            }
            return show(&client);
        }
        Session::List(arguments) => list(arguments)?,
        Session::Delete(NameArguments { name, manager }) => {
            manager.connect()?.remove_session(name.as_str())?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn list(arguments: &ListArguments) -> anyhow::Result<()> {
    let sessions = arguments.manager.connect()?.sessions()?;
    if arguments.json {
        return say(sessions.iter().map(|session| json!(session)).collect::<Value>());
    }
    for SavedSession { name, scene, views, stored_views, .. } in &sessions {
        let scene = scene.as_deref().map_or("no scene".into(), printable);
        let (views, stored) = (counted(views, "view"), counted(stored_views, "stored view"));
        say(format_args!("{}: {scene}, {views}, {stored}", printable(name)))?;
    }
    Ok(())
}
