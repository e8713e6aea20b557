//! A Containerfile, and for each machine a compose file that runs its processes.

use std::collections::BTreeMap;
use std::path::Path;

use polyptych_tls::NodeIdentity;
use polyptych_wall_file::LaunchOutput;
use serde_json::{Value, json};

use super::plan::LaunchPlan;
use super::unit_file::{UnitFile, UnitFiles, X_SOCKETS, dns_label, head, machine_folder};
use super::yaml::to_yaml;

/// The image that ours is made from: its C library is newer than those of the systems that the
/// command is usually built on.
const BASE_IMAGE: &str = "debian:trixie-slim";

/// Packages that the command needs there: Vulkan with Mesa's drivers, X, and certificates of web
/// servers.
const PACKAGES: &[&str] = &[
    "ca-certificates",
    "libegl1",
    "libgl1-mesa-dri",
    "libvulkan1",
    "libx11-6",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxkbcommon-x11-0",
    "libxrandr2",
    "mesa-vulkan-drivers",
];

/// Returns the files of a wall, for containers of this image.
///
/// # Errors
/// Servers cannot be told where the manager is.
pub(crate) fn units(plan: &LaunchPlan, image: &str) -> anyhow::Result<UnitFiles> {
    let address = plan.manager_address()?;
    let head = head(plan, "container");
    let mut files = vec![UnitFile::new("Containerfile", head.clone() + &containerfile())];
    let mut steps = vec![
        "cp $(command -v polyptych) {DIR}/   (the program goes into the image)".to_owned(),
        format!(
            "podman build -t {image} {{DIR}}   (or docker build -t {image} -f \
             {{DIR}}/Containerfile {{DIR}})"
        ),
    ];
    for machine in plan.machines() {
        let mut services = serde_json::Map::new();
        if machine.has_manager {
            let wall = plan.wall_there();
            // A container has a root of its own: of a wall file in the root only the file is there.
            let folder = Path::new(&wall).parent().filter(|folder| *folder != Path::new("/"));
            let folder = folder.map(|folder| folder.display().to_string());
            let mut mounts = vec![folder.unwrap_or_else(|| wall.clone())];
            mounts.extend(plan.wall.scenes.iter().filter(|scenes| *scenes != "/").cloned());
            mounts.extend(plan.keys_of(&NodeIdentity::Manager));
            let arguments = plan.manager_there();
            let service = service(image, &arguments, &plan.launch.environment, mounts);
            services.insert("manager".to_owned(), service);
        }
        for name in &machine.servers {
            let server = &plan.launch.servers[*name];
            let arguments = plan.server_there(name, &address, LaunchOutput::Headless);
            let keys = plan.keys_of(&NodeIdentity::Server((*name).to_owned()));
            let mut mounts: Vec<String> = keys.into_iter().collect();
            if server.environment.contains_key("DISPLAY") {
                mounts.push(X_SOCKETS.to_owned());
            }
            mounts.extend(server.environment.get("XAUTHORITY").cloned());
            let mut service = service(image, &arguments, &server.environment, mounts);
            let has_display = server.output.is_some_and(|output| output != LaunchOutput::Headless);
            if has_display || server.gpu.is_some() || server.gpus > 0 {
                service["devices"] = json!(["/dev/dri"]);
            }
            if has_display {
                // The display may come up after it; a server that ends in order stays ended.
                service["restart"] = json!("on-failure");
            }
            services.insert(format!("server-{name}"), service);
        }
        let place = machine_folder(machine.host);
        let compose = json!({
            "name": dns_label(&format!("polyptych-{}", plan.wall.name)),
            "services": services,
            "volumes": { "state": {}, "cache": {} },
        });
        files.push(UnitFile::new(
            format!("{place}/compose.yaml"),
            head.clone() + &to_yaml(&compose),
        ));
        steps.push(format!("{place}: podman compose -f {{DIR}}/{place}/compose.yaml up -d"));
    }
    Ok(UnitFiles { files, steps })
}

/// Returns a process on the network of its machine, so that addresses are those of the wall file.
fn service(
    image: &str,
    arguments: &[String],
    environment: &BTreeMap<String, String>,
    mut mounts: Vec<String>,
) -> Value {
    // Compose replaces variables in values.
    let literal = |text: &str| text.replace('$', "$$");
    let mut volumes = vec![json!("state:/var/lib/polyptych"), json!("cache:/var/cache/polyptych")];
    mounts.sort_unstable();
    mounts.dedup();
    // The short form divides at colons, which a path may have.
    volumes.extend(mounts.iter().map(|path| {
        let path = literal(path);
        json!({ "type": "bind", "source": path, "target": path, "read_only": true })
    }));
    let arguments: Vec<String> = arguments.iter().map(|word| literal(word)).collect();
    let environment: BTreeMap<&String, String> =
        environment.iter().map(|(name, value)| (name, literal(value))).collect();
    json!({
        "image": image,
        "command": arguments,
        "environment": environment,
        "network_mode": "host",
        "restart": "on-failure:5",
        "init": true,
        "volumes": volumes,
    })
}

/// Returns the file of the image: the program that stands beside it, and the packages it needs.
pub(crate) fn containerfile() -> String {
    let packages = PACKAGES.join(" \\\n        ");
    format!(
        "FROM {BASE_IMAGE}\n\
         RUN apt-get update && apt-get install -y --no-install-recommends \\\n        \
                 {packages} && \\\n    \
             rm -rf /var/lib/apt/lists/* && \\\n    \
             mkdir -p -m 700 /var/lib/polyptych /var/cache/polyptych /run/polyptych\n\
         ENV XDG_STATE_HOME=/var/lib XDG_CACHE_HOME=/var/cache XDG_RUNTIME_DIR=/run/polyptych\n\
         COPY polyptych /usr/bin/polyptych\n\
         # A program that does not run on this system is known now.\n\
         RUN polyptych --version\n\
         STOPSIGNAL SIGTERM\n\
         ENTRYPOINT [\"polyptych\"]\n"
    )
}
