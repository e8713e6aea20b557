//! The server manager: the one process of a wall that decides.
//!
//! The crate `polyptych-core` decides, without sockets or a clock; [`run`] gives it both. The crate
//! `polyptych-baker` turns foreign files into blobs; the manager runs it as a child process only.

mod brain;
mod bulk;
pub mod capture;
mod client_session;
mod delivery;
mod door;
mod gate;
pub mod import;
mod memory;
mod metrics;
pub mod record;
pub mod replay;
mod requests;
mod run;
mod server_session;
mod session;
mod strangers;
mod traffic;

pub use run::{ManagerError, ManagerOptions, run};
