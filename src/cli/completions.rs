//! `polyptych completions` and `man`: the command's own description, for shells and manuals.

use std::path::{Path, PathBuf};

use clap_complete::Shell;
use clap_mangen::Man;
use polyptych_text::counted;

use super::{command, say};
use crate::outputs;

#[derive(Debug, clap::Args)]
pub(super) struct CompletionArguments {
    /// The shell that completes the command
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Debug, clap::Args)]
pub(super) struct ManArguments {
    /// The folder for the pages, which is made if it is missing; older pages are replaced
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn completions(arguments: &CompletionArguments) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command(), "polyptych", &mut script);
    say(String::from_utf8(script)?.trim_end())
}

pub(super) fn man(arguments: &ManArguments) -> anyhow::Result<()> {
    let folder = &arguments.output;
    outputs::make_folder(folder)?;
    let mut command = command().disable_help_subcommand(true);
    command.build();
    let pages = write_pages(command, folder)?;
    say(format_args!("{}: {}", folder.display(), counted(pages, "page")))
}

/// Writes the pages of a command and those below it, and returns how many.
fn write_pages(command: clap::Command, folder: &Path) -> anyhow::Result<usize> {
    let mut pages = 1;
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        pages += write_pages(below.clone(), folder)?;
    }
    let man = Man::new(command);
    let mut page = Vec::new();
    man.render(&mut page)?;
    outputs::write(&folder.join(man.get_filename()), &page)?;
    Ok(pages)
}
