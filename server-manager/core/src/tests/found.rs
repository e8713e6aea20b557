//! Errors that the simulated wall has found, each as its shortest reproduction.

use super::*;

#[test]
fn a_frame_that_a_change_overtakes_is_still_waited_for() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    let drawn: Vec<FrameRendered> = (0..2).map(|channel| stage.drawn(channel)).collect();
    stage.request(Request::CloseScene);
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.revision, Revision(2));
    // Both have drawn the frame, of the state that it names; it once waited for its deadline, and
    // both were called late.
    for (session, drawn) in drawn.into_iter().enumerate() {
        stage.say(SessionId(session as u64), ServerMessage::Drawn(drawn));
    }
    assert_eq!(stage.swaps.len(), 1);
    let frame = stage.replies.iter().find_map(|(_, reply)| match reply {
        Ok(Response::Frame(feedback)) => Some(feedback.revision),
        _ => None,
    });
    assert_eq!(frame, Some(Revision(1)), "what it shows, not what comes next");
    assert_eq!((stage.state(0), stage.state(1)), (ChannelState::Live, ChannelState::Live));
}

#[test]
fn what_was_drawn_wrong_is_not_swapped() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    let wrong = FrameRendered { digest: Digest(1), ..stage.drawn(1) };
    stage.cluster.handle_status(stage.now, SessionId(1), ServerMessage::Drawn(wrong));
    let right = stage.drawn(0);
    stage.cluster.handle_status(stage.now, SessionId(0), ServerMessage::Drawn(right));
    let mut asked_to_show = Vec::new();
    while let Some(output) = stage.cluster.poll_effect() {
        if let Effect::Command { to, command } = output
            && matches!(*command, Command::Swap(_))
        {
            asked_to_show.extend(to);
        }
    }
    assert_eq!(asked_to_show, [SessionId(0)]);
}

#[test]
fn a_late_channel_that_is_slower_than_the_others_comes_back() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(1), ChannelState::Late);
    // It draws within the deadline of 80 ms, but always after the other's frame was swapped.
    for _ in 0..9 {
        stage.order_frame();
        let slow = stage.drawn(1);
        stage.draw(&[0], 20_000);
        stage.wait(30_000);
        stage.say(SessionId(1), ServerMessage::Drawn(slow));
    }
    stage.order_frame();
    assert_eq!(stage.state(1), ChannelState::Live);
}

#[test]
fn a_channel_that_hangs_does_not_hold_late_ones_that_draw() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.wait(100_000);
    assert_eq!((stage.state(0), stage.state(1)), (ChannelState::Late, ChannelState::Late));
    stage.order_frame();
    stage.draw(&[0], 10_000);
    stage.wait(2_000_000);
    assert_eq!(stage.swaps.len(), 2, "all are late: it is worth the longest wait");
    stage.order_frame();
    stage.draw(&[0], 10_000);
    assert_eq!(stage.swaps.len(), 3, "the one that draws is not held up again");
}

#[test]
fn a_server_that_cannot_prepare_is_asked_again_after_a_while() {
    let mut stage = ClusterFixture::empty(1);
    stage.join(SessionId(0), 0).expect("joined");
    let (_, prepare) = stage.prepares.remove(0);
    let (epoch, revision) = (prepare.epoch, prepare.revision);
    let reason = "the disk is full".to_owned();
    stage.replicas.insert(SessionId(0), Replica::default());
    stage.say(SessionId(0), ServerMessage::PrepareFailed { epoch, revision, reason });
    stage.wait(1_900_000);
    assert!(stage.prepares.is_empty(), "at once it would fail again");
    stage.wait(200_000);
    stage.prepare_all();
    assert_eq!(stage.state(0), ChannelState::Ready);
}

#[test]
fn the_deadline_counts_all_channels_of_a_server() {
    let mut stage = ClusterFixture::empty(6);
    let hello = ServerHello {
        name: "six".into(),
        channels: (0..6).map(|index| format!("c{index}")).collect(),
        pid: 1,
        adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
    };
    let joined = stage.cluster.handle_server(stage.now, SessionId(0), hello, "10.0.0.1:9".into());
    joined.expect("joined");
    stage.read();
    stage.prepare_all();
    for _ in 0..10 {
        stage.order_frame();
        // One after another, 20 ms each: the last is done after 120 ms, six times a draw.
        for channel in 0..6 {
            let drawn = stage.drawn(channel);
            stage.wait(20_000);
            stage.say(SessionId(0), ServerMessage::Drawn(drawn));
        }
    }
    assert_eq!(stage.swaps.len(), 10);
    assert!((0..6).all(|channel| stage.state(channel) == ChannelState::Live));
}
