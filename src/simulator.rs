//! The laboratory: a wall on one machine, faults on purpose, measurements, and a scene to show.

pub(crate) mod barrier;
pub(crate) mod benchmark;
pub(crate) mod ending;
pub(crate) mod faults;
pub(crate) mod frame_series;
pub(crate) mod gallery;
pub(crate) mod local_wall;
pub(crate) mod look;
pub(crate) mod orbit;
pub(crate) mod run_page;
pub(crate) mod run_report;
pub(crate) mod town;
pub(crate) mod verify;
