//! States that are made drawable while frames of the state before go on.

use std::sync::mpsc::TryRecvError;

use bytes::Bytes;
use glam::DAffine3;
use polyptych_renderer::SceneLayout;
use polyptych_scene::LightEffects;

use super::*;
use crate::correction::tests::harness::{MeshFixture, SceneFixture, gpu, matt};
use crate::loader::ShownState;

/// Cards of one mesh, beside each other.
pub(super) fn cards(count: u32) -> SceneFixture {
    let mut scene = SceneFixture::new();
    let material = scene.material(matt(0.8, 0.4, 0.2));
    let card = scene.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
    for number in 0..count {
        let place = DVec3::new(2.0 * f64::from(number), 0.0, -3.0);
        scene.node(card, DAffine3::from_translation(place));
    }
    scene
}

/// A render thread that shows a card, and the state that it shows.
pub(super) fn shown() -> (RenderThreadFixture, Arc<LoadedState>) {
    shown_of(&cards(1))
}

/// A render thread that shows a scene, and the state that it shows.
pub(super) fn shown_of(scene: &SceneFixture) -> (RenderThreadFixture, Arc<LoadedState>) {
    let mut stage = RenderThreadFixture::on(gpu().clone(), None);
    let scene = Rc::new(scene.build());
    let thread = &mut stage.thread;
    let state = Arc::clone(&thread.states.back().expect("a state").state);
    thread.prepare(&state, &scene);
    thread.states.back_mut().expect("a state").scene = scene;
    (stage, state)
}

/// The same with other effects, one revision later.
pub(super) fn with_effects(state: &LoadedState, effects: LightEffects) -> Arc<LoadedState> {
    let mut replica = state.replica.clone();
    replica.apply(Operation::SetEffects(effects));
    Arc::new(LoadedState {
        epoch: state.epoch,
        digest: replica.digest(),
        replica,
        scene: state.scene,
        warm_up: state.warm_up,
        environment: None,
        plans: Arc::clone(&state.plans),
        maps: CalibrationMaps::default(),
        shapes: Arc::default(),
        motion: None,
    })
}

#[test]
fn frames_go_on_while_pipelines_are_made_and_warmed_up() {
    let (mut stage, state) = shown();
    let plain = stage.show(0.5, OutputMode::Normal);
    let all = LightEffects { fog: true, glow: true, ambient_occlusion: true, depth_of_field: true };
    let next = with_effects(&state, all);
    let (answer, answered) = sync_channel(1);
    stage.thread.upload(Upload::Finish { state: Arc::clone(&next), answer });
    let mut frames = 0;
    while answered.try_recv() == Err(TryRecvError::Empty) {
        assert_eq!(stage.show(0.5, OutputMode::Normal), plain, "the state before");
        frames += 1;
        assert!(frames < 10_000, "the state is never made drawable");
    }
    // The first has the answer of its preparation behind it at the earliest.
    assert!(frames > 1, "{frames} frames");
    let latest = stage.thread.states.back().expect("a state");
    assert_eq!(latest.state.replica.revision, next.replica.revision);
    let scene = Rc::clone(&latest.scene);
    assert!(
        stage
            .thread
            .needs(&next, &scene)
            .iter()
            .all(|needs| { stage.thread.renderer.pipelines().meet(needs) })
    );
    // Effects come with frames, and not with states.
    assert_eq!(stage.show(0.5, OutputMode::Normal), plain);
}

#[test]
fn a_preparation_that_is_given_up_has_no_answer_and_the_next_one_has() {
    let (mut stage, state) = shown();
    let fog = LightEffects { fog: true, ..LightEffects::default() };
    let (answer, answered) = sync_channel(1);
    stage.thread.upload(Upload::Finish { state: with_effects(&state, fog), answer });
    stage.thread.upload(Upload::Abandon);
    assert_eq!(answered.try_recv(), Err(TryRecvError::Disconnected));
    let glow = LightEffects { glow: true, ..LightEffects::default() };
    finish(&mut stage.thread, with_effects(&state, glow));
    let plain = stage.show(0.5, OutputMode::Normal);
    assert!(plain.chunks_exact(4).any(|pixel| pixel != &plain[..4]), "the card is seen");
}

#[test]
fn a_preparation_that_another_one_replaces_has_no_answer_and_is_never_drawn() {
    let (mut stage, state) = shown();
    let fog = LightEffects { fog: true, ..LightEffects::default() };
    let (answer, answered) = sync_channel(1);
    stage.thread.upload(Upload::Finish { state: with_effects(&state, fog), answer });
    let glow = LightEffects { glow: true, ..LightEffects::default() };
    let next = with_effects(&state, glow);
    finish(&mut stage.thread, Arc::clone(&next));
    assert_eq!(answered.try_recv(), Err(TryRecvError::Disconnected));
    let ready: Vec<_> = stage.thread.states.iter().map(|of| Arc::clone(&of.state)).collect();
    assert!(ready.last().is_some_and(|latest| Arc::ptr_eq(latest, &next)));
    assert!(ready.iter().all(|of| of.replica.effects != fog), "it is not kept either");
}

#[test]
fn a_refused_part_makes_room_for_the_next_one_and_a_shown_one_stays() {
    let (mut stage, state) = shown();
    let fog = LightEffects { fog: true, ..LightEffects::default() };
    let next = with_effects(&state, fog);
    finish(&mut stage.thread, Arc::clone(&next));
    let layout = SceneLayout::new(SceneFixture::new().desc, &|| false).expect("sound");
    let layout = Arc::new(layout);
    let mut held_beside = |of: &LoadedState| {
        let shown = ShownState { epoch: EPOCH, revision: of.replica.revision };
        let layout = Arc::clone(&layout);
        stage.thread.upload(Upload::Begin { layout, shares: true, is_part: true, shown });
        stage.thread.states.iter().map(|of| of.state.replica.revision).collect::<Vec<_>>()
    };
    let both = [state.replica.revision, next.replica.revision];
    assert_eq!(held_beside(&next), both, "no frame has named the latest yet");
    assert_eq!(held_beside(&state), both[..1], "the latest was refused");
}

#[test]
fn a_part_whose_upload_failed_is_not_taken_for_prepared() {
    let (mut stage, state) = shown();
    let mut scene = SceneFixture::new();
    let card = scene.mesh(&MeshFixture::rectangle(1.0, 1.0), None);
    scene.node(card, DAffine3::IDENTITY);
    let layout = Arc::new(SceneLayout::new(scene.desc, &|| false).expect("sound"));
    let next = with_effects(&state, LightEffects::NONE);
    let finish = |stage: &mut RenderThreadFixture| {
        let (answer, answered) = sync_channel(1);
        stage.thread.upload(Upload::Finish { state: Arc::clone(&next), answer });
        answered.recv().expect("answered")
    };
    // Of the same scene, which is there, but not with what has come of it now.
    let shown = ShownState { epoch: EPOCH, revision: next.replica.revision };
    stage.thread.upload(Upload::Begin { layout, shares: false, is_part: true, shown });
    let bytes = Bytes::from_static(b"cut short");
    stage.thread.upload(Upload::Primitive { mesh: 0, primitive: 0, bytes });
    let reason = finish(&mut stage).expect_err("the scene before was taken for it");
    assert!(reason.contains("the scene could not be built"), "{reason}");
    // What comes then is judged by itself.
    stage.thread.upload(Upload::Abandon);
    finish(&mut stage).expect("the scene before is meant");
}
