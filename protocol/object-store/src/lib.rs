//! Blobs in object stores: a folder of blobs that lies in a bucket of S3, Google Cloud Storage or
//! Azure, or on a web server.
//!
//! Objects have the names of files in a [`polyptych_files::blob::BlobStore`], so that a copy of
//! such a folder is a store. What comes from one is checked against its hash.

mod part_upload;
mod remote_store;
mod stop_signal;
mod store_fault;
mod upload;

pub use remote_store::RemoteStore;
pub use store_fault::{FaultKind, StoreFault};
pub use upload::{Uploaded, upload};
