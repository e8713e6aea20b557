//! The passes of a frame; each has its shader beside it.

pub(crate) mod ambient_occlusion;
pub(crate) mod background;
pub(crate) mod behind;
pub mod correct;
pub(crate) mod depth_of_field;
pub mod enlarge;
pub(crate) mod glow;
pub mod idle;
pub mod label;
pub(crate) mod occluder;
pub(crate) mod opaque;
pub mod present_pass;
pub mod reduce;
pub(crate) mod shadow;
pub(crate) mod tonemap;
pub(crate) mod transparent;
