//! The manager behind the decoder: what a message that can be decoded meets next.

use std::collections::VecDeque;
use std::num::NonZeroU32;
use std::sync::Arc;

use polyptych_core::{ClientRequest, Cluster, Effect, ImportedScene, Input, SessionId};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_manager::capture::{CaptureBudget, CaptureJob, GeometryCache};
use polyptych_protocol::bulk::BulkToManager;
use polyptych_protocol::command::{Command, Frame};
use polyptych_protocol::handshake::{Hello, Introduction, ServerHello};
use polyptych_protocol::ids::{Digest, FrameId, RequestId, Revision};
use polyptych_protocol::request::{Request, SceneSummary};
use polyptych_protocol::server_message::{FrameRendered, Prepared, ServerMessage};
use polyptych_protocol::state_log::{Operation, Replica, SceneRef};
use polyptych_scene::{PassTimes, Scene, SceneFeatures, Texture};
use polyptych_wall::{ChannelId, Wall};

use crate::message::Message;
use crate::seeds::messages;

/// Most outputs of the core that may wait at once: one call asks for no more than a few things
/// of every peer.
const OUTPUTS_MAX: usize = 4096;

/// The client that asks for frames, so that there is one on its way.
const CLIENT: SessionId = SessionId(1000);

/// A manager's core, fed with what it could be sent.
#[derive(Debug)]
pub struct Receiver {
    wall: Wall,
    cluster: Cluster,
    now: u64,
    next_session: u64,
    servers: VecDeque<SessionId>,
    frames: u64,
    /// The digest of the state that was prepared last.
    digest: Digest,
    /// The imports that wait; `None`: they are done at once.
    imports: Option<Vec<ClientRequest>>,
    /// The messages that servers send for each frame, instead of having drawn it well.
    says: Vec<ServerMessage>,
    /// The commands that servers were sent and have not answered yet.
    sent: VecDeque<(SessionId, Command)>,
}

impl Receiver {
    /// A wall with all of its channels driven.
    pub fn new() -> Self {
        let wall = messages::wall();
        let mut receiver = Self {
            cluster: Cluster::new(wall.clone(), messages::EPOCH),
            wall,
            now: 1_000_000,
            next_session: 1,
            servers: VecDeque::new(),
            frames: 0,
            digest: Digest(0),
            imports: None,
            says: Vec::new(),
            sent: VecDeque::new(),
        };
        receiver.tell(Input::Client { session: CLIENT, name: "seed".into() });
        receiver.join_all();
        receiver.answer_all();
        receiver
    }

    /// Servers for the channels that have none.
    fn join_all(&mut self) {
        for hello in messages::hellos() {
            if let Hello::Server(hello) = hello {
                self.next_session += 1;
                let session = SessionId(self.next_session);
                let joined = self.join(session, hello, "a:1");
                if joined.is_ok() {
                    self.servers.push_back(session);
                }
            }
        }
        self.read();
    }

    /// Hands a message to who it is for; `chance` picks the peer that it comes from.
    pub fn take(&mut self, message: Message, chance: u64) {
        self.now += chance % 5000;
        self.answer_all();
        match message {
            Message::Status(status) => {
                let pick = chance as usize % self.servers.len().max(1);
                let from = self.servers.get(pick).copied().unwrap_or(SessionId(0));
                self.tell(Input::Status { from, status });
            }
            Message::Call(call) => {
                self.tell(Input::Request { client: CLIENT, id: call.id, request: call.request });
            }
            Message::Introduction(Introduction { hello: Hello::Server(hello), .. }) => {
                self.next_session += 1;
                let session = SessionId(self.next_session);
                if self.join(session, hello, "a:2").is_ok() {
                    self.servers.push_back(session);
                }
            }
            Message::Manifest(scene) => read_manifest(&scene),
            Message::BulkUp(BulkToManager::Picture(chunk)) => {
                let job = ClientRequest { client: CLIENT, id: RequestId(1) };
                let ids: Vec<_> = self.wall.channel_ids().collect();
                let side = NonZeroU32::MIN;
                let room = CaptureBudget::default().reserve(&self.wall, side);
                let room = room.expect("a small wall");
                // A wall without files asks for none of its blobs.
                let shapes = GeometryCache::new(BlobStore::new("nowhere"));
                let wall = (&self.wall, &shapes);
                let frame = (FrameId(1), side);
                let mut collection = CaptureJob::new(job, frame, &ids, Vec::new(), wall, room);
                let _ = collection.add(&chunk);
            }
            _ => {}
        }
        if self.cluster.poll_timeout().is_some_and(|due| due <= self.now) {
            self.tell(Input::Timeout);
        }
        self.read();
        if chance.is_multiple_of(64) {
            self.join_all();
            self.order_frame();
        }
    }

    /// Keeps the core busy: a frame is asked for, and drawn by those that are sent it.
    fn order_frame(&mut self) {
        self.frames += 1;
        let request = Request::RenderFrame { camera: None, time_s: None };
        self.tell(Input::Request { client: CLIENT, id: RequestId(self.frames), request });
        self.read();
    }

    fn tell(&mut self, input: Input) {
        // Only a server that joins is refused.
        let _ = self.cluster.handle(self.now, input);
    }

    fn join(
        &mut self,
        session: SessionId,
        hello: ServerHello,
        address: &str,
    ) -> Result<(), String> {
        let input = Input::Server { session, hello, address: address.into() };
        self.cluster.handle(self.now, input)
    }

    /// Takes what the core wants done, and plays the peers that do it.
    fn read(&mut self) {
        let mut read = 0;
        while let Some(output) = self.cluster.poll_effect() {
            read += 1;
            assert!(read < OUTPUTS_MAX, "the core does not come to an end: {output:?}");
            match output {
                Effect::Command { to, command } => {
                    let to = to.into_iter();
                    self.sent.extend(to.map(|server| (server, Command::clone(&command))));
                }
                Effect::Close { session, .. } => self.servers.retain(|server| *server != session),
                Effect::Import { job, .. } => match &mut self.imports {
                    Some(imports) => imports.push(job),
                    None => self.tell(Input::Import { job, imported: Ok(imported()) }),
                },
                _ => {}
            }
        }
    }

    /// Servers answer what they were sent; a wall that runs freely sends them more at once.
    fn answer_all(&mut self) {
        for (server, command) in std::mem::take(&mut self.sent) {
            self.answer(server, &command);
        }
        self.read();
    }

    /// Answers a command as a server in good health does.
    fn answer(&mut self, server: SessionId, command: &Command) {
        match command {
            Command::Prepare(prepare) => {
                let mut replica = if prepare.base.is_some() {
                    let wall = Operation::SetWall(Box::new(self.wall.clone()));
                    let before = prepare.revision.0 - prepare.operations.len() as u64;
                    Replica::from_snapshot(Revision(before), vec![wall])
                } else {
                    Replica::from_snapshot(prepare.revision, prepare.operations.clone())
                };
                if prepare.base.is_some() {
                    prepare.operations.iter().for_each(|o| replica.apply(o.clone()));
                }
                self.digest = replica.digest();
                let prepared = Prepared {
                    epoch: prepare.epoch,
                    revision: prepare.revision,
                    digest: self.digest,
                    features: Vec::new(),
                    scene_bytes: 0,
                    detail_reach: None,
                };
                self.tell(Input::Status {
                    from: server,
                    status: ServerMessage::Prepared(prepared),
                });
            }
            Command::Frame(frame) => {
                for channel in self.cluster.channels_of(server) {
                    let mut status = drawn(frame, channel, self.digest);
                    for said in &self.says {
                        if let ServerMessage::Drawn(said) = said
                            && said.channel == channel
                        {
                            let FrameRendered { draw_us, triangles, draw_calls, .. } = *said;
                            status = FrameRendered { draw_us, triangles, draw_calls, ..status };
                        }
                    }
                    self.tell(Input::Status { from: server, status: ServerMessage::Drawn(status) });
                }
            }
            _ => {}
        }
    }

    /// From now on imports wait.
    pub fn hold_imports(&mut self) {
        self.imports = Some(Vec::new());
    }

    /// Returns the number of imports that wait.
    pub fn imports_held(&self) -> usize {
        self.imports.as_ref().map_or(0, Vec::len)
    }

    /// The first of them is done.
    pub fn finish_import(&mut self) {
        let imports = self.imports.as_mut().filter(|imports| !imports.is_empty());
        if let Some(job) = imports.map(|imports| imports.remove(0)) {
            self.tell(Input::Import { job, imported: Ok(imported()) });
        }
        self.read();
    }

    /// Says this of the frame that comes next, in place of what a server in good health says.
    pub fn take_for_each_frame(&mut self, status: ServerMessage) {
        self.says.push(status);
        for _ in 0..4 {
            self.order_frame();
            self.answer_all();
        }
    }
}

fn drawn(frame: &Frame, channel: ChannelId, digest: Digest) -> FrameRendered {
    FrameRendered {
        epoch: frame.epoch,
        frame: frame.frame,
        channel,
        revision: frame.revision,
        digest,
        draw_us: 20_000,
        triangles: 1000,
        draw_calls: 6,
        error_fraction: 0.0,
        draws_occluded: 40,
        is_trial: false,
        passes: PassTimes::default(),
    }
}

fn imported() -> ImportedScene {
    let scene = SceneRef { name: "town".into(), manifest: BlobHash([5; 32]) };
    let summary = SceneSummary {
        name: "town".into(),
        revision: Revision(0),
        bounds: None,
        triangles: 0,
        features: SceneFeatures::default(),
        notes: Vec::new(),
        exposure: 1.0,
        clips: Vec::new(),
    };
    ImportedScene::of_file(scene, summary, Arc::default())
}

/// Reads a manifest as the manager does.
fn read_manifest(scene: &Scene) {
    if scene.fault().is_some() {
        return;
    }
    let _ = (scene.triangles(), SceneFeatures::from_scene(scene).names(), scene.world_from_nodes());
    let textures = scene.textures.iter().map(Texture::bytes);
    let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let meshes = primitives.map(polyptych_scene::Primitive::bytes);
    let _ = meshes.chain(textures).fold(0, u64::saturating_add);
}
