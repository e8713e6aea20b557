//! Requests of clients: what each of them sets in motion.

use polyptych_protocol::ids::RequestId;
use polyptych_protocol::log::Operation;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{Failure, Pace, Reply, Request};
use polyptych_wall::head::Head;
use polyptych_wall::limits::PATH_BYTES_MAX;
use tracing::Level;

use super::change::Purpose;
use super::sight::checked_camera;
use super::{
    Change, Cluster, FRAME_ORDERS_MAX, FrameOrder, Importing, Micros, Output, RequestOf, SessionId,
    Wish, progress,
};

/// Slowest and fastest rate that a client may ask for, in frames per second.
const RATES: std::ops::RangeInclusive<f64> = 0.01..=1000.0;

/// Most scenes of one client that are looked for and baked at a time.
const IMPORTS_MAX: usize = 16;

/// The same of all clients, those that left before the end among them.
const IMPORTS_OF_ALL_MAX: usize = 64;

impl Cluster {
    /// A client asks for something. It gets exactly one reply, now or later.
    pub fn handle_request(
        &mut self,
        now: Micros,
        client: SessionId,
        id: RequestId,
        request: Request,
    ) {
        let job = RequestOf { client, id };
        if tracing::enabled!(Level::DEBUG) {
            self.span_of_request(job).in_scope(|| tracing::debug!(?request, "a client asks"));
        }
        match self.translate(now, job, request) {
            Ok(Some(reply)) => {
                self.remember();
                self.reply(job, Ok(reply));
            }
            // The reply comes with a frame, an import or a change.
            Ok(None) => {}
            Err(reason) => {
                if tracing::enabled!(Level::DEBUG) {
                    let tell = || tracing::debug!(reason, "a request is refused");
                    self.span_of_request(job).in_scope(tell);
                }
                self.reply(job, Err(Failure::new(reason)));
            }
        }
        self.advance_frame(now);
    }

    fn translate(
        &mut self,
        now: Micros,
        job: RequestOf,
        request: Request,
    ) -> Result<Option<Reply>, String> {
        match request {
            Request::OpenScene { path } => return self.import(job, path),
            Request::OpenOutcome { session, of } => return self.claim_outcome(job, session, of),
            Request::CloseScene => {
                let operations = vec![Operation::CloseScene];
                let purpose = Purpose::Scene { job, summary: None };
                self.request_change(now, Change { operations, purpose });
                return Ok(None);
            }
            Request::SetCamera(camera) => self.camera = checked_camera(camera)?,
            Request::SetEye(position) => self.set_head(Head { position, ..self.head })?,
            Request::SetHead(head) => self.set_head(head)?,
            Request::SetViews(views) => self.set_views(views)?,
            Request::SetExposure(exposure) => {
                if !(exposure.is_finite() && exposure >= 0.0) {
                    return Err(format!("an exposure is 0 or more, not {exposure}"));
                }
                self.exposure = exposure;
            }
            Request::RenderFrame { camera, time_s } => {
                let camera = camera.map(checked_camera).transpose()?;
                if time_s.is_some_and(|time| !time.is_finite()) {
                    return Err("the time of a frame is a finite number of seconds".into());
                }
                return self.order(FrameOrder { camera, time_s, ..FrameOrder::plain(job) });
            }
            Request::Capture => {
                return self.order(FrameOrder { capture: true, ..FrameOrder::plain(job) });
            }
            Request::SetDisplays(mode) => {
                let wish = Some(Wish::Displays(mode));
                return self.order(FrameOrder { wish, ..FrameOrder::plain(job) });
            }
            Request::SetPattern(pattern) => {
                let wish = Some(Wish::Pattern(pattern));
                return self.order(FrameOrder { wish, ..FrameOrder::plain(job) });
            }
            Request::Tune { channel, changes } => {
                return self.tune(now, job, &channel, &changes);
            }
            Request::Run(pace) => {
                if let Pace::Rate(rate) = pace
                    && !RATES.contains(&rate)
                {
                    let (low, high) = (RATES.start(), RATES.end());
                    return Err(format!("a rate is {low} to {high} frames per second, not {rate}"));
                }
                self.set_pace(Some(pace), now);
            }
            Request::Pause => self.set_pace(None, now),
            Request::Status => return Ok(Some(Reply::Status(Box::new(self.status(now))))),
            Request::DescribeWall => return Ok(Some(Reply::Wall(Box::new(self.wall.clone())))),
            Request::DescribeSight => return Ok(Some(Reply::Sight(Box::new(self.sight())))),
            Request::Statistics { reset } => {
                return Ok(Some(Reply::Statistics(Box::new(self.statistics(reset)))));
            }
            Request::Subscribe(wish) => {
                if let Some(client) = self.clients.get_mut(&job.client) {
                    client.is_subscribed = wish;
                }
            }
            Request::Stop => return Ok(self.stop(job)),
            Request::StopServers => {
                // Answered by the event loop, which hears the goodbyes of servers.
                self.outputs.push_back(Output::StopServers { job });
                return Ok(None);
            }
        }
        Ok(Some(Reply::Done))
    }

    /// Answers before the end: afterwards there is nobody to do it.
    fn stop(&mut self, job: RequestOf) -> Option<Reply> {
        self.reply(job, Ok(Reply::Done));
        self.outputs.push_back(Output::Stop);
        None
    }

    fn import(&mut self, job: RequestOf, path: String) -> Result<Option<Reply>, String> {
        if path.is_empty() || path.len() > PATH_BYTES_MAX {
            return Err(format!("a scene's path has 1 to {PATH_BYTES_MAX} bytes"));
        }
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
        let scene = progress::name_of(&path);
        self.outcomes.begin(job);
        self.imports.push(Importing { job, scene, progress: OpenProgress::NONE });
        self.outputs.push_back(Output::Import { job, path });
        Ok(None)
    }

    fn order(&mut self, order: FrameOrder) -> Result<Option<Reply>, String> {
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
