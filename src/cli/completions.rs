//! `polyptych completions` and `man`: the command's own description, for shells and manuals.

use std::path::PathBuf;

use anyhow::Context;
use clap_complete::Shell;
use polyptych_protocol::words::counted;

use super::{command, say};

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
    let named = || format!("cannot write to {}", folder.display());
    std::fs::create_dir_all(folder).with_context(named)?;
    clap_mangen::generate_to(command(), folder).with_context(named)?;
    let is_page = |entry: &std::io::Result<std::fs::DirEntry>| {
        let name = entry.as_ref().map(std::fs::DirEntry::file_name).unwrap_or_default();
        name.to_string_lossy().starts_with("polyptych") && name.to_string_lossy().ends_with(".1")
    };
    let pages = std::fs::read_dir(folder).with_context(named)?.filter(is_page).count();
    say(format_args!("{}: {}", folder.display(), counted(pages, "page")))
}
