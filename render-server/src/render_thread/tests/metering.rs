//! Frames that are metered once they are shown.

use std::f64::consts::PI;

use glam::{DAffine3, DQuat};
use polyptych_protocol::luminance::luminance_index;
use polyptych_renderer::{MovedItems, MovedNode, PipelineNeeds, SceneLayout};
use polyptych_scene::{Light, LightKind, Material};
use polyptych_wall::view::{Area, View, ViewProjection};

use super::preparation::{cards, shown, shown_of, with_effects};
use super::*;
use crate::correction::tests::harness::{MeshFixture, SceneFixture, gpu, matt};

impl RenderThreadFixture {
    /// Draws a frame and returns its number.
    fn draw_one(&mut self, is_metered: bool) -> u64 {
        self.is_metered = is_metered;
        self.draw(0.5, OutputMode::Normal);
        self.frame
    }

    /// Shows a frame that was drawn. Returns the frames that were metered since the last call.
    fn metered_by(&mut self, frame: u64) -> Vec<u64> {
        let (not_after_us, present_at_us) = (u64::MAX, None);
        let frame = FrameId(frame);
        let swap = Swap { epoch: EPOCH, frame, not_after_us, present_at_us };
        self.thread.handle(RenderTask::Swap(swap));
        self.turn();
        self.metered()
    }

    /// Returns the frames that were metered since the last call.
    fn metered(&mut self) -> Vec<u64> {
        let reports = std::iter::from_fn(|| self.reports.try_recv().ok());
        let metered = reports.filter_map(|report| match report {
            RenderEvent::Status(ServerMessage::Luminance(of)) => Some(of.frame.0),
            _ => None,
        });
        metered.collect()
    }

    /// Meters a frame with these views over the wall's own. Returns the numbers of pixels of these
    /// luminances, which are all that there are.
    fn pixels_of<const N: usize>(&mut self, luminances: [f32; N], views: Vec<View>) -> [u32; N] {
        let head = HeadPose::facing_forward(DVec3::ZERO, 0.0);
        let frame = Frame {
            epoch: EPOCH,
            frame: FrameId(1),
            time_s: 0.0,
            revision: self.thread.states.front().expect("a state").state.replica.revision,
            presentation: Presentation { views, ..Presentation::new(head) },
            capture: None,
            detail: DetailBound::default(),
            clips: Vec::new(),
            is_metered: true,
        };
        self.thread.meter_now(&frame);
        let mut reports = std::iter::from_fn(|| self.reports.try_recv().ok());
        let counts = reports.find_map(|report| match report {
            RenderEvent::Status(ServerMessage::Luminance(of)) => Some(of.counts),
            _ => None,
        });
        let counts = counts.expect("metered");
        let found = luminances.map(|of| counts[luminance_index(of).expect("no black")]);
        assert_eq!(found.iter().sum::<u32>(), counts.iter().sum::<u32>(), "{counts:?}");
        found
    }
}

/// A render thread whose wall is a cylinder around the origin. All that is before the origin glows
/// with the first of these luminances, and all that is behind it with the second.
fn curved_between(luminances: [f32; 2]) -> RenderThreadFixture {
    let mut scene = SceneFixture::new();
    scene.desc.sky = Vec3::ZERO;
    // Without any light there would be the default sun.
    let (kind, color) = (LightKind::Directional, Vec3::ZERO);
    scene.light(Light { kind, color, intensity: 0.0, range: None }, DAffine3::IDENTITY);
    for (luminance, turn_rad) in luminances.into_iter().zip([0.0, PI]) {
        let emissive = Vec3::splat(luminance);
        let material = scene.material(Material { emissive, ..matt(0.0, 0.0, 0.0) });
        let card = scene.mesh(&MeshFixture::rectangle(40.0, 40.0), Some(material));
        let place = DAffine3::from_translation(DVec3::NEG_Z * 5.0);
        scene.node(card, DAffine3::from_rotation_y(turn_rad) * place);
    }
    let mut stage = RenderThreadFixture::on(gpu().clone(), None);
    let mut curved = wall();
    curved.screens[0].surface = Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-0.8, 0.8],
        height_m: [-0.9, 0.9],
    });
    stage.prepare(curved);
    let thread = &mut stage.thread;
    thread.states.pop_front();
    let state = Arc::clone(&thread.states.back().expect("a state").state);
    let scene = Rc::new(scene.build());
    thread.prepare(&state, &scene);
    thread.states.back_mut().expect("a state").scene = scene;
    stage
}

#[test]
fn a_metered_frame_is_metered_when_it_is_shown_though_the_next_one_is_drawn_already() {
    let mut stage = RenderThreadFixture::new();
    let first = stage.draw_one(true);
    let second = stage.draw_one(false);
    assert_eq!(stage.metered_by(first), [first]);
    let third = stage.draw_one(true);
    assert!(stage.metered_by(second).is_empty(), "the metered one is not shown yet");
    assert_eq!(stage.metered_by(third), [third]);
    assert!(stage.metered_by(third).is_empty(), "once");
}

#[test]
fn a_metered_frame_that_was_passed_over_is_metered_with_the_next_one() {
    let mut stage = RenderThreadFixture::new();
    let first = stage.draw_one(true);
    let second = stage.draw_one(false);
    assert_eq!(stage.metered_by(second), [first]);
}

#[test]
fn the_first_metered_frame_waits_for_pipelines_that_are_made_beside_the_next_ones() {
    let (mut stage, state) = shown();
    let scene = Rc::clone(&stage.thread.states.back().expect("a state").scene);
    let first = stage.draw_one(true);
    assert!(stage.metered_by(first).is_empty(), "nothing is compiled between frames");
    // There is nothing else to wait for.
    stage.thread.wait();
    assert_eq!(stage.metered(), [first]);
    let second = stage.draw_one(true);
    assert_eq!(stage.metered_by(second), [second], "they are there");
    // The next scene has them made with its others, as long as frames are metered.
    assert_eq!(stage.thread.needs_and_metering(&state, &scene).len(), 2);
    stage.thread.is_metering = false;
    assert_eq!(stage.thread.needs_and_metering(&state, &scene).len(), 1);
}

#[test]
fn nodes_that_are_moved_do_not_wait_for_pipelines_of_metering() {
    let scene = cards(2);
    let (mut stage, state) = shown_of(&scene);
    let effects = state.replica.effects;
    let layout = Arc::new(SceneLayout::new(scene.desc, &|| false).expect("sound"));
    let node = MovedNode::new(0, DAffine3::from_translation(DVec3::NEG_Z * 4.0), &[]);
    let moved = MovedItems::new(&layout, std::iter::once(node)).expect("one of two");
    // A metered frame has come, and the pipelines for it are not made yet.
    stage.thread.is_metering = true;
    let (answer, answered) = sync_channel(1);
    stage.thread.upload(Upload::Relayout { layout, moved: Some(Arc::new(moved)) });
    stage.thread.upload(Upload::Finish { state: with_effects(&state, effects), answer });
    answered.try_recv().expect("answered at once").expect("drawable");
    let latest = stage.thread.states.back().expect("a state");
    let of_frames = stage.thread.needs(&latest.state, &latest.scene);
    let of_metering = PipelineNeeds::metering(&latest.scene, effects);
    let own = stage.thread.renderer.pipelines();
    assert!(of_frames.iter().all(|needs| own.meet(needs)));
    assert!(!own.meet(&of_metering), "a picture that moves would wait for a driver");
}

#[test]
fn views_over_a_warped_channel_are_metered_and_not_what_they_cover() {
    let luminances = [900.0, 0.33];
    let mut stage = curved_between(luminances);
    let mut metered = |views| stage.pixels_of(luminances, views);
    let [alone, none] = metered(Vec::new());
    assert!(alone > 20 && none == 0, "{alone} bright pixels, {none} dark ones");
    let behind = Camera { rotation: DQuat::from_rotation_y(PI), ..Camera::IDENTITY };
    let lenses = [
        ViewProjection::Perspective { fov_y_rad: 0.8 },
        ViewProjection::Orthographic { height_m: 2.0 },
    ];
    for projection in lenses {
        let whole = View { projection, ..View::of_wall(behind) };
        let [bright, dark] = metered(vec![whole.clone()]);
        assert!(bright == 0 && dark > 20, "{bright} bright pixels, {dark} dark ones");
        let area = Area::Screen { screen: 0, rect: [0, 0, SIZE[0] / 2, SIZE[1]] };
        let half = View { area, ..whole };
        // Twice the same, of which only the upper one is seen.
        for views in [vec![half.clone()], vec![half.clone(), half]] {
            let [bright, dark] = metered(views);
            assert!(bright.abs_diff(alone / 2) <= 2, "{bright} of {alone} bright pixels");
            assert!(dark > 10 && dark < alone, "{dark} dark pixels, {alone} of the whole wall");
        }
    }
}
