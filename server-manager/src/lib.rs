//! The server manager: the one process of a wall that decides.
//!
//! The crate `polyptych-core` decides, without sockets or a clock; [`run()`] gives it both. The
//! crate `polyptych-baker` turns foreign files into blobs; the manager runs it as a child process
//! only.

mod acceptor;
mod assets;
mod authenticator;
mod bulk;
pub mod capture;
mod capture_sender;
mod client_session;
mod entry_store;
mod environment;
pub mod http;
pub mod import;
pub mod leadership;
pub mod lease;
mod mesh_walk;
mod metrics;
mod nearest_point;
mod ray_cast;
mod recorded_cluster;
pub mod recorder;
mod region_search;
pub mod replay;
mod requests;
mod run;
pub mod scene_export;
#[cfg(test)]
mod scene_fixture;
mod scene_folders;
mod scene_index;
mod server_session;
mod session;
mod state_file;
mod stored_scene;
mod stored_session;
mod strangers;
mod traffic;
mod triangle_cache;
mod walk;

pub use run::{ManagerError, ManagerOptions, run};
