//! Walls that cannot be: numbers, places, tiles and names.

use glam::DVec2;
use polyptych_wall::{ChannelId, MemoryBudget};

use super::{BY_HAND, SMALLEST, check, check_changed, read, to_toml};

#[test]
fn channels_may_overlap_and_then_need_not_cover_the_canvas() {
    let wall = read(&BY_HAND.replace("[100, 0]", "[90, 0]"));
    assert_eq!(wall.channels[1].origin.x, 90);
    let hard = |side: &str| {
        let edges = format!("[channel.b]\nedges.{side} = 0\n");
        format!("{}{edges}", BY_HAND.replace("[100, 0]", "[90, 0]"))
    };
    // Its light ends in a line, as somebody may have tuned it; the check's report warns of it.
    assert_eq!(read(&hard("left")).channels[1].adjustment.edges.left, Some(0.0));
    // At its other edges it is alone.
    read(&hard("right"));
}

#[test]
fn each_eye_is_covered_by_channels_of_its_own() {
    let eyes = |a: &str, b: &str| format!("[channel.a]\neye = {a:?}\n[channel.b]\neye = {b:?}\n");
    let twice = BY_HAND.replace("[100, 0]", "[0, 0]").replace("[200, 100]", "[100, 100]");
    let wall = read(&format!("{twice}{}", eyes("left", "right")));
    assert_eq!(wall.channels[1].adjustment.eye, polyptych_wall::Eye::Right);
    check(
        &format!("{BY_HAND}{}", eyes("left", "right")),
        "8:10: screen[0].channel: 1 channel for the left eye leaves a hole: none shows 100×100 \
         pixels at [100, 0]",
    );
    check(
        &format!("{BY_HAND}{}", eyes("left", "center")),
        "8:10: screen[0].channel: 1 channel for the right eye leaves a hole: none shows 100×100 \
         pixels at [0, 0]",
    );
    let tiles = format!("{SMALLEST}columns = 2\n[channel.front-1-1]\neye = \"left\"\n");
    check(&tiles, "7:9: screen[0].tiles: 1 channel for the right eye leaves a hole");
}

#[test]
fn monitors_are_named_once_for_each_server() {
    let monitors = |a: &str, b: &str| {
        format!("{BY_HAND}[channel.a]\nmonitor = {a:?}\n[channel.b]\nmonitor = {b:?}\n")
    };
    let wall = read(&monitors("HDMI-1", "HDMI-1"));
    assert_eq!(wall.channels[1].monitor.as_deref(), Some("HDMI-1"), "another server's machine");
    let text = monitors("HDMI-1", "HDMI-1");
    let both = text.replace("name = \"a\"", "name = \"a\"\nserver = \"pc\"");
    check(
        &both,
        "21:1: channel.b.monitor: channel \"a\" of the same server fills monitor \"HDMI-1\"; \
         give each a monitor of its own",
    );
    read(&both.replacen("HDMI-1", "HDMI-2", 1));
    let (long, shown) = ("x".repeat(65), "x".repeat(64));
    for (name, shown) in [("", ""), ("a\nb", "a\\nb"), (long.as_str(), shown.as_str())] {
        let key = "18:1: channel.a.monitor";
        let expected = format!("{key}: \"{shown}\" is not the name of a monitor; write 1");
        check(&monitors(name, "B"), &expected);
    }
}

#[test]
fn holes_say_where_and_how_large_they_are() {
    check_changed(
        BY_HAND,
        "pixels = [200, 100]",
        "pixels = [220, 110]",
        "8:10: screen[0].channel: 2 channels leave a hole: none shows 20×100 pixels at [200, 0] \
         (4200 pixels missing in all); add the channel that is missing, or [[screen.hidden]]",
    );
}

#[test]
fn channels_without_pixels_or_with_too_many() {
    check_changed(
        BY_HAND,
        "pixels = [100, 100]",
        "pixels = [100, 0]",
        "11:16: screen[0].channel[0].pixels[1]: a channel cannot be 0 pixels high; write 1 to 8192",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[100000, 100]",
        "8:11: screen[0].tiles.pixels[0]: a channel cannot be 100000 pixels wide; write 1 to 8192",
    );
    check_changed(
        BY_HAND,
        "pixels = [200, 100]",
        "pixels = [200, 4000000000]",
        "7:16: screen[0].pixels[1]: a canvas cannot have 4000000000 pixels on a side",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[8192, 8192]\ncolumns = 17",
        "8:1: screen[0].tiles.pixels: 17×1 tiles of 8192×8192 pixels and the bezels between them",
    );
}

#[test]
fn channels_outside_the_canvas() {
    check_changed(
        BY_HAND,
        "[100, 0]",
        "[101, 0]",
        "14:1: screen[0].channel[1].origin: channel \"b\", 100×100 pixels at [101, 0], leaves the \
         canvas of 200×100 pixels; move it",
    );
    check_changed(BY_HAND, "[100, 0]", "[4294967295, 0]", "14:1: screen[0].channel[1].origin: ");
}

#[test]
fn an_eye_in_the_plane_of_a_screen_or_behind_it() {
    check_changed(
        SMALLEST,
        "name = \"w\"",
        "name = \"w\"\neye = [0.5, 0.0, -1.0]",
        "3:1: wall.eye: the eye [0.5, 0, -1] m is in the plane of screen \"front\", so that its \
         channel \"front\" has no view; move the eye or the screen",
    );
    check_changed(
        SMALLEST,
        "-1.0]",
        "0.5]",
        "1:2: wall.eye: the eye [0, 0, 0] m is 0.500000 m behind screen \"front\", so that",
    );
    read(&SMALLEST.replace("-1.0]", "-1e-4]"));
    check_changed(
        SMALLEST,
        "-1.0]",
        "-1e-6]",
        "1:2: wall.eye: the eye [0, 0, 0] m is 0.000001 m before screen \"front\", so near that \
         pixels of its channel \"front\" would be wrong; move the eye or the screen: 0.00003",
    );
}

/// Corners that a person measured lean a little: all that knows pixels knows the same ones.
#[test]
fn measured_corners_make_one_rectangle() {
    let corners = "lower_left = [-1, -0.5, -1]\nlower_right = [1, -0.5, -1]\n\
                   upper_left = [-0.9991, 0.5, -1]\n";
    let pose = "size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]\n";
    let wall = read(&SMALLEST.replace(pose, corners));
    let screen = &wall.screens[0];
    for place in [[0.0, 0.0], [200.0, 0.0], [40.0, 30.0], [0.0, 100.0], [200.0, 100.0]] {
        let place = DVec2::from(place);
        let point = screen.display_from_canvas(place).unwrap();
        let drawn = wall.pixel_from_display(ChannelId(0), wall.eye, point).unwrap();
        assert!(drawn.distance(place) < 1e-6, "{place} is drawn at {drawn}");
        let found = screen.canvas_from_display(point).unwrap();
        assert!(found.distance(place) < 1e-6, "{place} is found at {found}");
    }
    assert_eq!(read(&to_toml(&wall)), wall);
}

#[test]
fn corners_that_span_no_rectangle() {
    let corners = |a: &str, b: &str, c: &str| {
        let place = format!("lower_left = {a}\nlower_right = {b}\nupper_left = {c}\n");
        let pose = "size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]\n";
        SMALLEST.replace(pose, &place)
    };
    let (a, b, c) = ("[-1, 0, -1]", "[1, 0, -1]", "[-1, 1, -1]");
    read(&corners(a, b, c));
    check(
        &corners(a, a, c),
        "6:1: screen[0].lower_right: corners lower_left and lower_right coincide; ",
    );
    check(
        &corners(a, b, b),
        "7:1: screen[0].upper_left: corners lower_right and upper_left coincide; ",
    );
    check(
        &corners(a, b, "[0, 0, -1]"),
        "7:1: screen[0].upper_left: corners lower_left, lower_right and upper_left lie on one line",
    );
    check(
        &corners(a, b, "[0, 1, -1]"),
        "7:1: screen[0].upper_left: the angle at lower_left is 45.000°, so that the corners span \
         no rectangle; the angle must be 90°, as with upper_left = [-1.0000, 1.0000, -1.0000]",
    );
    check(
        &corners(a, "[nan, 0, -1]", c),
        "6:16: screen[0].lower_right[0]: NaN is no number of metres; write numbers from -1000000",
    );
    check(
        &corners(a, "[1e300, 0, -1]", c),
        "6:16: screen[0].lower_right[0]: 1e300 metres is beyond all reason",
    );
    check(
        &corners(a, b, c).replace("upper_left", "# "),
        "3:1: screen[0].upper_left: screen \"front\" lacks this corner; give all three",
    );
    check(
        &corners(a, b, c).replace("[screen.tiles]", "size = [1, 1]\n[screen.tiles]"),
        "8:1: screen[0].size: the screen's place is given twice, by lower_left and by size",
    );
}

#[test]
fn places_that_are_none() {
    check_changed(
        SMALLEST,
        "size = [2.0, 1.0]\n",
        "",
        "3:1: screen[0].size: nobody knows where screen \"front\" stands; give lower_left",
    );
    check_changed(
        SMALLEST,
        "[2.0, 1.0]",
        "[2.0, -1.0]",
        "5:14: screen[0].size[1]: a side of -1 metres is too short; write 0.001 or more",
    );
    check_changed(
        SMALLEST,
        "[2.0, 1.0]",
        "[2.0, inf]",
        "5:14: screen[0].size[1]: inf is no number of metres",
    );
    check_changed(
        SMALLEST,
        "size",
        "rotation = [0, 0, 361]\nsize",
        "5:19: screen[0].rotation[2]: 3.61e2 degrees is beyond all reason",
    );
    check_changed(
        SMALLEST,
        "0.0, -1.0]",
        "1e300, -1.0]",
        "6:16: screen[0].center[1]: 1e300 metres is beyond all reason",
    );
}

#[test]
fn names_are_unique_and_fit_for_files() {
    check_changed(
        BY_HAND,
        "\"b\"",
        "\"a\"",
        "13:1: screen[0].channel[1].name: two channels are called \"a\"; give each a name",
    );
    check_changed(
        BY_HAND,
        "\"b\"",
        "\"A\"",
        "13:1: screen[0].channel[1].name: two channels are called \"a\" and \"A\", which differ",
    );
    let screen = &SMALLEST[SMALLEST.find("[[screen]]").unwrap()..];
    check(&format!("{SMALLEST}{screen}"), "10:1: screen[1].name: two screens are called \"front\"");
    check(
        &format!("{SMALLEST}columns = 2\nnames = [\"a\", \"a\"]"),
        "10:15: screen[0].tiles.names[1]: two channels are called \"a\"",
    );
    check(
        &format!("{SMALLEST}servers = [\"a/b\"]"),
        "9:12: screen[0].tiles.servers[0]: \"a/b\" has the character '/'; it becomes part of",
    );
    for (name, what) in [
        ("", "the name is empty"),
        ("..", "\"..\" begins with \".\", as hidden files do"),
        ("--help", "\"--help\" begins with \"-\", as options on a command line do"),
        ("a/b", "\"a/b\" has the character '/'; it becomes part of file names"),
        ("é", "\"é\" has the character 'é'"),
        (&"x".repeat(65), "the name has 65 bytes"),
    ] {
        check_changed(
            BY_HAND,
            "\"b\"",
            &format!("{name:?}"),
            &format!("13:1: screen[0].channel[1].name: {what}"),
        );
        check_changed(SMALLEST, "\"w\"", &format!("{name:?}"), &format!("2:1: wall.name: {what}"));
    }
}

#[test]
fn numbers_of_the_wall() {
    let head = |line: &str| SMALLEST.replacen("name = \"w\"", &format!("name = \"w\"\n{line}"), 1);
    for near in ["0", "-1.0", "nan", "inf", "1e300"] {
        check(&head(&format!("near = {near}")), "3:1: wall.near: the near plane cannot be at ");
    }
    for samples in ["0", "2", "8"] {
        check(&head(&format!("samples = {samples}")), "3:1: wall.samples: ");
    }
    check(
        &head("samples = 2"),
        "3:1: wall.samples: 2 samples per pixel are not possible; write 1 or 4",
    );
    check(&head("eye = [0, inf, 0]"), "3:11: wall.eye[1]: inf is no number of metres");
    check(&head("eye = [0, 0, -1e300]"), "3:14: wall.eye[2]: -1e300 metres is beyond all reason");
}

#[test]
fn deadlines_that_make_no_sense() {
    let deadline = |line: &str| format!("[deadline]\n{line}\n{SMALLEST}");
    for factor in ["0.5", "nan", "inf", "-1"] {
        check(&deadline(&format!("factor = {factor}")), "2:1: deadline.factor: a deadline of ");
    }
    check(
        &deadline("min_ms = 0"),
        "2:1: deadline.min_ms: a deadline of 0 ms would make every frame late; write 1 or more",
    );
    check(&deadline("max_ms = 0"), "2:1: deadline.max_ms: a deadline of 0 ms");
    check(
        &deadline("min_ms = 3000"),
        "2:1: deadline.min_ms: the shortest deadline, 3000 ms, is above the longest, 2000 ms; \
         write 2000 or less",
    );
    check(&deadline("max_ms = 10"), "1:2: deadline.min_ms: the shortest deadline, 50 ms");
}

#[test]
fn more_than_one_frame_cannot_be_sent_ahead() {
    let sync = |line: &str| format!("[sync]\n{line}\n{SMALLEST}");
    check(
        &sync("pipeline_depth = 2"),
        "2:1: sync.pipeline_depth: 2 frames cannot be sent ahead; write 0 to 1",
    );
    check(&sync("pipeline_depth = -1"), "2:");
    check(
        &sync("swap_lead_ms = 101"),
        "2:1: sync.swap_lead_ms: a swap that is sent 101 ms ahead; write 100 or less, such as 5",
    );
}

#[test]
fn rejects_budgets_out_of_range() {
    let budget = |line: &str| format!("[budget]\n{line}\n{SMALLEST}");
    check(
        &budget("gpu_mib = 0"),
        "2:1: budget.gpu_mib: a budget of 0 MiB is not possible; write 1 to 1048576, such as 4096",
    );
    check(
        &budget("host_mib = 63"),
        "2:1: budget.host_mib: a budget of 63 MiB is not possible; write 64 to 1048576, such as",
    );
    check(&budget("gpu_mib = 1048577"), "2:1: budget.gpu_mib: a budget of 1048577 MiB");
    for odd in ["-1", "nan", "1.5", "\"4 GiB\"", "4294967296"] {
        check(&budget(&format!("gpu_mib = {odd}")), "2:");
    }
    let wall = read(&budget("gpu_mib = 1\nhost_mib = 1048576"));
    assert_eq!((wall.budget.gpu_bytes(), wall.budget.host_bytes()), (Some(1 << 20), Some(1 << 40)));
    assert_eq!(read(SMALLEST).budget, MemoryBudget::default());
}

#[test]
fn addresses_need_a_port() {
    let network = |line: &str| format!("[network]\n{line}\n{SMALLEST}");
    for good in ["127.0.0.1:0", "[::1]:7878", "0.0.0.0:65535", "wall-pc.local:7878"] {
        assert_eq!(read(&network(&format!("listen = {good:?}"))).listen, good);
    }
    let odd = ["", ":", "7878", "127.0.0.1", "127.0.0:1", "h:65536", "h:+1", "a b:1", "::1", ":1"];
    for odd in odd {
        check(
            &network(&format!("listen = {odd:?}")),
            &format!("2:1: network.listen: {odd:?} is no address with a port; write ADDRESS:PORT"),
        );
    }
    check(&network("heartbeat_ms = 0"), "2:1: network.heartbeat_ms: 0 ms of silence are normal");
}

#[test]
fn folders_have_a_name() {
    check(
        &format!("[storage]\nscenes = [\".\", \"\"]\n{SMALLEST}"),
        "2:16: storage.scenes[1]: \"\" is no folder; write a path",
    );
}

#[test]
fn walls_without_screens_and_screens_without_channels() {
    check("[wall]\nname = \"w\"", "1:1: screen: the wall has no screen; add [[screen]]");
    check_changed(
        SMALLEST,
        "[screen.tiles]\npixels = [200, 100]\n",
        "",
        "3:1: screen[0].tiles: screen \"front\" has no channel; add [screen.tiles]",
    );
    check_changed(
        BY_HAND,
        "pixels = [200, 100]",
        "tiles.pixels = [200, 100]",
        "8:10: screen[0].channel: the screen has both tiles and channels by hand; keep one",
    );
    check_changed(
        BY_HAND,
        "pixels = [200, 100]",
        "",
        "3:1: screen[0].pixels: with channels by hand the canvas must be given; add pixels",
    );
    check_changed(
        SMALLEST,
        "size",
        "pixels = [200, 100]\nsize",
        "5:1: screen[0].pixels: tiles cover the whole screen, so that this follows from them",
    );
}

#[test]
fn grids_that_are_none() {
    let tiles = |line: &str| format!("{SMALLEST}{line}\n");
    check(&tiles("columns = 0"), "9:1: screen[0].tiles.columns: 0 columns × 1 rows are 0 tiles");
    check(&tiles("rows = 4294967295\ncolumns = 4294967295"), "9:1: screen[0].tiles.rows: ");
    check(&tiles("rows = 1025"), "9:1: screen[0].tiles.rows: 1 columns × 1025 rows are 1025 tiles");
    check(
        &tiles("names = [\"a\", \"b\"]"),
        "9:1: screen[0].tiles.names: there are 2 names for 1 tiles; write 1 names, row by row",
    );
    check(
        &tiles("columns = 3\nbezel = [1.0, 0.0]"),
        "10:10: screen[0].tiles.bezel[0]: 2 gaps of 1 metres leave nothing of a screen of 2 metres",
    );
    check(&tiles("columns = 3\nbezel = [0.9999999999, 0.0]"), "8:1: screen[0].tiles.pixels: 3×1");
    check(
        &tiles("bezel = [0.0, -0.1]"),
        "9:15: screen[0].tiles.bezel[1]: a gap of -0.1 metres would overlap tiles",
    );
    check(&tiles("bezel = [nan, 0]"), "9:10: screen[0].tiles.bezel[0]: NaN is no number of metres");
}

#[test]
fn hidden_rectangles_hide_only_what_no_channel_shows() {
    let hidden = |origin: &str, pixels: &str| {
        format!("{BY_HAND}[[screen.hidden]]\norigin = {origin}\npixels = {pixels}\n")
    };
    check(&hidden("[0, 0]", "[0, 5]"), "18:1: screen[0].hidden[0].origin: a hidden rectangle with");
    check(
        &hidden("[199, 0]", "[2, 2]"),
        "18:1: screen[0].hidden[0].origin: 2×2 pixels at [199, 0]",
    );
    check(
        &hidden("[99, 0]", "[1, 1]"),
        "18:1: screen[0].hidden[0].origin: 1×1 pixels at [99, 0] lies over channel \"a\"; hide",
    );
}

#[test]
fn too_many_of_anything() {
    let screen = |index: usize, columns: usize| {
        let place = "size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]";
        let tiles = format!("tiles.pixels = [2, 2]\ntiles.columns = {columns}");
        format!("[[screen]]\nname = \"s{index}\"\n{place}\n{tiles}\n")
    };
    let wall = |screens: usize, columns: usize| {
        let screens: String = (0..screens).map(|index| screen(index, columns)).collect();
        format!("[wall]\nname = \"w\"\n{screens}")
    };
    assert_eq!(read(&wall(256, 4)).channels.len(), 1024);
    check(&wall(257, 1), "3:3: screen: the wall has 257 screens; 256 are possible");
    check(&wall(2, 513), "9:1: screen[1]: the wall has 1026 channels up to here; 1024 are");
}

#[test]
fn a_shared_matrix_serves_no_canvas_beyond_a_viewport() {
    let text =
        format!("{}columns = 50\n", SMALLEST.replace("size", "projection = \"shared\"\nsize"));
    check(&text, "5:1: screen[0].projection: a canvas of 10000×100 pixels is too long for one");
}
