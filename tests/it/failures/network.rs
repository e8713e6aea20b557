//! Connections that carry rubbish, break off or fall silent, and replicas that disagree.

use polyptych_client::blocking::FeedbackStream;
use polyptych_client::{ChannelFeedback, ChannelState, FrameId, Pacing};
use polyptych_protocol::command::{Command, Frame, Swap};
use polyptych_protocol::ids::Digest;
use polyptych_protocol::server_message::{FrameRendered, ServerMessage};
use polyptych_wall::ChannelId;

use super::{RATE, Run, brisk, hold, in_time};
use crate::harness::local_wall::{ANY_PORT, LocalWall};
use crate::harness::place::TestDir;
use crate::harness::stub_server::StubServer;
use crate::harness::wait;

#[test]
fn corrupted_bytes_end_a_connection_with_a_reason_on_both_sides() {
    in_time(|| {
        let faults =
            ["at 40 corrupt down front-1-1", "at 85 corrupt up front-2-1", "at 130 cut front-1-2"];
        let run = Run::new(&faults, 175);
        for index in 0..3 {
            let fault = run.fault(index);
            fault.went_through(&["lost", "live"])?;
            let back_ms = fault.ms("live_again_ms")?;
            hold(back_ms <= 1000.0, "milliseconds to live again", &back_ms)?;
            fault.spared_the_others()?;
        }
        let size = "frame size too big";
        assert!(run.said(&["not connected", size]), "the server says why: {}", run.log);
        assert!(run.said(&["server is lost", "front-1-1", "it left:", size]), "{}", run.log);
        assert!(
            run.said(&["server is lost", "front-2-1", size]),
            "the manager says why: {}",
            run.log
        );
        assert!(run.said(&["not connected", "the connection failed:", size]), "{}", run.log);
        assert_eq!(run.report["restarts"], 0, "no process was needed for it");
        Ok(())
    });
}

#[test]
fn a_half_open_connection_is_lost_after_the_heartbeat_and_made_again() {
    in_time(|| {
        let again = "at 60 unplug 1s front-2-2";
        let run = Run::new(&["at 40 unplug 3500ms front-2-2", again], 210);
        let fault = run.fault(0);
        assert_eq!(run.fault(1).record["skipped"], "its server is unplugged already");
        fault.went_through(&["late", "lost", "live"])?;
        let before_the_end = run.log.split("the manager ends").next().unwrap_or_default();
        let lines = |part: &str| before_the_end.lines().filter(|l| l.contains(part)).count();
        assert_eq!(lines("server is lost"), 1, "{}", run.log);
        let not_connected = lines("not connected; trying again for ever");
        assert!((1..=2).contains(&not_connected), "one line for each change: {}", run.log);
        assert!(run.log.contains("silent for more than 2000 ms"), "{}", run.log);
        let back_ms = fault.ms_after("live_again_ms")?;
        hold(back_ms <= 2500.0, "milliseconds from the plug to live", &back_ms)?;
        fault.spared_the_others()?;
        run.kept_its_pace()
    });
}

/// A wall of a stub and a real server, moving, and the feedback of its frames.
fn wall_with_stub() -> (LocalWall, StubServer, FeedbackStream) {
    let wall = brisk(2, 1);
    let mut local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    local.start_server(&wall.channels[1].server);
    let stub = StubServer::start(&local, &wall.channels[0].name);
    let client = local.client();
    client.start_rendering(Pacing::Rate(RATE)).expect("runs");
    let mut feedbacks = client.feedback().expect("a stream");
    let is_live = |channel: &ChannelFeedback| channel.state == ChannelState::Live;
    let all_live = feedbacks.find(|feedback| feedback.channels.iter().all(is_live));
    assert!(all_live.is_some(), "the stream goes on");
    (local, stub, feedbacks)
}

#[test]
fn a_replica_whose_digest_differs_is_given_the_state_anew_and_not_shown_meanwhile() {
    let (mut local, stub, mut feedbacks) = wall_with_stub();
    let honest = stub.drawn_honestly();
    // So that there is a time in which it is not prepared.
    stub.hold_prepared();
    let lied_about = stub.answer_once(move |frame: &Frame| {
        let FrameRendered { digest: Digest(right), .. } = honest(frame);
        ServerMessage::Drawn(FrameRendered { digest: Digest(!right), ..honest(frame) })
    });
    let away = feedbacks.find(|f| f.channels[0].state != ChannelState::Live).expect("away");
    assert_eq!(away.channels[0].state, ChannelState::Preparing, "{away:?}");
    let reason = away.channels[0].reason.clone().unwrap_or_default();
    assert!(reason.contains("another digest"), "the client is told: {reason:?}");
    assert_eq!(away.channels[1].state, ChannelState::Live, "{away:?}");
    local.manager.await_line(&["ERROR", "resynchronising a server", "another digest"]);
    let meanwhile = feedbacks.find(|f| f.frame.0 > away.frame.0 + 10).expect("frames go on");
    assert_eq!(meanwhile.channels[0].state, ChannelState::Preparing, "{meanwhile:?}");
    stub.release_prepared();
    let back = feedbacks.find(|f| f.channels[0].state == ChannelState::Live).expect("back");
    let limit = meanwhile.frame.0 + (RATE * 1.0) as u64;
    assert!(back.frame.0 <= limit, "live within a second: {} {}", meanwhile.frame, back.frame);
    let heard = stub.heard();
    let lied_about = lied_about.recv_timeout(wait::LIMIT).expect("a frame");
    let at = |is_it: &dyn Fn(&Command) -> bool| heard.iter().rposition(is_it).expect("heard");
    let drawn = at(&|command| matches!(command, Command::Frame(f) if f.frame == lied_about));
    let snapshot = at(&|command| matches!(command, Command::Prepare(p) if p.base.is_none()));
    assert!(snapshot > drawn, "the whole state is sent anew");
    let is_swap =
        |c: &Command| matches!(c, Command::Swap(Swap { frame, .. }) if *frame == lied_about);
    assert!(!heard.iter().any(is_swap), "frame {lied_about} is not to be shown");
}

#[test]
fn messages_that_are_too_large_or_make_no_sense_end_the_connection() {
    let (mut local, stub, mut feedbacks) = wall_with_stub();
    let oversized = vec![0xff; 64];
    let malformed = [&5u32.to_le_bytes()[..], b"\x77\x66\x55\x44\x33"].concat();
    for (bytes, reason) in
        [(oversized, "frame size too big"), (malformed, "it sent something malformed")]
    {
        stub.send_raw(bytes);
        let away = feedbacks.find(|f| f.channels[0].state == ChannelState::Lost).expect("away");
        let told = away.channels[0].reason.clone().unwrap_or_default();
        assert!(told.contains(reason), "the client is told: {told:?}");
        assert_eq!(away.channels[1].state, ChannelState::Live, "the wall goes on");
        local.manager.await_line(&["server is lost", reason]);
        let goodbye = wait::until("the stub is told", || stub.goodbyes().pop());
        assert!(goodbye.contains(reason), "{goodbye:?}");
        stub.rejoin();
        assert!(feedbacks.any(|f| f.channels[0].state == ChannelState::Live), "it rejoins");
    }
}

#[test]
fn reports_of_the_wrong_frame_or_channel_change_nothing() {
    let (local, stub, mut feedbacks) = wall_with_stub();
    let honest = stub.drawn_honestly();
    // Of a frame that is not there yet, and of a channel of another server.
    for change in [
        |drawn: FrameRendered| FrameRendered { frame: FrameId(drawn.frame.0 + 1000), ..drawn },
        |drawn: FrameRendered| FrameRendered { channel: ChannelId(1), ..drawn },
    ] {
        let honest = honest.clone();
        let answered = stub.answer_once(move |frame| ServerMessage::Drawn(change(honest(frame))));
        let frame = answered.recv_timeout(wait::LIMIT).expect("a frame");
        let of_frame = feedbacks.find(|feedback| feedback.frame == frame).expect("its feedback");
        assert!(of_frame.channels[0].draw_us.is_none(), "it was not believed: {of_frame:?}");
        assert_eq!(of_frame.channels[0].state, ChannelState::Late, "{of_frame:?}");
        assert!(of_frame.channels[1].draw_us.is_some(), "the other drew it: {of_frame:?}");
        assert!(feedbacks.any(|f| f.channels[0].state == ChannelState::Live), "it rejoins");
    }
    assert!(!local.manager.output().contains("server is lost"), "the connection holds");
}
