//! Manifests of Kubernetes: the manager behind a service, and a deployment for each server.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use polyptych_wall_file::LaunchOutput;
use serde_json::{Value, json};

use super::plan::{LaunchPlan, ManagerPlace, ServerPlace, machine_of};
use super::unit_file::{UnitFile, UnitFiles, X_SOCKETS, dns_label, head};
use super::yaml::to_yaml;

/// Folders in the containers.
const KEYS: &str = "/etc/polyptych/keys";
const TOKEN: &str = "/etc/polyptych/token";
const WALL: &str = "/etc/polyptych/wall";
const SCENES: &str = "/scenes";

/// The state file of a manager without keys, on its volume: by default it stands beside the token,
/// which lies in a volume that is read-only.
const STATE: &str = "/var/lib/polyptych/wall.state";

/// The file that probes read; the image makes its folder.
const ALIVE: &str = "/run/polyptych/alive";

/// Age of that file, in seconds, beyond which a process hangs: a driver that compiles may hold a
/// server's render thread for half a minute.
const SILENCE_MAX_S: u32 = 90;

/// Maximum time until a process says that it lives, in seconds: a manager bakes the files of its
/// wall first, and a single bake may take half of it.
const START_TIME_MAX_S: u32 = 3600;

/// Maximum bytes of a wall file that a ConfigMap takes, with room for the rest of it.
const CONFIG_BYTES_MAX: usize = 1_000_000;

/// The manifests of a wall, for containers of this image.
///
/// # Errors
/// The wall has files beside its own that no manifest can carry, or neither keys nor leave to go
/// without.
pub(crate) fn units(plan: &LaunchPlan, image: &str) -> anyhow::Result<UnitFiles> {
    plan.expect_encryption()?;
    let wall = Manifests { plan, image, base: format!("polyptych-{}", dns_label(&plan.wall.name)) };
    let head = head(plan, "kubernetes");
    let document = |values: Vec<Value>| {
        let texts: Vec<String> = values.iter().map(to_yaml).collect();
        head.clone() + &texts.join("---\n")
    };
    let mut files = vec![UnitFile::new("manager.yaml", document(wall.manager()?))];
    for name in plan.launch.servers.keys() {
        let path = format!("server-{name}.yaml");
        files.push(UnitFile::new(path, document(vec![wall.server(name)])));
    }
    files.push(UnitFile::script("secrets.sh", wall.secrets(&head)));
    let argument = if plan.launch.keys.is_some() { " KEYS" } else { "" };
    let steps = vec![
        format!("sh {{DIR}}/secrets.sh{argument}   (KEYS: the folder that polyptych keys made)"),
        "kubectl apply --server-side -f {DIR}".to_owned(),
    ];
    Ok(UnitFiles { files, steps })
}

/// Returns the port at which these arguments offer HTTP; `None` if they do not.
fn http_port(arguments: &[String]) -> Option<u16> {
    let mut words = arguments.iter();
    let mut port = None;
    while let Some(word) = words.next() {
        let address = match word.strip_prefix("--http=") {
            Some(address) => address,
            None if word == "--http" => words.next()?,
            None => continue,
        };
        let number = address.rsplit_once(':').and_then(|(_, port)| port.parse().ok());
        port = number.filter(|port| *port > 0);
    }
    port
}

/// Returns whether these arguments say where the manager's state is, or that it has none.
fn names_state(arguments: &[String]) -> bool {
    let is_name = |word: &str| matches!(word, "--state" | "--afresh");
    arguments.iter().any(|word| is_name(word) || word.starts_with("--state="))
}

struct Manifests<'p> {
    plan: &'p LaunchPlan,
    image: &'p str,
    /// The beginning of the names of all objects.
    base: String,
}

/// The pod of one process.
struct Pod<'p> {
    /// `manager`, or `server-` and a label.
    role: String,
    host: Option<&'p str>,
    arguments: Vec<String>,
    environment: &'p BTreeMap<String, String>,
    mounts: Vec<Value>,
    volumes: Vec<Value>,
    gpus: u32,
    ports: Vec<Value>,
}

impl Manifests<'_> {
    fn port(&self) -> u16 {
        let port = self.plan.wall.listen.rsplit_once(':').and_then(|(_, port)| port.parse().ok());
        port.filter(|port| *port > 0).unwrap_or(polyptych_wall::limits::PORT_DEFAULT)
    }

    fn has_keys(&self) -> bool {
        self.plan.launch.keys.is_some()
    }

    /// The name of the secret with the keys of a role, or with the token that all share.
    fn secret(&self, role: &str) -> String {
        let what = if self.has_keys() { format!("{role}-keys") } else { "token".to_owned() };
        format!("{}-{what}", self.base)
    }

    fn manager(&self) -> anyhow::Result<Vec<Value>> {
        let (wall_path, mut volumes) = self.wall_volume()?;
        let claim = format!("{}-data", self.base);
        volumes.push(json!({ "name": "data", "persistentVolumeClaim": { "claimName": claim } }));
        let data =
            |path: &str, part: &str| json!({ "name": "data", "mountPath": path, "subPath": part });
        let mounts = vec![
            json!({ "name": "wall", "mountPath": WALL, "readOnly": true }),
            data("/var/lib/polyptych", "state"),
            data("/var/cache/polyptych", "cache"),
            data(SCENES, "scenes"),
        ];
        let port = self.port();
        let mut arguments = self.plan.manager_arguments(ManagerPlace {
            wall: &wall_path,
            listen: &format!("0.0.0.0:{port}"),
            keys: self.has_keys().then_some(KEYS),
            is_insecure: self.plan.launch.is_insecure,
        });
        arguments.extend(["--scenes", SCENES, "--alive", ALIVE].map(str::to_owned));
        if !self.has_keys() && !names_state(&self.plan.launch.manager_arguments) {
            arguments.extend(["--state", STATE].map(str::to_owned));
        }
        let mut container_ports = vec![json!({ "name": "wall", "containerPort": port })];
        let mut service_ports = vec![json!({ "name": "wall", "port": port, "targetPort": port })];
        if let Some(http) = http_port(&self.plan.launch.manager_arguments) {
            container_ports.push(json!({ "name": "http", "containerPort": http }));
            service_ports.push(json!({ "name": "http", "port": http, "targetPort": http }));
        }
        let pod = Pod {
            role: "manager".to_owned(),
            host: self.plan.launch.manager_host.as_deref(),
            arguments,
            environment: &self.plan.launch.environment,
            mounts,
            volumes,
            gpus: 0,
            ports: container_ports,
        };
        let labels = self.labels("manager");
        let service = json!({
            "apiVersion": "v1", "kind": "Service",
            "metadata": { "name": format!("{}-manager", self.base), "labels": labels },
            "spec": {
                "selector": labels,
                "ports": service_ports,
            },
        });
        let claim = json!({
            "apiVersion": "v1", "kind": "PersistentVolumeClaim",
            "metadata": { "name": claim, "labels": labels },
            "spec": {
                "accessModes": ["ReadWriteOnce"],
                "resources": { "requests": { "storage": "20Gi" } },
            },
        });
        let mut objects = vec![service, claim, self.deployment(pod)];
        if let Some(config) = self.config_map() {
            objects.insert(0, config);
        }
        Ok(objects)
    }

    fn server(&self, name: &str) -> Value {
        let server = &self.plan.launch.servers[name];
        let (mut mounts, mut volumes) = (Vec::new(), Vec::new());
        if server.environment.contains_key("DISPLAY") {
            mounts.push(json!({ "name": "display", "mountPath": X_SOCKETS }));
            volumes.push(json!({ "name": "display", "hostPath": { "path": X_SOCKETS } }));
        }
        if let Some(file) = server.environment.get("XAUTHORITY").filter(|it| it.starts_with('/')) {
            mounts.push(json!({ "name": "xauthority", "mountPath": file, "readOnly": true }));
            volumes.push(json!({ "name": "xauthority", "hostPath": { "path": file } }));
        }
        mounts.push(json!({ "name": "cache", "mountPath": "/var/cache/polyptych" }));
        volumes.push(json!({ "name": "cache", "emptyDir": {} }));
        let address = format!("{}-manager:{}", self.base, self.port());
        let mut arguments = self.plan.server_arguments(
            name,
            ServerPlace {
                manager: &address,
                keys: self.has_keys().then_some(KEYS),
                is_insecure: self.plan.launch.is_insecure,
                output_default: LaunchOutput::Headless,
            },
        );
        arguments.extend(["--alive".to_owned(), ALIVE.to_owned()]);
        self.deployment(Pod {
            role: format!("server-{}", dns_label(name)),
            host: server.host.as_deref(),
            arguments,
            environment: &server.environment,
            mounts,
            volumes,
            gpus: server.gpus,
            ports: Vec::new(),
        })
    }

    fn labels(&self, role: &str) -> Value {
        json!({
            "app.kubernetes.io/name": "polyptych",
            "app.kubernetes.io/instance": self.base,
            "app.kubernetes.io/component": role,
        })
    }

    /// The deployment of one process. The old process ends before a new one starts, since two must
    /// not run at once.
    fn deployment(&self, pod: Pod<'_>) -> Value {
        let labels = self.labels(&pod.role);
        // A reference to a variable is replaced in these texts.
        let literal = |text: &String| text.replace('$', "$$");
        let variable =
            |(name, value): (&String, &String)| json!({ "name": name, "value": literal(value) });
        let arguments: Vec<String> = pod.arguments.iter().map(literal).collect();
        let mut environment: Vec<Value> = pod.environment.iter().map(variable).collect();
        let (mut mounts, mut volumes) = (pod.mounts, pod.volumes);
        let secret = if self.has_keys() { KEYS } else { TOKEN };
        mounts.push(json!({ "name": "secret", "mountPath": secret, "readOnly": true }));
        volumes.push(json!({
            "name": "secret",
            "secret": { "secretName": self.secret(&pod.role), "defaultMode": 0o400 },
        }));
        if !self.has_keys() {
            let file = format!("{TOKEN}/token");
            environment.push(json!({ "name": "POLYPTYCH_TOKEN_FILE", "value": file }));
        }
        let shell = |test: String| json!({ "command": ["sh", "-c", test] });
        let fresh = format!("test $(( $(date +%s) - $(stat -c %Y {ALIVE}) )) -lt {SILENCE_MAX_S}");
        let ready = format!("test \"$(cat {ALIVE})\" = ready");
        let mut container = json!({
            "name": "polyptych",
            "image": self.image,
            "args": arguments,
            "env": environment,
            "volumeMounts": mounts,
            "ports": pod.ports,
            "startupProbe": { "exec": shell(format!("test -e {ALIVE}")), "periodSeconds": 2,
                "failureThreshold": START_TIME_MAX_S / 2 },
            "livenessProbe": { "exec": shell(fresh), "periodSeconds": 10, "timeoutSeconds": 5 },
            "readinessProbe": { "exec": shell(ready), "periodSeconds": 2, "timeoutSeconds": 5 },
            "securityContext": { "allowPrivilegeEscalation": false },
        });
        if pod.gpus > 0 {
            container["resources"] = json!({ "limits": { "nvidia.com/gpu": pod.gpus } });
        }
        let mut spec = json!({
            "containers": [container],
            "volumes": volumes,
            "terminationGracePeriodSeconds": 10,
        });
        if let Some(machine) = machine_of(pod.host) {
            spec["nodeSelector"] = json!({ "kubernetes.io/hostname": machine });
        }
        json!({
            "apiVersion": "apps/v1", "kind": "Deployment",
            "metadata": { "name": format!("{}-{}", self.base, pod.role), "labels": labels },
            "spec": {
                "replicas": 1,
                "strategy": { "type": "Recreate" },
                "selector": { "matchLabels": labels },
                "template": { "metadata": { "labels": labels }, "spec": spec },
            },
        })
    }

    /// The wall file's path in the manager's container, and the volume with it.
    fn wall_volume(&self) -> anyhow::Result<(String, Vec<Value>)> {
        let launch = &self.plan.launch;
        if let (Some(_), Some(wall)) = (machine_of(launch.manager_host.as_deref()), &launch.wall) {
            let wall = Path::new(wall);
            let folder = wall.parent().unwrap_or(Path::new("/")).display().to_string();
            let name = wall.file_name().unwrap_or_default().to_string_lossy();
            let volume = json!({ "name": "wall", "hostPath": { "path": folder } });
            return Ok((format!("{WALL}/{name}"), vec![volume]));
        }
        if let Some(file) = self.plan.wall.files.first() {
            let what = format!(
                "the wall has files of its own, such as {}, which no ConfigMap holds; put its \
                 folder on a node, and write the node as manager and the wall file's path there as \
                 wall under [launch]",
                file.path
            );
            return Err(self.plan.fault("launch.wall", what));
        }
        if self.plan.text.len() > CONFIG_BYTES_MAX {
            let what =
                format!("a ConfigMap holds {CONFIG_BYTES_MAX} bytes, and the file is larger");
            return Err(self.plan.fault("launch.wall", what));
        }
        let name = format!("{}-wall", self.base);
        let volume = json!({ "name": "wall", "configMap": { "name": name } });
        Ok((format!("{WALL}/wall.toml"), vec![volume]))
    }

    fn config_map(&self) -> Option<Value> {
        let launch = &self.plan.launch;
        if machine_of(launch.manager_host.as_deref()).is_some() && launch.wall.is_some() {
            return None;
        }
        Some(json!({
            "apiVersion": "v1", "kind": "ConfigMap",
            "metadata": { "name": format!("{}-wall", self.base), "labels": self.labels("manager") },
            "data": { "wall.toml": self.plan.text },
        }))
    }

    /// A script that makes the secrets, which no manifest holds.
    fn secrets(&self, head: &str) -> String {
        let mut text = format!("#!/bin/sh\n{head}set -eu\n");
        if !self.has_keys() {
            let name = self.secret("");
            let _ = write!(
                text,
                "kubectl get secret {name} >/dev/null 2>&1 && exit 0\n\
                 token=$(od -An -N16 -tx1 /dev/urandom | tr -d ' \\n')\n\
                 # Not as an argument, which every user of this machine could read.\n\
                 printf %s \"$token\" | \
                     kubectl create secret generic {name} --from-file=token=/dev/stdin\n"
            );
            return text;
        }
        text.push_str(
            "keys=${1:?the folder that polyptych keys made}\n\
             make() { # NAME FOLDER\n    \
                 kubectl create secret generic \"$1\" --from-file=\"$keys/$2\" \\\n        \
                     --dry-run=client -o yaml | kubectl apply --server-side -f -\n\
             }\n",
        );
        let _ = writeln!(text, "make {} manager", self.secret("manager"));
        for name in self.plan.launch.servers.keys() {
            let secret = self.secret(&format!("server-{}", dns_label(name)));
            let _ = writeln!(text, "make {secret} server-{name}");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_port_of_http_is_that_of_the_last_address() {
        let port = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            http_port(&words)
        };
        assert_eq!(port(&["--http", "0.0.0.0:7880", "--http-host", "wall"]), Some(7880));
        assert_eq!(port(&["--http=[::]:80"]), Some(80));
        assert_eq!(port(&["--http-host", "wall:1", "--http"]), None);
        assert_eq!(port(&["--http", "0.0.0.0:0"]), None);
    }
}
