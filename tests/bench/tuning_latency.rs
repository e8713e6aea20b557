//! The time that a person who aligns a wall waits to see a change: one server with one channel of a
//! wall of projectors, as every machine of it has it.
//!
//! `cargo bench --bench tuning_latency [-- WALL.toml ...]`; without a wall, `dome-5` and
//! `powerwall-overlap`. Measured from the request to the answer, which comes when a frame with the
//! change was swapped; and from the start of the server until it could show a picture.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use polyptych_client::blocking::Client;
use polyptych_client::calibration_change::{CalibrationChange, Corner, Edge, Offset};
use polyptych_client::glam::{DVec2, DVec3};
use polyptych_client::{ChannelState, ConnectOptions};

/// Each change is made so often.
const TIMES: u32 = 5;

/// A start that takes longer has failed.
const START_TIME_MAX: Duration = Duration::from_mins(2);

/// The name of a change, and the change itself for the n-th time.
type Tuning = (&'static str, fn(f64) -> CalibrationChange);

/// A process that ends with its measurement.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let named: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let usual = ["dome-5.toml", "powerwall-overlap.toml"].map(|name| configs.join(name));
    let walls = if named.is_empty() { usual.to_vec() } else { named };
    walls.iter().try_for_each(|wall| measure(wall))
}

fn measure(path: &Path) -> Result<(), Box<dyn Error>> {
    let wall = polyptych_wall_file::load(path)?;
    let channel = wall.channels.first().ok_or("the wall has no channel")?.name.clone();
    let folder = tempfile::tempdir()?;
    let in_folder = |name: &str| folder.path().join(name);
    let address = {
        let free = std::net::TcpListener::bind("127.0.0.1:0")?;
        free.local_addr()?.to_string()
    };
    let polyptych = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_polyptych"));
        command.args(["--log", "error"]).env("POLYPTYCH_TOKEN_FILE", in_folder("token"));
        command
    };
    let mut manager = polyptych();
    manager.args(["manager", "--listen", &address, "--state"]).arg(in_folder("state"));
    let _manager = Ended(manager.arg("--store").arg(in_folder("store")).arg(path).spawn()?);
    let mut server = polyptych();
    server.args(["server", "--headless", "--manager", &address, "--channel", &channel]);
    let began = Instant::now();
    let _server = Ended(server.arg("--cache").arg(in_folder("cache")).spawn()?);
    let client = connected(&address, &in_folder("token"), began)?;
    until_ready(&client, &channel, began)?;
    println!(
        "{}: {channel} is ready {:.2} s after its start",
        wall.name,
        began.elapsed().as_secs_f64()
    );
    for (what, change) in changes() {
        let mut times_ms = Vec::new();
        for time in 0..TIMES {
            let start = Instant::now();
            client.calibrate(&channel, vec![change(f64::from(time))])?;
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times_ms.sort_by(f64::total_cmp);
        let (median, most) = (times_ms[times_ms.len() / 2], times_ms[times_ms.len() - 1]);
        println!("{}: {what}: {median:.0} ms, {most:.0} ms at most", wall.name);
    }
    Ok(())
}

/// The changes that are measured; another one each time.
fn changes() -> [Tuning; 4] {
    [
        ("a gain", |time| CalibrationChange::Gain(DVec3::splat(0.95 - 0.01 * time))),
        ("a gamma", |time| CalibrationChange::Gamma(Some(DVec3::splat(2.2 + 0.01 * time)))),
        ("a pin", |time| CalibrationChange::Pin {
            corner: Corner::UpperLeft,
            to: Offset::To(DVec2::new(3.0 + time, 2.0)),
        }),
        ("an edge", |time| CalibrationChange::Edge {
            side: Edge::Right,
            width: Some(120.0 + time),
        }),
    ]
}

fn connected(address: &str, token_file: &Path, began: Instant) -> Result<Client, Box<dyn Error>> {
    let mut options = ConnectOptions::new(address);
    options.token_file = Some(token_file.to_owned());
    loop {
        match Client::connect_with(options.clone()) {
            Ok(client) => return Ok(client),
            Err(error) if began.elapsed() > START_TIME_MAX => return Err(error.into()),
            Err(_) => std::thread::yield_now(),
        }
    }
}

fn until_ready(client: &Client, channel: &str, began: Instant) -> Result<(), Box<dyn Error>> {
    loop {
        let status = client.status()?;
        let mut own = status.channels.iter().filter(|it| it.name == channel);
        if own.any(|it| matches!(it.state, ChannelState::Ready | ChannelState::Live)) {
            return Ok(());
        }
        if began.elapsed() > START_TIME_MAX {
            return Err(format!("{channel} is not ready").into());
        }
        // Asked too often, the manager would measure itself.
        std::thread::park_timeout(Duration::from_millis(10));
    }
}
