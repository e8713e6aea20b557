//! Servers that join, or were late, while changes come one after another.

use super::editing::{TREE, moving};
use super::*;

/// A wall that shows the house on its first channel, and whose second server has just joined.
fn joining() -> ClusterFixture {
    let mut stage = ClusterFixture::empty(2);
    stage.join(SessionId(0), 0).expect("joined");
    stage.prepare_all();
    stage.open_house();
    stage.join(SessionId(1), 1).expect("joined");
    stage
}

/// Edits the scene and draws a frame of it, if no edit waits; the first server is always a step
/// ahead. Returns whether it did.
fn edit_once(stage: &mut ClusterFixture, x: f64) -> bool {
    let is_held = stage.cluster.changes.current.is_some();
    if !is_held {
        stage.edit(moving(TREE, x));
        stage.prepare(SessionId(0));
    }
    let drawing: &[u32] = if stage.state(1) == ChannelState::Live { &[0, 1] } else { &[0] };
    stage.draw(drawing, 1_000);
    !is_held
}

#[test]
fn a_server_that_joins_while_edits_come_without_end_gets_back_in() {
    let mut stage = joining();
    for x in 0..100 {
        edit_once(&mut stage, f64::from(x));
        stage.prepare(SessionId(1));
    }
    assert_eq!(stage.state(1), ChannelState::Live);
}

#[test]
fn a_server_that_takes_long_to_catch_up_is_given_more_time_each_time() {
    let mut stage = joining();
    let begun = stage.now;
    let mut busy_until = stage.now;
    for x in 0..600 {
        edit_once(&mut stage, f64::from(x));
        stage.wait(100_000);
        // Each state takes it 5 s.
        if stage.now >= busy_until {
            stage.prepare(SessionId(1));
            busy_until = stage.now + 5_000_000;
        }
        if stage.state(1) == ChannelState::Live {
            assert!(stage.now - begun < 60_000_000, "after {} us", stage.now - begun);
            return;
        }
    }
    panic!("it never got in");
}

#[test]
fn servers_that_hang_as_they_catch_up_hold_a_fifth_of_the_edits() {
    let mut stage = joining();
    let mut edits = 0;
    for x in 0..3_000 {
        edits += u32::from(edit_once(&mut stage, f64::from(x)));
        stage.wait(100_000);
        // It prepares what it was sent whole, and nothing of what is held for it.
        if stage.cluster.changes.current.is_none() {
            stage.prepare(SessionId(1));
        }
    }
    assert!((2_300..3_000).contains(&edits), "{edits} of 3,000 edits were shown at once");
}

#[test]
fn changes_that_settle_as_a_frame_ends_are_all_answered() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    let asked = [(); 3].map(|()| stage.request(Request::CloseScene));
    stage.prepare(SessionId(1));
    // The frame is overdue, though nobody has said so yet.
    stage.now += 3_000_000;
    stage.prepare(SessionId(0));
    stage.prepare_all();
    for id in asked {
        assert_eq!(stage.replies.iter().filter(|(of, _)| *of == id).count(), 1, "{id:?}");
    }
}

#[test]
fn edits_behind_a_server_that_catches_up_are_not_refused_for_their_number() {
    let mut stage = joining();
    edit_once(&mut stage, 0.0);
    stage.prepare(SessionId(1));
    let asked: Vec<_> = (0..300)
        .map(|x| {
            let id = stage.edit(moving(TREE, f64::from(x)));
            stage.prepare(SessionId(0));
            stage.draw(&[0], 1_000);
            id
        })
        .collect();
    let refused = stage.replies.iter().find(|(id, reply)| asked.contains(id) && reply.is_err());
    assert_eq!(refused, None);
}

#[test]
fn a_late_channel_gets_back_in_though_each_frame_is_overtaken_by_an_edit() {
    let mut stage = ClusterFixture::with_house(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    while stage.state(1) != ChannelState::Late {
        stage.wait(10_000);
    }
    for x in 0..20 {
        stage.order_frame();
        let drawn = stage.drawn(1);
        let is_sent = stage.frames.last().is_some_and(|(_, frame)| frame.frame == drawn.frame);
        stage.draw(&[0], 5_000);
        stage.edit(moving(TREE, f64::from(x)));
        stage.prepare(SessionId(0));
        stage.wait(7_000);
        if is_sent {
            stage.say(SessionId(1), ServerMessage::Drawn(drawn));
        }
        stage.prepare(SessionId(1));
    }
    assert_eq!(stage.state(1), ChannelState::Live);
}
