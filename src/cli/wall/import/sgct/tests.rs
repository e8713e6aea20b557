//! Configurations of SGCT against its documented formulas, computed here in another way.

use std::f64::consts::PI;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::super::super::made::{Made, MadeScreen, Shape};
use super::super::{json, xml};
use super::*;

/// What a hundredth of a pixel may be, in radians, where pixels are the finest of the tests here:
/// 90 degrees over 4,096 of them.
const HUNDREDTH_RAD: f64 = PI / 2.0 / 4096.0 / 100.0;

fn import(text: &str) -> anyhow::Result<(Made, Vec<String>)> {
    let path = Path::new("hall.json");
    let is_xml = text.trim_start().starts_with('<');
    let tree = if is_xml { xml::parse(path, text)?.0 } else { json::parse(path, text)? };
    let mut made = read(&tree)?;
    made.pair_eyes();
    if let Err(error) = polyptych_wall_file::parse(&made.text(), Path::new("wall.toml")) {
        panic!("{error}\n{}", made.text());
    }
    let told = [tree.warnings.take(), tree.notes.take()].concat();
    Ok((made, told))
}

/// A configuration of one window with these keys, and one viewport with others.
fn one(window: &str, viewport: &str) -> String {
    format!(
        r#"{{"version": 1, "masteraddress": "localhost", "nodes": [{{"address": "localhost",
        "port": 20401, "windows": [{{"size": {{"x": 640, "y": 480}}, {window}
        "viewports": [{{{viewport}}}]}}]}}]}}"#
    )
}

fn one_screen(viewport: &str) -> MadeScreen {
    let (mut made, _) = import(&one("", viewport)).expect("a wall");
    assert_eq!(made.screens.len(), 1);
    made.screens.remove(0)
}

fn corners(screen: &MadeScreen) -> [DVec3; 3] {
    let Shape::Plane(corners) = screen.shape else { panic!("{:?}", screen.shape) };
    corners
}

/// Rotations by matrices, with angles in degrees.
fn about(axis: char, degrees: f64) -> DMat3 {
    let (s, c) = degrees.to_radians().sin_cos();
    let rows = match axis {
        'x' => [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
        'y' => [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        _ => [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
    };
    DMat3::from_cols_array_2d(&rows).transpose()
}

fn assert_direction(found: DVec3, due: DVec3, what: &str) {
    let off = found.normalize().cross(due.normalize()).length();
    assert!(off < HUNDREDTH_RAD && found.dot(due) > 0.0, "{what}: {found} is not {due}: {off} rad");
}

#[test]
fn planes_by_angles_stand_where_the_angles_say() {
    let turns = [
        (
            r#""yaw": 30, "pitch": 10, "roll": 5"#,
            about('y', -30.0) * about('x', 10.0) * about('z', -5.0),
        ),
        (r#""heading": -45, "elevation": 48, "bank": 0"#, about('y', 45.0) * about('x', 48.0)),
        (r#""x": 0, "y": 0.6, "z": 0, "w": 0.8"#, about('y', 2.0 * 0.6f64.asin().to_degrees())),
        (r#""x": 20, "y": 30, "z": 0"#, about('x', 20.0) * about('y', 30.0)),
    ];
    for (keys, turn) in turns {
        for (fov, [left, right, down, up]) in [
            (r#""left": 50, "right": 40, "down": -7.7, "up": 70"#, [-50.0, 40.0, 7.7, 70.0]),
            (r#""hfov": 80, "vFov": 50"#, [-40.0, 40.0, -25.0, 25.0]),
            (r#""hfov": 80, "down": 10, "up": 50"#, [-40.0, 40.0, -10.0, 50.0f64]),
        ] {
            let screen = one_screen(&format!(
                r#""projection": {{"type": "PlanarProjection", "fov": {{{fov}}}, "distance": 3,
                "orientation": {{{keys}}}, "offset": {{"x": 0.5, "y": 0.25, "z": -1}}}}"#
            ));
            let tan = |degrees: f64| degrees.to_radians().tan();
            let found = corners(&screen);
            let places = [(left, down), (right, down), (left, up)];
            for (found, (across, along)) in found.into_iter().zip(places) {
                let due = turn * DVec3::new(tan(across), tan(along), -1.0) * 3.0;
                let due = due + DVec3::new(0.5, 0.25, -1.0);
                assert_direction(found, due, keys);
                assert!(found.distance(due) < 1e-9, "{keys} {fov}: {found} is not {due}");
            }
        }
    }
}

#[test]
fn xml_and_json_of_the_same_wall_are_the_same() {
    let points = [[-2.0, -1.0, -3.0], [-2.0, 1.25, -3.0], [2.0, 1.25, -3.0]];
    let pos = points.map(|[x, y, z]| format!(r#"<Pos x="{x}" y="{y}" z="{z}"/>"#)).concat();
    let old = format!(
        r#"<?xml version="1.0"?><Cluster masterAddress="10.0.0.1"><Node address="10.0.0.1"
        port="20401"><Window fullScreen="true" msaa="4"><Stereo type="side_by_side"/>
        <Size x="1280" y="720"/><Viewport eye="left" user="lea"><Pos x="0.5" y="0"/>
        <Size x="0.5" y="1"/><Viewplane>{pos}</Viewplane></Viewport></Window></Node>
        <User eyeSeparation="0.065"><Pos x="0" y="1.5" z="0"/></User>
        <User name="lea"><Pos x="0.5" y="1.5" z="0"/></User></Cluster>"#
    );
    let keys = ["lowerleft", "upperleft", "upperright"].iter().zip(points);
    let keys = keys.map(|(k, [x, y, z])| format!(r#", "{k}": {{"x": {x}, "y": {y}, "z": {z}}}"#));
    let new = format!(
        r#"{{"version": 1, "masterAddress": "10.0.0.1", "nodes": [{{"address": "10.0.0.1",
        "port": 20401, "windows": [{{"fullscreen": true, "msaa": 4, "stereo": "side_by_side",
        "size": {{"x": 1280, "y": 720}}, "viewports": [{{"eye": "left", "user": "lea",
        "pos": {{"x": 0.5, "y": 0}}, "size": {{"x": 0.5, "y": 1}},
        "projection": {{"type": "ProjectionPlane"{}}}}}]}}]}}],
        "users": [{{"eyeseparation": 0.065, "pos": {{"x": 0, "y": 1.5, "z": 0}}}},
        {{"name": "lea", "pos": {{"x": 0.5, "y": 1.5, "z": 0}}}}]}}"#,
        keys.collect::<String>()
    );
    let ((old, told), (new, also_told)) = (import(&old).expect("XML"), import(&new).expect("JSON"));
    assert_eq!(old.text(), new.text());
    assert_eq!(told, also_told);
    let [screen] = &new.screens[..] else { panic!("{new:?}") };
    // One eye's half of a half of the window; moved by the way from lea's eye to the wall's.
    assert_eq!(screen.size, [320, 720]);
    assert_eq!(corners(&new.screens[0])[0], DVec3::new(-2.5, -1.0, -3.0));
    assert_eq!(
        (&screen.adjust[..], screen.eye),
        (&["stereo = \"side-by-side\"".to_owned()][..], None)
    );
    assert!(told[0].contains("for the user lea"), "{told:?}");
    assert!(new.is_smooth && new.eye_separation == Some(0.065), "{new:?}");
}

#[test]
fn fisheyes_show_directions_by_their_angle_from_the_axis() {
    for (fov, tilt) in [(180.0, 0.0), (165.0, 27.0), (220.0, 90.0), (360.0, -10.0)] {
        let screen = one_screen(&format!(
            r#""projection": {{"type": "FisheyeProjection", "fov": {fov}, "tilt": {tilt},
            "diameter": 10}}"#
        ));
        let warp = screen.warp.as_ref().expect("a warp");
        let (mut lit, mut dark) = (0, 0);
        for (at, point) in warp.iter().enumerate() {
            // The circle is as high as the window, in its middle.
            let x = (at % 640) as f64 + 0.5 - 320.0;
            let y = 240.0 - ((at / 640) as f64 + 0.5);
            let radius = x.hypot(y) / 240.0;
            let Some(point) = point else {
                assert!(radius > 1.0 - 1e-12, "{fov} {tilt}: dark at {x} {y}");
                dark += 1;
                continue;
            };
            // A dome master: azimuth from the bottom of the circle, which is ahead, to the right.
            let (angle, azimuth) = (radius * fov / 2.0, x.atan2(-y).to_degrees());
            let flat = about('y', -azimuth) * about('x', 90.0 - angle) * DVec3::NEG_Z;
            assert_direction(*point, about('x', -tilt) * flat, "fisheye");
            assert!((point.length() - 5.0).abs() < 1e-9);
            lit += 1;
        }
        assert!(lit > 170_000 && dark > 100_000, "{lit} {dark}");
    }
    let tilted = one_screen(r#""projection": {"type": "FisheyeProjection", "tilt": 30}"#);
    let middle = tilted.warp.expect("a warp")[240 * 640 + 320].expect("lit");
    let elevation = middle.y.atan2(-middle.z).to_degrees();
    assert!((elevation - 60.0).abs() < 0.6, "the middle of a dome tilted by 30°: {elevation}");
}

#[test]
fn an_offset_moves_the_dome_against_the_eye() {
    let keys = r#""type": "FisheyeProjection", "tilt": 90, "fov": 180"#;
    let at = 100 * 640 + 300;
    let plain = one_screen(&format!(r#""projection": {{{keys}}}"#)).warp.expect("a warp")[at];
    let moved = one_screen(&format!(
        r#""projection": {{{keys}, "offset": {{"x": 0.1, "y": 0.2, "z": 0.3}}}}"#
    ));
    let moved = moved.warp.expect("a warp")[at].expect("lit");
    // The shader's axes: x right, y down in the picture, z along the axis of the lens.
    let unit = plain.expect("lit") / 7.4;
    let [x, y, z] = [unit.x - 0.1, -unit.y - 0.2, -unit.z - 0.3];
    assert_direction(moved, DVec3::new(x, -y, -z), "offset");
}

#[test]
fn crops_show_the_rest_of_the_circle_as_large_as_fits() {
    let keys = r#""type": "FisheyeProjection", "tilt": 90, "crop": {"left": 0, "right": 0,
        "bottom": 0.125, "top": 0.125}"#;
    let warp = one_screen(&format!(r#""projection": {{{keys}}}"#)).warp.expect("a warp");
    // 640 × 480 of a square of 640: the rim touches both sides.
    let point = warp[239 * 640].expect("lit");
    let radius = (319.5f64).hypot(0.5) / 320.0;
    assert!(((-point.z / 7.4).acos() - radius * PI / 2.0).abs() < 1e-9, "{point}");
    // Stretched, the rim touches all four sides.
    let keys = r#""type": "FisheyeProjection", "tilt": 90, "keepaspectratio": false"#;
    let warp = one_screen(&format!(r#""projection": {{{keys}}}"#)).warp.expect("a warp");
    let point = warp[239 * 640].expect("lit");
    let radius = (319.5f64 / 320.0).hypot(0.5 / 240.0);
    assert!(((-point.z / 7.4).acos() - radius * PI / 2.0).abs() < 1e-9, "{point}");
}

#[test]
fn meshes_of_bourke_are_measured_on_the_whole_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("half.data");
    // The middle half of a window of 4:3.
    let mesh =
        "2\n2 2\n-0.666667 -1 0 0 1\n0.666667 -1 1 0 1\n-0.666667 1 0 1 1\n0.666667 1 1 1 1\n";
    std::fs::write(&path, mesh).expect("written");
    let plane = r#""projection": {"type": "PlanarProjection", "fov": {"hfov": 60, "vfov": 40}}"#;
    let viewport = format!(r#""mesh": {path:?}, {plane}"#);
    for (stereo, size) in
        [("none", [640, 480]), ("side_by_side", [320, 480]), ("top_bottom", [640, 240])]
    {
        let text = one(&format!(r#""stereo": "{stereo}","#), &viewport);
        let (made, _) = import(&text).expect("a wall");
        let [screen] = &made.screens[..] else { panic!("{made:?}") };
        assert_eq!(screen.size, size);
        let warp = screen.warp.as_ref().expect("a warp");
        let [width, height] = size.map(|side| side as usize);
        let row = &warp[height / 2 * width..][..width];
        let lit: Vec<usize> = (0..width).filter(|at| row[*at].is_some()).collect();
        assert_eq!(lit, (width / 4..width * 3 / 4).collect::<Vec<_>>(), "{stereo}");
    }
}

#[test]
fn surfaces_that_a_wall_file_knows_need_no_map() {
    let screen = one_screen(r#""projection": {"type": "EquirectangularProjection"}"#);
    assert_eq!((screen.shape, screen.warp), (Shape::all_around(DVec3::ZERO, 5.0), None));
    let due = Shape::Cylinder {
        center: DVec3::ZERO,
        radius: 4.0,
        degrees: [-90.0, 270.0],
        height: [-2.0, 2.0],
    };
    for rotation in [90, 450, -270] {
        let screen = one_screen(&format!(
            r#""projection": {{"type": "CylindricalProjection", "rotation": {rotation},
            "heightoffset": -0.5, "radius": 4}}"#
        ));
        assert_eq!((screen.shape, screen.warp), (due, None), "{rotation}");
    }
}

#[test]
fn faces_of_cubes_meet_at_their_edges() {
    let text = one(
        "",
        r#""projection": {"type": "SpoutOutputProjection", "quality": "1k", "mapping": "cubemap",
        "spoutname": "dome", "orientation": {"yaw": 45, "pitch": 0, "roll": 0}}"#,
    );
    let (made, told) = import(&text).expect("a wall");
    assert_eq!(made.screens.len(), 6);
    assert!(told.is_empty() || told.iter().all(|line| line.contains("left out")), "{told:?}");
    let face = |name: &str| {
        let screen = made.screens.iter().find(|screen| screen.name.ends_with(name));
        let screen = screen.expect("a face");
        assert_eq!(screen.size, [1024, 1024]);
        corners(screen)
    };
    let lower_right = |name: &str| face(name)[1];
    for (left, right) in
        [("front", "right"), ("right", "back"), ("back", "left"), ("left", "front")]
    {
        assert!(lower_right(left).distance(face(right)[0]) < 1e-9, "{left} {right}");
    }
    // The top's lower edge is the front's upper one, the bottom's upper the front's lower.
    assert!(face("top")[0].distance(face("front")[2]) < 1e-9);
    assert!(face("bottom")[2].distance(face("front")[0]) < 1e-9);
    let ahead = (face("front")[1] + face("front")[2]) / 2.0;
    assert_direction(ahead, DVec3::new(1.0, 0.0, -1.0), "yaw to the right");
}

#[test]
fn viewports_become_channels_of_whole_pixels() {
    let plane = r#""projection": {"type": "PlanarProjection", "fov": {"hfov": 60, "vfov": 40}}"#;
    let text = one(
        r#""name": "Left Wall", "mirrorx": true,"#,
        &format!(
            r#""size": {{"x": 0.3333, "y": 1}}, {plane}}}, {{"pos": {{"x": 0.3333, "y": 0}},
            "size": {{"x": 0.6667, "y": 0.5}}, "eye": "right", {plane}"#
        ),
    );
    let (made, told) = import(&text).expect("a wall");
    let found: Vec<_> = made.screens.iter().map(|s| (s.name.as_str(), s.size)).collect();
    assert_eq!(found, [("left-wall-1", [213, 480]), ("left-wall-2", [426, 240])]);
    assert_eq!(made.screens[1].adjust, ["mirror = true"]);
    assert!(told.iter().any(|line| line.contains("2 viewports")), "{told:?}");
}

#[test]
fn viewports_for_each_eye_share_a_screen() {
    let plane = r#""projection": {"type": "PlanarProjection", "fov": {"hfov": 60, "vfov": 40}}"#;
    let of = |second: &str| {
        let text = one("", &format!(r#""eye": "left", {plane}}}, {{"eye": "{second}", {plane}"#));
        import(&text).expect("a wall").0
    };
    let text = of("right").text();
    assert!(text.contains("eye = \"left\"") && text.contains("eye = \"right\""), "{text}");
    assert_eq!(
        (text.matches("[[screen]]").count(), text.matches("[[screen.channel]]").count()),
        (1, 2)
    );
    let text = of("left").text();
    assert_eq!((text.matches("[[screen]]").count(), text.contains("eye = \"")), (2, false));
}

#[test]
fn what_makes_a_wall_wrong_is_told() {
    let plane = r#""projection": {"type": "PlanarProjection", "fov": {"hfov": 60, "vfov": 40}}"#;
    for (window, viewport, what) in [
        (r#""fxaa": true,"#, "", "FXAA is left out"),
        (r#""border": true,"#, "", "borders are left out"),
        (r#""spoutname": "hall","#, "", "Spout and NDI outputs are left out"),
        (r#""stereo": "active","#, "", "stereo active is not known"),
        (r#""stereo": "side_by_side_inverted","#, "", "left eye is now on the left"),
        ("", r#""overlay": "logo.png", "#, "(overlay) is left out"),
        ("", r#""tracked": true, "#, "tracking is left out"),
    ] {
        let (_, told) = import(&one(window, &format!("{viewport}{plane}"))).expect("a wall");
        assert!(told.iter().any(|line| line.contains(what)), "{what}: {told:?}");
    }
    let text = one("", plane).replace(
        r#""version": 1,"#,
        r#""version": 1, "scene": {"scale": 2}, "users": [{"pos": {"x": 0, "y": 0, "z": 4}}],"#,
    );
    let (_, told) = import(&text).expect("a wall");
    assert!(told[0].contains("scaled by 2"), "{told:?}");
    assert!(told[1].contains("stand around the origin"), "{told:?}");
}

#[test]
fn bad_configurations_are_refused_with_place_and_remedy() {
    let plane = r#""projection": {"type": "PlanarProjection", "fov": {"hfov": 60, "vfov": 40}}"#;
    let good = one("", plane);
    assert!(import(&good).is_ok());
    let of = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1)
    };
    for (text, parts) in [
        (of("60", "180"), ["projection.fov.hfov: an edge at 90", "at most"]),
        (of("60", "-60"), ["span no picture", "more than 0"]),
        (of("\"hfov\": 60, ", ""), ["fov.left: the key is missing", "add it here"]),
        (of("hfov", "hfow"), ["fov.hfow: the key is not known", "perhaps hfov"]),
        (of("Planar", "Plane"), ["there is no projection", "these are"]),
        (of("\"nodes\"", "\"include\": \"a.json\", \"nodes\""), ["include others", "in its place"]),
        (of("640", "640.5"), ["hall.json:2:51: nodes[0].windows[0].size.x", "whole numbers"]),
        (of("640", "\"640\""), ["a number stands in quotes", "write 640"]),
        (of("640", "9000000"), ["size.x", "1 to 65536"]),
        (of("\"port\": 20401,", "\"port\": 99999,"), ["port: found 99999", "0 to 65535"]),
        (
            of("\"masteraddress\": \"localhost\", ", ""),
            ["masteraddress: the key is missing", "add"],
        ),
        (of("}]}]}]}", "}]}]}"), ["hall.json:3", "mend the JSON"]),
        (of("{\"hfov\": 60,", "{\"hfov\": 60, \"hfov\": 70,"), ["given twice", "keep one"]),
        (
            of(plane, r#""projection": {"type": "FisheyeProjection", "fov": 400}"#),
            ["no lens sees 400 degrees", "up to 360"],
        ),
        (
            of(
                plane,
                r#""projection": {"type": "FisheyeProjection", "crop": {"left": 1, "top": 0}}"#,
            ),
            ["the crop leaves nothing", "less than 1"],
        ),
        (of(plane, &format!(r#""mesh": "none.obj", {plane}"#)), ["none.obj", "correct the path"]),
        (of(plane, &format!(r#""user": "tom", {plane}"#)), ["no user \"tom\"", "these are"]),
        (
            of("\"viewports\"", "\"mpcdi\": \"a.mpcdi\", \"viewports\""),
            ["described by another file", "polyptych wall import"],
        ),
        (
            "<Cluster masterAddress=\"a\"><Node port=\"1\"/></Cluster>".to_owned(),
            ["node[0].address: the key is missing", "add it"],
        ),
        (
            "<!DOCTYPE a [<!ENTITY b \"c\">]>\n<Cluster masterAddress=\"&b;\"/>".to_owned(),
            ["DTD or entities", "remove <!DOCTYPE"],
        ),
        ("<Cluster><Node></Cluster>".to_owned(), ["hall.json:1:", "mend the XML"]),
        ("<Cluster masterAddress=\"a\"/>".to_owned(), ["it has no node", "add nodes"]),
    ] {
        let error = import(&text).expect_err(&text).to_string();
        for part in parts {
            assert!(error.contains(part), "{part}: {error}");
        }
        assert!(error.starts_with("hall.json:"), "{error}");
    }
    let deep = format!("{}{}", "[".repeat(100), "]".repeat(100));
    let error = import(&format!("{{\"version\": {deep}}}")).expect_err("deep").to_string();
    assert!(error.contains("more than 64 deep"), "{error}");
}
