//! A manager is started again: from another folder, by another path, with an edited wall file.
//! Tunings, the eye and views stay as far as they are valid, and the log names those that do not.

use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use crate::harness::local_wall::ANY_PORT;
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::wait;

const WALL: &str = r#"
[wall]
name = "t3"
eye = [0.0, 0.0, 0.0]

[[screen]]
name = "front"
size = [4.0, 1.0]
center = [0.0, 0.0, -2.0]
pixels = [320, 80]
[[screen.channel]]
name = "left"
origin = [0, 0]
pixels = [160, 80]
[[screen.channel]]
name = "right"
origin = [160, 0]
pixels = [160, 80]

[[screen]]
name = "side"
size = [1.0, 1.0]
center = [-2.0, 0.0, -1.0]
rotation = [90, 0, 0]
[screen.tiles]
pixels = [80, 80]

[storage]
scenes = ["scenes"]
"#;

/// A wall's manager, started again and again; no server is needed to tune.
struct Desk {
    place: TestDir,
    address: String,
    manager: Process,
}

impl Desk {
    fn start() -> Self {
        let place = TestDir::new();
        fs::create_dir_all(place.path("t3/scenes")).expect("made");
        let path = place.write("t3/t.toml", WALL);
        let (manager, address) = start(&place, &place.path("t3"), &path, ANY_PORT);
        Self { place, address, manager }
    }

    /// The manager is ended and started in this folder with this path; gives what it says until
    /// it listens, and all before that.
    fn restart(&mut self, folder: &str, path: &str) -> String {
        self.run(&["stop"]);
        assert_eq!(self.manager.finish(wait::LIMIT).code(), 0);
        let folder = self.place.path(folder);
        let (manager, _) = start(&self.place, &folder, Path::new(path), &self.address);
        self.manager = manager;
        self.manager.await_line(&["going on where"]);
        self.manager.output()
    }

    /// Runs a command. There is no display, so what is done may be seen on none: 3.
    #[track_caller]
    fn run(&self, arguments: &[&str]) -> String {
        let mut arguments: Vec<OsString> = arguments.iter().map(OsString::from).collect();
        arguments.extend(["--manager", &self.address].map(OsString::from));
        let finished = self.place.run(arguments);
        assert!([0, 3].contains(&finished.code()), "{}", finished.output);
        finished.output
    }

    fn tune(&self, channel: &str, keys: &[&str]) {
        self.run(&[&["tune", channel][..], keys].concat());
    }

    fn shown(&self, channel: &str) -> String {
        self.run(&["tune", channel, "--show"])
    }

    /// Corners and light of both channels, a head, a camera and a view on each screen.
    fn work(&self) {
        self.tune("left", &["pin.upper-left=+2,1", "gain=0.5"]);
        self.tune("right", &["pin.upper-left=+3,1", "gamma=2.5"]);
        self.run(&["eye", "0.1,0.2,0.3"]);
        self.run(&["camera", "look-at", "1,2,3", "0,0,0"]);
        self.run(&[
            "view",
            "add",
            "0,9,0",
            "0,0,0",
            "--up",
            "0,0,-1",
            "--ortho",
            "20",
            "--screen",
            "front",
            "--rect",
            "0,0,80,80",
        ]);
        self.run(&[
            "view",
            "add",
            "0,0,5",
            "0,0,0",
            "--fov",
            "40",
            "--screen",
            "side",
            "--rect",
            "0,0,40,40",
        ]);
    }

    fn edit(&self, edit: impl Fn(&str) -> String) {
        let path = self.place.path("t3/t.toml");
        let text = fs::read_to_string(&path).expect("a wall file");
        let edited = edit(&text);
        assert_ne!(edited, text, "the edit changes something");
        fs::write(path, edited).expect("written");
    }
}

fn start(place: &TestDir, folder: &Path, path: &Path, listen: &str) -> (Process, String) {
    let mut command = place.command(["manager", "--listen", listen]);
    command.arg(path).current_dir(folder);
    let mut manager = Process::start("manager", &mut command);
    let line = manager.await_line(&["manager listens", "address="]);
    let address = line.split("address=").nth(1).and_then(|rest| rest.split(' ').next());
    (manager, address.expect("an address behind its name").to_owned())
}

/// Checks that all of [`Desk::work`] is there.
#[track_caller]
fn check_all(desk: &Desk) {
    check_tunings(desk);
    assert!(desk.run(&["eye"]).contains("0.1"), "{}", desk.run(&["eye"]));
    assert_eq!(desk.run(&["view", "list"]).lines().count(), 2, "{}", desk.run(&["view", "list"]));
}

#[track_caller]
fn check_tunings(desk: &Desk) {
    let (left, right) = (desk.shown("left"), desk.shown("right"));
    assert!(left.contains("pin.upper-left=@2,1\n") && left.contains("gain=0.5"), "{left}");
    assert!(right.contains("pin.upper-left=@3,1\n") && right.contains("gamma=2.5"), "{right}");
}

#[test]
fn a_wall_file_by_another_path_is_the_same_wall() {
    let mut desk = Desk::start();
    desk.work();
    fs::create_dir_all(desk.place.path("elsewhere")).expect("made");
    symlink(desk.place.path("t3/t.toml"), desk.place.path("elsewhere/link.toml")).expect("linked");
    desk.place.write("copy/t.toml", WALL);
    let absolute = desk.place.path("t3/t.toml");
    for (folder, path) in [
        ("elsewhere", "../t3/t.toml"),
        ("", "t3/t.toml"),
        ("", "./elsewhere/../t3//t.toml"),
        ("elsewhere", "link.toml"),
        ("elsewhere", absolute.to_str().expect("text")),
        ("copy", "t.toml"),
    ] {
        let said = desk.restart(folder, path);
        assert!(said.contains("going on where"), "{said}");
        for word in ["changed", "dropped", "forgotten"] {
            assert!(!said.contains(word), "{path} in {folder}: {said}");
        }
        check_all(&desk);
    }
    // What was tuned goes into the file, and is no tuning any more.
    desk.run(&["wall", "save", absolute.to_str().expect("text")]);
    let said = desk.restart("elsewhere", "../t3/t.toml");
    assert!(!said.contains("dropped"), "{said}");
    check_all(&desk);
    let saved = desk.run(&["wall", "save", absolute.to_str().expect("text")]);
    assert!(saved.contains("says already"), "{saved}");
}

#[test]
fn an_edited_eye_or_deadline_drops_nothing_and_is_logged_with_both_values() {
    let mut desk = Desk::start();
    desk.work();
    desk.edit(|text| text.replace("eye = [0.0, 0.0, 0.0]", "eye = [0.0, 0.5, 0.0]"));
    let said = desk.restart("", "t3/t.toml");
    let line = said.lines().find(|line| line.contains("wall.eye")).expect("logged");
    assert!(line.contains("[0.0, 0.0, 0.0]") && line.contains("[0.0, 0.5, 0.0]"), "{line}");
    assert!(!said.contains("dropped"), "{said}");
    check_all(&desk);
    desk.edit(|text| format!("{text}\n[deadline]\nmax_ms = 1500\n"));
    let said = desk.restart("", "t3/t.toml");
    assert!(said.contains("deadline.max_ms") && !said.contains("dropped"), "{said}");
    assert!(!said.contains("wall.eye"), "what was said once is not said again: {said}");
    check_all(&desk);
    let saved = desk.place.path("t3/t.toml");
    desk.run(&["wall", "save", saved.to_str().expect("text")]);
    check_all(&desk);
}

#[test]
fn an_edited_pin_drops_the_tuned_pin_of_that_channel_only() {
    let mut desk = Desk::start();
    desk.work();
    let pin = "pin = [[5, 0], [0, 0], [0, 0], [0, 0]]";
    desk.edit(|text| format!("{text}\n[channel.left]\n{pin}\n"));
    let said = desk.restart("", "t3/t.toml");
    let lost: Vec<_> = said.lines().filter(|line| line.contains("a tuning was dropped")).collect();
    assert_eq!(lost.len(), 1, "{said}");
    assert!(lost[0].contains("left") && lost[0].contains("pin"), "{said}");
    let left = desk.shown("left");
    assert!(left.contains("pin.upper-left=@5,0\n") && left.contains("gain=0.5"), "{left}");
    assert!(desk.shown("right").contains("pin.upper-left=@3,1\n"));
    let copy = said.lines().find_map(|line| line.split("copy=").nth(1)).expect("a copy");
    assert!(Path::new(copy.trim()).is_file(), "{said}");
}

#[test]
fn a_removed_channel_and_screen_are_named_and_the_rest_stays() {
    let mut desk = Desk::start();
    desk.work();
    desk.edit(|text| {
        let from = text.find("[[screen.channel]]\nname = \"right\"").expect("there");
        let to = text.find("[storage]").expect("there");
        [&text[..from], &text[to..]].concat().replace("[320, 80]", "[160, 80]")
    });
    let said = desk.restart("", "t3/t.toml");
    for part in ["screen.side", "screen.front.channel.right", "channel=\"right\"", "view 2"] {
        assert!(said.contains(part), "{part} is not in {said}");
    }
    assert!(desk.shown("left").contains("pin.upper-left=@2,1\n"));
    assert_eq!(desk.run(&["view", "list"]).lines().count(), 1);
}

#[test]
fn a_renamed_channel_keeps_its_tuning_and_an_added_one_costs_none() {
    let mut desk = Desk::start();
    desk.work();
    desk.edit(|text| text.replace("name = \"right\"", "name = \"rechts\""));
    let said = desk.restart("", "t3/t.toml");
    assert!(said.contains("renamed") && !said.contains("dropped"), "{said}");
    assert!(desk.shown("rechts").contains("pin.upper-left=@3,1\n"), "{}", desk.shown("rechts"));
    desk.edit(|text| {
        let more = "[[screen.channel]]\nname = \"more\"\norigin = [320, 0]\npixels = [160, 80]\n";
        let text = text.replace("[320, 80]", "[480, 80]");
        text.replacen(
            "\n[[screen]]\nname = \"side\"",
            &format!("{more}\n[[screen]]\nname = \"side\""),
            1,
        )
    });
    let said = desk.restart("", "t3/t.toml");
    assert!(said.contains("screen.front.channel.more"), "{said}");
    assert!(!said.contains("a tuning was dropped"), "{said}");
    assert!(desk.shown("rechts").contains("pin.upper-left=@3,1\n"));
    assert!(desk.shown("left").contains("pin.upper-left=@2,1\n"));
}
