//! The tests of the whole, in reading order:
//!
//! - `tidy`: the repository's own rules, held by reading its sources

mod tidy;
