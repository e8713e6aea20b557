//! `polyptych variant`: the look of the open scene, of those that its file has.

use std::process::ExitCode;

use polyptych_client::VariantList;
use polyptych_text::printable;
use serde_json::json;

use super::seen::show;
use super::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The name of a variant, or its number; "none", for the materials that parts have without
    /// one; or "list". Without it, list too
    #[arg(value_name = "NAME|none|list")]
    variant: Option<String>,
    /// With "list": print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let wanted = match arguments.variant.as_deref() {
        None | Some("list") => {
            list(&client.variants()?, arguments.json)?;
            return Ok(ExitCode::SUCCESS);
        }
        Some("none") => None,
        name => name,
    };
    client.set_variant(wanted)?;
    show(&client)
}

fn list(variants: &VariantList, is_json: bool) -> anyhow::Result<()> {
    let chosen = variants.chosen.map(|at| at as usize);
    let all = variants.names.iter().enumerate().map(|(at, name)| (at, name, chosen == Some(at)));
    if is_json {
        let json = |(at, name, is_shown)| json!({ "number": at, "name": name, "shown": is_shown });
        let all: Vec<serde_json::Value> = all.map(json).collect();
        return say(serde_json::to_string_pretty(&all)?);
    }
    if variants.names.is_empty() {
        return say("the open scene has no variants");
    }
    for (at, name, is_shown) in all {
        let name = if name.is_empty() { "without a name".into() } else { printable(name) };
        let shown = if is_shown { ", shown" } else { "" };
        say(format_args!("{at} {name}{shown}"))?;
    }
    if chosen.is_none() { say("none is shown: parts have their own materials") } else { Ok(()) }
}
