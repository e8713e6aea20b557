//! Random walls survive a round trip; random bytes and random slips end in an error at worst.

use glam::{DVec2, DVec3, UVec2};
use proptest::prelude::*;
use proptest::sample::Index;

use super::{BY_HAND, SMALLEST, parse, to_toml};
use crate::wall::surface::{Plane, Surface};
use crate::wall::{Bezel, Channel, DeadlineRule, Projection, Screen, Wall};

/// A screen before the origin, turned any way that faces it.
#[derive(Debug)]
struct Seed {
    direction: [f64; 3],
    distance_m: f64,
    size_m: [f64; 2],
    own: bool,
    columns: Vec<u32>,
    rows: Vec<u32>,
    gap: [u32; 2],
    bezel: bool,
}

fn seed() -> impl Strategy<Value = Seed> {
    let tiles = || prop::collection::vec(1u32..700, 1..5);
    (
        prop::array::uniform3(-1.0..1.0),
        0.01..100.0,
        prop::array::uniform2(0.01..50.0),
        any::<bool>(),
        (tiles(), tiles()),
        prop::array::uniform2(0u32..20),
        any::<bool>(),
    )
        .prop_map(|(direction, distance_m, size_m, own, (columns, rows), gap, bezel)| Seed {
            direction,
            distance_m,
            size_m,
            own,
            columns,
            rows,
            gap,
            bezel,
        })
}

/// Offsets of tiles along one side, and the side's length.
fn offsets(tiles: &[u32], gap: u32) -> (Vec<u32>, u32) {
    let mut at = 0;
    let offsets = tiles
        .iter()
        .map(|tile| {
            at += tile + gap;
            at - tile - gap
        })
        .collect();
    (offsets, at - gap)
}

fn add_screen(wall: &mut Wall, mut seed: Seed) {
    let index = wall.screens.len();
    let normal = DVec3::from(seed.direction).try_normalize().unwrap_or(DVec3::Z);
    let right = normal.any_orthonormal_vector();
    let up = normal.cross(right);
    let half = DVec2::from(seed.size_m) / 2.0;
    let center = wall.eye - normal * seed.distance_m;
    let plane = Plane {
        lower_left: center - right * half.x - up * half.y,
        lower_right: center + right * half.x - up * half.y,
        upper_left: center - right * half.x + up * half.y,
    };
    let mut screen = Screen::new(&format!("screen.{index}"), Surface::Plane(plane), UVec2::ONE);
    if seed.bezel {
        // Equal tiles, and the metres that these pixels of bezel are.
        seed.columns = vec![seed.columns[0]; seed.columns.len()];
        seed.rows = vec![seed.rows[0]; seed.rows.len()];
        seed.gap = seed.gap.map(|gap| gap / 2 * 2);
    }
    let (xs, width) = offsets(&seed.columns, seed.gap[0]);
    let (ys, height) = offsets(&seed.rows, seed.gap[1]);
    screen.canvas = UVec2::new(width, height);
    let pixels = UVec2::from(seed.gap);
    let asked_m = screen.size_m() / screen.canvas.as_dvec2() * pixels.as_dvec2();
    screen.bezel = (seed.bezel && asked_m != DVec2::ZERO).then_some(Bezel { asked_m, pixels });
    for (y, row) in ys.iter().zip(&seed.rows) {
        for (x, column) in xs.iter().zip(&seed.columns) {
            let at = wall.channels.len();
            let (origin, size) = (UVec2::new(*x, *y), UVec2::new(*column, *row));
            wall.channels.push(Channel {
                server: format!("server_{}", at / 3),
                projection: if seed.own { Projection::Own } else { Projection::Shared },
                ..Channel::tile(&format!("c-{at}"), index as u16, origin, size)
            });
        }
    }
    wall.screens.push(screen);
}

fn wall() -> impl Strategy<Value = Wall> {
    (
        prop::collection::vec(seed(), 1..4),
        prop::array::uniform3(-100.0..100.0),
        (1e-6..1e3, any::<bool>(), 20u32..=60_000, "[ -~é]{1,12}"),
        (1.0..1e9, 1u32..=60_000, 1u32..=60_000),
    )
        .prop_map(|(seeds, eye, (near_m, many, heartbeat_ms, folder), (factor, a, b))| {
            let mut wall = Wall {
                eye: DVec3::from(eye),
                near_m,
                samples: if many { 4 } else { 1 },
                deadline: DeadlineRule { factor, min_ms: a.min(b), max_ms: a.max(b) },
                heartbeat_ms,
                listen: "[::]:1".into(),
                stores: vec![],
                scenes: vec![format!("/x{}", folder.replace(['/', '.'], ""))],
                ..Wall::new("random-wall", vec![], vec![])
            };
            for seed in seeds {
                add_screen(&mut wall, seed);
            }
            wall
        })
}

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

fn mutated() -> impl Strategy<Value = String> {
    let good = prop::sample::select(vec![
        SMALLEST,
        BY_HAND,
        include_str!("../../../../../configs/wall-2x2.toml"),
        include_str!("../../../../../configs/bezel-2x2.toml"),
        include_str!("../../../../../configs/cave-4.toml"),
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

/// As many cases, and no files beside the sources.
fn thousand() -> ProptestConfig {
    ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(thousand())]

    #[test]
    fn walls_survive_a_round_trip(wall in wall()) {
        let text = to_toml(&wall);
        let again = parse(&text, "/walls/w.toml".as_ref());
        prop_assert_eq!(again.as_ref(), Ok(&wall), "{}", text);
    }

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
