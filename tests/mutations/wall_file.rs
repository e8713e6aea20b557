//! Damaged wall files: bytes, tokens and lines. Each is a wall, or an error of one line.

use std::time::{Duration, Instant};

use allocation_counter::measure;
use fastrand::Rng;

use crate::mutation::mutate;
use crate::seeds::walls::SEEDS;
use crate::wall_text;

const FILES: u64 = 20_000;

/// Maximum bytes held at once, for each byte of a file: serde and the error's positions take some
/// hundred.
const HELD_PER_BYTE: u64 = 2048;

/// And beyond that: a wall of a thousand channels, which a short file may ask for.
const HELD_ANYWAY: u64 = 8 << 20;

/// Longest time for one file; it takes a millisecond.
const FILE_TIME_MAX: Duration = Duration::from_secs(10);

/// Tokens that replace others.
const TOKENS: &[&str] = &[
    "0",
    "-1",
    "1",
    "3",
    "65536",
    "8193",
    "131073",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "99999999999999999999",
    "nan",
    "-inf",
    "inf",
    "1e308",
    "1e-308",
    "0.0",
    "\"\"",
    "\"../x\"",
    "\"\\u0000\"",
    "\"a\\nb\"",
    "true",
    "[]",
    "[[]]",
    "{}",
    "[1, 2, 3, 4]",
    "1979-05-27",
    "'''x\ny'''",
    "= =",
    "]",
    "\"",
    "#",
    "\u{202e}",
    "columns",
];

#[test]
fn damaged_wall_files_are_walls_or_one_line() {
    let mut walls = 0;
    for number in 0..FILES {
        let seed = crate::seed().wrapping_add(number);
        let mut rng = Rng::with_seed(seed);
        let text = damaged(&mut rng);
        let begin = Instant::now();
        let mut is_wall = false;
        let info = measure(|| is_wall = wall_text::check(&text));
        let shown = String::from_utf8_lossy(&text);
        let allowed = HELD_ANYWAY + HELD_PER_BYTE * text.len() as u64;
        assert!(info.bytes_max < allowed, "POLYPTYCH_SEED={seed}: {info:?}\n{shown}");
        assert!(begin.elapsed() < FILE_TIME_MAX, "POLYPTYCH_SEED={seed}:\n{shown}");
        walls += u64::from(is_wall);
    }
    let share = walls as f64 / FILES as f64;
    assert!((0.05..0.95).contains(&share), "{share} of the files are walls");
}

fn damaged(rng: &mut Rng) -> Vec<u8> {
    let mut text = SEEDS[rng.usize(0..SEEDS.len())].to_owned();
    for _ in 0..rng.usize(1..3) {
        match rng.u8(0..8) {
            0..4 => replace_value(rng, &mut text),
            4 => change_lines(rng, &mut text),
            5 => {
                let other = SEEDS[rng.usize(0..SEEDS.len())];
                text.push_str(&other[other.floor_char_boundary(rng.usize(0..other.len()))..]);
            }
            6 => {
                let mut bytes = text.into_bytes();
                mutate(rng, &mut bytes, SEEDS[0].as_bytes());
                text = String::from_utf8_lossy(&bytes).into_owned();
            }
            _ => nest(rng, &mut text),
        }
    }
    text.into_bytes()
}

/// Another value behind one of the "=" or in one of the lists.
fn replace_value(rng: &mut Rng, text: &mut String) {
    let starts: Vec<usize> =
        text.match_indices(['=', ',', '[']).map(|(at, sign)| at + sign.len()).collect();
    if starts.is_empty() {
        return;
    }
    let start = starts[rng.usize(0..starts.len())];
    let end = text[start..].find([',', ']', '\n', '#']).map_or(text.len(), |end| start + end);
    text.replace_range(start..end, TOKENS[rng.usize(0..TOKENS.len())]);
}

/// A line is missing, twice there, or stands elsewhere.
fn change_lines(rng: &mut Rng, text: &mut String) {
    let mut lines: Vec<&str> = text.lines().collect();
    if lines.is_empty() {
        return;
    }
    let (at, to) = (rng.usize(0..lines.len()), rng.usize(0..lines.len()));
    let line = lines[at];
    match rng.u8(0..3) {
        0 => drop(lines.remove(at)),
        1 => lines.insert(to, line),
        _ => lines.swap(at, to),
    }
    *text = lines.join("\n");
}

/// Tables in lists in tables, or a list that is long.
fn nest(rng: &mut Rng, text: &mut String) {
    let depth = 1 << rng.u8(0..13);
    let addition = match rng.u8(0..4) {
        0 => format!("\nx = {}{}\n", "[".repeat(depth), "]".repeat(depth)),
        1 => format!("\nx = {}1{}\n", "{ a = ".repeat(depth), "}".repeat(depth)),
        2 => format!("\n[{}x]\n", "a.".repeat(depth)),
        _ => format!("\nx = [{}]\n", "1, ".repeat(depth)),
    };
    text.push_str(&addition);
}
