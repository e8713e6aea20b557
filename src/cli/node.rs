//! `polyptych node`, `transaction` and `scene tree`: the open scene of a running wall, read and
//! changed.

mod layer;
mod node_change;
mod node_name;
mod shape;
mod style_change;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail};
pub(super) use layer::{LayerArguments, layers};
use node_change::NodeChange;
pub(super) use node_change::rotation;
use node_name::find;
pub(super) use node_name::node_by_name;
use polyptych_client::blocking::Client;
use polyptych_client::glam::DAffine3;
use polyptych_client::{
    AssetSource, Assets, Attribute, Edited, NodeId, NodeInfo, NodeQuery, NodeStyle, Transaction,
};
use polyptych_text::printable;
use serde_json::{Value, json};
use style_change::{facing_name, style_in_json};

use super::remote::{here_or_there, say_notes};
use super::seen::Seen;
use super::{ManagerAddress, say};

/// Largest file of operations that is read: far more than a transaction may have.
const FILE_BYTES_MAX: u64 = 64 << 20;

#[derive(Debug, clap::Subcommand)]
pub(super) enum NodeCommand {
    /// Make a node
    Add(AddArguments),
    /// Change a node
    Set(SetArguments),
    /// Hang a node, with all that hangs from it, from another
    Move(MoveArguments),
    /// Take a node away with all that hangs from it
    Remove(RemoveArguments),
}

/// Where to change what, and how to say what came of it.
#[derive(Debug, clap::Args)]
struct Target {
    /// Print JSON: the numbers of the nodes that were made, and the frame
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct AddArguments {
    /// What it is: name=TEXT position=X,Y,Z rotation=YAW,PITCH,ROLL scale=S visible=true
    /// mesh=INDEX layer=NAME attribute.KEY=VALUE; a new mesh is mesh=box:X,Y,Z, sphere:RADIUS,
    /// cylinder:RADIUS,HEIGHT, cone:LOW,HIGH,HEIGHT, rectangle:WIDTH,HEIGHT, line:X,Y,Z,… or
    /// points:X,Y,Z,… with color=#RRGGBB; a text is
    /// label=TEXT size=SIZE color=#RRGGBB, with SIZE from line to line
    #[arg(value_name = "KEY=VALUE")]
    words: Vec<String>,
    /// The node that it hangs from, by number or path [default: the scene itself]
    #[arg(long, value_name = "NODE")]
    parent: Option<String>,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, clap::Args)]
pub(super) struct SetArguments {
    /// The node, by its number, its path such as /house/door, or the end of its path
    node: String,
    /// As of `node add`, a label with size and color; and switch=CHILD, which shows only this of
    /// the nodes that hang from it, or switch=all; fill=solid|wireframe|points
    /// shading=material|unlit highlight=#RRGGBB|off facing=eye|upright|none, for all that hangs
    /// from it too; what is not given stays as it is
    #[arg(required = true, value_name = "KEY=VALUE")]
    words: Vec<String>,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, clap::Args)]
pub(super) struct MoveArguments {
    /// The node, as of `node set`
    node: String,
    /// The node that it hangs from then; / for the scene itself
    parent: String,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, clap::Args)]
pub(super) struct RemoveArguments {
    /// The node, as of `node set`
    node: String,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, clap::Args)]
pub(super) struct TransactionArguments {
    /// A JSON file with a list of operations: {"op": "add", "as": "arm", "parent": NODE, KEY: …},
    /// {"op": "set", "node": NODE, KEY: …}, {"op": "move", "node": NODE, "parent": NODE} and
    /// {"op": "remove", "node": NODE}; "$arm" is the node that was added as "arm"
    file: PathBuf,
    #[command(flatten)]
    target: Target,
}

#[derive(Debug, clap::Args)]
pub(super) struct TreeArguments {
    /// Only this node and what hangs from it, as of `node set`
    #[arg(long, value_name = "NODE")]
    below: Option<String>,
    /// Only nodes of this name
    #[arg(long)]
    name: Option<String>,
    /// Only nodes in this layer, their own or that of a node above them
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Only nodes of this kind
    #[arg(long, value_name = "KIND")]
    kind: Option<layer::Kind>,
    /// Print JSON: all that is known of each node
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct ImportArguments {
    /// A .gltf or .glb file in one of the manager's scene folders
    file: String,
    /// Name, position, rotation and scale of the node that is made for it, as of `node add`
    /// [default: the file's name, at the origin]
    #[arg(value_name = "KEY=VALUE")]
    words: Vec<String>,
    /// The node that it hangs from, by number or path [default: the scene itself]
    #[arg(long, value_name = "NODE")]
    parent: Option<String>,
    #[command(flatten)]
    target: Target,
}

/// The nodes of the open scene, and what is to become of them.
struct Editor {
    client: Client,
    /// Read once a path is to be found.
    nodes: Option<Vec<NodeInfo>>,
    /// Nodes of this transaction by the name that it gives them.
    made: BTreeMap<String, NodeId>,
    /// The places and styles of nodes that this transaction has made or changed.
    places: BTreeMap<NodeId, (DAffine3, NodeStyle)>,
    transaction: Transaction,
    /// The assets that it brings.
    assets: Assets,
}

impl Editor {
    /// Changes are refused where somebody else has changed the same since.
    fn new(client: Client) -> anyhow::Result<Self> {
        let transaction = Transaction::based_on(client.status()?.revision);
        let (made, places) = (BTreeMap::new(), BTreeMap::new());
        let assets = Assets::default();
        Ok(Self { client, nodes: None, made, places, transaction, assets })
    }

    fn nodes(&mut self) -> anyhow::Result<&[NodeInfo]> {
        if self.nodes.is_none() {
            self.nodes = Some(self.client.find_all_nodes(NodeQuery::default())?);
        }
        Ok(self.nodes.as_deref().unwrap_or_default())
    }

    /// The node that is meant by a number, a path, or a name of this transaction.
    fn node(&mut self, meant: &str) -> anyhow::Result<NodeId> {
        if let Some(name) = meant.strip_prefix('$') {
            let made = self.made.get(name).copied();
            return made.ok_or_else(|| anyhow!("{meant}: no operation before this adds it"));
        }
        if let Ok(number) = meant.parse() {
            return Ok(NodeId(number));
        }
        find(self.nodes()?, meant)
    }

    /// The node that is meant by the name of one that hangs from a node, or as by [`Self::node`].
    fn child(&mut self, of: NodeId, meant: &str) -> anyhow::Result<NodeId> {
        let nodes = self.nodes()?.iter();
        let called = nodes.filter(|child| child.parent == Some(of) && child.name == meant);
        match called.map(|child| child.id).collect::<Vec<_>>()[..] {
            [child] => Ok(child),
            _ => self.node(meant),
        }
    }

    /// `None` for the scene itself.
    fn parent(&mut self, meant: &str) -> anyhow::Result<Option<NodeId>> {
        if meant == "/" { Ok(None) } else { self.node(meant).map(Some) }
    }

    fn add(
        &mut self,
        mut change: NodeChange,
        parent: Option<&str>,
        name: Option<&str>,
    ) -> anyhow::Result<()> {
        let parent = parent.map(|parent| self.parent(parent)).transpose()?.flatten();
        change.take_shape(&mut self.assets)?;
        if change.take_switch().is_some() {
            bail!("nothing hangs from a node that is made; set its switch afterwards");
        }
        let (node, known) = change.create(parent, &mut self.transaction);
        self.places.insert(node, known);
        if let Some(name) = name {
            self.made.insert(name.to_owned(), node);
        }
        Ok(())
    }

    fn set(&mut self, node: &str, mut change: NodeChange) -> anyhow::Result<()> {
        change.check_label()?;
        change.take_shape(&mut self.assets)?;
        let node = self.node(node)?;
        let (local, style) = if let Some(known) = self.places.get(&node) {
            *known
        } else {
            let mut nodes = self.nodes()?.iter();
            let known = nodes.find(|of| of.id == node).map(|of| (of.local, of.style));
            known.ok_or_else(|| anyhow!("there is no {node} in the open scene"))?
        };
        if let Some(shown) = change.take_switch() {
            let shown = shown.map(|child| self.child(node, &child)).transpose()?;
            self.transaction.set_switch(node, shown);
        }
        let known = change.edit(node, (&local, style), &mut self.transaction);
        self.places.insert(node, known);
        Ok(())
    }

    fn operation(&mut self, operation: &Value) -> anyhow::Result<()> {
        let of = operation.as_object().context("an operation is an object with \"op\"")?;
        let text = |key: &str| {
            of.get(key).map(|value| match value {
                Value::String(text) => Ok(text.clone()),
                Value::Number(number) if number.is_u64() => Ok(number.to_string()),
                _ => Err(anyhow!("{key} is a number of a node, or a path")),
            })
        };
        let needed = |key: &str| text(key).unwrap_or_else(|| Err(anyhow!("it has no \"{key}\"")));
        let mut change = NodeChange::default();
        for (key, value) in of {
            match (key.as_str(), value) {
                ("op" | "node" | "parent" | "as", _) => {}
                ("attributes", Value::Object(all)) => {
                    for (key, value) in all {
                        change.set(&format!("attribute.{key}"), value)?;
                    }
                }
                (key, value) => change.set(key, value).with_context(|| key.to_owned())?,
            }
        }
        let op = of.get("op").and_then(Value::as_str);
        let taken: &[&str] = match op {
            Some("add") => &["parent", "as"],
            Some("move") => &["node", "parent"],
            Some("set" | "remove") => &["node"],
            _ => &["node", "parent", "as"],
        };
        let is_of_node = matches!(op, Some("add" | "set"));
        let is_taken = |key: &str| match key {
            "op" => true,
            "node" | "parent" | "as" => taken.contains(&key),
            _ => is_of_node,
        };
        if let (Some(op), Some(key)) = (op, of.keys().find(|key| !is_taken(key))) {
            let taken = taken.join(" and ");
            bail!("\"{op}\" takes {taken}, not \"{key}\": write an operation of its own for that");
        }
        match op {
            Some("add") => {
                let (parent, name) = (text("parent").transpose()?, text("as").transpose()?);
                self.add(change, parent.as_deref(), name.as_deref())
            }
            Some("set") => self.set(&needed("node")?, change),
            Some("move") => {
                let (node, parent) = (self.node(&needed("node")?)?, needed("parent")?);
                let parent = self.parent(&parent)?;
                self.transaction.set_parent(node, parent);
                Ok(())
            }
            Some("remove") => {
                let node = self.node(&needed("node")?)?;
                self.transaction.remove(node);
                Ok(())
            }
            _ => bail!("\"op\" is \"add\", \"set\", \"move\" or \"remove\""),
        }
    }

    /// Has it done, and says what came of it.
    fn commit(mut self, is_json: bool) -> anyhow::Result<ExitCode> {
        if !self.assets.is_empty() {
            self.transaction = self.transaction.with_assets(self.assets.to_source()?);
        }
        if self.transaction.edits.is_empty() && self.transaction.assets.is_none() {
            bail!("nothing would change");
        }
        let edited = self.client.commit(self.transaction)?;
        conclude(&self.client, &edited, is_json)
    }
}

/// Says what came of a transaction.
fn conclude(client: &Client, edited: &Edited, is_json: bool) -> anyhow::Result<ExitCode> {
    let seen = Seen::of(client, &edited.feedback)?;
    if is_json {
        say(in_json(edited, &seen))?;
    } else {
        let made: Vec<_> = edited.created.iter().take(8).map(ToString::to_string).collect();
        let made = match edited.created.len() {
            0 => String::new(),
            count if count <= 8 => format!("made {}; ", made.join(", ")),
            count => format!("made {count} nodes from {} on; ", edited.created[0]),
        };
        let revision = edited.revision;
        say(format_args!("{made}revision {revision}, {}", seen.in_words()))?;
        say_notes(&edited.notes)?;
    }
    Ok(seen.conclude())
}

fn in_json(edited: &Edited, seen: &Seen) -> Value {
    json!({
        "revision": edited.revision.0,
        "created": edited.created.iter().map(|node| node.0).collect::<Vec<_>>(),
        "first_mesh": edited.assets.map(|numbers| numbers.first_mesh),
        "frame": edited.feedback.frame.0,
        "is_complete": seen.is_complete(),
        "notes": edited.notes,
    })
}

pub(super) fn run(command: &NodeCommand) -> anyhow::Result<ExitCode> {
    let target = match command {
        NodeCommand::Add(AddArguments { target, .. })
        | NodeCommand::Set(SetArguments { target, .. })
        | NodeCommand::Move(MoveArguments { target, .. })
        | NodeCommand::Remove(RemoveArguments { target, .. }) => target,
    };
    // Wrong words are told before a manager is asked for.
    let change = match command {
        NodeCommand::Add(AddArguments { words, .. })
        | NodeCommand::Set(SetArguments { words, .. }) => NodeChange::from_words(words)?,
        _ => NodeChange::default(),
    };
    let mut editor = Editor::new(target.manager.connect()?)?;
    match command {
        NodeCommand::Add(arguments) => editor.add(change, arguments.parent.as_deref(), None)?,
        NodeCommand::Set(arguments) => editor.set(&arguments.node, change)?,
        NodeCommand::Move(arguments) => {
            let node = editor.node(&arguments.node)?;
            let parent = editor.parent(&arguments.parent)?;
            editor.transaction.set_parent(node, parent);
        }
        NodeCommand::Remove(arguments) => {
            let node = editor.node(&arguments.node)?;
            editor.transaction.remove(node);
        }
    }
    editor.commit(target.json)
}

pub(super) fn import(arguments: &ImportArguments) -> anyhow::Result<ExitCode> {
    let change = NodeChange::from_words(&arguments.words)?;
    let mut editor = Editor::new(arguments.target.manager.connect()?)?;
    let parent = arguments.parent.as_deref().map(|parent| editor.parent(parent));
    let below = change.new_node(parent.transpose()?.flatten(), &arguments.file)?;
    let Editor { client, transaction, .. } = editor;
    let edited = here_or_there(&arguments.file, |path| {
        let source = AssetSource::File(path.to_owned());
        client.commit(transaction.clone().with_scene(source, below.clone()))
    })?;
    conclude(&client, &edited, arguments.target.json)
}

pub(super) fn transaction(arguments: &TransactionArguments) -> anyhow::Result<ExitCode> {
    let file = arguments.file.display();
    let facts = std::fs::metadata(&arguments.file).with_context(|| file.to_string())?;
    if !facts.is_file() || facts.len() > FILE_BYTES_MAX {
        bail!("{file}: not a file of at most {FILE_BYTES_MAX} bytes");
    }
    let text = std::fs::read(&arguments.file).with_context(|| file.to_string())?;
    let operations: Vec<Value> = serde_json::from_slice(&text)
        .with_context(|| format!("{file}: not a JSON list of operations"))?;
    let mut editor = Editor::new(arguments.target.manager.connect()?)?;
    for (index, operation) in operations.iter().enumerate() {
        editor.operation(operation).with_context(|| format!("{file}: operation {index}"))?;
    }
    editor.commit(arguments.target.json)
}

/// The node of the open scene that is meant by a number or a path.
pub(super) fn find_node(client: &Client, meant: &str) -> anyhow::Result<NodeId> {
    Editor::new(client.clone())?.node(meant)
}

/// A query for nodes of a name, below one that is meant by its number or path.
pub(super) fn query_for(
    client: &Client,
    below: Option<&str>,
    name: Option<&str>,
) -> anyhow::Result<NodeQuery> {
    let mut query = NodeQuery { name: name.map(str::to_owned), ..NodeQuery::default() };
    if let Some(below) = below {
        query.below = Some(find_node(client, below)?);
    }
    Ok(query)
}

pub(super) fn tree(arguments: &TreeArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let mut query = query_for(&client, arguments.below.as_deref(), arguments.name.as_deref())?;
    query.layer.clone_from(&arguments.layer);
    query.kind = arguments.kind.map(layer::Kind::of_nodes);
    let nodes = client.find_all_nodes(query)?;
    if arguments.json {
        let nodes: Vec<Value> = nodes.iter().map(node_in_json).collect();
        say(Value::Array(nodes))?;
        return Ok(ExitCode::SUCCESS);
    }
    let top = nodes.iter().map(|node| node.depth).min().unwrap_or(0);
    for node in &nodes {
        let name = if node.name.is_empty() { "(no name)".into() } else { printable(&node.name) };
        let mut facts = Vec::new();
        facts.extend(node.mesh.map(|mesh| format!("mesh {mesh}")));
        facts.extend(node.light.as_ref().map(|_| "light".to_owned()));
        facts.extend((!node.visible).then(|| "hidden".to_owned()));
        facts.extend(node.own_layer.as_ref().map(|layer| format!("layer {}", printable(layer))));
        facts.extend(node.switch.map(|child| format!("shows only {child}")));
        facts.extend(node.attributes.iter().map(|(key, value)| {
            let value = match value {
                Attribute::Bool(is) => is.to_string(),
                Attribute::Number(number) => number.to_string(),
                Attribute::Text(text) => text.clone(),
            };
            printable(&format!("{key}={value}")).into_owned()
        }));
        let indent = "  ".repeat((node.depth - top) as usize);
        say(format_args!("{indent}{} {name}  {}", node.id.0, facts.join(", "))
            .to_string()
            .trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}

pub(super) fn node_in_json(node: &NodeInfo) -> Value {
    let (scale, rotation, position) = node.local.to_scale_rotation_translation();
    json!({
        "id": node.id.0,
        "parent": node.parent.map(|parent| parent.0),
        "name": node.name,
        "depth": node.depth,
        "visible": node.visible,
        "layer": node.layer,
        "own_layer": node.own_layer,
        "switch": node.switch.map(|child| child.0),
        "style": style_in_json(&node.style),
        "facing": node.facing.map(facing_name),
        "mesh": node.mesh,
        "light": node.light,
        "position": position,
        "rotation": rotation,
        "scale": scale,
        "world": node.world,
        "attributes": node.attributes.iter().map(|(key, value)| {
            let value = match value {
                Attribute::Bool(is) => json!(is),
                Attribute::Number(number) => json!(number),
                Attribute::Text(text) => json!(text),
            };
            (key.clone(), value)
        }).collect::<serde_json::Map<_, _>>(),
        "bounds": node.bounds.map(|of| json!({ "min": of.min, "max": of.max })),
    })
}
