//! Blobs: immutable bytes that are named by their hash, and folders of them.

mod blob_store;
mod hash;
mod partial_blob;
mod reader;
mod store_url;
mod temporary;

pub use blob_store::{BlobError, BlobStore};
pub use hash::{BlobHash, BlobHasher};
pub use partial_blob::PartialBlob;
pub use reader::BlobReader;
pub use store_url::{StoreScheme, StoreUrl, StoreUrlError};
pub use temporary::{Abandoned, place, remove_abandoned};

/// Largest blob: 16,384² pixels with mip levels are 1.4 GiB, and wgpu's buffers end at 2 GiB.
pub const BLOB_BYTES_MAX: u64 = 2 << 30;

/// Largest piece of a blob or picture in one message, so that nothing waits long behind it.
pub const CHUNK_BYTES_MAX: usize = 1 << 20;
