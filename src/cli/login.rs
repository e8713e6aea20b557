//! `polyptych login`: how a browser comes to command a wall, and the token of programs.

use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use polyptych_manager::http::PORT_DEFAULT;
use polyptych_manager::http::login::{ChallengeEnd, bearer, is_same, nonce, proof};
use polyptych_protocol::stream::check_addresses;
use polyptych_protocol::token;
use serde_json::{Value, json};

use super::{http, say};

/// Maximum size of an answer; ours have 200 bytes.
const ANSWER_BYTES_MAX: u64 = 64 << 10;

/// Maximum time for each answer.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(10);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Where the manager serves HTTP
    #[arg(long, value_name = "ADDR", value_parser = http::address)]
    #[arg(default_value_t = format!("127.0.0.1:{PORT_DEFAULT}"))]
    http: String,
    /// Print the bearer token of programs instead of a link
    #[arg(long)]
    token: bool,
    /// The file with the manager's token [default: where the manager of this user puts it]
    #[arg(long, value_name = "FILE", env = token::TOKEN_FILE_VARIABLE)]
    token_file: Option<PathBuf>,
    /// Go over a network, though nothing is encrypted
    #[arg(long)]
    insecure: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let path = match &arguments.token_file {
        Some(path) => path.clone(),
        None => token::default_path()?,
    };
    let token = token::read(&path)?;
    if arguments.token {
        return say(bearer(&token));
    }
    let at = &arguments.http;
    let addresses = at.to_socket_addrs().with_context(|| format!("{at} names no machine"))?;
    check_addresses(&addresses.collect::<Vec<_>>(), arguments.insecure)?;
    say(link(at, &token).with_context(|| format!("with the token in {}", path.display()))?)
}

/// A link that logs a browser in, once, at a manager that knows the token.
pub(super) fn link(at: &str, token: &str) -> anyhow::Result<String> {
    let mine = nonce().map_err(|reason| anyhow!(reason))?;
    let challenge = post(at, "/api/v1/login/challenge", &json!({ "nonce": mine }))?;
    let manager = text(&challenge, "nonce")?;
    let expected = proof(token, ChallengeEnd::Manager, manager, &mine);
    if !is_same(&expected, text(&challenge, "proof")?) {
        bail!("what listens at {at} does not know the token; it is another manager, or none");
    }
    let mine = proof(token, ChallengeEnd::Client, manager, &mine);
    let code = post(at, "/api/v1/login/code", &json!({ "nonce": manager, "proof": mine }))?;
    Ok(format!("http://{at}/login?code={}", text(&code, "code")?))
}

fn text<'a>(answer: &'a Value, name: &str) -> anyhow::Result<&'a str> {
    answer[name].as_str().with_context(|| format!("the answer has no {name}"))
}

/// Sends JSON and returns the answer's.
fn post(at: &str, path: &str, body: &Value) -> anyhow::Result<Value> {
    let about =
        || format!("no manager serves HTTP at {at}; start it with --http {at}, or say --http ADDR");
    let mut stream = TcpStream::connect(at).with_context(about)?;
    stream.set_read_timeout(Some(ANSWER_TIME_MAX))?;
    stream.set_write_timeout(Some(ANSWER_TIME_MAX))?;
    let body = body.to_string();
    write!(
        stream,
        "POST {path} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\nContent-Type: \
         application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    )
    .with_context(about)?;
    let mut answer = Vec::new();
    stream.take(ANSWER_BYTES_MAX).read_to_end(&mut answer).with_context(about)?;
    let answer = String::from_utf8_lossy(&answer);
    let (head, body) = answer.split_once("\r\n\r\n").with_context(about)?;
    let value: Value = serde_json::from_str(body).with_context(about)?;
    if !head.starts_with("HTTP/1.1 200 ") {
        bail!("{at}: {}", value["error"].as_str().unwrap_or("an answer without a reason"));
    }
    Ok(value)
}
