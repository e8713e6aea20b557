//! `polyptych status`: how a running wall stands.

use super::{ManagerAddress, say, watch};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Go on: a live table in a terminal, a line a second elsewhere
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.watch {
        return watch::run(&arguments.manager, arguments.json);
    }
    let status = arguments.manager.connect()?.status()?;
    if arguments.json {
        say(serde_json::to_string_pretty(&status)?)?;
    } else {
        say(watch::table(&status))?;
    }
    Ok(())
}
