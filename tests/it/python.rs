//! The Python package drives a wall as the Rust client does: the cases of `tests/conformance` hold
//! for both, and for plain HTTP; its example runs unchanged on one channel and on fourteen.

mod calls;
mod patterns;

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use polyptych_client::{ChannelState, Wall, fit_bounds};
use serde_json::Value;

use crate::harness::local_wall::{
    ANY_PORT, LocalWall, await_states, patient, screen_of, shot, small, tiled,
};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count, read};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::town;
use crate::harness::{keys, wait};

/// Maximum time of a runner: it makes some hundred small requests.
const RUNNER_TIME_MAX: Duration = Duration::from_mins(3);

/// A file of the repository.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A wall whose manager serves HTTP, and where.
struct HttpWall {
    local: LocalWall,
    address: String,
}

impl HttpWall {
    /// Starts the manager and all servers, and waits until channels could draw.
    fn start(place: TestDir, wall: &Wall, scenes: &[&Path]) -> Self {
        let http = ["--http", ANY_PORT];
        let mut local = LocalWall::manager_with(place, wall, scenes, ANY_PORT, &http);
        let line = local.manager.await_line(&["HTTP is offered", "url=http"]);
        let address = line.split("://").nth(1).and_then(|rest| rest.split('/').next());
        let address = address.expect("an address").to_owned();
        let servers: BTreeSet<&String> = wall.channels.iter().map(|c| &c.server).collect();
        for server in servers {
            local.start_server(server);
        }
        await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
        Self { local, address }
    }

    /// Python with these arguments, as a user of this wall.
    fn python(&self, arguments: &[&dyn AsRef<OsStr>]) -> Process {
        let mut command = python();
        command
            .args(arguments.iter().map(AsRef::as_ref))
            .current_dir(self.local.place.folder())
            .env("POLYPTYCH_TOKEN_FILE", self.local.place.token_file());
        Process::start("python3", &mut command)
    }
}

/// Python that finds the package in the source folder and leaves nothing there.
fn python() -> Command {
    let mut command = Command::new("python3");
    command
        .env("PYTHONPATH", repository("client-api/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env_remove("POLYPTYCH_KEYS")
        .env_remove("POLYPTYCH_BEARER");
    command
}

#[test]
#[cfg_attr(not(has_python), ignore = "no python3 of version 3.9 or later")]
fn the_package_holds_without_a_wall() {
    let mut command = python();
    let tests = repository("client-api/python/tests");
    command.args(["-W", "error", "-m", "unittest", "discover", "-s"]).arg(tests);
    let said = Process::start("unittest", &mut command).finish(RUNNER_TIME_MAX).succeeded();
    assert!(said.contains("\nOK"), "{said}");
}

#[test]
#[cfg_attr(not(has_python), ignore = "no python3 of version 3.9 or later")]
fn the_same_cases_hold_for_python_and_for_plain_http() {
    let scenes = repository("tests/conformance/scenes");
    let wall = HttpWall::start(TestDir::new(), &small(2, 1), &[&scenes]);
    let runner = repository("tests/conformance/run.py");
    let count = cases().len();
    let token = wall.local.place.token_file();
    let bearer = wall.local.place.run(["login", "--token"]).succeeded().trim().to_owned();
    for (kind, secret) in [("python", token.as_os_str()), ("http", bearer.as_ref())] {
        let mut process = wall.python(&[&runner, &kind, &wall.address, &secret]);
        let said = process.finish(RUNNER_TIME_MAX).succeeded();
        assert!(said.contains(&format!("{kind}: {count} cases passed, 0 failed")), "{said}");
    }
}

#[test]
fn the_same_cases_hold_for_the_rust_client() {
    let scenes = repository("tests/conformance/scenes");
    let local = LocalWall::start(&small(2, 1), &[&scenes]);
    let client = local.client();
    let reset: Value = parsed("reset.json");
    let mut faults = Vec::new();
    for (name, case) in cases() {
        for request in reset["requests"].as_array().expect("requests") {
            let request = serde_json::from_value(request.clone()).expect("a request");
            client.request(request).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
        for (number, step) in (1..).zip(case["steps"].as_array().expect("steps")) {
            let found = calls::run(&client, step);
            if !found.is_empty() {
                faults.push(format!("{name}, step {number}, {}: {found:?}", step["call"]));
                break;
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// All cases, by their names, in the order in which runners take them.
fn cases() -> Vec<(String, Value)> {
    let mut all = Vec::new();
    for file in ["pictures", "edits", "questions", "presentation", "sessions", "refusals"] {
        let parsed = parsed(&format!("{file}.json"));
        for case in parsed["cases"].as_array().expect("cases") {
            all.push((format!("{file}: {}", case["name"]), case.clone()));
        }
    }
    all
}

fn parsed(file: &str) -> Value {
    let path = repository("tests/conformance").join(file);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn every_file_of_cases_is_run() {
    let folder = repository("tests/conformance");
    let files = std::fs::read_dir(folder).expect("a folder").flatten().map(|file| file.path());
    let files = files.filter(|path| path.extension().is_some_and(|of| of == "json"));
    let mut names: Vec<String> =
        files.map(|path| path.file_stem().expect("a name").to_string_lossy().into()).collect();
    names.sort();
    let known = ["edits", "pictures", "presentation", "questions", "refusals", "reset", "sessions"];
    assert_eq!(names, known);
}

/// A wall of these tiles, driven by two processes.
fn of_two_servers(columns: u32, rows: u32) -> Wall {
    let mut wall = patient(tiled([columns, rows], [476, 272]));
    for (index, channel) in wall.channels.iter_mut().enumerate() {
        channel.server = format!("server-{}", index % 2);
    }
    wall
}

#[test]
#[cfg_attr(not(has_python), ignore = "no python3 of version 3.9 or later")]
fn the_example_runs_unchanged_on_one_four_and_fourteen_channels() {
    let example = repository("client-api/python/examples/hello_wall.py");
    let lines = std::fs::read_to_string(&example).expect("an example").lines().count();
    assert!(lines <= 30, "{lines} lines");
    let mut first = None;
    for (columns, rows) in [(1, 1), (2, 2), (7, 2)] {
        let layout = of_two_servers(columns, rows);
        let wall = HttpWall::start(TestDir::new(), &layout, &[town().parent().expect("a folder")]);
        let mut process = wall.python(&[&example, &"town.glb", &wall.address]);
        let said = process.finish(wait::LIMIT).succeeded();
        let count = columns * rows;
        assert!(said.contains(&format!("on {count} of {count} channels")), "{said}");
        let picture = read(&wall.local.place.path("front.png"));
        assert!(color_count(&picture) > 100, "there is something to see");
        // The Rust client places its camera alike, and gets the same picture.
        let client = wall.local.client();
        let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
        let camera = fit_bounds(&client.wall().expect("a wall"), &bounds, 0.6);
        check("python", &picture, &screen_of(&shot(&client, camera)), &IDENTICAL);
        let expected = first.get_or_insert_with(|| picture.clone());
        check(&format!("python-{count}"), &picture, expected, &SEAMS);
    }
}

/// A program that watches a wall, and shows itself as notebooks do.
const WATCHING: &str = "
import sys, polyptych
with polyptych.Client.connect(sys.argv[1]) as wall:
    with wall.feedback() as feedback:
        drawn = [wall.render_frame().frame for _ in range(5)]
        assert [next(feedback).frame for _ in drawn] == drawn, drawn
        wall.start_rendering(60.0)
        frames = [next(feedback).frame for _ in range(30)]
        wall.pause()
        assert frames == list(range(frames[0], frames[0] + 30)), frames
        assert feedback.lost == 0
    with wall.events() as events:
        first = next(event for event in events if isinstance(event, polyptych.StatusEvent))
        assert first.status.wall == wall.wall_name and first.status.epoch == wall.epoch
        wall.set_output_mode(polyptych.OutputMode.BLANK)
        texts = (event.text for event in events if isinstance(event, polyptych.LogEvent))
        assert 'displays are in mode blank' in texts
    assert wall._repr_png_()[1:4] == b'PNG' and 'front</td><td>live' in wall._repr_html_()
    capture = wall.capture(channels=True)
    assert [image.name for image in capture.channels] == ['front'] and not capture.missing
    assert {image.frame for image in [*capture.screens, *capture.channels]} == {capture.frame}
    for image in [*capture.screens, *capture.channels]:
        assert (image.width, image.height) == (480, 272) and image._repr_png_()[1:4] == b'PNG'
    assert wall.preview(width=48).width == 48
print('watched')
";

#[test]
#[cfg_attr(not(has_python), ignore = "no python3 of version 3.9 or later")]
fn a_program_watches_a_wall_and_sees_every_frame() {
    let wall = HttpWall::start(TestDir::new(), &small(1, 1), &[]);
    let mut process = wall.python(&[&"-c", &WATCHING, &wall.address]);
    assert_eq!(process.finish(wait::LIMIT).succeeded(), "watched");
}

/// A program that says what it sees of a wall with keys.
const WITH_KEYS: &str = "
import sys, polyptych
address, folder = sys.argv[1:]
try:
    with polyptych.Client.connect(address, keys=folder) as wall:
        print(wall.wall_name, wall.status().clients, wall.render_frame().is_complete())
        with wall.events() as events:
            print(type(next(events)).__name__)
except polyptych.ClientError as error:
    print(type(error).__name__, error)
";

/// A server of the wall that takes itself for its manager, and a client that meets it.
const IMPOSTOR: &str = "
import socket, ssl, sys, threading, polyptych
own, folder = sys.argv[1:]
context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
context.load_cert_chain(own + '/cert.pem', own + '/key.pem')
listener = socket.create_server(('127.0.0.1', 0))
def serve():
    connected = listener.accept()[0]
    try:
        context.wrap_socket(connected, server_side=True).recv(1 << 16)
    except OSError:
        pass
threading.Thread(target=serve, daemon=True).start()
try:
    polyptych.Client.connect('127.0.0.1:%d' % listener.getsockname()[1], keys=folder)
except polyptych.ClientError as error:
    print(type(error).__name__, error)
";

#[test]
#[cfg_attr(not(has_python), ignore = "no python3 of version 3.9 or later")]
fn keys_stand_for_a_token() {
    let (place, layout) = (TestDir::new(), small(1, 1));
    keys::make(&place, &layout);
    let wall = HttpWall::start(place, &layout, &[]);
    let ask = |folder: &Path| {
        let mut process = wall.python(&[&"-c", &WITH_KEYS, &wall.address, &folder]);
        process.finish(wait::LIMIT).succeeded()
    };
    let own = keys::of(&wall.local.place, "client-operator").expect("keys");
    let said = ask(&own);
    assert!(said.contains("'http operator'") && said.ends_with("True\nStatusEvent"), "{said}");
    // A server's certificate commands nothing, and that of another wall is not believed.
    let server = format!("server-{}", layout.channels[0].server);
    let servers = keys::of(&wall.local.place, &server).expect("keys");
    let said = ask(&servers);
    assert!(said.starts_with("Refused") && said.contains("polyptych keys --client"), "{said}");
    let other = TestDir::new();
    keys::make(&other, &layout);
    let others = keys::of(&other, "client-operator").expect("keys");
    let said = ask(&others);
    assert!(said.starts_with("NotSecured"), "{said}");
    // Nor does the client believe a manager of another wall, or a server that plays the manager.
    let mixed = wall.local.place.path("mixed");
    std::fs::create_dir(&mixed).expect("made");
    for (from, name) in [(&own, "cert.pem"), (&own, "key.pem"), (&others, "authority.pem")] {
        std::fs::copy(from.join(name), mixed.join(name)).expect("copied");
    }
    let said = ask(&mixed);
    assert!(said.starts_with("NotSecured") && said.contains("certificate verify failed"), "{said}");
    let mut process = wall.python(&[&"-c", &IMPOSTOR, &servers, &own]);
    let said = process.finish(wait::LIMIT).succeeded();
    assert!(said.starts_with("NotSecured") && said.contains("unsuitable certificate"), "{said}");
    // In the clear it is told what is wrong.
    let plain = "
import sys, polyptych
try:
    polyptych.Client.connect(sys.argv[1], token='0' * 32)
except polyptych.ClientError as error:
    print(type(error).__name__)
";
    let mut process = wall.python(&[&"-c", &plain, &wall.address]);
    let said = process.finish(wait::LIMIT).succeeded();
    assert!(said == "Handshake" || said == "NotSecured", "{said}");
}
