//! Pictures that somebody asked for.

use std::num::NonZeroU32;

use polyptych_protocol::ids::FrameId;
use polyptych_renderer::read_picture;
use polyptych_wall::ChannelId;

use super::RenderThread;
use crate::render_event::{self, CapturedImage, RenderEvent};

impl RenderThread {
    /// Sends the picture of a channel as it was drawn, whether or not it comes to be shown: a
    /// picture that someone asked for may be late. Its pixels have the mean light of squares of so
    /// many pixels along each side.
    pub(super) fn send_capture(
        &mut self,
        index: usize,
        (frame, channel): (FrameId, ChannelId),
        side: NonZeroU32,
    ) {
        let Some(picture) = self.outputs[index].picture() else { return };
        let is_reduced = side > NonZeroU32::MIN;
        let reduced = is_reduced.then(|| self.renderer.reduce(&self.gpu, picture, side));
        let picture = reduced.as_ref().unwrap_or(picture);
        let [width, height] = picture.size();
        match read_picture(&self.gpu, picture) {
            Ok(pixels) => {
                let bytes = pixels.into();
                let picture = CapturedImage { channel, frame, width, height, bytes };
                self.send(RenderEvent::Picture(picture));
            }
            Err(error) => self.send(render_event::draw_failed(frame, channel, error.to_string())),
        }
    }
}
