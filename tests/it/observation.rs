//! A wall is observed: metrics, logs for programs, and a live status.

mod exposition;
mod logs;
pub mod metrics;
mod stuck;
mod watch;
