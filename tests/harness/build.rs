//! Tells the tests at build time what this machine has: models and walls of others beside the
//! repository, in `../shared`, Python, and programs of administrators. Tests that need what is not
//! there are ignored, and counted as such.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The folders that must be there.
const FOLDERS: [&str; 2] = ["assets", "walls"];

/// Ends well where Python can run the package of clients.
const PYTHON_IS_NEW: &str = "import sys; sys.exit(sys.version_info < (3, 9))";

/// Programs that some tests run, and what says that they are there.
const PROGRAMS: [(&str, &[&str]); 3] = [
    ("has_systemd", &["systemd-analyze"]),
    ("has_sshd", &["sshd", "ssh", "ssh-keygen"]),
    ("has_dpkg", &["dpkg-deb"]),
];

/// Ends well where Python reads YAML.
const PYTHON_READS_YAML: &str = "import yaml";

/// Returns whether a program is where people and services have theirs.
fn is_installed(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    folders.push("/usr/sbin".into());
    folders.iter().any(|folder| folder.join(program).is_file())
}

fn main() {
    for (name, programs) in PROGRAMS {
        println!("cargo::rustc-check-cfg=cfg({name})");
        if programs.iter().all(|program| is_installed(program)) {
            println!("cargo::rustc-cfg={name}");
        }
    }
    println!("cargo::rustc-check-cfg=cfg(has_yaml)");
    let yaml =
        Command::new("python3").args(["-c", PYTHON_READS_YAML]).stderr(Stdio::null()).status();
    if yaml.is_ok_and(|status| status.success()) {
        println!("cargo::rustc-cfg=has_yaml");
    }
    println!("cargo::rustc-check-cfg=cfg(has_python)");
    println!("cargo::rerun-if-env-changed=PATH");
    let mut python = Command::new("python3");
    let asked = python.args(["-c", PYTHON_IS_NEW]).stdin(Stdio::null()).status();
    if asked.is_ok_and(|status| status.success()) {
        println!("cargo::rustc-cfg=has_python");
    }
    println!("cargo::rustc-check-cfg=cfg(has_shared_files)");
    let package = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let root = package.ancestors().find(|folder| folder.join("Cargo.lock").is_file());
    let shared = root.map(|root| root.join("../shared"));
    let has_all = |shared: &Path| FOLDERS.iter().all(|name| shared.join(name).is_dir());
    match shared.filter(|shared| has_all(shared)) {
        Some(shared) => {
            println!("cargo::rustc-cfg=has_shared_files");
            println!("cargo::rerun-if-changed={}", shared.join(FOLDERS[0]).display());
        }
        // A path that is not there would build all of it again each time.
        None => println!("cargo::rerun-if-env-changed=CARGO_MANIFEST_DIR"),
    }
}
