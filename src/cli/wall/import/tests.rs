//! Files of Tide and Equalizer, and what is no configuration, as a user gives them.

use polyptych_wall::{StereoPacking, Wall};

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
        "surfaces": [{"displayWidth": 960, "displayHeight": 540, "screenCountX": 2,
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
fn tide_joins_displays_to_screens_and_gives_processes_an_eye() {
    let text = r#"<configuration><dimensions numScreensX="2" displayWidth="1920"
        displayHeight="1080" displaysPerScreenX="2" bezelWidth="14"/>
        <process host="a" stereo="left"><screen/><screen i="1"/></process>
        <process host="b" stereo="right"><screen/><screen i="1"/></process></configuration>"#;
    let (wall, _) = import("hall.xml", text).expect("a wall");
    let found: Vec<_> = wall.channels.iter().map(|c| (c.name.as_str(), c.size.x)).collect();
    let due = ["1-1-left", "2-1-left", "1-1-right", "2-1-right"];
    let due = due.map(|name| format!("surface-1-{name}"));
    assert_eq!(found, due.each_ref().map(|name| (name.as_str(), 2 * 1920 + 14)));
    assert_eq!(wall.screens[0].canvas.x, 2 * (2 * 1920 + 14) + 14);
    refused("a.xml", &text.replace("ScreenX=\"2\"", "ScreenX=\"5\""), "of 5 displays has 9656");
    refused("a.xml", &text.replace("\"left\"", "\"both\""), "there is no eye both");
}

#[test]
fn tide_says_the_eyes_of_each_tile() {
    let text = r#"{"processes": [{"screens": [{"stereo": "left"}]},
        {"screens": [{"stereo": "right"}]}, {"screens": [{"i": 1}, {"i": 2}]},
        {"screens": [{"i": 0}]}],
        "surfaces": [{"displayWidth": 960, "displayHeight": 540, "screenCountX": 4}]}"#;
    let (wall, told) = import("hall.json", text).expect("a wall");
    let found: Vec<_> =
        wall.channels.iter().map(|c| (c.name.as_str(), c.server.as_str())).collect();
    let due = [
        ("surface-1-2-1", "process-3"),
        ("surface-1-3-1", "process-3"),
        ("surface-1-1-1-left", "process-1"),
        ("surface-1-4-1-left", "surface-1-4-1-left"),
        ("surface-1-1-1-right", "process-2"),
        ("surface-1-4-1-right", "surface-1-4-1-right"),
    ];
    assert_eq!(found, due);
    assert!(told.iter().any(|line| line.contains("of process-4 is left out")), "{told:?}");
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
fn equalizer_has_defaults_for_what_a_file_leaves_out() {
    let text = r#"#Equalizer 1.0 ascii
        global { EQ_CONFIG_FATTR_EYE_BASE 0.07 }
        server { config {
            appNode { pipe { window { viewport [ 0 0 .5 1 ] channel { name "ß" } } } }
            canvas {
                wall { type HMD top_left [ -0.8 1.5 -1 ] }
                segment { channel "ß" }
                segment { channel "ß" projection { } }
            } } }"#;
    let (wall, told) = import("Übersicht.eqc", text).expect("a wall");
    assert_eq!((wall.name.as_str(), wall.eye_separation_m), ("bersicht", 0.07));
    let names: Vec<_> = wall.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["channel", "channel-2"]);
    assert_eq!(wall.screens[0].canvas.to_array(), [960, 1080]);
    assert!(told.iter().any(|line| line.contains("display of 1920 × 1080")), "{told:?}");
    let made = eqc::read(&eqc::parse(Path::new("a.eqc"), text).expect("a tree")).expect("a wall");
    let usual =
        [DVec3::new(-0.8, -0.5, -1.0), DVec3::new(0.8, -0.5, -1.0), DVec3::new(-0.8, 0.5, -1.0)];
    for (screen, top) in made.screens.iter().zip([1.5, 0.5]) {
        let Shape::Plane(corners) = screen.shape else { panic!("{made:?}") };
        let due = [usual[0], usual[1], usual[2].with_y(top)];
        for (corner, due) in corners.into_iter().zip(due) {
            assert!(corner.distance(due) < 1e-5, "{corner} is not {due}");
        }
    }
}

/// A configuration of channels a, b and c with these fields of its pipe, its window, its canvas and
/// the configuration itself.
fn equalizer([pipe, window, canvas, config]: [&str; 4]) -> String {
    format!(
        r#"#Equalizer 1.1 ascii
        server {{ config {{
            appNode {{ pipe {{ {pipe} window {{ {window}
                channel {{ name "a" }} channel {{ name "b" }} channel {{ name "c" }} }} }} }}
            canvas {{ {canvas} }}
            {config} }} }}"#
    )
}

fn read_equalizer(text: &str) -> Made {
    eqc::read(&eqc::parse(Path::new("a.eqc"), text).expect("a tree")).expect("a wall")
}

#[test]
fn equalizer_says_the_eyes_of_segments() {
    use super::super::made::OneEye::{Left, Right};
    for (words, due) in [
        ("eye [ LEFT ]", Some(Left)),
        ("eye [ LEFT CYCLOP ]", Some(Left)),
        ("eye [ CYCLOP right ]", Some(Right)),
        ("eye [ LEFT RIGHT ]", None),
        ("eye [ CYCLOP LEFT RIGHT ]", None),
        ("eye [ CYCLOP ]", None),
        ("", None),
    ] {
        let canvas = format!(r#"wall {{ }} segment {{ channel "a" {words} }}"#);
        let made = read_equalizer(&equalizer(["", "", &canvas, ""]));
        assert_eq!(made.screens[0].eye, due, "{words}");
    }
    let canvas = r#"wall { } segment { channel "a" eye [ LEFT CYCLOP ] }
        segment { channel "b" eye [ RIGHT CYCLOP ] }"#;
    let text = equalizer(["", "", canvas, ""]);
    let (wall, _) = import("a.eqc", &text).expect("a wall");
    assert_eq!((wall.screens.len(), wall.channels.len()), (1, 2), "one screen for both eyes");
    refused("a.eqc", &text.replace("RIGHT", "RIHGT"), "there is no eye RIHGT");
}

#[test]
fn equalizer_says_channels_without_stereo_beside_those_of_the_eyes() {
    let canvas = r#"wall { } segment { channel "a" eye [ LEFT ] }
        segment { channel "b" eye [ RIGHT ] } segment { channel "c" eye [ CYCLOP ] }"#;
    let names = |canvas: &str| {
        let (wall, told) = import("a.eqc", &equalizer(["", "", canvas, ""])).expect("a wall");
        let is_told = told.iter().any(|line| line.contains("channel \"c\" is left out"));
        (wall.channels.into_iter().map(|channel| channel.name).collect::<Vec<_>>(), is_told)
    };
    let own = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    assert_eq!(names(canvas), (own(&["a", "b"]), true));
    // Elsewhere, or where no channel shows the right eye's picture, it is another display.
    let elsewhere = canvas.replace("\"c\"", "\"c\" viewport [ 0 0 .5 1 ]");
    assert_eq!(names(&elsewhere), (own(&["a", "b", "c"]), false));
    assert_eq!(names(&canvas.replace("RIGHT", "LEFT")), (own(&["a", "b", "c"]), false));
}

#[test]
fn equalizer_says_the_eyes_of_observers() {
    let canvas = r#"wall { } segment { channel "a" }"#;
    for (config, eye, separation) in [
        ("", DVec3::ZERO, 0.05),
        ("observer { }", DVec3::ZERO, 0.05),
        ("attributes { eye_base 0.06 } observer { }", DVec3::ZERO, 0.06),
        ("attributes { eye_base 0.06 } observer { eye_base 0.07 }", DVec3::ZERO, 0.07),
        (
            "observer { eye_left [ -.035 0 0 ] eye_right [ .035 0 0 ] eye_cyclop [ 0 0 0.125 ] }",
            DVec3::Z * 0.125,
            0.07,
        ),
        (
            "observer { eye_left [ 0 .25 0 ] eye_right [ .0625 .25 0 ] }",
            DVec3::new(0.03125, 0.25, 0.0),
            0.0625,
        ),
    ] {
        let text = equalizer(["", "", canvas, config]);
        let made = read_equalizer(&text);
        assert_eq!((made.eye, made.eye_separation), (eye, Some(separation)), "{config}");
        let (wall, told) = import("a.eqc", &text).expect(config);
        assert_eq!(wall.eye_separation_m, separation, "{config}");
        assert!(!told.iter().any(|line| line.contains("observers")), "{config}: {told:?}");
    }
    let config = "observer { eye_base 0.07 } observer { eye_base 0.06 }";
    let (_, told) = import("a.eqc", &equalizer(["", "", canvas, config])).expect("a wall");
    assert!(told.iter().any(|line| line.contains("observers have different eyes")), "{told:?}");
}

#[test]
fn equalizer_says_the_stereo_of_channels_for_both_eyes() {
    let stereo = "layout { view { mode STEREO } }";
    let compound = "compound { compound { attributes { stereo_mode ANAGLYPH } } }";
    let quad = "attributes { hint_stereo ON }";
    let no_quad = "attributes { hint_stereo off }";
    let passive = r#"segment { channel "a" eye [ LEFT ] } segment { channel "b" eye [ RIGHT ] }"#;
    let both = r#"segment { channel "a" }"#;
    let mono = r#"segment { channel "a" eye [ CYCLOP ] }"#;
    for (global, window, segments, config, due) in [
        ("", "", both, "layout { view { } }", ""),
        ("", quad, both, "", "warning"),
        ("", "", both, stereo, "warning"),
        ("EQ_WINDOW_IATTR_HINT_STEREO ON", "", both, "", "warning"),
        ("EQ_WINDOW_IATTR_HINT_STEREO ON", no_quad, both, "", ""),
        ("", quad, passive, stereo, ""),
        ("", quad, mono, stereo, ""),
        ("EQ_COMPOUND_IATTR_STEREO_MODE anaglyph", quad, both, stereo, "anaglyph"),
        ("", "", both, compound, "anaglyph"),
        ("", "", passive, compound, ""),
    ] {
        let text = equalizer(["", window, &format!("wall {{ }} {segments}"), config]);
        let text = text.replacen("server", &format!("global {{ {global} }} server"), 1);
        let (wall, told) = import("a.eqc", &text).expect("a wall");
        let is_told = told.iter().any(|line| line.contains("stereo quadbuffer is not known"));
        assert_eq!(is_told, due == "warning", "{text}: {told:?}");
        let packing = wall.channels[0].adjustment.packing;
        assert_eq!(packing == StereoPacking::Anaglyph, due == "anaglyph", "{text}");
    }
}

#[test]
fn equalizer_says_pixels_of_pipes() {
    let canvas = r#"wall { } segment { channel "a" }"#;
    let pipe = "viewport [ 0 0 3840 2160 ]";
    let [share, pixels] = ["viewport [ 0 0 .5 1 ]", "viewport [ 9 9 800 600 ]"];
    for (pipe, window, size, is_guess) in [
        (pipe, "", [3840, 2160], false),
        (pipe, share, [1920, 2160], false),
        (pipe, pixels, [800, 600], false),
        ("", pixels, [800, 600], false),
        ("", share, [960, 1080], true),
        ("", "", [1920, 1080], true),
    ] {
        let text = equalizer([pipe, window, canvas, ""]);
        let (wall, told) = import("a.eqc", &text).expect("a wall");
        assert_eq!(wall.channels[0].size.to_array(), size, "{text}");
        let is_told = told.iter().any(|line| line.contains("display of 1920 × 1080"));
        assert_eq!(is_told, is_guess, "{text}: {told:?}");
    }
}

#[test]
fn equalizer_says_walls_of_views() {
    let wall = |x: f64, width: f64| {
        format!(
            "wall {{ bottom_left [ {x} -1 -3 ] bottom_right [ {} -1 -3 ] top_left [ {x} 1 -3 ] }}",
            x + width
        )
    };
    let layouts = format!(
        r#"layout {{ name "first" view {{ {} }} }} layout {{ name "halves"
            view {{ viewport [ 0 0 .5 1 ] {} }} view {{ viewport [ .5 0 .5 1 ] {} }} }}
            layout {{ view {{ }} }}"#,
        wall(-4.0, 8.0),
        wall(-2.0, 2.0),
        wall(1.0, 4.0)
    );
    let segments = r#"segment { channel "a" viewport [ 0 0 .5 1 ] }
        segment { channel "b" viewport [ .75 0 .25 1 ] }"#;
    // Left edges and widths of both segments.
    for (canvas, due) in [
        ("", Some([[-4.0, 4.0], [2.0, 2.0]])),
        ("layout 0", Some([[-4.0, 4.0], [2.0, 2.0]])),
        (r#"layout "halves""#, Some([[-2.0, 2.0], [3.0, 2.0]])),
        (r#"name "hall" layout 2"#, None),
        (r#"name "hall" layout OFF"#, None),
    ] {
        let text = equalizer(["", "", &format!("{canvas} {segments}"), &layouts]);
        let (_, told) = import("a.eqc", &text).expect(canvas);
        let is_told = told.iter().any(|line| line.contains("the canvas hall has no wall"));
        assert_eq!(is_told, due.is_none(), "{canvas}: {told:?}");
        let made = read_equalizer(&text);
        for (screen, [x, width]) in made.screens.iter().zip(due.into_iter().flatten()) {
            let Shape::Plane([low, right, _]) = screen.shape else { panic!("{made:?}") };
            assert!(low.distance(DVec3::new(x, -1.0, -3.0)) < 1e-9, "{canvas}: {low}");
            assert!((low.distance(right) - width).abs() < 1e-9, "{canvas}: {right}");
        }
    }
}

#[test]
fn names_are_those_that_a_wall_file_may_have() {
    for (file, due) in [
        ("Übersicht.mpcdi", "bersicht"),
        ("..hidden.mpcdi", "hidden"),
        ("Hall_1 b.mpcdi", "hall_1-b"),
        ("ß_.mpcdi", "wall"),
    ] {
        assert_eq!(wall_name(Path::new(file)), due, "{file}");
    }
}

#[test]
fn archives_that_make_no_wall_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let [file, wall_file] = ["hall.xml", "wall.toml"].map(|name| folder.path().join(name));
    let turn = "<yaw>0</yaw><pitch>0</pitch><roll>0</roll>";
    let angles = "<leftAngle>-1</leftAngle><rightAngle>1</rightAngle><downAngle>-1</downAngle>\
                  <upAngle>1</upAngle>";
    let text = format!(
        r#"<MPCDI profile="sl" version="2.0"><display><buffer id="all"><region id="a" x="0" y="0"
        xsize="1" ysize="1" xResolution="100" yResolution="100"><frustum>{turn}{angles}</frustum>
        </region></buffer></display></MPCDI>"#
    );
    fs::write(&file, text).expect("written");
    let output = folder.path().to_owned();
    // So near, the lens lights less than a millimetre.
    let arguments = Arguments { file, output, width: 4.0, distance: 0.01, force: false };
    let error = archive(&arguments, &wall_file).expect_err("too small").to_string();
    assert!(error.contains("make no wall"), "{error}");
    assert!(!wall_file.exists(), "it is written");
}

#[test]
fn files_of_no_system_are_refused() {
    refused("a.toml", "[wall]\nname = \"a\"", "is no configuration");
    refused("a.xml", "<html/>", "<html> is not known");
    refused("a.json", "{}", "masteraddress: the key is missing");
}

#[test]
fn maps_that_an_import_reads_are_never_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let [file, mask] = ["hall.json", "dome-alpha.png"].map(|name| folder.path().join(name));
    let text = r#"{"version": 1, "masteraddress": "localhost", "nodes": [{"address": "localhost",
        "port": 20401, "windows": [{"name": "dome", "size": {"x": 64, "y": 48}, "viewports": [
        {"blendmask": "dome-alpha.png", "projection": {"type": "PlanarProjection",
        "fov": {"hfov": 60, "vfov": 40}}}]}]}]}"#;
    fs::write(&file, text).expect("written");
    image::GrayImage::new(4, 3).save(&mask).expect("written");
    let before = fs::read(&mask).expect("read");
    let output = folder.path().to_owned();
    let arguments = Arguments { file, output, width: 4.0, distance: 3.0, force: true };
    let error = configuration(&arguments).expect_err("it is read").to_string();
    assert!(error.contains("dome-alpha.png is a file that it is made of"), "{error}");
    assert_eq!(fs::read(&mask).expect("read"), before);
    assert!(!folder.path().join("wall.toml").exists(), "it is written");
}
