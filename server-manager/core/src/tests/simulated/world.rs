//! The simulated wall: one clock, and everything that happens in its order.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::Request;
use polyptych_wall::Wall;

use super::super::{Micros, SessionId};
use super::coverage::Coverage;
use super::dice::Rng;
use super::invariant::InvariantChecker;
use super::manager::Manager;
use super::network::{LatencyModel, Link, LinkId, Packet, Side};
use super::server::Server;

/// An invariant holds, or what broke it.
pub type Check = Result<(), String>;

/// An event that is due at a time. Events of a process carry its life; another life ignores them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimEvent {
    Arrives(LinkId, Side),
    HandshakeEnds(LinkId),
    Converse(LinkId),
    Tick(LinkId),
    Connect(usize, u32),
    Render(usize, u32),
    DrawingEnds(usize, u32),
    Loaded(usize, u32),
    ServerStarts(usize),
    ManagerStarts,
    Timeout(u32),
    Asked(usize),
    Imported(usize),
}

/// A program that asks. Its messages are not delayed by the network model: the core's answers to
/// it are looked at as they come out.
#[derive(Debug, Default)]
pub struct Client {
    pub session: Option<SessionId>,
    pub next_id: u64,
}

/// A request on its way.
#[derive(Clone, Debug)]
pub struct PendingRequest {
    pub client: SessionId,
    pub id: RequestId,
    pub request: Request,
}

/// All that there is.
pub struct Simulation {
    pub now: Micros,
    count: u64,
    agenda: BinaryHeap<Reverse<(Micros, u64, SimEvent)>>,
    pub wall: Wall,
    pub manager: Manager,
    pub servers: Vec<Server>,
    pub links: Vec<Link>,
    pub clients: Vec<Client>,
    pub asked: Vec<PendingRequest>,
    pub weather: LatencyModel,
    pub dice: Rng,
    pub watch: InvariantChecker,
    pub coverage: Coverage,
    /// `true` if mice move over its windows: on one wall of four, so that older seeds of the others
    /// mean what they did.
    pub is_navigated: bool,
    /// `true` if events are printed.
    pub is_told: bool,
}

impl Simulation {
    pub fn new(seed: u64, wall: Wall, servers: Vec<Server>, clients: usize) -> Self {
        Self {
            now: 1_000,
            count: 0,
            agenda: BinaryHeap::new(),
            manager: Manager::default(),
            links: Vec::new(),
            clients: (0..clients).map(|_| Client::default()).collect(),
            asked: Vec::new(),
            weather: LatencyModel::new(Rng::new(seed, 2), servers.len()),
            dice: Rng::new(seed, 3),
            is_navigated: seed % 4 == 2,
            watch: InvariantChecker::new(&wall),
            coverage: Coverage::default(),
            is_told: false,
            servers,
            wall,
        }
    }

    pub fn tell(&self, what: impl FnOnce() -> String) {
        if self.is_told {
            println!("{:>12.3} ms  {}", self.now as f64 / 1000.0, what());
        }
    }

    pub fn at(&mut self, due: Micros, happening: SimEvent) {
        self.count += 1;
        self.agenda.push(Reverse((due, self.count, happening)));
    }

    pub fn send(&mut self, link: LinkId, to: Side, parcel: Packet) {
        let due = self.weather.send(self.now, &mut self.links[link.0], to, parcel);
        if let Some(due) = due {
            self.at(due, SimEvent::Arrives(link, to));
        }
    }

    /// Lets everything happen that is due until `end`.
    pub fn run_until(&mut self, end: Micros) -> Check {
        while let Some(&Reverse((due, _, happening))) = self.agenda.peek() {
            if due > end {
                break;
            }
            self.agenda.pop();
            self.now = self.now.max(due);
            if let Some(later) = self.hindrance(happening) {
                self.at(later, happening);
            } else {
                self.coverage.happenings += 1;
                self.happen(happening)?;
            }
        }
        self.now = self.now.max(end);
        Ok(())
    }

    /// Until when whoever is to do this stands still, if it does.
    fn hindrance(&self, happening: SimEvent) -> Option<Micros> {
        let of_server = |index: usize| Some(self.servers[index].trouble.stopped_until);
        let of_link = |link: LinkId| of_server(self.links[link.0].server);
        let until = match happening {
            SimEvent::Arrives(_, Side::Manager) | SimEvent::Asked(_) | SimEvent::Imported(_) => {
                Some(self.manager.stopped_until)
            }
            // Whoever wakes hears what waits before it looks at the clock.
            SimEvent::Timeout(_) => Some(self.manager.stopped_until + 1),
            SimEvent::Arrives(link, Side::Server) => {
                let server = &self.servers[self.links[link.0].server];
                Some(server.trouble.stopped_until.max(server.reads_from))
            }
            SimEvent::Converse(link) | SimEvent::Tick(link) => of_link(link),
            SimEvent::Connect(index, _) | SimEvent::Loaded(index, _) => of_server(index),
            SimEvent::Render(index, _) | SimEvent::DrawingEnds(index, _) => {
                let trouble = &self.servers[index].trouble;
                Some(trouble.stopped_until.max(trouble.hangs_until))
            }
            _ => None,
        };
        until.filter(|until| self.now < *until)
    }

    fn happen(&mut self, happening: SimEvent) -> Check {
        let is_of = |world: &Self, index: usize, life: u32| world.servers[index].life == life;
        match happening {
            SimEvent::Arrives(link, side) => {
                let is_open = self.links[link.0].is_open(side);
                let Some(parcel) = self.links[link.0].lane(side).waiting.pop_front() else {
                    return Ok(());
                };
                match side {
                    _ if !is_open => Ok(()),
                    Side::Server => self.arrive_at_server(link, parcel),
                    Side::Manager => self.arrive_at_manager(link, parcel),
                }
            }
            SimEvent::HandshakeEnds(link) => {
                self.end_handshake(link);
                Ok(())
            }
            SimEvent::Converse(link) => {
                self.converse(link);
                Ok(())
            }
            SimEvent::Tick(link) => {
                self.tick(link);
                Ok(())
            }
            SimEvent::Connect(index, life) if is_of(self, index, life) => {
                self.connect(index);
                Ok(())
            }
            SimEvent::Render(index, life) if is_of(self, index, life) => self.render(index),
            SimEvent::DrawingEnds(index, life) if is_of(self, index, life) => {
                self.end_drawing(index)
            }
            SimEvent::Loaded(index, life) if is_of(self, index, life) => {
                self.loaded(index);
                Ok(())
            }
            SimEvent::ServerStarts(index) => {
                self.start_server(index);
                Ok(())
            }
            SimEvent::ManagerStarts => self.start_manager(),
            SimEvent::Timeout(life) => self.time_out(life),
            SimEvent::Asked(index) => self.arrive_asked(index),
            SimEvent::Imported(index) => self.arrive_import(index),
            _ => Ok(()),
        }
    }
}
