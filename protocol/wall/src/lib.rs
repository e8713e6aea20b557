//! The wall: screens in display space, and the channels that tile them.
//!
//! These types are what travels and what is drawn from; they hold only what was checked. A wall
//! file is read, checked and turned into them by the crate `polyptych-wall-file`.

pub mod blend;
pub mod calibration_change;
pub mod calibration_maps;
pub mod camera;
pub mod channel;
pub mod channel_calibration;
pub mod channel_mapping;
pub mod color;
pub mod device;
mod drawable;
pub mod foldover;
pub mod frustum;
pub mod head;
pub mod head_limits;
mod identity;
pub mod light_composite;
pub mod limits;
mod lit_area;
pub mod mesh_bvh;
pub mod pick_ray;
pub mod pick_region;
mod pixel_density;
pub mod projector;
pub mod region;
pub mod screen;
mod shadow_filter;
pub mod surface;
pub mod surface_sample;
pub mod tour;
pub mod triangle_bvh;
pub mod triangle_distance;
pub mod unfold;
pub mod view;
pub mod view_atlas;
pub mod viewpoint;
pub mod wall_geometry;
pub mod warp;
pub mod warp_mesh;

use glam::DVec3;
use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

pub use channel::{Channel, ChannelId, ChannelKind, FrustumMode};
pub use channel_calibration::{
    BitDepth, BlendWidths, ChannelCalibration, ColorCorrection, Eye, Orientation, Ramps,
    StereoPacking, TransferFunction,
};
pub use screen::{Bezel, Screen};
pub use shadow_filter::ShadowFilter;
pub use surface::Surface;
pub use viewpoint::{StereoMode, StereoRule, Viewpoint};

use crate::device::Device;
use crate::limits::{
    CANVAS_SIDE_MAX, CHANNEL_SIDE_MAX, CHANNELS_MAX, DEADLINE_FACTOR_DEFAULT, DEADLINE_MAX_DEFAULT,
    DEADLINE_MIN_DEFAULT, DEVICES_MAX, HEARTBEAT_DEFAULT, PIPELINE_DEPTH_MAX, SCREENS_MAX,
    SWAP_LEAD_MS_MAX, WALL_FILES_MAX,
};

/// From one eye to the other: the mean of adults, N. Dodgson, *Variation and extrema of human
/// interpupillary distance*, 2004.
pub const EYE_SEPARATION_DEFAULT_M: f64 = 0.063;

/// Nothing is nearer to the eye than this, unless a wall file says otherwise.
pub const NEAR_DEFAULT_M: f64 = 0.05;

/// The whole display system that one wall file describes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// The wall's name.
    pub name: String,
    /// Surfaces, in the order of the file.
    pub screens: Vec<Screen>,
    /// Output images; a [`ChannelId`] is an index into this list.
    pub channels: Vec<Channel>,
    /// The position of the viewer's eye, in metres of display space.
    pub eye: DVec3,
    /// From the left eye to the right one, in metres; channels for one eye see from half of it.
    pub eye_separation_m: f64,
    /// The rule for the pictures of stereo channels.
    pub stereo: StereoRule,
    /// Distance of the near plane from the eye, in metres of display space; the same for all
    /// channels, so that depth agrees.
    pub near_m: f64,
    /// Samples per pixel: 1 or 4.
    pub samples: u32,
    /// The rule by which channels that light the same places share the light.
    pub blend: BlendConfig,
    /// `true` if codes are dithered where a channel's light is corrected.
    pub dither: bool,
    /// Files of others that channels and screens refer to, by their index in this list.
    pub files: Vec<CalibrationFile>,
    /// The rule for the time that a frame waits for a channel.
    pub deadline: DeadlinePolicy,
    /// The timing of sending and swapping frames.
    pub sync: SyncPolicy,
    /// A peer that is silent this long is lost.
    pub heartbeat_ms: u32,
    /// The address that the manager listens on.
    pub listen: String,
    /// Folders and URLs of object stores in which servers look for blobs before they ask the
    /// manager.
    pub stores: Vec<String>,
    /// Folders from which scenes may be opened.
    pub scenes: Vec<String>,
    /// The memory that each server may take for the open scene.
    #[serde(default)]
    pub budget: MemoryBudget,
    /// The shadows of a scene's lights.
    #[serde(default)]
    pub shadows: ShadowFilter,
    /// Trackers, wands and pads.
    #[serde(default)]
    pub devices: Vec<Device>,
}

/// The memory that each server may take for the open scene; `None` for no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemoryBudget {
    /// Maximum size of meshes and textures on the GPU in MiB: within [`limits::GPU_MIB`].
    pub gpu_mib: Option<u32>,
    /// Maximum size of parts of the scene in main memory while they are loaded, in MiB: within
    /// [`limits::HOST_MIB`].
    pub host_mib: Option<u32>,
}

impl MemoryBudget {
    /// Returns whether both are in their ranges.
    pub fn is_valid(self) -> bool {
        self.gpu_mib.is_none_or(|mib| limits::GPU_MIB.contains(&mib))
            && self.host_mib.is_none_or(|mib| limits::HOST_MIB.contains(&mib))
    }

    /// Returns the maximum size of meshes and textures on the GPU, in bytes.
    pub fn gpu_bytes(self) -> Option<u64> {
        self.gpu_mib.map(|mib| u64::from(mib) << 20)
    }

    /// Returns the maximum size of parts of the scene in main memory, in bytes.
    pub fn host_bytes(self) -> Option<u64> {
        self.host_mib.map(|mib| u64::from(mib) << 20)
    }
}

/// The time that a frame waits: `factor` × the wall's median draw time, within bounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeadlinePolicy {
    /// Times the median draw time.
    pub factor: f64,
    /// Never shorter than this.
    pub min_ms: u32,
    /// Never longer than this.
    pub max_ms: u32,
}

/// The timing of sending and swapping frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SyncPolicy {
    /// Frames that are sent ahead of the one that waits for its swap: 0 to
    /// [`PIPELINE_DEPTH_MAX`](limits::PIPELINE_DEPTH_MAX).
    pub pipeline_depth: u32,
    /// Time from the swap command to the instant at which all servers present the frame, by their
    /// estimates of the manager's clock; 0 to
    /// [`SWAP_LEAD_MS_MAX`](limits::SWAP_LEAD_MS_MAX), 0 where they present as it arrives.
    pub swap_lead_ms: u32,
}

/// The rule by which channels share the light of a place that several of them light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlendConfig {
    /// Steepness of the ramps: 1 is a smooth step, larger numbers are steeper in the middle.
    pub exponent: f64,
    /// The black level of a projector, as a share of its white; 0 for panels.
    pub leak: f64,
}

/// A file of another program: a map of pixels, a mesh of a screen, a mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrationFile {
    /// Its path, as in the wall file.
    pub path: String,
    /// Its kind.
    pub kind: CalibrationFileKind,
    /// The blob that it was baked to; `None` before baking, never in a wall that servers get.
    pub blob: Option<BlobHash>,
    /// `true` if it is right for the eye of the wall file only, as maps on a canvas are: then no
    /// head moves. Known after baking.
    pub is_for_one_eye: bool,
    /// Some places of its surface, if it has any, which tell where no eye can be. Known after
    /// baking.
    pub front: Vec<surface_sample::SurfaceSample>,
}

/// The kind of a wall's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CalibrationFileKind {
    /// The position of each pixel of a channel.
    Warp,
    /// The surface of a screen.
    ScreenMesh,
    /// The factor of the light.
    Alpha,
    /// The minimum of the light.
    Beta,
    /// A warp in a PFM whose pixels at (0, 0, 0) are unlit.
    WarpDarkZeros,
    /// A warp in an OBJ whose positions are places of the picture, and whose texture coordinates
    /// are places of the canvas.
    WarpSgct,
}

impl Default for BlendConfig {
    fn default() -> Self {
        Self { exponent: 1.0, leak: 0.0 }
    }
}

impl Wall {
    /// Returns the black level of a channel's display, as a share of its white in red, green and
    /// blue.
    pub fn leak_of(&self, channel: &Channel) -> DVec3 {
        channel.adjustment.color.leak.unwrap_or(DVec3::splat(self.blend.leak))
    }

    /// A wall of these screens and channels, with the eye at the origin and a wall file's defaults
    /// for all else; opens no folder, and listens on any port of this machine.
    pub fn new(name: &str, screens: Vec<Screen>, channels: Vec<Channel>) -> Self {
        Self {
            name: name.to_owned(),
            screens,
            channels,
            eye: DVec3::ZERO,
            eye_separation_m: EYE_SEPARATION_DEFAULT_M,
            stereo: StereoRule::default(),
            near_m: NEAR_DEFAULT_M,
            samples: 1,
            blend: BlendConfig::default(),
            dither: false,
            files: Vec::new(),
            deadline: DeadlinePolicy {
                factor: DEADLINE_FACTOR_DEFAULT,
                min_ms: DEADLINE_MIN_DEFAULT.as_millis() as u32,
                max_ms: DEADLINE_MAX_DEFAULT.as_millis() as u32,
            },
            sync: SyncPolicy::default(),
            heartbeat_ms: HEARTBEAT_DEFAULT.as_millis() as u32,
            listen: "127.0.0.1:0".to_owned(),
            stores: Vec::new(),
            scenes: Vec::new(),
            budget: MemoryBudget::default(),
            shadows: ShadowFilter::default(),
            devices: Vec::new(),
        }
    }

    /// Returns the fault of a wall that came over the wire, if any: an index that points nowhere, a
    /// size beyond the limits, an invalid number. A wall file is checked for more.
    pub fn fault(&self) -> Option<String> {
        if self.channels.len() > CHANNELS_MAX || self.screens.len() > SCREENS_MAX {
            return Some("the wall has more channels or screens than any may have".into());
        }
        if self.samples != 1 && self.samples != 4 {
            return Some(format!("{} samples per pixel, where 1 or 4 can be", self.samples));
        }
        if !(self.near_m.is_finite() && self.near_m > 0.0 && self.eye.is_finite()) {
            return Some("the eye or the near plane is not finite".into());
        }
        let is_large = |screen: &&Screen| screen.canvas.max_element() > CANVAS_SIDE_MAX;
        if let Some(screen) = self.screens.iter().find(is_large) {
            return Some(format!("screen {} is longer than {CANVAS_SIDE_MAX} pixels", screen.name));
        }
        let is_separate = self.eye_separation_m.is_finite() && self.eye_separation_m >= 0.0;
        let BlendConfig { exponent, leak } = self.blend;
        if !(is_separate && exponent > 0.0 && exponent.is_finite() && (0.0..1.0).contains(&leak)) {
            return Some("the eye separation or the rule of blends is out of range".into());
        }
        let SyncPolicy { pipeline_depth, swap_lead_ms } = self.sync;
        if pipeline_depth > PIPELINE_DEPTH_MAX || swap_lead_ms > SWAP_LEAD_MS_MAX {
            return Some("frames are sent or swapped further ahead than may be".into());
        }
        if !self.budget.is_valid() {
            return Some("the budget of memory is out of range".into());
        }
        if !self.stereo.is_sound() {
            return Some("the error of omnidirectional stereo is out of range".into());
        }
        if self.devices.len() > DEVICES_MAX {
            return Some(format!("the wall has more than {DEVICES_MAX} devices"));
        }
        if self.files.len() > WALL_FILES_MAX {
            return Some(format!("the wall has more than {WALL_FILES_MAX} files"));
        }
        let is_odd = |file: &CalibrationFile| {
            file.front.len() > surface_sample::FRONT_PLACES_MAX
                || !file.front.iter().all(surface_sample::SurfaceSample::is_valid)
        };
        if self.files.iter().any(is_odd) {
            return Some("a file has more places than it may have, or no numbers".into());
        }
        self.screens
            .iter()
            .find_map(|screen| screen.fault(self.files.len()))
            .or_else(|| self.channels.iter().find_map(|channel| self.fault_of(channel)))
    }

    /// Returns the fault of a channel's numbers that came over the wire, if any.
    pub(crate) fn fault_of(&self, channel: &Channel) -> Option<String> {
        let is_bad = self.screens.get(usize::from(channel.screen)).is_none_or(|screen| {
            let end = channel.origin.saturating_add(channel.size);
            channel.size.min_element() == 0
                || channel.size.max_element() > CHANNEL_SIDE_MAX
                || (channel.cover == ChannelKind::Tile && end.cmpgt(screen.canvas).any())
        });
        if is_bad {
            return Some(format!("channel {} does not lie on its screen", channel.name));
        }
        if channel.monitor.as_deref().is_some_and(|name| !channel::is_monitor_name(name)) {
            return Some(format!("channel {} has an invalid monitor name", channel.name));
        }
        let fault = channel.cover.fault().or_else(|| channel.adjustment.fault(self.files.len()));
        fault.map(|fault| format!("channel {}: {fault}", channel.name))
    }

    /// The channel of this id.
    pub fn channel(&self, id: ChannelId) -> Option<&Channel> {
        self.channels.get(usize::from(id.0))
    }

    /// The channel of this name, with its id.
    pub fn channel_by_name(&self, name: &str) -> Option<(ChannelId, &Channel)> {
        let index = self.channels.iter().position(|channel| channel.name == name)?;
        Some((ChannelId(u16::try_from(index).ok()?), &self.channels[index]))
    }

    /// The ids of all channels, in the order of the file.
    pub fn channel_ids(&self) -> impl Iterator<Item = ChannelId> + use<> {
        (0..u16::try_from(self.channels.len()).unwrap_or(u16::MAX)).map(ChannelId)
    }

    /// The screen that a channel lies on.
    pub fn screen_of(&self, channel: &Channel) -> &Screen {
        &self.screens[usize::from(channel.screen)]
    }
}
