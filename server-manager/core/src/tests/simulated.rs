//! The simulated wall: thousands of random schedules with a clock, a network, render servers,
//! clients and managers of our own, each from one number.
//!
//! ```text
//! cargo test -p polyptych-core simulated                                 10,000 schedules
//! POLYPTYCH_SCHEDULES=1000000 cargo test -p polyptych-core --release simulated -- --nocapture
//! POLYPTYCH_SEED=7 cargo test -p polyptych-core simulated -- --nocapture   one, in all steps
//! POLYPTYCH_FIRST_SEED=5000000 ...                                       other schedules
//! ```

#[expect(dead_code, reason = "the render server's own file; its shared clock is for threads")]
#[expect(clippy::disallowed_methods, reason = "render servers have a clock; tests give theirs")]
#[path = "../../../../render-server/src/clock.rs"]
mod clock;
mod coverage;
mod dice;
mod invariant;
mod manager;
mod network;
// What the real servers run, so that the simulated ones can't differ from them.
#[path = "../../../../render-server/src/frame_scheduler.rs"]
mod playback;
mod promise;
mod render;
mod schedule;
mod server;
mod world;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use coverage::Coverage;

/// Schedules of an ordinary test run.
const SCHEDULES_DEFAULT: u64 = 10_000;

fn number(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{variable} is a number, not {text:?}")))
}

fn check(seed: u64, is_told: bool) -> Result<Coverage, String> {
    let run = catch_unwind(AssertUnwindSafe(|| schedule::run(seed, is_told)));
    let run = run.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(format!("a panic: {}", text.unwrap_or("without a word")))
    });
    run.map_err(|fault| {
        format!(
            "seed {seed}: {fault}\nthis one alone, told step by step:\n    POLYPTYCH_SEED={seed} \
             cargo test -p polyptych-core simulated -- --nocapture"
        )
    })
}

#[test]
fn random_schedules_keep_every_invariant() {
    if let Some(seed) = number("POLYPTYCH_SEED") {
        let coverage = check(seed, true).unwrap_or_else(|fault| panic!("{fault}"));
        coverage.print();
        return;
    }
    let first = number("POLYPTYCH_FIRST_SEED").unwrap_or(0);
    let end = first + number("POLYPTYCH_SCHEDULES").unwrap_or(SCHEDULES_DEFAULT);
    println!("seeds {first} to {}", end - 1);
    let (next, sum) = (AtomicU64::new(first), Mutex::new(Coverage::default()));
    let faults = Mutex::new(Vec::new());
    let work = || {
        let mut coverage = Coverage::default();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= end || faults.lock().unwrap().len() >= 5 {
                break;
            }
            match check(seed, false) {
                Ok(one) => coverage.add(&one),
                Err(fault) => faults.lock().unwrap().push(fault),
            }
        }
        sum.lock().unwrap().add(&coverage);
    };
    thread::scope(|scope| {
        for index in 0..thread::available_parallelism().map_or(2, usize::from) {
            let named = thread::Builder::new().name(format!("wall {index}"));
            named.spawn_scoped(scope, work).unwrap();
        }
    });
    let faults = faults.into_inner().unwrap();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    let sum = sum.into_inner().unwrap();
    sum.print();
    if sum.schedules >= SCHEDULES_DEFAULT {
        sum.assert_wide();
    }
}

/// Seeds that broke the core as it was, by what was wrong with it; `found.rs` tells each as a
/// short story.
const FOUND: [(u64, &str); 11] = [
    (
        1125747,
        "a wall that was late as a whole forgot its slower half: the fast one ended each frame",
    ),
    (1, "a frame that a change overtook waited for its deadline, and all were called late"),
    (12, "the same on a wall of several servers"),
    (19, "a server was told to show what it had just been found to have drawn wrong"),
    (
        11,
        "a frame was sent to servers that had not prepared its state; a server held a wrong state",
    ),
    (21, "a late channel turned live within a frame that did not wait for it"),
    (22, "a server that once could not prepare was never asked again"),
    (102, "a late channel slower than the others never came back"),
    (195, "the same, where every server had failed"),
    (21156, "a report for the connection before was taken for an answer on this one"),
    (6813, "a wrong state was not noticed while a change was overtaking a frame"),
];

#[test]
fn seeds_that_broke_it_once_break_it_no_more() {
    for (seed, what) in FOUND {
        if let Err(fault) = check(seed, false) {
            panic!("again: {what}\n{fault}");
        }
    }
}
