//! Frames that are metered once they are shown.

use glam::DAffine3;
use polyptych_renderer::{MovedItems, MovedNode, PipelineNeeds, SceneLayout};

use super::preparation::{cards, shown, shown_of, with_effects};
use super::*;

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
