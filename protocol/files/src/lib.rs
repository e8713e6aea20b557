//! Files that appear whole or not at all: blobs, what commands write, and what holds secrets; and
//! which faults of their storage may pass.

pub mod blob;
pub mod output_file;
pub mod private_file;
pub mod storage_fault;
