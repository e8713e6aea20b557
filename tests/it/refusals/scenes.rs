//! Scenes that can't be shown: the wall goes on showing the one before.

use std::os::unix::fs::symlink;
use std::path::Path;

use polyptych_client::blocking::Client;
use polyptych_client::{Capture, WallStatus};
use serde_json::json;

use crate::harness::local_wall::{LocalWall, shot, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, poses, town};

/// A wall that shows something, and what it shows.
struct Stage {
    scenes: TestDir,
    local: LocalWall,
    client: Client,
    status: WallStatus,
    capture: Capture,
}

impl Stage {
    fn new() -> Self {
        let scenes = TestDir::new();
        let folder = scenes.path("scenes");
        std::fs::create_dir(&folder).expect("a folder");
        let local = LocalWall::start(&small(2, 1), &[town().parent().expect("one"), &folder]);
        let client = local.client();
        let scene = client.open_scene("town.glb").expect("opened");
        let capture = shot(&client, poses(&scene.bounds.expect("bounds"))[4]);
        let status = client.status().expect("a status");
        Self { scenes, local, client, status, capture }
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        self.scenes.write(&format!("scenes/{name}"), bytes);
    }

    /// The file is refused with a message that has all these parts, and nothing has changed.
    #[track_caller]
    fn refuses(&self, path: &str, parts: &[&str]) {
        let name = Path::new(path).file_name().expect("a name").to_string_lossy();
        let said = self.local.run(&["open", path]).failed(parts);
        assert!(said.contains(&*name), "{said:?} names no file");
        let status = self.client.status().expect("a status");
        assert_eq!(
            (status.revision, status.digest, &status.scene),
            (self.status.revision, self.status.digest, &self.status.scene),
            "{path}"
        );
        let capture = self.client.capture().expect("a picture");
        assert_eq!(capture.missing, [], "{path}");
        assert!(capture.channels == self.capture.channels, "{path}: the picture has changed");
    }
}

#[test]
fn files_that_are_no_scene_leave_the_wall_as_it_was() {
    let stage = Stage::new();
    stage.refuses("gone.glb", &["not found", "scene folders"]);
    stage.write("picture.glb", b"\x89PNG\r\n\x1a\n and so on");
    stage.refuses("picture.glb", &["not glTF"]);
    stage.write("empty.gltf", b"");
    stage.refuses("empty.gltf", &["not glTF"]);
    let whole = Gltf::triangle().glb();
    stage.write("short.glb", &whole[..whole.len() - 7]);
    stage.refuses("short.glb", &["truncated"]);
    stage.write("nobuffer.gltf", Gltf::triangle().gltf("gone.bin"));
    stage.refuses("nobuffer.gltf", &["gone.bin", "buffers[0]"]);
    let beyond = Gltf::triangle().with(|gltf| gltf.bin[36..40].copy_from_slice(&[7, 0, 0, 0]));
    stage.write("index.glb", beyond.glb());
    stage.refuses("index.glb", &["index 0 is 7", "3 vertices"]);
    let accessor = Gltf::triangle().with(|gltf| gltf.json["nodes"][0]["mesh"] = json!(5));
    stage.write("mesh.glb", accessor.glb());
    stage.refuses("mesh.glb", &["nodes[0].mesh", "meshes[5]"]);
    let nan = f32::NAN.to_le_bytes();
    stage.write("nan.glb", Gltf::triangle().with(|g| g.bin[0..4].copy_from_slice(&nan)).glb());
    stage.refuses("nan.glb", &["POSITION", "finite"]);
    let nodes = json!([{ "mesh": 0, "children": [1] }, { "name": "b", "children": [0] }]);
    stage.write("cycle.glb", Gltf::triangle().with(|gltf| gltf.json["nodes"] = nodes).glb());
    stage.refuses("cycle.glb", &["cycle"]);
    let required = json!(["ACME_shape"]);
    let unknown = Gltf::triangle().with(|gltf| gltf.json["extensionsRequired"] = required);
    stage.write("unknown.glb", unknown.glb());
    stage.refuses("unknown.glb", &["ACME_shape"]);
    // The same file without a fault is shown.
    stage.write("good.glb", Gltf::triangle().glb());
    stage.local.run(&["open", "good.glb"]).succeeded();
    assert_ne!(stage.client.status().expect("a status").revision, stage.status.revision);
}

#[test]
fn files_outside_the_scene_folders_are_not_opened() {
    let stage = Stage::new();
    let outside = stage.scenes.write("outside.glb", Gltf::triangle().glb());
    let outside_parts = ["outside the manager's scene folders"];
    stage.refuses(&outside.display().to_string(), &outside_parts);
    stage.refuses("../outside.glb", &outside_parts);
    symlink(&outside, stage.scenes.path("scenes/linked.glb")).expect("a link");
    stage.refuses("linked.glb", &outside_parts);
    symlink(stage.scenes.folder(), stage.scenes.path("scenes/folder")).expect("a link");
    stage.refuses("folder/outside.glb", &outside_parts);
    // What a scene names must lie in its folder as well, however it is written.
    stage.scenes.write("outside.bin", &Gltf::triangle().bin);
    let linked = stage.scenes.path("scenes/linked.bin");
    symlink(stage.scenes.path("outside.bin"), linked).expect("a link");
    let absolute = stage.scenes.path("outside.bin").display().to_string();
    for uri in ["../outside.bin", "%2e%2e/outside.bin", "linked.bin", &absolute] {
        stage.write("reaching.gltf", Gltf::triangle().gltf(uri));
        stage.refuses("reaching.gltf", &["buffers[0]", "bin"]);
    }
    let textured = |uri: &str| {
        let textured = Gltf::triangle().with(|gltf| {
            let texture = json!({ "baseColorTexture": { "index": 0 } });
            gltf.json["materials"] = json!([{ "pbrMetallicRoughness": texture }]);
            gltf.json["textures"] = json!([{ "source": 0 }]);
            gltf.json["images"] = json!([{ "uri": uri }]);
            gltf.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        });
        stage.write("picture.glb", textured.glb());
    };
    for uri in ["../outside.bin", "%2E%2e%2Foutside.bin", "a/../../outside.bin", "linked.bin"]
        .into_iter()
        .chain(["folder/outside.bin", &absolute])
    {
        textured(uri);
        stage.refuses("picture.glb", &["images[0]", "leads out of the scene's folder"]);
    }
    stage.write("fetching.gltf", Gltf::triangle().gltf("http://127.0.0.1:9/a.bin"));
    stage.refuses("fetching.gltf", &["http", "buffers[0]"]);
}

/// Files without an end, and pipes without a writer, must not hold the baker.
#[test]
fn files_that_are_no_files_are_refused_at_once() {
    let stage = Stage::new();
    let path = |name: &str| stage.scenes.path(&format!("scenes/{name}"));
    let made = std::process::Command::new("mkfifo").arg(path("pipe.glb")).status();
    assert!(made.expect("mkfifo runs").success());
    symlink("pipe.glb", path("pipe.bin")).expect("a link");
    symlink("/dev/zero", path("zero.bin")).expect("a link");
    symlink("loop.bin", path("loop.bin")).expect("a link");
    symlink("back.glb", path("forth.glb")).expect("a link");
    symlink("forth.glb", path("back.glb")).expect("a link");
    std::fs::create_dir(path("folder.bin")).expect("a folder");
    symlink(".", path("here")).expect("a link");

    stage.refuses("pipe.glb", &["not a file"]);
    stage.refuses("forth.glb", &["not found"]);
    for (uri, fault) in [
        ("pipe.bin", "not a file"),
        ("folder.bin", "not a file"),
        ("zero.bin", "leads out of the scene's folder"),
        ("loop.bin", "can't be found"),
        ("%00.bin", "buffers[0]"),
    ] {
        stage.write("reaching.gltf", Gltf::triangle().gltf(uri));
        stage.refuses("reaching.gltf", &["buffers[0]", fault]);
    }
    // A link that stays inside is as good as the file.
    stage.write("a.bin", &Gltf::triangle().bin);
    stage.write("inside.gltf", Gltf::triangle().gltf("here/here/a.bin"));
    stage.local.run(&["open", "inside.gltf"]).succeeded();
}
