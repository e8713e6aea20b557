//! Nodes as people name them: by number, or by path.

use std::collections::BTreeMap;

use anyhow::bail;
use polyptych_client::blocking::Client;
use polyptych_client::{NodeId, NodeInfo, NodeQuery};

/// The node that is meant by a number or a path.
///
/// # Errors
/// There is none, or there are several.
pub(in crate::cli) fn node_by_name(client: &Client, meant: &str) -> anyhow::Result<NodeId> {
    match meant.parse() {
        Ok(number) => Ok(NodeId(number)),
        Err(_) => find(&client.find_all_nodes(NodeQuery::default())?, meant),
    }
}

/// The one node whose path ends so; from the scene itself on where it begins with a slash. Names
/// may have slashes of their own.
pub(super) fn find(nodes: &[NodeInfo], meant: &str) -> anyhow::Result<NodeId> {
    // Parents come before their children.
    let mut paths: BTreeMap<NodeId, String> = BTreeMap::new();
    let end = format!("/{}", meant.trim_start_matches('/'));
    let mut found = Vec::new();
    for node in nodes {
        let above = node.parent.and_then(|parent| paths.get(&parent));
        let path = format!("{}/{}", above.map_or("", String::as_str), node.name);
        let is_whole = meant.starts_with('/');
        if path == end || (!is_whole && path.ends_with(&end)) {
            found.push(node.id);
        }
        paths.insert(node.id, path);
    }
    match found[..] {
        [node] => Ok(node),
        [] => bail!("{meant}: the open scene has no such node; polyptych scene tree lists them"),
        [..] => {
            let some: Vec<_> = found.iter().take(8).map(|node| node.0.to_string()).collect();
            let more = if found.len() > 8 { ", …" } else { "" };
            bail!("{meant}: several nodes are called so: {}{more}; say which", some.join(", "))
        }
    }
}
