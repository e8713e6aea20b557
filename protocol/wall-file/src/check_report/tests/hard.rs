//! Walls as integrators bring them: light beside the screen, stereo, turned panels, wrong units.

use std::fmt::Write;

use super::*;

/// A cylinder of 120° and 3 m radius, lit by three projectors that overshoot it: they hang 2.6 m
/// above the floor, as far from the screen as given, and look down at it.
fn overshoot(back_m: f64, degrees: [f64; 2], rest: &str) -> String {
    let mut text = "[wall]\nname = \"round\"\neye = [0, 1.6, 0]\n[[screen]]\nname = \"round\"\n\
                    pixels = [3000, 1000]\n[screen.cylinder]\nradius = 3.0\ndegrees = [-60, 60]\n\
                    height = [0.6, 2.6]\n"
        .to_owned();
    for (at, azimuth) in [-40.0_f64, 0.0, 40.0].iter().enumerate() {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let out = 3.0 - back_m;
        let _ = write!(
            text,
            "[[screen.channel]]\nname = \"p{}\"\npixels = [960, 600]\n[screen.channel.projector]\n\
             position = [{:?}, 2.8, {:?}]\nlook_at = [{:?}, 1.5, {:?}]\ndegrees = {degrees:?}\n",
            at + 1,
            out * sin,
            -out * cos,
            3.0 * sin,
            -3.0 * cos
        );
    }
    text + rest
}

#[test]
fn projectors_that_overshoot_are_measured_on_the_screen() {
    let table = table(&overshoot(2.6, [46.0, 46.0], ""));
    for channel in &table.channels {
        let ([width, height], spill) = (channel.size_m.unwrap(), channel.spill.unwrap());
        assert!((1.5..3.0).contains(&width) && (1.9..2.1).contains(&height), "{channel:?}");
        assert!((0.02..0.5).contains(&spill), "{channel:?}");
        let projector = channel.projector.unwrap();
        let expected = 1.0 / (2.0 * 23.0_f64.to_radians().tan());
        assert!((projector.throw_ratio - expected).abs() < 1e-9, "{projector:?}");
        assert!((2.4..3.4).contains(&projector.distance_m.unwrap()), "{projector:?}");
    }
    // The middle row of the middle one: the arc between the rays that leave its lens.
    let arc = |degrees: f64| 3.0 * degrees.to_radians();
    let [width, _] = table.channels[1].size_m.unwrap();
    assert!((width - arc(table.channels[1].degrees.unwrap()[0])).abs() < 0.05, "{table}");
    let text = table.to_string();
    assert!(text.contains("projector 1.18:1, 2.") && !text.contains("NaN"), "{text}");
}

#[test]
fn light_that_misses_is_told_in_percent() {
    // 100° across and down: above and below the screen, and beside it.
    let table = table(&overshoot(2.6, [100.0, 100.0], ""));
    for channel in &table.channels {
        let spill = channel.spill.unwrap();
        assert!(spill > 0.5 && spill < 1.0, "{channel:?}");
        let said = table.warnings.iter().any(|line| {
            line.starts_with(&format!("channel {}: ", channel.name)) && line.contains("% of its")
        });
        assert!(said, "{:?}", table.warnings);
    }
}

#[test]
fn a_screen_that_is_small_in_a_picture_is_found_in_it() {
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\npixels = [100, 50]\n\
                size = [0.08, 0.04]\ncenter = [0.3, 0.1, -4.0]\n[[screen.channel]]\nname = \"c\"\n\
                pixels = [2000, 1000]\nprojector = { position = [0, 0, -1], look_at = [0, 0, -4], \
                degrees = [90, 53.13] }\n";
    let channel = &table(text).channels[0];
    // 3 m away the picture is 6 × 3 m.
    let spill = channel.spill.unwrap();
    assert!((1.0 - spill - 0.0032 / 18.0).abs() < 2e-5, "{channel:?}");
    let [width, height] = channel.size_m.unwrap();
    assert!((width - 0.08).abs() < 1e-6 && (height - 0.04).abs() < 1e-6, "{channel:?}");
}

/// A wall of one screen before the eye with this body.
fn one(body: &str) -> CheckReport {
    table(&format!(
        "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.7, 2.7]\n\
         center = [0.0, 0.0, -2.0]\npixels = [270, 270]\n{body}"
    ))
}

#[test]
fn what_an_eye_gets_and_what_a_display_gets_are_both_told() {
    let tile = "[[screen.channel]]\nname = \"a\"\norigin = [0, 0]\npixels = [270, 270]\n";
    let table = one(&format!("{tile}[channel.a]\nstereo = \"side-by-side\"\n"));
    let channel = &table.channels[0];
    assert_eq!((channel.pixels, channel.output_pixels), ([270, 270], [540, 270]));
    assert_eq!((table.stereo, table.pixels_total), (Stereo::Packed, 540 * 270));
    let text = table.to_string();
    assert!(text.contains("stereo: both eyes share a display, eyes 63.0 mm apart"), "{text}");
    assert!(text.contains("270 × 270  540 × 270  both, side by side"), "{text}");

    let second = tile.replace("\"a\"", "\"b\"");
    let eyes = "[channel.a]\neye = \"left\"\n[channel.b]\neye = \"right\"\n";
    let table = one(&format!("{tile}{second}{eyes}"));
    assert_eq!((table.stereo, table.channels[1].eye), (Stereo::Passive, Eye::Right));
    let text = table.to_string();
    assert!(text.contains("stereo: channels for the left and for the right eye"), "{text}");
    assert!(!text.contains("output") && text.contains("hangs").eq(&false), "{text}");
}

#[test]
fn turned_and_mirrored_displays_are_told() {
    let half = |name: &str, x: u32| {
        format!("[[screen.channel]]\nname = \"{name}\"\norigin = [{x}, 0]\npixels = [90, 270]\n")
    };
    let turns = "[channel.a]\nturn = \"left\"\n[channel.b]\nturn = \"right\"\nmirror = true\n\
                 [channel.c]\nturn = \"half\"\n";
    let table = one(&format!("{}{}{}{turns}", half("a", 0), half("b", 90), half("c", 180)));
    let outputs: Vec<_> = table.channels.iter().map(|c| c.output_pixels).collect();
    assert_eq!(outputs, [[270, 90], [270, 90], [90, 270]]);
    let text = table.to_string();
    for what in ["turned left ", "turned right, mirrored", "upside down ", "90 × 270  270 × 90"] {
        assert!(text.contains(what), "{what}: {text}");
    }
    let json = serde_json::to_string(&table).unwrap();
    assert!(json.contains("\"turn\":\"right\",\"mirror\":true"), "{json}");
}

#[test]
fn hidden_parts_are_told_by_their_own_pixels() {
    let table = config("bezel-2x2.toml");
    let screen = &table.screens[0];
    let [width, height] = screen.pixels.map(f64::from);
    let shown: f64 =
        table.channels.iter().map(|c| f64::from(c.pixels[0]) * f64::from(c.pixels[1])).sum();
    let coverage = &screen.coverage[0];
    assert_eq!(coverage.uncovered_pixels, width * height - shown);
    let [patch] = coverage.uncovered[..] else { panic!("{coverage:?}") };
    assert_eq!(patch.area, coverage.uncovered_pixels);
    let [across, down] = screen.size_m.unwrap();
    let area = across * down * patch.area / (width * height);
    assert!((patch.area_m2.unwrap() / area - 1.0).abs() < 1e-9, "{patch:?}");
    let line = format!("hidden: {} pixels, {area:.3} m², within ", thousands(patch.area as u64));
    let text = table.to_string();
    assert!(text.contains(&line), "{line}: {text}");
}

#[test]
fn every_column_is_explained() {
    for text in [one_tile(""), one_tile("[channel.a]\nstereo = \"top-bottom\"\nmirror = true\n")] {
        let heads = text.lines().find(|line| line.starts_with("channel ")).unwrap();
        let heads = heads.split("  ").map(str::trim).filter(|head| !head.is_empty());
        for head in heads.filter(|head| !matches!(*head, "channel" | "screen" | "server")) {
            assert!(text.contains(&format!("\n{head}: ")), "{head}: {text}");
        }
    }
    assert!(!one_tile("").contains("\noutput: "));
}

fn one_tile(rest: &str) -> String {
    let tile = "[[screen.channel]]\nname = \"a\"\norigin = [0, 0]\npixels = [270, 270]\n";
    one(&format!("{tile}{rest}")).to_string()
}

/// A wall file, and what its only warnings say.
fn warned(text: &str, expected: &[&str]) {
    let warnings = table(text).warnings;
    let mut found = warnings.iter().zip(expected);
    let is_same = warnings.len() == expected.len() && found.all(|(line, what)| line.contains(what));
    assert!(is_same, "{text}\n{warnings:#?}\n{expected:#?}");
}

#[test]
fn implausible_numbers_are_warned_of() {
    let screen = |metres: [f64; 2], distance: f64, pixels: [u32; 2]| {
        format!(
            "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\nsize = {metres:?}\n\
             center = [0.0, 0.0, -{distance:?}]\ntiles.pixels = {pixels:?}\n"
        )
    };
    let good = screen([0.384, 0.216], 0.7, [1920, 1080]);
    // Pixels of 0.2 mm are those of many a desk.
    warned(&good, &[]);
    warned(&screen([4000.0, 2250.0], 3.0, [1920, 1080]), &["4000.0000 × 2250", "mm, where"]);
    warned(&screen([400.0, 225.0], 30.0, [8192, 4608]), &["where 0.01 to 200 m are plausible"]);
    warned(&screen([0.008, 0.0045], 0.05, [1600, 900]), &["0.0080 × 0.0045 m", "0.00500 × 0.00"]);
    warned(&screen([40.0, 22.5], 1000.0, [1920, 1080]), &["it is 1000 m from the eye"]);
    warned(&good.replace("[1920, 1080]", "[1920, 1000]"), &["8.0 % apart"]);
    let near = good.replace("name = \"w\"", "name = \"w\"\nnear = 0.9");
    warned(&near, &["the near plane, 0.9 m, is farther than the screen, 0.700 m"]);
    let apart = "name = \"w\"\neye_separation = 0.63";
    let eyes = good.replace("name = \"w\"", apart) + "[channel.s]\nstereo = \"anaglyph\"\n";
    warned(&eyes, &["eyes are 0.63 m apart"]);
}

#[test]
fn an_eye_behind_a_screen_beside_the_head_is_warned_of() {
    // The left eye is 31.5 mm left of the middle, the screen's plane 20 mm.
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"left\"\nsize = [2.0, 2.0]\n\
                center = [-0.02, 0.0, -1.5]\nrotation = [90, 0, 0]\ntiles.pixels = [200, 200]\n\
                [channel.left]\nstereo = \"side-by-side\"\n";
    let warnings = table(text).warnings;
    assert!(warnings.iter().any(|line| line.contains("left eye")), "{warnings:?}");
}

#[test]
fn screens_in_one_place_are_warned_of_and_screens_that_touch_are_not() {
    let pair = |place: &str| {
        format!(
            "[wall]\nname = \"w\"\neye = [0, 0, 2]\n[[screen]]\nname = \"a\"\nsize = [2.0, 2.0]\n\
             center = [0, 0, -1]\ntiles.pixels = [200, 200]\n[[screen]]\nname = \"b\"\n\
             size = [2.0, 2.0]\n{place}\ntiles.pixels = [200, 200]\n"
        )
    };
    let meets = "so that one hides the other";
    warned(&pair("center = [0.5, 0, -1]"), &["screens a and b lie in the same place"]);
    warned(&pair("center = [0.5, 0, -1]\nrotation = [-40, 0, 0]"), &[meets]);
    warned(&pair("center = [0, 0.3, -1]\nrotation = [0, -30, 0]"), &["cross each other"]);
    // Beside each other, at a right angle, behind each other.
    warned(&pair("center = [2.0, 0, -1]"), &[]);
    warned(&pair("center = [1.0, 0, 0]\nrotation = [-90, 0, 0]"), &[]);
    warned(&pair("center = [0.5, 0, -3]"), &[]);
    let round = pair("center = [0, 0, -1]").replace(
        "size = [2.0, 2.0]\ncenter = [0, 0, -1]\ntiles.pixels = [200, 200]\n[[screen]]",
        "cylinder = { radius = 3, degrees = [-60, 60], height = [-1, 1] }\n\
         tiles.pixels = [628, 200]\n[[screen]]",
    );
    warned(&round, &[]);
    warned(&round.replace("center = [0, 0, -1]", "center = [0, 0, -2.9]"), &["cross each other"]);
}

#[test]
fn viewers_in_the_light_and_servers_in_two_ways_are_warned_of() {
    let beam = |position: [f64; 3], more: &str| {
        format!(
            "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\nsize = [2.0, 1.0]\n\
             pixels = [200, 100]\ncenter = [0, 0, -2]\n\
             [[screen.channel]]\nname = \"c\"\npixels = [200, 100]\n{more}\
             projector = {{ position = {position:?}, look_at = [0, 0, -2], tangents = [-0.27, \
             0.27, -0.15, 0.15] }}\n"
        )
    };
    warned(&beam([0.0, 0.0, 2.0], ""), &["the viewer stands in its projector's light, 2.00 m"]);
    warned(&beam([0.0, 0.1, 0.1], ""), &["0.14 m from the eye, where the viewer's", "no channel"]);
    let second = "server = \"Node\"\n";
    let two = beam([0.0, 1.2, 2.0], second)
        + "[[screen.channel]]\nname = \"d\"\npixels = [20, 20]\norigin = [0, 0]\n\
           server = \"node\"\n";
    let warnings = table(&two).warnings;
    assert!(warnings.iter().any(|line| line.contains("called \"node\", another")), "{warnings:?}");
}
