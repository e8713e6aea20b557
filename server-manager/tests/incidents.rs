//! Every incident that was kept: the core of today is told the same, and the invariants hold.
//!
//! `polyptych replay FILE --keep NAME` adds one. Decisions are not compared: a core that is
//! changed on purpose decides in another way. Where the messages have changed, a line can be
//! mended by hand.

use std::fs;
use std::path::{Path, PathBuf};

use polyptych_manager::replay::incident::Incident;

fn incidents() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/incidents");
    let entries = fs::read_dir(folder).expect("the folder of incidents");
    let mut files: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files
}

#[test]
fn kept_incidents_do_not_happen_again() {
    let files = incidents();
    assert!(!files.is_empty(), "at least one is kept");
    for file in files {
        let incident = Incident::load(&file).unwrap_or_else(|error| panic!("{error}"));
        let about = incident.description().to_owned();
        let checked = incident.check();
        let checked = checked.unwrap_or_else(|e| panic!("{} ({about}): {e}", file.display()));
        assert!(checked.inputs > 0 && checked.frames > 0, "{}: {checked:?}", file.display());
    }
}

#[test]
fn an_incident_of_another_form_is_refused_by_its_line() {
    let text = fs::read_to_string(&incidents()[0]).expect("text");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("broken.incident");
    let refused = |text: &str| {
        fs::write(&path, text).expect("written");
        let error = Incident::load(&path).expect_err("no incident");
        assert!(error.starts_with(&path.display().to_string()) && !error.contains('\n'), "{error}");
        error
    };
    assert!(refused("").contains(":1: it is empty"));
    assert!(refused("{}\n").contains(":1: missing field"));
    let unknown = text.replacen("\"input\":{\"Status\"", "\"input\":{\"Gossip\"", 1);
    assert_ne!(unknown, text);
    assert!(refused(&unknown).contains("unknown variant `Gossip`"));
}
