//! Screens that are no rectangle, projectors and overlapping tiles, right and wrong.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::{Channel, ChannelKind, FrustumMode, Surface};

use super::{BY_HAND, SMALLEST, check, check_changed, config, read};

const ROUND: &str = r#"[wall]
name = "w"
[[screen]]
name = "round"
[screen.cylinder]
radius = 3.0
degrees = [-45, 45]
height = [-1.0, 1.0]
[screen.tiles]
columns = 3
pixels = [200, 100]
"#;

const DOME: &str = r#"[wall]
name = "w"
[[screen]]
name = "dome"
[screen.sphere]
radius = 4.0
azimuth = [-180, 180]
elevation = [0, 90]
[screen.tiles]
pixels = [400, 100]
"#;

const BEAM: &str = r#"[wall]
name = "w"
[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
pixels = [200, 100]
[[screen.channel]]
name = "beam"
pixels = [100, 80]
[screen.channel.projector]
position = [0.0, 0.0, 1.0]
look_at = [0.5, 0.0, -1.0]
degrees = [40, 30]
"#;

#[test]
fn a_cylinder_stands_where_the_file_says() {
    let wall = read(ROUND);
    let screen = &wall.screens[0];
    let Surface::Cylinder(cylinder) = screen.surface else { panic!("{screen:?}") };
    assert_eq!(cylinder.azimuth_rad, [-PI / 4.0, PI / 4.0]);
    assert_eq!(screen.canvas, UVec2::new(600, 100));
    let middle = screen.display_from_canvas(DVec2::new(300.0, 50.0)).unwrap();
    assert!(middle.distance(DVec3::new(0.0, 0.0, -3.0)) < 1e-12, "{middle}");
    // Yawed by a quarter turn it stands at the viewer's left, as planar screens do.
    let turned = ROUND.replace("height", "rotation = [90, 0, 0]\nheight");
    let middle = read(&turned).screens[0].display_from_canvas(DVec2::new(300.0, 50.0)).unwrap();
    assert!(middle.distance(DVec3::new(-3.0, 0.0, 0.0)) < 1e-12, "{middle}");
    let quaternion = ROUND.replace("height", "rotation = [0, 0.6, 0, 0.8]\nheight");
    assert!(matches!(read(&quaternion).screens[0].surface, Surface::Cylinder(_)));
}

#[test]
fn a_dome_has_its_pole_above() {
    let wall = read(DOME);
    let pole = wall.screens[0].display_from_canvas(DVec2::ZERO).unwrap();
    assert!(pole.distance(DVec3::Y * 4.0) < 1e-12, "{pole}");
}

#[test]
fn numbers_that_are_no_curved_screen() {
    let at = |from: &str, to: &str, expected: &str| check_changed(ROUND, from, to, expected);
    for radius in ["0", "-3.0", "nan", "1e300"] {
        let line = format!("radius = {radius}");
        at("radius = 3.0", &line, "6:1: screen[0].cylinder.radius: a radius of ");
    }
    at("[-45, 45]", "[45, 45]", "7:1: screen[0].cylinder.degrees: from 45° to 45° are 0°; write");
    at("[-45, 45]", "[-200, 200]", "7:1: screen[0].cylinder.degrees: from -200° to 200° are 400°");
    at("[-1.0, 1.0]", "[1.0, -1.0]", "8:1: screen[0].cylinder.height: a cylinder from 1 to -1");
    at("[-1.0, 1.0]", "[-1.0, nan]", "8:17: screen[0].cylinder.height[1]: NaN is no number of");
    at(
        "height",
        "rotation = [0, 0, 0, 2]\nheight",
        "8:22: screen[0].cylinder.rotation[3]: 2e0 a quaternion is beyond all reason",
    );
    at(
        "height",
        "rotation = [0, 0, 0, 0.5]\nheight",
        "8:1: screen[0].cylinder.rotation: a quaternion of length 0.5; its length must be 1",
    );
    at(
        "height",
        "rotation = [0, 0]\nheight",
        "8:12: screen[0].cylinder.rotation: found 2 of them; write a list of 3 angles or of 4",
    );
    at(
        "[screen.cylinder]",
        "size = [1, 1]\n[screen.cylinder]",
        "5:1: screen[0].size: the screen's place is given twice, by cylinder and by size; keep one",
    );
    at("radius = 3.0", "", "5:1: screen[0].cylinder.radius: the key is missing; add radius = …");
    let at = |from: &str, to: &str, expected: &str| check_changed(DOME, from, to, expected);
    at("[0, 90]", "[0, 91]", "8:17: screen[0].sphere.elevation[1]: 9.1e1 degrees is beyond all");
    at("[0, 90]", "[30, 30]", "8:1: screen[0].sphere.elevation: a sphere from 30° to 30° above");
    let mesh = SMALLEST.replace("size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]", "mesh = \"\"");
    check(&mesh, "5:1: screen[0].mesh: \"\" is no file; write the path of a file");
    let bezel = format!("{}columns = 2\nbezel = [0.1, 0]", mesh.replace("\"\"", "\"m.obj\""));
    check(&bezel, "9:1: screen[0].tiles.bezel: how many pixels a bezel of a mesh is");
}

#[test]
fn an_eye_behind_a_curved_screen_or_in_it() {
    let eye = |good: &str, eye: &str| {
        good.replacen("name = \"w\"", &format!("name = \"w\"\neye = {eye}"), 1)
    };
    // The first of three, 3 m - 4 m · cos 15° at its right edge.
    check(
        &eye(ROUND, "[0.0, 0.0, -4.0]"),
        "3:1: wall.eye: the eye [0, 0, -4] m is 0.863703 m behind screen \"round\", so that its \
         channel \"round-1-1\" has no view; move the eye or the screen; left and right are as",
    );
    check(
        &eye(DOME, "[0.0, 4.0, 0.0]"),
        "3:1: wall.eye: the eye [0, 4, 0] m is in the plane of screen \"dome\", so that its \
         channel \"dome\" has no view",
    );
    read(&eye(ROUND, "[0.0, 0.0, 1.2]"));
    // Behind the axis, the sides turn their backs.
    check(
        &eye(ROUND, "[4.5, 0.0, 0.0]"),
        "3:1: wall.eye: the eye [4.5, 0, 0] m is 0.181981 m behind",
    );
    // From outside, what faces the eye is the other side.
    let outside = ROUND.replace("[-45, 45]", "[45, -45]");
    check(&outside, "1:2: wall.eye: the eye [0, 0, 0] m is 3.000000 m behind screen \"round\"");
    read(&eye(&outside, "[0.0, 0.0, -9.0]"));
}

#[test]
fn projectors_throw_their_picture_where_they_look() {
    let wall = read(BEAM);
    let [beam] = wall.channels.as_slice() else { panic!("{:?}", wall.channels) };
    assert!(matches!(beam.cover, ChannelKind::Projector(_)));
    assert_eq!(beam.projection, FrustumMode::Own);
    // Its window stands around what it lights, x = 0.5 m of a metre to each side.
    assert_eq!((beam.origin, beam.size), (UVec2::new(100, 10), UVec2::new(100, 80)));
    let map = ChannelMapping::new(beam, &wall.screens[0]).unwrap();
    let middle = map.canvas_from_pixel(DVec2::new(50.0, 40.0)).unwrap();
    assert!(middle.distance(DVec2::new(150.0, 50.0)) < 1e-9, "{middle}");
    let straight = BEAM.replace("look_at = [0.5, 0.0, -1.0]", "rotation = [0, 0, 0]");
    let middle_of = |channel: &Channel| {
        let map = ChannelMapping::new(channel, &wall.screens[0]).unwrap();
        map.canvas_from_pixel(DVec2::new(50.0, 40.0)).unwrap()
    };
    let middle = middle_of(&read(&straight).channels[0]);
    assert!(middle.distance(DVec2::new(100.0, 50.0)) < 1e-9, "{middle}");
    // Half a picture up: tan 15° · 2 m, in pixels of 1 cm.
    let shifted = straight.replace("degrees = [40, 30]", "degrees = [40, 30]\nshift = [0, 0.5]");
    let middle = middle_of(&read(&shifted).channels[0]);
    let up = 15_f64.to_radians().tan() * 200.0;
    assert!(middle.distance(DVec2::new(100.0, 50.0 - up)) < 1e-9, "{middle}");
    // The same by its tangents.
    let [x, y] = [20_f64, 15.0].map(|half| half.to_radians().tan());
    let tangents = format!("tangents = [{}, {x}, 0.0, {}]", -x, 2.0 * y);
    let same = straight.replace("degrees = [40, 30]", &tangents);
    assert!(middle_of(&read(&same).channels[0]).distance(middle) < 1e-9);
}

#[test]
fn projectors_that_cannot_be() {
    let at = |from: &str, to: &str, expected: &str| {
        let key = "screen[0].channel[0].projector";
        let (place, rest) = expected.split_once('|').unwrap();
        check_changed(BEAM, from, to, &format!("{place}: {key}{rest}"));
    };
    at("position = [0.0,", "position = [nan,", "12:13|.position[0]: NaN is no number of metres");
    at("look_at", "# ", "11:17|.look_at: nobody knows where the projector looks; give look_at");
    at("look_at", "rotation = [0, 0, 0]\nlook_at", "13:1|.rotation: where it looks is given twice");
    at("[0.5, 0.0, -1.0]", "[0, 0, 1]", "13:1|.look_at: it looks at its own position; write");
    at("degrees", "# ", "11:17|.degrees: nobody knows how wide the projector's picture is; give");
    at(
        "degrees",
        "tangents = [-1, 1, -1, 1]\ndegrees",
        "14:1|.tangents: its picture is given twice",
    );
    at("[40, 30]", "[40, 180]", "14:16|.degrees[1]: a picture of 180.0 degrees is not possible");
    at(
        "degrees = [40, 30]",
        "tangents = [1, -1, -1, 1]",
        "14:1|.tangents: the picture's edges are",
    );
    at(
        "degrees = [40, 30]",
        "tangents = [-1, 1, -1, 1]\nshift = [0, 0]",
        "15:1|.shift: tangents say",
    );
    at("[40, 30]", "[40, 30]\nshift = [0, 11]", "15:13|.shift[1]: 1.1e1 pictures is beyond all");
    at(
        "[0.5, 0.0, -1.0]",
        "[0, 0, 9]",
        "11:17|: the projector of channel \"beam\" lights nothing of screen \"front\"; \
         check position, look_at or rotation, and degrees",
    );
    // A beam far wider than the screen lights it still.
    read(&BEAM.replace("[0.0, 0.0, 1.0]", "[0, 0, 900]").replace("[40, 30]", "[170, 170]"));
}

#[test]
fn tiles_overlap_by_whole_pixels() {
    let wall = read(&format!("{SMALLEST}columns = 3\nrows = 2\noverlap = [30, 16]\n"));
    assert_eq!(wall.screens[0].canvas, UVec2::new(540, 184));
    let last = &wall.channels[5];
    assert_eq!((last.origin, last.size), (UVec2::new(340, 84), UVec2::new(200, 100)));
    let overlap = |line: &str, expected: &str| {
        check(&format!("{SMALLEST}columns = 2\n{line}\n"), &format!("10:{expected}"));
    };
    overlap(
        "overlap = [200, 0]",
        "12: screen[0].tiles.overlap[0]: 200 of 200 pixels overlap; write",
    );
    overlap(
        "overlap = [0, 4000000000]",
        "15: screen[0].tiles.overlap[1]: 4000000000 of 100 pixels",
    );
    overlap(
        "overlap = [2, 0]\nbezel = [0.1, 0]",
        "1: screen[0].tiles.overlap: tiles cannot have both gaps and overlaps; keep one",
    );
}

#[test]
fn screens_of_different_kinds_stand_in_one_wall() {
    let more = &DOME[DOME.find("[[screen]]").unwrap()..];
    let wall = read(&format!("{BY_HAND}{more}"));
    assert!(wall.screens[0].plane().is_some() && wall.screens[1].plane().is_none());
    assert_eq!(wall.channels[2].screen, 1);
}

#[test]
fn the_wall_files_of_every_shape_have_their_form() {
    let round = config("cylinder-360.toml");
    let Surface::Cylinder(cylinder) = round.screens[0].surface else { panic!("a cylinder") };
    assert_eq!((round.channels.len(), cylinder.radius_m), (14, 3.0));
    let dome = config("dome-5.toml");
    assert!(matches!(dome.screens[0].surface, Surface::Sphere(_)) && dome.channels.len() == 5);
    let power = config("powerwall-overlap.toml");
    assert_eq!(power.channels.len(), 6);
    assert_eq!(power.channels[1].origin.x, power.channels[0].size.x * 85 / 100);
    assert_eq!(config("panoramic-3.toml").channels.len(), 3);
}
