//! A wall with HTTP, and HTTP/1.1 as it is typed: the tests must be able to send anything.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

use polyptych_client::{ChannelState, Wall};
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states};
use crate::harness::place::TestDir;

/// A running wall and where its HTTP is.
pub struct Page {
    pub local: LocalWall,
    pub address: String,
    /// The bearer token that programs send.
    pub bearer: String,
    /// Method and path of the routes that were asked for.
    pub asked: RefCell<BTreeSet<(String, String)>>,
}

/// An answer.
#[derive(Debug)]
pub struct Answer {
    pub code: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Page {
    /// Starts a wall, with more arguments for its manager, and waits until channels could draw.
    pub fn start(wall: &Wall, scenes: &[&Path], extra: &[&str]) -> Self {
        let mut page = Self::manager(TestDir::new(), wall, scenes, extra);
        for channel in &wall.channels {
            if !page.local.servers.contains_key(&channel.server) {
                page.local.start_server(&channel.server);
            }
        }
        await_states(&page.local.client(), &[ChannelState::Ready, ChannelState::Live]);
        page
    }

    /// Starts the manager only.
    pub fn manager(place: TestDir, wall: &Wall, scenes: &[&Path], extra: &[&str]) -> Self {
        let arguments: Vec<&str> = ["--http", ANY_PORT].iter().chain(extra).copied().collect();
        let mut local = LocalWall::manager_with(place, wall, scenes, ANY_PORT, &arguments);
        let line = local.manager.await_line(&["HTTP is offered", "url=http"]);
        let address = line.split("://").nth(1).and_then(|rest| rest.split('/').next());
        let address = address.expect("an address").to_owned();
        let bearer = if local.place.token_file().exists() {
            local.place.run(["login", "--token"]).succeeded().trim().to_owned()
        } else {
            String::new()
        };
        Self { local, address, bearer, asked: RefCell::default() }
    }

    /// The head of a request, with what a program must send.
    pub fn head(&self, method: &str, path: &str) -> String {
        format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nAuthorization: Bearer \
             {}\r\n",
            self.address, self.bearer
        )
    }

    /// Asks for a path below the interface, with a body if there is one.
    pub fn ask(&self, method: &str, path: &str, body: Option<&Value>) -> Answer {
        let mut text = self.head(method, &format!("/api/v1{path}"));
        if let Some(body) = body {
            let body = body.to_string();
            text += "Content-Type: application/json\r\nContent-Length: ";
            text += &[&body.len().to_string(), "\r\n\r\n", &body].concat();
        } else {
            text += "\r\n";
        }
        exchange(&self.address, text.as_bytes())
    }

    /// Asks for a route of the description, with these names for its parameters, and records that
    /// it was asked.
    #[expect(clippy::needless_pass_by_value, reason = "callers make it for this")]
    pub fn route(&self, method: &str, route: &str, names: &[&str], body: Option<Value>) -> Answer {
        let (pattern, query) = route.split_once('?').unwrap_or((route, ""));
        self.asked.borrow_mut().insert((method.to_owned(), pattern.to_owned()));
        let mut path = pattern.to_owned();
        for name in names {
            let start = path.find('{').expect("a name is wanted");
            let end = path[start..].find('}').expect("its end") + start;
            path.replace_range(start..=end, name);
        }
        if !query.is_empty() {
            path += "?";
            path += query;
        }
        self.ask(method, &path, body.as_ref())
    }
}

impl Answer {
    /// The value of a successful answer.
    #[track_caller]
    pub fn value(&self) -> Value {
        assert_eq!(self.code, 200, "{self}");
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {self}"))
    }

    /// Checks a refusal by its code and a part of its text.
    #[track_caller]
    pub fn refused(&self, code: u16, part: &str) {
        assert_eq!(self.code, code, "{self}");
        let value: Value = serde_json::from_slice(&self.body).expect("JSON");
        let error = value["error"].as_str().expect("a reason");
        assert!(error.contains(part), "{error:?} has no {part:?}");
    }

    /// A line of the head.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.find(|(of, _)| of.eq_ignore_ascii_case(name)).map(|(_, value)| value)
    }
}

impl std::fmt::Display for Answer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}\n{}", self.head, String::from_utf8_lossy(&self.body))
    }
}

/// A connection that gives up rather than hang.
pub fn connect(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(Duration::from_mins(2))).expect("a limit");
    stream.set_write_timeout(Some(Duration::from_mins(1))).expect("a limit");
    stream
}

/// Sends bytes and reads until the manager closes the connection.
pub fn exchange(address: &str, bytes: &[u8]) -> Answer {
    let mut stream = connect(address);
    // It may close the connection before it has read all.
    let _ = stream.write_all(bytes);
    read_answer(&mut stream)
}

/// Reads until the manager closes the connection.
pub fn read_answer(stream: &mut TcpStream) -> Answer {
    let mut bytes = Vec::new();
    // What it sent before a reset counts.
    let _ = stream.read_to_end(&mut bytes);
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap_or(bytes.len());
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let body = bytes.get(end + 4..).unwrap_or_default();
    let is_chunked = head.to_ascii_lowercase().contains("transfer-encoding: chunked");
    let body = if is_chunked { unchunked(body) } else { body.to_vec() };
    let code = head.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
    Answer { code, head, body }
}

fn unchunked(mut rest: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    while let Some(end) = rest.windows(2).position(|two| two == b"\r\n") {
        let length = String::from_utf8_lossy(&rest[..end]);
        let length = usize::from_str_radix(length.trim(), 16).expect("a length");
        let Some(piece) = rest.get(end + 2..end + 2 + length) else { break };
        body.extend_from_slice(piece);
        rest = rest.get(end + 4 + length..).unwrap_or_default();
        if length == 0 {
            break;
        }
    }
    body
}
