//! The cost of the frame barrier, beside a raw TCP barrier of the same shape in the same run.
//!
//! Stub servers answer at once and draw nothing, so what remains is the cluster itself: frame
//! command out, a report from each back, swap command out. The raw barrier sends messages of the
//! same sizes in the same order and does nothing else. Both have one thread for the middle and one
//! for each server, on loopback: with one for all of them, a server would wait for the answers of
//! the others, and the skew would measure that.

mod raw;
mod secrets;
mod stub;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use glam::{DVec2, DVec3, UVec2};
use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions, Pacing, Quantiles};
use polyptych_manager::import::Baker;
use polyptych_manager::recorder::Recorder;
use polyptych_manager::{ManagerOptions, run as run_manager};
use polyptych_tls::NodeIdentity;
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, DeadlinePolicy, Screen, Surface, Wall};
use secrets::Secrets;
use serde::Serialize;
use tokio_util::sync::CancellationToken;

/// Pixels of a channel that nobody draws.
const SIDE: u32 = 64;

/// Maximum time for all stub servers together to connect.
const JOIN_TIME_MAX: Duration = Duration::from_secs(30);

/// Period in which a measurement checks whether it is over: each check takes the manager's time.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Ours, raw and the ratio, for one number of servers.
#[derive(Debug, Serialize)]
pub(crate) struct BarrierCost {
    pub servers: u16,
    pub frames: u64,
    /// From the first connection to the last live channel.
    pub joined_ms: f64,
    pub ours: Measured,
    pub raw: Measured,
    /// Ours by raw, of the medians.
    pub ratio_p50: f64,
    /// Ours by raw, of the 99th percentiles.
    pub ratio_p99: f64,
    /// Ours by raw, of the medians of the skew.
    pub skew_ratio_p50: f64,
}

/// The times of a barrier.
#[derive(Debug, Serialize)]
pub(crate) struct Measured {
    /// From the frame command to the swap command.
    pub barrier_us: Quantiles,
    /// From the first to the last server that received the swap command.
    pub skew_us: Quantiles,
}

/// Measures a number of servers over a number of frames, ours over TLS where `is_encrypted`.
///
/// # Errors
/// A socket failed, or the stub servers did not come.
pub(crate) fn measure(
    servers: u16,
    frames: u64,
    record: Option<&Path>,
    is_encrypted: bool,
) -> anyhow::Result<BarrierCost> {
    let recorder = record.map(Recorder::open).transpose()?;
    let (joined, ours, sizes) = measure_ours(servers, frames, recorder, is_encrypted)?;
    let raw = raw::measure(servers, frames, sizes)?;
    let ratio = |ours: f64, raw: f64| ours / raw.max(1.0);
    Ok(BarrierCost {
        servers,
        frames,
        joined_ms: joined.as_secs_f64() * 1000.0,
        ratio_p50: ratio(ours.barrier_us.p50, raw.barrier_us.p50),
        ratio_p99: ratio(ours.barrier_us.p99, raw.barrier_us.p99),
        skew_ratio_p50: ratio(ours.skew_us.p50, raw.skew_us.p50),
        ours,
        raw,
    })
}

fn measure_ours(
    servers: u16,
    frames: u64,
    recorder: Option<Recorder>,
    is_encrypted: bool,
) -> anyhow::Result<(Duration, Measured, stub::Sizes)> {
    let client_node = NodeIdentity::Client("bench".into());
    let mut nodes = vec![NodeIdentity::Manager, client_node.clone()];
    nodes.extend((0..servers).map(|index| NodeIdentity::Server(stub::channel_name(index))));
    let secrets = Arc::new(Secrets::new(is_encrypted, &nodes)?);
    let (token, keys) = (secrets.token().0, secrets.folder(&NodeIdentity::Manager));
    let listener = std::net::TcpListener::bind("127.0.0.1:0").context("no port is free")?;
    let address = listener.local_addr()?.to_string();
    let stop = CancellationToken::new();
    let end = stop.clone();
    // Whichever way this ends, both threads do too.
    let _guard = stop.clone().drop_guard();
    let manager = std::thread::Builder::new().name("manager".into()).spawn(move || {
        let options = ManagerOptions {
            wall: wall(servers),
            token,
            keys,
            scene_roots: Vec::new(),
            baker: no_baker(),
            memory: None,
            leadership: None,
            is_navigable: false,
            recorder,
            metrics: None,
            http: None,
            notifier: None,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let shutdown = async move { end.cancelled().await };
        let ran = runtime.block_on(run_manager(listener, options, shutdown));
        ran.map(drop).map_err(std::io::Error::other)
    })?;
    let began = Instant::now();
    let stubs = stub::start(&address, servers, &secrets, &stop)?;
    let mut connect = ConnectOptions::new(address);
    connect.token = Some(secrets.token().0);
    connect.reconnect = None;
    connect.keys = secrets.folder(&client_node);
    let client = Client::connect_with(connect)?;
    // Frames begin at once, so that channels become live as they come.
    client.start_rendering(Pacing::Free)?;
    while !client.status()?.channels.iter().all(|c| c.state == ChannelState::Live) {
        anyhow::ensure!(began.elapsed() < JOIN_TIME_MAX, "the stub servers did not come");
        std::thread::sleep(Duration::from_millis(1));
    }
    let joined = began.elapsed();
    client.statistics(true)?;
    let first = client.status()?.frame;
    let mut reached = first;
    while reached.0 < first.0 + frames {
        std::thread::sleep(POLL_PERIOD);
        reached = client.status()?.frame;
    }
    let statistics = client.statistics(false)?;
    client.stop()?;
    stop.cancel();
    let sights = stubs.join()?;
    let measured = Measured {
        barrier_us: statistics.barrier_us,
        skew_us: Quantiles::from_samples(sights.skews_us(first)),
    };
    let sizes = sights.sizes();
    // Its error, if any, has shown in the client's calls.
    let _ = manager.join();
    Ok((joined, measured, sizes))
}

/// The baker of a manager that opens no scene.
fn no_baker() -> Baker {
    let (program, store) = ("true".into(), std::env::temp_dir());
    Baker { program, memory_mib: 1, memory_remedy: "open no scene", store }
}

fn wall(channels: u16) -> Wall {
    let channel = |index: u16| {
        let origin = UVec2::new(u32::from(index) * SIDE, 0);
        Channel::tile(&stub::channel_name(index), 0, origin, UVec2::splat(SIDE))
    };
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
    let canvas = UVec2::new(u32::from(channels) * SIDE, SIDE);
    let screens = vec![Screen::new("front", Surface::Plane(plane), canvas)];
    Wall {
        deadline: DeadlinePolicy { factor: 4.0, min_ms: 2000, max_ms: 2000 },
        heartbeat_ms: 5000,
        ..Wall::new("barrier", screens, (0..channels).map(channel).collect())
    }
}

/// The time from the first to the last of these instants, in microseconds.
fn width_us(instants: &[Instant]) -> Option<f64> {
    let (first, last) = (instants.iter().min()?, instants.iter().max()?);
    Some((*last - *first).as_secs_f64() * 1e6)
}
