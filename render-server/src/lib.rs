//! The render server: one machine's channels of a wall, drawn with wgpu.
//!
//! Four threads: the window system's on the main thread ([`window`]), the network's ([`mod@run`]),
//! one that loads blobs ([`loader`]), and the one that owns the GPU ([`render_thread`]).
//! The crate `polyptych-renderer` draws; it knows nothing of the wire.

mod blob_sources;
mod bulk;
mod channel_output;
pub mod clock;
pub mod connection_status;
mod correction;
mod desktop;
mod draw_delay;
mod ending;
pub mod frame_scheduler;
pub mod frame_views;
mod fullscreen;
mod loader;
mod manager_fetch;
mod mismatch;
mod monitor;
mod mouse;
mod network;
mod own_address;
mod pattern;
pub mod presentation_state;
mod reduced_grid;
mod render_event;
mod render_thread;
mod run;
mod term_guard;
mod touch;
mod watched_store;
mod window;
mod window_output;

pub use monitor::Monitor;
pub use polyptych_renderer::rasterize;
pub use run::{
    OutputKind, PRESENT_DELAY_MAX, ServerError, ServerOptions, Shutdown, TokenSource, gpus,
    monitors, run,
};
