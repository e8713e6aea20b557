//! The processes of a wall, the machine of each, and their command lines.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use polyptych_tls::NodeIdentity;
use polyptych_wall::Wall;
use polyptych_wall_file::{Launch, LaunchOutput};

/// A wall file with what it says of starting the wall.
#[derive(Debug)]
pub(crate) struct LaunchPlan {
    /// The absolute path of the file.
    pub file: PathBuf,
    pub text: String,
    pub wall: Wall,
    pub launch: Launch,
}

/// The part of a manager's command line that depends on its machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ManagerPlace<'p> {
    /// The path of the wall file there.
    pub wall: &'p str,
    pub listen: &'p str,
    /// The folder of its keys there.
    pub keys: Option<&'p str>,
    pub is_insecure: bool,
}

/// The part of a server's command line that depends on its machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServerPlace<'p> {
    /// The manager's address, seen from there.
    pub manager: &'p str,
    /// The folder of its keys there.
    pub keys: Option<&'p str>,
    pub is_insecure: bool,
    /// The kind of its output if the wall file says nothing.
    pub output_default: LaunchOutput,
}

/// The processes of one machine.
#[derive(Debug, Default)]
pub(crate) struct Machine<'p> {
    /// `USER@HOST` or `HOST`, as ssh takes it; `None` for the machine of the command. Several
    /// users of one machine are one machine: the host is the manager's, else the first server's.
    pub host: Option<&'p str>,
    pub has_manager: bool,
    /// The names of its servers, in order.
    pub servers: Vec<&'p str>,
}

impl LaunchPlan {
    /// Reads a wall file, and checks the command lines that it makes.
    ///
    /// # Errors
    /// The file is no wall file, or arguments in it are none of the command.
    pub fn load(file: &Path) -> anyhow::Result<Self> {
        let loaded = polyptych_wall_file::load_with_launch(file);
        let (wall, launch) = loaded.map_err(|error| anyhow!("{error}"))?;
        let file = std::path::absolute(file)
            .with_context(|| format!("the folder of {} is not known", file.display()))?;
        let text = std::fs::read_to_string(&file)
            .with_context(|| format!("cannot read {}", file.display()))?;
        let plan = Self { file, text, wall, launch };
        plan.check_arguments()?;
        Ok(plan)
    }

    /// An error about a key of the file.
    pub fn fault(&self, key: &str, what: impl std::fmt::Display) -> anyhow::Error {
        anyhow!("{}: {key}: {what}", self.file.display())
    }

    /// The path of the wall file on the manager's machine.
    pub fn wall_there(&self) -> String {
        let here = || self.file.display().to_string();
        self.launch.wall.clone().unwrap_or_else(here)
    }

    /// The folder of a node's keys on its machine; `None` without keys.
    pub fn keys_of(&self, node: &NodeIdentity) -> Option<String> {
        let keys = self.launch.keys.as_ref()?;
        Some(format!("{}/{}", keys.trim_end_matches('/'), node.folder()))
    }

    /// Returns whether what goes over a network may: it is encrypted, or the file says that it
    /// need not be.
    pub fn may_leave_machine(&self) -> bool {
        self.launch.keys.is_some() || self.launch.is_insecure
    }

    /// The arguments of the manager, without the program.
    pub fn manager_arguments(&self, place: ManagerPlace<'_>) -> Vec<String> {
        let mut words = words(&["manager", place.wall, "--listen", place.listen]);
        put_trust(&mut words, place.keys, place.is_insecure);
        words.extend(self.launch.manager_arguments.iter().cloned());
        words
    }

    /// The arguments of a server of the wall, without the program.
    ///
    /// # Panics
    /// The wall has no server of that name.
    pub fn server_arguments(&self, name: &str, place: ServerPlace<'_>) -> Vec<String> {
        let server = &self.launch.servers[name];
        let mut words = words(&["server", "--manager", place.manager, "--name", name]);
        for channel in &server.channels {
            words.extend(["--channel".to_owned(), channel.clone()]);
        }
        let output = match server.output.unwrap_or(place.output_default) {
            LaunchOutput::Fullscreen => "--fullscreen",
            LaunchOutput::Window => "--window",
            LaunchOutput::Headless => "--headless",
        };
        words.push(output.to_owned());
        if let Some(gpu) = &server.gpu {
            // In one word, since a name may begin with a dash.
            words.push(format!("--gpu={gpu}"));
        }
        put_trust(&mut words, place.keys, place.is_insecure);
        words.extend(server.arguments.iter().cloned());
        words
    }

    /// The arguments of the manager on the machine that the file names.
    pub fn manager_there(&self) -> Vec<String> {
        self.manager_arguments(ManagerPlace {
            wall: &self.wall_there(),
            listen: &self.wall.listen,
            keys: self.keys_of(&NodeIdentity::Manager).as_deref(),
            is_insecure: self.launch.is_insecure,
        })
    }

    /// The arguments of a server on the machine that the file names. `manager` is the address that
    /// [`LaunchPlan::manager_address`] returned.
    pub fn server_there(&self, name: &str, manager: &str, none: LaunchOutput) -> Vec<String> {
        let keys = self.keys_of(&NodeIdentity::Server(name.to_owned()));
        let place = ServerPlace {
            manager,
            keys: keys.as_deref(),
            is_insecure: self.launch.is_insecure,
            output_default: none,
        };
        self.server_arguments(name, place)
    }

    /// Returns the machines with their processes: that of the manager first, then by name.
    pub fn machines(&self) -> Vec<Machine<'_>> {
        let mut machines: BTreeMap<Option<&str>, Machine<'_>> = BTreeMap::new();
        let manager = self.launch.manager_host.as_deref();
        let of_manager = machines.entry(machine_of(manager)).or_default();
        of_manager.host = machine_of(manager).and(manager);
        of_manager.has_manager = true;
        for (name, server) in &self.launch.servers {
            let host = server.host.as_deref();
            let machine = machines.entry(machine_of(host)).or_default();
            machine.host = machine.host.or(machine_of(host).and(host));
            machine.servers.push(name);
        }
        let mut machines: Vec<_> = machines.into_values().collect();
        machines.sort_by_key(|machine| !machine.has_manager);
        machines
    }

    /// Returns the address at which all servers reach the manager, if each runs on the machine that
    /// the file names.
    ///
    /// # Errors
    /// There is none, or nothing may go over the network to it; with the key to write.
    pub fn manager_address(&self) -> anyhow::Result<String> {
        let listen = self.wall.listen.as_str();
        let (host, port) = listen.rsplit_once(':').unwrap_or((listen, ""));
        if port == "0" {
            let what = "port 0 is any free one, and servers must be told which; write a port, such \
                        as 7878";
            return Err(self.fault("network.listen", what));
        }
        let ip = host.trim_matches(['[', ']']).parse::<IpAddr>().ok();
        let is_loopback = ip.map_or(host == "localhost", |ip| ip.is_loopback());
        if !is_loopback && !self.may_leave_machine() {
            let what = format!(
                "other machines reach {listen}, and without keys nothing is encrypted; write \
                 keys = \"/FOLDER\" under [launch] (polyptych keys makes them), or insecure = true \
                 on a network that you trust"
            );
            return Err(self.fault("network.listen", what));
        }
        if let Some(address) = &self.launch.address {
            if !is_loopback_address(address) && !self.may_leave_machine() {
                let what = format!(
                    "servers reach the manager at {address}, over a network, and without keys \
                     nothing is encrypted; write keys = \"/FOLDER\" under [launch] (polyptych keys \
                     makes them), or insecure = true on a network that you trust"
                );
                return Err(self.fault("launch.address", what));
            }
            // An address on loopback is that of a tunnel.
            if is_loopback && !is_loopback_address(address) {
                let what = format!(
                    "the manager listens at {listen} only, and servers are told {address}; write \
                     listen = \"0.0.0.0:{port}\" under [network]"
                );
                return Err(self.fault("network.listen", what));
            }
            return Ok(address.clone());
        }
        let manager = machine_of(self.launch.manager_host.as_deref());
        let servers = &self.launch.servers;
        let away = servers.iter().find(|(_, it)| machine_of(it.host.as_deref()) != manager);
        match away {
            None if ip.is_some_and(|ip| ip.is_unspecified()) => {
                let loopback =
                    if ip.is_some_and(|ip| ip.is_ipv6()) { "[::1]" } else { "127.0.0.1" };
                Ok(format!("{loopback}:{port}"))
            }
            Some((name, server)) if is_loopback || ip.is_some_and(|ip| ip.is_unspecified()) => {
                let machine = server.host.as_deref().unwrap_or("this machine");
                let listens = if is_loopback {
                    format!("; the manager listens at {listen} only, see listen of [network]")
                } else {
                    String::new()
                };
                let what = format!(
                    "server {name} runs on {machine}, another machine than the manager's; write \
                     the address at which it reaches the manager, such as \
                     \"head.example:{port}\"{listens}"
                );
                Err(self.fault("launch.address", what))
            }
            _ => Ok(listen.to_owned()),
        }
    }

    /// Refuses arguments in the file that the command would refuse when it is started.
    fn check_arguments(&self) -> anyhow::Result<()> {
        let check = |key: &str, arguments: Vec<String>| {
            crate::cli::check_command_line(&arguments).map_err(|error| self.fault(key, error))
        };
        check("launch.manager_arguments", self.manager_there())?;
        for name in self.launch.servers.keys() {
            let arguments = self.server_there(name, "127.0.0.1:7878", LaunchOutput::Headless);
            check(&format!("launch.server_arguments, server.{name}.arguments"), arguments)?;
        }
        Ok(())
    }

    /// Refuses a wall whose processes go over a network in the clear without being told to.
    pub fn expect_encryption(&self) -> anyhow::Result<()> {
        if self.may_leave_machine() {
            return Ok(());
        }
        Err(self.fault(
            "launch.keys",
            "it is missing, and without keys nothing is encrypted; write the folder of the keys \
             (polyptych keys makes them), or insecure = true on a network that you trust",
        ))
    }
}

/// Returns whether HOST:PORT, or HOST, is on the machine of the program that connects to it.
fn is_loopback_address(address: &str) -> bool {
    let is_loopback = |host: &str| {
        let ip = host.trim_matches(['[', ']']).parse::<IpAddr>();
        ip.map_or(host == "localhost", |ip| ip.is_loopback())
    };
    is_loopback(address) || address.rsplit_once(':').is_some_and(|(host, _)| is_loopback(host))
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

fn put_trust(words: &mut Vec<String>, keys: Option<&str>, is_insecure: bool) {
    match keys {
        Some(keys) => words.extend(["--keys".to_owned(), keys.to_owned()]),
        None if is_insecure => words.push("--insecure".to_owned()),
        None => {}
    }
}

/// Returns the machine without the user; `None` for the one of the command, by any of its names.
pub(crate) fn machine_of(host: Option<&str>) -> Option<&str> {
    let host = host?;
    let machine = host.rsplit_once('@').map_or(host, |(_, machine)| machine);
    let ip = machine.trim_matches(['[', ']']).parse::<IpAddr>();
    let is_here = machine == "localhost" || ip.is_ok_and(|ip| ip.is_loopback());
    (!is_here).then_some(machine)
}

#[cfg(test)]
mod tests;
