//! `polyptych prove`, on real servers: of walls that are right, and of others that are not.

use std::f64::consts::TAU;
use std::fmt::Write;

use serde_json::Value;

use crate::harness::maps::{Png, png};
use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, town};

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

/// The rows of a proof, and its exit code.
struct Proof {
    code: i32,
    rows: Vec<Value>,
    said: String,
}

impl Proof {
    /// Runs `prove` on the text of a wall file, and of one as built.
    fn of(place: &TestDir, wall: &str, built: Option<&str>, scene: &str) -> Self {
        let wall = place.write("wall.toml", wall).display().to_string();
        let out = place.path("out").display().to_string();
        let mut arguments = vec!["prove".to_owned(), wall, scene.to_owned(), "--out".into(), out];
        arguments.extend(["--html".to_owned(), place.path("proof.html").display().to_string()]);
        if let Some(built) = built {
            arguments.push("--as-built".into());
            arguments.push(place.write("built.toml", built).display().to_string());
        }
        let run = place.run(&arguments);
        let json = std::fs::read(place.path("out").join("prove.json"));
        let json = json.unwrap_or_else(|error| panic!("{error}: {}", run.output));
        let table: Value = serde_json::from_slice(&json).expect("JSON");
        let rows = table["rows"].as_array().expect("rows").clone();
        Self { code: run.code(), rows, said: run.output }
    }

    fn row(&self, what: &str) -> &Value {
        let row = self.rows.iter().find(|row| row["what"] == what);
        row.unwrap_or_else(|| panic!("no row {what} in {:?}", self.rows))
    }

    fn missed(&self) -> Vec<&str> {
        let missed = self.rows.iter().filter(|row| row["is_kept"] == false);
        missed.filter_map(|row| row["what"].as_str()).collect()
    }
}

#[test]
fn a_proof_says_what_it_does_and_what_its_rows_mean() {
    let place = TestDir::new();
    let proof = Proof::of(&place, WALL, None, &town().display().to_string());
    let Proof { code, rows, said } = &proof;
    // It says what it does before it prints what came of that.
    let steps: Vec<_> = (1..=9).filter_map(|n| said.find(&format!("step {n} of 9: "))).collect();
    assert_eq!(steps.len(), 9, "{said}");
    let headings = said.lines().find(|line| line.starts_with("what ")).expect("headings");
    for heading in ["measured", "target", "kept", "where"] {
        assert!(headings.contains(heading), "{headings}");
    }
    let judged = rows.iter().filter(|row| !row["target"].is_null()).count();
    assert!(said.contains(&format!("targets kept: {judged} of {judged}")), "{said}");
    for what in [
        "points",
        "points, 1e7 m away",
        "sum of blend weights, off 1",
        "black",
        "points in views of their own",
    ] {
        let row = proof.row(what);
        assert!(row["is_kept"] == true && row["measured"].is_f64(), "{row}");
    }
    assert_eq!(proof.row("pixels within 2 levels, superposed")["is_kept"], true);
    assert!(proof.row("displays that hang or shine otherwise")["measured"].is_null());
    assert_eq!(*code, 0, "{rows:?}");
    for picture in ["wall.png", "markers.png", "single-front.png", "difference-front.png"] {
        image::open(place.path("out").join(picture)).expect("a picture");
    }
    let page = std::fs::read_to_string(place.path("proof.html")).expect("a page");
    let document = roxmltree::Document::parse(page.split_once('\n').expect("lines").1);
    let document = document.expect("XML");
    let of_class = |class: &str| {
        let nodes = document.descendants().filter_map(|node| node.attribute("class"));
        nodes.filter(|has| has.split(' ').any(|word| word == class)).count()
    };
    assert!(of_class("mark-ring") > 4, "points on the picture");
    assert_eq!(of_class("spread"), 1, "errors by channel");
    assert_eq!((of_class("picture"), of_class("w-view")), (2, 2), "wall, difference; two views");
}

/// A smaller wall, with more keys of its first channel.
fn small(keys: &str) -> String {
    let wall = WALL.replace("[320, 224]", "[160, 112]").replace("[80, 0]", "[40, 0]");
    format!("{wall}[channel.front-1-1]\n{keys}\n")
}

/// Masks that fade over the overlap, to the right and to the left, and one that does so some
/// pixels too early.
fn write_masks(place: &TestDir) {
    // Where its light ends, and which way it fades.
    let masks = [("right.png", 160.0, -1.0), ("left.png", 0.0, 1.0), ("early.png", 156.0, -1.0)];
    for (name, edge, way) in masks {
        let share = |x: u32| ((f64::from(x) + 0.5 - edge) * way / 40.0).clamp(0.0, 1.0);
        let texels: Vec<u16> =
            (0..160 * 4).map(|i| (share(i % 160) * 65535.0).round() as u16).collect();
        let picture =
            Png { size: [160, 4], color: 0, bits: 16, gamma: Some(100_000), texels: &texels };
        place.write(name, png(&picture));
    }
}

/// Keys of both channels whose alpha files share the light.
fn shared_by(alpha: &str) -> String {
    let of = |file: &str| format!("alpha = \"{file}\"\nramps = \"alpha\"\n");
    format!("{}[channel.front-2-1]\n{}", of(alpha), of("left.png"))
}

#[test]
fn each_fault_fails_a_row_and_no_right_wall_does() {
    let place = TestDir::new();
    let scene = place.write("triangle.glb", Gltf::triangle().glb()).display().to_string();
    write_masks(&place);
    let [alphas, shifted] = ["right.png", "early.png"].map(shared_by);
    // What is drawn, and what stands, by keys of one channel: only who says what stands can tell
    // that a display shines or hangs otherwise.
    let faults = [
        ("gain = 0.7", None),
        ("alpha = \"right.png\"", None),
        (&shifted, None),
        ("matrix = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]", None),
        ("gamma = 1.8", Some("")),
        ("mirror = true", Some("")),
        ("", Some("pin = [[0, 0], [1, 0], [0, 0], [0, 0]]")),
        ("gain = 0.7", Some("gain = 0.8")),
        ("leak = 0.01", Some("")),
    ];
    for (drawn, built) in faults {
        let built = built.map(small);
        let proof = Proof::of(&place, &small(drawn), built.as_deref(), &scene);
        assert!(proof.code == 1 && !proof.missed().is_empty(), "{drawn}: {:?}", proof.rows);
    }
    let measured = "gain = 0.8\nmatrix = [[0.9, 0.1, 0], [0, 1, 0], [0, 0, 1]]\ngamma = 2.2";
    let right = [
        ("mirror = true", None),
        ("edges = { right = 20 }", None),
        ("turn = \"half\"", None),
        ("bits = 10", None),
        ("gamma = 1.8", None),
        (&alphas, None),
        (measured, Some(measured)),
        ("gain = 0.8", Some("gain = 0.8")),
        ("leak = [0.01, 0.004, 0.006]", None),
    ];
    for (drawn, built) in right {
        let built = built.map(small);
        let proof = Proof::of(&place, &small(drawn), built.as_deref(), &scene);
        assert!(proof.code == 0 && proof.missed().is_empty(), "{drawn}: {:?}", proof.missed());
    }
}

#[test]
fn an_eye_close_to_its_screen_is_proved_too() {
    let place = TestDir::new();
    let scene = place.write("triangle.glb", Gltf::triangle().glb()).display().to_string();
    let wall = small("").replace("center = [0.0, 0.0, -1.5]", "center = [0.0, 0.0, -0.005]");
    let proof = Proof::of(&place, &wall, None, &scene);
    assert!(proof.code == 0 && proof.missed().is_empty(), "{:?}", proof.rows);
}

/// Both channels of the small wall with the pictures of two eyes, and more keys of each.
fn stereo([first, second]: [&str; 2]) -> String {
    format!("{}[channel.front-2-1]\n{second}\n", small(first))
}

#[test]
fn displays_for_two_eyes_are_proved_for_both() {
    let place = TestDir::new();
    let scene = place.write("triangle.glb", Gltf::triangle().glb()).display().to_string();
    let beside = stereo([
        "stereo = \"side-by-side\"\nturn = \"left\"",
        "stereo = \"top-bottom\"\nmirror = true",
    ]);
    let red_and_cyan = stereo(["stereo = \"anaglyph\""; 2]);
    for wall in [&beside, &red_and_cyan] {
        let proof = Proof::of(&place, wall, None, &scene);
        assert!(proof.code == 0 && proof.missed().is_empty(), "{:?}", proof.rows);
    }
    // A viewer with eyes further apart would see what lies behind the screen elsewhere.
    let built = beside.replace("name = \"pair\"", "name = \"pair\"\neye_separation = 0.2");
    let proof = Proof::of(&place, &beside, Some(&built), &scene);
    assert!(proof.code == 1 && proof.missed().contains(&"points"), "{:?}", proof.rows);
    let row = proof.row("points");
    let note = row["note"].as_str().expect("a note");
    assert!(note.contains("left eye") || note.contains("right eye"), "{row}");
}

/// A dome of 160° as points on a disc, in the middle of a canvas of which the corners lie nowhere,
/// turned to the left by some degrees.
fn dome(degrees: f64) -> String {
    const RINGS: u32 = 12;
    const AROUND: u32 = 48;
    let (sin, cos) = degrees.to_radians().sin_cos();
    let mut text = String::new();
    let mut add = |share: f64, around: f64| {
        let ((up, right), (out, ahead)) =
            ((around * TAU).sin_cos(), (share * 80.0).to_radians().sin_cos());
        let [x, y, z] = [out * right, out * up, -ahead].map(|length| length * 2.0);
        let [u, v] = [right, up].map(|side| 0.5 + 0.5 * share * side);
        let [x, z] = [x * cos + z * sin, z * cos - x * sin];
        let _ = write!(text, "v {x} {y} {z}\nvt {u} {v}\n");
    };
    add(0.0, 0.0);
    for (ring, at) in (1..=RINGS).flat_map(|ring| (0..AROUND).map(move |at| (ring, at))) {
        add(f64::from(ring) / f64::from(RINGS), f64::from(at) / f64::from(AROUND));
    }
    let corner = |ring: u32, at: u32| 2 + (ring - 1) * AROUND + at % AROUND;
    for at in 0..AROUND {
        let mut faces = vec![vec![1, corner(1, at), corner(1, at + 1)]];
        for ring in 1..RINGS {
            let [a, b] = [at, at + 1].map(|at| [corner(ring, at), corner(ring + 1, at)]);
            faces.push(vec![a[0], a[1], b[1], b[0]]);
        }
        for face in faces {
            let words: Vec<String> = face.iter().map(|at| format!("{at}/{at}")).collect();
            let _ = writeln!(text, "f {}", words.join(" "));
        }
    }
    text
}

#[test]
fn a_dome_of_points_is_proved_where_it_is() {
    const DOME: &str = "[wall]\nname = \"planetarium\"\n[[screen]]\nname = \"dome\"\n\
                        mesh = \"dome.obj\"\n[screen.tiles]\npixels = [192, 192]\n";
    let place = TestDir::new();
    let scene = place.write("triangle.glb", Gltf::triangle().glb()).display().to_string();
    place.write("dome.obj", dome(0.0));
    place.write("turned.obj", dome(1.0));
    // The corners of its channel are dark, as no light of them would fall on anything.
    let proof = Proof::of(&place, DOME, None, &scene);
    assert!(proof.code == 0 && proof.missed().is_empty(), "{:?}", proof.rows);
    for what in ["warped points", "superposed codes"] {
        assert!(proof.row(what)["measured"].is_f64(), "{:?}", proof.row(what));
    }
    let turned = DOME.replace("dome.obj", "turned.obj");
    let proof = Proof::of(&place, DOME, Some(&turned), &scene);
    assert!(proof.missed().contains(&"warped points"), "{:?}", proof.rows);
}
