//! Coverage-guided: a kept incident that somebody has edited. The core takes all of it, or it is
//! refused with file and line; what it says of invariants is not judged here.
#![no_main]

use std::fs;

use libfuzzer_sys::fuzz_target;
use polyptych_manager::replay::incident::Incident;

thread_local! {
    static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a folder");
}

fuzz_target!(|data: &[u8]| {
    FOLDER.with(|folder| {
        let path = folder.path().join("a.incident");
        fs::write(&path, data).expect("written");
        match Incident::load(&path) {
            Ok(incident) => drop(incident.check()),
            Err(reason) => assert!(reason.contains("a.incident"), "{reason}"),
        }
    });
});
