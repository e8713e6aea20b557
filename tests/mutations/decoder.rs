//! A million mutated frames, cut at random places, on two threads: framing, decoder, and behind
//! it the manager's core and the render server's state.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::sync_channel;
use std::thread::Builder;
use std::time::{Duration, Instant};

use allocation_counter::measure;
use bytes::{Bytes, BytesMut};
use fastrand::Rng;
use polyptych_protocol::limits::MESSAGE_BYTES_MAX;
use tokio_util::codec::Decoder;

use crate::message::{KINDS, Kind, Message};
use crate::mutation::mutate;
use crate::receiver::Receiver;
use crate::seeds::messages;
use crate::server::{Server, show};

/// The number of frames, as the issue has it.
const FRAMES: u64 = 1_000_000;

/// On as many threads; a hosted runner has two cores.
const THREADS: u64 = 2;

/// Frames that one manager and one server take before they begin anew, so that a failure has a
/// short history.
const FRAMES_PER_LIFE: u64 = 2500;

/// Maximum bytes that decoding holds at once, for each byte of the message: an empty string takes
/// one byte on the wire and 24 in memory, in a list that doubles as it grows.
const HELD_PER_BYTE: u64 = 128;

/// And beyond that: 64 KiB for one string that is cut short, as [`codec`] lets it claim, and 1 MiB
/// for each of three nested lists, which serde makes room for before their elements come: clips,
/// channels and keys.
const HELD_ANYWAY: u64 = (64 << 10) + (3 << 20);

/// Longest time for one message, decoder and core together: thousands of times the usual, since
/// the machine may do something else meanwhile.
const MESSAGE_TIME_MAX: Duration = Duration::from_secs(5);

/// Longest time for all: two orders of magnitude more than it takes.
const ALL_TIME_MAX: Duration = Duration::from_mins(10);

/// The counts of one thread's frames.
#[derive(Debug, Default)]
struct Tally {
    frames: u64,
    decoded: u64,
    held_max: u64,
    slowest: Duration,
}

/// One end of a connection: what comes, in pieces.
struct Line {
    seeds: Vec<(Kind, Bytes)>,
    receiver: Receiver,
    server: Server,
}

#[test]
fn a_million_mutated_frames_are_taken_or_refused() {
    let seed = crate::seed();
    let (sender, tallies) = sync_channel(THREADS as usize);
    for thread in 0..THREADS {
        let sender = sender.clone();
        let work = move || {
            let first = seed.wrapping_add(thread * FRAMES / THREADS);
            let _ = sender.send(run(first, FRAMES / THREADS));
        };
        Builder::new().name(format!("frames-{thread}")).spawn(work).expect("a thread");
    }
    drop(sender);
    let deadline = Instant::now() + ALL_TIME_MAX;
    let mut all = Tally::default();
    for _ in 0..THREADS {
        let left = deadline.saturating_duration_since(Instant::now());
        let tally = tallies.recv_timeout(left).expect("a thread hangs or has failed, see above");
        all.frames += tally.frames;
        all.decoded += tally.decoded;
        all.held_max = all.held_max.max(tally.held_max);
        all.slowest = all.slowest.max(tally.slowest);
    }
    println!("{all:?}");
    assert_eq!(all.frames, FRAMES);
    // Mutations that leave nothing valid, or change nothing, would test nothing behind them.
    let share = all.decoded as f64 / all.frames as f64;
    assert!((0.1..0.9).contains(&share), "{share} of the frames can be decoded");
}

fn run(first: u64, count: u64) -> Tally {
    let mut tally = Tally::default();
    let mut line = Line::new();
    for number in 0..count {
        if number.is_multiple_of(FRAMES_PER_LIFE) {
            line = Line::new();
        }
        let seed = first.wrapping_add(number);
        let mut rng = Rng::with_seed(seed);
        let (kind, bytes) = line.pick(&mut rng);
        let begin = Instant::now();
        let taken = catch_unwind(AssertUnwindSafe(|| line.take(kind, &bytes, &mut rng)));
        tally.slowest = tally.slowest.max(begin.elapsed());
        match taken {
            Ok((decoded, held)) => {
                tally.frames += 1;
                tally.decoded += decoded;
                tally.held_max = tally.held_max.max(held);
            }
            Err(panic) => {
                eprintln!("POLYPTYCH_SEED={seed}: {kind:?} {bytes:02x?}");
                resume_unwind(panic);
            }
        }
        assert!(tally.slowest < MESSAGE_TIME_MAX, "POLYPTYCH_SEED={seed}: {kind:?} {bytes:02x?}");
    }
    tally
}

impl Line {
    fn new() -> Self {
        Self { seeds: messages::all(), receiver: Receiver::new(), server: Server::new() }
    }

    /// A mutated message, and what it will be taken for.
    fn pick(&self, rng: &mut Rng) -> (Kind, Vec<u8>) {
        let (mut kind, bytes) = self.seeds[rng.usize(0..self.seeds.len())].clone();
        let other = &self.seeds[rng.usize(0..self.seeds.len())].1;
        if rng.u8(0..16) == 0 {
            kind = KINDS[rng.usize(0..KINDS.len())];
        }
        let mut bytes = bytes.to_vec();
        mutate(rng, &mut bytes, other);
        (kind, bytes)
    }

    /// Takes one frame as it would come from a socket. Gives how many messages it held, and how
    /// many bytes were held at once to find that out.
    fn take(&mut self, kind: Kind, bytes: &[u8], rng: &mut Rng) -> (u64, u64) {
        let mut frame = polyptych_codec::framed(&Bytes::copy_from_slice(bytes)).to_vec();
        if rng.u8(0..8) == 0 {
            // The length itself, or what follows it.
            mutate(rng, &mut frame, bytes);
        }
        let mut framing = polyptych_protocol::framing::frames(MESSAGE_BYTES_MAX);
        let (mut stream, mut decoded, mut held) = (BytesMut::new(), 0, 0);
        let mut rest = &frame[..];
        while !rest.is_empty() {
            let (piece, behind) = rest.split_at(rng.usize(1..=rest.len()));
            rest = behind;
            stream.extend_from_slice(piece);
            loop {
                let mut next = Ok(None);
                let info = measure(|| next = framing.decode(&mut stream));
                // Room for the frame that is announced, and no more than a message may have.
                assert!(info.bytes_max <= 2 * MESSAGE_BYTES_MAX as u64, "{info:?}");
                match next {
                    // A length beyond the limit: the connection ends.
                    Err(_) => return (decoded, held),
                    Ok(None) => break,
                    Ok(Some(message)) => {
                        let (count, bytes) = self.decode(kind, &message, rng.u64(..));
                        decoded += count;
                        held = held.max(bytes);
                    }
                }
            }
        }
        (decoded, held)
    }

    fn decode(&mut self, kind: Kind, bytes: &[u8], chance: u64) -> (u64, u64) {
        let mut message = None;
        let info = measure(|| message = Message::decode(kind, bytes));
        let allowed = HELD_ANYWAY + HELD_PER_BYTE * bytes.len() as u64;
        assert!(info.bytes_max <= allowed, "{info:?} for {} bytes", bytes.len());
        let Some(message) = message else { return (0, info.bytes_max) };
        message.check_stable(kind);
        match message {
            Message::Command(command) => self.server.obey(*command),
            Message::Manifest(scene) => {
                show(&scene);
                self.receiver.take(Message::Manifest(scene), chance);
            }
            message => self.receiver.take(message, chance),
        }
        (1, info.bytes_max)
    }
}

/// Every seed is what it says, or nothing was tested.
#[test]
fn seeds_are_valid() {
    for (kind, bytes) in messages::all() {
        let message = Message::decode(kind, &bytes);
        assert!(message.is_some(), "{kind:?} {bytes:02x?}");
    }
    let missing: Vec<_> =
        KINDS.iter().filter(|kind| !messages::all().iter().any(|(k, _)| k == *kind)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
