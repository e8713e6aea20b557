//! Servers that lie, repeat themselves, or work on what nobody wants any more.

use super::*;
use std::sync::Arc;

/// A scene of this name, as a bake gives it.
fn imported(name: &str) -> ImportedScene {
    let scene = SceneRef { name: name.into(), manifest: BlobHash::of(name.as_bytes()) };
    let summary = SceneSummary { name: name.into(), ..*ClusterFixture::imported().summary };
    ImportedScene::of_file(scene, summary, Arc::default())
}

impl ClusterFixture {
    pub(super) fn open(&mut self, name: &str) -> RequestId {
        let id = self.request(Request::OpenScene { path: format!("{name}.glb"), scene: None });
        let job = self.imports.pop().expect("an import");
        self.cluster.handle_import(self.now, job, Ok(imported(name)));
        self.read();
        id
    }

    pub(super) fn reply(&self, id: RequestId) -> Option<&Result<Response, RequestError>> {
        self.replies.iter().find(|(of, _)| *of == id).map(|(_, reply)| reply)
    }

    /// Time passes in which all servers give signs of life.
    pub(super) fn live_for(&mut self, micros: Micros) {
        for _ in 0..micros / 1_000_000 {
            self.wait(1_000_000);
        }
        self.wait(micros % 1_000_000);
    }

    /// The oldest preparation that was sent to a server is cancelled there.
    pub(super) fn cancel(&mut self, session: SessionId) {
        let at = self.prepares.iter().position(|(to, _)| *to == session).expect("a preparation");
        let (_, Prepare { epoch, revision, .. }) = self.prepares.remove(at);
        let reason = "a newer preparation has come".to_owned();
        self.say(session, ServerMessage::PrepareFailed { epoch, revision, reason });
    }
}

#[test]
fn replaces_a_scene_that_is_not_ready_half_a_second_after_the_next_was_opened() {
    let mut stage = ClusterFixture::new(2);
    let heavy = stage.open("heavy");
    stage.prepare(SessionId(0));
    stage.live_for(30_000_000);
    assert_eq!(stage.reply(heavy), None, "nothing else was asked for");
    let good = stage.open("good");
    stage.wait(400_000);
    assert_eq!(stage.reply(heavy), None, "it may be ready in a moment");
    stage.wait(200_000);
    let refused = stage.reply(heavy).expect("answered").as_ref().expect_err("refused");
    assert!(refused.reason.contains("another scene was opened"), "{refused:?}");
    // The busy server is sent the next state though it owes an answer, and stops.
    assert_eq!(stage.prepares.iter().filter(|(to, _)| *to == SessionId(1)).count(), 2);
    stage.cancel(SessionId(1));
    stage.prepare_all();
    let Some(Ok(Response::SceneOpened(summary))) = stage.reply(good) else { panic!("not opened") };
    assert_eq!(summary.name, "good");
    for _ in 0..20 {
        stage.order_frame();
        stage.draw(&[0, 1], 1_000);
    }
    assert_eq!((stage.state(0), stage.state(1)), (ChannelState::Live, ChannelState::Live));
}

#[test]
fn a_server_that_prepares_a_scene_of_long_ago_is_sent_the_shown_one() {
    let mut stage = ClusterFixture::new(2);
    let heavy = stage.open("heavy");
    stage.prepare(SessionId(0));
    // The wall goes on without the server that takes too long.
    stage.live_for(120_000_000);
    assert!(matches!(stage.reply(heavy), Some(Ok(Response::SceneOpened(_)))));
    assert_eq!(stage.state(1), ChannelState::Preparing);
    stage.open("good");
    stage.prepare(SessionId(0));
    let sent = stage.prepares.iter().filter(|(to, _)| *to == SessionId(1));
    assert_eq!(sent.count(), 2, "it is busy with what nobody wants");
    // Nothing more than these two, whatever is opened meanwhile.
    for name in ["a", "b", "c"] {
        stage.open(name);
        stage.prepare(SessionId(0));
    }
    assert_eq!(stage.prepares.iter().filter(|(to, _)| *to == SessionId(1)).count(), 2);
    stage.cancel(SessionId(1));
    stage.prepare_all();
    assert_eq!(stage.state(1), ChannelState::Live);
    assert_eq!(stage.replicas[&SessionId(1)], stage.cluster.shown);
}

#[test]
fn a_scene_that_no_display_is_ready_for_is_waited_for_and_never_called_open() {
    let mut stage = ClusterFixture::new(2);
    let shown = stage.cluster.shown.revision;
    let large = stage.open("large");
    stage.live_for(600_000_000);
    assert_eq!((stage.reply(large), stage.cluster.shown.revision), (None, shown), "dark");
    let told = stage.progress.iter().filter(|(of, _)| *of == large).count();
    assert!(told >= 600 / 120 * 2, "{told} times: clients wait 120 s for news");
    // Another change does not wait for it longer than for any.
    let edit = stage.request(Request::SetFog(Some(polyptych_scene::Fog::even(50.0))));
    stage.live_for(130_000_000);
    let Some(Err(refused)) = stage.reply(large) else { panic!("called open") };
    assert!(refused.reason.contains("no display was ready"), "{refused:?}");
    stage.cancel(SessionId(0));
    stage.cancel(SessionId(1));
    stage.prepare_all();
    assert!(matches!(stage.reply(edit), Some(Ok(_))));
    // A slow one is shown when the first display has it.
    let large = stage.open("large");
    stage.live_for(300_000_000);
    stage.prepare(SessionId(1));
    stage.live_for(130_000_000);
    assert!(matches!(stage.reply(large), Some(Ok(Response::SceneOpened(_)))));
}

#[test]
fn a_scene_that_is_opened_twice_is_prepared_once() {
    let mut stage = ClusterFixture::new(1);
    let first = stage.open("town");
    let second = stage.open("town");
    stage.live_for(2_000_000);
    assert_eq!((stage.reply(first), stage.prepares.len()), (None, 1));
    stage.prepare_all();
    assert!([first, second].iter().all(|id| matches!(stage.reply(*id), Some(Ok(_)))));
}

#[test]
fn a_server_that_prepares_wrong_states_is_asked_ever_more_rarely() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    let mut asked = 0;
    let end = stage.now + 60_000_000;
    let wrong = FrameRendered { digest: Digest(9), ..stage.drawn(1) };
    stage.say(SessionId(1), ServerMessage::Drawn(wrong));
    while stage.now < end {
        while let Some(at) = stage.prepares.iter().position(|(to, _)| *to == SessionId(1)) {
            let (_, prepare) = stage.prepares.remove(at);
            asked += 1;
            let (epoch, revision) = (prepare.epoch, prepare.revision);
            let features = Vec::new();
            let digest = Digest(9);
            let (scene_bytes, detail_reach) = (0, None);
            let lie = Prepared { epoch, revision, digest, features, scene_bytes, detail_reach };
            stage.say(SessionId(1), ServerMessage::Prepared(lie));
        }
        stage.wait(10_000);
    }
    assert!((8..=14).contains(&asked), "asked {asked} times in a minute");
    // One that is well again, and was for a while, is asked at once.
    stage.live_for(8_000_000);
    stage.prepare_all();
    assert_eq!(stage.state(1), ChannelState::Live);
    stage.live_for(40_000_000);
    stage.order_frame();
    let wrong = FrameRendered { digest: Digest(9), ..stage.drawn(1) };
    stage.say(SessionId(1), ServerMessage::Drawn(wrong));
    assert_eq!(stage.prepares.len(), 1);
}

#[test]
fn pauses_of_a_server_that_cannot_prepare_double_up_to_eight_seconds() {
    let mut stage = ClusterFixture::empty(1);
    stage.join(SessionId(0), 0).expect("joined");
    stage.replicas.insert(SessionId(0), Replica::default());
    for pause in [2_000_000, 4_000_000, 8_000_000, 8_000_000, 8_000_000] {
        let (_, prepare) = stage.prepares.remove(0);
        let (epoch, revision) = (prepare.epoch, prepare.revision);
        let reason = "the disk is full".to_owned();
        stage.say(SessionId(0), ServerMessage::PrepareFailed { epoch, revision, reason });
        stage.live_for(pause - 100_000);
        assert!(stage.prepares.is_empty(), "before {pause} us");
        stage.wait(200_000);
        assert_eq!(stage.prepares.len(), 1, "after {pause} us");
    }
}

/// Frames in which channel 2 draws for this long, and says another time.
fn deadline_with(liar_takes: Micros, liar_says: u32) -> Micros {
    let mut stage = ClusterFixture::new(3);
    for _ in 0..200 {
        stage.order_frame();
        stage.draw(&[0, 1], 20_000);
        // Just in time, whatever the deadline is by now.
        let left = stage.cluster.deadline.length().min(liar_takes).saturating_sub(21_000);
        stage.wait(left);
        let drawn = FrameRendered { draw_us: liar_says, ..stage.drawn(2) };
        stage.say(SessionId(2), ServerMessage::Drawn(drawn));
    }
    stage.cluster.deadline.length()
}

#[test]
fn one_server_of_three_cannot_move_the_deadline_far() {
    let honest = deadline_with(20_000, 20_000);
    assert_eq!(honest, 80_000);
    assert_eq!(deadline_with(20_000, u32::MAX), honest, "it cannot have drawn before the frame");
    assert_eq!(deadline_with(20_000, 0), honest, "the others are slower");
    let slow = deadline_with(2_000_000, u32::MAX);
    assert!(slow <= 4 * honest, "{slow}: as slow as it may be at each frame");
}

#[test]
fn a_server_whose_gpu_was_lost_is_sent_the_shown_state_and_holds_up_nobody() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    assert!(stage.swaps.is_empty());
    stage.say(SessionId(1), ServerMessage::StateLost { reason: "the GPU was lost".into() });
    assert_eq!(stage.swaps.len(), 1, "the frame does not wait for it");
    let channel = stage.cluster.status(stage.now).channels.swap_remove(1);
    assert_eq!(channel.state, ChannelState::Preparing);
    assert_eq!(channel.reason.as_deref(), Some("the GPU was lost"));
    let (to, prepare) = stage.prepares.last().expect("sent at once");
    assert_eq!((*to, prepare.base), (SessionId(1), None), "the whole state");
    stage.prepare_all();
    for _ in 0..2 {
        stage.order_frame();
        stage.draw(&[0, 1], 1_000);
    }
    assert_eq!(stage.state(1), ChannelState::Live);
}

#[test]
fn bad_requests_are_answered_with_what_would_be_right() {
    let mut stage = ClusterFixture::new(1);
    let nan = Camera { scale: f64::NAN, ..Camera::IDENTITY };
    stage.request(Request::SetCamera(nan));
    stage.request(Request::Run(Pacing::Rate(f64::INFINITY)));
    stage.request(Request::SetExposure(-1.0));
    stage.request(Request::OpenScene { path: String::new(), scene: None });
    stage.request(Request::OpenScene { path: "a.glb".into(), scene: Some("a".repeat(257)) });
    stage.request(Request::SetHead(DVec3::new(0.0, 0.0, -5.0).into()));
    stage.request(Request::SetBounds(QualityBounds { error_px: -1.0, rate_fps: None }));
    stage.request(Request::SetBounds(QualityBounds { error_px: 1.0, rate_fps: Some(f64::NAN) }));
    assert_eq!(stage.replies.len(), 8);
    assert!(stage.replies.iter().all(|(_, reply)| reply.is_err()), "{:?}", stage.replies);
}
