//! `polyptych simulate`, looked at from outside while it runs.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::Path;

use polyptych_client::blocking::Client;
use polyptych_client::{ConnectOptions, Wall};
use polyptych_protocol::token::TOKEN_FILE_VARIABLE;
use rustix::process::Signal;

use super::place::TestDir;
use super::process::Process;
use super::{signals, wait};

/// A wall on one machine, as the command starts it.
#[derive(Debug)]
pub struct Simulation {
    pub place: TestDir,
    pub process: Process,
}

impl Simulation {
    /// Starts it; pictures go to `out` in its place.
    pub fn start(place: TestDir, wall: &Wall, scene: &Path, arguments: &[&str]) -> Self {
        Self::start_with(place, wall, scene, arguments, &[])
    }

    /// Starts it as [`Self::start`] does, with more variables in its environment.
    pub fn start_with(
        place: TestDir,
        wall: &Wall,
        scene: &Path,
        arguments: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        let wall = place.write("wall.toml", polyptych_wall_file::to_toml(wall));
        let mut all: Vec<OsString> = vec!["simulate".into(), wall.into(), scene.into()];
        all.extend(arguments.iter().map(OsString::from));
        all.extend(["--out".into(), place.path("out").into()]);
        let mut command = place.command(all);
        command.envs(environment.iter().copied());
        // As a shell starts it: what is typed at a terminal reaches a whole group of processes.
        let process = Process::start("simulate", command.process_group(0));
        Self { place, process }
    }

    /// The processes that it has started and that are still there, by their first argument.
    pub fn children(&self, command: &str) -> Vec<u32> {
        let all = signals::processes_of(self.place.folder());
        let is_one = |pid: &u32| signals::arguments_of(*pid).get(1).is_some_and(|c| c == command);
        all.into_iter().filter(is_one).collect()
    }

    /// A second client of its manager, beside the one that draws.
    pub fn client(&self) -> Client {
        let (address, token_file) = wait::until("a server that names its manager", || {
            let server = *self.children("server").first()?;
            let arguments = signals::arguments_of(server);
            let at = arguments.iter().position(|argument| argument == "--manager")?;
            let token_file = signals::variable_of(server, TOKEN_FILE_VARIABLE)?;
            Some((arguments.get(at + 1)?.clone(), token_file))
        });
        let mut options = ConnectOptions::new(address);
        options.token_file = Some(token_file.into());
        Client::connect_with(options).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Ends it with SIGINT for all its processes, as Ctrl-C does, or another signal for itself
    /// only, as a service manager does. Nothing may be left behind.
    #[track_caller]
    pub fn interrupt(&mut self, signal: Signal, when: &str) {
        match signal {
            Signal::INT => signals::send_to_group(self.process.pid(), signal),
            _ => self.process.signal(signal),
        }
        // A run that has drawn writes its pictures first, which is not quick on a busy machine.
        let finished = self.process.finish(wait::LIMIT);
        // Before the program listens for signals, the system ends it in its own way.
        let is_ended = finished.code() == 130 || finished.code() == 128 + signal.as_raw();
        assert!(is_ended, "{signal:?} {when}: {}: {}", finished.code(), finished.output);
        self.await_no_orphans(when);
    }

    /// Waits until nothing that it has started is left.
    #[track_caller]
    pub fn await_no_orphans(&self, when: &str) {
        let left = || signals::processes_of(self.place.folder());
        let gone = wait::look_for(wait::SOON, || left().is_empty().then_some(()));
        let describe = |pid: &u32| signals::arguments_of(*pid).join(" ");
        assert!(gone.is_some(), "{when}: {:?}", left().iter().map(describe).collect::<Vec<_>>());
    }
}

impl Drop for Simulation {
    fn drop(&mut self) {
        self.process.kill();
        // Where a test has found orphans, they end with it.
        for pid in signals::processes_of(self.place.folder()) {
            signals::send(pid, Signal::KILL);
        }
    }
}
