//! Hostile peers against real processes, each case as a named test in a short form:
//!
//! - `squatter`: a program that holds the manager's port while the manager is down

mod squatter;
