//! The resources of the interface, each with its part of the table of routes.

pub(super) mod camera;
pub(super) mod capture;
pub(super) mod live;
pub(super) mod pick;
pub(super) mod pictures;
pub(super) mod presentation;
pub(super) mod saved_sessions;
pub(super) mod scene;
pub(super) mod session;
pub(super) mod wall;
