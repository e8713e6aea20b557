//! Two frames on their way: what is sent, swapped and answered, and when.

use proptest::prelude::*;

use super::*;

/// A wall with a pipeline whose channels are warm.
fn stage(channels: u32) -> ClusterFixture {
    let mut stage = ClusterFixture::new(channels);
    stage.cluster.wall.sync.pipeline_depth = 1;
    stage
}

/// The numbers of the frames that were sent, each once.
fn sent(stage: &ClusterFixture) -> Vec<u64> {
    let mut sent: Vec<u64> = stage.frames.iter().map(|(_, frame)| frame.frame.0).collect();
    sent.dedup();
    sent
}

fn draw(stage: &mut ClusterFixture, channel: u32, frame: FrameId) {
    let drawn = FrameRendered { frame, ..stage.drawn(channel) };
    stage.say(SessionId(u64::from(channel)), ServerMessage::Drawn(drawn));
    stage.wait(0);
}

/// The requests that were answered with a frame, and the frames.
fn answers(stage: &ClusterFixture) -> Vec<(RequestId, FrameId)> {
    let frame = |(id, reply): &(RequestId, Result<Response, RequestError>)| match reply {
        Ok(Response::Frame(feedback)) => Some((*id, feedback.frame)),
        _ => None,
    };
    stage.replies.iter().filter_map(frame).collect()
}

#[test]
fn two_frames_are_on_their_way_and_feedback_comes_in_their_order() {
    let mut stage = stage(2);
    let first = stage.cluster.frame.0 + 1;
    let asked: Vec<_> = (0..4).map(|_| stage.order_frame()).collect();
    stage.wait(0);
    assert_eq!(sent(&stage), [first, first + 1], "two at most");
    // One server is a frame ahead of the other.
    draw(&mut stage, 0, FrameId(first));
    draw(&mut stage, 0, FrameId(first + 1));
    assert!(stage.swaps.is_empty());
    draw(&mut stage, 1, FrameId(first));
    assert_eq!(stage.swaps, [FrameId(first)]);
    assert_eq!(sent(&stage), [first, first + 1, first + 2]);
    draw(&mut stage, 1, FrameId(first + 1));
    for channel in [1, 0] {
        for frame in [first + 2, first + 3] {
            draw(&mut stage, channel, FrameId(frame));
        }
    }
    let frames = (first..first + 4).map(FrameId);
    assert_eq!(stage.swaps, frames.clone().collect::<Vec<_>>());
    assert_eq!(answers(&stage), asked.into_iter().zip(frames).collect::<Vec<_>>());
    assert_eq!(stage.cluster.statistics(false).ahead, 3);
}

#[test]
fn without_a_pipeline_a_frame_begins_when_the_last_one_is_swapped() {
    let mut stage = ClusterFixture::new(1);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.order_frame();
    stage.wait(0);
    assert_eq!(sent(&stage), [first]);
    draw(&mut stage, 0, FrameId(first));
    assert_eq!(sent(&stage), [first, first + 1]);
    draw(&mut stage, 0, FrameId(first + 1));
    assert_eq!(stage.cluster.statistics(false).ahead, 0);
}

#[test]
fn a_free_pace_keeps_two_frames_on_their_way() {
    let mut stage = stage(1);
    let first = stage.cluster.frame.0 + 1;
    stage.request(Request::Run(Pacing::Free));
    stage.wait(0);
    for frame in first..first + 10 {
        assert_eq!(sent(&stage).last(), Some(&(frame + 1)));
        stage.wait(5_000);
        draw(&mut stage, 0, FrameId(frame));
    }
    assert_eq!(stage.swaps, (first..first + 10).map(FrameId).collect::<Vec<_>>());
}

#[test]
fn a_capture_has_the_wall_for_itself() {
    let mut stage = stage(1);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.request(Request::Capture { time_s: None });
    stage.order_frame();
    stage.wait(0);
    for frame in first..first + 3 {
        assert_eq!(sent(&stage).last(), Some(&frame), "nothing is sent ahead");
        draw(&mut stage, 0, FrameId(frame));
    }
    assert_eq!(stage.swaps.len(), 3);
}

#[test]
fn a_channel_that_hangs_costs_one_deadline_though_two_frames_wait_for_it() {
    let mut stage = stage(2);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.order_frame();
    stage.wait(0);
    draw(&mut stage, 0, FrameId(first));
    draw(&mut stage, 0, FrameId(first + 1));
    // Four times the median of 20 ms.
    stage.wait(79_000);
    assert!(stage.swaps.is_empty());
    stage.wait(1_001);
    assert_eq!(stage.swaps, [FrameId(first), FrameId(first + 1)], "both at once");
    assert_eq!(stage.state(1), ChannelState::Late);
    assert_eq!(stage.cluster.registry.channel(ChannelId(1)).map(|c| c.late), Some(1));
}

#[test]
fn the_deadline_of_a_frame_that_was_sent_ahead_counts_from_the_swap_before_it() {
    let mut stage = stage(1);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.order_frame();
    stage.wait(60_000);
    draw(&mut stage, 0, FrameId(first));
    stage.wait(79_000);
    assert_eq!((stage.swaps.len(), stage.state(0)), (1, ChannelState::Live));
    draw(&mut stage, 0, FrameId(first + 1));
    assert_eq!((stage.swaps.len(), stage.state(0)), (2, ChannelState::Live));
}

#[test]
fn two_frames_on_their_way_may_be_of_two_states() {
    let mut stage = stage(1);
    let (first, before) = (stage.cluster.frame.0 + 1, stage.cluster.shown.revision);
    stage.order_frame();
    let drawn = stage.drawn(0);
    stage.request(Request::CloseScene);
    stage.prepare_all();
    stage.order_frame();
    stage.wait(0);
    let revisions: Vec<_> = stage.frames.iter().map(|(_, frame)| frame.revision).collect();
    assert_eq!(revisions, [before, Revision(before.0 + 1)]);
    stage.say(SessionId(0), ServerMessage::Drawn(drawn));
    assert_eq!(stage.swaps, [FrameId(first)]);
    draw(&mut stage, 0, FrameId(first + 1));
    assert_eq!(stage.swaps, [FrameId(first), FrameId(first + 1)]);
    assert_eq!(stage.state(0), ChannelState::Live);
}

#[test]
fn a_server_that_drew_one_frame_wrong_shows_neither() {
    let mut stage = stage(2);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.order_frame();
    stage.wait(0);
    let wrong = FrameRendered { digest: Digest(1), frame: FrameId(first), ..stage.drawn(1) };
    stage.cluster.handle_status(stage.now, SessionId(1), ServerMessage::Drawn(wrong));
    for frame in [first, first + 1] {
        let right = FrameRendered { frame: FrameId(frame), ..stage.drawn(0) };
        stage.cluster.handle_status(stage.now, SessionId(0), ServerMessage::Drawn(right));
    }
    let mut asked_to_show = Vec::new();
    while let Some(output) = stage.cluster.poll_effect() {
        if let Effect::Command { to, command } = output
            && matches!(*command, Command::Swap(_))
        {
            asked_to_show.extend(to);
        }
    }
    assert_eq!(asked_to_show, [SessionId(0), SessionId(0)]);
}

#[test]
fn a_server_that_goes_is_waited_for_by_neither_frame() {
    let mut stage = stage(2);
    let first = stage.cluster.frame.0 + 1;
    stage.order_frame();
    stage.order_frame();
    stage.wait(0);
    draw(&mut stage, 0, FrameId(first));
    draw(&mut stage, 0, FrameId(first + 1));
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.read();
    assert_eq!(stage.swaps, [FrameId(first), FrameId(first + 1)]);
}

/// An event that may happen while frames are on their way.
#[derive(Clone, Copy, Debug)]
enum Step {
    Order,
    /// A server says that it has drawn one of the frames that it was sent, counted from the last;
    /// it may have said so before.
    Draw(u32, usize),
    Wait(Micros),
    /// A server ends, and another one comes in its place.
    Replace(u32),
    /// The next frames are of another state.
    Change,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => Just(Step::Order),
        12 => (0..3u32, 0..3usize).prop_map(|(channel, back)| Step::Draw(channel, back)),
        3 => (0..120_000u64).prop_map(Step::Wait),
        1 => (0..3u32).prop_map(Step::Replace),
        1 => Just(Step::Change),
    ]
}

/// A server says that it has drawn the frame that it was sent so many frames before the last.
fn draw_back(stage: &mut ClusterFixture, (channel, session): (u32, SessionId), back: usize) {
    let mut sent = stage.frames.iter().rev().filter(|(to, _)| *to == session);
    let Some((_, frame)) = sent.nth(back) else { return };
    let (frame, revision) = (frame.frame, frame.revision);
    let digest = stage.digests[&(session, revision)];
    let drawn = FrameRendered { frame, revision, digest, ..stage.drawn(channel) };
    stage.say(session, ServerMessage::Drawn(drawn));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

    #[test]
    fn frames_are_shown_in_rising_order_and_none_twice(
        steps in proptest::collection::vec(step(), 1..100),
    ) {
        let mut stage = stage(3);
        let mut sessions = [0, 1, 2].map(SessionId);
        let (mut next_session, mut asked) = (100, Vec::new());
        for step in steps {
            match step {
                Step::Order => asked.push(stage.order_frame()),
                Step::Draw(channel, back) => {
                    let session = sessions[channel as usize];
                    draw_back(&mut stage, (channel, session), back);
                }
                Step::Wait(micros) => stage.wait(micros),
                Step::Replace(channel) => {
                    let gone = sessions[channel as usize];
                    stage.replicas.remove(&gone);
                    stage.cluster.handle_server_gone(stage.now, gone, "killed");
                    stage.read();
                    let session = SessionId(next_session);
                    stage.join(session, channel).expect("the channel is free");
                    stage.prepare_all();
                    (sessions[channel as usize], next_session) = (session, next_session + 1);
                }
                Step::Change => {
                    stage.request(Request::CloseScene);
                    stage.prepare_all();
                }
            }
            prop_assert!(stage.cluster.pipeline.iter().count() <= 2);
        }
        // Nobody draws any more: all that was asked for still comes to an end.
        for _ in 0..asked.len() + 2 {
            stage.wait(130_000_000);
        }
        prop_assert!(stage.swaps.is_sorted_by(|a, b| a < b), "{:?}", stage.swaps);
        let mut last: BTreeMap<SessionId, FrameId> = BTreeMap::new();
        for (to, frame) in &stage.frames {
            let is_next = last.insert(*to, frame.frame).is_none_or(|before| before < frame.frame);
            prop_assert!(is_next, "{} to {:?}", frame.frame, to);
        }
        let answers = answers(&stage);
        let is_next = |a: &(RequestId, FrameId), b: &(RequestId, FrameId)| a.0 < b.0 && a.1 < b.1;
        prop_assert!(answers.is_sorted_by(is_next), "{:?}", answers);
        let mut answered: Vec<RequestId> = stage.replies.iter().map(|(id, _)| *id).collect();
        answered.retain(|id| asked.contains(id));
        answered.sort();
        prop_assert_eq!(answered, asked);
    }
}
