//! Events for a person to read: who came and went, who was late, what was asked and refused.

use std::collections::BTreeMap;

use polyptych_core::{Cluster, Effect, Input, Micros, SessionId};
use polyptych_protocol::command::Command;
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::{MessageToClient, Request};
use serde::Serialize;

use crate::replay::incident::TimeRange;
use crate::replay::words;

/// Events that are kept: more than anybody reads; the rest is counted.
const EVENTS_KEPT_MAX: usize = 10_000;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Manager time in seconds.
    pub at_s: f64,
    /// `join`, `refused`, `leave`, `channel`, `client`, `request`, `import`, `failure` or `end`.
    pub kind: &'static str,
    /// In words.
    pub text: String,
}

/// A summary of a stretch of inputs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Manager time of the first input, in seconds.
    pub from_s: f64,
    /// Manager time of the last input, in seconds.
    pub to_s: f64,
    /// Frames swapped.
    pub frames: u64,
    /// The longest time from a frame command to its swap.
    pub longest_frame_ms: f64,
    /// Manager time at which that frame was swapped, in seconds.
    pub longest_frame_at_s: f64,
    /// Deadlines that each channel missed in this stretch, by name; only those that missed any.
    pub late: BTreeMap<String, u64>,
    /// Requests, by kind.
    pub requests: BTreeMap<String, u64>,
    /// Answers of the core.
    pub answers: u64,
    /// Answers that said no.
    pub failures: u64,
    /// In order.
    pub events: Vec<Event>,
    /// Events beyond those.
    pub events_more: u64,
}

/// Makes a [`Summary`] while a core is told.
#[derive(Debug)]
pub(super) struct Timeline {
    summary: Summary,
    now: Option<Micros>,
    states: Vec<ChannelState>,
    /// Deadlines that each channel had missed before.
    late_before: Vec<u64>,
    /// Servers and clients by their sessions.
    peers: BTreeMap<SessionId, String>,
    /// When frames began that are not swapped.
    began: BTreeMap<FrameId, Micros>,
    /// The range that is drawn, if any.
    range: Option<TimeRange>,
    /// Events in that range, as many as are kept, and how many there are beyond those.
    drawn: (Vec<Event>, u64),
}

impl Timeline {
    /// Begins with a core. Events in `range` are kept for a drawing as well.
    pub fn new(cluster: &Cluster, range: Option<&TimeRange>) -> Self {
        let states = cluster.channel_states().map(|(_, state, _, _)| state).collect();
        // A checkpoint has peers that came before the recording's first input.
        let there = cluster.server_names().chain(cluster.client_names());
        let peers = there.map(|(session, name)| (session, name.to_owned())).collect();
        let late_before = cluster.channel_states().map(|(.., late)| late).collect();
        let summary = Summary::default();
        Self {
            summary,
            now: None,
            states,
            late_before,
            peers,
            began: BTreeMap::new(),
            range: range.cloned(),
            drawn: (Vec::new(), 0),
        }
    }

    pub fn now_s(&self) -> f64 {
        self.now.unwrap_or(0) as f64 / 1e6
    }

    pub fn observe(
        &mut self,
        now: Micros,
        input: &Input,
        outputs: &[Effect],
        refusal: Option<&str>,
        cluster: &Cluster,
    ) {
        if self.now.is_none() {
            self.summary.from_s = now as f64 / 1e6;
        }
        self.now = Some(now);
        self.note_input(input, refusal);
        self.note_states(cluster);
        for output in outputs {
            self.note_output(now, output);
        }
    }

    /// Takes the events in the drawn range, and the number of those beyond them.
    pub fn take_drawn(&mut self) -> (Vec<Event>, u64) {
        std::mem::take(&mut self.drawn)
    }

    pub fn finish(mut self, cluster: &Cluster) -> Summary {
        self.summary.to_s = self.now_s();
        let late = cluster.channel_states().zip(&self.late_before);
        let late = late.map(|((name, .., late), before)| (name, late.saturating_sub(*before)));
        let late = late.filter(|(_, late)| *late > 0);
        self.summary.late = late.map(|(name, late)| (name.to_owned(), late)).collect();
        self.summary
    }

    fn event(&mut self, kind: &'static str, text: String) {
        let event = Event { at_s: self.now_s(), kind, text };
        if self.range.as_ref().is_some_and(|range| range.holds(event.at_s)) {
            keep(&mut self.drawn.0, &mut self.drawn.1, event.clone());
        }
        keep(&mut self.summary.events, &mut self.summary.events_more, event);
    }

    fn name(&self, session: SessionId) -> String {
        let unnamed = || format!("session {}", session.0);
        self.peers.get(&session).cloned().unwrap_or_else(unnamed)
    }

    fn note_input(&mut self, input: &Input, refusal: Option<&str>) {
        match input {
            Input::Server { session, hello, address } => {
                let (name, adapter) = (&hello.name, &hello.adapter.name);
                let text = format!("server {name} at {address} ({adapter})");
                match refusal {
                    None => {
                        self.peers.insert(*session, name.clone());
                        self.event("join", format!("{text} joins"));
                    }
                    Some(reason) => self.event("refused", format!("{text} is refused: {reason}")),
                }
            }
            Input::ServerGone { session, reason } => {
                let name = self.name(*session);
                self.peers.remove(session);
                self.event("leave", format!("server {name} is gone: {reason}"));
            }
            Input::Client { session, name } => {
                self.peers.insert(*session, name.clone());
                self.event("client", format!("client {name} comes"));
            }
            Input::ClientGone { session } => {
                let name = self.name(*session);
                self.peers.remove(session);
                self.event("client", format!("client {name} leaves"));
            }
            Input::Request { client, request, .. } => {
                *self.summary.requests.entry(request.name().to_owned()).or_default() += 1;
                if !is_everyday(request) {
                    let (name, words) = (self.name(*client), words::of_request(request));
                    self.event("request", format!("client {name} asks: {words}"));
                }
            }
            Input::Session { session, .. } => {
                let outcome = session.as_ref().map(|_| "it was read");
                let text = format!("a session: {}", outcome.unwrap_or_else(|reason| reason));
                self.event("session", text);
            }
            Input::Import { imported, .. } => {
                let text = match imported {
                    Ok(imported) => format!("scene {} is baked", imported.scene.name),
                    Err(reason) => format!("a scene could not be baked: {reason}"),
                };
                self.event("import", text);
            }
            Input::Timeout
            | Input::Status { .. }
            | Input::Heard { .. }
            | Input::Places { .. }
            | Input::Minute { .. }
            | Input::Progress { .. } => {}
        }
    }

    /// Channels that have changed, those of one kind and reason in one line.
    fn note_states(&mut self, cluster: &Cluster) {
        let mut changed: Vec<(ChannelState, Option<&str>, Vec<&str>)> = Vec::new();
        for (index, (name, state, reason, _)) in cluster.channel_states().enumerate() {
            let Some(before) = self.states.get_mut(index).filter(|before| **before != state) else {
                continue;
            };
            *before = state;
            match changed.iter_mut().find(|(s, r, _)| (*s, *r) == (state, reason)) {
                Some((_, _, names)) => names.push(name),
                None => changed.push((state, reason, vec![name])),
            }
        }
        for (state, reason, names) in changed {
            // On the way to being live only what went wrong is of interest.
            let is_step = matches!(
                state,
                ChannelState::Joining | ChannelState::Preparing | ChannelState::Ready
            );
            if is_step && reason.is_none() {
                continue;
            }
            let word = state.name();
            let reason = reason.map(|reason| format!(": {reason}")).unwrap_or_default();
            self.event("channel", format!("{} {word}{reason}", names.join(", ")));
        }
    }

    fn note_output(&mut self, now: Micros, output: &Effect) {
        match output {
            Effect::Command { command, .. } => match &**command {
                Command::Frame(frame) => drop(self.began.insert(frame.frame, now)),
                Command::Swap(swap) => {
                    self.summary.frames += 1;
                    let began = self.began.remove(&swap.frame).unwrap_or(now);
                    self.began.retain(|frame, _| *frame > swap.frame);
                    let took_ms = now.saturating_sub(began) as f64 / 1000.0;
                    if took_ms > self.summary.longest_frame_ms {
                        self.summary.longest_frame_ms = took_ms;
                        self.summary.longest_frame_at_s = now as f64 / 1e6;
                    }
                }
                _ => {}
            },
            Effect::Answer { to, answer: MessageToClient::Reply { reply, .. } } => {
                self.summary.answers += 1;
                if let Err(failure) = reply {
                    self.summary.failures += 1;
                    let name = self.name(*to);
                    self.event("failure", format!("client {name} is told: {}", failure.reason));
                }
            }
            Effect::Close { session, reason } => {
                let name = self.name(*session);
                self.event("leave", format!("server {name} is let go: {reason}"));
            }
            Effect::Stop => self.event("end", "the manager is stopped by a client".into()),
            Effect::StopServers { .. } => {
                self.event("end", "the manager and its servers are stopped by a client".into());
            }
            _ => {}
        }
    }
}

/// Keeps an event, or counts it where there are as many as are kept.
fn keep(events: &mut Vec<Event>, more: &mut u64, event: Event) {
    if events.len() < EVENTS_KEPT_MAX {
        events.push(event);
    } else {
        *more += 1;
    }
}

/// Returns whether clients send such requests all the time.
pub(super) fn is_everyday(request: &Request) -> bool {
    matches!(
        request,
        Request::RenderFrame { .. }
            | Request::Redraw(_)
            | Request::SetCamera(_)
            | Request::SetHead(_)
            | Request::Fly(_)
            | Request::ReportDevices(_)
            | Request::Status
            | Request::DescribeWall
            | Request::Statistics { .. }
    )
}
