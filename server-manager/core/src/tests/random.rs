//! Random schedules: whatever happens in whatever order, the invariants hold.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use polyptych_protocol::navigation::Navigation;
use polyptych_scene::{Fog, Glow};
use polyptych_wall::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_wall::view::Area;
use proptest::prelude::*;

use super::*;
use polyptych_protocol::pattern::TestPattern;
use polyptych_wall::camera::Camera;
use polyptych_wall::view::View;

#[derive(Clone, Debug)]
enum Step {
    Order,
    Draw(u32),
    Wait(Micros),
    /// Time passes, though the core is not told: there is much else to read first.
    Stall(Micros),
    Kill(u32),
    Join(u32),
    Prepare(u32),
    FailToPrepare(u32),
    Open,
    Import(bool),
    Close,
    Tune(bool),
    Pattern,
    Fog(bool),
    Glow(bool),
    View(bool),
    Run,
    Pause,
    Navigate(u32, f64),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => Just(Step::Order),
        6 => (0..3u32).prop_map(Step::Draw),
        3 => (0..200_000u64).prop_map(Step::Wait),
        1 => (0..3_000_000u64).prop_map(Step::Stall),
        1 => (0..3u32).prop_map(Step::Kill),
        2 => (0..3u32).prop_map(Step::Join),
        4 => (0..3u32).prop_map(Step::Prepare),
        1 => (0..3u32).prop_map(Step::FailToPrepare),
        1 => Just(Step::Open),
        2 => any::<bool>().prop_map(Step::Import),
        1 => Just(Step::Close),
        4 => any::<bool>().prop_map(Step::Tune),
        1 => Just(Step::Pattern),
        2 => any::<bool>().prop_map(Step::Fog),
        2 => any::<bool>().prop_map(Step::Glow),
        2 => any::<bool>().prop_map(Step::View),
        1 => Just(Step::Run),
        1 => Just(Step::Pause),
        2 => (0..3u32, -4.0..4.0f64).prop_map(|(c, by)| Step::Navigate(c, by)),
    ]
}

impl ClusterFixture {
    /// Asks for what a step is, where that is a request.
    fn ask(&mut self, step: &Step) -> Option<RequestId> {
        let request = match step {
            Step::Order => Request::RenderFrame { camera: None, time_s: None },
            Step::Open => Request::OpenScene { path: "a".into(), scene: None },
            Step::Close => Request::CloseScene,
            // A pin, with which no view of its own can be; or a gain, with which all can.
            Step::Tune(is_pin) => {
                let to = Offset::By(DVec2::new(0.1, 0.0));
                let pin = CalibrationChange::Pin { corner: Corner::UpperLeft, to };
                let change = if *is_pin { pin } else { CalibrationChange::Gain(DVec3::splat(0.5)) };
                Request::Tune { channel: "c1".into(), changes: vec![change] }
            }
            Step::Pattern => Request::SetPattern(Some(TestPattern::Grid)),
            Step::Fog(is_on) => Request::SetFog(is_on.then(|| Fog::even(90.0))),
            Step::Glow(is_on) => Request::SetGlow(is_on.then(|| Glow::new(0.5))),
            Step::View(is_one) => {
                let area = Area::Screen { screen: 0, rect: [0, 0, 32, 32] };
                let view = View { area, ..View::of_wall(Camera::IDENTITY) };
                Request::SetViews(is_one.then_some(view).into_iter().collect())
            }
            Step::Run => Request::Run(Pacing::Rate(20.0)),
            Step::Pause => Request::Pause,
            _ => return None,
        };
        Some(self.request(request))
    }

    fn fail_to_prepare(&mut self, session: SessionId) {
        let Some(at) = self.prepares.iter().position(|(to, _)| *to == session) else { return };
        let (_, Prepare { epoch, revision, .. }) = self.prepares.remove(at);
        self.say(
            session,
            ServerMessage::PrepareFailed { epoch, revision, reason: "no room".into() },
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Whatever happens in whatever order: frames are swapped in order and once, the wall goes on
    /// within the longest deadline, and every request gets exactly one answer.
    #[test]
    fn random_schedules_keep_the_invariants(steps in proptest::collection::vec(step(), 1..120)) {
        let mut stage = ClusterFixture::empty(3);
        let mut sessions: BTreeMap<u32, SessionId> = BTreeMap::new();
        let mut next_session = 0;
        let mut asked = Vec::new();
        for step in steps {
            match step {
                Step::Draw(c) => if let Some(&session) = sessions.get(&c) {
                    let drawn = stage.drawn(c);
                    if stage.frames.iter().any(|(to, f)| *to == session && f.frame == drawn.frame) {
                        stage.say(session, ServerMessage::Drawn(drawn));
                    }
                },
                Step::Wait(micros) => stage.wait(micros),
                Step::Stall(micros) => stage.now += micros,
                Step::Navigate(c, by) => if let Some(&session) = sessions.get(&c) {
                    let (orbit_rad, pan) = (DVec2::new(by, -by), DVec2::new(0.1, by));
                    let none = Navigation::none(&format!("c{c}"));
                    let navigation = Navigation { orbit_rad, pan, zoom: by.exp(), ..none };
                    stage.say(session, ServerMessage::Navigate(navigation));
                },
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
                Step::FailToPrepare(c) => if let Some(&session) = sessions.get(&c) {
                    stage.fail_to_prepare(session);
                },
                Step::Import(is_good) => if let Some(job) = stage.imports.pop() {
                    let imported = ClusterFixture::imported();
                    let result = is_good.then_some(imported).ok_or("broken".to_owned());
                    stage.cluster.handle_import(stage.now, job, result);
                    stage.read();
                },
                step => asked.extend(stage.ask(&step)),
            }
            // What frames show fits the wall that they name, whatever came in between.
            let cluster = &stage.cluster;
            prop_assert_eq!(cluster.shown.wall.as_deref(), Some(&cluster.wall));
            prop_assert_eq!(cluster.presentation.camera.fault(), None);
            prop_assert_eq!(cluster.check_presentation(&cluster.wall), Ok(()));
            // Servers are ready for the effects that frames have.
            prop_assert_eq!(cluster.shown.effects, cluster.presentation.effects());
            // A server that the core has let go of is gone for the test as well.
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
        // No frame comes by itself any more, for which a tuning could wait.
        asked.push(stage.request(Request::Pause));
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
