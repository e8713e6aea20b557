//! `polyptych scene layer`: the layers of the open scene; and the kinds of its nodes.

use std::process::ExitCode;

use polyptych_client::{LayerInfo, NodeKind, Transaction};
use polyptych_text::{counted, printable};
use serde_json::{Value, json};

use super::in_json;
use crate::cli::seen::Seen;
use crate::cli::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct LayerArguments {
    /// The layer to show or to hide [default: list all]
    #[arg(requires = "what")]
    name: Option<String>,
    /// What to do with it
    what: Option<Visibility>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Visibility {
    Show,
    Hide,
}

/// Kinds of nodes, as they are typed.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(super) enum Kind {
    Mesh,
    Lines,
    Points,
    Light,
    Empty,
    Label,
}

impl Kind {
    /// The kind that a query asks for.
    pub fn of_nodes(self) -> NodeKind {
        match self {
            Self::Mesh => NodeKind::Mesh,
            Self::Lines => NodeKind::Lines,
            Self::Points => NodeKind::Points,
            Self::Light => NodeKind::Light,
            Self::Empty => NodeKind::Empty,
            Self::Label => NodeKind::Label,
        }
    }
}

pub(in crate::cli) fn layers(arguments: &LayerArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    if let (Some(name), Some(what)) = (&arguments.name, arguments.what) {
        let mut transaction = Transaction::default();
        transaction.set_layer_visible(name.as_str(), what == Visibility::Show);
        let edited = client.commit(transaction)?;
        let seen = Seen::of(&client, &edited.feedback)?;
        if arguments.json {
            say(in_json(&edited, &seen))?;
        } else {
            say(seen.in_words())?;
        }
        return Ok(seen.conclude());
    }
    let layers = client.layers()?;
    if arguments.json {
        let layer =
            |of: &LayerInfo| json!({ "name": of.name, "nodes": of.nodes, "visible": of.visible });
        say(Value::Array(layers.iter().map(layer).collect()))?;
        return Ok(ExitCode::SUCCESS);
    }
    if layers.is_empty() {
        say("there are no layers: node set NODE layer=NAME puts a node into one")?;
    }
    for LayerInfo { name, nodes, visible } in &layers {
        let hidden = if *visible { "" } else { ", hidden" };
        say(format_args!("{}: {}{hidden}", printable(name), counted(nodes, "node")))?;
    }
    Ok(ExitCode::SUCCESS)
}
