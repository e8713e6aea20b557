//! Walls of files, which the crate itself cannot read.

mod carried_tunings;
mod dome_blend;
mod pick_ray;
mod unfolded_windows;
