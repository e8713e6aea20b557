//! The render server: one machine's channels of a wall, drawn with wgpu.
//!
//! Four threads: the window system's on the main thread ([`window`]), the network's ([`run`]),
//! one that loads blobs ([`loader`]), and the one that owns the GPU ([`render_thread`]).
//! The crate `polyptych-renderer` draws; it knows nothing of the wire.

pub mod apply;
mod bulk;
pub mod clock;
mod correction;
mod desktop;
mod display;
mod ending;
mod fullscreen;
mod loader;
mod mismatch;
mod monitor;
mod mouse;
mod network;
pub mod notice;
mod output;
mod pattern;
pub mod playback;
mod render_thread;
mod report;
mod run;
pub mod showing;
mod slowness;
mod window;

pub use monitor::Monitor;
pub use run::{
    OutputKind, PRESENT_DELAY_MAX, ServerError, ServerOptions, Shutdown, TokenSource, monitors, run,
};
