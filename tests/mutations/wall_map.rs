//! Damaged files of walls through their readers: bytes of all, words of those that are text.

use std::time::{Duration, Instant};

use allocation_counter::measure;
use fastrand::Rng;
use polyptych_wall::warp::CalibrationMap;

use crate::map_file::{KINDS, check};
use crate::mutation::mutate;
use crate::seeds::maps;
use crate::wall_shape::lit;

/// The number of files of each kind.
const FILES: u64 = 1500;

/// Blobs, which need no disk.
const BLOBS: u64 = 50_000;

/// The number of sound blobs of which one is shown.
const SHOWN_SHARE: u64 = 20;

/// Most that one such small file may hold at once: a picture of 4 million pixels, of 16 bits and
/// four components, and the map that it becomes; meshes of as many zeros.
const HELD_MAX: u64 = 1 << 30;

/// Longest time for one file, on a machine that does something else too.
const FILE_TIME_MAX: Duration = Duration::from_mins(1);

/// Words that replace others.
const WORDS: &[&str] = &[
    "0",
    "-1",
    "1",
    "2",
    "3",
    "8192",
    "8193",
    "4294967295",
    "99999999999999999999",
    "nan",
    "inf",
    "1e308",
    "-1e-308",
    "0.5",
    "1/1",
    "-1/-1",
    "9/9",
    "f",
    "v",
    "vt",
    "#",
    "PF",
    "\u{0}",
    "",
];

#[test]
fn damaged_files_of_walls_are_maps_or_one_line() {
    let seeds = maps::all();
    assert_eq!(seeds.len(), KINDS.len());
    for (kind, seed_file) in seeds.iter().enumerate() {
        let name = KINDS[kind].0;
        // A scene has no UV for a screen; its damage goes through the same doors.
        assert!(check(kind, seed_file) || name == "a.glb", "{name}");
        let mut whole = 0;
        for number in 0..FILES {
            let seed = crate::seed().wrapping_add(number);
            let mut rng = Rng::with_seed(seed);
            let bytes = damaged(&mut rng, seed_file);
            let begin = Instant::now();
            let mut is_map = false;
            let info = measure(|| is_map = check(kind, &bytes));
            assert!(info.bytes_max < HELD_MAX, "POLYPTYCH_SEED={seed}: {name}: {info:?}");
            assert!(begin.elapsed() < FILE_TIME_MAX, "POLYPTYCH_SEED={seed}: {name}");
            whole += u64::from(is_map);
        }
        println!("{name}: {whole} of {FILES} are maps");
        let least = match name {
            "a.glb" => 0,
            // The archive's checksums find nearly all damage.
            "a.mpcdi" => 1,
            _ => FILES / 100,
        };
        assert!((least..FILES).contains(&whole), "{name}: {whole}");
    }
}

fn damaged(rng: &mut Rng, file: &[u8]) -> Vec<u8> {
    let mut bytes = file.to_vec();
    if rng.bool() && file.len() < 20_000 {
        for _ in 0..rng.usize(1..3) {
            replace_word(rng, &mut bytes);
        }
    } else {
        mutate(rng, &mut bytes, file);
    }
    bytes
}

/// Another word where one stands between white space, quotes, or brackets of XML.
fn replace_word(rng: &mut Rng, bytes: &mut Vec<u8>) {
    let is_end = |byte: &u8| byte.is_ascii_whitespace() || b"\"<>/=".contains(byte);
    let from = rng.usize(0..bytes.len());
    let start = bytes[..from].iter().rposition(is_end).map_or(0, |at| at + 1);
    let length = bytes[start..].iter().position(is_end).unwrap_or(bytes.len() - start);
    let word = WORDS[rng.usize(0..WORDS.len())];
    bytes.splice(start..start + length, word.bytes());
}

#[test]
fn damaged_blobs_of_maps_are_maps_or_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = polyptych_baker::BakeCache::open(folder.path()).expect("a store");
    let seeds: Vec<Vec<u8>> = maps::all()
        .into_iter()
        .zip(KINDS)
        .filter_map(|(bytes, kind)| {
            let file = folder.path().join(kind.0);
            std::fs::write(&file, bytes).expect("written");
            let go_on = std::sync::atomic::AtomicBool::new(false);
            let baked = polyptych_baker::map::bake_map(&file, kind.1?, &store, &go_on).ok()?;
            Some(store.blobs().read(baked.blob).expect("read").expect("there").to_vec())
        })
        .collect();
    assert_eq!(seeds.len(), 5);
    let (mut whole, mut shown) = (0, 0);
    for number in 0..BLOBS {
        let seed = crate::seed().wrapping_add(number);
        let mut rng = Rng::with_seed(seed);
        let mut bytes = seeds[rng.usize(0..seeds.len())].clone();
        mutate(&mut rng, &mut bytes, &seeds[0]);
        let mut decoded = None;
        let info = measure(|| decoded = Some(CalibrationMap::decode(&bytes)));
        let allowed = 4096 + 8 * bytes.len() as u64;
        assert!(info.bytes_max < allowed, "POLYPTYCH_SEED={seed}: {info:?}");
        match decoded.expect("decoded") {
            Ok(map) => {
                whole += u64::from(map.fault().is_none());
                if whole.is_multiple_of(SHOWN_SHARE) {
                    let begin = Instant::now();
                    shown += u64::from(lit(&map).is_some_and(|pixels| pixels > 0));
                    assert!(begin.elapsed() < FILE_TIME_MAX, "POLYPTYCH_SEED={seed}");
                }
            }
            Err(line) => assert!(!line.contains('\n') && line.len() < 300, "{line}"),
        }
    }
    println!("{shown} of {} sound blobs light something", whole / SHOWN_SHARE);
    assert!(shown > 0, "nothing was lit");
    let share = whole as f64 / BLOBS as f64;
    assert!((0.05..0.95).contains(&share), "{share} of the blobs are maps");
}
