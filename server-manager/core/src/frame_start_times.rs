//! The beginnings of the newest frames: those of channels that are late are told from them.

use std::collections::VecDeque;

use polyptych_protocol::ids::FrameId;
use serde::{Deserialize, Serialize};

use super::Micros;
use super::reduction::Reduction;

/// Frames whose beginning is remembered: what a late channel may be behind and still be measured,
/// two seconds of a wall at 240 frames per second.
const FRAMES_REMEMBERED: usize = 480;

/// The beginnings of the newest frames and the reductions that they were drawn with, `None` where
/// they show a test pattern: its times say nothing of the scene's. Their numbers have no gaps.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct FrameStartTimes(VecDeque<(Micros, Option<Reduction>)>);

impl FrameStartTimes {
    pub fn add(&mut self, now: Micros, reduction: Option<Reduction>) {
        if self.0.len() == FRAMES_REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((now, reduction));
    }

    /// The beginning of `frame` and its reduction, the newest one being `newest`.
    pub fn of(&self, frame: FrameId, newest: FrameId) -> Option<(Micros, Option<Reduction>)> {
        let back = usize::try_from(newest.0.checked_sub(frame.0)?).ok()?;
        self.0.get(self.0.len().checked_sub(back + 1)?).copied()
    }
}
