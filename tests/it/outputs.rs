//! Commands replace regular files only: devices, FIFOs, sockets and folders stay what they are.

use std::fs;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::maps::{self, Region};
use crate::harness::place::TestDir;
use crate::harness::wait;

/// Kinds of things in the place of a file to be written. Tests may run as root: no real device is
/// named.
const KINDS: [&str; 5] = ["folder", "FIFO", "socket", "link to FIFO", "link to nothing"];

/// The kinds that every command is tried with: they tell whether it asks before it writes. How all
/// kinds are told apart is tried once, and by the tests of `polyptych_files`.
const SOME: [&str; 2] = ["FIFO", "link to nothing"];

fn make(kind: &str, path: &Path) {
    match kind {
        "folder" => fs::create_dir(path).expect("made"),
        "FIFO" => make_fifo(path),
        "socket" => drop(UnixListener::bind(path).expect("bound")),
        "link to FIFO" => {
            let fifo = path.with_file_name("the-fifo");
            if !fifo.exists() {
                make_fifo(&fifo);
            }
            symlink(fifo, path).expect("linked");
        }
        "link to nothing" => symlink("nowhere", path).expect("linked"),
        kind => panic!("{kind}"),
    }
}

fn make_fifo(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().expect("mkfifo").success());
}

/// Runs a command for some kinds of files at a path that it would write.
fn refuses(place: &TestDir, command: &str, name: &str, kinds: &[&str]) {
    let path = place.path(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    for &kind in kinds {
        make(kind, &path);
        let before = fs::symlink_metadata(&path).expect("there").file_type();
        let arguments = command.split(' ').map(|word| if word == "TARGET" { name } else { word });
        let said = place.run(arguments.clone()).failed(&[name]);
        let reasons = ["not a regular file", "not a folder", "symbolic link", "File exists"];
        // One that may be replaced, but not without being asked.
        let is_guarded = said.contains("is there already; --force") && kind.starts_with("link");
        let is_known = is_guarded || reasons.iter().any(|reason| said.contains(reason));
        assert!(is_known, "{command}, {kind}: {said}");
        let after = fs::symlink_metadata(&path).expect("still there").file_type();
        assert_eq!(before, after, "{command}, {kind}");
        if kind == "folder" {
            assert_eq!(fs::read_dir(&path).expect("a folder").count(), 0, "{command}");
            fs::remove_dir(&path).expect("removed");
        } else {
            fs::remove_file(&path).expect("removed");
        }
    }
    assert!(!place.path("nowhere").exists(), "{command}");
}

#[test]
fn commands_that_make_a_file_replace_only_regular_files() {
    let place = TestDir::new();
    place.run(["wall", "grid", "-o", "wall.toml"]).succeeded();
    for (command, name) in [
        ("scene town --blocks 1 -o TARGET", "town.glb"),
        ("scene town --blocks 1 --force -o TARGET", "town.glb"),
        ("wall arch --force -o TARGET", "new.toml"),
        ("wall cylinder --force -o TARGET", "new.toml"),
        ("wall cave --force -o TARGET", "new.toml"),
        ("wall dome -o TARGET", "new.toml"),
        ("wall save TARGET", "new.toml"),
        ("shot TARGET", "shot.png"),
        ("man -o man1", "man1/polyptych-wall-grid.1"),
        ("simulate wall.toml --out out", "out/wall.png"),
        ("simulate wall.toml --out out", "out/report.json"),
        ("simulate wall.toml --out out", "out/channel-front-1-2.png"),
        ("simulate wall.toml --record TARGET", "wall.rec"),
        ("manager wall.toml --listen 127.0.0.1:0 --record TARGET", "wall.rec"),
        ("prove wall.toml --out proof", "proof/prove.json"),
        ("gallery one.glb -o TARGET", "sheet.png"),
        ("bench --out out", "out/report.html"),
        ("bench --out out", "out/report.json"),
    ] {
        refuses(&place, command, name, &SOME);
    }
    refuses(&place, "wall grid --force -o TARGET", "new.toml", &KINDS);
}

#[test]
fn folders_of_results_are_folders() {
    let place = TestDir::new();
    place.run(["wall", "grid", "-o", "wall.toml"]).succeeded();
    place.write("file", "mine");
    make_fifo(&place.path("fifo"));
    for command in [
        "simulate wall.toml --out NAME",
        "prove wall.toml --out NAME",
        "bench --out NAME",
        "man -o NAME",
        "keys wall.toml -o NAME",
    ] {
        for name in ["file", "fifo"] {
            let arguments = command.split(' ').map(|word| if word == "NAME" { name } else { word });
            place.run(arguments.clone()).failed(&[name]);
        }
    }
    assert_eq!(fs::read(place.path("file")).expect("a file"), b"mine");
    place.run(["keys", "wall.toml"]).succeeded();
    let keys = place.path("keys/manager");
    fs::remove_dir_all(&keys).expect("removed");
    for kind in ["FIFO", "socket"] {
        make(kind, &keys);
        let renew = ["keys", "wall.toml", "--renew"];
        place.run(renew).failed(&["keys/manager", kind, "not a folder", "--out"]);
        fs::remove_file(&keys).expect("still there");
    }
    place.run(["keys", "wall.toml"]).succeeded();
}

#[test]
fn incidents_and_maps_replace_only_regular_files() {
    let place = TestDir::new();
    let record = ["--record", "wall.rec"];
    let mut local = LocalWall::manager_with(place, &small(1, 1), &[], ANY_PORT, &record);
    local.manager.signal(Signal::TERM);
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
    let place = local.place;
    refuses(&place, "replay wall.rec --force --keep TARGET", "kept.incident", &SOME);
    let region = Region {
        id: "front".to_owned(),
        size: [8, 4],
        part: [0.0, 0.0, 1.0, 1.0],
        frustum: None,
        warp: maps::pfm([8, 4], 3, true, |x, y| [x as f32 / 8.0, 1.0 - y as f32 / 4.0, 0.0]),
        unit: None,
        origin: None,
        alpha: None,
        beta: None,
    };
    place.write("hall.mpcdi", maps::zip(&maps::mpcdi_entries("2d", [8, 4], &[region])));
    for name in ["hall/wall.toml", "hall/front.pfm"] {
        refuses(&place, "wall import hall.mpcdi --force -o hall", name, &SOME);
    }
    place.run(["wall", "import", "hall.mpcdi", "--force", "-o", "hall"]).succeeded();
}
