//! The event loop's part in captures: collects the pictures of servers, and has them stitched.

use std::num::NonZeroU32;
use std::time::Duration;

use polyptych_core::{ClientRequest, SessionId};
use polyptych_protocol::bulk::CaptureChunk;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::{MessageToClient, RequestError};
use polyptych_protocol::server_message::ServerMessage;
use polyptych_wall::ChannelId;
use tokio::time::Instant;

use super::EventLoop;
use crate::capture::CaptureJob;
use crate::capture_sender;

/// Maximum time that a capture waits for its pictures, from the beginning of its frame.
const CAPTURE_TIME_MAX: Duration = Duration::from_secs(30);

impl EventLoop {
    /// Begins to collect the pictures of a frame for a client.
    pub(super) fn begin_collection(
        &mut self,
        job: ClientRequest,
        (frame, side): (FrameId, NonZeroU32),
        channels: &[ChannelId],
        missing: Vec<(String, String)>,
    ) {
        // As it is tuned now: that is what the frame shows.
        let wall = self.cluster.wall();
        match self.pictures.reserve(wall, side) {
            Ok(room) => {
                let wall = (wall, &self.shapes);
                let collection = CaptureJob::new(job, (frame, side), channels, missing, wall, room);
                self.collections.push((Instant::now() + CAPTURE_TIME_MAX, collection));
                self.finish_collections();
            }
            Err(reason) => {
                let reply = Err(RequestError::new(reason));
                self.answer(job.client, MessageToClient::Reply { id: job.id, reply });
            }
        }
    }

    /// Puts a piece of a picture in its place.
    pub(super) fn take_picture(&mut self, from: SessionId, chunk: &CaptureChunk) {
        let now = self.now();
        if !self.cluster.channels_of(from).contains(&chunk.channel) {
            let what = format!("session {}: picture", from.0);
            if let Some(times) = self.repetitions.should_log(now, &what) {
                let tell = || tracing::warn!(times, "a picture of another's channel");
                self.cluster.session_span(from).in_scope(tell);
            }
            return;
        }
        for (_, collection) in &mut self.collections {
            if let Err(reason) = collection.add(chunk) {
                let what = format!("session {}: a picture does not fit", from.0);
                if let Some(times) = self.repetitions.should_log(now, &what) {
                    let tell = || tracing::warn!(reason, times, "a picture does not fit");
                    self.cluster.session_span(from).in_scope(tell);
                }
                collection.mark_missing(&[chunk.channel], &reason);
            }
        }
    }

    /// Captures hear which channels have drawn what, or could not.
    pub(super) fn note_drawing(&mut self, from: SessionId, status: &ServerMessage) {
        if self.collections.is_empty() {
            return;
        }
        let channels = self.cluster.channels_of(from);
        for (_, collection) in &mut self.collections {
            match status {
                ServerMessage::Drawn(drawn) if channels.contains(&drawn.channel) => {
                    collection.note_drawn(drawn.channel, drawn.frame);
                }
                ServerMessage::DrawFailed { channel, frame, reason }
                    if channels.contains(channel) && *frame == collection.frame =>
                {
                    collection.mark_missing(&[*channel], reason);
                }
                _ => {}
            }
        }
    }

    pub(super) fn finish_collections(&mut self) {
        let now = Instant::now();
        for (expires, collection) in &mut self.collections {
            if *expires <= now {
                collection.expire();
            }
        }
        let finished = self.collections.extract_if(.., |(_, collection)| collection.is_complete());
        for (_, collection) in finished {
            let Some(seat) = self.clients.get(&collection.job.client) else { continue };
            let (link, queues) = (seat.link.clone(), self.turns.queues().clone());
            let ClientRequest { client, id } = collection.job;
            tokio::spawn(async move {
                capture_sender::send_capture(collection, link).await;
                queues.finish(client, id);
            });
        }
    }
}
