//! Turns the readings of trackers, wands and pads into heads and flights of a wall, without sockets
//! and without a clock.
//!
//! ```text
//! packet --osc--> messages --osc_input--> pose --sensor_pose--> display space
//!   display space --pose_filter--> head
//!   messages --osc_input--> values of sticks --flight_controls--> flight
//! ```
//!
//! [`Bridge`] holds the devices of a wall and decides what to send to the manager and when; its
//! caller owns the sockets and the clock.

pub mod bridge;
mod device_reader;
mod flight_controls;
mod head_pacer;
pub mod joystick;
mod latency_meter;
pub mod osc;
mod osc_input;
mod packet_order;
pub mod pose_filter;
mod pose_track;
mod rotation_reading;
pub mod sensor_pose;
pub mod spacenav;
pub mod vrpn;

pub use bridge::Bridge;

/// Microseconds of the caller's clock, which never goes back.
pub type Micros = u64;

fn micros_from_ms(ms: u32) -> Micros {
    Micros::from(ms) * 1000
}

fn seconds(micros: Micros) -> f64 {
    micros as f64 / 1e6
}
