//! Random walls survive a round trip; random bytes and random slips end in an error at worst.

use polyptych_wall::Wall;
use proptest::prelude::*;
use proptest::sample::Index;

use super::generated::wall;
use super::{BY_HAND, SMALLEST, parse, to_toml};

/// Cuts a text into words, numbers, marks and blanks.
fn tokens(text: &str) -> Vec<String> {
    let kind = |c: char| match c {
        c if c.is_alphanumeric() || matches!(c, '_' | '-' | '.') => 0,
        '\n' => 1,
        c if c.is_whitespace() => 2,
        c => c as u32,
    };
    let mut tokens: Vec<String> = Vec::new();
    let mut last = None;
    for c in text.chars() {
        match tokens.last_mut() {
            Some(token) if last == Some(kind(c)) => token.push(c),
            _ => tokens.push(c.to_string()),
        }
        last = Some(kind(c));
    }
    tokens
}

const ODD: [&str; 16] = [
    "-1",
    "1e300",
    "nan",
    "inf",
    "0",
    "4294967295",
    "18446744073709551616",
    "\"\"",
    "[]",
    "{}",
    "true",
    "[[",
    "1979-05-27",
    "\u{0}",
    "é",
    "'''",
];

pub(crate) fn mutated() -> impl Strategy<Value = String> {
    let good = prop::sample::select(vec![
        SMALLEST,
        BY_HAND,
        include_str!("../../../../configs/wall-2x2.toml"),
        include_str!("../../../../configs/bezel-2x2.toml"),
        include_str!("../../../../configs/cave-4.toml"),
        include_str!("../../../../configs/dome-5.toml"),
        super::EVERY_KEY,
    ]);
    let slip = (0..4u8, any::<Index>(), any::<Index>());
    (good, any::<bool>(), prop::collection::vec(slip, 1..6)).prop_map(|(good, lines, slips)| {
        let mut parts = if lines {
            good.split_inclusive('\n').map(str::to_owned).collect()
        } else {
            tokens(good)
        };
        for (kind, at, other) in slips {
            if parts.is_empty() {
                break;
            }
            let (at, odd) = (at.index(parts.len()), ODD[other.index(ODD.len())]);
            let other = other.index(parts.len());
            match kind {
                0 => drop(parts.remove(at)),
                1 => parts.insert(at, parts[other].clone()),
                2 => parts[at] = odd.to_owned(),
                _ => parts.swap(at, other),
            }
        }
        parts.concat()
    })
}

/// Whatever it says, it must not panic, and errors must have a place.
fn survives(text: &str) -> Result<(), TestCaseError> {
    match parse(text, "w.toml".as_ref()) {
        Ok(wall) => {
            let again = parse(&to_toml(&wall), "w.toml".as_ref());
            prop_assert_eq!(again.as_ref(), Ok(&wall));
        }
        Err(error) => {
            let lines = text.split('\n').count() as u32;
            prop_assert!((1..=lines).contains(&error.line()), "{error}");
            prop_assert!(error.column() >= 1 && !error.remedy().is_empty(), "{error}");
        }
    }
    Ok(())
}

/// Returns whether no pixel is so large, seen from so near, that a wall file with it is refused.
fn is_far_enough(wall: &Wall) -> bool {
    wall.channels.iter().all(|channel| {
        let screen = wall.screen_of(channel);
        let distance_m = screen.frustum(wall.eye).map_or(f64::INFINITY, |seen| seen.distance_m);
        screen.eye_distance_min_m(channel, wall.eye).is_none_or(|least_m| distance_m >= least_m)
    })
}

/// Returns a configuration with 1,000 cases that writes no files beside the sources.
fn thousand() -> ProptestConfig {
    ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    // A wall has up to 96 channels, each with all that can be adjusted.
    #![proptest_config(ProptestConfig { cases: 256, ..thousand() })]

    #[test]
    fn walls_survive_a_round_trip(wall in wall()) {
        prop_assume!(is_far_enough(&wall));
        let text = to_toml(&wall);
        let again = parse(&text, "/walls/w.toml".as_ref());
        prop_assert_eq!(again.as_ref(), Ok(&wall), "{}", text);
    }
}

proptest! {
    #![proptest_config(thousand())]

    #[test]
    fn slips_never_panic(text in mutated()) {
        survives(&text)?;
    }

    #[test]
    fn bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        survives(&String::from_utf8_lossy(&bytes))?;
    }

    #[test]
    fn toml_like_texts_never_panic(text in "([a-z\\[\\]{}=.,\"'# 0-9\\-\\\\é]|\n){0,120}") {
        survives(&text)?;
    }
}
