//! Connections between render servers and the manager. Each keeps its order, as TCP does; between
//! two of them there is none.

use std::collections::VecDeque;
use std::rc::Rc;

use polyptych_protocol::command::Command;
use polyptych_protocol::server_message::ServerMessage;

use super::super::{Micros, SessionId};
use super::dice::Rng;

/// An end of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Side {
    Server,
    Manager,
}

/// A connection, by its place in the network's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LinkId(pub usize);

/// A message of a simulated connection.
#[derive(Clone, Debug)]
pub enum Packet {
    Hello,
    Welcome,
    Refused,
    Command(Rc<Command>),
    Status(Box<ServerMessage>),
    /// The peer has closed its end, after all that it sent.
    End,
}

/// One direction of a connection.
#[derive(Debug, Default)]
pub struct LinkDirection {
    /// Under way, or arrived at a peer that does not read.
    pub waiting: VecDeque<Packet>,
    last: Micros,
    /// Nothing arrives any more, and nobody is told: a cable was pulled.
    pub is_dead: bool,
}

/// A connection.
#[derive(Debug)]
pub struct Link {
    pub server: usize,
    /// The manager's `life` when it was opened.
    pub life: u32,
    pub session: Option<SessionId>,
    to_server: LinkDirection,
    to_manager: LinkDirection,
    pub is_open_at_server: bool,
    pub is_open_at_manager: bool,
}

impl Link {
    pub fn new(server: usize, life: u32) -> Self {
        Self {
            server,
            life,
            session: None,
            to_server: LinkDirection::default(),
            to_manager: LinkDirection::default(),
            is_open_at_server: true,
            is_open_at_manager: true,
        }
    }

    /// The direction that ends at this side.
    pub fn lane(&mut self, to: Side) -> &mut LinkDirection {
        match to {
            Side::Server => &mut self.to_server,
            Side::Manager => &mut self.to_manager,
        }
    }

    pub fn is_open(&self, at: Side) -> bool {
        match at {
            Side::Server => self.is_open_at_server,
            Side::Manager => self.is_open_at_manager,
        }
    }
}

/// The latency of messages.
#[derive(Debug)]
pub struct LatencyModel {
    dice: Rng,
    delay_us: u64,
    jitter_us: u64,
    /// Until when things on a server's connections travel longer, and by how much.
    pub spikes: Vec<(Micros, Micros)>,
}

impl LatencyModel {
    pub fn new(mut dice: Rng, servers: usize) -> Self {
        let delay_us = dice.pick(&[20, 100, 100, 400, 3_000]);
        let jitter_us = dice.pick(&[1, 50, 200, 2_000]);
        Self { dice, delay_us, jitter_us, spikes: vec![(0, 0); servers] }
    }

    fn delay(&mut self, server: usize, now: Micros) -> Micros {
        let (until, extra) = self.spikes[server];
        let spike = if now < until { self.dice.between(0, extra) } else { 0 };
        self.delay_us + self.dice.between(0, self.jitter_us) + spike
    }

    /// Puts a parcel on its way and says when it arrives, if it does.
    pub fn send(
        &mut self,
        now: Micros,
        link: &mut Link,
        to: Side,
        parcel: Packet,
    ) -> Option<Micros> {
        let delay = self.delay(link.server, now);
        let lane = link.lane(to);
        if lane.is_dead {
            return None;
        }
        lane.last = lane.last.max(now + delay);
        lane.waiting.push_back(parcel);
        Some(lane.last)
    }
}
