//! Requests of clients: what each of them sets in motion.

use std::num::NonZeroU32;

use polyptych_protocol::ids::RequestId;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{Pacing, Request, RequestError, Response};
use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_wall::Wall;
use polyptych_wall::light_composite::StereoEye;
use polyptych_wall::limits::PATH_BYTES_MAX;
use tracing::Level;

use super::frame_request::{FrameRequest, OutputChange};
use super::presentation::checked_camera;
use super::{
    ClientRequest, Cluster, Effect, FRAME_ORDERS_MAX, Importing, Micros, SessionId, StateChange,
    progress,
};

/// The range of rates that a client may ask for, in frames per second.
const RATES: std::ops::RangeInclusive<f64> = 0.01..=1000.0;

/// Maximum number of scenes of one client that are looked for and baked at a time.
const IMPORTS_MAX: usize = 16;

/// Maximum number of scenes of all clients that are looked for and baked at a time, including those
/// of clients that left before the end.
const IMPORTS_OF_ALL_MAX: usize = 64;

impl Cluster {
    /// A client asks for something. It gets exactly one reply, now or later.
    pub(crate) fn handle_request(
        &mut self,
        now: Micros,
        client: SessionId,
        id: RequestId,
        request: Request,
    ) {
        let job = ClientRequest { client, id };
        if tracing::enabled!(Level::DEBUG) {
            self.request_span(job).in_scope(|| tracing::debug!(?request, "a client asks"));
        }
        self.note_request(now, &request);
        match self.translate(now, job, request) {
            Ok(Some(reply)) => {
                self.persist();
                self.reply(job, Ok(reply));
            }
            // The reply comes with a frame, an import or a change.
            Ok(None) => {}
            Err(reason) => {
                if tracing::enabled!(Level::DEBUG) {
                    let tell = || tracing::debug!(reason, "a request is refused");
                    self.request_span(job).in_scope(tell);
                }
                self.reply(job, Err(RequestError::new(reason)));
            }
        }
        self.advance_frame(now);
    }

    fn translate(
        &mut self,
        now: Micros,
        job: ClientRequest,
        request: Request,
    ) -> Result<Option<Response>, String> {
        match request {
            opening @ (Request::OpenScene { .. }
            | Request::OpenSession { .. }
            | Request::OpenOutcome { .. }
            | Request::CloseScene) => return self.open(now, job, opening),
            Request::SetCamera(camera) => self.place_camera(checked_camera(camera)?),
            Request::SetHead(head) => self.place_head(Some(job.client), head)?,
            Request::Fly(flight) => self.fly(now, &flight)?,
            Request::ReportDevices(report) => self.report_devices(now, job.client, report)?,
            Request::SetViews(views) => self.request_views(views)?,
            Request::SetExposure(exposure) => self.set_exposure(exposure)?,
            Request::SetTone(tone) => self.presentation.tone = tone,
            Request::SetFog(_)
            | Request::SetGlow(_)
            | Request::SetAmbientOcclusion(_)
            | Request::SetDepthOfField(_) => return self.set_effect(now, job, &request),
            Request::SetAutomaticExposure => self.set_automatic_exposure(now),
            Request::MarkPoint(marker) => self.mark_point(marker)?,
            Request::SetRest(rules) => self.set_rest(now, rules)?,
            Request::SetBounds(bounds) => self.set_bounds(bounds)?,
            Request::SetEnvironment(source) => return self.set_environment(now, job, source),
            frame @ (Request::RenderFrame { .. }
            | Request::Redraw(_)
            | Request::Capture { .. }
            | Request::Preview { .. }
            | Request::SetDisplays(_)
            | Request::SetPattern(_)) => return self.order_frame(job, &frame),
            Request::Tune { channel, changes } => {
                return self.calibrate(now, job, &channel, &changes);
            }
            // They are many, and answered beside the core.
            Request::FindNodes(_)
            | Request::CastRay(_)
            | Request::FindInRegion(_)
            | Request::NearestPoint(_)
            | Request::ListLayers
            | Request::SaveScene { .. }
            | Request::FindWay(_)
            | Request::ListSavedScenes
            | Request::RemoveSavedScene { .. }
            | Request::SaveSession { .. }
            | Request::ListSessions
            | Request::RemoveSession { .. }
            | Request::ListSceneFiles
            | Request::ExportScene { .. } => {
                return Err("this manager answers no questions".into());
            }
            Request::Edit(transaction) => return self.edit_scene(now, job, transaction),
            Request::Run(pace) => self.run(pace, now)?,
            Request::Pause => self.set_pace(None, now),
            Request::Status => return Ok(Some(Response::Status(Box::new(self.status(now))))),
            Request::DescribeWall => return Ok(Some(Response::Wall(Box::new(self.wall.clone())))),
            Request::ListTunings => return Ok(Some(Response::Tunings(self.tuned.list()))),
            Request::Statistics { reset } => {
                return Ok(Some(Response::Statistics(Box::new(self.statistics(reset)))));
            }
            Request::Subscribe(wish) => self.subscribe(job, wish),
            guiding @ (Request::StoreView { .. }
            | Request::RemoveView { .. }
            | Request::ListStoredViews
            | Request::PlayTour(_)
            | Request::StopTour
            | Request::DescribeTour) => return self.guide(guiding).map(Some),
            Request::FollowNode(follow) => return self.follow(job, follow),
            Request::ChangeClips(change) => self.change_clips(&change)?,
            list @ (Request::ListClips | Request::ListVariants) => return self.list(&list),
            Request::Stop => return Ok(self.stop(job)),
            Request::StopServers => return Ok(self.stop_servers(job)),
        }
        Ok(Some(Response::Done))
    }

    /// Ends all servers; the event loop answers, which hears their goodbyes.
    fn stop_servers(&mut self, job: ClientRequest) -> Option<Response> {
        self.outputs.push_back(Effect::StopServers { job });
        None
    }

    /// Opens or closes a scene, or all that a session shows.
    fn open(
        &mut self,
        now: Micros,
        job: ClientRequest,
        request: Request,
    ) -> Result<Option<Response>, String> {
        match request {
            Request::OpenScene { path, scene } => self.import(job, path, scene),
            Request::OpenSession { name } => self.open_session(job, name),
            Request::OpenOutcome { session, of } => self.claim_outcome(job, session, of),
            _ => {
                self.request_change(now, StateChange::closing(job));
                Ok(None)
            }
        }
    }

    fn subscribe(&mut self, job: ClientRequest, wish: bool) {
        if let Some(client) = self.clients.get_mut(&job.client) {
            client.is_subscribed = wish;
        }
    }

    /// Lists the variants or the animation clips of the open scene, as requested.
    fn list(&self, request: &Request) -> Result<Option<Response>, String> {
        Ok(Some(match request {
            Request::ListVariants => Response::Variants(self.variants()?),
            _ => Response::Clips(self.clips.statuses()),
        }))
    }

    fn run(&mut self, pace: Pacing, now: Micros) -> Result<(), String> {
        if let Pacing::Rate(rate) = pace
            && !RATES.contains(&rate)
        {
            let (low, high) = (RATES.start(), RATES.end());
            return Err(format!("a rate is {low} to {high} frames per second, not {rate}"));
        }
        self.set_pace(Some(pace), now);
        Ok(())
    }

    fn set_exposure(&mut self, exposure: f32) -> Result<(), String> {
        if !(exposure.is_finite() && exposure >= 0.0) {
            return Err(format!("an exposure is 0 or more, not {exposure}"));
        }
        self.presentation.exposure = exposure;
        self.presentation.is_exposure_automatic = false;
        Ok(())
    }

    /// Answers before the end: afterwards there is nobody to do it.
    fn stop(&mut self, job: ClientRequest) -> Option<Response> {
        self.reply(job, Ok(Response::Done));
        self.outputs.push_back(Effect::Stop);
        None
    }

    fn import(
        &mut self,
        job: ClientRequest,
        path: String,
        scene: Option<String>,
    ) -> Result<Option<Response>, String> {
        if path.is_empty() || path.len() > PATH_BYTES_MAX {
            return Err(format!("a scene's path has 1 to {PATH_BYTES_MAX} bytes"));
        }
        if scene.as_ref().is_some_and(|scene| scene.len() > NODE_NAME_BYTES_MAX) {
            return Err(format!(
                "a scene's name has at most {NODE_NAME_BYTES_MAX} bytes; its number chooses it too"
            ));
        }
        self.begin_import(job, progress::name_of(&path))?;
        self.outputs.push_back(Effect::Import { job, path, scene });
        Ok(None)
    }

    /// Notes that something is read or baked for a client before it can be shown.
    ///
    /// # Errors
    /// There is too much of it already.
    pub(super) fn begin_import(&mut self, job: ClientRequest, name: String) -> Result<(), String> {
        if self.imports.iter().filter(|of| of.job.client == job.client).count() >= IMPORTS_MAX {
            return Err(format!(
                "{IMPORTS_MAX} scenes are being opened for this client already; await some first"
            ));
        }
        if self.imports.len() >= IMPORTS_OF_ALL_MAX {
            return Err(format!(
                "{IMPORTS_OF_ALL_MAX} scenes are being opened already; ask again later"
            ));
        }
        self.outcomes.begin(job);
        self.imports.push(Importing { job, scene: name, progress: OpenProgress::NONE });
        Ok(())
    }

    /// Orders the frame that a request asks for.
    fn order_frame(
        &mut self,
        job: ClientRequest,
        request: &Request,
    ) -> Result<Option<Response>, String> {
        let mut order = FrameRequest::unchanged(job);
        match *request {
            Request::RenderFrame { camera, time_s } => {
                order.camera = camera.map(checked_camera).transpose()?;
                order.time_s = time_s;
            }
            Request::Redraw(camera) => {
                order.camera = camera.map(checked_camera).transpose()?;
                order.keeps_time = true;
            }
            Request::Capture { time_s } => {
                (order.capture, order.time_s) = (Some(NonZeroU32::MIN), time_s);
            }
            Request::Preview { width } => {
                let side = preview_side(&self.wall, width);
                (order.capture, order.is_preview) = (Some(side), true);
                order.keeps_time = true;
            }
            Request::SetDisplays(mode) => order.wish = Some(OutputChange::Displays(mode)),
            Request::SetPattern(pattern) => order.wish = Some(OutputChange::Pattern(pattern)),
            _ => {}
        }
        order.keeps_time |= order.wish.is_some();
        self.order(order)
    }

    fn order(&mut self, order: FrameRequest) -> Result<Option<Response>, String> {
        if order.time_s.is_some_and(|time| !time.is_finite()) {
            return Err("the time of a frame is a finite number of seconds".into());
        }
        let waiting = self.orders.iter().filter(|o| o.job.client == order.job.client).count();
        if waiting >= FRAME_ORDERS_MAX {
            return Err(format!(
                "{FRAME_ORDERS_MAX} frames of this client are waiting already; await some first"
            ));
        }
        self.orders.push_back(order);
        Ok(None)
    }
}

/// The side of the squares of pixels of which a preview has the mean light, so that all screens
/// side by side have at least so many squares across, if they have so many pixels.
fn preview_side(wall: &Wall, width: u32) -> NonZeroU32 {
    let side = StereoEye::pixels_across(wall).checked_div(u64::from(width)).unwrap_or(1);
    u32::try_from(side).ok().and_then(NonZeroU32::new).unwrap_or(NonZeroU32::MIN)
}
