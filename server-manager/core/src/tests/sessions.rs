//! Sessions: what was on the wall comes back as one, and what does not fit is said.

use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow};
use polyptych_wall::head::HeadPose;
use polyptych_wall::tour::{Tour, TourStop};
use polyptych_wall::view::View;

use super::*;

/// A wall with the town open and everything else changed.
fn dressed() -> ClusterFixture {
    let mut stage = ClusterFixture::new(2);
    let job = ClientRequest { client: CLIENT, id: RequestId(99) };
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    stage.prepare_all();
    let camera = Camera { scale: 3.0, ..Camera::IDENTITY };
    let head = HeadPose::facing_forward(DVec3::new(0.1, 0.2, 0.3), 0.06);
    let stops = vec![TourStop::new(camera, 4.0)];
    for request in [
        Request::SetCamera(camera),
        Request::SetHead(head.into()),
        Request::SetViews(vec![View::of_wall(camera)]),
        Request::StoreView { name: "quay".into(), camera: None },
        Request::SetExposure(2.0),
        Request::SetFog(Some(Fog::even(90.0))),
        Request::SetGlow(Some(Glow::new(0.5))),
        Request::SetAmbientOcclusion(Some(AmbientOcclusion { radius: 0.5 })),
        Request::SetDepthOfField(Some(DepthOfField::new(12.0))),
        Request::SetBounds(QualityBounds { error_px: 0.5, rate_fps: None }),
        Request::SetPattern(Some(TestPattern::Grid)),
        Request::SetDisplays(OutputMode::Identify),
        Request::PlayTour(Tour { stops, is_loop: true }),
        Request::Run(Pacing::Rate(30.0)),
    ] {
        stage.request(request);
        stage.prepare_all();
        stage.draw(&[0, 1], 20_000);
    }
    stage
}

fn open(stage: &mut ClusterFixture, session: ImportedSession) -> RequestId {
    let id = stage.request(Request::OpenSession { name: "evening".into() });
    let job = stage.imports.pop().expect("read beside the core");
    stage.cluster.handle_session(stage.now, job, Ok(Box::new(session)));
    stage.read();
    stage.prepare_all();
    id
}

fn session_of(state: &PersistentState) -> ImportedSession {
    let scene = state.scene.is_some().then(ClusterFixture::imported);
    ImportedSession { scene, state: state.clone(), left_out: Vec::new() }
}

#[test]
fn a_session_brings_back_all_that_was_on_the_wall() {
    let mut stage = dressed();
    let kept = stage.cluster.session_state();
    assert_eq!((kept.tunings.len(), kept.temporary.len()), (0, 0));
    assert_eq!(kept.presentation.output_mode, OutputMode::Identify);
    let empty = PersistentState::of_wall(&stage.cluster.wall);
    let id = open(&mut stage, session_of(&empty));
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == id).expect("answered");
    let Ok(Response::SessionOpened(opened)) = reply else { panic!("{reply:?}") };
    assert_eq!((&opened.scene, &opened.left_out), (&None, &Vec::new()));
    let cleared = stage.cluster.session_state();
    assert_eq!(cleared.presentation, empty.presentation);
    assert_eq!((cleared.scene, cleared.stored_views, cleared.tour), (None, Vec::new(), None));
    assert_eq!(cleared.pace, None);

    stage.draw(&[0, 1], 20_000);
    stage.frames.clear();
    let id = open(&mut stage, session_of(&kept));
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == id).expect("answered");
    let Ok(Response::SessionOpened(opened)) = reply else { panic!("{reply:?}") };
    assert_eq!(opened.scene.as_ref().map(|scene| scene.name.as_str()), Some("town"));
    let back = stage.cluster.session_state();
    assert_eq!(PersistentState { revision: kept.revision, ..back }, kept);
    // What it tells of outlives the manager.
    let memory = stage.memories.last().expect("remembered");
    assert_eq!(memory.presentation, kept.presentation);
    let revision = stage.cluster.shown.revision;
    stage.draw(&[0, 1], 20_000);
    stage.wait(40_000);
    let first = stage.frames.iter().find(|(_, of)| of.revision == revision).expect("a frame");
    assert_eq!(first.1.presentation.views, kept.presentation.views, "all of it from one frame on");
}

#[test]
fn a_paused_wall_shows_a_session_and_parts_that_cannot_be_are_said() {
    let mut stage = ClusterFixture::new(1);
    let mut state = stage.cluster.session_state();
    state.presentation.output_mode = OutputMode::Blank;
    state.presentation.bounds.error_px = -1.0;
    let mut view = View::of_wall(Camera::IDENTITY);
    view.area = polyptych_wall::view::Area::Screen { screen: 7, rect: [0, 0, 8, 8] };
    state.presentation.views = vec![view];
    let id = open(&mut stage, session_of(&state));
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == id).expect("answered");
    let Ok(Response::SessionOpened(opened)) = reply else { panic!("{reply:?}") };
    let [views, bounds] = &opened.left_out[..] else { panic!("{:?}", opened.left_out) };
    assert!(views.starts_with("views: ") && bounds.starts_with("the bounds: "), "{opened:?}");
    assert!(stage.cluster.presentation.views.is_empty());
    stage.wait(0);
    let (_, frame) = stage.frames.last().expect("a frame that nobody ordered");
    assert_eq!(frame.presentation.output_mode, OutputMode::Blank);
}

#[test]
fn a_session_that_cannot_be_read_changes_nothing() {
    let mut stage = dressed();
    let before = stage.cluster.session_state();
    let id = stage.request(Request::OpenSession { name: "morning".into() });
    let job = stage.imports.pop().expect("read beside the core");
    let reason = "no session is saved as morning; saved: evening".to_owned();
    stage.cluster.handle_session(stage.now, job, Err(reason.clone()));
    stage.read();
    assert!(stage.replies.contains(&(id, Err(RequestError::new(reason)))), "{:?}", stage.replies);
    let unnamed = stage.request(Request::OpenSession { name: "a\nb".into() });
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == unnamed).expect("refused");
    assert!(reply.as_ref().expect_err("no name").reason.contains("1 to 64 bytes"));
    assert_eq!(stage.cluster.session_state(), before);
}
