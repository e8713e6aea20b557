//! A wall file that is written back: its comments stay, and it says what the wall is.

use polyptych_client::calibration_change::{
    CalibrationChange, Corner, Edge, Offset, apply_changes,
};
use polyptych_client::glam::UVec2;

use super::*;

const TEXT: &str = r#"# The lab's wall.
[wall]
name = "lab"

[[screen]]   # one for both
name = "front"
size = [3.2, 0.9]
center = [0.0, 0.0, -2.0]
[screen.tiles]
columns = 2
pixels = [1600, 900]   # each

# The left one is older.
[channel.front-1-1]
gain = [1.0, 0.5, 1.0]   # measured on Monday
edges = { left = 4.0, right = 60.0 }

[network]
listen = "127.0.0.1:0"  # at the end
"#;

fn path() -> &'static Path {
    Path::new("lab.toml")
}

fn wall(text: &str) -> Wall {
    polyptych_wall_file::parse(text, path()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn tuned(channel: &str, keys: &[&str]) -> TunedChannel {
    let keys = keys.iter().map(|key| (*key).to_owned()).collect();
    TunedChannel { channel: channel.to_owned(), keys }
}

/// The text with all of the running wall's adjustments, and the channels that did not have them.
fn saved(text: &str, running: &Wall) -> anyhow::Result<(String, Vec<String>)> {
    let keys = ["pin", "bend", "edge.left", "edge.right", "gain", "matrix", "leak", "gamma"];
    let tunings: Vec<_> = running.channels.iter().map(|of| tuned(&of.name, &keys)).collect();
    let merged = with_adjustments(text, path(), running, &tunings)?;
    Ok((merged.text, merged.channels))
}

#[test]
fn what_is_tuned_is_written_and_comments_stay() {
    let changes = [
        CalibrationChange::Gain(DVec3::new(1.0, 0.9, 1.0)),
        CalibrationChange::Edge { side: Edge::Right, width: Some(120.5) },
        CalibrationChange::Edge { side: Edge::Left, width: None },
    ];
    let running = apply_changes(&wall(TEXT), "front-1-1", &changes).expect("tuned");
    let changes = [
        CalibrationChange::Pin { corner: Corner::LowerLeft, to: Offset::To(DVec2::new(-1.5, 0.1)) },
        CalibrationChange::Grid(Some(UVec2::new(3, 2))),
        CalibrationChange::Bend { column: 1, row: 0, to: Offset::To(DVec2::new(0.3, -7.25)) },
        CalibrationChange::Gamma(Some(DVec3::splat(2.2))),
        CalibrationChange::Leak(Some(DVec3::splat(0.004))),
        CalibrationChange::Matrix(DMat3::from_cols_array(&[
            1.0, 0.1, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 1.0,
        ])),
    ];
    let running = apply_changes(&running, "front-2-1", &changes).expect("tuned");
    let (text, names) = saved(TEXT, &running).expect("written");
    assert_eq!(names, ["front-1-1", "front-2-1"]);
    let expected = TEXT
        .replace("[1.0, 0.5, 1.0]   #", "[1.0, 0.9, 1.0]   #")
        .replace("{ left = 4.0, right = 60.0 }", "{ right = 120.5 }");
    assert!(text.starts_with(&expected[..expected.find("[network]").expect("there")]), "{text}");
    for comment in TEXT.lines().filter_map(|line| line.split_once('#').map(|(_, what)| what)) {
        assert!(text.contains(comment), "{comment:?} is lost:\n{text}");
    }
    assert_eq!(wall(&text).channels, running.channels);
    let (again, names) = saved(&text, &running).expect("written");
    assert_eq!((again, names.len()), (text, 0), "nothing is left to write");
}

#[test]
fn what_is_tuned_back_is_taken_out() {
    let plain = wall(&TEXT.replace("gain = [1.0, 0.5, 1.0]   # measured on Monday\n", ""));
    let changes = [
        CalibrationChange::Pin { corner: Corner::UpperLeft, to: Offset::To(DVec2::ONE) },
        CalibrationChange::Grid(Some(UVec2::splat(2))),
        CalibrationChange::Gamma(Some(DVec3::new(2.0, 2.1, 2.2))),
    ];
    let running = apply_changes(&plain, "front-2-1", &changes).expect("tuned");
    let before = TEXT.replace("gain = [1.0, 0.5, 1.0]   # measured on Monday\n", "");
    let (text, _) = saved(&before, &running).expect("written");
    let back = [CalibrationChange::Grid(None), CalibrationChange::Gamma(None)];
    let running = apply_changes(&running, "front-2-1", &back).expect("tuned");
    let (text, _) = saved(&text, &running).expect("written");
    assert!(!text.contains("bend") && !text.contains("gamma"), "{text}");
    assert_eq!(wall(&text).channels, running.channels);
}

#[test]
fn hand_edits_of_what_nobody_tuned_stay() {
    let loaded = wall(TEXT);
    let changes = [CalibrationChange::Edge { side: Edge::Right, width: Some(120.5) }];
    let running = apply_changes(&loaded, "front-1-1", &changes).expect("tuned");
    let edited = TEXT.replace("gain = [1.0, 0.5, 1.0]", "gain = [1.0, 0.7, 1.0]");
    let edited = edited.replace("left = 4.0, right = 60.0", "left = 6.0, right = 60.0");
    let edited = format!("{edited}[channel.front-2-1]\ngamma = 2.4\n");
    let tunings = [tuned("front-1-1", &["edge.right"])];
    let merged = with_adjustments(&edited, path(), &running, &tunings).expect("written");
    assert_eq!(merged.text, edited.replace("right = 60.0", "right = 120.5"));
    assert_eq!(merged.channels, ["front-1-1"]);
    assert_eq!(merged.changes, ["front-1-1: edge.right was 60 in the file, is 120.5 now"]);
    let kept: Vec<_> =
        merged.kept.iter().filter_map(|line| line.split_once(" in the file; it is ")).collect();
    let rest = |value: &str| format!("{value} on the wall, where nobody tuned it");
    let (left, gain, gamma) = (rest("4"), rest("[1.0, 0.5, 1.0]"), rest("srgb"));
    assert_eq!(
        kept,
        [
            ("front-1-1: edge.left stays 6", left.as_str()),
            ("front-1-1: gain stays [1.0, 0.7, 1.0]", gain.as_str()),
            ("front-2-1: gamma stays 2.4", gamma.as_str()),
        ]
    );
    // Tuned, saved, and tuned back: the wall is as it was loaded, and the file is not.
    let tunings = [tuned("front-1-1", &["gain"])];
    let merged = with_adjustments(&edited, path(), &loaded, &tunings).expect("written");
    assert_eq!(merged.text, edited.replace("[1.0, 0.7, 1.0]", "[1.0, 0.5, 1.0]"));
}

#[test]
fn an_edge_without_a_ramp_is_written() {
    let text = TEXT.replace("columns = 2\n", "columns = 2\noverlap = [96, 0]\n");
    let changes = [CalibrationChange::Edge { side: Edge::Right, width: Some(0.0) }];
    let running = apply_changes(&wall(&text), "front-1-1", &changes).expect("tuned");
    let (written, _) = saved(&text, &running).expect("written");
    assert_eq!(written, text.replace("right = 60.0", "right = 0.0"));
    assert_eq!(wall(&written).channels, running.channels);
}

#[test]
fn a_file_of_another_wall_is_left_alone() {
    let running = wall(TEXT);
    for (text, said) in [
        (TEXT.replace("\"lab\"", "\"attic\""), "its name is \"attic\", not \"lab\""),
        (TEXT.replace("[3.2, 0.9]", "[3.2, 0.91]"), "its screens are others"),
        (TEXT.replace("[channel.front-1-1]", "[channel.front-1-1]\nmirror = true"), "front-1-1"),
    ] {
        let refused = saved(&text, &running).expect_err("refused").to_string();
        assert!(refused.contains("another wall than the one that runs"), "{refused}");
        assert!(refused.contains(said), "{refused}");
    }
}
