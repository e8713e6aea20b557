//! A blob whose transfer was broken off by the end of a server: the next one fetches the rest.

use std::fs;
use std::path::{Path, PathBuf};

use polyptych_client::blocking::Client;
use polyptych_client::{Camera, ChannelState};
use polyptych_files::blob::CHUNK_BYTES_MAX;

use crate::back_pressure::heavy;
use crate::harness::local_wall::{
    ANY_PORT, LocalWall, await_states, screen_of, shot, small, start_server,
};
use crate::harness::pictures::{IDENTICAL, check};
use crate::harness::place::TestDir;
use crate::harness::relay::Relay;
use crate::harness::wait;
use crate::observation::metrics::scrape;

/// Bytes that come through before the server is killed, of some 20 MB.
const HELD: usize = 6 << 20;

/// A manager with a heavy scene, and no server yet.
struct Fixture {
    local: LocalWall,
    client: Client,
    metrics: String,
}

impl Fixture {
    fn start() -> Self {
        let place = TestDir::new();
        let scenes = place.path("scenes");
        place.write("scenes/heavy.glb", heavy());
        let extra = ["--metrics", ANY_PORT];
        let folders = [&scenes as &Path];
        let mut local = LocalWall::manager_with(place, &small(1, 1), &folders, ANY_PORT, &extra);
        let line = local.manager.await_line(&["metrics are offered", "url=http://"]);
        let address = line.split("url=http://").nth(1).and_then(|rest| rest.split('/').next());
        let metrics = address.expect("an address").to_owned();
        let client = local.client();
        client.open_scene("heavy.glb").expect("opened");
        Self { local, client, metrics }
    }

    fn sent(&self) -> f64 {
        let labels = "connection=\"bulk\",direction=\"sent\"";
        let series = format!("polyptych_server_connection_bytes_total{{{labels}}}");
        scrape(&self.metrics).value(&series)
    }

    fn name(&self) -> String {
        self.local.wall().channels[0].server.clone()
    }

    /// The beginnings of blobs in the server's cache.
    fn beginnings(&self) -> Vec<PathBuf> {
        let folder = self.local.place.path(&format!("blobs-{}/partial", self.name()));
        let entries = fs::read_dir(folder).into_iter().flatten();
        entries.map(|entry| entry.expect("one").path()).collect()
    }

    /// Starts a server on a link that stands still inside a blob, and kills it there; gives its
    /// file with the beginning.
    fn kill_inside_a_blob(&mut self) -> PathBuf {
        let relay = Relay::holding_bulk_after(HELD, &self.local.address);
        let name = self.name();
        let mut server = start_server(&self.local.place, self.local.wall(), &name, &relay.address);
        let beginning = wait::until("a beginning on disk", || {
            let beginnings = self.beginnings();
            let bytes = |file: &PathBuf| fs::metadata(file).map_or(0, |facts| facts.len());
            beginnings.into_iter().find(|file| bytes(file) > HELD as u64 / 2)
        });
        server.kill();
        self.local.await_lost(&self.client, &name);
        beginning
    }

    /// Starts the server, and returns how many bytes it was sent until it showed the scene.
    fn restart(&mut self) -> f64 {
        let before = self.sent();
        let name = self.name();
        self.local.start_server(&name);
        await_states(&self.client, &[ChannelState::Ready, ChannelState::Live]);
        self.sent() - before
    }

    fn end_server(&mut self) {
        let name = self.name();
        self.local.servers.remove(&name).expect("a server").kill();
        self.local.await_lost(&self.client, &name);
    }
}

#[test]
fn a_server_that_is_killed_inside_a_blob_fetches_the_rest_and_then_nothing() {
    let mut fixture = Fixture::start();
    let beginning = fixture.kill_inside_a_blob();
    let pieces = fs::metadata(&beginning).expect("there").len() / CHUNK_BYTES_MAX as u64;
    let kept = (pieces * CHUNK_BYTES_MAX as u64) as f64;
    let whole = fixture.local.place.path("whole");
    let rest = fixture.restart();
    assert_eq!(fixture.beginnings(), Vec::<PathBuf>::new(), "it is a blob now");
    let picture = screen_of(&shot(&fixture.client, Camera::IDENTITY));
    fixture.end_server();
    assert_eq!(fixture.restart(), 0.0, "a second start sends no byte of a blob");
    fixture.end_server();

    // A beginning that was damaged is thrown away.
    let cache = fixture.local.place.path(&format!("blobs-{}", fixture.name()));
    fs::rename(&cache, whole).expect("moved");
    let all = fixture.restart();
    assert!(rest <= all - kept && kept > 2e6, "{rest} of {all}, {kept} kept");
    fixture.end_server();
    fs::remove_dir_all(&cache).expect("removed");
    let beginning = fixture.kill_inside_a_blob();
    let mut bytes = fs::read(&beginning).expect("read");
    bytes[1000] ^= 1;
    fs::write(&beginning, &bytes).expect("damaged");
    let sent = fixture.restart();
    assert!(sent > all && sent < all * 2.0, "the rest, then the whole: {sent} of {all}");
    let again = screen_of(&shot(&fixture.client, Camera::IDENTITY));
    check("after all", &again, &picture, &IDENTICAL);
    assert_eq!(fixture.beginnings(), Vec::<PathBuf>::new());
}
