//! The choice of the frame that a server draws next and of the one it shows: without sockets, GPU
//! or clock.
//!
//! Commands are taken as they come; what is to be done is asked for when all have been taken, so
//! that a server that wakes from a stop goes to the newest frame and never shows an old one.

use std::collections::VecDeque;
use std::time::Duration;

use polyptych_protocol::command::{Frame, Swap};
use polyptych_protocol::ids::{Epoch, FrameId};
use polyptych_protocol::output_mode::OutputMode;

/// Maximum time by which a frame that took long to draw may be shown late: a slow channel shows
/// what it can, and a picture of a second ago is worse than the last one.
pub const SLOW_GRACE_MAX: Duration = Duration::from_secs(1);

/// Maximum number of frames that wait to be drawn: as many as a manager has on their way.
const WAITING_MAX: usize = 2;

/// Time before the instant of a swap from which on the render thread looks at the clock all the
/// time, in microseconds: a system wakes a sleeping thread up to a millisecond late. One that is
/// woken as late behind the instant still counts as in time.
pub const SWAP_SPIN_US: u64 = 1_000;

/// A frame's number in the life of a manager.
pub type FrameKey = (Epoch, FrameId);

/// The next thing to do.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameAction {
    /// Draw this frame into the channels' own targets.
    Draw {
        /// The frame.
        frame: Box<Frame>,
        /// The frame that the targets hold and that may still be shown: it is to be kept aside.
        keep: Option<FrameKey>,
    },
    /// Show a frame that was drawn: the last one, or the one that was kept aside.
    Show {
        /// The manager's epoch.
        epoch: Epoch,
        /// The frame.
        frame: FrameId,
        /// The mode of the displays that the frame asks for.
        display: OutputMode,
        /// The instant of manager time at which to show it, at most [`SWAP_SPIN_US`] away; `None`:
        /// at once.
        at_us: Option<u64>,
        /// Such an instant was stated, and passed more than [`SWAP_SPIN_US`] ago or is unknown.
        is_unscheduled: bool,
    },
}

/// The last frames that a channel drew: the two that may still be shown. Another channel of the
/// same server may have drawn one that this one could not.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrawnFrames([Option<FrameKey>; 2]);

impl DrawnFrames {
    /// The channel has drawn this frame.
    pub fn add(&mut self, key: FrameKey) {
        self.0 = [Some(key), self.0[0]];
    }

    /// Returns whether the channel has drawn this frame.
    pub fn has(&self, key: FrameKey) -> bool {
        self.0.contains(&Some(key))
    }
}

/// The newest commands that wait, and what was done.
#[derive(Debug, Default)]
pub struct FrameScheduler {
    /// Oldest first.
    waiting_frames: VecDeque<Box<Frame>>,
    waiting_swap: Option<Swap>,
    /// A swap of a drawn frame that waits for its instant, behind which another one has come.
    held_swap: Option<Swap>,
    /// The frame of the last swap command.
    swapped: Option<FrameKey>,
    drawn: Option<RenderedFrame>,
    /// Drawn before that one, which was drawn ahead of its turn.
    kept: Option<RenderedFrame>,
    shown: Option<FrameKey>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct RenderedFrame {
    key: FrameKey,
    display: OutputMode,
    /// The time that drawing took, in microseconds.
    took_us: u64,
}

impl FrameScheduler {
    /// A frame command. An older one that was not drawn is passed over if the wall has swapped it
    /// meanwhile, or as many wait as the manager sends at a time.
    pub fn handle_frame(&mut self, frame: Box<Frame>) {
        while let Some(oldest) = self.waiting_frames.front()
            && (self.waiting_frames.len() == WAITING_MAX
                || self.is_swapped((oldest.epoch, oldest.frame)))
        {
            self.waiting_frames.pop_front();
        }
        self.waiting_frames.push_back(frame);
    }

    /// A swap command. `Some` is to be done at once: the frame behind it may follow in the same
    /// breath.
    pub fn handle_swap(&mut self, swap: Swap, manager_us: Option<u64>) -> Option<FrameAction> {
        if self.held_swap.is_none() && self.next_show_us().is_some() {
            self.held_swap = self.waiting_swap;
        }
        self.waiting_swap = Some(swap);
        self.swapped = Some((swap.epoch, swap.frame));
        while self.waiting_frames.len() > 1
            && self.waiting_frames.front().is_some_and(|f| self.is_swapped((f.epoch, f.frame)))
        {
            self.waiting_frames.pop_front();
        }
        self.take_show(manager_us)
    }

    /// Returns the next action, once all commands have been taken; `None` if there is nothing to do
    /// now. `manager_us` is manager time, if it is known. A drawn frame must be noted by
    /// [`FrameScheduler::frame_drawn`] before the next call.
    pub fn poll(&mut self, manager_us: Option<u64>) -> Option<FrameAction> {
        if let Some(show) = self.take_show(manager_us) {
            return Some(show);
        }
        if manager_us.is_some() && self.next_show_us().is_some() {
            // A frame that is drawn first would be shown late for it.
            return None;
        }
        let frame = self.waiting_frames.pop_front()?;
        if let Some(drawn) = self.drawn.take().filter(|drawn| !self.is_swapped(drawn.key)) {
            self.kept = Some(drawn);
        }
        let keep = self.kept.map(|kept| kept.key);
        Some(FrameAction::Draw { frame, keep })
    }

    /// Channels have drawn this frame in this time; they may show it. `Some` is to be done at
    /// once: where the wall did not wait for it, its swap is there already, and the next one would
    /// take its place.
    pub fn frame_drawn(
        &mut self,
        frame: &Frame,
        took: Duration,
        manager_us: Option<u64>,
    ) -> Option<FrameAction> {
        let took_us = took.min(SLOW_GRACE_MAX).as_micros() as u64;
        let Frame { epoch, frame, ref presentation, .. } = *frame;
        let display = presentation.output_mode;
        self.drawn = Some(RenderedFrame { key: (epoch, frame), display, took_us });
        self.take_show(manager_us)
    }

    /// Forgets what waits and what was drawn: another connection, another state.
    pub fn reset(&mut self) {
        *self = Self { shown: self.shown, ..Self::default() };
    }

    /// Returns whether the wall has swapped this frame, or a later one.
    fn is_swapped(&self, (epoch, frame): FrameKey) -> bool {
        self.swapped.is_some_and(|(of, newest)| of == epoch && newest >= frame)
    }

    /// Returns the time of the next poll for a drawn frame that waits for the instant of its swap,
    /// in microseconds of manager time.
    pub fn next_show_us(&self) -> Option<u64> {
        let at_us = |swap: &Swap| {
            let key = (swap.epoch, swap.frame);
            self.ready(key).and(swap.present_at_us).map(|at_us| at_us.saturating_sub(SWAP_SPIN_US))
        };
        self.held_swap.iter().chain(&self.waiting_swap).find_map(at_us)
    }

    /// The drawn frame of this number.
    fn ready(&self, key: FrameKey) -> Option<RenderedFrame> {
        [self.kept, self.drawn].into_iter().flatten().find(|drawn| drawn.key == key)
    }

    fn take_show(&mut self, manager_us: Option<u64>) -> Option<FrameAction> {
        if let Some(held) = self.held_swap {
            let newer = self.waiting_swap.replace(held);
            let show = self.take_waiting_show(manager_us);
            let is_over = self.waiting_swap.is_none();
            self.waiting_swap = newer;
            if !is_over {
                return None;
            }
            self.held_swap = None;
            if show.is_some() {
                return show;
            }
        }
        self.take_waiting_show(manager_us)
    }

    fn take_waiting_show(&mut self, manager_us: Option<u64>) -> Option<FrameAction> {
        let swap = self.waiting_swap?;
        let key = (swap.epoch, swap.frame);
        let is_old =
            self.shown.is_some_and(|(epoch, frame)| epoch == swap.epoch && frame >= swap.frame);
        if is_old {
            self.waiting_swap = None;
            return None;
        }
        // If neither, it is not drawn yet or passed over; a newer swap will replace it.
        let ready = self.ready(key)?;
        let at_us = match (swap.present_at_us, manager_us) {
            (Some(at_us), Some(now)) if now < at_us.saturating_sub(SWAP_SPIN_US) => return None,
            (Some(at_us), Some(now)) if now <= at_us.saturating_add(SWAP_SPIN_US) => Some(at_us),
            _ => None,
        };
        let is_unscheduled = swap.present_at_us.is_some() && at_us.is_none();
        self.waiting_swap = None;
        self.kept = None;
        // Whoever draws slowly may show what it drew by so much later; whoever stood still with a
        // drawn frame may not.
        let not_after_us = swap.not_after_us.saturating_add(ready.took_us);
        if manager_us.is_some_and(|now| now > not_after_us) {
            return None;
        }
        self.shown = Some(key);
        let RenderedFrame { key: (epoch, frame), display, .. } = ready;
        Some(FrameAction::Show { epoch, frame, display, at_us, is_unscheduled })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use polyptych_protocol::ids::Revision;
    use polyptych_protocol::presentation::Presentation;
    use polyptych_protocol::quality_bounds::DetailBound;
    use polyptych_wall::head::HeadPose;

    use super::*;

    const EPOCH: Epoch = Epoch(1);

    fn frame(n: u64) -> Frame {
        Frame {
            epoch: EPOCH,
            frame: FrameId(n),
            time_s: 0.0,
            revision: Revision(1),
            presentation: Presentation::new(HeadPose::facing_forward(DVec3::ZERO, 0.0)),
            capture: None,
            detail: DetailBound::default(),
            clips: Vec::new(),
            is_metered: false,
        }
    }

    fn swap(n: u64, not_after_us: u64) -> Swap {
        Swap { epoch: EPOCH, frame: FrameId(n), not_after_us, present_at_us: None }
    }

    fn draw(n: u64, keep: Option<u64>) -> FrameAction {
        let keep = keep.map(|n| (EPOCH, FrameId(n)));
        FrameAction::Draw { frame: Box::new(frame(n)), keep }
    }

    fn show_as(n: u64, display: OutputMode) -> FrameAction {
        let (epoch, frame, at_us, is_unscheduled) = (EPOCH, FrameId(n), None, false);
        FrameAction::Show { epoch, frame, display, at_us, is_unscheduled }
    }

    fn show(n: u64) -> FrameAction {
        show_as(n, OutputMode::Normal)
    }

    #[test]
    fn a_frame_is_drawn_and_then_shown_once() {
        let mut playback = FrameScheduler::default();
        playback.handle_frame(Box::new(frame(1)));
        assert_eq!(playback.poll(Some(0)), Some(draw(1, None)));
        assert_eq!(playback.handle_swap(swap(1, 100), Some(10)), None);
        let act = playback.frame_drawn(&frame(1), Duration::ZERO, Some(20));
        assert_eq!(act, Some(show(1)));
        assert_eq!(playback.handle_swap(swap(1, 100), Some(20)), None);
        assert_eq!(playback.poll(Some(20)), None);
    }

    #[test]
    fn whoever_wakes_goes_to_the_newest_frame() {
        let mut playback = FrameScheduler::default();
        playback.handle_frame(Box::new(frame(1)));
        playback.poll(Some(0));
        assert_eq!(playback.frame_drawn(&frame(1), Duration::ZERO, None), None);
        for n in 2..50 {
            assert_eq!(playback.handle_swap(swap(n - 1, n * 10), Some(9_999)), None);
            playback.handle_frame(Box::new(frame(n)));
        }
        assert_eq!(playback.poll(Some(9_999)), Some(draw(49, None)));
        assert_eq!(playback.frame_drawn(&frame(49), Duration::ZERO, None), None);
        assert_eq!(playback.handle_swap(swap(49, 10_100), Some(10_000)), Some(show(49)));
    }

    #[test]
    fn an_expired_swap_shows_nothing() {
        let mut playback = FrameScheduler::default();
        assert_eq!(playback.frame_drawn(&frame(3), Duration::ZERO, None), None);
        assert_eq!(playback.handle_swap(swap(3, 100), Some(101)), None);
        assert_eq!(playback.poll(Some(50)), None);
    }

    #[test]
    fn displays_change_with_the_frame_that_is_shown_and_not_with_the_one_that_is_drawn() {
        let mut playback = FrameScheduler::default();
        let mut black = frame(2);
        black.presentation.output_mode = OutputMode::Blank;
        assert_eq!(playback.frame_drawn(&frame(1), Duration::ZERO, None), None);
        playback.handle_frame(Box::new(black.clone()));
        assert_eq!(playback.handle_swap(swap(1, 100), Some(10)), Some(show(1)));
        playback.poll(Some(10));
        assert_eq!(playback.frame_drawn(&black, Duration::ZERO, None), None);
        let expected = show_as(2, OutputMode::Blank);
        assert_eq!(playback.handle_swap(swap(2, 100), Some(20)), Some(expected));
    }

    #[test]
    fn a_swap_and_the_next_frame_in_one_breath_are_both_done() {
        let mut playback = FrameScheduler::default();
        assert_eq!(playback.frame_drawn(&frame(1), Duration::ZERO, None), None);
        assert_eq!(playback.handle_swap(swap(1, 100), None), Some(show(1)));
        playback.handle_frame(Box::new(frame(2)));
        assert_eq!(playback.poll(None), Some(draw(2, None)));
    }

    #[test]
    fn a_slow_channel_shows_what_it_drew_though_the_wall_is_further() {
        let (second, minute) = (Duration::from_secs(1), Duration::from_mins(1));
        for (took, at_us, is_shown) in [
            (Duration::from_millis(200), 300_000, true),
            (Duration::from_millis(200), 300_001, false),
            (second, 1_100_000, true),
            // It stood still while it drew: a frame of a minute ago is none to show.
            (minute, 60_000_000, false),
        ] {
            let mut playback = FrameScheduler::default();
            assert_eq!(playback.frame_drawn(&frame(3), took, None), None);
            let shown = playback.handle_swap(swap(3, 100_000), Some(at_us));
            assert_eq!(shown.is_some(), is_shown, "{took:?} {at_us}");
        }
    }

    #[test]
    fn a_frame_that_waits_for_its_swap_is_kept_while_the_next_one_is_drawn() {
        let mut playback = FrameScheduler::default();
        playback.handle_frame(Box::new(frame(1)));
        playback.handle_frame(Box::new(frame(2)));
        for n in 1..20 {
            let keep = (n > 1).then(|| n - 1);
            assert_eq!(playback.poll(Some(0)), Some(draw(n, keep)));
            assert_eq!(playback.frame_drawn(&frame(n), Duration::ZERO, Some(0)), None);
            if n > 1 {
                assert_eq!(playback.handle_swap(swap(n - 1, 100), Some(0)), Some(show(n - 1)));
                playback.handle_frame(Box::new(frame(n + 1)));
            }
        }
        assert_eq!(playback.handle_swap(swap(19, 100), Some(0)), Some(show(19)));
    }

    #[test]
    fn both_swaps_that_come_together_are_done_in_their_order() {
        let mut playback = FrameScheduler::default();
        for n in [1, 2] {
            playback.handle_frame(Box::new(frame(n)));
            assert!(playback.poll(None).is_some());
            assert_eq!(playback.frame_drawn(&frame(n), Duration::ZERO, None), None);
        }
        assert_eq!(playback.handle_swap(swap(1, 100), None), Some(show(1)));
        assert_eq!(playback.handle_swap(swap(2, 100), None), Some(show(2)));
    }

    #[test]
    fn a_kept_frame_whose_swap_has_expired_is_not_shown_and_the_next_one_is() {
        let mut playback = FrameScheduler::default();
        for n in [1, 2] {
            playback.handle_frame(Box::new(frame(n)));
            assert!(playback.poll(None).is_some());
            playback.frame_drawn(&frame(n), Duration::ZERO, None);
        }
        assert_eq!(playback.handle_swap(swap(1, 100), Some(101)), None);
        assert_eq!(playback.handle_swap(swap(2, 200), Some(101)), Some(show(2)));
    }

    #[test]
    fn a_frame_that_the_wall_has_swapped_is_passed_over_for_the_next_one() {
        let mut playback = FrameScheduler::default();
        playback.handle_frame(Box::new(frame(1)));
        playback.handle_frame(Box::new(frame(2)));
        assert_eq!(playback.handle_swap(swap(1, 100), Some(0)), None);
        assert_eq!(playback.poll(Some(0)), Some(draw(2, None)));
        // A third frame is sent only when the first one is over.
        for n in 3..6 {
            playback.handle_frame(Box::new(frame(n)));
        }
        playback.frame_drawn(&frame(2), Duration::ZERO, Some(0));
        assert_eq!(playback.poll(Some(0)), Some(draw(4, Some(2))));
    }

    /// A swap that states an instant, and what comes of it.
    fn timed(n: u64, at_us: u64) -> Swap {
        Swap { present_at_us: Some(at_us), ..swap(n, at_us + 50_000) }
    }

    fn show_at(n: u64, at: Result<u64, ()>) -> FrameAction {
        let (epoch, frame, display) = (EPOCH, FrameId(n), OutputMode::Normal);
        FrameAction::Show { epoch, frame, display, at_us: at.ok(), is_unscheduled: at.is_err() }
    }

    #[test]
    fn a_swap_that_states_an_instant_is_done_then_and_nothing_is_drawn_before() {
        let mut playback = FrameScheduler::default();
        assert_eq!(playback.frame_drawn(&frame(1), Duration::ZERO, Some(0)), None);
        assert_eq!(playback.handle_swap(timed(1, 9_000), Some(1_000)), None);
        playback.handle_frame(Box::new(frame(2)));
        assert_eq!((playback.poll(Some(7_999)), playback.next_show_us()), (None, Some(8_000)));
        assert_eq!(playback.poll(Some(8_000)), Some(show_at(1, Ok(9_000))));
        assert_eq!(playback.poll(Some(9_000)), Some(draw(2, None)));
        assert_eq!(playback.next_show_us(), None);
    }

    #[test]
    fn a_swap_whose_instant_has_passed_or_is_unknown_is_done_at_once_and_said() {
        for now in [Some(10_001), None] {
            let mut playback = FrameScheduler::default();
            assert_eq!(playback.frame_drawn(&frame(1), Duration::ZERO, now), None);
            assert_eq!(playback.handle_swap(timed(1, 9_000), now), Some(show_at(1, Err(()))));
        }
    }

    #[test]
    fn a_swap_that_waits_for_its_instant_is_not_forgotten_for_the_next_one() {
        let mut playback = FrameScheduler::default();
        for n in [1, 2] {
            playback.handle_frame(Box::new(frame(n)));
            assert!(playback.poll(Some(0)).is_some());
            assert_eq!(playback.frame_drawn(&frame(n), Duration::ZERO, Some(0)), None);
        }
        assert_eq!(playback.handle_swap(timed(1, 9_000), Some(4_000)), None);
        assert_eq!(playback.handle_swap(timed(2, 12_000), Some(7_000)), None);
        assert_eq!(playback.next_show_us(), Some(8_000));
        assert_eq!(playback.poll(Some(8_500)), Some(show_at(1, Ok(9_000))));
        assert_eq!((playback.poll(Some(9_000)), playback.next_show_us()), (None, Some(11_000)));
        assert_eq!(playback.poll(Some(11_500)), Some(show_at(2, Ok(12_000))));
    }
}
