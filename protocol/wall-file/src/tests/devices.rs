//! Trackers, wands and pads of wall files.

use glam::DVec3;
use polyptych_wall::device::{DeviceSource, EulerOrder, HeadInput, RotationForm};

use super::*;
use crate::WallFileError;
use crate::check_report::CheckReport;
use crate::difference::differences;

const WALL: &str = r#"
[wall]
name = "desk"
eye = [0.0, 1.6, 1.0]
[[screen]]
name = "front"
size = [1.92, 1.08]
center = [0.0, 1.6, -1.3]
[screen.tiles]
pixels = [1920, 1080]
"#;

const TRACKER: &str = r#"
[[device]]
name = "tracker"
kind = "osc"
listen = "0.0.0.0:9000"
lost_ms = 250
[device.frame]
axes = ["x", "z", "-y"]
unit = 0.001
origin = [0.0, 0.0, -2.0]
rotation = [90.0, 0.0, 0.0]
[device.head]
position = "/head/position"
rotation = "/head/angles"
form = "euler-degrees"
order = "zyx"
mount = [0.0, 10.0, 0.0]
eyes = [0.0, -0.06, -0.09]
prediction_ms = 20
bounds = [[-2.0, 1.0, -1.0], [2.0, 2.0, 3.0]]
[device.fly]
forward = "-/wand/stick[1]"
turn = "/wand/stick"
"#;

const PAD: &str = r#"
[[device]]
name = "pad"
kind = "joystick"
path = "/dev/input/js0"
[device.fly]
forward = "-axis1"
up = "button4"
turn_speed = 90.0
"#;

const MOUSE: &str = r#"
[[device]]
name = "mouse"
kind = "spacenav"
path = "/var/run/spnav.sock"
[device.fly]
forward = "axis2"
turn = "-axis4"
"#;

const VRPN: &str = r#"
[[device]]
name = "dtrack"
kind = "vrpn"
server = "tracker-pc:3883"
[device.head]
tracker = "Tracker0"
sensor = 2
"#;

fn parsed(devices: &[&str]) -> Result<Wall, WallFileError> {
    parse(&format!("{WALL}{}", devices.concat()), "desk.toml".as_ref())
}

#[test]
fn devices_are_read_and_written_back() {
    let wall = parsed(&[TRACKER, PAD, MOUSE]).expect("a wall");
    let tracker = &wall.devices[0];
    assert_eq!(tracker.source, DeviceSource::Osc { listen: "0.0.0.0:9000".into() });
    let head = tracker.head.as_ref().expect("a head");
    let order = EulerOrder([2, 1, 0]);
    let form = Some(RotationForm::Euler { order, is_degrees: true });
    let (position, rotation) = ("/head/position".into(), Some("/head/angles".into()));
    assert_eq!(head.input, HeadInput::Osc { position, rotation, form });
    assert_eq!((head.prediction_ms, head.hold_ms, head.jump_m), (20, 2000, 0.3));
    // A metre along the tracker's y, turned to the left.
    let at = tracker.frame.position(DVec3::new(0.0, 1000.0, 0.0));
    assert!(at.abs_diff_eq(DVec3::new(-1.0, 0.0, -2.0), 1e-12), "{at}");
    let vrpn = parsed(&[&VRPN.replace("Tracker0", "Rigid Body 1"), PAD]).expect("a wall");
    for wall in [&wall, &vrpn] {
        assert_eq!(parse(&to_toml(wall), "again.toml".as_ref()).as_ref(), Ok(wall));
    }
    let changes = differences(&wall, &parsed(&[PAD, MOUSE]).expect("a wall"));
    let keys: Vec<&str> = changes.iter().map(|change| change.key.as_str()).collect();
    assert_eq!(keys, ["device.tracker"]);
}

#[test]
fn wrong_devices_are_refused_with_key_and_remedy() {
    let second = TRACKER.replace("\"tracker\"", "\"other\"").replace(":9000", ":9001");
    for (devices, from, to, key, words) in [
        (TRACKER, "\"osc\"", "\"usb\"", "device[0].kind", "osc"),
        (TRACKER, "listen =", "path =", "device[0].path", "no path"),
        (TRACKER, "listen = \"0.0.0.0:9000\"", "", "device[0].listen", "add listen"),
        (TRACKER, "0.0.0.0:9000", "9000", "device[0].listen", "ADDRESS:PORT"),
        (TRACKER, "\"z\"", "\"x\"", "device[0].frame.axes[1]", "no rotation"),
        (TRACKER, "\"-y\"", "\"up\"", "device[0].frame.axes[2]", "no axis"),
        (TRACKER, "[90.0, 0.0, 0.0]", "[1.0, 1.0, 0.0, 0.0]", "device[0].frame.rotation", "length"),
        (TRACKER, "0.001", "0.0", "device[0].frame.unit", "write a number from"),
        (TRACKER, "\"/head/position\"", "\"head\"", "device[0].head.position", "OSC address"),
        (TRACKER, "position = ", "pose = ", "device[0].head.rotation", "pose"),
        (TRACKER, "/head/angles", "/head/position", "device[0].head.rotation", "already"),
        (TRACKER, "\"zyx\"", "\"zzx\"", "device[0].head.order", "yxz"),
        (TRACKER, "form = \"euler-degrees\"", "", "device[0].head.order", "angles"),
        (TRACKER, "rotation = \"/head/angles\"", "", "device[0].head.form", "no rotation"),
        (
            TRACKER,
            "rotation = \"/head/angles\"\nform = \"euler-degrees\"\norder = \"zyx\"",
            "",
            "device[0].head.mount",
            "no rotation",
        ),
        (
            TRACKER,
            "prediction_ms = 20",
            "prediction_ms = 101",
            "device[0].head.prediction_ms",
            "100",
        ),
        (TRACKER, "[-2.0, 1.0", "[2.5, 1.0", "device[0].head.bounds", "lower"),
        (TRACKER, "prediction_ms", "sensor", "device[0].head.sensor", "no sensor"),
        (TRACKER, "stick[1]", "stick[x]", "device[0].fly.forward", "[1]"),
        (TRACKER, "lost_ms = 250", "lost_ms = 0", "device[0].lost_ms", "20"),
        (PAD, "button4", "button", "device[0].fly.up", "button0"),
        (PAD, "turn_speed = 90.0", "dead_zone = 1.0", "device[0].fly.dead_zone", "0.9"),
        (MOUSE, "path = \"/var/run/spnav.sock\"", "", "device[0].path", "spnav.sock"),
        (MOUSE, "axis2", "axis6", "device[0].fly.forward", "axis5"),
        (MOUSE, "fly]\nforward = \"axis2\"\nturn", "head]\npose", "device[0].head", "osc"),
        (VRPN, "tracker-pc:3883", "tracker-pc", "device[0].server", "HOST:PORT"),
        (VRPN, "\"Tracker0\"", "\"a@b\"", "device[0].head.tracker", "Tracker0"),
        (VRPN, "\"Tracker0\"", "\"a \"", "device[0].head.tracker", "Tracker0"),
    ] {
        let text = devices.replacen(from, to, 1);
        assert_ne!(text, devices, "{from}");
        let error = parsed(&[&text]).expect_err(key);
        assert_eq!(error.key(), key, "{error}");
        assert!(error.to_string().contains(words), "{words}: {error}");
        assert!(error.line() > 11, "{error}");
    }
    for (others, key, words) in [
        (second.as_str(), "device[1].head", "tracks the head already"),
        (&second.replace("other", "Tracker"), "device[1].name", "name of its own"),
        (&TRACKER.replace("\"tracker\"", "\"other\""), "device[1].listen", "already"),
        (
            "[[device]]\nname = \"a\"\nkind = \"osc\"\nlisten = \"[::1]:1\"",
            "device[1].head",
            "moves nothing",
        ),
        ("[device]", "device", "list"),
    ] {
        let before = if others == "[device]" { "" } else { TRACKER };
        let error = parsed(&[before, others]).expect_err(key);
        assert_eq!(error.key(), key, "{error}");
        assert!(error.to_string().contains(words), "{words}: {error}");
    }
}

#[test]
fn check_names_devices_and_warns_of_heads_that_cannot_be() {
    let wall = parsed(&[TRACKER, PAD]).expect("a wall");
    let report = CheckReport::from_wall(&wall).to_string();
    for words in [
        "device tracker: osc 0.0.0.0:9000, head by /head/position and /head/angles with angles, \
         predicted 20 ms ahead, flies by forward -/wand/stick[1], turn /wand/stick\n",
        "device pad: joystick /dev/input/js0, flies by up button4, forward -axis1\n",
    ] {
        assert!(report.contains(words), "{words}: {report}");
    }
    assert_eq!(CheckReport::from_wall(&wall).warnings, <[String; 0]>::default());
    for (from, to, words) in [
        ("[-2.0, 1.0, -1.0]", "[-2.0, 1.0, -1.4]", "head.bounds is refused"),
        ("[-2.0, 1.0, -1.0]", "[-2.0, 1.7, -1.0]", "is outside of head.bounds"),
        ("unit = 0.001", "unit = 100.0", "check frame.unit"),
        ("-0.06", "-6.0", "check head.eyes"),
        ("[0.0, 0.0, -2.0]", "[0.0, 0.0, -2000.0]", "check frame.origin"),
        ("prediction_ms = 20", "prediction_ms = 90", "overshoot"),
    ] {
        let wall = parsed(&[&TRACKER.replacen(from, to, 1)]).expect("a wall");
        let warnings = CheckReport::from_wall(&wall).warnings;
        assert!(warnings.iter().any(|warning| warning.contains(words)), "{words}: {warnings:?}");
    }
}
