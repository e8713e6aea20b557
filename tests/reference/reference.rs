//! A renderer in f64 that shares no code with the one it judges: slow, small, and plain to check.
//!
//! ```text
//! world -> view (pose, eye, screen) -> clip (homogeneous) -> raster (coverage, attributes) -> tone
//! ```
//!
//! It follows the incremental pipeline of Szirmay-Kalos' lecture, "Incremental 3D rendering", with
//! what that gets wrong or leaves out mended: attributes are interpolated with perspective, not
//! linearly on the screen; all is clipped before the division, so that a triangle around the eye
//! does not wrap through the ideal point; front is counter-clockwise, as in glTF; z is 1 at the
//! near plane and 0 at infinity, so that no far plane is needed; and frusta are off-axis.

pub mod clip;
pub mod facet;
pub mod raster;
pub mod tone;
pub mod view;
