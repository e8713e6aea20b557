//! Progress of scenes that are being opened, and the channels that showed a frame.

use polyptych_protocol::feedback::{ChannelState, Shown};
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::progress::{OpenProgress, OpenStage};
use polyptych_protocol::request::{Request, Response};

use super::{ClusterFixture, SessionId};
use crate::{ClientRequest, ImportedScene};

impl ClusterFixture {
    /// Returns the scenes that are being opened, as the status has them.
    fn openings(&self) -> Vec<String> {
        let openings = self.cluster.status(self.now).opening;
        openings.iter().map(|opening| format!("{}: {}", opening.scene, opening.progress)).collect()
    }

    fn bake(&mut self, job: ClientRequest, percent: u8) {
        let progress = OpenProgress { stage: OpenStage::Baking, percent };
        self.cluster.handle_progress(job, progress);
        self.read();
    }
}

#[test]
fn a_client_and_the_status_are_told_each_step_of_an_opening() {
    let mut stage = ClusterFixture::new(4);
    let id = stage.request(Request::OpenScene { path: "a/town.glb".into(), scene: None });
    assert_eq!(stage.openings(), ["town: waiting for its turn"]);
    let job = stage.imports[0];
    stage.bake(job, 40);
    assert_eq!(stage.openings(), ["town: baking 40 %"]);
    let other = ClientRequest { id: RequestId(99), ..job };
    stage.bake(other, 50);
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    assert_eq!(stage.openings(), ["town: preparing 0 %"]);
    for session in 0..3 {
        stage.prepare(SessionId(session));
    }
    assert_eq!(stage.openings(), ["town: preparing 75 %"]);
    // Who repeats itself is no news.
    stage.prepare(SessionId(0));
    stage.prepare(SessionId(3));
    assert_eq!(stage.openings(), [] as [String; 0]);
    let told: Vec<&str> = stage.progress.iter().map(|(_, progress)| progress.as_str()).collect();
    let preparing = ["0", "25", "50", "75", "100"].map(|percent| format!("preparing {percent} %"));
    assert_eq!(told[0], "baking 40 %");
    assert_eq!(told[1..], preparing);
    assert!(stage.progress.iter().all(|(of, _)| *of == id));
}

#[test]
fn a_client_that_is_back_hears_what_became_of_the_scene_that_it_opened() {
    for is_done in [false, true] {
        let mut stage = ClusterFixture::new(1);
        let id = stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
        let job = stage.imports[0];
        stage.cluster.handle_client_gone(stage.now, job.client);
        stage.bake(job, 40);
        let finish = |stage: &mut ClusterFixture| {
            stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
            stage.read();
            stage.prepare_all();
        };
        if is_done {
            finish(&mut stage);
        }
        assert_eq!((stage.progress.len(), stage.replies.len()), (0, 0), "nobody is there");
        let (back, asked) = (SessionId(77), RequestId(500));
        stage.cluster.handle_client(back, "back".into());
        let ask = |stage: &mut ClusterFixture, of: RequestId| {
            let request = Request::OpenOutcome { session: job.client.0, of };
            stage.cluster.handle_request(stage.now, back, asked, request);
            stage.read();
        };
        ask(&mut stage, id);
        if !is_done {
            stage.bake(job, 60);
            assert_eq!(stage.progress, [(asked, "baking 60 %".to_owned())]);
            finish(&mut stage);
        }
        let [(of, Ok(Response::SceneOpened(_)))] = &stage.replies[..] else {
            panic!("one answer: {:?}", stage.replies)
        };
        assert_eq!(*of, asked);
        // It is answered once; and nobody knows of another request.
        for unknown in [id, RequestId(9999)] {
            stage.replies.clear();
            ask(&mut stage, unknown);
            let refused = stage.replies[0].1.as_ref().expect_err("refused");
            assert!(refused.reason.contains("open it again"), "{refused}");
        }
    }
}

#[test]
fn a_failed_bake_is_not_being_opened_any_more() {
    let mut stage = ClusterFixture::new(1);
    stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports[0];
    stage.cluster.handle_import(stage.now, job, Err("town.glb: not glTF".into()));
    stage.bake(job, 90);
    assert_eq!((stage.openings().len(), stage.progress.len()), (0, 0));
}

#[test]
fn notes_of_a_scene_stand_in_status_and_memory_until_another_is_shown() {
    let mut stage = ClusterFixture::new(1);
    let notes = vec!["animations: 1, not played".to_owned()];
    stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let imported = ClusterFixture::imported();
    let ImportedScene { scene, mut summary, .. } = imported.clone();
    summary.notes.clone_from(&notes);
    let job = stage.imports[0];
    stage.cluster.handle_import(stage.now, job, Ok(ImportedScene { scene, summary, ..imported }));
    assert_eq!(stage.cluster.status(stage.now).notes, [] as [String; 0], "not shown yet");
    stage.read();
    stage.prepare(SessionId(0));
    assert_eq!(stage.cluster.status(stage.now).notes, notes);
    assert_eq!(stage.memories.last().map(|memory| &memory.notes), Some(&notes));
    stage.request(Request::CloseScene);
    stage.prepare(SessionId(0));
    assert_eq!(stage.cluster.status(stage.now).notes, [] as [String; 0]);
}

#[test]
fn a_frame_without_servers_was_shown_by_none_and_one_with_a_late_channel_by_some() {
    let mut empty = ClusterFixture::empty(2);
    empty.request(Request::RenderFrame { camera: None, time_s: None });
    let Some((_, Ok(Response::Frame(feedback)))) = empty.replies.last() else { panic!("no frame") };
    assert_eq!(feedback.shown(), Shown::ByNone);
    assert!(feedback.missing_channels().all(|channel| channel.reason.is_some()), "{feedback:?}");
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::RenderFrame { camera: None, time_s: None });
    stage.draw(&[0], 1_000);
    stage.wait(3_000_000);
    let Some((_, Ok(Response::Frame(feedback)))) = stage.replies.last() else { panic!("no frame") };
    assert_eq!(feedback.shown(), Shown::BySome);
    let missing: Vec<&str> = feedback.missing_channels().map(|c| c.name.as_str()).collect();
    assert_eq!(missing, ["c1"]);
}

#[test]
fn a_wall_of_late_channels_opens_a_scene_when_the_first_has_it() {
    let mut stage = ClusterFixture::new(3);
    stage.order_frame();
    stage.wait(100_000);
    assert!((0..3).all(|channel| stage.state(channel) == ChannelState::Late));
    let id = stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports[0];
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    assert_eq!(stage.openings(), ["town: preparing 0 %"], "nobody shows it");
    let is_answered = |stage: &ClusterFixture| stage.replies.iter().any(|(of, _)| *of == id);
    assert!(!is_answered(&stage));
    stage.prepare(SessionId(1));
    assert!(is_answered(&stage), "the others may hang");
    assert_eq!(stage.openings(), [] as [String; 0]);
}

#[test]
fn a_change_that_a_late_channel_has_is_shown_once_the_others_are_late_too() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[1], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(0), ChannelState::Late);
    let id = stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports[0];
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    stage.prepare(SessionId(0));
    let is_answered = |stage: &ClusterFixture| stage.replies.iter().any(|(of, _)| *of == id);
    assert!(!is_answered(&stage), "the other one is in time");
    // The one in time hangs: neither does it draw, nor get ready.
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(1), ChannelState::Preparing, "it has not the scene that is shown");
    assert!(is_answered(&stage));
}
