//! The passes of a frame; each has its shader beside it.

pub mod correct;
pub mod idle;
pub mod label;
pub(crate) mod opaque;
pub mod output;
pub(crate) mod tonemap;
pub(crate) mod transparent;
