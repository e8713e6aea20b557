//! Promises to clients: every request has one answer, and what was said to be done is remembered.

use std::collections::{BTreeMap, BTreeSet};

use polyptych_protocol::feedback::FrameFeedback;
use polyptych_protocol::ids::{FrameId, RequestId, Revision};
use polyptych_protocol::request::{MessageToClient, Pacing, Request, Response};
use polyptych_protocol::state_log::SceneRef;
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::View;

use super::super::{ClientRequest, Cluster, Micros, PersistentState, SessionId};
use super::invariant::InvariantChecker;
use super::world::Check;

/// Open requests, and what clients were promised.
#[derive(Debug, Default)]
pub struct DurabilityChecker {
    open: BTreeMap<(SessionId, RequestId), Request>,
    clients: BTreeSet<SessionId>,
    subscribed: BTreeMap<SessionId, FrameId>,
    /// Frames since statistics were reset, counted here.
    frames: u64,
    last: Option<PersistentState>,
    told: ClientView,
    pub answers: u64,
    pub refusals: u64,
    /// Within the input that is being answered.
    pub is_tuning_refused: bool,
}

/// The state of the wall as clients were told it; `None` where they were told nothing.
#[derive(Debug, Default)]
struct ClientView {
    scene: Option<(Revision, Option<String>)>,
    camera: Option<Camera>,
    head: Option<HeadPose>,
    views: Option<Vec<View>>,
    #[expect(clippy::option_option, reason = "told nothing, told to stand, told to run")]
    pace: Option<Option<Pacing>>,
}

impl DurabilityChecker {
    pub fn open_requests(&self) -> usize {
        self.open.len()
    }

    pub fn an_open_request(&self) -> Option<String> {
        self.open.iter().next().map(|(of, request)| format!("{of:?} {request:?}"))
    }
}

impl InvariantChecker {
    /// A manager begins: it has what clients were told, as its memory says.
    pub fn manager_starts(
        &mut self,
        cluster: &Cluster,
        started: Micros,
        memory: Option<&PersistentState>,
    ) -> Check {
        self.begin_life(cluster.epoch(), started);
        self.promises.frames = 0;
        if std::mem::take(&mut self.is_cut_short) {
            // It may have remembered what it had no time to tell.
            let scene = self.promises.told.scene.take();
            self.promises.told = ClientView { scene, ..ClientView::default() };
        }
        let told = &self.promises.told;
        if let Some((revision, scene)) = &told.scene {
            let now = cluster.shown.revision;
            let name = cluster.shown.scene.as_ref().map(|scene| scene.name.clone());
            if now < *revision || (now == *revision && name != *scene) {
                return Err(format!("told {scene:?} at {revision}, restored {name:?} at {now}"));
            }
        }
        let Some(memory) = memory else { return Ok(()) };
        let is_kept = told.camera.is_none_or(|camera| cluster.presentation.camera == camera)
            && told.head.is_none_or(|head| cluster.presentation.head == head)
            && told.views.as_ref().is_none_or(|views| cluster.presentation.views == *views)
            && cluster.presentation.exposure == memory.presentation.exposure
            && told.pace.is_none_or(|pace| cluster.pacer.pace() == pace)
            && cluster.shown.scene == memory.scene
            && (cluster.shown.edits == memory.edits || !memory.temporary.is_empty())
            && cluster.shown.revision.0 - memory.revision.0
                <= u64::from(!memory.temporary.is_empty());
        if !is_kept {
            return Err(format!("told {told:?}, remembered {memory:?}, but restored otherwise"));
        }
        Ok(())
    }

    pub fn manager_ends(&mut self) {
        self.promises.open.clear();
        self.promises.clients.clear();
        self.promises.subscribed.clear();
    }

    pub fn client_joins(&mut self, session: SessionId) {
        self.promises.clients.insert(session);
    }

    pub fn client_leaves(&mut self, session: SessionId) {
        self.promises.clients.remove(&session);
        self.promises.subscribed.remove(&session);
        self.promises.open.retain(|(client, _), _| *client != session);
    }

    pub fn asked(&mut self, client: SessionId, id: RequestId, request: Request) {
        if let Request::RenderFrame { camera: Some(_), .. } | Request::PlayTour(_) = request {
            // Where a client was with a frame, or a tour, is remembered now and then only.
            self.promises.told.camera = None;
        }
        self.promises.open.insert((client, id), request);
    }

    /// The mouse over a window moves the camera away from where a client has set it.
    pub fn camera_moves(&mut self) {
        self.promises.told.camera = None;
    }

    pub fn remembered(&mut self, memory: &PersistentState) -> Check {
        let last = self.promises.last.replace(memory.clone());
        if last.as_ref().is_some_and(|last| last.revision > memory.revision) {
            return Err(format!("revision {} is remembered after {last:?}", memory.revision));
        }
        Ok(())
    }

    /// A capture is answered by the manager's collection, from here on.
    pub fn collects(&mut self, job: ClientRequest, frame: FrameId, channels: usize) -> Check {
        match self.promises.open.remove(&(job.client, job.id)) {
            Some(Request::Capture { .. }) => {}
            None if !self.promises.clients.contains(&job.client) => {}
            other => return Err(format!("a capture of frame {frame} answers {other:?}")),
        }
        if channels != self.wall_channels() {
            return Err(format!("a capture speaks of {channels} channels"));
        }
        Ok(())
    }

    pub fn answered(
        &mut self,
        to: SessionId,
        answer: &MessageToClient,
        memory: Option<&PersistentState>,
    ) -> Check {
        if !self.promises.clients.contains(&to) {
            return Err(format!("{to:?} is gone, but is answered"));
        }
        match answer {
            MessageToClient::Feedback(feedback) => {
                self.feedback_sent += 1;
                self.check_feedback(feedback)?;
                let Some(last) = self.promises.subscribed.get_mut(&to) else {
                    return Err(format!("{to:?} did not ask for feedback"));
                };
                let before = std::mem::replace(last, feedback.frame);
                if before >= feedback.frame {
                    return Err(format!("feedback of {} after {before}", feedback.frame));
                }
                Ok(())
            }
            MessageToClient::Reply { id, reply } => {
                let Some(request) = self.promises.open.remove(&(to, *id)) else {
                    return Err(format!("{to:?} is answered {id} again, or did not ask"));
                };
                self.promises.answers += 1;
                let failure = match reply {
                    Ok(reply) => return self.check_reply(to, &request, reply, memory),
                    Err(failure) => failure,
                };
                self.promises.refusals += 1;
                self.promises.is_tuning_refused |= matches!(request, Request::Tune { .. })
                    && failure.reason.starts_with("nothing has changed");
                Ok(())
            }
            MessageToClient::Chunk(_)
            | MessageToClient::Goodbye(_)
            | MessageToClient::Progress { .. }
            | MessageToClient::Warning { .. }
            | MessageToClient::Heartbeat => Ok(()),
        }
    }

    fn check_feedback(&self, feedback: &FrameFeedback) -> Check {
        // A frame that was sent to nobody, or drawn wrong by all, is not swapped by anyone.
        let is_seen = self.revision_of(feedback.frame).is_some();
        let is_shown = is_seen && !self.was_drawn_wrong(feedback.frame);
        if feedback.frame < self.swapped || (is_shown && feedback.frame != self.swapped) {
            let (frame, last) = (feedback.frame, self.swapped);
            return Err(format!("feedback of frame {frame}, but {last} was swapped last"));
        }
        let revision = self.revision_of(feedback.frame);
        if is_seen && revision != Some(feedback.revision) {
            return Err(format!("frame {} shows {revision:?}, but {feedback:?}", feedback.frame));
        }
        Ok(())
    }

    #[expect(clippy::too_many_lines, reason = "one table of what each request is answered with")]
    fn check_reply(
        &mut self,
        to: SessionId,
        request: &Request,
        reply: &Response,
        memory: Option<&PersistentState>,
    ) -> Check {
        let is_kept = |is: fn(&PersistentState, &Request) -> bool| match memory {
            Some(memory) if is(memory, request) => Ok(()),
            _ => Err(format!("{request:?} was done, but {memory:?} is remembered")),
        };
        let scene_of = |memory: Option<&PersistentState>| {
            memory.map(|m| (m.revision, m.scene.as_ref().map(|s: &SceneRef| s.name.clone())))
        };
        let told = &mut self.promises.told;
        match (request, reply) {
            (Request::OpenScene { .. }, Response::SceneOpened(summary)) => {
                told.scene = scene_of(memory);
                if told.scene != Some((summary.revision, Some(summary.name.clone()))) {
                    return Err(format!("{summary:?} was opened, but {memory:?} is remembered"));
                }
            }
            (Request::CloseScene, Response::Done) => {
                told.scene = scene_of(memory);
                is_kept(|memory, _| memory.scene.is_none())?;
            }
            (Request::SetCamera(camera), Response::Done) => {
                let rotation = camera.rotation.normalize();
                let camera = Some(Camera { rotation, ..*camera });
                if memory.map(|memory| memory.presentation.camera) != camera {
                    return Err(format!("{camera:?} was set, but {memory:?} is remembered"));
                }
                // A frame that waits may still place it elsewhere.
                let places =
                    |r: &Request| matches!(r, Request::RenderFrame { camera: Some(_), .. });
                told.camera = camera.filter(|_| !self.promises.open.values().any(places));
            }
            (Request::SetHead(_), Response::Done) => {
                told.head = memory.map(|memory| memory.presentation.head);
                is_kept(|memory, asked| {
                    let head = memory.presentation.head;
                    matches!(asked, Request::SetHead(update) if update.apply(&head) == head)
                })?;
            }
            (Request::SetViews(views), Response::Done) => {
                told.views = Some(views.clone());
                is_kept(|memory, asked| {
                    *asked == Request::SetViews(memory.presentation.views.clone())
                })?;
            }
            (Request::SetExposure(_), Response::Done) => {
                is_kept(|memory, asked| {
                    *asked == Request::SetExposure(memory.presentation.exposure)
                })?;
            }
            (Request::SetBounds(_), Response::Done) => {
                is_kept(|memory, asked| *asked == Request::SetBounds(memory.presentation.bounds))?;
            }
            (Request::Run(pace), Response::Done) => {
                told.pace = Some(Some(*pace));
                is_kept(|memory, asked| memory.pace.is_some_and(|p| *asked == Request::Run(p)))?;
            }
            (Request::Pause, Response::Done) => {
                told.pace = Some(None);
                is_kept(|memory, _| memory.pace.is_none())?;
            }
            (Request::RenderFrame { .. }, Response::Frame(feedback)) => {
                self.check_feedback(feedback)?;
            }
            (Request::Subscribe(wish), Response::Done) => {
                if *wish {
                    self.promises.subscribed.entry(to).or_default();
                } else {
                    self.promises.subscribed.remove(&to);
                }
            }
            (Request::Status, Response::Status(status)) => {
                let is_whole = status.channels.len() == self.wall_channels();
                if status.frame < self.swapped || !is_whole || status.epoch != self.epoch {
                    return Err(format!("a status of frame {}: {status:?}", self.swapped));
                }
                let seen = &status.presentation;
                let told = &self.promises.told;
                let is_it = told.head.is_none_or(|head| seen.head == head)
                    && told.views.as_ref().is_none_or(|views| seen.views == *views);
                if !is_it {
                    return Err(format!("told {told:?}, but asked it is {seen:?}"));
                }
            }
            (Request::Statistics { reset }, Response::Statistics(statistics)) => {
                // Frames that nobody was sent are counted too.
                if statistics.frames < self.promises.frames {
                    let (theirs, ours) = (statistics.frames, self.promises.frames);
                    return Err(format!(
                        "statistics of {theirs} frames, where {ours} were swapped"
                    ));
                }
                if *reset {
                    self.promises.frames = 0;
                }
            }
            (Request::Tune { .. }, Response::Tuned(tuned)) => {
                let of = self.revision_of(tuned.feedback.frame);
                let is_shown = of.is_some() && !self.was_drawn_wrong(tuned.feedback.frame);
                let is_late = tuned.feedback.frame < self.swapped;
                let is_early = is_shown && tuned.feedback.frame != self.swapped;
                if is_late || is_early || of.is_some_and(|of| of < tuned.revision) {
                    return Err(format!("{tuned:?}, but frame {} was swapped last", self.swapped));
                }
            }
            (Request::Edit(_), Response::Edited(edited)) => {
                let of = self.revision_of(edited.feedback.frame);
                if of.is_some_and(|of| of < edited.revision) {
                    return Err(format!("{edited:?}, and that frame shows {of:?}"));
                }
                if memory.is_none_or(|memory| memory.revision < edited.revision) {
                    return Err(format!("{edited:?}, but {memory:?} is remembered"));
                }
            }
            (Request::PlayTour(_), Response::Done) => {
                is_kept(|memory, asked| {
                    let kept = memory.tour.as_ref().map(|played| &played.tour);
                    matches!(asked, Request::PlayTour(tour) if kept == Some(tour))
                })?;
            }
            (Request::StopTour, Response::Done) => is_kept(|memory, _| memory.tour.is_none())?,
            (Request::StoreView { .. }, Response::Done) => {
                is_kept(|memory, _| memory.stored_views.len() == 1)?;
            }
            (Request::RemoveView { .. }, Response::Done) => {
                is_kept(|memory, _| memory.stored_views.is_empty())?;
            }
            (Request::DescribeTour, Response::Tour(_))
            | (Request::DescribeWall, Response::Wall(_))
            | (Request::Stop, Response::Done) => {}
            (request, reply) => return Err(format!("{request:?} is answered by {reply:?}")),
        }
        Ok(())
    }

    pub fn count_frame(&mut self) {
        self.promises.frames += 1;
    }
}
