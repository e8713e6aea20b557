//! Bakers that die, and caches that are damaged or can't be written.

use std::fs;
use std::path::{Path, PathBuf};

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, Pacing};
use polyptych_files::blob::BlobHash;
use rustix::process::Signal;

use super::{RATE, brisk};
use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, shot};
use crate::harness::place::{TestDir, of_this_run};
use crate::harness::scenes::{Gltf, poses, town};
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

#[test]
fn a_client_is_told_of_a_baker_that_dies_and_the_wall_goes_on() {
    let folder = town().parent().expect("a folder");
    let wall = brisk(1, 1);
    // Nothing is baked yet in a cold place.
    let mut local = LocalWall::manager(TestDir::unbaked(), &wall, &[folder], ANY_PORT);
    local.start_server(&wall.channels[0].server);
    let client = local.client();
    await_states(&client, &[ChannelState::Ready]);
    client.start_rendering(Pacing::Rate(RATE)).expect("runs");
    let mut feedbacks = client.feedback().expect("a stream");
    let before = feedbacks.next().expect("a frame");
    let asked = client.clone();
    let opened = std::thread::Builder::new()
        .name("client".into())
        .spawn(move || asked.open_scene("town.glb"))
        .expect("a thread");
    let baker = wait::until("a baker", || {
        let all = signals::processes_of(local.place.folder());
        all.into_iter().find(|&pid| signals::arguments_of(pid).get(1).is_some_and(|a| a == "bake"))
    });
    signals::send(baker, Signal::KILL);
    let error = opened.join().expect("no panic").expect_err("it was killed").to_string();
    for part in ["town.glb", "the baker ended", "SIGKILL", "MiB of memory", "--bake-memory-mib"] {
        assert!(error.contains(part), "{part:?} is not in {error:?}");
    }
    let after = feedbacks.find(|f| f.frame.0 > before.frame.0 + 10).expect("the wall goes on");
    assert_eq!(after.channels[0].state, ChannelState::Live, "{after:?}");
    let status = client.status().expect("status");
    assert_eq!((status.scene, status.channels[0].late), (None, 0));
    client.open_scene("town.glb").expect("nothing half done is in the way");
}

/// A package that is upgraded puts its program in the place of the one that runs.
#[test]
fn a_manager_whose_program_was_replaced_bakes_with_the_one_that_runs() {
    // Beside the program, of which another file system would need a copy.
    let program = of_this_run().join("replaced");
    let own = env!("CARGO_BIN_EXE_polyptych");
    fs::hard_link(own, &program).or_else(|_| fs::copy(own, &program).map(drop)).expect("there");
    let place = TestDir::unbaked().with_program(program.clone());
    place.write("triangle.glb", Gltf::triangle().glb());
    let scenes = place.folder().to_owned();
    let local = LocalWall::manager(place, &brisk(1, 1), &[&scenes], ANY_PORT);
    fs::remove_file(&program).expect("removed");
    fs::write(&program, "no program of this release").expect("replaced");
    let summary = local.client().open_scene("triangle.glb").expect("opened");
    assert_eq!(summary.triangles, 1);
}

/// A command that bakes by itself is not told to start a manager.
#[test]
fn a_command_whose_baker_dies_says_how_to_give_it_more_memory() {
    let arguments = ["--frames", "1", "--bake-memory-mib", "5000"];
    let wall = brisk(1, 1);
    let mut simulation = Simulation::start(TestDir::unbaked(), &wall, town(), &arguments);
    let baker = wait::until("a baker", || simulation.children("bake").first().copied());
    let words = signals::arguments_of(baker);
    signals::send(baker, Signal::KILL);
    assert!(words.windows(2).any(|pair| pair == ["--memory-mib", "5000"]), "{words:?}");
    let remedy = "5000 MiB of memory: give this command --bake-memory-mib N";
    let failed = simulation.process.finish(wait::LIMIT);
    failed.failed(&["town.glb", "the baker ended", "SIGKILL", remedy]);
}

/// A server whose cache is somewhere, and the picture that it shows.
struct Cached {
    local: LocalWall,
    client: Client,
    server: String,
}

impl Cached {
    fn start() -> Self {
        Self::start_in(TestDir::new())
    }

    fn start_in(place: TestDir) -> Self {
        let wall = crate::harness::local_wall::small(1, 1);
        let server = wall.channels[0].server.clone();
        let folder = town().parent().expect("a folder");
        let local = LocalWall::manager(place, &wall, &[folder], ANY_PORT);
        let client = local.client();
        Self { local, client, server }
    }

    fn cache(&self) -> PathBuf {
        self.local.place.path(&format!("blobs-{}", self.server))
    }

    fn start_server(&mut self) {
        self.local.start_server(&self.server);
        await_states(&self.client, &[ChannelState::Ready, ChannelState::Live]);
    }

    /// The server is started anew, with nothing of its own if `is_empty`, while the wall shows no
    /// scene.
    fn restart_server(&mut self, is_empty: bool) {
        self.client.close_scene().expect("closed");
        self.server().kill();
        self.local.await_lost(&self.client, &self.server.clone());
        if is_empty {
            fs::remove_dir_all(self.cache()).expect("removed");
        }
        self.start_server();
    }

    fn server(&mut self) -> &mut crate::harness::process::Process {
        self.local.servers.get_mut(&self.server).expect("a server")
    }
}

#[test]
fn a_damaged_cache_is_filled_anew_and_never_believed() {
    let mut wall = Cached::start();
    wall.start_server();
    let bounds = wall.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let before = shot(&wall.client, poses(&bounds)[2]);
    wall.server().kill();
    wall.local.await_lost(&wall.client, &wall.server.clone());
    let blobs = blobs_in(&wall.cache());
    assert!(blobs.len() > 10, "{} blobs", blobs.len());
    for (number, blob) in blobs.iter().enumerate() {
        let mut bytes = fs::read(blob).expect("read");
        // One byte is another, or the end is missing.
        match number % 2 {
            0 => bytes[0] ^= 1,
            _ => bytes.truncate(bytes.len() / 2),
        }
        fs::write(blob, bytes).expect("written");
    }
    wall.start_server();
    wall.server().await_line(&["WARN", "a stored blob is of no use", "was damaged"]);
    let after = shot(&wall.client, poses(&bounds)[2]);
    assert!(after.screens == before.screens, "another picture");
    // Whole again: the next start needs nobody.
    wall.server().kill();
    wall.local.await_lost(&wall.client, &wall.server.clone());
    wall.start_server();
    assert!(!wall.server().output().contains("of no use"), "{}", wall.server().output());
}

/// The blobs in a folder of them.
fn blobs_in(folder: &Path) -> Vec<PathBuf> {
    let folders = fs::read_dir(folder).expect("a folder of blobs").flatten();
    let files = folders.flat_map(|folder| fs::read_dir(folder.path()).into_iter().flatten());
    files.flatten().map(|file| file.path()).collect()
}

/// Damages every second blob: bytes that are other, an end that is missing, a file that is gone,
/// and one that is empty.
fn damage(blobs: &[PathBuf]) {
    for (number, blob) in blobs.iter().step_by(2).enumerate() {
        let mut bytes = fs::read(blob).expect("read");
        match number % 4 {
            0 => bytes[0] ^= 1,
            1 => bytes.truncate(bytes.len() / 2),
            2 => {
                fs::remove_file(blob).expect("removed");
                continue;
            }
            _ => bytes.clear(),
        }
        fs::write(blob, bytes).expect("written");
    }
}

#[test]
fn one_open_mends_a_store_and_a_cache_that_are_damaged_in_every_way() {
    let mut wall = Cached::start_in(TestDir::unbaked());
    wall.start_server();
    let bounds = wall.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let before = shot(&wall.client, poses(&bounds)[2]);
    let store = wall.local.place.path("cache/polyptych/store/blobs");
    let stored = blobs_in(&store);
    assert!(stored.len() > 10, "{} blobs", stored.len());
    for is_cache_empty in [true, false] {
        // What a killed process leaves, and what is somebody else's.
        let left = stored[0].parent().expect("a folder").join(".polyptych-dead.part");
        fs::write(&left, "half").expect("written");
        damage(&stored);
        if !is_cache_empty {
            let cached = blobs_in(&wall.cache());
            damage(&cached);
            fs::write(cached[0].with_file_name(".polyptych-dead.part"), "half").expect("written");
        }
        wall.restart_server(is_cache_empty);
        if !is_cache_empty {
            let parts = ["files of killed processes were removed", "files=1", "bytes=4"];
            wall.server().await_line(&parts);
        }
        wall.client.open_scene("town.glb").expect("mended by one open");
        let after = shot(&wall.client, poses(&bounds)[2]);
        assert!(after.screens == before.screens, "another picture, cache empty: {is_cache_empty}");
        let name =
            |path: &PathBuf| path.file_name().expect("a name").to_string_lossy().into_owned();
        for blob in &stored {
            let hash = BlobHash::of(&fs::read(blob).expect("there again"));
            assert_eq!(hash.to_string(), name(blob), "mended");
        }
    }
}

#[test]
fn a_cache_that_cannot_be_written_is_done_without() {
    let mut wall = Cached::start();
    // Where the folder should be stands a file, which keeps out root too.
    fs::write(wall.cache(), "in the way").expect("written");
    wall.start_server();
    let bounds = wall.client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let picture = shot(&wall.client, poses(&bounds)[2]);
    assert_eq!(picture.channels.len(), 1);
    let line = wall.server().await_line(&["WARN", "the cache can't be written"]);
    assert!(line.contains("going on without it"), "{line}");
    let said = wall.server().output().matches("can't be written").count();
    assert_eq!(said, 1, "once, not for each blob");
    assert_eq!(fs::read_to_string(wall.cache()).expect("still there"), "in the way");
}

#[test]
fn a_store_that_cannot_be_written_is_told_to_the_client() {
    let folder = town().parent().expect("a folder");
    let place = TestDir::unbaked();
    // The manager's cache folder is one of its own in a cold place.
    place.write("cache/polyptych/store", "in the way");
    let wall = brisk(1, 1);
    let local = LocalWall::manager(place, &wall, &[folder], ANY_PORT);
    let client = local.client();
    let error = client.open_scene("town.glb").expect_err("nowhere to put it").to_string();
    assert!(error.contains("cache/polyptych/store") && error.contains("writable"), "{error}");
    client.render_frame().expect("the wall goes on");
}
