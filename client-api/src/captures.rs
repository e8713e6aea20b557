//! Frames of the wall that move nothing, and its pictures.

use polyptych_protocol::feedback::FrameFeedback;
use polyptych_protocol::request::{Request, Response};
use polyptych_wall::camera::Camera;

use crate::client::Client;
use crate::connection_handle::Wanted;
use crate::error::{ClientError, wrong_answer};
use crate::image::{Capture, ChunkSink, ImageAssembler};

impl Client {
    /// Places the camera, if given, and renders a frame like [`Client::render_frame`]; on a paused
    /// wall with the scene time of the frame before, so that nothing else moves.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn redraw(&self, camera: Option<Camera>) -> Result<FrameFeedback, ClientError> {
        self.frame("render a frame", Request::Redraw(camera)).await
    }

    /// Draws and shows one frame, and returns its pictures: each screen as it hangs on the wall,
    /// and each channel.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::CaptureTooLarge`] where the pictures take more than
    /// [`crate::ConnectOptions::capture_bytes_max`].
    pub async fn capture(&self) -> Result<Capture, ClientError> {
        self.capture_at(None).await
    }

    /// Captures with the scene's time set to `time_s` seconds where given: frames
    /// at equal steps of it make a film, however long each takes.
    ///
    /// # Errors
    /// Those of [`Client::capture`].
    pub async fn capture_at(&self, time_s: Option<f64>) -> Result<Capture, ClientError> {
        self.pictures(Request::Capture { time_s }).await
    }

    async fn pictures(&self, request: Request) -> Result<Capture, ClientError> {
        let name = request.name();
        let pictures = ImageAssembler::new(self.link.shared.capture_bytes_max());
        let pictures = ChunkSink::Pictures(pictures);
        let wanted = Wanted { parts: Some(pictures), ..Wanted::default() };
        let mut pending = self.link.post(request, wanted)?;
        let answered = std::future::poll_fn(|context| pending.poll_answered(context)).await?;
        match (answered.reply, answered.parts) {
            (Response::Captured(captured), Some(ChunkSink::Pictures(parts))) => {
                parts.assemble(captured)
            }
            (other, _) => Err(wrong_answer(name, &other)),
        }
    }

    /// Returns the pictures of the wall for a person who watches: of the next frame that it draws
    /// by itself, or of its last one. Unlike [`Client::capture`] it neither moves scene time on
    /// nor waits for a channel longer than other frames do. With at least `width` pixels across all
    /// screens, if the wall has so many, it costs a network little; 0 is for all pixels.
    ///
    /// # Errors
    /// Those of [`Client::capture`].
    pub async fn preview(&self, width: u32) -> Result<Capture, ClientError> {
        self.pictures(Request::Preview { width }).await
    }
}
