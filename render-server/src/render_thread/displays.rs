//! Presentation, and the fit of pictures to the monitors of a server in full screen.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use polyptych_protocol::output_mode::OutputMode;

use super::RenderThread;
use crate::channel_output::ChannelOutput;
use crate::frame_scheduler::FrameKey;
use crate::loader::LoadedState;
use crate::render_event;

/// Between two looks at notes where none is shown.
const IDLE_WAIT: Duration = Duration::from_mins(10);

impl RenderThread {
    pub(super) fn show(
        &mut self,
        (epoch, frame): FrameKey,
        mode: OutputMode,
        is_unscheduled: bool,
    ) {
        let state = self.states.front().map(|drawable| Arc::clone(&drawable.state));
        let Some(state) = state.filter(|state| state.epoch == epoch) else { return };
        let Some(wall) = state.replica.wall.as_deref() else { return };
        if !self.drawing.present_delay.is_zero() {
            // Not scheduled beside other work: what is drawn next would lie where this does.
            std::thread::sleep(self.drawing.present_delay);
        }
        let is_taken = self.showing.frame_presented(mode);
        let mut is_news = false;
        for index in 0..self.outputs.len() {
            let output = &mut self.outputs[index];
            let Some((id, _)) = wall.channel_by_name(&output.name) else { continue };
            // One that could not draw keeps its picture, in the mode of this frame.
            let is_drawn = output.drawn.has((epoch, frame));
            if is_taken && is_drawn {
                output.latch_image(&self.gpu, (epoch, frame));
            }
            let fault = output.present(&self.gpu, &self.showing, &self.identity).err();
            let is_shown = is_drawn && fault.is_none();
            if output.present_fault != fault {
                if let Some(reason) = &fault {
                    tracing::warn!(channel = output.name, reason, "its display takes no frames");
                }
                (output.present_fault, is_news) = (fault, true);
            }
            // A fault is told as the display's: the channel has drawn, and its picture may be on
            // the way to somebody who asked for it.
            if is_shown {
                self.send(render_event::shown(epoch, frame, id, &self.clock, is_unscheduled));
            }
        }
        if is_news {
            self.check_displays();
        }
    }

    /// Presents again on a display that was uncovered or resized, or that has new words.
    pub(super) fn show_again(&mut self, index: usize) {
        let output = &mut self.outputs[index];
        if let Err(reason) = output.present(&self.gpu, &self.showing, &self.identity) {
            tracing::warn!(channel = output.name, reason, "the display was not redrawn");
        }
    }

    /// Presents again on displays whose content has changed. On others it would take the place of
    /// a frame, where each picture waits for a refresh of the display.
    pub(super) fn show_news(&mut self) {
        for index in 0..self.outputs.len() {
            if self.outputs[index].has_other_content(&self.showing) {
                self.show_again(index);
            }
        }
    }

    /// Learns what the wall of a state says of the displays.
    pub(super) fn expect(&mut self, state: &LoadedState) {
        let Some(wall) = state.replica.wall.as_deref() else { return };
        for output in &mut self.outputs {
            output.expect(wall);
        }
        let named = self.outputs.iter().filter_map(|output| {
            let (_, channel) = wall.channel_by_name(&output.name)?;
            Some((output.name.clone(), channel.monitor.clone()?))
        });
        let named: BTreeMap<_, _> = named.collect();
        match &self.queues.monitor_names {
            // It answers with the monitors, and their sizes are looked at then.
            Some(send) if self.names_sent.as_ref() != Some(&named) => {
                send(named.clone());
                self.names_sent = Some(named);
            }
            _ => self.check_displays(),
        }
    }

    /// Looks whether pictures fit their monitors, and tells the manager what it does not know of
    /// the displays.
    pub(super) fn check_displays(&mut self) {
        for index in 0..self.outputs.len() {
            let output = &mut self.outputs[index];
            let fit = output.check_fit().and_then(|(_, warning)| warning);
            let Some(id) = output.expected_id() else { continue };
            let fault = output.present_fault.as_ref();
            let fault = fault.map(|reason| format!("its display takes no frames: {reason}"));
            let all: Vec<String> =
                fit.into_iter().chain(fault).chain(self.losses.warning()).collect();
            let warning = (!all.is_empty()).then(|| all.join("; "));
            if output.reported != warning {
                let report = render_event::display(id, warning.clone());
                // Where there is no room for it, the next look sends it.
                if self.queues.reports.try_send(report).is_ok() {
                    output.reported = warning;
                }
            }
        }
    }

    /// The next manager, or the next connection to this one, knows nothing of displays, nor of what
    /// was reported of them in between.
    pub(super) fn reset_reported(&mut self) {
        for output in &mut self.outputs {
            output.reported = None;
        }
    }

    /// Returns the time until the next note over a picture ends.
    pub(super) fn note_wait(&self) -> Duration {
        let ends = self.outputs.iter().filter_map(ChannelOutput::note_end);
        let wait = |end: Instant| end.saturating_duration_since(Instant::now());
        ends.min().map_or(IDLE_WAIT, wait)
    }

    /// Takes notes away whose time is over.
    pub(super) fn end_notes(&mut self) {
        let now = Instant::now();
        for index in 0..self.outputs.len() {
            if self.outputs[index].end_note(now) {
                self.show_again(index);
            }
        }
    }
}
