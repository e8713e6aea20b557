//! Coverage-guided: a message of any kind, its first byte the kind, and who it is for.
//!
//! README.md says how to run it.
#![no_main]

#[path = "../../mutations/message.rs"]
mod message;
#[path = "../../mutations/receiver.rs"]
mod receiver;
#[path = "../../mutations/seeds.rs"]
mod seeds;

use std::cell::RefCell;

use libfuzzer_sys::fuzz_target;
use message::{KINDS, Message};
use receiver::Receiver;

/// Inputs after which the receiver is a new one, so that a finding needs few of them.
const INPUTS_MAX: u32 = 1000;

thread_local! {
    static RECEIVER: RefCell<(u32, Receiver)> = RefCell::new((0, Receiver::new()));
}

fuzz_target!(|data: &[u8]| {
    let Some((&first, bytes)) = data.split_first() else { return };
    let kind = KINDS[first as usize % KINDS.len()];
    let Some(message) = Message::decode(kind, bytes) else { return };
    message.check_stable(kind);
    RECEIVER.with_borrow_mut(|(inputs, receiver)| {
        *inputs += 1;
        if *inputs == INPUTS_MAX {
            (*inputs, *receiver) = (0, Receiver::new());
        }
        receiver.take(message, u64::from(first / 9) + u64::from(*inputs));
    });
});
