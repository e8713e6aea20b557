//! The wall, as an application drives it.

use std::pin::pin;

use glam::DVec3;
use polyptych_protocol::delivery::Delivery;
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::feedback::{FrameFeedback, Statistics, Tuned, WallStatus};
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::ids::Epoch;
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::{Pacing, Request, Response, StoppedServers};
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, ToneMapper};
use polyptych_wall::Wall;
use polyptych_wall::calibration_change::CalibrationChange;
use polyptych_wall::camera::Camera;
use polyptych_wall::view::View;
use tokio::io::{AsyncRead, AsyncWrite};

use crate::connect::{ConnectOptions, connect_over, connect_tcp};
use crate::connection_handle::{ConnectionHandle, Wanted};
use crate::error::{ClientError, wrong_answer};
use crate::feedback::FeedbackStream;
use crate::pending::Pending;

/// A connection with a wall's manager.
///
/// Clones share the connection, which closes when the last clone, [`Pending`] and
/// [`FeedbackStream`] are dropped. Requests reach the manager in the order in which they are made,
/// and several may be open at once. Dropping the future of a call gives up its answer and frees its
/// place; the manager may do the request all the same.
///
/// Every method fails with [`ClientError`]: as the manager says ([`ClientError::Failed`], after
/// which the wall is as it was), or because no answer came ([`ClientError::TimedOut`],
/// [`ClientError::ConnectionLost`], [`ClientError::ManagerEnded`]: the outcome is unknown), or
/// because nothing was sent ([`ClientError::Closed`], [`ClientError::TooManyOpen`],
/// [`ClientError::NotConnected`]).
///
/// A connection that is lost is made again, unless [`ConnectOptions::reconnect`] says otherwise:
/// requests that were sent fail once with an outcome that is unknown
/// ([`ClientError::is_outcome_unknown`]) and are never repeated, later ones wait for the
/// connection, and [`Client::feedback`] goes on. The manager remembers scene, camera and pace. One
/// that has a standby, and from which nothing comes for five seconds, counts as lost too.
#[derive(Clone, Debug)]
pub struct Client {
    pub(crate) link: ConnectionHandle,
}

impl Client {
    /// Connects to the manager at `address`, with the user's own token.
    ///
    /// # Errors
    /// [`ClientError`], which says what would be right.
    ///
    /// # Panics
    /// Outside of a tokio runtime; [`crate::blocking::Client`] needs none.
    pub async fn connect(address: &str) -> Result<Self, ClientError> {
        Self::connect_with(ConnectOptions::new(address)).await
    }

    /// Connects to a manager with these options; see [`Client::connect`].
    ///
    /// # Errors
    /// [`ClientError`], which says what would be right.
    ///
    /// # Panics
    /// Outside of a tokio runtime; [`crate::blocking::Client`] needs none.
    pub async fn connect_with(options: ConnectOptions) -> Result<Self, ClientError> {
        let (link, driver) = connect_tcp(options).await?;
        tokio::spawn(driver);
        Ok(Self { link })
    }

    /// Connects over a byte stream that leads to a manager: a tunnel, or a pipe to a manager in the
    /// same process. Otherwise like [`Client::connect_with`]; the address appears only in messages.
    ///
    /// # Errors
    /// [`ClientError`], which says what would be right.
    ///
    /// # Panics
    /// Outside of a tokio runtime.
    pub async fn connect_over<S>(stream: S, options: ConnectOptions) -> Result<Self, ClientError>
    where
        S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let (link, driver) = connect_over(stream, options).await?;
        tokio::spawn(driver);
        Ok(Self { link })
    }

    pub(crate) fn from_link(link: ConnectionHandle) -> Self {
        Self { link }
    }

    /// The manager's host and port.
    pub fn address(&self) -> &str {
        &self.link.shared.address
    }

    /// The wall's name, as the manager gave it when this client connected.
    pub fn wall_name(&self) -> &str {
        &self.link.shared.wall
    }

    /// Returns whether there is a connection now.
    pub fn is_connected(&self) -> bool {
        matches!(self.link.shared.connection(), Ok(Some(_)))
    }

    /// Returns the epoch of the manager that this client talks to, or has talked to last. Another
    /// one after a reconnection means that the manager was restarted.
    pub fn epoch(&self) -> Epoch {
        self.link.shared.epoch()
    }

    /// Waits until there is a connection, and gives the life of the manager.
    ///
    /// # Errors
    /// [`ClientError::Closed`] where there will be none any more.
    pub async fn connected(&self) -> Result<Epoch, ClientError> {
        let shared = &self.link.shared;
        loop {
            let mut changed = pin!(shared.connection_changed.notified());
            // From here on no change is missed.
            changed.as_mut().enable();
            if let Some(epoch) = shared.connection()? {
                return Ok(epoch);
            }
            changed.await;
        }
    }

    /// Returns the reason why there is no connection, or none any more; `None` while there is one.
    pub fn close_reason(&self) -> Option<String> {
        self.link.shared.end_reason()
    }

    /// Returns the number of requests that wait for their answers; at most
    /// [`crate::OPEN_REQUESTS_MAX`].
    pub fn pending_requests(&self) -> usize {
        self.link.shared.open_requests()
    }

    /// Sends a request and does not wait for its answer, which the handle gives later.
    /// Pictures of a posted [`Request::Capture`] are thrown away; [`Client::capture`] keeps them.
    ///
    /// # Errors
    /// [`ClientError::Closed`], [`ClientError::TooManyOpen`], [`ClientError::RequestTooLarge`]:
    /// nothing was sent.
    pub fn submit(&self, request: Request) -> Result<Pending, ClientError> {
        self.link.post(request, Wanted::default())
    }

    /// Sends a request that is begun when no immediate one of this client waits for its turn, and
    /// no queued one is under way: the highest priority next, equal ones in their order. All that
    /// the other methods send is immediate. It has no time limit; what still waits when this
    /// client's connection ends is dropped.
    ///
    /// At most [`QUEUED_REQUESTS_MAX`](crate::QUEUED_REQUESTS_MAX) wait, or 2 MiB of them; the
    /// answer to one more says so.
    ///
    /// # Errors
    /// Those of [`Client::submit`].
    pub fn submit_queued(&self, request: Request, priority: u8) -> Result<Pending, ClientError> {
        let delivery = Delivery::Queued { priority };
        self.link.post(request, Wanted { delivery, ..Wanted::default() })
    }

    /// Sends any request and waits for its reply; the other methods are this, typed.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn request(&self, request: Request) -> Result<Response, ClientError> {
        self.submit(request)?.await
    }

    /// Places display space in the scene, from the next frame on.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where [`Camera::fault`] finds a fault.
    pub async fn set_camera(&self, camera: Camera) -> Result<(), ClientError> {
        self.done("set the camera", Request::SetCamera(camera)).await
    }

    /// Places the origin of display space at `position` and turns its −Z to `target`, with `up`
    /// upwards, from the next frame on. World units count as metres; [`Camera::with_scale`] and
    /// [`crate::fit_bounds`] are for scenes of other sizes.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn look_at(
        &self,
        position: DVec3,
        target: DVec3,
        up: DVec3,
    ) -> Result<(), ClientError> {
        self.set_camera(Camera::look_at(position, target, up)).await
    }

    /// Moves the viewer's head, from the next frame on: all channels draw it for their eye of it.
    /// Takes a [`HeadPose`](crate::HeadPose), or a point between the eyes in metres of display
    /// space: the head then stays turned as it is, and its eyes as far apart.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where one of the eyes would not see the front of a
    /// screen.
    pub async fn set_head(&self, head: impl Into<HeadUpdate>) -> Result<(), ClientError> {
        self.done("set the head", Request::SetHead(head.into())).await
    }

    /// Lays views over the wall's own picture, from the next frame on, later ones over earlier
    /// ones: at most 63. They stay when the camera moves, until [`Client::clear_views`].
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where one of them cannot be.
    pub async fn set_views(&self, views: Vec<View>) -> Result<(), ClientError> {
        self.done("set the views", Request::SetViews(views)).await
    }

    /// Takes all views away, from the next frame on.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn clear_views(&self) -> Result<(), ClientError> {
        self.set_views(Vec::new()).await
    }

    /// Returns the presentation of the next frame: camera, head, views, exposure, and output mode.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn presentation(&self) -> Result<Presentation, ClientError> {
        self.status().await.map(|status| status.presentation)
    }

    /// Multiplies light by `exposure` before tone mapping, from the next frame on and until
    /// another scene is opened: that sets the exposure that suits it, which is 1 for most. Ends an
    /// automatic one.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn set_exposure(&self, exposure: f32) -> Result<(), ClientError> {
        self.done("set the exposure", Request::SetExposure(exposure)).await
    }

    /// Exposes the wall by what it shows, from the next frame on and until
    /// [`Self::set_exposure`]: the mean light becomes middle grey within a second, on all channels
    /// alike. Opening another scene does not end it.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn set_automatic_exposure(&self) -> Result<(), ClientError> {
        self.done("set the automatic exposure", Request::SetAutomaticExposure).await
    }

    /// Surrounds scenes by light, until it is set again; returns once every live channel can draw
    /// with it. A file is an equirectangular Radiance .hdr in one of the manager's scene folders.
    ///
    /// # Errors
    /// [`ClientError`]; a file that cannot be read, with the place in it and the remedy.
    pub async fn set_environment(&self, environment: EnvironmentSource) -> Result<(), ClientError> {
        self.done("set the environment", Request::SetEnvironment(environment)).await
    }

    /// Sets how exposed light becomes what displays show, from the next frame on.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn set_tone(&self, tone: ToneMapper) -> Result<(), ClientError> {
        self.done("set the tone mapper", Request::SetTone(tone)).await
    }

    /// Lays fog over all that cameras see; `None` takes it away. Returns once every live channel
    /// can draw so, and frames have it. Plans, whose rays are parallel, have none.
    ///
    /// # Errors
    /// [`ClientError`]; a number that no fog has.
    pub async fn set_fog(&self, fog: Option<Fog>) -> Result<(), ClientError> {
        self.done("set the fog", Request::SetFog(fog)).await
    }

    /// Spreads light around what is bright; `None` ends it. Returns once every live channel can
    /// draw so, and frames have it. Plans, whose rays are parallel, have none.
    ///
    /// # Errors
    /// [`ClientError`]; a number that no glow has.
    pub async fn set_glow(&self, glow: Option<Glow>) -> Result<(), ClientError> {
        self.done("set the glow", Request::SetGlow(glow)).await
    }

    /// Darkens corners and gaps, which get less of the light from all around; `None` ends it.
    /// Returns once every live channel can draw so, and frames have it.
    ///
    /// # Errors
    /// [`ClientError`]; a radius that is not above 0.
    pub async fn set_ambient_occlusion(
        &self,
        occlusion: Option<AmbientOcclusion>,
    ) -> Result<(), ClientError> {
        self.done("set the ambient occlusion", Request::SetAmbientOcclusion(occlusion)).await
    }

    /// Blurs what is nearer or farther than a distance; `None` ends it. Returns once every live
    /// channel can draw so, and frames have it. Plans, whose rays are parallel, are sharp.
    ///
    /// # Errors
    /// [`ClientError`]; a focus or an aperture that is not above 0.
    pub async fn set_depth_of_field(&self, of: Option<DepthOfField>) -> Result<(), ClientError> {
        self.done("set the depth of field", Request::SetDepthOfField(of)).await
    }

    /// Bounds the error and the rate of pictures, from the next frame on and until it is set again.
    /// The feedback of every frame says which error bound was in force, and the largest error that
    /// was drawn.
    ///
    /// # Errors
    /// [`ClientError`]; a number out of its range, with the range.
    pub async fn set_bounds(&self, bounds: QualityBounds) -> Result<(), ClientError> {
        self.done("set the bounds", Request::SetBounds(bounds)).await
    }

    /// Draws and shows one frame on all channels; returns what it became.
    ///
    /// A frame that no display showed is no error: a wall may have no servers yet, and goes on
    /// without those that it loses. [`FrameFeedback::shown`] tells which displays showed it.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn render_frame(&self) -> Result<FrameFeedback, ClientError> {
        self.render_frame_at(None, None).await
    }

    /// Places the camera and sets the scene's time to `time_s` seconds, each if given, then renders
    /// a frame like [`Client::render_frame`]; without a time the wall's own clock goes on.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn render_frame_at(
        &self,
        camera: Option<Camera>,
        time_s: Option<f64>,
    ) -> Result<FrameFeedback, ClientError> {
        self.frame("render a frame", Request::RenderFrame { camera, time_s }).await
    }

    /// Lets the wall draw frames by itself at this pace, until [`Client::pause`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn start_rendering(&self, pace: Pacing) -> Result<(), ClientError> {
        self.done("run", Request::Run(pace)).await
    }

    /// Stops the wall from drawing by itself; it goes on showing the last frame.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn pause(&self) -> Result<(), ClientError> {
        self.done("pause", Request::Pause).await
    }

    /// Changes what all displays show: the picture, their names over it, black, or for ever what
    /// they show now. Returns what the first frame with it became, which says on which displays it
    /// is seen; a paused wall draws one for it. Frames go on and captures are as before, whatever
    /// displays show.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn set_output_mode(&self, mode: OutputMode) -> Result<FrameFeedback, ClientError> {
        self.frame("change the displays", Request::SetDisplays(mode)).await
    }

    /// Lets all channels draw a test pattern instead of the scene, or the scene again. Returns
    /// what the first frame with it became; captures have it too.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn set_pattern(
        &self,
        pattern: Option<TestPattern>,
    ) -> Result<FrameFeedback, ClientError> {
        self.frame("change the pattern", Request::SetPattern(pattern)).await
    }

    /// Changes a channel's adjustment, all of it or nothing. Returns what the first frame with it
    /// became; a paused wall draws one for it. The manager remembers it; the wall file says it once
    /// it is written there. Tunings that come faster than frames are shown together.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the key that is wrong.
    pub async fn calibrate(
        &self,
        channel: impl Into<String>,
        changes: Vec<CalibrationChange>,
    ) -> Result<Tuned, ClientError> {
        match self.request(Request::Tune { channel: channel.into(), changes }).await? {
            Response::Tuned(tuned) => Ok(tuned),
            other => Err(wrong_answer("tune the channel", &other)),
        }
    }

    /// The wall's state: channels, servers, warnings.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn status(&self) -> Result<WallStatus, ClientError> {
        match self.request(Request::Status).await? {
            Response::Status(status) => Ok(*status),
            other => Err(wrong_answer("read the status", &other)),
        }
    }

    /// The wall's description: screens, channels, eye.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn wall(&self) -> Result<Wall, ClientError> {
        match self.request(Request::DescribeWall).await? {
            Response::Wall(wall) => Ok(*wall),
            other => Err(wrong_answer("read the wall's description", &other)),
        }
    }

    /// Returns measurements of the frames since the statistics were last reset; `reset` resets them
    /// afterwards.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn statistics(&self, reset: bool) -> Result<Statistics, ClientError> {
        match self.request(Request::Statistics { reset }).await? {
            Response::Statistics(statistics) => Ok(*statistics),
            other => Err(wrong_answer("read the statistics", &other)),
        }
    }

    /// Subscribes to the feedback of every frame: all that are shown after this returns, and
    /// perhaps some before. Several readers of one connection each get all of them.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn feedback(&self) -> Result<FeedbackStream, ClientError> {
        self.link.subscribe().await
    }

    /// Ends the manager, and this client with it. A goodbye instead of an answer is as good.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn stop(&self) -> Result<(), ClientError> {
        match self.done("stop the manager", Request::Stop).await {
            Err(ClientError::ManagerEnded { .. }) => Ok(()),
            other => other,
        }
    }

    pub(crate) async fn frame(
        &self,
        name: &'static str,
        request: Request,
    ) -> Result<FrameFeedback, ClientError> {
        match self.request(request).await? {
            Response::Frame(feedback) => Ok(feedback),
            other => Err(wrong_answer(name, &other)),
        }
    }

    /// Ends all servers of the wall and then the manager, and this client with it. Returns what
    /// became of the servers.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn stop_with_servers(&self) -> Result<StoppedServers, ClientError> {
        match self.request(Request::StopServers).await? {
            Response::ServersStopped(stopped) => Ok(stopped),
            other => Err(wrong_answer("stop the manager and its servers", &other)),
        }
    }

    pub(crate) async fn done(
        &self,
        name: &'static str,
        request: Request,
    ) -> Result<(), ClientError> {
        match self.request(request).await? {
            Response::Done => Ok(()),
            other => Err(wrong_answer(name, &other)),
        }
    }
}
