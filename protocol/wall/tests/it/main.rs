//! Walls of files, which the crate itself cannot read.

mod carried_tunings;
mod dome_blend;
mod unfolded_windows;
