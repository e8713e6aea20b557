//! The maximum sizes of a wall, and the defaults of its waits, each with its reason.

use std::ops::RangeInclusive;
use std::time::Duration;

/// Most channels of a wall; the largest walls known have a few hundred.
pub const CHANNELS_MAX: usize = 1024;

/// Most screens of a wall.
pub const SCREENS_MAX: usize = 256;

/// Maximum number of trackers, wands and pads of a wall.
pub const DEVICES_MAX: usize = 16;

/// Most files that a wall refers to: three for each channel, and one for each screen.
pub const WALL_FILES_MAX: usize = 3 * CHANNELS_MAX + SCREENS_MAX;

/// Maximum number of control points of a channel's bend: 32 × 32 are more than a person moves by
/// hand, and finer maps come as files.
pub const BEND_POINTS_MAX: usize = 1024;

/// Most changes of one tuning: a whole grid of points, and all else that a channel has.
pub const TUNE_CHANGES_MAX: usize = BEND_POINTS_MAX + 16;

/// Largest share of its white that a display shows of black: what leaks more is no projector, as
/// four of them over one place leave a fifth of the contrast.
pub const LEAK_MAX: f64 = 0.2;

/// Most points of a measured curve: one for each code of 10 bits.
pub const CURVE_POINTS_MAX: usize = 1024;

/// Longest side of a channel: what the weakest supported driver can draw into.
pub const CHANNEL_SIDE_MAX: u32 = 8192;

/// Longest side of a canvas that a shared matrix serves: a viewport cannot span more.
pub const SHARED_CANVAS_SIDE_MAX: u32 = 8192;

/// Longest side of a screen's canvas.
pub const CANVAS_SIDE_MAX: u32 = 131_072;

/// Longest name of a wall, screen, channel, server or client, in bytes.
pub const NAME_BYTES_MAX: usize = 64;

/// Longest path of a scene in a request, in bytes.
pub const PATH_BYTES_MAX: usize = 4096;

/// Most views of one frame.
pub const VIEWS_MAX: usize = 64;

/// Maximum number of stored views of a wall: more are found in no list.
pub const STORED_VIEWS_MAX: usize = 256;

/// Maximum number of stops of a tour: those of a walk over rough ground. All, 400 KiB, are written
/// with the manager's state every second.
pub const TOUR_STOPS_MAX: usize = 4096;

/// Maximum time to a stop of a tour, and at it, in seconds: a day.
pub const TOUR_SECONDS_MAX: f64 = 86_400.0;

/// Most rectangles into which views that lie over each other divide a channel: each is culled and
/// drawn on its own.
pub const VIEW_PARTS_MAX: usize = 256;

/// Silence after which a peer is lost, where the wall file says nothing else.
pub const HEARTBEAT_DEFAULT: Duration = Duration::from_secs(2);

/// Shortest frame deadline by default: a scheduler's slice must not make a channel late.
pub const DEADLINE_MIN_DEFAULT: Duration = Duration::from_millis(50);

/// Maximum frame deadline by default: a wall should not be frozen for longer.
pub const DEADLINE_MAX_DEFAULT: Duration = Duration::from_secs(2);

/// The deadline by default, as a multiple of the wall's median draw time.
pub const DEADLINE_FACTOR_DEFAULT: f64 = 4.0;

/// Maximum number of frames that are sent ahead of the one that waits for its swap: one hides the
/// round trip to the servers, and each further one would show every input a frame later.
pub const PIPELINE_DEPTH_MAX: u32 = 1;

/// Maximum time from a swap command to the instant that it states, in milliseconds: the way to a
/// server on another continent takes as long, and everything that is seen comes so much later.
pub const SWAP_LEAD_MS_MAX: u32 = 100;

/// Range of the budget of GPU memory of each server, in MiB: up to a TiB, which no GPU has.
pub const GPU_MIB: RangeInclusive<u32> = 1..=1 << 20;

/// Range of the budget of main memory of each server, in MiB: the largest part of a scene that is
/// loaded as a whole must fit.
pub const HOST_MIB: RangeInclusive<u32> = 64..=1 << 20;

/// The manager's port where a wall file names none.
pub const PORT_DEFAULT: u16 = 7878;

/// Maximum number of corners of a prism's polygon: more than a person draws around a building, and
/// each is looked at for each triangle near the border.
pub const REGION_CORNERS_MAX: usize = 256;

/// Maximum number of planes around a convex region: their corners are found by looking at every
/// three of them.
pub const REGION_PLANES_MAX: usize = 64;

/// Maximum distance of a region from the origin, along each axis, in world units: products of three
/// such lengths are still finite.
pub const REGION_REACH_MAX: f64 = 1e100;
