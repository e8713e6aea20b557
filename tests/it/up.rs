//! All processes of a wall are started on their machines, kept, and ended: by `up`, through an
//! ssh of the test's own and, where it is installed, through sshd.

use std::fs::{self, Permissions};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions};
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, patient, tiled};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::{signals, wait};

/// An ssh that runs its command here, but for the machine `gone`.
const SSH: &str = r#"#!/bin/sh
while [ "$1" != -- ]; do host=$1; shift; done
if [ "$host" = gone ]; then
    echo "ssh: Could not resolve hostname gone: Name or service not known" >&2
    exit 255
fi
exec sh -c "$2"
"#;

/// A port that is free now: a wall file names one, as servers must be told of it.
pub fn free_port() -> u16 {
    let listener = TcpListener::bind(ANY_PORT).expect("a port");
    listener.local_addr().expect("an address").port()
}

pub fn script(place: &TestDir, name: &str, text: &str) -> PathBuf {
    let path = place.write(name, text);
    fs::set_permissions(&path, Permissions::from_mode(0o700)).expect("made executable");
    path
}

/// A wall of small tiles whose file has these lines at its end, and the manager's address.
pub fn wall_with(place: &TestDir, columns: u32, lines: &str) -> String {
    let mut wall = patient(tiled([columns, 1], [columns * 96, 54]));
    wall.heartbeat_ms = 2_000;
    wall.listen = format!("127.0.0.2:{}", free_port());
    let text = polyptych_wall_file::to_toml(&wall);
    place.write("wall.toml", format!("{text}\n{lines}"));
    wall.listen
}

fn program() -> &'static str {
    env!("CARGO_BIN_EXE_polyptych")
}

fn client(place: &TestDir, address: &str) -> Client {
    let mut options = ConnectOptions::new(address);
    options.token_file = Some(place.token_file());
    wait::until("the manager", || Client::connect_with(options.clone()).ok())
}

/// The process of the server that draws a channel, as the manager knows it.
fn server_pid(client: &Client, channel: usize) -> Option<u32> {
    let status = client.status().unwrap_or_else(|error| panic!("{error}"));
    let channel = &status.channels[channel];
    let is_there = matches!(channel.state, ChannelState::Ready | ChannelState::Live);
    channel.pid.filter(|_| is_there)
}

fn is_running(pid: u32) -> bool {
    // A process that has ended and whose parent has not looked is a zombie.
    let state = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    state.rsplit(')').next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with(" Z"))
}

#[track_caller]
fn await_end(pids: &[u32]) {
    wait::until("all processes ended", || pids.iter().all(|pid| !is_running(*pid)).then_some(()));
}

#[test]
fn a_wall_on_three_machines_is_kept_and_ends_with_the_command() {
    let place = TestDir::new();
    let ssh = script(&place, "ssh", SSH);
    let address = wall_with(
        &place,
        3,
        &format!(
            "[launch]\nssh = [{ssh:?}, \"-v\"]\nprogram = {:?}\noutput = \"headless\"\n\
             environment = {{ POLYPTYCH_TEST = \"it's $HOME\" }}\naddress = \"{{}}\"\n\
             [server.front-2-1]\nhost = \"me@render1\"\n[server.front-3-1]\nhost = \"gone\"\n",
            program()
        ),
    );
    let text = fs::read_to_string(place.path("wall.toml")).expect("a file");
    place.write("wall.toml", text.replace("\"{}\"", &format!("{address:?}")));
    let mut up = place.start("up", ["up", "wall.toml"]);
    up.await_line(&["manager", "here", "live"]);
    up.await_line(&["front-1-1", "here", "live"]);
    up.await_line(&["front-2-1", "render1", "live"]);
    let gone = "exit status: 255: ssh: Could not resolve hostname gone";
    up.await_line(&["front-3-1", "gone", "waiting", gone, "starts again in"]);
    let client = client(&place, &address);
    let pid = server_pid(&client, 1).expect("it is there");
    let environment = fs::read(format!("/proc/{pid}/environ")).expect("its environment");
    let environment = String::from_utf8_lossy(&environment).into_owned();
    assert!(environment.contains("POLYPTYCH_TEST=it's $HOME\0"), "{environment}");
    signals::send(pid, Signal::KILL);
    let again = wait::until("a new process", || server_pid(&client, 1).filter(|it| *it != pid));
    up.await_line(&["front-2-1", "render1", "waiting", "signal: 9"]);
    let pids = [server_pid(&client, 0).expect("it is there"), again];
    up.signal(Signal::TERM);
    let ended = up.finish(wait::SOON).succeeded();
    assert!(ended.contains("all processes have ended"), "{ended}");
    assert!(pids.iter().all(|pid| !is_running(*pid)), "{ended}");
}

/// A wall of 256 servers has a thousand pipes and sockets, which the usual limit does not allow.
#[test]
fn all_processes_may_open_as_many_files_as_the_system_allows() {
    let place = TestDir::new();
    let address = wall_with(&place, 1, "[launch]\noutput = \"headless\"\n");
    let command = place.command([""; 0]);
    let mut shell = Command::new("sh");
    shell.arg("-c").arg("ulimit -Sn 256 && exec \"$0\" up wall.toml").arg(command.get_program());
    shell.current_dir(place.folder());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    let mut up = Process::start("up", &mut shell);
    up.await_line(&["the manager and 1 server are live"]);
    let server = server_pid(&client(&place, &address), 0).expect("it is there");
    let is_manager =
        |pid: &u32| signals::arguments_of(*pid).get(1).is_some_and(|word| word == "manager");
    let manager = signals::processes_of(place.folder()).into_iter().find(is_manager);
    for pid in [up.pid(), manager.expect("a manager"), server] {
        let limits = fs::read_to_string(format!("/proc/{pid}/limits")).expect("it runs");
        let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"));
        let words: Vec<&str> = line.expect("a limit").split_whitespace().collect();
        assert!(words[0] == words[1] && words[0] != "256", "{pid}: {words:?}");
    }
    up.signal(Signal::TERM);
    up.finish(wait::SOON).succeeded();
}

#[test]
fn no_process_outlives_a_killed_command_and_a_stopped_wall_ends_it() {
    let place = TestDir::new();
    let ssh = script(&place, "ssh", SSH);
    let launch = format!(
        "[launch]\nssh = [{ssh:?}]\nprogram = {:?}\nmanager = \"localhost\"\n\
         [server.front]\nhost = \"localhost\"\n",
        program()
    );
    let address = wall_with(&place, 1, &launch);
    let mut up = place.start("up", ["up", "wall.toml", "--json"]);
    let line = up.await_line(&["\"event\":\"live\""]);
    let line: Value = serde_json::from_str(&line).expect("JSON");
    assert!(line["seconds"].is_f64(), "{line}");
    let client = client(&place, &address);
    let pid = server_pid(&client, 0).expect("it is there");
    // A second one would give its servers to the first one's manager, were it not refused: there
    // the manager is on this machine.
    let here = fs::read_to_string(place.path("wall.toml")).expect("a file");
    place.write("second.toml", here.replace("manager = \"localhost\"\n", ""));
    place.run(["up", "second.toml"]).failed(&[&address, "is in use"]);
    up.kill();
    await_end(&[pid]);
    let mut up = place.start("up", ["up", "wall.toml"]);
    up.await_line(&["the manager and 1 server are live"]);
    place.run(["stop", "--servers", "--manager", &address]).succeeded();
    let said = up.finish(wait::SOON).succeeded();
    assert!(said.contains("a client stopped the wall"), "{said}");
}

#[test]
fn what_cannot_be_started_is_refused_before_anything_is() {
    let place = TestDir::new();
    let elsewhere = "[server.front]\nhost = \"render1\"\n";
    for (lines, parts) in [
        (elsewhere, ["launch.address", "server front runs on render1"]),
        ("[server.other]\nhost = \"x\"\n", ["server.other", "no channel is drawn"]),
        ("[launch]\nserver_arguments = [\"--monitr\"]\n", ["server_arguments", "--monitr"]),
        ("[launch]\nssh = []\n", ["launch.ssh", "the command is empty"]),
    ] {
        wall_with(&place, 1, lines);
        let said = place.run(["up", "wall.toml"]).failed(&parts);
        assert!(said.contains("wall.toml"), "{said}");
    }
}

/// An sshd of this user for a test, and an ssh that reaches it.
fn start_sshd(place: &TestDir) -> (Process, String) {
    let folder = place.folder();
    for key in ["host", "user"] {
        let made = Command::new("ssh-keygen")
            .args(["-q", "-t", "ed25519", "-N", "", "-f"])
            .arg(folder.join(key))
            .status();
        assert!(made.expect("ssh-keygen").success());
    }
    fs::copy(folder.join("user.pub"), folder.join("authorized")).expect("copied");
    let port = free_port();
    let folder = folder.display();
    let config = place.write(
        "sshd_config",
        format!(
            "Port {port}\nListenAddress 127.0.0.2\nHostKey {folder}/host\n\
             AuthorizedKeysFile {folder}/authorized\nStrictModes no\nUsePAM no\n\
             PidFile none\nAcceptEnv *\n"
        ),
    );
    // sshd of root wants this folder, which its service makes elsewhere.
    let _ = fs::create_dir("/run/sshd");
    let found = std::env::var_os("PATH").unwrap_or_default();
    let sshd = std::env::split_paths(&found).chain([PathBuf::from("/usr/sbin")]);
    let sshd = sshd.map(|folder| folder.join("sshd")).find(|path| path.is_file());
    let mut command = Command::new(sshd.expect("the build has found it"));
    command.args([Path::new("-D"), Path::new("-e"), Path::new("-f"), &config]);
    let mut process = Process::start("sshd", &mut command);
    process.await_line(&["Server listening on 127.0.0.2"]);
    let ssh = format!(
        "[\"ssh\", \"-F\", \"none\", \"-p\", \"{port}\", \"-i\", \"{folder}/user\", \"-o\", \
         \"StrictHostKeyChecking=no\", \"-o\", \"UserKnownHostsFile=/dev/null\", \"-o\", \
         \"LogLevel=ERROR\"]"
    );
    (process, ssh)
}

#[test]
#[cfg_attr(not(has_sshd), ignore = "no sshd, ssh or ssh-keygen")]
fn sshd_starts_ends_and_brings_back_servers() {
    let place = TestDir::new();
    let (mut sshd, ssh) = start_sshd(&place);
    let environment: String = ["XDG_CACHE_HOME", "XDG_STATE_HOME", "POLYPTYCH_TOKEN_FILE"]
        .into_iter()
        .filter_map(|name| {
            let command = place.command(["x"]);
            let mut set = command.get_envs().filter(|(key, _)| *key == name);
            let (_, value) = set.next()?;
            Some(format!("{name} = {:?}, ", value?.to_str()?))
        })
        .collect();
    let lines = format!(
        "[launch]\nssh = {ssh}\nprogram = {:?}\nenvironment = {{ {} }}\n\
         [server.front-1-1]\nhost = \"127.0.0.2\"\n[server.front-2-1]\nhost = \"127.0.0.2\"\n",
        program(),
        environment.trim_end_matches(", ")
    );
    let address = wall_with(&place, 2, &lines);
    let mut up = place.start("up", ["up", "wall.toml"]);
    up.await_line(&["the manager and 2 servers are live"]);
    let client = client(&place, &address);
    let pids = [0, 1].map(|channel| server_pid(&client, channel).expect("it is there"));
    up.kill();
    await_end(&pids);
    let mut up = place.start("up", ["up", "wall.toml"]);
    up.await_line(&["the manager and 2 servers are live"]);
    let pids = [0, 1].map(|channel| server_pid(&self::client(&place, &address), channel));
    let pids = pids.map(|pid| pid.expect("it is there"));
    // One that stands still ends with its connection; and no further login is needed for that.
    signals::send(pids[0], Signal::STOP);
    sshd.kill();
    up.signal(Signal::INT);
    up.finish(wait::SOON).succeeded();
    await_end(&pids);
    let mut options = ConnectOptions::new(address.as_str());
    options.token_file = Some(place.token_file());
    assert!(Client::connect_with(options).is_err(), "the manager has ended too");
}
