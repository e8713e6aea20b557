//! The wall file's shape: what may be written, with which defaults. What it means is checked in
//! [`check`](super::check); the docs here become the JSON Schema's, which editors show.

mod adjust;
mod curved;
mod device;
mod launch;
mod lists;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(super) use adjust::{AdjustSection, BendSection, EdgesSection, WarpObj, WarpZero};
pub(super) use curved::{CylinderSection, ProjectorSection, SphereSection};
pub(super) use device::{
    DeviceKind, DeviceSection, FlySection, FormChoice, FrameSection, HeadSection,
};
pub use launch::LaunchOutput;
pub(super) use launch::{LaunchSection, ServerSection};
pub(super) use lists::{Pair, Rotation, Row, ScalarOrRgb};
use lists::{exact, some_exact};

use polyptych_wall::limits::{
    DEADLINE_FACTOR_DEFAULT, DEADLINE_MAX_DEFAULT, DEADLINE_MIN_DEFAULT, HEARTBEAT_DEFAULT,
    PORT_DEFAULT,
};
use polyptych_wall::viewpoint::STEREO_ERROR_DEFAULT_PX;
use polyptych_wall::{
    BlendConfig, EYE_SEPARATION_DEFAULT_M, NEAR_DEFAULT_M, ShadowFilter, StereoMode,
};

/// A wall: the screens of a display system and the channels that tile them. Lengths are in
/// metres of display space (+X right, +Y up, the viewer looks along −Z), angles in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Polyptych wall file")]
pub struct Document {
    /// What holds for the whole wall.
    pub wall: WallSection,
    /// How long a frame waits for a channel.
    #[serde(default)]
    pub deadline: DeadlineSection,
    /// When frames are sent and swapped.
    #[serde(default)]
    pub sync: SyncSection,
    /// Addresses and silence.
    #[serde(default)]
    pub network: NetworkSection,
    /// Folders.
    #[serde(default)]
    pub storage: StorageSection,
    /// The memory that servers may take.
    #[serde(default)]
    pub budget: BudgetSection,
    /// How channels share the light of a place that several of them light.
    #[serde(default)]
    pub blend: BlendSection,
    /// The surfaces, each with its channels. At least one.
    #[serde(default)]
    pub screen: Vec<ScreenSection>,
    /// `[channel.NAME]`: what makes a channel's picture right on its display, however the channel
    /// was made.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub channel: BTreeMap<String, AdjustSection>,
    /// How the wall's processes are started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub launch: Option<LaunchSection>,
    /// `[server.NAME]`: the machine of a server that channels name, and how it is started there.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub server: BTreeMap<String, ServerSection>,
    /// Trackers, wands and pads, which `polyptych devices` reads; 16 at most.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub device: Vec<DeviceSection>,
}

/// What holds for the whole wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallSection {
    /// What to call the wall: letters a–z, digits, "-", "_" and ".", 64 at most.
    pub name: String,
    /// Where the viewer's eye stands, [x, y, z] in metres. Default: the origin.
    #[serde(default, deserialize_with = "exact")]
    pub eye: [f64; 3],
    /// Distance of the near plane from the eye, in metres; the same for all channels.
    #[serde(default = "near_default")]
    pub near: f64,
    /// Samples per pixel against jagged edges: 1 or 4.
    #[serde(default = "samples_default")]
    pub samples: u32,
    /// From the left eye to the right one, in metres.
    #[serde(default = "eye_separation_default")]
    pub eye_separation: f64,
    /// Where the eyes of stereo channels are: "head", left and right of a viewer who looks one
    /// way, or "omnidirectional", left and right of every direction, for viewers who look all
    /// around on cylinders and domes.
    #[serde(default)]
    pub stereo: StereoMode,
    /// With stereo = "omnidirectional": by how many pixels a point on the screen or behind it may
    /// be off for each eye; less takes more pictures. Default: 0.5.
    #[serde(default = "stereo_error_default")]
    pub stereo_error: f64,
    /// Whether codes are dithered where a channel's light is corrected.
    #[serde(default)]
    pub dither: bool,
    /// The shadows of a scene's lights: "soft", "hard", whose edges are as jagged as the maps of
    /// shadows, "contact-hardening", which are softer the farther they are from what casts them, or
    /// "off".
    #[serde(default)]
    pub shadows: ShadowFilter,
}

/// How channels share the light of a place that several of them light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BlendSection {
    /// Steepness of the ramps: 1 is a smooth step, larger numbers are steeper in the middle.
    pub exponent: f64,
    /// What a projector shows of black, as a share of its white; 0 for panels.
    pub leak: f64,
}

/// How long a frame waits for a channel: `factor` times the median draw time, within bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeadlineSection {
    /// Times the wall's median draw time; 1 or more.
    pub factor: f64,
    /// Never shorter than this, in milliseconds.
    pub min_ms: u32,
    /// Never longer than this, in milliseconds.
    pub max_ms: u32,
}

/// When frames are sent and swapped.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SyncSection {
    /// 1: the next frame is sent while the last one waits for its swap, so that the round trip to
    /// the servers does not add to each frame; what is seen lags by one frame more, and each
    /// window takes the memory of one more picture. 0: one frame after the other.
    pub pipeline_depth: u32,
    /// Servers present a frame so many milliseconds after its swap command was sent, all at one
    /// instant of the manager's clock, which they estimate: for displays without genlock. More than
    /// the longest way to a server takes; 0 to 100. 0: each presents it as the command arrives.
    pub swap_lead_ms: u32,
}

/// Addresses and silence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkSection {
    /// Where the manager listens, ADDRESS:PORT. Port 0: any that is free.
    pub listen: String,
    /// A peer that is silent for this many milliseconds is lost.
    pub heartbeat_ms: u32,
}

/// Folders, and object stores by their URLs. Folders that begin without "/" stand in the wall
/// file's own folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StorageSection {
    /// Where servers look for baked scenes before they ask the manager: shared disks as folders,
    /// object stores as s3://BUCKET/PREFIX, gs://BUCKET/PREFIX, az://CONTAINER/PREFIX or
    /// https://HOST/PREFIX. Credentials come from the environment of each server.
    pub stores: Vec<String>,
    /// From where scenes may be opened; nothing outside is.
    pub scenes: Vec<String>,
}

/// The memory that each server may take for the open scene. A scene that needs more is shown with
/// fewer levels of detail, the same on all servers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BudgetSection {
    /// Maximum size of a scene's meshes and textures on the GPU of a server, in MiB; 1 to 1048576.
    /// Default: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gpu_mib: Option<u32>,
    /// Maximum size of the parts of a scene that a server holds in its main memory at once while it
    /// loads them, in MiB; 64 to 1048576. Default: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub host_mib: Option<u32>,
}

/// A surface that channels cover. A planar one's place is given by three corners, as the viewer
/// sees them, or by size, center and rotation; others by cylinder, sphere or mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScreenSection {
    /// What to call the screen; unique in the wall. Letters a–z, digits, "-", "_", ".", 64 at most.
    pub name: String,
    /// Corner [x, y, z] in metres.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub lower_left: Option<[f64; 3]>,
    /// Corner [x, y, z] in metres.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub lower_right: Option<[f64; 3]>,
    /// Corner [x, y, z] in metres.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub upper_left: Option<[f64; 3]>,
    /// Instead of corners: [width, height] in metres.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub size: Option<[f64; 2]>,
    /// With size: the middle [x, y, z] in metres.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 3]>,
    /// With size: [yaw, pitch, roll] in degrees, each right-handed. At [0, 0, 0] the screen stands
    /// upright and faces +Z. It is rolled about its own normal first (positive: counter-clockwise
    /// as the viewer sees it), then pitched about +X (90 is a ceiling, −90 a floor), then
    /// yawed about +Y (90 is a wall at the viewer's left). Default: [0, 0, 0].
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f64; 3]>,
    /// A patch of a cylinder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<CylinderSection>,
    /// A patch of a sphere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere: Option<SphereSection>,
    /// A mesh file (OBJ or glTF) in metres of display space, whose texture coordinates run over
    /// the canvas. It stands in the wall file's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// How channels get their frusta. Default: shared, or own for canvases beyond 8,192 pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projection: Option<ProjectionChoice>,
    /// With channels by hand: the canvas, [width, height] of the whole screen in pixels.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u32; 2]>,
    /// Channels as a grid of equal tiles; or write each by hand under screen.channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tiles: Option<TilesSection>,
    /// Channels by hand.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channel: Vec<ChannelSection>,
    /// With channels by hand: parts of the canvas that no channel shows, such as bezels.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden: Vec<HiddenSection>,
}

/// How the channels of a screen get their frusta.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ProjectionChoice {
    /// One matrix for the screen, viewports shifted by whole pixels: fewest differing pixels.
    Shared,
    /// A frustum for each channel: for canvases longer than a viewport can span.
    Own,
}

/// A grid of equal tiles that fills a screen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TilesSection {
    /// How many side by side.
    #[serde(default = "one")]
    pub columns: u32,
    /// How many above each other.
    #[serde(default = "one")]
    pub rows: u32,
    /// [width, height] of one tile in pixels.
    #[serde(deserialize_with = "exact")]
    pub pixels: [u32; 2],
    /// Gap between tiles, [across, down] in metres, behind which the picture goes on. Rounded to
    /// even pixels; `polyptych check` prints to how many. The screen's size includes the gaps.
    #[serde(default, deserialize_with = "exact", skip_serializing_if = "is_zero")]
    pub bezel: [f64; 2],
    /// Pixels that neighbours share, [across, down]; projectors blend there. Even numbers are
    /// best. Not together with bezel.
    #[serde(default, deserialize_with = "exact", skip_serializing_if = "is_none")]
    pub overlap: [u32; 2],
    /// Names of the channels, row by row from the upper left. Default: the screen's name for one
    /// tile, else SCREEN-COLUMN-ROW, counted from 1 at the upper left.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Servers that drive them, in the same order. Default: each channel's own name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub servers: Vec<String>,
}

/// One output image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChannelSection {
    /// Unique in the wall. Letters a–z, digits, "-", "_", ".", 64 at most.
    pub name: String,
    /// Its upper left pixel, [x, y] from the upper left of the canvas; even numbers are best. Where
    /// a projector or a warp file says what the channel shows, this is only where its window
    /// stands among those of the screen.
    #[serde(default, deserialize_with = "some_exact", skip_serializing_if = "Option::is_none")]
    pub origin: Option<[u32; 2]>,
    /// [width, height] in pixels.
    #[serde(deserialize_with = "exact")]
    pub pixels: [u32; 2],
    /// The projector that throws it onto the screen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<ProjectorSection>,
    /// The server that drives it; several channels may name the same. Default: the channel's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub server: Option<String>,
}

/// A part of the canvas that no channel shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HiddenSection {
    /// Its upper left pixel, [x, y] from the upper left of the canvas.
    #[serde(deserialize_with = "exact")]
    pub origin: [u32; 2],
    /// [width, height] in pixels.
    #[serde(deserialize_with = "exact")]
    pub pixels: [u32; 2],
}

impl Default for DeadlineSection {
    fn default() -> Self {
        Self {
            factor: DEADLINE_FACTOR_DEFAULT,
            min_ms: DEADLINE_MIN_DEFAULT.as_millis() as u32,
            max_ms: DEADLINE_MAX_DEFAULT.as_millis() as u32,
        }
    }
}

impl Default for BlendSection {
    fn default() -> Self {
        let BlendConfig { exponent, leak } = BlendConfig::default();
        Self { exponent, leak }
    }
}

impl Default for NetworkSection {
    fn default() -> Self {
        Self {
            listen: format!("127.0.0.1:{PORT_DEFAULT}"),
            heartbeat_ms: HEARTBEAT_DEFAULT.as_millis() as u32,
        }
    }
}

impl Default for StorageSection {
    fn default() -> Self {
        Self { stores: Vec::new(), scenes: vec![".".to_owned()] }
    }
}

fn near_default() -> f64 {
    NEAR_DEFAULT_M
}

fn samples_default() -> u32 {
    1
}

fn eye_separation_default() -> f64 {
    EYE_SEPARATION_DEFAULT_M
}

fn stereo_error_default() -> f64 {
    STEREO_ERROR_DEFAULT_PX
}

fn one() -> u32 {
    1
}

fn is_zero(bezel: &[f64; 2]) -> bool {
    *bezel == [0.0, 0.0]
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks in this form")]
fn is_none(overlap: &[u32; 2]) -> bool {
    *overlap == [0, 0]
}
