//! Children of a shell, which are always there.

use std::sync::mpsc::{Receiver, sync_channel};

use super::*;

/// Maximum wait for a child, on a machine that builds something meanwhile.
const LIMIT: Duration = Duration::from_mins(1);

const POLICY: RestartPolicy = RestartPolicy {
    first: Duration::from_millis(1),
    longest: Duration::from_millis(1),
    steady: Duration::ZERO,
};

fn child(name: &str, script: &str) -> ChildCommand {
    ChildCommand {
        name: name.to_owned(),
        program: "/bin/sh".into(),
        arguments: ["-c", script].map(Into::into).to_vec(),
        environment: Vec::new(),
        gate: None,
        reports_errors: true,
        signs_of_life: None,
    }
}

/// A supervisor, and the lines of its children as `NAME>TEXT`, or `NAME!TEXT` for errors.
fn start(commands: Vec<ChildCommand>) -> (Supervisor, Receiver<String>) {
    let (lines, said) = sync_channel(64);
    let on_line: OnLine = Arc::new(move |line| {
        let mark = if line.is_error { '!' } else { '>' };
        // A full queue is a test that has seen enough.
        let _ = lines.try_send(format!("{}{mark}{}", line.child, line.text));
    });
    (Supervisor::start(commands, POLICY, on_line).expect("started"), said)
}

#[test]
fn a_child_that_ends_is_started_again_and_its_last_lines_are_kept() {
    let script = "echo up; echo one >&2; echo two >&2; echo three >&2; echo four >&2; exit 3";
    let (supervisor, said) = start(vec![child("a", script)]);
    let mut lines = Vec::new();
    while lines.iter().filter(|line: &&String| *line == "a>up").count() < 3 {
        lines.push(said.recv_timeout(LIMIT).expect("a line"));
    }
    assert!(lines.contains(&"a!four".to_owned()), "{lines:?}");
    let state = supervisor.states().remove(0);
    assert!(state.restarts >= 2, "{state:?}");
    assert_eq!(state.last_end.as_deref(), Some("exit status: 3"));
}

#[test]
fn children_behind_a_gate_start_one_after_the_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let lock = folder.path().join("lock").display().to_string();
    let gate = Arc::new(Semaphore::new(1));
    let commands = ["a", "b", "c"].map(|name| {
        // A start that meets another one fails; then it runs until its input ends.
        let script = format!("mkdir {lock} || exit 9; rmdir {lock}; echo begun; read -r _");
        ChildCommand { gate: Some(Arc::clone(&gate)), ..child(name, &script) }
    });
    let (supervisor, said) = start(commands.into());
    for _ in 0..3 {
        let line = said.recv_timeout(LIMIT).expect("a line");
        assert!(line.ends_with(">begun"), "{line}");
    }
    for state in supervisor.states() {
        let runs = state.pid.is_some() && state.begun.is_some();
        assert!(runs && state.restarts == 0, "{state:?}");
    }
}

#[test]
fn a_gate_opens_although_children_of_an_ended_child_hold_its_output() {
    let gate = Some(Arc::new(Semaphore::new(1)));
    let (supervisor, _said) = start(vec![ChildCommand { gate, ..child("a", "sleep 20 & exit 3") }]);
    let deadline = Instant::now() + Duration::from_secs(15);
    while supervisor.states()[0].restarts < 2 {
        assert!(Instant::now() < deadline, "{:?}", supervisor.states());
        std::thread::yield_now();
    }
}

#[test]
fn a_child_elsewhere_is_sent_signs_of_life() {
    let signs_of_life = Some(Duration::from_millis(1));
    let script = "read -r _ && read -r _ && echo alive && exec cat";
    let (_supervisor, said) = start(vec![ChildCommand { signs_of_life, ..child("a", script) }]);
    assert_eq!(said.recv_timeout(LIMIT).expect("a line"), "a>alive");
}

#[test]
fn a_line_without_end_is_cut_and_what_cannot_start_is_told() {
    let script = "head -c 20000 /dev/zero | tr '\\0' x; echo; echo short; read -r _";
    let missing = ChildCommand { program: "/no/such/program".into(), ..child("m", "") };
    let (supervisor, said) = start(vec![child("a", script), missing]);
    let line = said.recv_timeout(LIMIT).expect("a line");
    assert_eq!(line.len() as u64, LINE_BYTES_MAX + 2);
    assert_eq!(said.recv_timeout(LIMIT).expect("a line"), "a>short");
    let deadline = Instant::now() + LIMIT;
    let end = loop {
        assert!(Instant::now() < deadline, "nothing is told");
        match supervisor.states().swap_remove(1).last_end {
            Some(end) => break end,
            None => std::thread::yield_now(),
        }
    };
    assert!(end.contains("could not be started: No such file"), "{end}");
}
