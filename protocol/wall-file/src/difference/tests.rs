//! Walls that are the same, and what differs between others.

use polyptych_files::blob::BlobHash;

use super::*;

const WALL: &str = r#"
    [wall]
    name = "w"
    [[screen]]
    name = "front"
    size = [4.0, 1.0]
    center = [0.0, 0.0, -2.0]
    pixels = [200, 50]
    [[screen.channel]]
    name = "left"
    origin = [0, 0]
    pixels = [100, 50]
    [[screen.channel]]
    name = "right"
    origin = [100, 0]
    pixels = [100, 50]
"#;

fn parsed(text: &str) -> Wall {
    crate::parse(text, "w.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

fn lines(new: &str) -> Vec<String> {
    let not_set = || "-".to_owned();
    let line = |KeyChange { key, old, new }: KeyChange| {
        format!("{key}: {} to {}", old.unwrap_or_else(not_set), new.unwrap_or_else(not_set))
    };
    differences(&parsed(WALL), &parsed(new)).into_iter().map(line).collect()
}

#[test]
fn a_wall_file_in_another_folder_is_the_same_wall() {
    let elsewhere = crate::parse(WALL, "../other/folder/w.toml".as_ref());
    let elsewhere = elsewhere.unwrap_or_else(|error| panic!("{error}"));
    let here = parsed(WALL);
    assert_ne!(here, elsewhere, "the folder of its scenes is another");
    assert_eq!(here.without_paths(), elsewhere.without_paths());
    assert_eq!(differences(&here, &elsewhere), []);
}

#[test]
fn files_are_known_by_their_content() {
    let mut here = parsed(&format!("{WALL}\n[channel.left]\nalpha = \"a.png\"\n"));
    here.files[0].blob = Some(BlobHash([7; 32]));
    let mut moved = here.clone();
    moved.files[0].path = "/elsewhere/b.png".into();
    assert_eq!(differences(&here, &moved), []);
    moved.files[0].blob = Some(BlobHash([8; 32]));
    let [change] = &differences(&here, &moved)[..] else { panic!("one change") };
    assert_eq!(change.key, "channel.left.alpha");
}

#[test]
fn every_changed_key_is_named_with_both_values() {
    assert_eq!(lines(WALL), <[String; 0]>::default());
    assert_eq!(
        lines(&WALL.replace("name = \"w\"", "name = \"w\"\neye = [0.0, 0.5, 0.0]")),
        ["wall.eye: [0.0, 0.0, 0.0] to [0.0, 0.5, 0.0]"]
    );
    assert_eq!(
        lines(&format!("{WALL}\n[channel.left]\ngain = 0.5\n[deadline]\nmax_ms = 3000\n")),
        ["channel.left.gain: - to 0.5", "deadline.max_ms: 2000 to 3000"]
    );
}

#[test]
fn channels_are_compared_by_name_and_one_that_is_gone_is_one_change() {
    let right = WALL.find("[[screen.channel]]\n    name = \"right\"").expect("there");
    let left = WALL.find("[[screen.channel]]").expect("there");
    let swapped = [&WALL[..left], &WALL[right..], &WALL[left..right]].concat();
    assert_eq!(lines(&swapped), <[String; 0]>::default());
    let alone = lines(&WALL[..right].replace("[200, 50]", "[100, 50]"));
    let keys: Vec<_> = alone.iter().filter_map(|line| line.split(": ").next()).collect();
    assert_eq!(keys, ["screen.front.channel.right", "screen.front.pixels"], "{alone:?}");
    assert!(alone[0].ends_with(" to -"), "{alone:?}");
}

#[test]
fn long_values_are_cut() {
    let moves = "[0.1, 0.1], ".repeat(100);
    let bend = format!("{WALL}\n[channel.left]\nbend = {{ points = [10, 10], moves = [{moves}] }}");
    let lines = lines(&bend);
    let line =
        lines.iter().find(|line| line.starts_with("channel.left.bend.moves")).expect("there");
    assert!(line.chars().count() < VALUE_CHARS_MAX + 40 && line.ends_with('…'), "{line}");
}
