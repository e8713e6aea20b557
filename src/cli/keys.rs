//! `polyptych keys`: makes a wall's authority, and a folder of keys for each of its nodes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use polyptych_tls::NodeIdentity;
use polyptych_wall::Wall;
use polyptych_wall::limits::NAME_BYTES_MAX;

use super::{load_wall, say};
use crate::certificate_authority::{CertificateAuthority, IssueOutcome};

/// The client that every wall has: whoever types commands.
const CLIENT_DEFAULT: &str = "operator";

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// Where the folders go: one stays, each of the others is copied to one node
    #[arg(short, long, value_name = "DIR", default_value = "keys")]
    out: PathBuf,
    /// A client that gets keys, beside "operator"; may be given again
    #[arg(long, value_name = "NAME", value_parser = client_name)]
    client: Vec<String>,
    /// Make the keys of all these nodes anew, by the same authority; the old ones stay valid
    #[arg(long)]
    renew: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let wall = load_wall(&arguments.wall)?;
    let (authority, done) = CertificateAuthority::open_or_create(&arguments.out.join("authority"))?;
    say(format_args!(
        "{} {}: stays here; whoever has its key.pem can join the wall",
        word(done),
        arguments.out.join("authority").display()
    ))?;
    for (node, use_of_it) in nodes(&wall, arguments) {
        let folder = arguments.out.join(node.folder());
        let done = authority.issue(&node, &folder, arguments.renew)?;
        say(format_args!("{} {}: {use_of_it}", word(done), folder.display()))?;
    }
    Ok(())
}

fn word(done: IssueOutcome) -> &'static str {
    match done {
        IssueOutcome::Made => "made",
        IssueOutcome::Kept => "kept",
        IssueOutcome::Renewed => "renewed",
    }
}

/// Every node, and how its folder is used.
fn nodes(wall: &Wall, arguments: &Arguments) -> Vec<(NodeIdentity, String)> {
    let file = arguments.wall.display();
    let port = wall.listen.rsplit_once(':').map_or("7878", |(_, port)| port);
    let manager = format!(
        "copy it to the manager: polyptych manager {file} --listen 0.0.0.0:{port} --keys manager"
    );
    let mut nodes = vec![(NodeIdentity::Manager, manager)];
    let mut servers: BTreeMap<&str, String> = BTreeMap::new();
    for channel in &wall.channels {
        let channels = servers.entry(&channel.server).or_default();
        channels.push_str(" --channel ");
        channels.push_str(&channel.name);
    }
    nodes.extend(servers.into_iter().map(|(name, channels)| {
        let node = NodeIdentity::Server(name.into());
        let folder = node.folder();
        let server = format!(
            "copy it to that machine: polyptych server --manager HOST:{port} --keys {folder}\
             {channels}"
        );
        (node, server)
    }));
    let mut clients = vec![CLIENT_DEFAULT.to_owned()];
    clients.extend(arguments.client.iter().filter(|name| *name != CLIENT_DEFAULT).cloned());
    nodes.extend(clients.into_iter().map(|name| {
        let node = NodeIdentity::Client(name);
        let folder = node.folder();
        let client = format!(
            "copy it to who drives the wall: polyptych status --manager HOST:{port} --keys \
             {folder}, or POLYPTYCH_KEYS={folder}"
        );
        (node, client)
    }));
    nodes
}

/// A client's name, as an argument: a part of a folder's name, as those of servers are.
fn client_name(text: &str) -> Result<String, String> {
    let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let is_name = (1..=NAME_BYTES_MAX).contains(&text.len())
        && text.chars().all(fits)
        && !text.starts_with(['.', '-']);
    is_name.then(|| text.to_owned()).ok_or_else(|| {
        format!(
            "write 1 to {NAME_BYTES_MAX} of the letters a–z and A–Z, digits, \"-\", \"_\" and \
             \".\"; neither \"-\" nor \".\" begins it"
        )
    })
}
