//! Text that is no TOML, or no wall file's TOML.

use super::{BY_HAND, SMALLEST, check, check_changed};

#[test]
fn broken_toml_names_the_line_and_the_key() {
    check(
        "[wall]\nname = \"w\n",
        "2:10: wall.name: the text is not closed; write a quote at its end",
    );
    check("[wall]\nname = \n", "2:8: ");
    check("[wall\nname = 1\n", "1:6: ");
    check("nonsense", "1:");
    check_changed(
        SMALLEST,
        "name = \"w\"",
        "name = \"w\"\nname = \"v\"",
        "3:1: wall.name: the key is given twice; keep one of the two",
    );
    check("\u{feff}\u{feff}x", "1:");
}

#[test]
fn unknown_keys_are_named_with_the_nearest_known_one() {
    check_changed(
        SMALLEST,
        "pixels",
        "pixel",
        "8:1: screen[0].tiles.pixel: there is no key \"pixel\" here; did you mean \"pixels\"? \
         keys here: columns, rows, pixels, bezel, overlap, names, servers",
    );
    check_changed(
        SMALLEST,
        "[wall]",
        "[walls]",
        "1:2: walls: there is no key \"walls\" here; did you mean \"wall\"? \
         keys here: wall, deadline, sync, network, storage, budget, blend, screen, channel",
    );
    check_changed(
        SMALLEST,
        "name = \"w\"",
        "name = \"w\"\nzzzzzz = 1",
        "3:1: wall.zzzzzz: there is no key \"zzzzzz\" here; keys here: name, eye, near, samples, ",
    );
    check_changed(
        SMALLEST,
        "name = \"w\"",
        "name = \"w\"\n\"a.b\" = 1",
        "3:1: wall.\"a.b\": there",
    );
}

#[test]
fn missing_keys_are_named_at_their_table() {
    check_changed(SMALLEST, "name = \"w\"", "", "1:1: wall.name: the key is missing; add name = …");
    check_changed(
        SMALLEST,
        "name = \"front\"",
        "",
        "3:1: screen[0].name: the key is missing; add name = …",
    );
    check_changed(
        BY_HAND,
        "origin = [100, 0]",
        "",
        "12:1: screen[0].channel[1].origin: nobody knows what channel \"b\" shows; give origin",
    );
    check("", "1:1: wall: the key is missing; add [wall]");
}

#[test]
fn wrong_types_say_what_was_found_and_what_is_right() {
    check_changed(
        SMALLEST,
        "\"w\"",
        "5",
        "2:8: wall.name: found the number 5; write a text in quotes",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "\"big\"",
        "8:10: screen[0].tiles.pixels: found the text \"big\"; write a list of 2 numbers, [a, b]",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[200, true]",
        "8:16: screen[0].tiles.pixels[1]: found true; write a whole number from 0 to 4294967295",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[200, 100.5]",
        "8:16: screen[0].tiles.pixels[1]: found the number 100.5; write a whole number",
    );
    check_changed(
        SMALLEST,
        "[2.0, 1.0]",
        "[2.0, [1.0]]",
        "5:14: screen[0].size[1]: found a list; write a number",
    );
    check_changed(
        SMALLEST,
        "name = \"w\"",
        "name = \"w\"\nnear = 1979-05-27",
        "3:8: wall.near: found a table or a date; write a number",
    );
}

#[test]
fn integers_that_are_negative_or_huge_are_named() {
    for number in ["-1", "4294967296", "99999999999999999999999999999999999999999999", "1e300"] {
        check_changed(
            SMALLEST,
            "[200, 100]",
            &format!("[200, {number}]"),
            "8:16: screen[0].tiles.pixels[1]: ",
        );
    }
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[200, -1]",
        "8:16: screen[0].tiles.pixels[1]: found the number -1; write a whole number from 0",
    );
    check_changed(
        SMALLEST,
        "[2.0, 1.0]",
        "[2.0, 1e999]",
        "5:14: screen[0].size[1]: the number is too large; write a smaller one",
    );
}

#[test]
fn lists_must_have_their_length() {
    check_changed(
        SMALLEST,
        "[0.0, 0.0, -1.0]",
        "[0.0, 0.0]",
        "6:10: screen[0].center: found 2 of them; write a list of 3 numbers, [x, y, z]",
    );
    check_changed(
        SMALLEST,
        "[0.0, 0.0, -1.0]",
        "[0.0, 0.0, -1.0, 1.0]",
        "6:10: screen[0].center: found 4 of them; write a list of 3 numbers, [x, y, z]",
    );
    check_changed(
        SMALLEST,
        "[200, 100]",
        "[]",
        "8:10: screen[0].tiles.pixels: found 0 of them; write a list of 2 numbers, [a, b]",
    );
}

#[test]
fn values_that_are_none_of_those_possible() {
    check_changed(
        SMALLEST,
        "size",
        "projection = \"share\"\nsize",
        "5:14: screen[0].projection: \"share\" is none of the values possible; \
         did you mean \"shared\"? values here: shared, own",
    );
}

#[test]
fn a_value_in_the_place_of_a_word_lists_all_words() {
    let with = |key: &str| format!("{SMALLEST}[channel.front]\n{key}\n");
    let turns = "write one of \"none\", \"left\", \"right\", \"half\"";
    for (value, found) in [
        ("90", "the number 90"),
        ("-1.5", "the number -1.5"),
        ("true", "true"),
        ("[]", "[]"),
        ("{}", "{}"),
        ("{ left = 1 }", "a table"),
        ("1979-05-27", "1979-05-27"),
    ] {
        let found = format!(": found {found}; {turns}");
        let error = super::error(&with(&format!("turn = {value} # degrees")));
        assert!(error.starts_with("w.toml:10:") && error.ends_with(&found), "{error}");
    }
    for (key, words) in [
        ("eye = 1", "\"center\", \"left\", \"right\""),
        ("stereo = true", "\"none\", \"side-by-side\", \"top-bottom\", \"anaglyph\""),
    ] {
        let error = super::error(&with(key));
        assert!(error.ends_with(&format!("write one of {words}")), "{error}");
    }
    check_changed(
        SMALLEST,
        "size",
        "projection = 2\nsize",
        "5:14: screen[0].projection: found the number 2; write one of \"shared\", \"own\"",
    );
}

#[test]
fn lists_and_values_are_no_tables() {
    check("wall = [\"w\"]", "1:1: wall: found a list where a table belongs; write [wall] on");
    check(
        "screen = 1\n[wall]\nname = \"w\"",
        "1:1: screen: found a number where a table belongs; write [[screen]] on",
    );
    check(
        "[screen]\nname = \"s\"\n[wall]\nname = \"w\"",
        "1:2: screen: found one table where a list of tables belongs; write [[screen]] on",
    );
    check(
        "screen = [[\"s\"]]\n[wall]\nname = \"w\"",
        "1:11: screen[0]: found a list where a table belongs; write [[screen]] on",
    );
    check_changed(
        SMALLEST,
        "[screen.tiles]\npixels = [200, 100]",
        "tiles = [1, 1, [200, 100]]",
        "7:1: screen[0].tiles: found a list where a table belongs; write [screen.tiles] on",
    );
    check_changed(
        SMALLEST,
        "[screen.tiles]",
        "channel = [[\"a\", [0, 0], [1, 1]]]\n[screen.tiles]",
        "7:12: screen[0].channel[0]: found a list where a table belongs; \
         write [[screen.channel]] on",
    );
}

#[test]
fn nesting_without_end_is_an_error() {
    let deep = "[".repeat(100_000);
    check(&format!("a = {deep}"), "1:");
    check(&format!("{}.x = 1", vec!["a"; 100_000].join(".")), "1:");
    check(&format!("a = {}", "{a=".repeat(100_000)), "1:");
}

#[test]
fn tables_of_a_channel_are_tables() {
    let with = |text: &str| format!("{SMALLEST}{text}\n");
    check(
        &with("[[channel]]\nname = \"front\""),
        "9:3: channel: found a list of tables where one belongs; write [channel.NAME] on",
    );
    check(
        &with("[channel]\nfront = 1"),
        "10:1: channel.front: found a number where a table belongs; write [channel.front] on",
    );
    check(
        &with("[channel.front]\nedges = [1, 2]"),
        "10:1: channel.front.edges: found a list where a table belongs",
    );
    check(
        &with("[channel.front]\nbend = 1"),
        "10:1: channel.front.bend: found a number where a table belongs",
    );
    check(&with("[[blend]]\nleak = 0"), "9:3: blend: found a list of tables where one belongs");
    check(
        &with("[channel.front]\ngain = 1\n[channel.front]"),
        "11:10: channel.front: the table is given twice; put all its keys below the first one",
    );
    check(
        &with("[channel.front]\nblur = 1"),
        "10:1: channel.front.blur: there is no key \"blur\" here; ",
    );
    check(
        &with("[channel.front]\nturn = \"lefft\""),
        "10:8: channel.front.turn: \"lefft\" is none of the values possible; \
         did you mean \"left\"? values here: none, left, right, half",
    );
    check_changed(
        BY_HAND,
        "origin = [0, 0]",
        "projector = [1]",
        "10:1: screen[0].channel[0].projector: found a list where a table belongs",
    );
    check_changed(
        SMALLEST,
        "size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]",
        "cylinder = 3.0",
        "5:1: screen[0].cylinder: found a number where a table belongs",
    );
}

#[test]
fn one_number_or_three() {
    let with = |text: &str| format!("{SMALLEST}[channel.front]\n{text}\n");
    check(
        &with("gamma = \"2.2\""),
        "10:9: channel.front.gamma: found the text \"2.2\"; write a number, or a list of 3 numbers",
    );
    check(
        &with("gamma = [2.2, 2.2]"),
        "10:9: channel.front.gamma: found 2 of them; write a list of 3 numbers",
    );
    check(
        &with("pin = [[0, 0]]"),
        "10:7: channel.front.pin: found 1 of them; write a list of 4 points, [[x, y], ",
    );
    check(
        &with("matrix = [1, 0, 0]"),
        "10:11: channel.front.matrix[0]: found the number 1; write a list of 3 numbers",
    );
    check(
        &with("bits = 12"),
        "10:1: channel.front.bits: codes of 12 bits are not possible; write 8 or 10",
    );
    check(
        &with("mirror = 1"),
        "10:10: channel.front.mirror: found the number 1; write true or false",
    );
}
