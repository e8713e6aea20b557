//! Events and intervals of each channel and client of a recording: lanes of a drawing.

use std::collections::{BTreeMap, VecDeque};

use polyptych_core::{Cluster, Effect, Input, Micros, SessionId};
use polyptych_protocol::command::Command;
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::MessageToClient;
use polyptych_protocol::server_message::ServerMessage;

use super::incident::TimeRange;
use super::timeline::{Event, is_everyday};
use super::words;

/// Maximum number of intervals of one kind in a lane: beyond it, neighbours become one.
pub const INTERVALS_MAX: usize = 1000;

/// Maximum number of lanes of clients; others share the last one.
const CLIENTS_MAX: usize = 64;

/// Marks of a lane that are kept with their words; the rest is counted.
const MARKS_MAX: usize = 200;

/// Frames that may be on their way.
const FRAMES_MAX: usize = 16;

/// Times in seconds, in rising order, in a bounded number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intervals {
    /// Beginning, end, and how many became one.
    pub list: Vec<(f64, f64, u64)>,
    /// Neighbours that are nearer to each other than this are one.
    gap_s: f64,
}

/// Something that is worth a word.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Manager time in seconds.
    pub at_s: f64,
    /// `true` for what a reader looks for: a failure or a loss.
    pub is_trouble: bool,
    /// In words.
    pub text: String,
}

/// The events of one channel, or the requests of one client.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lane {
    /// The name of the channel or the client.
    pub name: String,
    /// The server that drives the channel, if one did.
    pub server: Option<String>,
    /// States of the channel, from when on, in order.
    pub states: Vec<(f64, ChannelState)>,
    /// From when to when it drew; of a client, its everyday requests.
    pub busy: Intervals,
    /// Present calls of a channel; other requests of a client.
    pub shown: Intervals,
    /// Deadlines that were missed; requests that were refused.
    pub late: Intervals,
    /// The first things that are worth a word; trouble takes the place of what is none.
    pub marks: Vec<Mark>,
    /// Things beyond those.
    pub marks_more: u64,
}

/// The lanes of a part of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lanes {
    /// The part, from 1.
    pub part: usize,
    /// Manager time of the first input, in seconds.
    pub from_s: f64,
    /// Manager time of the last input, in seconds.
    pub to_s: f64,
    /// From frame commands to their swaps.
    pub frames: Intervals,
    /// In the wall's order.
    pub channels: Vec<Lane>,
    /// In the order in which they came.
    pub clients: Vec<Lane>,
    /// Events of the timeline that are in the range, in order.
    pub events: Vec<Event>,
    /// Events in the range beyond those.
    pub events_more: u64,
}

impl Intervals {
    fn push(&mut self, from_s: f64, to_s: f64) {
        if !(from_s.is_finite() && to_s.is_finite()) {
            return;
        }
        match self.list.last_mut() {
            Some(last) if from_s - last.1 <= self.gap_s && self.gap_s > 0.0 => {
                *last = (last.0.min(from_s), last.1.max(to_s), last.2 + 1);
            }
            _ => self.list.push((from_s, to_s, 1)),
        }
        while self.list.len() > INTERVALS_MAX {
            self.widen();
        }
    }

    /// Makes one of neighbours that are twice as far from each other as before.
    fn widen(&mut self) {
        let span = self.list.last().map_or(0.0, |last| last.1) - self.list[0].0;
        let least = (span / INTERVALS_MAX as f64).max(1e-6) / 8.0;
        self.gap_s = (self.gap_s * 2.0).max(least);
        let mut merged: Vec<(f64, f64, u64)> = Vec::with_capacity(self.list.len());
        for &(from, to, count) in &self.list {
            match merged.last_mut() {
                Some(last) if from - last.1 <= self.gap_s => {
                    *last = (last.0, last.1.max(to), last.2 + count);
                }
                _ => merged.push((from, to, count)),
            }
        }
        self.list = merged;
    }
}

impl Lane {
    fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }

    fn mark(&mut self, at_s: f64, is_trouble: bool, text: String) {
        if self.marks.len() >= MARKS_MAX {
            self.marks_more += 1;
            let ordinary = self.marks.iter().rposition(|mark| !mark.is_trouble);
            let Some(index) = ordinary.filter(|_| is_trouble) else { return };
            self.marks.remove(index);
        }
        self.marks.push(Mark { at_s, is_trouble, text });
    }
}

/// Makes [`Lanes`] while a core is told.
#[derive(Debug)]
pub(super) struct LaneRecorder {
    lanes: Lanes,
    range: TimeRange,
    /// Frames that have not been swapped, and when they began.
    begun: VecDeque<(FrameId, f64)>,
    /// Deadlines that each channel has missed.
    late: Vec<u64>,
    /// Lanes of clients by their sessions.
    clients: BTreeMap<SessionId, usize>,
    is_begun: bool,
}

impl LaneRecorder {
    pub fn new(cluster: &Cluster, part: usize, range: &TimeRange) -> Self {
        let channels = cluster.channel_states().map(|(name, ..)| Lane::new(name)).collect();
        let late = cluster.channel_states().map(|(.., late)| late).collect();
        let mut recorder = Self {
            lanes: Lanes { part, channels, ..Lanes::default() },
            range: range.clone(),
            begun: VecDeque::new(),
            late,
            clients: BTreeMap::new(),
            is_begun: false,
        };
        // A checkpoint has peers that came before the recording's first input.
        for (session, name) in cluster.server_names() {
            for channel in cluster.channels_of(session) {
                if let Some(lane) = recorder.lanes.channels.get_mut(usize::from(channel.0)) {
                    lane.server = Some(name.to_owned());
                }
            }
        }
        for (session, name) in cluster.client_names() {
            recorder.add_client(session, name);
        }
        recorder
    }

    pub fn finish(self) -> Lanes {
        self.lanes
    }

    pub fn observe(&mut self, now: Micros, input: &Input, outputs: &[Effect], cluster: &Cluster) {
        let now_s = now as f64 / 1e6;
        // Who is there is known from before.
        self.note_peers(input);
        if !self.range.holds(now_s) {
            return;
        }
        if !self.is_begun {
            self.is_begun = true;
            self.lanes.from_s = now_s;
            self.late = cluster.channel_states().map(|(.., late)| late).collect();
        }
        self.lanes.to_s = now_s;
        self.note_input(now_s, input);
        self.note_states(now_s, cluster);
        for output in outputs {
            self.note_output(now_s, output);
        }
    }

    fn note_peers(&mut self, input: &Input) {
        match input {
            Input::Server { hello, .. } => {
                for lane in &mut self.lanes.channels {
                    if hello.channels.contains(&lane.name) {
                        lane.server = Some(hello.name.clone());
                    }
                }
            }
            Input::Client { session, name } => self.add_client(*session, name),
            _ => {}
        }
    }

    /// Gives a client a lane; clients of one name share it.
    fn add_client(&mut self, session: SessionId, name: &str) {
        let known = self.lanes.clients.iter().position(|lane| lane.name == name);
        let lane = known.unwrap_or_else(|| {
            if self.lanes.clients.len() < CLIENTS_MAX {
                self.lanes.clients.push(Lane::new(name));
            }
            self.lanes.clients.len() - 1
        });
        self.clients.insert(session, lane);
    }

    fn client(&mut self, session: SessionId) -> Option<&mut Lane> {
        self.lanes.clients.get_mut(*self.clients.get(&session)?)
    }

    fn note_input(&mut self, now_s: f64, input: &Input) {
        match input {
            Input::Server { hello, .. } => {
                for lane in &mut self.lanes.channels {
                    if hello.channels.contains(&lane.name) {
                        lane.mark(now_s, false, format!("server {} came", hello.name));
                    }
                }
            }
            Input::Status { status, .. } => self.note_status(now_s, status),
            Input::Client { session, .. } => {
                if let Some(lane) = self.client(*session) {
                    lane.mark(now_s, false, "came".to_owned());
                }
            }
            Input::ClientGone { session } => {
                if let Some(lane) = self.client(*session) {
                    lane.mark(now_s, false, "left".to_owned());
                }
                self.clients.remove(session);
            }
            Input::Request { client, request, .. } => {
                let Some(lane) = self.client(*client) else { return };
                if is_everyday(request) {
                    lane.busy.push(now_s, now_s);
                } else {
                    lane.shown.push(now_s, now_s);
                    lane.mark(now_s, false, words::of_request(request));
                }
            }
            _ => {}
        }
    }

    fn note_status(&mut self, now_s: f64, status: &ServerMessage) {
        match status {
            ServerMessage::Drawn(drawn) => {
                if let Some(lane) = self.lanes.channels.get_mut(usize::from(drawn.channel.0)) {
                    lane.busy.push(now_s - f64::from(drawn.draw_us) / 1e6, now_s);
                }
            }
            ServerMessage::Shown(shown) => {
                if let Some(lane) = self.lanes.channels.get_mut(usize::from(shown.channel.0)) {
                    let at_s = shown.at_us as f64 / 1e6;
                    lane.shown.push(at_s, at_s);
                }
            }
            ServerMessage::DrawFailed { channel, reason, .. } => {
                if let Some(lane) = self.lanes.channels.get_mut(usize::from(channel.0)) {
                    lane.mark(now_s, true, format!("could not draw: {reason}"));
                }
            }
            _ => {}
        }
    }

    fn note_states(&mut self, now_s: f64, cluster: &Cluster) {
        let channels = self.lanes.channels.iter_mut().zip(&mut self.late);
        for ((lane, before), (_, state, reason, late)) in channels.zip(cluster.channel_states()) {
            if lane.states.last().is_none_or(|(_, last)| *last != state) {
                let is_first = lane.states.is_empty();
                // As many as of other things; the last one stays true.
                if lane.states.len() >= INTERVALS_MAX {
                    lane.states.pop();
                }
                lane.states.push((now_s, state));
                if let (ChannelState::Lost, Some(reason), false) = (state, reason, is_first) {
                    lane.mark(now_s, true, format!("lost: {reason}"));
                }
            }
            if late > *before {
                *before = late;
                lane.late.push(now_s, now_s);
            }
        }
    }

    fn note_output(&mut self, now_s: f64, output: &Effect) {
        match output {
            Effect::Command { command, .. } => match &**command {
                Command::Frame(frame) => {
                    self.begun.push_back((frame.frame, now_s));
                    if self.begun.len() > FRAMES_MAX {
                        self.begun.pop_front();
                    }
                }
                Command::Swap(swap) => {
                    let at = self.begun.iter().position(|(frame, _)| *frame == swap.frame);
                    let begun = at.and_then(|at| self.begun.drain(..=at).next_back());
                    self.lanes.frames.push(begun.map_or(now_s, |(_, from_s)| from_s), now_s);
                }
                _ => {}
            },
            Effect::Answer { to, answer: MessageToClient::Reply { reply: Err(failure), .. } } => {
                let text = format!("refused: {}", failure.reason);
                if let Some(lane) = self.client(*to) {
                    lane.late.push(now_s, now_s);
                    lane.mark(now_s, true, text);
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_recording_is_bounded_and_keeps_gaps_that_are_wide() {
        let mut intervals = Intervals::default();
        for frame in 0..200_000 {
            // Ten seconds without frames after every thousand seconds.
            let at_s = f64::from(frame) / 60.0 + f64::from(frame / 60_000) * 10.0;
            intervals.push(at_s, at_s + 0.01);
        }
        assert!(intervals.list.len() <= INTERVALS_MAX, "{}", intervals.list.len());
        assert_eq!(intervals.list.iter().map(|(_, _, count)| count).sum::<u64>(), 200_000);
        let gaps = intervals.list.windows(2).filter(|pair| pair[1].0 - pair[0].1 > 9.0);
        assert_eq!(gaps.count(), 3);
        intervals.push(f64::NAN, 0.0);
        assert!(intervals.list.iter().all(|(from, to, _)| from <= to));
    }

    #[test]
    fn trouble_is_marked_in_a_lane_that_is_full() {
        let mut lane = Lane::new("left");
        let count = MARKS_MAX as u32 + 10;
        (0..count).for_each(|at| lane.mark(f64::from(at), at == 3, "asked".to_owned()));
        lane.mark(1000.0, true, "lost".to_owned());
        assert_eq!((lane.marks.len(), lane.marks_more), (MARKS_MAX, 11));
        let trouble = lane.marks.iter().filter(|mark| mark.is_trouble).map(|mark| mark.at_s);
        assert_eq!(trouble.collect::<Vec<_>>(), [3.0, 1000.0]);
        assert!(lane.marks.is_sorted_by(|a, b| a.at_s < b.at_s), "{:?}", lane.marks);
    }

    #[test]
    fn few_intervals_stay_as_they_were() {
        let mut intervals = Intervals::default();
        (0..900).for_each(|at| intervals.push(f64::from(at), f64::from(at) + 0.5));
        assert_eq!(intervals.list.len(), 900);
    }
}
