//! The passes of a frame; each has its shader beside it.

pub mod correct;
pub mod idle;
pub mod label;
pub(in crate::renderer) mod opaque;
pub mod output;
pub(in crate::renderer) mod tonemap;
pub(in crate::renderer) mod transparent;
