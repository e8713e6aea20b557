//! Shared code for tests of the whole: a wall of real processes, its pictures, and scenes.

pub mod adapter;
pub mod browser;
pub mod display;
pub mod keys;
pub mod local_wall;
pub mod maps;
pub mod model;
pub mod mouse;
pub mod pictures;
pub mod place;
pub mod process;
pub mod relay;
pub mod s3_server;
pub mod scenes;
pub mod signals;
pub mod simulation;
pub mod stage;
pub mod stub_server;
pub mod wait;
