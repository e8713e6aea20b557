//! The commands that `polyptych up` starts: this program, or ssh, which runs it elsewhere.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use polyptych_wall_file::LaunchOutput;
use tokio::sync::Semaphore;

use crate::launch::plan::LaunchPlan;
use crate::launch::shell;
use crate::logging;
use crate::supervisor::ChildCommand;

/// The manager's name among the processes. A server may have it too: only the manager says that
/// the wall was stopped.
pub(super) const MANAGER: &str = "manager";

/// Maximum number of connections to one machine that log in at a time: sshd turns away some of more
/// than ten.
const LOGINS_MAX: usize = 6;

/// Options of ssh, behind those of the wall file, which come first and so win: no question that
/// nobody answers, and an end for a machine that is off or gone.
const SSH_OPTIONS: &[&str] = &[
    "-T",
    "-o",
    "BatchMode=yes",
    "-o",
    "ConnectTimeout=5",
    "-o",
    "ServerAliveInterval=5",
    "-o",
    "ServerAliveCountMax=3",
];

/// Time between two signs of life to a process on another machine, which ends when none has come
/// for four times as long. ssh sees to its own side only: there it ends after 15 s.
const SIGNS_PERIOD: Duration = Duration::from_secs(5);

/// The command by which the other machine says that the login is done.
const LOGGED_IN: &str = "echo logged in";

/// Returns the commands of the manager and of all servers by name.
pub(super) fn commands(plan: &LaunchPlan, address: &str) -> anyhow::Result<Vec<ChildCommand>> {
    let mut gates: BTreeMap<&str, Arc<Semaphore>> = BTreeMap::new();
    let launch = &plan.launch;
    let mut list = vec![command(
        plan,
        MANAGER,
        launch.manager_host.as_deref(),
        plan.manager_there(),
        &launch.environment,
        &mut gates,
    )?];
    for (name, server) in &launch.servers {
        let arguments = plan.server_there(name, address, LaunchOutput::Headless);
        let host = server.host.as_deref();
        list.push(command(plan, name, host, arguments, &server.environment, &mut gates)?);
    }
    Ok(list)
}

fn command<'p>(
    plan: &'p LaunchPlan,
    name: &str,
    host: Option<&'p str>,
    mut arguments: Vec<String>,
    environment: &BTreeMap<String, String>,
    gates: &mut BTreeMap<&'p str, Arc<Semaphore>>,
) -> anyhow::Result<ChildCommand> {
    arguments.push("--with-parent".to_owned());
    if !arguments.iter().any(|word| word == "--log" || word.starts_with("--log=")) {
        arguments.extend(["--log".to_owned(), logging::of_children()]);
    }
    let Some(host) = host else {
        let program = std::env::current_exe().context("this program's own file is not known")?;
        let variable = |(name, value): (&String, &String)| (name.into(), value.into());
        return Ok(ChildCommand {
            name: name.to_owned(),
            program,
            arguments: arguments.into_iter().map(OsString::from).collect(),
            environment: environment.iter().map(variable).collect(),
            gate: None,
            reports_errors: true,
            signs_of_life: None,
        });
    };
    let remote = remote_line(&plan.launch.program, &arguments, environment);
    let gate = gates.entry(host).or_insert_with(|| Arc::new(Semaphore::new(LOGINS_MAX)));
    let (program, own) = plan.launch.ssh.split_first().context("launch.ssh is empty")?;
    let options = own.iter().map(String::as_str).chain(SSH_OPTIONS.iter().copied());
    Ok(ChildCommand {
        name: name.to_owned(),
        program: program.into(),
        arguments: options.chain([host, "--", &remote]).map(OsString::from).collect(),
        environment: Vec::new(),
        gate: Some(Arc::clone(gate)),
        reports_errors: true,
        signs_of_life: Some(SIGNS_PERIOD),
    })
}

/// The command line for the shell of the other machine. The shell becomes the process, so that
/// it ends when ssh does.
fn remote_line(
    program: &str,
    arguments: &[String],
    environment: &BTreeMap<String, String>,
) -> String {
    let variables: Vec<String> =
        environment.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let words = ["env"].into_iter().chain(variables.iter().map(String::as_str));
    let words = words.chain([program]).chain(arguments.iter().map(String::as_str));
    format!("{LOGGED_IN}; exec {}", shell::line(words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remote_line_holds_every_word_as_it_is() {
        let environment = BTreeMap::from([("A".to_owned(), "x 'y' $Z".to_owned())]);
        let arguments = ["-c", "printf '%s|%s' \"$A\" \"$1\"", "sh", "a;b"].map(str::to_owned);
        let line = remote_line("/bin/sh", &arguments, &environment);
        let output = std::process::Command::new("/bin/sh").args(["-c", &line]).output();
        let output = String::from_utf8(output.expect("a shell").stdout).expect("text");
        assert_eq!(output, "logged in\nx 'y' $Z|a;b");
    }
}
