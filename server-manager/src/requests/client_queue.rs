//! The requests of one client: in turn, or queued with a priority.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

use polyptych_protocol::delivery::Delivery;
use polyptych_protocol::ids::RequestId;

use super::Asked;

/// The requests of one client that wait.
#[derive(Debug, Default)]
pub(super) struct ClientQueue {
    immediate: VecDeque<Asked>,
    /// By falling priority, then as they came.
    queued: BTreeMap<(Reverse<u8>, u64), Asked>,
    /// The number of the next queued one.
    next: u64,
    /// The queued request that was begun and has no answer yet.
    under_way: Option<RequestId>,
    /// All requests that were begun and have no answer yet.
    unanswered: BTreeSet<RequestId>,
}

impl ClientQueue {
    pub fn push(&mut self, asked: Asked) {
        match &asked {
            Asked::Call(call, _) => {
                if let Delivery::Queued { priority } = call.delivery {
                    self.queued.insert((Reverse(priority), self.next), asked);
                    self.next += 1;
                    return;
                }
            }
            Asked::Gone(_) => self.queued.clear(),
            Asked::Beyond(_) => {}
        }
        self.immediate.push_back(asked);
    }

    /// The next request, if any may begin.
    pub fn front(&self) -> Option<&Asked> {
        let queued = || self.queued.values().next().filter(|_| self.under_way.is_none());
        self.immediate.front().or_else(queued)
    }

    /// Takes what is next.
    pub fn pop(&mut self) -> Option<Asked> {
        let immediate = self.immediate.pop_front();
        let is_queued = immediate.is_none();
        if is_queued && self.under_way.is_some() {
            return None;
        }
        let asked = immediate.or_else(|| self.queued.pop_first().map(|(_, asked)| asked))?;
        match &asked {
            Asked::Call(call, _) => {
                self.unanswered.insert(call.id);
                if is_queued {
                    self.under_way = Some(call.id);
                }
            }
            Asked::Beyond(_) => {}
            // It gets no answer any more.
            Asked::Gone(_) => {
                self.unanswered.clear();
                self.under_way = None;
            }
        }
        Some(asked)
    }

    /// Returns whether this was the answer that a queued request waited for.
    pub fn finish(&mut self, id: RequestId) -> bool {
        self.unanswered.remove(&id);
        let is_it = self.under_way == Some(id);
        if is_it {
            self.under_way = None;
        }
        is_it
    }

    /// Returns whether there is nothing to be kept of the client.
    pub fn is_empty(&self) -> bool {
        self.immediate.is_empty() && self.queued.is_empty() && self.unanswered.is_empty()
    }
}
