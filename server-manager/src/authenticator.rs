//! Who may come in: what a peer says of itself, against what it has proven.
//!
//! On this machine a token proves that a peer is the same user's. Over TLS no token is asked for:
//! the certificate proves more, which node of this very wall it is, and for that node only.

use polyptych_protocol::handshake::{Hello, Secret};
use polyptych_tls::{Credentials, NodeIdentity};
use polyptych_wall::Wall;
use polyptych_wall::limits::NAME_BYTES_MAX;

/// The facts that peers are checked against.
#[derive(Clone, Debug)]
pub(crate) struct Authenticator {
    /// TLS for all connections, where there are any.
    pub keys: Option<Credentials>,
    /// The token; empty with keys.
    pub secret: Secret,
    /// Every channel and the server that the wall file gives it.
    owners: Vec<(String, String)>,
}

impl Authenticator {
    pub fn new(token: String, keys: Option<Credentials>, wall: &Wall) -> Self {
        let owner = |c: &polyptych_wall::Channel| (c.name.clone(), c.server.clone());
        // Over TLS no peer knows a token, and certificates prove more.
        let secret = Secret(if keys.is_some() { String::new() } else { token });
        Self { keys, secret, owners: wall.channels.iter().map(owner).collect() }
    }

    /// Checks that a peer is what it says; `knows_token` if it has proven to know the token.
    ///
    /// # Errors
    /// Says what is wrong, and what would be right; sent to the peer.
    pub fn authenticate(
        &self,
        hello: &Hello,
        knows_token: bool,
        proven: Option<&NodeIdentity>,
    ) -> Result<(), String> {
        let name = match hello {
            Hello::Client(hello) => hello.name.as_str(),
            Hello::Server(hello) => hello.name.as_str(),
            Hello::Bulk(_) => "",
        };
        if name.len() > NAME_BYTES_MAX || name.chars().any(char::is_control) {
            return Err("a name has at most 64 bytes and no control characters".into());
        }
        match proven {
            Some(identity) => self.check_identity(hello, identity),
            // The stream lets nobody through who has proven nothing; nor does this.
            None if self.keys.is_some() => Err("it has shown no certificate".into()),
            None if knows_token => Ok(()),
            None => Err("the token is not this manager's; give the peer a copy of the manager's \
                         token file"
                .into()),
        }
    }

    fn check_identity(&self, hello: &Hello, identity: &NodeIdentity) -> Result<(), String> {
        let (said, is_same) = match (hello, identity) {
            (Hello::Client(hello), NodeIdentity::Client(name)) => {
                (format!("client {}", hello.name), hello.name == *name)
            }
            (Hello::Server(hello), NodeIdentity::Server(name)) => {
                (format!("server {}", hello.name), hello.name == *name)
            }
            // Its control connection said the name; the core's thread compares.
            (Hello::Bulk(_), NodeIdentity::Server(_)) => ("a server".into(), true),
            (Hello::Client(hello), _) => (format!("client {}", hello.name), false),
            (Hello::Server(hello), _) => (format!("server {}", hello.name), false),
            (Hello::Bulk(_), _) => ("a server".into(), false),
        };
        if !is_same {
            return Err(format!(
                "it says that it is {said}, and its certificate that it is {identity}; start it \
                 with the keys of what it is"
            ));
        }
        let Hello::Server(hello) = hello else { return Ok(()) };
        // A channel that the wall has not is for the core to refuse.
        let owner = |channel: &String| self.owners.iter().find(|(name, _)| name == channel);
        let mut taken = hello.channels.iter().filter_map(owner);
        match taken.find(|(_, server)| *server != hello.name) {
            Some((channel, server)) => Err(format!(
                "the wall file gives channel {channel} to server {server}, and this is {identity}"
            )),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::handshake::{Adapter, BulkHello, ClientHello, ServerHello};

    use super::*;

    const WALL: &str = r#"
        [wall]
        name = "gate"
        [[screen]]
        name = "front"
        size = [2.0, 1.0]
        center = [0.0, 0.0, -1.0]
        pixels = [200, 100]
        [[screen.channel]]
        name = "a"
        origin = [0, 0]
        pixels = [100, 100]
        server = "left"
        [[screen.channel]]
        name = "b"
        origin = [100, 0]
        pixels = [100, 100]
        server = "right"
        "#;

    fn server(name: &str, channels: &[&str]) -> Hello {
        Hello::Server(ServerHello {
            name: name.into(),
            channels: channels.iter().map(|&channel| channel.into()).collect(),
            pid: 1,
            adapter: Adapter::default(),
        })
    }

    fn client(name: &str) -> Hello {
        Hello::Client(ClientHello { name: name.into() })
    }

    #[test]
    fn a_peer_is_only_what_it_has_proven() {
        let wall = polyptych_wall_file::parse(WALL, "gate.toml".as_ref()).expect("a wall");
        let gate = Authenticator::new("0123456789abcdef".into(), None, &wall);
        let bulk = Hello::Bulk(BulkHello { session: 1 });
        let is = |text: &str| -> Option<NodeIdentity> {
            Some(match text.split_once(' ') {
                Some(("server", name)) => NodeIdentity::Server(name.into()),
                Some((_, name)) => NodeIdentity::Client(name.into()),
                None => NodeIdentity::Manager,
            })
        };
        for (hello, knows_token, proven, fault) in [
            (client("x"), true, None, ""),
            (client("x"), false, None, "the token is not"),
            (server("anyone", &["a", "b"]), true, None, ""),
            (bulk.clone(), false, None, "the token is not"),
            (client("x\n"), true, None, "a name has"),
            (client("x"), false, is("client x"), ""),
            (
                client("y"),
                false,
                is("client x"),
                "client y, and its certificate that it is client x",
            ),
            (client("left"), true, is("server left"), "certificate that it is server left"),
            (client("x"), true, is("manager"), "certificate that it is the manager"),
            (server("left", &["a"]), false, is("server left"), ""),
            (server("left", &["attic"]), false, is("server left"), ""),
            (server("left", &["a", "b"]), false, is("server left"), "channel b to server right"),
            (server("right", &["b"]), true, is("server left"), "that it is server left"),
            (server("left", &["a"]), true, is("client left"), "that it is client left"),
            (server("left", &["a"]), true, is("manager"), "that it is the manager"),
            (bulk.clone(), false, is("server left"), ""),
            (bulk.clone(), false, is("client left"), "that it is client left"),
            (bulk, true, is("manager"), "that it is the manager"),
        ] {
            let checked = gate.authenticate(&hello, knows_token, proven.as_ref());
            match checked {
                Ok(()) => assert_eq!(fault, "", "{hello:?} {proven:?}"),
                Err(said) => assert!(!fault.is_empty() && said.contains(fault), "{said}"),
            }
        }
    }
}
