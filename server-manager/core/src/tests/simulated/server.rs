//! A simulated render server: the network and the loader thread, as `network.rs` and `loader.rs`
//! of the render server have them.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec2;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::{Command, Prepare};
use polyptych_protocol::ids::{Digest, Epoch, FrameId, Revision};
use polyptych_protocol::limits::PINGS_PER_HEARTBEAT;
use polyptych_protocol::navigation::Navigation;
use polyptych_protocol::server_message::{Ping, Prepared, ServerMessage};
use polyptych_protocol::state_log::Replica;
use polyptych_wall::ChannelId;

use super::super::Micros;
use super::clock::ClockEstimate;
use super::network::{Link, LinkId, Packet, Side};
use super::playback::{DrawnFrames, FrameKey, FrameScheduler};
use super::render::{Drawing, Job};
use super::world::{Check, SimEvent, Simulation};

/// `ORDERS_MAX`, `REPORTS_MAX`, `JOBS_MAX` of the render server.
const ORDERS_MAX: usize = 16;
const REPORTS_MAX: usize = 512;
pub const JOBS_MAX: usize = 512;

/// `RETRY_FIRST` and `RETRY_LONGEST` of the render server, in microseconds.
const RETRY_FIRST: Micros = 50_000;
pub const RETRY_LONGEST: Micros = 2_000_000;

/// A state that can be drawn.
#[derive(Clone, Debug)]
pub struct State {
    pub epoch: Epoch,
    pub replica: Replica,
    pub digest: Digest,
}

impl State {
    pub fn revision(&self) -> Revision {
        self.replica.revision
    }
}

/// The content of a channel's own target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnImage {
    pub epoch: Epoch,
    pub frame: FrameId,
    pub revision: Revision,
    pub digest: Digest,
}

/// The faults of a server, with the times at which they end.
#[derive(Clone, Debug, Default)]
pub struct InjectedFaults {
    /// The whole process stands still.
    pub stopped_until: Micros,
    /// The render thread stands still.
    pub hangs_until: Micros,
    /// Drawing takes so many times as long.
    pub slow_until: Micros,
    pub slow_by: u64,
    pub draws_fail_until: Micros,
    pub loads_fail_until: Micros,
    /// Loading takes so much longer.
    pub loads_slow_until: Micros,
    pub loads_slow_by: Micros,
    /// The next state that it makes is wrong.
    pub corrupts_next: bool,
}

/// A process, and what stays of it from one life to the next.
#[derive(Debug)]
pub struct Server {
    pub channels: Vec<ChannelId>,
    pub names: Vec<String>,
    pub pid: u32,
    /// Counts its lives and its deaths; what was set down for another one is not done.
    pub life: u32,
    pub is_alive: bool,
    pub is_gone_for_good: bool,
    pub trouble: InjectedFaults,
    clock_start: i64,
    /// Its quartz, in millionths.
    clock_drift: i64,
    // The network thread.
    pub link: Option<LinkId>,
    is_welcomed: bool,
    is_conversing: bool,
    wait: Micros,
    last_heard: Micros,
    /// Things that arrive before the bulk connection stands wait until then.
    pub reads_from: Micros,
    estimate: ClockEstimate,
    pub offset: Option<(i64, u32)>,
    reports: VecDeque<ServerMessage>,
    // The loader.
    orders: VecDeque<(Prepare, LinkId)>,
    is_loading: bool,
    loading: Option<Result<State, String>>,
    ready: Option<(Epoch, Replica)>,
    ready_scene: Option<BlobHash>,
    /// The time at which it began to draw its last frame.
    pub frame_began: Micros,
    /// The frames that it drew last, and how much later than it should it may show each: as long as
    /// its drawing took, within `SLOW_GRACE_MAX`.
    pub graces_us: VecDeque<(FrameKey, Micros)>,
    pub load_us: Micros,
    // The render thread.
    pub finish: Option<State>,
    pub jobs: VecDeque<Job>,
    pub playback: FrameScheduler,
    pub states: VecDeque<State>,
    pub drawing: Option<Drawing>,
    pub is_waking: bool,
    /// The frames that may be shown.
    pub drawn: BTreeMap<ChannelId, DrawnFrames>,
    pub targets: BTreeMap<ChannelId, DrawnImage>,
    /// Pictures that wait for their swap while the next ones are drawn.
    pub aside: BTreeMap<ChannelId, DrawnImage>,
    pub draw_us: u64,
}

impl Server {
    pub fn new(index: usize, channels: Vec<ChannelId>, draw_us: u64, load_us: Micros) -> Self {
        Self {
            names: channels.iter().map(|id| format!("c{id}")).collect(),
            channels,
            pid: 1000 * (1 + index as u32),
            life: 0,
            is_alive: false,
            is_gone_for_good: false,
            trouble: InjectedFaults::default(),
            clock_start: 0,
            clock_drift: 0,
            link: None,
            is_welcomed: false,
            is_conversing: false,
            wait: RETRY_FIRST,
            last_heard: 0,
            reads_from: 0,
            estimate: ClockEstimate::default(),
            offset: None,
            reports: VecDeque::new(),
            orders: VecDeque::new(),
            is_loading: false,
            loading: None,
            ready: None,
            ready_scene: None,
            frame_began: 0,
            graces_us: VecDeque::new(),
            load_us,
            finish: None,
            jobs: VecDeque::new(),
            playback: FrameScheduler::default(),
            states: VecDeque::new(),
            drawing: None,
            is_waking: false,
            drawn: BTreeMap::new(),
            targets: BTreeMap::new(),
            aside: BTreeMap::new(),
            draw_us,
        }
    }

    fn local_us(&self, now: Micros) -> u64 {
        let passed = now as i64 + self.clock_start;
        (passed + passed * self.clock_drift / 1_000_000).max(0) as u64
    }

    /// Manager time, as far as it is known.
    pub fn manager_us(&self, now: Micros) -> Option<u64> {
        let (offset, _) = self.offset?;
        Some((self.local_us(now) as i64).saturating_add(offset).max(0) as u64)
    }

    /// A scene that is not here is fetched over the connection that the order came from.
    fn needs_blobs(&self, replica: &Replica) -> bool {
        replica.scene.as_ref().is_some_and(|scene| self.ready_scene != Some(scene.manifest))
    }

    fn fold(&self, prepare: &Prepare) -> Result<Replica, String> {
        let Some(base) = prepare.base else {
            let operations = prepare.operations.clone();
            return Ok(Replica::from_snapshot(prepare.revision, operations));
        };
        let ready = self.ready.as_ref();
        let ready = ready.filter(|(epoch, r)| *epoch == prepare.epoch && r.revision == base);
        let mut replica = ready.map(|(_, r)| r.clone()).ok_or("its base is not here")?;
        prepare.operations.iter().for_each(|o| replica.apply(o.clone()));
        Ok(replica)
    }
}

impl Simulation {
    /// A process begins: a new one knows nothing.
    pub fn start_server(&mut self, index: usize) {
        if self.servers[index].is_alive || self.servers[index].is_gone_for_good {
            return;
        }
        let old = &self.servers[index];
        let mut fresh = Server::new(index, old.channels.clone(), old.draw_us, old.load_us);
        fresh.pid = old.pid + 1;
        fresh.life = old.life + 1;
        fresh.is_alive = true;
        fresh.clock_start = self.dice.between(0, 9_000_000) as i64;
        fresh.clock_drift = self.dice.between(0, 100) as i64 - 50;
        self.servers[index] = fresh;
        self.tell(|| format!("server {index} starts"));
        self.connect(index);
    }

    /// A process ends; the system closes its connection, unless the whole machine is gone.
    pub fn kill_server(&mut self, index: usize, is_heard: bool) {
        self.tell(|| format!("server {index} is killed, heard: {is_heard}"));
        let server = &mut self.servers[index];
        server.is_alive = false;
        server.life += 1;
        if let Some(link) = server.link.take() {
            if is_heard {
                self.cut(link);
            } else {
                self.silence(link, true, true);
            }
            self.links[link.0].is_open_at_server = false;
        }
    }

    /// A connection breaks, with all that is on its way; both ends are told.
    pub fn cut(&mut self, link: LinkId) {
        for side in [Side::Server, Side::Manager] {
            self.links[link.0].lane(side).waiting.clear();
            self.send(link, side, Packet::End);
            self.links[link.0].lane(side).is_dead = true;
        }
    }

    /// A connection falls silent in these directions; nobody is told.
    pub fn silence(&mut self, link: LinkId, to_server: bool, to_manager: bool) {
        for (side, is_meant) in [(Side::Server, to_server), (Side::Manager, to_manager)] {
            if is_meant {
                self.links[link.0].lane(side).waiting.clear();
                self.links[link.0].lane(side).is_dead = true;
            }
        }
    }

    pub fn connect(&mut self, index: usize) {
        let server = &self.servers[index];
        if !server.is_alive || server.link.is_some() {
            return;
        }
        if self.manager.cluster.is_none() {
            self.retry(index);
            return;
        }
        let link = LinkId(self.links.len());
        self.links.push(Link::new(index, self.manager.life));
        self.servers[index].link = Some(link);
        self.servers[index].is_welcomed = false;
        self.send(link, Side::Manager, Packet::Hello);
        // `HANDSHAKE_TIME_MAX`.
        self.at(self.now + 5_000_000, SimEvent::HandshakeEnds(link));
    }

    fn retry(&mut self, index: usize) {
        let jitter = self.dice.between(750, 1250);
        let server = &mut self.servers[index];
        let due = self.now + server.wait * jitter / 1000;
        server.wait = (server.wait * 2).min(RETRY_LONGEST);
        let life = server.life;
        self.at(due, SimEvent::Connect(index, life));
    }

    /// The server lets its connection go.
    pub fn disconnect(&mut self, index: usize, why: &str) {
        let Some(link) = self.servers[index].link.take() else { return };
        self.tell(|| format!("server {index} disconnects: {why}"));
        self.links[link.0].is_open_at_server = false;
        self.send(link, Side::Manager, Packet::End);
        if self.servers[index].is_conversing {
            self.servers[index].is_conversing = false;
            self.push_job(index, Job::Disconnected);
        }
        self.retry(index);
    }

    /// A handshake that has no answer in time is given up.
    pub fn end_handshake(&mut self, link: LinkId) {
        let index = self.links[link.0].server;
        if self.servers[index].link == Some(link) && !self.servers[index].is_welcomed {
            self.disconnect(index, "no answer to the handshake");
        }
    }

    pub fn arrive_at_server(&mut self, link: LinkId, parcel: Packet) -> Check {
        let index = self.links[link.0].server;
        if self.servers[index].link != Some(link) {
            return Ok(());
        }
        self.servers[index].last_heard = self.now;
        match parcel {
            Packet::Welcome => {
                let bulk_us = self.dice.between(100, 8_000);
                let server = &mut self.servers[index];
                server.is_welcomed = true;
                server.offset = None;
                server.estimate = ClockEstimate::default();
                server.reports.clear();
                server.reads_from = self.now + bulk_us;
                let due = server.reads_from;
                self.at(due, SimEvent::Converse(link));
            }
            Packet::Refused => {
                self.coverage.count("server refused");
                self.disconnect(index, "refused");
            }
            Packet::End => self.disconnect(index, "it closed the connection"),
            Packet::Command(command) => self.obey(index, link, &command)?,
            Packet::Hello | Packet::Status(_) => return Err("a parcel went the wrong way".into()),
        }
        Ok(())
    }

    /// The bulk connection stands: reports go out, and signs of life.
    pub fn converse(&mut self, link: LinkId) {
        let index = self.links[link.0].server;
        if self.servers[index].link != Some(link) {
            return;
        }
        let server = &mut self.servers[index];
        server.is_conversing = true;
        server.last_heard = self.now;
        server.wait = RETRY_FIRST;
        self.tick(link);
        let reports = std::mem::take(&mut self.servers[index].reports);
        for status in reports {
            self.coverage.count("stale report on a new connection");
            self.report(index, status);
        }
    }

    pub fn tick(&mut self, link: LinkId) {
        let index = self.links[link.0].server;
        if self.servers[index].link != Some(link) {
            return;
        }
        let heartbeat = Micros::from(self.wall.heartbeat_ms) * 1000;
        if self.now - self.servers[index].last_heard > heartbeat {
            self.coverage.count("manager silent for a server");
            self.disconnect(index, "silent for too long");
            return;
        }
        let sent_us = self.servers[index].local_us(self.now);
        self.report(index, ServerMessage::Ping(Ping { sent_us, memory_bytes: 1 << 20 }));
        if self.is_navigated {
            let channel = self.servers[index].names[0].clone();
            let orbit_rad = DVec2::new(0.3, -0.2);
            let navigation = Navigation { orbit_rad, ..Navigation::none(&channel) };
            self.report(index, ServerMessage::Navigate(navigation));
        }
        let period = heartbeat / Micros::from(PINGS_PER_HEARTBEAT);
        self.at(self.now + period, SimEvent::Tick(link));
    }

    pub fn report(&mut self, index: usize, status: ServerMessage) {
        match self.servers[index].link {
            Some(link) if self.servers[index].is_conversing => {
                self.send(link, Side::Manager, Packet::Status(Box::new(status)));
            }
            _ if self.servers[index].reports.len() < REPORTS_MAX => {
                self.servers[index].reports.push_back(status);
            }
            _ => {}
        }
    }

    fn obey(&mut self, index: usize, link: LinkId, command: &Command) -> Check {
        match command {
            Command::Frame(frame) => self.push_job(index, Job::Frame(Box::new(frame.clone()))),
            Command::Swap(swap) => self.push_job(index, Job::Swap(*swap)),
            Command::Prepare(prepare) => {
                let server = &mut self.servers[index];
                if server.orders.len() >= ORDERS_MAX {
                    return Err(format!("server {index} was sent more than it can prepare"));
                }
                server.orders.push_back((prepare.clone(), link));
                let server = &mut self.servers[index];
                if server.finish.is_none() && server.loading.take().is_some() {
                    // What it is at work on is of no use any more.
                    self.coverage.count("a preparation was cancelled");
                    self.loading_failed(index, "a newer preparation has come");
                } else {
                    self.load_next(index);
                }
            }
            Command::Pong(pong) => {
                let server = &mut self.servers[index];
                let arrived = server.local_us(self.now);
                server.estimate.add(pong, arrived);
                server.offset = server.estimate.best(arrived);
            }
            Command::Goodbye(goodbye) => self.disconnect(index, &goodbye.to_string()),
        }
        Ok(())
    }

    fn load_next(&mut self, index: usize) {
        let server = &mut self.servers[index];
        if server.is_loading {
            return;
        }
        let Some((prepare, _)) = server.orders.front() else { return };
        server.is_loading = true;
        let (epoch, shown) = (prepare.epoch, prepare.shown);
        server.states.retain(|of| of.epoch != epoch || of.revision() <= shown);
        let is_failing = self.now < server.trouble.loads_fail_until;
        let loaded = match server.fold(prepare) {
            Ok(_) if is_failing => Err("out of memory".to_owned()),
            Ok(replica) => {
                let mut digest = replica.digest();
                if std::mem::take(&mut server.trouble.corrupts_next) {
                    digest.0 ^= 1;
                }
                Ok(State { epoch: prepare.epoch, replica, digest })
            }
            Err(reason) => Err(reason),
        };
        let is_new = loaded.as_ref().is_ok_and(|state| server.needs_blobs(&state.replica));
        let mut load_us = if is_new { server.load_us } else { 100 };
        if self.now < server.trouble.loads_slow_until {
            load_us += server.trouble.loads_slow_by;
        }
        server.loading = Some(loaded);
        let life = server.life;
        let due = self.now + self.dice.between(load_us / 2, load_us);
        self.at(due, SimEvent::Loaded(index, life));
    }

    /// The loader is done with a state, but for what the render thread makes of it.
    pub fn loaded(&mut self, index: usize) {
        let server = &mut self.servers[index];
        let Some(loaded) = server.loading.take() else { return };
        let Some((_, link)) = server.orders.front() else { return };
        let is_cut = server.link != Some(*link);
        match loaded {
            Ok(state) if is_cut && server.needs_blobs(&state.replica) => {
                self.loading_failed(index, "the connection that asked for it has ended");
            }
            Ok(state) => {
                server.finish = Some(state);
                self.wake_render(index);
            }
            Err(reason) => {
                if reason.contains("base") {
                    self.coverage.count("prepare without its base");
                }
                self.loading_failed(index, &reason);
            }
        }
    }

    fn loading_failed(&mut self, index: usize, reason: &str) {
        let Some((prepare, _)) = self.servers[index].orders.pop_front() else { return };
        self.tell(|| format!("server {index} cannot prepare {}: {reason}", prepare.revision));
        let (epoch, revision) = (prepare.epoch, prepare.revision);
        let reason = reason.to_owned();
        self.servers[index].is_loading = false;
        self.report(index, ServerMessage::PrepareFailed { epoch, revision, reason });
        self.load_next(index);
    }

    /// The render thread has made a state drawable, and tells the loader.
    pub fn finished(&mut self, index: usize, state: &State) -> Check {
        let server = &mut self.servers[index];
        server.orders.pop_front();
        server.is_loading = false;
        server.ready = Some((state.epoch, state.replica.clone()));
        server.ready_scene = state.replica.scene.as_ref().map(|scene| scene.manifest);
        let budget = state.replica.wall.as_ref().and_then(|wall| wall.budget.gpu_mib);
        let prepared = Prepared {
            epoch: state.epoch,
            revision: state.revision(),
            digest: state.digest,
            features: Vec::new(),
            scene_bytes: 0,
            // As if each wall with a budget held a part.
            detail_reach: state.replica.scene.as_ref().and(budget).map(|_| 0.5),
        };
        self.watch.folded(state)?;
        self.report(index, ServerMessage::Prepared(prepared));
        self.load_next(index);
        Ok(())
    }
}
