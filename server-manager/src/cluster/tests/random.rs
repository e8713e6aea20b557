//! Random schedules: whatever happens in whatever order, the invariants hold.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use proptest::prelude::*;

use super::*;

#[derive(Clone, Debug)]
enum Step {
    Order,
    Draw(u32),
    Wait(Micros),
    Kill(u32),
    Join(u32),
    Prepare(u32),
    Open,
    Import(bool),
    Close,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => Just(Step::Order),
        6 => (0..3u32).prop_map(Step::Draw),
        3 => (0..200_000u64).prop_map(Step::Wait),
        1 => (0..3u32).prop_map(Step::Kill),
        2 => (0..3u32).prop_map(Step::Join),
        4 => (0..3u32).prop_map(Step::Prepare),
        1 => Just(Step::Open),
        2 => any::<bool>().prop_map(Step::Import),
        1 => Just(Step::Close),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Whatever happens in whatever order: frames are swapped in order and once, the wall goes on
    /// within the longest deadline, and every request gets exactly one answer.
    #[test]
    fn random_schedules_keep_the_invariants(steps in proptest::collection::vec(step(), 1..120)) {
        let mut stage = Stage::empty(3);
        let mut sessions: BTreeMap<u32, SessionId> = BTreeMap::new();
        let mut next_session = 0;
        let mut asked = Vec::new();
        for step in steps {
            match step {
                Step::Order => asked.push(stage.order_frame()),
                Step::Draw(c) => if let Some(&session) = sessions.get(&c) {
                    let digest = stage.replicas.get(&session).map_or(Digest(0), Replica::digest);
                    let drawn = Drawn { digest, ..stage.drawn(c) };
                    if stage.frames.iter().any(|(to, f)| *to == session && f.frame == drawn.frame) {
                        stage.say(session, Status::Drawn(drawn));
                    }
                },
                Step::Wait(micros) => stage.wait(micros),
                Step::Kill(c) => if let Some(session) = sessions.remove(&c) {
                    stage.replicas.remove(&session);
                    stage.prepares.retain(|(to, _)| *to != session);
                    stage.cluster.handle_server_gone(stage.now, session, "killed");
                    stage.read();
                },
                Step::Join(c) => if let Entry::Vacant(free) = sessions.entry(c) {
                    next_session += 1;
                    stage.join(SessionId(next_session), c).expect("the channel is free");
                    free.insert(SessionId(next_session));
                },
                Step::Prepare(c) => if let Some(&session) = sessions.get(&c) {
                    stage.prepare(session);
                },
                Step::Open => asked.push(stage.request(Request::OpenScene { path: "a".into() })),
                Step::Import(is_good) => if let Some(job) = stage.imports.pop() {
                    let imported = Stage::imported();
                    let result = is_good.then_some(imported).ok_or("broken".to_owned());
                    stage.cluster.handle_import(stage.now, job, result);
                    stage.read();
                },
                Step::Close => asked.push(stage.request(Request::CloseScene)),
            }
            // A server that the brain has let go of is gone for the test as well.
            for session in std::mem::take(&mut stage.closed) {
                sessions.retain(|_, s| *s != session);
                stage.replicas.remove(&session);
                stage.prepares.retain(|(to, _)| *to != session);
            }
        }
        for job in std::mem::take(&mut stage.imports) {
            stage.cluster.handle_import(stage.now, job, Err("the end".into()));
            stage.read();
        }
        // Nobody draws or prepares any more: the wall still comes to an end with everything.
        for _ in 0..asked.len() + 2 {
            stage.wait(130_000_000);
        }
        prop_assert!(stage.swaps.is_sorted_by(|a, b| a < b), "{:?}", stage.swaps);
        let mut answered: Vec<_> = stage.replies.iter().map(|(id, _)| *id).collect();
        answered.sort();
        asked.sort();
        prop_assert_eq!(answered, asked);
    }
}
