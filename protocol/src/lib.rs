//! The wire protocol of clients, the manager and the render servers: ids, the wall description, the
//! scene as plain data, the four message types, the handshake and the framing.
//!
//! The crate does no I/O but the codec and the byte streams under it, knows no GPU and makes no
//! decision. Functions whose results both ends must agree on (frusta, the fold of the log, the
//! digest) stand here as pure functions.
//!
//! ```
//! use polyptych_codec::encode;
//! use polyptych_protocol::framing::decode;
//! use polyptych_protocol::request::Request;
//!
//! let bytes = encode(&Request::Status);
//! assert_eq!(decode::<Request>(&bytes), Ok(Request::Status));
//! ```

pub mod bulk;
pub mod calibration_marker;
mod capture_info;
pub mod clip;
pub mod command;
pub mod delivery;
pub mod device_status;
pub mod environment;
pub mod exported_scene;
pub mod feedback;
pub mod follow;
pub mod framing;
pub mod handshake;
pub mod handshake_io;
pub mod head_update;
pub mod ids;
pub mod leader_status;
pub mod limits;
pub mod luminance;
pub mod manager_addresses;
pub mod navigation;
pub mod node_query;
pub mod output_mode;
mod pacing;
pub mod pattern;
pub mod presentation;
pub mod process;
pub mod progress;
pub mod quality_bounds;
mod quantiles;
pub mod request;
mod request_error;
pub mod saved_scene;
pub mod saved_session;
pub mod scene_file_list;
pub mod screen_rest;
pub mod server_message;
pub mod service_notifier;
pub mod stall_limit;
pub mod state_log;
mod stopped_servers;
pub mod stored_view;
pub mod stream;
pub mod token;
pub mod tour_status;
pub mod transaction;
pub mod tuned_channel;
pub mod variant;
pub mod walk_query;
