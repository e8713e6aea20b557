//! Servers that speak the protocol and draw nothing.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::codec;
use polyptych_protocol::command::{Command, Frame, Prepare};
use polyptych_protocol::connection;
use polyptych_protocol::handshake::{Adapter, Hello, Role, Secret, ServerHello};
use polyptych_protocol::ids::{ChannelId, Digest, FrameId, Revision};
use polyptych_protocol::limits::CHANNEL_SIDE_MAX;
use polyptych_protocol::log::Replica;
use polyptych_protocol::status::{Drawn, Ping, Prepared, Shown, Status};
use tokio::net::TcpStream;
use tokio_util::sync::CancellationToken;

use super::width_us;

/// Often enough for the heartbeat of the measured wall.
const PING_PERIOD: Duration = Duration::from_secs(1);

/// Bytes of the messages of one frame, as a raw barrier should send them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sizes {
    pub frame: usize,
    pub drawn: usize,
    pub swap: usize,
    pub shown: usize,
}

#[derive(Debug, Default)]
struct Seen {
    sizes: Sizes,
    /// When each server received the swap of a frame.
    swaps: BTreeMap<FrameId, Vec<Instant>>,
}

/// The stub servers, on a thread of their own.
#[derive(Clone, Debug, Default)]
pub(super) struct Stubs(Arc<Mutex<Seen>>);

impl Stubs {
    fn with<T>(&self, look: impl FnOnce(&mut Seen) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Forgets what was seen so far.
    pub fn forget(&self) {
        self.with(|seen| seen.swaps.clear());
    }

    /// The sizes of the messages of a frame.
    pub fn sizes(&self) -> Sizes {
        self.with(|seen| seen.sizes)
    }

    /// The skew of every frame that all servers have seen, in microseconds.
    pub fn skews_us(&self, servers: u16) -> Vec<f64> {
        self.with(|seen| {
            let whole = seen.swaps.values().filter(|swaps| swaps.len() == usize::from(servers));
            whole.filter_map(|swaps| width_us(swaps)).collect()
        })
    }
}

/// The name of a channel, and of the server that drives it.
pub(super) fn channel_name(index: u16) -> String {
    format!("stub-{index}")
}

/// Starts the servers; they end when `stop` is cancelled or the manager ends.
pub(super) fn start(
    address: &str,
    servers: u16,
    token: &str,
    stop: CancellationToken,
) -> std::io::Result<Stubs> {
    let stubs = Stubs::default();
    let (address, token, shared) = (address.to_owned(), token.to_owned(), stubs.clone());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let work = move || {
        runtime.block_on(async {
            let mut tasks = tokio::task::JoinSet::new();
            for index in 0..servers {
                let stub = serve(address.clone(), index, token.clone(), shared.clone());
                tasks.spawn(stub);
            }
            let all = async { while tasks.join_next().await.is_some() {} };
            tokio::select! {
                () = all => {}
                () = stop.cancelled() => {}
            }
        });
    };
    std::thread::Builder::new().name("stubs".into()).spawn(work)?;
    Ok(stubs)
}

async fn serve(address: String, index: u16, token: String, stubs: Stubs) {
    if let Err(error) = converse(&address, index, token, &stubs).await {
        tracing::warn!(index, %error, "a stub server ended");
    }
}

async fn converse(
    address: &str,
    index: u16,
    token: String,
    stubs: &Stubs,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let stream = TcpStream::connect(address).await?;
    stream.set_nodelay(true)?;
    let hello = Hello::Server(ServerHello {
        name: channel_name(index),
        token: Secret(token),
        channels: vec![channel_name(index)],
        pid: std::process::id(),
        adapter: Adapter { texture_side_max: CHANNEL_SIDE_MAX, ..Adapter::default() },
    });
    let (mut frames, _) = connection::introduce(stream, Role::Server, &hello).await?;
    let mut ping = tokio::time::interval(PING_PERIOD);
    let mut replica = Replica::default();
    let mut digest = Digest::default();
    loop {
        let bytes = tokio::select! {
            message = frames.next() => match message {
                Some(bytes) => bytes?,
                None => return Ok(()),
            },
            _ = ping.tick() => {
                let ping = Status::Ping(Ping { sent_us: 0, memory_bytes: 0 });
                frames.send(codec::encode(&ping)).await?;
                continue;
            }
        };
        let answer = match codec::decode::<Command>(&bytes)? {
            Command::Prepare(prepare) => {
                let prepared = prepare_replica(prepare, &mut replica);
                digest = prepared.digest;
                codec::encode(&Status::Prepared(prepared))
            }
            Command::Frame(frame) => {
                let answer = codec::encode(&drawn(&frame, index, replica.revision, digest));
                stubs.with(|seen| {
                    seen.sizes.frame = bytes.len();
                    seen.sizes.drawn = answer.len();
                });
                answer
            }
            Command::Swap(swap) => {
                let shown = Status::Shown(Shown {
                    epoch: swap.epoch,
                    frame: swap.frame,
                    channel: ChannelId(index),
                    at_us: 0,
                    clock_error_us: 0,
                });
                let answer = codec::encode(&shown);
                stubs.with(|seen| {
                    seen.swaps.entry(swap.frame).or_default().push(Instant::now());
                    seen.sizes.swap = bytes.len();
                    seen.sizes.shown = answer.len();
                });
                answer
            }
            Command::Pong(_) => continue,
            Command::Goodbye { .. } => return Ok(()),
        };
        frames.send(answer).await?;
    }
}

fn prepare_replica(prepare: Prepare, replica: &mut Replica) -> Prepared {
    let (epoch, revision) = (prepare.epoch, prepare.revision);
    if prepare.base.is_none() {
        *replica = Replica::from_snapshot(revision, prepare.operations);
    } else {
        prepare.operations.into_iter().for_each(|operation| replica.apply(operation));
    }
    let digest = replica.digest();
    Prepared { epoch, revision, digest, features: Vec::new(), scene_bytes: 0 }
}

fn drawn(frame: &Frame, index: u16, revision: Revision, digest: Digest) -> Status {
    Status::Drawn(Drawn {
        epoch: frame.epoch,
        frame: frame.frame,
        channel: ChannelId(index),
        revision,
        digest,
        draw_us: 0,
        triangles: 0,
        draw_calls: 0,
    })
}
