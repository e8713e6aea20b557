//! The brightness of what is shown, for the manager's automatic exposure.

use std::rc::Rc;
use std::sync::Arc;

use crossbeam_channel::{Receiver, TryRecvError, never};
use polyptych_protocol::command::Frame;
use polyptych_protocol::luminance::{LUMINANCE_COUNTS, luminance_index};
use polyptych_renderer::{GpuScene, PipelineNeeds, ScenePipelines, ViewDesc};
use polyptych_wall::{ChannelId, Wall};

use super::{Correctors, ReadyState, RenderThread};
use crate::correction::metered::MeteredPicture;
use crate::frame_scheduler::FrameKey;
use crate::frame_views;
use crate::render_event;

/// Pixels of a channel along each axis for one that is metered: a thing of 16 pixels counts.
const PIXELS_PER_SAMPLE: u32 = 16;

/// A frame that was shown and is metered as soon as the pipelines for that are made.
pub(super) struct DelayedMetering {
    frame: Box<Frame>,
    /// Gives the pipelines; its sender is gone if they could not be made.
    made: Receiver<ScenePipelines>,
}

impl RenderThread {
    /// Meters the frame that is to be metered, if it is this one, which is shown now, or an earlier
    /// one: the time until the next one is free. One that another state has replaced is not
    /// metered. The first one waits for its pipelines, and nothing waits for it.
    pub(super) fn meter(&mut self, (epoch, shown): FrameKey) {
        // Another one may have been drawn ahead of its turn meanwhile.
        let is_due = |frame: &mut Box<Frame>| frame.epoch != epoch || frame.frame <= shown;
        let Some(frame) = self.to_meter.take_if(is_due) else { return };
        if let Some(delayed) = &mut self.delayed_metering {
            // The newest one is wanted. Pipelines are asked for here, too, since a thread whose
            // next frame is always there already never waits.
            delayed.frame = frame;
            match delayed.made.try_recv() {
                Ok(pipelines) => self.take_metering_pipelines(Some(pipelines)),
                Err(TryRecvError::Disconnected) => self.take_metering_pipelines(None),
                Err(TryRecvError::Empty) => {}
            }
        } else {
            self.meter_or_delay(frame);
        }
    }

    /// The pipelines that a frame waits for to be metered, once they are made on their thread;
    /// never ready if none does.
    pub(super) fn metering_pipelines(&self) -> Receiver<ScenePipelines> {
        self.delayed_metering.as_ref().map_or_else(never, |delayed| delayed.made.clone())
    }

    /// Meters the frame that waited for these pipelines. Without them, since their thread failed,
    /// they are made here.
    pub(super) fn take_metering_pipelines(&mut self, pipelines: Option<ScenePipelines>) {
        let Some(DelayedMetering { frame, .. }) = self.delayed_metering.take() else { return };
        match pipelines {
            Some(pipelines) => {
                self.renderer.add_pipelines(pipelines);
                self.meter_or_delay(frame);
            }
            None => self.meter_now(&frame),
        }
    }

    /// Meters a frame, or has the pipelines for that made beside the next ones.
    fn meter_or_delay(&mut self, frame: Box<Frame>) {
        let Some(drawable) = self.state_of(&frame) else { return };
        let needs = PipelineNeeds::metering(&drawable.scene, frame.presentation.effects());
        if self.renderer.pipelines().meet(&needs) {
            self.meter_now(&frame);
        } else {
            let made = self.make_pipelines(vec![needs]);
            self.delayed_metering = Some(DelayedMetering { frame, made });
        }
    }

    /// The state that a frame shows, unless another one has replaced it.
    fn state_of(&self, frame: &Frame) -> Option<&ReadyState> {
        let is_its = |epoch, revision| (epoch, revision) == (frame.epoch, frame.revision);
        self.states.front().filter(|it| is_its(it.state.epoch, it.state.replica.revision))
    }

    pub(super) fn meter_now(&mut self, frame: &Frame) {
        let Some(drawable) = self.state_of(frame) else { return };
        let _span = tracing::error_span!("meter", frame = frame.frame.0).entered();
        let state = Arc::clone(&drawable.state);
        let correctors = Rc::clone(&drawable.correctors);
        let scene = Rc::clone(&drawable.scene);
        let scene = self.scene_at(scene, state.motion.as_deref(), &frame.clips);
        let Some(wall) = state.replica.wall.as_deref() else { return };
        for index in 0..self.outputs.len() {
            let Some((id, _)) = wall.channel_by_name(&self.outputs[index].name) else { continue };
            match self.counts((wall, id), frame, &scene, &correctors) {
                Ok(counts) => self.send(render_event::luminance(frame, id, counts)),
                // The manager does without.
                Err(reason) => tracing::debug!(reason, "a channel could not be metered"),
            }
        }
    }

    /// Numbers of pixels by luminance, of each picture by the part of it that is seen.
    fn counts(
        &mut self,
        (wall, id): (&Wall, ChannelId),
        frame: &Frame,
        scene: &GpuScene,
        correctors: &Correctors,
    ) -> Result<Vec<u32>, String> {
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        let pictures = if let Some(corrector) = correctors.borrow_mut().get_mut(&channel.name) {
            corrector.metered_pictures(&self.gpu, wall, frame)?
        } else {
            let (size, views) = (channel.size.to_array(), frame_views::views(wall, id, frame)?);
            vec![MeteredPicture { size, views, share: 1.0 }]
        };
        let mut counts = vec![0.0f64; LUMINANCE_COUNTS];
        for MeteredPicture { size, views, share } in pictures {
            let (size, views) = sampled(&views, size);
            let luminances = self.renderer.luminances(&self.gpu, scene, size, &views);
            for luminance in luminances.map_err(|error| error.to_string())? {
                if let Some(index) = luminance_index(luminance) {
                    counts[index] += share;
                }
            }
        }
        Ok(whole_counts(counts))
    }
}

/// Rounds counts so that the sum of all up to any of them is off by half at most: by themselves,
/// many that are less than half would be none.
fn whole_counts(counts: Vec<f64>) -> Vec<u32> {
    let (mut sum, mut told) = (0.0f64, 0u32);
    let whole = |count: f64| {
        sum += count;
        let so_far = sum.round() as u32;
        so_far - std::mem::replace(&mut told, so_far)
    };
    counts.into_iter().map(whole).collect()
}

/// The views of a picture with fewer pixels, and its size. Levels of detail and shadows stay those
/// of the whole picture, so that maps of shadows serve both.
fn sampled(views: &[ViewDesc], whole: [u32; 2]) -> ([u32; 2], Vec<ViewDesc>) {
    let ends = views.iter().filter_map(|view| view.scissor.map(|[x, y, w, h]| [x + w, y + h]));
    let [width, height] = ends.fold(whole, |[w, h], [x, y]| [w.max(x), h.max(y)]);
    let reduced = |pixels: u32| pixels.div_ceil(PIXELS_PER_SAMPLE).max(1);
    let share = 1.0 / f64::from(PIXELS_PER_SAMPLE);
    let views = views.iter().filter_map(|view| {
        let scissor = match view.scissor {
            None => None,
            Some([x, y, w, h]) => {
                let [left, top] = [x, y].map(|at| at / PIXELS_PER_SAMPLE);
                let [right, bottom] = [x + w, y + h].map(|at| at / PIXELS_PER_SAMPLE);
                // Too small to count.
                (left < right && top < bottom).then_some(())?;
                Some([left, top, right - left, bottom - top])
            }
        };
        Some(ViewDesc { viewport: view.viewport.map(|at| at * share), scissor, ..view.clone() })
    });
    ([reduced(width), reduced(height)], views.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_shares_of_many_counts_are_not_rounded_away() {
        let whole = whole_counts(vec![0.4; 320]);
        assert_eq!(whole.iter().sum::<u32>(), 128);
        assert!(whole.iter().all(|count| *count <= 1));
        assert_eq!(whole_counts(vec![0.0, 3.0, 0.0, 7.0]), [0, 3, 0, 7]);
    }
}
