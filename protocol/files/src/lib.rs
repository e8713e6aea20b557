//! Files that appear whole or not at all: blobs, what commands write, and what holds secrets.

pub mod blob;
pub mod output_file;
pub mod private_file;
