//! Drive a wall as if it were one window.
//!
//! A [`Client`] is a handle to one connection with a wall's manager. The same calls drive one
//! channel or thirty; a client never talks to a render server and needs no GPU.
//! [`blocking::Client`] has the same calls for programs without tokio.
//!
//! ```no_run
//! use polyptych_client::{Client, ClientError, fit_bounds};
//!
//! # async fn example() -> Result<(), ClientError> {
//! let wall = Client::connect("127.0.0.1:7878").await?;
//! let scene = wall.open_scene("town.glb").await?;
//! if let Some(bounds) = scene.bounds {
//!     wall.set_camera(fit_bounds(&wall.wall().await?, &bounds, 0.5)).await?;
//! }
//! let feedback = wall.render_frame().await?;
//! println!("frame {} took {} us", feedback.frame, feedback.frame_us);
//! for channel in feedback.missing_channels() {
//!     println!("{} does not show it: it is {}", channel.name, channel.state);
//! }
//! for picture in wall.capture().await?.screens {
//!     println!("{}: {} x {} pixels", picture.name, picture.width, picture.height);
//! }
//! # Ok(()) }
//! ```
//!
//! ```text
//! Client -submit-> in_flight table --bytes--> connection task --> manager
//! Pending <-reply-- in_flight table <-------- connection task <-- manager
//! FeedbackStream <- bounded queue, oldest dropped ----+
//! ```
//!
//! A request whose answer is not awaited any more frees its place. A connection that ends is made
//! again, so that a program outlives its manager: every request that was sent is told once that
//! its outcome is unknown, and nothing is repeated; see [`ConnectOptions::reconnect`].

mod assets;
pub mod blocking;
mod camera;
mod captures;
mod client;
mod clips;
mod connect;
mod connection;
mod connection_handle;
mod devices;
mod dial;
mod displays;
mod error;
mod exports;
mod feedback;
mod image;
mod in_flight;
#[cfg(feature = "labels")]
mod labels;
mod mesh_data;
mod outgoing;
mod pending;
mod reconnect;
mod saved_scenes;
mod scene;
mod scene_file;
mod scene_space;
mod sessions;
mod tours;
mod tunings;
mod variants;
mod window;

pub use assets::{AssetError, Assets};
pub use camera::{fit_bounds, orbit};
pub use client::Client;
pub use connect::{ConnectOptions, KEYS_VARIABLE, Timeouts};
pub use error::ClientError;
pub use feedback::{FEEDBACK_QUEUE_MAX, FeedbackStream};
pub use image::{CAPTURE_BYTES_MAX, Capture, Image};
pub use in_flight::OPEN_REQUESTS_MAX;
#[cfg(feature = "labels")]
pub use labels::{LABEL_BYTES_MAX, LABEL_KEY};
pub use mesh_data::MeshData;
pub use pending::Pending;
pub use reconnect::ReconnectPolicy;
pub use scene_file::SceneFile;

pub use glam;
pub use polyptych_protocol::calibration_marker::{CalibrationMarker, MarkedPoint};
pub use polyptych_protocol::clip::{ClipAction, ClipChange, ClipStatus, ClipSummary};
pub use polyptych_protocol::delivery::QUEUED_REQUESTS_MAX;
pub use polyptych_protocol::device_status::{DeviceState, DeviceStatus};
pub use polyptych_protocol::environment::EnvironmentSource;
pub use polyptych_protocol::exported_scene::ExportedScene;
pub use polyptych_protocol::feedback::{
    ChannelFeedback, ChannelState, ChannelStatistics, ChannelStatus, FrameFeedback, Quantiles,
    ResolutionScales, Shown, Skew, Statistics, WallStatus,
};
pub use polyptych_protocol::feedback::{Edited, Tuned};
pub use polyptych_protocol::follow::Follow;
pub use polyptych_protocol::head_update::HeadUpdate;
pub use polyptych_protocol::ids::{Digest, Epoch, FrameId, RequestId, Revision};
pub use polyptych_protocol::leader_status::LeaderStatus;
pub use polyptych_protocol::navigation::Flight;
pub use polyptych_protocol::node_query::{
    LayerInfo, NODES_MAX, NearestPoint, NearestQuery, NodeInfo, NodeKind, NodePage, NodeQuery,
    RayHit, RayQuery, RegionQuery,
};
pub use polyptych_protocol::output_mode::OutputMode;
pub use polyptych_protocol::pattern::TestPattern;
pub use polyptych_protocol::presentation::Presentation;
pub use polyptych_protocol::progress::{OpenProgress, OpenStage, Opening};
pub use polyptych_protocol::quality_bounds::{DrawnDetail, ERROR_PX_MAX, QualityBounds};
pub use polyptych_protocol::request::{Pacing, Request, Response, SceneSummary, StoppedServers};
pub use polyptych_protocol::saved_scene::{SAVED_PREFIX, SavedScene};
pub use polyptych_protocol::saved_session::{OpenedSession, SavedSession};
pub use polyptych_protocol::scene_file_list::{
    SCENE_FILES_MAX, SCENE_FOLDERS, SceneFileInfo, SceneFileList,
};
pub use polyptych_protocol::screen_rest::{LitHours, RestRules, RestStatus};
pub use polyptych_protocol::stored_view::StoredView;
pub use polyptych_protocol::tour_status::TourStatus;
pub use polyptych_protocol::transaction::{AssetNumbers, AssetSource, NewAssets, Transaction};
pub use polyptych_protocol::tuned_channel::TunedChannel;
pub use polyptych_protocol::variant::VariantList;
pub use polyptych_protocol::walk_query::{
    Touched, WAY_POINTS_MAX, WalkEnd, WalkQuery, WalkedWay, Walker,
};
pub use polyptych_scene::{
    AlphaMode, AmbientOcclusion, Anisotropy, Attribute, BakedLight, Bounds, CAMERA_KEY, Clearcoat,
    DepthOfField, DiffuseTransmission, Edit, Facing, Fill, Fog, FramePass, Glow, Highlight,
    Iridescence, Light, LightKind, Material, MaterialExtensions, NewNode, NodeId, NodeStyle,
    SceneFeatures, SceneSubset, Shading, Sheen, Specular, TextureRef, ToneMapper, Topology,
    Transmission, Volume, provisional_asset,
};
pub use polyptych_wall::calibration_change;
pub use polyptych_wall::camera::Camera;
pub use polyptych_wall::head::HeadPose;
pub use polyptych_wall::pick_ray::Ray;
pub use polyptych_wall::region::{HalfSpace, Region, Relation};
pub use polyptych_wall::tour::{Easing, Tour, TourError, TourStop};
pub use polyptych_wall::view::{Area, View, ViewProjection};
pub use polyptych_wall::{Channel, Screen, Wall};
