//! Tunings and patterns: when they are seen, who is told, what is remembered.

use glam::DVec2;
use polyptych_protocol::feedback::Tuned;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::tuned_channel::TunedChannel;
use polyptych_wall::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::{Area, View};

use super::super::calibrate::TUNERS_MAX;
use super::*;
use polyptych_wall::camera::Camera;

fn pin(x: f64) -> CalibrationChange {
    CalibrationChange::Pin { corner: Corner::UpperLeft, to: Offset::To(DVec2::new(x, 0.0)) }
}

fn nudge(x: f64) -> CalibrationChange {
    CalibrationChange::Pin { corner: Corner::UpperLeft, to: Offset::By(DVec2::new(x, 0.0)) }
}

impl ClusterFixture {
    fn tune(&mut self, change: CalibrationChange) -> RequestId {
        self.request(Request::Tune { channel: "c1".into(), changes: vec![change] })
    }

    fn pin_of(&self, session: u64) -> f64 {
        let wall = self.replicas[&SessionId(session)].wall.as_ref().expect("a wall");
        wall.channels[1].adjustment.pin[0].x
    }

    fn pinned(&self) -> f64 {
        self.cluster.wall.channels[1].adjustment.pin[0].x
    }

    fn tuned(&self, id: RequestId) -> Vec<Tuned> {
        let of_id = self.replies.iter().filter(|(of, _)| *of == id);
        let tuned = of_id.map(|(_, reply)| match reply {
            Ok(Response::Tuned(tuned)) => tuned.clone(),
            other => panic!("{other:?}"),
        });
        tuned.collect()
    }

    fn failure(&self, id: RequestId) -> &str {
        let found = self.replies.iter().find(|(of, _)| *of == id);
        let Some((_, Err(failure))) = found else { panic!("{id:?} has not failed") };
        &failure.reason
    }
}

#[test]
fn a_paused_wall_draws_one_frame_for_a_tuning_and_answers_when_it_is_swapped() {
    let mut stage = ClusterFixture::new(2);
    stage.memories.clear();
    let before = stage.cluster.frame;
    let id = stage.tune(pin(1.5));
    assert_eq!((stage.prepares.len(), stage.frames.len()), (2, 0), "nothing is drawn yet");
    stage.prepare_all();
    assert_eq!((stage.pin_of(0), stage.pin_of(1), stage.frames.len()), (1.5, 1.5, 2));
    stage.draw(&[0], 1_000);
    assert!(stage.replies.is_empty(), "not all have drawn it");
    stage.draw(&[1], 1_000);
    let (frame, revision) = (stage.cluster.frame, stage.cluster.shown.revision);
    assert_eq!(frame.0, before.0 + 1);
    let [tuned] = &stage.tuned(id)[..] else { panic!("one answer: {:?}", stage.replies) };
    assert_eq!((tuned.revision, tuned.feedback.frame, tuned.frames), (revision, frame, 1));
    assert!(tuned.feedback.is_complete(), "{tuned:?}");
    assert_eq!(stage.memories.len(), 1, "remembered before anybody is told");
    stage.wait(1_500_000);
    assert_eq!(stage.swaps.len(), 1, "and no frame more");
}

#[test]
fn a_wall_that_runs_shows_a_tuning_with_the_second_frame_at_most() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Run(Pacing::Free));
    stage.wait(0);
    // A frame is being drawn; the servers prepare while the next one is.
    let id = stage.tune(pin(2.0));
    stage.draw(&[0, 1], 5_000);
    stage.wait(0);
    let ongoing = stage.frames.last().expect("a frame").1.clone();
    let before = stage.replicas[&SessionId(0)].digest();
    stage.prepare_all();
    assert_ne!(ongoing.revision, stage.cluster.shown.revision);
    assert!(stage.tuned(id).is_empty(), "the frame on its way is of the state before");
    for session in [0, 1] {
        let mut drawn = stage.drawn(session as u32);
        (drawn.revision, drawn.digest) = (ongoing.revision, before);
        stage.say(SessionId(session), ServerMessage::Drawn(drawn));
    }
    assert!(stage.tuned(id).is_empty(), "nor does its swap tell of the tuning");
    stage.wait(0);
    stage.draw(&[0, 1], 5_000);
    let [tuned] = &stage.tuned(id)[..] else { panic!("one answer: {:?}", stage.replies) };
    assert_eq!(tuned.frames, 2);
    assert_eq!(stage.state(0), ChannelState::Live);
    assert_eq!(stage.cluster.status(stage.now).channels[1].late, 0);
}

#[test]
fn a_wall_with_a_slow_pace_draws_a_frame_for_a_tuning_and_keeps_its_beat() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Run(Pacing::Rate(0.02)));
    stage.wait(0);
    stage.draw(&[0, 1], 5_000);
    stage.wait(1_000_000);
    let before = stage.cluster.frame;
    let id = stage.tune(pin(2.0));
    stage.prepare_all();
    stage.draw(&[0, 1], 5_000);
    let [tuned] = &stage.tuned(id)[..] else { panic!("one answer: {:?}", stage.replies) };
    assert_eq!((tuned.feedback.frame.0, tuned.frames), (before.0 + 1, 1));
    // In steps: servers give a sign of life at each.
    (0..20).for_each(|_| stage.wait(1_500_000));
    assert_eq!(stage.cluster.frame.0, before.0 + 1, "and no frame more");
    (0..17).for_each(|_| stage.wait(1_500_000));
    assert_eq!(stage.cluster.frame.0, before.0 + 2, "the beat is where it was");
}

#[test]
fn tunings_that_come_faster_than_servers_prepare_are_one() {
    let mut stage = ClusterFixture::new(2);
    let ids: Vec<_> = (1..=50).map(|step| stage.tune(pin(f64::from(step) * 0.1))).collect();
    assert_eq!(stage.cluster.changes.waiting(), 1, "one is on its way, one behind it");
    stage.prepare_all();
    // Both revisions were prepared; the last one is what is seen.
    for _ in 0..3 {
        stage.draw(&[0, 1], 1_000);
        stage.wait(0);
    }
    assert_eq!((stage.pinned(), stage.pin_of(0)), (5.0, 5.0));
    for id in &ids {
        assert_eq!(stage.tuned(*id).len(), 1, "{id:?} has one answer");
    }
    assert_eq!(stage.replies.len(), ids.len());
    assert!(stage.swaps.len() <= 2, "{} frames for 50 tunings", stage.swaps.len());
}

#[test]
fn steps_add_up_however_many_are_shown_together() {
    let mut stage = ClusterFixture::new(2);
    for _ in 0..10 {
        stage.tune(nudge(0.5));
    }
    stage.prepare_all();
    assert_eq!(stage.pinned(), 5.0);
}

#[test]
fn a_client_that_tunes_without_end_is_told_so_and_others_are_not() {
    let mut stage = ClusterFixture::new(2);
    for _ in 0..TUNERS_MAX {
        stage.tune(nudge(0.01));
    }
    assert!(stage.replies.is_empty());
    let id = stage.tune(nudge(0.01));
    assert!(stage.failure(id).contains("256 tunings of this client"), "{:?}", stage.replies);
    let other = SessionId(1001);
    stage.cluster.handle_client(other, "other".into());
    let tune = Request::Tune { channel: "c0".into(), changes: vec![pin(1.0)] };
    stage.cluster.handle_request(stage.now, other, RequestId(9), tune);
    stage.read();
    assert_eq!(stage.replies.len(), 1);
    assert_eq!(stage.cluster.changes.waiting(), 1);
    stage.prepare_all();
    stage.draw(&[0, 1], 1_000);
    stage.wait(0);
    stage.draw(&[0, 1], 1_000);
    assert_eq!(stage.replies.len(), 1 + TUNERS_MAX + 1);
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let mut stage = ClusterFixture::new(2);
    let id = stage.tune(pin(1e6));
    assert!(stage.failure(id).starts_with("c1: pin.upper-left: "));
    let tune = Request::Tune { channel: "c7".into(), changes: Vec::new() };
    let id = stage.request(tune);
    assert!(stage.failure(id).contains("no channel \"c7\""));
    assert_eq!((stage.prepares.len(), stage.cluster.wall.clone()), (0, wall(2)));
}

#[test]
fn a_tuning_that_no_server_takes_fails_with_all_that_were_made_of_it() {
    let mut stage = ClusterFixture::new(1);
    let revision = stage.cluster.shown.revision;
    let ids = [0, 1]
        .map(|_| stage.request(Request::Tune { channel: "c0".into(), changes: vec![nudge(1.0)] }));
    let epoch = stage.cluster.epoch();
    let (revision, reason) = (Revision(revision.0 + 1), "no room".to_owned());
    stage.say(SessionId(0), ServerMessage::PrepareFailed { epoch, revision, reason });
    for id in ids {
        assert!(stage.failure(id).contains("no room"));
    }
    assert_eq!((stage.cluster.changes.waiting(), stage.pinned_of(0)), (0, 0.0));
    stage.prepare_all();
    let id = stage.request(Request::Tune { channel: "c0".into(), changes: vec![nudge(1.0)] });
    stage.prepare_all();
    // The channel was given a frame of the old state as it came back.
    stage.draw(&[0], 1_000);
    assert_eq!(stage.tuned(id), [], "it does not show the tuning");
    stage.draw(&[0], 1_000);
    assert_eq!((stage.tuned(id).len(), stage.pinned_of(0)), (1, 1.0), "the wall goes on");
}

/// One server cannot have it: nobody does, all stay live, and the next tuning is taken, though
/// servers differ in what they have built.
#[test]
fn a_tuning_that_one_server_does_not_take_changes_nothing_and_all_stay_live() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Run(Pacing::Free));
    stage.wait(0);
    stage.draw(&[0, 1], 5_000);
    let first = stage.tune(pin(1.0));
    stage.prepare_all();
    for _ in 0..2 {
        stage.wait(0);
        stage.draw(&[0, 1], 5_000);
    }
    assert_eq!(stage.tuned(first).len(), 1, "one is shown");
    let shown = stage.cluster.shown.revision;
    for times in 1..=5 {
        stage.clear();
        let id = stage.tune(pin(2.0));
        stage.prepare(SessionId(0));
        let (_, prepare) = stage.prepares.remove(0);
        assert_eq!(prepare.revision.0, shown.0 + times, "a number of its own");
        let epoch = stage.cluster.epoch();
        let reason = "channel c1: none of its pixels lies on its screen".to_owned();
        let failed = ServerMessage::PrepareFailed { epoch, revision: prepare.revision, reason };
        stage.say(SessionId(1), failed);
        let said = stage.failure(id);
        assert!(said.starts_with("nothing has changed, since server "), "{said}");
        assert!(said.contains("c1: none of its pixels") && !said.contains('\n'), "{said}");
        for _ in 0..2 {
            stage.wait(0);
            stage.draw(&[0, 1], 5_000);
            assert_eq!([0, 1].map(|c| stage.state(c)), [ChannelState::Live; 2]);
        }
        assert_eq!((stage.cluster.shown.revision, stage.pinned()), (shown, 1.0));
        assert!(stage.prepares.is_empty(), "nothing is given anew");
    }
    let id = stage.tune(pin(3.0));
    stage.prepare_all();
    for _ in 0..2 {
        stage.wait(0);
        stage.draw(&[0, 1], 5_000);
    }
    assert_eq!((stage.tuned(id).len(), stage.pin_of(0), stage.pin_of(1)), (1, 3.0, 3.0));
    assert_eq!(stage.cluster.shown.revision.0, shown.0 + 6);
}

/// Two refusals without a frame between them: who holds both is given the shown state anew,
/// before it has to let that go.
#[test]
fn who_holds_two_refused_states_is_given_the_shown_one_anew() {
    let mut stage = ClusterFixture::new(2);
    let refuse = |stage: &mut ClusterFixture| {
        stage.tune(pin(2.0));
        stage.prepare(SessionId(0));
        let (_, prepare) = stage.prepares.remove(0);
        let epoch = stage.cluster.epoch();
        let reason = "no room".to_owned();
        let failed = ServerMessage::PrepareFailed { epoch, revision: prepare.revision, reason };
        stage.say(SessionId(1), failed);
    };
    stage.order_frame();
    refuse(&mut stage);
    assert_eq!([0, 1].map(|c| stage.state(c)), [ChannelState::Live; 2]);
    refuse(&mut stage);
    assert_eq!([0, 1].map(|c| stage.state(c)), [ChannelState::Preparing, ChannelState::Live]);
    let shown = stage.cluster.shown.revision;
    let [(to, prepare)] = &stage.prepares[..] else { panic!("one: {:?}", stage.prepares) };
    assert_eq!((*to, prepare.base, prepare.revision), (SessionId(0), None, shown));
    stage.prepare_all();
    for _ in 0..3 {
        stage.draw(&[0, 1], 1_000);
        stage.wait(0);
    }
    assert_eq!([0, 1].map(|c| stage.state(c)), [ChannelState::Live; 2]);
}

impl ClusterFixture {
    fn pinned_of(&self, channel: usize) -> f64 {
        self.cluster.wall.channels[channel].adjustment.pin[0].x
    }
}

#[test]
fn the_scene_and_its_features_stay_and_so_does_the_deadline() {
    let mut stage = ClusterFixture::new(1);
    let job = ClientRequest { client: CLIENT, id: RequestId(77) };
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    stage.prepare_all();
    for _ in 0..4 {
        stage.order_frame();
        stage.draw(&[0], 10_000);
    }
    let before = stage.cluster.status(stage.now);
    stage.request(Request::Tune { channel: "c0".into(), changes: vec![pin(1.0)] });
    let [(_, prepare)] = &stage.prepares[..] else { panic!("one prepare") };
    let [Operation::Adjust { .. }] = &prepare.operations[..] else { panic!("the wall alone") };
    stage.prepare_all();
    let after = stage.cluster.status(stage.now);
    assert_eq!((after.scene.as_deref(), after.deadline_ms), (Some("town"), before.deadline_ms));
}

#[test]
fn a_restarted_manager_has_the_tuned_wall() {
    let mut stage = ClusterFixture::new(2);
    stage.tune(pin(2.5));
    stage.prepare_all();
    stage.draw(&[0, 1], 1_000);
    stage.request(Request::SetPattern(Some(TestPattern::Grid)));
    stage.draw(&[0, 1], 1_000);
    let memory = stage.memories.pop().expect("remembered");
    let tuned = stage.cluster.wall.clone();
    let pattern_of = |cluster: &Cluster| cluster.status(0).presentation.pattern;

    let again = Cluster::restore(wall(2), Epoch(8), &memory);
    assert_eq!((&again.wall, again.shown.wall.as_deref()), (&tuned, Some(&tuned)));
    assert_eq!(
        (again.shown.revision, pattern_of(&again)),
        (memory.revision, Some(TestPattern::Grid))
    );
    assert_eq!(again.shown_digest, again.shown.digest());
    assert_eq!(again.persistent_state(), memory, "and the next one too");
}

#[test]
fn keys_that_were_tuned_are_listed_though_they_were_tuned_back() {
    let mut stage = ClusterFixture::new(2);
    let listed = |stage: &mut ClusterFixture| {
        let id = stage.request(Request::ListTunings);
        let found = stage.replies.iter().find(|(of, _)| *of == id);
        let Some((_, Ok(Response::Tunings(tunings)))) = found else { panic!("{found:?}") };
        tunings.clone()
    };
    assert_eq!(listed(&mut stage), []);
    for change in [pin(2.5), CalibrationChange::Gain(DVec3::splat(0.5)), pin(0.0)] {
        stage.tune(change);
        stage.prepare_all();
        stage.draw(&[0, 1], 1_000);
    }
    let tuned = |keys: &[&str]| {
        let keys = keys.iter().map(|key| (*key).to_owned()).collect();
        TunedChannel { channel: "c1".into(), keys }
    };
    assert_eq!(listed(&mut stage), [tuned(&["pin", "gain"])]);
    let memory = stage.memories.pop().expect("remembered");
    let again = Cluster::restore(wall(2), Epoch(8), &memory);
    assert_eq!(again.tuned.list(), [tuned(&["gain"])], "the rest is as in the wall file");
}

#[test]
fn all_channels_change_their_pattern_with_one_frame_and_joiners_have_it() {
    let mut stage = ClusterFixture::new(2);
    stage.memories.clear();
    let id = stage.request(Request::SetPattern(Some(TestPattern::Checker)));
    let patterns: Vec<_> =
        stage.frames.iter().map(|(_, frame)| frame.presentation.pattern).collect();
    assert_eq!(patterns, [Some(TestPattern::Checker); 2]);
    stage.draw(&[0, 1], 1_000);
    assert!(stage.is_answered_by_a_whole_frame(id), "{:?}", stage.replies);
    let memory = stage.memories.pop().expect("remembered");
    assert_eq!(memory.presentation.pattern, Some(TestPattern::Checker));
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.clear();
    stage.join(SessionId(1), 1).expect("joined");
    stage.prepare_all();
    let (to, frame) = stage.frames.last().expect("a frame for the joiner");
    assert_eq!((*to, frame.presentation.pattern), (SessionId(1), Some(TestPattern::Checker)));
    stage.draw(&[0, 1], 1_000);
    stage.request(Request::SetPattern(None));
    assert_eq!(stage.frames.last().expect("a frame").1.presentation.pattern, None);
}

impl ClusterFixture {
    /// A frame that was begun, or one that is ordered, is drawn by the only channel in this time.
    fn draw_in(&mut self, us: u32) {
        if self.cluster.pipeline.is_empty() {
            self.order_frame();
        }
        self.wait(Micros::from(us));
        let drawn = FrameRendered { draw_us: us, ..self.drawn(0) };
        self.say(SessionId(0), ServerMessage::Drawn(drawn));
    }
}

#[test]
fn a_pattern_shortens_no_deadline_of_the_scene() {
    let mut stage = ClusterFixture::new(1);
    (0..64).for_each(|_| stage.draw_in(70_000));
    assert_eq!(stage.cluster.status(stage.now).deadline_ms, 280.0);
    stage.request(Request::SetPattern(Some(TestPattern::Checker)));
    (0..64).for_each(|_| stage.draw_in(1_000));
    stage.request(Request::SetPattern(None));
    stage.draw_in(70_000);
    assert_eq!(stage.cluster.status(stage.now).deadline_ms, 280.0);
    assert_eq!(stage.state(0), ChannelState::Live);
}

#[test]
fn a_pattern_that_takes_longer_than_the_deadline_lengthens_it() {
    let mut stage = ClusterFixture::new(1);
    assert_eq!(stage.cluster.status(stage.now).deadline_ms, 80.0);
    stage.request(Request::SetPattern(Some(TestPattern::Checker)));
    (0..40).for_each(|_| stage.draw_in(200_000));
    assert_eq!(stage.cluster.status(stage.now).deadline_ms, 800.0);
    assert_eq!(stage.state(0), ChannelState::Live);
}

/// Views in rows and columns, which divide the second channel into more parts than a tile may
/// have; while it is pinned, each has a picture of its own.
fn net() -> Vec<View> {
    let strips = (0..16u32).flat_map(|n| [[64 + n * 4, 0, 1, 64], [64, n * 4, 64, 1]]);
    let view =
        |rect| View { area: Area::Screen { screen: 0, rect }, ..View::of_wall(Camera::IDENTITY) };
    strips.map(view).collect()
}

#[test]
fn a_tuning_under_views_that_it_leaves_no_place_for_is_refused() {
    let mut stage = ClusterFixture::new(2);
    stage.tune(pin(1.0));
    stage.prepare_all();
    stage.draw(&[0, 1], 1_000);
    stage.request(Request::SetViews(net()));
    assert_eq!(stage.cluster.presentation.views.len(), 32);
    let pinned = stage.cluster.wall.clone();
    let id = stage.tune(pin(0.0));
    for part in ["c1: the views", "256 rectangles", "take them away first"] {
        assert!(stage.failure(id).contains(part), "{part} is not in {}", stage.failure(id));
    }
    assert_eq!((stage.prepares.len(), stage.cluster.wall.clone()), (0, pinned));
    stage.tune(pin(2.0));
    assert_eq!(stage.prepares.len(), 2, "views move with the corners");
    stage.prepare_all();
    stage.request(Request::SetViews(Vec::new()));
    stage.tune(pin(0.0));
    stage.prepare_all();
    assert_eq!(stage.pinned(), 0.0);
}

#[test]
fn views_are_refused_that_a_tuning_on_its_way_leaves_no_place_for() {
    let mut stage = ClusterFixture::new(2);
    let refused = |stage: &mut ClusterFixture| {
        let id = stage.request(Request::SetViews(net()));
        assert!(stage.failure(id).contains("256 rectangles"), "{}", stage.failure(id));
    };
    stage.tune(pin(1.0));
    stage.prepare_all();
    stage.tune(CalibrationChange::Gain(DVec3::splat(0.5)));
    stage.tune(pin(0.0));
    refused(&mut stage);
    stage.prepare_all();
    refused(&mut stage);
    assert!(stage.cluster.presentation.views.is_empty());
}

#[test]
fn a_tuning_under_a_head_that_cannot_be_there_is_refused() {
    let mut stage = ClusterFixture::new(2);
    // No request leads to this head; a wall is not tuned under it all the same.
    stage.cluster.presentation.head = HeadPose::facing_forward(DVec3::Z * -1.25, 0.06);
    let id = stage.tune(pin(1.0));
    for part in ["c1: the head", "behind screen front", "move it first"] {
        assert!(stage.failure(id).contains(part), "{part} is not in {}", stage.failure(id));
    }
    assert_eq!((stage.prepares.len(), stage.cluster.wall.clone()), (0, wall(2)));
}

#[test]
fn a_wall_that_is_paused_before_it_showed_a_tuning_shows_it() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Run(Pacing::Rate(1.0)));
    let id = stage.tune(pin(1.0));
    stage.prepare_all();
    // The frame that is being drawn is of the state before.
    stage.request(Request::Pause);
    stage.draw(&[0, 1], 1_000);
    assert_eq!(stage.tuned(id), []);
    stage.draw(&[0, 1], 1_000);
    assert_eq!(stage.tuned(id).len(), 1);
    let swaps = stage.swaps.len();
    stage.wait(1_500_000);
    assert_eq!(stage.swaps.len(), swaps, "and no frame more");
}
