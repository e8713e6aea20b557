//! Invariants that hold whatever the core is told; they stay true when the core is changed on
//! purpose.

use std::collections::{BTreeSet, VecDeque};

use polyptych_core::{ClientRequest, Cluster, Effect, Input, Micros, SessionId};
use polyptych_protocol::command::Command;
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::MessageToClient;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_wall::ChannelId;

use crate::replay::words;

/// Looks at all that a core is told and decides.
///
/// - Frames begin and are swapped in order and once, one at a time.
/// - A server is told to swap only what it was told to draw.
/// - What is swapped was drawn by every channel that was live all the time since the frame began.
/// - Every request gets one answer, and no answer comes unasked.
#[derive(Debug)]
pub struct Invariants {
    what: String,
    /// `true` if the first input is the first of the manager's life: otherwise older requests may
    /// be answered, and an older frame swapped.
    is_from_start: bool,
    /// The frames that have begun and are not swapped, in order: one, and as many as the wall may
    /// draw ahead.
    begun: VecDeque<Begun>,
    begun_max: usize,
    /// The time of the last swap.
    swapped_at: Micros,
    frame: FrameId,
    open: BTreeSet<ClientRequest>,
    is_over: bool,
}

#[derive(Debug)]
struct Begun {
    frame: FrameId,
    at: Micros,
    sent: Vec<SessionId>,
    /// The channels that were live as it began and are still; not known within that input.
    live: Option<BTreeSet<ChannelId>>,
    drawn: BTreeSet<ChannelId>,
}

impl Invariants {
    /// For a core that stands here; `what` begins every message.
    pub fn new(cluster: &Cluster, is_from_start: bool, what: String) -> Self {
        let frame = if is_from_start { FrameId(0) } else { cluster.frame_begun() };
        let open = BTreeSet::new();
        let begun_max = 1 + cluster.wall().sync.pipeline_depth as usize;
        Self {
            what,
            is_from_start,
            begun: VecDeque::new(),
            begun_max,
            swapped_at: 0,
            frame,
            open,
            is_over: false,
        }
    }

    /// Requests that wait for their answer.
    pub fn open(&self) -> &BTreeSet<ClientRequest> {
        &self.open
    }

    /// Returns the next frame to be swapped, and the time at which its turn began: with it, or with
    /// the swap before it.
    pub fn frame_began(&self) -> Option<(FrameId, Micros)> {
        self.begun.front().map(|begun| (begun.frame, begun.at.max(self.swapped_at)))
    }

    /// The core was told this, and decided that.
    ///
    /// # Errors
    /// Says which invariant is broken, where and by what.
    pub fn observe(
        &mut self,
        now: Micros,
        input: &Input,
        outputs: &[Effect],
        cluster: &Cluster,
    ) -> Result<(), String> {
        match input {
            Input::ClientGone { session } => {
                self.open.retain(|job| job.client != *session);
            }
            Input::Request { client, id, .. } => {
                // A client that uses a number twice has itself to blame.
                self.open.insert(ClientRequest { client: *client, id: *id });
            }
            Input::Status { status: ServerMessage::Drawn(drawn), .. } => {
                if let Some(begun) = self.begun.iter_mut().find(|b| b.frame == drawn.frame) {
                    begun.drawn.insert(drawn.channel);
                }
            }
            _ => {}
        }
        let live = || {
            let states = cluster.channel_states().zip(0..);
            let live = states.filter(|((_, state, _, _), _)| *state == ChannelState::Live);
            live.map(|(_, index)| ChannelId(index)).collect::<BTreeSet<_>>()
        };
        for known in self.begun.iter_mut().filter_map(|begun| begun.live.as_mut()) {
            let live = live();
            known.retain(|id| live.contains(id));
        }
        for output in outputs {
            self.look_at(now, output).map_err(|fault| {
                let at_s = now as f64 / 1e6;
                format!("{} at {at_s:.6} s, as {}: {fault}", self.what, words::of_input(input))
            })?;
        }
        for begun in &mut self.begun {
            begun.live.get_or_insert_with(live);
        }
        Ok(())
    }

    fn look_at(&mut self, now: Micros, output: &Effect) -> Result<(), String> {
        match output {
            Effect::Command { to, command } => match &**command {
                Command::Frame(frame) => self.begin(now, frame.frame, to),
                Command::Swap(swap) => self.swap(now, swap.frame, to),
                _ => Ok(()),
            },
            Effect::Answer { to, answer: MessageToClient::Reply { id, .. } } => {
                self.answer(ClientRequest { client: *to, id: *id })
            }
            // Its pictures are collected, and end in an answer, by the manager.
            Effect::Collect { job, .. } => self.answer(*job),
            Effect::Stop | Effect::StopServers { .. } => {
                self.is_over = true;
                self.open.clear();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn begin(&mut self, at: Micros, frame: FrameId, to: &[SessionId]) -> Result<(), String> {
        if let Some(first) = self.begun.front().filter(|_| self.begun.len() == self.begun_max) {
            return Err(format!("frame {frame} begins before frame {} was swapped", first.frame));
        }
        if frame <= self.frame {
            return Err(format!("frame {frame} begins after frame {}", self.frame));
        }
        self.frame = frame;
        let (sent, drawn) = (to.to_vec(), BTreeSet::new());
        self.begun.push_back(Begun { frame, at, sent, live: None, drawn });
        Ok(())
    }

    fn swap(&mut self, now: Micros, frame: FrameId, to: &[SessionId]) -> Result<(), String> {
        self.swapped_at = now;
        let first = self.begun.front().map(|begun| begun.frame);
        // It began before the first input that is known.
        if !self.is_from_start && frame <= self.frame && first.is_none_or(|first| frame < first) {
            return Ok(());
        }
        let Some(begun) = self.begun.pop_front() else {
            return Err(format!("frame {frame} is swapped and has not begun"));
        };
        if begun.frame != frame {
            return Err(format!("frame {frame} is swapped instead of frame {}", begun.frame));
        }
        if let Some(session) = to.iter().find(|session| !begun.sent.contains(session)) {
            return Err(format!("session {} is to show frame {frame} unseen", session.0));
        }
        let live = begun.live.unwrap_or_default();
        if let Some(channel) = live.difference(&begun.drawn).next() {
            return Err(format!("frame {frame} is swapped, and live channel {channel} lacks it"));
        }
        Ok(())
    }

    fn answer(&mut self, job: ClientRequest) -> Result<(), String> {
        let is_known = self.open.remove(&job);
        if is_known || !self.is_from_start || self.is_over {
            return Ok(());
        }
        let (client, id) = (job.client.0, job.id);
        Err(format!("request {id} of session {client} is answered twice, or was never made"))
    }
}
