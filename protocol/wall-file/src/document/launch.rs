//! What a wall file says of starting the wall's processes: `[launch]` and `[server.NAME]`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How `polyptych up` and `polyptych unit` start the manager and the servers. Paths are those of
/// the machine on which a process runs, and absolute.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LaunchSection {
    /// The machine of the manager as ssh takes it, HOST or USER@HOST. Default: the one on which
    /// the command runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub manager: Option<String>,
    /// The manager's address as servers reach it, HOST:PORT. Default: listen of [network].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub address: Option<String>,
    /// The wall file on the manager's machine. Default: the path that the command was given, as
    /// an absolute one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall: Option<String>,
    /// The command polyptych on each machine: a path, or a name that the machine finds.
    pub program: String,
    /// The folder on each machine in which the folders of its keys lie, as `polyptych keys` names
    /// them: manager, server-NAME. Default: no keys.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keys: Option<String>,
    /// Without keys: servers go over a network all the same, and nothing is encrypted. Each
    /// machine needs a copy of the manager's token.
    pub insecure: bool,
    /// Where servers draw. Default: "fullscreen" where the environment of a server names DISPLAY,
    /// else "headless".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<LaunchOutput>,
    /// Variables for all processes, such as DISPLAY. No secrets: they stand in command lines.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub environment: BTreeMap<String, String>,
    /// More arguments of polyptych manager, such as "--http", "0.0.0.0:7880".
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub manager_arguments: Vec<String>,
    /// More arguments of polyptych server, for all servers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub server_arguments: Vec<String>,
    /// The command that runs a command on another machine: ssh with options of its own, or
    /// another program that takes the same ones.
    pub ssh: Vec<String>,
}

/// Where a server draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum LaunchOutput {
    /// Each channel fills a monitor.
    Fullscreen,
    /// A window for each channel.
    Window,
    /// No display.
    Headless,
}

/// The machine of a server, and how it is started there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServerSection {
    /// The machine as ssh takes it, HOST or USER@HOST. Default: the one on which the command runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// Where it draws. Default: output of [launch].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<LaunchOutput>,
    /// The GPU that it draws with: a part of its name, or its PCI address, as `polyptych server
    /// --list-gpus` prints them on its machine. Default: the best one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gpu: Option<String>,
    /// Variables for this server, before those of [launch].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub environment: BTreeMap<String, String>,
    /// More arguments of polyptych server, behind those of [launch].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub arguments: Vec<String>,
    /// GPUs that Slurm and Kubernetes are asked for; 0 to 64.
    #[serde(skip_serializing_if = "is_zero")]
    pub gpus: u32,
}

impl Default for LaunchSection {
    fn default() -> Self {
        Self {
            manager: None,
            address: None,
            wall: None,
            program: "polyptych".to_owned(),
            keys: None,
            insecure: false,
            output: None,
            environment: BTreeMap::new(),
            manager_arguments: Vec::new(),
            server_arguments: Vec::new(),
            ssh: vec!["ssh".to_owned()],
        }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks in this form")]
fn is_zero(gpus: &u32) -> bool {
    *gpus == 0
}
