//! The checked sections of a wall file about its processes: they are no part of the wall,
//! so that no server and no state file hears of a host that was renamed.

use std::collections::BTreeMap;

use polyptych_wall::Wall;
use polyptych_wall::limits::PATH_BYTES_MAX;

use super::document::{Document, LaunchOutput, LaunchSection, ServerSection};
use super::error::WallFileError;
use super::source::SourceText;

/// Maximum bytes of a host: 253 bytes of a DNS name, and a user's name before it.
const HOST_BYTES_MAX: usize = 320;

/// Maximum number of arguments or variables in one list: more than the command has options.
const ARGUMENTS_MAX: usize = 64;

/// Maximum number of GPUs of a server: no machine has more.
const GPUS_MAX: u32 = 64;

/// The machines, arguments and variables of a wall's processes.
#[derive(Clone, Debug, PartialEq)]
pub struct Launch {
    /// The machine of the manager, `HOST` or `USER@HOST`; `None` for that of the command.
    pub manager_host: Option<String>,
    /// `HOST:PORT` at which servers reach the manager; `None` for the address at which it listens.
    pub address: Option<String>,
    /// The absolute path of the wall file on the manager's machine; `None` for the given one.
    pub wall: Option<String>,
    /// The command `polyptych` on each machine: a path or a name.
    pub program: String,
    /// The folder of the folders of keys on each machine.
    pub keys: Option<String>,
    /// `true` if processes may go over a network without keys.
    pub is_insecure: bool,
    /// More arguments of the manager.
    pub manager_arguments: Vec<String>,
    /// Variables of the manager.
    pub environment: BTreeMap<String, String>,
    /// The command that runs a command on another machine; one word or more.
    pub ssh: Vec<String>,
    /// All servers of the wall, by name.
    pub servers: BTreeMap<String, ServerLaunch>,
}

/// The machine, arguments and variables of one server.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ServerLaunch {
    /// The machine, `HOST` or `USER@HOST`; `None` for that of the command.
    pub host: Option<String>,
    /// The channels that it draws, in the order of the wall; at least one.
    pub channels: Vec<String>,
    /// The kind of its output; `None` if neither the file nor `DISPLAY` in it says so.
    pub output: Option<LaunchOutput>,
    /// A part of the name or the PCI address of its GPU; `None` for the best one.
    pub gpu: Option<String>,
    /// More arguments.
    pub arguments: Vec<String>,
    /// Variables.
    pub environment: BTreeMap<String, String>,
    /// GPUs that schedulers are asked for: 0 to 64.
    pub gpus: u32,
}

pub(super) fn check(
    source: &SourceText<'_>,
    document: &Document,
    wall: &Wall,
) -> Result<Launch, WallFileError> {
    let section = document.launch.clone().unwrap_or_default();
    check_launch(source, &section)?;
    let mut servers: BTreeMap<String, ServerLaunch> = BTreeMap::new();
    for channel in &wall.channels {
        let server = servers.entry(channel.server.clone()).or_default();
        server.channels.push(channel.name.clone());
    }
    for (name, server) in &document.server {
        check_server(source, name, server)?;
        if !servers.contains_key(name) {
            let what = format!("no channel is drawn by a server {name:?}");
            let known: Vec<_> = servers.keys().take(8).map(String::as_str).collect();
            let remedy = format!("write one of the wall's servers, such as {}", known.join(", "));
            return Err(source.error(format!("server.{}", key_step(name)), what, remedy));
        }
    }
    for (name, server) in &mut servers {
        let own = document.server.get(name).cloned().unwrap_or_default();
        server.environment.clone_from(&section.environment);
        server.environment.extend(own.environment);
        let has_display = server.environment.get("DISPLAY").is_some_and(|it| !it.is_empty());
        let shown = has_display.then_some(LaunchOutput::Fullscreen);
        server.output = own.output.or(section.output).or(shown);
        server.host = own.host;
        server.gpu = own.gpu;
        server.arguments.clone_from(&section.server_arguments);
        server.arguments.extend(own.arguments);
        server.gpus = own.gpus;
    }
    Ok(Launch {
        manager_host: section.manager,
        address: section.address,
        wall: section.wall,
        program: section.program,
        keys: section.keys,
        is_insecure: section.insecure,
        manager_arguments: section.manager_arguments,
        environment: section.environment,
        ssh: section.ssh,
        servers,
    })
}

fn check_launch(source: &SourceText<'_>, section: &LaunchSection) -> Result<(), WallFileError> {
    if let Some(host) = &section.manager {
        check_host(source, "launch.manager", host)?;
    }
    if let Some(address) = &section.address {
        check_address(source, address)?;
    }
    for (key, path) in [("launch.wall", &section.wall), ("launch.keys", &section.keys)] {
        if let Some(path) = path.as_ref().filter(|path| !path.starts_with('/')) {
            let what = format!("{path:?} is no absolute path");
            return Err(source.error(key, what, "write a path that begins with \"/\""));
        }
    }
    let paths = [section.wall.as_ref(), section.keys.as_ref(), Some(&section.program)];
    for (key, path) in ["launch.wall", "launch.keys", "launch.program"].into_iter().zip(paths) {
        if let Some(path) = path {
            check_word(source, key, path)?;
        }
    }
    if section.program.starts_with('-') {
        let what = format!("{:?} is an option, not a program", section.program);
        return Err(source.error("launch.program", what, "write \"polyptych\", or its path"));
    }
    if section.program.contains('=') {
        let what =
            format!("{:?} has a \"=\", and env would take it for a variable", section.program);
        return Err(source.error("launch.program", what, "write \"polyptych\", or another path"));
    }
    if section.ssh.is_empty() {
        return Err(source.error("launch.ssh", "the command is empty", "write [\"ssh\"]"));
    }
    check_words(source, "launch.ssh", &section.ssh)?;
    check_words(source, "launch.manager_arguments", &section.manager_arguments)?;
    check_words(source, "launch.server_arguments", &section.server_arguments)?;
    check_environment(source, "launch.environment", &section.environment)
}

fn check_server(
    source: &SourceText<'_>,
    name: &str,
    server: &ServerSection,
) -> Result<(), WallFileError> {
    let key = |of: &str| format!("server.{}.{of}", key_step(name));
    if let Some(host) = &server.host {
        check_host(source, &key("host"), host)?;
    }
    if let Some(gpu) = &server.gpu {
        check_word(source, &key("gpu"), gpu)?;
    }
    check_words(source, &key("arguments"), &server.arguments)?;
    check_environment(source, &key("environment"), &server.environment)?;
    if server.gpus > GPUS_MAX {
        let what = format!("a server cannot have {} GPUs", server.gpus);
        return Err(source.error(key("gpus"), what, format!("write 0 to {GPUS_MAX}")));
    }
    Ok(())
}

/// Returns a name as a step of a key, in quotes if it has dots.
fn key_step(name: &str) -> String {
    if name.contains('.') { format!("{name:?}") } else { name.to_owned() }
}

/// Refuses what ssh would take for an option, and what is no name of a machine.
fn check_host(source: &SourceText<'_>, key: &str, host: &str) -> Result<(), WallFileError> {
    let letters = |c: char| c.is_ascii_alphanumeric() || "-_.:[]%".contains(c);
    let is_part =
        |part: &str| !part.is_empty() && !part.starts_with('-') && part.chars().all(letters);
    let parts: Vec<&str> = host.splitn(2, '@').collect();
    if host.len() <= HOST_BYTES_MAX && parts.into_iter().all(is_part) {
        return Ok(());
    }
    let shown: String = host.chars().take(80).collect();
    let what = format!("{shown:?} is no machine that ssh could reach");
    Err(source.error(key, what, "write HOST or USER@HOST, such as \"operator@render1\""))
}

fn check_address(source: &SourceText<'_>, address: &str) -> Result<(), WallFileError> {
    let split = address.rsplit_once(':');
    let is_host = |host: &str| {
        let plain = host.trim_start_matches('[').trim_end_matches(']');
        let letters = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | ':');
        let is_bracketed = host.starts_with('[') && host.ends_with(']');
        !plain.is_empty()
            && !plain.starts_with('-')
            && plain.chars().all(letters)
            && (is_bracketed || !host.contains([':', '[', ']']))
    };
    let is_port = |port: &str| port.parse::<u16>().is_ok_and(|port| port > 0);
    if split.is_some_and(|(host, port)| is_host(host) && is_port(port)) {
        return Ok(());
    }
    let what = format!("{address:?} is no address with a port");
    Err(source.error("launch.address", what, "write HOST:PORT, such as \"head.example:7878\""))
}

fn check_words(source: &SourceText<'_>, key: &str, words: &[String]) -> Result<(), WallFileError> {
    if words.len() > ARGUMENTS_MAX {
        let what = format!("there are {} words", words.len());
        return Err(source.error(key, what, format!("{ARGUMENTS_MAX} are possible")));
    }
    words
        .iter()
        .enumerate()
        .try_for_each(|(at, word)| check_word(source, &format!("{key}[{at}]"), word))
}

/// Refuses words that no command line, unit or shell could hold.
fn check_word(source: &SourceText<'_>, key: &str, word: &str) -> Result<(), WallFileError> {
    let what = if word.is_empty() {
        "the word is empty".to_owned()
    } else if word.len() > PATH_BYTES_MAX {
        format!("the word has {} bytes", word.len())
    } else if let Some(odd) = word.chars().find(|c| c.is_control()) {
        format!("the word has the control character {odd:?}")
    } else {
        return Ok(());
    };
    let remedy = format!("write 1 to {PATH_BYTES_MAX} bytes without line breaks");
    Err(source.error(key, what, remedy))
}

fn check_environment(
    source: &SourceText<'_>,
    key: &str,
    environment: &BTreeMap<String, String>,
) -> Result<(), WallFileError> {
    if environment.len() > ARGUMENTS_MAX {
        let what = format!("there are {} variables", environment.len());
        return Err(source.error(key, what, format!("{ARGUMENTS_MAX} are possible")));
    }
    for (name, value) in environment {
        let letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty()
            || name.starts_with(|c: char| c.is_ascii_digit())
            || !name.chars().all(letters)
        {
            let what = format!("{name:?} is no name of a variable");
            let remedy = "write letters, digits and \"_\", such as DISPLAY";
            return Err(source.error(key, what, remedy));
        }
        if !value.is_empty() {
            check_word(source, &format!("{key}.{name}"), value)?;
        }
    }
    Ok(())
}
