//! Hostile peers and broken machines against real processes, each case as a named test in a short
//! form:
//!
//! - `squatter`: a program that holds the manager's port while the manager is down
//! - `door`: connections that say nothing, thousands of them
//! - `clients`: clients that ask too much, and clients that do not read
//! - `disk`: a state file that cannot be written

mod clients;
mod disk;
mod door;
mod squatter;
