//! Blobs in object stores: a real S3 server holds them, servers fetch them from there, and work
//! round one that fails.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use image::RgbaImage;
use polyptych_client::{Camera, ChannelState, Wall, fit_bounds};
use polyptych_files::blob::BLOB_BYTES_MAX;
use rustix::process::Signal;
use serde_json::json;

use crate::harness::local_wall::{
    ANY_PORT, LocalWall, await_states, screen_of, shot, small, start_server_with,
};
use crate::harness::maps::{Png, png};
use crate::harness::pictures::{IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::process::{Finished, Process};
use crate::harness::s3_server::{S3Server, Trouble};
use crate::harness::scenes::{Gltf, town};
use crate::harness::wait;
use crate::observation::metrics::scrape;

const STORE: &str = "s3://walls/blobs";

/// The line that a server logs when it goes on without a store.
const TOLD: &str = "blobs come from elsewhere than this object store";

/// A wall of one display that looks for blobs in these places.
fn wall(stores: &[&str]) -> Wall {
    let mut wall = small(1, 1);
    wall.stores = stores.iter().map(|&store| store.to_owned()).collect();
    wall
}

fn bake(place: &TestDir, store: &S3Server, url: &str) -> Finished {
    bake_with(place, &store.environment(), url)
}

fn bake_with(place: &TestDir, environment: &[(&str, &str)], url: &str) -> Finished {
    let mut arguments = ["bake", "-o", "baked", "--upload", url].map(PathBuf::from).to_vec();
    arguments.push(town().to_owned());
    let mut command = place.command(arguments);
    command.envs(environment.iter().copied());
    Process::start("bake", &mut command).finish(wait::LIMIT)
}

/// Writes a scene with two textures, each of which is sent in several parts.
fn write_large_scene(place: &TestDir) -> PathBuf {
    const SIZE: [u32; 2] = [2048, 1536];
    let scene = Gltf::triangle().with(|file| {
        let corners = [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0];
        let bytes: Vec<u8> = corners.iter().flat_map(|number| number.to_le_bytes()).collect();
        let uv = file.accessor("VEC2", 5126, 3, &bytes);
        let primitive = &mut file.json["meshes"][0]["primitives"][0];
        primitive["attributes"]["TEXCOORD_0"] = uv.into();
        primitive["material"] = 0.into();
        file.json["materials"] = json!([{
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "emissiveTexture": { "index": 1 }, "emissiveFactor": [1, 1, 1],
        }]);
        file.json["textures"] = json!([{ "source": 0 }, { "source": 1 }]);
        file.json["images"] = json!([]);
        for number in 0..2 {
            let texels = (0..SIZE[0] * SIZE[1] * 3).map(|at| ((at / 7 + number * 50) % 251) as u16);
            let texels: Vec<u16> = texels.collect();
            let picture = Png { size: SIZE, color: 2, bits: 8, gamma: None, texels: &texels };
            let bytes = png(&picture);
            file.bin.resize(file.bin.len().next_multiple_of(4), 0);
            let (at, length) = (file.bin.len(), bytes.len());
            file.bin.extend(bytes);
            let views = file.json["bufferViews"].as_array_mut().expect("a list");
            views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": length }));
            let image = json!({ "bufferView": views.len() - 1, "mimeType": "image/png" });
            file.json["images"].as_array_mut().expect("a list").push(image);
        }
    });
    place.write("large.glb", scene.glb())
}

fn start_upload(place: &TestDir, scene: &Path, store: &S3Server) -> Process {
    let mut arguments = ["bake", "-o", "baked", "--upload", STORE].map(PathBuf::from).to_vec();
    arguments.push(scene.to_owned());
    let mut command = place.command(arguments);
    command.envs(store.environment());
    Process::start("bake", &mut command)
}

#[test]
fn an_upload_that_is_interrupted_leaves_no_parts_in_the_store() {
    let place = TestDir::new();
    let scene = write_large_scene(&place);
    let folder = place.path("s3");
    let store = S3Server::start_troubled(&folder, &[Trouble::Silence, Trouble::Silence]);
    let mut upload = start_upload(&place, &scene, &store);
    wait::until("both textures on their way", || store.is_in_trouble_with(2).then_some(()));
    assert!(store.uploads_left().len() >= 4, "two uploads with a part each");
    upload.signal(Signal::INT);
    upload.finish(wait::LIMIT).failed(&["interrupted", "another upload goes on"]);
    assert_eq!(store.uploads_left(), [] as [PathBuf; 0]);
    // Another one goes on from there.
    drop(store);
    let store = S3Server::start(&folder);
    start_upload(&place, &scene, &store).finish(wait::LIMIT).succeeded();
    let large = |file: &&PathBuf| fs::metadata(file).expect("there").len() > 8 << 20;
    assert_eq!(blobs_in(&store.objects("blobs")).iter().filter(large).count(), 2);
}

#[test]
fn a_blob_that_is_refused_ends_the_uploads_beside_it_in_order() {
    let place = TestDir::new();
    let scene = write_large_scene(&place);
    let troubles = [Trouble::Silence, Trouble::RefusalAfter(2)];
    let store = S3Server::start_troubled(&place.path("s3"), &troubles);
    let mut upload = start_upload(&place, &scene, &store);
    upload.finish(wait::LIMIT).failed(&[STORE, "403"]);
    assert!(store.is_in_trouble_with(2), "both textures were on their way");
    assert_eq!(store.uploads_left(), [] as [PathBuf; 0]);
}

/// The blobs of a folder, the largest first.
fn blobs_in(folder: &Path) -> Vec<PathBuf> {
    let folders = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("one").path());
    let files = folders.flat_map(|folder| fs::read_dir(folder).expect("a folder"));
    let mut files: Vec<PathBuf> = files.map(|entry| entry.expect("one").path()).collect();
    files.sort_by_key(|file| std::cmp::Reverse(fs::metadata(file).expect("there").len()));
    files
}

/// A manager with metrics, and one display whose server has an environment.
struct Fixture {
    local: LocalWall,
    metrics: String,
    camera: Camera,
}

impl Fixture {
    /// Starts both; the display then shows the town.
    fn start(place: TestDir, wall: &Wall, environment: &[(&str, &str)]) -> Self {
        let folder = town().parent().expect("a folder");
        let extra = ["--metrics", ANY_PORT];
        let mut local = LocalWall::manager_with(place, wall, &[folder], ANY_PORT, &extra);
        let line = local.manager.await_line(&["metrics are offered", "url=http://"]);
        let address = line.split("url=http://").nth(1).and_then(|rest| rest.split('/').next());
        let metrics = address.expect("an address").to_owned();
        let mut fixture = Self { local, metrics, camera: Camera::IDENTITY };
        fixture.start_server(environment);
        let scene = fixture.local.client().open_scene("town.glb").expect("opened");
        fixture.camera = fit_bounds(wall, &scene.bounds.expect("a town"), 0.0);
        fixture
    }

    fn start_server(&mut self, environment: &[(&str, &str)]) {
        let LocalWall { place, address, .. } = &self.local;
        let name = self.local.wall().channels[0].server.clone();
        let more = ["--headless"];
        let wall = self.local.wall();
        let server = start_server_with(place, wall, &name, address, &more, environment);
        self.local.servers.insert(name, server);
        await_states(&self.local.client(), &[ChannelState::Ready, ChannelState::Live]);
    }

    /// Ends the server, and starts it again without a cache.
    fn restart_server(&mut self, environment: &[(&str, &str)]) {
        let name = self.local.wall().channels[0].server.clone();
        self.local.servers.remove(&name).expect("a server").kill();
        self.local.await_lost(&self.local.client(), &name);
        fs::remove_dir_all(self.local.place.path(&format!("blobs-{name}"))).expect("removed");
        self.start_server(environment);
    }

    fn picture(&self) -> RgbaImage {
        screen_of(&shot(&self.local.client(), self.camera))
    }

    /// Bytes of blobs that the manager has sent.
    fn sent_by_manager(&self) -> f64 {
        let labels = "connection=\"bulk\",direction=\"sent\"";
        let series = format!("polyptych_server_connection_bytes_total{{{labels}}}");
        scrape(&self.metrics).value(&series)
    }

    /// The only warning of the status.
    #[track_caller]
    fn warning(&self) -> String {
        let warnings = wait::until("a warning", || {
            let warnings = self.local.client().status().expect("status").warnings;
            (!warnings.is_empty()).then_some(warnings)
        });
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        warning.clone()
    }

    /// Lines of the server's log that say that a store is not used.
    fn told(&self) -> usize {
        let server = self.local.servers.values().next().expect("a server");
        server.output().lines().filter(|line| line.contains(TOLD)).count()
    }
}

/// The picture that every wall here must show.
fn expected() -> &'static RgbaImage {
    static PICTURE: OnceLock<RgbaImage> = OnceLock::new();
    PICTURE.get_or_init(|| {
        let picture = Fixture::start(TestDir::new(), &wall(&[]), &[]).picture();
        assert!(color_count(&picture) > 100, "there is something to see");
        picture
    })
}

/// A place and a store with all blobs of the town, a copy of one that is filled once.
fn stored_town() -> (TestDir, S3Server) {
    static FILLED: OnceLock<TestDir> = OnceLock::new();
    let filled = FILLED.get_or_init(|| {
        let place = TestDir::unbaked();
        let store = S3Server::start(&place.path("s3"));
        bake(&place, &store, STORE).succeeded();
        place
    });
    let place = TestDir::unbaked();
    copy_folder(&filled.path("s3"), &place.path("s3"));
    let store = S3Server::start(&place.path("s3"));
    (place, store)
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("made");
    for entry in fs::read_dir(from).expect("a folder").map(|entry| entry.expect("one")) {
        let to = to.join(entry.file_name());
        if entry.file_type().expect("known").is_dir() {
            copy_folder(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).expect("copied");
        }
    }
}

#[test]
fn a_scene_whose_blobs_are_only_in_an_object_store_is_drawn() {
    let (place, store) = stored_town();
    let mut fixture = Fixture::start(place, &wall(&[STORE]), &store.environment());
    check("from S3", &fixture.picture(), expected(), &IDENTICAL);
    assert_eq!(fixture.sent_by_manager(), 0.0);
    assert!(store.requests() > 100, "{} requests", store.requests());
    // Nor has the manager any of them from here on.
    let baked = blobs_in(&fixture.local.place.path("cache/polyptych/store/blobs"));
    assert!(!baked.is_empty());
    for blob in &baked {
        fs::remove_file(blob).expect("removed");
    }
    fixture.restart_server(&store.environment());
    check("from S3 alone", &fixture.picture(), expected(), &IDENTICAL);
    assert_eq!(fixture.sent_by_manager(), 0.0);
    assert_eq!(fixture.told(), 0);
    assert!(fixture.local.client().status().expect("status").warnings.is_empty());
}

#[test]
fn objects_with_wrong_or_too_many_bytes_come_from_the_manager_and_are_told() {
    let (place, store) = stored_town();
    let objects = blobs_in(&store.objects("blobs"));
    let mut bytes = fs::read(&objects[0]).expect("read");
    bytes[100] ^= 1;
    fs::write(&objects[0], &bytes).expect("damaged");
    let huge = fs::File::options().write(true).open(&objects[1]).expect("opened");
    huge.set_len(BLOB_BYTES_MAX + 1).expect("lengthened");
    let fixture = Fixture::start(place, &wall(&[STORE]), &store.environment());
    check("two objects damaged", &fixture.picture(), expected(), &IDENTICAL);
    let warning = fixture.warning();
    assert!(warning.contains(&format!("{STORE}: object blobs/")), "{warning}");
    assert!(warning.contains("--upload"), "{warning}");
    assert_eq!(fixture.told(), 1);
    let total: u64 = objects[2..].iter().map(|file| fs::metadata(file).expect("there").len()).sum();
    let sent = fixture.sent_by_manager();
    assert!(sent > bytes.len() as f64 && sent < total as f64, "{sent} of {total}");
}

#[test]
fn a_store_that_is_stopped_is_told_once_and_the_manager_delivers() {
    let (place, mut store) = stored_town();
    store.stop();
    let mut fixture = Fixture::start(place, &wall(&[STORE]), &store.environment());
    check("stopped", &fixture.picture(), expected(), &IDENTICAL);
    let warning = fixture.warning();
    assert!(warning.contains(STORE) && warning.contains("refused"), "{warning}");
    assert!(warning.contains("AWS_ENDPOINT"), "{warning}");
    assert_eq!(fixture.told(), 1);
    // A store that works is no matter for a warning any more.
    let store = S3Server::start(&fixture.local.place.path("s3"));
    fixture.restart_server(&store.environment());
    check("started", &fixture.picture(), expected(), &IDENTICAL);
    assert!(fixture.local.client().status().expect("status").warnings.is_empty());
}

#[test]
fn a_store_that_refuses_is_asked_once_and_the_manager_delivers() {
    let (place, store) = stored_town();
    let before = store.requests();
    let mut environment = store.environment();
    environment[4].1 = "another-secret";
    let fixture = Fixture::start(place, &wall(&[STORE]), &environment);
    check("refused", &fixture.picture(), expected(), &IDENTICAL);
    let warning = fixture.warning();
    assert!(warning.contains(STORE) && warning.contains("SignatureDoesNotMatch"), "{warning}");
    assert!(warning.contains("AWS_SECRET_ACCESS_KEY"), "{warning}");
    assert!(!warning.contains("another-secret") && !warning.contains("operator"), "{warning}");
    assert_eq!((fixture.told(), store.requests() - before), (1, 1));
}

#[test]
fn folders_and_stores_together_hold_a_scene() {
    let (place, store) = stored_town();
    let half = place.path("half");
    let objects = blobs_in(&store.objects("blobs"));
    for object in objects.iter().step_by(2) {
        let folder = half.join(object.parent().expect("a folder").file_name().expect("a name"));
        fs::create_dir_all(&folder).expect("made");
        fs::rename(object, folder.join(object.file_name().expect("a name"))).expect("moved");
    }
    let folder = half.to_str().expect("text");
    let empty = "s3://walls/empty";
    let fixture = Fixture::start(place, &wall(&[empty, folder, STORE]), &store.environment());
    check("half and half", &fixture.picture(), expected(), &IDENTICAL);
    assert_eq!((fixture.sent_by_manager(), fixture.told()), (0.0, 0));
}

#[test]
fn a_web_server_with_a_copy_of_the_folder_is_a_store() {
    let (place, store) = stored_town();
    // As somebody's own page may be called.
    fs::create_dir(store.objects("~ann")).expect("made");
    fs::rename(store.objects("blobs"), store.objects("~ann/bücher")).expect("renamed");
    drop(store);
    let store = S3Server::start_open(&place.path("s3"));
    let url = format!("{}/walls/~ann/bücher", store.endpoint);
    let fixture = Fixture::start(place, &wall(&[&url]), &[]);
    check("from the web", &fixture.picture(), expected(), &IDENTICAL);
    assert_eq!((fixture.sent_by_manager(), fixture.told()), (0.0, 0));
}

#[test]
fn an_upload_sends_what_is_missing_and_says_how_much_that_is() {
    let place = TestDir::new();
    let store = S3Server::start(&place.path("s3"));
    let said = bake(&place, &store, STORE).succeeded();
    let objects = blobs_in(&store.objects("blobs"));
    let bytes: u64 = objects.iter().map(|file| fs::metadata(file).expect("there").len()).sum();
    let count = objects.len();
    let expected = format!("uploaded to {STORE}: {count} blobs of {bytes} bytes sent, 0 there");
    assert!(said.contains(&expected), "{said}");
    // They are the folder's files.
    for object in &objects {
        let name = object.strip_prefix(store.objects("blobs")).expect("below it");
        let file = place.path("baked/blobs").join(name);
        assert_eq!(fs::read(file).expect("there"), fs::read(object).expect("there"));
    }
    fs::remove_file(&objects[3]).expect("removed");
    let cut = fs::File::options().write(true).open(&objects[5]).expect("opened");
    cut.set_len(10).expect("cut");
    let said = bake(&place, &store, STORE).succeeded();
    assert!(
        said.contains("2 blobs of ") && said.contains(&format!("{} there", count - 2)),
        "{said}"
    );
    let said = bake(&place, &store, STORE).succeeded();
    assert!(said.contains(&format!("0 blobs of 0 bytes sent, {count} there")), "{said}");

    let mut environment = store.environment();
    environment[4].1 = "another-secret";
    let refused = bake_with(&place, &environment, STORE);
    refused.failed(&[STORE, "403", "AWS_SECRET_ACCESS_KEY"]);
    let folder = bake(&place, &store, "baked/blobs");
    folder.failed(&["--upload", "no URL", "s3://BUCKET/PREFIX"]);
    let said = bake(&place, &store, "s3://key:hidden@walls/blobs");
    let said = said.failed(&["--upload", "password", "AWS_SECRET_ACCESS_KEY"]);
    assert!(!said.contains("hidden"), "{said}");
}
