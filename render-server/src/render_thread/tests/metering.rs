//! Frames that are metered once they are shown.

use super::preparation::shown;
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
