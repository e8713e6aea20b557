//! The wall, for programs without tokio: the same calls, which wait.
//!
//! The connection lives on a thread of its own, named `polyptych-client`. A call parks the
//! caller's thread until its answer is there. That is possible anywhere, inside a tokio runtime
//! too; but there it stops all other tasks of that thread, and so belongs into `spawn_blocking`.
//! A manager that runs on the very runtime that such a call stops can't answer it.
//!
//! ```no_run
//! use polyptych_client::blocking::Client;
//!
//! # fn example() -> Result<(), polyptych_client::ClientError> {
//! let wall = Client::connect("127.0.0.1:7878")?;
//! wall.open_scene("town.glb")?;
//! println!("{:?}", wall.render_frame()?.shown());
//! # Ok(()) }
//! ```

mod captures;
mod clips;
mod devices;
mod displays;
mod exports;
mod quality;
mod saved_scenes;
mod scene_space;
mod sessions;
mod tours;
mod tunings;
mod variants;

use std::pin::pin;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};

use glam::{DVec2, DVec3};
use polyptych_protocol::feedback::{Edited, FrameFeedback, Statistics, Tuned, WallStatus};
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::ids::{Epoch, RequestId};
use polyptych_protocol::node_query::{NodeInfo, NodePage, NodeQuery, RayHit, RayQuery};
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{Pacing, Request, Response, SceneSummary, StoppedServers};
use polyptych_protocol::transaction::Transaction;
use polyptych_wall::Wall;
use polyptych_wall::calibration_change::CalibrationChange;
use polyptych_wall::camera::Camera;
use polyptych_wall::view::View;

use crate::client::Client as AsyncClient;
use crate::connect::{ConnectOptions, connect_tcp, thread_ended};
use crate::error::ClientError;
use crate::feedback::FeedbackStream as AsyncFeedbacks;
use crate::image::Capture;
use crate::pending::Pending as AsyncPending;
use crate::scene_file::SceneFile;

/// A connection to a wall's manager; clones share it. Blocking version of [`crate::Client`].
///
/// Requests that were submitted and not waited for may be lost if the program ends.
#[derive(Clone, Debug)]
pub struct Client {
    inner: AsyncClient,
}

/// A request that was sent: wait for it, query it from time to time, or drop it. Blocking version
/// of [`crate::Pending`].
#[derive(Debug)]
#[must_use = "dropping gives up the answer"]
pub struct Pending {
    inner: AsyncPending,
}

/// The feedback of every frame from the subscription on. The iterator waits for each, and ends with
/// the client. Blocking version of [`crate::FeedbackStream`].
#[derive(Debug)]
pub struct FeedbackStream {
    inner: AsyncFeedbacks,
}

impl Client {
    /// Blocking version of [`crate::Client::connect`], in or outside of a tokio runtime.
    ///
    /// # Errors
    /// [`ClientError`], which says what would be right.
    pub fn connect(address: &str) -> Result<Self, ClientError> {
        Self::connect_with(ConnectOptions::new(address))
    }

    /// Blocking version of [`crate::Client::connect_with`], in or outside of a tokio runtime.
    ///
    /// # Errors
    /// [`ClientError`], which says what would be right.
    pub fn connect_with(options: ConnectOptions) -> Result<Self, ClientError> {
        let (sender, connected) = sync_channel(1);
        let work = move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let runtime = match runtime {
                Ok(runtime) => runtime,
                Err(error) => {
                    let _gone = sender.send(Err(ClientError::Thread(error)));
                    return;
                }
            };
            runtime.block_on(async {
                let driver = match connect_tcp(options).await {
                    Ok((link, driver)) => {
                        let _gone = sender.send(Ok(link));
                        driver
                    }
                    Err(error) => {
                        let _gone = sender.send(Err(error));
                        return;
                    }
                };
                driver.await;
            });
        };
        let thread = thread::Builder::new().name("polyptych-client".into());
        thread.spawn(work).map_err(ClientError::Thread)?;
        let link = connected.recv().map_err(|_| thread_ended())??;
        Ok(Self { inner: AsyncClient::from_link(link) })
    }

    /// Blocking version of [`crate::Client::address`].
    pub fn address(&self) -> &str {
        self.inner.address()
    }

    /// Blocking version of [`crate::Client::wall_name`].
    pub fn wall_name(&self) -> &str {
        self.inner.wall_name()
    }

    /// Blocking version of [`crate::Client::is_connected`].
    pub fn is_connected(&self) -> bool {
        self.inner.is_connected()
    }

    /// Blocking version of [`crate::Client::epoch`].
    pub fn epoch(&self) -> Epoch {
        self.inner.epoch()
    }

    /// Blocking version of [`crate::Client::connected`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn connected(&self) -> Result<Epoch, ClientError> {
        wait(self.inner.connected())
    }

    /// Blocking version of [`crate::Client::close_reason`].
    pub fn close_reason(&self) -> Option<String> {
        self.inner.close_reason()
    }

    /// Blocking version of [`crate::Client::pending_requests`].
    pub fn pending_requests(&self) -> usize {
        self.inner.pending_requests()
    }

    /// Blocking version of [`crate::Client::submit`].
    ///
    /// # Errors
    /// [`ClientError`]: nothing was sent.
    pub fn submit(&self, request: Request) -> Result<Pending, ClientError> {
        Ok(Pending { inner: self.inner.submit(request)? })
    }

    /// Blocking version of [`crate::Client::submit_queued`].
    ///
    /// # Errors
    /// [`ClientError`]: nothing was sent.
    pub fn submit_queued(&self, request: Request, priority: u8) -> Result<Pending, ClientError> {
        Ok(Pending { inner: self.inner.submit_queued(request, priority)? })
    }

    /// Blocking version of [`crate::Client::request`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn request(&self, request: Request) -> Result<Response, ClientError> {
        wait(self.inner.request(request))
    }

    /// Blocking version of [`crate::Client::open_scene`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn open_scene(&self, file: impl Into<SceneFile>) -> Result<SceneSummary, ClientError> {
        wait(self.inner.open_scene(file))
    }

    /// Blocking version of [`crate::Client::open_scene_with`]: `on_progress` is called on the
    /// caller's thread.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn open_scene_with(
        &self,
        file: impl Into<SceneFile>,
        on_progress: impl FnMut(OpenProgress),
    ) -> Result<SceneSummary, ClientError> {
        wait(self.inner.open_scene_with(file, on_progress))
    }

    /// Blocking version of [`crate::Client::close_scene`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn close_scene(&self) -> Result<(), ClientError> {
        wait(self.inner.close_scene())
    }

    /// Blocking version of [`crate::Client::set_camera`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_camera(&self, camera: Camera) -> Result<(), ClientError> {
        wait(self.inner.set_camera(camera))
    }

    /// Blocking version of [`crate::Client::look_at`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn look_at(&self, position: DVec3, target: DVec3, up: DVec3) -> Result<(), ClientError> {
        wait(self.inner.look_at(position, target, up))
    }

    /// Blocking version of [`crate::Client::set_head`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_head(&self, head: impl Into<HeadUpdate>) -> Result<(), ClientError> {
        wait(self.inner.set_head(head))
    }

    /// Blocking version of [`crate::Client::set_views`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_views(&self, views: Vec<View>) -> Result<(), ClientError> {
        wait(self.inner.set_views(views))
    }

    /// Blocking version of [`crate::Client::clear_views`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn clear_views(&self) -> Result<(), ClientError> {
        wait(self.inner.clear_views())
    }

    /// Blocking version of [`crate::Client::presentation`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn presentation(&self) -> Result<Presentation, ClientError> {
        wait(self.inner.presentation())
    }

    /// Blocking version of [`crate::Client::render_frame`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn render_frame(&self) -> Result<FrameFeedback, ClientError> {
        wait(self.inner.render_frame())
    }

    /// Blocking version of [`crate::Client::render_frame_at`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn render_frame_at(
        &self,
        camera: Option<Camera>,
        time_s: Option<f64>,
    ) -> Result<FrameFeedback, ClientError> {
        wait(self.inner.render_frame_at(camera, time_s))
    }

    /// Blocking version of [`crate::Client::start_rendering`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn start_rendering(&self, pace: Pacing) -> Result<(), ClientError> {
        wait(self.inner.start_rendering(pace))
    }

    /// Blocking version of [`crate::Client::pause`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn pause(&self) -> Result<(), ClientError> {
        wait(self.inner.pause())
    }

    /// Blocking version of [`crate::Client::set_output_mode`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_output_mode(&self, mode: OutputMode) -> Result<FrameFeedback, ClientError> {
        wait(self.inner.set_output_mode(mode))
    }

    /// Blocking version of [`crate::Client::set_pattern`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_pattern(&self, pattern: Option<TestPattern>) -> Result<FrameFeedback, ClientError> {
        wait(self.inner.set_pattern(pattern))
    }

    /// Blocking version of [`crate::Client::calibrate`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn calibrate(
        &self,
        channel: impl Into<String>,
        changes: Vec<CalibrationChange>,
    ) -> Result<Tuned, ClientError> {
        wait(self.inner.calibrate(channel, changes))
    }

    /// Blocking version of [`crate::Client::commit`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn commit(&self, transaction: Transaction) -> Result<Edited, ClientError> {
        wait(self.inner.commit(transaction))
    }

    /// Blocking version of [`crate::Client::find_nodes`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn find_nodes(&self, query: NodeQuery) -> Result<NodePage, ClientError> {
        wait(self.inner.find_nodes(query))
    }

    /// Blocking version of [`crate::Client::find_all_nodes`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn find_all_nodes(&self, query: NodeQuery) -> Result<Vec<NodeInfo>, ClientError> {
        wait(self.inner.find_all_nodes(query))
    }

    /// Blocking version of [`crate::Client::cast_ray`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn cast_ray(&self, query: RayQuery) -> Result<Option<RayHit>, ClientError> {
        wait(self.inner.cast_ray(query))
    }

    /// Blocking version of [`crate::Client::pick`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn pick(&self, screen: &str, pixel: DVec2) -> Result<Option<RayHit>, ClientError> {
        wait(self.inner.pick(screen, pixel))
    }

    /// Blocking version of [`crate::Client::capture`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn capture(&self) -> Result<Capture, ClientError> {
        wait(self.inner.capture())
    }

    /// Blocking version of [`crate::Client::status`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn status(&self) -> Result<WallStatus, ClientError> {
        wait(self.inner.status())
    }

    /// Blocking version of [`crate::Client::wall`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn wall(&self) -> Result<Wall, ClientError> {
        wait(self.inner.wall())
    }

    /// Blocking version of [`crate::Client::statistics`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn statistics(&self, reset: bool) -> Result<Statistics, ClientError> {
        wait(self.inner.statistics(reset))
    }

    /// Blocking version of [`crate::Client::feedback`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn feedback(&self) -> Result<FeedbackStream, ClientError> {
        Ok(FeedbackStream { inner: wait(self.inner.feedback())? })
    }

    /// Blocking version of [`crate::Client::stop`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn stop(&self) -> Result<(), ClientError> {
        wait(self.inner.stop())
    }

    /// Blocking version of [`crate::Client::stop_with_servers`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn stop_with_servers(&self) -> Result<StoppedServers, ClientError> {
        wait(self.inner.stop_with_servers())
    }
}

impl Pending {
    /// Returns the request's number; see [`crate::Pending::id`].
    pub fn id(&self) -> RequestId {
        self.inner.id()
    }

    /// Returns the answer, if it is there; see [`crate::Pending::poll`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn query(&mut self) -> Option<Result<Response, ClientError>> {
        self.inner.poll()
    }

    /// Waits for the answer.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn wait(self) -> Result<Response, ClientError> {
        wait(self.inner)
    }
}

impl FeedbackStream {
    /// Returns the number of reconnections; see [`crate::FeedbackStream::reconnects`].
    pub fn reconnects(&self) -> u64 {
        self.inner.reconnects()
    }

    /// Returns the epoch of the last feedback; see [`crate::FeedbackStream::epoch`].
    pub fn epoch(&self) -> Epoch {
        self.inner.epoch()
    }

    /// Returns the number of dropped feedbacks; see [`crate::FeedbackStream::dropped`].
    pub fn dropped(&self) -> u64 {
        self.inner.dropped()
    }
}

impl Iterator for FeedbackStream {
    type Item = FrameFeedback;

    fn next(&mut self) -> Option<FrameFeedback> {
        wait(self.inner.next())
    }
}

/// Parks this thread until the future is done.
///
/// Tokio's own `block_on` panics inside a runtime. Our futures need no runtime: the connection's
/// thread has the clock and the socket. They are unconstrained, since tokio would otherwise make
/// them yield, and a thread that is parked inside of a task never gives the task a new budget.
fn wait<F: Future>(future: F) -> F::Output {
    let waker = Waker::from(Arc::new(ThreadWaker(thread::current())));
    let mut context = Context::from_waker(&waker);
    let mut future = pin!(tokio::task::unconstrained(future));
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return output;
        }
        thread::park();
    }
}

struct ThreadWaker(Thread);

impl Wake for ThreadWaker {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}
