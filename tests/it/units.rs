//! The files with which other systems run a wall, and what these hear of its processes.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;

use super::up::{script, wall_with};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::{signals, wait};

/// Two servers, one of which is on a machine of its own.
const LINES: &str = "[launch]\nprogram = \"PROGRAM\"\naddress = \"head:7878\"\nkeys = \"/etc/k\"\n\
                     output = \"headless\"\nenvironment = { VK_LOADER_DEBUG = \"100% $x\" }\n\
                     [server.front-2-1]\nhost = \"me@render1\"\ngpus = 1\n";

fn lines() -> String {
    LINES.replace("PROGRAM", env!("CARGO_BIN_EXE_polyptych"))
}

/// A wall of two servers whose manager listens at all addresses of its machine.
fn wall_of_machines(place: &TestDir) {
    wall_with(place, 2, &lines());
    let text = fs::read_to_string(place.path("wall.toml")).expect("a file");
    place.write("wall.toml", text.replace("127.0.0.2:", "0.0.0.0:"));
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into()).collect()
}

#[test]
#[cfg_attr(not(has_systemd), ignore = "no systemd-analyze")]
fn systemd_takes_its_units() {
    let place = TestDir::new();
    wall_of_machines(&place);
    let said = place.run(["unit", "systemd", "wall.toml", "-o", "units"]).succeeded();
    assert!(said.contains("render1: sudo systemctl daemon-reload"), "{said}");
    let here = place.path("units/here");
    let expected = ["manager.service", "manager.socket", "server-front-1-1.service"]
        .map(|name| format!("polyptych-small-{name}"));
    let mut expected = BTreeSet::from(expected);
    expected.insert("polyptych-small.target".to_owned());
    assert_eq!(names(&here), expected);
    let there = place.path("units/render1/polyptych-small-server-front-2-1.service");
    let text = fs::read_to_string(there).expect("a unit");
    for line in [
        "Type=notify",
        "Restart=on-failure",
        "StartLimitBurst=5",
        "WatchdogSec=90",
        "User=me",
        "Environment=\"VK_LOADER_DEBUG=100%% $x\"",
        "--keys /etc/k/server-front-2-1",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    let mut units: Vec<_> = names(&here).into_iter().map(|name| here.join(name)).collect();
    units.extend(
        names(&place.path("units/render1"))
            .iter()
            .map(|name| place.path("units/render1").join(name)),
    );
    for unit in units {
        let verified = Command::new("systemd-analyze").arg("verify").arg(&unit).output();
        let verified = verified.expect("systemd-analyze");
        let said = String::from_utf8_lossy(&verified.stderr);
        // It looks at all units of this machine, too.
        assert!(verified.status.success() && !said.contains("polyptych"), "{said}");
    }
    let again = ["unit", "systemd", "wall.toml", "-o", "units"];
    place.run(again).failed(&["is there already", "--force"]);
    place.run(again.iter().chain(&["--force"])).succeeded();
}

/// Programs of Slurm that run everything here.
fn fake_slurm(place: &TestDir) {
    script(place, "bin/scontrol", "#!/bin/sh\necho \"$SLURM_JOB_NODELIST\" | tr ',' '\\n'\n");
    script(
        place,
        "bin/srun",
        "#!/bin/bash\necho \"srun $* of ${SLURM_GPUS-no} GPUs\" >>\"$SRUN_LOG\"\n\
         while [ \"$1\" != env ]; do shift; done\nexec \"$@\"\n",
    );
    // Restarts of a test do not wait.
    script(place, "bin/sleep", "#!/bin/sh\nexit 0\n");
}

fn batch(place: &TestDir, nodes: &str, file: &str) -> Process {
    let mut command = place.command(["x"]);
    let variables: Vec<_> = command
        .get_envs()
        .filter_map(|(name, value)| Some((name.to_owned(), value?.to_owned())))
        .collect();
    command = Command::new("bash");
    let path = format!("{}:{}", place.path("bin").display(), std::env::var("PATH").expect("one"));
    command
        .arg(place.path(file))
        .current_dir(place.folder())
        .envs(variables)
        .env("PATH", path)
        .env("SRUN_LOG", place.path("srun.log"))
        .env("SLURM_JOB_NODELIST", nodes)
        .env("SLURM_GPUS", "1");
    Process::start("batch", &mut command)
}

#[test]
fn a_batch_job_runs_a_wall_and_gives_up_on_what_fails_at_once() {
    let place = TestDir::new();
    fake_slurm(&place);
    let program = env!("CARGO_BIN_EXE_polyptych");
    let address = wall_with(&place, 2, &format!("[launch]\nprogram = {program:?}\n"));
    // Where a job on one node listens.
    let address = address.replace("127.0.0.2", "127.0.0.1");
    let said = place.run(["unit", "slurm", "wall.toml", "-o", "job"]).succeeded();
    assert!(said.contains("sbatch job/polyptych-small.sh"), "{said}");
    let file = place.path("job/polyptych-small.sh");
    let text = fs::read_to_string(&file).expect("a script");
    assert!(text.contains("#SBATCH --ntasks=3\n#SBATCH --nodes=1-2\n"), "{text}");
    let mut job = batch(&place, "n1", "job/polyptych-small.sh");
    wait::until("both servers", || {
        let status = place.run(["status", "--json", "--manager", &address]);
        let status: Value = serde_json::from_str(&status.output).ok()?;
        let channels = status["channels"].as_array()?;
        let is_there = |it: &Value| it["state"] == "ready" || it["state"] == "live";
        (channels.len() == 2 && channels.iter().all(is_there)).then_some(())
    });
    job.signal(Signal::TERM);
    job.finish(wait::SOON);
    place.run(["status", "--manager", &address]).failed(&["127.0.0.1"]);
    // Two nodes need keys, or leave to go without them.
    let mut two = batch(&place, "n1,n2", "job/polyptych-small.sh");
    let refused = two.finish(wait::SOON);
    assert_eq!(refused.code(), 1);
    assert!(refused.output.contains("nothing is encrypted"), "{}", refused.output);
    // What fails at once is started five times.
    fs::write(&file, text.replace(program, "/bin/false")).expect("written");
    fs::write(place.path("srun.log"), "").expect("emptied");
    let mut failing = batch(&place, "n1", "job/polyptych-small.sh");
    let failed = failing.finish(wait::LIMIT);
    assert_eq!(failed.code(), 1);
    assert!(failed.output.contains("manager failed 5 times"), "{}", failed.output);
    let log = fs::read_to_string(place.path("srun.log")).expect("a log");
    assert_eq!(log.lines().filter(|line| line.contains("--job-name=manager")).count(), 5, "{log}");
}

#[test]
fn a_batch_job_places_servers_on_the_nodes_it_has() {
    let place = TestDir::new();
    fake_slurm(&place);
    // The job ends with the manager, which waits until all were started.
    let started = "#!/bin/sh\n[ \"$1\" != manager ] || \
                   until [ \"$(wc -l <\"$SRUN_LOG\")\" -ge 3 ]; do :; done\n";
    let program = script(&place, "bin/started", started).display().to_string();
    let lines = lines().replace(env!("CARGO_BIN_EXE_polyptych"), &program);
    wall_with(&place, 2, &lines);
    place.run(["unit", "slurm", "wall.toml", "-o", "job"]).succeeded();
    let mut job = batch(&place, "n1,render1.example,n3", "job/polyptych-small.sh");
    assert_eq!(job.finish(wait::LIMIT).code(), 0, "{}", job.output());
    let log = fs::read_to_string(place.path("srun.log")).expect("a log");
    // A step asks for its own GPUs, and not for those of the job.
    let (none, one) = ("--overlap --gpus=0 ", "--exact --mem=0 --gpus-per-task=1 ");
    for parts in [
        ["--nodelist=n1 ", none, "manager ", "--listen 0.0.0.0:", "of no GPUs"],
        ["--nodelist=n1 ", none, "--name front-1-1 ", "--manager n1:", "of no GPUs"],
        ["--nodelist=render1.example ", one, "--name front-2-1 ", "--manager n1:", "of no GPUs"],
    ] {
        let is_there = log.lines().any(|line| parts.iter().all(|part| line.contains(part)));
        assert!(is_there, "{parts:?}: {log}");
    }
    assert!(log.contains("VK_LOADER_DEBUG=100% $x"), "{log}");
}

/// Every document of a YAML file, as Python reads it.
fn documents(file: &Path) -> Vec<Value> {
    const READ: &str = "import json, sys, yaml\n\
                        print(json.dumps(list(yaml.safe_load_all(open(sys.argv[1])))))";
    let output = Command::new("python3").args(["-c", READ]).arg(file).output().expect("python3");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {said}", file.display());
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[cfg_attr(not(has_yaml), ignore = "no python3 with yaml")]
fn manifests_and_compose_files_are_yaml_with_what_the_wall_says() {
    let place = TestDir::new();
    wall_of_machines(&place);
    for kind in ["kubernetes", "container"] {
        place.run(["unit", kind, "wall.toml", "-o", kind, "--image", "r.example/p:1"]).succeeded();
    }
    let manager = documents(&place.path("kubernetes/manager.yaml"));
    let kinds: Vec<_> = manager.iter().map(|it| it["kind"].as_str().expect("a kind")).collect();
    assert_eq!(kinds, ["ConfigMap", "Service", "PersistentVolumeClaim", "Deployment"]);
    let text = fs::read_to_string(place.path("wall.toml")).expect("a file");
    assert_eq!(manager[0]["data"]["wall.toml"], text);
    let server = documents(&place.path("kubernetes/server-front-2-1.yaml"));
    let pod = &server[0]["spec"]["template"]["spec"];
    assert_eq!(pod["nodeSelector"]["kubernetes.io/hostname"], "render1");
    let container = &pod["containers"][0];
    assert_eq!(container["image"], "r.example/p:1");
    assert_eq!(container["resources"]["limits"]["nvidia.com/gpu"], 1);
    assert_eq!(container["env"][0]["value"], "100% $$x");
    let secret = &pod["volumes"][1]["secret"];
    assert_eq!(secret["secretName"], "polyptych-small-server-front-2-1-keys");
    assert_eq!(secret["defaultMode"], 0o400);
    let secrets = place.path("kubernetes/secrets.sh");
    let read = Command::new("sh").arg("-n").arg(&secrets).status().expect("sh");
    assert!(
        read.success() && fs::read_to_string(&secrets).expect("text").contains("server-front-2-1")
    );
    let compose = documents(&place.path("container/render1/compose.yaml"));
    let service = &compose[0]["services"]["server-front-2-1"];
    assert_eq!(service["network_mode"], "host");
    assert_eq!(service["restart"], "on-failure:5");
    assert_eq!(service["devices"][0], "/dev/dri");
    // Of all keys a container has its own.
    let keys = "/etc/k/server-front-2-1";
    let bind =
        serde_json::json!({ "type": "bind", "source": keys, "target": keys, "read_only": true });
    assert_eq!(service["volumes"][2], bind);
    let image = fs::read_to_string(place.path("container/Containerfile")).expect("a file");
    assert!(image.contains("COPY polyptych") && image.contains("ENTRYPOINT"), "{image}");
    // Without keys a cluster's network is told of everything.
    wall_with(&place, 2, "");
    let refused = ["unit", "kubernetes", "wall.toml", "-o", "other"];
    place.run(refused).failed(&["launch.keys", "nothing is encrypted"]);
}

#[test]
fn a_secret_is_no_argument_of_a_command() {
    let place = TestDir::new();
    wall_with(&place, 2, "[launch]\ninsecure = true\n");
    place.run(["unit", "kubernetes", "wall.toml", "-o", "files"]).succeeded();
    let kubectl =
        "#!/bin/sh\n[ \"$1\" != get ] || exit 1\necho \"$*\" >said\ncat /dev/stdin >token\n";
    script(&place, "bin/kubectl", kubectl);
    let path = format!("{}:{}", place.path("bin").display(), std::env::var("PATH").expect("one"));
    let mut made = Command::new("sh");
    made.arg(place.path("files/secrets.sh")).current_dir(place.folder()).env("PATH", path);
    assert!(made.status().expect("sh").success());
    let token = fs::read_to_string(place.path("token")).expect("a token");
    assert!(token.len() == 32 && token.chars().all(|c| c.is_ascii_hexdigit()), "{token:?}");
    let said = fs::read_to_string(place.path("said")).expect("arguments");
    assert!(said.contains("polyptych-small-token") && !said.contains(&token), "{said}");
}

/// The next message with this word.
#[track_caller]
fn hear(socket: &UnixDatagram, word: &str) -> String {
    let mut bytes = [0; 1024];
    wait::until(word, || {
        let count = socket.recv(&mut bytes).ok()?;
        let text = String::from_utf8_lossy(&bytes[..count]).into_owned();
        text.contains(word).then_some(text)
    })
}

#[test]
fn a_service_manager_hears_who_is_ready_works_and_ends() {
    let place = TestDir::new();
    let address = wall_with(&place, 1, "");
    let listen = |name: &str| {
        let socket = UnixDatagram::bind(place.path(name)).expect("bound");
        socket.set_read_timeout(Some(wait::SOON)).expect("set");
        socket
    };
    let start = |name: &str, arguments: &[&str]| {
        let mut command = place.command(arguments);
        command.env("NOTIFY_SOCKET", place.path(name)).env("WATCHDOG_USEC", "600000");
        Process::start(name, &mut command)
    };
    let of_server = listen("server.socket");
    let arguments = ["server", "--manager", &address, "--channel", "front", "--headless"];
    let alive = ["--alive", "alive"];
    let mut server = start("server.socket", &[&arguments[..], &alive].concat());
    let waits = hear(&of_server, "STATUS=no manager at");
    assert!(!waits.contains("READY"), "{waits}");
    hear(&of_server, "WATCHDOG=1");
    assert_eq!(fs::read_to_string(place.path("alive")).expect("a file"), "starting\n");
    let of_manager = listen("manager.socket");
    let mut manager = start("manager.socket", &["manager", "wall.toml"]);
    hear(&of_manager, "READY=1");
    hear(&of_manager, "WATCHDOG=1");
    hear(&of_manager, "STATUS=wall small: 0 of 1 channel live, 1 connected");
    hear(&of_server, "READY=1");
    let is_ready = || fs::read_to_string(place.path("alive")).is_ok_and(|it| it == "ready\n");
    wait::until("the file", || is_ready().then_some(()));
    // A process that stands still gives no sign.
    server.signal(Signal::STOP);
    hear(&of_manager, "0 connected");
    of_server.set_nonblocking(true).expect("set");
    while of_server.recv(&mut [0; 1024]).is_ok() {}
    for _ in 0..3 {
        hear(&of_manager, "WATCHDOG=1");
    }
    assert!(of_server.recv(&mut [0; 1024]).is_err(), "nothing works there");
    signals::send(server.pid(), Signal::CONT);
    of_server.set_nonblocking(false).expect("set");
    hear(&of_server, "WATCHDOG=1");
    manager.signal(Signal::TERM);
    hear(&of_manager, "STOPPING=1");
    assert_eq!(manager.finish(wait::SOON).code(), 0);
    server.signal(Signal::TERM);
    hear(&of_server, "STOPPING=1");
    assert_eq!(server.finish(wait::SOON).code(), 0);
    assert!(!place.path("alive").exists());
}

#[test]
#[cfg_attr(not(has_dpkg), ignore = "no dpkg-deb")]
fn a_package_has_the_program_its_manuals_and_its_services() {
    let place = TestDir::new();
    let run = Path::new(env!("CARGO_MANIFEST_DIR")).join("run");
    let mut command = place.command(["x"]);
    let variables: Vec<_> = command
        .get_envs()
        .filter_map(|(name, value)| Some((name.to_owned(), value?.to_owned())))
        .collect();
    command = Command::new(run);
    // The program of the tests is large, and nobody keeps this package.
    command.args(["package", "deb", "--binary", env!("CARGO_BIN_EXE_polyptych"), "-o", "out"]);
    command.current_dir(place.folder()).envs(variables).env("DEB_LEVEL", "0");
    let said = Process::start("package", &mut command).finish(wait::LIMIT).succeeded();
    let file = place.path(said.lines().last().expect("the file"));
    let ask = |what: &str| {
        let output = Command::new("dpkg-deb").arg(what).arg(&file).output().expect("dpkg-deb");
        String::from_utf8(output.stdout).expect("text")
    };
    let contents = ask("--contents");
    for path in [
        "./usr/bin/polyptych",
        "./usr/share/man/man1/polyptych-up.1.gz",
        "./usr/share/bash-completion/completions/polyptych",
        "./usr/share/zsh/vendor-completions/_polyptych",
        "./usr/share/fish/vendor_completions.d/polyptych.fish",
        "./usr/lib/systemd/system/polyptych-manager.service",
        "./usr/lib/systemd/system/polyptych-server@.service",
        "./usr/lib/sysusers.d/polyptych.conf",
        "./usr/share/doc/polyptych/copyright",
        "./etc/default/polyptych",
    ] {
        let line = contents.lines().find(|line| line.ends_with(path));
        let line = line.unwrap_or_else(|| panic!("{path}: {contents}"));
        assert!(line.contains("root/root"), "{line}");
    }
    let tree = place.path("tree");
    let unpacked = Command::new("dpkg-deb").arg("--extract").args([&file, &tree]).status();
    assert!(unpacked.expect("dpkg-deb").success());
    for (unit, limit) in [
        ("polyptych-manager.service", "StartLimitBurst=5\n"),
        ("polyptych-server@.service", "StartLimitIntervalSec=0\n"),
    ] {
        let text = fs::read_to_string(tree.join("usr/lib/systemd/system").join(unit));
        let text = text.expect("a unit");
        assert!(text.contains(limit) && text.contains("TimeoutStartSec=infinity\n"), "{text}");
    }
    let fields = ask("--field");
    assert!(fields.contains("Depends: libc6 (>= 2."), "{fields}");
    assert!(fields.contains(&format!("Version: {}\n", env!("CARGO_PKG_VERSION"))), "{fields}");
}
