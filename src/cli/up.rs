//! `polyptych up`: starts the processes of a wall on their machines, and ends them.

mod commands;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use polyptych_protocol::token;
use polyptych_text::counted;
use serde_json::json;

use super::manager::{self, WALL_STOPPED};
use super::shutdown_signal::watch_shutdown_signals;
use super::watch::status_poller::StatusPoller;
use super::{ManagerAddress, say};
use crate::launch::plan::{LaunchPlan, machine_of};
use crate::launch::roster::{Changes, Known, Node, NodeReport, NodeState, reports};
use crate::logging;
use crate::simulator::local_wall::INTERRUPTED;
use crate::supervisor::{ChildLine, OnLine, RestartPolicy, Supervisor};

/// Time between two looks at all processes: a person sees a change at once.
const LOOK_PERIOD: Duration = Duration::from_millis(100);

/// Waits before restarts: a process that ends is back within two seconds, of which a login takes up
/// to one, and a host that is off is tried twice a minute.
const RESTARTS: RestartPolicy = RestartPolicy {
    first: Duration::from_millis(100),
    longest: Duration::from_secs(30),
    steady: Duration::from_secs(5),
};

/// Maximum number of reasons to end that wait to be heard: the first one counts.
const ENDS_MAX: usize = 4;

/// The manager and the servers of the wall run on the machines that [launch] and [server.NAME] of
/// the wall file name, or here. A process that ends is started again, after waits that grow while
/// it fails. Ctrl-C, SIGTERM, and the end of this command in any other way end them all.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// Print each change as a line of JSON
    #[arg(long)]
    json: bool,
    /// The file with the manager's token [default: where the manager of this user puts it]
    #[arg(long, value_name = "FILE", env = token::TOKEN_FILE_VARIABLE)]
    token_file: Option<PathBuf>,
    /// A client's folder of keys, with which this command asks how the wall stands [default:
    /// client-operator in the folder that keys of [launch] names, if it is here]
    #[arg(long, value_name = "FOLDER", env = polyptych_client::KEYS_VARIABLE)]
    keys: Option<PathBuf>,
}

/// The reason for the end of this command.
#[derive(Clone, Copy, Debug)]
enum End {
    /// Ctrl-C, or SIGTERM.
    Asked,
    /// A client stopped the wall.
    WallStopped,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let plan = LaunchPlan::load(&arguments.wall)?;
    let address = plan.manager_address()?;
    if plan.launch.manager_host.is_none() {
        // A manager that runs there already would take these servers for its own.
        drop(manager::bind(&plan.wall.listen, plan.may_leave_machine())?);
    }
    let nodes = nodes(&plan);
    let commands = commands::commands(&plan, &address)?;
    let (ends, ended) = sync_channel(ENDS_MAX);
    end_on_signals(ends.clone())?;
    let began = Instant::now();
    let poller = StatusPoller::start(&client_address(arguments, &plan, &address))?;
    if !arguments.json {
        let servers = counted(nodes.len() - 1, "server");
        let machines = counted(plan.machines().len(), "machine");
        let wall = &plan.wall.name;
        say(format_args!("{wall}: the manager and {servers} on {machines}; Ctrl-C ends them"))?;
    }
    let supervisor = Supervisor::start(commands, RESTARTS, on_line(ends))?;
    let mut show = Show { is_json: arguments.json, began, ..Show::default() };
    let end = loop {
        match next_end(&ended) {
            Some(end) => break end,
            None => show.changes(&nodes, &supervisor, &poller)?,
        }
    };
    let why = match end {
        End::Asked => "ending all processes",
        End::WallStopped => "a client stopped the wall; ending all processes",
    };
    show.event("ending", why)?;
    drop(supervisor);
    show.event("ended", "all processes have ended")
}

fn next_end(ended: &Receiver<End>) -> Option<End> {
    match ended.recv_timeout(LOOK_PERIOD) {
        Ok(end) => Some(end),
        Err(RecvTimeoutError::Timeout) => None,
        // The threads that hold the other side end with the process.
        Err(RecvTimeoutError::Disconnected) => Some(End::Asked),
    }
}

/// Returns the processes, in the order of their commands.
fn nodes(plan: &LaunchPlan) -> Vec<Node> {
    let machine = |host: Option<&str>| machine_of(host).or(host).unwrap_or("here").to_owned();
    let manager = Node {
        name: commands::MANAGER.to_owned(),
        machine: machine(plan.launch.manager_host.as_deref()),
        channels: None,
    };
    let servers = plan.launch.servers.iter().map(|(name, server)| Node {
        name: name.clone(),
        machine: machine(server.host.as_deref()),
        channels: Some(server.channels.clone()),
    });
    std::iter::once(manager).chain(servers).collect()
}

/// The manager's address and the keys for asking how the wall stands.
fn client_address(arguments: &Arguments, plan: &LaunchPlan, address: &str) -> ManagerAddress {
    let beside = plan.launch.keys.as_ref();
    let beside = beside.map(|keys| PathBuf::from(keys).join("client-operator"));
    ManagerAddress {
        manager: address.to_owned(),
        token_file: arguments.token_file.clone(),
        keys: arguments.keys.clone().or(beside.filter(|folder| folder.is_dir())),
        insecure: plan.launch.is_insecure,
    }
}

/// Returns the callback for lines of processes: it passes errors on, and hears the manager end.
fn on_line(ends: SyncSender<End>) -> OnLine {
    Arc::new(move |line: ChildLine<'_>| {
        if line.is_error {
            logging::pass_on(line.child, &polyptych_text::printable(line.text));
        } else if line.child == commands::MANAGER && line.text == WALL_STOPPED {
            // A full queue is an end that is heard already.
            let _ = ends.try_send(End::WallStopped);
        }
    })
}

/// Ends the command in order at the first signal, and at once at the second.
fn end_on_signals(ends: SyncSender<End>) -> anyhow::Result<()> {
    let mut is_second = false;
    let on_request = move || {
        if !std::mem::replace(&mut is_second, true) {
            // A full queue is an end that is heard already.
            let _ = ends.try_send(End::Asked);
            return;
        }
        logging::say_failure("up", "interrupted again: ending at once");
        logging::finish();
        // Processes end when their standard input does.
        std::process::exit(i32::from(INTERRUPTED));
    };
    Ok(watch_shutdown_signals(None, on_request)?)
}

/// The printed state of the wall.
#[derive(Debug)]
struct Show {
    is_json: bool,
    began: Instant,
    changes: Changes,
    /// `true` if all processes were live at the last look.
    is_whole: bool,
}

impl Default for Show {
    fn default() -> Self {
        let changes = Changes::default();
        Self { is_json: false, began: Instant::now(), changes, is_whole: false }
    }
}

impl Show {
    fn changes(
        &mut self,
        nodes: &[Node],
        supervisor: &Supervisor,
        poller: &StatusPoller,
    ) -> anyhow::Result<()> {
        let (status, outage) = poller.known();
        let known = Known { status: status.as_ref(), outage: outage.as_deref() };
        let reports = reports(nodes, &supervisor.states(), known, Instant::now());
        for report in self.changes.of(&reports) {
            self.line(report, nodes)?;
        }
        let is_whole = reports.iter().all(|report| report.state == NodeState::Live);
        if is_whole && !self.is_whole {
            let count = counted(nodes.len() - 1, "server");
            self.event("live", &format!("the manager and {count} are live"))?;
        }
        self.is_whole = is_whole;
        Ok(())
    }

    fn line(&self, report: &NodeReport, nodes: &[Node]) -> anyhow::Result<()> {
        let seconds = self.began.elapsed().as_secs_f64();
        if self.is_json {
            let mut line = serde_json::to_value(report)?;
            line["seconds"] = json!(seconds);
            return say(line);
        }
        let width = |text: fn(&Node) -> &str| nodes.iter().map(|node| text(node).len()).max();
        let name = width(|node| &node.name).unwrap_or_default();
        let machine = width(|node| &node.machine).unwrap_or_default();
        let reason = report.reason.as_ref().map_or_else(String::new, |it| format!(": {it}"));
        let state = report.state.word();
        say(format_args!(
            "{seconds:7.1} s  {:name$}  {:machine$}  {state}{reason}",
            report.name, report.machine
        ))
    }

    fn event(&self, name: &str, text: &str) -> anyhow::Result<()> {
        let seconds = self.began.elapsed().as_secs_f64();
        if self.is_json {
            return say(json!({ "event": name, "seconds": seconds }));
        }
        say(format_args!("{seconds:7.1} s  {text}"))
    }
}
