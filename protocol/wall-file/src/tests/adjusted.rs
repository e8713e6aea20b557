//! Tests of a channel's keys that do not depend on how it was made, right and wrong.

use glam::{DMat3, DVec2, DVec3, UVec2};
use polyptych_wall::channel_calibration::{BlendWidths, ControlGrid, TransferFunction};
use polyptych_wall::{
    BlendConfig, CalibrationFileKind, ChannelKind, FrustumMode, Orientation, Ramps, ShadowFilter,
    StereoMode, StereoPacking, StereoRule,
};

use super::{BY_HAND, EVERY_KEY, SMALLEST, check, parse, read, to_toml};

fn front(lines: &str) -> String {
    format!("{SMALLEST}[channel.front]\n{lines}\n")
}

#[test]
fn every_key_arrives() {
    let wall = read(EVERY_KEY);
    assert_eq!((wall.eye_separation_m, wall.dither), (0.065, true));
    assert_eq!((wall.shadows, read(SMALLEST).shadows), (ShadowFilter::Hard, ShadowFilter::Soft));
    let stereo = StereoRule { mode: StereoMode::Omnidirectional, error_max_px: 0.25 };
    assert_eq!(wall.stereo, stereo);
    assert_eq!(wall.blend, BlendConfig { exponent: 1.5, leak: 0.003 });
    let found = &wall.channels[0].adjustment;
    assert_eq!((found.turn, found.mirror), (Orientation::Left, true));
    assert_eq!(found.packing, StereoPacking::SideBySide);
    assert_eq!(found.pin[2], DVec2::new(-3.5, 0.0));
    let mut moves = vec![DVec2::ZERO; 6];
    (moves[1], moves[3]) = (DVec2::X, DVec2::Y * 2.0);
    assert_eq!(found.bend, Some(ControlGrid { points: UVec2::new(2, 3), moves: moves.into() }));
    let edges = BlendWidths { left: Some(0.0), right: Some(30.5), top: None, bottom: None };
    assert_eq!(found.edges, edges);
    assert_eq!(found.color.gain, DVec3::new(1.0, 0.9, 0.8));
    assert_eq!(found.color.leak, Some(DVec3::new(0.004, 0.003, 0.005)));
    // Rows of the file are rows of the matrix: red takes a tenth of green.
    assert_eq!(found.color.matrix * DVec3::Y, DVec3::new(0.1, 1.0, 0.0));
    assert_eq!(found.color.curve, TransferFunction::Gamma(DVec3::splat(2.2)));
    assert_eq!(wall.channels[0].display_size(), UVec2::new(640, 400));
    let middle = DVec3::new(0.2, 0.25, 0.3);
    let measured = TransferFunction::Measured(vec![DVec3::ZERO, middle, DVec3::ONE]);
    assert_eq!(wall.channels[1].adjustment.color.curve, measured);
    assert_eq!(wall.channels[1].adjustment.color.matrix, DMat3::IDENTITY);
}

#[test]
fn stereo_that_is_none_is_told() {
    let wall = |line: &str| SMALLEST.replace("[wall]\n", &format!("[wall]\n{line}\n"));
    check(&wall("stereo = \"side-by-side\""), "2:10: wall.stereo: \"side-by-side\" is none of");
    check(&wall("stereo_error = 0.0"), "2:1: wall.stereo_error: points cannot be off by up to 0.0");
    check(&wall("stereo_error = nan"), "2:1: wall.stereo_error: points cannot be off by up to NaN");
    assert_eq!(read(SMALLEST).stereo, StereoRule::default());
}

#[test]
fn files_are_listed_once_in_the_order_of_the_wall() {
    let wall = read(EVERY_KEY);
    let files: Vec<(&str, CalibrationFileKind)> =
        wall.files.iter().map(|file| (file.path.as_str(), file.kind)).collect();
    let expected = [
        ("hull.obj", CalibrationFileKind::ScreenMesh),
        ("masks/a.png", CalibrationFileKind::Alpha),
        ("masks/b.png", CalibrationFileKind::Beta),
        ("maps/mapped.pfm", CalibrationFileKind::Warp),
    ];
    assert_eq!(files, expected);
    let mapped = &wall.channels[3];
    assert_eq!((&mapped.cover, mapped.projection), (&ChannelKind::Map, FrustumMode::Own));
    assert_eq!((mapped.adjustment.warp, mapped.adjustment.alpha), (Some(3), Some(1)));
    for bad in ["\"\"", "\"a\\u0000b\""] {
        let text = front(&format!("alpha = {bad}"));
        check(&text, "10:1: channel.front.alpha: ");
    }
    assert_eq!(mapped.adjustment.ramps, Ramps::Alpha);
    let text = front("ramps = \"alpha\"");
    check(&text, "10:1: channel.front.ramps: there is no alpha file that says how its light fades");
    let text = front("alpha = \"a.png\"\nedges.left = 3\nramps = \"alpha\"");
    check(&text, "12:1: channel.front.ramps: how its light fades is given twice, by edges and");
    check(&front("warp = \"\""), "10:1: channel.front.warp: \"\" is no file; write the path of a");
}

#[test]
fn what_a_warp_holds_is_said_beside_it() {
    for (key, kind) in [
        ("warp_zero = \"dark\"", CalibrationFileKind::WarpDarkZeros),
        ("warp_obj = \"sgct\"", CalibrationFileKind::WarpSgct),
    ] {
        let wall = read(&front(&format!("warp = \"a.obj\"\n{key}")));
        assert_eq!(wall.files[0].kind, kind);
        let text = to_toml(&wall);
        assert!(text.contains(key) && read(&text) == wall, "{text}");
        let name = key.split(' ').next().expect("a key");
        check(&front(key), &format!("10:1: channel.front.{name}: there is no warp "));
    }
    let both = front("warp = \"a.obj\"\nwarp_zero = \"dark\"\nwarp_obj = \"sgct\"");
    check(&both, "12:1: channel.front.warp_obj: an OBJ has no pixels that could be dark");
    check(&front("warp = \"a.obj\"\nwarp_obj = \"vioso\""), "11:12: channel.front.warp_obj: ");
}

#[test]
fn everything_is_written_and_read_again() {
    let wall = read(EVERY_KEY);
    let text = to_toml(&wall);
    assert_eq!(parse(&text, "/walls/w.toml".as_ref()).as_ref(), Ok(&wall), "{text}");
    // What is said in round numbers of degrees stays so.
    assert!(text.contains("degrees = [-45.0, 45.0]"), "{text}");
    assert!(text.contains("rotation = [10.0, 0.0, 0.0]"), "{text}");
    let plain = to_toml(&read(SMALLEST));
    assert!(!plain.contains("[channel"), "{plain}");
}

#[test]
fn channels_that_are_not_there() {
    check(
        &format!("{SMALLEST}[channel.fornt]\nmirror = true\n"),
        "9:10: channel.fornt: there is no channel \"fornt\"; did you mean \"front\"? \
         channels here: front",
    );
    check(
        &format!("{BY_HAND}[channel.\"x.y\"]\n"),
        "17:10: channel.\"x.y\": there is no channel \"x.y\"; channels here: a, b",
    );
    let dotted = BY_HAND.replace("\"b\"", "\"b.1\"");
    check(
        &format!("{dotted}[channel.\"b.1\"]\ngamma = 0\n"),
        "18:1: channel.\"b.1\".gamma: a gamma of 0.0 is not possible",
    );
}

#[test]
fn light_that_cannot_be() {
    for gamma in ["0", "-2.2", "nan", "inf", "[2.2, 0, 2.2]"] {
        check(&front(&format!("gamma = {gamma}")), "10:1: channel.front.gamma: a gamma of ");
    }
    check(
        &front("gamma = 0"),
        "10:1: channel.front.gamma: a gamma of 0.0 is not possible; write a number above 0, such",
    );
    check(
        &front("gamma = 2.2\ncurve = [0, 1]"),
        "11:1: channel.front.curve: how codes become light is given twice, by gamma and by curve",
    );
    check(&front("curve = [0]"), "10:1: channel.front.curve: a curve of 1 point; write 2 to 1024");
    let falls = "channel.front.curve[2]: the curve does not rise from 0 to 1; measure the light";
    check(&front("curve = [0, 0.5, 0.4, 1]"), &format!("10:18: {falls}"));
    check(&front("curve = [0.1, 1]"), "10:10: channel.front.curve[0]: the curve does not rise");
    check(&front("curve = [0, 0.9]"), "10:13: channel.front.curve[1]: the curve does not rise");
    check(&front("curve = [0, nan, 1]"), "10:13: channel.front.curve[1]: the curve does not rise");
    check(&front("gain = -1"), "10:1: channel.front.gain: light cannot be multiplied by -1.0");
    check(
        &front("matrix = [[1, 0, 0], [0, inf, 0], [0, 0, 1]]"),
        "10:26: channel.front.matrix[1][1]: inf is no number of light",
    );
    check(&front("leak = 0.3"), "10:1: channel.front.leak: a display cannot leak 0.3 of its white");
    let blend = |line: &str| format!("{SMALLEST}[blend]\n{line}\n");
    check(&blend("exponent = 0"), "10:1: blend.exponent: a ramp cannot have the exponent 0.0");
    check(&blend("leak = 1"), "10:1: blend.leak: a projector cannot leak 1.0 of its white");
    check(&blend("leak = nan"), "10:1: blend.leak: a projector cannot leak NaN of its white");
}

#[test]
fn pins_and_bends_that_fold_the_picture() {
    // The upper right corner beyond the upper left one; and one inside the picture.
    for pin in ["[[0, 0], [-210, 0], [0, 0], [0, 0]]", "[[150, 80], [0, 0], [0, 0], [0, 0]]"] {
        check(
            &front(&format!("pin = {pin}")),
            "10:1: channel.front.pin: the pins fold the picture, or mirror it; move corners by",
        );
    }
    check(
        &front("pin = [[200, 0], [-200, 0], [200, 0], [-200, 0]]"),
        "10:1: channel.front.pin: the pins fold the picture, or mirror it",
    );
    check(
        &front("pin = [[0, 0], [nan, 0], [0, 0], [0, 0]]"),
        "10:17: channel.front.pin[1][0]: NaN is no number of pixels",
    );
    let bend = |points: &str, moves: &str| {
        front(&format!("bend = {{ points = {points}, moves = {moves} }}"))
    };
    let still = "[[0, 0], [0, 0], [0, 0], [0, 0]]";
    read(&bend("[2, 2]", still));
    check(&bend("[1, 4]", still), "10:10: channel.front.bend.points: a grid of 1×4 points is not");
    check(&bend("[64, 64]", still), "10:10: channel.front.bend.points: a grid of 64×64 points");
    check(&bend("[3, 2]", still), "10:27: channel.front.bend.moves: found 4 moves for 6 points");
    check(
        &bend("[2, 2]", "[[300, 0], [-300, 0], [300, 0], [-300, 0]]"),
        "10:1: channel.front.bend: the bend folds the picture, or nearly; move its points by less",
    );
}

#[test]
fn eyes_edges_and_maps_that_contradict_each_other() {
    check(
        &front("eye = \"left\"\nstereo = \"top-bottom\""),
        "10:1: channel.front.eye: a display that shows both eyes is not for one of them",
    );
    check(
        &front("edges = { left = -1 }"),
        "10:11: channel.front.edges.left: a ramp of -1.0 pixels is not possible; write 0 to 200",
    );
    check(
        &front("edges.bottom = 101"),
        "10:7: channel.front.edges.bottom: a ramp of 101.0 pixels is not possible; write 0 to 100",
    );
    check(
        &format!("{EVERY_KEY}[channel.beam]\nwarp = \"x.pfm\"\n"),
        "57:1: channel.beam.warp: where its pixels lie is given twice, by a warp file and by a",
    );
    check(
        &EVERY_KEY.replace("warp = ", "# "),
        "28:1: screen[1].channel[1].origin: nobody knows what channel \"mapped\" shows; give \
         origin",
    );
    let head = SMALLEST.replacen("name = \"w\"", "name = \"w\"\neye_separation = -0.1", 1);
    check(&head, "3:1: wall.eye_separation: eyes cannot be -0.1 metres apart; write a number from");
}
