//! Tells the tests at build time whether models and walls of others lie beside the repository, in
//! `../shared`: tests that need them are ignored where they do not, and counted as such.

use std::path::{Path, PathBuf};

/// What must be there.
const FOLDERS: [&str; 2] = ["assets", "walls"];

fn main() {
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
