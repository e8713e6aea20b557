//! `polyptych stop`: ends the manager of a running wall, and its servers if asked to.

use anyhow::bail;
use polyptych_text::counted;

use super::{ManagerAddress, say};
use crate::logging;

/// Displays say that the wall was stopped; servers wait for the next manager. Ctrl-C and SIGTERM of
/// a manager leave the last frame with "manager stopped since", as it may be started again at once.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// End the servers too, and wait until each has said goodbye
    #[arg(long)]
    servers: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let client = arguments.manager.connect()?;
    let wall = client.wall_name().to_owned();
    if !arguments.servers {
        client.stop()?;
        return say(format_args!(
            "the manager of wall {wall} ends; its servers wait for the next one \
             (polyptych stop --servers ends them too)"
        ));
    }
    let stopped = client.stop_with_servers()?;
    let count = counted(stopped.ended.len(), "server");
    say(format_args!("the manager of wall {wall} ends, and {count} with it"))?;
    if !stopped.absent.is_empty() {
        let names = stopped.absent.join(", ");
        logging::say_warning(&format!("not connected, so not told to end: {names}"));
    }
    if stopped.silent.is_empty() {
        return Ok(());
    }
    let silent: Vec<_> =
        stopped.silent.iter().map(|(name, reason)| format!("{name} ({reason})")).collect();
    bail!("servers that may still run: {}; end their processes by hand", silent.join(", "))
}
