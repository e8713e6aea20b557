//! Damage that finds bugs in binary formats: bits, lengths, cuts, splices, tags, numbers.

use fastrand::Rng;

/// Varints of bincode: the beginnings of those that are 2, 4 and 8 bytes long, the largest of each,
/// and counts around the limits.
const NUMBERS: &[&[u8]] = &[
    &[0],
    &[1],
    &[250],
    &[251, 251, 0],
    &[251, 255, 255],
    &[252, 0, 0, 64, 0],
    &[252, 255, 255, 255, 255],
    &[253, 0, 0, 0, 32, 0, 0, 0, 0],
    &[253, 255, 255, 255, 255, 255, 255, 255, 127],
    &[253, 255, 255, 255, 255, 255, 255, 255, 255],
    &[254],
    &[255],
];

/// Floats that arithmetic does not like.
const FLOATS: &[f64] =
    &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, -0.0, 1e300];

/// Changes bytes in one or two ways, so that much of it still is a message; `other` is what is
/// spliced in.
pub fn mutate(rng: &mut Rng, bytes: &mut Vec<u8>, other: &[u8]) {
    for _ in 0..rng.usize(1..3) {
        change(rng, bytes, other);
    }
}

fn change(rng: &mut Rng, bytes: &mut Vec<u8>, other: &[u8]) {
    if bytes.is_empty() {
        bytes.extend_from_slice(other);
        return;
    }
    let at = rng.usize(0..bytes.len());
    match rng.u8(0..12) {
        0 => bytes[at] ^= 1 << rng.u8(0..8),
        1 => bytes[at] = rng.u8(..),
        // A tag or a small count of another variant.
        2 => bytes[at] = rng.u8(0..18),
        3 => bytes.truncate(at),
        4 => {
            let run: Vec<u8> = (0..rng.usize(1..9)).map(|_| rng.u8(..)).collect();
            bytes.splice(at..at, run);
        }
        5 => {
            let end = (at + rng.usize(1..9)).min(bytes.len());
            bytes.drain(at..end);
        }
        6 | 7 => {
            let number = NUMBERS[rng.usize(0..NUMBERS.len())];
            let end = (at + if rng.bool() { 1 } else { number.len() }).min(bytes.len());
            bytes.splice(at..end, number.iter().copied());
        }
        8 => {
            let float = FLOATS[rng.usize(0..FLOATS.len())];
            let whole = float.to_le_bytes();
            let half = (float as f32).to_le_bytes();
            let raw: &[u8] = if rng.bool() { &whole } else { &half };
            let end = (at + raw.len()).min(bytes.len());
            bytes.splice(at..end, raw.iter().copied());
        }
        9 => {
            let from = rng.usize(0..=other.len());
            bytes.truncate(at);
            bytes.extend_from_slice(&other[from..]);
        }
        10 => {
            // Many of the same: lists that hold what their count says.
            let end = (at + rng.usize(1..40)).min(bytes.len());
            let part = bytes[at..end].to_vec();
            for _ in 0..rng.usize(1..8) {
                bytes.splice(at..at, part.iter().copied());
            }
        }
        _ => {
            let value = rng.u8(..);
            let end = (at + rng.usize(1..17)).min(bytes.len());
            bytes[at..end].fill(value);
        }
    }
}
