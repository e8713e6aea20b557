//! Servers that speak the protocol and draw nothing.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::command::{Command, Frame, Prepare};
use polyptych_protocol::handshake::{Adapter, Hello, Role, ServerHello};
use polyptych_protocol::handshake_io;
use polyptych_protocol::ids::{Digest, FrameId, Revision};
use polyptych_protocol::server_message::{
    FramePresented, FrameRendered, Ping, Prepared, ServerMessage,
};
use polyptych_protocol::state_log::Replica;
use polyptych_tls::NodeIdentity;
use polyptych_wall::ChannelId;
use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use tokio_util::sync::CancellationToken;

use super::secrets::Secrets;
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

/// The log of one server, in a list of its own: a list that all share would cost them more than the
/// messages do, and the raw barrier has none.
#[derive(Debug, Default)]
struct StubLog {
    sizes: Sizes,
    /// The time at which it received the swap of each frame.
    swaps: Vec<(FrameId, Instant)>,
}

/// The stub servers, each on a thread of its own, as each display has a process of its own.
#[derive(Debug)]
pub(super) struct Stubs {
    threads: Vec<JoinHandle<StubLog>>,
}

/// The logs of the stub servers, once they have ended.
#[derive(Debug)]
pub(super) struct StubTimings(Vec<StubLog>);

impl Stubs {
    /// Waits until the servers have ended, which whoever started them has asked for.
    ///
    /// # Errors
    /// One of them panicked.
    pub fn join(self) -> anyhow::Result<StubTimings> {
        let ends = self.threads.into_iter().map(JoinHandle::join);
        let seen = ends.collect::<Result<Vec<_>, _>>();
        Ok(StubTimings(seen.map_err(|_| anyhow::anyhow!("a stub server panicked"))?))
    }
}

impl StubTimings {
    /// The sizes of the messages of a frame.
    pub fn sizes(&self) -> Sizes {
        self.0.first().map(|seen| seen.sizes).unwrap_or_default()
    }

    /// The skew of each frame from `first` on that all servers have seen, in microseconds.
    pub fn skews_us(&self, first: FrameId) -> Vec<f64> {
        let mut swaps: BTreeMap<FrameId, Vec<Instant>> = BTreeMap::new();
        for (frame, instant) in self.0.iter().flat_map(|seen| &seen.swaps) {
            swaps.entry(*frame).or_default().push(*instant);
        }
        let whole = swaps.range(first..).filter(|(_, swaps)| swaps.len() == self.0.len());
        whole.filter_map(|(_, swaps)| width_us(swaps)).collect()
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
    secrets: &Arc<Secrets>,
    stop: &CancellationToken,
) -> std::io::Result<Stubs> {
    let start_one = |index: u16| {
        let (address, secrets, stop) = (address.to_owned(), Arc::clone(secrets), stop.clone());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let work = move || runtime.block_on(serve(address, index, &secrets, stop));
        std::thread::Builder::new().name(channel_name(index)).spawn(work)
    };
    let threads = (0..servers).map(start_one).collect::<std::io::Result<Vec<_>>>()?;
    Ok(Stubs { threads })
}

async fn serve(address: String, index: u16, secrets: &Secrets, stop: CancellationToken) -> StubLog {
    let mut seen = StubLog::default();
    let ended = tokio::select! {
        ended = converse(&address, index, secrets, &mut seen) => ended,
        () = stop.cancelled() => Ok(()),
    };
    if let Err(error) = ended {
        // The manager's end is theirs; one that ended too early is missed when all must be live.
        tracing::debug!(index, %error, "a stub server ended");
    }
    seen
}

async fn converse(
    address: &str,
    index: u16,
    secrets: &Secrets,
    seen: &mut StubLog,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let keys = secrets.keys(&NodeIdentity::Server(channel_name(index)))?;
    let stream = polyptych_tls::connect(address, keys.as_ref(), false).await?;
    let hello = Hello::Server(ServerHello {
        name: channel_name(index),
        channels: vec![channel_name(index)],
        pid: std::process::id(),
        adapter: Adapter { texture_side_max: CHANNEL_SIDE_MAX, ..Adapter::default() },
    });
    let (mut frames, _) =
        handshake_io::send_hello(stream, Role::Server, &hello, &secrets.token()).await?;
    // Frames come all the time, and so does the moment to look at the clock.
    let mut pinged = Instant::now();
    let mut replica = Replica::default();
    let mut digest = Digest::default();
    loop {
        let Some(bytes) = frames.next().await else { return Ok(()) };
        let bytes = bytes?;
        let received = Instant::now();
        if received - pinged > PING_PERIOD {
            pinged = received;
            let ping = ServerMessage::Ping(Ping { sent_us: 0, memory_bytes: 0 });
            frames.send(polyptych_codec::encode(&ping)).await?;
        }
        let answer = match polyptych_protocol::framing::decode::<Command>(&bytes)? {
            Command::Prepare(prepare) => {
                let prepared = prepare_replica(prepare, &mut replica);
                digest = prepared.digest;
                polyptych_codec::encode(&ServerMessage::Prepared(prepared))
            }
            Command::Frame(frame) => {
                let answer =
                    polyptych_codec::encode(&drawn(&frame, index, replica.revision, digest));
                seen.sizes.frame = bytes.len();
                seen.sizes.drawn = answer.len();
                answer
            }
            Command::Swap(swap) => {
                let shown = ServerMessage::Shown(FramePresented {
                    epoch: swap.epoch,
                    frame: swap.frame,
                    channel: ChannelId(index),
                    at_us: 0,
                    clock_error_us: 0,
                    is_unscheduled: false,
                });
                let answer = polyptych_codec::encode(&shown);
                seen.swaps.push((swap.frame, received));
                seen.sizes.swap = bytes.len();
                seen.sizes.shown = answer.len();
                answer
            }
            Command::Pong(_) => continue,
            Command::Goodbye(_) => return Ok(()),
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
    Prepared { epoch, revision, digest, features: Vec::new(), scene_bytes: 0, detail_reach: None }
}

fn drawn(frame: &Frame, index: u16, revision: Revision, digest: Digest) -> ServerMessage {
    ServerMessage::Drawn(FrameRendered {
        epoch: frame.epoch,
        frame: frame.frame,
        channel: ChannelId(index),
        revision,
        digest,
        draw_us: 0,
        triangles: 0,
        draw_calls: 0,
        error_fraction: 0.0,
        draws_occluded: 0,
        is_trial: false,
        passes: polyptych_scene::PassTimes::default(),
    })
}
