//! The state of each process of a wall: a pure function of what its supervisor and its manager
//! know.

use std::time::Instant;

use polyptych_client::{ChannelState, WallStatus};
use serde::Serialize;

use crate::supervisor::ChildState;

/// The beginning of the client's error if nothing listens at the manager's address.
const NO_MANAGER: &str = "no manager at ";

/// A process of a wall.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// `manager`, or the server's name.
    pub name: String,
    /// The machine, as a person reads it.
    pub machine: String,
    /// The channels of a server; `None` for the manager.
    pub channels: Option<Vec<String>>,
}

/// The state of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum NodeState {
    /// The machine is being reached.
    Starting,
    /// The process runs, and has not joined the wall.
    Running,
    /// The process has joined the wall and could draw, or is the manager and answers.
    Live,
    /// The process has ended, and is started again after a while.
    Waiting,
}

impl NodeState {
    pub fn word(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Live => "live",
            Self::Waiting => "waiting",
        }
    }
}

/// A process with its state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct NodeReport {
    pub name: String,
    pub machine: String,
    pub state: NodeState,
    /// The reason why it is not live.
    pub reason: Option<String>,
    /// The number of times that it was started again.
    pub restarts: u64,
    /// The process on this machine: that of ssh for one on another machine.
    pub pid: Option<u32>,
}

/// The manager's knowledge of the wall.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Known<'k> {
    /// The last answer of the manager.
    pub status: Option<&'k WallStatus>,
    /// The reason why there is no newer one.
    pub outage: Option<&'k str>,
}

/// Returns the reports of the processes, in their order. `children` has one entry for each.
pub(crate) fn reports(
    nodes: &[Node],
    children: &[ChildState],
    known: Known<'_>,
    now: Instant,
) -> Vec<NodeReport> {
    nodes.iter().zip(children).map(|(node, child)| report(node, child, known, now)).collect()
}

fn report(node: &Node, child: &ChildState, known: Known<'_>, now: Instant) -> NodeReport {
    let (state, reason) = if let Some(next) = child.next_start {
        (NodeState::Waiting, Some(end_of(child, next, now)))
    } else if child.begun.is_none() {
        (NodeState::Starting, None)
    } else {
        let trouble = match &node.channels {
            None => known.outage.map(|outage| trouble_of_manager(outage).to_owned()),
            Some(channels) => trouble_of(channels, known.status),
        };
        match (trouble, known.status) {
            (None, Some(_)) => (NodeState::Live, None),
            (trouble, _) => (NodeState::Running, trouble),
        }
    };
    NodeReport {
        name: node.name.clone(),
        machine: node.machine.clone(),
        state,
        reason,
        restarts: child.restarts,
        pid: child.pid,
    }
}

/// Returns the end of a process in words, with its own last words, or those of ssh.
fn end_of(child: &ChildState, next: Instant, now: Instant) -> String {
    let mut text = child.last_end.clone().unwrap_or_default();
    for line in &child.last_lines {
        text.push_str(": ");
        text.push_str(line);
    }
    let wait = next.saturating_duration_since(now).as_secs_f64();
    let text = polyptych_text::printable(&text).into_owned();
    format!("{text}; starts again in {wait:.1} s")
}

/// Returns the reason why a manager that runs does not answer. Nothing listens at its address until
/// it has read its wall, and the client's advice would be to start another one.
fn trouble_of_manager(outage: &str) -> &str {
    if outage.contains(NO_MANAGER) { "it starts, and does not listen yet" } else { outage }
}

/// Returns the reason why a server's channels could not draw; `None` if all could.
fn trouble_of(channels: &[String], status: Option<&WallStatus>) -> Option<String> {
    let status = status?;
    channels.iter().find_map(|name| {
        let Some(channel) = status.channels.iter().find(|channel| channel.name == *name) else {
            return Some(format!("the running manager's wall has no channel {name}"));
        };
        let reason = || channel.reason.clone().unwrap_or_default();
        match channel.state {
            ChannelState::Ready | ChannelState::Live | ChannelState::Late => None,
            ChannelState::Lost => Some(reason())
                .filter(|reason| !reason.is_empty())
                .or_else(|| Some("it has not joined yet".to_owned())),
            ChannelState::Joining | ChannelState::Preparing => Some("it gets ready".to_owned()),
        }
    })
}

/// Processes whose reports changed in more than the time that is left of a wait.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    last: Vec<(NodeState, u64, Option<String>)>,
}

impl Changes {
    /// Returns the reports that differ from those of the last call.
    pub fn of<'r>(&mut self, reports: &'r [NodeReport]) -> Vec<&'r NodeReport> {
        let key = |report: &NodeReport| {
            // The wait is a part of the reason of one that waits; a new end is another restart.
            let reason = report.reason.clone().filter(|_| report.state != NodeState::Waiting);
            (report.state, report.restarts, reason)
        };
        let keys: Vec<_> = reports.iter().map(key).collect();
        let is_new = |at: usize| self.last.get(at) != Some(&keys[at]);
        let changed = (0..reports.len()).filter(|at| is_new(*at)).map(|at| &reports[at]).collect();
        self.last = keys;
        changed
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn node(channels: Option<&[&str]>) -> Node {
        let owned = |list: &[&str]| list.iter().map(|name| (*name).to_owned()).collect();
        Node { name: "n".into(), machine: "here".into(), channels: channels.map(owned) }
    }

    #[test]
    fn a_process_goes_from_starting_to_running_and_waits_with_its_last_words() {
        let now = Instant::now();
        let mut child = ChildState { name: "n".into(), ..ChildState::default() };
        let state = |child: &ChildState| {
            let known = Known { status: None, outage: Some("another token") };
            let report = report(&node(None), child, known, now);
            (report.state, report.reason)
        };
        assert_eq!(state(&child), (NodeState::Starting, None));
        child.begun = Some(now);
        assert_eq!(state(&child), (NodeState::Running, Some("another token".into())));
        child.begun = None;
        child.last_end = Some("exit status: 255".into());
        child.last_lines.push_back("ssh: no\u{1b}[1m route".into());
        child.next_start = Some(now + Duration::from_millis(1500));
        let expected = "exit status: 255: ssh: no\\u{1b}[1m route; starts again in 1.5 s";
        assert_eq!(state(&child), (NodeState::Waiting, Some(expected.into())));
    }

    #[test]
    fn a_manager_that_does_not_listen_yet_is_said_to_start() {
        let source = std::io::ErrorKind::ConnectionRefused.into();
        let address = "127.0.0.1:7878".to_owned();
        let refused = polyptych_client::ClientError::NoManager { address, source }.to_string();
        assert_eq!(trouble_of_manager(&refused), "it starts, and does not listen yet");
        assert_eq!(trouble_of_manager("another token"), "another token");
    }

    #[test]
    fn a_wait_that_shrinks_is_no_change_and_a_new_end_is_one() {
        let report = |state, restarts, reason: &str| NodeReport {
            name: "n".into(),
            machine: "here".into(),
            state,
            reason: Some(reason.into()),
            restarts,
            pid: None,
        };
        let mut changes = Changes::default();
        for (state, restarts, reason, is_change) in [
            (NodeState::Running, 0, "a", true),
            (NodeState::Running, 0, "a", false),
            (NodeState::Running, 0, "b", true),
            (NodeState::Waiting, 1, "2 s", true),
            (NodeState::Waiting, 1, "1 s", false),
            (NodeState::Waiting, 2, "4 s", true),
        ] {
            let reports = [report(state, restarts, reason)];
            assert_eq!(!changes.of(&reports).is_empty(), is_change, "{state:?} {reason}");
        }
    }
}
