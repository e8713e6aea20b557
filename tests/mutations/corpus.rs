//! The seeds as files, for the coverage-guided targets of `tests/fuzz`: written where
//! `POLYPTYCH_CORPUS` says, else to a folder that is gone with the test.

use std::fs;
use std::path::{Path, PathBuf};

use polyptych_protocol::handshake::{Preamble, Role};

use crate::message::{KINDS, Kind};
use crate::seeds::{maps, messages, scenes, walls};

#[test]
fn every_target_has_something_to_begin_from() {
    let passing = tempfile::tempdir().expect("a folder");
    let given = std::env::var_os("POLYPTYCH_CORPUS").map(PathBuf::from);
    let folder = given.unwrap_or_else(|| passing.path().to_owned());
    let mut greeted = 0;
    for (i, (kind, bytes)) in messages::all().into_iter().enumerate() {
        let at = KINDS.iter().position(|k| *k == kind).expect("a kind") as u8;
        write(&folder, "decoder", i, &[&[at], &bytes[..]].concat());
        let (first, role) = match kind {
            // The first byte: which end listens, and how long the pieces are.
            Kind::Greeting => (255, Role::Manager),
            Kind::Introduction => {
                (254, [Role::Client, Role::Server, Role::Server, Role::Bulk][i % 4])
            }
            _ => continue,
        };
        greeted += 1;
        let said =
            [&[first], &Preamble::current(role).to_bytes()[..], &polyptych_codec::framed(&bytes)]
                .concat();
        write(&folder, "handshake", i, &said);
    }
    assert!(greeted > 4);
    for (i, text) in walls::SEEDS.iter().enumerate() {
        write(&folder, "wall_file", i, text.as_bytes());
    }
    for (i, bytes) in scenes::files().iter().enumerate() {
        write(&folder, "scene_import", i, bytes);
    }
    let incident = include_bytes!("../../server-manager/tests/incidents/killed-server.incident");
    write(&folder, "incident", 0, incident);
    for (i, bytes) in maps::all().iter().enumerate() {
        write(&folder, "wall_map", i, &[&[i as u8], &bytes[..]].concat());
    }
}

fn write(folder: &Path, target: &str, number: usize, bytes: &[u8]) {
    let folder = folder.join(target);
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join(format!("seed-{number}")), bytes).expect("written");
}
