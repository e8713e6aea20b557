//! Digests of the core's decisions, to compare them.

use polyptych_core::Effect;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::feedback::FrameFeedback;
use polyptych_protocol::request::{MessageToClient, Response};
use serde::{Deserialize, Serialize};

/// Outputs of one input that are listed; more are only in the digest.
const KINDS_MAX: usize = 32;

/// A digest of the effects of one input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EffectDigest {
    /// A letter for each output, for a person who looks for a difference.
    pub kinds: String,
    /// The digest of all outputs, in order.
    pub digest: u64,
}

impl EffectDigest {
    /// Returns the digest of these outputs and of the refusal, if a server was refused; `None` if
    /// there is neither.
    ///
    /// Measurements are left out: what was measured before a checkpoint is not in it.
    pub fn from_effects<'a>(
        outputs: impl Iterator<Item = &'a Effect>,
        refusal: Option<&str>,
    ) -> Option<Self> {
        let (mut kinds, mut bytes) = (String::new(), Vec::new());
        for output in outputs {
            let (kind, part) = describe(output);
            if kinds.len() < KINDS_MAX {
                kinds.push(kind);
            }
            bytes.push(kind as u8);
            bytes.extend_from_slice(&part);
        }
        if let Some(refusal) = refusal {
            kinds.push('x');
            bytes.extend_from_slice(refusal.as_bytes());
        }
        if kinds.is_empty() {
            return None;
        }
        let BlobHash(hash) = BlobHash::of(&bytes);
        let digest = hash.iter().take(8).fold(0, |sum, &byte| (sum << 8) | u64::from(byte));
        Some(Self { kinds, digest })
    }

    /// Returns the meaning of its letters, in words.
    pub fn describe(&self) -> String {
        let word = |kind| match kind {
            'c' => "a command",
            'a' => "an answer",
            'f' => "feedback",
            'i' => "an import",
            'o' => "a session",
            'p' => "a capture",
            'l' => "a server let go",
            'r' => "something to remember",
            's' => "the end",
            'S' => "the end of servers",
            'x' => "a refusal",
            _ => "something unknown",
        };
        self.kinds.chars().map(word).collect::<Vec<_>>().join(", ")
    }
}

fn describe(output: &Effect) -> (char, Vec<u8>) {
    match output {
        Effect::Command { to, command } => ('c', polyptych_codec::encode(&(to, command)).to_vec()),
        Effect::Answer { to, answer: MessageToClient::Feedback(feedback) } => {
            ('f', polyptych_codec::encode(&(to, frame(feedback))).to_vec())
        }
        Effect::Answer { to, answer: MessageToClient::Reply { id, reply } } => {
            let head = polyptych_codec::encode(&(to, id));
            let reply = match reply {
                Ok(Response::Frame(feedback)) => polyptych_codec::encode(&frame(feedback)),
                Ok(Response::Status(status)) => {
                    polyptych_codec::encode(&(status.revision, status.digest, status.frame))
                }
                Ok(Response::Edited(edited)) => polyptych_codec::encode(&(
                    edited.revision,
                    &edited.created,
                    edited.frames,
                    frame(&edited.feedback),
                )),
                Ok(Response::Tuned(tuned)) => {
                    polyptych_codec::encode(&(tuned.revision, tuned.frames, frame(&tuned.feedback)))
                }
                Ok(Response::Statistics(_)) => polyptych_codec::encode(&"statistics"),
                other => polyptych_codec::encode(other),
            };
            ('a', [&head[..], &reply[..]].concat())
        }
        Effect::Answer { to, answer } => ('a', polyptych_codec::encode(&(to, answer)).to_vec()),
        Effect::Import { job, path, scene } => {
            ('i', polyptych_codec::encode(&(job, path, scene)).to_vec())
        }
        Effect::OpenSession { job, name } => ('o', polyptych_codec::encode(&(job, name)).to_vec()),
        Effect::Collect { job, frame, side, channels, missing } => {
            ('p', polyptych_codec::encode(&(job, frame, side, channels, missing)).to_vec())
        }
        Effect::Close { session, reason } => {
            ('l', polyptych_codec::encode(&(session, reason)).to_vec())
        }
        Effect::Remember(memory) => ('r', polyptych_codec::encode(&**memory).to_vec()),
        Effect::Stop => ('s', Vec::new()),
        Effect::StopServers { job } => ('S', polyptych_codec::encode(job).to_vec()),
    }
}

/// Returns what the core decided about a frame.
fn frame(feedback: &FrameFeedback) -> impl Serialize {
    let states: Vec<_> = feedback.channels.iter().map(|c| (c.state, c.draw_us)).collect();
    (feedback.frame, feedback.revision, feedback.frame_us, states)
}
