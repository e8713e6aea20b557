//! Damaged input of every kind, in counts: whatever comes, there is no panic, no allocation
//! beyond the limit and no hang. Everything comes from one seed, which a failure prints:
//! `POLYPTYCH_SEED=N cargo test --test mutations` runs it again, or with another.
//!
//! - `decoder`: a million frames of all messages, and who they are for
//! - `handshake`: strangers on the manager's port, while a good wall goes on
//! - `wall_file`: damaged wall files
//! - `device_packet`: damaged packets of trackers
//! - `scene_import`: damaged scenes through the baker
//! - `wall_map`: damaged warp maps, meshes, masks and MPCDI archives
//! - `findings`: what was found once, so that it stays mended
//! - `corpus`: what the coverage-guided targets of `tests/fuzz` begin from

mod corpus;
mod decoder;
mod device_packet;
mod findings;
mod handshake;
mod map_file;
mod message;
mod mutation;
mod receiver;
mod scene_file;
mod scene_import;
mod seeds;
mod server;
mod wall_file;
mod wall_map;
mod wall_shape;
mod wall_text;

/// Returns the seed of this run's tests: the same each time, unless `POLYPTYCH_SEED` gives another.
pub fn seed() -> u64 {
    let given = std::env::var("POLYPTYCH_SEED").ok();
    given.map_or(20_261, |text| text.parse().expect("POLYPTYCH_SEED is a number"))
}
