//! `polyptych identify`, `blank` and `freeze`: what all displays of a running wall show.

use std::process::ExitCode;

use anyhow::bail;
use polyptych_client::OutputMode;

use super::seen::Seen;
use super::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// End it: displays show the wall's picture again
    #[arg(long)]
    off: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(mode: OutputMode, arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let command = mode.name();
    if !arguments.off {
        let seen = Seen::of(&client, &client.set_output_mode(mode)?)?;
        let what = match mode {
            OutputMode::Normal => "shows its picture",
            OutputMode::Identify => "shows what it is",
            OutputMode::Blank => "is black",
            OutputMode::Freeze => "keeps what it shows",
        };
        let who = seen.displays();
        say(format_args!("{who} {what}; end it with: polyptych {command} --off"))?;
        return Ok(seen.conclude());
    }
    // Someone may have asked for another mode since; that is not ours to end.
    let present = client.status()?.presentation.output_mode;
    if present != mode && present != OutputMode::Normal {
        let present = present.name();
        bail!("displays are in {present}, not {command}; end it with: polyptych {present} --off");
    }
    let seen = Seen::of(&client, &client.set_output_mode(OutputMode::Normal)?)?;
    say(format_args!("{} shows its picture", seen.displays()))?;
    Ok(seen.conclude())
}
