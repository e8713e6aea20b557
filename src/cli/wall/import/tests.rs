//! Files of Tide and Equalizer, and what is no configuration, as a user gives them.

use polyptych_wall::Wall;

use super::super::made::Shape;
use super::*;

/// Imports a text as a file of this name; returns the wall and what is told.
fn import(name: &str, text: &str) -> anyhow::Result<(Wall, Vec<String>)> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(name);
    fs::write(&path, text)?;
    let output = folder.path().join("out");
    let arguments = Arguments { file: path, output, width: 4.0, distance: 3.0, force: false };
    let (made, tree) = read_configuration(&arguments)?;
    made.write(&arguments.output, false)?;
    let wall_file = arguments.output.join("wall.toml");
    let text = fs::read_to_string(&wall_file)?;
    let wall = polyptych_wall_file::parse(&text, &wall_file)
        .map_err(|error| anyhow::anyhow!("{error}"))?;
    let told = [tree.warnings.take(), tree.notes.take()].concat();
    assert!(told.iter().all(|line| text.contains(line.as_str())), "{told:?}\n{text}");
    Ok((wall, told))
}

fn refused(name: &str, text: &str, part: &str) {
    let error = import(name, text).expect_err(part).to_string();
    assert!(error.contains(part), "{part}: {error}");
}

#[test]
fn tide_says_tiles_and_their_processes() {
    let text = r#"{"master": {"host": "a", "display": ":0"}, "background": {"color": "white"},
        "processes": [
        {"host": "b", "screens": [{"display": ":0"}, {"display": ":0", "j": 1}]},
        {"host": "c", "screens": [{"i": 1, "x": 400}, {"i": 1, "j": 1}]}],
        "surfaces": [{"displayWidth": 400, "displayHeight": 300, "numScreensX": 2,
        "numScreensY": 2, "bezelWidth": 20, "bezelHeight": 10}]}"#;
    let (wall, told) = import("hall.json", text).expect("a wall");
    let names: Vec<_> =
        wall.channels.iter().map(|c| (c.name.as_str(), c.server.as_str())).collect();
    let due = [
        ("surface-1-1-1", "process-1"),
        ("surface-1-2-1", "process-2"),
        ("surface-1-1-2", "process-1"),
        ("surface-1-2-2", "process-2"),
    ];
    assert_eq!(names, due);
    assert_eq!(wall.screens[0].canvas.to_array(), [820, 610]);
    assert!(told.iter().any(|line| line.contains("nothing of metres")), "{told:?}");
    // The older XML of DisplayCluster, and displays that overlap, for two eyes.
    let old = r#"<configuration><dimensions numTilesWidth="3" numTilesHeight="1" screenWidth="640"
        screenHeight="480" mullionWidth="0" mullionHeight="0" fullscreen="1"/></configuration>"#;
    let (wall, _) = import("wall.xml", old).expect("a wall");
    assert_eq!((wall.channels.len(), wall.screens[0].canvas.to_array()), (3, [1920, 480]));
    let stereo = r#"{"processes": [{"screens": [{"stereo": "left"}]},
        {"screens": [{"stereo": "right"}]}, {"screens": [{"stereo": "left", "i": 1}]},
        {"screens": [{"stereo": "right", "i": 1}]}],
        "surfaces": [{"displayWidth": 960, "displayHeight": 540, "numScreensX": 2,
        "bezelWidth": -60}]}"#;
    let (wall, _) = import("stereo.json", stereo).expect("a wall");
    assert_eq!((wall.channels.len(), wall.screens[0].canvas.x), (4, 1860));
    refused("a.json", &text.replace("\"i\": 1, \"j\": 1", "\"i\": 1"), "show the same tile");
    refused(
        "a.json",
        &text.replace("\"displayWidth\": 400, ", ""),
        "displaywidth: the key is missing",
    );
    refused("a.json", &text.replace("20", "-500"), "leave no picture");
}

#[test]
fn equalizer_says_walls_of_segments() {
    let text = r#"#Equalizer 1.0 ascii
        server { config {
            attributes { eye_base 0.07 }
            appNode { pipe { window { viewport [ 10 20 1200 400 ]
                channel { viewport [ 0 0 400 400 ] name "left" }
                channel { viewport [ 0.5 0 .5 1 ] name "right" } } } }
            canvas {
                wall { bottom_left [ -2 -1 -3 ] bottom_right [ 2 -1 -3 ] top_left [ -2 1 -3 ] }
                segment { channel "left" viewport [ 0 0 .5 1 ] }   # a half of it
                segment { channel "right" eye [ LEFT ]
                    projection { origin [ 0 0 0 ] distance 3 fov [ 54 40 ] hpr [ 50 0 0 ] } }
            } } }"#;
    let (wall, told) = import("cave.eqc", text).expect("a wall");
    assert_eq!(wall.eye_separation_m, 0.07);
    let sizes: Vec<_> = wall.screens.iter().map(|screen| screen.canvas.to_array()).collect();
    assert_eq!(sizes, [[400, 400], [600, 400]]);
    let made = eqc::read(&eqc::parse(Path::new("a.eqc"), text).expect("a tree")).expect("a wall");
    let Shape::Plane(left) = made.screens[0].shape else { panic!("{made:?}") };
    let half =
        [DVec3::new(-2.0, -1.0, -3.0), DVec3::new(0.0, -1.0, -3.0), DVec3::new(-2.0, 1.0, -3.0)];
    assert_eq!(left, half);
    let Shape::Plane([a, b, c]) = made.screens[1].shape else { panic!("{made:?}") };
    // Its middle is 3 m away, 50° to the left; it is as wide as 54° there.
    let middle = (b + c) / 2.0;
    let due = DVec3::new(-(50f64.to_radians().sin()), 0.0, -(50f64.to_radians().cos())) * 3.0;
    assert!(middle.distance(due) < 1e-9, "{middle}");
    assert!((a.distance(b) - 6.0 * 27f64.to_radians().tan()).abs() < 1e-9);
    assert!(told.iter().any(|line| line.contains("compounds")), "{told:?}");
    refused(
        "a.eqc",
        &text.replace("\"left\" viewport", "\"lost\" viewport"),
        "no channel \"lost\"",
    );
    refused("a.eqc", &text.replace("[ -2 -1 -3 ]", "[ -2 -1 ]"), "2 numbers; 3 are right");
    refused("a.eqc", &text.replace("[ -2 -1 -3 ]", "[ -2 -1"), "is not closed");
    refused("a.eqc", &format!("{text} }}"), "one } too many");
    refused("a.eqc", "server { config { } }", "no segment of a canvas");
}

#[test]
fn files_of_no_system_are_refused() {
    refused("a.toml", "[wall]\nname = \"a\"", "is no configuration");
    refused("a.xml", "<html/>", "<html> is not known");
    refused("a.json", "{}", "masteraddress: the key is missing");
}
