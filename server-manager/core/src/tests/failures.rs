//! Limits on what a failing channel costs the others, and on how long its failure is held against
//! it.

use super::editing::{TREE, moving};
use super::*;

/// Orders a frame that these channels draw at once; gives how long it took to be swapped.
fn frame_time(stage: &mut ClusterFixture, channels: &[u32]) -> Micros {
    let (swaps, began) = (stage.swaps.len(), stage.now);
    stage.order_frame();
    stage.draw(channels, 1_000);
    while stage.swaps.len() == swaps {
        stage.wait(1_000);
    }
    stage.now - began
}

#[test]
fn a_channel_that_joins_and_hangs_holds_a_wall_that_moves_for_one_deadline() {
    let mut stage = ClusterFixture::new(3);
    stage.cluster.handle_server_gone(stage.now, SessionId(2), "killed");
    stage.replicas.remove(&SessionId(2));
    stage.join(SessionId(12), 2).expect("joined");
    stage.prepare_all();
    let deadline = stage.cluster.deadline.length();
    let took = frame_time(&mut stage, &[0, 1]);
    assert!(took <= deadline + 1_000, "{took} µs, the deadline being {deadline}");
    assert_eq!(stage.state(2), ChannelState::Late);
    assert!(frame_time(&mut stage, &[0, 1]) <= 2_000, "nobody waits for it any more");
}

#[test]
fn a_frame_is_not_late_for_the_lead_of_the_swap_before_it() {
    let mut stage = ClusterFixture::new(2);
    stage.cluster.wall.sync.swap_lead_ms = 100;
    let deadline = stage.cluster.deadline.length();
    assert!(deadline < 100_000, "{deadline}");
    stage.order_frame();
    // Servers show the frame before 100 ms after its swap, and draw this one then.
    stage.draw(&[0, 1], 120_000);
    assert_eq!([stage.state(0), stage.state(1)], [ChannelState::Live; 2]);
    let took = frame_time(&mut stage, &[0]);
    assert!(took <= deadline + 101_000, "{took} µs, the deadline being {deadline}");
    assert_eq!(stage.state(1), ChannelState::Late);
    // Nor is one that was late before.
    for _ in 0..20 {
        stage.order_frame();
        stage.draw(&[1, 0], 120_000);
    }
    assert_eq!(stage.state(1), ChannelState::Live);
}

#[test]
fn a_channel_that_hangs_holds_no_wall_whose_others_are_late() {
    let mut stage = ClusterFixture::new(3);
    stage.order_frame();
    stage.wait(100_000);
    assert!((0..3).all(|channel| stage.state(channel) == ChannelState::Late));
    // Where nobody has drawn, the first who has ends the frame.
    stage.order_frame();
    stage.wait(500_000);
    let swaps = stage.swaps.len();
    stage.draw(&[1], 1_000);
    assert_eq!(stage.swaps.len(), swaps + 1);
    let deadline = stage.cluster.deadline.length();
    for _ in 0..3 {
        let took = frame_time(&mut stage, &[0, 1]);
        assert!(took <= deadline + 1_000, "{took} µs, the deadline being {deadline}");
    }
}

#[test]
fn misses_are_forgiven_after_many_frames_in_time() {
    let mut stage = ClusterFixture::new(2);
    let mut rejoin = |frames_between: u32| {
        for _ in 0..frames_between {
            frame_time(&mut stage, &[0, 1]);
        }
        frame_time(&mut stage, &[0]);
        assert_eq!(stage.state(1), ChannelState::Late);
        let mut frames = 0;
        while stage.state(1) == ChannelState::Late {
            frame_time(&mut stage, &[1, 0]);
            frames += 1;
        }
        frames
    };
    assert_eq!([rejoin(20), rejoin(20), rejoin(20), rejoin(520)], [8, 16, 32, 8]);
}

#[test]
fn a_frame_that_a_replica_in_doubt_has_drawn_is_not_shown_by_it() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    let wrong = FrameRendered { digest: Digest(1), ..stage.drawn(1) };
    stage.cluster.handle_status(stage.now, SessionId(1), ServerMessage::Drawn(wrong));
    let drawn = stage.drawn(0);
    stage.cluster.handle_status(stage.now, SessionId(0), ServerMessage::Drawn(drawn));
    let mut told = Vec::new();
    while let Some(output) = stage.cluster.poll_effect() {
        if let Effect::Command { to, command } = output
            && matches!(*command, Command::Swap(_))
        {
            told.extend(to);
        }
    }
    assert_eq!(told, [SessionId(0)]);
}

#[test]
fn a_server_that_says_goodbye_is_lost_for_its_own_reason() {
    let mut stage = ClusterFixture::new(2);
    let reason = "it sent something malformed".to_owned();
    stage.say(SessionId(1), ServerMessage::Goodbye { reason });
    assert_eq!(stage.closed, [SessionId(1)]);
    let status = stage.cluster.status(stage.now);
    assert_eq!(status.channels[1].state, ChannelState::Lost);
    let reason = status.channels[1].reason.as_deref();
    assert_eq!(reason, Some("it left: it sent something malformed"));
}

#[test]
fn a_display_that_does_not_fit_is_warned_of_until_its_server_says_otherwise_or_goes() {
    let mut stage = ClusterFixture::new(2);
    let say = |stage: &mut ClusterFixture, from: u64, channel: u16, warning: Option<&str>| {
        let warning = warning.map(str::to_owned);
        stage.say(SessionId(from), ServerMessage::Display { channel: ChannelId(channel), warning });
        stage.cluster.status(stage.now).warnings
    };
    assert_eq!(say(&mut stage, 1, 1, Some("too small")), ["too small"]);
    assert_eq!(say(&mut stage, 0, 1, None), ["too small"], "the channel of another server");
    assert_eq!(say(&mut stage, 0, 0, Some("too large")), ["too large", "too small"]);
    assert_eq!(say(&mut stage, 0, 0, None), ["too small"]);
    let long = "x".repeat(100_000);
    assert!(say(&mut stage, 0, 0, Some(&long))[0].len() < 2_000);
    stage.cluster.handle_server_gone(stage.now, SessionId(0), "killed");
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    assert!(stage.cluster.status(stage.now).warnings.is_empty());
}

#[test]
fn stores_that_fail_are_warned_of_once_for_all_servers_until_they_work() {
    let mut stage = ClusterFixture::new(2);
    let say = |stage: &mut ClusterFixture, from: u64, warning: Option<&str>| {
        let warning = warning.map(str::to_owned);
        stage.say(SessionId(from), ServerMessage::Storage { warning });
        stage.cluster.status(stage.now).warnings
    };
    let names = stage.cluster.registry.servers().map(|(_, server)| server.name.clone());
    let [first, second] = names.collect::<Vec<_>>().try_into().expect("two servers");
    assert_eq!(say(&mut stage, 0, Some("s3 fails")), [format!("s3 fails (told by {first})")]);
    let both = format!("s3 fails (told by {first}, {second})");
    assert_eq!(say(&mut stage, 1, Some("s3 fails")), [both]);
    let long = "x".repeat(100_000);
    assert!(say(&mut stage, 0, Some(&long))[1].len() < 2_000);
    assert_eq!(say(&mut stage, 0, None), [format!("s3 fails (told by {second})")]);
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    assert!(stage.cluster.status(stage.now).warnings.is_empty());
}

#[test]
fn a_channel_that_never_came_back_has_a_gap_to_the_last_frame() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Statistics { reset: true });
    let began = stage.now;
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    for _ in 0..10 {
        frame_time(&mut stage, &[0]);
        stage.wait(99_000);
    }
    let took_ms = (stage.now - began) as f64 / 1000.0;
    let gap_ms = stage.cluster.statistics(false).channels[1].longest_gap_ms;
    assert!((took_ms - 200.0..=took_ms).contains(&gap_ms), "{gap_ms} of {took_ms} ms");
}

#[test]
fn a_late_channel_that_is_the_last_of_each_frame_rejoins() {
    let mut stage = ClusterFixture::new(2);
    frame_time(&mut stage, &[0]);
    assert_eq!(stage.state(1), ChannelState::Late);
    for n in 0..8 {
        assert_eq!(stage.state(1), ChannelState::Late, "after {n} frames in time");
        frame_time(&mut stage, &[0]);
        // Behind the swap, and far within the deadline.
        stage.draw(&[1], 5_000);
        stage.wait(20_000);
    }
    // From the next frame on it is waited for, and misses that.
    stage.order_frame();
    assert_eq!(stage.state(1), ChannelState::Live);
    stage.draw(&[0], 10_000);
    stage.wait(100_000);
    // Behind the deadline it is not in time, however often.
    for _ in 0..40 {
        frame_time(&mut stage, &[0]);
        stage.wait(100_000);
        stage.draw(&[1], 0);
        assert_eq!(stage.state(1), ChannelState::Late);
    }
}

#[test]
fn frames_that_end_at_their_deadline_count_their_time() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Statistics { reset: true });
    let deadline = stage.cluster.deadline.length();
    // Nobody draws: first the deadline passes, then, all being late, the longest wait.
    let took: Vec<f64> = (0..3).map(|_| frame_time(&mut stage, &[]) as f64).collect();
    assert!(took[0] >= deadline as f64 && took[2] >= took[0], "{took:?}");
    let statistics = stage.cluster.statistics(false);
    let frame_ms = statistics.frame_ms;
    assert_eq!((statistics.frames, frame_ms.count, statistics.complete), (3, 3, 0));
    assert!(frame_ms.p50 * 1000.0 >= took[1] * 0.99, "{frame_ms:?}, where {took:?} µs passed");
    assert_eq!(statistics.draw_ms.count, 0, "nothing was drawn");
    let seconds = took.iter().sum::<f64>() * 1e-6;
    assert!((statistics.seconds - seconds).abs() < 0.01, "{} of {seconds} s", statistics.seconds);
    let totals = stage.cluster.snapshot(stage.now).totals;
    assert_eq!((totals.frame_s.count(), totals.complete), (7, 4), "four before the reset");
}

#[test]
fn frames_that_one_channel_missed_are_not_counted_as_complete() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Statistics { reset: true });
    frame_time(&mut stage, &[0, 1]);
    // The first is waited for until its deadline, the others not any more.
    for _ in 0..3 {
        frame_time(&mut stage, &[0]);
    }
    let statistics = stage.cluster.statistics(false);
    assert_eq!((statistics.frames, statistics.complete, statistics.late), (4, 1, 1));
    assert!(statistics.frame_ms.max > 79.0, "{:?}", statistics.frame_ms);
}

#[test]
fn a_channel_that_draws_late_has_the_times_of_what_it_drew() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::Statistics { reset: true });
    for _ in 0..3 {
        frame_time(&mut stage, &[0]);
        stage.draw(&[1], 400_000);
    }
    let late = &stage.cluster.statistics(false).channels[1];
    assert_eq!((late.frame_ms.count, late.draw_ms.count), (3, 3));
    assert!(late.frame_ms.p50 > 400.0 && late.draw_ms.p50 > 19.0, "{late:?}");
}

#[test]
fn a_frame_that_waits_for_no_channel_adds_no_time() {
    let mut stage = ClusterFixture::empty(2);
    stage.order_frame();
    let statistics = stage.cluster.statistics(false);
    assert_eq!((statistics.frames, statistics.complete, statistics.frame_ms.count), (1, 0, 0));
}

#[test]
fn an_edit_does_not_make_a_late_channel_live_before_it_has_caught_up() {
    let mut stage = ClusterFixture::with_house(2);
    frame_time(&mut stage, &[0]);
    assert_eq!(stage.state(1), ChannelState::Late);
    for x in [1.0, 2.0, 3.0] {
        stage.edit(moving(TREE, x));
        // The wall shows it without the late channel, which answers then.
        stage.prepare(SessionId(0));
        assert_eq!(stage.state(1), ChannelState::Preparing);
        stage.prepare(SessionId(1));
        assert_eq!(stage.state(1), ChannelState::Late);
        // A frame for those that had it, and one for the late channel too.
        let swaps = stage.swaps.len();
        stage.frames.clear();
        stage.draw(&[0], 1_000);
        stage.draw(&[0], 1_000);
        assert_eq!(stage.swaps.len(), swaps + 2);
        assert!(stage.frames.iter().any(|(to, _)| *to == SessionId(1)), "its picture is older");
        assert!(frame_time(&mut stage, &[0]) <= 2_000, "nobody waits for it");
        assert_eq!(stage.state(1), ChannelState::Late);
    }
    for n in 0..8 {
        assert_eq!(stage.state(1), ChannelState::Late, "after {n} frames in time");
        frame_time(&mut stage, &[1, 0]);
    }
    assert_eq!(stage.state(1), ChannelState::Live);
}

#[test]
fn a_wall_of_late_channels_shows_an_edit_and_comes_back() {
    let mut stage = ClusterFixture::with_house(2);
    frame_time(&mut stage, &[]);
    stage.edit(moving(TREE, 1.0));
    stage.prepare_all();
    assert_eq!([stage.state(0), stage.state(1)], [ChannelState::Late; 2]);
    let swaps = stage.swaps.len();
    for _ in 0..12 {
        stage.order_frame();
        stage.draw(&[0, 1], 1_000);
    }
    assert!(stage.swaps.len() >= swaps + 12);
    assert_eq!([stage.state(0), stage.state(1)], [ChannelState::Live; 2]);
}

#[test]
fn a_late_channel_whose_gpu_was_lost_begins_anew() {
    let mut stage = ClusterFixture::with_house(2);
    frame_time(&mut stage, &[0]);
    assert_eq!(stage.state(1), ChannelState::Late);
    stage.say(SessionId(1), ServerMessage::StateLost { reason: "the GPU was lost".into() });
    stage.prepare_all();
    // The frame that it must see.
    assert_eq!(stage.state(1), ChannelState::Live);
}
