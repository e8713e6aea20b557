//! The manager around the core, as `run.rs` has it: sessions, imports, what outlives it, its end.

use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

use glam::DVec3;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::{Epoch, FrameId, RequestId, Revision};
use polyptych_protocol::request::{Request, SceneSummary};
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{Bounds, Node, Scene, SceneFeatures, SceneOutline};

use super::super::{
    ClientRequest, Cluster, Effect, ImportedScene, Micros, PersistentState, SessionId,
};
use super::network::{LinkId, Packet, Side};
use super::world::{Check, PendingRequest, SimEvent, Simulation};

/// `OUTBOX_MESSAGES_MAX` of the manager.
const OUTBOX_MESSAGES_MAX: usize = 512;

/// Timeouts that may follow each other at one instant: a full queue of orders on a wall without
/// channels takes one each.
const TIMEOUTS_AT_ONCE_MAX: usize = 3 * 64 + 16;

/// The manager's process.
#[derive(Debug, Default)]
pub struct Manager {
    pub cluster: Option<Cluster>,
    /// Counts its lives.
    pub life: u32,
    pub started: Micros,
    pub stopped_until: Micros,
    /// The state on disk.
    pub memory: Option<PersistentState>,
    next_session: u64,
    alarm: Option<Micros>,
    pub links: BTreeMap<SessionId, LinkId>,
    imports: Vec<(u32, ClientRequest, bool)>,
    /// After so many outputs more it is killed.
    pub dies_after: Option<u32>,
    pub before: Vec<ChannelState>,
    /// The frames on their way, oldest first.
    pub frames_before: Vec<FrameId>,
}

/// Returns the outline of every simulated scene: four nodes, each below the one before.
fn outline() -> Arc<SceneOutline> {
    let node = |parent| Node { parent, ..Node::default() };
    let nodes = [None, Some(0), Some(1), Some(2)].map(node).into();
    Arc::new(SceneOutline::from(&Scene { nodes, ..Scene::default() }))
}

impl Simulation {
    /// The core, with what it was before this.
    fn core<R>(&mut self, what: impl FnOnce(&mut Cluster, Micros) -> R) -> Option<R> {
        let now = self.now - self.manager.started;
        let cluster = self.manager.cluster.as_mut()?;
        self.manager.before.clear();
        self.manager.before.extend(cluster.registry.channels().map(|(_, c)| c.state));
        self.manager.frames_before = cluster.pipeline.iter().map(|b| b.frame).collect();
        Some(what(cluster, now))
    }

    pub fn start_manager(&mut self) -> Check {
        if self.manager.cluster.is_some() {
            return Ok(());
        }
        self.manager.life += 1;
        self.manager.started = self.now - self.dice.below(1_000);
        self.manager.alarm = None;
        self.manager.dies_after = None;
        let epoch = Epoch(self.dice.next());
        let wall = self.wall.clone();
        let mut cluster = match &self.manager.memory {
            None => Cluster::new(wall, epoch),
            Some(memory) => Cluster::restore(wall, epoch, memory),
        };
        cluster.set_outline(Some(outline()));
        cluster.set_navigable(true);
        self.tell(|| format!("manager starts, memory {:?}", self.manager.memory.is_some()));
        let started = self.manager.started;
        self.watch.manager_starts(&cluster, started, self.manager.memory.as_ref())?;
        self.manager.cluster = Some(cluster);
        self.coverage.count("manager started");
        for index in 0..self.clients.len() {
            if self.dice.is_hit(700) {
                self.connect_client(index);
            }
        }
        self.core(|_, _| ());
        self.carry_out()
    }

    /// The process is gone, and its system closes the connections.
    pub fn kill_manager(&mut self, why: &str) {
        if self.manager.cluster.take().is_none() {
            return;
        }
        self.tell(|| format!("manager ends: {why}"));
        for link in std::mem::take(&mut self.manager.links).into_values() {
            self.links[link.0].is_open_at_manager = false;
            self.send(link, Side::Server, Packet::End);
        }
        // Those that are still in the handshake hear of it too.
        for at in 0..self.links.len() {
            if self.links[at].is_open_at_manager && self.links[at].life == self.manager.life {
                self.links[at].is_open_at_manager = false;
                self.send(LinkId(at), Side::Server, Packet::End);
            }
        }
        self.clients.iter_mut().for_each(|client| client.session = None);
        self.manager.stopped_until = 0;
        self.watch.manager_ends();
        let wait = self.dice.between(1_000, 3_000_000);
        self.at(self.now + wait, SimEvent::ManagerStarts);
    }

    fn new_session(&mut self) -> SessionId {
        self.manager.next_session += 1;
        SessionId(self.manager.next_session)
    }

    pub fn arrive_at_manager(&mut self, link: LinkId, parcel: Packet) -> Check {
        if self.manager.cluster.is_none() || self.links[link.0].life != self.manager.life {
            return Ok(());
        }
        match (parcel, self.links[link.0].session) {
            (Packet::Hello, _) => self.welcome(link),
            (Packet::Status(status), Some(session)) => self.hear(session, *status),
            (Packet::End, Some(session)) => self.forget(session, "it closed the connection"),
            (Packet::End, None) => Ok(()),
            (parcel, session) => Err(format!("{parcel:?} of {session:?} came to the manager")),
        }
    }

    fn welcome(&mut self, link: LinkId) -> Check {
        let index = self.links[link.0].server;
        let server = &self.servers[index];
        let hello = ServerHello {
            name: format!("s{index}"),
            channels: server.names.clone(),
            pid: server.pid,
            adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
        };
        let address = format!("10.0.0.{index}:{}", 40_000 + link.0);
        let session = self.new_session();
        self.manager.links.insert(session, link);
        self.links[link.0].session = Some(session);
        let joined = self.core(|cluster, now| cluster.handle_server(now, session, hello, address));
        match joined {
            Some(Ok(())) => {
                self.tell(|| format!("server {index} joins as {session:?}"));
                self.watch.server_joins(session, &self.servers[index].channels);
                self.send(link, Side::Server, Packet::Welcome);
            }
            refused => {
                self.tell(|| format!("server {index} is refused: {refused:?}"));
                self.manager.links.remove(&session);
                self.links[link.0].session = None;
                self.send(link, Side::Server, Packet::Refused);
            }
        }
        self.carry_out()
    }

    fn hear(&mut self, session: SessionId, status: ServerMessage) -> Check {
        if !self.manager.links.contains_key(&session) {
            return Ok(());
        }
        if let Some(cluster) = &self.manager.cluster {
            self.watch.hears(cluster, session, &status, &mut self.coverage);
        }
        if !matches!(status, ServerMessage::Ping(_) | ServerMessage::Shown(_)) {
            self.tell(|| format!("  {session:?} says {}", brief(&status)));
        }
        let moves = |cluster: &Cluster| cluster.navigator.count;
        let before = self.manager.cluster.as_ref().map(moves);
        self.core(|cluster, now| cluster.handle_status(now, session, status));
        if self.manager.cluster.as_ref().map(moves) > before {
            self.coverage.count("camera moved by a mouse");
            self.watch.camera_moves();
        }
        self.carry_out()
    }

    /// A connection has ended, on one side or the other.
    fn forget(&mut self, session: SessionId, why: &str) -> Check {
        self.let_go(session);
        self.core(|cluster, now| cluster.handle_server_gone(now, session, why));
        self.carry_out()
    }

    fn let_go(&mut self, session: SessionId) {
        if let Some(link) = self.manager.links.remove(&session) {
            self.tell(|| format!("manager lets {session:?} go"));
            self.links[link.0].is_open_at_manager = false;
            self.send(link, Side::Server, Packet::End);
        }
    }

    pub fn time_out(&mut self, life: u32) -> Check {
        if self.manager.life != life || self.manager.cluster.is_none() {
            return Ok(());
        }
        self.manager.alarm = None;
        for _ in 0..TIMEOUTS_AT_ONCE_MAX {
            let now = self.now - self.manager.started;
            let due = self.manager.cluster.as_ref().and_then(Cluster::poll_timeout);
            if due.is_none_or(|due| due > now) {
                self.set_alarm();
                return Ok(());
            }
            self.core(Cluster::handle_timeout);
            self.carry_out()?;
        }
        Err("the core spins: time does not go on".into())
    }

    fn set_alarm(&mut self) {
        let Some(cluster) = &self.manager.cluster else { return };
        let Some(due) = cluster.poll_timeout() else { return };
        let due = (self.manager.started + due).max(self.now);
        if self.manager.alarm.is_none_or(|alarm| due < alarm) {
            self.manager.alarm = Some(due);
            let life = self.manager.life;
            self.at(due, SimEvent::Timeout(life));
        }
    }

    pub fn connect_client(&mut self, index: usize) {
        if self.manager.cluster.is_none() || self.clients[index].session.is_some() {
            return;
        }
        let session = self.new_session();
        self.clients[index].session = Some(session);
        self.watch.client_joins(session);
        self.core(|cluster, _| cluster.handle_client(session, format!("client {index}")));
    }

    pub fn disconnect_client(&mut self, index: usize) -> Check {
        let Some(session) = self.clients[index].session.take() else { return Ok(()) };
        self.watch.client_leaves(session);
        self.core(|cluster, now| cluster.handle_client_gone(now, session));
        self.carry_out()
    }

    /// A client asks; the manager hears it a little later.
    pub fn ask(&mut self, index: usize, request: Request) {
        let Some(client) = self.clients[index].session else { return };
        self.clients[index].next_id += 1;
        let id = RequestId(self.clients[index].next_id);
        self.asked.push(PendingRequest { client, id, request });
        self.at(self.now + 50, SimEvent::Asked(self.asked.len() - 1));
    }

    pub fn arrive_asked(&mut self, index: usize) -> Check {
        let PendingRequest { client, id, request } = self.asked[index].clone();
        if !self.clients.iter().any(|c| c.session == Some(client)) {
            return Ok(());
        }
        self.tell(|| format!("  {client:?} asks {id}: {request:?}"));
        self.watch.asked(client, id, request.clone());
        self.core(|cluster, now| cluster.handle_request(now, client, id, request));
        self.carry_out()
    }

    pub fn arrive_import(&mut self, index: usize) -> Check {
        let (life, job, is_good) = self.manager.imports[index];
        if life != self.manager.life || self.manager.cluster.is_none() {
            return Ok(());
        }
        let name = format!("scene {}", self.dice.below(4));
        let manifest = BlobHash::of(name.as_bytes());
        let summary = SceneSummary {
            name: name.clone(),
            revision: Revision(0),
            bounds: Some(Bounds { min: -DVec3::ONE, max: DVec3::ONE }),
            triangles: 3,
            features: SceneFeatures::default(),
            notes: Vec::new(),
            exposure: 1.0,
            clips: Vec::new(),
        };
        let scene = ImportedScene::of_file(SceneRef { name, manifest }, summary, outline());
        let imported = if is_good { Ok(scene) } else { Err("not glTF".to_owned()) };
        self.coverage.count(if is_good { "import done" } else { "import failed" });
        self.core(|cluster, now| cluster.handle_import(now, job, imported));
        self.carry_out()
    }

    /// Does what the core wants done, then looks at what became of it.
    fn carry_out(&mut self) -> Check {
        let mut count = 0;
        while let Some(output) = self.manager.cluster.as_mut().and_then(Cluster::poll_effect) {
            count += 1;
            if let Some(left) = &mut self.manager.dies_after {
                if *left == 0 {
                    self.coverage.count("manager killed between two outputs");
                    self.watch.is_cut_short = true;
                    self.kill_manager("killed between two outputs");
                    return Ok(());
                }
                *left -= 1;
            }
            self.perform(output)?;
        }
        let now = self.now;
        let Some(cluster) = &self.manager.cluster else { return Ok(()) };
        self.watch.settled(now, &self.manager, cluster, count, &mut self.coverage)?;
        self.set_alarm();
        Ok(())
    }

    fn perform(&mut self, output: Effect) -> Check {
        match output {
            Effect::Command { to, command } => {
                if let Some(cluster) = &self.manager.cluster {
                    let (now, before) = (self.now, &self.manager.before);
                    self.watch.commanded(now, cluster, before, &to, &command)?;
                }
                if !matches!(*command, Command::Pong(_)) {
                    self.tell(|| format!("    to {to:?}: {}", brief(&command)));
                }
                let command = Rc::new(*command);
                for session in to {
                    let Some(&link) = self.manager.links.get(&session) else { continue };
                    let is_full = self.links[link.0].lane(Side::Server).waiting.len();
                    self.send(link, Side::Server, Packet::Command(Rc::clone(&command)));
                    if is_full >= OUTBOX_MESSAGES_MAX {
                        self.coverage.count("server let go: it reads too slowly");
                        self.let_go(session);
                        let now = self.now - self.manager.started;
                        if let Some(cluster) = &mut self.manager.cluster {
                            cluster.handle_server_gone(now, session, "it reads too slowly");
                        }
                    }
                }
            }
            Effect::Answer { to, answer } => {
                self.tell(|| format!("    to {to:?}: {}", brief(&answer)));
                self.watch.answered(to, &answer, self.manager.memory.as_ref())?;
            }
            // Sessions are not asked for here.
            Effect::OpenSession { .. } => {}
            Effect::Import { job, .. } => {
                let is_good = self.dice.is_hit(800);
                self.manager.imports.push((self.manager.life, job, is_good));
                let bake_us = self.dice.between(0, 150_000);
                let import = SimEvent::Imported(self.manager.imports.len() - 1);
                self.at(self.now + bake_us, import);
            }
            Effect::Collect { job, frame, channels, missing, .. } => {
                self.watch.collects(job, frame, channels.len() + missing.len())?;
            }
            Effect::Close { session, reason } => {
                self.coverage.count("session closed by the core");
                if let Some(&link) = self.manager.links.get(&session) {
                    let goodbye = Rc::new(Command::Goodbye(Goodbye::closed(reason)));
                    self.send(link, Side::Server, Packet::Command(goodbye));
                }
                self.let_go(session);
                let now = self.now - self.manager.started;
                if let Some(cluster) = &mut self.manager.cluster {
                    cluster.handle_server_gone(now, session, "closed");
                }
            }
            Effect::Remember(memory) => {
                self.watch.remembered(&memory)?;
                self.manager.memory = Some(*memory);
            }
            Effect::Stop | Effect::StopServers { .. } => {
                self.coverage.count("manager stopped by a client");
                self.kill_manager("a client stopped it");
            }
        }
        Ok(())
    }
}

/// The beginning of a message, for a person.
fn brief(what: &impl std::fmt::Debug) -> String {
    let text = format!("{what:?}");
    text.chars().take(160).collect()
}
