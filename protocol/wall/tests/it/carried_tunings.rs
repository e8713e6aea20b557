//! Tunings that are carried over to a changed wall.

use glam::{DVec2, DVec3};
use polyptych_files::blob::BlobHash;
use polyptych_wall::calibration_change::carry_over::{CarriedOver, carried_over};
use polyptych_wall::calibration_change::reapply;
use polyptych_wall::{CalibrationFile, CalibrationFileKind, ChannelCalibration, Orientation, Wall};

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
    polyptych_wall_file::parse(text, "w.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Corners and light of both channels of [`WALL`].
fn tunings(wall: &Wall) -> Vec<(String, ChannelCalibration)> {
    let tuned = |name: &str, x: f64| {
        let (_, channel) = wall.channel_by_name(name).expect("a channel");
        let mut adjustment = channel.adjustment.clone();
        adjustment.pin[0] = DVec2::new(x, 1.0);
        adjustment.color.gain = DVec3::splat(0.5);
        (name.to_owned(), adjustment)
    };
    vec![tuned("left", 2.0), tuned("right", 3.0)]
}

/// Returns the outcome for both channels' tunings if the wall file becomes this one.
fn after(new: &Wall) -> CarriedOver {
    let old = parsed(WALL);
    let carried = carried_over(&old, &tunings(&old), new);
    reapply(new, &carried.tunings).expect("valid");
    carried
}

fn names(carried: &CarriedOver) -> Vec<&str> {
    carried.tunings.iter().map(|(name, _)| name.as_str()).collect()
}

#[test]
fn a_moved_eye_and_a_changed_deadline_drop_nothing() {
    let eye = WALL.replace("name = \"w\"", "name = \"w\"\neye = [0.0, 0.5, 0.0]");
    for new in [WALL, &eye, &format!("{WALL}\n[deadline]\nmax_ms = 3000")] {
        let carried = after(&parsed(new));
        assert_eq!(carried.tunings, tunings(&parsed(WALL)));
        assert_eq!((carried.dropped, carried.renamed), (vec![], vec![]));
    }
}

#[test]
fn an_edited_key_drops_its_own_tuning_and_no_other() {
    let pins = "pin = [[9, 0], [0, 0], [0, 0], [0, 0]]";
    let new = parsed(&format!("{WALL}\n[channel.left]\n{pins}"));
    let carried = after(&new);
    let [lost] = &carried.dropped[..] else { panic!("{:?}", carried.dropped) };
    assert_eq!((lost.channel.as_str(), lost.keys.as_str()), ("left", "pin"));
    let left = &carried.tunings[0].1;
    assert_eq!((left.pin[0], left.color.gain), (DVec2::new(9.0, 0.0), DVec3::splat(0.5)));
    assert_eq!(carried.tunings[1], tunings(&parsed(WALL))[1]);
}

#[test]
fn an_edited_edge_leaves_the_tuning_of_another() {
    let old = parsed(WALL);
    let mut tuned = old.channels[0].adjustment.clone();
    (tuned.edges.left, tuned.edges.right) = (Some(7.0), Some(8.0));
    let new = parsed(&format!("{WALL}\n[channel.left]\nedges.left = 5"));
    let carried = carried_over(&old, &[("left".to_owned(), tuned)], &new);
    let [lost] = &carried.dropped[..] else { panic!("{:?}", carried.dropped) };
    assert_eq!((lost.channel.as_str(), lost.keys.as_str()), ("left", "edge.left"));
    let edges = carried.tunings[0].1.edges;
    assert_eq!((edges.left, edges.right), (Some(5.0), Some(8.0)));
}

#[test]
fn a_width_is_lost_to_an_alpha_file_that_says_how_light_fades() {
    let old = parsed(WALL);
    let mut tuned = tunings(&old);
    tuned[0].1.edges.right = Some(8.0);
    let alpha = "alpha = \"a.png\"\nramps = \"alpha\"";
    let new = parsed(&format!("{WALL}\n[channel.left]\n{alpha}"));
    let carried = carried_over(&old, &tuned, &new);
    let [lost] = &carried.dropped[..] else { panic!("{:?}", carried.dropped) };
    assert_eq!((lost.channel.as_str(), lost.keys.as_str()), ("left", "edge.right"));
    assert!(lost.reason.contains("alpha file"), "{lost:?}");
    assert_eq!(names(&carried), ["left", "right"]);
    // As the wall is saved, with the tunings of both.
    let tuned = reapply(&new, &carried.tunings).expect("valid");
    assert_eq!(parsed(&polyptych_wall_file::to_toml(&tuned)).channels, tuned.channels);
    // One that comes with both, of a channel that is not known, is refused as files are.
    let mut both = carried.tunings;
    both[0].1.edges.right = Some(8.0);
    assert!(reapply(&new, &both).expect_err("twice").contains("twice"));
}

#[test]
fn a_tuning_that_was_saved_into_the_file_is_no_tuning_any_more() {
    let new = reapply(&parsed(WALL), &tunings(&parsed(WALL))).expect("valid");
    assert_eq!(after(&new), CarriedOver::default());
}

#[test]
fn a_channel_with_another_picture_keeps_its_light_only() {
    let narrow =
        WALL.replace("[200, 50]", "[180, 50]").replace("= [100, 50]\n    [[", "= [80, 50]\n    [[");
    let narrow = narrow.replace("origin = [100, 0]", "origin = [80, 0]");
    let turned = format!("{WALL}\n[channel.left]\nturn = \"half\"");
    for (new, reason) in [(narrow, "80 × 50 pixels now, and had 100 × 50"), (turned, "turn")] {
        let carried = after(&parsed(&new));
        let [lost] = &carried.dropped[..] else { panic!("{:?}", carried.dropped) };
        assert_eq!((lost.channel.as_str(), lost.keys.as_str()), ("left", "pin"));
        assert!(lost.reason.contains(reason), "{lost:?}");
        assert_eq!(carried.tunings[0].1.pin[0], DVec2::ZERO);
        assert_eq!(carried.tunings[0].1.color.gain, DVec3::splat(0.5));
        assert_eq!(carried.tunings[1], tunings(&parsed(WALL))[1], "the neighbour has all");
    }
}

#[test]
fn a_warp_file_of_other_content_drops_corners_and_one_of_another_name_does_not() {
    let warped = |path: &str, content: u8| {
        let mut wall = parsed(WALL);
        wall.files.push(CalibrationFile {
            path: path.into(),
            kind: CalibrationFileKind::Warp,
            blob: Some(BlobHash([content; 32])),
            is_for_one_eye: false,
            front: Vec::new(),
        });
        wall.channels[0].adjustment.warp = Some(0);
        wall
    };
    let old = warped("a.pfm", 1);
    let after = |new: &Wall| carried_over(&old, &tunings(&old), new);
    assert_eq!(after(&warped("../b.pfm", 1)).tunings, tunings(&old));
    let carried = after(&warped("a.pfm", 2));
    assert_eq!((carried.dropped.len(), carried.dropped[0].keys.as_str()), (1, "pin"));
    assert!(carried.dropped[0].reason.contains("warp file"), "{carried:?}");
}

#[test]
fn a_removed_channel_drops_its_own_tunings_and_a_renamed_one_keeps_them() {
    let at = WALL.find("[[screen.channel]]\n    name = \"right\"").expect("there");
    let carried = after(&parsed(&WALL[..at].replace("[200, 50]", "[100, 50]")));
    assert_eq!(names(&carried), ["left"]);
    let [lost] = &carried.dropped[..] else { panic!("{:?}", carried.dropped) };
    assert_eq!((lost.channel.as_str(), lost.keys.as_str()), ("right", "pin, gain"));

    let carried = after(&parsed(&WALL.replace("\"right\"", "\"rechts\"")));
    assert_eq!((names(&carried), &carried.dropped[..]), (vec!["left", "rechts"], &[][..]));
    assert_eq!(carried.renamed, [("right".to_owned(), "rechts".to_owned())]);
    assert_eq!(carried.tunings[1].1, tunings(&parsed(WALL))[1].1);
    // Of two channels that could be either nothing is guessed: both lie in the same place.
    let twins =
        WALL.replace("origin = [100, 0]", "origin = [0, 0]").replace("[200, 50]", "[100, 50]");
    let eyes = |text: &str| text.replace("\"left\"", "\"a\"").replace("\"right\"", "\"b\"");
    let eyed = "\n[channel.left]\neye = \"left\"\n[channel.right]\neye = \"right\"";
    let old = parsed(&format!("{twins}{eyed}"));
    let eyed = eyed.replace("l.left]", "l.a]").replace("l.right]", "l.b]");
    let new = parsed(&format!("{}{eyed}", eyes(&twins)));
    let renamed = carried_over(&old, &[], &new).renamed;
    assert_eq!(renamed.len(), 2, "told apart by their eyes: {renamed:?}");
    assert_eq!(renamed[0], ("left".to_owned(), "a".to_owned()));
}

#[test]
fn an_added_channel_changes_nothing_for_the_others() {
    let added = WALL.replace("[200, 50]", "[300, 50]");
    let more = "[[screen.channel]]\nname = \"more\"\norigin = [200, 0]\npixels = [100, 50]";
    let carried = after(&parsed(&format!("{added}\n{more}")));
    assert_eq!((names(&carried), carried.dropped.len()), (vec!["left", "right"], 0));
}

#[test]
fn an_unknown_channel_that_hangs_otherwise_loses_its_tuning() {
    let mut new = parsed(WALL);
    new.channels[0].adjustment.turn = Orientation::Half;
    let carried = carried_over(&Wall::new("w", vec![], vec![]), &tunings(&parsed(WALL)), &new);
    assert_eq!(names(&carried), ["right"]);
    assert_eq!(carried.dropped[0].keys, "pin, gain");
}

#[test]
fn a_tuning_that_the_wall_refuses_is_dropped_with_the_reason() {
    let wall = parsed(WALL);
    let mut tunings = tunings(&wall);
    tunings[0].1.color.gain.x = f64::NAN;
    let carried = carried_over(&wall, &tunings, &wall);
    assert_eq!(names(&carried), ["right"], "{:?}", carried.dropped);
    assert!(carried.dropped[0].reason.contains("gain"), "{:?}", carried.dropped);
}
