//! Blended surfaces, far to near, over the opaque ones.

use crate::frame::{DrawContext, ListPart};

/// The fragment stage.
pub(crate) const SOURCE: &str = include_str!("transparent.wgsl");

/// Draws the blended draws of all views. They share the render pass of the opaque ones, so that
/// nothing is stored and loaded in between.
pub(crate) fn encode(pass: &mut wgpu::RenderPass<'_>, context: &DrawContext<'_>) {
    for view in 0..context.lists.len() {
        context.draw(pass, view, ListPart::Transparent);
    }
}
