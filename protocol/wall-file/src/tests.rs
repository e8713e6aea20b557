//! Wall files, good and bad: each mistake has its own words, its place and its remedy.

mod adjusted;
mod curved;
mod devices;
pub(crate) mod generated;
mod launch;
mod meaning;
pub(crate) mod random;
mod reference;
mod shape;
mod slips;

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::limits::SHARED_CANVAS_SIDE_MAX;
use polyptych_wall::{DeadlinePolicy, FrustumMode, Wall};

use super::{load, parse, schema, to_toml};

/// A wall that leaves everything out that can be left out.
const SMALLEST: &str = r#"[wall]
name = "w"
[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
[screen.tiles]
pixels = [200, 100]
"#;

/// Two channels by hand.
const BY_HAND: &str = r#"[wall]
name = "w"
[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
pixels = [200, 100]
[[screen.channel]]
name = "a"
origin = [0, 0]
pixels = [100, 100]
[[screen.channel]]
name = "b"
origin = [100, 0]
pixels = [100, 100]
server = "pc"
"#;

/// Curved screens, projectors, files, and a channel with everything that can be adjusted.
const EVERY_KEY: &str = include_str!("tests/every-key.toml");

fn read(text: &str) -> Wall {
    parse(text, "/walls/w.toml".as_ref()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// The one way in which bad files are tested: what the error says, without the path before it.
#[track_caller]
fn check(text: &str, expected: &str) {
    let Err(error) = parse(text, "w.toml".as_ref()) else { panic!("no error in\n{text}") };
    assert_eq!(error.path(), Path::new("w.toml"));
    assert!(error.line() >= 1 && error.column() >= 1, "{error}");
    assert!(!error.what().is_empty() && !error.remedy().is_empty(), "{error}");
    let text = error.to_string();
    let found = text.strip_prefix("w.toml:").unwrap();
    assert!(found.starts_with(expected), "\n   found {found}\nexpected {expected}");
}

/// The error of a bad file as a person reads it.
#[track_caller]
fn error(text: &str) -> String {
    let Err(error) = parse(text, "w.toml".as_ref()) else { panic!("no error in\n{text}") };
    error.to_string()
}

/// [`check`] of a good file with one thing changed.
#[track_caller]
fn check_changed(good: &str, from: &str, to: &str, expected: &str) {
    assert!(good.contains(from), "there is no {from:?} in\n{good}");
    check(&good.replacen(from, to, 1), expected);
}

fn configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs")
}

fn config(name: &str) -> Wall {
    load(&configs().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn the_smallest_wall_has_the_defaults() {
    let wall = read(SMALLEST);
    assert_eq!(wall.eye, DVec3::ZERO);
    assert_eq!((wall.near_m, wall.samples, wall.heartbeat_ms), (0.05, 1, 2000));
    assert_eq!(wall.deadline, DeadlinePolicy { factor: 4.0, min_ms: 50, max_ms: 2000 });
    assert_eq!(wall.listen, "127.0.0.1:7878");
    assert_eq!((wall.stores.len(), wall.scenes.as_slice()), (0, &["/walls".to_owned()][..]));
    let screen = &wall.screens[0];
    let plane = screen.plane().expect("a plane");
    assert_eq!(plane.lower_left, DVec3::new(-1.0, -0.5, -1.0));
    assert_eq!(plane.lower_right, DVec3::new(1.0, -0.5, -1.0));
    assert_eq!(plane.upper_left, DVec3::new(-1.0, 0.5, -1.0));
    assert_eq!((screen.canvas, screen.bezel), (UVec2::new(200, 100), None));
    let [channel] = wall.channels.as_slice() else { panic!("{:?}", wall.channels) };
    assert_eq!((channel.name.as_str(), channel.server.as_str()), ("front", "front"));
    assert_eq!((channel.origin, channel.size), (UVec2::ZERO, UVec2::new(200, 100)));
    assert_eq!(channel.projection, FrustumMode::Shared);
}

#[test]
fn tiles_are_named_by_column_and_row_and_bezels_are_even_pixels() {
    let tiles = "columns = 3\nrows = 2\nbezel = [0.1, 0.031]\n";
    let wall = read(&format!("{SMALLEST}{tiles}"));
    let names: Vec<&str> = wall.channels.iter().map(|c| c.name.as_str()).collect();
    let expected = ["front-1-1", "front-2-1", "front-3-1", "front-1-2", "front-2-2", "front-3-2"];
    assert_eq!(names, expected);
    // 1.8 m for 600 pixels: 3 mm each, 33.3 for the bezel; 0.969 m for 200, 6.4 for the bezel.
    let screen = &wall.screens[0];
    let bezel = screen.bezel.unwrap();
    assert_eq!((bezel.asked_m, bezel.pixels), (DVec2::new(0.1, 0.031), UVec2::new(34, 6)));
    assert_eq!(screen.canvas, UVec2::new(668, 206));
    assert_eq!(wall.channels[5].origin, UVec2::new(468, 106));
}

#[test]
fn names_and_servers_of_tiles_may_be_listed() {
    let tiles = "columns = 2\nnames = [\"a\", \"b\"]\nservers = [\"pc\", \"pc\"]\n";
    let wall = read(&format!("{SMALLEST}{tiles}"));
    assert_eq!((wall.channels[1].name.as_str(), wall.channels[1].server.as_str()), ("b", "pc"));
}

#[test]
fn hidden_parts_need_no_channel() {
    let gap = BY_HAND.replace("[100, 0]", "[104, 0]").replace("[200, 100]", "[204, 100]");
    let hidden = "[[screen.hidden]]\norigin = [100, 0]\npixels = [4, 100]\n";
    assert_eq!(read(&format!("{gap}{hidden}")).channels[1].origin, UVec2::new(104, 0));
}

#[test]
fn turned_screens_stand_where_the_document_says() {
    let corners = |rotation: &str| {
        let place = format!("center = [0.0, 0.0, 0.0]\nrotation = {rotation}");
        let eye = "name = \"w\"\neye = [9.0, 9.0, 9.0]";
        let text = SMALLEST.replace("center = [0.0, 0.0, -1.0]", &place);
        let text = text.replacen("name = \"w\"", eye, 1);
        let wall = read(&text);
        let plane = wall.screens[0].plane().expect("a plane");
        [plane.lower_left, plane.lower_right, plane.upper_left]
    };
    let (x, y, z) = (DVec3::X, DVec3::Y / 2.0, DVec3::Z);
    // A wall at the viewer's left faces +X: its right edge is farther from the viewer.
    assert_eq!(corners("[90, 0, 0]"), [z - y, -z - y, z + y]);
    // A floor's upper edge is farther from the viewer.
    assert_eq!(corners("[0, -90, 0]"), [-x + z / 2.0, x + z / 2.0, -x - z / 2.0]);
    // Rolled counter-clockwise as the viewer sees it, the right edge goes up.
    assert_eq!(
        corners("[0, 0, 90]"),
        [y * 2.0 * -1.0 + x / 2.0, y * 2.0 + x / 2.0, -y * 2.0 - x / 2.0]
    );
}

#[test]
fn long_canvases_get_frusta_of_their_own() {
    let tiles = format!("{SMALLEST}columns = 50\n");
    assert_eq!(read(&tiles).channels[49].projection, FrustumMode::Own);
    const { assert!(50 * 200 > SHARED_CANVAS_SIDE_MAX) };
    let own = SMALLEST.replace("[screen.tiles]", "projection = \"own\"\n[screen.tiles]");
    assert_eq!(read(&own).channels[0].projection, FrustumMode::Own);
}

#[test]
fn folders_stand_beside_the_wall_file() {
    let storage = "[storage]\nstores = [\"/disk\", \"baked\"]\nscenes = [\".\", \"../scenes\"]\n";
    let wall = read(&format!("{storage}{SMALLEST}"));
    assert_eq!(wall.stores, ["/disk", "/walls/baked"]);
    assert_eq!(wall.scenes, ["/walls", "/walls/../scenes"]);
}

#[test]
fn stores_are_folders_or_urls_of_object_stores() {
    let storage = "[storage]\nstores = [\"baked\", \"S3://walls/town/\", \"https://h:8/a\"]\n";
    let wall = read(&format!("{storage}{SMALLEST}"));
    assert_eq!(wall.stores, ["/walls/baked", "s3://walls/town", "https://h:8/a"]);
    for (stores, key, what, remedy) in [
        ("\"a\", \"ftp://h/a\"", "storage.stores[1]", "\"ftp\"", "s3://BUCKET/PREFIX"),
        ("\"s3:///a\"", "storage.stores[0]", "names no bucket", "s3://BUCKET/PREFIX"),
        ("\"s3://k:hidden@b\"", "storage.stores[0]", "password", "AWS_SECRET_ACCESS_KEY"),
        ("\"\"", "storage.stores[0]", "no folder", "write a path"),
    ] {
        let text = format!("[storage]\nstores = [{stores}]\n{SMALLEST}");
        let error = parse(&text, Path::new("/walls/lab.toml")).expect_err(stores);
        assert_eq!((error.key(), error.line()), (key, 2), "{error}");
        assert!(error.what().contains(what) && error.remedy().contains(remedy), "{error}");
        assert!(!error.to_string().contains("hidden"), "{error}");
    }
}

#[test]
fn every_wall_file_loads_and_survives_a_round_trip() {
    let mut count = 0;
    for entry in std::fs::read_dir(configs()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let wall = load(&path).unwrap_or_else(|error| panic!("{error}"));
            let again = parse(&to_toml(&wall), &path).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(again, wall, "{}", path.display());
            assert_eq!(wall.name, path.file_stem().unwrap().to_str().unwrap());
            let first = std::fs::read_to_string(&path).unwrap();
            assert!(first.starts_with("#:schema ./wall.schema.json\n"), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= 5, "{count} wall files");
}

#[test]
fn three_wall_files_show_the_same_screen() {
    let [single, four, three] =
        ["single.toml", "wall-2x2.toml", "wall-3x1.toml"].map(|name| config(name).screens);
    assert_eq!(single, four);
    assert_eq!(single, three);
    assert_eq!(config("wall-2x2.toml").channels[3].origin, UVec2::new(960, 540));
}

#[test]
fn the_cave_has_four_planes_that_its_eye_sees_off_the_middle() {
    let wall = config("cave-4.toml");
    let distances: Vec<f64> =
        wall.screens.iter().map(|s| s.frustum(wall.eye).unwrap().distance_m).collect();
    let expected = [1.7, 1.8, 1.3, 1.7];
    for (found, expected) in distances.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{distances:?}");
    }
}

#[test]
fn the_schema_in_configs_is_that_of_the_types() {
    let path = configs().join("wall.schema.json");
    if std::env::var_os("UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::write(&path, schema()).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == schema(), "{} is stale: run with UPDATE_GOLDEN=1", path.display());
}

#[test]
fn files_that_cannot_be_read_say_so() {
    let error = load("no/such.toml".as_ref()).unwrap_err();
    let text = error.to_string();
    assert!(text.starts_with("no/such.toml: the file cannot be read: No such file"), "{text}");
    assert_eq!((error.line(), error.key()), (0, ""));
    let folder = tempfile::tempdir().unwrap();
    assert!(load(folder.path()).is_err());
    let path = folder.path().join("w.toml");
    std::fs::write(&path, b"[wall]\nname = \"\xc3\xa9\xff\"\n").unwrap();
    let error = load(&path).unwrap_err();
    assert_eq!((error.line(), error.column()), (2, 10), "{error}");
    std::fs::write(&path, vec![b'#'; super::WALL_FILE_BYTES_MAX + 1]).unwrap();
    assert!(load(&path).unwrap_err().what().starts_with("the file is larger than"));
}
