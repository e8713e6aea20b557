//! A render server that speaks the protocol, draws nothing, and lies where a test wants it to.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::command::{Command, Frame, Prepare};
use polyptych_protocol::handshake::{Adapter, Hello, Role, Secret, ServerHello};
use polyptych_protocol::handshake_io::send_hello;
use polyptych_protocol::ids::{Digest, FrameId, Revision};
use polyptych_protocol::server_message::{FrameRendered, Ping, Prepared, ServerMessage};
use polyptych_protocol::state_log::Replica;
use polyptych_protocol::token;
use polyptych_wall::ChannelId;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tokio::sync::Notify;

use super::local_wall::LocalWall;

/// Often enough for the shortest heartbeat of a test.
const PING_PERIOD: Duration = Duration::from_millis(200);

/// The name of its adapter: it would clear a terminal, forge a line of a log, and reverse the text
/// behind it.
pub const HOSTILE_NAME: &str = "stub\u{1b}[2J\r\n ERROR forged\u{9b}31m\u{202e}";

type Answer = Box<dyn FnOnce(&Frame) -> ServerMessage + Send>;

/// A server for the first channel of a wall, on a thread. Where its connection ends, it stays away
/// until it is told to rejoin.
pub struct StubServer {
    shared: Arc<Shared>,
}

struct Shared {
    secret: Secret,
    channel: ChannelId,
    state: Mutex<State>,
    /// There is something to send, or it is over.
    wake: Notify,
}

#[derive(Default)]
struct State {
    replica: Replica,
    /// The digest of each state that it has prepared.
    digests: BTreeMap<Revision, Digest>,
    heard: Vec<Command>,
    raw: Vec<u8>,
    answer: Option<(Answer, SyncSender<FrameId>)>,
    /// `true` if its answers to changes wait in `raw`.
    holds_prepared: bool,
    is_over: bool,
}

impl StubServer {
    /// Starts a server that drives this channel.
    pub fn start(local: &LocalWall, channel: &str) -> Self {
        let hello = Hello::Server(ServerHello {
            name: "stub".into(),
            channels: vec![channel.into()],
            pid: std::process::id(),
            adapter: Adapter {
                name: HOSTILE_NAME.into(),
                driver: HOSTILE_NAME.into(),
                texture_side_max: 8192,
                ..Adapter::default()
            },
        });
        let secret = Secret(token::read(&local.place.token_file()).expect("a token"));
        let (of, _) = local.wall().channel_by_name(channel).expect("a channel of the wall");
        let shared = Shared { secret, channel: of, state: Mutex::default(), wake: Notify::new() };
        let shared = Arc::new(shared);
        let (address, kept) = (local.address.clone(), Arc::clone(&shared));
        let serve = move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(async {
                while !kept.state().is_over {
                    // The manager may have had enough of it.
                    let _ = converse(&address, &hello, &kept).await;
                    kept.wake.notified().await;
                }
            });
        };
        Builder::new().name("stub".into()).spawn(serve).expect("a thread");
        Self { shared }
    }

    /// Returns the function that answers a frame as an honest server does.
    pub fn drawn_honestly(&self) -> impl Fn(&Frame) -> FrameRendered + Clone + Send + use<> {
        let shared = Arc::clone(&self.shared);
        move |frame| shared.drawn(frame)
    }

    /// Answers the next frame so, once; gives the frame.
    pub fn answer_once(
        &self,
        answer: impl FnOnce(&Frame) -> ServerMessage + Send + 'static,
    ) -> Receiver<FrameId> {
        let (sender, receiver) = sync_channel(1);
        self.shared.state().answer = Some((Box::new(answer), sender));
        receiver
    }

    /// Sends bytes that need not be a message.
    pub fn send_raw(&self, bytes: Vec<u8>) {
        self.shared.state().raw = bytes;
        self.shared.wake.notify_one();
    }

    /// All that it was told, oldest first.
    pub fn heard(&self) -> Vec<Command> {
        self.shared.state().heard.clone()
    }

    /// The reasons that it was given for the end of a connection.
    pub fn goodbyes(&self) -> Vec<String> {
        let reason = |command| match command {
            Command::Goodbye(goodbye) => Some(goodbye.to_string()),
            _ => None,
        };
        self.heard().into_iter().filter_map(reason).collect()
    }

    /// From now on it does not say that it is prepared.
    pub fn hold_prepared(&self) {
        self.shared.state().holds_prepared = true;
    }

    /// It says what it held.
    pub fn release_prepared(&self) {
        self.shared.state().holds_prepared = false;
        self.shared.wake.notify_one();
    }

    /// Connects again, and forgets what it was told before.
    pub fn rejoin(&self) {
        self.shared.state().heard.clear();
        self.shared.wake.notify_one();
    }
}

impl Drop for StubServer {
    fn drop(&mut self) {
        self.shared.state().is_over = true;
        self.shared.wake.notify_one();
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the answer of an honest server to a frame.
    fn drawn(&self, frame: &Frame) -> FrameRendered {
        let digest = self.state().digests.get(&frame.revision).copied();
        FrameRendered {
            epoch: frame.epoch,
            frame: frame.frame,
            channel: self.channel,
            revision: frame.revision,
            digest: digest.unwrap_or_default(),
            draw_us: 0,
            triangles: 0,
            draw_calls: 0,
            error_fraction: 0.0,
            draws_occluded: 0,
            is_trial: false,
            passes: polyptych_scene::PassTimes::default(),
        }
    }
}

type Ended = Result<(), Box<dyn std::error::Error>>;

async fn converse(address: &str, hello: &Hello, shared: &Shared) -> Ended {
    let stream = TcpStream::connect(address).await?;
    stream.set_nodelay(true)?;
    let (mut frames, _) = send_hello(stream, Role::Server, hello, &shared.secret).await?;
    let mut ping = tokio::time::interval(PING_PERIOD);
    loop {
        tokio::select! {
            message = frames.next() => {
                let bytes = message.ok_or("it closed the connection")??;
                let command = polyptych_protocol::framing::decode::<Command>(&bytes)?;
                shared.state().heard.push(command.clone());
                if let Some(answer) = answer(command, shared) {
                    frames.send(polyptych_codec::encode(&answer)).await?;
                }
            }
            _ = ping.tick() => {
                let ping = ServerMessage::Ping(Ping { sent_us: 0, memory_bytes: 0 });
                frames.send(polyptych_codec::encode(&ping)).await?;
            }
            () = shared.wake.notified() => {
                let raw = std::mem::take(&mut shared.state().raw);
                frames.get_mut().write_all(&raw).await?;
            }
        }
        if shared.state().is_over {
            return Ok(());
        }
    }
}

fn answer(command: Command, shared: &Shared) -> Option<ServerMessage> {
    match command {
        Command::Prepare(prepare) => {
            let mut state = shared.state();
            let prepared = prepare_replica(prepare, &mut state.replica);
            let (revision, digest) = (state.replica.revision, state.replica.digest());
            state.digests.insert(revision, digest);
            if !state.holds_prepared {
                return Some(prepared);
            }
            state.raw = polyptych_codec::framed(&polyptych_codec::encode(&prepared)).to_vec();
            None
        }
        Command::Frame(frame) => {
            let asked = shared.state().answer.take();
            let Some((answer, sender)) = asked else {
                return Some(ServerMessage::Drawn(shared.drawn(&frame)));
            };
            let answer = answer(&frame);
            // A test that has ended asks no more.
            let _ = sender.send(frame.frame);
            Some(answer)
        }
        Command::Swap(_) | Command::Pong(_) | Command::Goodbye(_) => None,
    }
}

fn prepare_replica(prepare: Prepare, replica: &mut Replica) -> ServerMessage {
    let (epoch, revision) = (prepare.epoch, prepare.revision);
    if prepare.base.is_none() {
        *replica = Replica::from_snapshot(revision, prepare.operations);
    } else {
        prepare.operations.into_iter().for_each(|operation| replica.apply(operation));
    }
    let digest = replica.digest();
    ServerMessage::Prepared(Prepared {
        epoch,
        revision,
        digest,
        features: Vec::new(),
        scene_bytes: 0,
        detail_reach: None,
    })
}
