//! Every number that both ends must agree on, with its reason.

use std::time::Duration;

/// The version of the wire protocol. A peer of another version is refused by both numbers.
pub const PROTOCOL_VERSION: u16 = 4;

/// Largest control message. A status of 1,024 channels takes about 200 KiB.
pub const MESSAGE_BYTES_MAX: usize = 4 << 20;

/// Maximum size of a client's message, in bytes: a tuning of a whole grid takes 30 KiB.
pub const CALL_BYTES_MAX: usize = 128 << 10;

/// Largest message of a peer that has not finished the handshake: strangers get no memory.
pub const HANDSHAKE_BYTES_MAX: usize = 4 << 10;

/// Time for the whole handshake: enough for a slow link, too short to hold connections open.
pub const HANDSHAKE_TIME_MAX: Duration = Duration::from_secs(5);

/// Largest piece of a blob or picture in one message, so that nothing waits long behind it.
pub const CHUNK_BYTES_MAX: usize = 1 << 20;

/// Largest message of the bulk connection: one chunk and its head.
pub const BULK_BYTES_MAX: usize = CHUNK_BYTES_MAX + 128;

/// Largest blob: 16,384² pixels with mip levels are 1.4 GiB, and wgpu's buffers end at 2 GiB.
pub const BLOB_BYTES_MAX: u64 = 2 << 30;

/// Largest manifest: about a million nodes.
pub const MANIFEST_BYTES_MAX: usize = 512 << 20;

/// Maximum number of draws of a scene, a draw being one primitive in one place. A few kilobytes of
/// glTF can name billions. A render server holds 324 bytes for each draw (its place, its box and
/// its share of the tree that culls it), and at most 360 more while it is on screen: 1.4 GiB in
/// all.
pub const DRAWS_MAX: u64 = 2 << 20;

/// Maximum product of the draws and the lights of a scene: each pair is tested once when a scene is
/// prepared, in about 2 ns.
pub const LIT_DRAWS_MAX: u64 = 8 << 30;

/// Longest side of a texture; what the weakest supported driver can hold.
pub const TEXTURE_SIDE_MAX: u32 = 8192;

/// Most channels of a wall; the largest walls known have a few hundred.
pub const CHANNELS_MAX: usize = 1024;

/// Most screens of a wall.
pub const SCREENS_MAX: usize = 256;

/// Most files that a wall refers to: three for each channel, and one for each screen.
pub const WALL_FILES_MAX: usize = 3 * CHANNELS_MAX + SCREENS_MAX;

/// Most control points of a channel's bend: 32 × 32 are more than anybody moves by hand, and finer
/// maps come as files.
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

/// Maximum number of notes of a scene; a broken exporter repeats itself.
pub const NOTES_MAX: usize = 64;

/// Maximum length of a note in bytes: a line of a terminal and a half. All notes of a scene take
/// 16 KiB of every status.
pub const NOTE_BYTES_MAX: usize = 256;

/// Most views of one frame.
pub const VIEWS_MAX: usize = 64;

/// Most rectangles into which views that lie over each other divide a channel: each is culled and
/// drawn on its own.
pub const VIEW_PARTS_MAX: usize = 256;

/// Silence after which a peer is lost, where the wall file says nothing else.
pub const HEARTBEAT_DEFAULT: Duration = Duration::from_secs(2);

/// How many pings are sent in one heartbeat limit: one may get lost in a stall.
pub const PINGS_PER_HEARTBEAT: u32 = 4;

/// Shortest frame deadline by default: a scheduler's slice must not make a channel late.
pub const DEADLINE_MIN_DEFAULT: Duration = Duration::from_millis(50);

/// Longest frame deadline by default: nobody should look at a frozen wall for longer.
pub const DEADLINE_MAX_DEFAULT: Duration = Duration::from_secs(2);

/// The deadline by default, as a multiple of the wall's median draw time.
pub const DEADLINE_FACTOR_DEFAULT: f64 = 4.0;

/// The manager's port where a wall file names none.
pub const PORT_DEFAULT: u16 = 7878;
