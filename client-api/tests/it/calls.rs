//! Each request and its typed reply; several at once; handles that are asked, awaited, dropped.

use std::time::Duration;

use polyptych_client::glam::DVec3;
use polyptych_client::{
    AmbientOcclusion, Camera, Client, ClientError, DepthOfField, Digest, EnvironmentSource, Epoch,
    Fog, FrameId, Glow, HeadPose, OPEN_REQUESTS_MAX, OpenProgress, OpenStage, OutputMode, Pacing,
    Presentation, Quantiles, Request, RequestId, ResolutionScales, Response, Revision,
    SceneFeatures, SceneSummary, Statistics, TestPattern, ToneMapper, Tuned, View, Wall,
    WallStatus, calibration_change::CalibrationChange,
};
use polyptych_protocol::request::MessageToClient;

use crate::manager::{feedback, pair};

pub fn summary() -> SceneSummary {
    SceneSummary {
        name: "town".into(),
        revision: Revision(3),
        bounds: None,
        triangles: 12,
        features: SceneFeatures::default(),
        notes: Vec::new(),
        exposure: 1.0,
        clips: Vec::new(),
    }
}

fn status() -> WallStatus {
    WallStatus {
        wall: "lab".into(),
        epoch: Epoch(7),
        revision: Revision(3),
        digest: Digest(1),
        frame: FrameId(9),
        scene: None,
        deadline_ms: 50.0,
        error_in_force_px: 0.0,
        presentation: Presentation::new(HeadPose::facing_forward(DVec3::X, 0.05)),
        channels: Vec::new(),
        clients: vec!["test".into()],
        warnings: Vec::new(),
        notes: Vec::new(),
        opening: Vec::new(),
        memory_bytes: 0,
        resolution_scale: 1.0,
        environment: None,
        rest: polyptych_client::RestStatus::default(),
        devices: Vec::new(),
        leader: None,
    }
}

fn statistics() -> Statistics {
    let spread = Quantiles::default();
    Statistics {
        frames: 3,
        complete: 2,
        ahead: 1,
        seconds: 0.1,
        frame_ms: spread,
        draw_ms: spread,
        barrier_us: spread,
        swap_skew_us: spread,
        late: 0,
        triangles: 12,
        draw_calls: 1,
        draws_occluded: 0,
        error_bound_px: 0.0,
        error_in_force_px: spread,
        largest_error_px: 0.0,
        gpu_bytes: 0,
        limiting_channel: None,
        bytes_per_frame: 200.0,
        features: Vec::new(),
        channels: Vec::new(),
        resolution_scale: ResolutionScales::FULL,
    }
}

pub fn wall() -> Wall {
    let text = r#"
        [wall]
        name = "lab"
        [[screen]]
        name = "front"
        size = [1.92, 1.08]
        center = [0.0, 0.0, -1.3]
        [screen.tiles]
        pixels = [1920, 1080]
    "#;
    polyptych_wall_file::parse(text, "lab.toml".as_ref()).expect("a wall")
}

fn tuned() -> Tuned {
    Tuned { revision: Revision(3), frames: 1, feedback: feedback(9) }
}

/// Answers every request but a capture as a manager would.
pub fn answer(request: &Request) -> Response {
    match request {
        Request::OpenScene { .. } => Response::SceneOpened(summary()),
        Request::RenderFrame { time_s, .. } => {
            Response::Frame(feedback(time_s.map_or(9, |t| t as _)))
        }
        Request::SetDisplays(_) | Request::SetPattern(_) => Response::Frame(feedback(9)),
        Request::Status => Response::Status(Box::new(status())),
        Request::DescribeWall => Response::Wall(Box::new(wall())),
        Request::Statistics { .. } => Response::Statistics(Box::new(statistics())),
        Request::Tune { .. } => Response::Tuned(tuned()),
        _ => Response::Done,
    }
}

/// Sets all that is light.
async fn set_light(client: &Client) {
    client.set_exposure(0.5).await.expect("set");
    client.set_tone(ToneMapper::Aces).await.expect("set");
    client.set_fog(Some(Fog::even(80.0))).await.expect("set");
    client.set_glow(Some(Glow::new(0.5))).await.expect("set");
    client.set_ambient_occlusion(Some(AmbientOcclusion { radius: 0.5 })).await.expect("set");
    client.set_depth_of_field(Some(DepthOfField::new(12.0))).await.expect("set");
    client.set_environment(EnvironmentSource::Sky).await.expect("set");
}

#[tokio::test]
async fn every_call_sends_its_request_and_gives_its_reply() {
    let (client, mut manager) = pair().await;
    let camera = Camera::IDENTITY.with_scale(2.0);
    let script = tokio::spawn(async move {
        let mut seen = Vec::new();
        while let Some((id, request)) = manager.next().await {
            seen.push(request.clone());
            manager.reply(id, answer(&request)).await;
        }
        seen
    });
    assert_eq!((client.wall_name(), client.address()), ("lab", "pipe"));
    assert_eq!(client.open_scene("a.glb").await.expect("opened"), summary());
    client.close_scene().await.expect("closed");
    client.set_camera(camera).await.expect("set");
    client.look_at(DVec3::X, DVec3::ZERO, DVec3::Y).await.expect("set");
    client.set_head(DVec3::Z).await.expect("set");
    let head = HeadPose::facing_forward(DVec3::Z, 0.06);
    client.set_head(head).await.expect("set");
    let view = View::of_wall(camera);
    client.set_views(vec![view.clone()]).await.expect("set");
    client.clear_views().await.expect("cleared");
    assert_eq!(client.presentation().await.expect("status"), status().presentation);
    set_light(&client).await;
    assert_eq!(client.render_frame().await.expect("drawn"), feedback(9));
    assert_eq!(client.render_frame_at(Some(camera), Some(4.0)).await.expect("drawn"), feedback(4));
    client.start_rendering(Pacing::Rate(30.0)).await.expect("running");
    client.pause().await.expect("paused");
    assert_eq!(client.set_output_mode(OutputMode::Blank).await.expect("blank"), feedback(9));
    assert_eq!(client.set_pattern(Some(TestPattern::Grid)).await.expect("grid"), feedback(9));
    let change = CalibrationChange::Gain(DVec3::splat(0.9));
    assert_eq!(client.calibrate("left", vec![change.clone()]).await.expect("tuned"), tuned());
    assert_eq!(client.status().await.expect("status"), status());
    assert_eq!(client.wall().await.expect("wall"), wall());
    assert_eq!(client.statistics(true).await.expect("statistics"), statistics());
    client.stop().await.expect("stopped");
    drop(client);
    let expected = [
        Request::OpenScene { path: "a.glb".into(), scene: None },
        Request::CloseScene,
        Request::SetCamera(camera),
        Request::SetCamera(Camera::look_at(DVec3::X, DVec3::ZERO, DVec3::Y)),
        Request::SetHead(DVec3::Z.into()),
        Request::SetHead(head.into()),
        Request::SetViews(vec![view]),
        Request::SetViews(Vec::new()),
        Request::Status,
        Request::SetExposure(0.5),
        Request::SetTone(ToneMapper::Aces),
        Request::SetFog(Some(Fog::even(80.0))),
        Request::SetGlow(Some(Glow::new(0.5))),
        Request::SetAmbientOcclusion(Some(AmbientOcclusion { radius: 0.5 })),
        Request::SetDepthOfField(Some(DepthOfField::new(12.0))),
        Request::SetEnvironment(EnvironmentSource::Sky),
        Request::RenderFrame { camera: None, time_s: None },
        Request::RenderFrame { camera: Some(camera), time_s: Some(4.0) },
        Request::Run(Pacing::Rate(30.0)),
        Request::Pause,
        Request::SetDisplays(OutputMode::Blank),
        Request::SetPattern(Some(TestPattern::Grid)),
        Request::Tune { channel: "left".into(), changes: vec![change] },
        Request::Status,
        Request::DescribeWall,
        Request::Statistics { reset: true },
        Request::Stop,
    ];
    assert_eq!(script.await.expect("the script ends"), expected);
}

#[tokio::test]
async fn answers_may_come_in_any_order() {
    let (client, mut manager) = pair().await;
    let first = client.submit(Request::Status).expect("posted");
    let second = client.submit(Request::DescribeWall).expect("posted");
    let third = client.submit(Request::Pause).expect("posted");
    assert_eq!(client.pending_requests(), 3);
    let ids = [
        manager.expect(Request::Status).await,
        manager.expect(Request::DescribeWall).await,
        manager.expect(Request::Pause).await,
    ];
    assert_eq!(ids, [first.id(), second.id(), third.id()]);
    manager.fail(ids[2], "nothing runs").await;
    manager.reply(ids[1], Response::Wall(Box::new(wall()))).await;
    manager.reply(ids[0], Response::Status(Box::new(status()))).await;
    assert_eq!(first.await.expect("status"), Response::Status(Box::new(status())));
    assert_eq!(second.await.expect("wall"), Response::Wall(Box::new(wall())));
    let error = third.await.expect_err("failed");
    assert_eq!(error.to_string(), "cannot pause: nothing runs");
    assert!(matches!(error, ClientError::Failed { .. }));
    assert_eq!(client.pending_requests(), 0);
}

#[tokio::test]
async fn a_posted_request_is_asked_later() {
    let (client, mut manager) = pair().await;
    let mut pending = client.submit(Request::Pause).expect("posted");
    assert!(pending.poll().is_none());
    let id = manager.expect(Request::Pause).await;
    manager.reply(id, Response::Done).await;
    // The connection task has run once this later request is answered.
    let later = client.submit(Request::CloseScene).expect("posted");
    manager.reply(later.id(), Response::Done).await;
    later.await.expect("answered");
    assert_eq!(pending.poll().expect("there").expect("done"), Response::Done);
    assert!(matches!(pending.poll(), Some(Err(ClientError::AnswerTaken { .. }))));
    assert!(matches!(pending.await, Err(ClientError::AnswerTaken { .. })));
}

#[tokio::test]
async fn a_wrong_answer_is_named_and_one_to_nobody_ignored() {
    let (client, mut manager) = pair().await;
    let script = async {
        let id = manager.expect(Request::Status).await;
        manager.reply(RequestId(u64::MAX), Response::Done).await;
        manager.piece(RequestId(99), 0, &[1, 2, 3]).await;
        manager.reply(id, Response::Done).await;
    };
    let (status, ()) = tokio::join!(client.status(), script);
    let error = status.expect_err("no status");
    assert!(error.to_string().contains("\"read the status\" with something else: done"), "{error}");
}

#[tokio::test]
async fn a_dropped_call_frees_its_place() {
    let (client, mut manager) = pair().await;
    {
        let call = client.render_frame();
        tokio::pin!(call);
        tokio::select! {
            biased;
            _ = &mut call => panic!("nobody answered"),
            id = manager.expect(Request::RenderFrame { camera: None, time_s: None }) => {
                assert_eq!(client.pending_requests(), 1);
                manager.reply(id, Response::Done).await;
            }
        }
    }
    assert_eq!(client.pending_requests(), 0);
    drop(client.submit(Request::Pause));
    assert_eq!(client.pending_requests(), 0);
    // The late answer to nobody does no harm.
    let serving = manager.serve(answer);
    let (status, ()) = tokio::join!(async move { client.status().await }, serving);
    assert_eq!(status.expect("status").wall, "lab");
}

#[tokio::test]
async fn too_many_open_requests_are_refused_and_the_rest_goes_on() {
    let (client, manager) = pair().await;
    let mut open = Vec::new();
    let error = loop {
        match client.submit(Request::Pause) {
            Ok(pending) => open.push(pending),
            Err(error) => break error,
        }
    };
    assert_eq!(open.len(), OPEN_REQUESTS_MAX);
    assert!(error.to_string().contains("1024 requests are open"), "{error}");
    assert!(matches!(client.status().await, Err(ClientError::TooManyOpen { .. })));
    let serving = tokio::spawn(manager.serve(answer));
    for pending in open {
        pending.await.expect("done");
    }
    client.status().await.expect("there is room again");
    drop(client);
    serving.await.expect("the manager saw the end");
}

#[tokio::test]
async fn a_request_beyond_a_message_is_not_sent() {
    let (client, manager) = pair().await;
    let error = client.open_scene("x".repeat(3 << 20)).await.expect_err("too large");
    assert!(matches!(error, ClientError::RequestTooLarge { .. }), "{error}");
    assert_eq!(client.pending_requests(), 0);
    let (status, ()) = tokio::join!(async move { client.status().await }, manager.serve(answer));
    status.expect("the connection holds");
}

#[tokio::test(start_paused = true)]
async fn a_manager_that_never_answers_is_not_waited_for() {
    let (client, mut manager) = pair().await;
    let begin = tokio::time::Instant::now();
    let (frame, capture, scene) =
        tokio::join!(client.render_frame(), client.capture(), client.open_scene("a.glb"));
    assert_eq!(begin.elapsed().as_secs(), 120);
    let after = |result: ClientError| match result {
        ClientError::TimedOut { after, .. } => after.as_secs(),
        other => panic!("{other}"),
    };
    assert_eq!(after(frame.expect_err("late")), 30);
    assert_eq!(after(capture.expect_err("late")), 60);
    let error = scene.expect_err("late");
    assert!(error.to_string().contains("\"open the scene\" within 120s"), "{error}");
    // The connection holds, and an answer that is late is nobody's.
    let id = manager.next().await.expect("the first").0;
    manager.reply(id, Response::Frame(feedback(1))).await;
    let mut pending = client.submit(Request::Pause).expect("posted");
    tokio::time::advance(Duration::from_secs(29)).await;
    tokio::task::yield_now().await;
    assert!(pending.poll().is_none());
    assert!(matches!(pending.await, Err(ClientError::TimedOut { .. })));
}

#[tokio::test(start_paused = true)]
async fn progress_of_an_opening_is_heard_and_gives_it_its_time_again() {
    let mut options = crate::manager::options("pipe");
    options.timeouts.open_scene = Duration::from_secs(10);
    let (client, mut manager) = crate::manager::pair_with(1 << 16, options).await;
    let script = async {
        let id = manager.expect(Request::OpenScene { path: "a.glb".into(), scene: None }).await;
        for percent in [10, 50, 90] {
            tokio::time::advance(Duration::from_secs(8)).await;
            let progress = OpenProgress { stage: OpenStage::Baking, percent };
            manager.send(MessageToClient::Progress { id, progress }).await;
            // Of a request that nobody waits for: nothing happens.
            manager.send(MessageToClient::Progress { id: RequestId(77), progress }).await;
        }
        tokio::time::advance(Duration::from_secs(8)).await;
        manager.reply(id, Response::SceneOpened(summary())).await;
    };
    let mut heard = Vec::new();
    let opening = client.open_scene_with("a.glb", |progress| heard.push(progress.percent));
    let (opened, ()) = tokio::join!(opening, script);
    assert_eq!(opened.expect("opened"), summary());
    assert_eq!(heard, [10, 50, 90]);
}
