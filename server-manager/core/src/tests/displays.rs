//! Output modes of displays, and the skew between displays.

use polyptych_protocol::feedback::Skew;
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::server_message::FramePresented;

use super::*;

impl ClusterFixture {
    /// A channel shows the last frame that was swapped, so long after the swap.
    fn show(&mut self, channel: u16, after: Micros, clock_error_us: u32) {
        let shown = FramePresented {
            epoch: Epoch(7),
            frame: self.cluster.swapped,
            channel: ChannelId(channel),
            at_us: self.now + after,
            clock_error_us,
            is_unscheduled: false,
        };
        // The report comes at once.
        let from = SessionId(u64::from(channel));
        self.cluster.handle_status(shown.at_us, from, ServerMessage::Shown(shown));
        self.read();
    }

    fn mode_of_last_frame(&self) -> OutputMode {
        self.frames.last().expect("a frame was sent").1.presentation.output_mode
    }
}

#[test]
fn a_paused_wall_draws_one_frame_for_a_mode_and_answers_when_it_is_swapped() {
    let mut stage = ClusterFixture::new(2);
    stage.memories.clear();
    let id = stage.request(Request::SetDisplays(OutputMode::Blank));
    assert_eq!(stage.frames.len(), 2, "one frame, for each server");
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Blank);
    stage.draw(&[0], 1_000);
    assert_eq!((stage.replies.len(), stage.memories.len()), (0, 0), "not all have drawn it");
    stage.draw(&[1], 1_000);
    assert!(stage.is_answered_by_a_whole_frame(id), "{:?}", stage.replies);
    assert_eq!(
        stage.memories.pop().expect("remembered").presentation.output_mode,
        OutputMode::Blank
    );
    assert_eq!(stage.cluster.status(stage.now).presentation.output_mode, OutputMode::Blank);
    stage.wait(1_500_000);
    assert_eq!(stage.swaps.len(), 1, "and no frame more");
    // It holds for all frames that follow, captures among them.
    stage.request(Request::Capture { time_s: None });
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Blank);
    stage.draw(&[0, 1], 1_000);
    stage.request(Request::SetDisplays(OutputMode::Normal));
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Normal);
}

#[test]
fn a_wall_that_runs_changes_its_mode_in_the_order_of_requests() {
    let mut stage = ClusterFixture::new(1);
    stage.request(Request::Run(Pacing::Rate(10.0)));
    stage.draw(&[0], 1_000);
    stage.order_frame();
    let id = stage.request(Request::SetDisplays(OutputMode::Identify));
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Normal);
    stage.draw(&[0], 1_000);
    stage.wait(0);
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Identify);
    assert!(stage.replies.iter().all(|(of, _)| *of != id));
    stage.draw(&[0], 1_000);
    assert!(stage.is_answered_by_a_whole_frame(id), "{:?}", stage.replies);
}

#[test]
fn a_joiner_of_a_paused_wall_that_is_black_gets_a_frame_that_says_so() {
    let mut stage = ClusterFixture::new(2);
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.request(Request::SetDisplays(OutputMode::Blank));
    stage.draw(&[0], 1_000);
    stage.clear();
    stage.join(SessionId(1), 1).expect("joined");
    assert!(stage.frames.is_empty());
    stage.prepare_all();
    assert_eq!(stage.frames.last().expect("sent").0, SessionId(1));
    assert_eq!(stage.mode_of_last_frame(), OutputMode::Blank);
    stage.draw(&[0, 1], 1_000);
    stage.wait(1_500_000);
    assert_eq!(stage.swaps.len(), 1, "one frame, though nobody ordered it");
}

#[test]
fn a_restored_wall_is_as_black_as_it_was_and_shows_itself_to_servers_that_come_back() {
    let mut stage = ClusterFixture::new(1);
    stage.request(Request::SetDisplays(OutputMode::Blank));
    stage.draw(&[0], 1_000);
    let mut memory = stage.memories.pop().expect("remembered");
    for displays in [OutputMode::Blank, OutputMode::Normal] {
        memory.presentation.output_mode = displays;
        let mut stage = ClusterFixture::empty(2);
        stage.cluster = Cluster::restore(wall(2), Epoch(7), &memory);
        stage.cluster.handle_client(CLIENT, "test".into());
        for index in 0..2 {
            stage.join(SessionId(u64::from(index)), index).expect("joined");
            stage.prepare_all();
        }
        assert_eq!(stage.frames.len(), 1, "the first server is not held up by the second");
        stage.draw(&[0], 1_000);
        stage.wait(0);
        assert_eq!(stage.frames.len(), 3, "and one for the second, which goes to both");
        stage.draw(&[0, 1], 1_000);
        stage.wait(1_500_000);
        assert_eq!(stage.swaps.len(), 2);
        // Another wall's memory says nothing about displays: to be on the safe side, it holds.
        assert_eq!(stage.cluster.presentation.output_mode, displays);
    }
    // Once a client has ordered frames, whoever comes is given the present one.
    memory.presentation.output_mode = OutputMode::Normal;
    let mut stage = ClusterFixture::empty(1);
    stage.cluster = Cluster::restore(wall(1), Epoch(7), &memory);
    stage.cluster.handle_client(CLIENT, "test".into());
    stage.order_frame();
    stage.join(SessionId(0), 0).expect("joined");
    stage.prepare_all();
    assert_eq!(stage.frames.len(), 1);
    assert_eq!(stage.state(0), ChannelState::Live);
}

#[test]
fn a_present_call_that_is_five_milliseconds_late_is_read_as_that() {
    let mut stage = ClusterFixture::new(3);
    let mut frames = Vec::new();
    for n in 0..200 {
        let id = stage.order_frame();
        stage.draw(&[0, 1, 2], 10_000);
        let reply = stage.replies.iter().find(|(of, _)| *of == id).expect("answered");
        let Ok(Response::Frame(feedback)) = &reply.1 else { panic!("no feedback") };
        frames.push(feedback.channels[1].skew);
        // Reports come in any order; every tenth call is late by twice as much.
        stage.show(1, 15_000 + u64::from(n % 10 == 0) * 5_000, 80);
        stage.show(0, 10_000, 40);
        stage.show(2, 10_200, 60);
    }
    let status = stage.cluster.status(stage.now);
    let expected = Skew {
        frames: 200,
        p50_us: 5_000,
        p99_us: 10_000,
        max_us: 10_000,
        clock_error_us: Some(80),
    };
    assert_eq!(status.channels[1].skew, expected);
    assert_eq!((status.channels[0].skew.max_us, status.channels[2].skew.p50_us), (0, 200));
    let statistics = stage.cluster.statistics(true);
    assert_eq!(statistics.channels[1].swap_skew_us.p50, 5_000.0);
    assert_eq!((statistics.swap_skew_us.p50, statistics.swap_skew_us.count), (5_000.0, 200));
    // Feedback has it too, at most a second old; a reset of the statistics is none of the skew.
    let last = frames.last().expect("feedback");
    assert_eq!((last.p50_us, last.clock_error_us), (5_000, Some(80)));
    assert!(last.frames >= 100, "{last:?}: a second of 10 ms frames");
    assert_eq!(stage.cluster.status(stage.now).channels[1].skew.frames, 200);
}

#[test]
fn a_server_that_comes_back_has_no_skew_of_its_former_life() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0, 1], 1_000);
    stage.show(0, 0, 1);
    stage.show(1, 700, 1);
    assert_eq!(stage.cluster.status(stage.now).channels[1].skew.max_us, 700);
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.join(SessionId(1), 1).expect("joined");
    assert_eq!(stage.cluster.status(stage.now).channels[1].skew, Skew::default());
}
