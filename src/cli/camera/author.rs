//! `polyptych camera list` and `camera author`: the cameras that the file of the scene has.

use std::process::ExitCode;

use anyhow::bail;
use polyptych_client::blocking::Client;
use polyptych_client::{Attribute, CAMERA_KEY, Follow, NodeInfo, NodeQuery};
use polyptych_text::printable;
use serde_json::json;

use crate::cli::node::node_by_name;
use crate::cli::seen::show;
use crate::cli::{ManagerAddress, say};

/// Maximum number of cameras that a message names.
const NAMED_MAX: usize = 8;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct AuthorArguments {
    /// The camera, by its own name, or by the number, path or end of the path of its node; may be
    /// left out where there is only one
    camera: Option<String>,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct ListArguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// Lets the camera stand where the author's does, and move with its node.
pub(super) fn author(arguments: &AuthorArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let node = find(&client, arguments.camera.as_deref())?.id;
    let (eye, scale) = (client.wall()?.eye, client.presentation()?.camera.scale);
    client.follow_node(Follow::standing_at(node, eye, scale))?;
    show(&client)
}

pub(super) fn list(arguments: &ListArguments) -> anyhow::Result<ExitCode> {
    let cameras = cameras(&arguments.manager.connect()?)?;
    if arguments.json {
        let in_json = |node: &NodeInfo| {
            let position = node.world.translation.to_array();
            json!({ "node": node.id.0, "name": node.name, "camera": text_of(node),
                "position": position })
        };
        say(json!(cameras.iter().map(in_json).collect::<Vec<_>>()))?;
    } else if cameras.is_empty() {
        say("the open scene has no cameras")?;
    }
    for node in cameras.iter().filter(|_| !arguments.json) {
        let (name, camera) = (printable(&node.name), printable(text_of(node)));
        say(format_args!("{:>6}  {name}  {camera}", node.id.0))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The nodes of the open scene that have a camera, in their order.
fn cameras(client: &Client) -> anyhow::Result<Vec<NodeInfo>> {
    let attribute = Some((CAMERA_KEY.to_owned(), None));
    Ok(client.find_all_nodes(NodeQuery { attribute, ..NodeQuery::default() })?)
}

/// The one camera that is meant.
fn find(client: &Client, meant: Option<&str>) -> anyhow::Result<NodeInfo> {
    let mut cameras = cameras(client)?;
    if cameras.is_empty() {
        bail!("the open scene has no camera of its own; camera look-at and camera pose place one");
    }
    let Some(meant) = meant else {
        return match cameras.len() {
            1 => Ok(cameras.remove(0)),
            _ => bail!("the open scene has several cameras; say which: {}", names(&cameras)),
        };
    };
    let called: Vec<_> = cameras.iter().filter(|node| is_called(node, meant)).collect();
    let found = match called[..] {
        [node] => node.id,
        // Perhaps a number or a path, which tells of what is in the way.
        _ => node_by_name(client, meant).map_err(|error| {
            anyhow::anyhow!("{error}; the cameras of the scene are {}", names(&cameras))
        })?,
    };
    match cameras.iter().position(|node| node.id == found) {
        Some(place) => Ok(cameras.swap_remove(place)),
        None => bail!("{meant} has no camera; those of the scene are {}", names(&cameras)),
    }
}

fn is_called(node: &NodeInfo, meant: &str) -> bool {
    let own = text_of(node).strip_prefix(meant).is_some_and(|rest| rest.starts_with(": "));
    own || node.name == meant
}

/// The file's words on a camera.
fn text_of(node: &NodeInfo) -> &str {
    match node.attributes.get(CAMERA_KEY) {
        Some(Attribute::Text(text)) => text,
        _ => "",
    }
}

fn names(cameras: &[NodeInfo]) -> String {
    let name = |node: &NodeInfo| match printable(&node.name) {
        name if name.is_empty() => node.id.0.to_string(),
        name => format!("{} ({name})", node.id.0),
    };
    let mut text = cameras.iter().take(NAMED_MAX).map(name).collect::<Vec<_>>().join(", ");
    if cameras.len() > NAMED_MAX {
        text += ", …";
    }
    text
}
