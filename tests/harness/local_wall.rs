//! A wall of real processes, each started by hand as an operator would.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::{
    Camera, Capture, ChannelState, ChannelStatus, ConnectOptions, Wall, WallStatus,
};
use serde_json::json;

use super::place::TestDir;
use super::process::{Finished, Process};
use super::scenes::Gltf;
use super::{keys, pictures, wait};

/// Milliseconds for which frames wait for a channel in tests: machines that also build something
/// are slow, and a picture without a channel is not what most tests are about.
const PATIENCE_MS: u32 = 20_000;

/// A port that the system chooses. The address is not that which connections begin at: one of those
/// may take the port of a manager while it is started again.
pub const ANY_PORT: &str = "127.0.0.2:0";

/// A manager and its servers; they end with it.
#[derive(Debug)]
pub struct LocalWall {
    pub place: TestDir,
    pub address: String,
    pub manager: Process,
    /// By name.
    pub servers: BTreeMap<String, Process>,
    wall: Wall,
}

/// A wall file of the repository, with patience.
pub fn of_repository(name: &str) -> Wall {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name);
    patient(polyptych_wall_file::load(&path).unwrap_or_else(|error| panic!("{error}")))
}

/// The screen of single.toml as tiles of a few pixels each.
pub fn small(columns: u32, rows: u32) -> Wall {
    patient(tiled([columns, rows], [480, 272]))
}

/// The screen of single.toml with so many pixels in all, and the times of a wall file that names
/// none.
pub fn tiled([columns, rows]: [u32; 2], pixels: [u32; 2]) -> Wall {
    let [width, height] = [pixels[0] / columns, pixels[1] / rows];
    let text = format!(
        r#"
        [wall]
        name = "small"
        [[screen]]
        name = "front"
        size = [1.92, 1.088]
        center = [0.0, 0.0, -1.304]
        [screen.tiles]
        columns = {columns}
        rows = {rows}
        pixels = [{width}, {height}]
        "#
    );
    let parsed = polyptych_wall_file::parse(&text, "small.toml".as_ref());
    let mut wall = parsed.unwrap_or_else(|error| panic!("{error}"));
    wall.scenes.clear();
    wall
}

/// Returns the wall with `PATIENCE_MS` for its deadlines and heartbeat, and without scenes of its
/// own.
pub fn patient(mut wall: Wall) -> Wall {
    wall.deadline.min_ms = PATIENCE_MS;
    wall.deadline.max_ms = PATIENCE_MS;
    wall.heartbeat_ms = PATIENCE_MS;
    wall.scenes.clear();
    wall
}

impl LocalWall {
    /// Starts the manager and a server for each that the wall file names, and waits until all
    /// channels could draw.
    pub fn start(wall: &Wall, scenes: &[&Path]) -> Self {
        Self::start_in(TestDir::new(), wall, scenes, ANY_PORT)
    }

    /// The [small] wall of so many tiles with a scene without meshes.
    pub fn with_nothing(columns: u32, rows: u32) -> Self {
        let place = TestDir::new();
        let nothing = Gltf::triangle().with(|gltf| {
            gltf.json["scenes"][0]["nodes"] = json!([0]);
            gltf.json["nodes"] = json!([{ "name": "nothing" }]);
        });
        let folder = place.write("empty.glb", nothing.glb()).parent().expect("a folder").to_owned();
        let local = Self::start_in(place, &small(columns, rows), &[&folder], ANY_PORT);
        local.client().open_scene("empty.glb").expect("opened");
        local
    }

    /// Starts manager and servers in a place that is there, with the keys that it may have, and
    /// waits until all channels could draw.
    pub fn start_in(place: TestDir, wall: &Wall, scenes: &[&Path], listen: &str) -> Self {
        let mut local = Self::manager(place, wall, scenes, listen);
        let servers: Vec<String> = wall.channels.iter().map(|c| c.server.clone()).collect();
        for server in servers {
            if !local.servers.contains_key(&server) {
                local.start_server(&server);
            }
        }
        let client = local.client();
        await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
        local
    }

    /// Starts only the manager.
    pub fn manager(place: TestDir, wall: &Wall, scenes: &[&Path], listen: &str) -> Self {
        Self::manager_with(place, wall, scenes, listen, &[])
    }

    /// Starts only the manager, with more arguments.
    pub fn manager_with(
        place: TestDir,
        wall: &Wall,
        scenes: &[&Path],
        listen: &str,
        extra: &[&str],
    ) -> Self {
        let path = place.write("wall.toml", polyptych_wall_file::to_toml(wall));
        let mut arguments = ["manager", "--listen", listen].map(OsString::from).to_vec();
        arguments.extend(extra.iter().map(OsString::from));
        for folder in scenes {
            arguments.extend(["--scenes".into(), folder.as_os_str().to_owned()]);
        }
        if let Some(folder) = keys::of(&place, "manager") {
            arguments.extend(["--keys".into(), folder.into()]);
        }
        arguments.push(path.into());
        let mut manager = place.start("manager", arguments);
        let line = manager.await_line(&["manager listens", "address="]);
        let address = line.split("address=").nth(1).and_then(|rest| rest.split(' ').next());
        let address = address.expect("an address behind its name").to_owned();
        Self { place, address, manager, servers: BTreeMap::new(), wall: wall.clone() }
    }

    /// Starts a server with all channels that the wall file gives it.
    pub fn start_server(&mut self, name: &str) {
        let server = start_server(&self.place, &self.wall, name, &self.address);
        self.servers.insert(name.to_owned(), server);
    }

    /// The wall that it drives.
    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    /// A client of this wall.
    pub fn client(&self) -> Client {
        Client::connect_with(self.connect_options()).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Returns the address and the identity with which a client of this wall connects.
    pub fn connect_options(&self) -> ConnectOptions {
        let mut options = ConnectOptions::new(self.address.as_str());
        options.token_file = Some(self.place.token_file());
        options.keys = keys::of(&self.place, "client-operator");
        options.name = "test".into();
        // Most tests want to see a connection end.
        options.reconnect = None;
        options
    }

    /// Runs a command against this wall's manager.
    #[track_caller]
    pub fn run(&self, arguments: &[&str]) -> Finished {
        let mut arguments: Vec<OsString> = arguments.iter().map(OsString::from).collect();
        arguments.extend(["--manager", &self.address].map(OsString::from));
        let has_keys = arguments.iter().any(|argument| argument == "--keys");
        if let Some(folder) = keys::of(&self.place, "client-operator").filter(|_| !has_keys) {
            arguments.extend(["--keys".into(), folder.into()]);
        }
        self.place.run(arguments)
    }

    /// Waits until the manager knows that this server has gone.
    #[track_caller]
    pub fn await_lost(&self, client: &Client, server: &str) {
        let mine = self.wall.channels.iter().filter(|c| c.server == server);
        let names: Vec<&str> = mine.map(|channel| channel.name.as_str()).collect();
        wait::until(&format!("{names:?} lost"), || {
            let status = client.status().unwrap_or_else(|error| panic!("{error}"));
            let mut mine = status.channels.iter().filter(|c| names.contains(&c.name.as_str()));
            mine.all(|channel| channel.state == ChannelState::Lost).then_some(())
        });
    }
}

/// Waits until every channel is in one of these states.
#[track_caller]
pub fn await_states(client: &Client, states: &[ChannelState]) -> WallStatus {
    let is_there = |channel: &ChannelStatus| states.contains(&channel.state);
    wait::until(&format!("all channels {states:?}"), || {
        let status = client.status().unwrap_or_else(|error| panic!("{error}"));
        status.channels.iter().all(is_there).then_some(status)
    })
}

/// Starts a server with all channels that the wall gives it, whether there is a manager or not.
pub fn start_server(place: &TestDir, wall: &Wall, name: &str, manager: &str) -> Process {
    start_server_with(place, wall, name, manager, &["--headless"], &[])
}

/// Starts a server as [`start_server`] does, with these arguments and variables.
pub fn start_server_with(
    place: &TestDir,
    wall: &Wall,
    name: &str,
    manager: &str,
    more: &[&str],
    environment: &[(&str, &str)],
) -> Process {
    let mut arguments: Vec<OsString> = ["server", "--with-parent"].map(OsString::from).to_vec();
    arguments.extend(more.iter().map(OsString::from));
    arguments.extend(["--manager", manager, "--name", name, "--cache"].map(OsString::from));
    arguments.push(place.path(&format!("blobs-{name}")).into());
    if let Some(folder) = keys::of(place, &format!("server-{name}")) {
        arguments.extend(["--keys".into(), folder.into()]);
    }
    let channels = wall.channels.iter().filter(|channel| channel.server == name);
    arguments.extend(channels.flat_map(|c| ["--channel", &c.name]).map(OsString::from));
    let mut command = place.command(arguments);
    command.envs(environment.iter().copied());
    Process::start(&format!("server {name}"), &mut command)
}

/// The whole wall from here, all channels being there.
#[track_caller]
pub fn shot(client: &Client, camera: Camera) -> Capture {
    client.set_camera(camera).unwrap_or_else(|error| panic!("{error}"));
    let capture = client.capture().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(capture.missing, [], "channels that sent no picture");
    capture
}

/// The picture of the only screen.
#[track_caller]
pub fn screen_of(capture: &Capture) -> RgbaImage {
    let [screen] = &capture.screens[..] else { panic!("{} screens", capture.screens.len()) };
    pictures::image_of(screen)
}
