//! `polyptych prove`, on real servers: of a wall that is right, and of one that is not.

use polyptych_protocol::wall::file;

use crate::harness::place::Place;
use crate::harness::scenes::town;

/// Two overlapping projectors whose black leaks.
const WALL: &str = r#"[wall]
name = "pair"
[blend]
leak = 0.003
[[screen]]
name = "front"
size = [2.4, 0.9]
center = [0.0, 0.0, -1.5]
[screen.tiles]
columns = 2
pixels = [320, 224]
overlap = [80, 0]
"#;

#[test]
fn a_wall_that_is_right_keeps_its_targets_and_one_that_is_not_does_not() {
    let place = Place::new();
    let town = town().display().to_string();
    let prove = |text: &str| {
        file::parse(text, "wall.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"));
        let wall = place.write("wall.toml", text).display().to_string();
        let out = place.path("out").display().to_string();
        let run = place.run(["prove", &wall, &town, "--out", &out]);
        let json = std::fs::read(place.path("out").join("prove.json")).expect("a table");
        let table: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
        let rows = table["rows"].as_array().expect("rows").clone();
        (run.code(), rows, run.output)
    };
    let (code, rows, said) = prove(WALL);
    // It says what it does before it prints what came of that.
    let steps: Vec<_> = (1..=7).filter_map(|n| said.find(&format!("step {n} of 7: "))).collect();
    assert_eq!(steps.len(), 7, "{said}");
    let headings = said.lines().find(|line| line.starts_with("what ")).expect("headings");
    for heading in ["measured", "target", "kept", "where"] {
        assert!(headings.contains(heading), "{headings}");
    }
    let judged = rows.iter().filter(|row| !row["target"].is_null()).count();
    assert!(said.contains(&format!("targets kept: {judged} of {judged}")), "{said}");
    let find = |rows: &[serde_json::Value], what: &str| {
        let row = rows.iter().find(|row| row["what"] == what);
        row.unwrap_or_else(|| panic!("no row {what} in {rows:?}")).clone()
    };
    for what in ["points", "points, 1e7 m away", "sum of blend weights, off 1", "black"] {
        let row = find(&rows, what);
        assert!(row["is_kept"] == true && row["measured"].is_f64(), "{row}");
    }
    assert_eq!(find(&rows, "pixels within 2 levels, superposed")["is_kept"], true);
    assert_eq!(code, 0, "{rows:?}");
    for picture in ["wall.png", "markers.png", "single-front.png", "difference-front.png"] {
        image::open(place.path("out").join(picture)).expect("a picture");
    }

    // Steps of 20 %, as coarse as nobody measured them: each code is far from its light.
    let curve = "[channel.front-1-1]\ncurve = [0, 0, 0, 0, 0, 1]\n";
    let (code, rows, _) = prove(&[WALL, curve].concat());
    assert!(code == 1 && rows.iter().any(|row| row["is_kept"] == false), "{rows:?}");
}
