//! The limits of the wire that both ends must agree on, each with its reason.

use std::time::Duration;

use polyptych_files::blob::CHUNK_BYTES_MAX;

/// The version of the wire protocol. A peer of another version is refused by both numbers.
pub const PROTOCOL_VERSION: u16 = 1;

/// Largest control message. A status of 1,024 channels takes about 200 KiB.
pub const MESSAGE_BYTES_MAX: usize = 4 << 20;

/// Maximum size of a client's message, in bytes: a transaction that moves ten thousand nodes takes
/// 1.1 MiB.
pub const CALL_BYTES_MAX: usize = 2 << 20;

/// Largest message of a peer that has not finished the handshake: strangers get no memory.
pub const HANDSHAKE_BYTES_MAX: usize = 4 << 10;

/// Time for the whole handshake: enough for a slow link, too short to hold connections open.
pub const HANDSHAKE_TIME_MAX: Duration = Duration::from_secs(5);

/// Largest message of the bulk connection: one chunk and its head.
pub const BULK_BYTES_MAX: usize = CHUNK_BYTES_MAX + 128;

/// The number of pings in one heartbeat limit: one may get lost in a stall.
pub const PINGS_PER_HEARTBEAT: u32 = 4;

/// Time between two heartbeats that a manager sends to a client, however busy it is.
pub const CLIENT_HEARTBEAT_PERIOD: Duration = Duration::from_secs(1);

/// Maximum time in which nothing comes from a manager that has a standby, before a client tries the
/// others; the wall's heartbeat limit if that is longer. Several heartbeats may be late, and by
/// default another manager leads by then.
pub const MANAGER_SILENCE_MAX: Duration = Duration::from_secs(5);
