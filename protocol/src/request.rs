//! Requests of clients to the manager, and the answers.
//!
//! Every request has exactly one answer, which carries its number.

use polyptych_scene::{
    AmbientOcclusion, Bounds, DepthOfField, Fog, Glow, SceneFeatures, ToneMapper,
};
use polyptych_text::text_of_peer;
use polyptych_wall::Wall;
use polyptych_wall::calibration_change::CalibrationChange;
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::Tour;
use polyptych_wall::view::View;
use serde::{Deserialize, Serialize};

use crate::calibration_marker::CalibrationMarker;
pub use crate::capture_info::{CaptureInfo, ImageInfo, ReplyChunk};
use crate::clip::{ClipChange, ClipStatus, ClipSummary};
use crate::command::Goodbye;
use crate::delivery::Delivery;
use crate::device_status::DeviceStatus;
use crate::environment::EnvironmentSource;
use crate::exported_scene::ExportedScene;
use crate::feedback::{Edited, FrameFeedback, Statistics, Tuned, WallStatus};
use crate::follow::Follow;
use crate::head_update::HeadUpdate;
use crate::ids::{RequestId, Revision};
use crate::navigation::Flight;
use crate::node_query::{
    LayerInfo, NearestPoint, NearestQuery, NodePage, NodeQuery, RayHit, RayQuery, RegionQuery,
};
use crate::output_mode::OutputMode;
pub use crate::pacing::Pacing;
use crate::pattern::TestPattern;
use crate::progress::OpenProgress;
use crate::quality_bounds::QualityBounds;
pub use crate::request_error::{CAPTURE_ROOM_TAKEN, RequestError};
use crate::saved_scene::SavedScene;
use crate::saved_session::{OpenedSession, SavedSession};
use crate::scene_file_list::SceneFileList;
use crate::screen_rest::RestRules;
pub use crate::stopped_servers::StoppedServers;
use crate::stored_view::StoredView;
use crate::tour_status::TourStatus;
use crate::transaction::Transaction;
use crate::tuned_channel::TunedChannel;
use crate::variant::VariantList;
use crate::walk_query::{WalkQuery, WalkedWay};

/// A message from a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestMessage {
    /// The client's own number, unique among its open requests.
    pub id: RequestId,
    /// The request.
    pub request: Request,
    /// The condition for beginning the request.
    pub delivery: Delivery,
}

impl RequestMessage {
    /// A request that is begun in its turn.
    pub fn new(id: RequestId, request: Request) -> Self {
        Self { id, request, delivery: Delivery::Immediate }
    }
}

/// A request of a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Request {
    /// Shows a scene; answered once every live channel can draw it.
    OpenScene {
        /// A file in one of the manager's scene folders, absolute or relative to one of them; or
        /// `saved:NAME` for one that was saved.
        path: String,
        /// The scene of a file that has several, by its name, or by its number from 0 on if none
        /// has that name; where not given, the one that the file names, or its first. A scene that
        /// was saved has no others.
        scene: Option<String>,
    },
    /// Shows none.
    CloseScene,
    /// Places display space in the scene, from the next frame on.
    SetCamera(Camera),
    /// Multiplies light before tone mapping, from the next frame on and until another scene is
    /// opened, which has its own ([`SceneSummary::exposure`]). Ends an automatic one.
    SetExposure(f32),
    /// Draws and shows one frame; answered by its feedback.
    RenderFrame {
        /// Placed first, where given.
        camera: Option<Camera>,
        /// Scene time in seconds; where not given, the wall's own clock goes on.
        time_s: Option<f64>,
    },
    /// Goes on drawing frames by itself.
    Run(Pacing),
    /// Stops that.
    Pause,
    /// Draws and shows one frame, and sends its pictures.
    Capture {
        /// Scene time in seconds; where not given, the wall's own clock goes on.
        time_s: Option<f64>,
    },
    /// Sends the wall's state.
    Status,
    /// Sends the wall's description.
    DescribeWall,
    /// Sends what the frames took since the last time it was asked to forget.
    Statistics {
        /// Forget afterwards, so that the next answer begins anew.
        reset: bool,
    },
    /// From now on sends the feedback of every frame, or no more.
    Subscribe(bool),
    /// Ends the manager.
    Stop,
    /// Changes what all displays show; answered by the feedback of the frame that carries it. A
    /// wall that is paused makes one for it.
    SetDisplays(OutputMode),
    /// Moves the viewer's head, from the next frame on; refused where one of its eyes would not
    /// see the front of a screen.
    SetHead(HeadUpdate),
    /// Lays these views over the wall's picture, the last on top, from the next frame on.
    SetViews(Vec<View>),
    /// Lets channels draw a test pattern, or the scene again; answered as [`Self::SetDisplays`].
    SetPattern(Option<TestPattern>),
    /// Changes a channel's adjustment, all of it or nothing; answered once a frame with it was
    /// swapped. A wall that is paused makes one for it.
    Tune {
        /// The channel's name.
        channel: String,
        /// The changes, in order.
        changes: Vec<CalibrationChange>,
    },
    /// Changes the open scene, all of it or nothing; answered once a frame with it was swapped. A
    /// wall that is paused makes one for it. Refused if the scene is replaced while files are read.
    Edit(Transaction),
    /// Asks for nodes of the open scene, as the state has it that frames name.
    FindNodes(NodeQuery),
    /// Asks what a ray meets first in the open scene, as the state has it that frames name.
    CastRay(RayQuery),
    /// Ends all servers and then the manager; answered with what became of the servers.
    StopServers,
    /// Asks what became of a [`Request::OpenScene`] whose connection was lost before its answer,
    /// in the same epoch. Its progress and its answer come as if this were that request.
    OpenOutcome {
        /// The lost connection, as its [`Welcome`](crate::handshake::Welcome) named it.
        session: u64,
        /// The number of the request on that connection.
        of: RequestId,
    },
    /// Asks for nodes of the open scene by their triangles' places, in the state that frames name.
    FindInRegion(RegionQuery),
    /// Asks for the point of the open scene's triangles that is nearest to a point, as the state
    /// has it that frames name.
    NearestPoint(NearestQuery),
    /// Keeps a place of the camera under a name, in the place of what had that name.
    StoreView {
        /// See [`StoredView::name`].
        name: String,
        /// The place; the present one if not given.
        camera: Option<Camera>,
    },
    /// Forgets a place of the camera.
    RemoveView {
        /// The name that it was stored under.
        name: String,
    },
    /// Asks for all places of the camera that are kept.
    ListStoredViews,
    /// Lets the camera move through stops. It begins with the next frame that is asked for or
    /// paced, and is evaluated for every frame as a function of scene time; what sets the camera
    /// otherwise, or opens another scene, ends it. A wall that is paused does not move by itself.
    PlayTour(Tour),
    /// Ends the tour, or what [`Request::FollowNode`] began; the camera stays where it is.
    StopTour,
    /// Asks how the tour stands.
    DescribeTour,
    /// Keeps the open scene with all that was changed of it under a name, in the place of what had
    /// that name. [`Request::OpenScene`] with `saved:NAME` opens it.
    SaveScene {
        /// See [`SavedScene::name`].
        name: String,
    },
    /// Asks for all scenes that were saved.
    ListSavedScenes,
    /// Forgets a scene that was saved.
    RemoveSavedScene {
        /// The name that it was saved under.
        name: String,
    },
    /// Lets the camera follow a node, for every frame as a function of where the node is in it and
    /// of scene time; answered once its place is known. What ends a tour ends it, and so does the
    /// end of the node.
    FollowNode(Follow),
    /// Asks how far a walker comes through the open scene, on the ground or in flight; in the state
    /// that frames name.
    FindWay(WalkQuery),
    /// Asks for a scene with all that was changed of it as a binary glTF file, whose pieces come
    /// before the answer. What is temporary is not in it.
    ExportScene {
        /// The name that it was saved under; the open scene if not given.
        saved: Option<String>,
    },
    /// Asks for the layers of the open scene.
    ListLayers,
    /// Bounds the error and the rate of pictures, from the next frame on.
    SetBounds(QualityBounds),
    /// Changes how clips of the scene are played; a wall that is paused makes a frame for it.
    ChangeClips(ClipChange),
    /// Asks for the clips of the open scene.
    ListClips,
    /// Surrounds scenes by light, until it is set again; answered once all can draw with it.
    SetEnvironment(EnvironmentSource),
    /// Sets how exposed light becomes what displays show, from the next frame on.
    SetTone(ToneMapper),
    /// Asks for the variants of the open scene; [`Request::Edit`] chooses one.
    ListVariants,
    /// Exposes the wall by what it shows, from the next frame on and until [`Self::SetExposure`].
    SetAutomaticExposure,
    /// Lays fog over what cameras see, from the next frame on; `None` takes it away.
    SetFog(Option<Fog>),
    /// Spreads light around what is bright, from the next frame on; `None` ends it.
    SetGlow(Option<Glow>),
    /// Darkens corners and gaps, from the next frame on; `None` ends it.
    SetAmbientOcclusion(Option<AmbientOcclusion>),
    /// Blurs what is nearer or farther than a distance; `None` ends it.
    SetDepthOfField(Option<DepthOfField>),
    /// Sends pictures as [`Request::Capture`] does, for a person who watches: of the wall's next
    /// frame, or of its last one at its own scene time. It waits for no channel longer than others.
    Preview {
        /// The least pixels across all screens, each the mean light of a square; 0 for all.
        width: u32,
    },
    /// Keeps all that the wall shows and how it shows it under a name, in the place of what had
    /// that name: the scene with all that was changed of it, camera, head, views, stored views,
    /// tour, light, surroundings, bounds, modes and pace. The wall's calibration is no part of it.
    SaveSession {
        /// See [`SavedSession::name`].
        name: String,
    },
    /// Shows a saved session in the place of all that is shown; answered once every live channel
    /// can draw it.
    OpenSession {
        /// The name that it was saved under.
        name: String,
    },
    /// Asks for all saved sessions.
    ListSessions,
    /// Forgets a saved session.
    RemoveSession {
        /// The name that it was saved under.
        name: String,
    },
    /// Lights a point of a channel over its test pattern, or none, from the next frame on. A wall
    /// that is paused makes one for it.
    MarkPoint(Option<CalibrationMarker>),
    /// Asks for the scene files in the manager's scene folders.
    ListSceneFiles,
    /// Sets the rules by which displays go dark by themselves.
    SetRest(RestRules),
    /// Moves the camera as wands and pads fly it, from the next frame on.
    Fly(Flight),
    /// Reports the state of the devices of the wall file that this client reads; they belong to the
    /// client until its connection ends.
    ReportDevices(Vec<DeviceStatus>),
    /// Places the camera, where given, and draws one frame as [`Request::RenderFrame`] does; with
    /// the scene time of the frame before if the wall is paused.
    Redraw(Option<Camera>),
    /// Asks for the keys of channels that were tuned since the manager loaded the wall file.
    ListTunings,
}

impl Request {
    /// Returns what the request does, as it stands behind "cannot".
    pub fn name(&self) -> &'static str {
        match self {
            Self::OpenScene { .. } | Self::OpenOutcome { .. } => "open the scene",
            Self::CloseScene => "close the scene",
            Self::SetCamera(_) => "set the camera",
            Self::SetHead(_) => "set the head",
            Self::SetViews(_) => "set the views",
            Self::SetExposure(_) => "set the exposure",
            Self::RenderFrame { .. } | Self::Redraw(_) => "render a frame",
            Self::Run(_) => "run",
            Self::Pause => "pause",
            Self::Capture { .. } => "capture the wall",
            Self::Preview { .. } => "preview the wall",
            Self::Status => "read the status",
            Self::DescribeWall => "read the wall's description",
            Self::Statistics { .. } => "read the statistics",
            Self::Subscribe(true) => "subscribe to feedback",
            Self::Subscribe(false) => "end the subscription",
            Self::Stop => "stop the manager",
            Self::StopServers => "stop the manager and its servers",
            Self::SetDisplays(_) => "change the displays",
            Self::SetPattern(_) => "change the pattern",
            Self::Tune { .. } => "tune the channel",
            Self::Edit(_) => "edit the scene",
            Self::FindNodes(_) => "find nodes",
            Self::CastRay(_) => "cast a ray",
            Self::FindInRegion(_) => "find nodes in the region",
            Self::NearestPoint(_) => "find the nearest point",
            Self::StoreView { .. } => "store the view",
            Self::RemoveView { .. } => "remove the view",
            Self::ListStoredViews => "list the stored views",
            Self::PlayTour(_) => "play the tour",
            Self::StopTour => "stop the tour",
            Self::DescribeTour => "read how the tour stands",
            Self::SaveScene { .. } => "save the scene",
            Self::ListSavedScenes => "list the saved scenes",
            Self::RemoveSavedScene { .. } => "remove the saved scene",
            Self::FollowNode(_) => "follow the node",
            Self::FindWay(_) => "find a way",
            Self::ExportScene { .. } => "export the scene",
            Self::ListLayers => "list the layers",
            Self::SetBounds(_) => "set the bounds",
            Self::ChangeClips(_) => "play the animation",
            Self::ListClips => "list the animations",
            Self::SetEnvironment(_) => "set the environment",
            Self::SetTone(_) => "set the tone mapper",
            Self::ListVariants => "list the variants",
            Self::SetAutomaticExposure => "set the automatic exposure",
            Self::SetFog(_) => "set the fog",
            Self::SetGlow(_) => "set the glow",
            Self::SetAmbientOcclusion(_) => "set the ambient occlusion",
            Self::SetDepthOfField(_) => "set the depth of field",
            Self::SaveSession { .. } => "save the session",
            Self::OpenSession { .. } => "open the session",
            Self::ListSessions => "list the sessions",
            Self::RemoveSession { .. } => "remove the session",
            Self::MarkPoint(_) => "mark the point",
            Self::ListSceneFiles => "list the scene files",
            Self::SetRest(_) => "set the rest of the displays",
            Self::Fly(_) => "fly the camera",
            Self::ReportDevices(_) => "report the devices",
            Self::ListTunings => "list the tunings",
        }
    }
}

/// A message to a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MessageToClient {
    /// The one answer to a request.
    Reply {
        /// The client's number of the request.
        id: RequestId,
        /// The outcome of the request.
        reply: Result<Response, RequestError>,
    },
    /// The outcome of a frame, for clients that subscribed.
    Feedback(FrameFeedback),
    /// A piece of what is too large for a reply; all pieces come before the reply.
    Chunk(ReplyChunk),
    /// The manager ends the connection.
    Goodbye(Goodbye),
    /// The progress of opening a scene: at most once a percent; in a bake, every few seconds too.
    Progress {
        /// The client's number of the request.
        id: RequestId,
        /// The progress so far.
        progress: OpenProgress,
    },
    /// A warning about a request that succeeds, such as that no restart keeps it; before the reply.
    Warning {
        /// The client's number of the request.
        id: RequestId,
        /// The warning's text.
        warning: String,
    },
    /// The manager's event loop works and leads the wall; sent every second.
    Heartbeat,
}

/// The outcome of a request that succeeded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response {
    /// It was done.
    Done,
    /// To [`Request::OpenScene`].
    SceneOpened(SceneSummary),
    /// To [`Request::RenderFrame`], [`Request::Redraw`], [`Request::SetDisplays`] and
    /// [`Request::SetPattern`]: the frame from which on it holds.
    Frame(FrameFeedback),
    /// To [`Request::Capture`] and [`Request::Preview`]: which frame, and the pictures that were
    /// sent before this.
    Captured(CaptureInfo),
    /// To [`Request::Status`].
    Status(Box<WallStatus>),
    /// To [`Request::DescribeWall`].
    Wall(Box<Wall>),
    /// To [`Request::Statistics`].
    Statistics(Box<Statistics>),
    /// To [`Request::Tune`].
    Tuned(Tuned),
    /// To [`Request::Edit`].
    Edited(Edited),
    /// To [`Request::FindNodes`] and [`Request::FindInRegion`].
    Nodes(NodePage),
    /// To [`Request::CastRay`]: what it meets, if anything.
    Ray(Option<RayHit>),
    /// To [`Request::StopServers`].
    ServersStopped(StoppedServers),
    /// To [`Request::NearestPoint`]: the point, if any is near enough.
    Nearest(Option<NearestPoint>),
    /// To [`Request::ListStoredViews`]: by name.
    StoredViews(Vec<StoredView>),
    /// To [`Request::DescribeTour`].
    Tour(Box<TourStatus>),
    /// To [`Request::ListSavedScenes`]: by name.
    SavedScenes(Vec<SavedScene>),
    /// To [`Request::FindWay`].
    Way(Box<WalkedWay>),
    /// To [`Request::ExportScene`]: the file that was sent before this.
    Exported(ExportedScene),
    /// To [`Request::ListLayers`]: by name.
    Layers(Vec<LayerInfo>),
    /// To [`Request::ListClips`]: in the order of their numbers.
    Clips(Vec<ClipStatus>),
    /// To [`Request::ListVariants`].
    Variants(VariantList),
    /// To [`Request::OpenSession`].
    SessionOpened(Box<OpenedSession>),
    /// To [`Request::ListSessions`]: by name.
    Sessions(Vec<SavedSession>),
    /// To [`Request::ListSceneFiles`].
    SceneFiles(SceneFileList),
    /// To [`Request::ListTunings`]: the channels that were tuned.
    Tunings(Vec<TunedChannel>),
}

impl Response {
    /// Returns whether it says that something has changed, which then must outlive the manager.
    pub fn tells_of_change(&self) -> bool {
        match self {
            Self::Status(_)
            | Self::Wall(_)
            | Self::Statistics(_)
            | Self::Nodes(_)
            | Self::Ray(_)
            | Self::Nearest(_)
            | Self::StoredViews(_)
            | Self::Tour(_)
            | Self::SavedScenes(_)
            | Self::Way(_)
            | Self::Exported(_)
            | Self::Layers(_)
            | Self::Clips(_)
            | Self::Variants(_)
            | Self::Sessions(_)
            | Self::SceneFiles(_)
            | Self::Tunings(_) => false,
            Self::Done
            | Self::SceneOpened(_)
            | Self::SessionOpened(_)
            | Self::Frame(_)
            | Self::Captured(_)
            | Self::Tuned(_)
            | Self::Edited(_)
            | Self::ServersStopped(_) => true,
        }
    }
}

/// A scene as a client needs to know it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSummary {
    /// The scene's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The revision that shows it.
    pub revision: Revision,
    /// The box that an overview shows: around everything drawn but backgrounds that are far larger
    /// than all else; `None` for an empty scene.
    pub bounds: Option<Bounds>,
    /// Each instance counted.
    pub triangles: u64,
    /// The renderer features that it needs.
    pub features: SceneFeatures,
    /// Parts of the file that are not drawn, or not as they are there; see
    /// [`polyptych_scene::Scene::notes`].
    #[serde(default, deserialize_with = "text_of_peer")]
    pub notes: Vec<String>,
    /// The exposure that the wall has from now on: 1, or what suits a scene that is lit in real
    /// units.
    pub exposure: f32,
    /// Its animations.
    #[serde(default)]
    pub clips: Vec<ClipSummary>,
}
