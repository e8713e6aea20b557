//! Units of systemd: for each machine a service for each of its processes, and a target for all.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::net::SocketAddr;

use polyptych_wall_file::LaunchOutput;

use super::plan::{LaunchPlan, Machine};
use super::unit_file::{UnitFile, UnitFiles, head, machine_folder};

/// Maximum silence of the manager's loop, in seconds: it never waits for disks or peers.
const MANAGER_WATCHDOG_S: u32 = 30;

/// Maximum silence of a server's threads, in seconds: a driver that compiles, or a GPU that is
/// opened again, may hold the render thread for half a minute.
const SERVER_WATCHDOG_S: u32 = 90;

/// Lines of a service that is not started again without end.
const START_LIMIT: &str = "\
    # What fails five times within a minute stays failed, until systemctl reset-failed.\n\
    StartLimitIntervalSec=60\n\
    StartLimitBurst=5\n";

/// Lines of a service with a display, which is there some time after a boot.
const NO_START_LIMIT: &str = "\
    # The display may come up later than this service.\n\
    StartLimitIntervalSec=0\n";

/// The user of services on machines whose host names none.
const USER_DEFAULT: &str = "polyptych";

/// The lines that differ between services.
struct Service<'s> {
    description: String,
    command: Vec<String>,
    environment: &'s BTreeMap<String, String>,
    user: &'s str,
    /// `true` if processes of other users run on its machine.
    shares_machine: bool,
    /// `true` if it draws on a display.
    has_display: bool,
    target: &'s str,
    watchdog_s: u32,
    /// Maximum time until it says that it is ready, as systemd reads it.
    start_time_max: &'s str,
}

/// The units of a wall.
///
/// # Errors
/// Servers cannot be told where the manager is.
pub(crate) fn units(plan: &LaunchPlan) -> anyhow::Result<UnitFiles> {
    let address = plan.manager_address()?;
    let mut units = UnitFiles::default();
    let base = format!("polyptych-{}", plan.wall.name);
    let target = format!("{base}.target");
    for machine in plan.machines() {
        put_machine(plan, &machine, &address, &base, &mut units);
        let place = machine_folder(machine.host);
        let copy = match machine.host {
            None => format!("sudo cp {{DIR}}/{place}/* /etc/systemd/system/"),
            Some(host) => {
                format!(
                    "scp {{DIR}}/{place}/* {host}:  and there: sudo install -m 644 polyptych-* \
                     /etc/systemd/system/"
                )
            }
        };
        if machine.has_manager && machine.host.is_some() {
            let wall = plan.wall_there();
            units.steps.push(format!("{place}: the wall file has to be {wall} there"));
        }
        units.steps.push(format!("{place}: {copy}"));
        units.steps.push(format!(
            "{place}: sudo systemctl daemon-reload && sudo systemctl enable --now {target}"
        ));
    }
    Ok(units)
}

fn put_machine(
    plan: &LaunchPlan,
    machine: &Machine<'_>,
    address: &str,
    base: &str,
    units: &mut UnitFiles,
) {
    let place = machine_folder(machine.host);
    let target = format!("{base}.target");
    let program = &plan.launch.program;
    let with_program = |mut words: Vec<String>| {
        words.insert(0, program.clone());
        words
    };
    let mut names = Vec::new();
    let mut put = |name: String, text: String| {
        names.push(name.clone());
        units.files.push(UnitFile::new(format!("{place}/{name}"), text));
    };
    let head = head(plan, "systemd");
    let shares_machine = has_several_users(plan, machine);
    if machine.has_manager {
        let service = Service {
            description: format!("Manager of the wall {}", plan.wall.name),
            command: with_program(plan.manager_there()),
            environment: &plan.launch.environment,
            user: user_of(plan.launch.manager_host.as_deref()),
            shares_machine,
            has_display: false,
            target: &target,
            watchdog_s: MANAGER_WATCHDOG_S,
            // It bakes the files of the wall first, for minutes; a bake ends by itself.
            start_time_max: "infinity",
        };
        put(format!("{base}-manager.service"), head.clone() + &service.text());
    }
    for name in &machine.servers {
        let server = &plan.launch.servers[*name];
        let service = Service {
            description: format!("Render server {name} of the wall {}", plan.wall.name),
            command: with_program(plan.server_there(name, address, LaunchOutput::Headless)),
            environment: &server.environment,
            user: user_of(server.host.as_deref()),
            shares_machine,
            has_display: server.output.is_some_and(|output| output != LaunchOutput::Headless),
            target: &target,
            watchdog_s: SERVER_WATCHDOG_S,
            // It is ready when it has joined, and the manager may come a day later.
            start_time_max: "infinity",
        };
        put(format!("{base}-server-{name}.service"), head.clone() + &service.text());
    }
    let target_text = format!(
        "{head}[Unit]\nDescription=The wall {} on this machine\nWants={}\n\n\
         [Install]\nWantedBy=multi-user.target\n",
        literal(&plan.wall.name),
        literal(&names.join(" "))
    );
    units.files.push(UnitFile::new(format!("{place}/{target}"), target_text));
    let is_address = plan.wall.listen.parse::<SocketAddr>().is_ok();
    if machine.has_manager && is_address {
        let text = format!("{head}{}", socket_text(plan));
        units.files.push(UnitFile::new(format!("{place}/{base}-manager.socket"), text));
    }
}

/// Returns whether processes of several users run on a machine.
fn has_several_users(plan: &LaunchPlan, machine: &Machine<'_>) -> bool {
    let servers = machine.servers.iter().map(|name| plan.launch.servers[*name].host.as_deref());
    let manager = machine.has_manager.then_some(plan.launch.manager_host.as_deref());
    let users: BTreeSet<&str> = servers.chain(manager).map(user_of).collect();
    users.len() > 1
}

/// The user that a host names, or the one of services.
fn user_of(host: Option<&str>) -> &str {
    host.and_then(|host| host.rsplit_once('@')).map_or(USER_DEFAULT, |(user, _)| user)
}

/// The socket of the manager, which is not started with the target.
fn socket_text(plan: &LaunchPlan) -> String {
    format!(
        "# Optional: with it connections wait while the manager is started again. Servers connect\n\
         # again and again, so a manager that was stopped is started at once as long as this unit\n\
         # is active: stop both.\n\
         [Unit]\nDescription=Address of the manager of the wall {}\n\n\
         [Socket]\nListenStream={}\nBacklog=1024\n\n\
         [Install]\nWantedBy=sockets.target\n",
        literal(&plan.wall.name),
        literal(&plan.wall.listen)
    )
}

impl Service<'_> {
    fn text(&self) -> String {
        let Self { description, target, watchdog_s, start_time_max, .. } = self;
        let user = literal(self.user);
        let (limit, pause) =
            if self.has_display { (NO_START_LIMIT, "2s") } else { (START_LIMIT, "500ms") };
        // At each start systemd gives a folder to the service's user, with all that is in it.
        let (folder, home) = if self.shares_machine {
            (format!("polyptych-{user}/polyptych"), format!("/polyptych-{user}"))
        } else {
            ("polyptych".to_owned(), String::new())
        };
        let command = self.command.iter().map(|word| command_word(word)).collect::<Vec<_>>();
        let target = literal(target);
        let mut text = format!(
            "[Unit]\n\
             Description={}\n\
             Wants=network-online.target\n\
             After=network-online.target\n\
             PartOf={target}\n\
             {limit}\n\
             [Service]\n\
             Type=notify\n\
             NotifyAccess=main\n\
             ExecStart={}\n\
             Restart=on-failure\n\
             RestartSec={pause}\n\
             WatchdogSec={watchdog_s}\n\
             TimeoutStartSec={start_time_max}\n\
             TimeoutStopSec=10\n\
             User={user}\n\
             StateDirectory={folder}\n\
             CacheDirectory={folder}\n\
             RuntimeDirectory=%N\n\
             NoNewPrivileges=yes\n\
             Environment=XDG_STATE_HOME=%S{home} XDG_CACHE_HOME=%C{home} \
                 XDG_RUNTIME_DIR=%t/%N\n",
            literal(description),
            command.join(" "),
        );
        for (name, value) in self.environment {
            let assignment = value_word(&format!("{name}={value}"));
            let _ = writeln!(text, "Environment={assignment}");
        }
        let _ = writeln!(text, "\n[Install]\nWantedBy={target}");
        text
    }
}

/// The text of a value that is no word: no specifier is replaced in it.
fn literal(text: &str) -> String {
    text.replace('%', "%%")
}

/// A word of a command line: neither a specifier nor a variable is replaced in it.
fn command_word(word: &str) -> String {
    value_word(&word.replace('$', "$$"))
}

/// A word of a value: no specifier is replaced in it.
fn value_word(word: &str) -> String {
    let escaped = word.replace('\\', r"\\").replace('"', "\\\"").replace('%', "%%");
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "@$_+=:,./-%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) { escaped } else { format!("\"{escaped}\"") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_taken_literally() {
        for (word, expected) in [
            ("--keys", "--keys"),
            ("/a b", "\"/a b\""),
            ("100%", "100%%"),
            ("a\"b\\c", "\"a\\\"b\\\\c\""),
            ("$HOME", "$$HOME"),
            ("", "\"\""),
        ] {
            assert_eq!(command_word(word), expected);
        }
        assert_eq!(value_word("A=$B"), "A=$B");
    }
}
