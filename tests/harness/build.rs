//! Tells the tests at build time what this machine has: models and walls of others beside the
//! repository, in `../shared`, and Python. Tests that need what is not there are ignored, and
//! counted as such.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The folders that must be there.
const FOLDERS: [&str; 2] = ["assets", "walls"];

/// Ends well where Python can run the package of clients.
const PYTHON_IS_NEW: &str = "import sys; sys.exit(sys.version_info < (3, 9))";

fn main() {
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
