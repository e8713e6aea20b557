//! `polyptych check` and `polyptych wall`, as an integrator runs them: no number is missing, wrong
//! or infinite, and what a wall file is made of is said.

use serde_json::Value;

use crate::harness::maps;
use crate::harness::place::TestDir;

/// Three projectors in front of a cylinder of 120°, each wider than its part, with keystone.
const OVERSHOOT: &str = r#"[wall]
name = "round"
eye = [0.0, 1.6, 0.0]
[[screen]]
name = "round"
pixels = [2880, 1000]
[screen.cylinder]
radius = 3.0
degrees = [-60, 60]
height = [0.6, 2.6]
[[screen.channel]]
name = "left"
pixels = [960, 600]
projector = { position = [-1.0, 3.0, 0.2], look_at = [-2.1, 1.5, -2.1], degrees = [60, 50] }
[[screen.channel]]
name = "middle"
pixels = [960, 600]
projector = { position = [0.0, 3.0, -0.2], look_at = [0.0, 1.5, -3.0], degrees = [60, 50] }
[[screen.channel]]
name = "right"
pixels = [960, 600]
projector = { position = [1.0, 3.0, 0.2], look_at = [2.1, 1.5, -2.1], degrees = [60, 50] }
"#;

/// Runs `check` in both forms; refuses text and JSON in which a number is none.
fn check(place: &TestDir, name: &str) -> (String, Value) {
    let text = place.run(["check", name]).succeeded();
    let mut words = text.split(|c: char| !c.is_alphanumeric());
    assert!(!words.any(|word| matches!(word, "NaN" | "inf" | "infinity")), "{text}");
    let json = place.run(["check", "--json", name]).succeeded();
    assert!(!json.contains("null"), "{json}");
    (text, serde_json::from_str(&json).expect("JSON"))
}

#[test]
fn projectors_that_overshoot_a_cylinder_have_finite_figures() {
    let place = TestDir::new();
    place.write("wall.toml", OVERSHOOT);
    let (text, json) = check(&place, "wall.toml");
    for channel in json["channels"].as_array().expect("channels") {
        assert!(channel["spill"].as_f64() > Some(0.05), "{channel}");
        let [width, degrees] = ["size_m", "degrees"].map(|key| channel[key][0].as_f64());
        assert!(width > Some(1.0) && width < Some(5.0), "{channel}");
        assert!(degrees > Some(20.0) && degrees < Some(100.0), "{channel}");
        let ratio = channel["projector"]["throw_ratio"].as_f64().expect("a ratio");
        assert!((ratio - 0.5 / 30.0_f64.to_radians().tan()).abs() < 1e-9, "{channel}");
    }
    assert!(text.contains("projector 0.87:1, ") && text.contains("\nspill: the share"), "{text}");
}

#[test]
fn walls_of_calibration_files_have_finite_figures() {
    let place = TestDir::new();
    // Some pixels are unlit, some beside the screen.
    let value = |x: u32, y: u32| match (x, y) {
        (0, 0) => [f32::NAN; 3],
        _ => [x as f32 * 0.24 - 0.84, 0.4 - y as f32 * 0.27, -1.3],
    };
    place.write("front.pfm", maps::pfm([8, 4], 3, true, value));
    place.write(
        "hill.obj",
        "v -1 -1 -2\nv 1 -1 -2\nv 1 1 -2.3\nv -1 1 -2.3\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
         f 1/1 2/2 3/3 4/4\n",
    );
    place.write(
        "wall.toml",
        "[wall]\nname = \"w\"\n[[screen]]\nname = \"flat\"\nsize = [1.6, 0.9]\n\
         center = [0, 0, -1.3]\npixels = [160, 90]\n[[screen.channel]]\nname = \"warped\"\n\
         pixels = [160, 90]\n[[screen]]\nname = \"hill\"\nmesh = \"hill.obj\"\n\
         tiles.pixels = [200, 200]\n[channel.warped]\nwarp = \"front.pfm\"\n",
    );
    let (text, json) = check(&place, "wall.toml");
    let channels = json["channels"].as_array().expect("channels");
    for channel in channels {
        for key in ["size_m", "degrees", "pixels_per_degree", "sampling", "spill"] {
            assert!(channel.get(key).is_some(), "{key}: {channel}\n{text}");
        }
    }
    assert!(text.contains("warp file") && channels[0]["warp"] == "front.pfm", "{text}");
    let [width, height] = [0, 1].map(|axis| json["screens"][1]["size_m"][axis].as_f64());
    assert!(width.is_some_and(|width| (width - 2.0).abs() < 1e-6), "{text}");
    assert!(height.is_some_and(|height| (height - 4.09_f64.sqrt()).abs() < 1e-6), "{text}");
}

#[test]
fn stereo_orientation_and_hidden_pixels_are_told() {
    let place = TestDir::new();
    place.write(
        "wall.toml",
        "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\nsize = [5.4, 2.7]\ncenter = [0, 0, -4]\n\
         pixels = [540, 270]\n[[screen.channel]]\nname = \"a\"\norigin = [0, 0]\n\
         pixels = [270, 270]\n[[screen.channel]]\nname = \"b\"\norigin = [280, 0]\n\
         pixels = [260, 260]\n[[screen.hidden]]\norigin = [270, 0]\npixels = [10, 270]\n\
         [[screen.hidden]]\norigin = [280, 260]\npixels = [260, 10]\n[channel.a]\n\
         stereo = \"side-by-side\"\n[channel.b]\nturn = \"left\"\nmirror = true\n\
         stereo = \"top-bottom\"\n",
    );
    let (text, json) = check(&place, "wall.toml");
    for what in ["540 × 270", "both, side by side", "turned left, mirrored", "stereo: both eyes"] {
        assert!(text.contains(what), "{what}: {text}");
    }
    let hidden = &json["screens"][0]["coverage"][0];
    assert_eq!(hidden["uncovered_pixels"], 5300.0, "{text}");
    assert!(text.contains("hidden: 5,300 pixels, 0.530 m², within 270 × 270 pixels"), "{text}");
    assert_eq!(json["channels"][1]["output_pixels"], serde_json::json!([260, 520]));
}

#[test]
fn a_screen_of_four_kilometres_is_warned_of() {
    let place = TestDir::new();
    place.write(
        "wall.toml",
        "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\nsize = [4000, 2250]\n\
         center = [0, 0, -3]\ntiles.pixels = [1920, 1080]\n",
    );
    let (text, _) = check(&place, "wall.toml");
    assert!(text.contains("warning: screen s: it is 4000.0000 × 2250.0000 m"), "{text}");
}

/// Returns the output of the command that writes a wall, and that of `check` for the wall.
fn generated(place: &TestDir, arguments: &[&str]) -> (String, String) {
    let said = place.run(["wall"].iter().chain(arguments).chain(&["-o", "made.toml"])).succeeded();
    let (checked, _) = check(place, "made.toml");
    assert!(!said.contains("warning") && !checked.contains("warning"), "{said}\n{checked}");
    std::fs::remove_file(place.path("made.toml")).expect("removed");
    (said, checked)
}

#[test]
fn generated_walls_say_whether_they_are_panels_or_projectors() {
    let place = TestDir::new();
    let (said, checked) = generated(&place, &["cylinder", "--degrees", "180", "--overlap", "100"]);
    assert!(said.contains("14 channels on the surface: panels, or projectors that"), "{said}");
    assert!(checked.contains("  tile  "), "{checked}");
    let line =
        ["cylinder", "--projectors", "--degrees", "120", "--throw", "1.2", "--overlap", "15"];
    let (said, checked) = generated(&place, &line);
    assert!(said.contains("2 channels of projectors by pose, throw 1.20:1"), "{said}");
    assert!(checked.contains("projector 1.20:1, ") && checked.contains("100.00 %"), "{checked}");
    let few = place.run(["wall", "cylinder", "--projectors", "--channels", "3", "--throw", "1.2"]);
    few.failed(&["3 projectors with a throw ratio of 1.2:1 cannot light this screen", " works"]);
}

#[test]
fn a_drawing_is_written_beside_the_table_and_a_folder_is_refused_before() {
    let place = TestDir::new();
    place.write("wall.toml", OVERSHOOT);
    let text = place.run(["check", "wall.toml", "--svg", "wall.svg"]).succeeded();
    assert!(text.contains("spill: the share"), "{text}");
    let svg = std::fs::read_to_string(place.path("wall.svg")).expect("a drawing");
    let document = roxmltree::Document::parse(&svg).expect("XML");
    let beams = document
        .descendants()
        .filter(|node| node.attribute("class").is_some_and(|class| class.starts_with("w-beam ")));
    // Three projectors in two views, and the legend.
    assert_eq!(beams.count(), 7);
    place.run(["check", "wall.toml", "--svg", "."]).failed(&["cannot write ."]);
}
