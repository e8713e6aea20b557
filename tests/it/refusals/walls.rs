//! Walls that are none, ports and drivers that are not there, channels that are taken.

use crate::harness::local_wall::{LocalWall, small};
use crate::harness::place::TestDir;

const WALL: &str = r#"[wall]
name = "good"
eye = [0.0, 0.0, 0.0]

[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
pixels = [200, 100]

[[screen.channel]]
name = "left"
origin = [0, 0]
pixels = [100, 100]

[[screen.channel]]
name = "right"
origin = [100, 0]
pixels = [100, 100]
"#;

/// The fault, a change to the wall file, and the parts of the expected error, line and key first.
type Case = (&'static str, [&'static str; 2], &'static [&'static str]);

/// The end of the wall, after which tables of channels may stand.
const LAST: &str = "origin = [100, 0]\npixels = [100, 100]\n";

const NO_GAMMA: &str = "origin = [100, 0]\npixels = [100, 100]\n[channel.right]\ngamma = 0\n";

const MISSPELT: &str = "origin = [100, 0]\npixels = [100, 100]\n[channel.rihgt]\n";

const FOLDED: &str = "origin = [100, 0]\npixels = [100, 100]\n[channel.right]\n\
                      pin = [[0, 0], [-110, 0], [0, 0], [0, 0]]\n";

/// Seen from outside, though the eye is inside.
const BEHIND: &str = "cylinder = { radius = 1.0, degrees = [30, -30], height = [-0.5, 0.5] }";

const CASES: &[Case] = &[
    ("unknown key", ["size = ", "sice = "], &["wall.toml:7:1", "screen[0].sice", "size"]),
    ("wrong type", ["pixels = [200, 100]", "pixels = \"many\""], &[":9:", "screen[0].pixels"]),
    ("no TOML", ["name = \"good\"", "name = good"], &["wall.toml:2:"]),
    ("gamma", [LAST, NO_GAMMA], &["gamma", ":21:"]),
    ("no channel", [LAST, MISSPELT], &["rihgt", "\"right\"?"]),
    ("folded pins", [LAST, FOLDED], &["channel.right.pin", "fold", ":21:"]),
    (
        "eye behind a curved screen",
        ["size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]", BEHIND],
        &[":3:", "wall.eye", "1.000000 m behind screen", "channel \"left\""],
    ),
    ("hole", ["origin = [100, 0]\npixels = [100,", "origin = [100, 0]\npixels = [90,"], &["190"]),
    ("no pixels", ["[100, 100]", "[0, 100]"], &[":14:", "screen[0].channel[0].pixels"]),
    ("many pixels", ["pixels = [100, 100]", "pixels = [100000, 100]"], &[":14:", "channel"]),
    ("eye in the plane", ["eye = [0.0, 0.0, 0.0]", "eye = [0.0, 0.0, -1.0]"], &[":3:", "eye"]),
    ("name twice", ["name = \"right\"", "name = \"left\""], &["left", ":17:"]),
];

#[test]
fn a_wall_file_that_is_wrong_is_refused_with_its_place() {
    let place = TestDir::new();
    for (what, [from, to], parts) in CASES {
        assert!(WALL.contains(from), "{what}");
        place.write("wall.toml", WALL.replacen(from, to, 1));
        let checked = place.run(["check", "wall.toml"]).failed(parts);
        for command in ["manager", "simulate"] {
            let refused = place.run([command, "wall.toml"]).failed(parts);
            assert_eq!(refused, checked, "{what}: all commands say the same");
        }
        let json = place.run(["check", "--json", "wall.toml"]);
        assert_eq!(json.code(), 1, "{what}");
        let error: serde_json::Value = serde_json::from_str(&json.output).expect("JSON");
        assert!(error["error"]["line"].as_u64() > Some(0), "{what}: {error}");
    }
    let absent = place.run(["check", "--json", "absent.toml"]);
    let error: serde_json::Value = serde_json::from_str(&absent.output).expect("JSON");
    assert!(error["error"]["file"] == "absent.toml" && error["error"].get("line").is_none());
    // Overlaps blend, and holes beside them are shown.
    place.write("wall.toml", WALL.replacen("[100, 0]", "[90, 0]", 1));
    let table = place.run(["check", "wall.toml"]).succeeded();
    assert!(
        table.contains("overlap: left and right, blended, 10 × 100 pixels at [90, 0]"),
        "{table}"
    );
    assert!(table.contains("not covered: 10 × 100 pixels at [190, 0], 0.100 × 1.000 m"), "{table}");
    place.write("wall.toml", WALL);
    let table = place.run(["check", "wall.toml"]).succeeded();
    assert!(table.contains("left") && table.contains("right"), "{table}");
    place.run(["check", "gone.toml"]).failed(&["gone.toml", "cannot be read"]);
}

#[test]
fn a_wall_file_is_written_checked_and_not_written_over() {
    let place = TestDir::new();
    let line = ["wall", "cylinder", "--channels", "6", "--degrees", "180", "-o", "round.toml"];
    place.run(line).succeeded();
    let table = place.run(["check", "round.toml"]).succeeded();
    assert!(table.contains("screen round: cylinder") && !table.contains("warning"), "{table}");
    place.run(line).failed(&["round.toml is there already", "--force"]);
    place.run(line.iter().chain(&["--force"])).succeeded();
    place.run(["wall", "arch", "--channels", "1", "--degrees", "200"]).failed(&["200°", "150"]);
    let none = place.run(["wall", "grid", "--columns", "0"]);
    assert!(none.code() == 2 && none.output.contains("--columns"), "{}", none.output);
}

#[test]
fn a_channel_has_one_server_and_a_port_one_manager() {
    let wall = small(1, 1);
    let name = wall.channels[0].name.clone();
    let local = LocalWall::start(&wall, &[]);
    let pid = local.servers[&name].pid().to_string();
    let server =
        |channel: &str| local.run(&["server", "--once", "--headless", "--channel", channel]);
    server(&name).failed(&[&local.address, &name, "driven by another server", &pid]);
    server("attic").failed(&["no channel \"attic\"", &name]);
    let path = local.place.path("wall.toml").display().to_string();
    let second = local.place.run(["manager", "--listen", &local.address, &path]);
    second.failed(&[&local.address, "in use", "polyptych stop", "--listen"]);
    let open = local.place.run(["manager", "--listen", "0.0.0.0:0", &path]);
    open.failed(&["can be reached from other machines", "--insecure"]);
    local.client().render_frame().expect("the wall goes on");
}

#[test]
fn a_machine_without_a_driver_is_told_which_package_has_one() {
    let place = TestDir::new();
    let nothing = [("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent")];
    let without_drivers = |arguments: &[&str]| {
        let mut command = place.command(arguments);
        command.envs(nothing).env("WGPU_BACKEND", "vulkan");
        let mut process = crate::harness::process::Process::start("polyptych", &mut command);
        process.finish(crate::harness::wait::LIMIT)
    };
    let server = ["server", "--once", "--channel", "left", "--manager", "127.0.0.1:9"];
    without_drivers(&server).failed(&["no Vulkan or GL driver", "apt install mesa-vulkan-drivers"]);
    place.write("wall.toml", WALL);
    let scene = crate::harness::scenes::town().display().to_string();
    let simulated = without_drivers(&["simulate", "wall.toml", &scene]);
    assert!(simulated.output.contains("mesa-vulkan-drivers"), "{}", simulated.output);
    simulated.failed(&["the server", "ended"]);
}

#[test]
fn a_server_that_finds_no_manager_says_so_once_and_gives_up_if_told_to() {
    let place = TestDir::new();
    let nobody = std::net::TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr());
    let nobody = nobody.expect("a free port").to_string();
    let server = ["server", "--headless", "--channel", "a", "--manager", &nobody];
    let once = place.run(server.iter().chain(&["--once"]));
    once.failed(&[&nobody, "token"]);
    place.write("state/token", "0123456789abcdef0123456789abcdef");
    place.run(server.iter().chain(&["--once"])).failed(&[&nobody, "refused"]);
}
